!> Solves a problem by the method that the settings name and, when that fails, by others.
module hb_solver
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

contains

   !> Solves r(x) = 0 from the given x. When the direct attempt fails and rescue is on: another first guess, the solution of a
   !> smaller problem as first guess, the other method, the other guess with it, homotopy in the nonlinearity from the linear
   !> solution, homotopy in the load from zero, several guesses. The report adds up all attempts and says which one succeeded;
   !> if none did, x and the status are those of the direct attempt.
   subroutine solve(problem, config, linear_solution, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(in) :: linear_solution(:)                      !! of the problem without its nonlinearity
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report
      type(report_t) :: attempt
      real(wp), allocatable :: first_guess(:), other_guess(:), trial(:)
      integer :: chosen, i, other_method, way
      logical :: is_found

      allocate (first_guess, source=x)
      allocate (other_guess, source=linear_solution)
      if (all(x == linear_solution)) other_guess = 0.0_wp
      chosen = config%method
      if (chosen == method%auto) chosen = merge(method%krylov, method%newton, &
                                                problem%has_products .and. problem%n_unknowns > problem%largest_dense)
      other_method = merge(method%broyden, method%newton, chosen == method%newton)
      call solve_directly(problem, config, chosen, x, report)
      if (report%status == outcome%converged .or. .not. config%rescue) return
      do i = 1, merge(size(ways), n_ways_without_matrix, problem%n_unknowns <= largest_affordable)
         way = ways(i)
         select case (way)
         case (rescue%fewer_harmonics)
            trial = first_guess
            call problem%coarse_guess(config, trial, attempt, is_found)
            call add_effort(report, attempt)
            if (.not. is_found) cycle
            call solve_directly(problem, config, chosen, trial, attempt)
         case (rescue%other_guess)
            trial = other_guess
            call solve_directly(problem, config, chosen, trial, attempt)
         case (rescue%other_method)
            trial = first_guess
            call solve_directly(problem, config, other_method, trial, attempt)
         case (rescue%both_other)
            trial = other_guess
            call solve_directly(problem, config, other_method, trial, attempt)
         case (rescue%nonlinearity)
            trial = linear_solution
            call solve_by_homotopy(problem, config, deformation%nonlinearity, trial, attempt)
         case (rescue%load)
            trial = 0.0_wp*linear_solution
            call solve_by_homotopy(problem, config, deformation%load, trial, attempt)
         case default
            call solve_from_shares(problem, config, chosen, linear_solution, trial, attempt)
         end select
         call add_effort(report, attempt)
         if (attempt%status == outcome%converged) then
            x = trial
            report%status = attempt%status
            report%residual = attempt%residual
            report%rescue = way
            return
         end if
      end do
   end subroutine solve

   !> Attempts from several shares of the linear solution, until one succeeds: what limits a motion often leaves its shape.
   subroutine solve_from_shares(problem, config, chosen, linear_solution, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: chosen                                   !! one of hb_solver_types%method
      real(wp), intent(in) :: linear_solution(:)
      real(wp), intent(inout), contiguous :: x(:)
      type(report_t), intent(out) :: report
      type(report_t) :: attempt
      integer :: i

      do i = 1, size(shares)
         x = shares(i)*linear_solution
         call solve_directly(problem, config, chosen, x, attempt)
         call add_effort(report, attempt)
         report%status = attempt%status
         report%residual = attempt%residual
         if (report%status == outcome%converged) return
      end do
   end subroutine solve_from_shares

   !> Adds the work of an attempt to that of all.
   pure subroutine add_effort(report, attempt)
      type(report_t), intent(inout) :: report
      type(report_t), intent(in) :: attempt

      report%iterations = report%iterations + attempt%iterations
      report%evaluations = report%evaluations + attempt%evaluations
      report%factorizations = report%factorizations + attempt%factorizations
      report%products = report%products + attempt%products
   end subroutine add_effort

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
   end subroutine solve_directly
end module hb_solver
