!> Coefficients of given tones from a long record, by averages with a smooth window.
!>
!> With the weight w(s) = exp(-1/(s (1 - s))), 0 < s < 1, all of whose derivatives vanish at both ends, the average of a
!> quasi-periodic function converges faster than any power of the length of the record. Source: S. Das, Y. Saiki,
!> E. Sander and J. A. Yorke, Quantitative quasiperiodicity, Nonlinearity 30 (2017) 4111-4140.
module hb_birkhoff
   use hb_kinds, only: wp
   implicit none
   private
   public :: average_at, bump_weights, coefficients_at

   integer, parameter :: samples_between_cosines = 256                ! rotation errors grow with the samples since

contains

   !> Weights of n samples, of sum 1; the first and the last are 0.
   pure function bump_weights(n) result(weights)
      integer, intent(in) :: n                                        !! >= 3
      real(wp) :: weights(n)
      real(wp) :: s
      integer :: i

      weights = 0.0_wp
      do i = 2, n - 1
         s = real(i - 1, wp)/(n - 1)
         weights(i) = exp(-1.0_wp/(s*(1.0_wp - s)))
      end do
      weights = weights/sum(weights)
   end function bump_weights

   !> Average of x exp(-i w t) over weighted samples at the times start + k step.
   pure complex(wp) function average_at(x, weights, start, step, frequency) result(average)
      real(wp), intent(in), contiguous :: x(:)                        !! (n_samples)
      real(wp), intent(in), contiguous :: weights(:)                  !! (n_samples), of sum 1
      real(wp), intent(in) :: start, step                             !! [s]
      real(wp), intent(in) :: frequency                               !! w [rad/s]
      complex(wp) :: block, phasor, rotation
      real(wp) :: phase
      integer :: first, i

      average = (0.0_wp, 0.0_wp)
      phase = frequency*step
      rotation = cmplx(cos(phase), -sin(phase), wp)
      do first = 1, size(x), samples_between_cosines
         phase = frequency*(start + (first - 1)*step)
         phasor = cmplx(cos(phase), -sin(phase), wp)
         block = (0.0_wp, 0.0_wp)
         do i = first, min(first + samples_between_cosines - 1, size(x))
            block = block + weights(i)*x(i)*phasor
            phasor = phasor*rotation
         end do
         average = average + block
      end do
   end function average_at

   !> Coefficients c - i s of x = sum c cos(w t) + s sin(w t) at given frequencies; at 0 the mean.
   pure subroutine coefficients_at(x, start, step, frequencies, coefficients)
      real(wp), intent(in), contiguous :: x(:)                        !! (n_samples), at least 3
      real(wp), intent(in) :: start, step                             !! [s], time of the first sample, distance of two
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], of any sign
      complex(wp), intent(out) :: coefficients(:)                     !! as frequencies
      real(wp) :: weights(size(x))
      integer :: h

      weights = bump_weights(size(x))
      do h = 1, size(frequencies)
         coefficients(h) = average_at(x, weights, start, step, frequencies(h))
         if (abs(frequencies(h)) > 0.0_wp) coefficients(h) = 2.0_wp*coefficients(h)
      end do
   end subroutine coefficients_at
end module hb_birkhoff
