!> A motion as a series in its tones, at any time: x = Re sum of c_j exp(i (j.omega) t), c = cos - i sin.
module hb_motion_series
   use hb_kinds, only: wp
   implicit none
   private
   public :: motion_series_t, new_motion_series

   integer, parameter :: n_together = 32                              ! times, for the vectors of the processor

   type :: motion_series_t
      integer :: n_coordinates = 0
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics)
      real(wp), allocatable :: omega(:)                               !! [rad/s], (n_tones)
      real(wp), allocatable :: frequencies(:)                         !! j.omega [rad/s], (n_harmonics)
      complex(wp), allocatable :: amplitudes(:, :)                    !! (n_coordinates, n_harmonics)
      integer, private :: highest = 0                                 ! entry of a tuple
   contains
      procedure :: at => motion_series_at
      procedure :: phases => motion_series_phases
   end type motion_series_t

contains

   !> Series of coordinates, sum of Re(amplitude exp(i j.omega t)).
   subroutine new_motion_series(self, tuples, omega, amplitudes)
      type(motion_series_t), intent(out) :: self
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_coordinates, n_harmonics)

      self%n_coordinates = size(amplitudes, 1)
      self%tuples = tuples
      self%omega = omega
      self%frequencies = matmul(omega, real(tuples, wp))
      self%amplitudes = amplitudes
      self%highest = max(1, maxval(abs(tuples)))
   end subroutine new_motion_series

   !> Phases of all tones at several times, (n_tones, n_times).
   pure function motion_series_phases(self, times) result(phases)
      class(motion_series_t), intent(in) :: self
      real(wp), intent(in) :: times(:)                                !! [s]
      real(wp) :: phases(size(self%omega), size(times))
      integer :: i

      do i = 1, size(times)
         phases(:, i) = self%omega*times(i)
      end do
   end function motion_series_phases

   !> Coordinates and their rates at several phases; a motion goes through those of its times.
   pure subroutine motion_series_at(self, phases, z, v)
      class(motion_series_t), intent(in) :: self
      real(wp), intent(in) :: phases(:, :)                            !! [rad], (n_tones, n_times)
      real(wp), intent(out) :: z(:, :), v(:, :)                       !! (n_times, n_coordinates)
      integer :: first, last

      do first = 1, size(phases, 2), n_together
         last = min(first + n_together - 1, size(phases, 2))
         call sum_up(self, phases(:, first:last), z(first:last, :), v(first:last, :))
      end do
   end subroutine motion_series_at

   !> Coordinates and their rates at a few phases, side by side: exp(i j.tau) of each tuple from powers of those of the tones.
   pure subroutine sum_up(self, phases, z, v)
      type(motion_series_t), intent(in) :: self
      real(wp), intent(in) :: phases(:, :)                            !! tau [rad], (n_tones, n_times), at most `n_together`
      real(wp), intent(out) :: z(:, :), v(:, :)                       !! (n_times, n_coordinates)
      real(wp), dimension(size(phases, 2), 0:self%highest, size(self%omega)) :: cosine, sine
      real(wp), dimension(size(phases, 2)) :: a, b, c, s
      real(wp), dimension(size(phases, 2), self%n_coordinates) :: place, rate
      integer :: coordinate, h, j, k, m

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
      place = 0.0_wp
      rate = 0.0_wp
      do h = 1, size(self%frequencies)
         j = self%tuples(1, h)
         c = cosine(:, abs(j), 1)
         s = sign(1, j)*sine(:, abs(j), 1)
         do m = 2, size(self%omega)
            j = self%tuples(m, h)
            a = cosine(:, abs(j), m)*c - sign(1, j)*sine(:, abs(j), m)*s
            s = cosine(:, abs(j), m)*s + sign(1, j)*sine(:, abs(j), m)*c
            c = a
         end do
         do coordinate = 1, self%n_coordinates
            associate (x => real(self%amplitudes(coordinate, h)), y => aimag(self%amplitudes(coordinate, h)))
               place(:, coordinate) = place(:, coordinate) + (x*c - y*s)
               rate(:, coordinate) = rate(:, coordinate) - self%frequencies(h)*(x*s + y*c)
            end associate
         end do
      end do
      z = place
      v = rate
   end subroutine sum_up
end module hb_motion_series
