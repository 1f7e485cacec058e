!> Newton's method without a matrix: steps by GMRES from products with the exact tangent, with an adaptive accuracy.
!>
!> Source: docs/why/theory.md, section 6.6; Dembo, Eisenstat, Steihaug, SIAM J. Numer. Anal. 19 (1982) 400-408; Eisenstat and
!> Walker, SIAM J. Sci. Comput. 17 (1996) 16-32 (accuracy of the steps, the rougher of both choices).
module hb_krylov
   use hb_assert, only: assert, asserts_are_on
   use hb_iteration_end, only: end_at_point, end_if_over, end_without_step
   use hb_kinds, only: wp
   use hb_line_search, only: line_search_t, new_line_search
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   use hb_tangent_krylov, only: new_tangent_krylov, tangent_krylov_t
   implicit none
   private
   public :: solve_krylov

   real(wp), parameter :: lowest_accuracy = 1.0e-3_wp                 ! of a step: rougher ones fail for rigid contact
   real(wp), parameter :: max_residual_ratio = 0.9_wp                 ! a step that leaves a larger part of the residual is rejected

contains

   !> Solves r(x) = 0 from the given x; returns the last iterate in x, whatever the outcome. Ends as `singular` if
   !> GMRES finds no step, or the problem has no products.
   subroutine solve_krylov(problem, config, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report
      type(tangent_krylov_t) :: tangent
      type(line_search_t) :: search
      real(wp), allocatable :: r(:), step(:)
      real(wp) :: accuracy, fraction, norm_before
      logical :: is_ready

      if (asserts_are_on) call assert(size(x) == problem%n_unknowns, "solve_krylov", "as many unknowns as the problem")
      allocate (r(problem%n_unknowns), step(problem%n_unknowns))
      call new_line_search(search, config, problem, x, r, report%residual)
      accuracy = lowest_accuracy
      do
         report%evaluations = 1 + search%n_residuals
         call end_at_point(problem, config, report)
         if (report%status /= outcome%pending) return

         if (report%iterations == 0) then
            call new_tangent_krylov(tangent, problem, config%krylov_vectors, config%krylov_products)
            tangent%patience = config%krylov_patience
         end if
         call tangent%update(problem, x, is_ready)
         if (is_ready) call tangent%solve(problem, r, max(accuracy, 0.5_wp*config%tolerance/report%residual), step)
         report%factorizations = tangent%n_preconditioners
         report%products = tangent%n_products
         call end_if_over(report)                                     ! the step is then incomplete
         if (report%status /= outcome%pending) return
         if (.not. tangent%residual < max_residual_ratio) then
            call end_without_step(problem, x, outcome%singular, report)
            return
         end if
         step = -step
         norm_before = report%residual
         call search%advance(problem, step, x, r, report%residual, fraction)
         report%iterations = report%iterations + 1
         if (fraction <= 0.0_wp) then
            report%evaluations = 1 + search%n_residuals
            call end_without_step(problem, x, search%failure, report)
            return
         end if
         associate (gain => report%residual/norm_before)              ! usable for quadratic convergence, or left by kinks
            accuracy = min(lowest_accuracy, max(0.9_wp*gain**2, abs(gain - tangent%residual)))
         end associate
      end do
   end subroutine solve_krylov
end module hb_krylov
