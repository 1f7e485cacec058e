!> Where and why a branch of a curve ends, other than at the end of its range: the values ahead are not possible, its tones lock,
!> its points are no longer reliable or use up their work, or it has come back to one of its folds.
module hb_curve_end
   use hb_budget, only: is_spent
   use hb_curve, only: curve_t
   use hb_curve_course, only: curve_course_t, max_exhausted, max_unlocated, max_unreliable
   use hb_curve_points, only: curve_point_t
   use hb_followed, only: followed_t
   use hb_harmonics, only: tuple_text
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_options, only: accuracy_t
   use hb_outcome, only: outcome, reason
   use hb_point_kinds, only: curve_kind
   use hb_text, only: rounded_to, to_text
   use hb_thresholds, only: negligible_step
   implicit none
   private
   public :: describe_end, end_at_fold, returns_to_fold

   character(*), parameter :: returns_to_fold = "the curve returns to this fold: it would pass over its points again"

   integer, parameter :: n_digits_of_lock = 6                         ! an extrapolated value has no more

contains

   !> Status, reason and message where the curve cannot be followed.
   subroutine describe_end(followed, curve, course, result)
      class(followed_t), intent(in) :: followed
      type(curve_t), intent(in) :: curve
      type(curve_course_t), intent(in) :: course
      type(motion_result_t), intent(inout) :: result
      character(500) :: fault

      associate (n => size(curve%x))
         fault = followed%fault_near(curve%x(n), negligible_step*curve%units(n))
         result%status = curve%status
         result%reason = reason%lost_curve
         if (len_trim(fault) > 0) then
            result%status = outcome%failed
            result%reason = reason%error
            result%message = "continuation failed at the value "//to_text(curve%x(n))//": "//trim(fault)
            return
         end if
      end associate
      if (any(result%status == [outcome%collapsed, outcome%locked])) result%reason = reason%none
      result%message = trim(end_text(curve, course, followed%model%options%accuracy))
   end subroutine describe_end

   !> Where and why the curve cannot be followed, for people.
   function end_text(curve, course, accuracy) result(text)
      type(curve_t), intent(in) :: curve
      type(curve_course_t), intent(in) :: course
      type(accuracy_t), intent(in) :: accuracy
      character(500) :: text

      associate (value => curve%x(size(curve%x)))
         if (curve%status == outcome%collapsed) then
            text = "the amplitude of an unknown tone vanishes near the value "//to_text(value)
         else if (curve%status == outcome%locked) then
            text = "the tones lock near the value "//to_text(rounded_to(course%locked_at, n_digits_of_lock))//", where "// &
                   tuple_text(course%locked)//" vanishes: beyond it the motion is periodic"
         else if (course%n_exhausted >= max_exhausted) then
            text = "the curve is given up at the value "//to_text(value)//": each of the last "//to_text(max_exhausted)// &
                   " steps"//is_spent//", that of a point: accuracy%max_work and solver%max_fallback_work"
         else if (course%is_circling()) then
            text = "the curve is given up at the value "//to_text(value)//": the last "//to_text(max_unlocated)// &
                   " folds that it passed were not located and are close to each other, as where it moves back and forth "// &
                   "between kinks of a law; another order, or more samples, changes these"
         else if (course%n_unreliable >= max_unreliable) then
            text = "the curve is lost at the value "//to_text(value)//": the estimated errors of the last "// &
                   to_text(max_unreliable)//" points are "
            if (accuracy%is_on .and. accuracy%grows_set) then
               text = trim(text)//" more than ten times the tolerance"
            else
               text = trim(text)//" too large to be meaningful"
            end if
         else
            text = "continuation failed at the value "//to_text(value)//", arc length "//to_text(curve%length)
         end if
      end associate
   end function end_text

   !> The end of a branch that has come back to a fold.
   pure function end_at_fold(fold) result(point)
      type(curve_point_t), intent(in) :: fold
      type(curve_point_t) :: point

      point = curve_point_t(curve_kind%end, fold%position, fold%x)
      point%is_crossing = .true.                                      ! there the value alone does not select a motion
   end function end_at_fold
end module hb_curve_end
