!> Whether two motions, at two values of a parameter, lie on one branch: the first is followed towards the second in
!> steps as small as the branch requires.
!> Each step goes along the line through the last two motions and is accepted if the motion found is close to this
!> line; otherwise it is halved. If halving does not help, the branch ends there, usually at a fold. Corners of
!> contact, where samples come into contact one by one, have folds of their own that are too small to matter: steps
!> over them are long, and changes of the motion below `smallest_jump` do not count as another branch. Source: E. L.
!> Allgower and K. Georg, Numerical Continuation Methods (1990), sections 2.2 and 6.1, with the parameter as the
!> length.
module hb_branch_tracking
   use hb_kinds, only: wp
   implicit none
   private
   public :: difference_of, find_branch, finding, smallest_jump, stretch_t, tracking_t

   real(wp), parameter :: smallest_jump = 1.0e-2_wp !! relative to the motion: smaller changes are not another branch
   real(wp), parameter :: first_step = 1.0_wp/16.0_wp, longest_step = 0.25_wp, shortest_step = 1.0_wp/1024.0_wp ! of the interval
   real(wp), parameter :: largest_turn = 0.3_wp                       ! distance from the line, relative to the step
   real(wp), parameter :: small_turn = 0.1_wp                         ! below which steps grow
   real(wp), parameter :: leap_lengths(3) = [4.0_wp, 16.0_wp, 64.0_wp] ! over a fold of a corner, in shortest steps

   !> Outcomes.
   type :: finding_t
      integer :: one_branch = 0
      integer :: ends = 1                                             !! the branch of the first motion ends before the second
      integer :: goes_on = 2                                          !! it does not end, and the second motion is a different one
      integer :: unclear = 3                                          !! the budget was exhausted before
   end type finding_t
   type(finding_t), parameter :: finding = finding_t()

   !> Motions between two values of a parameter, which is 0 at the first and 1 at the second.
   type, abstract :: stretch_t
      logical :: is_spent = .false.                                   !! the budget is exhausted
   contains
      procedure(solve_between), deferred :: solve
   end type stretch_t

   abstract interface
      !> Finds the motion at a value of the parameter from a first guess close to it; sets `is_spent` if it was the
      !> last permitted one.
      subroutine solve_between(self, share, motion, is_solved)
         import :: stretch_t, wp
         class(stretch_t), intent(inout) :: self
         real(wp), intent(in) :: share                                !! 0 to 1
         real(wp), intent(inout) :: motion(:)                         !! coefficients; on entry the first guess
         logical, intent(out) :: is_solved
      end subroutine solve_between
   end interface

   !> A branch as far as it was followed.
   type :: tracking_t
      integer :: finding = finding%unclear
      real(wp) :: share = 0.0_wp                                      !! position at which it ends
      real(wp), allocatable :: motion(:)                              !! there
   end type tracking_t

contains

   !> Whether the motions at both ends of an interval lie on one branch. A branch that appears to end is also followed
   !> from the other side; if that leads back to its end, it continues: the first attempt may have failed at a corner.
   subroutine find_branch(stretch, first, last, tracking)
      class(stretch_t), intent(inout) :: stretch
      real(wp), intent(in) :: first(:), last(:)
      type(tracking_t), intent(out) :: tracking
      type(tracking_t) :: back

      call track(stretch, 0.0_wp, first, last, tracking)
      if (tracking%finding /= finding%ends) return
      call track(stretch, 1.0_wp, last, first, back)
      if (back%finding == finding%one_branch) tracking%finding = finding%one_branch
   end subroutine find_branch

   !> Follows the branch of one motion from one end of the interval to the other.
   subroutine track(stretch, start, first, last, tracking)
      class(stretch_t), intent(inout) :: stretch
      real(wp), intent(in) :: start                                   !! 0 or 1
      real(wp), intent(in) :: first(:)                                !! motion there
      real(wp), intent(in) :: last(:)                                 !! motion at the other end
      type(tracking_t), intent(out) :: tracking
      real(wp) :: allowed, done, next(size(first)), slope(size(first)), step, turn
      logical :: has_slope, is_solved

      tracking%motion = first
      done = 0.0_wp
      step = first_step
      has_slope = .false.
      slope = 0.0_wp
      do while (done < 1.0_wp)
         step = min(step, 1.0_wp - done)
         if (stretch%is_spent) exit
         call solve_after(step, is_solved)
         turn = norm2(next - tracking%motion - step*slope)
         allowed = largest_turn*norm2(next - tracking%motion)
         if (.not. has_slope) allowed = 0.5_wp*largest_turn*norm2(last - first)
         if (is_solved) is_solved = turn <= allowed .or. difference_of(next, tracking%motion) <= smallest_jump
         if (is_solved) then
            call accept_step(merge(2.0_wp, 1.0_wp, turn <= small_turn/largest_turn*allowed))
         else if (step > shortest_step) then
            step = 0.5_wp*step
         else
            call leap(is_solved)
            if (.not. is_solved) exit
         end if
      end do
      tracking%share = abs(start - done)
      if (done >= 1.0_wp) then
         tracking%finding = merge(finding%one_branch, finding%goes_on, difference_of(tracking%motion, last) <= smallest_jump)
      else if (.not. stretch%is_spent) then
         tracking%finding = finding%ends
      end if

   contains

      !> Finds the motion after one more step.
      subroutine solve_after(length, is_found)
         real(wp), intent(in) :: length
         logical, intent(out) :: is_found

         next = tracking%motion + length*slope
         call stretch%solve(abs(start - min(1.0_wp, done + length)), next, is_found)
      end subroutine solve_after

      !> Accepts the step, and increases the length of the next one.
      subroutine accept_step(factor)
         real(wp), intent(in) :: factor

         slope = (next - tracking%motion)/step
         has_slope = .true.
         tracking%motion = next
         done = done + step
         if (1.0_wp - done < 0.5_wp*shortest_step) done = 1.0_wp
         step = min(longest_step, factor*step)
      end subroutine accept_step

      !> Passes a corner to a motion that differs very little.
      subroutine leap(is_over)
         logical, intent(out) :: is_over
         integer :: i

         is_over = .false.
         do i = 1, size(leap_lengths)
            if (stretch%is_spent) return
            step = min(leap_lengths(i)*shortest_step, 1.0_wp - done)
            call solve_after(step, is_over)
            if (is_over) is_over = difference_of(next, tracking%motion) <= smallest_jump
            if (.not. is_over) cycle
            call accept_step(1.0_wp)
            return
         end do
      end subroutine leap
   end subroutine track

   !> Distance of two motions relative to the larger one.
   pure real(wp) function difference_of(a, b)
      real(wp), intent(in) :: a(:), b(:)

      difference_of = norm2(a - b)/max(norm2(a), norm2(b), tiny(1.0_wp))
   end function difference_of
end module hb_branch_tracking
