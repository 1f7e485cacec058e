!> What a period of marching makes of a state, where the motion leads through events that have no linearised equations: blows,
!> rigid friction that holds and lets go, sliders in a plane.
!>
!> The state that repeats is found by Newton's method from that of the motion (shooting); the derivative of the map there is its
!> monodromy matrix, from central differences over distances that shrink (and steps, of a method that has them), extrapolated. What
!> the next distance changes is the estimate; where the map has a kink or a jump, as at a grazing blow, it stays large. Source:
!> A. H. Nayfeh and B. Balachandran, Applied Nonlinear Dynamics, Wiley 1995, sections 6.5 and 7.1.
module hb_period_map
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: int64, two_pi, wp
   use hb_lapack, only: dgeqrf, dgetrf, dgetrs, dorgqr
   use hb_law, only: hold_t
   use hb_march, only: march_from, march_record_t
   use hb_march_config, only: march_config_t, march_method
   use hb_march_state, only: march_state_t, new_march_state
   use hb_march_system, only: march_system_t
   use hb_motion_series, only: motion_series_t
   use hb_rigid_laws, only: collect_rigid
   implicit none
   private
   public :: find_period_map, new_period_map, period_map_t, work_of_period_map

   real(wp), parameter :: farthest = 5.0e-3_wp                        ! of two states whose difference makes a derivative, scaled
   real(wp), parameter :: nearer = 0.2_wp                             ! from one distance to the next
   integer, parameter :: most_levels = 4                              ! distances
   real(wp), parameter :: most_accurate = 1.0e-13_wp                  ! tolerance of marching with variable steps
   real(wp), parameter :: least_accurate = 1.0e-11_wp
   real(wp), parameter :: finer = 1.0e-4_wp                           ! that of marching relative to that of the matrix
   integer, parameter :: fewest_steps = 1000                          ! of marching with fixed ones, in a period
   integer, parameter :: steps_a_radian = 20                          ! of the fastest motion, likewise
   real(wp), parameter :: smallest_scale = 0.1_wp                     ! of one unknown, relative to the largest of its kind: what
                                                                      ! is moved apart has to slip, not to creep
   real(wp), parameter :: same_motion = 0.1_wp                        ! largest change of the state by shooting, scaled
   real(wp), parameter :: repeats = 1.0e-7_wp                         ! what may be left of a state after a period, scaled
   real(wp), parameter :: enough = 1.0e-9_wp                          ! what no step is made for, likewise
   integer, parameter :: most_shots = 30
   integer, parameter :: most_matrices = 4                            ! on the way
   real(wp), parameter :: slow = 0.3_wp                               ! fall of what is left that asks for a new matrix
   real(wp), parameter :: neutral = 1.0e-2_wp                         ! change of what stays as it is: a push apart slips a little
   integer, parameter :: laps_of_sliders = 3                          ! in which they find their places
   integer, parameter :: n_looks = 256                                ! for the phase that is farthest from events
   real(wp), parameter :: usual_looks = 1500.0_wp                     ! at the motion in a period, with variable steps
   real(wp), parameter :: usual_shots = 6.0_wp

   type :: period_map_t
      real(wp), allocatable :: matrix(:, :)                           !! monodromy of what does not stay for ever, scaled
      real(wp), allocatable :: first(:, :)                            !! that at the state of the motion as it was given
      real(wp), allocatable :: shift(:)                               !! of the phase of a tone of its own, as the matrix
      real(wp) :: estimate = huge(1.0_wp)                             !! of the error of the matrix, relative to its largest entry
      logical :: is_found = .false.
      real(wp), private :: tolerance = 0.0_wp
      real(wp), private :: share = 1.0_wp                             ! of the period that is marched: a half of an odd motion,
      real(wp), private :: sense = 1.0_wp                             ! which is mirrored then, -1
      real(wp), private :: start = 0.0_wp, period = 0.0_wp            ! [s]
      real(wp), allocatable, private :: scale(:)                      ! of (q, v, states), > 0
      real(wp), allocatable, private :: x(:)                          ! state, scaled
      real(wp), allocatable, private :: rate(:)                       ! of the motion at the start [1/s], scaled
      real(wp), allocatable, private :: still(:, :)                   ! places that stay while friction holds, (size, any)
      real(wp), allocatable, private :: free(:, :)                    ! orthonormal, of all states at which they stay
      type(march_config_t), private :: config
   end type period_map_t

