!> The search for events on a completed step of a curve of motions: what is known of the step, and how a zero of the function
!> of an event, or two of them, become points of the curve.
module hb_event_search
   use hb_curve, only: curve_t, event_t
   use hb_curve_branches, only: branches_t
   use hb_curve_events, only: describe_unlocated, event_values_t
   use hb_curve_points, only: curve_point_t
   use hb_event_pairs, only: find_other_sign, may_change_sign, place_of_end
   use hb_followed, only: followed_t
   use hb_kinds, only: wp
   use hb_point_kinds, only: curve_kind, curve_kinds
   use hb_thresholds, only: location_tolerance, negligible_step
   implicit none
   private
   public :: find_pair, find_zeros, is_at_origin, rounding_of, search_t, sort_by_position, whole_step

   !> A completed step, and what was found on it.
   type :: search_t
      class(followed_t), pointer :: followed => null()                !! its functions at points of the curve, to which it moves
      type(branches_t), pointer :: branches => null()
      type(curve_t) :: curve                                          !! at the end of the step
      type(event_values_t) :: at_start, at_end                        !! of the step
      type(curve_point_t), allocatable :: found(:)
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

   !> Begins a search on a completed step. With a rough residual the tolerance of its many points is larger.
   subroutine search_begin(self, followed, curve, at_start, at_end, branches)
      class(search_t), intent(out) :: self
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(in) :: curve                              !! at the end of the step
      type(event_values_t), intent(in) :: at_start, at_end            !! of the step
      type(branches_t), intent(in), target :: branches

      self%followed => followed
      self%branches => branches
      self%curve = curve
      if (followed%is_rough) self%curve%corrector%tolerance = 10.0_wp*self%curve%corrector%tolerance
      self%at_start = at_start
      self%at_end = at_end
      self%has_branched = curve%n_branch_points /= curve%last%n_branch_points
      allocate (self%found(0), self%folds(2, 0))
      call place_of_end(self%curve, self%length, self%along, self%is_smooth)
   end subroutine search_begin

   !> Ends a search: its points with the end of the step, up to an end of the branch, and its work.
   subroutine search_finish(self, curve, found)
      class(search_t), intent(inout) :: self
      type(curve_t), intent(inout) :: curve
      type(curve_point_t), allocatable, intent(out) :: found(:)
      type(curve_point_t) :: point

      point = curve_point_t(curve_kind%regular, self%curve%last%step, self%curve%x)
      point%stability = self%at_end%stability                         ! gfortran 12 loses it in the constructor
      if (.not. is_at_origin(self)) &
         call describe_unlocated(self%at_start, self%at_end, self%followed%request%responses%kind, self%found, point)
      self%found = [self%found, point]
      call sort_by_position(self%found)
      call move_alloc(self%found, found)
      curve%problem = self%curve%problem                              ! with its preconditioner
      curve%report = self%curve%report
      curve%status = self%curve%status
   end subroutine search_finish

   !> Locates the zeros of the function of an event on a piece of the step: one if it has different signs at its ends, two if it has
   !> the same and is expected to come close to zero in between.
   subroutine find_zeros(search, event, piece, at_ends, between, points)
      type(search_t), intent(inout) :: search
      class(event_t), intent(in) :: event
      real(wp), intent(in) :: piece(2)                                !! positions on the step
      real(wp), intent(in) :: at_ends(2)                              !! of the function
      real(wp), intent(in) :: between(:)                              !! as expected on the piece; none: no pairs are sought
      type(curve_point_t), allocatable, intent(out) :: points(:)
      real(wp) :: middle, value
      logical :: is_found

      allocate (points(0))
      if (may_change_sign(at_ends, between)) then
         call find_other_sign(search%curve, event, piece, at_ends, between, middle, value, is_found)
         if (is_found) call add_pair(search, event, piece, at_ends, middle, value, points)
      else if (at_ends(1)*at_ends(2) < 0.0_wp .or. (abs(at_ends(1)) > 0.0_wp .and. .not. abs(at_ends(2)) > 0.0_wp)) then
         call add_zero(search, event, piece, at_ends, points)         ! a zero at the end belongs to this step
      end if
   end subroutine find_zeros

   !> As `find_zeros`, for a function that may have the other sign at a known position of the piece alone.
   subroutine find_pair(search, event, piece, at_ends, middle, points)
      type(search_t), intent(inout) :: search
      class(event_t), intent(in) :: event
      real(wp), intent(in) :: piece(2), at_ends(2)
      real(wp), intent(in) :: middle                                  !! on the step
      type(curve_point_t), allocatable, intent(out) :: points(:)
      class(event_t), allocatable :: sought
      real(wp) :: value, x(size(search%curve%x))
      logical :: is_on_curve

      allocate (points(0))
      call search%curve%point_at(middle, x, is_on_curve)
      if (.not. is_on_curve) return
      allocate (sought, source=event)
      value = sought%value(search%curve, x)
      if (at_ends(1)*value < 0.0_wp) call add_pair(search, event, piece, at_ends, middle, value, points)
   end subroutine find_pair

   !> Locates both zeros beside a position at which the function has the other sign.
   subroutine add_pair(search, event, piece, at_ends, middle, value, points)
      type(search_t), intent(inout) :: search
      class(event_t), intent(in) :: event
      real(wp), intent(in) :: piece(2), at_ends(2), middle, value
      type(curve_point_t), allocatable, intent(inout) :: points(:)

      call add_zero(search, event, [piece(1), middle], [at_ends(1), value], points)
      call add_zero(search, event, [middle, piece(2)], [value, at_ends(2)], points)
   end subroutine add_pair

   !> Locates the zero of a function with different signs at the ends of a piece; one that is not found is lost.
   subroutine add_zero(search, event, piece, at_ends, points)
      type(search_t), intent(inout) :: search
      class(event_t), intent(in) :: event
      real(wp), intent(in) :: piece(2), at_ends(2)
      type(curve_point_t), allocatable, intent(inout) :: points(:)
      class(event_t), allocatable :: sought
      type(curve_point_t) :: point
      logical :: is_found

      if (curve_kinds(event%kind)%sense*at_ends(1) < 0.0_wp) return
      allocate (sought, source=event)
      allocate (point%x(size(search%curve%x)))
      point%kind = event%kind
      call search%curve%find_zero(sought, piece, at_ends, point%x, point%position, is_found)
      search%is_lost = search%is_lost .or. .not. is_found
      if (is_at_origin(search)) is_found = is_found .and. point%position > negligible_step*search%curve%last%step
      if (is_found) points = [points, point]
   end subroutine add_zero

   !> The whole step, as a piece of it.
   pure function whole_step(search) result(piece)
      type(search_t), intent(in) :: search
      real(wp) :: piece(2)

      piece = [0.0_wp, search%curve%last%step]
   end function whole_step

   !> Bound of a function at its zero, from rounding or from the roughness of the residual.
   pure real(wp) function rounding_of(search)
      type(search_t), intent(in) :: search

      rounding_of = max(location_tolerance, 10.0_wp*search%curve%corrector%tolerance)
   end function rounding_of

   !> Whether the step begins at the origin of this branch, a branch point or a separate motion.
   pure logical function is_at_origin(search)
      type(search_t), intent(in) :: search

      is_at_origin = search%branches%number > 0 .and. search%curve%last%length <= 0.0_wp
   end function is_at_origin

   !> Sorts points by their positions on the step, and removes those beyond an end.
   subroutine sort_by_position(points)
      type(curve_point_t), allocatable, intent(inout) :: points(:)
      type(curve_point_t), allocatable :: sorted(:)
      real(wp) :: positions(size(points))
      integer :: i, k, n, order(size(points))

      positions = points%position
      do i = 1, size(points)                                          ! equal ones keep their order
         k = i - 1
         do while (k >= 1)
            if (positions(order(k)) <= positions(i)) exit
            order(k + 1) = order(k)
            k = k - 1
         end do
         order(k + 1) = i
      end do
      n = findloc(points(order)%kind, curve_kind%end, dim=1)
      if (n == 0) n = size(points)
      allocate (sorted(n))
      do i = 1, n
         sorted(i) = points(order(i))
      end do
      call move_alloc(sorted, points)
   end subroutine sort_by_position
end module hb_event_search
