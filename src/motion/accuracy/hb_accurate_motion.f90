!> The motion of a model to a requested accuracy, by the attempts of `hb_attempts`: where its first level is found, how it is
!> refined (hb_refined_motion), and what is tried where no level reaches the tolerance.
!> Source: docs/why/accuracy.md.
module hb_accurate_motion
   use, intrinsic :: iso_fortran_env, only: int64
   use hb_amplitudes, only: amplitudes_t
   use hb_attempts, only: attempt_row, attempt_rule_t, attempts_t, make_attempts, point_conditions_t, stage
   use hb_budget, only: affordable_evaluations
   use hb_cancellation, only: cancellation_t, work_is_over
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_integrate_to_tolerance, only: driven_tuples, integrate_from_balance, integrate_to_tolerance, integrates_first
   use hb_kinds, only: wp
   use hb_level, only: degree_of, distance, estimate_of, level_t
   use hb_model, only: model_t
   use hb_motion_result, only: motion_result_t
   use hb_options, only: options_t
   use hb_outcome, only: is_integrated, outcome
   use hb_point_budget, only: limit_refinement, point_budget_t
   use hb_primary_method, only: evaluation_work, primary_method
   use hb_refined_motion, only: has_ended, refined_motion_t
   use hb_solver_types, only: attempt_t
   use hb_stability, only: stability_verdict => verdict
   use hb_system, only: coordinates_of, measure_of, system_t
   use hb_threads, only: use_threads
   use hb_thresholds, only: estimate_safety
   use hb_torus, only: samples_for
   use hb_tuple_choice, only: lowest_order, new_lowest_set
   implicit none
   private
   public :: solve_to_tolerance

   integer, parameter :: max_refinements = 2                          ! for a verdict on stability
   real(wp), parameter :: clear_change = 1.0e-4_wp                    ! of multipliers, caused by the errors of the motion

   !> The attempts to find a motion to the tolerance.
   type, extends(attempts_t) :: point_attempts_t
      type(refined_motion_t) :: motion
      type(point_conditions_t) :: conditions
      logical :: is_finer = .false.                                   ! to a part of the tolerance, for a verdict on stability
      logical :: has_left_start = .false.                             ! the motion on the first set is far from the given start
   contains
      procedure :: applies => point_attempts_applies
      procedure :: make => point_attempts_make
      procedure :: is_over => point_attempts_is_over
   end type point_attempts_t

