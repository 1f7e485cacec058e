!> Location of the events on a completed step of a curve of motions: folds, peaks, grazes, bifurcations, wanted values and
!> ends.
module hb_event_location
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_bifurcation, only: bifurcation
   use hb_bifurcation_location, only: add_branches, find_bifurcations
   use hb_curve, only: curve_t, event_t
   use hb_curve_branches, only: branches_t, origin_t
   use hb_curve_events, only: branch_event_t, event_values_t, fold_event_t, value_event_t
   use hb_curve_points, only: add_point, curve_point_t
   use hb_event_pairs, only: cubic_between, may_change_sign, parabola_between, point_between, quadratic_between
   use hb_event_search, only: find_zeros, is_at_origin, rounding_of, search_t, whole_step
   use hb_followed, only: followed_t
   use hb_kinds, only: wp
   use hb_located_response, only: located_response_t
   use hb_point_kinds, only: curve_kind, curve_kinds
   use hb_thresholds, only: equality_tolerance, negligible_share, rounding_level, small_share
   implicit none
   private
   public :: find_events, response_event_t

   real(wp), parameter :: max_value_of_zero = 0.5_wp                  ! of the unit of a function: it may be zero on the step

   !> A zero of the function of a response.
   type, extends(event_t) :: response_event_t
      class(followed_t), pointer :: followed => null()
      type(located_response_t) :: response
      real(wp) :: unit = 1.0_wp                                       ! of the function
   contains
      procedure :: value => response_event_value
   end type response_event_t

   !> A zero of an extremum of a switching function of a law.
   type, extends(event_t) :: grazing_event_t
      class(followed_t), pointer :: followed => null()
      integer :: extreme = 0, switch = 0                              ! of `extremes_of_switches`
      real(wp) :: unit = 1.0_wp
   contains
      procedure :: value => grazing_event_value
   end type grazing_event_t

   !> A change of the number of impacts in a period at any wall: 1 while they are the given ones, otherwise -1.
   type, extends(event_t) :: impact_event_t
      class(followed_t), pointer :: followed => null()
      integer, allocatable :: impacts(:)
   contains
      procedure :: value => impact_event_value
   end type impact_event_t

