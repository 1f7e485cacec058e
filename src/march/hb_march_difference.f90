!> Difference between a marched record and a motion given by coefficients, period by period.
!>
!> A motion with tones of its own may begin at any phase of them: an error of its frequency only moves it along itself, by a
!> phase that grows with time and says nothing of its shape. So the phases of unknown tones are fitted to each period by the
!> method of least squares; their slope over time is the difference of the frequencies, and what is left is the difference of
!> the motions.
module hb_march_difference
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: dpotrf, dpotrs
   use hb_march, only: march_record_t
   implicit none
   private
   public :: compare, march_difference_t, motion

   integer, parameter :: max_fits = 8                                 ! steps of Gauss and Newton in one period
   integer, parameter :: fewest_periods = 3                           ! from which a drift is taken
   real(wp), parameter :: largest_step = 0.5_wp                       ! of a phase in one fit [rad]

   type :: march_difference_t
      real(wp) :: first = 0.0_wp                                      !! in the first period, relative to the largest motion
      real(wp) :: largest = 0.0_wp                                    !! over all, likewise
      real(wp) :: growth = 0.0_wp                                     !! slope of its logarithm [1/s]
      real(wp), allocatable :: drift(:)                               !! march minus motion [rad/s], (n_tones), 0 of known tones
   end type march_difference_t

