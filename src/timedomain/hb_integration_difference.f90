!> Difference between an integrated record and a motion given by coefficients, and distance of two records, period by period.
!>
!> The difference includes all degrees of freedom, relative to the largest motion in their unit, and the coordinates
!> of all laws, relative to their own motion, so that a contact with a small motion has the same weight as a large
!> one. Where there are laws their coordinates count, at which errors are estimated: other degrees of freedom follow
!> from them, and may respond more strongly to the omitted harmonics.
!>
!> A motion with unknown tones may start at any phase of them: an error of its frequency only shifts it along itself,
!> by a phase that grows with time and is not an error of its shape. Therefore the phases of unknown tones are fitted
!> to each period by least squares; their slope over time is the difference of the frequencies, and the remainder is
!> the difference of the motions. Likewise a distance of two time integrations along the motion does not count.
module hb_integration_difference
   use hb_birkhoff, only: coefficients_at
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: dpotrf, dpotrs
   use hb_time_stepping, only: integration_record_t
   implicit none
   private
   public :: integration_difference_t, motion, new_integration_difference, series_t

   integer, parameter :: max_fits = 8                                 ! steps of Gauss and Newton in one period
   integer, parameter :: min_periods = 3                           ! for a drift
   integer, parameter :: min_instants = 40                         ! per period of the fastest tone
   real(wp), parameter :: largest_step = 0.5_wp                       ! of a phase in one fit [rad]
   real(wp), parameter :: smallest_motion = 1.0e-3_wp                 ! of a coordinate, relative to the largest motion
   real(wp), parameter :: smallest_part = 5.0e-2_wp                   ! of one tone, relative to the motion of the coordinate

   !> A motion sum of Re(amplitude exp(i j.omega t)).
   type :: series_t
      complex(wp), allocatable :: amplitudes(:, :)                    !! cos - i sin [m], (n_harmonics, n_dofs)
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics)
      real(wp), allocatable :: omega(:)                               !! [rad/s], (n_tones)
      logical, allocatable :: is_unknown(:)                           !! (n_tones)
   end type series_t

   type :: integration_difference_t
      integer :: n_dofs = 0, n_items = 0                              !! items: degrees of freedom, then coordinates of laws
      integer :: n_periods = 0
      integer :: n_retained = 0                                       !! periods whose differences are stored for the tones
      real(wp) :: period = 0.0_wp                                     !! of the slowest tone [s]
      real(wp) :: length = 0.0_wp                                     !! scale if nothing moves [m]
      real(wp), allocatable :: largest(:, :)                          !! difference, relative, (n_items, n_periods)
      real(wp), allocatable :: apart(:)                               !! distance of both records, relative, (n_periods)
      real(wp), allocatable :: scale(:)                               !! [m], (n_items), of the relative differences
      real(wp), allocatable :: share(:)                               !! largest motion over that scale, >= 1, (n_items)
      logical, allocatable :: counts(:)                               !! (n_items)
      ! The motion
      complex(wp), allocatable :: amplitudes(:, :)                    !! cos - i sin [m], (n_harmonics, n_items)
      real(wp), allocatable :: shape(:, :)                            !! of the coordinates of the laws, (n_dofs, any)
      real(wp), allocatable :: omega(:), frequencies(:)               !! of tones and harmonics [rad/s]
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics)
      integer, allocatable :: tones(:)                                !! the unknown ones
      character(8), allocatable :: units(:)                           !! (n_dofs)
      real(wp), allocatable :: phases(:, :)                           !! of the unknown tones [rad], (n_unknown, n_periods)
      ! Differences at the coordinates of the laws in the last periods
      real(wp), allocatable :: time(:), remainder(:, :)               !! [s], (n_samples); [m], (n_samples, n_coordinates)
   contains
      procedure :: add => difference_add
      procedure :: drift => difference_drift
      procedure :: parts => difference_parts
   end type integration_difference_t

