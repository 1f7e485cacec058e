!> Solves a problem by the method that the settings name and, when that fails, by others.
module hb_solver
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_broyden, only: solve_broyden
   use hb_homotopy, only: solve_by_homotopy
   use hb_kinds, only: wp
   use hb_krylov, only: solve_krylov
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_problem, only: deformation, problem_t
   use hb_solver_types, only: largest_affordable, method, report_t, rescue, solver_config_t
   implicit none
   private
   public :: solve

   real(wp), parameter :: shares(8) = [0.5_wp, 0.2_wp, 0.1_wp, 0.05_wp, 0.02_wp, -0.5_wp, 1.5_wp, -0.1_wp] ! of the linear solution

   integer, parameter :: ways(7) = [rescue%other_guess, rescue%fewer_harmonics, rescue%other_method, rescue%both_other, &
                                    rescue%nonlinearity, rescue%load, rescue%several_guesses]   ! in the order of trial
   integer, parameter :: n_ways_without_matrix = 2
   real(wp), parameter :: work_of_rescues = 4.0_wp                    ! times that of the direct attempt, at least

contains

   !> Solves r(x) = 0 from the given x. When the direct attempt fails and rescue is on: another first guess, the solution of a
   !> smaller problem as first guess, the other method, the other guess with it, homotopy in the nonlinearity from the linear
   !> solution, homotopy in the load from zero, several guesses. The report adds up all attempts and says which one succeeded;
   !> if none did, x and the status are those of the direct attempt, unless the time was up.
   !>
   !> The rescues together may take the work that the settings allow, or some times that of the direct attempt; each at most half
   !> of what is left, so that none takes it from all that follow.
   !>
   !> Not finite where the scales of the problem are out of range.
   subroutine solve(problem, config, linear_solution, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(in) :: linear_solution(:)                      !! of the problem without its nonlinearity
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report
      type(report_t) :: attempt
      type(solver_config_t) :: limited
      real(wp), allocatable :: first_guess(:), other_guess(:), trial(:)
      real(wp) :: all_work
      integer :: chosen, i, other_method, way
      logical :: is_found

      if (.not. problem%has_sound_scales()) then
         x = 0.0_wp
         report%status = outcome%not_finite
         report%residual = ieee_value(1.0_wp, ieee_quiet_nan)
         return
      end if
      allocate (first_guess, source=x)
      allocate (other_guess, source=linear_solution)
      if (all(x == linear_solution)) other_guess = 0.0_wp
      chosen = config%method
      if (chosen == method%auto) chosen = merge(method%krylov, method%newton, &
                                                problem%has_products .and. problem%n_unknowns > problem%largest_dense)
      other_method = merge(method%broyden, method%newton, chosen == method%newton)
      call solve_directly(problem, config, chosen, x, report)
      if (report%status == outcome%converged) return
      report%attempts = [report%as_attempt(rescue%none)]
      if (has_ended(report) .or. .not. config%rescue) return
      limited = config
      all_work = report%work + max(config%rescue_work, work_of_rescues*report%work)
      do i = 1, merge(size(ways), n_ways_without_matrix, problem%n_unknowns <= largest_affordable)
         way = ways(i)
         limited%work_limit = 0.5_wp*(all_work - report%work)
         if (limited%work_limit < problem%residual_work) exit
         select case (way)
         case (rescue%fewer_harmonics)
            trial = first_guess
            call problem%coarse_guess(limited, trial, attempt, is_found)
            call report%add(attempt)
            if (.not. is_found) cycle
            call solve_directly(problem, limited, chosen, trial, attempt)
         case (rescue%other_guess)
            trial = other_guess
            call solve_directly(problem, limited, chosen, trial, attempt)
         case (rescue%other_method)
            trial = first_guess
            call solve_directly(problem, limited, other_method, trial, attempt)
         case (rescue%both_other)
            trial = other_guess
            call solve_directly(problem, limited, other_method, trial, attempt)
         case (rescue%nonlinearity)
            trial = linear_solution
            call solve_by_homotopy(problem, limited, deformation%nonlinearity, trial, attempt)
         case (rescue%load)
            trial = 0.0_wp*linear_solution
            call solve_by_homotopy(problem, limited, deformation%load, trial, attempt)
         case default
            call solve_from_shares(problem, limited, chosen, linear_solution, trial, attempt)
         end select
         call report%add(attempt)
         report%attempts = [report%attempts, attempt%as_attempt(way)]
         if (.not. has_ended(attempt)) cycle
         report%status = attempt%status
         if (attempt%status /= outcome%converged) return
         x = trial
         report%residual = attempt%residual
         report%rescue = way
         return
      end do
   end subroutine solve

   !> Whether there is nothing more to try: the solution is found, or whoever watches over the point has ended it.
   pure logical function has_ended(report)
      type(report_t), intent(in) :: report

      has_ended = any(report%status == [outcome%converged, outcome%timed_out, outcome%interrupted])
   end function has_ended

   !> Attempts from several shares of the linear solution, until one succeeds: what limits a motion often leaves its shape.
   subroutine solve_from_shares(problem, config, chosen, linear_solution, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: chosen                                   !! one of hb_solver_types%method
      real(wp), intent(in) :: linear_solution(:)
      real(wp), intent(inout), contiguous :: x(:)
      type(report_t), intent(out) :: report
      type(report_t) :: attempt
      type(solver_config_t) :: limited
      integer :: i

      limited = config
      do i = 1, size(shares)
         limited%work_limit = config%work_limit - report%work
         x = shares(i)*linear_solution
         call solve_directly(problem, limited, chosen, x, attempt)
         call report%add(attempt)
         report%status = attempt%status
         report%residual = attempt%residual
         report%best = min(report%best, attempt%best)
         report%is_out_of_work = attempt%is_out_of_work
         if (has_ended(report) .or. report%work >= config%work_limit) return
      end do
   end subroutine solve_from_shares

   subroutine solve_directly(problem, config, chosen, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: chosen                                   !! one of hb_solver_types%method
      real(wp), intent(inout), contiguous :: x(:)
      type(report_t), intent(out) :: report

      if (chosen == method%broyden) then
         call solve_broyden(problem, config, x, report)
      else if (chosen == method%krylov) then
         call solve_krylov(problem, config, x, report)
      else
         call solve_newton(problem, config, x, report)
      end if
      report%work = problem%work_of(report)
   end subroutine solve_directly
end module hb_solver
