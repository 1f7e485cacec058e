!> Contact of curved bodies behind a gap, f = k d**n (1 + chi v) with the approach d = max(z - g, 0).
!> Source: Hertz, J. reine angew. Math. 92 (1881) 156-171, n = 3/2 for points; Hunt and Crossley, J. Appl. Mech. 42 (1975) 440-445,
!> for chi. Sign: f stands beside K q on the left-hand side.
module hb_law_hertz
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: hertz_t

   type, extends(law_t) :: hertz_t
      real(wp) :: stiffness = 0.0_wp                                  !! k [N/m**n]
      real(wp) :: exponent = 1.5_wp                                   !! n
      real(wp) :: gap = 0.0_wp                                        !! g [m]; negative: preloaded at rest
      real(wp) :: dissipation = 0.0_wp                                !! chi [s/m]
   contains
      procedure :: declare_numbers => hertz_declare_numbers
      procedure :: derive => hertz_derive
      procedure :: number_slope => hertz_number_slope
      procedure :: evaluate => hertz_evaluate
      procedure :: potential => hertz_potential
      procedure :: switches => hertz_switches
      procedure :: evaluate_held => hertz_evaluate_held
   end type hertz_t

contains

   subroutine hertz_declare_numbers(self, numbers)
      class(hertz_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("stiffness", self%stiffness)
      call numbers%add("exponent", self%exponent)
      call numbers%add("gap", self%gap)
      call numbers%add("dissipation", self%dissipation)
   end subroutine hertz_declare_numbers

   pure subroutine hertz_derive(self)
      class(hertz_t), intent(inout) :: self

      self%needs_velocity = self%dissipation > 0.0_wp
      self%has_potential = .true.
      self%has_convex_free_region = .true.
      self%length_scale = abs(self%gap)
      self%n_switches = 1
   end subroutine hertz_derive

   subroutine hertz_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(hertz_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: approach(size(z, 1), size(z, 2))

      approach = max(z - self%gap, 0.0_wp)
      associate (k => self%stiffness, n => self%exponent, chi => self%dissipation)
         f = k*approach**n
         if (present(df_dz)) df_dz(:, :, 1) = n*k*approach**(n - 1.0_wp)
         if (.not. self%needs_velocity) return
         if (present(df_dz)) df_dz(:, :, 1) = df_dz(:, :, 1)*(1.0_wp + chi*v)
         if (present(df_dv)) df_dv(:, :, 1) = chi*f
         f = f*(1.0_wp + chi*v)
      end associate
   end subroutine hertz_evaluate

   subroutine hertz_number_slope(self, number, z, v, p, slope, is_known)
      class(hertz_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      real(wp) :: approach(size(z, 1), size(z, 2)), k, n

      is_known = .true.
      approach = max(z - self%gap, 0.0_wp)
      k = self%stiffness
      n = self%exponent
      select case (number%key)
      case ("stiffness"); slope = approach**n
      case ("exponent"); slope = merge(k*approach**n*log(max(approach, tiny(k))), 0.0_wp, approach > 0.0_wp)
      case ("gap"); slope = merge(-n*k*approach**(n - 1.0_wp), 0.0_wp, approach > 0.0_wp)
      case ("dissipation")
         is_known = self%needs_velocity
         slope = k*approach**n
         if (is_known) slope = slope*v
         return
      case default
         is_known = .false.
         return
      end select
      if (self%needs_velocity) slope = slope*(1.0_wp + self%dissipation*v)
   end subroutine hertz_number_slope

   pure subroutine hertz_switches(self, z, v, values)
      class(hertz_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: values(:)

      values = z - self%gap
   end subroutine hertz_switches

   subroutine hertz_evaluate_held(self, z, v, is_positive, f)
      class(hertz_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      logical, intent(in) :: is_positive(:)
      real(wp), intent(out) :: f(:)

      f = 0.0_wp
      if (.not. is_positive(1)) return
      f = self%stiffness*max(z - self%gap, 0.0_wp)**self%exponent
      if (self%needs_velocity) f = f*(1.0_wp + self%dissipation*v)
   end subroutine hertz_evaluate_held

   !> k d**(n + 1)/(n + 1).
   subroutine hertz_potential(self, z, energy, gradient)
      class(hertz_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)

      gradient = self%stiffness*max(z - self%gap, 0.0_wp)**self%exponent
      energy = gradient(:, 1)*max(z(:, 1) - self%gap, 0.0_wp)/(self%exponent + 1.0_wp)
   end subroutine hertz_potential
end module hb_law_hertz
