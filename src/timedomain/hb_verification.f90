!> Verification of a motion by time integration that starts on it.
!>
!> One integration starts on the motion at time zero, a second one very close to it. The verdict is that of
!> hb_integration_verdict: they diverge if the motion is unstable; otherwise they converge as the transient decays,
!> and the remaining difference of integration and motion is the error of the motion. Frequencies of unknown tones may
!> drift (hb_integration_difference): if the drift exceeds the estimated errors of the frequencies, the motion is
!> wrong. The integration lasts until this is decided, at most as long as the decay of the linear structure takes,
!> within a limit of work. Methods with fixed steps have errors of their own: a motion that differs is integrated again with
!> steps of half the length, and what the difference falls by is the least limit.
!>
!> The start has the error of the series. If disturbances of this size diverge from a periodic motion that is stable, the
!> integration leaves the series though both its values and its stability are right. Therefore, before a motion that is not
!> called unstable is contradicted, the periodic motion next to it is found by shooting, and the integration starts there.
module hb_verification
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_beat, only: slowest_beat
   use hb_cancellation, only: cancellation_t
   use hb_claim, only: claim_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t, fail
   use hb_integrable_system, only: fastest_of, fixed_step_method_of, has_bounds_of, is_stiff, lacks_mass
   use hb_integrated_motion, only: find_steady_motion
   use hb_integration_config, only: integration_config_t, integration_method, step_of
   use hb_integration_difference, only: integration_difference_t, motion, new_integration_difference, series_t
   use hb_integration_system, only: has_sparse_steps, integration_state_t, integration_system_t, new_integration_state, &
      new_integration_system
   use hb_integration_verdict, only: certain_growth, decide, growth_of, limit_of, min_growth, n_steady, verdict, verdict_t
   use hb_kinds, only: two_pi, wp
   use hb_model, only: model_t
   use hb_modes, only: has_free_motion, slowest_decay
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_options, only: options_t
   use hb_outcome, only: outcome
   use hb_period_map, only: find_periodic_state, new_period_map, period_map_t, work_of_period_map
   use hb_steady_motion, only: steady_motion_t
   use hb_structure, only: max_dense, max_dofs, max_sparse_dofs, structure_t
   use hb_system, only: system_t
   use hb_text, only: to_text
   use hb_time_stepping, only: integrate_from, integration_record_t
   implicit none
   private
   public :: verify_motion

   integer, parameter :: periods_of_sliders = 20                      ! of the motion, until sliders are periodic
   integer, parameter :: min_periods = 20 ! of the slowest tone; with several tones twice that, and two beats
   integer, parameter :: min_bound = 100, greatest_bound = 1000     ! periods at which a time integration ends without a
                                                                      !! decision, at first and finally
   integer, parameter :: longest_decay = 1000000                      ! periods; a slower decay counts as none
   integer, parameter :: usual_bound = 150                            ! if nothing in the structure decays
   integer, parameter :: max_samples = 400000                        ! of one time integration, beyond the fewest periods
   integer, parameter :: periods_at_once = 5
   real(wp), parameter :: enough_decay = 8.0_wp                       ! of the slowest mode, as a logarithm: the bound
   real(wp), parameter :: max_decay = 3.0_wp                         ! likewise: the start has no influence any more
   real(wp), parameter :: integration_tolerance = 1.0e-13_wp ! of the time integration, unless the input requests a smaller one
   real(wp), parameter :: min_distance_fall = 10.0_wp ! fall of the distance below which the start still has influence
   real(wp), parameter :: start_distance = 1.0e-6_wp ! of the second time integration at its start, relative to the motion
   real(wp), parameter :: too_far = 1.0e-4_wp, too_near = 1.0e-10_wp  ! distances at which it is reset
   real(wp), parameter :: runaway_ratio = 1.0e4_wp                    ! displacement relative to the motion
   integer, parameter :: finer_steps = 8                              ! of central differences, of first order under rigid laws
   integer, parameter :: min_steps = 1000                          ! of fixed steps in a period of the slowest tone, and in
   real(wp), parameter :: step_of_mode = 0.1_wp                       ! radians of the fastest mode: errors of 1e-6 in a period
   real(wp), parameter :: halving_ratio = 1.5_wp ! ratio of differences by a step and its half, if they are errors of the steps
   real(wp), parameter :: shooting_tolerance = 1.0e-7_wp ! of the matrix with which the periodic motion is found
   integer, parameter :: max_matrices = 20                           ! work of shooting, in that of one matrix
   integer, parameter :: max_shooting_dofs = 50
   real(wp), parameter :: implicit_steps = 4000.0_wp                  ! in a period of the fastest tone: errors of 1e-6
   real(wp), parameter :: error_of_implicit_steps = 1.0e-6_wp
   real(wp), parameter :: share_of_steps = 0.01_wp                    ! of such steps in the limit, on sparse matrices
   real(wp), parameter :: max_seconds = 1800.0_wp                     ! of a verification on sparse matrices, by its estimate
   real(wp), parameter :: max_record = 2.0_wp**28                     ! bytes of a record on sparse matrices

   !> Length of a time integration, in periods of the slowest tone.
   type :: length_t
      real(wp) :: period = 0.0_wp                                     !! [s]
      integer :: n_samples = 0                                        !! in a period
      integer :: fewest = 0, bound = 0                                !! periods
      integer :: most = 0                                             !! to which the bound is raised without a decision
      integer :: longest = 0                                          !! that all limits permit
      real(wp) :: beats = 0.0_wp                                      !! that two of the slowest beats last
      integer :: decay = 0 !! in which the transient of the linear structure decays; 0: it does not
      logical :: is_free = .false.                                    !! the linear structure does not hold some body
   end type length_t

   !> Both integrations, and their results so far.
   type :: pair_t
      type(integration_system_t) :: system
      type(integration_config_t) :: config
      type(integration_state_t) :: state, other                       !! of the one on the motion, and of the neighbouring one
      type(integration_record_t) :: record
      type(length_t) :: length
      type(integration_difference_t) :: difference
      real(wp), allocatable :: scale(:), speed(:)                     !! [m], [m/s], (n_dofs)
      real(wp), allocatable :: distance(:)                            !! logarithm, after each group of periods
      real(wp), allocatable :: ratio(:)                               !! of difference to limit, in each period
      real(wp) :: estimate, share                                    !! of the motion, relative; factor for velocities
      real(wp) :: expected                                            !! difference in the last periods
      real(wp) :: moved_back = 0.0_wp                                 !! logarithm of the total factor of all resets
      logical :: is_ending = .false.                                  !! one of them fails: period by period up to there
      logical :: may_recover = .false.                                !! disturbances that grow may decay later: it is not called
                                                                      !! unstable
   end type pair_t

   !> Reports the progress of the integrations of a verification as a share of all of its periods, as planned so far.
   type, extends(cancellation_t) :: periods_t
      real(wp) :: n_done = 0.0_wp                                     ! before the integration in progress
      real(wp) :: n_new = 0.0_wp                                      ! in it
      real(wp) :: n_planned = 1.0_wp
   contains
      procedure :: note_progress => periods_note_progress
   end type periods_t

