!> The search for events on a completed step of a curve of motions: what is known of the step, and how a zero of the function
!> of an event, or two of them, become points of the curve.
module hb_event_search
   use hb_curve, only: event_t
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: add_waiting, waiting_t
   use hb_event_pairs, only: find_other_sign, may_change_sign
   use hb_kinds, only: wp
   use hb_observed_motion, only: observed_motion_t
   use hb_point_kinds, only: curve_kind, curve_kinds
   use hb_thresholds, only: next_to_none, sharp
   implicit none
   private
   public :: find_all, find_zero, is_at_origin, rounding_of, search_t, sort_by_position

   !> The step, and the state of the search.
   type :: search_t
      type(event_values_t) :: at_end                                  !! of the step
      logical :: has_branched = .false.                               !! a branch point was passed
      logical :: is_lost = .false.                                    !! an event was not located
      logical :: is_smooth = .false.                                  !! the directions at both ends differ little
      real(wp) :: length = 0.0_wp                                     !! of the step along the direction at its start
      real(wp) :: along = 1.0_wp                                      !! its growth along the direction at its end
      real(wp), allocatable :: folds(:, :)                            !! positions and values of folds, (2, any)
   end type search_t

contains

   !> Locates the zero of an event whose function has changed its sign on the step, or the two zeros if it changes it twice.
   subroutine find_all(self, search, event, at_ends, between, response)
      class(observed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      class(event_t), intent(in) :: event
      real(wp), intent(in) :: at_ends(2)
      real(wp), intent(in) :: between(:)                              !! as expected on the step; none: no pairs are sought
      integer, intent(in), optional :: response
      real(wp) :: middle, value
      integer :: n
      logical :: is_found

      n = size(self%waiting)
      if (may_change_sign(at_ends, between)) then
         call find_other_sign(self%curve, event, [0.0_wp, self%curve%last%step], at_ends, between, middle, value, is_found)
         if (.not. is_found) return
         call find_zero(self, search, event, [at_ends(1), value], is_found, [0.0_wp, middle])
         call find_zero(self, search, event, [value, at_ends(2)], is_found, [middle, self%curve%last%step])
      else if (changes_sign()) then
         call find_zero(self, search, event, at_ends, is_found)
      end if
      if (present(response)) self%waiting(n + 1:)%response = response

   contains

      !> Zero at the end belongs to this step.
      pure logical function changes_sign()
         changes_sign = at_ends(1)*at_ends(2) < 0.0_wp
         if (present(response)) changes_sign = changes_sign .or. (abs(at_ends(1)) > 0.0_wp .and. .not. abs(at_ends(2)) > 0.0_wp)
      end function changes_sign
   end subroutine find_all

   !> Locates an event on the step or a part of it, and adds its point.
   subroutine find_zero(self, search, event, at_ends, is_found, part)
      class(observed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      class(event_t), intent(in) :: event
      real(wp), intent(in) :: at_ends(2)
      logical, intent(out) :: is_found
      real(wp), intent(in), optional :: part(2)
      class(event_t), allocatable :: sought
      real(wp) :: ends(2), position, x(size(self%curve%x))

      is_found = .false.
      if (curve_kinds(event%kind)%sense*at_ends(1) < 0.0_wp) return
      ends = [0.0_wp, self%curve%last%step]
      if (present(part)) ends = part
      allocate (sought, source=event)
      call self%curve%find_zero(sought, ends, at_ends, x, position, is_found)
      search%is_lost = search%is_lost .or. .not. is_found
      if (is_at_origin(self)) is_found = is_found .and. position > next_to_none*self%curve%last%step
      if (is_found) call add_waiting(self%waiting, event%kind, position, x)
   end subroutine find_zero

   !> Bound of a function at its zero, from rounding or from the roughness of the residual.
   pure real(wp) function rounding_of(self)
      class(observed_motion_t), intent(in) :: self

      rounding_of = max(sharp, 10.0_wp*self%curve%corrector%tolerance)
   end function rounding_of

   !> Whether the step begins at the origin of this branch, a branch point or a separate motion.
   pure logical function is_at_origin(self)
      class(observed_motion_t), intent(in) :: self

      is_at_origin = self%branch > 0 .and. self%curve%last%length <= 0.0_wp
   end function is_at_origin

   !> Sorts points by their positions on the step, and removes those beyond an end.
   subroutine sort_by_position(points)
      type(waiting_t), allocatable, intent(inout) :: points(:)
      type(waiting_t), allocatable :: up_to_end(:)
      type(waiting_t) :: point
      integer :: i, k

      do i = 2, size(points)
         point = points(i)
         k = i - 1
         do while (k >= 1)
            if (points(k)%position <= point%position) exit
            points(k + 1) = points(k)
            k = k - 1
         end do
         points(k + 1) = point
      end do
      i = findloc(points%kind, curve_kind%end, dim=1)
      if (i == 0) return
      allocate (up_to_end(i))
      up_to_end = points(:i)
      call move_alloc(up_to_end, points)
   end subroutine sort_by_position
end module hb_event_search
