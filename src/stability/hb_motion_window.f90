!> A motion of many tuples at many times of an interval: from equidistant samples, for which tuples are summed once.
!>
!> Frequencies are spread to a grid by Gaussians, a transform gives the samples, and times in between are interpolated by
!> Gaussians; both are then divided by the spectrum of a Gaussian. Source: L. Greengard and J.-Y. Lee, SIAM Review 46 (2004)
!> 443-454; J.-Y. Lee and L. Greengard, J. Comput. Phys. 206 (2005) 1-5 (type 3); docs/why/theory.md, section 8.
module hb_motion_window
   use hb_error, only: error_t
   use hb_fftw, only: axis_plan_t, new_axis_plan
   use hb_kinds, only: pi, two_pi, wp
   use hb_motion_series, only: motion_series_t
   use hb_torus, only: fast_size
   implicit none
   private
   public :: motion_window_t

   integer, parameter :: window_points = 28                               ! of a Gaussian, in points
   integer, parameter :: half_width = window_points/2
   real(wp), parameter :: spread_by = window_points/(6.0_wp*pi)       ! exponent -x**2/(4 spread_by): the errors of the width and of
                                                                     ! twice as many points as needed are equal, 2e-13
   integer, parameter :: min_tuples = 100                            ! with fewer the sum is as cheap
   integer, parameter :: points_per_tuple = 16                       ! of the grid, up to which it pays

   type :: motion_window_t
      real(wp), private :: start = 0.0_wp, finish = -1.0_wp          ! of the interval; none
      real(wp), private :: length = 0.0_wp                           ! for which it is prepared; 0: for none
      logical, private :: is_useful = .false.                        ! for this length
      real(wp), private :: spacing = 0.0_wp                          ! of samples [s]
      integer, private :: n_points = 0                               ! of the grid
      integer, allocatable, private :: first(:)                      ! point of each tuple
      real(wp), allocatable, private :: weights(:, :)                ! of points, (width, n_harmonics)
      real(wp), allocatable, private :: divisors(:)                  ! of samples
      real(wp), allocatable, private :: samples(:, :, :)             ! (samples, n_coordinates, displacement and rate)
   contains
      procedure :: cover => motion_window_cover
      procedure :: covers => motion_window_covers
      procedure :: at => motion_window_at
   end type motion_window_t

