!> The error of a bifurcation that was located from the multipliers of a motion: small errors of a motion may change its
!> multipliers much.
module hb_bifurcation_error
   use hb_kinds, only: wp
   use hb_level, only: estimate_of
   use hb_model, only: model_t
   use hb_motion_description, only: stability_of_refined
   use hb_motion_result, only: motion_result_t
   use hb_stability, only: bifurcation_value, stability_t
   use hb_tones, only: tones_t
   implicit none
   private
   public :: add_error_of_bifurcation

contains

   !> Estimates the error by the multipliers of the motion with its first-order errors removed: that of the multipliers is
   !> part of the estimate of stability, that of the value, with a tolerance, of the estimate of the levels.
   subroutine add_error_of_bifurcation(model, kind, shift, result)
      type(model_t), intent(in) :: model                              !! at the motion
      integer, intent(in) :: kind                                     !! of hb_stability; 0: it was not found from multipliers
      real(wp), intent(in) :: shift                                   !! of the value, relative, by a change of its function
      type(motion_result_t), intent(inout) :: result
      type(stability_t) :: refined
      type(tones_t) :: tones
      real(wp) :: change

      if (kind == 0 .or. result%stability%is_integrated .or. .not. allocated(result%error_estimate%refined)) return
      tones = model%system%tones
      tones%omega = result%frequency
      call stability_of_refined(model%system, model%discretisation, model%options, tones, result%error_estimate, &
                                model%options%stability, refined)
      if (.not. allocated(refined%multipliers)) return
      change = abs(bifurcation_value(kind, refined%multipliers))
      result%stability%estimate = max(result%stability%estimate, change)
      if (model%options%accuracy%is_on .and. change*shift > estimate_of(result)) &
         result%level_estimate = min(1.0_wp, change*shift)
   end subroutine add_error_of_bifurcation
end module hb_bifurcation_error
