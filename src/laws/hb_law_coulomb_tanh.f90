!> Smoothed Coulomb friction: f = S tanh(v/v_0).
!>
!> It does not stick: below v_0 it creeps like a dashpot S/v_0. For friction that sticks use coulomb_rigid or jenkins.
!> Source: docs/why/theory.md, section 5.5. Sign: f stands beside K q on the left-hand side.
module hb_law_coulomb_tanh
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: coulomb_tanh_t

   type, extends(law_t) :: coulomb_tanh_t
      real(wp) :: limit = 0.0_wp                                      !! S = mu N [N]
      real(wp) :: velocity = 0.0_wp                                   !! v_0 [m/s]
   contains
      procedure :: declare_numbers => coulomb_tanh_declare_numbers
      procedure :: derive => coulomb_tanh_derive
      procedure :: number_slope => coulomb_tanh_number_slope
      procedure :: evaluate => coulomb_tanh_evaluate
   end type coulomb_tanh_t

contains

   subroutine coulomb_tanh_declare_numbers(self, numbers)
      class(coulomb_tanh_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("limit", self%limit)
      call numbers%add("velocity", self%velocity)
   end subroutine coulomb_tanh_declare_numbers

   pure subroutine coulomb_tanh_derive(self)
      class(coulomb_tanh_t), intent(inout) :: self

      self%needs_velocity = .true.
      self%needs_displacement = .false.
      self%has_potential = .true.
      self%is_odd = .true.
   end subroutine coulomb_tanh_derive

   subroutine coulomb_tanh_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(coulomb_tanh_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      f = self%limit*tanh(v/self%velocity)
      if (present(df_dz)) df_dz = 0.0_wp
      if (present(df_dv)) df_dv(:, :, 1) = self%limit/self%velocity*(1.0_wp - tanh(v/self%velocity)**2)
   end subroutine coulomb_tanh_evaluate

   subroutine coulomb_tanh_number_slope(self, number, z, v, p, slope, is_known)
      class(coulomb_tanh_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known

      is_known = .true.
      select case (number%key)
      case ("limit"); slope = tanh(v/self%velocity)
      case ("velocity"); slope = -self%limit*v/self%velocity**2*(1.0_wp - tanh(v/self%velocity)**2)
      case default
         is_known = .false.
      end select
   end subroutine coulomb_tanh_number_slope
end module hb_law_coulomb_tanh