contains

   !> Creates the difference from a motion.
   subroutine new_integration_difference(self, series, shape, units, length, n_retained)
      type(integration_difference_t), intent(out) :: self
      type(series_t), intent(in) :: series
      real(wp), intent(in) :: shape(:, :)                             !! of the coordinates of the laws, (n_dofs, any)
      character(*), intent(in) :: units(:)                            !! (n_dofs)
      real(wp), intent(in) :: length                                  !! of the system [m]: scale if nothing moves
      integer, intent(in) :: n_retained                               !! last periods stored for `parts`
      integer :: m, n

      n = size(series%amplitudes, 2)
      self%n_dofs = n
      self%n_items = n + size(shape, 2)
      self%n_retained = n_retained
      self%length = length
      self%counts = [spread(size(shape, 2) == 0, 1, n), spread(.true., 1, size(shape, 2))]
      allocate (self%amplitudes(size(series%amplitudes, 1), self%n_items))
      self%amplitudes(:, :n) = series%amplitudes
      self%amplitudes(:, n + 1:) = matmul(series%amplitudes, cmplx(shape, 0.0_wp, wp))
      self%shape = shape
      self%tuples = series%tuples
      self%omega = series%omega
      self%frequencies = matmul(series%omega, real(series%tuples, wp))
      self%tones = pack([(m, m=1, size(series%omega))], series%is_unknown)
      self%units = units
      self%period = two_pi/minval(series%omega)
      allocate (self%largest(self%n_items, 0), self%apart(0), self%phases(size(self%tones), 0), self%time(0))
      allocate (self%remainder(0, size(shape, 2)))
   end subroutine new_integration_difference

   !> Adds the periods of two records that start at the same time, the second one of a time integration close to the
   !> first.
   subroutine difference_add(self, record, other, n_new)
      class(integration_difference_t), intent(inout) :: self
      type(integration_record_t), intent(in) :: record, other         !! of all degrees of freedom, in their order
      integer, intent(in) :: n_new                                    !! periods in the records
      complex(wp), allocatable :: waves(:, :)
      real(wp), allocatable, dimension(:, :) :: beside, largest, phases, remainder, x
      real(wp), allocatable, dimension(:) :: apart, phase, t
      integer, allocatable :: rows(:)
      integer :: first, h, i, k, last, n, n_samples, stride

      n = self%n_periods
      if (n == 0) call find_scale(self, record)
      n_samples = (size(record%every_displacement, 1) - 1)/n_new
      stride = max(1, int(n_samples*minval(self%omega)/(min_instants*maxval(self%omega))))
      do while (modulo(n_samples, stride) /= 0)
         stride = stride - 1
      end do
      allocate (largest(self%n_items, n + n_new), apart(n + n_new), phases(size(self%tones), n + n_new))
      largest(:, :n) = self%largest
      apart(:n) = self%apart
      phases(:, :n) = self%phases
      do k = n + 1, n + n_new
         first = (k - n - 1)*n_samples + 1
         last = first + n_samples
         allocate (rows, source=[(i, i=first, last, stride)])
         allocate (t(size(rows)), source=record%start + (rows - 1)*record%step)
         allocate (x, source=with_coordinates(self, record%every_displacement(rows, :)))
         allocate (waves(size(t), size(self%frequencies)))
         do h = 1, size(self%frequencies)
            waves(:, h) = cmplx(cos(self%frequencies(h)*t), sin(self%frequencies(h)*t), wp)
         end do
         allocate (phase(size(self%tones)), source=0.0_wp)
         if (k > 1) phase = phases(:, k - 1)
         if (k > 2) phase = 2.0_wp*phases(:, k - 1) - phases(:, k - 2)
         call fit(self, waves, x, phase)
         phases(:, k) = phase
         allocate (remainder, source=x - moved(waves, turned(self, phase)))
         largest(:, k) = maxval(abs(remainder), dim=1)/self%scale
         allocate (beside, source=with_coordinates(self, other%every_displacement(rows, :)))
         apart(k) = distance(self, waves, phase, beside - x)
         call store_period(self, k, t(:size(t) - 1), remainder(:size(t) - 1, self%n_dofs + 1:))
         deallocate (beside, phase, remainder, rows, t, waves, x)
      end do
      call move_alloc(largest, self%largest)
      call move_alloc(apart, self%apart)
      call move_alloc(phases, self%phases)
      self%n_periods = n + n_new
   end subroutine difference_add

   !> Stores the differences of the last periods at the coordinates of the laws.
   subroutine store_period(self, period, t, remainder)
      class(integration_difference_t), intent(inout) :: self
      integer, intent(in) :: period                                   !! its number
      real(wp), intent(in) :: t(:), remainder(:, :)
      real(wp), allocatable :: joined(:, :)
      integer :: first, n

      if (size(remainder, 2) == 0 .or. self%n_retained == 0) return
      n = size(self%time)
      first = 1
      if (period > self%n_retained) first = size(t) + 1               ! all periods have the same number of samples
      allocate (joined(n - first + 1 + size(t), size(remainder, 2)))
      joined(:n - first + 1, :) = self%remainder(first:, :)
      joined(n - first + 2:, :) = remainder
      self%time = [self%time(first:), t]
      call move_alloc(joined, self%remainder)
   end subroutine store_period

   !> Differences of the first harmonic of each tone at the coordinates of the laws in the stored periods, relative to
   !> their own amplitude; and the ratio of that to the largest motion.
   subroutine difference_parts(self, differences, shares)
      class(integration_difference_t), intent(in) :: self
      real(wp), allocatable, intent(out) :: differences(:, :)         !! (n_coordinates, n_tones), 0: tone not in the set
      real(wp), allocatable, intent(out) :: shares(:, :)              !! as differences
      complex(wp) :: found(size(self%omega))
      real(wp) :: part
      integer :: c, h, m

      allocate (differences(size(self%shape, 2), size(self%omega)), source=0.0_wp)
      allocate (shares(size(self%shape, 2), size(self%omega)), source=1.0_wp)
      if (size(self%time) < 3) return
      do c = 1, size(self%shape, 2)
         call coefficients_at(self%remainder(:, c), self%time(1), &
                              (self%time(size(self%time)) - self%time(1))/(size(self%time) - 1), self%omega, found)
         do m = 1, size(self%omega)
            do h = 1, size(self%frequencies)
               if (sum(abs(self%tuples(:, h))) /= 1 .or. self%tuples(m, h) == 0) cycle
               associate (own => self%scale(self%n_dofs + c))
                  part = max(abs(self%amplitudes(h, self%n_dofs + c)), smallest_part*own)
                  differences(c, m) = abs(found(m))/part
                  shares(c, m) = max(1.0_wp, self%share(self%n_dofs + c)*own/part)
               end associate
            end do
         end do
      end do
   end subroutine difference_parts

   !> Integrated frequencies minus those of the motion [rad/s], (n_tones), 0 for known tones: from the first periods.
   pure function difference_drift(self, n_periods) result(drift)
      class(integration_difference_t), intent(in) :: self
      integer, intent(in) :: n_periods                                !! at least three are used if available
      real(wp) :: drift(size(self%omega))
      integer :: m, n

      n = min(self%n_periods, max(min_periods, n_periods))
      drift = 0.0_wp
      if (n < 2) return
      do m = 1, size(self%tones)
         drift(self%tones(m)) = slope(self%phases(m, :n))/self%period
      end do
   end function difference_drift

   !> Phases with the smallest sum of squares of the difference, starting from the given ones.
   subroutine fit(self, waves, x, phase)
      type(integration_difference_t), intent(in) :: self
      complex(wp), intent(in) :: waves(:, :)                          !! exp(i j.omega t), (n_samples, n_harmonics)
      real(wp), intent(in) :: x(:, :)                                 !! [m], (n_samples, n_items)
      real(wp), intent(inout) :: phase(:)                             !! [rad], (n_unknown)
      real(wp) :: change(size(phase))
      integer :: iteration
      logical :: is_found

      if (size(phase) == 0) return
      do iteration = 1, max_fits
         call along(self, waves, phase, x(:, :self%n_dofs) - moved(waves, turned(self, phase, self%n_dofs)), change, is_found)
         if (.not. is_found) return                                   ! nothing moves with one of the tones
         phase = phase + min(max(change, -largest_step), largest_step)
         if (maxval(abs(change)) <= 1.0e-13_wp) return
      end do
   end subroutine fit

   !> Phase changes for which a small difference of the degrees of freedom is along the motion, by least squares.
   subroutine along(self, waves, phase, difference, change, is_found, left)
      type(integration_difference_t), intent(in) :: self
      complex(wp), intent(in) :: waves(:, :)
      real(wp), intent(in) :: phase(:), difference(:, :)              !! [rad]; [m], (n_samples, n_dofs)
      real(wp), intent(out) :: change(:)                              !! [rad], as phase
      logical, intent(out) :: is_found
      real(wp), intent(inout), optional :: left(:, :)                 !! [m], (n_samples, n_items): minus the part along the motion
      real(wp), allocatable :: directions(:, :, :)
      complex(wp) :: there(size(self%frequencies), self%n_items)
      real(wp) :: normal(size(phase), size(phase)), weights(self%n_dofs)
      integer :: a, b, info

      weights = 1.0_wp/self%scale(:self%n_dofs)**2
      there = turned(self, phase)
      allocate (directions(size(waves, 1), self%n_items, size(phase)))
      do a = 1, size(phase)
         directions(:, :, a) = moved(waves, there*spread(cmplx(0.0_wp, self%tuples(self%tones(a), :), wp), 2, self%n_items))
         change(a) = sum(matmul(directions(:, :self%n_dofs, a)*difference, weights))
         do b = 1, a
            normal(a, b) = sum(matmul(directions(:, :self%n_dofs, a)*directions(:, :self%n_dofs, b), weights))
         end do
      end do
      call dpotrf("L", size(phase), normal, size(phase), info)
      is_found = info == 0
      if (.not. is_found) return
      call dpotrs("L", size(phase), 1, normal, size(phase), change, size(phase), info)
      if (.not. present(left)) return
      do a = 1, size(phase)
         left = left - change(a)*directions(:, :, a)
      end do
   end subroutine along

   !> Largest distance of two time integrations in one period, relative, without the part along the motion.
   real(wp) function distance(self, waves, phase, between)
      type(integration_difference_t), intent(in) :: self
      complex(wp), intent(in) :: waves(:, :)
      real(wp), intent(in) :: phase(:), between(:, :)                 !! [rad]; [m], (n_samples, n_items)
      real(wp) :: change(size(phase)), left(size(between, 1), size(between, 2))
      logical :: is_found

      left = between
      if (size(phase) > 0) call along(self, waves, phase, between(:, :self%n_dofs), change, is_found, left)
      distance = maxval(maxval(abs(left), dim=1)/self%scale)
   end function distance

   !> Amplitudes at other phases of the unknown tones, of all items or of the first ones.
   pure function turned(self, phase, n_items) result(amplitudes)
      type(integration_difference_t), intent(in) :: self
      real(wp), intent(in) :: phase(:)
      integer, intent(in), optional :: n_items
      complex(wp), allocatable :: amplitudes(:, :)
      real(wp) :: angle(size(self%frequencies))
      integer :: n

      n = self%n_items
      if (present(n_items)) n = n_items
      amplitudes = self%amplitudes(:, :n)
      if (size(phase) == 0) return
      angle = matmul(phase, real(self%tuples(self%tones, :), wp))
      amplitudes = amplitudes*spread(cmplx(cos(angle), sin(angle), wp), 2, n)
   end function turned

   !> Displacements at the times of some waves.
   pure function moved(waves, amplitudes) result(x)
      complex(wp), intent(in) :: waves(:, :), amplitudes(:, :)
      real(wp) :: x(size(waves, 1), size(amplitudes, 2))
      real(wp), dimension(size(waves, 1), size(waves, 2)) :: cosines, sines
      real(wp), dimension(size(amplitudes, 1), size(amplitudes, 2)) :: cosine_parts, sine_parts

      cosines = real(waves, wp)
      cosine_parts = real(amplitudes, wp)
      sines = aimag(waves)
      sine_parts = aimag(amplitudes)
      x = matmul(cosines, cosine_parts) - matmul(sines, sine_parts)
   end function moved

   !> Degrees of freedom followed by the coordinates of the laws.
   pure function with_coordinates(self, q) result(x)
      type(integration_difference_t), intent(in) :: self
      real(wp), intent(in) :: q(:, :)                                 !! [m], (n_samples, n_dofs)
      real(wp) :: x(size(q, 1), self%n_items)

      x(:, :self%n_dofs) = q
      x(:, self%n_dofs + 1:) = matmul(q, self%shape)
   end function with_coordinates

   !> Displacements of a motion at one time.
   pure function motion(amplitudes, frequencies, t) result(x)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin [m], (n_harmonics, n_dofs)
      real(wp), intent(in) :: frequencies(:), t                       !! [rad/s], (n_harmonics); [s]
      real(wp) :: x(size(amplitudes, 2))
      complex(wp) :: waves(size(frequencies))

      waves = cmplx(cos(frequencies*t), sin(frequencies*t), wp)
      x = real(matmul(waves, amplitudes), wp)
   end function motion

   !> Scales: for a degree of freedom the largest motion in its unit, or the length of the system if that is at rest;
   !> for a coordinate its own motion, the amplitude of an oscillation with the same mean square.
   pure subroutine find_scale(self, record)
      class(integration_difference_t), intent(inout) :: self
      type(integration_record_t), intent(in) :: record
      real(wp) :: motions(self%n_dofs), extent
      integer :: c, k

      allocate (self%scale(self%n_items), self%share(self%n_items))
      associate (n => self%n_dofs, units => self%units)
         motions = sum(abs(self%amplitudes(:, :n)), dim=1)
         do k = 1, n
            if (any(motions > 0.0_wp .and. units == units(k))) cycle
            motions(k) = max(maxval(abs(record%every_displacement(:, k))), self%length, tiny(1.0_wp))
         end do
         self%scale(:n) = [(maxval(motions, mask=units == units(k)), k=1, n)]
         self%share(:n) = 1.0_wp
         do c = 1, size(self%shape, 2)
            extent = maxval(abs(self%shape(:, c))*self%scale(:n))
            self%scale(n + c) = max(sqrt(sum(abs(self%amplitudes(:, n + c))**2, mask=any(self%tuples /= 0, dim=1))), &
                                    smallest_motion*extent, tiny(1.0_wp))
            self%share(n + c) = max(1.0_wp, extent/self%scale(n + c))
         end do
      end associate
   end subroutine find_scale

   !> Slope of a straight line through equidistant values, at least two.
   pure real(wp) function slope(values)
      real(wp), intent(in) :: values(:)
      real(wp) :: abscissa(size(values))
      integer :: k

      abscissa = [(k - 0.5_wp*(size(values) + 1), k=1, size(values))]
      slope = sum(abscissa*values)/sum(abscissa**2)
   end function slope
end module hb_integration_difference
