!> Location of the events on a completed step of a curve of motions: folds, peaks, grazes, bifurcations, wanted values and
!> ends.
module hb_event_location
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_quiet_nan, ieee_value
   use hb_curve, only: curve_t, event_t
   use hb_curve_events, only: branch_event_t, find_extremes, fold_event_t, grazing_event_t, value_event_t
   use hb_curve_return, only: has_images, image_of, nearest_phases
   use hb_event_pairs, only: cubic_between, find_other_sign, may_change_sign, parabola_between, place_of_end, point_between, &
      quadratic_between
   use hb_followed_motion, only: add_waiting, event_values_t, followed_motion_t, waiting_t
   use hb_kinds, only: wp
   use hb_level, only: transferred
   use hb_located_response, only: located_response_t
   use hb_point_kinds, only: curve_kind, curve_kinds
   use hb_stability, only: bifurcation, bifurcation_product, bifurcation_value, is_torus, max_multipliers, stability_method, &
      stability_t
   use hb_thresholds, only: agreement, clearly, faint, minor, next_to_none, rounding, sharp
   implicit none
   private
   public :: bifurcation_event_t, find_events, n_outside, response_event_t, retained_doubling

   ! of each kind of bifurcation
   integer, parameter :: kind_of(3) = [curve_kind%symmetry_breaking, curve_kind%period_doubling, curve_kind%neimark_sacker]

   real(wp), parameter :: nearby = 0.5_wp                             ! of a square: the response may reach an amplitude on the step

   !> The step, and the state of the search.
   type :: search_t
      type(event_values_t) :: known                                          ! at the end of the step
      logical :: has_branched = .false.                               ! a branch point was passed
      logical :: is_lost = .false.                                    ! an event was not located
      logical :: is_smooth = .false.                                  ! the directions at both ends differ little
      real(wp) :: length = 0.0_wp                                     ! of the step along the direction at its start
      real(wp) :: along = 1.0_wp                                      ! its growth along the direction at its end
      real(wp), allocatable :: folds(:, :)                            ! positions and values of folds, (2, any)
   end type search_t

   !> Part of the step without grazes; at grazes multipliers may jump.
   type :: piece_t
      real(wp) :: ends(2) = 0.0_wp                                    ! positions on the step
      type(stability_t) :: stability(2)                               ! at the ends
   end type piece_t

   !> A zero of a function of the multipliers.
   type, extends(event_t) :: bifurcation_event_t
      class(followed_motion_t), pointer :: motion => null()
      integer :: bifurcation = 0                                      ! hb_stability
      logical :: is_integrated = .false.                              ! of the integrated periodic motion
      logical :: is_product = .false.                                 ! of all factors: smooth, and with the same sign
   contains
      procedure :: value => bifurcation_event_value
   end type bifurcation_event_t

   !> A zero of the function of a response.
   type, extends(event_t) :: response_event_t
      class(followed_motion_t), pointer :: motion => null()
      type(located_response_t) :: response
      real(wp) :: unit = 1.0_wp                                       ! of the function
   contains
      procedure :: value => response_event_value
   end type response_event_t

   !> A change of a number: 1 while it is a given one, otherwise -1.
   type, extends(event_t) :: count_event_t
      class(followed_motion_t), pointer :: motion => null()
      integer, allocatable :: impacts(:)                              ! those in a period, if given; otherwise:
      integer :: n = 0                                                ! multipliers outside the unit circle
   contains
      procedure :: value => count_event_value
   end type count_event_t

