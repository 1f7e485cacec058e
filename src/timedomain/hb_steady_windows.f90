!> Time integration in windows until the motion is steady, by one method.
!>
!> Windows follow one another, each twice as long as the previous one. The averages over each (hb_birkhoff) are
!> coefficients at all tuples of the set; their difference from those of the previous window, which is shorter and
!> nearer to the start, is the spread. If the spread no longer falls, the motion is aperiodic or still in its
!> transient. Averages do not show lines between the tuples: the remainder of the record after subtraction of the
!> series must repeat as the tones do (hb_recurrence), or after several periods of them. A record shorter than a beat of the tones
!> does not determine the lines that differ by it: what they may exchange is a part of the error.
module hb_steady_windows
   use hb_birkhoff, only: coefficients_at
   use hb_budget, only: affordable_evaluations, is_spent
   use hb_cancellation, only: work_is_over
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t, fail
   use hb_impact_orbit, only: impact_orbit_t, new_impact_orbit, orbit_tolerance
   use hb_integration_config, only: integration_config_t, integration_method, step_of
   use hb_integration_starts, only: scattered
   use hb_integration_system, only: integration_state_t, integration_system_t, new_integration_state, new_integration_system
   use hb_kinds, only: int64, two_pi, wp
   use hb_law_measure, only: law_measure_t
   use hb_line_fit, only: line_fit_t, new_line_fit, unresolved_by
   use hb_modes, only: slowest_decay
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_newton, only: solve_newton
   use hb_options, only: options_t
   use hb_outcome, only: outcome
   use hb_primary_method, only: evaluation_work
   use hb_record_share, only: amplitude_of, as_real, distance_of, largest_in_parts, largest_share, remainder_of, scale_of
   use hb_recurrence, only: repetition, turns_to_repeat
   use hb_solver_types, only: report_t, solver_config_t
   use hb_spectrum, only: spectrum_t
   use hb_stability, only: stability_t, stability_verdict => verdict
   use hb_steady_motion, only: steady_motion_t
   use hb_structure, only: max_dense
   use hb_system, only: coordinates_of, measure_of, system_t
   use hb_text, only: rounded, to_text
   use hb_thresholds, only: max_distance_of_same, rounding_level
   use hb_time_stepping, only: early_end_t, integrate_from, integration_record_t
   implicit none
   private
   public :: allowed_of, integrate_to_steady, is_final, periods_of_first, sample_step

   integer, parameter :: first_window = 50                            ! periods of the slowest tone
   integer, parameter :: other_window = 70                            ! likewise, from a given state: with averages of its own
   integer, parameter :: max_windows = 7
   integer, parameter :: max_shots = 15                              ! of Newton's method for a periodic motion with impacts
   integer, parameter :: min_windows = 4                            ! before the spread can count as not falling
   integer, parameter :: samples_of_harmonic = 16                     ! of the highest one per period, at least
   integer, parameter :: samples_of_candidate = 4                     ! likewise, if most of the highest ones are negligible
   real(wp), parameter :: share_of_fit = 0.01_wp                      ! of the requested error: least gain of a product
   real(wp), parameter :: fitted_fraction = 0.75_wp                   ! fraction of a record used by a fit
   real(wp), parameter :: numbers_of_unknown = 1.5_wp                 ! of the record used by the first fit, below its highest
                                                                      !! frequency
   real(wp), parameter :: min_fit_gain = 0.8_wp                       ! error of a fit, relative to the previous one
   real(wp), parameter :: largest_record = 1.0e7_wp                   ! numbers in memory
   real(wp), parameter :: largest_spread = 1.0e-2_wp                  ! of a steady motion, relative
   real(wp), parameter :: final_spread_ratio = 1.0e-2_wp ! spread at which the time integration ends, relative to that allowed
   real(wp), parameter :: near_tolerance_share = 0.1_wp               ! likewise, after `min_windows`
   real(wp), parameter :: enough_decay = 8.0_wp                       ! of the slowest mode, as a logarithm
   real(wp), parameter :: min_spread_fall = 0.5_wp                    ! spread relative to the previous one
   real(wp), parameter :: start_perturbation = 1.0e-6_wp              ! of the length of the system, at the start
   character(*), parameter :: ended = "time integration was ended before its time"
   real(wp), parameter :: runaway_ratio = 1.0e4_wp                    ! displacement relative to the length of the system

   !> Windows of a time integration, each twice as long as the one before, and the series of the last one.
   type :: windows_t
      type(integration_system_t) :: equations
      type(integration_config_t) :: config
      type(coordinates_t) :: coordinates                              ! of the laws
      type(law_measure_t) :: measure                                  ! of motions at these
      real(wp), allocatable :: rest(:)                                ! motion of each of them that counts as none
      real(wp), allocatable :: frequencies(:)                         ! [rad/s], of the set, or of the candidates
      integer :: n_first = 0                                          ! periods of the first one
      real(wp) :: period = 0.0_wp                                     ! [s] of the slowest tone
      real(wp) :: step = 0.0_wp                                       ! [s] between samples
      real(wp) :: decay = 0.0_wp                                      ! [1/s] of the slowest mode of the structure
      type(integration_record_t) :: record                            ! the last one
      type(line_fit_t) :: fit                                         ! of candidates to it
      real(wp) :: unresolved = 0.0_wp                                 ! part of the motion in lines that it does not separate
      real(wp), allocatable :: remainder(:, :)                        ! what its series leaves, (n_samples, n_coordinates)
   end type windows_t

