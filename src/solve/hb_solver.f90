!> Solves a problem by the attempts of `hb_attempts`: directly, from smaller problems, by homotopies.
!>
!> A homotopy continues the solution of an easy problem to the given one by arc length, around folds if necessary: the nonlinearity
!> (or the load) is multiplied by a factor from 0 to 1, which is an additional unknown of a curve. Source: docs/why/theory.md,
!> section 6.4.
module hb_solver
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_attempts, only: attempt_rule_t, attempts_t, make_attempts, solver_conditions_t, stage, starting_point, technique
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_broyden, only: solve_broyden
   use hb_budget, only: budget_t
   use hb_cancellation, only: work_is_over
   use hb_curve, only: curve_config_t, curve_t, new_curve
   use hb_kinds, only: wp
   use hb_krylov, only: solve_krylov
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_problem, only: deformation, problem_t
   use hb_solver_types, only: attempt_t, fallback, largest_affordable, method, report_t, solver_config_t
   implicit none
   private
   public :: solve, solve_by_homotopy

   type(curve_config_t), parameter :: steps = curve_config_t(little=2.0_wp)   ! each sample that enters contact is a kink
   real(wp), parameter :: curve_tolerance = 1.0e-4_wp                 ! of the residual along the curve: kinks prevent smaller ones
   integer, parameter :: max_corrections = 8

   real(wp), parameter :: share_outside_domain = 0.05_wp              ! of the budget, where there may be no solution
   integer, parameter :: easy_iterations = 2                          ! of a problem that is almost linear
   real(wp), parameter :: largest_level = 2.4_wp                      ! ratio of one problem to the next larger one

   !> The attempts to solve a problem.
   type, extends(attempts_t) :: solver_attempts_t
      class(problem_t), pointer :: problem => null()
      type(solver_config_t) :: config
      type(solver_conditions_t) :: conditions
      type(budget_t) :: budget                                        ! of all fallbacks
      type(report_t) :: report                                        ! of all attempts so far
      integer :: chosen = method%auto                                 ! method of direct attempts
      logical :: is_ended = .false.
      real(wp), allocatable :: first_guess(:), linear_solution(:)
      real(wp), allocatable :: x(:)                                   ! the solution, else the end of the direct attempt
   contains
      procedure :: applies => solver_attempts_applies
      procedure :: make => solver_attempts_make
      procedure :: is_over => solver_attempts_is_over
   end type solver_attempts_t

