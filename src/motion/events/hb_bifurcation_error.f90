!> The error of a bifurcation that was located from the multipliers of a motion, and of a graze: small errors of a motion may
!> change its multipliers much, and move the point at which a contact begins far along a curve that is nearly parallel to it.
module hb_bifurcation_error
   use hb_bifurcation, only: bifurcation_value
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_level, only: estimate_of
   use hb_model, only: model_t
   use hb_motion_description, only: stability_of_refined
   use hb_motion_result, only: motion_result_t
   use hb_stability, only: stability_t
   use hb_switch_extremes, only: extremes_of_switches
   use hb_tones, only: tones_t
   implicit none
   private
   public :: add_error_of_bifurcation, add_error_of_graze

contains

   !> Estimates the error by the multipliers of the motion with its first-order errors removed: that of the multipliers is
   !> part of the estimate of stability, that of the value, with a tolerance, of the estimate of the levels.
   subroutine add_error_of_bifurcation(model, kind, shift, result)
      type(model_t), intent(in) :: model                              !! at the motion
      integer, intent(in) :: kind                                     !! of hb_bifurcation; 0: it was not found from multipliers
      real(wp), intent(in) :: shift                                   !! of the value, relative, by a change of its function
      type(motion_result_t), intent(inout) :: result
      type(stability_t) :: refined
      type(tones_t) :: tones
      real(wp) :: change

      if (kind == 0 .or. result%stability%is_integrated .or. .not. allocated(result%error_estimate%refined)) return
      tones = model%system%tones
      tones%omega = result%frequency
      call stability_of_refined(model%system, model%options, tones, result%error_estimate, &
                                model%options%stability, refined)
      if (.not. allocated(refined%multipliers)) return
      change = abs(bifurcation_value(kind, refined%multipliers))
      result%stability%estimate = max(result%stability%estimate, change)
      call allow_for_shift(model, change*shift, result)
   end subroutine add_error_of_bifurcation

   !> Estimates the error of the value of a graze by the extreme that the motion with its first-order errors removed has there.
   subroutine add_error_of_graze(model, extreme, shift, result)
      type(model_t), intent(in) :: model                              !! at the motion
      integer, intent(in) :: extreme(2)                               !! that is zero, in `extremes_of_switches`; 0: none
      real(wp), intent(in) :: shift                                   !! of the value, relative, by a change of the extreme
      type(motion_result_t), intent(inout) :: result
      type(law_box_t), allocatable :: laws(:)
      real(wp), allocatable :: extremes(:, :)

      if (any(extreme == 0) .or. .not. allocated(result%error_estimate%refined)) return
      laws = model%system%laws
      associate (found => result%error_estimate)
         call extremes_of_switches(laws, found%around%tuples, result%frequency, found%refined, extremes)
      end associate
      if (size(extremes, 2) >= extreme(2)) call allow_for_shift(model, abs(extremes(extreme(1), extreme(2)))*shift, result)
   end subroutine add_error_of_graze

   !> Includes the error of the value in the estimate of the levels, if there is a tolerance.
   subroutine allow_for_shift(model, of_value, result)
      type(model_t), intent(in) :: model
      real(wp), intent(in) :: of_value                                !! relative
      type(motion_result_t), intent(inout) :: result

      if (model%options%accuracy%is_on .and. of_value > estimate_of(result)) result%level_estimate = min(1.0_wp, of_value)
   end subroutine allow_for_shift
end module hb_bifurcation_error
