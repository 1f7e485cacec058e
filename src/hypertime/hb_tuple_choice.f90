!> Choice of the tuples of a set of harmonics by their amplitudes: a set grows and shrinks with its motion.
!>
!> The amplitudes of the retained tuples are known, those of others to first order. The largest of all are selected
!> until the remainder is below a permitted tail. Source: Grolet and Thouverez, MSSP 30 (2012), who select among the
!> harmonics of one tone.
module hb_tuple_choice
   use hb_assert, only: assert, asserts_are_on
   use hb_error, only: error_t
   use hb_harmonics, only: canonical_sign, harmonics_t, new_box, new_harmonics
   use hb_kinds, only: int64, wp
   use hb_sorting, only: sort_descending
   implicit none
   private
   public :: chosen_tuples, largest_indices, lowest_order, new_doubled_set, new_lowest_set, shifted, tuple_union_t

   !> The union of many sets of tuples, in the order of addition: a hash table with open addressing, so that the sets
   !> of all points of a sweep take linear time. Source of the hash: FNV-1a, 32 bit, entry by entry.
   type :: tuple_union_t
      integer :: n = 0                                                !! number of tuples
      integer, allocatable, private :: entries(:, :)                  !! (n_tones, capacity), the first n are in use
      integer, allocatable, private :: slots(:)                       !! position of a tuple, 0 if free
   contains
      procedure :: add => tuple_union_add
      procedure :: add_one => tuple_union_add_one
      procedure :: list => tuple_union_list
      procedure :: reserve => tuple_union_reserve
   end type tuple_union_t

   real(wp), parameter :: retention_weight = 300.0_wp                 ! weight of the amplitude of a retained tuple
   integer, parameter :: lowest_orders(4) = [7, 5, 3, 2]              ! of the first box, by number of tones

