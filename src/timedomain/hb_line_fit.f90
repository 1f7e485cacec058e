!> Coefficients of many lines of a record by least squares with a smooth window, all at once.
!>
!> Averages (hb_birkhoff) isolate a line only if its neighbours are several cycles of the whole record away: with
!> thousands of combination tones this needs records of hours. A fit to all lines needs a record with more samples
!> than coefficients; of two lines that it cannot separate, the one of lower weight remains small. Conjugate gradients
!> on the normal equations, each product by two fast transforms: a line between two positions of the spectrum is
!> distributed over its neighbours by a Kaiser-Bessel kernel. Source: A. Dutt and V. Rokhlin, SIAM J. Sci. Comput. 14
!> (1993) 1368-1393; J. Keiner, S. Kunis and D. Potts, ACM Trans. Math. Softw. 36 (2009) 19.
module hb_line_fit
   use hb_birkhoff, only: bump_weights
   use hb_cancellation, only: work_is_over
   use hb_error, only: error_t
   use hb_fftw, only: complex_block_t, fft_plan_t, new_complex_block, new_fft_plan, new_real_block, real_block_t
   use hb_kinds, only: two_pi, wp
   use hb_sorting, only: sort_descending
   use hb_torus, only: cheap_size
   implicit none
   private
   public :: line_fit_t, new_line_fit, unresolved_by

   integer, parameter :: kernel_width = 14                            ! positions over which a line is distributed: errors of 1e-11
   integer, parameter :: max_products = 100
   real(wp), parameter :: work_of_position = 35.0_wp                  ! [ns] in a product: .6 to 1.3 times the time
   real(wp), parameter :: max_curvature_ratio = 13.4_wp               ! 6 sqrt(5): phase squared over misfit of such lines
   real(wp), parameter :: one_line = 1.0e-6_wp                        ! [rad] in a record: lines of one frequency

   type :: line_fit_t
      real(wp) :: work = 0.0_wp                                       !! of all fits so far [ns]
      real(wp) :: max_work = huge(1.0_wp)                           !! beyond which no product is begun [ns]
      real(wp), private, allocatable :: importance(:)                 ! (n_lines)
      real(wp), private, allocatable :: window(:), shape(:)           ! (n_samples); effect of the kernel on the samples
      integer, private, allocatable :: first(:)                       ! position of a line, (n_lines)
      real(wp), private, allocatable :: kernel(:, :)                  ! (width, n_lines)
      complex(wp), private, allocatable :: phase(:)                   ! of a line at the middle sample, (n_lines)
      type(real_block_t), private :: samples
      type(complex_block_t), private :: spectrum
      type(fft_plan_t), private :: plan
   contains
      procedure :: coefficients => line_fit_coefficients
      procedure :: series => line_fit_series
      procedure :: destroy => line_fit_destroy
   end type line_fit_t

