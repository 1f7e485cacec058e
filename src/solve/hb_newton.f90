!> Newton's method with the exact tangent, LU factorised by LAPACK, and backtracking.
!>
!> Factorising a tangent costs as much as many residuals. After each full step that reduces the residual fast, further
!> steps therefore reuse the factors, corrected by Broyden's updates, as long as they reduce it as fast. Iterations
!> count tangents. For contact laws the tangent is one element of the generalised derivative (semi-smooth Newton
!> method). Source: docs/why/theory.md, section 6.1; Qi and Sun, Math. Programming 58 (1993) 353-367; Kelley,
!> Iterative methods for linear and nonlinear equations, SIAM 1995, section 7.3.
module hb_newton
   use hb_assert, only: assert, asserts_are_on
   use hb_iteration_end, only: end_at_point, end_without_step
   use hb_kinds, only: wp
   use hb_line_search, only: line_search_t, new_line_search
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   use hb_tangent_factor, only: new_tangent_factor, tangent_factor_t
   implicit none
   private
   public :: solve_newton

   real(wp), parameter :: fast_reduction = 0.2_wp                     ! residual after a step, relative to that before
   integer, parameter :: max_repeats = 12                            ! of steps with one tangent
   integer, parameter :: min_unknowns = 24                         ! from which on a tangent costs much more than a residual

contains

   !> Solves r(x) = 0 from the given x; returns the last iterate in x, whatever the outcome.
   subroutine solve_newton(problem, config, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report
      type(tangent_factor_t) :: factor
      type(line_search_t) :: search
      real(wp), allocatable :: r(:), step(:)
      real(wp), allocatable :: steps(:, :)                            ! since the tangent, (n_unknowns, any), in units of the scale
      real(wp) :: before, fraction
      logical :: is_singular

      if (asserts_are_on) call assert(size(x) == problem%n_unknowns, "solve_newton", "as many unknowns as the problem")
      allocate (r(problem%n_unknowns), step(problem%n_unknowns))
      call new_line_search(search, config, problem, x, r, report%residual)
      do
         report%evaluations = 1 + search%n_residuals
         call end_at_point(problem, config, report)
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
         before = report%residual
         call search%advance(problem, step, x, r, report%residual, fraction)
         report%iterations = report%iterations + 1
         if (fraction <= 0.0_wp) then
            report%evaluations = 1 + search%n_residuals
            call end_without_step(problem, x, search%failure, report)
            return
         end if
         if (.not. config%repeats_tangent .or. problem%n_unknowns < min_unknowns) cycle
         if (fraction >= 1.0_wp .and. report%residual <= fast_reduction*before) call repeat_tangent()
      end do

   contains

      !> Repeats steps with the present tangent while each reduces the residual as fast; any step that reduces it is
      !> accepted. One more step follows the one that meets the tolerance, because an exact step would also have
      !> overshot it.
      subroutine repeat_tangent()
         real(wp) :: along
         integer :: i, k
         logical :: is_last

         if (.not. allocated(steps)) allocate (steps(size(x), 0:max_repeats))
         steps(:, 0) = step/problem%x_scale
         if (report%residual <= config%tolerance) return
         do k = 1, max_repeats
            is_last = report%residual <= config%tolerance
            step = -r
            call factor%solve(problem, step)
            step = step/problem%x_scale
            do i = 1, k - 1
               step = step + steps(:, i)*(dot_product(steps(:, i - 1), step)/sum(steps(:, i - 1)**2))
            end do
            along = dot_product(steps(:, k - 1), step)/sum(steps(:, k - 1)**2)
            if (.not. along < 0.5_wp) return                          ! the update is not reliable
            steps(:, k) = step/(1.0_wp - along)
            step = steps(:, k)*problem%x_scale
            before = report%residual
            call search%try_step(problem, step, x, r, report%residual)
            if (is_last .or. report%residual > fast_reduction*before) return
         end do
      end subroutine repeat_tangent
   end subroutine solve_newton
end module hb_newton
