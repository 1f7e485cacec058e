!> A slider between two moving bounds: the play operator, exact along a cubic path.
!>
!> The slider at position w rests while it can; the lower bound moves it up, the upper one down. If a bound reverses
!> within a step, its extreme value comes from the cubic with the values and rates of the bound at both ends (error of
!> fourth order in the step). Source: docs/why/theory.md, section 5.5; M. Brokate and J. Sprekels, Hysteresis and
!> Phase Transitions, Springer 1996, section 2.3 (play and stop).
module hb_slider
   use hb_hysteretic_law, only: n_path_parts, path_part
   use hb_kinds, only: wp
   implicit none
   private
   public :: move_slider, move_steadily, pushed_by, turning_point

   !> What determines the position of a slider at the end of a step.
   type :: pushed_by_t
      integer :: nothing = 0                                          !! sticks: its position at the start
      integer :: lower = 1
      integer :: upper = 2
   end type pushed_by_t
   type(pushed_by_t), parameter :: pushed_by = pushed_by_t()

contains

   !> Computes the position `w` of the slider at the end of a step. If a bound moved it, w = dot_product(weights,
   !> bound) of the bound that moved it last, and the weights are dw/dbound.
   !>
   !> A start outside the bounds, as may result from interpolation, is first moved onto them.
   pure subroutine move_slider(w_old, lower, upper, w, pusher, weights)
      real(wp), intent(in) :: w_old                                   !! position at the start [m]
      real(wp), intent(in) :: lower(n_path_parts), upper(n_path_parts)   !! paths of the bounds [m], lower <= upper
      real(wp), intent(out) :: w                                      !! [m]
      integer, intent(out) :: pusher                                  !! one of `pushed_by`
      real(wp), intent(out) :: weights(n_path_parts)
      real(wp) :: turn(n_path_parts), extreme
      integer :: position ! part of the path where it was moved last, 0: the turning point

      w = w_old
      pusher = pushed_by%nothing
      position = path_part%at_start
      if (w < lower(position)) pusher = pushed_by%lower
      if (w > upper(position)) pusher = pushed_by%upper
      w = min(max(w, lower(position)), upper(position))
      if (lower(path_part%start_rate) > 0.0_wp .and. lower(path_part%end_rate) < 0.0_wp) then
         turn = turning_point(lower)
         extreme = dot_product(turn, lower)
         if (w < extreme) then
            w = extreme
            pusher = pushed_by%lower
            position = 0
         end if
      end if
      if (upper(path_part%start_rate) < 0.0_wp .and. upper(path_part%end_rate) > 0.0_wp) then
         weights = turning_point(upper)
         extreme = dot_product(weights, upper)
         if (w > extreme) then
            w = extreme
            turn = weights
            pusher = pushed_by%upper
            position = 0
         end if
      end if
      if (w < lower(path_part%at_end)) then
         w = lower(path_part%at_end)
         pusher = pushed_by%lower
         position = path_part%at_end
      end if
      if (w > upper(path_part%at_end)) then
         w = upper(path_part%at_end)
         pusher = pushed_by%upper
         position = path_part%at_end
      end if
      weights = 0.0_wp
      if (pusher == pushed_by%nothing) return
      if (position == 0) then
         weights = turn
      else
         weights(position) = 1.0_wp
      end if
   end subroutine move_slider

   !> Position of a slider at the end of a step between bounds at a constant distance from a coordinate: the same as
   !> by `move_slider`, without derivatives.
   pure real(wp) function move_steadily(w_old, path, half_width) result(w)
      real(wp), intent(in) :: w_old                                   !! [m]
      real(wp), intent(in) :: path(n_path_parts)                      !! of the coordinate [m]
      real(wp), intent(in) :: half_width                              !! [m]
      real(wp) :: bound(n_path_parts)

      associate (start => path(path_part%at_start), end => path(path_part%at_end), &
                 start_rate => path(path_part%start_rate), end_rate => path(path_part%end_rate))
         w = min(max(w_old, start - half_width), start + half_width)
         if (start_rate*end_rate < 0.0_wp) then
            bound = path
            if (start_rate > 0.0_wp) then
               bound([path_part%at_start, path_part%at_end]) = [start - half_width, end - half_width]
               w = max(w, dot_product(turning_point(bound), bound))
            else
               bound([path_part%at_start, path_part%at_end]) = [start + half_width, end + half_width]
               w = min(w, dot_product(turning_point(bound), bound))
            end if
         end if
         w = min(max(w, end - half_width), end + half_width)
      end associate
   end function move_steadily

   !> Weights of the parts in the value of the cubic at its turning point. Its rate vanishes there, so these are also
   !> the derivatives of that value. The rates at both ends must differ in sign.
   pure function turning_point(path) result(weights)
      real(wp), intent(in) :: path(n_path_parts)
      real(wp) :: weights(n_path_parts)
      real(wp) :: a, b, c, q, x

      associate (start => path(path_part%at_start), end => path(path_part%at_end), &
                 start_rate => path(path_part%start_rate), end_rate => path(path_part%end_rate))
         ! rate(x) = a x**2 + b x + c for 0 <= x <= 1
         a = 3.0_wp*(start_rate + end_rate - 2.0_wp*(end - start))
         b = 2.0_wp*(3.0_wp*(end - start) - 2.0_wp*start_rate - end_rate)
         c = start_rate
      end associate
      q = -0.5_wp*(b + sign(sqrt(max(b**2 - 4.0_wp*a*c, 0.0_wp)), b))
      x = 1.0_wp
      if (abs(c) <= abs(q) .and. c*q > 0.0_wp) then
         x = c/q
      else if (abs(q) <= abs(a) .and. q*a > 0.0_wp) then
         x = q/a
      end if
      weights(path_part%at_start) = (1.0_wp + 2.0_wp*x)*(1.0_wp - x)**2
      weights(path_part%at_end) = (3.0_wp - 2.0_wp*x)*x**2
      weights(path_part%start_rate) = x*(1.0_wp - x)**2
      weights(path_part%end_rate) = (x - 1.0_wp)*x**2
   end function turning_point
end module hb_slider
