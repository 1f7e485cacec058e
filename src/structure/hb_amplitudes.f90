!> Complex amplitudes c = cos - i sin of all degrees of freedom, of loads or of a motion. Only harmonics with nonzero
!> amplitudes are stored.
module hb_amplitudes
   use hb_assert, only: assert, asserts_are_on
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   implicit none
   private
   public :: amplitudes_t, as_amplitudes, new_amplitudes

   type :: amplitudes_t
      integer :: n_dofs = 0, n_harmonics = 0
      integer, allocatable :: harmonics(:)                            !! numbers of the stored harmonics, ascending
      complex(wp), allocatable :: values(:, :)                        !! [N] or [m], (n_dofs, size(harmonics))
   contains
      procedure :: add => amplitudes_add
      procedure :: add_scaled => amplitudes_add_scaled
      procedure :: at => amplitudes_at
      procedure :: in_set => amplitudes_in_set
      procedure :: is_zero => amplitudes_is_zero
      procedure :: is_zero_at => amplitudes_is_zero_at
      procedure :: of => amplitudes_of
      procedure :: power_into => amplitudes_power_into
      procedure :: replace => amplitudes_replace
      procedure :: whole => amplitudes_whole
   end type amplitudes_t

contains

   !> Creates an object without amplitudes.
   pure subroutine new_amplitudes(self, n_dofs, n_harmonics)
      type(amplitudes_t), intent(out) :: self
      integer, intent(in) :: n_dofs, n_harmonics

      self%n_dofs = n_dofs
      self%n_harmonics = n_harmonics
      allocate (self%harmonics(0), self%values(n_dofs, 0))
   end subroutine new_amplitudes

   !> Amplitudes of an array with a column for each harmonic.
   pure function as_amplitudes(values) result(self)
      complex(wp), intent(in) :: values(:, :)                         !! (n_dofs, n_harmonics)
      type(amplitudes_t) :: self
      integer :: h

      self%n_dofs = size(values, 1)
      self%n_harmonics = size(values, 2)
      allocate (self%harmonics, source=pack([(h, h=1, size(values, 2))], &
                                            [(any(values(:, h) /= (0.0_wp, 0.0_wp)), h=1, size(values, 2))]))
      allocate (self%values(size(values, 1), size(self%harmonics)), source=values(:, self%harmonics))
   end function as_amplitudes

   !> Adds to the amplitudes of harmonic `h`.
   pure subroutine amplitudes_add(self, h, values)
      class(amplitudes_t), intent(inout) :: self
      integer, intent(in) :: h
      complex(wp), intent(in) :: values(:)                            !! (n_dofs)
      integer :: k

      call find_or_add(self, h, k)
      self%values(:, k) = self%values(:, k) + values
   end subroutine amplitudes_add

   !> Finds the column of harmonic `h`, and adds one of zeros if there is none.
   pure subroutine find_or_add(self, h, k)
      class(amplitudes_t), intent(inout) :: self
      integer, intent(in) :: h
      integer, intent(out) :: k
      complex(wp), allocatable :: wider(:, :)

      k = findloc(self%harmonics, h, dim=1)
      if (k > 0) return
      k = count(self%harmonics < h) + 1
      allocate (wider(self%n_dofs, size(self%harmonics) + 1))
      wider(:, :k - 1) = self%values(:, :k - 1)
      wider(:, k) = (0.0_wp, 0.0_wp)
      wider(:, k + 1:) = self%values(:, k:)
      call move_alloc(wider, self%values)
      self%harmonics = [self%harmonics(:k - 1), h, self%harmonics(k:)]
   end subroutine find_or_add

   !> Mean power [W] of these loads in a motion: sum over harmonics of Re(P* i w c)/2.
   pure real(wp) function amplitudes_power_into(self, c, frequencies) result(power)
      class(amplitudes_t), intent(in) :: self
      complex(wp), intent(in) :: c(:, :)                              !! a - i b [m], (n_dofs, n_harmonics)
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      integer :: k

      power = 0.0_wp
      do k = 1, size(self%harmonics)
         associate (h => self%harmonics(k))
            power = power - 0.5_wp*frequencies(h)*aimag(dot_product(self%values(:, k), c(:, h)))
         end associate
      end do
   end function amplitudes_power_into

   !> Adds other amplitudes of the same sizes, those of each harmonic times a factor.
   pure subroutine amplitudes_add_scaled(self, other, factors)
      class(amplitudes_t), intent(inout) :: self
      type(amplitudes_t), intent(in) :: other
      real(wp), intent(in) :: factors(:)                              !! (n_harmonics)
      integer :: k

      if (asserts_are_on) call assert(size(other%values, 1) == size(self%values, 1), "amplitudes_add_scaled", "the same dofs")
      do k = 1, size(other%harmonics)
         call self%add(other%harmonics(k), factors(other%harmonics(k))*other%values(:, k))
      end do
   end subroutine amplitudes_add_scaled

   !> Amplitudes of one set in another, for the tuples that both contain.
   pure function amplitudes_in_set(self, from_set, to_set) result(moved)
      class(amplitudes_t), intent(in) :: self
      type(harmonics_t), intent(in) :: from_set, to_set
      type(amplitudes_t) :: moved
      integer :: h, numbers(self%n_harmonics)

      numbers = [(to_set%index_of(from_set%tuples(:, h)), h=1, self%n_harmonics)]
      moved = renumbered(self, numbers, to_set%n_harmonics)
   end function amplitudes_in_set

   !> Renumbers harmonics: number `numbers(h)` of another set is harmonic `h` here, which is omitted if that is zero.
   pure function renumbered(self, numbers, n_harmonics) result(other)
      type(amplitudes_t), intent(in) :: self
      integer, intent(in) :: numbers(:)                               !! (self%n_harmonics)
      integer, intent(in) :: n_harmonics                              !! of the other set
      type(amplitudes_t) :: other
      integer :: k

      call new_amplitudes(other, self%n_dofs, n_harmonics)
      do k = 1, size(self%harmonics)
         if (numbers(self%harmonics(k)) > 0) call other%add(numbers(self%harmonics(k)), self%values(:, k))
      end do
   end function renumbered

   !> Amplitudes of some harmonics only.
   pure function amplitudes_at(self, positions) result(part)
      class(amplitudes_t), intent(in) :: self
      integer, intent(in) :: positions(:)                             !! their numbers
      type(amplitudes_t) :: part
      integer :: i, numbers(self%n_harmonics)

      numbers = 0
      numbers(positions) = [(i, i=1, size(positions))]
      part = renumbered(self, numbers, size(positions))
   end function amplitudes_at

   !> Replaces the amplitudes of some harmonics by those of an object that contains only these.
   pure subroutine amplitudes_replace(self, positions, part)
      class(amplitudes_t), intent(inout) :: self
      integer, intent(in) :: positions(:)                             !! their numbers, ascending
      type(amplitudes_t), intent(in) :: part
      type(amplitudes_t) :: retained
      integer :: k, numbers(self%n_harmonics)

      numbers = [(k, k=1, self%n_harmonics)]
      numbers(positions) = 0
      retained = renumbered(self, numbers, self%n_harmonics)
      call move_alloc(retained%harmonics, self%harmonics)
      call move_alloc(retained%values, self%values)
      do k = 1, size(part%harmonics)
         call self%add(positions(part%harmonics(k)), part%values(:, k))
      end do
   end subroutine amplitudes_replace

   !> Amplitudes of harmonic `h`, zero if it has none.
   pure function amplitudes_of(self, h) result(values)
      class(amplitudes_t), intent(in) :: self
      integer, intent(in) :: h
      complex(wp) :: values(self%n_dofs)
      integer :: k

      values = (0.0_wp, 0.0_wp)
      k = findloc(self%harmonics, h, dim=1)
      if (k > 0) values = self%values(:, k)
   end function amplitudes_of

   !> Whether there are no amplitudes, or all are zero.
   pure logical function amplitudes_is_zero(self) result(is_zero)
      class(amplitudes_t), intent(in) :: self

      is_zero = all(abs(self%values) <= 0.0_wp)
   end function amplitudes_is_zero

   !> The same of harmonic `h`.
   pure logical function amplitudes_is_zero_at(self, h) result(is_zero)
      class(amplitudes_t), intent(in) :: self
      integer, intent(in) :: h
      integer :: k

      k = findloc(self%harmonics, h, dim=1)
      is_zero = k == 0
      if (.not. is_zero) is_zero = all(abs(self%values(:, k)) <= 0.0_wp)
   end function amplitudes_is_zero_at

   !> Array with a column for each harmonic, (n_dofs, n_harmonics).
   pure function amplitudes_whole(self) result(values)
      class(amplitudes_t), intent(in) :: self
      complex(wp) :: values(self%n_dofs, self%n_harmonics)

      values = (0.0_wp, 0.0_wp)
      values(:, self%harmonics) = self%values
   end function amplitudes_whole
end module hb_amplitudes