contains

   !> Solves a model to the tolerance that it requests. The result has its own set, and status `converged` if the
   !> estimated error is below the tolerance, `truncated` if the budget was exhausted first; if no motion was found,
   !> it has the status of the attempt on the lowest level.
   subroutine solve_to_tolerance(model, result, error, top, start)
      type(model_t), intent(in), target :: model
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(level_t), intent(out) :: top                               !! the last level; without unknowns if none is solved
      type(level_t), intent(in), optional :: start                    !! of a neighbour
      type(cancellation_t), target :: cancellation
      type(point_attempts_t) :: attempts

      call cancellation%enter(model%options%solver%time_limit)
      call use_threads(model%options%solver%n_threads)
      if (present(start)) then
         attempts%motion%start = start
         attempts%motion%start%symmetry = model%discretisation%symmetry   ! which may differ from that of the neighbour
         attempts%motion%start%torus%corrects_kinks = model%discretisation%torus%corrects_kinks
      end if
      call solve_by_levels(attempts, model%system, model%discretisation, model%options)
      result = attempts%motion%result
      call result%withdraw_verdict()
      call move_alloc(attempts%made, result%attempts)
      top = attempts%motion%top
      if (allocated(attempts%motion%error)) call move_alloc(attempts%motion%error, error)
      call cancellation%leave()
   end subroutine solve_to_tolerance

   !> Makes the attempts of a point.
   recursive subroutine solve_by_levels(self, system, discretisation, options)
      type(point_attempts_t), intent(inout) :: self
      type(system_t), intent(in), target :: system
      type(discretisation_t), intent(in), target :: discretisation
      type(options_t), intent(in), target :: options

      call self%motion%begin(system, discretisation, options)
      call set_conditions(self)
      call make_attempts(self, stage%point)
   end subroutine solve_by_levels

   !> Whether an attempt can be made, by the conditions of `hb_attempts`.
   logical function point_attempts_applies(self, rule) result(applies)
      class(point_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule

      call note_progress(self)
      if (rule%row == attempt_row%finer_for_stability) &              ! levels before the last one have no stability
         self%conditions%lacks_stability = lacks_verdict(self%motion%system, self%motion%result)
      applies = self%conditions%permit(rule)
   end function point_attempts_applies

   !> Sets the conditions that hold for all attempts of the point.
   subroutine set_conditions(self)
      type(point_attempts_t), intent(inout) :: self

      associate (c => self%conditions, system => self%motion%system, options => self%motion%options)
         c%may_integrate = options%has_time_domain()
         c%integrates_last = options%solver%fallback .and. options%solver%fallback_by_integration
         c%integrates_unknown_tone = c%may_integrate .and. c%integrates_last .and. .not. &
            (options%start%from_integration .or. allocated(system%structure%parts) .or. system%normal_mode%is_requested) .and. &
            system%tones%n_tones == 1 .and. all(system%tones%is_unknown)
         c%grows_set = options%accuracy%grows_set
         c%has_laws = size(system%laws) > 0
         c%has_neighbour = allocated(self%motion%start%unknowns)
         c%is_within_another = self%is_finer
         if (c%may_integrate .and. .not. c%has_neighbour) c%integrates_first = integrates_first(system, options)
      end associate
   end subroutine set_conditions

   !> Notes in the conditions what the attempts so far have led to.
   subroutine note_progress(self)
      type(point_attempts_t), intent(inout) :: self
      type(point_budget_t) :: budget

      associate (c => self%conditions, motion => self%motion, system => self%motion%system, options => self%motion%options)
         c%status = motion%result%status
         c%has_motion = allocated(motion%top%unknowns) .and. .not. self%has_left_start   ! then a larger set is tried
         c%is_struck = options%lacks_impacts_of(system, c%status)
         c%is_unstable = .not. motion%result%stability%growth <= 1.0_wp
         budget = motion%solver%budget()
         c%is_out_of_work = motion%solver%is_out_of_work .or. budget%levels%is_exhausted()
         c%is_cancelled = work_is_over()
      end associate
   end subroutine note_progress

   !> Makes one attempt.
   recursive subroutine point_attempts_make(self, rule, attempt, within)
      class(point_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule
      type(attempt_t), intent(inout) :: attempt
      type(attempt_t), allocatable, intent(out) :: within(:)

      associate (motion => self%motion)
         select case (rule%row)
         case (attempt_row%lines_first)
            call integrate_before(motion, attempt%has_succeeded)
         case (attempt_row%lines)
            call integrate_after(motion%system, motion%discretisation, motion%options, motion%result, attempt%has_succeeded)
         case (attempt_row%lines_from_motion)
            call integrate_from_balance(motion%system, motion%discretisation, motion%options, motion%result, motion%top, &
                                        attempt%has_succeeded)
         case (attempt_row%refinement_of_lines)
            call refine_lines(self, rule)
         case (attempt_row%refinement)
            call motion%refine_to_tolerance()
            attempt%has_succeeded = motion%result%status == outcome%converged
         case (attempt_row%without_neighbour)
            call solve_without_neighbour(self)
            attempt%has_succeeded = motion%result%status == outcome%converged
         case (attempt_row%refinement_integrated)
            call solve_from_integration(self, rule)
            attempt%has_succeeded = motion%result%status == outcome%converged
         case (attempt_row%finer_for_stability)
            call refine_for_verdict(self, rule%share)
         case (attempt_row%set_of_neighbour, attempt_row%first_set, attempt_row%larger_first_set, attempt_row%smaller_first_set, &
               attempt_row%integrated_guess)
            call find_first_or_retain(self, rule, within)
            attempt%has_succeeded = allocated(motion%top%unknowns) .and. .not. self%has_left_start
         end select
         attempt%status = merge(outcome%failed, motion%result%status, allocated(motion%error) .or. &
                                motion%result%status == outcome%pending)
      end associate
   end subroutine point_attempts_make

   logical function point_attempts_is_over(self) result(is_over)
      class(point_attempts_t), intent(inout) :: self

      is_over = allocated(self%motion%error) .or. self%motion%result%status == outcome%interrupted .or. &
                (has_ended(self%motion%result) .and. .not. allocated(self%motion%top%unknowns))
   end function point_attempts_is_over

   !> Whether the errors of the motion leave its stability open: they move its largest multiplier as far as the unit
   !> circle or, with several tones and laws with kinks, its largest exponent to zero, or there is no periodic motion
   !> near it.
   pure logical function lacks_verdict(system, result)
      type(system_t), intent(in) :: system
      type(motion_result_t), intent(in) :: result
      real(wp) :: unit
      integer :: i

      lacks_verdict = .false.
      if (result%status /= outcome%converged) return
      associate (found => result%stability)
         if (.not. allocated(found%multipliers)) then
            unit = 1.0_wp
            if (size(result%frequency) > 1) unit = minval(result%frequency)
            lacks_verdict = found%verdict == stability_verdict%unknown .and. found%estimate > clear_change*unit .and. &
               any([(system%laws(i)%law%n_switches + system%laws(i)%law%n_states > 0, i=1, size(system%laws))])
            return
         end if
         lacks_verdict = found%estimate > clear_change .and. (found%verdict == stability_verdict%unknown .or. &
                     (found%verdict == stability_verdict%unstable .and. abs(found%multipliers(1)) - 1.0_wp < estimate_safety* &
                           found%estimate))
      end associate
   end function lacks_verdict

   !> Refines to a tenth, then a hundredth of the tolerance for a verdict on stability, within a limit of work; without a verdict
   !> the motion remains unchanged.
   recursive subroutine refine_for_verdict(self, share)
      class(point_attempts_t), intent(inout) :: self
      real(wp), intent(in) :: share                                   !! largest work, relative to that so far
      type(options_t), target :: sharper
      type(point_attempts_t), allocatable :: finer
      integer :: i

      do i = 1, max_refinements
         if (allocated(finer)) deallocate (finer)
         allocate (finer)
         associate (motion => self%motion)
            if (work_is_over() .or. .not. lacks_verdict(motion%system, motion%result)) exit
            sharper = motion%options
            sharper%may_integrate = .false.
            sharper%accuracy%tolerance = 10.0_wp**(-i)*motion%options%accuracy%tolerance
            finer%is_finer = .true.
            finer%motion%solver = motion%solver
            call limit_refinement(sharper, motion%solver%effort_t, share)
            finer%motion%start = motion%top
            call solve_by_levels(finer, motion%system, motion%discretisation, sharper)
            motion%solver%effort_t = finer%motion%solver%effort_t
            motion%result%work = finer%motion%solver%work
            if (allocated(finer%motion%error) .or. finer%motion%result%status /= outcome%converged) cycle
            if (finer%motion%result%stability%verdict == stability_verdict%unknown) cycle
            motion%result = finer%motion%result
            motion%top = finer%motion%top
         end associate
      end do
   end subroutine refine_for_verdict

   !> Solves the point without its neighbour: the branch, or the set, of the neighbour may not lead to the tolerance.
   recursive subroutine solve_without_neighbour(self)
      class(point_attempts_t), intent(inout) :: self
      type(options_t), target :: options
      logical :: is_adopted

      options = self%motion%options
      options%may_integrate = .false.
      options%start%from_integration = .false.
      call solve_alone(self, options, is_adopted)
   end subroutine solve_without_neighbour

   !> Solves the point from the end of a time integration: the branch of the smallest set may not lead to the tolerance.
   recursive subroutine solve_from_integration(self, rule)
      class(point_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule
      type(options_t), target :: options
      logical :: is_adopted

      options = self%motion%options
      options%may_integrate = .true.
      options%start%from_integration = .true.
      options%integration%max_evaluations = evaluations_of_guess(self%motion%system, self%motion%options, rule)
      call solve_alone(self, options, is_adopted)
      if (is_adopted) self%motion%result%fallback = rule%kind
   end subroutine solve_from_integration

   !> Refines the motion that time integration has led to by the balance; adopts a motion to the tolerance if it is the same one.
   recursive subroutine refine_lines(self, rule)
      class(point_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule
      type(options_t), target :: options
      type(point_attempts_t), allocatable :: finer

      allocate (finer)
      associate (motion => self%motion)
         options = motion%options
         options%may_integrate = .false.
         finer%motion%solver = motion%solver
         finer%motion%start = motion%top
         finer%is_finer = .true.
         call solve_by_levels(finer, motion%system, motion%discretisation, options)
         motion%solver%effort_t = finer%motion%solver%effort_t
         if (allocated(finer%motion%error) .or. finer%motion%result%status /= outcome%converged) return
         if (distance(motion%top, finer%motion%top, measure_of(motion%system), .false.) > &
             estimate_safety*(estimate_of(motion%result) + finer%motion%estimate)) return
         finer%motion%result%message = motion%result%message
         finer%motion%result%integration_work = motion%result%integration_work
         motion%result = finer%motion%result
         motion%result%fallback = rule%kind
         motion%top = finer%motion%top
         motion%estimate = finer%motion%estimate
      end associate
   end subroutine refine_lines

   !> Solves the point with other options and without its neighbour; adopts the motion if it has the smaller error.
   recursive subroutine solve_alone(self, options, is_adopted)
      class(point_attempts_t), intent(inout) :: self
      type(options_t), intent(in), target :: options
      logical, intent(out) :: is_adopted
      type(point_attempts_t), allocatable :: other

      is_adopted = .false.
      allocate (other)
      other%motion%solver = self%motion%solver
      call solve_by_levels(other, self%motion%system, self%motion%discretisation, options)
      self%motion%solver%effort_t = other%motion%solver%effort_t
      self%motion%result%effort_t = other%motion%solver%effort_t
      if (allocated(other%motion%error) .or. .not. allocated(other%motion%top%unknowns)) return
      if (other%motion%result%status /= outcome%converged .and. .not. other%motion%estimate < self%motion%estimate) return
      is_adopted = .true.
      self%motion%result = other%motion%result
      self%motion%top = other%motion%top
      self%motion%estimate = other%motion%estimate
   end subroutine solve_alone

   !> Integrates before any balance; `is_done` if that decides the point.
   subroutine integrate_before(self, is_done)
      type(refined_motion_t), intent(inout) :: self
      logical, intent(out) :: is_done

      associate (discretisation => self%discretisation, options => self%options, result => self%result)
         call integrate_to_tolerance(self%system, discretisation, options, result, is_done)
         self%top%discretisation_t = discretisation
         if (is_done) is_done = result%status /= outcome%truncated .or. options%primary_method == primary_method%integration
      end associate
   end subroutine integrate_before

   !> Integrates after the balance has found nothing, or an integrated motion.
   subroutine integrate_after(system, discretisation, options, result, is_done)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(inout) :: result
      logical, intent(out) :: is_done
      logical :: was_integrated

      was_integrated = is_integrated(result%status)
      call integrate_to_tolerance(system, discretisation, options, result, is_done)
      if (is_done .or. .not. (was_integrated .and. options%accuracy%grows_set)) return
      result%status = outcome%truncated
      result%error_estimate%truncation = 1.0_wp
   end subroutine integrate_after

   !> Searches for a limit cycle on a first set. Where this is far from the given start, a larger set is tried, since the one sought
   !> may not be a motion of few harmonics; its motion is adopted if it is much nearer.
   subroutine find_first_or_retain(self, rule, within)
      class(point_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule
      type(attempt_t), allocatable, intent(out) :: within(:)
      real(wp), parameter :: max_start_distance = 0.5_wp, max_distance_ratio = 0.5_wp ! of the start; of the distance before
      type(level_t) :: top
      type(motion_result_t) :: result
      real(wp) :: before

      associate (motion => self%motion)
         if (.not. self%has_left_start) then
            call find_first(motion, rule, within)
            if (rule%row == attempt_row%first_set .and. allocated(motion%top%unknowns) .and. &
                any(motion%system%tones%is_unknown) .and. self%conditions%grows_set) &
               self%has_left_start = distance_from_start(motion) > max_start_distance
            return
         end if
         self%has_left_start = .false.
         before = distance_from_start(motion)
         top = motion%top
         result = motion%result
         deallocate (motion%top%unknowns)
         call find_first(motion, rule, within)
         if (allocated(motion%top%unknowns)) then
            if (distance_from_start(motion) < max_distance_ratio*before) return
         end if
         if (allocated(motion%error)) deallocate (motion%error)
         call result%add(motion%result%effort_t)
         motion%top = top
         motion%result = result
      end associate
   end subroutine find_first_or_retain

   !> How far the amplitudes of a motion are from those of a given start of the oscillation, relative to these; 0 without one.
   real(wp) function distance_from_start(motion) result(distance)
      type(refined_motion_t), intent(in) :: motion
      type(amplitudes_t) :: start
      type(coordinates_t) :: coordinates
      complex(wp), allocatable :: given(:, :)                         ! (coordinates, n_harmonics)
      real(wp), allocatable :: u(:, :)
      real(wp) :: here, sum_of_differences, sum_of_given
      integer :: d, h, k

      distance = 0.0_wp
      start = motion%options%start%spectrum%in_set(motion%discretisation%harmonics)
      if (start%is_zero()) return
      coordinates = coordinates_of(motion%system)
      given = coordinates%amplitudes_of(start%whole())
      sum_of_differences = 0.0_wp
      sum_of_given = 0.0_wp
      associate (set => motion%top%harmonics, whole => motion%discretisation%harmonics)
         allocate (u(set%n_coefficients, size(given, 1)))
         u = reshape(motion%top%unknowns(:size(u)), shape(u))
         do k = 1, whole%n_harmonics
            h = set%index_of(whole%tuples(:, k))
            if (h == 0 .or. all(whole%tuples(:, k) == 0) .or. .not. any(abs(given(:, k)) > 0.0_wp)) cycle
            do d = 1, size(given, 1)
               here = abs(u(set%cos_at(h), d))
               if (set%sin_at(h) > 0) here = hypot(here, u(set%sin_at(h), d))
               sum_of_differences = sum_of_differences + (here - abs(given(d, k)))**2
               sum_of_given = sum_of_given + abs(given(d, k))**2
            end do
         end do
      end associate
      if (sum_of_given > 0.0_wp) distance = sqrt(sum_of_differences/sum_of_given)
   end function distance_from_start

   !> Searches for the motion on a small set: that of a neighbour, from its motion, or one of the boxes.
   subroutine find_first(self, rule, within)
      type(refined_motion_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule
      type(attempt_t), allocatable, intent(out) :: within(:)
      type(error_t), allocatable :: failure

      associate (system => self%system, discretisation => self%discretisation, options => self%options, top => self%top, &
                 result => self%result)
         if (rule%row == attempt_row%set_of_neighbour) then
            top = self%start
         else
            top%discretisation_t = discretisation
            if (rule%row == attempt_row%larger_first_set .or. rule%row == attempt_row%smaller_first_set) &
               call other_first(system, options, rule%row == attempt_row%larger_first_set, top, self%error)
            if (allocated(self%error)) return
            self%solver%level_options%may_integrate = options%may_integrate .and. &
               (options%start%from_integration .or. any(system%tones%is_unknown) .or. .not. options%accuracy%grows_set)
            if (rule%row == attempt_row%integrated_guess) then
               call find_from_integration(self, rule, within)
               return
            end if
         end if
         call self%solver%solve(top, .true., result, failure)
         self%solver%level_options%may_integrate = .false.
         if (allocated(result%attempts)) call move_alloc(result%attempts, within)
         result%work_spent = self%solver%work_spent
         if (allocated(top%unknowns) .or. has_ended(result)) return
         if (rule%row == attempt_row%set_of_neighbour) return       ! its error is none of the point
         if (allocated(failure)) call move_alloc(failure, self%error)
         result%harmonics = top%harmonics
         result%n_samples = top%torus%n_samples
      end associate
   end subroutine find_first

   !> Searches for a limit cycle on the first set from the end of a time integration; the report of the searches before remains if
   !> there is none.
   subroutine find_from_integration(self, rule, within)
      type(refined_motion_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule
      type(attempt_t), allocatable, intent(inout) :: within(:)
      type(error_t), allocatable :: failure
      type(motion_result_t) :: found

      associate (system => self%system, options => self%options)
         self%solver%level_options%integration%max_evaluations = evaluations_of_guess(system, options, rule)
         self%solver%level_options%start%from_integration = .true.
         call self%solver%solve(self%top, .true., found, failure)
         self%solver%level_options%start%from_integration = .false.
         self%solver%level_options%integration = options%integration
         self%solver%level_options%may_integrate = .false.
      end associate
      if (allocated(found%attempts)) call move_alloc(found%attempts, within)
      found%work_spent = self%solver%work_spent
      self%result%work_spent = found%work_spent
      if (.not. allocated(self%top%unknowns) .and. .not. has_ended(found)) return
      self%result = found
      self%result%fallback = rule%kind
   end subroutine find_from_integration

   !> Evaluations that the time integration of an attempt may use for a first guess.
   pure integer(int64) function evaluations_of_guess(system, options, rule) result(n)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(attempt_rule_t), intent(in) :: rule                        !! has a share of the work of all fallbacks
      real(wp) :: work
      integer :: i

      work = evaluation_work(system%structure%n_dofs, sum([(size(system%laws(i)%law%shape, 2), i=1, size(system%laws))]), &
                             .false.)
      n = affordable_evaluations(rule%share*options%solver%max_fallback_work, work)
   end function evaluations_of_guess

   !> Another lowest level, if the motion was not found on the first one: a larger or a smaller box.
   subroutine other_first(system, options, is_larger, level, error)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      logical, intent(in) :: is_larger
      type(level_t), intent(inout) :: level
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: loaded(:, :)
      integer :: order

      order = lowest_order(system%tones%n_tones)
      order = merge(order + (order + 1)/2, max(1, order - 2), is_larger)
      allocate (loaded, source=driven_tuples(system, options))
      call new_lowest_set(level%harmonics, system%tones%n_tones, loaded, error, order)
      if (.not. allocated(error)) call level%torus%resample(samples_for(level%harmonics%highest, degree_of(system)))
   end subroutine other_first
end module hb_accurate_motion
