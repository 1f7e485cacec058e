!> The finite set of integer tuples j of a solution, and the position of the cosine and sine of each in a vector.
!>
!> x(tau) = sum over the set of a_j cos(j.tau) + b_j sin(j.tau). Of j and -j only the one whose first non-zero entry is
!> positive is stored, so the set does not depend on the values of the base frequencies. Source: docs/why/theory.md, section 2.
module hb_harmonics
   use hb_assert, only: assert, asserts_are_on
   use hb_error, only: error_t, fail
   use hb_kinds, only: int64, wp
   use hb_text, only: length_of, to_text
   implicit none
   private
   public :: canonical_sign, coefficients_in, exceeds_largest_box, harmonics_t, new_box, new_diamond, new_harmonics, &
      new_of_parity, new_subset, tuple_text

   integer(int64), parameter :: largest_set = 20000000_int64         ! tuples of the box around a set; its table has one entry each
   integer, parameter :: max_harmonics = 4000000                     ! tuples of a set

   !> A set of harmonics. Coefficients of one degree of freedom are a vector (n_coefficients): harmonic by harmonic
   !> cosine then sine, without a sine for the zero tuple.
   type :: harmonics_t
      integer :: n_tones = 0
      integer :: n_harmonics = 0
      integer :: n_coefficients = 0                                   !! 2*n_harmonics, less one if the zero tuple is in
      logical :: has_zero = .false.
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics), the zero tuple first
      integer, allocatable :: highest(:)                              !! (n_tones) largest |j_m|
      integer, allocatable :: units(:, :)                             !! tuples of the tones of the input, in columns (n_tones,
                                                                      !! n_tones): unit vectors but for other base frequencies
      integer, allocatable :: cos_at(:)                               !! (n_harmonics) position of the cosine
      integer, allocatable :: sin_at(:)                               !! (n_harmonics) position of the sine, 0 for the zero tuple
      integer, allocatable, private :: lookup(:)                      !! harmonic by linear key of the tuple
   contains
      procedure :: equal => harmonics_equal
      procedure :: index_of => harmonics_index_of
      procedure :: frequencies => harmonics_frequencies
      procedure :: amplitude => harmonics_amplitude
      procedure :: set_amplitude => harmonics_set_amplitude
      procedure :: amplitudes => harmonics_amplitudes
      procedure :: coefficients => harmonics_coefficients
      procedure :: times => harmonics_times
      procedure :: norms => harmonics_norms
      procedure :: indices_of => harmonics_indices_of
      procedure :: positions_of => harmonics_positions_of
   end type harmonics_t

