!> Friction that falls with the sliding velocity, from a static to a kinetic limit (Stribeck curve), smoothed at rest:
!>
!>    f = (S_k + (S_s - S_k) exp(-(w/v_s)**2)) tanh(w/v_0),   w = v - v_b.
!>
!> The coordinate slides on a body that moves with v_b, such as a belt. Where f falls with w it excites: squeal, stick-slip.
!> Like coulomb_tanh it does not stick: below v_0 it creeps like a dashpot S_s/v_0.
!> Source: docs/why/theory.md, section 5.5. Sign: f stands beside K q on the left-hand side.
module hb_law_stribeck
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: stribeck_t

   type, extends(law_t) :: stribeck_t
      real(wp) :: limit = 0.0_wp                                      !! S_k, of fast sliding [N]
      real(wp) :: static_limit = 0.0_wp                               !! S_s, next to rest [N]
      real(wp) :: stribeck_velocity = 1.0_wp                          !! v_s, over which the limit falls [m/s]
      real(wp) :: velocity = 1.0_wp                                   !! v_0, below which it creeps [m/s]
      real(wp) :: belt_velocity = 0.0_wp                              !! v_b [m/s]
   contains
      procedure :: declare_numbers => stribeck_declare_numbers
      procedure :: derive => stribeck_derive
      procedure :: number_slope => stribeck_number_slope
      procedure :: evaluate => stribeck_evaluate
   end type stribeck_t

contains

   subroutine stribeck_declare_numbers(self, numbers)
      class(stribeck_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("limit", self%limit)
      call numbers%add("static_limit", self%static_limit)
      call numbers%add("stribeck_velocity", self%stribeck_velocity)
      call numbers%add("velocity", self%velocity)
      call numbers%add("belt_velocity", self%belt_velocity)
   end subroutine stribeck_declare_numbers

   pure subroutine stribeck_derive(self)
      class(stribeck_t), intent(inout) :: self

      self%needs_velocity = .true.
      self%needs_displacement = .false.
      self%is_odd = abs(self%belt_velocity) <= 0.0_wp
      self%has_potential = self%is_odd                                ! a belt does work
   end subroutine stribeck_derive

   subroutine stribeck_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(stribeck_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      f = sliding_friction(self, v)*direction(self, v)
      if (present(df_dz)) df_dz = 0.0_wp
      if (present(df_dv)) df_dv(:, :, 1) = slope_of_velocity(self, v)
   end subroutine stribeck_evaluate

   subroutine stribeck_number_slope(self, number, z, v, p, slope, is_known)
      class(stribeck_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known

      is_known = .true.
      associate (w => v - self%belt_velocity)
         select case (number%key)
         case ("limit"); slope = (1.0_wp - share_of_static(self, v))*direction(self, v)
         case ("static_limit"); slope = share_of_static(self, v)*direction(self, v)
         case ("stribeck_velocity")
            slope = 2.0_wp*w**2/self%stribeck_velocity**3*(self%static_limit - self%limit)* &
                    share_of_static(self, v)*direction(self, v)
         case ("velocity"); slope = -sliding_friction(self, v)*w/self%velocity**2*(1.0_wp - direction(self, v)**2)
         case ("belt_velocity"); slope = -slope_of_velocity(self, v)
         case default
            slope = 0.0_wp
            is_known = .false.
         end select
      end associate
   end subroutine stribeck_number_slope

   !> exp(-(w/v_s)**2).
   elemental real(wp) function share_of_static(self, v)
      class(stribeck_t), intent(in) :: self
      real(wp), intent(in) :: v                                       !! [m/s]

      share_of_static = exp(-((v - self%belt_velocity)/self%stribeck_velocity)**2)
   end function share_of_static

   !> The friction force of sliding [N].
   elemental real(wp) function sliding_friction(self, v)
      class(stribeck_t), intent(in) :: self
      real(wp), intent(in) :: v                                       !! [m/s]

      sliding_friction = self%limit + (self%static_limit - self%limit)*share_of_static(self, v)
   end function sliding_friction

   !> tanh(w/v_0).
   elemental real(wp) function direction(self, v)
      class(stribeck_t), intent(in) :: self
      real(wp), intent(in) :: v                                       !! [m/s]

      direction = tanh((v - self%belt_velocity)/self%velocity)
   end function direction

   !> df/dv [N s/m].
   elemental real(wp) function slope_of_velocity(self, v) result(slope)
      class(stribeck_t), intent(in) :: self
      real(wp), intent(in) :: v                                       !! [m/s]

      slope = sliding_friction(self, v)*(1.0_wp - direction(self, v)**2)/self%velocity - 2.0_wp*(v - self%belt_velocity)/ &
              self%stribeck_velocity**2*(self%static_limit - self%limit)*share_of_static(self, v)*direction(self, v)
   end function slope_of_velocity
end module hb_law_stribeck
