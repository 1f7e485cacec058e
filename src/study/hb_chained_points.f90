!> Which points of a sweep start from each other, for the command, C and Python alike: this depends on the input alone, not on the
!> machine or the number of processes.
module hb_chained_points
   use hb_model, only: model_t
   use hb_sweep_plan, only: sweep_plan_t
   implicit none
   private
   public :: are_checked, is_chained, length_of_units

contains

   !> Whether points start from their neighbours by default: if there are many consecutive ones along physical parameters that
   !> change gradually.
   pure logical function is_chained(plan, model)
      type(sweep_plan_t), intent(in) :: plan
      type(model_t), intent(in) :: model                              !! of the first point
      integer, parameter :: min_points = 8                          ! a few distant values are not a curve

      is_chained = model%options%chain%is_auto .and. size(model%system%laws) > 0 .and. &
         plan%n_fastest_of_whole() >= min_points .and. plan%can_be_chained()
   end function is_chained

   !> Number of points that are solved in order: a curve, a chain, or a point.
   pure integer function length_of_units(plan, model) result(length)
      type(sweep_plan_t), intent(in) :: plan
      type(model_t), intent(in) :: model                              !! of the first point

      length = 1
      if (allocated(plan%curve)) then
         length = plan%n_fastest()
      else if (model%options%chain%is_on) then
         length = model%options%chain%length
      end if
   end function length_of_units

   !> Whether chains are checked for changes of the branch.
   pure logical function are_checked(plan, model)
      type(sweep_plan_t), intent(in) :: plan
      type(model_t), intent(in) :: model                              !! of the first point

      are_checked = model%options%chain%is_on .and. .not. any(model%system%tones%is_unknown)
      if (are_checked) are_checked = plan%can_be_chained()
   end function are_checked
end module hb_chained_points
