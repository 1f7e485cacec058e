!> Where and why a branch of a curve ends, other than at the end of its range: the values ahead are not possible, its tones lock,
!> its points are no longer reliable or use up their work, or it has come back to one of its folds.
module hb_curve_end
   use hb_curve_points, only: waiting_t
   use hb_followed_motion, only: followed_motion_t
   use hb_harmonics, only: tuple_text
   use hb_kinds, only: wp
   use hb_level, only: estimate_of, estimate_of_motion
   use hb_motion_result, only: motion_result_t
   use hb_options, only: accuracy_t
   use hb_outcome, only: outcome, reason
   use hb_point_kinds, only: curve_kind
   use hb_text, only: rounded_to, to_text
   use hb_thresholds, only: next_to_none, reliable
   implicit none
   private
   public :: count_doubtful_steps, describe_end, end_at_fold, end_if_doubtful, returns_to_fold

   character(*), parameter :: returns_to_fold = "the curve returns to this fold: it would pass over its points again"

   integer, parameter :: max_unreliable = 30                          ! consecutive steps with errors too large to be estimated
   integer, parameter :: max_exhausted = 10                           ! consecutive steps that use up the work of a point
   real(wp), parameter :: far_above = 10.0_wp                         ! or in units of the tolerance: too large to go on
   integer, parameter :: n_digits_of_lock = 6                         ! an extrapolated value has no more

contains

   !> Counts the last steps whose errors are not known, or that have used up the work of a point.
   subroutine count_doubtful_steps(self, result)
      class(followed_motion_t), intent(inout) :: self
      type(motion_result_t), intent(in) :: result                     !! at the end of a step

      associate (accuracy => self%model%options%accuracy, course => self%course)
         course%n_unreliable = merge(course%n_unreliable + 1, 0, is_unreliable(estimate_of_motion(result), accuracy))
         course%n_exhausted = merge(course%n_exhausted + 1, 0, self%is_out_of_work .and. estimate_of(result) > accuracy%tolerance)
      end associate
   end subroutine count_doubtful_steps

   !> Ends the branch if nothing is gained by a further step.
   subroutine end_if_doubtful(self, has_ended)
      class(followed_motion_t), intent(inout) :: self
      logical, intent(out) :: has_ended

      associate (course => self%course)
         has_ended = .true.
         if (course%n_unreliable >= max_unreliable .or. course%n_exhausted >= max_exhausted) then
            self%curve%status = outcome%out_of_budget
         else if (allocated(course%locked)) then
            self%curve%status = outcome%locked
         else
            has_ended = .false.
         end if
      end associate
   end subroutine end_if_doubtful

   !> Status, reason and message where the curve cannot be followed.
   subroutine describe_end(self, result)
      class(followed_motion_t), intent(in) :: self
      type(motion_result_t), intent(inout) :: result

      result%status = self%curve%status
      result%reason = reason%lost_curve
      if (is_refused(self) .or. len_trim(fault_of_laws(self)) > 0) then
         result%status = outcome%failed
         result%reason = reason%error
      else if (any(result%status == [outcome%collapsed, outcome%locked])) then
         result%reason = reason%none
      end if
      result%message = trim(end_text(self))
   end subroutine describe_end

   !> Where and why the curve cannot be followed, for people.
   function end_text(self) result(text)
      class(followed_motion_t), intent(in) :: self
      character(500) :: text

      associate (value => self%curve%x(size(self%curve%x)), accuracy => self%model%options%accuracy, course => self%course)
         if (is_refused(self)) then
            text = "continuation failed at the value "//to_text(value)//": "//self%problem%refusal%text
         else if (len_trim(fault_of_laws(self)) > 0) then
            text = "continuation failed at the value "//to_text(value)//": "//fault_of_laws(self)
         else if (self%curve%status == outcome%collapsed) then
            text = "the amplitude of an unknown tone vanishes near the value "//to_text(value)
         else if (self%curve%status == outcome%locked) then
            text = "the tones lock near the value "//to_text(rounded_to(course%locked_at, n_digits_of_lock))//", where "// &
                   tuple_text(course%locked)//" vanishes: beyond it the motion is periodic"
         else if (course%n_exhausted >= max_exhausted) then
            text = "the curve is given up at the value "//to_text(value)//": each of the last "//to_text(max_exhausted)// &
                   " steps has used up the work of a point, accuracy%max_work and solver%max_fallback_work"
         else if (course%n_unreliable >= max_unreliable) then
            text = "the curve is lost at the value "//to_text(value)//": the estimated errors of the last "// &
                   to_text(max_unreliable)//" points are "
            if (accuracy%is_on .and. accuracy%grows_set) then
               text = trim(text)//" more than ten times the tolerance"
            else
               text = trim(text)//" too large to be meaningful"
            end if
         else
            text = "continuation failed at the value "//to_text(value)//", arc length "//to_text(self%curve%length)
         end if
      end associate
   end function end_text

   !> Whether the values ahead are not possible.
   pure logical function is_refused(self)
      class(followed_motion_t), intent(in) :: self

      is_refused = allocated(self%problem%refusal%text)
      associate (n => size(self%curve%x))
         if (is_refused) is_refused = abs(self%problem%refusal%value - self%curve%x(n)) <= next_to_none*self%curve%units(n)
      end associate
   end function is_refused

   !> Why a law cannot continue, here or on the set of odd motions; empty if all laws can.
   pure function fault_of_laws(self) result(text)
      class(followed_motion_t), intent(in) :: self
      character(400) :: text

      text = ""
      if (allocated(self%odd_problem)) text = self%odd_problem%fault_of_laws()
      if (len_trim(text) == 0) text = self%problem%fault_of_laws()
   end function fault_of_laws

   !> Whether an estimated error has no meaning, except that it is large: at a given order. By a tolerance, whether it is far above
   !> that.
   pure logical function is_unreliable(estimate, accuracy)
      real(wp), intent(in) :: estimate
      type(accuracy_t), intent(in) :: accuracy

      is_unreliable = estimate >= reliable
      if (accuracy%is_on .and. accuracy%grows_set) is_unreliable = estimate >= min(far_above*accuracy%tolerance, reliable)
   end function is_unreliable

   !> The end of a branch that has come back to a fold.
   pure function end_at_fold(fold) result(point)
      type(waiting_t), intent(in) :: fold
      type(waiting_t) :: point

      point = waiting_t(curve_kind%end, fold%position, fold%x)
      point%is_crossing = .true.                                      ! there the value alone does not select a motion
   end function end_at_fold
end module hb_curve_end
