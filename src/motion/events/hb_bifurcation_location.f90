!> Location of the bifurcations on a completed step of a curve of motions, from the multipliers at both of its ends and of its
!> pieces between grazes.
module hb_bifurcation_location
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_quiet_nan, ieee_value
   use hb_bifurcation, only: bifurcation, bifurcation_product, bifurcation_value, is_branch, is_torus, movement
   use hb_curve, only: curve_t, event_t
   use hb_curve_events, only: branch_event_t, n_outside
   use hb_curve_points, only: curve_point_t
   use hb_event_pairs, only: find_other_sign, may_change_sign, parabola_between, point_between
   use hb_event_search, only: find_pair, find_zeros, search_t, sort_by_position, whole_step
   use hb_followed, only: followed_t
   use hb_kinds, only: wp
   use hb_multiplier_meetings, only: by_angle, meeting
   use hb_point_kinds, only: curve_kind, curve_kinds, kind_of_bifurcation
   use hb_stability, only: max_multipliers, stability_t
   use hb_thresholds, only: certainty_factor, equality_tolerance, location_tolerance, rounding_level, small_share
   implicit none
   private
   public :: add_branches, bifurcation_event_t, find_bifurcations

   integer, parameter :: max_divisions = 6                            ! of a piece
   integer, parameter :: max_halvings = 4                             ! of them
   real(wp), parameter :: max_multiplier_travel = 0.25_wp             ! movement within which two multipliers may meet and part

   !> Part of the step without grazes; at grazes multipliers may jump.
   type :: piece_t
      real(wp) :: ends(2) = 0.0_wp                                    ! positions on the step
      type(stability_t) :: stability(2)                               ! at the ends
   end type piece_t

   !> A zero of a function of the multipliers.
   type, extends(event_t) :: bifurcation_event_t
      class(followed_t), pointer :: followed => null()
      integer :: bifurcation = 0                                      ! one of hb_bifurcation
      logical :: is_integrated = .false.                              ! of the integrated periodic motion
      logical :: is_product = .false.                                 ! of all factors: smooth, and with the same sign
   contains
      procedure :: value => bifurcation_event_value
   end type bifurcation_event_t

   !> A change of the number of multipliers outside the unit circle: 1 while it is a given one, otherwise -1.
   type, extends(event_t) :: number_event_t
      class(followed_t), pointer :: followed => null()
      integer :: n = 0
   contains
      procedure :: value => number_event_value
   end type number_event_t