contains

   !> Finds folds, peaks, bifurcations, wanted values and ends on the completed step, and lists them in their order.
   subroutine find_events(self, known, has_branched, is_lost)
      class(followed_motion_t), intent(inout), target :: self
      type(event_values_t), intent(in) :: known                              !! at the end of the step
      logical, intent(in) :: has_branched                             !! a branch point was passed
      logical, intent(out) :: is_lost                                 !! an event was not located because the step is too long
      type(search_t) :: search

      search%known = known
      search%has_branched = has_branched
      associate (curve => self%curve)
         if (self%is_rough) curve%corrector%tolerance = 10.0_wp*curve%corrector%tolerance    ! of many points
         call place_of_end(curve, search%length, search%along, search%is_smooth)
         call find_folds(self, search)
         if (has_branched) call find_branch(self, search)
         call find_responses(self, search)
         call find_grazes(self, search)
         call find_bifurcations(self, search)
         call find_values(self, search)
         self%is_closed = is_back(self)
         if (self%is_closed) then
            call add(self, curve_kind%end, curve%last_step, self%start%x)
            self%waiting(size(self%waiting))%is_crossing = self%has_left_branch()
         else
            call find_junction(self)
         end if
         call add(self, curve_kind%regular, curve%last_step, curve%x)
         self%waiting(size(self%waiting))%stability = known%stability
      end associate
      call sort_by_position(self%waiting)
      call self%renew()                                               ! the tolerance was different: a stored curve has this one
      is_lost = search%is_lost
   end subroutine find_events

   !> Finds where the value reverses: at a sharp kink the curve has reversed before its step, so the direction at the
   !> last point is used.
   subroutine find_folds(self, search)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      real(wp), allocatable :: between(:)
      integer :: i

      allocate (search%folds(2, 0), between(0))
      if (is_at_origin(self)) return
      associate (curve => self%curve, n => size(self%curve%x))
         associate (at_ends => [self%known%rise, search%known%rise]/curve%units(n))
            if (search%is_smooth) between = quadratic_between(at_ends/[1.0_wp, search%along], &
                                                              (curve%x(n) - curve%last_x(n))/(curve%units(n)*search%length))
            call find_all(self, search, fold_event_t(curve_kind%fold, .true., rounding_of(self)), at_ends, between)  ! also a corner
         end associate
         do i = 1, size(self%waiting)
            if (self%waiting(i)%kind /= curve_kind%fold) cycle
            search%folds = reshape([search%folds, self%waiting(i)%position, self%waiting(i)%x(n)], [2, size(search%folds, 2) + 1])
         end do
      end associate
   end subroutine find_folds

   !> Finds the intersection with another curve of the equations.
   subroutine find_branch(self, search)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      logical :: is_found, is_there

      call find(self, search, branch_event_t(curve_kind%branch, .true.), &   ! only a sign
                [-1.0_wp, 1.0_wp]*self%curve%orientation, is_found)
      if (is_found) call sharpen(self, bifurcation%branch, [0.0_wp, self%curve%last_step], is_there)
   end subroutine find_branch

   !> Finds where a response is extremal, including corners, equals a given amplitude, or is in quadrature with its
   !> load.
   subroutine find_responses(self, search)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      integer :: i
      real(wp) :: unit
      real(wp), allocatable :: between(:)

      do i = 1, size(self%request%responses)
         associate (response => self%request%responses(i), values => [self%known%functions(i), search%known%functions(i)])
            call expect_function(self, search, i, between)
            if (.not. ((values(1) < 0.0_wp .and. values(2) >= 0.0_wp) .or. (values(1) > 0.0_wp .and. values(2) <= 0.0_wp) &
                       .or. may_change_sign(values, between))) cycle
            unit = self%unit_of_function(response, self%curve%x)
            if (.not. unit > 0.0_wp) cycle
            ! Where branches cross by symmetry the slope is zero: half of its digits are rounding of the null vector.
            if (is_at_origin(self) .and. abs(values(1)) <= agreement*abs(values(2))) cycle
            call find_all(self, search, response_event_t(response%kind, curve_kinds(response%kind)%is_extreme, &
                                                         rounding_of(self), self, response, unit), values/unit, between/unit, i)
         end associate
      end do
   end subroutine find_responses

   !> The function of a response on the step as far as both ends show it; none if it cannot be close to zero.
   subroutine expect_function(self, search, i, between)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(in) :: search
      integer, intent(in) :: i                                        ! number of the response
      real(wp), allocatable, intent(out) :: between(:)
      real(wp) :: slopes(2)

      between = [real(wp) ::]
      if (.not. search%is_smooth) return
      associate (response => self%request%responses(i), curve => self%curve, &
                 values => [self%known%functions(i), search%known%functions(i)])
         if (curve_kinds(response%kind)%is_extreme) then
            between = quadratic_between(values/[1.0_wp, search%along], &
                                        (search%known%squares(i) - self%known%squares(i))/search%length)
         else if (response%kind == curve_kind%amplitude .and. minval(abs(values)) < nearby*search%known%squares(i)) then
            slopes(1) = self%slope_at(response, curve%last_x, curve%last_direction)
            slopes(2) = self%slope_at(response, curve%x, curve%direction)/search%along
            between = cubic_between(values, slopes, search%length)
         end if
      end associate
   end subroutine expect_function

   !> Finds where a contact begins, or becomes permanent.
   subroutine find_grazes(self, search)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      integer :: i, k
      logical :: is_found
      real(wp) :: unit
      real(wp), allocatable :: between(:), middle(:, :)

      if (allocated(self%known%impacts)) then
         if (any(self%known%impacts /= search%known%impacts)) &
            call find(self, search, count_event_t(curve_kind%grazing, .true., 0.0_wp, self, self%known%impacts), &
                      [1.0_wp, -1.0_wp], is_found)
         return
      end if
      if (size(self%known%extremes, 2) /= size(search%known%extremes, 2)) return
      call find_middle()
      do k = 1, size(search%known%extremes, 2)
         associate (before => self%known%extremes(:, k), behind => search%known%extremes(:, k))
            unit = max(maxval(abs(behind)), tiny(1.0_wp))
            do i = 1, 2
               if (i == 2 .and. same_change(before, behind)) cycle     ! the same distance everywhere: one event
               between = [real(wp) ::]
               if (size(middle, 2) > 0) between = parabola_between([before(i), behind(i)], middle(i, k))/unit
               call find_all(self, search, grazing_event_t(curve_kind%grazing, .false., rounding_of(self), self%problem, i, k, &
                                                           unit), [before(i), behind(i)]/unit, between)
            end do
         end associate
      end do

   contains

      !> The extremes in the middle of the step, if one may be zero on it.
      subroutine find_middle()
         real(wp) :: change, x(size(self%curve%x))
         logical :: is_there

         allocate (middle(2, 0))
         if (.not. search%is_smooth .or. is_at_origin(self)) return
         associate (before => self%known%extremes, behind => search%known%extremes, n => self%problem%n_unknowns, &
                    curve => self%curve)
            change = norm2((curve%x(:n) - curve%last_x(:n))/curve%units(:n))
            if (.not. any(before*behind > 0.0_wp .and. min(abs(before), abs(behind)) < &
                          change*spread(behind(2, :) - behind(1, :), 1, 2))) return
            call point_between(curve, 0.5_wp, x, is_there)
            if (is_there) call find_extremes(self%problem, x, middle)
            if (size(middle, 2) /= size(behind, 2)) middle = middle(:, :0)
         end associate
      end subroutine find_middle
   end subroutine find_grazes

   !> Finds bifurcations from the multipliers on each piece of the step between its grazes.
   subroutine find_bifurcations(self, search)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(piece_t) :: piece
      real(wp), allocatable :: grazes(:)
      integer :: i, n_before

      call sort_by_position(self%waiting)
      grazes = pack(self%waiting%position, self%waiting%kind == curve_kind%grazing)
      do i = 0, size(grazes)
         piece%ends = [0.0_wp, self%curve%last_step]
         piece%stability = [self%known%stability, search%known%stability]
         associate (tolerance => self%model%options%stability%tolerance, length => self%curve%last_step)
            if (i > 0) call evaluate_stability_at(self, grazes(i) + agreement*length, tolerance, piece%ends(1), piece%stability(1))
            if (i < size(grazes)) call evaluate_stability_at(self, grazes(i + 1) - agreement*length, tolerance, piece%ends(2), &
                                                             piece%stability(2))
         end associate
         if (.not. piece%ends(1) < piece%ends(2)) cycle
         if (.not. (piece%stability(1)%resolves_circle() .and. piece%stability(2)%resolves_circle())) cycle
         call make_certain(self, piece%ends(1), piece%stability(1))
         call make_certain(self, piece%ends(2), piece%stability(2))
         n_before = size(self%waiting)
         call find_by_kind(self, search, piece)
         call find_by_number(self, search, piece, n_before)
      end do
   end subroutine find_bifurcations

   !> Recomputes multipliers that are so close to the unit circle that their error may determine on which side they
   !> are.
   subroutine make_certain(self, position, there)
      class(followed_motion_t), intent(inout), target :: self
      real(wp), intent(in) :: position
      type(stability_t), intent(inout) :: there
      type(stability_t) :: better
      real(wp) :: same_position

      if (minval(abs(abs(there%multipliers) - 1.0_wp)) > clearly*self%model%options%stability%tolerance) return
      call evaluate_stability_at(self, position, sharp, same_position, better)
      if (allocated(better%multipliers)) there%multipliers = better%multipliers
   end subroutine make_certain

   !> Finds the zero of the function of a kind; a pair of reciprocal real multipliers is not a torus bifurcation.
   subroutine find_by_kind(self, search, piece)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(piece_t), intent(in) :: piece
      real(wp) :: at_ends(2)
      integer :: kind

      do kind = bifurcation%branch, bifurcation%torus
         if (kind == bifurcation%branch .and. is_branch_known(self, search)) cycle
         at_ends(1) = bifurcation_value(kind, piece%stability(1)%multipliers)
         at_ends(2) = bifurcation_value(kind, piece%stability(2)%multipliers)
         if (minval(abs(at_ends)) <= rounding) cycle
         if (at_ends(1)*at_ends(2) < 0.0_wp) then
            call find_zero_of_kind(self, search, kind, piece, at_ends)
         else
            call find_pair_of_kind(self, search, kind, piece, at_ends)
         end if
      end do
   end subroutine find_by_kind

   !> Finds the two zeros of the function of a kind on a piece with the same sign at its ends. Multipliers in the middle are
   !> only computed where the function is close to zero, and not nearly constant, as that of pairs is with little damping.
   subroutine find_pair_of_kind(self, search, kind, piece, at_ends)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      integer, intent(in) :: kind
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: at_ends(2)
      real(wp), parameter :: near = 0.3_wp                            ! to a bifurcation; also the least relative change
      type(bifurcation_event_t) :: change
      type(piece_t) :: half
      type(stability_t) :: there
      real(wp) :: position, products(2), value, x(size(self%curve%x))
      real(wp), allocatable :: between(:)
      logical :: is_found

      if (.not. search%is_smooth .or. minval(abs(at_ends)) > near .or. piece%ends(2) - piece%ends(1) < self%curve%last_step) return
      if (kind == bifurcation%torus .and. abs(at_ends(2) - at_ends(1)) < near*minval(abs(at_ends))) return
      call point_between(self%curve, 0.5_wp, x, is_found)
      if (is_found) call self%find_stability(x, self%model%options%stability%tolerance, there)
      if (.not. allocated(there%multipliers)) return
      products = [bifurcation_product(kind, piece%stability(1)%multipliers), bifurcation_product(kind, &
                                                                                                 piece%stability(2)%multipliers)]
      between = parabola_between(products, bifurcation_product(kind, there%multipliers))
      if (.not. may_change_sign(products, between)) return
      change = bifurcation_event_t(kind_of(kind), .false., rounding, self, kind, is_product=.true.)
      call find_other_sign(self%curve, change, products, between, position, value, is_found)
      if (.not. is_found) return
      half = piece
      call evaluate_stability_at(self, position, sharp, half%ends(2), half%stability(2))
      if (.not. allocated(half%stability(2)%multipliers)) return
      value = bifurcation_value(kind, half%stability(2)%multipliers)
      if (.not. at_ends(1)*value < 0.0_wp) return
      call find_zero_of_kind(self, search, kind, half, [at_ends(1), value])
      half%ends = [half%ends(2), piece%ends(2)]
      half%stability = [half%stability(2), piece%stability(2)]
      call find_zero_of_kind(self, search, kind, half, [value, at_ends(2)])
   end subroutine find_pair_of_kind

   !> Finds the zero of the function of a kind on a piece.
   subroutine find_zero_of_kind(self, search, kind, piece, at_ends)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      integer, intent(in) :: kind
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: at_ends(2)
      type(bifurcation_event_t) :: change
      type(stability_t) :: there
      real(wp) :: position, x(size(self%curve%x))
      logical :: is_found

      change = bifurcation_event_t(kind_of(kind), .false., rounding, self, kind)
      call self%curve%find_zero(change, piece%ends, at_ends, x, position, is_found)
      search%is_lost = search%is_lost .or. .not. is_found
      if (.not. is_found) return
      if (kind == bifurcation%torus) then
         call self%find_stability(x, sharp, there)
         if (.not. allocated(there%multipliers)) return
         if (.not. is_torus(there%multipliers)) return
      end if
      call add_bifurcation(self, kind, piece, position, x)
   end subroutine find_zero_of_kind

   !> If the bifurcations found do not explain the change in the number of multipliers outside the unit circle on a
   !> piece, as when two cross it in the same way, each change of this number is located instead.
   subroutine find_by_number(self, search, piece, n_before)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(piece_t), intent(in) :: piece
      integer, intent(in) :: n_before                                 !! waiting points, of them found without multipliers
      type(count_event_t) :: number
      type(stability_t) :: there
      real(wp) :: begin, position, x(size(self%curve%x))
      integer :: i, kind, n_last
      logical :: is_found, is_new

      n_last = n_outside(piece%stability(2))
      number%n = n_outside(piece%stability(1))
      if (is_explained(self%waiting, piece, n_last - number%n)) return
      self%waiting = self%waiting(:n_before)
      number%motion => self
      number%may_jump = .true.
      begin = piece%ends(1)
      do i = 1, max_multipliers
         if (number%n == n_last) return
         call self%curve%find_zero(number, [begin, piece%ends(2)], [1.0_wp, -1.0_wp], x, position, is_found)
         search%is_lost = search%is_lost .or. .not. is_found
         if (.not. is_found) return
         call self%find_stability(x, sharp, there)
         if (.not. allocated(there%multipliers)) return
         associate (nearest => there%multipliers(minloc(abs(abs(there%multipliers) - 1.0_wp), dim=1)))
            kind = kind_at(nearest)
            is_new = .not. (kind == bifurcation%branch .and. is_branch_known(self, search))
            if (abs(abs(nearest) - 1.0_wp) <= agreement .and. is_new) call add_bifurcation(self, kind, piece, position, x)
         end associate
         call evaluate_stability_at(self, min(piece%ends(2), position + rounding*self%curve%last_step), sharp, begin, there)
         if (.not. allocated(there%multipliers)) return
         number%n = n_outside(there)
      end do
   end subroutine find_by_number

   !> Whether the points on a piece explain the increase in the number of multipliers outside the unit circle.
   pure logical function is_explained(points, piece, n_more)
      type(waiting_t), intent(in) :: points(:)
      type(piece_t), intent(in) :: piece
      integer, intent(in) :: n_more
      integer :: i, n_pairs, n_single

      n_single = 0
      n_pairs = 0
      do i = 1, size(points)
         if (points(i)%position < piece%ends(1) .or. points(i)%position > piece%ends(2)) cycle
         if (any(points(i)%kind == [curve_kind%fold, curve_kind%branch, curve_kind%period_doubling, &
                                    curve_kind%symmetry_breaking])) n_single = n_single + 1
         if (points(i)%kind == curve_kind%neimark_sacker) n_pairs = n_pairs + 1
      end do
      is_explained = n_more == 0 .or. (modulo(n_more - n_single, 2) == 0 .and. abs(n_more) <= n_single + 2*n_pairs)
   end function is_explained

   !> The kind of bifurcation at which a multiplier crosses the unit circle at its present position.
   pure integer function kind_at(multiplier) result(kind)
      complex(wp), intent(in) :: multiplier

      kind = bifurcation%branch
      if (real(multiplier) < 0.0_wp) kind = bifurcation%doubling
      if (abs(aimag(multiplier)) > 0.0_wp) kind = bifurcation%torus
   end function kind_at

   !> Whether a multiplier 1 on the step is a fold or a branch point that was found without multipliers.
   pure logical function is_branch_known(self, search)
      class(followed_motion_t), intent(in) :: self
      type(search_t), intent(in) :: search

      is_branch_known = size(search%folds, 2) > 0 .or. search%has_branched .or. finds_all_intersections(self)
   end function is_branch_known

   !> Adds a bifurcation of the series, if the motion of the time domain has it.
   subroutine add_bifurcation(self, kind, piece, position, x)
      class(followed_motion_t), intent(inout), target :: self
      integer, intent(in) :: kind
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: position, x(:)
      logical :: is_there

      call add(self, kind_of(kind), position, x)
      call sharpen(self, kind, piece%ends, is_there)
      if (.not. is_there) then
         self%waiting = self%waiting(:size(self%waiting) - 1)
         return
      end if
      associate (found => self%waiting(size(self%waiting)))
         if (abs(found%position - position) > 0.0_wp) return           ! of the integrated motion, which has no error of the set
         call find_shift(self, kind, piece, found)
      end associate
   end subroutine add_bifurcation

   !> Finds by how much the value of a bifurcation moves with a change of the multipliers.
   subroutine find_shift(self, kind, piece, found)
      class(followed_motion_t), intent(inout), target :: self
      integer, intent(in) :: kind
      type(piece_t), intent(in) :: piece
      type(waiting_t), intent(inout) :: found
      type(bifurcation_event_t) :: change
      real(wp) :: beside, function_there, x(size(self%curve%x))
      logical :: is_on_curve

      beside = minor*self%curve%last_step
      if (found%position + beside > piece%ends(2)) beside = -min(beside, 0.5_wp*(found%position - piece%ends(1)))
      call self%curve%point_at(found%position + beside, x, is_on_curve)
      if (.not. is_on_curve) return
      change = bifurcation_event_t(kind_of(kind), .false., rounding, self, kind)
      function_there = change%value(self%curve, x)
      if (.not. abs(function_there) > 0.0_wp) return
      found%bifurcation = kind
      found%shift = abs((x(size(x)) - found%x(size(x)))/function_there)
   end subroutine find_shift

   !> Finds where the branch ends because it returns to the curve that it has left: at another intersection by symmetry,
   !> or where its period halves again. Beyond it the same motions follow, as their mirror images or shifted by a period.
   subroutine find_junction(self)
      class(followed_motion_t), intent(inout), target :: self
      real(wp) :: position, x(size(self%curve%x))
      integer :: i
      logical :: is_there

      if (self%length <= 0.0_wp) return
      if (self%branch == 0 .and. allocated(self%request%origin)) then
         if (self%request%origin%is_torus) return
         call find_halving(self, x, position, is_there)
      else if (self%has_left_branch()) then
         call find_intersection(self, x, position, is_there)
      else
         return
      end if
      if (.not. is_there) return
      self%is_closed = .true.
      self%waiting = pack(self%waiting, [(.not. belongs_to_junction(self%waiting(i)), i=1, size(self%waiting))])
      call add(self, curve_kind%end, position, x)
      self%waiting(size(self%waiting))%is_crossing = .true.

   contains

      !> At the junction the value has an extremum, the determinant is zero, and responses are extremal by symmetry.
      pure logical function belongs_to_junction(point)
         type(waiting_t), intent(in) :: point

         belongs_to_junction = (curve_kinds(point%kind)%is_extreme .or. &
                                any(point%kind == [curve_kind%branch, curve_kind%symmetry_breaking])) .and. &
                               abs(point%position - position) <= minor*self%curve%last_step
      end function belongs_to_junction
   end subroutine find_junction

   !> Finds where the doubled period halves again: the value has an extremum there, and the part of the motion that repeats
   !> after two periods alone passes through zero, or has become zero within the shortest step.
   subroutine find_halving(self, x, position, is_there)
      class(followed_motion_t), intent(inout), target :: self
      real(wp), intent(out) :: x(:), position
      logical, intent(out) :: is_there
      real(wp) :: share
      integer :: i

      share = retained_doubling(self)
      is_there = share <= faint
      if (.not. is_there) return
      i = findloc(self%waiting%kind, curve_kind%fold, dim=1)
      is_there = i > 0 .or. share >= -faint
      x = self%curve%x
      position = self%curve%last_step
      if (i == 0) return
      x = self%waiting(i)%x
      position = self%waiting(i)%position
   end subroutine find_halving

   !> Share of the part of a motion of doubled period that repeats after two periods alone, of its size at the start of the
   !> step, that is left at the end of the step; 1 for other motions.
   real(wp) function retained_doubling(self) result(share)
      class(followed_motion_t), intent(in) :: self
      real(wp) :: before, behind
      integer :: d, h

      share = 1.0_wp
      if (self%branch /= 0 .or. .not. allocated(self%request%origin)) return
      if (self%request%origin%is_torus) return
      before = 0.0_wp
      behind = 0.0_wp
      associate (set => self%problem%model%discretisation%harmonics, last_x => self%curve%last_x, x => self%curve%x, &
                 weights => self%weights)
         do h = 1, set%n_harmonics
            if (all(modulo(set%tuples(:, h), 2) == 0)) cycle
            do d = 0, self%problem%n_dofs - 1
               associate (parts => d*set%n_coefficients + [set%cos_at(h), set%sin_at(h)])
                  before = before + sum((last_x(parts)/weights(parts))**2)
                  behind = behind + sum(last_x(parts)*x(parts)/weights(parts)**2)
               end associate
            end do
         end do
      end associate
      if (before > 0.0_wp) share = behind/before
   end function retained_doubling

   !> Finds another origin of branches on the step, at which the value has an extremum.
   subroutine find_intersection(self, x, position, is_there)
      class(followed_motion_t), intent(inout), target :: self
      real(wp), intent(out) :: x(:), position
      logical, intent(out) :: is_there
      integer :: i, k

      is_there = .false.
      associate (curve => self%curve, units => self%curve%units)
         do k = 1, size(self%origins)
            if (k == self%branch .or. self%origins(k)%is_apart) cycle
            x = transferred(self%origins(k)%level%set, self%level%set, self%origins(k)%x, size(self%problem%which))
            associate (gap => (x - curve%last_x)/units, direction => curve%last_direction/units)
               position = dot_product(gap, direction)/norm2(direction)
               if (position <= 0.0_wp .or. position > curve%last_step) cycle
               if (norm2(gap - position*direction/norm2(direction)) > minor*curve%last_step) cycle
            end associate
            is_there = any([(self%waiting(i)%kind == curve_kind%fold .and. &
                             abs(self%waiting(i)%position - position) <= minor*curve%last_step, i=1, size(self%waiting))])
            if (is_there) return
         end do
      end associate
   end subroutine find_intersection

   !> Moves the bifurcation found last to that of the integrated periodic motion: near a kink of a law the multipliers
   !> of a truncated motion have a first-order error in the truncation.
   subroutine sharpen(self, kind, piece, is_there)
      class(followed_motion_t), intent(inout), target :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: piece(2) !! of the step, on which the integrated motion is searched for it
      logical, intent(out) :: is_there !! false: the integrated motion has none there, as far as known
      type(bifurcation_event_t) :: integrated
      real(wp) :: ends(2), position, values(2), x(size(self%curve%x))
      integer :: i, k
      logical :: is_on_curve

      associate (model => self%model, curve => self%curve, found => self%waiting(size(self%waiting)))
         is_there = model%options%stability%method /= stability_method%integration .or. model%system%tones%n_tones > 1 .or. &
                    allocated(self%known%impacts)
         if (.not. is_there) is_there = all([(model%system%laws(i)%law%n_switches + model%system%laws(i)%law%n_states == 0, &
                                              i=1, size(model%system%laws))])
         if (is_there) return
         integrated = bifurcation_event_t(kind_of(kind), .false., rounding, self, kind, .true.)
         do i = -3, 0                                                ! decades of the step
            ends = min(max(found%position + 10.0_wp**i*curve%last_step*[-1.0_wp, 1.0_wp], piece(1)), piece(2))
            do k = 1, 2
               call curve%point_at(ends(k), x, is_on_curve)
               if (.not. is_on_curve) return
               values(k) = integrated%value(curve, x)
               if (ieee_is_nan(values(k))) return
            end do
            if (.not. values(1)*values(2) < 0.0_wp) cycle
            call curve%find_zero(integrated, ends, values, x, position, is_there)
            if (.not. is_there) return
            found%position = position
            found%x = x
            return
         end do
      end associate
   end subroutine sharpen

   !> Finds wanted values and ends of the range; folds divide the step.
   subroutine find_values(self, search)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(value_event_t) :: event
      real(wp), allocatable :: wanted(:)
      real(wp), allocatable :: positions(:), values(:)
      real(wp) :: position, x(size(self%curve%x))
      integer :: i, k, n
      logical :: is_found, is_there

      n = size(x)
      associate (curve => self%curve, request => self%request)
         allocate (positions, source=[0.0_wp, search%folds(1, :), curve%last_step])
         allocate (values, source=[curve%last_x(n), search%folds(2, :), curve%x(n)])
         allocate (wanted, source=[request%from, request%to, request%values])
         event%unit = abs(request%to - request%from)
         do i = 1, size(wanted)
            if (i > 2 .and. any(abs(wanted(i) - wanted(:2)) <= 0.0_wp)) cycle
            event%wanted = wanted(i)
            do k = 1, size(positions) - 1
               if (.not. (values(k) - wanted(i))*(values(k + 1) - wanted(i)) < 0.0_wp) then
                  if (.not. abs(values(k + 1) - wanted(i)) <= 0.0_wp) cycle
               end if
               call curve%find_zero(event, positions(k:k + 1), (values(k:k + 1) - wanted(i))/event%unit, x, position, is_found)
               if (.not. is_found) search%is_lost = search%is_lost .or. i <= 2     ! nothing lies beyond the ends
               if (.not. is_found) cycle
               x(n) = wanted(i)
               call self%correct_at_value(x, is_there)
               call add(self, merge(curve_kind%end, curve_kind%value, i <= 2), position, x)
            end do
         end do
      end associate
   end subroutine find_values

   !> Locates the zero of an event whose function has changed its sign on the step, or the two zeros if it changes it twice.
   subroutine find_all(self, search, event, at_ends, between, response)
      class(followed_motion_t), intent(inout), target :: self
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
         call find_other_sign(self%curve, event, at_ends, between, middle, value, is_found)
         if (.not. is_found) return
         call find(self, search, event, [at_ends(1), value], is_found, [0.0_wp, middle])
         call find(self, search, event, [value, at_ends(2)], is_found, [middle, self%curve%last_step])
      else if (changes_sign()) then
         call find(self, search, event, at_ends, is_found)
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
   subroutine find(self, search, event, at_ends, is_found, part)
      class(followed_motion_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      class(event_t), intent(in) :: event
      real(wp), intent(in) :: at_ends(2)
      logical, intent(out) :: is_found
      real(wp), intent(in), optional :: part(2)
      class(event_t), allocatable :: sought
      real(wp) :: ends(2), position, x(size(self%curve%x))

      is_found = .false.
      if (curve_kinds(event%kind)%sense*at_ends(1) < 0.0_wp) return
      ends = [0.0_wp, self%curve%last_step]
      if (present(part)) ends = part
      allocate (sought, source=event)
      call self%curve%find_zero(sought, ends, at_ends, x, position, is_found)
      search%is_lost = search%is_lost .or. .not. is_found
      if (is_at_origin(self)) is_found = is_found .and. position > next_to_none*self%curve%last_step
      if (is_found) call add(self, event%kind, position, x)
   end subroutine find

   subroutine evaluate_stability_at(self, there, tolerance, position, stability)
      class(followed_motion_t), intent(inout), target :: self
      real(wp), intent(in) :: there, tolerance
      real(wp), intent(out) :: position
      type(stability_t), intent(out) :: stability                     !! without multipliers if they are not found
      real(wp) :: x(size(self%curve%x))
      logical :: is_on_curve

      position = there
      call self%curve%point_at(position, x, is_on_curve)
      if (is_on_curve) call self%find_stability(x, tolerance, stability)
   end subroutine evaluate_stability_at

   !> Adds a point of a kind to the waiting ones.
   subroutine add(self, kind, position, x)
      class(followed_motion_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: position, x(:)

      call add_waiting(self%waiting, kind, position, x)
   end subroutine add

   !> Bound of a function at its zero, from rounding or from the roughness of the residual.
   pure real(wp) function rounding_of(self)
      class(followed_motion_t), intent(in) :: self

      rounding_of = max(sharp, 10.0_wp*self%curve%corrector%tolerance)
   end function rounding_of

   !> Whether the step begins at the origin of this branch, a branch point or a separate motion.
   pure logical function is_at_origin(self)
      class(followed_motion_t), intent(in) :: self

      is_at_origin = self%branch > 0 .and. self%length <= 0.0_wp
   end function is_at_origin

   !> Whether all motions of one period are included, so that the determinant reports all intersections: multipliers
   !> of a truncated motion that pass 1 slightly beside a fold are then no other event.
   pure logical function finds_all_intersections(self)
      class(followed_motion_t), intent(in) :: self

      finds_all_intersections = abs(self%curve%orientation) > 0.0_wp
      if (allocated(self%known%impacts)) return
      associate (set => self%problem%model%discretisation%harmonics)
         finds_all_intersections = finds_all_intersections .and. set%n_harmonics == set%highest(1) + 1
      end associate
   end function finds_all_intersections

   !> Whether both extremes are equal before and after, as for a whirl about the center of a ring.
   pure logical function same_change(before, after)
      real(wp), intent(in) :: before(2), after(2)

      same_change = abs(before(2) - before(1)) <= rounding*maxval(abs(before)) .and. &
         abs(after(2) - after(1)) <= rounding*maxval(abs(after))
   end function same_change

   !> Whether the curve has returned to its start, after steps that led away from it. Its phases may differ.
   logical function is_back(self)
      class(followed_motion_t), intent(in) :: self
      real(wp) :: along, phases(self%model%system%tones%n_tones)
      real(wp), dimension(size(self%start%x)) :: direction_there, there

      is_back = .false.
      associate (curve => self%curve, units => self%curve%units)
         if (self%length < 3.0_wp*curve%last_step) return
         there = self%start%x
         direction_there = self%start%direction
         if (has_images(self)) then
            phases = nearest_phases(self, curve%last_x, there)
            there = image_of(self, there, phases)
            direction_there = image_of(self, direction_there, phases)
         end if
         associate (gap => (there - curve%last_x)/units, direction => curve%last_direction/units)
            along = dot_product(gap, direction)/norm2(direction)
            if (along <= 0.0_wp .or. along > curve%last_step) return
            if (norm2(gap - along*direction/norm2(direction)) > minor*curve%last_step) return
            is_back = dot_product(direction_there/units, direction) > 0.0_wp
         end associate
      end associate
   end function is_back

   real(wp) function response_event_value(self, curve, x) result(value)
      class(response_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      real(wp) :: tangent(size(x)), determinant_sign
      logical :: is_singular

      call curve%tangent_at(x, tangent, determinant_sign, is_singular)
      value = ieee_value(value, ieee_quiet_nan)
      if (.not. is_singular) value = self%motion%function_at(self%response, x, tangent)/self%unit
   end function response_event_value

   real(wp) function bifurcation_event_value(self, curve, x) result(value)
      class(bifurcation_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      type(stability_t) :: there

      call self%motion%find_stability(x, sharp, there, self%is_integrated)
      value = ieee_value(value, ieee_quiet_nan)
      if (.not. allocated(there%multipliers)) return
      if (self%is_product) then
         value = bifurcation_product(self%bifurcation, there%multipliers)
      else
         value = bifurcation_value(self%bifurcation, there%multipliers)
      end if
   end function bifurcation_event_value

   real(wp) function count_event_value(self, curve, x) result(value)
      class(count_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      type(event_values_t) :: known
      type(stability_t) :: there

      value = ieee_value(value, ieee_quiet_nan)
      if (allocated(self%impacts)) then
         call self%motion%find_contact(x, known)
         value = merge(1.0_wp, -1.0_wp, all(known%impacts == self%impacts))
      else
         call self%motion%find_stability(x, sharp, there)
         if (allocated(there%multipliers)) value = merge(1.0_wp, -1.0_wp, n_outside(there) == self%n)
      end if
   end function count_event_value

   !> Number of multipliers outside the unit circle; rounding errors of those on it, as without damping, do not count.
   pure integer function n_outside(stability)
      type(stability_t), intent(in) :: stability

      n_outside = count(abs(stability%multipliers) > 1.0_wp + rounding)
   end function n_outside

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
end module hb_event_location
