!> The map of the state of a motion, and of neighbouring states, over a time, by time integration.
!>
!> States are scaled by the amplitude and the speed of the motion. Methods follow events, so that a difference of two time
!> integrations includes the effect of impacts and reversals on a disturbance (saltation).
module hb_state_map
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_budget, only: affordable_evaluations
   use hb_error, only: error_t
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_integration_config, only: integration_config_t, integration_method
   use hb_integration_system, only: integration_state_t, integration_system_t, new_integration_state
   use hb_kinds, only: two_pi, wp
   use hb_law, only: hold_t
   use hb_monodromy, only: min_instants
   use hb_motion_series, only: motion_series_t
   use hb_primary_method, only: evaluation_work
   use hb_rigid_constraints, only: collect_rigid
   use hb_structure, only: structure_t
   use hb_thresholds, only: small_share
   use hb_time_stepping, only: integrate_from, integration_record_t
   implicit none
   private
   public :: at_rest, far_from_events, farthest_phase, new_state_map, state_map_t

   real(wp), parameter :: max_accurate = 1.0e-13_wp                  ! tolerance of time integration with variable steps
   real(wp), parameter :: min_accurate = 1.0e-11_wp
   real(wp), parameter :: tolerance_ratio = 1.0e-4_wp ! that of time integration relative to that of what is made of it
   integer, parameter :: steps_a_radian = 20                          ! of the fastest motion, likewise
   real(wp), parameter :: usual_evaluations = 1500.0_wp               ! at the motion in a period, with variable steps
   real(wp), parameter :: evaluations_per_radian = 15.0_wp          ! of the fastest mode, whose stability limits these steps: 15 on
                                                                      ! a beam of 8 degrees of freedom
                                                                      ! (test_hb_integrated_propagation)
   real(wp), parameter :: at_rest = 1.0e-6_wp !! oscillation relative to the extent, and speed relative to that times the frequency

   type :: state_map_t
      type(integration_system_t), pointer :: system => null()
      type(motion_series_t) :: motion                                 !! of all degrees of freedom
      type(hold_t), allocatable :: rigid(:)                           !! laws
      real(wp), allocatable :: scale(:)                               !! of (q, v, states of laws), > 0
      logical :: has_own_steps = .true.                               !! the method chooses them
      integer :: min_steps = 1000                                  !! else, in a period of the fastest tone
      integer :: level = 1                                            !! each has twice the steps of the one before
      integer, allocatable :: impacts(:)                              !! of the last time integration, as of a record; < 0: of none
      type(integration_config_t), private :: config
   contains
      procedure :: state_at => state_map_state_at
      procedure :: rate_at => state_map_rate_at
      procedure :: advance => state_map_advance
      procedure :: record_from => state_map_record_from
      procedure :: differences => state_map_differences
      procedure :: allow => state_map_allow
      procedure :: work_of => state_map_work_of
   end type state_map_t

