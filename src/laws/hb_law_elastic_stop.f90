!> Elastic stop behind a gap: f = k max(z - g, 0), two-sided also k min(z + g, 0).
!> Source: docs/why/theory.md, section 5.2. Sign: f stands beside K q on the left-hand side.
module hb_law_elastic_stop
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: elastic_stop_t

   type, extends(law_t) :: elastic_stop_t
      real(wp) :: stiffness = 0.0_wp                                  !! k [N/m]
      real(wp) :: gap = 0.0_wp                                        !! g [m]; negative: preloaded at rest
      logical :: two_sided = .false.
   contains
      procedure :: declare_numbers => elastic_stop_declare_numbers
      procedure :: derive => elastic_stop_derive
      procedure :: number_slope => elastic_stop_number_slope
      procedure :: evaluate => elastic_stop_evaluate
      procedure :: potential => elastic_stop_potential
      procedure :: switches => elastic_stop_switches
      procedure :: evaluate_held => elastic_stop_evaluate_held
   end type elastic_stop_t

contains

   subroutine elastic_stop_declare_numbers(self, numbers)
      class(elastic_stop_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("stiffness", self%stiffness)
      call numbers%add("gap", self%gap)
      call numbers%add("two_sided", self%two_sided)
   end subroutine elastic_stop_declare_numbers

   pure subroutine elastic_stop_derive(self)
      class(elastic_stop_t), intent(inout) :: self

      self%has_potential = .true.
      self%has_convex_free_region = .true.
      self%is_odd = self%two_sided
      self%is_piecewise_linear = .true.
      self%length_scale = abs(self%gap)
      self%n_switches = merge(2, 1, self%two_sided)
      if (self%two_sided) then
         call self%set_kinks_of_coordinate([self%gap, -self%gap], [self%stiffness, -self%stiffness])
      else
         call self%set_kinks_of_coordinate([self%gap], [self%stiffness])
      end if
   end subroutine elastic_stop_derive

   subroutine elastic_stop_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(elastic_stop_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      f = self%stiffness*max(z - self%gap, 0.0_wp)
      if (self%two_sided) f = f + self%stiffness*min(z + self%gap, 0.0_wp)
      if (.not. present(df_dz)) return
      df_dz(:, :, 1) = merge(self%stiffness, 0.0_wp, z > self%gap)
      if (self%two_sided) df_dz(:, :, 1) = df_dz(:, :, 1) + merge(self%stiffness, 0.0_wp, z < -self%gap)
   end subroutine elastic_stop_evaluate

   subroutine elastic_stop_number_slope(self, number, z, v, p, slope, is_known)
      class(elastic_stop_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known

      is_known = .true.
      select case (number%key)
      case ("stiffness")
         slope = max(z - self%gap, 0.0_wp)
         if (self%two_sided) slope = slope + min(z + self%gap, 0.0_wp)
      case ("gap")
         slope = merge(-self%stiffness, 0.0_wp, z > self%gap)
         if (self%two_sided) slope = slope + merge(self%stiffness, 0.0_wp, z < -self%gap)
      case default
         is_known = .false.
      end select
   end subroutine elastic_stop_number_slope

   pure subroutine elastic_stop_switches(self, z, v, values)
      class(elastic_stop_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: values(:)

      values(1) = z(1) - self%gap
      if (self%two_sided) values(2) = -z(1) - self%gap
   end subroutine elastic_stop_switches

   subroutine elastic_stop_evaluate_held(self, z, v, is_positive, f)
      class(elastic_stop_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      logical, intent(in) :: is_positive(:)
      real(wp), intent(out) :: f(:)

      f = 0.0_wp
      if (is_positive(1)) f = self%stiffness*(z - self%gap)
      if (.not. self%two_sided) return
      if (is_positive(2)) f = f + self%stiffness*(z + self%gap)
   end subroutine elastic_stop_evaluate_held

   !> k max(z - g, 0)**2/2, two-sided also k min(z + g, 0)**2/2; their sum while both are in contact.
   subroutine elastic_stop_potential(self, z, energy, gradient)
      class(elastic_stop_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)

      energy = 0.5_wp*self%stiffness*max(z(:, 1) - self%gap, 0.0_wp)**2
      gradient = self%stiffness*max(z - self%gap, 0.0_wp)
      if (.not. self%two_sided) return
      energy = energy + 0.5_wp*self%stiffness*min(z(:, 1) + self%gap, 0.0_wp)**2
      gradient = gradient + self%stiffness*min(z + self%gap, 0.0_wp)
   end subroutine elastic_stop_potential
end module hb_law_elastic_stop
