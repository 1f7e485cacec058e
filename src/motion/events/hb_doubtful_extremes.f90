!> Folds, peaks and minima of a curve that are smaller than the estimated errors of the motions around them are not
!> reported. Folds are omitted in pairs: between two that are reported the value moves in one direction.
module hb_doubtful_extremes
   use hb_curve, only: curve_t
   use hb_curve_branches, only: branches_t
   use hb_curve_points, only: curve_point_t, name_unlocated, reported_extreme_t
   use hb_error, only: error_t
   use hb_followed, only: followed_t
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: outcome
   use hb_point_kinds, only: curve_kind, curve_kinds
   use hb_stability, only: stability_method, stability_t
   use hb_thresholds, only: estimate_safety, max_bisections
   implicit none
   private
   public :: remove_doubtful_extremes

   real(wp), parameter :: refined_step_ratio = 0.25_wp                ! first and longest step, relative to those of the curve
   real(wp), parameter :: searched_steps = 15.0_wp                    ! part of the curve that is searched, in its last steps
   real(wp), parameter :: min_rise_at_start = 1.0e-3_wp               ! of the value along a curve, in its units: not across it

   !> An extremum of a function along the curve.
   type :: extreme_t
      real(wp) :: sense = 1.0_wp                                      ! -1: a minimum
      integer :: response = 0 ! of the request; the function is its square; 0: the moving value
      real(wp) :: value = 0.0_wp                                      ! of the function
      real(wp) :: error = 0.0_wp                                      ! estimated, of the value: the largest nearby, since
   end type extreme_t