contains

   !> Moves to an interval of time, if the motion has so many tuples that this pays.
   subroutine motion_window_cover(self, motion, start, finish, with_rates)
      class(motion_window_t), intent(inout) :: self
      type(motion_series_t), intent(in) :: motion
      real(wp), intent(in) :: start, finish                          !! [s]
      logical, intent(in) :: with_rates
      real(wp), parameter :: equal_lengths = 1.0e-6_wp               ! length, relative
      type(axis_plan_t) :: plan
      type(error_t), allocatable :: error
      complex(wp), allocatable :: amplitudes(:), grid(:), sampled(:), turns(:)
      real(wp) :: centre
      integer :: c, part

      if (.not. abs(finish - start - self%length) <= equal_lengths*self%length) call prepare(self, motion, finish - start)
      self%finish = -1.0_wp
      self%start = 0.0_wp
      if (.not. self%is_useful) return
      call new_axis_plan(plan, self%n_points, 1, 1, 1, 1, error)
      if (allocated(error)) return
      if (allocated(self%samples)) deallocate (self%samples)
      allocate (self%samples(0:size(self%divisors) - 1, motion%n_coordinates, merge(2, 1, with_rates)))
      allocate (grid(0:self%n_points - 1), sampled(0:self%n_points - 1), amplitudes(size(motion%frequencies)))
      centre = start + (size(self%divisors)/2 - half_width)*self%spacing
      turns = exp(cmplx(0.0_wp, matmul(motion%start, real(motion%tuples, wp)) + motion%frequencies*centre, wp))
      do part = 1, size(self%samples, 3)
         do c = 1, motion%n_coordinates
            amplitudes = motion%amplitudes(c, :)*turns
            if (part == 2) amplitudes = amplitudes*cmplx(0.0_wp, motion%frequencies, wp)
            call spread_out(self, motion%frequencies, amplitudes, grid)
            call plan%to_samples(grid, sampled)
            call gather(self, sampled, self%samples(:, c, part))
         end do
      end do
      call plan%destroy()
      self%start = start
      self%finish = finish
   end subroutine motion_window_cover

   !> Whether all times are within the interval.
   pure logical function motion_window_covers(self, times) result(covers)
      class(motion_window_t), intent(in) :: self
      real(wp), intent(in) :: times(:)                               !! [s]

      covers = self%finish > self%start
      if (covers) covers = all(times >= self%start .and. times <= self%finish)
   end function motion_window_covers

   !> Chooses samples and grid for intervals of one length.
   subroutine prepare(self, motion, length)
      type(motion_window_t), intent(inout) :: self
      type(motion_series_t), intent(in) :: motion
      real(wp), intent(in) :: length                                 !! [s]
      integer :: h, k, n, n_inside
      real(wp) :: position

      self%length = length
      associate (n_tuples => size(motion%frequencies), highest => maxval(abs(motion%frequencies)))
         self%is_useful = n_tuples >= min_tuples .and. highest*length < points_per_tuple*pi*n_tuples/4
         if (.not. self%is_useful) return
         n_inside = 1 + ceiling(2*highest*length/pi)                 ! four in a period of the fastest tuple
         self%spacing = length/n_inside
         n = n_inside + 1 + 2*half_width
         self%n_points = fast_size(2*n)
         if (allocated(self%first)) deallocate (self%first, self%weights, self%divisors)
         allocate (self%first(n_tuples), self%weights(window_points, n_tuples), self%divisors(0:n - 1))
         do h = 1, n_tuples
            position = abs(motion%frequencies(h))*self%spacing*self%n_points/two_pi
            self%first(h) = floor(position) - half_width + 1
            self%weights(:, h) = weights_of(position)/spectrum(motion%frequencies(h)*self%spacing)
         end do
         self%divisors = [(spectrum(two_pi*(k - n/2)/self%n_points), k=0, n - 1)]
      end associate
   end subroutine prepare

   !> Gaussian at the points around a position, the first of which is `half_width` - 1 below it, rounded down.
   pure function weights_of(position) result(weights)
      real(wp), intent(in) :: position                               !! in points
      real(wp) :: weights(window_points)
      integer :: j
      real(wp), parameter :: of_points(window_points) = [(exp(-real(j - half_width, wp)**2/(4.0_wp*spread_by)), j=1, window_points)]
      real(wp) :: part, power, ratio

      part = position - floor(position)
      ratio = exp(part/(2.0_wp*spread_by))
      power = exp(-(part**2 + 2*(half_width - 1)*part)/(4.0_wp*spread_by))
      do j = 1, window_points
         weights(j) = power*of_points(j)
         power = power*ratio
      end do
   end function weights_of

   !> Fourier transform of the Gaussian.
   pure real(wp) function spectrum(angle)
      real(wp), intent(in) :: angle

      spectrum = 2.0_wp*sqrt(pi*spread_by)*exp(-spread_by*angle**2)
   end function spectrum

   !> Spreads amplitudes to the grid of frequencies; those of negative frequencies are conjugate.
   pure subroutine spread_out(self, frequencies, amplitudes, grid)
      type(motion_window_t), intent(in) :: self
      real(wp), intent(in) :: frequencies(:)
      complex(wp), intent(in) :: amplitudes(:)
      complex(wp), intent(out) :: grid(0:)
      complex(wp) :: a, padded(-half_width:size(grid) + half_width)
      integer :: h, j

      padded = (0.0_wp, 0.0_wp)
      do h = 1, size(amplitudes)
         a = amplitudes(h)
         if (frequencies(h) < 0.0_wp) a = conjg(a)
         associate (points => padded(self%first(h):self%first(h) + window_points - 1))
            do j = 1, window_points
               points(j) = points(j) + self%weights(j, h)*a
            end do
         end associate
      end do
      grid = padded(0:size(grid) - 1)
      grid(size(grid) - half_width:) = grid(size(grid) - half_width:) + padded(-half_width:-1)
   end subroutine spread_out

   pure subroutine gather(self, sampled, samples)
      type(motion_window_t), intent(in) :: self
      complex(wp), intent(in) :: sampled(0:)
      real(wp), intent(out) :: samples(0:)

      associate (n => size(samples))
         samples(n/2:) = real(sampled(:n - n/2 - 1))
         samples(:n/2 - 1) = real(sampled(size(sampled) - n/2:))
         samples = samples/self%divisors
      end associate
   end subroutine gather

   !> Coordinates at times of the interval, and their rates if it has them, otherwise 0.
   pure subroutine motion_window_at(self, times, z, v)
      class(motion_window_t), intent(in) :: self
      real(wp), intent(in) :: times(:)                               !! [s]
      real(wp), intent(out) :: z(:, :), v(:, :)                      !! (n_times, n_coordinates)
      real(wp) :: position, weights(window_points)
      integer :: c, first, i

      v = 0.0_wp
      do i = 1, size(times)
         position = (times(i) - self%start)/self%spacing + half_width
         first = floor(position) - half_width + 1
         weights = weights_of(position)
         do c = 1, size(z, 2)
            z(i, c) = dot_product(weights, self%samples(first:first + window_points - 1, c, 1))
            if (size(self%samples, 3) > 1) v(i, c) = dot_product(weights, self%samples(first:first + window_points - 1, c, 2))
         end do
      end do
   end subroutine motion_window_at
end module hb_motion_window
