!> Events that a new set of harmonics has behind a point of a curve, where the previous set had them ahead.
!> The position of an event depends on the set. If the set changes at a point of the curve between the two positions,
!> neither the step before nor the step after contains the event. The functions of all events are therefore compared at
!> that point on both sets; where their signs differ, the curve is followed backward on the new set, until they have the
!> signs of the previous set.
module hb_passed_events
   use hb_curve, only: curve_t
   use hb_curve_branches, only: branches_t
   use hb_curve_events, only: compared_event_t, describe_unlocated, differing_events
   use hb_curve_points, only: curve_point_t, name_unlocated
   use hb_event_location, only: find_events
   use hb_followed, only: curve_state_t, followed_t
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   implicit none
   private
   public :: find_passed_events

   integer, parameter :: max_steps = 40                               ! backward

contains

   !> Adds the events behind the start of the last step to its points, at negative positions, and names those that are not found
   !> at its end.
   subroutine find_passed_events(followed, curve, branches, before, here, points)
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout) :: curve                           !! at the end of the step; the work is counted
      type(branches_t), intent(inout), target :: branches
      type(curve_state_t), intent(in) :: before                       !! at the start of the step, on the previous set
      type(curve_state_t), intent(in) :: here                         !! likewise, on the present set
      type(curve_point_t), allocatable, intent(inout) :: points(:)
      type(curve_t) :: backward
      type(curve_state_t) :: state
      type(curve_point_t) :: there
      type(compared_event_t), allocatable :: differing(:)
      type(curve_point_t), allocatable :: passed(:)
      real(wp) :: position
      integer :: i
      logical :: is_on_curve

      allocate (differing, source=differing_events(before%at_point, here%at_point, followed%request%responses%kind))
      if (size(differing) == 0) return
      backward = curve
      state = here
      call followed%place(backward, here%path)
      call followed%prepare_step(backward, branches%start_on_set)
      passed = [curve_point_t ::]
      position = 0.0_wp
      do i = 1, max_steps
         call find_on_step_before(followed, backward, branches, state, position, differing, passed, is_on_curve)
         if (.not. is_on_curve .or. position >= here%path%length) exit
         if (size(differing_events(before%at_point, state%at_point, followed%request%responses%kind)) == 0) exit
      end do
      curve%report = backward%report
      there%x = here%path%x
      call describe_unlocated(before%at_point, here%at_point, followed%request%responses%kind, passed, there)
      call name_unlocated(points(size(points)), trim(there%unlocated), there%hides_fold)
      points = [passed, points]
      call followed%update_units(curve)
   end subroutine find_passed_events

   !> Follows the curve backward by one step, and adds the events on it. The curve is then at the other end of the step.
   subroutine find_on_step_before(followed, curve, branches, state, position, differing, passed, is_on_curve)
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout) :: curve
      type(branches_t), intent(in), target :: branches
      type(curve_state_t), intent(inout) :: state                     !! of the curve
      real(wp), intent(inout) :: position                             !! of the end of the step, behind the start of the search
      type(compared_event_t), intent(in) :: differing(:)
      type(curve_point_t), allocatable, intent(inout) :: passed(:)    !! from the first to the last along the curve
      logical, intent(out) :: is_on_curve
      type(curve_state_t) :: ending
      integer :: i
      logical :: is_lost
      type(curve_point_t), allocatable :: found(:)

      ending = state
      ending%path = curve%path_t
      curve%direction = -curve%direction
      curve%orientation = -curve%orientation
      call curve%advance()
      is_on_curve = curve%status == outcome%pending
      if (.not. is_on_curve) return
      call curve%turn()
      curve%direction = -curve%direction
      curve%orientation = -curve%orientation
      call followed%evaluate(curve, state%at_point)
      state%path = curve%path_t
      state%path%length = ending%path%length                          ! that of the point where the search begins
      curve%last = state%path
      curve%last%step = dot_product((ending%path%x - state%path%x)/curve%units, state%path%direction/curve%units)
      curve%path_t = ending%path
      call find_events(followed, curve, state%at_point, ending%at_point, branches, found, is_lost)
      position = position + norm2((ending%path%x - state%path%x)/curve%units) ! around a fold the step may be negative
      found = pack(found, [(any(differing%is_at(found(i))), i=1, size(found))])
      do i = 1, size(found)
         found(i)%position = found(i)%position - position
      end do
      passed = [found, passed]
      call followed%place(curve, state%path)
   end subroutine find_on_step_before
end module hb_passed_events
