!> Cubic spring, f = k3 z**3.
!> Source: docs/why/theory.md, section 5.1. Sign: f stands beside K q on the left-hand side.
module hb_law_cubic_spring
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: cubic_spring_t

   type, extends(law_t) :: cubic_spring_t
      real(wp) :: stiffness = 0.0_wp                                  !! k3 [N/m**3], negative for a softening spring
   contains
      procedure :: declare_numbers => cubic_spring_declare_numbers
      procedure :: derive => cubic_spring_derive
      procedure :: number_slope => cubic_spring_number_slope
      procedure :: evaluate => cubic_spring_evaluate
      procedure :: potential => cubic_spring_potential
   end type cubic_spring_t

contains

   subroutine cubic_spring_declare_numbers(self, numbers)
      class(cubic_spring_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("stiffness", self%stiffness)
   end subroutine cubic_spring_declare_numbers

   pure subroutine cubic_spring_derive(self)
      class(cubic_spring_t), intent(inout) :: self

      self%degree = 3
      self%has_potential = .true.
      self%is_odd = .true.
   end subroutine cubic_spring_derive

   subroutine cubic_spring_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(cubic_spring_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      f = self%stiffness*z**3
      if (present(df_dz)) df_dz(:, :, 1) = 3.0_wp*self%stiffness*z**2
   end subroutine cubic_spring_evaluate

   subroutine cubic_spring_number_slope(self, number, z, v, p, slope, is_known)
      class(cubic_spring_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known

      is_known = .true.
      select case (number%key)
      case ("stiffness"); slope = z**3
      case default
         is_known = .false.
      end select
   end subroutine cubic_spring_number_slope

   !> k3 z**4/4.
   subroutine cubic_spring_potential(self, z, energy, gradient)
      class(cubic_spring_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)

      energy = 0.25_wp*self%stiffness*z(:, 1)**4
      gradient = self%stiffness*z**3
   end subroutine cubic_spring_potential
end module hb_law_cubic_spring
