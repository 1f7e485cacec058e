!> The curve that a request and a model need: of balances, of motions with impacts if walls have a restitution, or of located
!> points.
module hb_new_curve
   use hb_balance_branch, only: balance_branch_t
   use hb_curve_request, only: curve_request_t
   use hb_motion_curve, only: motion_curve_t
   use hb_motion_ridge, only: motion_ridge_t
   use hb_options, only: options_t
   use hb_orbit_branch, only: orbit_branch_t
   use hb_outcome, only: outcome
   use hb_solution_curve, only: solution_curve_t
   use hb_system, only: system_t
   implicit none
   private
   public :: new_curve_of

contains

   !> Creates the curve of a model.
   subroutine new_curve_of(self, system, options, request)
      class(solution_curve_t), allocatable, intent(out) :: self
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(curve_request_t), intent(in) :: request
      type(motion_curve_t), allocatable :: curve

      if (options%lacks_impacts_of(system, outcome%impact)) then
         allocate (curve)
         allocate (orbit_branch_t :: curve%followed)
      else if (allocated(request%over)) then
         allocate (motion_ridge_t :: self)
         return
      else
         allocate (curve)
         allocate (balance_branch_t :: curve%followed)
      end if
      call move_alloc(curve, self)
   end subroutine new_curve_of
end module hb_new_curve
