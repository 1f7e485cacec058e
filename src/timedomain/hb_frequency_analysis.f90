!> Unknown frequencies of a quasi-periodic record, one after the other by size.
!>
!> The largest line of the windowed spectrum is refined to a stationary point of the windowed average and subtracted,
!> and so on; then each line is refined again with the others subtracted. Source: J. Laskar, The chaotic motion of the
!> solar system: a numerical estimate of the size of the chaotic zones, Icarus 88 (1990) 266-291, with the window of
!> hb_birkhoff.
module hb_frequency_analysis
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_birkhoff, only: average_at, bump_weights
   use hb_cancellation, only: work_is_over
   use hb_error, only: error_t, fail
   use hb_fftw, only: complex_block_t, fft_plan_t, new_complex_block, new_fft_plan, new_real_block, real_block_t
   use hb_kinds, only: two_pi, wp
   implicit none
   private
   public :: find_frequencies

   integer, parameter :: n_refinements = 3                            ! of all lines, after the first
   integer, parameter :: max_halvings = 60                            ! of an interval of frequencies

contains

   !> The largest lines x = mean + sum of Re(amplitude exp(i w t)), in the order found. There may be fewer than
   !> requested: the remaining frequencies are NaN and amplitudes zero.
   subroutine find_frequencies(x, start, step, frequencies, amplitudes, error)
      real(wp), intent(in), contiguous :: x(:)                        !! (n_samples), at least 32
      real(wp), intent(in) :: start, step                             !! [s]
      real(wp), intent(out) :: frequencies(:)                         !! [rad/s]
      complex(wp), intent(out) :: amplitudes(:)                       !! as frequencies
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: remainder(:), time(:), weights(:)
      real(wp) :: width
      integer :: i, k, n, n_found, sweep

      n = size(x)
      if (n < 32) then
         call fail(error, "a record needs at least 32 samples for frequency analysis")
         return
      end if
      allocate (weights, source=bump_weights(n))
      remainder = x - sum(weights*x)
      time = [(start + (i - 1)*step, i=1, n)]
      width = two_pi/(n*step)
      frequencies = ieee_value(1.0_wp, ieee_quiet_nan)
      amplitudes = (0.0_wp, 0.0_wp)
      n_found = 0
      do k = 1, size(frequencies)
         call largest_line(remainder*weights, step, frequencies(k), error)
         if (allocated(error) .or. work_is_over()) return
         call maximise_average(remainder, weights, start, step, 2.0_wp*width, frequencies(k), amplitudes(k))
         if (abs(amplitudes(k)) <= 64*epsilon(1.0_wp)*maxval(abs(x))) exit
         call add_line(remainder, time, frequencies(k), -amplitudes(k))
         n_found = k
      end do
      do sweep = 1, n_refinements
         if (work_is_over()) exit
         remainder = remainder - sum(weights*remainder)
         do k = 1, n_found
            call add_line(remainder, time, frequencies(k), amplitudes(k))
            call maximise_average(remainder, weights, start, step, 0.5_wp*width, frequencies(k), amplitudes(k))
            call add_line(remainder, time, frequencies(k), -amplitudes(k))
         end do
      end do
   end subroutine find_frequencies

   pure subroutine add_line(x, time, frequency, amplitude)
      real(wp), intent(inout) :: x(:)
      real(wp), intent(in) :: time(:)
      real(wp), intent(in) :: frequency
      complex(wp), intent(in) :: amplitude

      x = x + real(amplitude, wp)*cos(frequency*time) - aimag(amplitude)*sin(frequency*time)
   end subroutine add_line

   !> Frequency of the largest bin above zero of the discrete Fourier transform.
   subroutine largest_line(x, step, frequency, error)
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: step
      real(wp), intent(out) :: frequency
      type(error_t), allocatable, intent(out) :: error
      type(real_block_t) :: samples
      type(complex_block_t) :: spectrum
      type(fft_plan_t) :: plan

      frequency = 0.0_wp
      call new_real_block(samples, size(x), 1, error)
      if (.not. allocated(error)) call new_complex_block(spectrum, size(x)/2 + 1, 1, error)
      if (.not. allocated(error)) call new_fft_plan(plan, [size(x)], 1, samples%values, &
                                                    spectrum%values, error)
      if (.not. allocated(error)) then
         samples%values(:, 1) = x
         call plan%to_spectrum(samples%values, spectrum%values)
         frequency = two_pi*maxloc(abs(spectrum%values(2:, 1)), dim=1)/(size(x)*step)
      end if
      call plan%destroy()
      call spectrum%destroy()
      call samples%destroy()
   end subroutine largest_line

   !> Moves a frequency to the maximum of the windowed average within +- `half_width`, by Ridders' method for the zero
   !> of its slope.
   !>
   !> Times are relative to the middle of the record, where the window is symmetric: the phase then does not affect
   !> the slope.
   pure subroutine maximise_average(x, weights, start, step, half_width, frequency, amplitude)
      real(wp), intent(in), contiguous :: x(:), weights(:)
      real(wp), intent(in) :: start, step, half_width
      real(wp), intent(inout) :: frequency
      complex(wp), intent(out) :: amplitude
      real(wp), allocatable :: moments(:), weighted(:)
      real(wp) :: at_frequency, at_high, at_low, at_middle, before, high, low, middle, root
      integer :: i

      middle = 0.5_wp*(size(x) - 1)*step
      allocate (weighted, source=weights*x)
      allocate (moments, source=[(((i - 1)*step - middle)*weighted(i), i=1, size(x))])
      low = frequency - half_width
      high = frequency + half_width
      at_low = slope(low)
      at_high = slope(high)
      if (at_low > 0.0_wp .and. at_high < 0.0_wp) then
         do i = 1, max_halvings
            before = frequency
            at_middle = slope(0.5_wp*(low + high))
            root = sqrt(at_middle**2 - at_low*at_high)
            if (.not. root > 0.0_wp) exit
            frequency = 0.5_wp*(low + high) + 0.5_wp*(high - low)*at_middle/root
            at_frequency = slope(frequency)
            if (abs(frequency - before) <= 2.0_wp*spacing(frequency)) exit
            call narrow(0.5_wp*(low + high), at_middle, low, at_low, high, at_high)
            call narrow(frequency, at_frequency, low, at_low, high, at_high)
            if (high - low <= 2.0_wp*spacing(frequency)) exit
         end do
      end if
      amplitude = 2.0_wp*average_at(weighted, start, step, frequency)

   contains

      !> Half the derivative of |average|**2 by the frequency.
      pure real(wp) function slope(w)
         real(wp), intent(in) :: w
         complex(wp) :: average, by_w

         average = average_at(weighted, -middle, step, w)
         by_w = cmplx(0.0_wp, -1.0_wp, wp)*average_at(moments, -middle, step, w)
         slope = real(conjg(average)*by_w, wp)
      end function slope
   end subroutine maximise_average

   !> Moves the end of an interval, positive at its low one and negative at the other, on whose side of the zero w is.
   pure subroutine narrow(w, at_w, low, at_low, high, at_high)
      real(wp), intent(in) :: w, at_w
      real(wp), intent(inout) :: low, at_low, high, at_high

      if (at_w > 0.0_wp .and. w > low) then
         low = w
         at_low = at_w
      else if (at_w <= 0.0_wp .and. w < high) then
         high = w
         at_high = at_w
      end if
   end subroutine narrow
end module hb_frequency_analysis
