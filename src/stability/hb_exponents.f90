!> Lyapunov exponents along a motion of several tones: the growth rates of disturbances, averaged over the torus.
!>
!> Disturbances are propagated period by period, each of the slowest tone, and orthogonalised after each (Benettin). The
!> logarithms of their growth are averaged with a smooth window, which converges faster than any power of the length if the
!> linear equations can be reduced to constant ones. The largest difference between this average and averages over half the
!> record, or its change by sorting, is the spread; the difference of both halves alone may vanish by chance. Disturbances may
!> beat for longer than the record: they then grow in both halves and decay later. Exponents whose disturbances have not become
!> very different in size may all equal their mean, and growth counts only if that is growth too.
!> Sources: G. Benettin, L. Galgani, A. Giorgilli and J.-M. Strelcyn, Meccanica 15 (1980) 9-20; S. Das, Y.
!> Saiki, E. Sander and J. A. Yorke, Nonlinearity 30 (2017) 4111-4140.
module hb_exponents
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_beat, only: slowest_beat
   use hb_birkhoff, only: bump_weights
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: wp
   use hb_stability, only: few_periods
   use hb_thresholds, only: certainty_factor, estimate_safety
   implicit none
   private
   public :: exponents_t, find_exponents, orthogonalise, periods_of_beats, propagation_t, work_of_exponents

   real(wp), parameter :: beats_of_record = 3.0_wp                    ! its halves then end at opposite phases of the beat

   !> Propagation of disturbances along a motion.
   type, abstract :: propagation_t
      integer :: size = 0                                             !! of a disturbance
      integer :: n_begun = 0                                          !! its first entries, displacements and velocities
      integer :: n_followed = 0                                       !! disturbances without those that are known to be neutral
      real(wp) :: length = 0.0_wp                                     !! of a period [s]
      real(wp) :: work = 0.0_wp                                       !! of a typical period, in about a nanosecond
      real(wp) :: work_left = huge(1.0_wp)                            !! of all periods, likewise
      real(wp) :: surge = 0.0_wp                                      !! logarithm of the largest growth of the first
                                                                      !! disturbance from any time to a later one, if periods
                                                                      !! record it
   contains
      procedure(reach_steady_state_of), deferred :: reach_steady_state
      procedure(propagate_disturbances), deferred :: propagate
   end type propagation_t

   abstract interface
      !> Advances some periods along the motion before the first one counts, until states with memory are periodic.
      subroutine reach_steady_state_of(self, n_periods, is_done)
         import :: propagation_t
         class(propagation_t), intent(inout) :: self
         integer, intent(in) :: n_periods
         logical, intent(out) :: is_done                              !! otherwise the motion was lost
      end subroutine reach_steady_state_of

      !> Propagates disturbances through the next period.
      subroutine propagate_disturbances(self, x, is_done)
         import :: propagation_t, wp
         class(propagation_t), intent(inout) :: self
         real(wp), intent(inout), contiguous :: x(:, :)               !! (size, n_followed)
         logical, intent(out) :: is_done                              !! otherwise the motion was lost
      end subroutine propagate_disturbances
   end interface

   type :: exponents_t
      real(wp), allocatable :: rate(:)                                !! [1/s], the largest first; not allocated if lost
      real(wp), allocatable :: spread(:)                              !! likewise
      integer :: n_periods = 0
      logical :: is_resolved = .true.                                 !! the sign of the largest one is not that of a beat
      logical :: is_cut_short = .false.                               !! more periods would exceed the permitted work
   end type exponents_t

   real(wp), parameter :: max_beat_growth = log(1.0e3_wp) ! largest ratio of the sizes of disturbances that may only beat
   integer, parameter :: n_windows = 5                                ! halves of the record that are compared with it
   integer, parameter :: longer_beat = 8                              ! periods to resolve one, relative to the usual limit

