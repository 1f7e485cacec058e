!> Locates jumps of the motion from one branch of solutions to another along a line of a sweep.
!> Between two neighbours the motion x changes with the slope |x_k+1 - x_k|/|p_k+1 - p_k|. A jump is a slope far
!> larger than those on both sides of it. The limit follows from the steepest smooth responses: across a resonance
!> without damping, x = 1/(p - p0), the slope is at most three times that of either neighbour, however coarse the
!> points are; across the vertical tangent of a cusp, x = (p - p0)**(1/3), 4.5 times. If the two sides differ greatly,
!> as before a fold (steep) and after the jump (flat), a smaller ratio suffices: the limit is applied to a mean of
!> both, dominated by the larger one.
module hb_branches
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_branch_tracking, only: smallest_jump
   use hb_kinds, only: wp
   implicit none
   private
   public :: is_far_above, is_reported, jumps_between, left_branch, line_t, new_line

   integer, parameter :: left_branch = -1 !! number of a point at which a chain was found to leave its branch

   real(wp), parameter :: min_ratio = 3.0_wp                        ! to the larger slope beside a jump
   real(wp), parameter :: mean_ratio = 6.0_wp                         ! to larger**(3/4)*smaller**(1/4)
   real(wp), parameter :: return_ratio = 1.5_wp                       ! slope past deviating points, relative to those beside it
   integer, parameter :: longest_run = 8                              ! alternating steps between two branches

   !> The solved points of a line, in order.
   type :: line_t
      private
      integer :: n = 0
      integer, allocatable :: point(:)
      real(wp), allocatable :: parameter(:), norm(:)
      real(wp), allocatable :: step(:)                                ! from the previous point
      real(wp), allocatable :: cosine(:)                              ! of the angle between this step and the previous one
      logical, allocatable :: is_reported(:)                          ! the motion is known to jump to the point
      real(wp), allocatable :: last(:), direction(:)                  ! the last motion, and the direction of the step to it
   contains
      procedure :: add => line_add
      procedure :: number => line_number
   end type line_t

