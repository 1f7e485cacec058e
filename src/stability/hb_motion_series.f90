!> A motion as a series in its tones, at any time: x = Re sum of c_j exp(i (j.omega) t), c = cos - i sin.
module hb_motion_series
   use hb_kinds, only: wp
   implicit none
   private
   public :: motion_series_t, new_motion_series

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
      complex(wp) :: waves(size(self%frequencies))
      integer :: c, h, i
      real(wp) :: place, rate

      do i = 1, size(phases, 2)
         call find_waves(self, phases(:, i), waves)
         do c = 1, self%n_coordinates
            place = 0.0_wp
            rate = 0.0_wp
            do h = 1, size(waves)
               associate (a => self%amplitudes(c, h))
                  place = place + real(a)*real(waves(h)) - aimag(a)*aimag(waves(h))
                  rate = rate - self%frequencies(h)*(real(a)*aimag(waves(h)) + aimag(a)*real(waves(h)))
               end associate
            end do
            z(i, c) = place
            v(i, c) = rate
         end do
      end do
   end subroutine motion_series_at

   !> exp(i j.tau) of all tuples, from powers of those of the tones.
   pure subroutine find_waves(self, phases, waves)
      type(motion_series_t), intent(in) :: self
      real(wp), intent(in) :: phases(:)                               !! tau [rad], (n_tones)
      complex(wp), intent(out) :: waves(:)                            !! (n_harmonics)
      complex(wp) :: powers(0:self%highest, size(self%omega)), wave
      integer :: h, k, m

      do m = 1, size(self%omega)
         wave = cmplx(cos(phases(m)), sin(phases(m)), wp)
         powers(0, m) = (1.0_wp, 0.0_wp)
         do k = 1, self%highest
            powers(k, m) = powers(k - 1, m)*wave
         end do
      end do
      do h = 1, size(waves)
         waves(h) = powers(abs(self%tuples(1, h)), 1)
         if (self%tuples(1, h) < 0) waves(h) = conjg(waves(h))
         do m = 2, size(self%omega)
            wave = powers(abs(self%tuples(m, h)), m)
            if (self%tuples(m, h) < 0) wave = conjg(wave)
            waves(h) = waves(h)*wave
         end do
      end do
   end subroutine find_waves
end module hb_motion_series
