!> The period map by time integration, for motions with events that have no linearised equations: impacts, rigid
!> friction that sticks and slips, sliders in a plane.
!>
!> Newton's method finds the periodic state from that of the motion (shooting); the derivative of the map there is the
!> monodromy matrix, from central differences over decreasing distances (and steps, for a method with fixed steps),
!> extrapolated. The change with the next distance is the estimate; it remains large if the map has a kink or a jump,
!> as at a grazing impact. Source: A. H. Nayfeh and B. Balachandran, Applied Nonlinear Dynamics, Wiley 1995, sections
!> 6.5 and 7.1.
!>
!> The map of the state of a motion, and of neighbouring states, over a time, by time integration.
!>
!> States are scaled by the amplitude and the speed of the motion. Methods follow events, so that a difference of two time
!> integrations includes the effect of impacts and reversals on a disturbance (saltation).
module hb_period_map
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_integration_laws, only: collect_rigid
   use hb_integration_system, only: integration_state_t, integration_system_t, new_integration_state
   use hb_kinds, only: int64, two_pi, wp
   use hb_lapack, only: dgeqrf, dgetrf, dgetrs, dorgqr
   use hb_law, only: hold_t
   use hb_monodromy, only: min_instants
   use hb_motion_series, only: motion_series_t
   use hb_structure, only: structure_t
   use hb_thresholds, only: minor, same_motion
   use hb_time_domain, only: evaluation_work, integration_config_t, integration_method
   use hb_time_stepping, only: integrate_from, integration_record_t
   implicit none
   private
   public :: at_rest, distance_at, far_from_events, farthest_phase, find_period_map, limit_t, new_period_map, new_state_map, &
      period_map_t, state_map_t, work_of_period_map

   real(wp), parameter :: max_accurate = 1.0e-13_wp                  ! tolerance of time integration with variable steps
   real(wp), parameter :: min_accurate = 1.0e-11_wp
   real(wp), parameter :: finer = 1.0e-4_wp ! that of time integration relative to that of what is made of it
   integer, parameter :: steps_a_radian = 20                          ! of the fastest motion, likewise
   real(wp), parameter :: usual_evaluations = 1500.0_wp               ! at the motion in a period, with variable steps
   real(wp), parameter :: evaluations_per_radian = 15.0_wp          ! of the fastest mode, whose stability limits these steps: 15 on
                                                                      ! a beam of 8 degrees of freedom
                                                                      ! (test_hb_integrated_propagation)

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
      procedure :: carry => state_map_carry
      procedure :: record_from => state_map_record_from
      procedure :: differences => state_map_differences
      procedure :: allow => state_map_allow
      procedure :: work_of => state_map_work_of
   end type state_map_t

   real(wp), parameter :: farthest = 5.0e-3_wp                        ! of two states in a difference quotient, scaled
   integer, parameter :: max_levels = 4                              ! distances
   real(wp), parameter :: repeats = 1.0e-7_wp                         ! permitted defect of a state after a period, scaled
   real(wp), parameter :: enough = 1.0e-9_wp                          ! defect that needs no further step, likewise
   integer, parameter :: max_shots = 30
   integer, parameter :: max_matrices = 4                            ! before convergence
   real(wp), parameter :: slow = 0.3_wp                               ! ratio of two residuals above which a new matrix is needed
   real(wp), parameter :: neutral = 1.0e-2_wp                         ! change of what stays as it is: a push apart slips a little
   integer, parameter :: periods_of_sliders = 3                       ! after which they are periodic
   real(wp), parameter :: usual_shots = 6.0_wp
   real(wp), parameter :: at_rest = 1.0e-6_wp !! oscillation relative to the extent, and speed relative to that times the frequency

   real(wp), parameter :: nearer = 0.2_wp                             ! from one distance to the next

   !> Limit of central differences over decreasing distances, by extrapolation of increasing order. The change by the last
   !> order and distance is the estimate of the error; the best value is stored. Source: C. J. F. Ridders, Adv. Eng. Softw. 4
   !> (1982) 75-76.
   type :: limit_t
      real(wp) :: ratio = nearer                                      !! of one distance to the one before
      real(wp), allocatable :: best(:, :)
      real(wp) :: estimate = huge(1.0_wp)                             !! relative to its largest entry
      integer :: n_idle = 0                                           !! last distances that have not improved the best value
      real(wp), allocatable, private :: orders(:, :, :)               ! at the last distance
   contains
      procedure :: add => limit_add
   end type limit_t

   type :: period_map_t
      real(wp), allocatable :: matrix(:, :)                           !! monodromy of the part that is not always held, scaled
      real(wp), allocatable :: first(:, :)                            !! that at the state of the given motion
      real(wp), allocatable :: shift(:)                               !! of the phase of an unknown tone, as the matrix
      real(wp) :: estimate = huge(1.0_wp)                             !! of the error of the matrix, relative to its largest entry
      logical :: is_found = .false.
      real(wp), private :: tolerance = 0.0_wp
      real(wp), private :: share = 1.0_wp                             ! of the period that is integrated: half for an odd motion,
      real(wp), private :: sense = 1.0_wp                             ! which is then mirrored, -1
      real(wp), private :: start = 0.0_wp, period = 0.0_wp            ! [s]
      real(wp), allocatable, private :: x(:)                          ! state, scaled
      real(wp), allocatable, private :: rate(:)                       ! of the motion at the start [1/s], scaled
      real(wp), allocatable, private :: still(:, :) ! coordinates that are constant while friction holds, (size, any)
      real(wp), allocatable, private :: free(:, :)                    ! orthonormal, of all states with these coordinates constant
      type(state_map_t), private :: integration
   end type period_map_t

