!> The sample grid in hypertime: the number of samples per tone, and their positions.
module hb_torus
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: int64, two_pi, wp
   use hb_text, only: to_text
   implicit none
   private
   public :: cheap_size, default_samples, fast_size, new_torus, samples_for, torus_t

   real(wp), parameter :: non_smooth_oversampling = 3.0_wp            ! times the 2N + 1 samples that N harmonics need
   integer, parameter :: smallest_grid = 8                            ! samples of a tone with few harmonics
   integer(int64), parameter :: largest_grid = 500000000_int64       ! samples, 4 GB for one degree of freedom

   !> Equidistant grid tau_m = 2 pi i/n_m, i = 0..n_m - 1; tone 1 is the fastest index. Half of it, the first half of
   !> the last tone, determines a motion that changes its sign, or a slope that does not, when all phases shift by pi.
   type :: torus_t
      integer :: n_total = 0                                          !! samples, of the half grid if it is one
      integer, allocatable :: n_samples(:)                            !! of the whole grid, (n_tones)
      logical :: is_half = .false.
      logical :: corrects_kinks = .false.                             !! of forces between samples, see hb_kinks
   contains
      procedure :: can_be_halved => torus_can_be_halved
      procedure :: check => torus_check
      procedure :: half => torus_half
      procedure :: phases => torus_phases
      procedure :: equal => torus_equal
      procedure :: resample => torus_resample
   end type torus_t

contains

   !> Creates a grid with the given numbers of samples; fails if a tone has too few to distinguish its harmonics.
   subroutine new_torus(self, n_samples, harmonics, error)
      type(torus_t), intent(out) :: self
      integer, intent(in) :: n_samples(:)                             !! (n_tones), at least 2 N_m + 1 each
      type(harmonics_t), intent(in) :: harmonics
      type(error_t), allocatable, intent(out) :: error

      call self%resample(n_samples)
      call self%check(harmonics, error)
      if (allocated(error)) self = torus_t()
   end subroutine new_torus

   !> Changes the numbers of samples of a whole grid.
   pure subroutine torus_resample(self, n_samples)
      class(torus_t), intent(inout) :: self
      integer, intent(in) :: n_samples(:)                             !! (n_tones)

      self%n_samples = n_samples
      self%n_total = huge(1)
      if (product(real(n_samples, wp)) <= real(largest_grid, wp)) self%n_total = product(n_samples)
   end subroutine torus_resample

   !> Fails if a tone has too few samples to distinguish its harmonics, or the grid too many.
   subroutine torus_check(self, harmonics, error)
      class(torus_t), intent(in) :: self
      type(harmonics_t), intent(in) :: harmonics
      type(error_t), allocatable, intent(out) :: error
      integer :: m

      if (size(self%n_samples) /= harmonics%n_tones) then
         call fail(error, "samples are given for "//to_text(size(self%n_samples))//" tones, the model has "// &
            to_text(harmonics%n_tones))
         return
      end if
      do m = 1, size(self%n_samples)
         if (self%n_samples(m) < 2*harmonics%highest(m) + 1) then
            call fail(error, "tone "//to_text(m)//" has "//to_text(self%n_samples(m))//" samples, order "// &
               to_text(harmonics%highest(m))//" needs at least "//to_text(2*harmonics%highest(m) + 1))
            return
         end if
      end do
      if (self%n_total > largest_grid) call fail(error, "the torus would have "//to_text(product(real(self%n_samples, wp)))// &
         " samples, more than "//to_text(largest_grid)//"; lower the orders or the samples")
   end subroutine torus_check

   !> Samples per tone for a law that is a polynomial of the given degree (exact for all retained harmonics: (degree +
   !> 1) N + 1), or for a non-smooth law (degree 0): three times what the harmonics need; rounded up to a fast size.
   pure function default_samples(harmonics, degree) result(n_samples)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: degree
      integer :: n_samples(harmonics%n_tones)

      n_samples = samples_for(harmonics%highest, degree)
   end function default_samples

   !> Samples per tone, as `default_samples`, for the largest entries N_m of the tuples.
   pure function samples_for(highest, degree) result(n_samples)
      integer, intent(in) :: highest(:)                               !! (n_tones)
      integer, intent(in) :: degree
      integer :: n_samples(size(highest))
      integer :: m, needed

      do m = 1, size(highest)
         if (degree > 0) then
            needed = (degree + 1)*highest(m) + 1
         else
            needed = ceiling(non_smooth_oversampling*(2*highest(m) + 1))
         end if
         n_samples(m) = fast_size(max(needed, smallest_grid))
      end do
   end function samples_for

   !> Smallest even number >= n whose prime factors are 2, 3, 5 and 7, which FFTW transforms fast.
   elemental integer function fast_size(n)
      integer, intent(in) :: n
      integer, parameter :: transform_factors(4) = [2, 3, 5, 7]
      integer :: i, cofactor

      fast_size = max(2, n + modulo(n, 2))
      do
         cofactor = fast_size
         do i = 1, size(transform_factors)
            do while (modulo(cofactor, transform_factors(i)) == 0)
               cofactor = cofactor/transform_factors(i)
            end do
         end do
         if (cofactor == 1) return
         fast_size = fast_size + 2
      end do
   end function fast_size

   !> Size of at least n with the cheapest transforms in all tones: per sample a power of two costs two thirds of
   !> other fast sizes, so it may be larger by that factor.
   elemental integer function cheap_size(n, n_tones)
      integer, intent(in) :: n
      integer, intent(in) :: n_tones                                  !! number of tones with such a size
      integer :: power

      cheap_size = fast_size(n)
      power = 2
      do while (power < n)
         power = 2*power
      end do
      if (real(power, wp)**n_tones <= 1.5_wp*real(cheap_size, wp)**n_tones) cheap_size = power
   end function cheap_size

   !> Phases (n_tones, n_total) [rad] of all samples.
   pure function torus_phases(self) result(tau)
      class(torus_t), intent(in) :: self
      real(wp) :: tau(size(self%n_samples), self%n_total)
      integer :: i, m, quotient

      do i = 1, self%n_total
         quotient = i - 1
         do m = 1, size(self%n_samples)
            tau(m, i) = two_pi*modulo(quotient, self%n_samples(m))/self%n_samples(m)
            quotient = quotient/self%n_samples(m)
         end do
      end do
   end function torus_phases

   !> Whether a sample shifted by half a period is a sample again in each tone; a single tone is halved once more
   !> within its transform.
   pure logical function torus_can_be_halved(self)
      class(torus_t), intent(in) :: self

      torus_can_be_halved = all(modulo(self%n_samples, 2) == 0)
      if (size(self%n_samples) == 1) torus_can_be_halved = modulo(self%n_samples(1), 4) == 0
   end function torus_can_be_halved

   !> Half of a whole grid that can be halved.
   pure type(torus_t) function torus_half(self) result(half)
      class(torus_t), intent(in) :: self

      half = self
      half%is_half = .true.
      half%n_total = self%n_total/2
   end function torus_half

   !> Whether this is the grid of another one, with the same corrections.
   pure logical function torus_equal(self, other) result(are_equal)
      class(torus_t), intent(in) :: self
      type(torus_t), intent(in) :: other

      are_equal = size(self%n_samples) == size(other%n_samples) .and. (self%is_half .eqv. other%is_half) .and. &
                  (self%corrects_kinks .eqv. other%corrects_kinks)
      if (are_equal) are_equal = all(self%n_samples == other%n_samples)
   end function torus_equal
end module hb_torus
