!> Jumps of a curve towards the end of its range, as those of a slow sweep: where a part of the curve folds back or cannot be
!> followed, another part begins at a value beyond all of its points, with a motion that is found like the first one.
module hb_curve_jumps
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_curve_request, only: curve_request_t
   use hb_kinds, only: wp
   use hb_motion_result, only: curve_position_t
   use hb_point_kinds, only: curve_kind
   use hb_thresholds, only: equality_tolerance
   implicit none
   private
   public :: curve_jumps_t

   real(wp), parameter :: gap_of_start = 0.1_wp                       ! of the longest step: from the furthest point to a start
   integer, parameter :: max_failures = 5                             ! consecutive values at which no motion is found
   real(wp), parameter :: to_go = 0.5_wp                              ! of the rest of the range, at most

   type :: curve_jumps_t
      integer :: part = 0                                             !! number of the present part, from 0
      integer :: n_before = 0                                         !! rows of the parts before it
      integer :: n_rows = 0                                           !! of all parts
      logical :: is_due = .false.                                     !! the present part has ended before the end of the range
      real(wp) :: furthest = 0.0_wp                                   !! value of all points so far
      real(wp), private :: target = 0.0_wp                            ! end of the range to which the curve goes
      real(wp), private :: range = 0.0_wp                             ! its length
      real(wp), private :: shortest = 0.0_wp                          ! jump
      integer, private :: n_failures = 0                              ! last values at which no motion was found
   contains
      procedure :: begin => curve_jumps_begin
      procedure :: note => curve_jumps_note
      procedure :: restore => curve_jumps_restore
      procedure :: next_request => curve_jumps_next_request
   end type curve_jumps_t

contains

   !> Begins at the first value of a curve, an end of its range.
   subroutine curve_jumps_begin(self, request, start)
      class(curve_jumps_t), intent(out) :: self
      type(curve_request_t), intent(in) :: request                    !! of the whole curve
      real(wp), intent(in) :: start

      self%furthest = start
      self%target = merge(request%to, request%from, abs(start - request%from) < abs(start - request%to))
      self%range = abs(request%to - request%from)
      self%shortest = gap_of_start*request%longest_step*self%range
   end subroutine curve_jumps_begin

   !> Notes a row of the present part, and whether a jump follows it.
   pure subroutine curve_jumps_note(self, position, has_ended)
      class(curve_jumps_t), intent(inout) :: self
      type(curve_position_t), intent(inout) :: position               !! gets the number of its part
      logical, intent(in) :: has_ended                                !! it is the last row of its part, a fold aside

      position%branch = self%part
      self%n_rows = self%n_rows + 1
      if (is_further(self, position%parameter)) self%furthest = position%parameter
      self%n_failures = merge(self%n_failures + 1, 0, self%n_rows == self%n_before + 1 .and. position%kind /= curve_kind%start)
      self%is_due = (position%kind == curve_kind%fold .or. has_ended) .and. self%n_rows > 1 .and. &
                    self%n_failures < max_failures .and. abs(self%target - self%furthest) > equality_tolerance*self%range
   end subroutine curve_jumps_note

   !> Restores the state at the last of the rows of a curve, and finds the first row of its part, with the request of this part.
   subroutine curve_jumps_restore(self, request, stored, first)
      class(curve_jumps_t), intent(out) :: self
      type(curve_request_t), intent(inout) :: request                 !! of the whole curve; on return of the part
      type(curve_position_t), intent(in) :: stored(:)
      integer, intent(out) :: first
      integer :: i

      call self%begin(request, stored(1)%parameter)
      first = 1
      do i = 1, size(stored)
         if (is_further(self, stored(i)%parameter)) self%furthest = stored(i)%parameter
         if (stored(i)%kind == curve_kind%start) first = i
      end do
      self%part = stored(first)%branch
      self%n_before = first - 1
      self%n_rows = size(stored)
      request%n_points = request%n_points - self%n_before
      if (self%part == 0) return
      request%from = stored(first)%parameter
      request%to = self%target
   end subroutine curve_jumps_restore

   !> The request of the next part.
   pure subroutine curve_jumps_next_request(self, n_points, request)
      class(curve_jumps_t), intent(inout) :: self
      integer, intent(in) :: n_points                                 !! of the whole curve
      type(curve_request_t), intent(inout) :: request
      real(wp) :: rest

      rest = self%target - self%furthest
      request%from = self%furthest + sign(min(2.0_wp**self%n_failures*self%shortest, to_go*abs(rest)), rest)
      request%to = self%target
      request%n_points = n_points - self%n_rows
      self%n_before = self%n_rows
      self%part = self%part + 1
   end subroutine curve_jumps_next_request

   !> Whether a value is nearer to the end of the range than all points so far.
   pure logical function is_further(self, value)
      type(curve_jumps_t), intent(in) :: self
      real(wp), intent(in) :: value

      is_further = ieee_is_finite(value)
      if (is_further) is_further = (value - self%furthest)*(self%target - self%furthest) > 0.0_wp
   end function is_further
end module hb_curve_jumps