contains

   !> Periods of the slowest tone that an average has to last for: in a part of a slow beat disturbances may grow although they
   !> decay on the whole, and the reverse.
   pure integer function periods_of_beats(tuples, omega, amplitudes) result(n_periods)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_dofs, n_harmonics)

      n_periods = ceiling(min(beats_of_record*minval(abs(omega))/slowest_beat(tuples, omega, amplitudes), 1.0e8_wp))
   end function periods_of_beats

   !> Propagates disturbances until the largest exponent exceeds its spread in magnitude and is resolved, or the work is used up.
   !> Of disturbances that beat with each other the first one may not have the largest exponent yet.
   subroutine find_exponents(self, propagation, max_work, min_periods, max_periods)
      type(exponents_t), intent(out) :: self
      class(propagation_t), intent(inout) :: propagation
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      integer, intent(in) :: min_periods                           !! of an average
      integer, intent(in) :: max_periods                             !! doubled up to this number, while the spread is too large
      type(exponents_t) :: found
      real(wp), allocatable :: growth(:, :), longer(:, :), x(:, :)
      integer :: forgotten, i, k, n_all
      logical :: is_done

      propagation%work_left = 4.0_wp*max_work                       ! balls of a bearing need 3.5 times the expected work
      call propagation%reach_steady_state(n_forgotten_of(min_periods), is_done)
      if (.not. is_done .or. propagation%n_followed < 1) return
      allocate (x(propagation%size, propagation%n_followed), source=0.0_wp)
      do i = 1, propagation%n_followed
         do k = 1, propagation%n_begun                                ! in no special directions
            x(k, i) = cos(real(3*i*k + k + i, wp)) + merge(2.0_wp, 0.0_wp, i == k)
         end do
      end do
      allocate (growth(propagation%n_followed, 0))
      found%n_periods = min_periods
      do
         forgotten = n_forgotten_of(found%n_periods)
         n_all = found%n_periods + forgotten
         allocate (longer(propagation%n_followed, n_all))
         longer(:, :size(growth, 2)) = growth
         k = size(growth, 2) + 1
         call move_alloc(longer, growth)
         do i = k, n_all
            call propagation%propagate(x, is_done)
            if (.not. is_done .or. work_is_over()) return
            self%is_cut_short = propagation%work_left < 0.0_wp
            if (self%is_cut_short) return
            call orthogonalise(x, growth(:, i))
            if (.not. all(ieee_is_finite(growth(:, i)))) return
         end do
         call average(growth(:, forgotten + 1:), propagation%length, found%rate, found%spread)
         found%is_resolved = is_resolved(found%rate, found%n_periods*propagation%length)
         if (found%is_resolved .and. &
             abs(found%rate(1)) > merge(certainty_factor, estimate_safety, found%n_periods <= few_periods)*found%spread(1)) exit
         found%is_cut_short = 2.0_wp*n_all*propagation%work > max_work
         if (found%is_cut_short .or. 2*found%n_periods > merge(1, longer_beat, found%is_resolved)*max_periods) exit
         found%n_periods = 2*found%n_periods
      end do
      self = found
   end subroutine find_exponents

   !> Whether the largest exponent is not positive, or the means of all exponents that may be equal to it are positive too.
   pure logical function is_resolved(rate, duration)
      real(wp), intent(in) :: rate(:)                                 !! [1/s], the largest first
      real(wp), intent(in) :: duration                                !! of the average [s]
      integer :: k

      is_resolved = rate(1) <= 0.0_wp
      if (is_resolved) return
      do k = 2, size(rate)
         if ((rate(1) - rate(k))*duration > max_beat_growth) exit
         if (sum(rate(:k)) <= 0.0_wp) return
      end do
      is_resolved = .true.
   end function is_resolved

   !> Approximate work in nanoseconds, with averages over the requested number of periods.
   pure real(wp) function work_of_exponents(work_of_period, min_periods) result(work)
      real(wp), intent(in) :: work_of_period
      integer, intent(in) :: min_periods

      work = (min_periods + n_forgotten_of(min_periods))*work_of_period
   end function work_of_exponents

   !> Periods before the average in which disturbances align.
   pure integer function n_forgotten_of(n)
      integer, intent(in) :: n                                        !! of the average

      n_forgotten_of = n/5
   end function n_forgotten_of

   !> Orthonormalises columns from left to right, twice; returns the logarithms of their lengths.
   pure subroutine orthogonalise(x, growth)
      real(wp), intent(inout) :: x(:, :)
      real(wp), intent(out) :: growth(:)
      real(wp) :: length
      integer :: i, k, pass

      do i = 1, size(x, 2)
         do pass = 1, 2
            do k = 1, i - 1
               x(:, i) = x(:, i) - dot_product(x(:, k), x(:, i))*x(:, k)
            end do
         end do
         length = max(norm2(x(:, i)), tiny(1.0_wp))
         growth(i) = log(length)
         x(:, i) = x(:, i)/length
      end do
   end subroutine orthogonalise

   !> Averages over the record, sorted, and how far those over half of it lie from them, wherever that half is.
   pure subroutine average(growth, length, rate, spread)
      real(wp), intent(in) :: growth(:, :)                            !! (n, n_periods)
      real(wp), intent(in) :: length                                  !! of a period [s]
      real(wp), allocatable, intent(out) :: rate(:), spread(:)
      real(wp) :: part(size(growth, 1))
      integer :: first, half, i

      half = size(growth, 2)/2
      part = mean_rates(growth)
      allocate (rate, source=nearest_decreasing(part))
      allocate (spread, source=abs(part - rate))
      do i = 0, n_windows - 1
         first = (i*(size(growth, 2) - half))/(n_windows - 1)
         part = mean_rates(growth(:, first + 1:first + half))
         spread = max(spread, abs(part - rate))
      end do

   contains

      pure function mean_rates(growth) result(mean)
         real(wp), intent(in) :: growth(:, :)
         real(wp) :: mean(size(growth, 1)), weights(size(growth, 2))

         weights = bump_weights(size(growth, 2))
         mean = matmul(growth, weights)/length
      end function mean_rates
   end subroutine average

   !> The nearest sequence that does not increase, by least squares: growth of disturbances that were orthogonalised from the first
   !> to the last decreases in the limit, and no average is further from its limit afterwards. Adjacent values that increase
   !> are replaced by their mean. Source: R. E. Barlow et al., Statistical Inference under Order Restrictions (1972), section 1.2.
   pure function nearest_decreasing(values) result(nearest)
      real(wp), intent(in) :: values(:)
      real(wp) :: nearest(size(values))
      integer :: first, i

      nearest = values
      do i = 2, size(nearest)
         first = i
         do while (first > 1)
            if (nearest(first - 1) >= nearest(first)) exit
            first = findloc(nearest(:first - 1) == nearest(first - 1), .true., dim=1)   ! of the values that share a mean
            nearest(first:i) = sum(values(first:i))/(i - first + 1)
         end do
      end do
   end function nearest_decreasing
end module hb_exponents