contains

   !> Solves r(x) = 0 from the given x by the attempts of `hb_attempts` that apply, in their order, until one converges. The
   !> report has the work of all attempts and the outcome of the one that succeeded; if none did, x and the outcome are those of the
   !> direct attempt, unless the time was used up.
   !>
   !> The fallbacks together may use the work permitted by the settings, or a multiple of that of the attempts before them; each
   !> its share of the remainder, so that none exhausts the budget of those that follow.
   !>
   !> Returns `not_finite` if the scales of the problem are out of range.
   recursive subroutine solve(problem, config, linear_solution, x, report)
      class(problem_t), intent(inout), target :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(in) :: linear_solution(:)                      !! of the problem without its nonlinearity
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report
      type(solver_attempts_t) :: attempts

      if (.not. problem%has_sound_scales()) then
         x = 0.0_wp
         report%status = outcome%not_finite
         report%residual = ieee_value(1.0_wp, ieee_quiet_nan)
         return
      end if
      attempts%problem => problem
      attempts%config = config
      attempts%first_guess = x
      attempts%linear_solution = linear_solution
      attempts%x = x
      attempts%chosen = method_for(problem, config)
      attempts%conditions = conditions_of(problem, config, attempts%chosen)
      call make_attempts(attempts, stage%solver)
      x = attempts%x
      report = attempts%report
      call move_alloc(attempts%made, report%attempts)
   end subroutine solve

   logical function solver_attempts_applies(self, rule) result(applies)
      class(solver_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule

      applies = self%conditions%permit(rule)
   end function solver_attempts_applies

   !> Makes one attempt. It counts as not made if the problem has no smaller one.
   recursive subroutine solver_attempts_make(self, rule, attempt, within)
      class(solver_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule
      type(attempt_t), intent(inout) :: attempt
      type(attempt_t), allocatable, intent(out) :: within(:)          !! those at smaller problems
      type(report_t) :: step
      type(solver_config_t) :: limited
      real(wp), allocatable :: trial(:)

      limited = self%config
      if (self%config%fallback) limited%patience = rule%max_stagnant_iterations
      if (rule%has_budget()) then
         limited%max_work = rule%share*self%budget%left()
         self%is_ended = limited%max_work < self%problem%residual_work
         if (self%is_ended) return
      end if
      allocate (trial, source=start_of(rule, self%first_guess, self%linear_solution))
      call proceed(self%problem, limited, self%chosen, rule, trial, step)
      call self%report%add(step)
      if (rule%has_budget()) call self%budget%spend(step%work)
      if (allocated(step%attempts)) call move_alloc(step%attempts, within)
      if (step%status == outcome%pending) then
         if (allocated(within)) attempt%status = within(size(within))%status
         return
      end if
      attempt = step%as_attempt(attempt%rule)
      if (rule%has_budget()) then
         step%fallback = rule%kind
      else
         self%budget = budget_t(max(self%config%max_fallback_work, self%config%fallback_share*self%report%work)* &
                                merge(share_outside_domain, 1.0_wp, self%problem%has_left_domain()))
      end if
      if (step%status == outcome%converged .or. is_first_direct(rule)) then
         call self%report%adopt_outcome(step)
         self%x = trial
      end if
      self%is_ended = has_ended(step)
      if (self%is_ended) self%report%status = step%status
      if (is_first_direct(rule) .and. .not. self%is_ended) self%is_ended = self%problem%is_unsuitable(trial)
   end subroutine solver_attempts_make

   logical function solver_attempts_is_over(self) result(is_over)
      class(solver_attempts_t), intent(inout) :: self

      is_over = self%is_ended
   end function solver_attempts_is_over

   !> Whether this is the attempt whose outcome is reported if none converges.
   pure logical function is_first_direct(rule)
      type(attempt_rule_t), intent(in) :: rule

      is_first_direct = rule%technique == technique%direct .and. .not. rule%has_budget()
   end function is_first_direct

   !> What decides which attempts apply to a problem.
   pure type(solver_conditions_t) function conditions_of(problem, config, chosen) result(conditions)
      class(problem_t), intent(in) :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: chosen                                   !! one of hb_solver_types%method

      conditions%has_fallbacks = config%fallback
      conditions%continues_in_order = config%continues_in_order
      conditions%continues_in_order_first = problem%continues_in_order_first .and. chosen /= method%broyden
      conditions%can_be_damped = problem%can_be_damped
      conditions%affords_tangent = problem%n_unknowns <= largest_affordable
   end function conditions_of

   !> The method of direct attempts.
   integer function method_for(problem, config) result(chosen)
      class(problem_t), intent(in) :: problem
      type(solver_config_t), intent(in) :: config

      chosen = config%method
      if (chosen == method%auto) chosen = merge(method%krylov, method%newton, &
                                                problem%has_products .and. problem%n_unknowns > problem%largest_dense)
   end function method_for

   !> The start of an attempt.
   pure function start_of(rule, first_guess, linear_solution) result(start)
      type(attempt_rule_t), intent(in) :: rule
      real(wp), intent(in) :: first_guess(:), linear_solution(:)
      real(wp) :: start(size(first_guess))

      select case (rule%start)
      case (starting_point%linear_solution)
         start = linear_solution
      case (starting_point%zero)
         start = 0.0_wp
      case (starting_point%other_guess)
         start = merge(0.0_wp, linear_solution, all(first_guess == linear_solution))
      case default
         start = first_guess
      end select
   end function start_of

   !> Proceeds as a rule says.
   recursive subroutine proceed(problem, config, chosen, rule, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config                     !! of the attempt
      integer, intent(in) :: chosen                                   !! one of hb_solver_types%method
      type(attempt_rule_t), intent(in) :: rule
      real(wp), intent(inout), contiguous :: x(:)                     !! the start, on return the last iterate
      type(report_t), intent(out) :: report

      select case (rule%technique)
      case (technique%smaller_problems)
         call solve_by_sizes(problem, config, chosen, x, report)
      case (technique%damping_homotopy)
         call solve_by_damping(problem, config, chosen, x, report)
      case (technique%other_method)
         call solve_directly(problem, config, merge(method%broyden, method%newton, chosen == method%newton), x, report)
      case (technique%nonlinearity_homotopy)
         call solve_by_homotopy(problem, config, deformation%nonlinearity, x, report)
      case (technique%load_homotopy)
         call solve_by_homotopy(problem, config, deformation%load, x, report)
      case default
         call solve_directly(problem, config, chosen, x, report)
      end select
   end subroutine proceed

   !> Solves the smallest problem that approximates this one by all methods, larger ones from its solution, and
   !> finally the problem. The status remains `pending` if there is no smaller problem or no solution of one;
   !> `fallback` is the method of the first solution.
   recursive subroutine solve_by_sizes(problem, config, chosen, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: chosen                                   !! one of hb_solver_types%method
      real(wp), intent(inout), contiguous :: x(:)                     !! a first guess, on return the last iterate
      type(report_t), intent(out) :: report
      type(report_t) :: step
      type(solver_config_t) :: all_methods, limited
      real(wp), allocatable :: shares(:)
      integer :: i
      logical :: is_found, is_solved

      call find_shares(problem%lowest_level(), shares)
      if (size(shares) == 0) return
      all_methods = config
      all_methods%continues_in_order = .false.
      all_methods%max_fallback_work = min(config%max_fallback_work, 0.5_wp*config%max_work)
      all_methods%max_work = huge(1.0_wp)                           ! each method has its own budget
      limited = config
      limited%continues_in_order = .false.
      limited%fallback = .false.
      limited%patience = 0                                            ! the guess is near
      is_found = .false.
      do i = 1, size(shares)
         is_solved = .false.
         if (is_found) call solve_larger(shares(i), shares(i - 1), is_solved)
         if (.not. is_solved) call solve_at_size(shares(i), all_methods, is_solved)
         if (is_over()) return
         if (is_solved .and. .not. is_found) then
            is_found = .true.
            report%fallback = step%fallback
            if (step%fallback == fallback%none .and. step%iterations <= easy_iterations) exit
         end if
      end do
      if (is_found) call solve_larger(1.0_wp, shares(min(i, size(shares))), is_solved)
      if (is_found) report%status = step%status

   contains

      !> Solves the next larger problem, if necessary through an intermediate one.
      subroutine solve_larger(share, share_below, is_there)
         real(wp), intent(in) :: share, share_below
         logical, intent(out) :: is_there
         logical :: is_between

         call solve_at_size(share, limited, is_there)
         if (is_there .or. is_over()) return
         call solve_at_size(0.5_wp*(share + share_below), limited, is_between)
         if (is_between .and. .not. is_over()) call solve_at_size(share, limited, is_there)
      end subroutine solve_larger

      !> Solves a problem of the given size from x; x is unchanged on failure, except for the problem itself.
      subroutine solve_at_size(share, settings, is_there)
         real(wp), intent(in) :: share
         type(solver_config_t), intent(inout) :: settings             !! its budget is what is left of the work
         logical, intent(out) :: is_there
         real(wp) :: before(size(x))

         settings%max_work = config%max_work - report%work
         if (share < 1.0_wp) then
            call problem%coarse_guess(share, settings, x, step, is_there)
            if (is_there) report%levels = report%levels + 1
            if (allocated(step%attempts)) call append(step%attempts)
            call report%add(step)
         else
            before = x
            call solve_directly(problem, settings, chosen, x, step)
            is_there = step%status == outcome%converged
            if (.not. is_there .and. .not. has_ended(step)) x = before
            call report%adopt(step)
         end if
      end subroutine solve_at_size

      subroutine append(attempts)
         type(attempt_t), intent(in) :: attempts(:)

         if (.not. allocated(report%attempts)) allocate (report%attempts(0))
         report%attempts = [report%attempts, attempts]
      end subroutine append

      !> Whether the point was cancelled.
      logical function is_over()
         is_over = has_ended(step) .and. step%status /= outcome%converged
         if (is_over) report%status = step%status
      end function is_over
   end subroutine solve_by_sizes

   !> Sizes of the smaller problems, relative and in geometric progression; none if not even the smallest is smaller.
   pure subroutine find_shares(lowest, shares)
      real(wp), intent(in) :: lowest
      real(wp), allocatable, intent(out) :: shares(:)
      integer :: i, n

      n = 0
      if (lowest < 1.0_wp) n = max(1, ceiling(log(1.0_wp/lowest)/log(largest_level)))
      shares = [(lowest**(1.0_wp - real(i, wp)/n), i=0, n - 1)]
   end subroutine find_shares

   !> Whether nothing remains to be tried: the solution is found, or the point was cancelled.
   logical function has_ended(report)
      type(report_t), intent(in) :: report

      has_ended = report%status == outcome%converged .or. work_is_over()
   end function has_ended

   !> Solves the problem with artificial damping, which is reduced step by step from each solution: without resonances
   !> the structure moves little, and the state of the laws is easy to determine. The easier a step was, the larger
   !> the next reduction. A solution with damping is none of the problem: it is neither `converged`, nor is its residual reported.
   subroutine solve_by_damping(problem, config, chosen, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: chosen                                   !! one of hb_solver_types%method
      real(wp), intent(inout), contiguous :: x(:)                     !! a first guess, on return the last solution
      type(report_t), intent(out) :: report
      real(wp), parameter :: intermediate_tolerance = 1.0e-3_wp       ! with damping
      real(wp), parameter :: largest_loss = 1.0_wp, min_loss = 1.0e-4_wp
      real(wp), parameter :: first_ratio = 0.3_wp, largest_ratio = 0.6_wp ! of one loss factor to the previous one
      integer, parameter :: max_easy_iterations = 3
      type(report_t) :: step
      type(solver_config_t) :: limited
      real(wp) :: loss, ratio, reached, residual(size(x)), trial(size(x))

      limited = config
      reached = 0.0_wp
      ratio = first_ratio
      loss = largest_loss
      do
         limited%max_work = config%max_work - report%work
         limited%tolerance = config%tolerance
         if (loss > 0.0_wp) limited%tolerance = max(limited%tolerance, intermediate_tolerance)
         trial = x
         call problem%deform(deformation%damping, 1.0_wp - loss)
         call solve_directly(problem, limited, chosen, trial, step)
         if (loss > 0.0_wp) step%best = huge(1.0_wp)
         call report%adopt(step)
         if (step%status == outcome%converged) then
            x = trial
            if (loss <= 0.0_wp) exit
            if (step%iterations <= max_easy_iterations) ratio = ratio**2
            reached = loss
         else
            ratio = sqrt(ratio)
            if (has_ended(step) .or. reached <= 0.0_wp .or. ratio > largest_ratio) exit
         end if
         if (report%work >= config%max_work) exit
         loss = ratio*reached
         if (loss < min_loss) loss = 0.0_wp
      end do
      call problem%deform(deformation%damping, 1.0_wp)
      if (loss <= 0.0_wp) return
      if (report%status == outcome%converged) then
         report%status = outcome%out_of_budget
         report%is_out_of_work = .true.
      end if
      call problem%residual(x, residual)
      report%residual = problem%norm(residual)
   end subroutine solve_by_damping

   subroutine solve_directly(problem, config, chosen, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: chosen                                   !! one of hb_solver_types%method
      real(wp), intent(inout), contiguous :: x(:)
      type(report_t), intent(out) :: report
      type(solver_config_t) :: patient

      if (allocated(problem%failure)) deallocate (problem%failure)
      if (chosen == method%broyden) then
         patient = config
         patient%patience = 0                                         ! many cheap iterations
         call solve_broyden(problem, patient, x, report)
      else if (chosen == method%krylov) then
         call solve_krylov(problem, config, x, report)
      else
         call solve_newton(problem, config, x, report)
      end if
      report%work = problem%work_of(report)
      if (.not. allocated(problem%failure)) return
      if (any(report%status == [outcome%singular, outcome%stalled, outcome%not_finite])) then
         report%status = outcome%failed
         call move_alloc(problem%failure, report%error)
      end if
   end subroutine solve_directly

   !> Solves r(x) = 0 along a curve that starts at x, the solution of the easy problem. On failure x is the last
   !> point. Iterations are corrections, evaluations those of the residual.
   subroutine solve_by_homotopy(problem, config, kind, x, report)
      class(problem_t), intent(inout), target :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: kind                                     !! one of hb_problem%deformation
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report
      type(bordered_problem_t) :: path
      type(curve_t) :: curve
      type(solver_config_t) :: corrector
      type(report_t) :: last
      real(wp), allocatable :: forward(:, :), residual(:), trial(:)
      integer :: n, n_steps
      logical :: is_possible

      if (problem%tangent_work >= config%max_work) then
         report%status = outcome%out_of_budget
         report%is_out_of_work = .true.
         return
      end if
      n = problem%n_unknowns
      corrector = config
      corrector%tolerance = curve_tolerance
      corrector%max_iterations = max_corrections
      corrector%line_search = .false.
      corrector%repeats_tangent = .false. ! if there are several motions, the path decides which one is found
      allocate (forward(n + 1, 1), source=0.0_wp)
      forward(n + 1, 1) = 1.0_wp
      call problem%set_parameters([-kind], [0.0_wp], is_possible)
      call new_bordered_problem(path, problem, [-kind], forward, [0.0_wp])
      call new_curve(curve, path, [x, 0.0_wp], forward(:, 1), path%x_scale, steps, corrector)
      n_steps = 0                                                     ! many steps may need no correction
      trial = x
      do while (curve%status == outcome%pending)
         call curve%advance()
         if (curve%status /= outcome%pending) exit
         n_steps = n_steps + 1
         associate (position => curve%x(n + 1))
            if (position >= 1.0_wp) then                              ! from the point of the chord where it is 1
               call correct_at_end(problem, config, kind, curve, trial, last)
            else if (position < 0.0_wp) then
               curve%status = outcome%stalled                         ! back at the easy problem
            else
               call curve%turn()
            end if
         end associate
         if (curve%status == outcome%pending .and. max(curve%report%iterations, n_steps) >= config%homotopy_iterations) &
            curve%status = outcome%out_of_budget
      end do
      call problem%set_parameters([-kind], [1.0_wp], is_possible)
      report = curve%report
      report%status = curve%status
      if (report%status == outcome%converged) then
         x = trial
         report%residual = last%residual
      else
         x = curve%x(:n)
         allocate (residual(n))
         call problem%residual(x, residual)
         report%residual = problem%norm(residual)
      end if
   end subroutine solve_by_homotopy

   !> Solves the problem itself from the chord of the last step, which has passed it; if that fails, the step was too
   !> long.
   subroutine correct_at_end(problem, config, kind, curve, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: kind                                     !! one of hb_problem%deformation
      type(curve_t), intent(inout) :: curve
      real(wp), intent(inout), contiguous :: x(:)                     !! the solution
      type(report_t), intent(out) :: report
      integer :: n
      logical :: is_possible

      n = size(x)
      associate (position => curve%x(n + 1), position_before => curve%last%x(n + 1))
         x = curve%last%x(:n) + (1.0_wp - position_before)/(position - position_before)*(curve%x(:n) - curve%last%x(:n))
         call problem%set_parameters([-kind], [1.0_wp], is_possible)
         call solve_newton(problem, config, x, report)
         call curve%report%add(report)
         if (report%status == outcome%converged) then
            curve%status = outcome%converged
         else
            call curve%retreat()                                ! the step was too long for convergence
         end if
      end associate
   end subroutine correct_at_end
end module hb_solver
