!> A step of a curve. Its length is limited so that the corrector converges and the events on it can be located.
module hb_curve_step
   use hb_bifurcation, only: movement
   use hb_curve, only: curve_t
   use hb_curve_branches, only: branches_t
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: add_point, curve_point_t
   use hb_event_location, only: find_events
   use hb_followed, only: followed_t
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   use hb_point_kinds, only: curve_kind
   use hb_thresholds, only: negligible_step
   implicit none
   private
   public :: max_chord, step

   real(wp), parameter :: max_turn = 0.6_wp                           ! [rad] on a step, unless it is short
   real(wp), parameter :: max_chord = 2.0_wp                          !! of a step, unless it is short: 1.05 with the largest turn
   real(wp), parameter :: max_short_step = 1.0e-2_wp                  ! of the longest step; 1e-4: ten times as slow

contains

   !> Performs one step, and finds the events on it and its end; none if the curve cannot be followed, see its status.
   subroutine step(followed, curve, at_point, branches, points)
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout) :: curve
      type(event_values_t), intent(inout) :: at_point                 !! what events compare, at the point of the curve
      type(branches_t), intent(inout) :: branches
      type(curve_point_t), allocatable, intent(out) :: points(:)
      type(event_values_t) :: at_end
      real(wp) :: units(size(curve%x))
      logical :: is_lost, is_relaxed, is_short

      allocate (points(0))
      call followed%prepare_step(curve, branches%start_on_set)
      do
         units = curve%units
         call curve%advance()
         if (curve%status == outcome%stalled) call try_end(followed, curve, points)
         if (curve%status == outcome%stalled) then
            call followed%relax(is_relaxed)
            if (is_relaxed) then
               call followed%update_units(curve)
               curve%status = outcome%pending
               curve%step = curve%config%first_step
               cycle
            end if
         end if
         if (curve%status /= outcome%pending .or. size(points) > 0) return
         call followed%update_units(curve)
         call curve%turn()
         is_short = curve%last%step <= max_short_step*curve%config%longest_step
         if (is_taken()) then
            if (followed%tone_vanishes(curve)) curve%status = outcome%collapsed
            if (curve%status == outcome%collapsed) return
            call followed%evaluate(curve, at_end)
            call find_events(followed, curve, at_point, at_end, branches, points, is_lost)
            if (is_short .or. followed%is_rough .or. .not. is_lost) exit
            points = [curve_point_t ::]
         end if
         call curve%retreat()
         if (curve%status == outcome%stalled) call try_end(followed, curve, points)
         if (curve%status /= outcome%pending .or. size(points) > 0) return
         curve%units = units
      end do
      if (allocated(at_point%stability%multipliers) .and. allocated(at_end%stability%multipliers)) &
         at_end%speed = movement(at_point%stability%multipliers, at_end%stability%multipliers)/curve%last%step
      at_point = at_end

   contains

      !> Whether the step is on the curve: it is short or turns little, and has not jumped.
      logical function is_taken()
         is_taken = is_short .or. (curve%angle <= max_turn .and. &
                                   norm2((curve%x - curve%last%x)/curve%units) <= max_chord*curve%last%step)
         if (is_taken) is_taken = .not. followed%has_jumped(curve, branches%number == 0)
      end function is_taken
   end subroutine step

   !> Steps to an end of the range that is too close for another step: beyond it there may be no motions.
   subroutine try_end(followed, curve, points)
      class(followed_t), intent(in) :: followed
      type(curve_t), intent(inout) :: curve
      type(curve_point_t), allocatable, intent(inout) :: points(:)
      real(wp) :: ends(2), gap, x(size(curve%x))
      integer :: i, n
      logical :: is_there

      n = size(x)
      ends = [followed%request%from, followed%request%to]
      do i = 1, size(ends)
         gap = ends(i) - curve%x(n)
         if (abs(gap) > negligible_step*curve%units(n) .or. .not. gap*curve%direction(n) > 0.0_wp) cycle
         x = curve%x + gap/curve%direction(n)*curve%direction
         x(n) = ends(i)
         call curve%correct_at_value(x, is_there)
         if (.not. is_there) cycle
         curve%status = outcome%pending
         points = [curve_point_t ::]
         call add_point(points, curve_kind%end, norm2((x - curve%x)/curve%units), x)
         return
      end do
   end subroutine try_end
end module hb_curve_step