contains

   !> Prepares fits to records of n_samples samples, of which the first n_seen are used; the others verify the series.
   subroutine new_line_fit(self, n_samples, n_seen, start, step, frequencies, importance, error)
      type(line_fit_t), intent(inout) :: self
      integer, intent(in) :: n_samples, n_seen                        !! >= 3
      real(wp), intent(in) :: start, step                             !! [s], time of the first sample, sampling interval
      real(wp), intent(in) :: frequencies(:)                          !! of the lines [rad/s], below pi/step in size
      real(wp), intent(in) :: importance(:)                           !! > 0; of two similar lines the larger one gets the motion
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: beta, position
      integer :: h, k, middle, n

      call self%destroy()
      self%work = 0.0_wp
      self%max_work = huge(1.0_wp)
      n = cheap_size(2*n_samples, 1)
      middle = n_samples/2
      beta = 0.5_wp*two_pi*kernel_width*(1.0_wp - 0.5_wp*n_samples/n)
      self%window = [bump_weights(n_seen), (0.0_wp, k=n_seen + 1, n_samples)]
      self%importance = importance/maxval(importance)
      self%shape = [(shape_at(beta, 0.5_wp*two_pi*kernel_width*(k - 1 - middle)/n), k=1, n_samples)]
      self%phase = exp(cmplx(0.0_wp, -frequencies*(start + middle*step), wp))
      if (allocated(self%first)) deallocate (self%first, self%kernel)
      allocate (self%first(size(frequencies)), self%kernel(kernel_width, size(frequencies)))
      do h = 1, size(frequencies)
         position = frequencies(h)*step/two_pi*n
         self%first(h) = floor(position) - kernel_width/2 + 1
         do k = 1, kernel_width
            self%kernel(k, h) = bessel_i0(beta*sqrt(max(0.0_wp, &
                                                        1.0_wp - (2.0_wp*(position - (self%first(h) + k - 1))/kernel_width)**2)))
         end do
      end do
      call new_real_block(self%samples, n, 1, error)
      if (.not. allocated(error)) call new_complex_block(self%spectrum, n/2 + 1, 1, error)
      if (.not. allocated(error)) &
         call new_fft_plan(self%plan, [n], 1, self%samples%values, self%spectrum%values, error)
   end subroutine new_line_fit

   !> Coefficients c - i s of x = sum c cos(w t) + s sin(w t), until a further product would change the root mean
   !> square of the remainder by less than `goal`, relative to the record, or exceed the limit of work.
   subroutine line_fit_coefficients(self, x, goal, coefficients)
      class(line_fit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! (n_samples)
      real(wp), intent(in) :: goal
      complex(wp), intent(out) :: coefficients(:)                     !! (n_lines)
      complex(wp), allocatable, dimension(:) :: direction, image, left, y
      real(wp) :: after, before, enough, length
      integer :: i

      allocate (left, source=self%importance*averages(self, self%window*x))
      allocate (y(size(left)), source=(0.0_wp, 0.0_wp))
      direction = left
      before = square(left)
      enough = goal**2*sum(self%window*x**2)
      do i = 1, max_products
         if (before <= 0.0_wp .or. self%work > self%max_work .or. work_is_over()) exit
         image = self%importance*averages(self, self%window*self%series(self%importance*direction))
         self%work = self%work + work_of_position*size(self%samples%values, 1)
         length = before/sum(real(conjg(direction)*image, wp))
         y = y + length*direction
         if (length*before <= enough) exit
         left = left - length*image
         after = square(left)
         direction = left + after/before*direction
         before = after
      end do
      coefficients = self%importance*y
   end subroutine line_fit_coefficients

   !> The series sum c cos(w t) + s sin(w t) at all samples.
   function line_fit_series(self, coefficients) result(x)
      class(line_fit_t), intent(inout) :: self
      complex(wp), intent(in) :: coefficients(:)                      !! c - i s, (n_lines)
      real(wp), allocatable :: x(:)
      complex(wp) :: c
      integer :: h, k, n, position

      associate (spectrum => self%spectrum%values(:, 1), samples => self%samples%values(:, 1))
         spectrum = (0.0_wp, 0.0_wp)
         do h = 1, size(coefficients)
            c = 0.5_wp*conjg(self%phase(h))*coefficients(h)
            do k = 1, kernel_width
               position = self%first(h) + k - 1
               if (position > 0) then
                  spectrum(1 + position) = spectrum(1 + position) + self%kernel(k, h)*c
               else if (position < 0) then
                  spectrum(1 - position) = spectrum(1 - position) + self%kernel(k, h)*conjg(c)
               else
                  spectrum(1) = spectrum(1) + 2.0_wp*self%kernel(k, h)*real(c, wp)
               end if
            end do
         end do
         call self%plan%to_samples(self%spectrum%values, self%samples%values)
         n = size(self%shape)
         x = [samples(size(samples) - n/2 + 1:), samples(:n - n/2)]/self%shape
      end associate
   end function line_fit_series

   !> Part of a series that a record does not determine, relative to its lines without the mean.
   !>
   !> Two lines closer than a cycle of the record share the motion at both of them, and that of a third one as close beyond the
   !> candidates: a fit divides it by their importance, whichever of them it belongs to. Lines at equal distances whose phases
   !> are b = (w1 - w2) T apart at the end of the record can exchange amplitudes as d, -2 d, d, and leave a misfit of
   !> d b**2/(6 sqrt(5)): an error of sqrt(6) d at other times. The smaller of the two lines is such a d, unless the misfit is
   !> too small for it. Lines of the same frequency, which tones with a common multiple have, are one at all times.
   pure real(wp) function unresolved_by(duration, frequencies, coefficients, misfit) result(share)
      real(wp), intent(in) :: duration                                !! T [s] of the record
      real(wp), intent(in) :: frequencies(:)                          !! w [rad/s], (n_lines)
      complex(wp), intent(in) :: coefficients(:)                      !! (n_lines)
      real(wp), intent(in) :: misfit                                  !! of the series, relative as the result
      real(wp) :: amplitude, beat, moving, squares, turns(size(frequencies))
      integer :: i, k, order(size(frequencies))

      share = 0.0_wp
      moving = norm2(pack(abs(coefficients), abs(frequencies) > 0.0_wp))
      if (moving <= 0.0_wp) return
      turns = duration*abs(frequencies)
      call sort_descending(turns, order)
      squares = 0.0_wp
      do i = 2, size(turns)
         amplitude = abs(coefficients(order(i)))
         do k = i - 1, 1, -1                                          ! from the nearest line on
            beat = turns(order(k)) - turns(order(i))
            if (beat >= two_pi) exit
            if (beat <= one_line) cycle
            squares = squares + (min(amplitude/moving, abs(coefficients(order(k)))/moving, misfit*max_curvature_ratio/beat**2))**2
         end do
      end do
      share = sqrt(6.0_wp*squares)
   end function unresolved_by

   !> Frees the memory of FFTW; safe to call twice.
   subroutine line_fit_destroy(self)
      class(line_fit_t), intent(inout) :: self

      call self%plan%destroy()
      call self%samples%destroy()
      call self%spectrum%destroy()
   end subroutine line_fit_destroy

   !> Sums of x exp(-i w t) over all samples, (n_lines): the adjoint of the series.
   function averages(self, x) result(sums)
      class(line_fit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! (n_samples)
      complex(wp), allocatable :: sums(:)
      integer :: h, k, n, position

      associate (spectrum => self%spectrum%values(:, 1), samples => self%samples%values(:, 1))
         n = size(x)
         samples = 0.0_wp
         samples(size(samples) - n/2 + 1:) = x(:n/2)/self%shape(:n/2)
         samples(:n - n/2) = x(n/2 + 1:)/self%shape(n/2 + 1:)
         call self%plan%to_spectrum(self%samples%values, self%spectrum%values)
         allocate (sums(size(self%first)), source=(0.0_wp, 0.0_wp))
         do h = 1, size(sums)
            do k = 1, kernel_width
               position = self%first(h) + k - 1
               if (position >= 0) then
                  sums(h) = sums(h) + self%kernel(k, h)*spectrum(1 + position)
               else
                  sums(h) = sums(h) + self%kernel(k, h)*conjg(spectrum(1 - position))
               end if
            end do
         end do
         sums = self%phase*sums
      end associate
   end function averages

   pure real(wp) function square(y)
      complex(wp), intent(in) :: y(:)

      square = sum(real(y, wp)**2 + aimag(y)**2)
   end function square

   !> Effect of the kernel on a sample: its transform, width sinh(r)/r with r**2 = beta**2 - position**2 > 0.
   pure real(wp) function shape_at(beta, position) result(shape)
      real(wp), intent(in) :: beta, position
      real(wp) :: r

      r = sqrt(beta**2 - position**2)
      shape = kernel_width*sinh(r)/r
   end function shape_at

   !> Modified Bessel function of the first kind and order 0, by its series.
   elemental real(wp) function bessel_i0(x)
      real(wp), intent(in) :: x
      real(wp) :: term
      integer :: k

      bessel_i0 = 1.0_wp
      term = 1.0_wp
      k = 0
      do while (term > epsilon(1.0_wp)*bessel_i0)
         k = k + 1
         term = term*(0.5_wp*x/k)**2
         bessel_i0 = bessel_i0 + term
      end do
   end function bessel_i0
end module hb_line_fit
