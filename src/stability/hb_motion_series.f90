!> A motion as a series in its tones, at any time: x = Re sum of c_j exp(i j.(start + omega t)), c = cos - i sin.
module hb_motion_series
   use hb_kinds, only: wp
   implicit none
   private
   public :: motion_series_t, new_motion_series

   integer, parameter :: n_together = 32                              ! times, for vectorisation

   type :: motion_series_t
      integer :: n_coordinates = 0
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics)
      real(wp), allocatable :: omega(:)                               !! [rad/s], (n_tones)
      real(wp), allocatable :: start(:)                               !! phases at t = 0 [rad], (n_tones)
      real(wp), allocatable :: frequencies(:)                         !! j.omega [rad/s], (n_harmonics)
      complex(wp), allocatable :: amplitudes(:, :)                    !! (n_coordinates, n_harmonics)
      integer, allocatable, private :: rows(:, :)                     ! tuples without their last entry, (n_tones - 1, any)
      integer, allocatable, private :: first(:)                       ! first part of each row, and one beyond the last
      integer, allocatable, private :: orders(:)                      ! size of the last entry in each part
      real(wp), allocatable, private :: parts(:, :, :)                ! of rows, (8, n_coordinates, any): factors of the cosine
                                                                      !! and of the sine of multiples of the last phase, each
                                                                      !! real and imaginary; of the displacement, then of the
                                                                      !! rate
      integer, private :: highest = 0                                 ! entry of a tuple
   contains
      procedure :: at => motion_series_at
      procedure :: phases => motion_series_phases
   end type motion_series_t

