!> Lyapunov exponents along a motion of several tones: the rates at which disturbances grow, on average over the torus.
!>
!> Disturbances are followed lap by lap, a period of the slowest tone each, and made orthogonal after each (Benettin). The
!> logarithms of what they have grown by are averaged with a smooth window, which converges faster than any power of the length
!> where the linear equations can be reduced to constant ones; what both halves of the record say apart is the spread. A phase of
!> the motion's own can be shifted: such disturbances, known at each time, are taken out.
!> Sources: G. Benettin, L. Galgani, A. Giorgilli and J.-M. Strelcyn, Meccanica 15 (1980) 9-20; S. Das, Y. Saiki, E. Sander and
!> J. A. Yorke, Nonlinearity 30 (2017) 4111-4140.
module hb_exponents
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_birkhoff, only: bump_weights
   use hb_kinds, only: two_pi, wp
   use hb_koopman_hill, only: hill_t
   use hb_monodromy, only: find_transfer, monodromy_t, n_looks_of, work_of_transfer
   use hb_variation, only: piece_t, variation_t
   use hb_variation_pieces, only: cut_time
   implicit none
   private
   public :: exponents_t, find_exponents, work_of_exponents

   integer, parameter :: n_laps = 100                                 ! on which averages are taken
   integer, parameter :: most_laps = 800                              ! doubled up to that many, while the spread decides
   real(wp), parameter :: clear = 3.0_wp, clear_early = 10.0_wp       ! of the spread: from zero, after fewer laps than `n_laps`

   real(wp), parameter :: most_of_usual = 100.0_wp                    ! work of a lap

   type :: exponents_t
      real(wp), allocatable :: rate(:)                                !! [1/s], the largest first; not allocated where lost
      real(wp), allocatable :: spread(:)                              !! likewise
      integer :: n_laps = 0
   end type exponents_t

contains

   !> Follows disturbances until the largest exponent is further from zero than its spread is wide, or the work is done.
   subroutine find_exponents(self, variation, shifts, tolerance, work_limit, hill, fewest_laps)
      type(exponents_t), intent(out) :: self
      type(variation_t), intent(inout) :: variation
      complex(wp), intent(in) :: shifts(:, :, :)                      !! disturbances by shifts of phases as series in the tones,
                                                                      !! cos - i sin, (size, n_harmonics, n_shifts)
      real(wp), intent(in) :: tolerance                               !! of a lap, relative
      real(wp), intent(in) :: work_limit                              !! in about a nanosecond
      type(hill_t), intent(inout), optional :: hill                   !! follows them by Hill's problem
      integer, intent(in), optional :: fewest_laps                    !! on which averages are taken, default `n_laps`
      type(monodromy_t) :: lap
      type(piece_t), allocatable :: pieces(:)
      real(wp), allocatable :: growth(:, :), longer(:, :), x(:, :)
      real(wp) :: length, time, usual, work
      integer :: forgotten, i, k, n, n_all

      length = two_pi/minval(variation%motion%omega)
      usual = work_of_transfer(variation, length)
      n = 2*variation%n_dofs - size(shifts, 3)
      if (n < 1) return
      allocate (x(variation%size, n), source=0.0_wp)
      do i = 1, n
         do k = 1, 2*variation%n_dofs                                 ! in no special directions
            x(k, i) = cos(real(3*i*k + k + i, wp)) + merge(2.0_wp, 0.0_wp, i == k)
         end do
      end do
      if (variation%n_states > 0) then                                ! sliders find their places
         do i = -n_forgotten_of(n_laps), -1
            call cut_time(variation, i*length, (i + 1)*length, n_looks_of(variation, length), pieces)
         end do
      end if
      allocate (growth(n, 0))
      work = 0.0_wp
      time = 0.0_wp
      self%n_laps = n_laps
      if (present(fewest_laps)) self%n_laps = fewest_laps
      do
         forgotten = n_forgotten_of(self%n_laps)
         n_all = self%n_laps + forgotten
         allocate (longer(n, n_all))
         longer(:, :size(growth, 2)) = growth
         k = size(growth, 2) + 1
         call move_alloc(longer, growth)
         do i = k, n_all
            if (present(hill)) then
               call hill%transfer(time, length, tolerance, lap%matrix, lap%estimate)
            else
               call find_transfer(lap, variation, time, time + length, tolerance, most_of_usual*usual)
            end if
            work = work + usual
            x = matmul(lap%matrix, x)
            time = time + length
            call remove_shifts(variation, shifts, time, x)
            call orthogonalise(x, growth(:, i))
            if (.not. all(ieee_is_finite(growth(:, i)))) return
         end do
         call average(growth(:, forgotten + 1:), length, self%rate, self%spread)
         if (abs(self%rate(1)) > merge(clear_early, clear, self%n_laps < n_laps)*self%spread(1)) exit
         if (2.0_wp*work > work_limit .or. 2*self%n_laps > most_laps) exit
         self%n_laps = 2*self%n_laps
      end do
   end subroutine find_exponents

   !> About how many nanoseconds they take, with averages on as many laps as are asked for.
   pure real(wp) function work_of_exponents(variation, fewest_laps) result(work)
      type(variation_t), intent(in) :: variation
      integer, intent(in) :: fewest_laps

      work = (fewest_laps + n_forgotten_of(fewest_laps))*work_of_transfer(variation, two_pi/minval(variation%motion%omega))
   end function work_of_exponents

   !> Laps in which disturbances find their directions, before so many on which averages are taken.
   pure integer function n_forgotten_of(n_laps)
      integer, intent(in) :: n_laps
      integer, parameter :: most = 20

      n_forgotten_of = min(most, n_laps/5)
   end function n_forgotten_of

   !> Takes out of disturbances what shifts phases of the motion.
   subroutine remove_shifts(variation, shifts, time, x)
      type(variation_t), intent(in) :: variation
      complex(wp), intent(in) :: shifts(:, :, :)
      real(wp), intent(in) :: time
      real(wp), intent(inout) :: x(:, :)
      real(wp) :: basis(size(x, 1), size(shifts, 3)), lost(size(shifts, 3)), waves(2, size(shifts, 2))
      integer :: k

      if (size(shifts, 3) == 0) return
      waves(1, :) = cos(variation%motion%frequencies*time)
      waves(2, :) = sin(variation%motion%frequencies*time)
      do k = 1, size(shifts, 3)
         basis(:, k) = matmul(real(shifts(:, :, k)), waves(1, :)) - matmul(aimag(shifts(:, :, k)), waves(2, :))
      end do
      call orthogonalise(basis, lost)
      x = x - matmul(basis, matmul(transpose(basis), x))
   end subroutine remove_shifts

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
