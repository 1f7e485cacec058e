!> Damping that drives small motions and damps large ones, f = -mu (1 - (z/a)**2) v. Source: van der Pol, Philos. Mag.
!> 2 (1926) 978-992, with a = 1; docs/why/theory.md, section 5.1. Sign: f stands beside K q on the left-hand side.
module hb_law_van_der_pol
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: van_der_pol_t

   type, extends(law_t) :: van_der_pol_t
      real(wp) :: strength = 0.0_wp                                   !! mu [N s/m]
      real(wp) :: threshold = 1.0_wp                                  !! a [m], at which driving changes to damping
   contains
      procedure :: declare_numbers => van_der_pol_declare_numbers
      procedure :: derive => van_der_pol_derive
      procedure :: number_slope => van_der_pol_number_slope
      procedure :: evaluate => van_der_pol_evaluate
   end type van_der_pol_t

contains

   subroutine van_der_pol_declare_numbers(self, numbers)
      class(van_der_pol_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("strength", self%strength)
      call numbers%add("threshold", self%threshold)
   end subroutine van_der_pol_declare_numbers

   pure subroutine van_der_pol_derive(self)
      class(van_der_pol_t), intent(inout) :: self

      self%needs_velocity = .true.
      self%degree = 3
      self%has_potential = .true.
      self%is_odd = .true.
      self%length_scale = self%threshold
   end subroutine van_der_pol_derive

   subroutine van_der_pol_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(van_der_pol_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      associate (mu => self%strength, a => self%threshold)
         f = -mu*(1.0_wp - (z/a)**2)*v
         if (present(df_dz)) df_dz(:, :, 1) = 2.0_wp*mu*z*v/a**2
         if (present(df_dv)) df_dv(:, :, 1) = -mu*(1.0_wp - (z/a)**2)
      end associate
   end subroutine van_der_pol_evaluate

   subroutine van_der_pol_number_slope(self, number, z, v, p, slope, is_known)
      class(van_der_pol_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known

      is_known = .true.
      select case (number%key)
      case ("strength"); slope = -(1.0_wp - (z/self%threshold)**2)*v
      case ("threshold"); slope = -2.0_wp*self%strength*z**2*v/self%threshold**3
      case default
         is_known = .false.
      end select
   end subroutine van_der_pol_number_slope
end module hb_law_van_der_pol
