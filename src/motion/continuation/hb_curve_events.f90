!> Functions along a curve of motions whose zeros are located: folds, grazes, branch points, values; and the one list of them,
!> by which two points are compared, and which shows what was passed and not located.
!>
!> A motion grazes where the smallest or the largest value of a switch of a law over all phases (hb_switch_extremes) is zero:
!> a contact begins, or becomes permanent.
module hb_curve_events
   use hb_curve, only: curve_t, event_t
   use hb_curve_points, only: curve_point_t
   use hb_kinds, only: wp
   use hb_point_kinds, only: curve_kind, curve_kinds, located_by
   use hb_stability, only: stability_t
   use hb_text, only: to_text
   use hb_thresholds, only: rounding_level
   implicit none
   private
   public :: branch_event_t, compared_event_t, describe_unlocated, differing_events, event_values_t, fold_event_t, n_outside
   public :: value_event_t

   !> Quantities at the point of the curve that events compare with those at the end of the next step.
   type :: event_values_t
      real(wp) :: rise = 0.0_wp                                       !! of the value in the direction
      real(wp) :: orientation = 0.0_wp                                !! sign of the determinant; 0: not known
      real(wp), allocatable :: excess(:)                              !! of the value over the ends of the range and wanted ones
      real(wp), allocatable :: functions(:)                           !! of the responses, hb_followed
      real(wp), allocatable :: squares(:)                             !! of the responses
      real(wp), allocatable :: extremes(:, :)                         !! of the switching functions of laws
      integer, allocatable :: impacts(:) !! of each wall in a period, if the unknowns are a state (hb_orbit_branch)
      type(stability_t) :: stability                                  !! without multipliers if none are searched for
      real(wp) :: speed = -1.0_wp                                     !! of the multipliers on the step to here; -1: not known
   end type event_values_t

   !> The function of an event at two points: at both ends of a step, or at one point on two sets of harmonics.
   type :: compared_event_t
      integer :: kind = curve_kind%none                               !! of multipliers: one of several
      integer :: response = 0                                         !! number in the request
      integer :: extreme = 0, switch = 0                              !! of `extremes_of_switches`
      real(wp) :: values(2) = 0.0_wp
   contains
      procedure :: differs => compared_event_differs
      procedure :: is_passed => compared_event_is_passed
      procedure :: is_at => compared_event_is_at
   end type compared_event_t

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

   !> All events whose functions are known at both points.
   pure function compare_events(before, behind, kinds) result(events)
      type(event_values_t), intent(in) :: before, behind
      integer, intent(in) :: kinds(:)                                 !! of points, (responses of the request)
      type(compared_event_t), allocatable :: events(:)
      integer :: i, k

      events = [compared_event_t(curve_kind%fold, values=[before%rise, behind%rise]), &
                compared_event_t(curve_kind%branch, values=[before%orientation, behind%orientation])]
      if (allocated(before%excess) .and. allocated(behind%excess)) &
         events = [events, (compared_event_t(merge(curve_kind%end, curve_kind%value, i <= 2), &
                                             values=[before%excess(i), behind%excess(i)]), i=1, size(before%excess))]
      if (allocated(before%functions) .and. allocated(behind%functions)) &
         events = [events, (compared_event_t(kinds(i), i, values=[before%functions(i), behind%functions(i)]), i=1, size(kinds))]
      if (allocated(before%extremes) .and. allocated(behind%extremes)) then
         if (size(before%extremes, 2) == size(behind%extremes, 2)) &
            events = [events, ((compared_event_t(curve_kind%grazing, 0, i, k, [before%extremes(i, k), behind%extremes(i, k)]), &
                                i=1, 2), k=1, size(behind%extremes, 2))]
      end if
      if (before%stability%resolves_circle() .and. behind%stability%resolves_circle()) &
         events = [events, compared_event_t(curve_kind%symmetry_breaking, values=[1.0_wp, &
                                            merge(1.0_wp, -1.0_wp, n_outside(before%stability) == n_outside(behind%stability))])]
   end function compare_events

   !> Those of them that differ.
   pure function differing_events(before, behind, kinds) result(events)
      type(event_values_t), intent(in) :: before, behind
      integer, intent(in) :: kinds(:)                                 !! likewise
      type(compared_event_t), allocatable :: events(:)

      events = compare_events(before, behind, kinds)
      events = pack(events, events%differs())
   end function differing_events

   !> Whether the function has another sign, or the number of multipliers outside the unit circle is another one.
   elemental logical function compared_event_differs(self) result(differs)
      class(compared_event_t), intent(in) :: self

      differs = product(self%values) < 0.0_wp
   end function compared_event_differs

   !> Whether it differs as at points of its kind: a function of a maximum is positive before it.
   elemental logical function compared_event_is_passed(self) result(is_passed)
      class(compared_event_t), intent(in) :: self

      is_passed = self%differs() .and. curve_kinds(self%kind)%sense*self%values(1) >= 0.0_wp
   end function compared_event_is_passed

   !> Whether a point is located by this function.
   elemental logical function compared_event_is_at(self, point) result(is_at)
      class(compared_event_t), intent(in) :: self
      type(curve_point_t), intent(in) :: point

      associate (by => curve_kinds(self%kind)%by)
         is_at = self%kind == point%kind .or. (by /= located_by%nothing .and. by == curve_kinds(point%kind)%by)
      end associate
      is_at = is_at .and. self%response == point%response
   end function compared_event_is_at

   !> Number of multipliers outside the unit circle; rounding errors of those on it, as without damping, do not count.
   pure integer function n_outside(stability)
      type(stability_t), intent(in) :: stability

      n_outside = count(abs(stability%multipliers) > 1.0_wp + rounding_level)
   end function n_outside

   !> Says at the end of a step which events were passed on it, of how many none or not all were located; blank if all were.
   subroutine describe_unlocated(before, behind, kinds, points, ending)
      type(event_values_t), intent(in) :: before, behind              !! at the ends of the step
      integer, intent(in) :: kinds(:)                                 !! of points, (responses of the request)
      type(curve_point_t), intent(in) :: points(:)                    !! located on the step
      type(curve_point_t), intent(inout) :: ending                    !! of the step
      type(compared_event_t), allocatable :: events(:)
      integer :: i, k, passed(0:ubound(curve_kinds, 1)), located(0:ubound(curve_kinds, 1))

      passed = 0
      located = 0
      allocate (events, source=compare_events(before, behind, kinds))
      do i = 1, size(events)
         associate (event => events(i))
            select case (curve_kinds(event%kind)%by)
            case (located_by%value, located_by%response)
               call compare(event, count(points%kind == event%kind .and. points%response == event%response))
            case (located_by%nothing)
               if (event%kind == curve_kind%value) call compare(event, n_at(event%values(2)))   ! not the ends of the range
            case (located_by%contact)
               ! on a circular orbit both extremes change at one point
               if (any(points%kind == event%kind .and. points%switch == event%switch)) cycle
               if (any(events(:i - 1)%switch == event%switch .and. events(:i - 1)%differs())) cycle
               call compare(event, 0)
            end select
         end associate
      end do
      ending%hides_fold = passed(curve_kind%fold) > 0
      ending%unlocated = ""
      associate (text => ending%unlocated)
         do k = 0, ubound(curve_kinds, 1)
            if (passed(k) == 0) cycle
            if (len_trim(text) > 0) text = trim(text)//","
            text = trim(text)//" "//to_text(passed(k))//" '"//trim(curve_kinds(k)%name)//"', "//to_text(located(k))//" located"
         end do
         text = adjustl(text)
      end associate

   contains

      !> Number of the points that are located at a wanted value, of which that at the end of the step has this excess.
      pure integer function n_at(excess) result(n)
         real(wp), intent(in) :: excess

         associate (at_end => ending%x(size(ending%x)))
            n = count([(points(i)%kind == curve_kind%value .and. &
                        abs(points(i)%x(size(points(i)%x)) - at_end + excess) <= rounding_level*abs(at_end), i=1, size(points))])
         end associate
      end function n_at

      !> Counts a function whose zeros on the step are more or fewer than its signs show.
      subroutine compare(event, n)
         type(compared_event_t), intent(in) :: event
         integer, intent(in) :: n                                     !! located zeros

         if (event%is_passed() .eqv. modulo(n, 2) == 1) return
         if (.not. (event%is_passed() .or. curve_kinds(event%kind)%sense == 0)) return
         passed(event%kind) = passed(event%kind) + merge(n + 1, n, event%is_passed())
         located(event%kind) = located(event%kind) + n
      end subroutine compare
   end subroutine describe_unlocated

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