contains

   !> Fails for laws that no method can follow.
   subroutine new_state_map(self, system, motion, restitution, tolerance, error)
      type(state_map_t), intent(out) :: self
      type(integration_system_t), intent(inout), target :: system     !! of all degrees of freedom
      type(motion_series_t), intent(in) :: motion                     !! of all degrees of freedom
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: tolerance                               !! of derivatives, relative
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: extent(motion%n_coordinates), speed(motion%n_coordinates)
      integer :: i, k, n

      self%system => system
      self%motion = motion
      call collect_rigid(system%laws, restitution, self%rigid, error)
      if (allocated(error)) return
      self%impacts = spread(-1, 1, 2*size(self%rigid))
      n = system%n_dofs
      do i = 1, size(system%laws%laws)
         select type (law => system%laws%laws(i)%law)
         class is (hysteretic_law_t)
            self%has_own_steps = self%has_own_steps .and. law%has_bounds
         end select
      end do
      self%config%method = merge(integration_method%cvode, integration_method%runge_kutta_4, self%has_own_steps)
      self%config%tolerance = min(max(tolerance_ratio*tolerance, max_accurate), min_accurate)
      self%config%restitution = restitution
      self%config%decimation = huge(1)
      extent = sum(abs(motion%amplitudes), dim=2)
      speed = matmul(abs(motion%amplitudes), abs(motion%frequencies))
      if (maxval(extent) <= 0.0_wp) extent = system%typical_displacements()
      if (maxval(extent) <= 0.0_wp) extent = system%unit              ! at rest, without loads, at no distance from anything
      extent = max(extent, small_share*system%largest_in_units(extent))
      speed = max(speed, small_share*system%largest_in_units(speed), at_rest*system%largest_in_units(extent)* &
            maxval(abs(motion%omega)))
      allocate (self%scale(2*n + system%laws%n_states))
      self%scale(:2*n) = [extent, speed]
      do i = 1, size(system%laws%spans)
         associate (span => system%laws%spans(i))
            do k = span%first_state, span%last_state
               self%scale(2*n + k) = maxval(matmul(transpose(abs(system%laws%shape(:, span%first:span%last))), extent))
            end do
         end associate
      end do
      self%config%largest = 1.0e4_wp*maxval(extent)
   end subroutine new_state_map

   !> State of the motion, scaled; states of laws are zero and must first become periodic.
   function state_map_state_at(self, time) result(x)
      class(state_map_t), intent(in) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp) :: x(size(self%scale))
      real(wp) :: v(1, self%motion%n_coordinates), z(1, self%motion%n_coordinates)

      call self%motion%at(self%motion%phases([time]), z, v)
      x = 0.0_wp
      associate (n => 2*self%system%n_dofs)
         x(:n) = [z(1, :), v(1, :)]/self%scale(:n)
      end associate
   end function state_map_state_at

   !> Rate of that state along the motion [1/s].
   function state_map_rate_at(self, time) result(rate)
      class(state_map_t), intent(in) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp) :: rate(size(self%scale))
      real(wp) :: a(self%motion%n_coordinates), v(1, self%motion%n_coordinates), z(1, self%motion%n_coordinates)
      complex(wp) :: waves(size(self%motion%frequencies))

      call self%motion%at(self%motion%phases([time]), z, v)
      associate (n => self%system%n_dofs, w => self%motion%frequencies)
         waves = w**2*exp(cmplx(0.0_wp, w*time, wp))
         a = -real(matmul(self%motion%amplitudes, waves), wp)
         rate = 0.0_wp
         rate(:n) = v(1, :)/self%scale(:n)
         rate(n + 1:2*n) = a/self%scale(n + 1:2*n)
      end associate
   end function state_map_rate_at

   !> State after a given time.
   subroutine state_map_advance(self, start, duration, x, after, is_done)
      class(state_map_t), intent(inout) :: self
      real(wp), intent(in) :: start, duration                         !! [s]
      real(wp), intent(in) :: x(:)                                    !! scaled
      real(wp), intent(out) :: after(:)                               !! likewise
      logical, intent(out) :: is_done
      type(integration_record_t) :: record
      integer, parameter :: no_instants(0) = 0

      after = x
      call self%record_from(start, duration, n_steps_of(self, self%level), no_instants, after, record, is_done)
   end subroutine state_map_advance

   !> As `advance`, with a record of some displacements, and of impacts if there are any.
   subroutine state_map_record_from(self, start, duration, n_samples, dofs, x, record, is_done)
      class(state_map_t), intent(inout) :: self
      real(wp), intent(in) :: start, duration                         !! [s]
      integer, intent(in) :: n_samples                                !! after the first
      integer, intent(in) :: dofs(:)
      real(wp), intent(inout) :: x(:)                                 !! scaled, on return after the duration
      type(integration_record_t), intent(out) :: record
      logical, intent(out) :: is_done
      type(integration_state_t) :: state
      type(error_t), allocatable :: error

      associate (system => self%system, n => self%system%n_dofs, y => x*self%scale)
         call new_integration_state(state, n, system%laws%n_states)
         state%time = start
         state%q = y(:n)
         state%v = y(n + 1:2*n)
         state%s = y(2*n + 1:)
         self%config%duration = duration
         system%lists_impacts = size(dofs) > 0
         call integrate_from(system, self%config, duration/n_samples, dofs, state, record, error)
      end associate
      is_done = .not. allocated(error)
      if (is_done) x = [state%q, state%v, state%s]/self%scale
      if (is_done) is_done = all(ieee_is_finite(x))
      if (allocated(record%impacts)) self%impacts = record%impacts
   end subroutine state_map_record_from

   !> Remaining changes after a time for changes in some directions, by central differences, per change.
   subroutine state_map_differences(self, start, duration, x, distance, directions, changes, is_done)
      class(state_map_t), intent(inout) :: self
      real(wp), intent(in) :: start, duration                         !! [s]
      real(wp), intent(in) :: x(:)                                    !! scaled
      real(wp), intent(in) :: distance                                !! of the two states from x, along a direction
      real(wp), intent(in) :: directions(:, :)                        !! (size, any)
      real(wp), intent(out) :: changes(:, :)                          !! likewise
      logical, intent(out) :: is_done
      real(wp), dimension(size(x)) :: above, below
      integer :: k

      is_done = .true.
      do k = 1, size(directions, 2)
         call self%advance(start, duration, x + distance*directions(:, k), above, is_done)
         if (is_done) call self%advance(start, duration, x - distance*directions(:, k), below, is_done)
         if (.not. is_done) return
         changes(:, k) = (above - below)/(2.0_wp*distance)
      end do
   end subroutine state_map_differences

   !> Limits the work of the following time integrations.
   subroutine state_map_allow(self, work)
      class(state_map_t), intent(inout) :: self
      real(wp), intent(in) :: work                                    !! in about a nanosecond

      self%config%max_evaluations = self%system%laws%n_evaluations + &
         affordable_evaluations(work, evaluation_work(self%system%n_dofs, self%system%laws%n_coordinates, .false.))
   end subroutine state_map_allow

   !> Approximate work of a period of the slowest tone in nanoseconds, from counts alone.
   pure real(wp) function state_map_work_of(self, level) result(work)
      class(state_map_t), intent(in) :: self
      integer, intent(in) :: level

      work = max(usual_evaluations*maxval(self%motion%omega), evaluations_per_radian*two_pi*fastest_mode(self%system%structure))/ &
             minval(self%motion%omega)
      if (.not. self%has_own_steps) work = 4.0_wp*n_steps_of(self, level)
      work = work*evaluation_work(self%system%n_dofs, self%system%laws%n_coordinates, .false.)
   end function state_map_work_of

   !> Phase [rad] at which open walls are far and friction slips fast, as a compromise between all.
   function farthest_phase(integration) result(phase)
      type(state_map_t), intent(in) :: integration
      real(wp) :: phase
      real(wp) :: phases(1, min_instants)
      real(wp) :: v(min_instants, integration%motion%n_coordinates), z(min_instants, integration%motion%n_coordinates)
      integer :: i

      phase = 0.0_wp
      if (size(integration%rigid) == 0) return
      phases(1, :) = [(two_pi*i/min_instants, i=0, min_instants - 1)]
      call integration%motion%at(phases, z, v)
      phase = phases(1, maxloc(far_from_events(integration, z, v), dim=1))
   end function farthest_phase

   !> Distance of instants of a motion from its events, the least of all laws, each relative to the largest.
   pure function far_from_events(integration, z, v) result(least)
      type(state_map_t), intent(in) :: integration
      real(wp), intent(in) :: z(:, :), v(:, :)                        !! [m], [m/s], (instants, n_dofs)
      real(wp) :: least(size(z, 1))
      real(wp) :: far(size(z, 1), size(integration%rigid))
      integer :: i

      do i = 1, size(integration%rigid)
         associate (rigid => integration%rigid(i), shape => integration%system%laws%shape(:, integration%rigid(i)%coordinate))
            if (.not. rigid%is_wall) then
               far(:, i) = abs(matmul(v, shape))
            else if (rigid%two_sided) then
               far(:, i) = max(rigid%gap - abs(matmul(z, shape)), 0.0_wp)
            else
               far(:, i) = max(rigid%gap - matmul(z, shape), 0.0_wp)
            end if
         end associate
         far(:, i) = far(:, i)/max(maxval(far(:, i)), tiny(1.0_wp))
      end do
      least = minval(far, dim=2)
   end function far_from_events

   !> Steps of a time integration at a level in a period of the slowest tone; one if the method chooses its own.
   pure integer function n_steps_of(self, level) result(n_steps)
      type(state_map_t), intent(in) :: self
      integer, intent(in) :: level

      n_steps = 1
      if (self%has_own_steps) return
      associate (omega => self%motion%omega, fastest => fastest_mode(self%system%structure))
         n_steps = max(ceiling(self%min_steps*maxval(omega)/minval(omega)), &
                       ceiling(min(steps_a_radian*fastest*two_pi/minval(omega), 1.0e6_wp)))*2**(level - 1)
      end associate
   end function n_steps_of

   !> Approximate largest natural frequency [rad/s], from the diagonals.
   pure real(wp) function fastest_mode(structure) result(fastest)
      type(structure_t), intent(in) :: structure
      integer :: i

      fastest = 0.0_wp
      do i = 1, structure%n_dofs
         if (structure%mass(i, i) > 0.0_wp) fastest = max(fastest, sqrt(abs(structure%stiffness(i, i)/structure%mass(i, i))))
      end do
   end function fastest_mode
end module hb_state_map
