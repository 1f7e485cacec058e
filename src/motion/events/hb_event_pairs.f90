!> Two equal events on one step of a curve: their function has the same sign at both ends.
!> The cubic through both ends with their tangents shows where a function may come close to zero in between. The nearest
!> point is then searched for on the curve by parabolas; if the function has the other sign there, it divides the step into
!> two, each with one event.
module hb_event_pairs
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use hb_curve, only: curve_t, event_t
   use hb_kinds, only: wp
   implicit none
   private
   public :: cubic_between, find_other_sign, may_change_sign, parabola_between, place_of_end, point_between, &
      quadratic_between

   integer, parameter :: n_between = 9                                ! points of the cubic
   real(wp), parameter :: max_minimum = 0.5_wp                        ! to zero, relative to the nearer end: cubics are inexact

contains

   !> Position number i of n between both ends, as a share of the step.
   pure real(wp) function share(i, n)
      integer, intent(in) :: i, n

      share = real(i, wp)/real(n + 1, wp)
   end function share

   !> A function on the step from its values at both ends and its mean.
   pure function quadratic_between(at_ends, mean) result(between)
      real(wp), intent(in) :: at_ends(2), mean
      real(wp) :: between(n_between), s
      integer :: i

      do i = 1, n_between
         s = share(i, n_between)
         between(i) = at_ends(1)*(1.0_wp - 4.0_wp*s + 3.0_wp*s**2) + at_ends(2)*(3.0_wp*s**2 - 2.0_wp*s) + &
                      6.0_wp*mean*s*(1.0_wp - s)
      end do
   end function quadratic_between

   !> A function on the step from its values and slopes at both ends.
   pure function cubic_between(at_ends, slopes, length) result(between)
      real(wp), intent(in) :: at_ends(2), slopes(2), length
      real(wp) :: between(n_between), s
      integer :: i

      do i = 1, n_between
         s = share(i, n_between)
         between(i) = at_ends(1)*(1.0_wp + 2.0_wp*s)*(1.0_wp - s)**2 + at_ends(2)*s**2*(3.0_wp - 2.0_wp*s) + &
                      length*s*(1.0_wp - s)*((1.0_wp - s)*slopes(1) - s*slopes(2))
      end do
   end function cubic_between

   !> A function on the step from its values at both ends and in the middle.
   pure function parabola_between(at_ends, middle) result(between)
      real(wp), intent(in) :: at_ends(2), middle
      real(wp) :: between(n_between)

      between = quadratic_between(at_ends, (sum(at_ends) + 4.0_wp*middle)/6.0_wp)
   end function parabola_between

   !> Place of the end of the last step along the direction at its start, and the growth of this place along the direction at its
   !> end; `is_smooth` is false if that direction is across the step.
   pure subroutine place_of_end(curve, length, along, is_smooth)
      class(curve_t), intent(in) :: curve
      real(wp), intent(out) :: length, along
      logical, intent(out) :: is_smooth

      associate (last => curve%last%direction/curve%units, now => curve%direction/curve%units)
         along = dot_product(now, last)/dot_product(last, last)
         length = dot_product((curve%x - curve%last%x)/curve%units, last)/dot_product(last, last)
      end associate
      is_smooth = along > max_minimum .and. length > 0.0_wp
   end subroutine place_of_end

   !> Point of the cubic through both ends of the last step with their tangents.
   pure subroutine point_between(curve, part, x, is_there)
      class(curve_t), intent(in) :: curve
      real(wp), intent(in) :: part                                    !! of the step
      real(wp), intent(out) :: x(:)
      logical, intent(out) :: is_there
      real(wp) :: along, length

      call place_of_end(curve, length, along, is_there)
      x = curve%last%x
      if (.not. is_there) return
      x = curve%last%x*(1.0_wp + 2.0_wp*part)*(1.0_wp - part)**2 + curve%x*part**2*(3.0_wp - 2.0_wp*part) + &
          length*part*(1.0_wp - part)*((1.0_wp - part)*curve%last%direction - part*curve%direction/along)
   end subroutine point_between

   !> Whether a function with the same sign at both ends may have the other one in between.
   pure logical function may_change_sign(at_ends, between)
      real(wp), intent(in) :: at_ends(2)
      real(wp), intent(in) :: between(:)                              !! expected, at equal distances

      may_change_sign = at_ends(1)*at_ends(2) > 0.0_wp .and. size(between) > 0
      if (may_change_sign) may_change_sign = &
         minval(sign(1.0_wp, at_ends(1))*between) < max_minimum*minval(abs(at_ends))
   end function may_change_sign

   !> Searches on the last step, or a part of it, for a point at which the function of an event has the other sign than at both
   !> ends.
   subroutine find_other_sign(curve, event, ends, at_ends, between, position, value, is_found)
      type(curve_t), intent(inout) :: curve
      class(event_t), intent(in) :: event
      real(wp), intent(in) :: ends(2)                                 !! positions on the step
      real(wp), intent(in) :: at_ends(2)                              !! of the function, with the same sign
      real(wp), intent(in) :: between(:)                              !! expected, at equal distances
      real(wp), intent(out) :: position                               !! on the step
      real(wp), intent(out) :: value                                  !! of the function there
      logical, intent(out) :: is_found
      integer, parameter :: max_points = 12
      real(wp), parameter :: end_margin = 1.0e-3_wp                   ! of this part, beside its ends
      class(event_t), allocatable :: sought
      real(wp) :: at(3), expected, sense, values(3), x(size(curve%x))
      integer :: i
      logical :: is_on_curve

      is_found = .false.
      sense = sign(1.0_wp, at_ends(1))
      allocate (sought, source=event)
      at = ends(1) + [0.0_wp, share(minloc(sense*between, dim=1), size(between)), 1.0_wp]*(ends(2) - ends(1))
      values = sense*[at_ends(1), 0.0_wp, at_ends(2)]
      position = at(2)
      do i = 1, max_points
         call curve%point_at(position, x, is_on_curve)
         if (.not. is_on_curve) return
         value = sought%value(curve, x)
         if (ieee_is_nan(value)) return
         is_found = sense*value < -sought%tolerance
         if (is_found) return
         call insert(position, sense*value)
         call find_vertex(position, expected)
         if (min(position - ends(1), ends(2) - position) <= end_margin*(ends(2) - ends(1))) return
         if (expected > max_minimum*values(2) .or. minval(abs(position - at)) <= sqrt(epsilon(1.0_wp))*(ends(2) - ends(1))) return
      end do

   contains

      !> Replaces one of the three points, so that the lowest is in the middle if possible.
      subroutine insert(there, value_there)
         real(wp), intent(in) :: there, value_there

         if (i == 1) then
            values(2) = value_there
         else if (there < at(2) .and. value_there < values(2)) then
            at(2:3) = [there, at(2)]
            values(2:3) = [value_there, values(2)]
         else if (there < at(2)) then
            at(1) = there
            values(1) = value_there
         else if (value_there < values(2)) then
            at(:2) = [at(2), there]
            values(:2) = [values(2), value_there]
         else
            at(3) = there
            values(3) = value_there
         end if
      end subroutine insert

      !> Vertex of the parabola through the three points, and its value.
      subroutine find_vertex(vertex, lowest)
         real(wp), intent(out) :: vertex, lowest
         real(wp) :: curvature, slope

         slope = (values(2) - values(1))/(at(2) - at(1))
         curvature = ((values(3) - values(2))/(at(3) - at(2)) - slope)/(at(3) - at(1))
         vertex = at(1)
         lowest = huge(1.0_wp)
         if (.not. curvature > 0.0_wp) return
         vertex = 0.5_wp*(at(1) + at(2) - slope/curvature)
         lowest = values(1) + (vertex - at(1))*(slope + curvature*(vertex - at(2)))
      end subroutine find_vertex
   end subroutine find_other_sign
end module hb_event_pairs
