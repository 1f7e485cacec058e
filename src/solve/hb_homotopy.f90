!> Homotopy: continues the solution of an easy problem to the given one by arc length, around folds if necessary.
!>
!> The nonlinearity (or the load) is multiplied by a factor from 0 to 1, which is an additional unknown of a curve.
!> Source: docs/why/theory.md, section 6.4.
module hb_homotopy
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_curve, only: curve_config_t, curve_t, new_curve
   use hb_kinds, only: wp
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   implicit none
   private
   public :: solve_by_homotopy

   type(curve_config_t), parameter :: steps = curve_config_t(little=2.0_wp)   ! each sample that enters contact is a kink
   real(wp), parameter :: loose_tolerance = 1.0e-4_wp                 ! of the residual along the curve: kinks prevent smaller ones
   integer, parameter :: most_corrections = 8

contains

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

      if (problem%tangent_work >= config%work_limit) then
         report%status = outcome%out_of_budget
         report%is_out_of_work = .true.
         return
      end if
      n = problem%n_unknowns
      corrector = config
      corrector%tolerance = loose_tolerance
      corrector%max_iterations = most_corrections
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
         associate (place => curve%x(n + 1))
            if (place >= 1.0_wp) then                                 ! from the point of the chord where it is 1
               call land(problem, config, kind, curve, trial, last)
            else if (place < 0.0_wp) then
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
   subroutine land(problem, config, kind, curve, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: kind                                     !! one of hb_problem%deformation
      type(curve_t), intent(inout) :: curve
      real(wp), intent(inout), contiguous :: x(:)                     !! the solution
      type(report_t), intent(out) :: report
      integer :: n
      logical :: is_possible

      n = size(x)
      associate (place => curve%x(n + 1), place_before => curve%last_x(n + 1))
         x = curve%last_x(:n) + (1.0_wp - place_before)/(place - place_before)*(curve%x(:n) - curve%last_x(:n))
         call problem%set_parameters([-kind], [1.0_wp], is_possible)
         call solve_newton(problem, config, x, report)
         call curve%report%add(report)
         if (report%status == outcome%converged) then
            curve%status = outcome%converged
         else
            call curve%retreat()                                ! the step was too long for convergence
         end if
      end associate
   end subroutine land
end module hb_homotopy
