!> Spring and damper that vary with the phase of tones, f = k(tau) z + d(tau) v with k = k_c cos(j.tau) + k_s
!> sin(j.tau) and d alike. Several of them form any periodic or quasi-periodic stiffness: Mathieu's equation, gear
!> meshes, breathing cracks. With a backlash b the spring acts on the part of z beyond -b to b, as between the teeth
!> of gears. Source: Nayfeh and Mook, Nonlinear Oscillations, Wiley 1979, chapter 5; A. Kahraman and R. Singh, J.
!> Sound Vib. 146 (1991) 135 (gears); docs/why/theory.md, section 5.1. Sign: f stands beside K q on the left-hand
!> side.
module hb_law_parametric
   use hb_kinds, only: wp
   use hb_law, only: law_t, read_location
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: parametric_t

   type, extends(law_t) :: parametric_t
      real(wp) :: stiffness(2) = 0.0_wp                               !! k_c, k_s [N/m]
      real(wp) :: damping(2) = 0.0_wp                                 !! d_c, d_s [N s/m]
      real(wp) :: backlash = 0.0_wp                                   !! b [m]
      real(wp), allocatable, private :: k(:, :), d(:, :)              ! at the following samples, (n_samples, 1)
   contains
      procedure :: read => parametric_read
      procedure :: set_phases => parametric_set_phases
      procedure :: evaluate => parametric_evaluate
      procedure :: switches => parametric_switches
      procedure :: evaluate_held => parametric_evaluate_held
   end type parametric_t

contains

   !> Reads a `&law type = 'parametric'` group.
   subroutine parametric_read(self, group, structure)
      class(parametric_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure

      call group%get("tuple", self%modulation)
      call group%get("stiffness_cos", self%stiffness(1))
      call group%get("stiffness_sin", self%stiffness(2))
      call group%get("damping_cos", self%damping(1))
      call group%get("damping_sin", self%damping(2))
      call group%get("backlash", self%backlash)
      self%needs_velocity = any(abs(self%damping) > 0.0_wp)
      if (self%backlash > 0.0_wp) then
         self%n_switches = 2
         self%length_scale = self%backlash
      else
         self%degree = 3                                              ! samples also for a tuple of twice the order
      end if
      call read_location(self, group, structure)
      if (.not. allocated(self%modulation)) return
      self%n_phases = size(self%modulation)
      if (all(self%modulation == 0)) call group%problem("tuple", "all zero: constant terms belong to the structure")
   end subroutine parametric_read

   pure subroutine parametric_set_phases(self, phases)
      class(parametric_t), intent(inout) :: self
      real(wp), intent(in) :: phases(:, :)
      real(wp) :: modulation(self%n_phases), phase(size(phases, 2), 1)

      modulation = real(self%modulation, wp)
      phase(:, 1) = matmul(modulation, phases(:self%n_phases, :))
      self%k = self%stiffness(1)*cos(phase) + self%stiffness(2)*sin(phase)
      self%d = self%damping(1)*cos(phase) + self%damping(2)*sin(phase)
   end subroutine parametric_set_phases

   subroutine parametric_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(parametric_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      f = self%k*(z - min(max(z, -self%backlash), self%backlash))
      if (present(df_dz)) df_dz(:, :, 1) = merge(0.0_wp, self%k, abs(z) < self%backlash)
      if (.not. self%needs_velocity) return
      f = f + self%d*v
      if (present(df_dv)) df_dv(:, :, 1) = self%d
   end subroutine parametric_evaluate

   pure subroutine parametric_switches(self, z, v, values)
      class(parametric_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: values(:)

      if (self%n_switches > 0) values = z(1) - [self%backlash, -self%backlash]
   end subroutine parametric_switches

   subroutine parametric_evaluate_held(self, z, v, is_positive, f)
      class(parametric_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      logical, intent(in) :: is_positive(:)
      real(wp), intent(out) :: f(:)

      f = 0.0_wp
      if (self%n_switches == 0) then
         f = self%k(1, 1)*z
      else if (is_positive(1)) then
         f = self%k(1, 1)*(z - self%backlash)
      else if (.not. is_positive(2)) then
         f = self%k(1, 1)*(z + self%backlash)
      end if
      if (self%needs_velocity) f = f + self%d(1, 1)*v
   end subroutine parametric_evaluate_held
end module hb_law_parametric
