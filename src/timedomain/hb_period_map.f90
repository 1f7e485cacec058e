!> The period map by time integration, for motions with events that have no linearised equations: impacts, rigid
!> friction that sticks and slips, sliders in a plane.
!>
!> Newton's method finds the periodic state from that of the motion (shooting); the derivative of the map there is the
!> monodromy matrix, from central differences over decreasing distances (and steps, for a method with fixed steps),
!> extrapolated. The change with the next distance is the estimate; it remains large if the map has a kink or a jump,
!> as at a grazing impact. Source: A. H. Nayfeh and B. Balachandran, Applied Nonlinear Dynamics, Wiley 1995, sections
!> 6.5 and 7.1.
module hb_period_map
   use hb_difference_limit, only: distance_at, limit_t, ratio_of_distances
   use hb_error, only: error_t
   use hb_integration_system, only: integration_system_t
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: dgeqrf, dgetrf, dgetrs, dorgqr
   use hb_motion_series, only: motion_series_t
   use hb_state_map, only: farthest_phase, new_state_map, state_map_t
   use hb_thresholds, only: max_distance_of_same
   implicit none
   private
   public :: find_period_map, find_periodic_state, new_period_map, period_map_t, work_of_period_map

   integer, parameter :: max_levels = 4                               ! distances
   real(wp), parameter :: max_defect = 1.0e-7_wp ! permitted defect of a state after a period, scaled
   real(wp), parameter :: converged_defect = 1.0e-9_wp ! defect that needs no further step, likewise
   integer, parameter :: max_shots = 30
   integer, parameter :: max_matrices = 4                            ! before convergence
   real(wp), parameter :: slow_ratio = 0.3_wp ! ratio of two residuals above which a new matrix is needed
   real(wp), parameter :: neutral_change = 1.0e-2_wp ! change of what stays as it is: a push apart slips a little
   integer, parameter :: periods_of_sliders = 3                       ! after which they are periodic
   real(wp), parameter :: usual_shots = 6.0_wp
   integer, parameter :: n_starts = 8 ! phases from which a period is tried

   type :: period_map_t
      real(wp), allocatable :: matrix(:, :)                           !! monodromy of the part that is not always held, scaled
      real(wp), allocatable :: at_motion(:, :)                            !! that at the state of the given motion
      real(wp), allocatable :: shift(:)                               !! of the phase of an unknown tone, as the matrix
      real(wp) :: estimate = huge(1.0_wp)                             !! of the error of the matrix, relative to its largest entry
      logical :: is_found = .false.
      real(wp), private :: tolerance = 0.0_wp
      real(wp), private :: share = 1.0_wp                             ! of the period that is integrated: half for an odd motion,
      real(wp), private :: mirror = 1.0_wp                             ! which is then mirrored, -1
      real(wp), private :: start = 0.0_wp, period = 0.0_wp            ! [s]
      real(wp), allocatable, private :: x(:)                          ! state, scaled
      real(wp), allocatable, private :: rate(:)                       ! of the motion at the start [1/s], scaled
      real(wp), allocatable, private :: held(:, :) ! coordinates that are constant while friction holds, (size, any)
      real(wp), allocatable, private :: moving(:, :)                    ! orthonormal, of all states with these coordinates constant
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
      call list_held(self)
      if (is_odd(system, motion)) then
         self%share = 0.5_wp
         self%mirror = -1.0_wp
      end if
   end subroutine new_period_map

   !> Whether a motion has only odd harmonics, and laws that permit this.
   pure logical function is_odd(system, motion)
      type(integration_system_t), intent(in) :: system
      type(motion_series_t), intent(in) :: motion
      real(wp), parameter :: negligible_even_part = 1.0e-9_wp         ! relative
      logical :: is_even(size(motion%frequencies))
      integer :: i, k

      is_even = modulo(motion%tuples(1, :), 2) == 0
      is_odd = all([(system%laws%laws(i)%law%is_odd, i=1, size(system%laws%laws))])
      do k = 1, motion%n_coordinates
         is_odd = is_odd .and. sum(abs(motion%amplitudes(k, :)), mask=is_even) <= negligible_even_part*sum(abs(motion%amplitudes))
      end do
   end function is_odd

   !> Coordinates that may be constant: those held by rigid friction, and sliders.
   subroutine list_held(self)
      type(period_map_t), intent(inout) :: self
      integer :: i, k, n

      associate (system => self%integration%system, rigid => self%integration%rigid, scale => self%integration%scale)
         n = system%n_dofs
         allocate (self%held(size(self%x), count(.not. rigid%is_wall) + system%laws%n_states), source=0.0_wp)
         k = 0
         do i = 1, size(rigid)
            if (rigid(i)%is_wall) cycle
            k = k + 1
            self%held(:n, k) = system%laws%shape(:, rigid(i)%coordinate)*scale(:n)
            self%held(:, k) = self%held(:, k)/norm2(self%held(:, k))
         end do
         do i = 1, system%laws%n_states
            self%held(2*n + i, k + i) = 1.0_wp
         end do
      end associate
   end subroutine list_held

   !> Approximate work in nanoseconds, from counts alone.
   pure real(wp) function work_of_period_map(self) result(work)
      type(period_map_t), intent(in) :: self

      work = self%share*(8.0_wp*size(self%x) + usual_shots)*self%integration%work_of(2)
   end function work_of_period_map

   !> Finds the periodic state and the matrix there; `is_found` states whether it is close to the motion.
   subroutine find_period_map(self, is_free, max_work)
      type(period_map_t), intent(inout) :: self
      logical, intent(in) :: is_free                                  !! the tone is unknown
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      type(limit_t) :: limit
      real(wp), allocatable :: there(:, :)
      integer :: level
      logical :: is_done

      call self%integration%allow(max_work)
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
      call leave_out_held(self, limit%best)
      self%matrix = matmul(transpose(self%moving), matmul(limit%best, self%moving))
      self%at_motion = matmul(transpose(self%moving), matmul(self%at_motion, self%moving))
      if (self%mirror < 0.0_wp) then                                   ! twice half a period
         self%matrix = matmul(self%matrix, self%matrix)
         self%at_motion = matmul(self%at_motion, self%at_motion)
      end if
      self%shift = matmul(transpose(self%moving), matmul(limit%best, self%rate))
      self%is_found = .true.
   end subroutine find_period_map

   !> Finds the periodic state alone, at the start of a period of the motion; `is_found` as of `find_period_map`.
   subroutine find_periodic_state(self, max_work, x, is_found)
      type(period_map_t), intent(inout) :: self
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      real(wp), allocatable, intent(out) :: x(:)                      !! displacements, velocities, states of laws [m], [m/s]
      logical, intent(out) :: is_found

      allocate (x, mold=self%x)
      call self%integration%allow(max_work)
      call choose_start(self)
      call make_sliders_periodic(self, is_found)
      if (is_found) call shoot(self, .false., is_found)
      if (is_found) call self%integration%advance(self%start, self%period - self%start, self%x, x, is_found)
      if (is_found) x = x*self%integration%scale
   end subroutine find_periodic_state

   !> Starts at the phase from which a period ends nearest to its start.
   subroutine choose_start(self)
      type(period_map_t), intent(inout) :: self
      real(wp), dimension(size(self%x)) :: after, before
      real(wp) :: least, left, start
      integer :: i
      logical :: is_done

      least = huge(1.0_wp)
      start = self%start
      do i = 0, n_starts - 1
         self%start = i*self%period/n_starts
         before = self%integration%state_at(self%start)
         call map_over_period(self, 1, before, after, is_done)
         if (.not. is_done) cycle
         associate (n => 2*self%integration%system%n_dofs)
            left = maxval(abs(after(:n) - before(:n)))
         end associate
         if (left >= least) cycle
         least = left
         start = self%start
      end do
      self%start = start
      self%x = self%integration%state_at(start)
      self%rate = self%integration%rate_at(start)
   end subroutine choose_start

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
         call map_over_period(self, 1, self%x, after, is_done)
         if (.not. is_done) return
         self%x(n + 1:) = after(n + 1:)
      end do
   end subroutine make_sliders_periodic

   !> State after a period, or the mirror image of that after half of one.
   subroutine map_over_period(self, level, x, after, is_done)
      type(period_map_t), intent(inout) :: self
      integer, intent(in) :: level
      real(wp), intent(in) :: x(:)                                    !! scaled
      real(wp), intent(out) :: after(:)                               !! likewise
      logical, intent(out) :: is_done

      self%integration%level = level
      call self%integration%advance(self%start, self%share*self%period, x, after, is_done)
      if (is_done) after = self%mirror*after
   end subroutine map_over_period

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
      call self%integration%differences(self%start, self%share*self%period, self%x, &
                                        distance_at(level, ratio_of_distances), axes, matrix, is_done)
      if (is_done) matrix = self%mirror*matrix
   end subroutine differentiate

   !> Orthonormal directions without changes of constant coordinates: where friction never slips, each position is as
   !> good as its neighbours, and the motions there remain apart.
   subroutine leave_out_held(self, matrix)
      type(period_map_t), intent(inout) :: self
      real(wp), intent(in) :: matrix(:, :)
      real(wp), allocatable :: q(:, :), tau(:), work(:)
      integer :: i, info, k, n

      n = size(self%x)
      if (allocated(self%moving)) deallocate (self%moving)
      allocate (q(n, n), source=0.0_wp)
      k = 0
      do i = 1, size(self%held, 2)
         associate (axis => self%held(:, i))
            if (norm2(matmul(axis, matrix) - self%mirror*axis) > neutral_change) cycle
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
      self%moving = q(:, k + 1:)
   end subroutine leave_out_held

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
         call map_over_period(self, 1, self%x, after, is_done)
         if (.not. is_done) return
         left = maxval(abs(after - self%x))
         is_done = left <= max_defect .and. (n_matrices > 0 .and. left > slow_ratio*before .or. &
                                                 left <= min(converged_defect, self%tolerance))
         if (is_done .and. n_matrices > 0) exit
         if (n_matrices == 0 .or. left > slow_ratio*before) then
            is_done = .false.
            if (n_matrices == max_matrices) return
            call differentiate(self, level, matrix, is_done)
            if (.not. is_done) return
            n_matrices = n_matrices + 1
            call leave_out_held(self, matrix)
            if (n_matrices == 1) self%at_motion = matrix
         end if
         before = left
         call solve_step(self, matrix, after - self%x, is_free, step, is_done)
         if (.not. is_done) return
         self%x = self%x + matmul(self%moving, step(:size(self%moving, 2)))
         if (is_free) self%period = self%period + step(size(step))
         associate (n => 2*self%integration%system%n_dofs)               ! the motion does not determine states of laws
            is_done = maxval(abs(self%x(:n) - begun(:n))) <= max_distance_of_same
         end associate
         if (.not. is_done) return
      end do
      is_done = left <= max_defect
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

      m = size(self%moving, 2)
      n = m + merge(1, 0, is_free)
      allocate (a(n, n), step(n), pivots(n))
      a(:m, :m) = matmul(transpose(self%moving), matmul(matrix, self%moving))
      do i = 1, m
         a(i, i) = a(i, i) - 1.0_wp
      end do
      step = 0.0_wp
      step(:m) = -matmul(transpose(self%moving), left)
      if (is_free) then
         a(n, :m) = matmul(transpose(self%moving), self%rate)
         a(:m, n) = self%share*a(n, :m)
         a(n, n) = 0.0_wp
      end if
      call dgetrf(n, n, a, n, pivots, info)
      is_done = info == 0
      if (is_done) call dgetrs("N", n, 1, a, n, pivots, step, n, info)
   end subroutine solve_step
end module hb_period_map