contains

   !> Compares a record with the motion sum of Re(amplitude exp(i j.omega t)), each degree of freedom relative to the largest motion
   !> in its unit. The drift is that of the periods before the difference leaves `tolerance`, at least of three.
   subroutine compare(self, record, amplitudes, tuples, omega, is_unknown, units, tolerance)
      type(march_difference_t), intent(out) :: self
      type(march_record_t), intent(in) :: record                      !! of all samples, from a time zero of the motion on
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin [m], (n_harmonics, n_dofs)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      logical, intent(in) :: is_unknown(:)                            !! (n_tones)
      character(*), intent(in) :: units(:)                            !! (n_dofs)
      real(wp), intent(in) :: tolerance                               !! relative
      real(wp), allocatable :: frequencies(:), largest(:), phases(:, :), scale(:)
      integer, allocatable :: tones(:)
      real(wp) :: period
      integer :: first, k, last, m, n, n_kept

      period = two_pi/minval(omega)
      frequencies = matmul(omega, real(tuples, wp))
      tones = pack([(m, m=1, size(omega))], is_unknown)
      n = max(2, nint((record%time(size(record%time)) - record%time(1))/period))
      allocate (largest(n), phases(size(tones), n))
      call find_scale(record, amplitudes, units, scale)
      last = 0
      do k = 1, n
         first = last + 1
         do while (last < size(record%time))
            if (k < n .and. record%time(last + 1) - record%time(1) >= k*period) exit
            last = last + 1
         end do
         phases(:, k) = 0.0_wp
         if (k > 1) phases(:, k) = phases(:, k - 1)
         if (k > 2) phases(:, k) = 2.0_wp*phases(:, k - 1) - phases(:, k - 2)
         call fit(record%time(first:last), record%displacement(first:last, :), phases(:, k))
         largest(k) = rest(record%time(first:last), record%displacement(first:last, :), phases(:, k))
      end do
      self%first = largest(1)
      self%largest = maxval(largest)
      n_kept = findloc(largest <= tolerance, .false., dim=1) - 1
      if (n_kept < 0) n_kept = n
      n_kept = min(n, max(fewest_periods, n_kept))
      allocate (self%drift(size(omega)), source=0.0_wp)
      do m = 1, size(tones)
         self%drift(tones(m)) = slope(phases(m, :n_kept))/period
      end do
      self%growth = slope(log(max(largest, epsilon(1.0_wp))))/period

   contains

      !> Phases with the smallest sum of squares of the difference, from those given on.
      subroutine fit(t, x, phase)
         real(wp), intent(in) :: t(:), x(:, :)                        !! [s], (n_samples); [m], (n_samples, n_dofs)
         real(wp), intent(inout) :: phase(:)                          !! [rad], (n_unknown)
         complex(wp) :: turned(size(amplitudes, 1), size(amplitudes, 2))
         real(wp) :: along(size(x, 2), size(phase)), difference(size(x, 2)), normal(size(phase), size(phase))
         real(wp) :: right(size(phase))
         integer :: a, b, i, info, iteration

         if (size(phase) == 0) return
         do iteration = 1, max_fits
            turned = shifted(phase)
            normal = 0.0_wp
            right = 0.0_wp
            do i = 1, size(t)
               difference = (x(i, :) - motion(turned, frequencies, t(i)))/scale
               do a = 1, size(phase)
                  along(:, a) = motion(turned*spread(cmplx(0.0_wp, tuples(tones(a), :), wp), 2, size(x, 2)), frequencies, t(i)) &
                                /scale
                  right(a) = right(a) + dot_product(along(:, a), difference)
                  do b = 1, a
                     normal(a, b) = normal(a, b) + dot_product(along(:, a), along(:, b))
                  end do
               end do
            end do
            call dpotrf("L", size(phase), normal, size(phase), info)
            if (info /= 0) return                                      ! nothing moves with one of the tones
            call dpotrs("L", size(phase), 1, normal, size(phase), right, size(phase), info)
            phase = phase + min(max(right, -largest_step), largest_step)
            if (maxval(abs(right)) <= 1.0e-13_wp) return
         end do
      end subroutine fit

      real(wp) function rest(t, x, phase)
         real(wp), intent(in) :: t(:), x(:, :), phase(:)
         complex(wp) :: turned(size(amplitudes, 1), size(amplitudes, 2))
         integer :: i

         turned = shifted(phase)
         rest = 0.0_wp
         do i = 1, size(t)
            rest = max(rest, maxval(abs(x(i, :) - motion(turned, frequencies, t(i)))/scale))
         end do
      end function rest

      function shifted(phase) result(turned)
         real(wp), intent(in) :: phase(:)
         complex(wp) :: turned(size(amplitudes, 1), size(amplitudes, 2))
         real(wp) :: angle(size(amplitudes, 1))

         angle = matmul(phase, real(tuples(tones, :), wp))
         turned = amplitudes*spread(cmplx(cos(angle), sin(angle), wp), 2, size(amplitudes, 2))
      end function shifted
   end subroutine compare

   !> Displacements of a motion at one time.
   pure function motion(amplitudes, frequencies, t) result(x)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin [m], (n_harmonics, n_dofs)
      real(wp), intent(in) :: frequencies(:), t                       !! [rad/s], (n_harmonics); [s]
      real(wp) :: x(size(amplitudes, 2))

      x = real(matmul(cmplx(cos(frequencies*t), sin(frequencies*t), wp), amplitudes), wp)
   end function motion

   !> Largest motion in the unit of each degree of freedom; that of the record where the motion given is rest.
   pure subroutine find_scale(record, amplitudes, units, scale)
      type(march_record_t), intent(in) :: record
      complex(wp), intent(in) :: amplitudes(:, :)
      character(*), intent(in) :: units(:)
      real(wp), allocatable, intent(out) :: scale(:)
      real(wp) :: motions(size(amplitudes, 2))
      integer :: k

      do k = 1, size(motions)
         motions(k) = sum(abs(amplitudes(:, k)))
      end do
      do k = 1, size(motions)
         if (any(motions > 0.0_wp .and. units == units(k))) cycle
         motions(k) = max(maxval(abs(record%displacement(:, k))), tiny(1.0_wp))
      end do
      scale = [(maxval(motions, mask=units == units(k)), k=1, size(motions))]
   end subroutine find_scale

   !> Slope of a straight line through equidistant values, at least two.
   pure real(wp) function slope(values)
      real(wp), intent(in) :: values(:)
      real(wp) :: place(size(values))
      integer :: k

      place = [(k - 0.5_wp*(size(values) + 1), k=1, size(values))]
      slope = sum(place*values)/sum(place**2)
   end function slope
end module hb_march_difference