contains

   !> Finds bifurcations from the multipliers on each piece of the step between its grazes.
   subroutine find_bifurcations(search)
      type(search_t), intent(inout) :: search
      type(piece_t) :: piece
      real(wp), allocatable :: grazes(:)
      integer :: i

      call sort_by_position(search%found)
      allocate (grazes, source=pack(search%found%position, [(curve_kinds(search%found(i)%kind)%multipliers_jump, &
                                                             i=1, size(search%found))]))
      do i = 0, size(grazes)
         piece%ends = whole_step(search)
         piece%stability = [search%at_start%stability, search%at_end%stability]
         associate (tolerance => search%followed%model%options%stability%tolerance, length => search%curve%last%step)
            if (i > 0) &
               call evaluate_stability_at(search, grazes(i) + equality_tolerance*length, tolerance, piece%ends(1), &
                     piece%stability(1))
            if (i < size(grazes)) &
               call evaluate_stability_at(search, grazes(i + 1) - equality_tolerance*length, tolerance, piece%ends(2), &
                     piece%stability(2))
         end associate
         if (.not. piece%ends(1) < piece%ends(2)) cycle
         if (.not. (piece%stability(1)%resolves_circle() .and. piece%stability(2)%resolves_circle())) then
            if (.not. seem_different(piece%stability(1), piece%stability(2))) cycle
         end if
         call make_certain(search, piece%ends(1), piece%stability(1))
         call make_certain(search, piece%ends(2), piece%stability(2))
         if (.not. (piece%stability(1)%resolves_circle() .and. piece%stability(2)%resolves_circle())) cycle
         if (is_branch_known(search)) call find_pair_of_branches(search, piece)
         call find_on_piece(search, piece, merge(max_divisions, 0, are_all_stored(piece)), &
                            movement(piece%stability(1)%multipliers, piece%stability(2)%multipliers) > max_multiplier_travel)
      end do
   end subroutine find_bifurcations

   !> Whether the multipliers at both ends are all that there are: of many only the largest are stored, others at one end than at
   !> the other, and do not tell how far any has moved.
   pure logical function are_all_stored(piece)
      type(piece_t), intent(in) :: piece

      are_all_stored = max(size(piece%stability(1)%multipliers), size(piece%stability(2)%multipliers)) < max_multipliers
   end function are_all_stored

   !> Finds bifurcations from the multipliers at both ends of a piece. It is halved if multipliers move far on it, and divided where
   !> two of them may meet, if they are outside the unit circle there: they leave it and return, with the same number at both ends.
   recursive subroutine find_on_piece(search, piece, n_divisions, moves_far)
      type(search_t), intent(inout) :: search
      type(piece_t), intent(in) :: piece
      integer, intent(in) :: n_divisions                              !! permitted
      logical, intent(in) :: moves_far                                !! a multiplier, on this piece or its neighbour
      type(piece_t) :: parts(2)
      complex(wp), allocatable :: before(:), behind(:)
      real(wp) :: share
      integer :: i, n_before
      logical :: is_divided

      if (moves_far .and. n_divisions > max_divisions - max_halvings) then
         call divide(search, piece, 0.5_wp, parts, is_divided)
         if (is_divided) then
            call find_on_parts()
            return
         end if
      end if
      allocate (before, source=by_angle(piece%stability(1)%multipliers))
      allocate (behind, source=by_angle(piece%stability(2)%multipliers))
      do i = 0, merge(size(before), -1, size(before) == size(behind) .and. size(before) > 0 .and. n_divisions > 0)
         share = meeting(before, behind, i, reach_on(search, piece))
         if (.not. share > 0.0_wp) cycle
         if (search%is_smooth) then
            if (.not. may_be_outside(search, piece, share)) cycle
         end if
         call divide(search, piece, share, parts, is_divided)
         if (.not. is_divided) cycle
         if (any(n_outside(parts(1)%stability(2)) == [n_outside(piece%stability(1)), n_outside(piece%stability(2))])) cycle
         call find_on_parts()
         return
      end do
      n_before = size(search%found)
      call find_by_kind(search, piece)
      call find_by_number(search, piece, n_before)

   contains

      recursive subroutine find_on_parts()
         logical :: move_far
         integer :: k

         move_far = maxval([(movement(parts(k)%stability(1)%multipliers, parts(k)%stability(2)%multipliers), k=1, &
               2)]) > max_multiplier_travel
         do k = 1, 2
            call find_on_piece(search, parts(k), n_divisions - 1, move_far)
         end do
      end subroutine find_on_parts
   end subroutine find_on_piece

   !> Distance that a multiplier may move on a piece, from that on it and on the step before.
   pure real(wp) function reach_on(search, piece) result(reach)
      type(search_t), intent(in) :: search
      type(piece_t), intent(in) :: piece

      reach = max_multiplier_travel
      if (search%at_start%speed >= 0.0_wp) reach = search%at_start%speed*(piece%ends(2) - piece%ends(1))
      reach = max(reach, movement(piece%stability(1)%multipliers, piece%stability(2)%multipliers))
   end function reach_on

   !> Whether the number of multipliers outside the unit circle may be another one at a place of a smooth step than at both ends
   !> of the piece.
   logical function may_be_outside(search, piece, share)
      type(search_t), intent(inout) :: search
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: share                                   !! of the piece
      type(stability_t) :: there
      real(wp) :: x(size(search%curve%x))
      logical :: is_there

      associate (position => piece%ends(1) + share*(piece%ends(2) - piece%ends(1)))
         call point_between(search%curve, position/search%curve%last%step, x, is_there)
      end associate
      may_be_outside = .false.
      if (is_there) call search%followed%find_stability(x, search%followed%model%options%stability%tolerance, there)
      if (allocated(there%multipliers)) may_be_outside = n_outside(there) /= n_outside(piece%stability(1)) .and. &
                                                         n_outside(there) /= n_outside(piece%stability(2))
   end function may_be_outside

   !> Divides a piece in two, if the multipliers there are known.
   subroutine divide(search, piece, share, parts, is_divided)
      type(search_t), intent(inout) :: search
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: share                                   !! of the piece, of its first part
      type(piece_t), intent(out) :: parts(2)
      logical, intent(out) :: is_divided

      parts = piece
      associate (position => parts(1)%ends(2), there => parts(1)%stability(2))
         call evaluate_stability_at(search, piece%ends(1) + share*(piece%ends(2) - piece%ends(1)), &
                                    search%followed%model%options%stability%tolerance, position, there)
         is_divided = there%resolves_circle()
         if (is_divided) call make_certain(search, position, there)
         is_divided = there%resolves_circle()
         parts(2)%ends(1) = position
         parts(2)%stability(1) = there
      end associate
   end subroutine divide

   !> Whether multipliers with errors, taken as they are, would have passed the unit circle.
   pure logical function seem_different(a, b)
      type(stability_t), intent(in) :: a, b
      integer :: kind

      seem_different = .false.
      if (.not. (allocated(a%multipliers) .and. allocated(b%multipliers))) return
      seem_different = n_outside(a) /= n_outside(b)
      do kind = bifurcation%branch, bifurcation%torus
         seem_different = seem_different .or. ((bifurcation_value(kind, a%multipliers) < 0.0_wp) .neqv. &
                                               (bifurcation_value(kind, b%multipliers) < 0.0_wp))
      end do
   end function seem_different

   !> Recomputes multipliers that are so close to the unit circle that their error may determine on which side they
   !> are.
   subroutine make_certain(search, position, there)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: position
      type(stability_t), intent(inout) :: there
      type(stability_t) :: better
      real(wp) :: same_position

      if (.not. allocated(there%multipliers)) return
      associate (tolerance => max(search%followed%model%options%stability%tolerance, there%noise))
         if (minval(abs(abs(there%multipliers) - 1.0_wp)) > certainty_factor*tolerance .and. there%resolves_circle()) return
      end associate
      if (certainty_factor*epsilon(1.0_wp)*maxval(abs(there%multipliers)) >= small_share) return ! nor sharply
      call evaluate_stability_at(search, position, location_tolerance, same_position, better)
      if (.not. allocated(better%multipliers)) return
      there%multipliers = better%multipliers
      there%noise = better%noise
   end subroutine make_certain

   !> Finds the zeros of the function of each kind: one, or two if it has the same sign at both ends.
   subroutine find_by_kind(search, piece)
      type(search_t), intent(inout) :: search
      type(piece_t), intent(in) :: piece
      type(bifurcation_event_t) :: change
      type(curve_point_t), allocatable :: points(:)
      real(wp) :: at_ends(2), middle
      integer :: kind
      logical :: is_found

      do kind = bifurcation%branch, bifurcation%torus
         if (kind == bifurcation%branch .and. is_branch_known(search)) cycle
         at_ends(1) = bifurcation_value(kind, piece%stability(1)%multipliers)
         at_ends(2) = bifurcation_value(kind, piece%stability(2)%multipliers)
         if (minval(abs(at_ends)) <= rounding_level) cycle
         change = bifurcation_event_t(kind_of_bifurcation(kind), .false., rounding_level, search%followed, kind)
         if (at_ends(1)*at_ends(2) < 0.0_wp) then
            call find_zeros(search, change, piece%ends, at_ends, [real(wp) ::], points)
         else
            call find_place_between(search, kind, piece, at_ends, middle, is_found)
            if (.not. is_found) cycle
            call find_pair(search, change, piece%ends, at_ends, middle, points)
         end if
         call add_bifurcations(search, kind, piece%ends, points)
      end do
   end subroutine find_by_kind

   !> Finds two branch points on a step whose determinant has the same sign at both ends: it has the other sign where a
   !> multiplier is beyond 1. One that passes 1 twice is closest to 1 at both ends.
   subroutine find_pair_of_branches(search, piece)
      type(search_t), intent(inout) :: search
      type(piece_t), intent(in) :: piece
      type(curve_point_t), allocatable :: points(:)
      real(wp) :: at_ends(2), middle
      integer :: i
      logical :: is_found

      if (size(search%folds, 2) > 0 .or. search%has_branched) return
      at_ends = [(bifurcation_value(bifurcation%branch, piece%stability(i)%multipliers), i=1, 2)]
      if (minval(abs(at_ends)) <= rounding_level .or. .not. at_ends(1)*at_ends(2) > 0.0_wp) return
      if (piece%ends(2) - piece%ends(1) < search%curve%last%step) return
      if (is_branch(piece%stability(1)%multipliers) .and. is_branch(piece%stability(2)%multipliers)) then
         call find_place_between(search, bifurcation%branch, piece, at_ends, middle, is_found)
      else
         call find_meeting_at_one()
      end if
      if (.not. is_found) return
      call find_pair(search, branch_event_t(curve_kind%branch, .true.), whole_step(search), &   ! only a sign
                     spread(search%curve%orientation, 1, 2), middle, points)
      call add_branches(search, points)

   contains

      !> Finds a place where a complex multiplier that is closest to 1 at both ends may have met its conjugate and be beyond 1.
      subroutine find_meeting_at_one()
         complex(wp), allocatable :: before(:), behind(:)
         real(wp) :: share

         is_found = .false.
         if (.not. are_all_stored(piece)) return
         allocate (before, source=by_angle(piece%stability(1)%multipliers))
         allocate (behind, source=by_angle(piece%stability(2)%multipliers))
         if (size(before) == 0 .or. size(before) /= size(behind) .or. .not. search%is_smooth) return
         share = meeting(before, behind, 0, reach_on(search, piece))
         if (share > 0.0_wp) is_found = may_be_outside(search, piece, share)
         middle = share*search%curve%last%step
      end subroutine find_meeting_at_one
   end subroutine find_pair_of_branches

   !> Finds a place where the function of a kind has the other sign than at both ends of a piece. Multipliers in the middle are
   !> only computed where the function is close to zero, and not nearly constant, as that of a torus or branch point is with little
   !> damping.
   subroutine find_place_between(search, kind, piece, at_ends, position, is_found)
      type(search_t), intent(inout) :: search
      integer, intent(in) :: kind
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: at_ends(2)
      real(wp), intent(out) :: position                               !! on the step
      logical, intent(out) :: is_found
      real(wp), parameter :: near_bifurcation = 0.3_wp                ! to a bifurcation; also the least relative change
      type(bifurcation_event_t) :: change
      type(stability_t) :: there
      real(wp) :: products(2), value, x(size(search%curve%x))
      real(wp), allocatable :: between(:)

      is_found = .false.
      position = 0.0_wp
      if (.not. search%is_smooth .or. minval(abs(at_ends)) > near_bifurcation) return
      if (kind /= bifurcation%doubling .and. abs(at_ends(2) - at_ends(1)) < near_bifurcation*minval(abs(at_ends))) return
      call point_between(search%curve, 0.5_wp*sum(piece%ends)/search%curve%last%step, x, is_found)
      if (is_found) call search%followed%find_stability(x, search%followed%model%options%stability%tolerance, there)
      is_found = .false.
      if (.not. allocated(there%multipliers)) return
      products = [bifurcation_product(kind, piece%stability(1)%multipliers), bifurcation_product(kind, &
                                                                                                 piece%stability(2)%multipliers)]
      between = parabola_between(products, bifurcation_product(kind, there%multipliers))
      if (.not. may_change_sign(products, between)) return
      change = bifurcation_event_t(kind_of_bifurcation(kind), .false., rounding_level, search%followed, kind, is_product=.true.)
      call find_other_sign(search%curve, change, piece%ends, products, between, position, value, is_found)
   end subroutine find_place_between

   !> If the bifurcations found do not explain the change in the number of multipliers outside the unit circle on a
   !> piece, as when two cross it in the same way, each change of this number is located instead.
   subroutine find_by_number(search, piece, n_before)
      type(search_t), intent(inout) :: search
      type(piece_t), intent(in) :: piece
      integer, intent(in) :: n_before                                 !! points so far, found without multipliers
      type(number_event_t) :: number
      type(stability_t) :: there
      type(curve_point_t), allocatable :: points(:)
      real(wp) :: begin
      integer :: i, kind, n_last
      logical :: is_new

      n_last = n_outside(piece%stability(2))
      number%n = n_outside(piece%stability(1))
      if (is_explained(search%found, piece, n_last - number%n)) return
      search%found = search%found(:n_before)
      number%followed => search%followed
      number%may_jump = .true.
      begin = piece%ends(1)
      do i = 1, max_multipliers
         if (number%n == n_last) return
         call find_zeros(search, number, [begin, piece%ends(2)], [1.0_wp, -1.0_wp], [real(wp) ::], points)
         if (size(points) == 0) return
         call search%followed%find_stability(points(1)%x, location_tolerance, there)
         if (.not. allocated(there%multipliers)) return
         associate (nearest => there%multipliers(minloc(abs(abs(there%multipliers) - 1.0_wp), dim=1)))
            kind = kind_at(nearest)
            is_new = .not. (kind == bifurcation%branch .and. is_branch_known(search))
            points%kind = kind_of_bifurcation(kind)
            if (abs(abs(nearest) - 1.0_wp) <= equality_tolerance .and. is_new) &
               call add_bifurcations(search, kind, piece%ends, points)
         end associate
         call evaluate_stability_at(search, min(piece%ends(2), points(1)%position + rounding_level*search%curve%last%step), &
               location_tolerance, &
                                    begin, there)
         if (.not. allocated(there%multipliers)) return
         number%n = n_outside(there)
      end do
   end subroutine find_by_number

   !> Whether the points on a piece explain the increase in the number of multipliers outside the unit circle.
   pure logical function is_explained(points, piece, n_more)
      type(curve_point_t), intent(in) :: points(:)
      type(piece_t), intent(in) :: piece
      integer, intent(in) :: n_more
      integer :: i, n_pairs, n_single

      n_single = 0
      n_pairs = 0
      do i = 1, size(points)
         if (points(i)%position < piece%ends(1) .or. points(i)%position > piece%ends(2)) cycle
         select case (curve_kinds(points(i)%kind)%bifurcation)
         case (bifurcation%branch, bifurcation%doubling)
            n_single = n_single + 1
         case (bifurcation%torus)
            n_pairs = n_pairs + 1
         end select
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
   pure logical function is_branch_known(search)
      type(search_t), intent(in) :: search

      is_branch_known = size(search%folds, 2) > 0 .or. search%has_branched .or. finds_all_intersections(search)
   end function is_branch_known

   !> Adds bifurcations of the series, those that the motion of the time domain has as well. A pair of reciprocal real
   !> multipliers is no torus bifurcation.
   subroutine add_bifurcations(search, kind, piece, points)
      type(search_t), intent(inout) :: search
      integer, intent(in) :: kind
      real(wp), intent(in) :: piece(2)                                !! positions on the step
      type(curve_point_t), intent(in) :: points(:)                        !! on the piece, in their order
      type(stability_t) :: there
      type(curve_point_t) :: point
      real(wp) :: ends(2)
      integer :: i
      logical :: is_there

      do i = 1, size(points)
         point = points(i)
         if (kind == bifurcation%torus) then
            call search%followed%find_stability(point%x, location_tolerance, there)
            if (.not. allocated(there%multipliers)) cycle
            if (.not. is_torus(there%multipliers)) cycle
         end if
         ends = around(points, i, piece)
         call sharpen(search, kind, ends, point, is_there)
         if (.not. is_there) cycle
         ! that of the integrated motion has no error of the set
         if (.not. abs(point%position - points(i)%position) > 0.0_wp) call find_shift(search, kind, ends, point)
         search%found = [search%found, point]
      end do
   end subroutine add_bifurcations

   !> Adds branch points of the step, each as that of the integrated motion if this has it.
   subroutine add_branches(search, points)
      type(search_t), intent(inout) :: search
      type(curve_point_t), intent(inout) :: points(:)                     !! in their order
      integer :: i
      logical :: is_there

      do i = 1, size(points)
         call sharpen(search, bifurcation%branch, around(points, i, whole_step(search)), points(i), is_there)
      end do
      search%found = [search%found, points]
   end subroutine add_branches

   !> The part of a piece between the neighbours of a point on it.
   pure function around(points, i, piece) result(ends)
      type(curve_point_t), intent(in) :: points(:)                        !! in their order
      integer, intent(in) :: i
      real(wp), intent(in) :: piece(2)
      real(wp) :: ends(2)

      ends = piece
      if (i > 1) ends(1) = points(i - 1)%position
      if (i < size(points)) ends(2) = points(i + 1)%position
   end function around

   !> Finds by how much the value of a bifurcation moves with a change of the multipliers.
   subroutine find_shift(search, kind, piece, found)
      type(search_t), intent(inout) :: search
      integer, intent(in) :: kind
      real(wp), intent(in) :: piece(2)
      type(curve_point_t), intent(inout) :: found
      type(bifurcation_event_t) :: change
      real(wp) :: beside, function_there, x(size(search%curve%x))
      logical :: is_on_curve

      beside = small_share*search%curve%last%step
      if (found%position + beside > piece(2)) beside = -min(beside, 0.5_wp*(found%position - piece(1)))
      call search%curve%point_at(found%position + beside, x, is_on_curve)
      if (.not. is_on_curve) return
      change = bifurcation_event_t(kind_of_bifurcation(kind), .false., rounding_level, search%followed, kind)
      function_there = change%value(search%curve, x)
      if (.not. abs(function_there) > 0.0_wp) return
      found%bifurcation = kind
      found%shift = abs((x(size(x)) - found%x(size(x)))/function_there)
   end subroutine find_shift

   !> Moves a bifurcation to that of the integrated periodic motion: near a kink of a law the multipliers
   !> of a truncated motion have a first-order error in the truncation.
   subroutine sharpen(search, kind, piece, found, is_there)
      type(search_t), intent(inout) :: search
      integer, intent(in) :: kind
      real(wp), intent(in) :: piece(2) !! of the step, on which the integrated motion is searched for it
      type(curve_point_t), intent(inout) :: found
      logical, intent(out) :: is_there !! false: the integrated motion has none there, as far as known
      type(bifurcation_event_t) :: integrated
      real(wp) :: ends(2), position, values(2), x(size(search%curve%x))
      integer :: i, k
      logical :: is_on_curve

      is_there = .not. search%followed%has_integrated_multipliers
      if (is_there) return
      associate (curve => search%curve)
         integrated = bifurcation_event_t(kind_of_bifurcation(kind), .false., rounding_level, search%followed, kind, .true.)
         do i = -3, 0                                                ! decades of the step
            ends = min(max(found%position + 10.0_wp**i*curve%last%step*[-1.0_wp, 1.0_wp], piece(1)), piece(2))
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

   subroutine evaluate_stability_at(search, there, tolerance, position, stability)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: there, tolerance
      real(wp), intent(out) :: position
      type(stability_t), intent(out) :: stability                     !! without multipliers if they are not found
      real(wp) :: x(size(search%curve%x))
      logical :: is_on_curve

      position = there
      call search%curve%point_at(position, x, is_on_curve)
      if (is_on_curve) call search%followed%find_stability(x, tolerance, stability)
   end subroutine evaluate_stability_at

   !> Whether the determinant shows all intersections: multipliers of a truncated motion that pass 1 slightly beside a fold are
   !> then no other event.
   pure logical function finds_all_intersections(search)
      type(search_t), intent(in) :: search

      finds_all_intersections = abs(search%curve%orientation) > 0.0_wp .and. search%followed%has_all_harmonics
   end function finds_all_intersections

   real(wp) function bifurcation_event_value(self, curve, x) result(value)
      class(bifurcation_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      type(stability_t) :: there

      call self%followed%find_stability(x, location_tolerance, there, self%is_integrated)
      value = ieee_value(value, ieee_quiet_nan)
      if (.not. allocated(there%multipliers)) return
      if (self%is_product) then
         value = bifurcation_product(self%bifurcation, there%multipliers)
      else
         value = bifurcation_value(self%bifurcation, there%multipliers)
      end if
   end function bifurcation_event_value

   real(wp) function number_event_value(self, curve, x) result(value)
      class(number_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      type(stability_t) :: there

      value = ieee_value(value, ieee_quiet_nan)
      call self%followed%find_stability(x, location_tolerance, there)
      if (allocated(there%multipliers)) value = merge(1.0_wp, -1.0_wp, n_outside(there) == self%n)
   end function number_event_value
end module hb_bifurcation_location
