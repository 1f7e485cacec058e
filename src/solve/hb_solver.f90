!> Calls the solver that the settings name.
module hb_solver
   use hb_broyden, only: solve_broyden
   use hb_kinds, only: wp
   use hb_newton, only: solve_newton
   use hb_problem, only: problem_t
   use hb_solver_types, only: method, report_t, solver_config_t
   implicit none
   private
   public :: solve

contains

   !> Solves r(x) = 0 from the given x; x is the last point reached, whatever the outcome.
   subroutine solve(problem, config, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report

      if (config%method == method%broyden) then
         call solve_broyden(problem, config, x, report)
      else
         call solve_newton(problem, config, x, report)
      end if
   end subroutine solve
end module hb_solver
