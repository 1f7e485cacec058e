!> When the iteration of a solver ends, and as what: the same for all of them.
module hb_ending
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   implicit none
   private
   public :: end_at_point, end_without_step

contains

   !> Ends where the residual of the point reached settles it, or the budget is used up; leaves `pending` else.
   pure subroutine end_at_point(config, report)
      type(solver_config_t), intent(in) :: config
      type(report_t), intent(inout) :: report

      if (.not. ieee_is_finite(report%residual)) then
         report%status = outcome%not_finite
      else if (report%residual <= config%tolerance) then
         report%status = outcome%converged
      else if (report%iterations >= config%max_iterations) then
         report%status = outcome%out_of_budget
      end if
   end subroutine end_at_point

   !> Ends where there is no further step: as converged if rounding alone gives the residual, else as `status`.
   subroutine end_without_step(problem, x, status, report)
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      integer, intent(in) :: status                                   !! one of hb_outcome%outcome
      type(report_t), intent(inout) :: report

      report%status = status
      if (report%residual <= problem%rounding_level(x)) report%status = outcome%converged
   end subroutine end_without_step
end module hb_ending
