!> Spring and damper that vary with the phase of tones, f = k(tau) z + c(tau) z**3 + d(tau) v with k = k_c cos(j.tau) + k_s
!> sin(j.tau), c and d alike. Several of them form any periodic or quasi-periodic stiffness: Mathieu's equation, gear
!> meshes, breathing cracks, pumped resonators. With a backlash b the springs act on the part of z beyond -b to b, as
!> between the teeth of gears. Source: Nayfeh and Mook, Nonlinear Oscillations, Wiley 1979, chapter 5; A. Kahraman and R. Singh, J.
!> Sound Vib. 146 (1991) 135 (gears); docs/why/theory.md, section 5.1. Sign: f stands beside K q on the left-hand
!> side.
module hb_law_parametric
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   use hb_problems, only: problems_t
   implicit none
   private
   public :: parametric_t

   type, extends(law_t) :: parametric_t
      real(wp) :: stiffness(2) = 0.0_wp                               !! k_c, k_s [N/m]
      real(wp) :: cubic(2) = 0.0_wp                                   !! c_c, c_s [N/m3]
      real(wp) :: damping(2) = 0.0_wp                                 !! d_c, d_s [N s/m]
      real(wp) :: backlash = 0.0_wp                                   !! b [m]
      real(wp), allocatable, private :: cosine(:, :), sine(:, :)      ! of the phase at the following samples, (n_samples, 1)
      real(wp), allocatable, private :: k(:, :), c(:, :), d(:, :)     ! there, (n_samples, 1)
      logical, private :: is_cubic = .false.
   contains
      procedure :: declare_numbers => parametric_declare_numbers
      procedure :: check => parametric_check
      procedure :: derive => parametric_derive
      procedure :: number_slope => parametric_number_slope
      procedure :: set_phases => parametric_set_phases
      procedure :: evaluate => parametric_evaluate
      procedure :: switches => parametric_switches
      procedure :: evaluate_held => parametric_evaluate_held
   end type parametric_t

contains

   subroutine parametric_declare_numbers(self, numbers)
      class(parametric_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("tuple", self%modulation)
      call numbers%add("stiffness_cos", self%stiffness(1))
      call numbers%add("stiffness_sin", self%stiffness(2))
      call numbers%add("cubic_cos", self%cubic(1))
      call numbers%add("cubic_sin", self%cubic(2))
      call numbers%add("damping_cos", self%damping(1))
      call numbers%add("damping_sin", self%damping(2))
      call numbers%add("backlash", self%backlash)
   end subroutine parametric_declare_numbers

   subroutine parametric_check(self, problems)
      class(parametric_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. allocated(self%modulation)) return
      if (all(self%modulation == 0)) call problems%add("tuple", "all zero: constant terms belong to the structure")
   end subroutine parametric_check

   pure subroutine parametric_derive(self)
      class(parametric_t), intent(inout) :: self

      if (allocated(self%modulation)) self%n_phases = size(self%modulation)
      self%needs_velocity = any(abs(self%damping) > 0.0_wp)
      self%n_switches = merge(2, 0, self%backlash > 0.0_wp)
      self%length_scale = self%backlash
      self%is_cubic = any(abs(self%cubic) > 0.0_wp)
      self%degree = merge(0, merge(5, 3, self%is_cubic), self%backlash > 0.0_wp)   ! samples also for a tuple of twice the order
      if (allocated(self%cosine)) call modulate(self)
   end subroutine parametric_derive

   pure subroutine parametric_set_phases(self, phases)
      class(parametric_t), intent(inout) :: self
      real(wp), intent(in) :: phases(:, :)
      real(wp) :: modulation(self%n_phases), phase(size(phases, 2), 1)

      modulation = real(self%modulation, wp)
      phase(:, 1) = matmul(modulation, phases(:self%n_phases, :))
      self%cosine = cos(phase)
      self%sine = sin(phase)
      call modulate(self)
   end subroutine parametric_set_phases

   !> Computes stiffnesses and damping at the samples.
   pure subroutine modulate(self)
      class(parametric_t), intent(inout) :: self

      self%k = self%stiffness(1)*self%cosine + self%stiffness(2)*self%sine
      self%c = self%cubic(1)*self%cosine + self%cubic(2)*self%sine
      self%d = self%damping(1)*self%cosine + self%damping(2)*self%sine
   end subroutine modulate

   subroutine parametric_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(parametric_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      f = self%k*beyond(z, self%backlash)
      if (present(df_dz)) df_dz(:, :, 1) = merge(0.0_wp, self%k, abs(z) < self%backlash)
      if (self%is_cubic) then
         f = f + self%c*beyond(z, self%backlash)**3
         if (present(df_dz)) df_dz(:, :, 1) = df_dz(:, :, 1) + 3*self%c*beyond(z, self%backlash)**2
      end if
      if (.not. self%needs_velocity) return
      f = f + self%d*v
      if (present(df_dv)) df_dv(:, :, 1) = self%d
   end subroutine parametric_evaluate

   !> The part of z beyond -b to b.
   elemental real(wp) function beyond(z, b)
      real(wp), intent(in) :: z, b                                    !! [m]

      beyond = z - min(max(z, -b), b)
   end function beyond

   subroutine parametric_number_slope(self, number, z, v, p, slope, is_known)
      class(parametric_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      real(wp) :: b

      is_known = .true.
      b = self%backlash
      slope = 0.0_wp
      select case (number%key)
      case ("stiffness_cos"); slope = self%cosine*beyond(z, b)
      case ("stiffness_sin"); slope = self%sine*beyond(z, b)
      case ("cubic_cos"); slope = self%cosine*beyond(z, b)**3
      case ("cubic_sin"); slope = self%sine*beyond(z, b)**3
      case ("damping_cos")
         is_known = self%needs_velocity
         if (is_known) slope = self%cosine*v
      case ("damping_sin")
         is_known = self%needs_velocity
         if (is_known) slope = self%sine*v
      case ("backlash")
         is_known = b > 0.0_wp
         slope = -(self%k + 3*self%c*beyond(z, b)**2)*merge(sign(1.0_wp, z), 0.0_wp, abs(z) >= b)
      case default
         is_known = .false.
      end select
   end subroutine parametric_number_slope

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
      real(wp) :: part(size(z))                                       ! beyond the backlash [m]

      part = 0.0_wp
      if (self%n_switches == 0) then
         part = z
      else if (is_positive(1)) then
         part = z - self%backlash
      else if (.not. is_positive(2)) then
         part = z + self%backlash
      end if
      f = self%k(1, 1)*part + self%c(1, 1)*part**3
      if (self%needs_velocity) f = f + self%d(1, 1)*v
   end subroutine parametric_evaluate_held
end module hb_law_parametric
