!> The motion of a scene to an accuracy: sets of harmonics and grids grow, rung by rung, until the estimated error is below the
!> tolerance.
!>
!> The lowest rung is a small box, where the motion is found by whatever it takes. From there the certificate tells what the
!> tuples carry that a set lacks, and what its grid does to the motion: the set takes those that matter and drops those that
!> do not, the grid is refined, and each rung starts from the solution of the one below it. How far two rungs are apart shows
!> what the estimate of the lower one was worth: where it was too small, that of the upper one counts for more. Nothing of this way
!> lowers an estimate, and what it adds is stored by itself. Source: docs/why/accuracy.md;
!> nested iteration as in Hackbusch, Multi-Grid Methods and Applications (1985), chapter 5.
module hb_accurate_motion
   use hb_error, only: error_t
   use hb_first_way, only: first_way
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_march_to_tolerance, only: loaded_tuples, march_from_balance, march_to_tolerance, marches_first
   use hb_marched_result, only: is_lost
   use hb_motion, only: solve_motion
   use hb_motion_description, only: allow_for_growth, compare_with_refined
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: is_solved, outcome
   use hb_rung, only: choose_next, degree_of, distance, estimate_of, estimate_of_motion, estimate_of_wanted, idle, is_rigid, &
      least_goal, margin, most_failures, put_on_rung, reliable, rung_t, trim_set, with_caution
   use hb_scene, only: accuracy_t, scene_t
   use hb_stability, only: stability_method, stability_verdict => verdict
   use hb_torus, only: samples_for
   use hb_tuple_choice, only: lowest_order, new_lowest_set
   use hb_watch, only: watch_t, work_is_over
   implicit none
   private
   public :: calibrate_outputs, estimate_by_levels, gains_nothing, left_after, solve_to_tolerance

   integer, parameter :: most_rungs = 24
   integer, parameter :: most_idle = 4                                ! rungs one after the other that gain nothing
   real(wp), parameter :: unchecked = 0.1_wp                          ! of the tolerance: an estimate that needs no second rung
   real(wp), parameter :: share_of_rescue = 0.2_wp                    ! of the work of rescues, for each rung but the first
   real(wp), parameter :: work_of_stability = 1.5_wp                  ! at most, times that of all rungs
   integer, parameter :: laps_of_verdict = 25                         ! for exponents, where they are far from zero
   integer, parameter :: patience_with_products = 16                  ! until the preconditioner gets stronger: rungs are many
   real(wp), parameter :: share_of_residual = 1.0e-4_wp               ! of the tolerance: where equations are solved well enough
   integer, parameter :: most_refinements = 2                         ! for a verdict on stability
   real(wp), parameter :: clear_change = 1.0e-4_wp                    ! of multipliers by the errors of the motion
   real(wp), parameter :: work_of_verdict = 4.0_wp                    ! beyond which no rung is begun, times that so far
   real(wp), parameter :: least_work_of_verdict = 5.0e7_wp
   integer, parameter :: patience = 3                                 ! steps from the rung below that gain nothing
   real(wp), parameter :: largest_correction = 10.0_wp                ! of an estimate by the one of the rung before

   !> What is spent on all rungs.
   type :: account_t
      integer :: iterations = 0, evaluations = 0, n_rungs = 0, rescue = 0
      real(wp) :: work = 0.0_wp, work_beside = 0.0_wp                 ! as in a result
      real(wp) :: setup_seconds = 0.0_wp, solver_seconds = 0.0_wp, certificate_seconds = 0.0_wp, certificate_cpu_seconds = 0.0_wp
   end type account_t

