!> The slowest beat of a motion of several tones: the lowest frequency of its lines, or between two of them.
!>
!> Where two strong lines have nearly the same frequency, their phases pass through each other slowly, and the motion is a
!> different one in each part of their beat. What is averaged over a torus has to last for it.
module hb_beat
   use hb_kinds, only: wp
   implicit none
   private
   public :: slowest_beat

   real(wp), parameter :: strong_line_ratio = 1.0e-2_wp               ! line, relative to the strongest one of its coordinate

contains

   !> Frequency of the beat [rad/s], at most that of the slowest tone. Frequencies that are equal to rounding do not beat.
   pure real(wp) function slowest_beat(tuples, omega, amplitudes) result(beat)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_coordinates, n_harmonics)
      integer, allocatable :: lines(:)
      logical :: is_mean(size(tuples, 2)), is_strong(size(tuples, 2))
      integer :: h, i, k, side

      is_mean = all(tuples == 0, dim=1)
      is_strong = sum(abs(tuples), dim=1) == 1                        ! laws may depend on the phases of the tones themselves
      do i = 1, size(amplitudes, 1)
         is_strong = is_strong .or. abs(amplitudes(i, :)) > strong_line_ratio*maxval(abs(amplitudes(i, :)), mask=.not. is_mean)
      end do
      lines = pack([(h, h=1, size(is_mean))], is_strong .and. .not. is_mean)
      beat = minval(abs(omega))
      do i = 1, size(lines)
         call include_combination(tuples(:, lines(i)))
         do k = 1, i - 1
            do side = -1, 1, 2
               call include_combination(tuples(:, lines(i)) + side*tuples(:, lines(k)))
            end do
         end do
      end do

   contains

      pure subroutine include_combination(combination)
         integer, intent(in) :: combination(:)
         real(wp) :: frequency

         frequency = abs(sum(omega*combination))
         if (frequency > 100*epsilon(1.0_wp)*sum(abs(omega*combination))) beat = min(beat, frequency)
      end subroutine include_combination
   end function slowest_beat
end module hb_beat