contains

   !> Creates the series of coordinates, sum of Re(amplitude exp(i j.omega t)): all phases start at 0.
   subroutine new_motion_series(self, tuples, omega, amplitudes)
      type(motion_series_t), intent(out) :: self
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_coordinates, n_harmonics)

      self%n_coordinates = size(amplitudes, 1)
      self%tuples = tuples
      self%omega = omega
      self%start = 0.0_wp*omega
      self%frequencies = matmul(omega, real(tuples, wp))
      self%amplitudes = amplitudes
      self%highest = max(1, maxval(abs(tuples)))
      call gather_rows(self)
   end subroutine new_motion_series

   !> Groups tuples that differ only in their last entry: those of k and -k share cosine and sine of k times the
   !> phase.
   pure subroutine gather_rows(self)
      type(motion_series_t), intent(inout) :: self
      integer :: part(0:self%highest), row(size(self%frequencies))
      integer :: coordinate, h, k, n, n_rows, r

      associate (n_tones => size(self%omega), tuples => self%tuples)
         allocate (self%rows(n_tones - 1, size(row)), self%first(size(row) + 1), self%orders(size(row)))
         allocate (self%parts(8, self%n_coordinates, size(row)), source=0.0_wp)
         n_rows = 0
         do h = 1, size(row)
            do r = 1, n_rows
               if (all(self%rows(:, r) == tuples(:n_tones - 1, h))) exit
            end do
            row(h) = r
            self%rows(:, r) = tuples(:n_tones - 1, h)
            n_rows = max(n_rows, r)
         end do
         n = 0
         do r = 1, n_rows
            self%first(r) = n + 1
            part = 0
            do h = 1, size(row)
               if (row(h) /= r) cycle
               k = abs(tuples(n_tones, h))
               if (part(k) == 0) then
                  n = n + 1
                  part(k) = n
                  self%orders(n) = k
               end if
               do coordinate = 1, self%n_coordinates
                  associate (values => self%parts(:, coordinate, part(k)), a => self%amplitudes(coordinate, h), &
                             sense => sign(1, tuples(n_tones, h)), rate => self%frequencies(h))
                     values(1:4) = values(1:4) + [real(a), aimag(a), -sense*aimag(a), sense*real(a)]
                     values(5:8) = values(5:8) + rate*[-aimag(a), real(a), -sense*real(a), -sense*aimag(a)]
                  end associate
               end do
            end do
         end do
         self%first = [self%first(:n_rows), n + 1]
      end associate
   end subroutine gather_rows

   !> Phases of all tones at several times, (n_tones, n_times).
   pure function motion_series_phases(self, times) result(phases)
      class(motion_series_t), intent(in) :: self
      real(wp), intent(in) :: times(:)                                !! [s]
      real(wp) :: phases(size(self%omega), size(times))
      integer :: i

      do i = 1, size(times)
         phases(:, i) = self%start + self%omega*times(i)
      end do
   end function motion_series_phases

   !> Coordinates and their rates at several phases, as along the motion.
   pure subroutine motion_series_at(self, phases, z, v, with_rates)
      class(motion_series_t), intent(in) :: self
      real(wp), intent(in) :: phases(:, :)                            !! [rad], (n_tones, n_times)
      real(wp), intent(out) :: z(:, :), v(:, :)                       !! (n_times, n_coordinates)
      logical, intent(in), optional :: with_rates                     !! false: v is 0, at half the cost; default true
      integer :: first, last
      logical :: has_rates

      has_rates = .true.
      if (present(with_rates)) has_rates = with_rates
      do first = 1, size(phases, 2), n_together
         last = min(first + n_together - 1, size(phases, 2))
         call sum_up(self, phases(:, first:last), has_rates, z(first:last, :), v(first:last, :))
      end do
   end subroutine motion_series_at

   !> Coordinates and their rates at a few phases, vectorised: multiples of each phase from the previous one, rows
   !> from those of the last tone.
   pure subroutine sum_up(self, phases, has_rates, z, v)
      type(motion_series_t), intent(in) :: self
      real(wp), intent(in) :: phases(:, :)                            !! tau [rad], (n_tones, n_times), at most `n_together`
      logical, intent(in) :: has_rates
      real(wp), intent(out) :: z(:, :), v(:, :)                       !! (n_times, n_coordinates)
      real(wp), dimension(size(phases, 2), 0:self%highest, size(self%omega)) :: cosine, sine
      real(wp), dimension(size(phases, 2)) :: a, b, c, s
      real(wp), dimension(size(phases, 2), 4) :: sums                 ! of a row: displacement, rate, each real and imaginary
      real(wp), dimension(size(phases, 2), self%n_coordinates) :: displacement, rate
      integer :: coordinate, i, j, k, last, m, n, r

      do m = 1, size(self%omega)
         cosine(:, 0, m) = 1.0_wp
         sine(:, 0, m) = 0.0_wp
         a = cos(phases(m, :))
         b = sin(phases(m, :))
         do k = 1, self%highest
            cosine(:, k, m) = cosine(:, k - 1, m)*a - sine(:, k - 1, m)*b
            sine(:, k, m) = cosine(:, k - 1, m)*b + sine(:, k - 1, m)*a
         end do
      end do
      displacement = 0.0_wp
      rate = 0.0_wp
      last = size(self%omega)
      do r = 1, size(self%first) - 1
         c = 1.0_wp
         s = 0.0_wp
         do m = 1, last - 1
            j = self%rows(m, r)
            a = cosine(:, abs(j), m)*c - sign(1, j)*sine(:, abs(j), m)*s
            s = cosine(:, abs(j), m)*s + sign(1, j)*sine(:, abs(j), m)*c
            c = a
         end do
         do coordinate = 1, self%n_coordinates
            sums = 0.0_wp
            do n = self%first(r), self%first(r + 1) - 1
               k = self%orders(n)
               associate (part => self%parts(:, coordinate, n))
                  do i = 1, size(phases, 2)
                     sums(i, 1) = sums(i, 1) + (part(1)*cosine(i, k, last) + part(3)*sine(i, k, last))
                     sums(i, 2) = sums(i, 2) + (part(2)*cosine(i, k, last) + part(4)*sine(i, k, last))
                  end do
                  if (.not. has_rates) cycle
                  do i = 1, size(phases, 2)
                     sums(i, 3) = sums(i, 3) + (part(5)*cosine(i, k, last) + part(7)*sine(i, k, last))
                     sums(i, 4) = sums(i, 4) + (part(6)*cosine(i, k, last) + part(8)*sine(i, k, last))
                  end do
               end associate
            end do
            displacement(:, coordinate) = displacement(:, coordinate) + (c*sums(:, 1) - s*sums(:, 2))
            rate(:, coordinate) = rate(:, coordinate) + (c*sums(:, 3) - s*sums(:, 4))
         end do
      end do
      z = displacement
      v = rate
   end subroutine sum_up
end module hb_motion_series
