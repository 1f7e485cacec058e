!> Coefficients of given tones from a long record, by averages with a smooth window.
!>
!> With the weight w(s) = exp(-1/(s (1 - s))), 0 < s < 1, all of whose derivatives vanish at both ends, the average of a
!> quasi-periodic function converges faster than any power of the length of the record. Source: S. Das, Y. Saiki,
!> E. Sander and J. A. Yorke, Quantitative quasiperiodicity, Nonlinearity 30 (2017) 4111-4140.
module hb_birkhoff
   use hb_assert, only: assert, asserts_are_on
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: wp
   implicit none
   private
   public :: average_at, bump_weights, coefficients_at

   integer, parameter :: block_size = 512, n_partial_sums = 8         ! sums side by side, for vector registers

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

   !> Average of x exp(-i w t) over weighted samples at the times start + k step. Blocks share one table of cosines and sines.
   pure complex(wp) function average_at(weighted, start, step, frequency) result(average)
      real(wp), intent(in), contiguous :: weighted(:)                 !! x times weights of sum 1, (n_samples)
      real(wp), intent(in) :: start, step                             !! [s]
      real(wp), intent(in) :: frequency                               !! w [rad/s]
      real(wp) :: cosines(block_size), sines(block_size), in_phase(n_partial_sums), quadrature(n_partial_sums), phase
      integer :: first, i, n

      do i = 1, block_size
         phase = frequency*((i - 1)*step)
         cosines(i) = cos(phase)
         sines(i) = sin(phase)
      end do
      average = (0.0_wp, 0.0_wp)
      do first = 1, size(weighted), block_size
         n = min(block_size, size(weighted) - first + 1)
         in_phase = 0.0_wp
         quadrature = 0.0_wp
         do i = 1, n - n_partial_sums + 1, n_partial_sums
            in_phase = in_phase + weighted(first + i - 1:first + i + n_partial_sums - 2)*cosines(i:i + n_partial_sums - 1)
            quadrature = quadrature + weighted(first + i - 1:first + i + n_partial_sums - 2)*sines(i:i + n_partial_sums - 1)
         end do
         do i = n - modulo(n, n_partial_sums) + 1, n
            in_phase(1) = in_phase(1) + weighted(first + i - 1)*cosines(i)
            quadrature(1) = quadrature(1) + weighted(first + i - 1)*sines(i)
         end do
         phase = frequency*(start + (first - 1)*step)
         average = average + cmplx(sum(in_phase), -sum(quadrature), wp)*cmplx(cos(phase), -sin(phase), wp)
      end do
   end function average_at

   !> Coefficients c - i s of x = sum c cos(w t) + s sin(w t) at given frequencies; at 0 the mean. Zero if the work
   !> was cancelled before.
   subroutine coefficients_at(x, start, step, frequencies, coefficients)
      real(wp), intent(in), contiguous :: x(:)                        !! (n_samples), at least 3
      real(wp), intent(in) :: start, step                             !! [s], time of the first sample, sampling interval
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], of any sign
      complex(wp), intent(out) :: coefficients(:)                     !! as frequencies
      real(wp), allocatable :: weighted(:)
      integer :: h

      if (asserts_are_on) call assert(size(x) >= 3 .and. size(coefficients) == size(frequencies), &
                                      "coefficients_at", "three samples, and a coefficient for each frequency")
      allocate (weighted, source=bump_weights(size(x))*x)
      coefficients = (0.0_wp, 0.0_wp)
      do h = 1, size(frequencies)
         if (work_is_over()) return
         coefficients(h) = average_at(weighted, start, step, frequencies(h))
         if (abs(frequencies(h)) > 0.0_wp) coefficients(h) = 2.0_wp*coefficients(h)
      end do
   end subroutine coefficients_at
end module hb_birkhoff
