!> A motion whose set and grid are refined, level by level, until its estimated error is below the tolerance.
!> The error estimate gives the amplitudes of the tuples that a set lacks and the effect of its grid: the set gains the important
!> tuples and loses the unimportant ones, the grid is refined, and each level starts from the solution of the level below. The
!> difference of two levels shows how accurate the estimate of the lower one was: if it was too small, the estimate of
!> the upper one is increased. This comparison never decreases an estimate, and its contribution is stored separately.
!> Source: docs/why/accuracy.md; nested iteration as in Hackbusch, Multi-Grid Methods and Applications (1985), chapter
!> 5.
module hb_refined_motion
   use hb_cancellation, only: note_level
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_level, only: choose_next, distance, estimate_of, estimate_of_motion, estimate_of_wanted, goal_share, is_rigid, level_t, &
      loaded_tuples, max_failures, min_goal, rigid_safety_factor, trim_for_neighbour, trim_set
   use hb_level_solver, only: level_solver_t, solver_tolerance
   use hb_level_stability, only: add_stability
   use hb_motion_result, only: effort_t, motion_result_t
   use hb_options, only: accuracy_t, options_t
   use hb_outcome, only: is_answer => is_solved, outcome, reason
   use hb_point_budget, only: point_budget_t
   use hb_refinement, only: refinable_t, refine, refinement_end
   use hb_stability, only: stability_method
   use hb_system, only: measure_of, system_t
   use hb_thresholds, only: max_reliable_error, small_share
   implicit none
   private
   public :: calibrate_outputs, estimate_by_levels, estimate_from_above, has_ended, least_work_of_next, left_after, refined_motion_t

   integer, parameter :: max_idle = 4                                 ! consecutive levels without improvement
   real(wp), parameter :: max_correction_ratio = 10.0_wp              ! of an estimate by that of the previous level

   !> The level solved last, the level it was compared with, the best level. The first level is solved before `refine_to_tolerance`:
   !> by its owner, into `top` and `result`.
   type, extends(refinable_t) :: refined_motion_t
      type(system_t), pointer :: system => null()
      type(discretisation_t), pointer :: discretisation => null()     !! as given
      type(options_t), pointer :: options => null()
      type(level_solver_t) :: solver                                  !! of all levels of the point
      type(level_t) :: start                                          !! of a neighbour; none if it has no unknowns
      type(level_t) :: top                                            !! solved last; none is solved if it has no unknowns
      type(motion_result_t) :: result                                 !! there
      integer, allocatable, private :: required(:, :)                 ! tuples of all levels, (n_tones, any)
      type(level_t), private :: next, best_top
      type(motion_result_t), private :: best
      real(wp), private :: own_estimate = 0.0_wp                      ! of the motion solved last, without other levels
      real(wp), allocatable, private :: own_outputs(:)                ! likewise, estimates of outputs
      real(wp), private :: difference = 0.0_wp                        ! of the last two motions, relative
      real(wp), private :: best_estimate = huge(1.0_wp)
      logical, private :: is_checked = .false.                        ! the level below agrees with its estimate
      logical, private :: is_ended = .false.                          ! by the time limit or by cancellation
   contains
      procedure :: begin => refined_motion_begin
      procedure :: refine_to_tolerance => refined_motion_refine
      procedure :: solve => refined_motion_solve
      procedure :: choose => refined_motion_choose
      procedure :: is_accurate => refined_motion_is_accurate
      procedure :: is_over => refined_motion_is_over
   end type refined_motion_t

