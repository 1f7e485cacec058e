!> Termination of an iteration: criteria and resulting status, the same for all solvers.
module hb_iteration_end
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_cancellation, only: verdict, verdict_on_work
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   implicit none
   private
   public :: end_at_point, end_if_over, end_without_step

contains

   !> Ends the iteration if the residual at the present point decides, or the budget or the time is used up; otherwise
   !> leaves `pending`.
   subroutine end_at_point(problem, config, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      type(report_t), intent(inout) :: report

      call report%note()
      report%work = problem%work_of(report)
      if (.not. ieee_is_finite(report%residual)) then
         report%status = outcome%not_finite
      else if (report%residual <= config%tolerance) then
         report%status = outcome%converged
      else if (report%iterations >= config%max_iterations .or. report%work >= config%max_work) then
         report%status = outcome%out_of_budget
         report%is_out_of_work = report%work >= config%max_work
      else if (report%gains_nothing(config%patience)) then
         report%status = outcome%stalled
      else
         call end_if_over(report)
      end if
   end subroutine end_at_point

   !> Ends the iteration if the point was cancelled; otherwise leaves the status.
   subroutine end_if_over(report)
      type(report_t), intent(inout) :: report

      select case (verdict_on_work())
      case (verdict%timed_out)
         report%status = outcome%timed_out
      case (verdict%interrupted)
         report%status = outcome%interrupted
      case (verdict%out_of_work)
         report%status = outcome%out_of_budget
         report%is_out_of_work = .true.
      end select
   end subroutine end_if_over

   !> Ends the iteration if there is no further step: as converged if the residual is at rounding level, otherwise as
   !> `status`.
   subroutine end_without_step(problem, x, status, report)
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      integer, intent(in) :: status                                   !! one of hb_outcome%outcome
      type(report_t), intent(inout) :: report

      report%status = status
      if (report%residual <= problem%rounding_level(x)) report%status = outcome%converged
   end subroutine end_without_step
end module hb_iteration_end
