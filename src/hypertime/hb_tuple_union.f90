!> The union of many sets of tuples, in the order in which they were added: a hash table with open addressing, so that
!> as many sets as a sweep has points take no more than linear time. Source of the hash: FNV-1a, 32 bit, entry by entry.
module hb_tuple_union
   use hb_kinds, only: int64
   implicit none
   private
   public :: tuple_union_t

   type :: tuple_union_t
      integer :: n = 0                                                !! number of tuples
      integer, allocatable, private :: entries(:, :)                  !! (n_tones, capacity), the first n are in use
      integer, allocatable, private :: slots(:)                       !! place of a tuple, 0 where free
   contains
      procedure :: add => tuple_union_add
      procedure :: add_one => tuple_union_add_one
      procedure :: list => tuple_union_list
   end type tuple_union_t

contains

   !> Adds the tuples that are not there yet.
   pure subroutine tuple_union_add(self, tuples)
      class(tuple_union_t), intent(inout) :: self
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, any), signs as those of hb_harmonics
      integer :: h

      do h = 1, size(tuples, 2)
         if (.not. has_room(self)) call enlarge(self, size(tuples, 1), self%n + size(tuples, 2) - h + 1)
         call self%add_one(tuples(:, h))
      end do
   end subroutine tuple_union_add

   !> Adds a tuple, unless it is there.
   pure subroutine tuple_union_add_one(self, tuple)
      class(tuple_union_t), intent(inout) :: self
      integer, intent(in) :: tuple(:)                                 !! sign as those of hb_harmonics
      integer :: slot

      if (.not. has_room(self)) call enlarge(self, size(tuple), self%n + 1)
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

      tuples = self%entries(:, :self%n)
   end function tuple_union_list

   pure logical function has_room(self)
      class(tuple_union_t), intent(in) :: self

      has_room = .false.
      if (allocated(self%entries)) has_room = self%n < size(self%entries, 2)
   end function has_room

   !> Makes room for `n_wanted` tuples, or twice as many as before.
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
      allocate (self%slots(2*n + 1), source=0)
      do h = 1, self%n
         self%slots(slot_of(self, self%entries(:, h))) = h
      end do
   end subroutine enlarge

   !> Slot that holds a tuple, or the free one where it belongs; half of the slots at least are free.
   pure integer function slot_of(self, tuple) result(slot)
      class(tuple_union_t), intent(in) :: self
      integer, intent(in) :: tuple(:)
      integer(int64), parameter :: offset = 2166136261_int64, prime = 16777619_int64, mask = 4294967295_int64
      integer(int64) :: hash
      integer :: m

      hash = offset
      do m = 1, size(tuple)
         hash = iand(ieor(hash, iand(int(tuple(m), int64), mask))*prime, mask)
         hash = ieor(hash, ishft(hash, -15))                          ! high bits reach the low ones, of which small entries differ
      end do
      slot = 1 + int(modulo(hash, int(size(self%slots), int64)))
      do while (self%slots(slot) > 0)
         if (all(self%entries(:, self%slots(slot)) == tuple)) return
         slot = merge(1, slot + 1, slot == size(self%slots))
      end do
   end function slot_of
end module hb_tuple_union
