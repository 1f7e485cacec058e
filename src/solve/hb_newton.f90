!> Newton's method with the exact tangent, LU factorised by LAPACK, and backtracking.
!>
!> For contact laws the tangent is one element of the generalised derivative (semi-smooth Newton).
!> Source: docs/theory.md, section 6.1; Qi and Sun, Math. Programming 58 (1993) 353-367.
module hb_newton
   use hb_ending, only: end_at_point, end_without_step
   use hb_kinds, only: wp
   use hb_line_search, only: line_search_t, new_line_search
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   use hb_tangent_factor, only: new_tangent_factor, tangent_factor_t
   implicit none
   private
   public :: solve_newton

contains

   !> Solves r(x) = 0 from the given x; x is the last point reached, whatever the outcome.
   subroutine solve_newton(problem, config, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report
      type(tangent_factor_t) :: factor
      type(line_search_t) :: search
      real(wp), allocatable :: r(:), step(:)
      real(wp) :: fraction
      logical :: is_singular

      allocate (r(problem%n_unknowns), step(problem%n_unknowns))
      call new_line_search(search, problem%n_unknowns, config%line_search)
      call problem%residual(x, r)
      report%residual = problem%norm(r)
      call search%remember(report%residual)
      do
         report%evaluations = 1 + search%n_residuals
         call end_at_point(config, report)
         if (report%status /= outcome%pending) return

         if (report%iterations == 0) call new_tangent_factor(factor, problem%n_unknowns)
         call factor%update(problem, x, is_singular)
         report%factorizations = report%factorizations + 1
         if (is_singular) then
            report%status = outcome%singular
            return
         end if
         step = -r
         call factor%solve(problem, step)
         call search%advance(problem, step, x, r, report%residual, fraction)
         report%iterations = report%iterations + 1
         if (fraction <= 0.0_wp) then
            report%evaluations = 1 + search%n_residuals
            call end_without_step(problem, x, search%failure, report)
            return
         end if
      end do
   end subroutine solve_newton
end module hb_newton