contains

   !> Takes the state of a motion at the phase that is farthest from its events. Fails for laws that no method can follow.
   subroutine new_period_map(self, system, motion, restitution, tolerance, error)
      type(period_map_t), intent(out) :: self
      type(march_system_t), intent(inout) :: system                   !! of all degrees of freedom
      type(motion_series_t), intent(in) :: motion                     !! of all degrees of freedom, one tone
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: tolerance                               !! of the matrix, relative
      type(error_t), allocatable, intent(out) :: error
      type(hold_t), allocatable :: rigid(:)
      real(wp) :: reach(motion%n_coordinates), speed(motion%n_coordinates)
      real(wp) :: v(1, motion%n_coordinates), z(1, motion%n_coordinates)
      integer :: i, k, n

      call collect_rigid(system%laws, rigid, error)
      if (allocated(error)) return
      n = system%n_dofs
      self%period = two_pi/motion%omega(1)
      self%config%method = march_method%cvode
      do i = 1, size(system%laws%laws)
         select type (law => system%laws%laws(i)%law)
         class is (hysteretic_law_t)
            if (.not. law%has_bounds) self%config%method = march_method%runge_kutta_4
         end select
      end do
      self%tolerance = tolerance
      self%config%tolerance = min(max(finer*tolerance, most_accurate), least_accurate)
      self%config%restitution = restitution
      self%config%decimation = huge(1)
      reach = sum(abs(motion%amplitudes), dim=2)
      speed = matmul(abs(motion%amplitudes), abs(motion%frequencies))
      reach = max(reach, smallest_scale*maxval(reach), tiny(1.0_wp))
      speed = max(speed, smallest_scale*maxval(speed), tiny(1.0_wp))
      allocate (self%scale(2*n + system%laws%n_states))
      self%scale(:2*n) = [reach, speed]
      do i = 1, size(system%laws%places)
         associate (place => system%laws%places(i))
            do k = place%first_state, place%last_state
               self%scale(2*n + k) = max(maxval(matmul(transpose(abs(system%laws%shape(:, place%first:place%last))), reach)), &
                                         smallest_scale*maxval(reach))
            end do
         end associate
      end do
      self%config%largest = 1.0e4_wp*maxval(reach)
      self%start = farthest_phase(system, rigid, motion)/motion%omega(1)
      call motion%at(motion%phases([self%start]), z, v)
      allocate (self%x(size(self%scale)), self%rate(size(self%scale)), source=0.0_wp)
      self%x(:2*n) = [z(1, :), v(1, :)]/self%scale(:2*n)
      self%rate(:n) = v(1, :)/self%scale(:n)
      self%rate(n + 1:2*n) = acceleration(motion, self%start)/self%scale(n + 1:2*n)
      call list_still(self, system, rigid)
      if (is_odd(system, motion)) then
         self%share = 0.5_wp
         self%sense = -1.0_wp
      end if
   end subroutine new_period_map

   !> Whether a motion has odd harmonics alone, and laws that let it.
   pure logical function is_odd(system, motion)
      type(march_system_t), intent(in) :: system
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

   !> Places that may stay for ever: of coordinates that rigid friction holds, and of sliders.
   subroutine list_still(self, system, rigid)
      type(period_map_t), intent(inout) :: self
      type(march_system_t), intent(in) :: system
      type(hold_t), intent(in) :: rigid(:)
      integer :: i, k, n

      n = system%n_dofs
      allocate (self%still(size(self%x), count(.not. rigid%is_wall) + system%laws%n_states), source=0.0_wp)
      k = 0
      do i = 1, size(rigid)
         if (rigid(i)%is_wall) cycle
         k = k + 1
         self%still(:n, k) = system%laws%shape(:, rigid(i)%coordinate)*self%scale(:n)
         self%still(:, k) = self%still(:, k)/norm2(self%still(:, k))
      end do
      do i = 1, system%laws%n_states
         self%still(2*n + i, k + i) = 1.0_wp
      end do
   end subroutine list_still

   !> Phase [rad] at which open walls are far and friction slips fast, as far as it can be had for all at once.
   function farthest_phase(system, rigid, motion) result(phase)
      type(march_system_t), intent(in) :: system
      type(hold_t), intent(in) :: rigid(:)
      type(motion_series_t), intent(in) :: motion
      real(wp) :: phase
      real(wp) :: far(n_looks, size(rigid)), phases(1, n_looks)
      real(wp) :: v(n_looks, motion%n_coordinates), z(n_looks, motion%n_coordinates)
      integer :: i

      phase = 0.0_wp
      if (size(rigid) == 0) return
      phases(1, :) = [(two_pi*i/n_looks, i=0, n_looks - 1)]
      call motion%at(phases, z, v)
      do i = 1, size(rigid)
         associate (shape => system%laws%shape(:, rigid(i)%coordinate))
            if (.not. rigid(i)%is_wall) then
               far(:, i) = abs(matmul(v, shape))
            else if (rigid(i)%two_sided) then
               far(:, i) = max(rigid(i)%gap - abs(matmul(z, shape)), 0.0_wp)
            else
               far(:, i) = max(rigid(i)%gap - matmul(z, shape), 0.0_wp)
            end if
         end associate
         far(:, i) = far(:, i)/max(maxval(far(:, i)), tiny(1.0_wp))
      end do
      phase = phases(1, maxloc(minval(far, dim=2), dim=1))
   end function farthest_phase

   pure function acceleration(motion, time) result(a)
      type(motion_series_t), intent(in) :: motion
      real(wp), intent(in) :: time                                    !! [s]
      real(wp) :: a(motion%n_coordinates)

      associate (w => motion%frequencies)
         a = -real(matmul(motion%amplitudes, w**2*exp(cmplx(0.0_wp, w*time, wp))), wp)
      end associate
   end function acceleration

   !> About how many nanoseconds it takes, from counts alone.
   pure real(wp) function work_of_period_map(self, system) result(work)
      type(period_map_t), intent(in) :: self
      type(march_system_t), intent(in) :: system
      real(wp) :: looks

      looks = usual_looks
      if (self%config%method == march_method%runge_kutta_4) looks = 4.0_wp*n_steps_of(self, system, 2)
      work = (8.0_wp*size(self%x) + usual_shots)*looks*work_of_look(system)
   end function work_of_period_map

   pure real(wp) function work_of_look(system) result(work)
      type(march_system_t), intent(in) :: system

      work = 600.0_wp + 6.0_wp*real(system%n_dofs, wp)**2 + 60.0_wp*system%laws%n_coordinates
   end function work_of_look

   !> Steps of a period at a level; one where the method chooses its own.
   pure integer function n_steps_of(self, system, level) result(n_steps)
      type(period_map_t), intent(in) :: self
      type(march_system_t), intent(in) :: system
      integer, intent(in) :: level
      real(wp) :: fastest
      integer :: i

      n_steps = 1
      if (self%config%method == march_method%cvode) return
      fastest = 0.0_wp
      do i = 1, system%n_dofs
         fastest = max(fastest, sqrt(abs(system%structure%stiffness(i, i)/system%structure%mass(i, i))))
      end do
      n_steps = max(fewest_steps, ceiling(min(steps_a_radian*fastest*self%period, 1.0e6_wp)))*2**(level - 1)
   end function n_steps_of

   !> Finds the state that repeats and the matrix there; `is_found` tells whether there is one close to the motion.
   subroutine find_period_map(self, system, is_free, work_limit)
      type(period_map_t), intent(inout) :: self
      type(march_system_t), intent(inout), target :: system
      logical, intent(in) :: is_free                                  !! the tone is the motion's own
      real(wp), intent(in) :: work_limit                              !! in about a nanosecond
      real(wp), allocatable :: before(:, :), best(:, :), here(:, :), now(:, :), there(:, :)
      real(wp) :: estimate
      integer :: level
      logical :: is_done

      self%config%most_looks = system%laws%n_gathered + int(min(work_limit/work_of_look(system), 1.0e18_wp), int64)
      call settle_sliders(self, system, is_done)
      if (is_done) call shoot(self, system, is_free, is_done)
      if (.not. is_done) return
      call differentiate(self, system, 1, here, is_done)
      do level = 2, most_levels
         if (.not. is_done) return
         call differentiate(self, system, level, there, is_done)
         if (.not. is_done) return
         now = there + (there - here)*(nearer**2/(1.0_wp - nearer**2))
         call move_alloc(there, here)
         if (allocated(before)) then
            estimate = maxval(abs(now - before))/max(1.0_wp, maxval(abs(now)))
            if (estimate < self%estimate) then
               self%estimate = estimate
               best = now
            end if
            if (self%estimate <= self%tolerance) exit
         end if
         call move_alloc(now, before)
      end do
      if (.not. allocated(best)) return
      call leave_still(self, best)
      self%matrix = matmul(transpose(self%free), matmul(best, self%free))
      self%first = matmul(transpose(self%free), matmul(self%first, self%free))
      if (self%sense < 0.0_wp) then                                   ! twice half a period
         self%matrix = matmul(self%matrix, self%matrix)
         self%first = matmul(self%first, self%first)
      end if
      self%shift = matmul(transpose(self%free), matmul(best, self%rate))
      self%is_found = .true.
   end subroutine find_period_map

   !> Lets sliders find their places along the motion.
   subroutine settle_sliders(self, system, is_done)
      type(period_map_t), intent(inout) :: self
      type(march_system_t), intent(inout), target :: system
      logical, intent(out) :: is_done
      real(wp) :: after(size(self%x))
      integer :: lap

      is_done = .true.
      if (system%laws%n_states == 0) return
      do lap = 1, laps_of_sliders
         call carry(self, system, 1, self%x, after, is_done)
         if (.not. is_done) return
         self%x(2*system%n_dofs + 1:) = after(2*system%n_dofs + 1:)
      end do
   end subroutine settle_sliders

   !> A state after a period, or the mirror image of that after half of one.
   subroutine carry(self, system, level, x, after, is_done)
      type(period_map_t), intent(inout) :: self
      type(march_system_t), intent(inout), target :: system
      integer, intent(in) :: level
      real(wp), intent(in) :: x(:)                                    !! scaled
      real(wp), intent(out) :: after(:)                               !! likewise
      logical, intent(out) :: is_done
      type(march_record_t) :: record
      type(march_state_t) :: state
      type(error_t), allocatable :: error
      integer, parameter :: nothing(0) = 0

      associate (n => system%n_dofs, y => x*self%scale)
         call new_march_state(state, n, system%laws%n_states)
         state%time = self%start
         state%q = y(:n)
         state%v = y(n + 1:2*n)
         state%s = y(2*n + 1:)
      end associate
      self%config%duration = self%share*self%period
      call march_from(system, self%config, self%config%duration/n_steps_of(self, system, level), nothing, state, record, error)
      is_done = .not. allocated(error)
      if (is_done) after = self%sense*[state%q, state%v, state%s]/self%scale
      if (is_done) is_done = all(ieee_is_finite(after))
   end subroutine carry

   !> Derivative of the map by central differences.
   subroutine differentiate(self, system, level, matrix, is_done)
      type(period_map_t), intent(inout) :: self
      type(march_system_t), intent(inout), target :: system
      integer, intent(in) :: level
      real(wp), allocatable, intent(out) :: matrix(:, :)
      logical, intent(out) :: is_done
      real(wp), dimension(size(self%x)) :: above, below, x
      real(wp) :: distance
      integer :: k

      allocate (matrix(size(x), size(x)))
      distance = farthest*nearer**(level - 1)
      do k = 1, size(x)
         x = self%x
         x(k) = self%x(k) + distance
         call carry(self, system, level, x, above, is_done)
         if (.not. is_done) return
         x(k) = self%x(k) - distance
         call carry(self, system, level, x, below, is_done)
         if (.not. is_done) return
         matrix(:, k) = (above - below)/(2.0_wp*distance)
      end do
   end subroutine differentiate

   !> Orthonormal directions in which nothing is changed that stays for ever: where friction never lets go, each place is as good
   !> as its neighbours, and the motions there stay apart.
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
         associate (place => self%still(:, i))
            if (norm2(matmul(place, matrix) - self%sense*place) > neutral) cycle
            k = k + 1
            q(:, k) = place
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

   !> Goes to the state that repeats: Newton's method, each matrix used as long as it helps.
   subroutine shoot(self, system, is_free, is_done)
      type(period_map_t), intent(inout) :: self
      type(march_system_t), intent(inout), target :: system
      logical, intent(in) :: is_free
      logical, intent(out) :: is_done
      real(wp), dimension(size(self%x)) :: after, begun
      real(wp), allocatable :: matrix(:, :), step(:)
      real(wp) :: before, left
      integer :: level, n_matrices, shot

      level = merge(3, 1, self%config%method == march_method%cvode)   ! accurate, as near a bifurcation little is left of the matrix
      begun = self%x
      n_matrices = 0
      before = huge(1.0_wp)
      do shot = 1, most_shots
         call carry(self, system, 1, self%x, after, is_done)
         if (.not. is_done) return
         left = maxval(abs(after - self%x))
         is_done = left <= repeats .and. (n_matrices > 0 .and. left > slow*before .or. left <= min(enough, self%tolerance))
         if (is_done .and. n_matrices > 0) exit
         if (n_matrices == 0 .or. left > slow*before) then
            is_done = .false.
            if (n_matrices == most_matrices) return
            call differentiate(self, system, level, matrix, is_done)
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
         is_done = maxval(abs(self%x - begun)) <= same_motion
         if (.not. is_done) return
      end do
      is_done = left <= repeats
   end subroutine shoot

   !> Newton's step: (matrix - 1) step = -left; of a motion with a tone of its own with the change of the period behind it, and
   !> nothing along the motion.
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
end module hb_period_map