contains

   !> Takes the state of a motion at the phase that is farthest from its events. Fails for laws that no integrator
   !> supports.
   subroutine new_period_map(self, system, motion, restitution, tolerance, error)
      type(period_map_t), intent(out) :: self
      type(integration_system_t), intent(inout), target :: system     !! of all degrees of freedom
      type(motion_series_t), intent(in) :: motion                     !! of all degrees of freedom, one tone
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: tolerance                               !! of the matrix, relative
      type(error_t), allocatable, intent(out) :: error

      call new_state_map(self%integration, system, motion, restitution, tolerance, error)
      if (allocated(error)) return
      self%tolerance = tolerance
      self%period = two_pi/motion%omega(1)
      self%start = farthest_phase(self%integration)/motion%omega(1)
      self%x = self%integration%state_at(self%start)
      self%rate = self%integration%rate_at(self%start)
      call list_still(self)
      if (is_odd(system, motion)) then
         self%share = 0.5_wp
         self%sense = -1.0_wp
      end if
   end subroutine new_period_map

   !> Whether a motion has only odd harmonics, and laws that permit this.
   pure logical function is_odd(system, motion)
      type(integration_system_t), intent(in) :: system
      type(motion_series_t), intent(in) :: motion
      real(wp), parameter :: nothing = 1.0e-9_wp                      ! relative
      logical :: is_even(size(motion%frequencies))
      integer :: i, k

      is_even = modulo(motion%tuples(1, :), 2) == 0
      is_odd = all([(system%laws%laws(i)%law%is_odd, i=1, size(system%laws%laws))])
      do k = 1, motion%n_coordinates
         is_odd = is_odd .and. sum(abs(motion%amplitudes(k, :)), mask=is_even) <= nothing*sum(abs(motion%amplitudes))
      end do
   end function is_odd

   !> Coordinates that may be constant: those held by rigid friction, and sliders.
   subroutine list_still(self)
      type(period_map_t), intent(inout) :: self
      integer :: i, k, n

      associate (system => self%integration%system, rigid => self%integration%rigid, scale => self%integration%scale)
         n = system%n_dofs
         allocate (self%still(size(self%x), count(.not. rigid%is_wall) + system%laws%n_states), source=0.0_wp)
         k = 0
         do i = 1, size(rigid)
            if (rigid(i)%is_wall) cycle
            k = k + 1
            self%still(:n, k) = system%laws%shape(:, rigid(i)%coordinate)*scale(:n)
            self%still(:, k) = self%still(:, k)/norm2(self%still(:, k))
         end do
         do i = 1, system%laws%n_states
            self%still(2*n + i, k + i) = 1.0_wp
         end do
      end associate
   end subroutine list_still

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

   !> Approximate work in nanoseconds, from counts alone.
   pure real(wp) function work_of_period_map(self) result(work)
      type(period_map_t), intent(in) :: self

      work = (8.0_wp*size(self%x) + usual_shots)*self%integration%work_of(2)
   end function work_of_period_map

   !> Finds the periodic state and the matrix there; `is_found` states whether it is close to the motion.
   subroutine find_period_map(self, is_free, work_limit)
      type(period_map_t), intent(inout) :: self
      logical, intent(in) :: is_free                                  !! the tone is unknown
      real(wp), intent(in) :: work_limit                              !! in about a nanosecond
      type(limit_t) :: limit
      real(wp), allocatable :: there(:, :)
      integer :: level
      logical :: is_done

      call self%integration%allow(work_limit)
      call make_sliders_periodic(self, is_done)
      if (is_done) call shoot(self, is_free, is_done)
      if (.not. is_done) return
      do level = 1, max_levels
         call differentiate(self, level, there, is_done)
         if (.not. is_done) return
         call limit%add(there)
         if (limit%estimate <= self%tolerance) exit
      end do
      if (.not. allocated(limit%best)) return
      self%estimate = limit%estimate
      call leave_still(self, limit%best)
      self%matrix = matmul(transpose(self%free), matmul(limit%best, self%free))
      self%first = matmul(transpose(self%free), matmul(self%first, self%free))
      if (self%sense < 0.0_wp) then                                   ! twice half a period
         self%matrix = matmul(self%matrix, self%matrix)
         self%first = matmul(self%first, self%first)
      end if
      self%shift = matmul(transpose(self%free), matmul(limit%best, self%rate))
      self%is_found = .true.
   end subroutine find_period_map

   !> Distance of the states of a difference from the state between them, scaled.
   pure real(wp) function distance_at(level, ratio) result(distance)
      integer, intent(in) :: level                                    !! from 1
      real(wp), intent(in) :: ratio                                   !! to the one before

      distance = farthest*ratio**(level - 1)
   end function distance_at

   !> Adds the difference over the next distance.
   subroutine limit_add(self, difference)
      class(limit_t), intent(inout) :: self
      real(wp), intent(in) :: difference(:, :)
      real(wp), allocatable :: now(:, :, :)
      real(wp) :: change
      integer :: i, n_last

      n_last = 0
      if (allocated(self%orders)) n_last = size(self%orders, 3)
      allocate (now(size(difference, 1), size(difference, 2), n_last + 1))
      now(:, :, 1) = difference
      self%n_idle = self%n_idle + 1
      do i = 1, n_last
         associate (share => self%ratio**(2*i), last => self%orders(:, :, i))
            now(:, :, i + 1) = (now(:, :, i) - share*last)/(1.0_wp - share)
            change = max(maxval(abs(now(:, :, i + 1) - now(:, :, i))), maxval(abs(now(:, :, i + 1) - last)))
         end associate
         change = change/max(1.0_wp, maxval(abs(now(:, :, i + 1))))
         if (.not. change < self%estimate) cycle
         self%estimate = change
         self%n_idle = 0
         self%best = now(:, :, i + 1)
      end do
      call move_alloc(now, self%orders)
   end subroutine limit_add

   !> Advances along the motion until sliders are periodic.
   subroutine make_sliders_periodic(self, is_done)
      type(period_map_t), intent(inout) :: self
      logical, intent(out) :: is_done
      real(wp) :: after(size(self%x))
      integer :: i_period, n

      is_done = .true.
      n = 2*self%integration%system%n_dofs
      if (size(self%x) == n) return
      do i_period = 1, periods_of_sliders
         call carry(self, 1, self%x, after, is_done)
         if (.not. is_done) return
         self%x(n + 1:) = after(n + 1:)
      end do
   end subroutine make_sliders_periodic

   !> State after a period, or the mirror image of that after half of one.
   subroutine carry(self, level, x, after, is_done)
      type(period_map_t), intent(inout) :: self
      integer, intent(in) :: level
      real(wp), intent(in) :: x(:)                                    !! scaled
      real(wp), intent(out) :: after(:)                               !! likewise
      logical, intent(out) :: is_done

      self%integration%level = level
      call self%integration%carry(self%start, self%share*self%period, x, after, is_done)
      if (is_done) after = self%sense*after
   end subroutine carry

   !> Derivative of the map by central differences.
   subroutine differentiate(self, level, matrix, is_done)
      type(period_map_t), intent(inout) :: self
      integer, intent(in) :: level
      real(wp), allocatable, intent(out) :: matrix(:, :)
      logical, intent(out) :: is_done
      real(wp) :: axes(size(self%x), size(self%x))
      integer :: k

      allocate (matrix, mold=axes)
      axes = 0.0_wp
      do k = 1, size(axes, 1)
         axes(k, k) = 1.0_wp
      end do
      self%integration%level = level
      call self%integration%differences(self%start, self%share*self%period, self%x, distance_at(level, nearer), axes, matrix, &
         is_done)
      if (is_done) matrix = self%sense*matrix
   end subroutine differentiate

   !> Orthonormal directions without changes of constant coordinates: where friction never slips, each position is as
   !> good as its neighbours, and the motions there remain apart.
   subroutine leave_still(self, matrix)
      type(period_map_t), intent(inout) :: self
      real(wp), intent(in) :: matrix(:, :)
      real(wp), allocatable :: q(:, :), tau(:), work(:)
      integer :: i, info, k, n

      n = size(self%x)
      if (allocated(self%free)) deallocate (self%free)
      allocate (q(n, n), source=0.0_wp)
      k = 0
      do i = 1, size(self%still, 2)
         associate (axis => self%still(:, i))
            if (norm2(matmul(axis, matrix) - self%sense*axis) > neutral) cycle
            k = k + 1
            q(:, k) = axis
         end associate
      end do
      allocate (tau(max(k, 1)), work(64*n))
      if (k > 0) then
         call dgeqrf(n, k, q, n, tau, work, size(work), info)
         call dorgqr(n, n, k, q, n, tau, work, size(work), info)
      else
         do i = 1, n
            q(i, i) = 1.0_wp
         end do
      end if
      self%free = q(:, k + 1:)
   end subroutine leave_still

   !> Moves to the periodic state: Newton's method, reusing each matrix as long as it helps.
   subroutine shoot(self, is_free, is_done)
      type(period_map_t), intent(inout) :: self
      logical, intent(in) :: is_free
      logical, intent(out) :: is_done
      real(wp), dimension(size(self%x)) :: after, begun
      real(wp), allocatable :: matrix(:, :), step(:)
      real(wp) :: before, left
      integer :: level, n_matrices, shot

      level = merge(3, 1, self%integration%has_own_steps) ! accurate, because near a bifurcation the matrix is nearly singular
      begun = self%x
      n_matrices = 0
      before = huge(1.0_wp)
      do shot = 1, max_shots
         call carry(self, 1, self%x, after, is_done)
         if (.not. is_done) return
         left = maxval(abs(after - self%x))
         is_done = left <= repeats .and. (n_matrices > 0 .and. left > slow*before .or. left <= min(enough, self%tolerance))
         if (is_done .and. n_matrices > 0) exit
         if (n_matrices == 0 .or. left > slow*before) then
            is_done = .false.
            if (n_matrices == max_matrices) return
            call differentiate(self, level, matrix, is_done)
            if (.not. is_done) return
            n_matrices = n_matrices + 1
            call leave_still(self, matrix)
            if (n_matrices == 1) self%first = matrix
         end if
         before = left
         call solve_step(self, matrix, after - self%x, is_free, step, is_done)
         if (.not. is_done) return
         self%x = self%x + matmul(self%free, step(:size(self%free, 2)))
         if (is_free) self%period = self%period + step(size(step))
         associate (n => 2*self%integration%system%n_dofs)               ! the motion does not determine states of laws
            is_done = maxval(abs(self%x(:n) - begun(:n))) <= same_motion
         end associate
         if (.not. is_done) return
      end do
      is_done = left <= repeats
   end subroutine shoot

   !> Newton's step: (matrix - 1) step = -left; for an unknown tone with the change of the period appended, and no
   !> component along the motion.
   subroutine solve_step(self, matrix, left, is_free, step, is_done)
      type(period_map_t), intent(in) :: self
      real(wp), intent(in) :: matrix(:, :), left(:)
      logical, intent(in) :: is_free
      real(wp), allocatable, intent(out) :: step(:)
      logical, intent(out) :: is_done
      real(wp), allocatable :: a(:, :)
      integer, allocatable :: pivots(:)
      integer :: i, info, m, n

      m = size(self%free, 2)
      n = m + merge(1, 0, is_free)
      allocate (a(n, n), step(n), pivots(n))
      a(:m, :m) = matmul(transpose(self%free), matmul(matrix, self%free))
      do i = 1, m
         a(i, i) = a(i, i) - 1.0_wp
      end do
      step = 0.0_wp
      step(:m) = -matmul(transpose(self%free), left)
      if (is_free) then
         a(n, :m) = matmul(transpose(self%free), self%rate)
         a(:m, n) = self%share*a(n, :m)
         a(n, n) = 0.0_wp
      end if
      call dgetrf(n, n, a, n, pivots, info)
      is_done = info == 0
      if (is_done) call dgetrs("N", n, 1, a, n, pivots, step, n, info)
   end subroutine solve_step

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
      self%config%tolerance = min(max(finer*tolerance, max_accurate), min_accurate)
      self%config%restitution = restitution
      self%config%decimation = huge(1)
      extent = sum(abs(motion%amplitudes), dim=2)
      speed = matmul(abs(motion%amplitudes), abs(motion%frequencies))
      if (maxval(extent) <= 0.0_wp) extent = maxval([abs(self%rigid%gap), 0.0_wp])
      if (maxval(extent) <= 0.0_wp) extent = 1.0_wp                   ! at rest, at no distance from anything
      extent = max(extent, minor*maxval(extent))
      speed = max(speed, minor*maxval(speed), at_rest*maxval(extent)*maxval(abs(motion%omega)))
      allocate (self%scale(2*n + system%laws%n_states))
      self%scale(:2*n) = [extent, speed]
      do i = 1, size(system%laws%spans)
         associate (span => system%laws%spans(i))
            do k = span%first_state, span%last_state
               self%scale(2*n + k) = max(maxval(matmul(transpose(abs(system%laws%shape(:, span%first:span%last))), extent)), &
                                         minor*maxval(extent))
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
   subroutine state_map_carry(self, start, duration, x, after, is_done)
      class(state_map_t), intent(inout) :: self
      real(wp), intent(in) :: start, duration                         !! [s]
      real(wp), intent(in) :: x(:)                                    !! scaled
      real(wp), intent(out) :: after(:)                               !! likewise
      logical, intent(out) :: is_done
      type(integration_record_t) :: record
      integer, parameter :: nothing(0) = 0

      after = x
      call self%record_from(start, duration, n_steps_of(self, self%level), nothing, after, record, is_done)
   end subroutine state_map_carry

   !> As `carry`, with a record of some displacements.
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
         call self%carry(start, duration, x + distance*directions(:, k), above, is_done)
         if (is_done) call self%carry(start, duration, x - distance*directions(:, k), below, is_done)
         if (.not. is_done) return
         changes(:, k) = (above - below)/(2.0_wp*distance)
      end do
   end subroutine state_map_differences

   !> Limits the work of the following time integrations.
   subroutine state_map_allow(self, work)
      class(state_map_t), intent(inout) :: self
      real(wp), intent(in) :: work                                    !! in about a nanosecond

      self%config%max_evaluations = self%system%laws%n_evaluations + &
         int(min(work/evaluation_work(self%system%n_dofs, self%system%laws%n_coordinates, .false.), 1.0e18_wp), int64)
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
end module hb_period_map
