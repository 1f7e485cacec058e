!> Events that a new set of harmonics has behind a point of a curve, where the previous set had them ahead.
!> The position of an event depends on the set. If the set changes at a point of the curve between the two positions,
!> neither the step before nor the step after contains the event. The functions of all events are therefore compared at
!> that point on both sets; where their signs differ, the curve is followed backward on the new set, until they have the
!> signs of the previous set.
module hb_passed_events
   use hb_bifurcation_location, only: n_outside
   use hb_curve, only: curve_t
   use hb_curve_branches, only: branches_t
   use hb_curve_points, only: curve_point_t
   use hb_event_location, only: find_events
   use hb_followed, only: curve_state_t, followed_t
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   use hb_point_kinds, only: curve_kind, curve_kinds, located_by
   implicit none
   private
   public :: find_differences, find_passed_events, set_differences_t

   integer, parameter :: max_steps = 40                               ! backward

   !> Events whose functions have different signs on two sets.
   type :: set_differences_t
      logical :: in_fold = .false.
      logical :: in_branch = .false.
      logical :: in_grazing = .false.
      logical :: in_stability = .false.                               !! number of multipliers outside the unit circle
      logical :: in_value = .false.                                   !! any that is wanted, or an end of the range
      logical, allocatable :: in_response(:)                          !! (responses of the request)
   contains
      procedure :: any => set_differences_any
      procedure :: include => set_differences_include
   end type set_differences_t

contains

   !> Compares the functions of events; those that are not known on both sets do not differ.
   pure subroutine find_differences(before, after, differences)
      type(curve_state_t), intent(in) :: before, after
      type(set_differences_t), intent(out) :: differences
      integer :: i

      associate (a => before%at_point, b => after%at_point)
         differences%in_fold = a%rise*b%rise < 0.0_wp
         differences%in_branch = before%path%orientation*after%path%orientation < 0.0_wp
         if (allocated(a%extremes) .and. allocated(b%extremes)) then
            if (size(a%extremes, 2) == size(b%extremes, 2)) differences%in_grazing = any(a%extremes*b%extremes < 0.0_wp)
         end if
         if (allocated(a%excess) .and. allocated(b%excess)) differences%in_value = any(a%excess*b%excess < 0.0_wp)
         allocate (differences%in_response(0))
         if (allocated(a%functions) .and. allocated(b%functions)) &
            differences%in_response = [(a%functions(i)*b%functions(i) < 0.0_wp, i=1, size(a%functions))]
         if (a%stability%resolves_circle() .and. b%stability%resolves_circle()) &
            differences%in_stability = n_outside(a%stability) /= n_outside(b%stability)
      end associate
   end subroutine find_differences

   !> Whether the sets differ in any event.
   pure logical function set_differences_any(self) result(has)
      class(set_differences_t), intent(in) :: self

      has = self%in_fold .or. self%in_branch .or. self%in_grazing .or. self%in_stability .or. self%in_value .or. &
            any(self%in_response)
   end function set_differences_any

   !> Whether a located point is one in which the sets differ.
   pure logical function set_differences_include(self, point) result(includes)
      class(set_differences_t), intent(in) :: self
      type(curve_point_t), intent(in) :: point

      select case (curve_kinds(point%kind)%by)
      case (located_by%value)
         includes = self%in_fold
      case (located_by%determinant)
         includes = self%in_branch
      case (located_by%contact)
         includes = self%in_grazing
      case (located_by%multipliers)
         includes = self%in_stability
      case (located_by%response)
         includes = self%in_response(point%response)
      case default
         includes = self%in_value .and. any(point%kind == [curve_kind%value, curve_kind%end])
      end select
   end function set_differences_include

   !> Adds the events behind the start of the last step to its points, at negative positions.
   subroutine find_passed_events(followed, curve, branches, before, here, points)
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout) :: curve                           !! at the end of the step; the work is counted
      type(branches_t), intent(inout), target :: branches
      type(curve_state_t), intent(in) :: before                       !! at the start of the step, on the previous set
      type(curve_state_t), intent(in) :: here                         !! likewise, on the present set
      type(curve_point_t), allocatable, intent(inout) :: points(:)
      type(curve_t) :: backward
      type(curve_state_t) :: state
      type(set_differences_t) :: differences, remaining
      type(curve_point_t), allocatable :: passed(:)
      real(wp) :: position
      integer :: i
      logical :: is_on_curve

      call find_differences(before, here, differences)
      if (.not. differences%any()) return
      backward = curve
      state = here
      call followed%place(backward, here%path)
      call followed%prepare_step(backward, branches%start_on_set)
      passed = [curve_point_t ::]
      position = 0.0_wp
      do i = 1, max_steps
         call find_on_step_before(followed, backward, branches, state, position, differences, passed, is_on_curve)
         if (.not. is_on_curve .or. position >= here%path%length) exit
         call find_differences(before, state, remaining)
         if (.not. remaining%any()) exit
      end do
      curve%report = backward%report
      points = [passed, points]
      call followed%update_units(curve)
   end subroutine find_passed_events

   !> Follows the curve backward by one step, and adds the events on it. The curve is then at the other end of the step.
   subroutine find_on_step_before(followed, curve, branches, state, position, differences, passed, is_on_curve)
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout) :: curve
      type(branches_t), intent(in), target :: branches
      type(curve_state_t), intent(inout) :: state                     !! of the curve
      real(wp), intent(inout) :: position                             !! of the end of the step, behind the start of the search
      type(set_differences_t), intent(in) :: differences
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
      position = position + curve%last%step
      found = pack(found, [(differences%include(found(i)), i=1, size(found))])
      do i = 1, size(found)
         found(i)%position = found(i)%position - position
      end do
      passed = [found, passed]
      call followed%place(curve, state%path)
   end subroutine find_on_step_before
end module hb_passed_events