contains

   !> Creates the set of all tuples with |j_m| <= orders(m); with `odd_only` only those whose entries have an odd sum.
   subroutine new_box(self, orders, odd_only, error)
      type(harmonics_t), intent(out) :: self
      integer, intent(in) :: orders(:)                                !! (n_tones), >= 0
      logical, intent(in) :: odd_only
      type(error_t), allocatable, intent(out) :: error

      call enumerate(self, orders, huge(1), odd_only, error)
   end subroutine new_box

   !> Creates the set of all tuples with sum |j_m| <= order; with `odd_only` only those whose entries have an odd sum.
   subroutine new_diamond(self, n_tones, order, odd_only, error)
      type(harmonics_t), intent(out) :: self
      integer, intent(in) :: n_tones                                  !! >= 1
      integer, intent(in) :: order                                    !! >= 0
      logical, intent(in) :: odd_only
      type(error_t), allocatable, intent(out) :: error
      integer :: m

      call enumerate(self, [(order, m=1, n_tones)], order, odd_only, error)
   end subroutine new_diamond

   !> Creates a set from a list of tuples; of j and -j either may be given, both are an error. Without tones the only tuple is
   !> the one without entries, the mean value.
   subroutine new_harmonics(self, tuples, error)
      type(harmonics_t), intent(out) :: self
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      type(error_t), allocatable, intent(out) :: error
      integer :: h, n_tuples

      n_tuples = size(tuples, 2)
      if (n_tuples < 1) then
         call fail(error, "the set of harmonics is empty")
         return
      end if
      self%n_tones = size(tuples, 1)
      self%n_harmonics = n_tuples
      allocate (self%tuples(self%n_tones, n_tuples))
      do h = 1, n_tuples
         self%tuples(:, h) = canonical_sign(tuples(:, h))*tuples(:, h)
      end do
      do h = 2, n_tuples                                               ! the zero tuple comes first
         if (all(self%tuples(:, h) == 0)) then
            self%tuples(:, 2:h) = self%tuples(:, 1:h - 1)
            self%tuples(:, 1) = 0
            exit
         end if
      end do
      call index_coefficients(self, error)
   end subroutine new_harmonics

   !> The tuples of a set whose entries have an even (`parity` 0) or an odd sum (1).
   subroutine new_of_parity(self, set, parity, error)
      type(harmonics_t), intent(out) :: self
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: parity
      type(error_t), allocatable, intent(out) :: error
      integer :: h

      if (asserts_are_on) call assert(any(parity == [0, 1]), "new_of_parity", "parity 0 or 1")
      call new_subset(self, set, pack([(h, h=1, set%n_harmonics)], modulo(sum(set%tuples, dim=1), 2) == parity), error)
   end subroutine new_of_parity

   !> Some tuples of a set, in their order; the largest entries are those of the whole set, so that choices based on
   !> them, such as grids, are the same.
   subroutine new_subset(self, set, retained, error)
      type(harmonics_t), intent(out) :: self
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: retained(:)                              !! numbers of harmonics, ascending
      type(error_t), allocatable, intent(out) :: error

      if (asserts_are_on) call assert(all(retained(2:) > retained(:size(retained) - 1)), "new_subset", "ascending harmonics")
      if (size(retained) == 0) then
         call fail(error, "the set of harmonics has none of the requested tuples")
         return
      end if
      self%n_tones = set%n_tones
      self%n_harmonics = size(retained)
      self%tuples = set%tuples(:, retained)
      call index_coefficients(self, error, set%highest)
      self%units = set%units
   end subroutine new_subset

   !> Fills the set with the tuples of a box truncated by sum |j_m| <= largest_sum.
   subroutine enumerate(self, orders, largest_sum, odd_only, error)
      type(harmonics_t), intent(inout) :: self
      integer, intent(in) :: orders(:), largest_sum
      logical, intent(in) :: odd_only
      type(error_t), allocatable, intent(out) :: error
      integer :: j(size(orders)), n_retained, pass

      if (size(orders) < 1 .or. any(orders < 0)) then
         call fail(error, "harmonics need one order of 0 or more for each tone")
         return
      end if
      if (exceeds_largest_box(orders)) then
         call fail(error, "the set of harmonics would have about "//to_text(anint(product(2*real(orders, wp) + 1)/2))// &
                   " tuples, or be in a box of that size, more than "//to_text(largest_set/2)//"; lower the order")
         return
      end if
      self%n_tones = size(orders)
      do pass = 1, 2                                                   ! count, then store
         n_retained = 0
         j = 0                                                        ! only tuples of canonical sign follow it
         box: do
            if (is_retained(j)) then
               n_retained = n_retained + 1
               if (pass == 2) self%tuples(:, n_retained) = j
            end if
            if (.not. advanced(j)) exit box
         end do box
         if (pass == 1) then
            if (n_retained == 0) then
               call fail(error, "the set of harmonics is empty")
               return
            else if (n_retained > max_harmonics) then
               call fail(error, "the set of harmonics would have "//to_text(n_retained)//" tuples, more than "// &
                         to_text(max_harmonics)//"; lower the order")
               return
            end if
            allocate (self%tuples(self%n_tones, n_retained))
         end if
      end do
      self%n_harmonics = n_retained
      call index_coefficients(self, error)

   contains

      pure logical function is_retained(tuple)
         integer, intent(in) :: tuple(:)

         is_retained = sum(abs(tuple)) <= largest_sum
         ! the sum of entries has the same parity as the sum of their magnitudes
         if (is_retained .and. odd_only) is_retained = mod(sum(abs(tuple)), 2) == 1
      end function is_retained

      !> Next tuple in odometer order, last entry fastest; false after the last one.
      logical function advanced(tuple)
         integer, intent(inout) :: tuple(:)
         integer :: m

         advanced = .true.
         do m = size(tuple), 1, -1
            if (tuple(m) < orders(m)) then
               tuple(m) = tuple(m) + 1
               return
            end if
            tuple(m) = merge(0, -orders(m), m == 1)
         end do
         advanced = .false.
      end function advanced
   end subroutine enumerate

   !> Derives all lookup tables from the tuples.
   subroutine index_coefficients(self, error, highest)
      type(harmonics_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: highest(:)                     !! (n_tones), otherwise those of the tuples
      integer :: h, key

      self%highest = maxval(abs(self%tuples), dim=2)
      if (present(highest)) self%highest = highest
      allocate (self%units(self%n_tones, self%n_tones), source=0)
      do h = 1, self%n_tones
         self%units(h, h) = 1
      end do
      if (exceeds_largest_box(self%highest)) then
         call fail(error, "the largest entries of the tuples span more than "//to_text(largest_set)//" tuples")
         return
      end if
      allocate (self%lookup(product(2*self%highest + 1)), source=0)
      do h = 1, self%n_harmonics
         key = tuple_key(self, self%tuples(:, h), 1)
         if (self%lookup(key) /= 0) then
            call fail(error, "tuple "//tuple_text(self%tuples(:, h))//" is in the set of harmonics twice (j and -j are the same)")
            return
         end if
         self%lookup(key) = h
      end do
      self%has_zero = all(self%tuples(:, 1) == 0)
      allocate (self%cos_at(self%n_harmonics), self%sin_at(self%n_harmonics))
      do h = 1, self%n_harmonics
         self%sin_at(h) = 2*h - merge(1, 0, self%has_zero)
         self%cos_at(h) = self%sin_at(h) - 1
      end do
      self%n_coefficients = self%sin_at(self%n_harmonics)
      if (self%has_zero) then
         self%cos_at(1) = 1
         self%sin_at(1) = 0
         self%n_coefficients = 2*self%n_harmonics - 1
      end if
   end subroutine index_coefficients

   !> Whether the box |j_m| <= orders(m) has more tuples than permitted.
   pure logical function exceeds_largest_box(orders)
      integer, intent(in) :: orders(:)                                !! (n_tones), >= 0

      exceeds_largest_box = product(2*real(orders, wp) + 1) > real(largest_set, wp)
   end function exceeds_largest_box

   !> Number of the harmonic with this tuple (or its negative), 0 if it is not in the set.
   pure integer function harmonics_index_of(self, tuple)
      class(harmonics_t), intent(in) :: self
      integer, intent(in) :: tuple(:)                                 !! (n_tones)

      harmonics_index_of = 0
      if (size(tuple) /= self%n_tones) return
      if (any(abs(tuple) > self%highest)) return
      harmonics_index_of = self%lookup(tuple_key(self, tuple, canonical_sign(tuple)))
   end function harmonics_index_of

   !> Complex amplitude a - i b of harmonic h.
   pure complex(wp) function harmonics_amplitude(self, u, h) result(amplitude)
      class(harmonics_t), intent(in) :: self
      real(wp), intent(in) :: u(:)                                    !! (n_coefficients)
      integer, intent(in) :: h

      associate (sine => self%sin_at(h))
         if (sine > 0) then
            amplitude = cmplx(u(self%cos_at(h)), -u(sine), wp)
         else
            amplitude = cmplx(u(self%cos_at(h)), 0.0_wp, wp)
         end if
      end associate
   end function harmonics_amplitude

   !> Stores the complex amplitude c = a - i b of harmonic h; only the real part for the zero tuple.
   pure subroutine harmonics_set_amplitude(self, u, h, c)
      class(harmonics_t), intent(in) :: self
      real(wp), intent(inout) :: u(:)                                 !! (n_coefficients)
      integer, intent(in) :: h
      complex(wp), intent(in) :: c

      u(self%cos_at(h)) = real(c)
      if (self%sin_at(h) > 0) u(self%sin_at(h)) = -aimag(c)
   end subroutine harmonics_set_amplitude

   !> Complex amplitudes a - i b of all harmonics, (any, n_harmonics).
   pure function harmonics_amplitudes(self, u) result(c)
      class(harmonics_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)                                 !! (n_coefficients, any)
      complex(wp) :: c(size(u, 2), self%n_harmonics)
      integer :: h, i

      do h = 1, self%n_harmonics
         do i = 1, size(u, 2)
            c(i, h) = self%amplitude(u(:, i), h)
         end do
      end do
   end function harmonics_amplitudes

   !> Coefficients of complex amplitudes, (n_coefficients, any).
   pure function harmonics_coefficients(self, c) result(u)
      class(harmonics_t), intent(in) :: self
      complex(wp), intent(in) :: c(:, :)                              !! (any, n_harmonics)
      real(wp) :: u(self%n_coefficients, size(c, 1))
      integer :: h, i

      do i = 1, size(c, 1)
         do h = 1, self%n_harmonics
            call self%set_amplitude(u(:, i), h, c(i, h))
         end do
      end do
   end function harmonics_coefficients

   !> Motion whose complex amplitudes are multiplied by one factor per harmonic: i w for the velocity, exp(i phi) for a
   !> phase shift.
   pure function harmonics_times(self, factors, u) result(product)
      class(harmonics_t), intent(in) :: self
      complex(wp), intent(in) :: factors(:)                           !! (n_harmonics)
      real(wp), intent(in) :: u(:, :)                                 !! (n_coefficients, any)
      real(wp) :: product(size(u, 1), size(u, 2))
      integer :: h, i

      do i = 1, size(u, 2)
         do h = 1, self%n_harmonics
            call self%set_amplitude(product(:, i), h, factors(h)*self%amplitude(u(:, i), h))
         end do
      end do
   end function harmonics_times

   !> Whether both sets have the same tuples in the same order.
   pure logical function harmonics_equal(self, other) result(are_equal)
      class(harmonics_t), intent(in) :: self
      type(harmonics_t), intent(in) :: other

      are_equal = self%n_tones == other%n_tones .and. self%n_harmonics == other%n_harmonics
      if (are_equal) are_equal = all(self%tuples == other%tuples)
   end function harmonics_equal

   !> Norm of the coefficients of each harmonic, (n_harmonics).
   pure function harmonics_norms(self, u) result(norms)
      class(harmonics_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)                                 !! (n_coefficients, any)
      real(wp) :: norms(self%n_harmonics)
      integer :: h

      do h = 1, self%n_harmonics
         norms(h) = norm2(u(self%cos_at(h):max(self%cos_at(h), self%sin_at(h)), :))
      end do
   end function harmonics_norms

   !> Where the coefficients of a part of this set stand among its own, of some degrees of freedom one after the other.
   pure function harmonics_indices_of(self, part, n_dofs) result(positions)
      class(harmonics_t), intent(in) :: self
      type(harmonics_t), intent(in) :: part                           !! all of whose tuples this set has
      integer, intent(in) :: n_dofs
      integer :: positions(part%n_coefficients, n_dofs)
      integer :: h, i, k

      do h = 1, part%n_harmonics
         k = self%index_of(part%tuples(:, h))
         positions(part%cos_at(h), 1) = self%cos_at(k)
         if (part%sin_at(h) > 0) positions(part%sin_at(h), 1) = self%sin_at(k)
      end do
      do i = 2, n_dofs
         positions(:, i) = positions(:, 1) + (i - 1)*self%n_coefficients
      end do
   end function harmonics_indices_of

   !> Numbers of the harmonics of a part of this set, (part%n_harmonics).
   pure function harmonics_positions_of(self, part) result(positions)
      class(harmonics_t), intent(in) :: self
      type(harmonics_t), intent(in) :: part
      integer :: positions(part%n_harmonics)
      integer :: h

      positions = [(self%index_of(part%tuples(:, h)), h=1, part%n_harmonics)]
   end function harmonics_positions_of

   !> Coefficients in another set, (to_set%n_coefficients, any): those of the tuples in both, zero of all others.
   pure function coefficients_in(to_set, from_set, from) result(to)
      type(harmonics_t), intent(in) :: to_set, from_set
      real(wp), intent(in) :: from(:, :)                              !! (from_set%n_coefficients, any)
      real(wp) :: to(to_set%n_coefficients, size(from, 2))
      integer :: h, k

      if (from_set%n_harmonics == to_set%n_harmonics) then             ! the usual case: points of a sweep
         if (all(from_set%tuples == to_set%tuples)) then
            to = from
            return
         end if
      end if
      to = 0.0_wp
      do h = 1, to_set%n_harmonics
         k = from_set%index_of(to_set%tuples(:, h))
         if (k == 0) cycle
         to(to_set%cos_at(h), :) = from(from_set%cos_at(k), :)
         if (to_set%sin_at(h) > 0) to(to_set%sin_at(h), :) = from(from_set%sin_at(k), :)
      end do
   end function coefficients_in

   !> Angular frequencies j.omega [rad/s] of all harmonics, (n_harmonics); may be negative.
   pure function harmonics_frequencies(self, omega) result(frequencies)
      class(harmonics_t), intent(in) :: self
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      real(wp) :: frequencies(self%n_harmonics), tuples(size(omega), self%n_harmonics)

      tuples = real(self%tuples, wp)
      frequencies = matmul(omega, tuples)
   end function harmonics_frequencies

   !> Sign that makes the first non-zero entry positive: 1 or -1; 1 for the zero tuple.
   pure integer function canonical_sign(tuple)
      integer, intent(in) :: tuple(:)
      integer :: first

      first = findloc(tuple /= 0, .true., dim=1)
      canonical_sign = 1
      if (first > 0) canonical_sign = sign(1, tuple(first))
   end function canonical_sign

   !> Text such as (1,-2).
   pure function tuple_text(tuple) result(text)
      integer, intent(in) :: tuple(:)
      character(1 + max(1, size(tuple)) + sum(length_of(tuple))) :: text
      integer :: m, n

      text = "("
      n = 1
      do m = 1, size(tuple)
         text(n + 1:) = to_text(tuple(m))//","
         n = n + length_of(tuple(m)) + 1
      end do
      text(len(text):) = ")"
   end function tuple_text

   pure integer function tuple_key(self, tuple, factor)
      type(harmonics_t), intent(in) :: self
      integer, intent(in) :: tuple(:)
      integer, intent(in) :: factor                                   !! of the tuple, 1 or -1
      integer :: m

      tuple_key = 0
      do m = self%n_tones, 1, -1
         tuple_key = tuple_key*(2*self%highest(m) + 1) + factor*tuple(m) + self%highest(m)
      end do
      tuple_key = tuple_key + 1
   end function tuple_key
end module hb_harmonics