contains

   !> Finds folds, peaks, bifurcations, wanted values and ends on a completed step, in their order.
   subroutine find_events(followed, curve, at_start, at_end, branches, found, is_lost)
      class(followed_t), intent(inout), target :: followed            !! moves to points of the step
      type(curve_t), intent(inout) :: curve                           !! at its end; the work is counted
      type(event_values_t), intent(in) :: at_start, at_end            !! of the step
      type(branches_t), intent(in), target :: branches
      type(curve_point_t), allocatable, intent(out) :: found(:)       !! up to the end of the branch or else of the step
      logical, intent(out) :: is_lost                                 !! an event was not located because the step is too long
      type(search_t) :: search

      call search%begin(followed, curve, at_start, at_end, branches)
      call find_folds(search)
      if (search%has_branched) call find_branch(search)
      call find_responses(search)
      call find_grazes(search)
      call find_bifurcations(search)
      call find_values(search)
      call find_return(search)
      call search%finish(curve, found)
      is_lost = search%is_lost
   end subroutine find_events

   !> Finds where the value reverses: at a sharp kink the curve has reversed before its step, so the direction at the
   !> last point is used.
   subroutine find_folds(search)
      type(search_t), intent(inout) :: search
      type(curve_point_t), allocatable :: points(:)
      real(wp), allocatable :: between(:)
      integer :: i

      if (is_at_origin(search)) return
      allocate (between(0))
      associate (curve => search%curve, n => size(search%curve%x))
         associate (at_ends => [search%at_start%rise, search%at_end%rise]/curve%units(n))
            if (search%is_smooth) between = quadratic_between(at_ends/[1.0_wp, search%along], &
                                                              (curve%x(n) - curve%last%x(n))/(curve%units(n)*search%length))
            call find_zeros(search, fold_event_t(curve_kind%fold, .true., rounding_of(search)), whole_step(search), at_ends, & ! or
                            between, points)                          ! a corner
         end associate
         search%folds = reshape([(points(i)%position, points(i)%x(n), i=1, size(points))], [2, size(points)])
      end associate
      search%found = [search%found, points]
   end subroutine find_folds

   !> Finds the intersection with another curve of the equations.
   subroutine find_branch(search)
      type(search_t), intent(inout) :: search
      type(curve_point_t), allocatable :: points(:)

      call find_zeros(search, branch_event_t(curve_kind%branch, .true.), whole_step(search), &   ! only a sign
                      [-1.0_wp, 1.0_wp]*search%curve%orientation, [real(wp) ::], points)
      call add_branches(search, points)
   end subroutine find_branch

   !> Finds where a response is extremal, including corners, equals a given amplitude, or is in quadrature with its
   !> load.
   subroutine find_responses(search)
      type(search_t), intent(inout) :: search
      type(curve_point_t), allocatable :: points(:)
      integer :: i
      real(wp) :: unit
      real(wp), allocatable :: between(:)

      do i = 1, size(search%followed%request%responses)
         associate (response => search%followed%request%responses(i), &
                    values => [search%at_start%functions(i), search%at_end%functions(i)])
            call expect_function(search, i, between)
            if (.not. ((values(1) < 0.0_wp .and. values(2) >= 0.0_wp) .or. (values(1) > 0.0_wp .and. values(2) <= 0.0_wp) &
                       .or. may_change_sign(values, between))) cycle
            unit = search%followed%unit_of_function(response, search%curve%x)
            if (.not. unit > 0.0_wp) cycle
            ! Where branches cross by symmetry the slope is zero: half of its digits are rounding of the null vector.
            if (is_at_origin(search) .and. abs(values(1)) <= equality_tolerance*abs(values(2))) cycle
            call find_zeros(search, response_event_t(response%kind, curve_kinds(response%kind)%is_extreme, rounding_of(search), &
                                                     search%followed, response, unit), whole_step(search), values/unit, &
                            between/unit, points)
         end associate
         points%response = i
         search%found = [search%found, points]
      end do
   end subroutine find_responses

   !> The function of a response on the step as far as both ends show it; none if it cannot be close to zero.
   subroutine expect_function(search, i, between)
      type(search_t), intent(inout) :: search
      integer, intent(in) :: i                                        ! number of the response
      real(wp), allocatable, intent(out) :: between(:)
      real(wp) :: middle(size(search%curve%x)), slopes(2)
      logical :: is_there

      between = [real(wp) ::]
      if (.not. search%is_smooth) return
      associate (response => search%followed%request%responses(i), curve => search%curve, &
                 values => [search%at_start%functions(i), search%at_end%functions(i)])
         if (curve_kinds(response%kind)%is_extreme) then
            between = quadratic_between(values/[1.0_wp, search%along], &
                                        (search%at_end%squares(i) - search%at_start%squares(i))/search%length)
         else if (.not. minval(abs(values)) < max_value_of_zero*response%unit_of(search%at_end%squares(i))) then
            return
         else if (curve_kinds(response%kind)%has_slope) then
            slopes(1) = search%followed%slope_at(response, curve%last%x, curve%last%direction)
            slopes(2) = search%followed%slope_at(response, curve%x, curve%direction)/search%along
            between = cubic_between(values, slopes, search%length)
         else
            call point_between(curve, 0.5_wp, middle, is_there)
            if (is_there) between = parabola_between(values, search%followed%function_at(response, middle, curve%direction))
         end if
      end associate
   end subroutine expect_function

   !> Finds where a contact begins, or becomes permanent.
   subroutine find_grazes(search)
      type(search_t), intent(inout) :: search
      type(grazing_event_t) :: graze
      type(curve_point_t) :: point
      type(curve_point_t), allocatable :: points(:)
      integer :: i, k, n
      real(wp) :: unit
      real(wp), allocatable :: between(:), middle(:, :)

      if (allocated(search%at_start%impacts)) then
         if (all(search%at_start%impacts == search%at_end%impacts)) return
         call find_zeros(search, impact_event_t(curve_kind%grazing, .true., 0.0_wp, search%followed, search%at_start%impacts), &
                         whole_step(search), [1.0_wp, -1.0_wp], [real(wp) ::], points)
         search%found = [search%found, points]
         return
      end if
      if (size(search%at_start%extremes, 2) /= size(search%at_end%extremes, 2)) return
      call find_middle()
      do k = 1, size(search%at_end%extremes, 2)
         associate (before => search%at_start%extremes(:, k), behind => search%at_end%extremes(:, k))
            unit = max(maxval(abs(behind)), tiny(1.0_wp))
            do i = 1, 2
               if (i == 2 .and. same_change(before, behind)) cycle     ! the same distance everywhere: one event
               between = [real(wp) ::]
               if (size(middle, 2) > 0) between = parabola_between([before(i), behind(i)], middle(i, k))/unit
               graze = grazing_event_t(curve_kind%grazing, .false., rounding_of(search), search%followed, i, k, unit)
               call find_zeros(search, graze, whole_step(search), [before(i), behind(i)]/unit, between, points)
               do n = 1, size(points)
                  point = points(n)
                  point%extreme = i
                  point%switch = k
                  if (is_repeated(point)) cycle
                  call find_shift_of_graze(search, graze, point)
                  search%found = [search%found, point]
               end do
            end do
         end associate
      end do

   contains

      !> The extremes in the middle of the step, if one may be zero on it.
      subroutine find_middle()
         type(event_values_t) :: there
         real(wp) :: change, x(size(search%curve%x))
         logical :: is_there

         allocate (middle(2, 0))
         if (.not. search%is_smooth .or. is_at_origin(search)) return
         associate (before => search%at_start%extremes, behind => search%at_end%extremes, curve => search%curve, &
                    n => size(search%curve%x) - search%followed%n_further)
            change = norm2((curve%x(:n) - curve%last%x(:n))/curve%units(:n))
            if (.not. any(before*behind > 0.0_wp .and. min(abs(before), abs(behind)) < &
                          change*spread(behind(2, :) - behind(1, :), 1, 2))) return
            call point_between(curve, 0.5_wp, x, is_there)
            if (is_there) call search%followed%find_contact(x, there)
            if (allocated(there%extremes)) call move_alloc(there%extremes, middle)
            if (size(middle, 2) /= size(behind, 2)) middle = middle(:, :0)
         end associate
      end subroutine find_middle

      !> Whether a contact becomes permanent where it begins: on a circular orbit or at rest the distance is the same at all
      !> phases, to rounding, and this is one event.
      pure logical function is_repeated(point)
         type(curve_point_t), intent(in) :: point

         is_repeated = point%switch == k .and. point%extreme == 2 .and. &
                       any(search%found%switch == k .and. search%found%extreme == 1 .and. &
                           abs(search%found%position - point%position) <= max(rounding_level, equality_tolerance* &
                                 search%curve%last%step))
      end function is_repeated
   end subroutine find_grazes

   !> Finds by how much the value of a graze moves with a change of the extreme that is zero there: on either side, for
   !> the curve may have a corner there.
   subroutine find_shift_of_graze(search, graze, found)
      type(search_t), intent(inout) :: search
      type(grazing_event_t), intent(inout) :: graze
      type(curve_point_t), intent(inout) :: found
      real(wp) :: beside, change, x(size(search%curve%x))
      integer :: side
      logical :: is_on_curve

      do side = -1, 1, 2
         beside = side*small_share*search%curve%last%step
         if (side < 0) beside = max(beside, -0.5_wp*found%position)
         if (side > 0) beside = min(beside, 0.5_wp*(search%curve%last%step - found%position))
         if (abs(beside) < negligible_share*search%curve%last%step) cycle ! differences would show rounding errors
         call search%curve%point_at(found%position + beside, x, is_on_curve)
         if (.not. is_on_curve) cycle
         change = graze%unit*graze%value(search%curve, x)
         if (abs(change) > 0.0_wp) found%shift = max(found%shift, abs((x(size(x)) - found%x(size(x)))/change))
      end do
   end subroutine find_shift_of_graze

   !> Finds where the branch ends because it returns to its start or to the curve that it has left: at another intersection by
   !> symmetry, or where its period halves again. Beyond it the same motions follow, as their mirror images or shifted by a period.
   subroutine find_return(search)
      type(search_t), intent(inout) :: search
      type(curve_point_t) :: point
      real(wp) :: position, x(size(search%curve%x))
      integer :: i
      logical :: is_back, is_there

      if (search%curve%last%length <= 0.0_wp) return
      is_back = is_at_start(search)
      if (is_back) then
         position = search%curve%last%step
         x = search%branches%start_on_set%x
         is_there = .true.
      else if (search%branches%number == 0 .and. allocated(search%followed%request%origin)) then
         if (search%followed%request%origin%is_torus) return
         call find_halving(search, x, position, is_there)
      else if (search%branches%leaves_another()) then
         call find_intersection(search, x, position, is_there)
      else
         return
      end if
      if (.not. is_there) return
      if (.not. is_back) &
         search%found = pack(search%found, [(.not. belongs_to_junction(search%found(i)), i=1, size(search%found))])
      point = curve_point_t(curve_kind%end, position, x, is_return=.true.)
      point%is_crossing = .not. is_back .or. search%branches%leaves_another()
      search%found = [search%found, point]

   contains

      !> At the junction the value has an extremum, the determinant is zero, and responses are extremal by symmetry.
      pure logical function belongs_to_junction(point)
         type(curve_point_t), intent(in) :: point

         belongs_to_junction = (curve_kinds(point%kind)%is_extreme .or. &
                                curve_kinds(point%kind)%bifurcation == bifurcation%branch) .and. &
                               abs(point%position - position) <= small_share*search%curve%last%step
      end function belongs_to_junction
   end subroutine find_return

   !> Finds where the doubled period halves again: the value has an extremum there, and the part of the motion that repeats
   !> after two periods alone passes through zero, or has become zero within the shortest step.
   subroutine find_halving(search, x, position, is_there)
      type(search_t), intent(inout) :: search
      real(wp), intent(out) :: x(:), position
      logical, intent(out) :: is_there
      real(wp) :: share
      integer :: i

      share = search%followed%retained_doubling(search%curve)
      is_there = share <= negligible_share
      if (.not. is_there) return
      i = findloc(search%found%kind, curve_kind%fold, dim=1)
      is_there = i > 0 .or. share >= -negligible_share
      x = search%curve%x
      position = search%curve%last%step
      if (i == 0) return
      x = search%found(i)%x
      position = search%found(i)%position
   end subroutine find_halving

   !> Finds another origin of branches on the step, at which the value has an extremum.
   subroutine find_intersection(search, x, position, is_there)
      type(search_t), intent(inout) :: search
      real(wp), intent(out) :: x(:), position
      logical, intent(out) :: is_there
      type(origin_t) :: origin
      integer :: i, k

      is_there = .false.
      associate (curve => search%curve, units => search%curve%units)
         do k = 1, size(search%branches%origins)
            if (k == search%branches%number .or. search%branches%origins(k)%is_apart) cycle
            origin = search%followed%on_level(search%branches%origins(k))
            if (size(origin%x) /= size(x)) cycle                      ! with a section of its own
            x = origin%x
            associate (gap => (x - curve%last%x)/units, direction => curve%last%direction/units)
               position = dot_product(gap, direction)/norm2(direction)
               if (position <= 0.0_wp .or. position > curve%last%step) cycle
               if (norm2(gap - position*direction/norm2(direction)) > small_share*curve%last%step) cycle
            end associate
            is_there = any([(search%found(i)%kind == curve_kind%fold .and. &
                             abs(search%found(i)%position - position) <= small_share*curve%last%step, i=1, size(search%found))])
            if (is_there) return
         end do
      end associate
   end subroutine find_intersection

   !> Finds wanted values and ends of the range; folds divide the step.
   subroutine find_values(search)
      type(search_t), intent(inout) :: search
      type(value_event_t) :: event
      real(wp), allocatable :: wanted(:)
      real(wp), allocatable :: positions(:), values(:)
      real(wp) :: position, x(size(search%curve%x))
      integer :: i, k, n
      logical :: is_found

      n = size(x)
      associate (curve => search%curve, request => search%followed%request)
         allocate (positions, source=[0.0_wp, search%folds(1, :), curve%last%step])
         allocate (values, source=[curve%last%x(n), search%folds(2, :), curve%x(n)])
         allocate (wanted, source=[request%from, request%to, request%values])
         event%unit = abs(request%to - request%from)
         do i = 1, size(wanted)
            if (i > 2 .and. any(abs(wanted(i) - wanted(:2)) <= 0.0_wp)) cycle
            event%wanted = wanted(i)
            do k = 1, size(positions) - 1
               if (.not. (values(k) - wanted(i))*(values(k + 1) - wanted(i)) < 0.0_wp) then
                  if (.not. abs(values(k + 1) - wanted(i)) <= 0.0_wp) cycle
               end if
               if (i <= 2) then                                       ! a start that moved with its set may be outside the range
                  if ((values(k) - wanted(i))*(wanted(3 - i) - wanted(i)) < 0.0_wp) cycle
               end if
               call curve%find_zero(event, positions(k:k + 1), (values(k:k + 1) - wanted(i))/event%unit, x, position, is_found)
               if (is_found) call move_to_value(is_found)
               if (.not. is_found) search%is_lost = search%is_lost .or. i <= 2     ! nothing lies beyond the ends
               if (.not. is_found) cycle
               call add_point(search%found, merge(curve_kind%end, curve_kind%value, i <= 2), position, x)
            end do
         end do
      end associate

   contains

      !> Moves a located point to the wanted value. Next to a fold the correction leaves it where it is: it counts if its value is
      !> the wanted one but for rounding.
      subroutine move_to_value(is_found)
         logical, intent(out) :: is_found
         logical :: is_there

         is_found = abs(x(n) - event%wanted) <= rounding_of(search)*event%unit
         x(n) = event%wanted
         call search%curve%correct_at_value(x, is_there)
         is_found = is_found .or. is_there
      end subroutine move_to_value
   end subroutine find_values

   !> Whether both extremes are equal before and after, as for a whirl about the center of a ring.
   pure logical function same_change(before, after)
      real(wp), intent(in) :: before(2), after(2)

      same_change = abs(before(2) - before(1)) <= rounding_level*maxval(abs(before)) .and. &
         abs(after(2) - after(1)) <= rounding_level*maxval(abs(after))
   end function same_change

   !> Whether the curve has returned to its start, after steps that led away from it. Its phases may differ.
   logical function is_at_start(search)
      type(search_t), intent(in) :: search
      real(wp) :: along
      real(wp), dimension(size(search%branches%start_on_set%x)) :: direction_there, there

      is_at_start = .false.
      associate (curve => search%curve, units => search%curve%units)
         if (curve%last%length < 3.0_wp*curve%last%step) return
         there = search%branches%start_on_set%x
         direction_there = search%branches%start_on_set%direction
         call search%followed%bring_near(curve%last%x, there, direction_there)
         associate (gap => (there - curve%last%x)/units, direction => curve%last%direction/units)
            along = dot_product(gap, direction)/norm2(direction)
            if (along <= 0.0_wp .or. along > curve%last%step) return
            if (norm2(gap - along*direction/norm2(direction)) > small_share*curve%last%step) return
            is_at_start = dot_product(direction_there/units, direction) > 0.0_wp
         end associate
      end associate
   end function is_at_start

   real(wp) function response_event_value(self, curve, x) result(value)
      class(response_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      real(wp) :: tangent(size(x)), determinant_sign
      logical :: is_singular

      call curve%tangent_at(x, tangent, determinant_sign, is_singular)
      value = ieee_value(value, ieee_quiet_nan)
      if (.not. is_singular) value = self%followed%function_at(self%response, x, tangent)/self%unit
   end function response_event_value

   real(wp) function grazing_event_value(self, curve, x) result(value)
      class(grazing_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      type(event_values_t) :: known

      call self%followed%find_contact(x, known)
      value = ieee_value(value, ieee_quiet_nan)
      if (size(known%extremes, 2) >= self%switch) value = known%extremes(self%extreme, self%switch)/self%unit
   end function grazing_event_value

   real(wp) function impact_event_value(self, curve, x) result(value)
      class(impact_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      type(event_values_t) :: known

      call self%followed%find_contact(x, known)
      value = merge(1.0_wp, -1.0_wp, all(known%impacts == self%impacts))
   end function impact_event_value
end module hb_event_location
