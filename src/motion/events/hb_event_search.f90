!> The search for events on a completed step of a curve of motions: what is known of the step, and how a zero of the function
!> of an event, or two of them, become points of the curve.
module hb_event_search
   use hb_curve, only: curve_t, event_t
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: waiting_t
   use hb_event_pairs, only: find_other_sign, may_change_sign, place_of_end
   use hb_kinds, only: wp
   use hb_observed_motion, only: observed_motion_t
   use hb_point_kinds, only: curve_kind, curve_kinds
   use hb_thresholds, only: next_to_none, sharp
   implicit none
   private
   public :: find_all, find_zero, is_at_origin, rounding_of, search_t, sort_by_position

   !> A completed step, and what was found on it.
   type :: search_t
      class(observed_motion_t), pointer :: motion => null()           !! its functions at points of the curve, to which it moves
      type(curve_t) :: curve                                          !! at the end of the step
      type(event_values_t) :: at_start, at_end                        !! of the step
      type(waiting_t), allocatable :: found(:)
      logical :: has_branched = .false.                               !! a branch point was passed
      logical :: is_lost = .false.                                    !! an event was not located
      logical :: is_smooth = .false.                                  !! the directions at both ends differ little
      real(wp) :: length = 0.0_wp                                     !! of the step along the direction at its start
      real(wp) :: along = 1.0_wp                                      !! its growth along the direction at its end
      real(wp), allocatable :: folds(:, :)                            !! positions and values of folds, (2, any)
   contains
      procedure :: begin => search_begin
      procedure :: finish => search_finish
   end type search_t

contains

   !> Begins a search on the step that a motion has completed. With a rough residual the tolerance of its many points is larger.
   subroutine search_begin(self, motion, at_end, has_branched)
      class(search_t), intent(out) :: self
      class(observed_motion_t), intent(inout), target :: motion
      type(event_values_t), intent(in) :: at_end                      !! of the step
      logical, intent(in) :: has_branched                             !! a branch point was passed

      self%motion => motion
      self%curve = motion%curve
      if (motion%is_rough) self%curve%corrector%tolerance = 10.0_wp*self%curve%corrector%tolerance
      self%at_start = motion%at_point
      self%at_end = at_end
      self%has_branched = has_branched
      allocate (self%found(0), self%folds(2, 0))
      call place_of_end(self%curve, self%length, self%along, self%is_smooth)
   end subroutine search_begin

   !> Ends a search: its points with the end of the step, up to an end of the branch, and its work.
   subroutine search_finish(self, motion, found)
      class(search_t), intent(inout) :: self
      class(observed_motion_t), intent(inout) :: motion
      type(waiting_t), allocatable, intent(out) :: found(:)
      type(waiting_t) :: point

      point = waiting_t(curve_kind%regular, self%curve%last%step, self%curve%x)
      point%stability = self%at_end%stability                         ! gfortran 12 loses it in the constructor
      self%found = [self%found, point]
      call sort_by_position(self%found)
      call move_alloc(self%found, found)
      motion%curve%problem = self%curve%problem                       ! with its preconditioner
      motion%curve%report = self%curve%report
      motion%curve%status = self%curve%status
   end subroutine search_finish

   !> Locates the zero of an event whose function has changed its sign on the step, or the two zeros if it changes it twice.
   subroutine find_all(search, event, at_ends, between, points, response)
      type(search_t), intent(inout) :: search
      class(event_t), intent(in) :: event
      real(wp), intent(in) :: at_ends(2)
      real(wp), intent(in) :: between(:)                              !! as expected on the step; none: no pairs are sought
      type(waiting_t), allocatable, intent(out) :: points(:)
      integer, intent(in), optional :: response
      real(wp) :: middle, value
      logical :: is_found

      allocate (points(0))
      if (may_change_sign(at_ends, between)) then
         call find_other_sign(search%curve, event, [0.0_wp, search%curve%last%step], at_ends, between, middle, value, is_found)
         if (.not. is_found) return
         call add_zero([at_ends(1), value], [0.0_wp, middle])
         call add_zero([value, at_ends(2)], [middle, search%curve%last%step])
      else if (changes_sign()) then
         call add_zero(at_ends, [0.0_wp, search%curve%last%step])
      end if
      if (present(response)) points%response = response

   contains

      !> Zero at the end belongs to this step.
      pure logical function changes_sign()
         changes_sign = at_ends(1)*at_ends(2) < 0.0_wp
         if (present(response)) changes_sign = changes_sign .or. (abs(at_ends(1)) > 0.0_wp .and. .not. abs(at_ends(2)) > 0.0_wp)
      end function changes_sign

      subroutine add_zero(values, part)
         real(wp), intent(in) :: values(2), part(2)
         type(waiting_t) :: point

         call find_zero(search, event, values, part, point, is_found)
         if (is_found) points = [points, point]
      end subroutine add_zero
   end subroutine find_all

   !> Locates an event on a part of the step.
   subroutine find_zero(search, event, at_ends, part, point, is_found)
      type(search_t), intent(inout) :: search
      class(event_t), intent(in) :: event
      real(wp), intent(in) :: at_ends(2), part(2)
      type(waiting_t), intent(out) :: point
      logical, intent(out) :: is_found
      class(event_t), allocatable :: sought

      is_found = .false.
      if (curve_kinds(event%kind)%sense*at_ends(1) < 0.0_wp) return
      allocate (sought, source=event)
      allocate (point%x(size(search%curve%x)))
      point%kind = event%kind
      call search%curve%find_zero(sought, part, at_ends, point%x, point%position, is_found)
      search%is_lost = search%is_lost .or. .not. is_found
      if (is_at_origin(search)) is_found = is_found .and. point%position > next_to_none*search%curve%last%step
   end subroutine find_zero

   !> Bound of a function at its zero, from rounding or from the roughness of the residual.
   pure real(wp) function rounding_of(search)
      type(search_t), intent(in) :: search

      rounding_of = max(sharp, 10.0_wp*search%curve%corrector%tolerance)
   end function rounding_of

   !> Whether the step begins at the origin of this branch, a branch point or a separate motion.
   pure logical function is_at_origin(search)
      type(search_t), intent(in) :: search

      is_at_origin = search%motion%branch > 0 .and. search%curve%last%length <= 0.0_wp
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