contains

   !> Solves a scene to the tolerance that it asks for. The result has the set of its own, and status `converged` where the
   !> estimated error is below the tolerance, `truncated` where the budget came first; a motion that was not found at all has the
   !> status of the attempt on the lowest rung.
   subroutine solve_to_tolerance(scene, result, error, top, start)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(rung_t), intent(out) :: top                                !! the last rung; without unknowns where none is solved
      type(rung_t), intent(in), optional :: start                     !! of a neighbour
      type(watch_t), target :: watch
      type(account_t) :: account
      integer :: i

      call watch%enter(scene%solver%time_limit)
      call climb(scene, account, result, error, top, start)
      do i = 1, merge(most_refinements, 0, scene%accuracy%grows_set .and. .not. allocated(error))
         if (work_is_over() .or. .not. is_denied(scene, result)) exit
         call refine_for_verdict(scene, 10.0_wp**(-i), account, result, top)
      end do
      call watch%leave()
   end subroutine solve_to_tolerance

   !> Whether the errors of the motion leave open whether it is stable: they move its largest multiplier as far as the unit circle
   !> or, of several tones under laws with kinks, its largest exponent to zero, or it has no periodic motion next to it.
   pure logical function is_denied(scene, result)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(in) :: result
      real(wp), parameter :: twice = 2.0_wp
      real(wp) :: unit
      integer :: i

      is_denied = .false.
      if (result%status /= outcome%converged) return
      associate (found => result%stability)
         if (.not. allocated(found%multipliers)) then
            unit = 1.0_wp
            if (size(result%frequency) > 1) unit = minval(result%frequency)
            is_denied = found%verdict == stability_verdict%unknown .and. found%estimate > clear_change*unit .and. &
               any([(scene%laws(i)%law%n_switches + scene%laws(i)%law%n_states > 0, i=1, size(scene%laws))])
            return
         end if
         is_denied = found%estimate > clear_change .and. (found%verdict == stability_verdict%unknown .or. &
                     (found%verdict == stability_verdict%unstable .and. abs(found%multipliers(1)) - 1.0_wp < twice*found%estimate))
      end associate
   end function is_denied

   !> Climbs on to a part of the tolerance for the sake of a verdict on stability, as far as `work_of_verdict` goes; without one the
   !> motion stays as it is.
   subroutine refine_for_verdict(scene, part, account, result, top)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: part                                    !! of the tolerance
      type(account_t), intent(inout) :: account
      type(motion_result_t), intent(inout) :: result
      type(rung_t), intent(inout) :: top
      type(scene_t) :: sharper
      type(motion_result_t) :: finer
      type(rung_t) :: finer_top
      type(error_t), allocatable :: trouble

      sharper = scene
      sharper%may_integrate = .false.
      sharper%accuracy%tolerance = part*scene%accuracy%tolerance
      sharper%accuracy%max_work = min(scene%accuracy%max_work, max(least_work_of_verdict, work_of_verdict*account%work))
      call climb(sharper, account, finer, trouble, finer_top, top)
      result%work = account%work
      if (allocated(trouble) .or. finer%status /= outcome%converged) return
      if (finer%stability%verdict == stability_verdict%unknown) return
      result = finer
      top = finer_top
   end subroutine refine_for_verdict

   !> One ladder, from the first rung to that of the tolerance.
   subroutine climb(scene, account, result, error, top, start)
      type(scene_t), intent(in) :: scene
      type(account_t), intent(inout) :: account                       !! of all ladders of the point
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(rung_t), intent(out) :: top                                !! as of `solve_to_tolerance`
      type(rung_t), intent(in), optional :: start
      type(scene_t) :: here                                           ! the scene on the set of a rung
      type(rung_t) :: best_top, next
      type(motion_result_t) :: best, trial
      type(error_t), allocatable :: trouble
      real(wp) :: before, best_estimate, difference, estimate, goal, raw
      real(wp), allocatable :: outputs_before(:), outputs_raw(:)      ! estimates of outputs
      real(wp), allocatable :: estimates(:)                           ! of all rungs so far
      integer :: n_failures, rung
      logical :: has_start, is_checked, is_done, is_there

      has_start = .false.
      if (present(start)) has_start = allocated(start%unknowns)
      if (scene%has_time_domain() .and. .not. has_start) then
         if (marches_first(scene)) then
            call march_to_tolerance(scene, result, is_done)
            top%set = scene%harmonics
            top%n_samples = scene%torus%n_samples
            if (is_done .and. (result%status /= outcome%truncated .or. scene%first_way == first_way%march)) return
         end if
      end if
      here = scene
      here%first_way = first_way%balance
      here%may_integrate = .false.
      here%certificate%is_on = .true.
      here%stability%method = stability_method%off
      here%solver%tolerance = solver_tolerance(scene)
      here%certificate%improvement_steps = 0
      if (allocated(here%output%samples)) here%output%samples = here%output%samples(:0)
      call find_first(here, scene, result, error, top, start, account)
      here%may_integrate = .false.
      if (.not. allocated(error) .and. scene%has_time_domain()) call march_lost(scene, result)
      if (allocated(error) .or. .not. allocated(top%unknowns)) return
      is_checked = .false.
      if (present(start)) is_checked = allocated(start%unknowns) .and. account%n_rungs == 1 ! as the neighbour was
      best_estimate = huge(1.0_wp)
      before = estimate_of_motion(result)
      outputs_before = estimates_of_outputs(result)
      n_failures = 0
      estimates = [missing_in(scene, result)]
      difference = 0.0_wp
      do rung = 1, most_rungs
         estimate = missing_in(scene, result)
         if (estimate <= scene%accuracy%tolerance*merge(margin, unchecked, is_checked)) exit
         if (account%work > scene%accuracy%max_work .or. gains_nothing(estimates)) exit
         goal = max(least_goal*estimate, margin*scene%accuracy%tolerance)
         if (estimate <= margin*scene%accuracy%tolerance) goal = max(0.3_wp*estimate, least_goal*scene%accuracy%tolerance)
         goal = goal*3.0_wp**n_failures*estimate_of(result)/max(estimate, tiny(1.0_wp))   ! of the motion
         call choose_next(scene, result, top, goal, n_failures, next, is_there)
         if (.not. is_there) exit
         call take(here, scene, next, next%unknowns, n_failures == most_failures - 1, account, trial, trouble)
         if (trial%status == outcome%interrupted) then
            result%status = outcome%interrupted
            return
         end if
         if (.not. (allocated(next%unknowns) .and. is_solved(trial%status))) then
            n_failures = n_failures + 1
            if (n_failures == most_failures .or. trial%status == outcome%timed_out) exit
            cycle
         end if
         difference = distance(top, next, any(scene%tones%is_unknown))
         is_checked = before < reliable
         raw = estimate_of_motion(trial)
         outputs_raw = estimates_of_outputs(trial)
         if (is_checked) trial%level_estimate = max(trial%level_estimate, estimate_by_levels(raw, before, difference))
         if (is_rigid(scene)) trial%level_estimate = max(trial%level_estimate, min(1.0_wp, &
            difference*left_after(top%set%n_harmonics, next%set%n_harmonics, scene%tones%n_tones)))
         call calibrate_outputs(scene, trial, next%set, result, top%set, outputs_before)
         before = raw
         outputs_before = outputs_raw
         if (is_checked .and. max(estimate, difference) < best_estimate .and. size(outputs_raw) == 0) then
            best = result
            best_top = top
            best_estimate = max(estimate, difference)
         end if
         n_failures = 0
         estimates = [estimates, missing_in(scene, trial)]
         top = next
         result = trial
      end do
      if (best_estimate < missing_in(scene, result)) then !  what came after it made it worse, as far as one knows
         result = best
         top = best_top
         result%level_estimate = max(result%level_estimate, best_estimate)
      end if
      call finish(scene, result, top, account, difference)
      if (result%status == outcome%truncated .and. scene%has_time_domain() .and. result%stability%growth <= 1.0_wp) &
         call march_from_balance(scene, result, top)
      if (scene%accuracy%grows_set .and. scene%chain%is_on .and. result%status == outcome%converged) call trim_set(scene, top)
   end subroutine climb

   !> What a rung misses: the estimated error of what the tolerance is for, and a penetration of walls beyond what is allowed as an
   !> error beyond what rungs are made for.
   pure real(wp) function missing_in(scene, result)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(in) :: result

      missing_in = max(estimate_of_wanted(result), margin*scene%accuracy%tolerance*result%penetration_share)
   end function missing_in

   !> Marches to the tolerance what was marched on the lowest set, of whose harmonics beyond averages say nothing, and what was not
   !> found at all: lines that averages do not part, or only in hours, a fit may.
   subroutine march_lost(scene, result)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(inout) :: result
      logical :: is_done, is_marched

      is_marched = any(result%status == [outcome%marched, outcome%several])
      if (.not. is_marched) then
         if (.not. (is_lost(result%status) .and. scene%solver%rescue .and. scene%solver%rescue_by_march)) return
      end if
      call march_to_tolerance(scene, result, is_done)
      if (is_done .or. .not. (is_marched .and. scene%accuracy%grows_set)) return
      result%status = outcome%truncated
      result%certificate%truncation = 1.0_wp
   end subroutine march_lost

   !> Whether rungs have gained nothing for so long that none will: each of the last ones leaves nearly all of the estimate
   !> before it.
   pure logical function gains_nothing(estimates)
      real(wp), intent(in) :: estimates(:)                            !! of the errors of all rungs, in their order

      associate (n => size(estimates))
         gains_nothing = n > most_idle
         if (gains_nothing) gains_nothing = all(estimates(n - most_idle + 1:) > idle*estimates(n - most_idle:n - 1))
      end associate
   end function gains_nothing

   !> Estimated error of a level as the one below shows it. Its motion was off by the difference of the two: where its certificate
   !> said less than that, the one of the upper level counts for more by as much.
   pure real(wp) function estimate_by_levels(estimate, estimate_below, difference)
      real(wp), intent(in) :: estimate, estimate_below                !! of the two levels, by their motions alone
      real(wp), intent(in) :: difference                              !! of their motions, relative

      estimate_by_levels = min(1.0_wp, estimate*max(1.0_wp, min(difference/max(estimate_below, tiny(1.0_wp)), largest_correction)))
   end function estimate_by_levels

   pure function estimates_of_outputs(result) result(estimates)
      type(motion_result_t), intent(in) :: result
      real(wp), allocatable :: estimates(:)

      allocate (estimates(0))
      if (allocated(result%output_estimate)) estimates = result%output_estimate
   end function estimates_of_outputs

   !> Finds the estimates of outputs that the levels show, as `estimate_by_levels` does, each by its own difference.
   subroutine calibrate_outputs(scene, upper, upper_set, lower, lower_set, estimates_below)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(inout) :: upper
      type(motion_result_t), intent(in) :: lower
      type(harmonics_t), intent(in) :: upper_set, lower_set
      real(wp), intent(in) :: estimates_below(:)                      !! of the lower rung, as its certificate had them
      complex(wp), allocatable :: below(:, :), above(:, :)
      real(wp) :: difference, left
      integer :: i

      if (.not. (allocated(upper%outputs) .and. allocated(lower%outputs))) return
      below = lower%outputs
      above = upper%outputs
      if (any(scene%tones%is_unknown)) then                           ! phases are free
         below = abs(below)
         above = abs(above)
      end if
      left = 0.0_wp
      if (is_rigid(scene)) left = left_after(lower_set%n_harmonics, upper_set%n_harmonics, scene%tones%n_tones)
      do i = 1, size(estimates_below)
         difference = scene%accuracy%outputs(i)%distance(lower_set, below(:, i), upper_set, above(:, i))
         associate (estimate => upper%output_estimate(i), by_levels => upper%output_level_estimate(i))
            if (estimates_below(i) < reliable) &
               by_levels = max(by_levels, estimate_by_levels(estimate, estimates_below(i), difference))
            by_levels = min(1.0_wp, max(by_levels, left*difference))
         end associate
      end do
   end subroutine calibrate_outputs

   !> What is left of the error after a rung, relative to the difference that it made, where the error falls with the first power of
   !> the order only: forces of rigid laws have all harmonics. Of two sets of about one size nothing is concluded beyond a bound.
   pure real(wp) function left_after(n_below, n_above, n_tones) result(share)
      integer, intent(in) :: n_below, n_above                         !! tuples of the two rungs
      integer, intent(in) :: n_tones
      real(wp), parameter :: largest_share = 2.0_wp
      real(wp) :: shrinking

      shrinking = (real(n_below, wp)/n_above)**(1.0_wp/n_tones)
      share = largest_share
      if (shrinking < 1.0_wp) share = min(share, shrinking/(1.0_wp - shrinking))
   end function left_after

   !> Finds the motion on a small set: on that of a neighbour from its motion, or on the first box, or on others.
   subroutine find_first(here, scene, result, error, top, start, account)
      type(scene_t), intent(inout) :: here
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(rung_t), intent(inout) :: top
      type(rung_t), intent(in), optional :: start
      type(account_t), intent(inout) :: account
      integer, parameter :: n_tries = 3
      real(wp), allocatable :: none(:)
      type(error_t), allocatable :: trouble
      integer :: i

      if (present(start)) then
         if (allocated(start%unknowns)) then
            top = start
            call take(here, scene, top, start%unknowns, .true., account, result, trouble)
            if (is_over(result) .or. allocated(top%unknowns)) return
         end if
      end if
      do i = 1, n_tries
         top%set = scene%harmonics
         top%n_samples = scene%torus%n_samples
         if (i > 1) then
            if (.not. scene%accuracy%grows_set) exit
            if (i < n_tries .and. account%work > scene%accuracy%max_work) cycle
            call other_first(scene, i, top, error)
            if (allocated(error)) return
         end if
         here%may_integrate = scene%may_integrate .and. (scene%start_from_march .or. any(scene%tones%is_unknown) .or. &
                                                         .not. scene%accuracy%grows_set)
         call take(here, scene, top, none, .true., account, result, error)
         if (allocated(error) .or. is_over(result) .or. allocated(top%unknowns)) return
         if (any(result%status == [outcome%collapsed, outcome%no_motion, outcome%locked, outcome%failed])) exit
         if (size(scene%laws) == 0) exit
      end do
      result%harmonics = top%set
      result%n_samples = top%n_samples
   end subroutine find_first

   !> Residual at which the equations of a rung are solved: far below what its motion may be off by, unless one was asked for.
   pure real(wp) function solver_tolerance(scene) result(tolerance)
      type(scene_t), intent(in) :: scene

      tolerance = scene%solver%tolerance
      if (.not. scene%solver%has_tolerance) tolerance = max(tolerance, share_of_residual*scene%accuracy%tolerance)
   end function solver_tolerance

   !> Whether the point has ended.
   pure logical function is_over(result)
      type(motion_result_t), intent(in) :: result

      is_over = any(result%status == [outcome%interrupted, outcome%timed_out])
   end function is_over

   !> Another lowest rung, where the motion was not found on the first one: a larger box, then a smaller one.
   subroutine other_first(scene, i, rung, error)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: i                                        !! number of the try, from 2
      type(rung_t), intent(inout) :: rung
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: loaded(:, :)
      integer :: order

      order = lowest_order(scene%tones%n_tones)
      order = merge(order + (order + 1)/2, max(1, order - 2), i == 2)
      loaded = loaded_tuples(scene)
      call new_lowest_set(rung%set, scene%tones%n_tones, loaded, error, order)
      if (.not. allocated(error)) rung%n_samples = samples_for(rung%set%highest, degree_of(scene))
   end subroutine other_first

   !> Solves the scene on a rung, from a first guess if there is one. Its unknowns are allocated afterwards where that has worked.
   subroutine take(here, scene, rung, guess, with_rescue, account, result, error)
      type(scene_t), intent(inout) :: here                            !! on any set
      type(scene_t), intent(in) :: scene
      type(rung_t), intent(inout) :: rung
      real(wp), allocatable, intent(in) :: guess(:)
      logical, intent(in) :: with_rescue
      type(account_t), intent(inout) :: account
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: first_guess(:), found(:)

      if (allocated(guess)) first_guess = guess
      if (allocated(rung%unknowns)) deallocate (rung%unknowns)
      call put_on_rung(here, scene, rung, error)
      if (allocated(error)) return
      here%solver%rescue = scene%solver%rescue .and. with_rescue
      here%solver%patience = merge(0, patience, with_rescue)
      here%solver%krylov_patience = patience_with_products
      here%solver%rescue_work = min(scene%solver%rescue_work, max(0.0_wp, scene%accuracy%max_work - account%work))
      if (account%n_rungs > 0) here%solver%rescue_work = share_of_rescue*here%solver%rescue_work
      here%solver%rescue_share = 0.0_wp                               ! other sets are left
      call solve_motion(here, result, error, first_guess, found)
      account%n_rungs = account%n_rungs + 1
      account%iterations = account%iterations + result%iterations
      account%evaluations = account%evaluations + result%evaluations
      account%work = account%work + result%work
      account%work_beside = account%work_beside + result%work_beside
      here%solver%preconditioner_level = result%preconditioner_level
      account%rescue = max(account%rescue, result%rescue)
      account%setup_seconds = account%setup_seconds + result%setup_seconds
      account%solver_seconds = account%solver_seconds + result%solver_seconds
      account%certificate_seconds = account%certificate_seconds + result%certificate_seconds
      account%certificate_cpu_seconds = account%certificate_cpu_seconds + result%certificate_cpu_seconds
      if (allocated(error)) return
      call with_caution(scene, result)
      if (is_solved(result%status) .and. allocated(found)) call move_alloc(found, rung%unknowns)
   end subroutine take

   !> Settles status and estimates of the last rung, and adds what the other rungs went without.
   subroutine finish(scene, result, top, account, difference)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(inout) :: result
      type(rung_t), intent(in) :: top
      type(account_t), intent(in) :: account
      real(wp), intent(in) :: difference
      type(scene_t) :: here
      type(motion_result_t) :: whole
      type(error_t), allocatable :: error

      if (any(result%status == [outcome%converged, outcome%truncated, outcome%aliased])) &
         result%status = merge(outcome%converged, outcome%truncated, estimate_of_wanted(result) <= scene%accuracy%tolerance)
      if (scene%stability%method /= stability_method%off .or. size(scene%output%samples) > 0) then
         here = scene
         here%may_integrate = .false.
         here%certificate%is_on = .false.
         here%solver%tolerance = solver_tolerance(scene)
         here%stability%work_spent = work_of_stability*(account%work + account%work_beside)
         if (here%stability%method == stability_method%auto) here%stability%fewest_laps = laps_of_verdict
         call put_on_rung(here, scene, top, error)
         if (.not. allocated(error)) call solve_motion(here, whole, error, top%unknowns)
         if (.not. allocated(error) .and. whole%status == outcome%converged) then
            if (result%status == outcome%converged) then
               result%stability = whole%stability
               here%tones%omega = result%frequency
               call compare_with_refined(here, here%tones, result%certificate, result%stability)
               call allow_for_growth(result, scene%accuracy%tolerance)
            end if
            if (allocated(whole%displacement_samples)) then
               result%displacement_samples = whole%displacement_samples
               result%force_samples = whole%force_samples
               result%corrected_samples = whole%corrected_samples
            end if
         end if
      end if
      if (result%status == outcome%truncated .and. allocated(result%output_estimate)) &
         result%message = trim(message_on_outputs(scene%accuracy, max(result%output_estimate, result%output_level_estimate)))
      result%harmonics = top%set
      result%n_samples = top%n_samples
      result%n_rungs = account%n_rungs
      result%rung_difference = difference
      if (result%level_estimate <= estimate_of_motion(result)) result%level_estimate = 0.0_wp
      if (allocated(result%output_estimate)) then
         where (result%output_level_estimate <= result%output_estimate) result%output_level_estimate = 0.0_wp
      end if
      result%iterations = account%iterations
      result%evaluations = account%evaluations
      result%work = account%work
      result%work_beside = account%work_beside
      result%rescue = account%rescue
      result%setup_seconds = account%setup_seconds
      result%solver_seconds = account%solver_seconds
      result%certificate_seconds = account%certificate_seconds
      result%certificate_cpu_seconds = account%certificate_cpu_seconds
   end subroutine finish

   !> Names the output that is known least.
   function message_on_outputs(accuracy, estimates) result(message)
      type(accuracy_t), intent(in) :: accuracy
      real(wp), intent(in) :: estimates(:)
      character(200) :: message
      character(9) :: estimate, tolerance

      write (estimate, "(es7.1)") maxval(estimates)
      write (tolerance, "(es7.1)") accuracy%tolerance
      message = "the error of '"//accuracy%outputs(maxloc(estimates, dim=1))%name//"' is estimated as "//trim(estimate)// &
                ", asked for was "//trim(tolerance)
   end function message_on_outputs
end module hb_accurate_motion
