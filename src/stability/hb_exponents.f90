!> Lyapunov exponents along a motion of several tones: the rates at which disturbances grow, on average over the torus.
!>
!> Disturbances are followed lap by lap, a period of the slowest tone each, and made orthogonal after each (Benettin). The
!> logarithms of what they have grown by are averaged with a smooth window, which converges faster than any power of the length
!> where the linear equations can be reduced to constant ones; what both halves of the record say apart is the spread.
!> Sources: G. Benettin, L. Galgani, A. Giorgilli and J.-M. Strelcyn, Meccanica 15 (1980) 9-20; S. Das, Y. Saiki, E. Sander and
!> J. A. Yorke, Nonlinearity 30 (2017) 4111-4140.
module hb_exponents
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_birkhoff, only: bump_weights
   use hb_kinds, only: wp
   use hb_watch, only: work_is_over
   implicit none
   private
   public :: exponents_t, find_exponents, laps_t, orthogonalise, work_of_exponents

   integer, parameter :: n_laps = 100                                 ! on which averages are taken
   integer, parameter :: usual_most_laps = 800
   real(wp), parameter :: clear = 3.0_wp, clear_early = 10.0_wp       ! of the spread: from zero, after fewer laps than `n_laps`

   !> Somebody who carries disturbances along a motion.
   type, abstract :: laps_t
      integer :: size = 0                                             !! of a disturbance
      integer :: n_begun = 0                                          !! its first entries, places and velocities
      integer :: n_followed = 0                                       !! disturbances without those that are known to stay
      real(wp) :: length = 0.0_wp                                     !! of a lap [s]
      real(wp) :: work = 0.0_wp                                       !! of a lap, in about a nanosecond
      real(wp) :: surge = 0.0_wp                                      !! logarithm of the most by which the first disturbance has
                                                                      !! grown from any time to a later one, where laps see that
   contains
      procedure(settle_memory), deferred :: settle
      procedure(carry_disturbances), deferred :: carry
   end type laps_t

   abstract interface
      !> Goes some laps along the motion before the first one counts: what remembers finds its place.
      subroutine settle_memory(self, n_laps, is_done)
         import :: laps_t
         class(laps_t), intent(inout) :: self
         integer, intent(in) :: n_laps
         logical, intent(out) :: is_done                              !! else the motion was lost
      end subroutine settle_memory

      !> Carries disturbances through the next lap.
      subroutine carry_disturbances(self, x, is_done)
         import :: laps_t, wp
         class(laps_t), intent(inout) :: self
         real(wp), intent(inout), contiguous :: x(:, :)               !! (size, n_followed)
         logical, intent(out) :: is_done                              !! else the motion was lost
      end subroutine carry_disturbances
   end interface

   type :: exponents_t
      real(wp), allocatable :: rate(:)                                !! [1/s], the largest first; not allocated where lost
      real(wp), allocatable :: spread(:)                              !! likewise
      integer :: n_laps = 0
      logical :: is_cut_short = .false.                               !! more laps would have taken more work than allowed
   end type exponents_t

contains

   !> Follows disturbances until the largest exponent is further from zero than its spread is wide, or the work is done.
   subroutine find_exponents(self, laps, work_limit, fewest_laps, most_laps)
      type(exponents_t), intent(out) :: self
      class(laps_t), intent(inout) :: laps
      real(wp), intent(in) :: work_limit                              !! in about a nanosecond
      integer, intent(in), optional :: fewest_laps                    !! on which averages are taken, default `n_laps`
      integer, intent(in), optional :: most_laps                      !! doubled up to that many, while the spread decides
      type(exponents_t) :: found
      real(wp), allocatable :: growth(:, :), longer(:, :), x(:, :)
      integer :: forgotten, i, k, limit, n_all
      logical :: is_done

      call laps%settle(n_forgotten_of(n_laps), is_done)
      if (.not. is_done .or. laps%n_followed < 1) return
      allocate (x(laps%size, laps%n_followed), source=0.0_wp)
      do i = 1, laps%n_followed
         do k = 1, laps%n_begun                                       ! in no special directions
            x(k, i) = cos(real(3*i*k + k + i, wp)) + merge(2.0_wp, 0.0_wp, i == k)
         end do
      end do
      allocate (growth(laps%n_followed, 0))
      found%n_laps = n_laps
      if (present(fewest_laps)) found%n_laps = fewest_laps
      limit = usual_most_laps
      if (present(most_laps)) limit = most_laps
      do
         forgotten = n_forgotten_of(found%n_laps)
         n_all = found%n_laps + forgotten
         allocate (longer(laps%n_followed, n_all))
         longer(:, :size(growth, 2)) = growth
         k = size(growth, 2) + 1
         call move_alloc(longer, growth)
         do i = k, n_all
            call laps%carry(x, is_done)
            if (.not. is_done .or. work_is_over()) return
            call orthogonalise(x, growth(:, i))
            if (.not. all(ieee_is_finite(growth(:, i)))) return
         end do
         call average(growth(:, forgotten + 1:), laps%length, found%rate, found%spread)
         if (abs(found%rate(1)) > merge(clear_early, clear, found%n_laps < n_laps)*found%spread(1)) exit
         found%is_cut_short = 2.0_wp*n_all*laps%work > work_limit
         if (found%is_cut_short .or. 2*found%n_laps > limit) exit
         found%n_laps = 2*found%n_laps
      end do
      self = found
   end subroutine find_exponents

   !> About how many nanoseconds they take, with averages on as many laps as are asked for.
   pure real(wp) function work_of_exponents(work_of_lap, fewest_laps) result(work)
      real(wp), intent(in) :: work_of_lap
      integer, intent(in) :: fewest_laps

      work = (fewest_laps + n_forgotten_of(fewest_laps))*work_of_lap
   end function work_of_exponents

   !> Laps in which disturbances find their directions, before so many on which averages are taken.
   pure integer function n_forgotten_of(n_laps)
      integer, intent(in) :: n_laps
      integer, parameter :: most = 20

      n_forgotten_of = min(most, n_laps/5)
   end function n_forgotten_of

   !> Columns made orthogonal and of length 1 from left to right, twice over; logarithms of what they were longer.
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

   !> Averages over the record and over its halves.
   pure subroutine average(growth, length, rate, spread)
      real(wp), intent(in) :: growth(:, :)                            !! (n, n_laps)
      real(wp), intent(in) :: length                                  !! of a lap [s]
      real(wp), allocatable, intent(out) :: rate(:), spread(:)
      integer :: half

      half = size(growth, 2)/2
      rate = matmul(growth, bump_weights(size(growth, 2)))/length
      spread = matmul(growth(:, :half), bump_weights(half))/length
      spread = abs(spread - matmul(growth(:, half + 1:), bump_weights(size(growth, 2) - half))/length)
   end subroutine average
end module hb_exponents