contains

   recursive subroutine periods_note_progress(self, n_done, n_steps)
      class(periods_t), intent(inout) :: self
      integer, intent(in) :: n_done, n_steps
      integer, parameter :: n_parts = 1000

      call self%cancellation_t%note_progress( &
         int(n_parts*(self%n_done + self%n_new*n_done/max(1, n_steps))/self%n_planned), n_parts)
   end subroutine periods_note_progress

   !> Integrates from a motion of a model, and from a neighbouring state, until the verdict is decided.
   subroutine verify_motion(model, claim, n_periods, result, error)
      type(model_t), intent(inout) :: model
      type(claim_t), intent(in) :: claim
      integer, intent(in) :: n_periods                                !! of the slowest tone, at most; 0: from the decay rate
      type(verdict_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(pair_t), target :: pair

      call claim%check(model%system%tones%n_tones, model%system%structure%n_dofs, error)
      if (.not. allocated(error)) call model%system%structure%check_matrices("verification", largest_of(model%system), error)
      if (.not. allocated(error)) call begin_pair(pair, model%system, model%discretisation, model%options, claim, n_periods, error)
      if (allocated(error)) return
      if (claim%is_averaged) then
         model%options%integration%tolerance = pair%config%tolerance
         call verify_integrated(model%system, model%discretisation, model%options, pair%system, claim, pair%state, result, error)
         return
      end if
      call decide_pair(pair, claim, result, error)
      if (allocated(error)) return
      if (result%kind == verdict%differs) call halve_steps(model, claim, n_periods, result, error)
      if (allocated(error) .or. claim%is_unstable) return
      if (result%kind == verdict%unstable .or. result%kind == verdict%differs) call verify_orbit(model, claim, n_periods, result, &
         error)
   end subroutine verify_motion

   !> Integrates a pair until the verdict is decided.
   subroutine decide_pair(self, claim, result, error)
      type(pair_t), intent(inout), target :: self
      type(claim_t), intent(in) :: claim
      type(verdict_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error

      do while (result%kind == verdict%not_done)
         call integrate_next_periods(self, result, error)
         if (allocated(error)) return
      end do
      call write_up(self, claim, result)
   end subroutine decide_pair

   !> Verdict by steps of half the length on a motion that differs, if the difference falls with the steps.
   subroutine halve_steps(model, claim, n_periods, result, error)
      type(model_t), intent(in) :: model
      type(claim_t), intent(in) :: claim
      integer, intent(in) :: n_periods
      type(verdict_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(pair_t), target :: pair
      type(verdict_t) :: finer
      real(wp) :: gain

      call begin_pair(pair, model%system, model%discretisation, model%options, claim, n_periods, error)
      if (allocated(error) .or. pair%config%method == integration_method%cvode) return
      pair%config%substeps = 2*pair%config%substeps
      call decide_pair(pair, claim, finer, error)
      if (allocated(error) .or. size(pair%distance) == 0) return
      if (finer%kind == verdict%unstable) then
         result = finer
         return
      end if
      gain = maxval(pair%distance) - max(pair%distance(1), 0.0_wp)
      if (gain > log(min_growth)) then                                ! errors of the steps grow as any other
         if (gain < log(certain_growth) .or. finer%first_difference > result%first_difference/halving_ratio) return
         result = finer
         result%kind = verdict%unstable
         result%growth = gain/(maxloc(pair%distance, dim=1)*pair%length%period)
         return
      end if
      if (finer%difference > result%difference/halving_ratio .or. any(abs(finer%drift) > abs(result%drift)/halving_ratio)) return
      finer%limit = max(finer%limit, min(result%difference - finer%difference, limit_of(1.0_wp, 1.0_wp)))
      if (finer%kind == verdict%differs .and. finer%difference <= finer%limit) then
         finer%kind = verdict%agrees
         finer%growth = growth_of(0.0_wp*pair%ratio, pair%distance)/pair%length%period
      end if
      result = finer
   end subroutine halve_steps

   !> Verdict from the periodic motion next to the series, if there is one within the permitted difference to which nearby
   !> trajectories return; otherwise the verdict remains.
   subroutine verify_orbit(model, claim, n_periods, result, error)
      type(model_t), intent(in) :: model
      type(claim_t), intent(in) :: claim
      integer, intent(in) :: n_periods
      type(verdict_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: refused
      type(motion_series_t) :: series
      type(pair_t), target :: pair
      type(period_map_t) :: map
      type(verdict_t) :: beside
      real(wp), allocatable :: x(:)
      logical :: is_found

      if (size(claim%omega) /= 1 .or. any(model%system%tones%is_unknown) .or. lacks_mass(model%system)) return
      if (model%system%structure%n_dofs > max_shooting_dofs) return
      call begin_pair(pair, model%system, model%discretisation, model%options, claim, n_periods, error)
      if (allocated(error)) return
      call new_motion_series(series, claim%tuples, claim%omega, transpose(claim%amplitudes))
      call new_period_map(map, pair%system, series, pair%config%restitution, shooting_tolerance, refused)
      if (allocated(refused)) return
      call find_periodic_state(map, max_matrices*work_of_period_map(map), x, is_found)
      if (.not. is_found) return
      associate (n => pair%system%n_dofs)
         pair%state%q = x(:n)
         pair%state%v = x(n + 1:2*n)
         pair%state%s = x(2*n + 1:)
      end associate
      call place_neighbour(pair)
      call decide_pair(pair, claim, beside, error)
      if (allocated(error) .or. beside%kind /= verdict%agrees) return
      result = beside
      result%starts_beside = .true.
   end subroutine verify_orbit

   !> Sets the second state beside the first.
   subroutine place_neighbour(self)
      type(pair_t), intent(inout) :: self

      associate (n => self%system%n_dofs)
         self%other = self%state
         self%other%q = self%state%q + start_distance*self%scale*directions(n, 0)
         self%other%v = self%state%v + start_distance*self%speed*directions(n, n)
      end associate
   end subroutine place_neighbour

   !> Most degrees of freedom of a verification. Explicit steps on the dense matrices of a large structure would not end.
   integer function largest_of(system)
      type(system_t), intent(in) :: system

      largest_of = max_dofs
      if (.not. allocated(system%structure%sparse)) return
      largest_of = merge(max_sparse_dofs, max_dense, steps_are_sparse(system))
   end function largest_of

   !> Whether steps are taken with the sparse matrices of a large structure.
   logical function steps_are_sparse(system)
      type(system_t), intent(in) :: system
      integer :: i

      steps_are_sparse = has_sparse_steps(system%structure) .and. &
                         .not. any([(system%laws(i)%law%is_multiplier, i=1, size(system%laws))])
   end function steps_are_sparse

   !> Fails if the time integrations on sparse matrices would take too long by an estimate, before any work.
   subroutine check_work(structure, length, substeps, n_coordinates, error)
      type(structure_t), intent(in) :: structure                      !! sparse
      type(length_t), intent(in) :: length
      integer, intent(in) :: substeps, n_coordinates
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: operations_per_entry = 20.0_wp           ! of the stiffness, in a step: products, two solutions
      real(wp), parameter :: operations_per_pair = 60.0_wp            ! of coordinates, in a step: derivatives, the tangent
      real(wp), parameter :: operations_per_second = 1.0e9_wp
      real(wp) :: seconds_of_period
      integer :: n_steps

      n_steps = length%n_samples*substeps
      seconds_of_period = 2.0_wp*n_steps*(operations_per_entry*structure%sparse%stiffness%n_entries() + &
                                          operations_per_pair*real(n_coordinates, wp)**2)/operations_per_second
      if (length%bound*seconds_of_period <= max_seconds) return
      call fail(error, "verification would take about "//to_text(ceiling(length%bound*seconds_of_period/60.0_wp))//" min: "// &
                to_text(length%bound)//" periods of "//to_text(n_steps)//" steps for "//to_text(structure%n_dofs)// &
                " degrees of freedom and "//to_text(n_coordinates)//" coordinates of laws; half an hour suffices for "// &
                to_text(int(max_seconds/seconds_of_period))//" periods, at least "//to_text(length%fewest)// &
                " are a verification: give their number, or verify the motion of a reduced model (nhbm-model reduce)")
   end subroutine check_work

   !> Sets one state on the motion and one beside it; fails if the time integrations would not end in time.
   subroutine begin_pair(self, system, discretisation, options, claim, n_periods, error)
      type(pair_t), intent(inout), target :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(claim_t), intent(in) :: claim
      integer, intent(in) :: n_periods
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: frequencies(size(claim%tuples, 2)), length, step, tuples(size(claim%tuples, 1), size(claim%tuples, 2))
      integer :: i
      logical :: is_implicit

      associate (omega => claim%omega, amplitudes => claim%amplitudes, equations => self%system)
         tuples = real(claim%tuples, wp)
         frequencies = matmul(omega, tuples)
         call new_integration_system(equations, system%structure, system%laws, system%load_spectrum, omega)
         length = equations%length
         call choose_length(self%length, system, options, claim, n_periods)
         step = self%length%period/self%length%n_samples
         self%estimate = options%error_estimate%truncation
         if (ieee_is_finite(claim%estimate)) self%estimate = claim%estimate
         self%config = options%integration
         self%config%transient = 0.0_wp
         self%config%decimation = huge(1)                             ! the record has displacements alone
         if (steps_are_sparse(system)) then
            self%config%method = integration_method%generalized_alpha
            self%config%substeps = ceiling(step*maxval(omega)/two_pi*implicit_steps* &
               min(1.0_wp, sqrt(error_of_implicit_steps/(share_of_steps*limit_of(self%estimate, 1.0_wp)))))
            call check_work(system%structure, self%length, self%config%substeps, equations%laws%n_coordinates, error)
            if (allocated(error)) return
         else
            self%config%tolerance = min(self%config%tolerance, integration_tolerance)
         end if
         self%scale = sum(abs(amplitudes), dim=1)
         self%scale = [(maxval(self%scale, mask=system%structure%units == system%structure%units(i)), i=1, size(self%scale))]
         where (self%scale <= 0.0_wp) self%scale = max(length, start_distance)
         equations%length = min(length, maxval(self%scale))           ! errors of time integration: a law's length may be far larger
         self%speed = self%scale*max(leading_of(amplitudes, frequencies), minval(omega))
         is_implicit = self%config%method == integration_method%cvode
         if (is_implicit) is_implicit = lacks_mass(system) .or. is_stiff(system, self%length%period, maxval(abs(frequencies)))
         if (is_implicit) then
            self%config%method = integration_method%generalized_alpha
            self%config%spectral_radius = 0.0_wp                      ! what has next to no mass has no vibration of its own
            self%config%substeps = ceiling(step*maxval(omega)*implicit_steps/two_pi)
         else if (self%config%method == integration_method%cvode .and. .not. has_bounds_of(system)) then
            self%config%method = fixed_step_method_of(system)
            self%config%substeps = ceiling(max(step*min_steps/self%length%period, step*fastest_of(system)/step_of_mode))
            if (self%config%method == integration_method%central_differences) &
               self%config%substeps = finer_steps*self%config%substeps
         end if
         self%config%largest = runaway_ratio*maxval(self%scale)
         call new_integration_state(self%state, equations%n_dofs, equations%laws%n_states)
         call place_state(equations, amplitudes, frequencies, -periods_of_sliders*self%length%period, step, self%state)
         call place_neighbour(self)
         call new_integration_difference(self%difference, series_t(amplitudes, claim%tuples, omega, system%tones%is_unknown), &
                                         equations%laws%shape, system%structure%units, max(length, start_distance), &
                                         n_steady(self%length%most, self%length%fewest))
         self%share = velocity_share(amplitudes, frequencies)
         self%may_recover = .not. claim%is_unstable
         self%expected = self%estimate
         allocate (self%distance(0))
      end associate
   end subroutine begin_pair

   !> Integrates both through the next group of periods.
   subroutine integrate_next_periods(self, result, error)
      type(pair_t), intent(inout), target :: self
      type(verdict_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(integration_record_t) :: other_record
      type(integration_state_t) :: before(2)
      type(periods_t), target :: progress
      integer :: i, n_new

      associate (length => self%length, difference => self%difference)
         n_new = min(max(periods_at_once, difference%n_periods/4), length%bound - difference%n_periods)
         if (allocated(self%system%structure%sparse)) &
            n_new = max(1, min(n_new, int(max_record/(24.0_wp*length%n_samples*self%system%n_dofs))))
         if (self%is_ending) n_new = 1
         self%config%duration = n_new*length%period
         before = [self%state, self%other]
         associate (step => length%period/length%n_samples, all_dofs => [(i, i=1, self%system%n_dofs)])
            call progress%enter(huge(1.0_wp))
            progress%n_done = 2*difference%n_periods
            progress%n_new = n_new
            progress%n_planned = 2*length%bound
            call integrate_from(self%system, self%config, step, all_dofs, self%state, self%record, error)
            progress%n_done = progress%n_done + n_new
            if (.not. allocated(error)) call integrate_from(self%system, self%config, step, all_dofs, self%other, other_record, &
               error)
            call progress%leave()
         end associate
         if (allocated(error)) then                                   ! the motion is bounded: it has been left
            if (.not. self%record%is_under_way .or. self%record%is_out_of_work .or. other_record%is_out_of_work) return
            if (n_new == 1) then
               result%ended_by = error%message
               i = size(self%distance)
               result%kind = verdict%differs
               if (i > 0) result%kind = decide([self%ratio, 2.0_wp], [self%distance, self%distance(i)], length%fewest, &
                                               length%decay, .true.)
               if (result%kind == verdict%undecided) result%kind = verdict%differs
            end if
            deallocate (error)
            self%is_ending = .true.
            self%state = before(1)
            self%other = before(2)
            return
         end if
         call difference%add(self%record, other_record, n_new)
         self%distance = [self%distance, &
                          log(max(difference%apart(size(self%distance) + 1:)/start_distance, tiny(1.0_wp))) + self%moved_back]
      end associate
      associate (length => self%length, difference => self%difference, distance => self%distance)
         self%expected = self%estimate*merge(self%share, 1.0_wp, distance(size(distance)) > -log(min_distance_fall))
         self%ratio = [(maxval(difference%largest(:, i)/limit_of(self%expected, difference%share), mask=difference%counts), &
                        i=1, difference%n_periods)]
         call reset_distance(self%state, self%other, self%scale, self%speed, self%moved_back)
         result%kind = decide(self%ratio, distance, length%fewest, length%decay, difference%n_periods >= length%bound, &
                              self%may_recover, length%is_free)
         if (result%kind /= verdict%undecided .or. length%bound >= length%most) return
         length%bound = min(2*length%bound, length%most)
         result%kind = verdict%not_done
      end associate
   end subroutine integrate_next_periods

   !> Fills the result in.
   subroutine write_up(self, claim, result)
      type(pair_t), intent(in) :: self
      type(claim_t), intent(in) :: claim
      type(verdict_t), intent(inout) :: result
      real(wp), allocatable :: max_drift(:)
      integer :: n_retained

      associate (difference => self%difference, omega => claim%omega)
         result%n_periods = difference%n_periods
         result%duration = difference%n_periods*self%length%period
         result%drift = 0.0_wp*omega
         result%coordinate = ""
         if (difference%n_periods == 0) return
         call find_worst(difference, self%system, self%length, self%expected, result)
         if (result%kind == verdict%agrees .and. 2*difference%n_periods < self%length%beats) result%kind = verdict%undecided
         result%first_difference = maxval(difference%largest(:, 1), mask=difference%counts)
         ! the difference of a motion that agrees exceeds its limit in the transient alone
         result%growth = growth_of(merge(0.0_wp, self%ratio, result%kind == verdict%agrees), self%distance)/self%length%period
         n_retained = findloc(self%ratio > 1.0_wp, .true., dim=1) - 1
         if (n_retained < 0) n_retained = difference%n_periods
         if (claim%is_unstable .and. result%kind == verdict%differs) then
            if (n_retained > 0) then                                  ! it starts there and leaves
               result%kind = verdict%unstable
               result%growth = log(self%ratio(min(n_retained + 1, size(self%ratio)))/self%ratio(1))/(n_retained*self%length%period)
            else if (self%distance(1) > log(min_growth)) then          ! it leaves within a period, from its neighbour, too
               result%kind = verdict%unstable
               result%growth = self%distance(1)/self%length%period
            end if
         end if
         result%drift = difference%drift(n_retained)
         if (result%kind == verdict%unstable) return                  ! the drift is then that of the motion to which it diverges
         max_drift = limit_of(self%estimate*self%share, 1.0_wp)*omega
         where (ieee_is_finite(claim%frequency_estimates)) max_drift = max(max_drift, &
            limit_of(claim%frequency_estimates/omega, 1.0_wp)*omega)
         if (any(abs(result%drift) > max_drift)) result%kind = verdict%differs
         if (result%kind == verdict%agrees .and. result%difference > result%limit) result%kind = verdict%differs
      end associate
   end subroutine write_up

   !> Verdict on a motion that was integrated: a second time integration, from the motion itself and with its own
   !> tolerance, until it is steady. The part of the motion outside the set is not in its coefficients, so that
   !> coefficients are compared.
   subroutine verify_integrated(system, discretisation, options, equations, claim, start, result, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(integration_system_t), intent(in) :: equations
      type(claim_t), intent(in) :: claim
      type(integration_state_t), intent(in) :: start
      type(verdict_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      complex(wp), allocatable :: items(:, :), others(:, :)
      character(64), allocatable :: labels(:)
      real(wp), allocatable :: difference(:), scale(:)
      type(steady_motion_t) :: steady
      integer :: i, k

      call find_steady_motion(system, discretisation, options, system%dofs_of_unknowns(), steady, error, start)
      if (allocated(error)) return
      result%n_periods = steady%n_periods
      result%duration = steady%n_periods*two_pi/minval(system%tones%omega)
      result%drift = 0.0_wp*system%tones%omega
      result%coordinate = ""
      result%is_of_coefficients = .true.
      result%kind = merge(verdict%unstable, verdict%differs, claim%is_unstable)
      if (steady%status == outcome%pending) result%kind = verdict%undecided
      if (steady%status /= outcome%integrated) return
      associate (amplitudes => transpose(claim%amplitudes), tuples => claim%tuples, n => system%structure%n_dofs, &
                 shape => cmplx(equations%laws%shape, 0.0_wp, wp), units => system%structure%units)
         allocate (items(n + size(shape, 2), size(amplitudes, 2)), others(n + size(shape, 2), size(amplitudes, 2)))
         items(:n, :) = amplitudes
         items(n + 1:, :) = matmul(transpose(shape), amplitudes)
         others = (0.0_wp, 0.0_wp)
         do i = 1, size(tuples, 2)
            k = discretisation%harmonics%index_of(tuples(:, i))
            if (k > 0) others(:n, i) = steady%amplitudes(:, k)
         end do
         others(n + 1:, :) = matmul(transpose(shape), others(:n, :))
         scale = norm2(abs(items), dim=2)
         scale(:n) = [(maxval(scale(:n), mask=units == units(i)), i=1, n)]
      end associate
      difference = norm2(abs(others - items), dim=2)/max(scale, tiny(1.0_wp))
      labels = [character(64) :: system%structure%labels, equations%laws%coordinate_labels()]
      i = maxloc(difference, dim=1)
      result%coordinate = trim(labels(i))
      result%difference = difference(i)
      result%first_difference = difference(i)
      result%limit = limit_of(claim%spread + steady%spread, 1.0_wp)
      if (result%difference <= result%limit) result%kind = verdict%agrees
   end subroutine verify_integrated

   !> Length of the time integration from a motion: at least one that covers all of it, at most one in which the
   !> slowest mode of the linear structure decays, as far as the limit of work permits.
   subroutine choose_length(self, system, options, claim, n_periods)
      type(length_t), intent(out) :: self
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(claim_t), intent(in) :: claim
      integer, intent(in) :: n_periods                                !! at most; 0: not given
      real(wp) :: rate

      associate (omega => claim%omega)
         self%period = two_pi/minval(omega)
         self%n_samples = ceiling(self%period/step_of(options%integration, omega)*(1.0_wp - 1.0e-9_wp))
         self%longest = min(greatest_bound, max_samples/self%n_samples)
         self%fewest = merge(2, 1, size(omega) > 1)*min_periods
         self%beats = 2.0_wp*minval(omega)/slowest_beat(claim%tuples, omega, transpose(claim%amplitudes))
         self%fewest = max(self%fewest, ceiling(min(self%beats, real(self%longest, wp))))
      end associate
      rate = 0.0_wp
      if (.not. allocated(system%structure%sparse)) then
         rate = slowest_decay(system%structure%mass, system%structure%damping, system%structure%stiffness)*self%period
         self%is_free = has_free_motion(system%structure%mass, system%structure%stiffness)
      end if
      self%bound = usual_bound
      if (rate > 0.0_wp) then
         self%decay = ceiling(min(max_decay/rate, real(longest_decay, wp)))
         self%bound = max(min_bound, ceiling(min(enough_decay/rate, real(greatest_bound, wp))))
      end if
      self%most = max(self%fewest, self%longest)
      self%bound = max(self%fewest, min(self%bound, self%most))
      if (n_periods == 0) return
      self%bound = n_periods
      self%most = n_periods
   end subroutine choose_length

   !> Components between 1/2 and 1 of either sign, in an order unrelated to any structure.
   pure function directions(n, offset) result(values)
      integer, intent(in) :: n, offset
      real(wp) :: values(n)
      real(wp), parameter :: golden_ratio = 0.6180339887498949_wp, sqrt_two_fraction = 0.4142135623730951_wp
      integer :: i

      values = [(merge(-1.0_wp, 1.0_wp, modulo((offset + i)*golden_ratio, 1.0_wp) < 0.5_wp)* &
                 (0.5_wp + 0.5_wp*modulo((offset + i)*sqrt_two_fraction, 1.0_wp)), i=1, n)]
   end function directions

   !> Resets the second time integration to its initial distance, in the same direction, if it is too far or too near.
   subroutine reset_distance(state, other, scale, speed, moved_back)
      type(integration_state_t), intent(in) :: state
      type(integration_state_t), intent(inout) :: other
      real(wp), intent(in) :: scale(:), speed(:)                      !! [m], [m/s], (n_dofs)
      real(wp), intent(inout) :: moved_back                           !! logarithm of the total factor
      real(wp) :: apart

      apart = max(maxval(abs(other%q - state%q)/scale), maxval(abs(other%v - state%v)/speed))
      if (apart <= too_far .and. (apart >= too_near .or. apart <= epsilon(1.0_wp))) return
      other%q = state%q + start_distance/apart*(other%q - state%q)
      other%v = state%v + start_distance/apart*(other%v - state%v)
      other%s = state%s + start_distance/apart*(other%s - state%s)
      moved_back = moved_back + log(apart/start_distance)
   end subroutine reset_distance

   !> The coordinate, or the tone of a coordinate, with the largest ratio to its limit in the last periods.
   subroutine find_worst(difference, system, length, estimate, result)
      type(integration_difference_t), intent(in) :: difference
      type(integration_system_t), intent(in) :: system
      type(length_t), intent(in) :: length
      real(wp), intent(in) :: estimate
      type(verdict_t), intent(inout) :: result
      real(wp), allocatable :: differences(:, :), steady(:), shares(:, :)
      character(64), allocatable :: labels(:)
      integer :: c, i, m, n

      n = difference%n_periods
      steady = maxval(difference%largest(:, n - n_steady(n, length%fewest) + 1:), dim=2)
      i = maxloc(steady/limit_of(estimate, difference%share), dim=1, mask=difference%counts)
      result%difference = steady(i)
      result%limit = limit_of(estimate, difference%share(i))
      allocate (labels, source=[character(64) :: system%structure%labels, system%laws%coordinate_labels()])
      result%coordinate = trim(labels(i))
      if (n < length%fewest) return                                   ! tones cannot be separated in so short a time
      call difference%parts(differences, shares)
      do m = 1, size(differences, 2)
         do c = 1, size(differences, 1)
            if (differences(c, m)/limit_of(estimate, shares(c, m)) <= result%difference/result%limit) cycle
            result%difference = differences(c, m)
            result%limit = limit_of(estimate, shares(c, m))
            result%coordinate = trim(labels(difference%n_dofs + c))//", tone "//to_text(m)
         end do
      end do
   end subroutine find_worst

   !> Factor by which an error of the displacements is larger as one of the velocities: omitted harmonics have
   !> frequencies beyond the highest one, and the velocity missing at the start of the time integration excites a
   !> motion with the leading frequency, until it decays.
   pure real(wp) function velocity_share(amplitudes, frequencies) result(share)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_harmonics, n_dofs)
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s]
      real(wp) :: leading

      leading = leading_of(amplitudes, frequencies)
      share = 1.0_wp
      if (leading > 0.0_wp) share = max(share, maxval(abs(frequencies))/leading)
   end function velocity_share

   !> Frequency of the harmonic with the largest amplitude [rad/s].
   pure real(wp) function leading_of(amplitudes, frequencies)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_harmonics, n_dofs)
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s]

      leading_of = abs(frequencies(maxloc(maxval(abs(amplitudes), dim=2)*merge(1.0_wp, 0.0_wp, abs(frequencies) > 0.0_wp), dim=1)))
   end function leading_of

   !> Sets a state on the motion at time zero; sliders follow the motion from rest at an earlier time.
   subroutine place_state(system, amplitudes, frequencies, start, step, state)
      type(integration_system_t), intent(inout) :: system
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_harmonics, n_dofs)
      real(wp), intent(in) :: frequencies(:), start, step             !! [rad/s], [s], [s]
      type(integration_state_t), intent(inout) :: state
      integer :: i, n

      n = merge(ceiling(-start/step), 0, system%laws%n_states > 0)
      do i = -n, 0
         call system%laws%start_step((i - 1)*step, state%q, state%v, state%s)
         state%q = motion(amplitudes, frequencies, i*step)
         state%v = motion(amplitudes*spread(cmplx(0.0_wp, frequencies, wp), 2, size(amplitudes, 2)), frequencies, i*step)
         if (n == 0) cycle
         call system%laws%gather(state%q, state%v)
         call system%laws%evaluate(step)
         state%s = system%laws%s
      end do
   end subroutine place_state
end module hb_verification
