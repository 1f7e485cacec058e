!> Polynomial spring and dashpot, f = sum k_n z**n + sum d_n v**n, n from 1.
!> Source: docs/why/theory.md, section 5.1. Sign: f stands beside K q on the left-hand side.
module hb_law_polynomial
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   use hb_problems, only: problems_t
   implicit none
   private
   public :: polynomial_t

   type, extends(law_t) :: polynomial_t
      real(wp), allocatable :: stiffness(:)                           !! k_1, k_2, ... [N/m, N/m**2, ...]
      real(wp), allocatable :: damping(:)                             !! d_1, d_2, ... [N s/m, N s**2/m**2, ...]
   contains
      procedure :: declare_numbers => polynomial_declare_numbers
      procedure :: check => polynomial_check
      procedure :: derive => polynomial_derive
      procedure :: number_slope => polynomial_number_slope
      procedure :: evaluate => polynomial_evaluate
      procedure :: potential => polynomial_potential
   end type polynomial_t

contains

   subroutine polynomial_declare_numbers(self, numbers)
      class(polynomial_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("stiffness", self%stiffness)
      call numbers%add("damping", self%damping)
   end subroutine polynomial_declare_numbers

   subroutine polynomial_check(self, problems)
      class(polynomial_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (size(self%stiffness) + size(self%damping) == 0) &
         call problems%add("stiffness", "a polynomial law needs 'stiffness' or 'damping' coefficients")
   end subroutine polynomial_check

   pure subroutine polynomial_derive(self)
      class(polynomial_t), intent(inout) :: self

      if (.not. allocated(self%stiffness)) allocate (self%stiffness(0))
      if (.not. allocated(self%damping)) allocate (self%damping(0))
      self%degree = max(size(self%stiffness), size(self%damping), 1)
      self%needs_velocity = size(self%damping) > 0
      self%needs_displacement = size(self%stiffness) > 0
      self%has_potential = .true.
      self%is_odd = all(abs(self%stiffness(2::2)) <= 0.0_wp) .and. all(abs(self%damping(2::2)) <= 0.0_wp)
   end subroutine polynomial_derive

   subroutine polynomial_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(polynomial_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      integer :: i

      do i = 1, size(z, 1)
         f(i, 1) = horner(self%stiffness, z(i, 1))
      end do
      if (self%needs_velocity) then
         do i = 1, size(z, 1)
            f(i, 1) = f(i, 1) + horner(self%damping, v(i, 1))
         end do
      end if
      if (present(df_dz)) then
         do i = 1, size(z, 1)
            df_dz(i, 1, 1) = horner_slope(self%stiffness, z(i, 1))
         end do
      end if
      if (self%needs_velocity .and. present(df_dv)) then
         do i = 1, size(z, 1)
            df_dv(i, 1, 1) = horner_slope(self%damping, v(i, 1))
         end do
      end if
   end subroutine polynomial_evaluate

   !> c_1 x + c_2 x**2 + ...
   subroutine polynomial_number_slope(self, number, z, v, p, slope, is_known)
      class(polynomial_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known

      is_known = .true.
      select case (number%key)
      case ("stiffness"); slope = z**max(1, number%element(1))
      case ("damping"); slope = v**max(1, number%element(1))
      case default
         is_known = .false.
      end select
   end subroutine polynomial_number_slope

   pure real(wp) function horner(c, x)
      real(wp), intent(in) :: c(:), x
      integer :: n

      horner = 0.0_wp
      do n = size(c), 1, -1
         horner = x*(c(n) + horner)
      end do
   end function horner

   !> c_1 + 2 c_2 x + 3 c_3 x**2 + ...
   pure real(wp) function horner_slope(c, x)
      real(wp), intent(in) :: c(:), x
      integer :: n

      horner_slope = 0.0_wp
      do n = size(c), 1, -1
         horner_slope = n*c(n) + x*horner_slope
      end do
   end function horner_slope

   !> Sum of k_n z**(n + 1)/(n + 1); powers of the rate store nothing.
   subroutine polynomial_potential(self, z, energy, gradient)
      class(polynomial_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)
      real(wp) :: weights(size(self%stiffness))
      integer :: i, n

      weights = [(self%stiffness(n)/(n + 1), n=1, size(self%stiffness))]
      do i = 1, size(z, 1)
         energy(i) = z(i, 1)*horner(weights, z(i, 1))
         gradient(i, 1) = horner(self%stiffness, z(i, 1))
      end do
   end subroutine polynomial_potential
end module hb_law_polynomial
