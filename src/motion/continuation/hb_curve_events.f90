!> Functions along a curve of motions whose zeros are located: folds, grazes, branch points, values.
!>
!> A motion grazes where the smallest or the largest value of a switch of a law over all phases (hb_switch_extremes) is zero:
!> a contact begins, or becomes permanent.
module hb_curve_events
   use hb_curve, only: curve_t, event_t
   use hb_kinds, only: wp
   use hb_stability, only: stability_t
   implicit none
   private
   public :: branch_event_t, event_values_t, fold_event_t, value_event_t

   !> Quantities at the point of the curve that events compare with those at the end of the next step.
   type :: event_values_t
      real(wp) :: rise = 0.0_wp                                       !! of the value in the direction
      real(wp), allocatable :: excess(:)                              !! of the value over the ends of the range and wanted ones
      real(wp), allocatable :: functions(:)                           !! of the responses, hb_followed
      real(wp), allocatable :: squares(:)                             !! of the responses
      real(wp), allocatable :: extremes(:, :)                         !! of the switching functions of laws
      integer, allocatable :: impacts(:) !! of each wall in a period, if the unknowns are a state (hb_orbit_branch)
      type(stability_t) :: stability                                  !! without multipliers if none are searched for
      real(wp) :: speed = -1.0_wp                                     !! of the multipliers on the step to here; -1: not known
   end type event_values_t

   !> A fold: the value's component of the tangent is zero.
   type, extends(event_t) :: fold_event_t
   contains
      procedure :: value => fold_event_value
   end type fold_event_t

   !> A branch point: the determinant of the tangent, bordered by the direction, changes sign.
   type, extends(event_t) :: branch_event_t
   contains
      procedure :: value => branch_event_value
   end type branch_event_t

   !> A given value.
   type, extends(event_t) :: value_event_t
      real(wp) :: wanted = 0.0_wp, unit = 1.0_wp
   contains
      procedure :: value => value_event_value
   end type value_event_t

contains

   real(wp) function fold_event_value(self, curve, x) result(value)
      class(fold_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      real(wp) :: tangent(size(x)), determinant_sign
      logical :: is_singular

      call curve%tangent_at(x, tangent, determinant_sign, is_singular)
      value = tangent(size(x))/curve%units(size(x))
      if (is_singular) value = 0.0_wp
   end function fold_event_value

   real(wp) function branch_event_value(self, curve, x) result(value)
      class(branch_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      real(wp) :: tangent(size(x))
      logical :: is_singular

      call curve%tangent_at(x, tangent, value, is_singular)
   end function branch_event_value

   real(wp) function value_event_value(self, curve, x) result(value)
      class(value_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)

      value = (x(size(x)) - self%wanted)/self%unit
   end function value_event_value
end module hb_curve_events