contains

   !> Order of the first box.
   pure integer function lowest_order(n_tones)
      integer, intent(in) :: n_tones

      lowest_order = 1
      if (n_tones <= size(lowest_orders)) lowest_order = lowest_orders(n_tones)
   end function lowest_order

   !> Creates the lowest set: a small box and the tuples of the loads of a model.
   subroutine new_lowest_set(self, n_tones, loaded, error, order)
      type(harmonics_t), intent(out) :: self
      integer, intent(in) :: n_tones
      integer, intent(in) :: loaded(:, :)                             !! (n_tones, any), signs as given
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: order                          !! of the box, otherwise `lowest_order`
      type(harmonics_t) :: box, others
      type(tuple_union_t) :: union
      integer :: m, its_order, i
      integer, allocatable :: more(:, :)

      if (asserts_are_on) call assert(size(loaded, 1) == n_tones, "new_lowest_set", "tuples of all tones")
      its_order = lowest_order(n_tones)
      if (present(order)) its_order = order
      call new_box(box, [(its_order, m=1, n_tones)], .false., error)
      if (allocated(error)) return
      call union%add(box%tuples)
      do i = 1, size(loaded, 2)
         more = reshape(loaded(:, i), [n_tones, 1])
         call new_harmonics(others, more, error)
         if (allocated(error)) return
         call union%add(others%tuples)
      end do
      call new_harmonics(self, union%list(), error)
   end subroutine new_lowest_set

   !> Returns the tuples that carry a motion: all needed ones, and the largest of the others until the root sum of
   !> squares of the remainder is at most `tail`, or `capacity` is used up. Retained tuples keep their order, new ones
   !> follow.
   function chosen_tuples(retained, carried, around, neglected, is_needed, tail, capacity) result(tuples)
      type(harmonics_t), intent(in) :: retained
      real(wp), intent(in) :: carried(:)                              !! amplitudes (retained%n_harmonics)
      type(harmonics_t), intent(in) :: around                         !! a set with further tuples
      real(wp), intent(in) :: neglected(:) !! their amplitudes (around%n_harmonics); ignored for retained tuples
      logical, intent(in) :: is_needed(:)                             !! (retained%n_harmonics)
      real(wp), intent(in) :: tail                                    !! in the unit of the amplitudes
      integer, intent(in) :: capacity                                 !! largest number of tuples of the set
      integer, allocatable :: tuples(:, :)                            !! (n_tones, at most `capacity`)
      integer, allocatable :: chosen(:), others(:)
      real(wp), allocatable :: amplitudes(:)
      integer :: h

      others = pack([(h, h=1, around%n_harmonics)], [(retained%index_of(around%tuples(:, h)) == 0, h=1, around%n_harmonics)])
      amplitudes = [merge(huge(1.0_wp), min(retention_weight*carried, huge(1.0_wp)/retention_weight), is_needed), neglected(others)]
      chosen = largest_indices(amplitudes, tail, capacity)
      allocate (tuples(retained%n_tones, size(chosen)))
      do h = 1, size(chosen)
         if (chosen(h) <= retained%n_harmonics) then
            tuples(:, h) = retained%tuples(:, chosen(h))
         else
            tuples(:, h) = around%tuples(:, others(chosen(h) - retained%n_harmonics))
         end if
      end do
   end function chosen_tuples

   !> Creates a set that extends twice as far as another in all directions: all tuples j of which j/2, with each entry
   !> rounded up or down, is in it, and all within two steps of each. Both, because a set of odd tuples has (2, 3) but
   !> not (3, 3) for (5, 6). Two steps, because the response of odd laws to a tuple j is in the next odd ones, j + k
   !> with an even sum of |k|: within one step of {0, 1} there is no third harmonic, and an estimate without it would
   !> always be 0. Five steps with one tone: order 6 does not show the error of order 3 for a stop that is touched for
   !> a short part of the period; and all tuples where a set has gaps, since one of those between twice its own may be
   !> next to a resonance. In addition, the responses of quadratic and cubic forces to the largest tuples: a
   !> load at tuple 7 has its next harmonics at 14 and 21. Steps are along the tones of the input, by which loads and laws couple
   !> the tuples, whatever the base frequencies of the set.
   subroutine new_doubled_set(self, set, error, carried, others)
      type(harmonics_t), intent(out) :: self
      type(harmonics_t), intent(in) :: set
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: carried(:)                    !! amplitudes of a motion (set%n_harmonics)
      integer, intent(in), optional :: others(:, :)                   !! tuples to be included, (n_tones, any)
      integer, parameter :: steps_of_one_tone = 5
      integer, parameter :: candidates_per_tuple = 5                  ! times as many tuples as the set
      integer, parameter :: max_in_gaps = 8                          ! order, times the tuples of the set: with a single distant
                                                                      ! one those up to it would cost more than the motion
      type(tuple_union_t) :: union
      integer :: farthest(set%n_tones), h, j(set%n_tones), k, last, m, s

      call union%reserve(set%n_tones, candidates_per_tuple*set%n_harmonics + 4*steps_of_one_tone)
      call union%add(set%tuples)
      if (present(carried)) call add_answers(union, set, carried)
      if (present(others)) call union%add(others)
      if (set%n_tones == 1) then
         do k = 1, steps_of_one_tone
            call union%add(set%tuples + k)
            call union%add(abs(set%tuples - k))
         end do
         last = 2*min(set%highest(1), max_in_gaps*set%n_harmonics)
         call union%add(reshape([(k, k=0, last)], [1, last + 1]))
         if (last == 2*set%highest(1)) then                           ! nothing is left
            call new_harmonics(self, union%list(), error)
            if (.not. allocated(error)) self%units = set%units
            return
         end if
      end if
      farthest = 2*set%highest + sum(abs(set%units), dim=2) - 1
      do h = 1, set%n_harmonics
         do k = 0, 3**set%n_tones - 1                                 ! digit m: increment of entry m, plus one
            j = 2*set%tuples(:, h)
            do m = 1, set%n_tones
               j = j + (modulo(k/3**(m - 1), 3) - 1)*set%units(:, m)
            end do
            if (all(abs(j) <= farthest)) call add_tuple(union, j)
         end do
         do m = 1, set%n_tones                                        ! two steps, or one
            do k = 1, set%n_tones
               do s = 0, 5
                  j = set%tuples(:, h) + (modulo(s, 2)*2 - 1)*set%units(:, m) + (s/2 - 1)*set%units(:, k)
                  call add_tuple(union, j)
               end do
            end do
         end do
      end do
      call new_harmonics(self, union%list(), error)
      if (.not. allocated(error)) self%units = set%units
   end subroutine new_doubled_set

   !> Adds j or -j, whichever is canonical; j is replaced by it.
   pure subroutine add_tuple(union, j)
      type(tuple_union_t), intent(inout) :: union
      integer, intent(inout) :: j(:)

      j = canonical_sign(j)*j
      call union%add_one(j)
   end subroutine add_tuple

   !> Adds i + k, i - k, 2 i + k and 2 i - k for the largest tuples i and k of a motion.
   pure subroutine add_answers(union, set, carried)
      type(tuple_union_t), intent(inout) :: union
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: carried(:)                              !! amplitudes (set%n_harmonics)
      real(wp), parameter :: large_amplitude_share = 0.1_wp ! of the largest amplitude: the cube of a smaller one is negligible
      integer, parameter :: max_large = 8                            ! tuples
      integer :: i, j(set%n_tones), k, n, order(set%n_harmonics), s

      call sort_descending(carried, order)
      n = min(max_large, count(carried > large_amplitude_share*maxval(carried)))
      do i = 1, n
         do k = 1, n
            do s = 0, 3
               j = (2 - s/2)*set%tuples(:, order(i)) + (1 - 2*modulo(s, 2))*set%tuples(:, order(k))
               call add_tuple(union, j)
            end do
         end do
      end do
   end subroutine add_answers

   !> Tuples shifted by another one in both directions; twice as many.
   pure function shifted(tuples, shift)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, any)
      integer, intent(in) :: shift(:)                                 !! (n_tones)
      integer :: shifted(size(tuples, 1), 2*size(tuples, 2))
      integer :: i

      do i = 1, size(tuples, 2)
         shifted(:, 2*i - 1) = canonical_sign(tuples(:, i) + shift)*(tuples(:, i) + shift)
         shifted(:, 2*i) = canonical_sign(tuples(:, i) - shift)*(tuples(:, i) - shift)
      end do
   end function shifted

   !> Positions, ascending, of the largest amplitudes: as few as leave a remainder of at most `tail`, but no more than
   !> `capacity`. Of equal ones the first has precedence.
   pure function largest_indices(amplitudes, tail, capacity) result(positions)
      real(wp), intent(in) :: amplitudes(:)                           !! >= 0
      real(wp), intent(in) :: tail                                    !! root of the sum of squares
      integer, intent(in) :: capacity
      integer, allocatable :: positions(:)
      integer :: order(size(amplitudes))
      logical :: is_taken(size(amplitudes))
      real(wp) :: left_out
      integer :: i, n

      call sort_descending(amplitudes, order)
      left_out = 0.0_wp
      n = size(order)
      do while (n > 1)                                                ! from the smallest on
         if (amplitudes(order(n)) > tail) exit
         left_out = left_out + amplitudes(order(n))**2
         if (left_out > tail**2) exit
         n = n - 1
      end do
      is_taken = .false.
      is_taken(order(:min(n, max(1, capacity)))) = .true.
      positions = pack([(i, i=1, size(order))], is_taken)
   end function largest_indices

   !> Adds the tuples that are not in the union.
   pure subroutine tuple_union_add(self, tuples)
      class(tuple_union_t), intent(inout) :: self
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, any), signs as those of hb_harmonics
      integer :: h

      do h = 1, size(tuples, 2)
         if (.not. has_capacity(self)) call enlarge(self, size(tuples, 1), self%n + size(tuples, 2) - h + 1)
         call self%add_one(tuples(:, h))
      end do
   end subroutine tuple_union_add

   !> Allocates memory for some tuples, so that adding them does not move what is there.
   pure subroutine tuple_union_reserve(self, n_tones, n_tuples)
      class(tuple_union_t), intent(inout) :: self
      integer, intent(in) :: n_tones, n_tuples

      if (allocated(self%entries)) then
         if (size(self%entries, 2) >= n_tuples) return
      end if
      call enlarge(self, n_tones, n_tuples)
   end subroutine tuple_union_reserve

   !> Adds a tuple unless it is in the union.
   pure subroutine tuple_union_add_one(self, tuple)
      class(tuple_union_t), intent(inout) :: self
      integer, intent(in) :: tuple(:)                                 !! sign as those of hb_harmonics
      integer :: slot

      if (.not. has_capacity(self)) call enlarge(self, size(tuple), self%n + 1)
      slot = slot_of(self, tuple)
      if (self%slots(slot) > 0) return
      self%n = self%n + 1
      self%entries(:, self%n) = tuple
      self%slots(slot) = self%n
   end subroutine tuple_union_add_one

   !> All tuples, each once, (n_tones, n); at least one must have been added.
   pure function tuple_union_list(self) result(tuples)
      class(tuple_union_t), intent(in) :: self
      integer, allocatable :: tuples(:, :)

      if (asserts_are_on) call assert(self%n >= 1, "tuple_union_list", "at least one tuple")
      tuples = self%entries(:, :self%n)
   end function tuple_union_list

   pure logical function has_capacity(self)
      class(tuple_union_t), intent(in) :: self

      has_capacity = .false.
      if (allocated(self%entries)) has_capacity = self%n < size(self%entries, 2)
   end function has_capacity

   !> Allocates memory for `n_wanted` tuples, or twice as many as before.
   pure subroutine enlarge(self, n_tones, n_wanted)
      class(tuple_union_t), intent(inout) :: self
      integer, intent(in) :: n_tones, n_wanted
      integer, allocatable :: larger(:, :)
      integer :: h, n

      n = max(n_wanted, 2*self%n)
      allocate (larger(n_tones, n))
      if (self%n > 0) larger(:, :self%n) = self%entries(:, :self%n)
      call move_alloc(larger, self%entries)
      if (allocated(self%slots)) deallocate (self%slots)
      allocate (self%slots(2**(bit_size(n) - leadz(2*n))), source=0)   ! a power of two above 2 n
      do h = 1, self%n
         self%slots(slot_of(self, self%entries(:, h))) = h
      end do
   end subroutine enlarge

   !> Slot of a tuple, or the free slot for it; at least half of the slots are free.
   pure integer function slot_of(self, tuple) result(slot)
      class(tuple_union_t), intent(in) :: self
      integer, intent(in) :: tuple(:)
      integer(int64), parameter :: fnv_offset = 2166136261_int64, fnv_prime = 16777619_int64, bits_32 = 4294967295_int64
      integer(int64) :: hash
      integer :: m

      hash = fnv_offset
      do m = 1, size(tuple)
         hash = iand(ieor(hash, iand(int(tuple(m), int64), bits_32))*fnv_prime, bits_32)
         hash = ieor(hash, ishft(hash, -15)) ! mix high bits into the low ones, in which small entries differ
      end do
      slot = 1 + int(iand(hash, int(size(self%slots) - 1, int64)))      ! a division would take longer than all the rest
      do while (self%slots(slot) > 0)
         if (all(self%entries(:, self%slots(slot)) == tuple)) return
         slot = merge(1, slot + 1, slot == size(self%slots))
      end do
   end function slot_of
end module hb_tuple_choice