contains

   !> Creates a line without points.
   pure subroutine new_line(self, n_points)
      type(line_t), intent(out) :: self
      integer, intent(in) :: n_points                                 !! at most

      allocate (self%point(n_points), self%parameter(n_points), self%norm(n_points), self%step(n_points), self%cosine(n_points))
      allocate (self%is_reported(n_points), source=.false.)
   end subroutine new_line

   !> Adds the next solved point.
   pure subroutine line_add(self, point, parameter, motion, is_reported)
      class(line_t), intent(inout) :: self
      integer, intent(in) :: point                                    !! its position on the line, from 1
      real(wp), intent(in) :: parameter
      real(wp), intent(in) :: motion(:)                               !! coefficients; missing ones are NaN
      logical, intent(in), optional :: is_reported                    !! whether the motion is known to jump to it
      real(wp) :: direction(size(motion)), x(size(motion))
      real(wp) :: cosine, step

      x = 0.0_wp
      where (ieee_is_finite(motion)) x = motion
      if (self%n == 0) then
         self%direction = 0.0_wp*x
         self%last = x
      end if
      direction = x - self%last
      step = norm2(direction)
      if (step > 0.0_wp) direction = direction/step
      cosine = dot_product(direction, self%direction)
      self%n = self%n + 1
      self%point(self%n) = point
      self%parameter(self%n) = parameter
      self%norm(self%n) = norm2(x)
      self%step(self%n) = step
      self%cosine(self%n) = cosine
      if (present(is_reported)) self%is_reported(self%n) = is_reported
      self%direction = direction
      self%last = x
   end subroutine line_add

   !> Numbers the branches of a line from 1; 0 if there is no solved point.
   pure subroutine line_number(self, branch)
      class(line_t), intent(in) :: self
      integer, intent(out) :: branch(:)                               !! (points of the line)
      logical :: is_jump(2:max(2, self%n))
      integer :: i, number

      branch = 0
      if (self%n == 0) return
      call find_jumps(self, is_jump)
      number = 1
      branch(self%point(1)) = number
      do i = 2, self%n
         if (is_jump(i)) number = number + 1
         branch(self%point(i)) = number
      end do
   end subroutine line_number

   !> Finds the steps that are jumps: known ones, single ones, and several consecutive ones that alternate.
   pure subroutine find_jumps(self, is_jump)
      type(line_t), intent(in) :: self
      logical, intent(out) :: is_jump(2:)
      real(wp) :: after, before, slope(2:max(2, self%n))
      integer :: i, last, n

      n = self%n
      is_jump = .false.
      is_jump(2:n) = self%is_reported(2:n)
      if (n < 4) return
      slope = self%step(2:n)/abs(self%parameter(2:n) - self%parameter(:n - 1))
      i = 2
      do while (i <= n)
         if (is_jump(i)) then
            i = i + 1
            cycle
         end if
         do last = i, min(n, i + longest_run - 1)
            if (last > i) then
               if (self%cosine(last) > 0.0_wp .or. is_jump(last)) exit
            end if
            before = slope(max(2, i - 1))
            after = slope(min(n, last + 1))
            if (i == 2) before = slope(min(n, last + 2))              ! at an end both are on one side
            if (last == n) after = slope(max(2, i - 2))
            if (last > i .and. (i == 2 .or. last == n)) cycle
            if (.not. all(is_far_above(slope(i:last), before, after))) cycle
            if (.not. all(self%step(i:last) > smallest_jump*max(self%norm(i - 1:last - 1), self%norm(i:last)))) cycle
            if (last == i + 1) then
               if (.not. returns(self, i, max(before, after))) cycle
            end if
            is_jump(i:last) = .true.
            exit
         end do
         i = merge(last + 1, i + 1, is_jump(i))
      end do
   end subroutine find_jumps

   !> Whether a slope is far larger than those on both sides of it.
   elemental logical function is_far_above(slope, before, after)
      real(wp), intent(in) :: slope, before, after

      associate (larger => max(before, after), smaller => min(before, after))
         is_far_above = slope > min_ratio*larger .and. slope > mean_ratio*larger**0.75_wp*smaller**0.25_wp
      end associate
   end function is_far_above

   !> Whether the motion returns to its branch after one deviating point. This is not the case after the peak of a
   !> resonance that only one point reaches, since the phase has changed.
   pure logical function returns(self, i, slope)
      type(line_t), intent(in) :: self
      integer, intent(in) :: i                                        !! the deviating point
      real(wp), intent(in) :: slope                                   !! on either side
      real(wp) :: across

      associate (there => self%step(i), back => self%step(i + 1))
         across = sqrt(max(0.0_wp, (there - back)**2 + 2.0_wp*there*back*(1.0_wp + self%cosine(i + 1))))
      end associate
      returns = across <= return_ratio*slope*abs(self%parameter(i + 1) - self%parameter(i - 1))
   end function returns

   !> Whether the numbers of two neighbours of a chain show that the motion jumps between them: the number
   !> `left_branch` of a newly solved point, or numbers of a previous run.
   elemental logical function is_reported(before, branch)
      integer, intent(in) :: before, branch

      is_reported = branch == left_branch .or. (before > 0 .and. branch > before)
   end function is_reported

   !> Points of a sweep, from 1, to which the motion jumps from the preceding solved point of their line.
   pure function jumps_between(branch, line_length) result(points)
      integer, intent(in) :: branch(:)                                !! of all points
      integer, intent(in) :: line_length
      integer, allocatable :: points(:)
      integer :: i, last
      logical :: is_jump(size(branch))

      is_jump = .false.
      last = 0
      do i = 1, size(branch)
         if (modulo(i - 1, line_length) == 0) last = 0
         if (branch(i) == 0) cycle
         is_jump(i) = branch(i) == left_branch .or. (last > 0 .and. branch(i) /= last)
         last = max(0, branch(i))
      end do
      points = pack([(i, i=1, size(branch))], is_jump)
   end function jumps_between
end module hb_branches