contains

   !> Removes the folds, peaks and minima of the step that are smaller than the estimated error of the motion there.
   !> A truncated motion depends on the positions of its samples relative to the kinks of laws, so its curve is
   !> slightly wavy and has extrema that the exact one does not have. A maximum is accepted if the curve falls on
   !> either side by more than the estimated errors of both ends of the fall, before it has risen by as much. Of
   !> several maxima on the same peak the first is reported. A minimum is the maximum of the negative function. Folds
   !> alternate: of the same sense as the last one, the next one is not reported, nor was the one between them. Otherwise the
   !> fall between them has passed the test behind the last one.
   subroutine remove_doubtful_extremes(followed, curve, branches, reported, points, error)
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout) :: curve                           !! at the end of the step; the work is counted
      type(branches_t), intent(in) :: branches
      type(reported_extreme_t), intent(in) :: reported(:)             !! on this branch
      type(curve_point_t), allocatable, intent(inout) :: points(:)        !! of the step
      type(error_t), allocatable, intent(out) :: error
      type(extreme_t) :: extreme
      logical :: is_retained(size(points))
      real(wp) :: last_sense
      integer :: i
      logical :: has_fall_behind, is_fold

      is_retained = .true.
      call find_last_sense(curve, branches, reported, last_sense, has_fall_behind)
      do i = 1, size(points)
         associate (point => points(i))
            if (.not. curve_kinds(point%kind)%is_extreme) cycle
            extreme = extreme_t(response=point%response, value=function_at(followed, point%response, point%x))
            extreme%sense = curve_kinds(point%kind)%sense
            is_fold = point%kind == curve_kind%fold
            if (is_fold) extreme%sense = sign(1.0_wp, first_rise(curve, points))*(-1)**n_folds_between(points, i)
            is_retained(i) = .not. (is_fold .and. extreme%sense*last_sense > 0.0_wp)
            if (.not. is_retained(i)) cycle
            call raise_error(followed, curve, extreme, point%x, error)
            if (.not. allocated(error)) call raise_error(followed, curve, extreme, curve%last%x, error)
            if (.not. allocated(error)) call raise_error(followed, curve, extreme, curve%x, error)
            if (.not. allocated(error)) call find_fall(followed, curve, extreme, reported, point%position, 1, is_retained(i), error)
            if (is_retained(i) .and. .not. allocated(error) .and. .not. (is_fold .and. has_fall_behind)) &
               call find_fall(followed, curve, extreme, reported, point%position, -1, is_retained(i), error)
            if (allocated(error)) return
            if (is_fold .and. .not. is_retained(i)) call name_fold_behind(curve, extreme, points(size(points)))
            point%sense = extreme%sense
            if (.not. (is_fold .and. is_retained(i))) cycle
            last_sense = extreme%sense
            has_fall_behind = .true.
         end associate
      end do
      if (.not. all(is_retained)) points = pack(points, is_retained)
   end subroutine remove_doubtful_extremes

   !> Names the fold behind one that is removed on the same step: the value goes beyond this one, and
   !> moves back at the end of the step.
   pure subroutine name_fold_behind(curve, removed, ending)
      type(curve_t), intent(in) :: curve                              !! at the end of the step
      type(extreme_t), intent(in) :: removed
      type(curve_point_t), intent(inout) :: ending                    !! of the step

      if (ending%kind /= curve_kind%regular .or. ending%hides_fold) return
      associate (n => size(curve%x))
         if (.not. removed%sense*(curve%x(n) - removed%value) > 0.0_wp) return
         if (.not. removed%sense*curve%direction(n) < 0.0_wp) return
      end associate
      call name_unlocated(ending, "1 'fold', 0 located", has_fold=.true.)
   end subroutine name_fold_behind

   !> Finds the sense of the last fold of this branch. The first branch begins at one, unless its start is across the value.
   pure subroutine find_last_sense(curve, branches, reported, sense, is_reported)
      type(curve_t), intent(in) :: curve
      type(branches_t), intent(in) :: branches
      type(reported_extreme_t), intent(in) :: reported(:)
      real(wp), intent(out) :: sense                                  !! 1: a maximum, -1: a minimum, 0: not known
      logical, intent(out) :: is_reported                             !! so its sense was found from a fall behind it
      real(wp) :: rise
      integer :: i, n

      sense = 0.0_wp
      i = maxloc(reported%length, mask=reported%response == 0, dim=1)
      if (i > 0) then
         sense = reported(i)%sense
      else if (branches%number == 0) then
         n = size(curve%x)
         rise = branches%start_on_set%direction(n)/curve%units(n)
         if (abs(rise) > min_rise_at_start) sense = -sign(1.0_wp, rise)
      end if
      is_reported = i > 0 .and. abs(sense) > 0.0_wp
   end subroutine find_last_sense

   !> How the value moves to the first fold of the step: along the direction at its start, which around a kink is that of the
   !> step and not of the curve.
   pure real(wp) function first_rise(curve, points) result(rise)
      type(curve_t), intent(in) :: curve
      type(curve_point_t), intent(in) :: points(:)

      associate (n => size(curve%x))
         rise = curve%last%direction(n)
         if (curve%is_around_kink) rise = points(findloc(points%kind, curve_kind%fold, dim=1))%x(n) - curve%last%x(n)
      end associate
   end function first_rise

   !> Number of folds between the start of the step and the beginning of the arc that ends at a fold. Folds that a change
   !> of the set has left behind the start have negative positions.
   pure integer function n_folds_between(points, i) result(n)
      type(curve_point_t), intent(in) :: points(:)
      integer, intent(in) :: i                                        !! the fold

      n = abs(count(points(:i - 1)%kind == curve_kind%fold) - count(points%kind == curve_kind%fold .and. points%position < 0.0_wp))
   end function n_folds_between

   !> The function at a point of the curve: the moving value, or the square of a response.
   real(wp) function function_at(followed, response, x) result(value)
      class(followed_t), intent(inout), target :: followed
      integer, intent(in) :: response
      real(wp), intent(in) :: x(:)

      value = x(size(x))
      if (response > 0) value = followed%square_at(followed%request%responses(response), x)
   end function function_at

   !> Includes the error of the function at a point near the extremum.
   subroutine raise_error(followed, curve, extreme, x, error)
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout) :: curve                           !! near the point
      type(extreme_t), intent(inout) :: extreme
      real(wp), intent(in) :: x(:)
      type(error_t), allocatable, intent(out) :: error
      type(motion_result_t) :: result
      type(curve_point_t) :: point

      if (.not. (followed%model%options%error_estimate%is_on .or. followed%model%options%accuracy%is_on)) return
      point%kind = curve_kind%regular
      point%x = x
      point%stability = stability_t(method=stability_method%auto)     ! without a verdict: none is searched for
      call followed%describe(curve, point, followed%plane_at(curve, point), result, error)
      if (allocated(error)) return
      associate (found => result%error_estimate)
         if (extreme%response == 0) then
            extreme%error = max(extreme%error, found%parameter_error)
         else if (allocated(found%refined)) then
            associate (response => followed%request%responses(extreme%response))
               extreme%error = max(extreme%error, abs(response%of(found%around, found%refined(response%dof, :)) &
                                                      - function_at(followed, extreme%response, x)))
            end associate
         end if
      end associate
   end subroutine raise_error

   !> Whether the function falls on one side of the extremum by more than the error of its values, before it rises by
   !> as much and, backward, before another extremum that was reported.
   subroutine find_fall(followed, curve, extreme, reported, position, side, is_clear, error)
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout) :: curve                           ! at the end of the step; the work is counted
      type(extreme_t), intent(inout) :: extreme
      type(reported_extreme_t), intent(in) :: reported(:)
      real(wp), intent(in) :: position                                ! on the step
      integer, intent(in) :: side                                     ! 1: forward, -1: backward
      logical, intent(out) :: is_clear
      type(error_t), allocatable, intent(out) :: error
      type(curve_t) :: beside
      real(wp) :: fall, length, span
      integer :: i
      logical :: has_error

      beside = curve
      if (side < 0) then
         beside%x = beside%last%x
         beside%direction = -beside%last%direction
         beside%orientation = 0.0_wp
      end if
      beside%step = refined_step_ratio*beside%last%step
      beside%config%longest_step = refined_step_ratio*beside%config%longest_step
      length = curve%last%length
      span = 0.0_wp
      is_clear = .true.
      has_error = .true.
      do i = 0, max_bisections
         fall = extreme%sense*(extreme%value - function_at(followed, extreme%response, beside%x))
         if (abs(fall) >= estimate_safety*extreme%error .and. .not. has_error) then
            call raise_error(followed, curve, extreme, beside%x, error)           ! here alone, where it decides
            if (allocated(error)) return
         end if
         if (fall >= estimate_safety*extreme%error) exit
         is_clear = fall >= -estimate_safety*extreme%error
         if (i == 0 .and. .not. is_clear) then
            call fall_on_step(followed, curve, extreme, position, side, is_clear)
            if (is_clear) exit
         end if
         if (side < 0 .and. is_clear) is_clear = .not. any(reported%response == extreme%response .and. &
                                                           reported%length >= length)
         if (.not. is_clear .or. span >= searched_steps*curve%last%step) exit
         call beside%advance()
         if (beside%status /= outcome%pending) exit
         length = length - beside%last%step
         span = span + beside%last%step
         call beside%turn()
         has_error = .false.
      end do
      curve%report = beside%report
   end subroutine find_fall

   !> As `find_fall`, on the step itself, for an extremum that is followed or preceded by another one there.
   subroutine fall_on_step(followed, curve, extreme, position, side, is_clear)
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout) :: curve
      type(extreme_t), intent(in) :: extreme
      real(wp), intent(in) :: position
      integer, intent(in) :: side
      logical, intent(out) :: is_clear
      integer, parameter :: n_halvings = 12
      real(wp) :: fall, limit, x(size(curve%x))
      integer :: i

      is_clear = .false.
      limit = merge(curve%last%step, 0.0_wp, side > 0)
      do i = n_halvings, 1, -1
         call curve%point_at(position + (limit - position)*0.5_wp**i, x, is_clear)
         if (.not. is_clear) return
         fall = extreme%sense*(extreme%value - function_at(followed, extreme%response, x))
         is_clear = fall >= estimate_safety*extreme%error .and. fall > 0.0_wp
         if (is_clear .or. fall < -estimate_safety*extreme%error) return
      end do
   end subroutine fall_on_step
end module hb_doubtful_extremes