contains

   !> Sampling interval of a record [s].
   real(wp) function sample_step(system, discretisation, options) result(step)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options

      associate (highest => maxval(abs(discretisation%harmonics%frequencies(system%tones%omega))))
         step = min(step_of(options%integration, system%tones%omega), &
                    two_pi/(merge(samples_of_candidate, samples_of_harmonic, options%integration%aim > 0.0_wp)*highest))
      end associate
   end function sample_step

   !> Periods of the slowest tone in the first window.
   integer function periods_of_first(system, discretisation, options) result(n_periods)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options

      n_periods = first_window
      if (options%integration%aim <= 0.0_wp) return
      associate (omega => system%tones%omega)
         n_periods = max(n_periods, ceiling(numbers_of_unknown/fitted_fraction*discretisation%harmonics%n_harmonics*minval(omega)/ &
                                            maxval(abs(discretisation%harmonics%frequencies(omega)))))
      end associate
   end function periods_of_first

   !> Work of averages over a record [ns].
   pure real(wp) function work_of_averages(discretisation, n_samples, n_coordinates) result(work)
      type(discretisation_t), intent(in) :: discretisation
      real(wp), intent(in) :: n_samples
      integer, intent(in) :: n_coordinates

      work = 2.0_wp*n_samples*n_coordinates*discretisation%harmonics%n_harmonics
   end function work_of_averages

   !> Largest permitted spread of a steady motion.
   pure real(wp) function allowed_of(options) result(allowed)
      type(options_t), intent(in) :: options

      allowed = min(options%error_estimate%truncation, largest_spread)
   end function allowed_of

   !> Integrates window by window until the motion is steady, no longer improves, or the work is exhausted.
   subroutine integrate_to_steady(system, discretisation, options, law_dofs, steady, state, error, start)
      type(system_t), intent(in) :: system                            !! all tones given
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      integer, intent(in) :: law_dofs(:)
      type(steady_motion_t), intent(out) :: steady
      type(integration_state_t), intent(out) :: state                 !! the last one
      type(error_t), allocatable, intent(out) :: error
      type(integration_state_t), intent(in), optional :: start
      type(windows_t), target :: windows
      real(wp), allocatable :: z(:, :)
      real(wp) :: spread_before, work_of_window
      integer :: n_periods, status_before, window

      call begin_windows(windows, system, discretisation, options, state, error, start)
      if (allocated(error)) return
      associate (record => windows%record)
         do window = 1, max_windows
            n_periods = windows%n_first*2**(window - 1)
            windows%config%duration = n_periods*windows%period
            if (window > 1) call check_work(options, 2.0_wp*work_of_window, steady)
            if (steady%is_out_of_work .or. is_too_long(windows, discretisation, options)) exit
            work_of_window = -steady%work
            call integrate_window(options, windows%equations, windows%config, windows%step, state, record, steady, error)
            if (allocated(error)) return
            if (steady%is_out_of_work) exit
            steady%n_periods = steady%n_periods + n_periods
            z = windows%coordinates%values_of(record%every_displacement(:, law_dofs))
            spread_before = merge(huge(1.0_wp), steady%spread, window == 1)
            call average_window(system, discretisation, options, windows, z, steady, error)
            if (allocated(error)) return
            work_of_window = work_of_window + steady%work
            steady%amplitude = amplitude_of(z)
            if (.not. options%integration%aim > 0.0_wp) then
               if (window < min_windows .and. steady%spread > final_spread_ratio*allowed_of(options)) cycle
               windows%remainder = remainder_of(z, steady%averages, record, windows%frequencies)
            end if
            status_before = steady%status
            call describe_verdict(discretisation, options, windows, steady, z, system%tones%omega*record%step/two_pi, &
                                  has_forgotten(windows, window, steady%n_periods), window == max_windows)
            if (work_is_over()) call fail(error, ended)
            if (allocated(error)) return
            if (is_final(steady, status_before, spread_before, allowed_of(options), options%integration%aim)) exit
         end do
      end associate
      call describe_end(system, options, windows, steady)
      if (steady%status == outcome%integrated) call complete(system, discretisation, options, windows, state, steady)
      call windows%fit%destroy()
   end subroutine integrate_to_steady

   !> Whether the start has no effect any more on the last window, or is not waited for any longer.
   pure logical function has_forgotten(self, window, n_periods)
      type(windows_t), intent(in) :: self
      integer, intent(in) :: window                                   !! its number
      integer, intent(in) :: n_periods                                !! of all windows so far

      has_forgotten = window == max_windows .or. self%decay*n_periods*self%period >= enough_decay .or. &
                      (self%decay <= 0.0_wp .and. window > min_windows)   ! no mode decays, or none is known
   end function has_forgotten

   !> Completes the message: no window was short enough, the lines are none of the tones, or some are not separated.
   subroutine describe_end(system, options, self, steady)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(windows_t), intent(in) :: self
      type(steady_motion_t), intent(inout) :: steady

      if (.not. allocated(steady%message)) steady%message = "time integration: a window of "//to_text(self%n_first)// &
         " periods has too many samples"
      if (steady%status == outcome%broadband .and. options%integration%aim > 0.0_wp) steady%message = steady%message// &
         ": the motion is none of these tones"
      if (steady%status == outcome%integrated .and. self%unresolved > steady%spread) steady%message = steady%message// &
         ", and "//rounded(self%unresolved)//" of the motion is of harmonics too close to each other for a record of this length"
      if (.not. allocated(self%record%impacts) .or. steady%status == outcome%pending) return
      if (any(self%record%impacts /= 0) .and. .not. system%has_restitution(options%integration%restitution)) &
         steady%message = steady%message//"; a wall without a restitution is struck: it was taken as 0"
   end subroutine describe_end

   !> Completes a steady motion: the error of lines that are not separated, the series of all degrees of freedom, and the periodic
   !> motion next to one with impacts.
   subroutine complete(system, discretisation, options, self, state, steady)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(windows_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state                  !! at the end of the last window
      type(steady_motion_t), intent(inout) :: steady

      steady%spread = hypot(steady%spread, self%unresolved)
      self%fit%max_work = huge(1.0_wp)
      steady%amplitudes = transpose(averages_of(system, discretisation, options, self%record%every_displacement, self%record, &
                                                self%fit))
      if (system%tones%n_tones == 1 .and. options%lacks_impacts_of(system, outcome%impact)) &
         call polish(system, discretisation, options, self%coordinates, state, steady)
   end subroutine complete

   !> Prepares the windows, and the state at their start.
   subroutine begin_windows(self, system, discretisation, options, state, error, start)
      type(windows_t), intent(inout), target :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(integration_state_t), intent(out) :: state
      type(error_t), allocatable, intent(out) :: error
      type(integration_state_t), intent(in), optional :: start

      self%frequencies = discretisation%harmonics%frequencies(system%tones%omega)
      self%coordinates = coordinates_of(system)
      self%measure = measure_of(system)
      call system%structure%check_matrices("integration", max_dense, error)
      if (allocated(error)) return
      associate (equations => self%equations)
         call new_integration_system(equations, system%structure, system%laws, system%load_spectrum, system%tones%omega)
         self%rest = rounding_level*sums_of_terms(self%coordinates, equations%response(self%coordinates%dofs))
         if (present(start)) then
            state = start
         else
            call begin(options%start%spectrum, system%tones%omega, equations, state)
         end if
         self%period = two_pi/minval(system%tones%omega)
         self%step = sample_step(system, discretisation, options)
         self%config = options%integration
         self%config%transient = 0.0_wp
         self%config%decimation = huge(1)
         self%config%largest = runaway_ratio*max(equations%length, maxval(abs(state%q)), tiny(1.0_wp))
         self%decay = slowest_decay(equations%structure%mass, equations%structure%damping, equations%structure%stiffness)
      end associate
      self%n_first = periods_of_first(system, discretisation, options)
      if (present(start)) self%n_first = max(self%n_first, other_window)
   end subroutine begin_windows

   !> Sums of the terms of each coordinate, whatever their signs.
   pure function sums_of_terms(coordinates, sizes) result(sums)
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(in) :: sizes(:)                                !! of the degrees of freedom, (size(coordinates%dofs))
      real(wp) :: sums(coordinates%n)
      integer, allocatable :: at(:)
      real(wp), allocatable :: weights(:)
      integer :: k

      do k = 1, coordinates%n
         call coordinates%find_functional(k, at, weights)
         sums(k) = sum(abs(weights)*sizes(at))
      end do
   end function sums_of_terms

   !> Whether a window of the present duration has too many samples for the memory, or the permitted work.
   pure logical function is_too_long(self, discretisation, options)
      type(windows_t), intent(in) :: self
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options

      associate (n_samples => self%config%duration/self%step)
         is_too_long = n_samples*self%equations%n_dofs > largest_record
         if (.not. options%integration%aim > 0.0_wp) &
            is_too_long = is_too_long .or. &
               work_of_averages(discretisation, n_samples, self%coordinates%n) > options%integration%max_work
      end associate
   end function is_too_long

   !> Averages of the last window and their spread: the remainder of the lines fitted to it, or the change since the window before.
   subroutine average_window(system, discretisation, options, self, z, steady, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(windows_t), intent(inout) :: self
      real(wp), intent(in) :: z(:, :)                                 !! its motion, (n_samples, n_coordinates)
      type(steady_motion_t), intent(inout) :: steady
      type(error_t), allocatable, intent(out) :: error
      type(law_measure_t) :: measure
      complex(wp), allocatable :: averages(:, :)
      integer :: i
      logical :: finds_lines

      finds_lines = options%integration%aim > 0.0_wp
      if (finds_lines) call new_line_fit(self%fit, size(z, 1), nint(fitted_fraction*size(z, 1)), self%record%start, self%step, &
                                         self%frequencies, importance_of(discretisation), error)
      if (allocated(error)) return
      self%fit%max_work = options%integration%max_work - steady%work
      averages = averages_of(system, discretisation, options, z, self%record, self%fit)
      steady%work = steady%work + &
                    merge(self%fit%work, work_of_averages(discretisation, real(size(z, 1), wp), size(z, 2)), finds_lines)
      if (work_is_over()) call fail(error, ended)
      if (allocated(error)) return
      if (finds_lines) then
         self%remainder = reshape([(z(:, i) - self%fit%series(averages(:, i)), i=1, size(z, 2))], shape(z))
         steady%spread = max(largest_in_parts(self%remainder, z, self%rest), &
                             largest_in_parts(self%measure%seen(self%remainder), self%measure%seen(z), seen_rest(self)))
         self%unresolved = maxval([(unresolved_by(self%step*size(z, 1), self%frequencies, averages(:, i), steady%spread), &
                                      i=1, size(z, 2))])
      else if (allocated(steady%averages)) then
         measure = self%measure
         call measure%relate_to(as_real(averages))
         steady%spread = max(maxval(distance_of(averages, steady%averages, 0.0_wp, self%rest)), &
                             measure%norm(as_real(averages - steady%averages))/ &
                             max(measure%size_of_motion, maxval(seen_rest(self)), tiny(1.0_wp)))
      else
         steady%spread = huge(1.0_wp)
      end if
      call move_alloc(averages, steady%averages)
   end subroutine average_window

   !> The motion that counts as none, at the coordinates of the laws.
   pure function seen_rest(self) result(rest)
      type(windows_t), intent(in) :: self
      real(wp), allocatable :: rest(:)
      real(wp), allocatable :: seen(:, :)
      real(wp) :: motion(1, size(self%rest))

      motion(1, :) = self%rest
      allocate (seen, source=abs(self%measure%seen(motion)))
      allocate (rest, source=seen(1, :))
   end function seen_rest

   !> Replaces a motion with impacts by the periodic one at its end, if Newton's method finds it nearby: its accuracy is
   !> then not limited by the decay of transients.
   subroutine polish(system, discretisation, options, coordinates, state, steady)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(coordinates_t), intent(in) :: coordinates
      type(integration_state_t), intent(in) :: state                  !! at the end of the record
      type(steady_motion_t), intent(inout) :: steady
      type(impact_orbit_t) :: orbit
      type(motion_series_t) :: motion
      type(report_t) :: report
      type(error_t), allocatable :: error
      type(stability_t) :: stability
      type(steady_motion_t) :: polished
      real(wp), allocatable :: begun(:), x(:)
      logical :: is_done

      call new_motion_series(motion, discretisation%harmonics%tuples, system%tones%omega, steady%amplitudes)
      call new_impact_orbit(orbit, system, discretisation, options, motion, error)
      if (.not. allocated(error)) then
         call orbit%state_after(state, begun, is_done)
         x = begun
         if (is_done) call solve_newton(orbit, solver_config_t(tolerance=orbit_tolerance, max_iterations=max_shots), x, report)
         steady%work = steady%work + orbit%work_of(report)
         if (is_done .and. report%status == outcome%converged .and. maxval(abs(x - begun)) <= max_distance_of_same) then
            polished = steady
            call orbit%describe(discretisation, options, coordinates, x, polished, is_done)
            stability = orbit%stability(x)
            if (is_done .and. stability%verdict /= stability_verdict%unstable) steady = polished    ! the motion attracts
         end if
      end if
      call orbit%destroy()
   end subroutine polish

   !> Ends the windows if the next one would exceed the limit of work.
   subroutine check_work(options, work_of_next, steady)
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: work_of_next
      type(steady_motion_t), intent(inout) :: steady

      steady%is_out_of_work = steady%work + work_of_next > options%integration%max_work
      if (steady%is_out_of_work) call end_without_work(steady)
   end subroutine check_work

   !> Sets the status of the windows so far, if there are any. A motion that repeats after several periods is found once transients
   !> have decayed, and remains so.
   subroutine end_without_work(steady)
      type(steady_motion_t), intent(inout) :: steady

      if (any(steady%status == [outcome%integrated, outcome%subharmonic])) return
      steady%status = outcome%pending
      if (len(steady%message) > 0) steady%message = steady%message//"; "
      steady%message = steady%message//"the time integration"//is_spent
   end subroutine end_without_work

   !> Integrates one window and counts its work. If the work limit ends it after other windows, these may suffice: the
   !> status is then `integrated` or undecided, without an error.
   subroutine integrate_window(options, system, config, step, state, record, steady, error)
      type(options_t), intent(in) :: options
      type(integration_system_t), intent(inout), target :: system
      type(integration_config_t), intent(inout) :: config             !! with the duration of the window
      real(wp), intent(in) :: step                                    !! [s], between samples
      type(integration_state_t), intent(inout) :: state
      type(integration_record_t), intent(inout) :: record             !! replaced if the window was integrated
      type(steady_motion_t), intent(inout) :: steady
      type(error_t), allocatable, intent(out) :: error
      type(integration_record_t) :: next
      integer(int64) :: n_before
      real(wp) :: cost
      integer :: i

      cost = evaluation_work(system%n_dofs, system%laws%n_coordinates, config%method == integration_method%generalized_alpha)
      n_before = system%laws%n_evaluations
      config%max_evaluations = n_before + affordable_evaluations(options%integration%max_work - steady%work, cost)
      call integrate_from(system, config, step, [(i, i=1, system%n_dofs)], state, next, error, early_end_t(watches_pace=.true.))
      steady%is_out_of_work = next%is_out_of_work
      steady%is_at_pole = next%is_at_pole
      if (next%is_out_of_work .and. allocated(steady%message)) then
         deallocate (error)
         call end_without_work(steady)
         return
      end if
      steady%work = steady%work + cost*(system%laws%n_evaluations - n_before)
      if (allocated(error)) return
      call move_alloc(next%every_displacement, record%every_displacement)
      call move_alloc(next%impacts, record%impacts)
      record%start = next%start
      record%step = next%step
   end subroutine integrate_window

   !> Whether a longer window would not change the result: the motion is accurate enough or no longer improves, or
   !> another kind of motion is found twice with a spread that remains above, or within, the permitted one.
   pure logical function is_final(steady, status_before, spread_before, allowed, aim_of_lines)
      type(steady_motion_t), intent(in) :: steady
      integer, intent(in) :: status_before
      real(wp), intent(in) :: spread_before
      real(wp), intent(in) :: allowed                                 !! spread
      real(wp), intent(in) :: aim_of_lines                            !! error at which to end if lines are found, otherwise 0

      associate (spread => steady%spread)
         if (steady%status /= outcome%integrated) then
            is_final = any(steady%status == [outcome%subharmonic, outcome%broadband]) .and. steady%status == status_before .and. &
               (spread > merge(min_fit_gain, min_spread_fall, aim_of_lines > 0.0_wp)*spread_before .or. &
                spread <= final_spread_ratio*allowed)
         else if (aim_of_lines > 0.0_wp) then
            is_final = spread <= aim_of_lines .or. spread > min_fit_gain*spread_before
         else
            is_final = spread <= near_tolerance_share*allowed
         end if
      end associate
   end function is_final

   subroutine begin(start, omega, system, state)
      type(spectrum_t), intent(in) :: start                           !! [m]
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s]
      type(integration_system_t), intent(in) :: system
      type(integration_state_t), intent(out) :: state
      integer :: i

      call new_integration_state(state, system%n_dofs, system%laws%n_states)
      if (.not. start%is_zero()) call start%find_state(omega, state%q, state%v)
      state%q = state%q + start_perturbation*system%length*[(scattered(i), i=1, system%n_dofs)]
   end subroutine begin

   !> Describes a steady record. The remainder of a fit to candidates consists of lines beyond them: they are faster
   !> than the resolution of returns. The motion is known to that accuracy.
   subroutine describe_verdict(discretisation, options, self, steady, z, turns, has_forgotten, is_last)
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(windows_t), intent(in) :: self
      type(steady_motion_t), intent(inout) :: steady
      real(wp), intent(in) :: z(:, :)                                 !! [m], (n_samples, n_coordinates)
      real(wp), intent(in) :: turns(:)                                !! of the phases from sample to sample, (n_tones)
      logical, intent(in) :: has_forgotten                            !! the transient has decayed, as far as damping determines it
      logical, intent(in) :: is_last                                  !! there is no longer window
      real(wp) :: allowed, left_out
      character(:), allocatable :: integrated_for
      integer :: part
      logical :: finds_lines

      integrated_for = "time integration over "//to_text(steady%n_periods)//" periods of the slowest tone"
      allowed = allowed_of(options)
      left_out = largest_share(self%remainder, z, self%rest)
      steady%left_out = merge(0.0_wp, left_out, options%integration%aim > 0.0_wp) ! for a fit included in the spread
      finds_lines = options%integration%aim > 0.0_wp
      part = turns_to_repeat(self%remainder, scale_of(z, self%rest), turns, left_out, allowed)
      steady%status = outcome%pending
      if (part == 1) then
         if (steady%spread <= allowed .or. (finds_lines .and. has_forgotten)) steady%status = outcome%integrated
      else if (has_forgotten .and. part > 1) then
         steady%status = outcome%subharmonic
         steady%n_repeat = part
      else if (has_forgotten .and. (is_last .or. part == repetition%none)) then
         steady%status = merge(outcome%integrated, outcome%broadband, finds_lines .and. left_out <= largest_spread)
      end if
      select case (steady%status)
      case (outcome%integrated)
         if (finds_lines) then
            steady%message = integrated_for//": relative residual of the series "//rounded(steady%spread)// &
                              " (worst quarter of the record)"
         else
            steady%message = integrated_for//": the averages scatter by "//rounded(steady%spread)// &
                              "; harmonics that the given order leaves out carry "//rounded(left_out)//" of the motion"
         end if
      case (outcome%subharmonic)
         steady%message = integrated_for//": the motion repeats after "//to_text(part)//" periods"
      case (outcome%broadband)
         if (finds_lines) then
            steady%message = integrated_for//": a series of "//to_text(discretisation%harmonics%n_harmonics)// &
                              " harmonics has the relative residual "//rounded(steady%spread)//" (worst quarter of the record)"
         else
            steady%message = integrated_for//": the motion does not repeat, its averages scatter by "//rounded(steady%spread)
         end if
      case default
         steady%message = integrated_for//": the averages scatter by "//rounded(steady%spread)// &
                           ", too short to decide whether the motion repeats"
      end select
   end subroutine describe_verdict

   !> Averages at all tuples, cos - i sin, (n_harmonics, any); for candidates by a fit of all of them.
   function averages_of(system, discretisation, options, x, record, fit) result(c)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: x(:, :)                                 !! (n_samples, any)
      type(integration_record_t), intent(in) :: record                !! that x is of
      type(line_fit_t), intent(inout) :: fit                          !! of candidates
      complex(wp) :: c(discretisation%harmonics%n_harmonics, size(x, 2))
      integer :: k

      do k = 1, size(x, 2)
         if (options%integration%aim > 0.0_wp) then
            call fit%coefficients(x(:, k), share_of_fit*options%integration%aim, c(:, k))
         else
            call coefficients_at(x(:, k), record%start, record%step, &
                                 discretisation%harmonics%frequencies(system%tones%omega), c(:, k))
         end if
      end do
   end function averages_of

   !> Weight of a candidate relative to others: the smaller, the higher its order.
   pure function importance_of(discretisation) result(importance)
      type(discretisation_t), intent(in) :: discretisation
      real(wp) :: importance(discretisation%harmonics%n_harmonics)

      importance = 1.0_wp/(1 + sum(abs(discretisation%harmonics%tuples), dim=1))
   end function importance_of
end module hb_steady_windows
