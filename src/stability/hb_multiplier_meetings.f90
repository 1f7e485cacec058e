!> Where multipliers that move along a curve may meet: a pair its conjugate, or another pair. There they can leave the unit circle,
!> and return before the end of a step. Source: docs/why/theory.md, section 8.
module hb_multiplier_meetings
   use hb_assert, only: assert, asserts_are_on
   use hb_kinds, only: two_pi, wp
   implicit none
   private
   public :: by_angle, meeting

contains

   !> Share of a piece at which complex multiplier number `i` at its start would meet the next one, if they moved towards each
   !> other at constant speed; none, 0, unless they are as close at both ends as multipliers move on the piece, or their
   !> magnitudes show that they have changed places.
   pure real(wp) function meeting(before, behind, i, reach)
      complex(wp), intent(in) :: before(:), behind(:)                 !! in the upper half-plane, by their angles; same size
      integer, intent(in) :: i                                        !! see `gap_behind`
      real(wp), intent(in) :: reach                                   !! of a multiplier on the piece
      real(wp), parameter :: as_close = 3.0_wp                        ! two of them move, and faster than before
      real(wp) :: gaps(2)

      if (asserts_are_on) call assert(size(before) == size(behind), "meeting", "the same multipliers at both ends")
      gaps = [gap_behind(before, i), gap_behind(behind, i)]
      meeting = 0.0_wp
      if (.not. sum(gaps) > 0.0_wp) return                            ! one multiplier twice, as of equal parts
      if (sum(gaps) <= as_close*reach .or. have_changed_places()) meeting = gaps(1)/sum(gaps)

   contains

      !> Whether both are more like the other one at the other end.
      pure logical function have_changed_places()
         have_changed_places = .false.
         if (i < 1 .or. i >= size(before)) return
         associate (a => abs(before(i:i + 1)), b => abs(behind(i:i + 1)))
            have_changed_places = abs(a(1) - b(2)) + abs(a(2) - b(1)) < 0.5_wp*(abs(a(1) - b(1)) + abs(a(2) - b(2)))
         end associate
      end function have_changed_places
   end function meeting

   !> Angle [rad] between a multiplier and the next one: number 0 is the conjugate of the first, and the last is followed by its
   !> conjugate.
   pure real(wp) function gap_behind(multipliers, i) result(gap)
      complex(wp), intent(in) :: multipliers(:)                       !! in the upper half-plane, by their angles
      integer, intent(in) :: i
      real(wp) :: angles(2)

      angles = 0.0_wp
      if (i > 0) angles(1) = angle_of(multipliers(i))
      if (i < size(multipliers)) angles(2) = angle_of(multipliers(i + 1))
      if (i == 0) angles(1) = -angles(2)
      if (i == size(multipliers)) angles(2) = two_pi - angles(1)
      gap = angles(2) - angles(1)
   end function gap_behind

   !> The complex multipliers in the upper half-plane, by their angles.
   pure function by_angle(multipliers) result(sorted)
      complex(wp), intent(in) :: multipliers(:)
      complex(wp), allocatable :: sorted(:)
      complex(wp) :: moved
      integer :: i, k

      sorted = pack(multipliers, aimag(multipliers) > 0.0_wp)
      do i = 2, size(sorted)
         moved = sorted(i)
         k = i - 1
         do while (k >= 1)
            if (angle_of(sorted(k)) <= angle_of(moved)) exit
            sorted(k + 1) = sorted(k)
            k = k - 1
         end do
         sorted(k + 1) = moved
      end do
   end function by_angle

   elemental real(wp) function angle_of(multiplier)
      complex(wp), intent(in) :: multiplier

      angle_of = atan2(aimag(multiplier), real(multiplier))
   end function angle_of
end module hb_multiplier_meetings