contains

   !> Begins with no level: system, discretisation and options must exist as long as the motion is refined.
   subroutine refined_motion_begin(self, system, discretisation, options)
      class(refined_motion_t), intent(inout) :: self
      type(system_t), intent(in), target :: system
      type(discretisation_t), intent(in), target :: discretisation
      type(options_t), intent(in), target :: options

      self%system => system
      self%discretisation => discretisation
      self%options => options
      self%required = loaded_tuples(system)
      self%max_idle = max_idle
      self%max_failures = max_failures
      call self%solver%prepare(system, options)
   end subroutine refined_motion_begin

   !> Refines the motion from the first level to that of the tolerance, and completes its result.
   subroutine refined_motion_refine(self)
      class(refined_motion_t), intent(inout) :: self
      integer :: ending

      associate (options => self%options)
         call refine(self, ending)
         if (allocated(self%error) .or. .not. allocated(self%top%unknowns) .or. self%result%status == outcome%interrupted) return
         if (self%best_estimate < self%estimate) then                 ! a later level has made it worse, as far as known
            self%result = self%best
            self%top = self%best_top
            self%result%level_estimate = max(self%result%level_estimate, self%best_estimate)
         end if
         call finish(self, ending)
         if (.not. (options%accuracy%grows_set .and. options%chain%is_on .and. self%result%status == outcome%converged) .or. &
             size(options%gradient%by) > 0) return                     ! which is that of the whole set
         if (self%system%tones%n_tones == 1) then                     ! whose grids cost little
            call trim_set(self%system, options, self%required, small_share, self%top)
         else
            call trim_for_neighbour(self%system, options, self%required, self%result, self%top)
         end if
      end associate
   end subroutine refined_motion_refine

   !> Solves the level chosen last, starting from the present motion, and compares the two; the first one is solved already.
   subroutine refined_motion_solve(self, is_solved)
      class(refined_motion_t), intent(inout) :: self
      logical, intent(out) :: is_solved
      type(motion_result_t) :: trial
      type(error_t), allocatable :: failure

      is_solved = .true.
      if (self%n_levels == 0) then
         self%is_checked = allocated(self%start%unknowns) .and. self%solver%n_levels == 1   ! as that of the neighbour was
         self%own_estimate = estimate_of_motion(self%result)
         self%own_outputs = estimates_of_outputs(self%result)
      else
         call self%solver%solve(self%next, self%n_failures == max_failures - 1, trial, failure)
         is_solved = allocated(self%next%unknowns) .and. is_answer(trial%status) .and. .not. self%solver%is_out_of_work
         self%is_ended = has_ended(trial)
         if (trial%status == outcome%interrupted) self%result%status = outcome%interrupted
         if (.not. is_solved) return
         call compare(self, trial)
         self%top = self%next
         self%result = trial
      end if
      self%estimate = missing_in(self%options, self%result)
      associate (is_known => is_clear_impact(self%options, self%result))
         self%max_failures = merge(1, max_failures, is_known)
         self%max_idle = merge(1, max_idle, is_known)
      end associate
      call note_level(self%n_levels + 1, size(self%top%unknowns), self%estimate)
   end subroutine refined_motion_solve

   !> Whether a wall is struck so hard that no larger set can leave the limit of impacts: the status is known.
   pure logical function is_clear_impact(options, result)
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(in) :: result
      real(wp), parameter :: clear_impact_ratio = 10.0_wp             ! of the limit

      is_clear_impact = result%status == outcome%impact .and. result%error_estimate%impact > clear_impact_ratio* &
            options%error_estimate%impact
   end function is_clear_impact

   !> Compares the motion of the next level with the level below, which may increase its estimate, and stores the best
   !> level so far.
   subroutine compare(self, trial)
      type(refined_motion_t), intent(inout) :: self
      type(motion_result_t), intent(inout) :: trial                   !! on `next`
      real(wp) :: below, raw
      real(wp), allocatable :: outputs_raw(:)

      associate (system => self%system, top => self%top, next => self%next)
         self%difference = distance(top, next, measure_of(system), any(system%tones%is_unknown))
         self%is_checked = self%own_estimate < max_reliable_error
         raw = estimate_of_motion(trial)
         allocate (outputs_raw, source=estimates_of_outputs(trial))
         if (self%is_checked) &
            trial%level_estimate = max(trial%level_estimate, estimate_by_levels(raw, self%own_estimate, self%difference))
         if (is_rigid(system)) trial%level_estimate = max(trial%level_estimate, min(1.0_wp, &
            self%difference*left_after(top%harmonics%n_harmonics, next%harmonics%n_harmonics, system%tones%n_tones)))
         call calibrate_outputs(system, self%options, trial, next%harmonics, self%result, top%harmonics, self%own_outputs)
         below = estimate_from_above(self%estimate, self%difference, trial%level_estimate, is_rigid(system))
         if (self%is_checked .and. below < self%best_estimate .and. size(outputs_raw) == 0) then
            self%best = self%result
            self%best_top = top
            self%best_estimate = below
         end if
      end associate
      self%own_estimate = raw
      self%own_outputs = outputs_raw
   end subroutine compare

   subroutine refined_motion_choose(self, is_there)
      class(refined_motion_t), intent(inout) :: self
      logical, intent(out) :: is_there
      real(wp) :: goal

      associate (accuracy => self%options%accuracy, estimate => self%estimate)
         goal = max(min_goal*estimate, goal_share*accuracy%tolerance)
         if (estimate <= goal_share*accuracy%tolerance) goal = max(0.3_wp*estimate, min_goal*accuracy%tolerance)
         goal = goal*3.0_wp**self%n_failures*estimate_of(self%result)/max(estimate, tiny(1.0_wp))   ! of the motion
      end associate
      call choose_next(self%system, self%options, self%required, self%result, self%top, goal, self%n_failures, self%next)
      is_there = allocated(self%next%unknowns)
      if (.not. is_there .or. affords_next(self)) return
      is_there = .false.
      self%solver%is_out_of_work = .true.
   end subroutine refined_motion_choose

   !> Whether the next level may end within what is left of the work. The first level tells nothing about it, which has searched for
   !> its motion. Within the tolerance a level is begun for its margin alone, without the work of fallbacks.
   pure logical function affords_next(self)
      class(refined_motion_t), intent(in) :: self
      type(point_budget_t) :: budget
      real(wp) :: left

      affords_next = self%n_levels < 2 .or. self%n_failures > 0
      if (affords_next) return
      budget = self%solver%budget()
      left = budget%of_level(self%system, self%options, .false.)
      if (self%estimate <= self%options%accuracy%tolerance .and. self%is_checked) left = budget%margin%left()
      affords_next = left > least_work_of_next(self%result%work_spent, self%top%torus%n_samples, self%next%torus%n_samples)
   end function affords_next

   !> Work that a level takes at least, from that of the level below and the samples of both.
   pure real(wp) function least_work_of_next(work_below, samples_below, samples) result(work)
      real(wp), intent(in) :: work_below
      integer, intent(in) :: samples_below(:), samples(:)             !! (n_tones)
      real(wp), parameter :: min_ratio_of_levels = 0.5_wp ! .4 to 1.7 in 15 pairs of levels under two and three tones

      work = min_ratio_of_levels*work_below*max(1.0_wp, product(real(samples, wp)/samples_below))
   end function least_work_of_next

   !> An estimate far below the tolerance needs no second level.
   logical function refined_motion_is_accurate(self) result(is_accurate)
      class(refined_motion_t), intent(inout) :: self

      is_accurate = self%estimate <= self%options%accuracy%tolerance*merge(goal_share, small_share, self%is_checked)
   end function refined_motion_is_accurate

   !> A larger set does not reveal the restitution of walls that are struck. Within the tolerance a level is begun for its margin
   !> alone: no longer if all levels with their error estimates have taken the permitted work.
   logical function refined_motion_is_over(self) result(is_over)
      class(refined_motion_t), intent(inout) :: self
      type(point_budget_t) :: budget

      budget = self%solver%budget()
      associate (accuracy => self%options%accuracy)
         is_over = self%is_ended .or. .not. allocated(self%top%unknowns) .or. budget%levels%is_exhausted() .or. &
                   self%solver%is_out_of_work .or. self%options%lacks_impacts_of(self%system, self%result%status) .or. &
                   (self%result%status == outcome%impact .and. self%own_estimate <= goal_share*accuracy%tolerance) .or. &
                   (self%estimate <= accuracy%tolerance .and. self%is_checked .and. budget%margin%is_exhausted())
      end associate
   end function refined_motion_is_over

   !> Raises the estimates of a motion that no larger set confirms by as much as a comparison with one could have raised them.
   subroutine raise_unchecked(result)
      type(motion_result_t), intent(inout) :: result
      character(9) :: estimate

      write (estimate, "(es7.1)") estimate_of_wanted(result)
      result%message = "no larger set of harmonics has a motion near this one, which would check its estimated error of "// &
                       trim(estimate)
      result%level_estimate = max(result%level_estimate, min(1.0_wp, max_correction_ratio*estimate_of_motion(result)))
      if (allocated(result%output_estimate)) &
         result%output_level_estimate = max(result%output_level_estimate, min(1.0_wp, max_correction_ratio*result%output_estimate))
   end subroutine raise_unchecked

   !> Error of a level: the estimated error of the quantities to which the tolerance applies; a penetration of walls
   !> beyond the permitted one counts as an error above the limit of levels.
   pure real(wp) function missing_in(options, result)
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(in) :: result

      missing_in = max(estimate_of_wanted(result), goal_share*options%accuracy%tolerance*result%penetration_share)
   end function missing_in

   !> Estimated error of a level according to the level below. The error of the motion of that level was the
   !> difference of the two: if its error estimate was less, the estimate of the upper level is increased by the
   !> same factor.
   pure real(wp) function estimate_by_levels(estimate, estimate_below, difference)
      real(wp), intent(in) :: estimate, estimate_below                !! of the two levels, from their own motions alone
      real(wp), intent(in) :: difference                              !! of their motions, relative

      estimate_by_levels = min(1.0_wp, estimate*max(1.0_wp, min(difference/max(estimate_below, tiny(1.0_wp)), &
            max_correction_ratio)))
   end function estimate_by_levels

   !> Estimated error of a level according to the level above: at least the difference of the two. Under rigid laws errors fall so
   !> slowly that the estimate of a level comes from differences, and what it is above, it was not less below.
   pure real(wp) function estimate_from_above(estimate, difference, estimate_above, is_rigid) result(below)
      real(wp), intent(in) :: estimate                                !! of the level so far
      real(wp), intent(in) :: difference                              !! of the two motions, relative
      real(wp), intent(in) :: estimate_above                          !! of the upper level, from the difference
      logical, intent(in) :: is_rigid                                 !! a law is rigid

      below = max(estimate, difference)
      if (is_rigid) below = max(below, estimate_above)
   end function estimate_from_above

   pure function estimates_of_outputs(result) result(estimates)
      type(motion_result_t), intent(in) :: result
      real(wp), allocatable :: estimates(:)

      allocate (estimates(0))
      if (allocated(result%output_estimate)) estimates = result%output_estimate
   end function estimates_of_outputs

   !> Finds the estimates of outputs that the levels show, as `estimate_by_levels`, each from its own difference.
   subroutine calibrate_outputs(system, options, upper, upper_set, lower, lower_set, estimates_below)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(inout) :: upper
      type(motion_result_t), intent(in) :: lower
      type(harmonics_t), intent(in) :: upper_set, lower_set
      real(wp), intent(in) :: estimates_below(:)                      !! of the lower level, from its error estimate
      complex(wp), allocatable :: below(:, :), above(:, :)
      real(wp) :: difference, left
      integer :: i

      if (.not. (allocated(upper%outputs) .and. allocated(lower%outputs))) return
      below = lower%outputs
      above = upper%outputs
      if (any(system%tones%is_unknown)) then                          ! phases are free
         below = abs(below)
         above = abs(above)
      end if
      left = 0.0_wp
      if (is_rigid(system)) left = left_after(lower_set%n_harmonics, upper_set%n_harmonics, system%tones%n_tones)
      do i = 1, size(estimates_below)
         difference = options%accuracy%outputs(i)%distance(lower_set, below(:, i), upper_set, above(:, i))
         associate (estimate => upper%output_estimate(i), by_levels => upper%output_level_estimate(i))
            if (estimates_below(i) < max_reliable_error) &
               by_levels = max(by_levels, estimate_by_levels(estimate, estimates_below(i), difference))
            by_levels = min(1.0_wp, max(by_levels, left*difference))
         end associate
      end do
   end subroutine calibrate_outputs

   !> Error that remains after a level, relative to its difference from the level below, if the error decreases only
   !> with the first power of the order: forces of rigid laws have all harmonics. For two sets of similar size there
   !> is only a bound.
   pure real(wp) function left_after(n_below, n_above, n_tones) result(share)
      integer, intent(in) :: n_below, n_above                         !! tuples of the two levels
      integer, intent(in) :: n_tones
      real(wp) :: shrinking

      shrinking = (real(n_below, wp)/n_above)**(1.0_wp/n_tones)
      share = rigid_safety_factor
      if (shrinking < 1.0_wp) share = min(share, shrinking/(1.0_wp - shrinking))
   end function left_after

   !> Sets status and estimates of the last level, and adds the results that were omitted on the levels.
   subroutine finish(self, ending)
      type(refined_motion_t), intent(inout) :: self
      integer, intent(in) :: ending                                   !! of the refinement
      logical :: compares

      associate (options => self%options, result => self%result)
         if (any(result%status == [outcome%converged, outcome%truncated, outcome%aliased])) then
            if (ending == refinement_end%failed .and. .not. self%is_checked .and. &
                estimate_of_wanted(result) <= options%accuracy%tolerance) call raise_unchecked(result)
            result%status = merge(outcome%converged, outcome%truncated, estimate_of_wanted(result) <= options%accuracy%tolerance)
            if (result%status == outcome%truncated) result%reason = why_truncated(self, ending)
         end if
         compares = compares_in_time(self)
         if (options%stability%method /= stability_method%off .or. size(options%output%samples) > 0 .or. compares) &
            call add_stability(self%system, self%options, self%top, solver_tolerance(self%options), &
                               self%solver%work_spent, compares, result)
         if (result%reason == reason%tolerance .and. .not. allocated(result%message) .and. &
               estimate_of_wanted(result) < small_share) &
            result%message = trim(message_on_tolerance(estimate_of_wanted(result)))
         if (result%status == outcome%truncated .and. allocated(result%output_estimate)) &
            result%message = trim(message_on_outputs(options%accuracy, max(result%output_estimate, result%output_level_estimate)))
         result%harmonics = self%top%harmonics
         result%n_samples = self%top%torus%n_samples
         result%level_difference = self%difference
         if (result%level_estimate <= estimate_of_motion(result)) result%level_estimate = 0.0_wp
         if (allocated(result%output_estimate)) then
            where (result%output_level_estimate <= result%output_estimate) result%output_level_estimate = 0.0_wp
         end if
         result%effort_t = self%solver%effort_t
      end associate
   end subroutine finish

   !> Why the levels have ended above the tolerance: for want of work, of sets, or because larger ones are no better.
   integer function why_truncated(self, ending) result(why)
      type(refined_motion_t), intent(inout) :: self
      integer, intent(in) :: ending                                   !! of the refinement

      why = reason%tolerance
      if (ending == refinement_end%exhausted .and. self%n_levels < self%max_levels) why = reason%max_harmonics
      if (ending == refinement_end%stopped .or. self%solver%is_out_of_work) why = reason%max_work
      if (self%is_ended) why = reason%time_limit
   end function why_truncated

   !> Whether a converged motion is compared with a short time integration, because error estimates see no jumps.
   logical function compares_in_time(self) result(compares)
      class(refined_motion_t), intent(in) :: self

      compares = self%result%status == outcome%converged .and. self%options%has_time_domain() .and. &
                 self%options%error_estimate%is_on .and. self%system%may_jump_within_period()
   end function compares_in_time

   !> Names the tolerance that can be met.
   pure function message_on_tolerance(estimate) result(message)
      real(wp), intent(in) :: estimate
      character(100) :: message
      character(9) :: tolerance

      write (tolerance, "(es7.1)") 1.05_wp*estimate                   ! not rounded to less
      message = "larger sets of harmonics bring no gain: accuracy%tolerance = "//trim(tolerance)//" can be met"
   end function message_on_tolerance

   !> Names the least accurate output.
   function message_on_outputs(accuracy, estimates) result(message)
      type(accuracy_t), intent(in) :: accuracy
      real(wp), intent(in) :: estimates(:)
      character(200) :: message
      character(9) :: estimate, tolerance

      write (estimate, "(es7.1)") maxval(estimates)
      write (tolerance, "(es7.1)") accuracy%tolerance
      message = "the error of '"//accuracy%outputs(maxloc(estimates, dim=1))%name//"' is estimated as "//trim(estimate)// &
                ", the tolerance is "//trim(tolerance)
   end function message_on_outputs

   !> Whether the point has ended.
   pure logical function has_ended(result)
      type(motion_result_t), intent(in) :: result

      has_ended = any(result%status == [outcome%interrupted, outcome%timed_out])
   end function has_ended
end module hb_refined_motion
