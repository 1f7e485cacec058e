!> Broyden's "good" method with limited memory, from the linear part of the problem or from one exact tangent.
!>
!> The inverse Jacobian is a product of rank-one updates of the first one, H_k = (I + a_k s_k^T) ... (I + a_1 s_1^T)
!> H_0, with a = (s - H y)/(s^T H y) for a step s that changed the residual by y. If the storage is full or no step
!> helps, the updates are discarded and the exact tangent at the present point becomes the first Jacobian. Source:
!> docs/why/theory.md, section 6.2; Broyden, Math. Comp. 19 (1965) 577-593; Kelley, Iterative Methods for Linear and
!> Nonlinear Equations, SIAM 1995, chapter 7.
module hb_broyden
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
   public :: solve_broyden

   real(wp), parameter :: smallest_denominator = 1.0e-8_wp            ! of an update, relative to |s|**2: skipped below

   !> The inverse Jacobian, in unknowns scaled to unit magnitude.
   type :: inverse_t
      logical :: with_tangent = .false.
      type(tangent_factor_t) :: factor
      integer :: n_updates = 0
      real(wp), allocatable :: a(:, :), s(:, :)                       ! (n_unknowns, memory)
   end type inverse_t

contains

   !> Solves r(x) = 0 from the given x; returns the last iterate in x, whatever the outcome.
   subroutine solve_broyden(problem, config, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report
      type(inverse_t) :: inverse
      type(line_search_t) :: search
      real(wp), allocatable :: r(:), step(:), step_before(:)
      real(wp) :: fraction
      logical :: is_singular

      if (asserts_are_on) call assert(size(x) == problem%n_unknowns, "solve_broyden", "as many unknowns as the problem")
      allocate (r(problem%n_unknowns), step(problem%n_unknowns), step_before(problem%n_unknowns))
      call new_line_search(search, config, problem, x, r, report%residual)
      report%evaluations = 1
      call end_at_point(problem, config, report)
      if (report%status /= outcome%pending) return
      allocate (inverse%a(problem%n_unknowns, config%memory), inverse%s(problem%n_unknowns, config%memory))
      if (config%start_with_tangent) then
         call restart(inverse, problem, x, report, is_singular)
         if (is_singular) return
      end if
      call apply(inverse, problem, r, step)
      do
         step = -step
         call search%advance(problem, step, x, r, report%residual, fraction)
         report%iterations = report%iterations + 1
         report%evaluations = 1 + search%n_residuals
         if (fraction <= 0.0_wp .and. inverse%n_updates == 0 .and. inverse%with_tangent) then
            call end_without_step(problem, x, search%failure, report)
         else
            call end_at_point(problem, config, report)
         end if
         if (report%status /= outcome%pending) return

         if (fraction <= 0.0_wp .or. inverse%n_updates == config%memory) then
            call restart(inverse, problem, x, report, is_singular)
            if (is_singular) return
            call apply(inverse, problem, r, step)
         else
            step_before = fraction*step
            call apply(inverse, problem, r, step)
            call update(inverse, problem, step_before, fraction, step)
         end if
      end do
   end subroutine solve_broyden

   !> Discards all updates and computes the exact tangent at x.
   subroutine restart(inverse, problem, x, report, is_singular)
      type(inverse_t), intent(inout) :: inverse
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)
      type(report_t), intent(inout) :: report
      logical, intent(out) :: is_singular

      inverse%n_updates = 0
      inverse%with_tangent = .true.
      if (report%factorizations == 0) call new_tangent_factor(inverse%factor, problem%n_unknowns)
      call inverse%factor%update(problem, x, is_singular)
      report%factorizations = report%factorizations + 1
      if (is_singular) report%status = outcome%singular
   end subroutine restart

   !> step = H r.
   subroutine apply(inverse, problem, r, step)
      type(inverse_t), intent(in) :: inverse
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)
      integer :: k

      if (inverse%with_tangent) then
         step = r
         call inverse%factor%solve(problem, step)
      else
         call problem%solve_linear(r, step)
      end if
      step = step/problem%x_scale
      do k = 1, inverse%n_updates
         step = step + dot_product(inverse%s(:, k), step)*inverse%a(:, k)
      end do
      step = step*problem%x_scale
   end subroutine apply

   !> Adds the update of the last step s and converts `step`, which is H r with the old H, to that of the new one.
   !>
   !> With H r_old = -s/fraction, H y = H r_new + s/fraction: no further product is needed.
   subroutine update(inverse, problem, step_before, fraction, step)
      type(inverse_t), intent(inout) :: inverse
      class(problem_t), intent(in) :: problem
      real(wp), intent(in) :: step_before(:), fraction
      real(wp), intent(inout) :: step(:)
      real(wp) :: denominator
      integer :: k

      k = inverse%n_updates + 1
      associate (s => inverse%s(:, k), a => inverse%a(:, k))
         s = step_before/problem%x_scale
         a = step/problem%x_scale + s/fraction                         ! H y
         denominator = dot_product(s, a)
         if (abs(denominator) <= smallest_denominator*dot_product(s, s)) return
         a = (s - a)/denominator
         step = step + dot_product(s, step/problem%x_scale)*a*problem%x_scale
      end associate
      inverse%n_updates = k
   end subroutine update
end module hb_broyden
