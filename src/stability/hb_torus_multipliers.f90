!> Multipliers of a motion of two tones, if its linearised equations can be reduced to constant ones.
!>
!> The map M(theta) over a period of one tone depends on the phase theta of the other one, which turns by rho in it. A
!> disturbance that grows by m in each period is v(theta) with M(theta) v(theta) = m v(theta + rho): an eigenvalue problem of
!> functions on the circle, here of their values at samples. exp(i k theta) v then has the multiplier m exp(-i k rho), so that
!> each disturbance occurs once for each k, and its shortest series represents it. One that equals its own conjugate but for
!> exp(i k theta) has a multiplier that is real (k even) or belongs to functions of twice the period (k odd, stored as
!> negative). Samples are added until the multipliers no longer change. The error of the last ones is how far they did, times the
!> ratio by which the ends of the series have fallen meanwhile: that of an eigenvalue falls at least as fast, as the product of the
!> ends of both its eigenfunctions.
!> Source: A. Jorba, Numerical computation of the normal behaviour of invariant curves of n-dimensional maps, Nonlinearity 14
!> (2001) 943-976.
module hb_torus_multipliers
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_bifurcation, only: movement
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: dgeev
   use hb_map_eigenvalues, only: sort_by_size
   use hb_monodromy, only: find_transfer, monodromy_t, work_of_transfer
   use hb_variation, only: variation_t
   implicit none
   private
   public :: find_torus_multipliers, has_torus_multipliers, tone_of_maps

   integer, parameter :: first_samples = 9, max_size = 400            ! of the circle; of the matrix of all samples
   real(wp), parameter :: least_multiplier = 1.0e-3_wp                ! those of disturbances that vanish within a few periods: none
   real(wp), parameter :: max_tail = 1.0e-3_wp                        ! of the series of a disturbance, relative
   real(wp), parameter :: max_error = 1.0e-4_wp                       ! of multipliers that are known
   real(wp), parameter :: same_multiplier = 1.0e-5_wp                 ! difference, relative, of disturbances that are one
   real(wp), parameter :: share_of_maps = 1.0e-2_wp                   ! of the tolerance of multipliers
   real(wp), parameter :: same_direction = 0.9_wp                     ! cosine between disturbances that are one
   real(wp), parameter :: work_of_eigenvectors = 25.0_wp              ! by the third power of the size [ns]

   !> The series of disturbances, each one of a family.
   type :: families_t
      complex(wp), allocatable :: series(:, :, :)                     ! (size, n, any), of norm 1: -n/2 to n/2
      complex(wp), allocatable :: multipliers(:)
   end type families_t

contains

   !> Whether the maps over periods of one tone are functions of one phase alone that can be found one by one.
   pure logical function has_torus_multipliers(variation) result(has)
      type(variation_t), intent(in) :: variation
      integer :: i

      has = size(variation%motion%omega) == 2 .and. variation%n_states == 0 .and. .not. allocated(variation%massless)
      has = has .and. first_samples*variation%size <= max_size .and. .not. allocated(variation%noise)
      if (has) has = all([(variation%laws(i)%law%n_phases == 0, i=1, size(variation%laws))])
   end function has_torus_multipliers

   !> The tone over whose periods disturbances are mapped: of two the one of the higher harmonics, so that the maps depend smoothly
   !> on the phase of the other.
   pure integer function tone_of_maps(tuples) result(tone)
      integer, intent(in) :: tuples(:, :)                             !! of the motion, (n_tones, n_harmonics)

      tone = maxloc(maxval(abs(tuples), dim=2), dim=1)
   end function tone_of_maps

   !> Finds the multipliers without those of given neutral disturbances; none if their error is not small on as many samples as
   !> are permitted, or the work would exceed its limit.
   subroutine find_torus_multipliers(variation, neutral, tolerance, max_work, multipliers, error)
      type(variation_t), intent(inout) :: variation
      complex(wp), intent(in) :: neutral(:, :, :)                     !! series in both phases, (size, n_harmonics, any)
      real(wp), intent(in) :: tolerance
      real(wp), intent(in) :: max_work                                !! in about a nanosecond
      complex(wp), allocatable, intent(out) :: multipliers(:)         !! over a period of the tone of the maps, the largest first
      real(wp), intent(out) :: error                                  !! of them
      complex(wp), allocatable :: before(:)
      real(wp), allocatable :: maps(:, :, :)
      real(wp) :: error_of_maps, length, rho, tail, tail_before, work
      integer :: n, other
      logical :: is_known

      error = huge(1.0_wp)
      tail_before = 1.0_wp
      other = 3 - tone_of_maps(variation%motion%tuples)
      associate (omega => variation%motion%omega)
         rho = two_pi*omega(other)/omega(3 - other)
         length = two_pi/omega(3 - other)
      end associate
      n = first_samples
      do while (n*variation%size <= max_size)
         work = n*work_of_transfer(variation, length) + &
                work_of_eigenvectors*(real(n, wp)*variation%size)**3
         if (work > max_work) exit
         call find_maps(variation, other, n, share_of_maps*tolerance, maps, error_of_maps)
         if (.not. allocated(maps)) exit
         if (variation%size == 2 .and. size(neutral, 3) == 1) then
            call find_last_one(maps, multipliers, tail, is_known)
         else
            call find_families(maps, rho, neutral_on_circle(neutral, variation%motion%tuples(other, :), n), multipliers, tail, &
                               is_known)
         end if
         if (is_known .and. allocated(before)) then
            if (size(before) == size(multipliers)) &
               error = movement(before, multipliers)*min(1.0_wp, tail/max(tail_before, tiny(1.0_wp))) + error_of_maps
            if (error <= tolerance) exit
         end if
         if (allocated(before)) deallocate (before)
         if (is_known) allocate (before, source=multipliers)
         tail_before = tail
         n = 2*((4*n)/5) + 1
      end do
      variation%motion%start(other) = 0.0_wp
      if (error > max_error .and. allocated(multipliers)) deallocate (multipliers)
   end subroutine find_torus_multipliers

   !> The maps over a period of one tone at equal distances of the phase of the other one; none if they are not found.
   subroutine find_maps(variation, other, n, tolerance, maps, error)
      type(variation_t), intent(inout) :: variation
      integer, intent(in) :: other                                    !! tone
      integer, intent(in) :: n
      real(wp), intent(in) :: tolerance
      real(wp), allocatable, intent(out) :: maps(:, :, :)             !! (size, size, n)
      real(wp), intent(out) :: error                                  !! estimated, relative to the largest entry of a map or 1
      type(monodromy_t) :: map
      real(wp), allocatable :: found(:, :, :)
      integer :: k

      allocate (found(variation%size, variation%size, n))
      error = 0.0_wp
      do k = 1, n
         variation%motion%start(other) = two_pi*(k - 1)/n
         call find_transfer(map, variation, 0.0_wp, two_pi/variation%motion%omega(3 - other), tolerance, huge(1.0_wp))
         if (work_is_over() .or. .not. allocated(map%matrix)) return
         if (.not. all(ieee_is_finite(map%matrix))) return
         error = max(error, map%estimate)
         found(:, :, k) = map%matrix
      end do
      call move_alloc(found, maps)
   end subroutine find_maps

   !> Series over the phase of the other tone at the phase 0 of that of the maps, (size, n, any).
   pure function neutral_on_circle(neutral, orders, n) result(series)
      complex(wp), intent(in) :: neutral(:, :, :)
      integer, intent(in) :: orders(:)                                !! of the other phase, (n_harmonics)
      integer, intent(in) :: n
      complex(wp) :: series(size(neutral, 1), n, size(neutral, 3))
      integer :: h, i, k

      series = (0.0_wp, 0.0_wp)
      do h = 1, size(orders)
         if (abs(orders(h)) > n/2) cycle
         do i = 1, size(neutral, 3)
            k = n/2 + 1 + orders(h)                                   ! a real function: half of each with its conjugate
            series(:, k, i) = series(:, k, i) + 0.5_wp*neutral(:, h, i)
            k = n/2 + 1 - orders(h)
            series(:, k, i) = series(:, k, i) + 0.5_wp*conjg(neutral(:, h, i))
         end do
      end do
   end function neutral_on_circle

   !> Finds the multiplier beside that of a neutral disturbance, of maps of two rows: the product of both is the mean growth of an
   !> area (Liouville).
   pure subroutine find_last_one(maps, multipliers, tail, is_known)
      real(wp), intent(in) :: maps(:, :, :)                           !! (2, 2, n)
      complex(wp), allocatable, intent(out) :: multipliers(:)
      real(wp), intent(out) :: tail                                   !! of the series of the growth
      logical, intent(out) :: is_known
      real(wp) :: growth(size(maps, 3))
      complex(wp) :: last
      integer :: k, n

      n = size(growth)
      growth = maps(1, 1, :)*maps(2, 2, :) - maps(1, 2, :)*maps(2, 1, :)
      tail = 0.0_wp
      is_known = all(growth > 0.0_wp)
      if (.not. is_known) return
      growth = log(growth)
      last = sum([(growth(k)*exp(cmplx(0.0_wp, -two_pi*(k - 1)*(n/2)/n, wp)), k=1, n)])/n
      tail = abs(last)
      multipliers = [cmplx(exp(sum(growth)/n), 0.0_wp, wp)]
   end subroutine find_last_one

   !> Finds one multiplier of each family, except of the neutral ones; they are not known if a disturbance has no short series.
   subroutine find_families(maps, rho, neutral, multipliers, largest_tail, is_known)
      real(wp), intent(in) :: maps(:, :, :)                           !! (size, size, n)
      real(wp), intent(in) :: rho                                     !! [rad]
      complex(wp), intent(in) :: neutral(:, :, :)                     !! (size, n, any)
      complex(wp), allocatable, intent(out) :: multipliers(:)
      real(wp), intent(out) :: largest_tail                           !! of the series of disturbances, relative
      logical, intent(out) :: is_known
      type(families_t) :: found
      complex(wp), allocatable :: series(:, :, :), values(:)
      real(wp), allocatable :: width(:), tail(:)
      integer, allocatable :: order(:)
      integer :: i, k, n, n_families

      n = size(maps, 3)
      largest_tail = 0.0_wp
      call eigenfunctions(maps, rho, values, series)
      is_known = allocated(values)
      if (.not. is_known) return
      allocate (width(size(values)), tail(size(values)))
      do i = 1, size(values)
         width(i) = sum([(real((k - n/2 - 1)**2, wp)*sum(abs(series(:, k, i))**2), k=1, n)])
         tail(i) = sum(abs(series(:, 1, i))**2) + sum(abs(series(:, n, i))**2)
      end do
      allocate (found%series(size(neutral, 1), n, size(neutral, 3)))
      do i = 1, size(neutral, 3)
         found%series(:, :, i) = neutral(:, :, i)/norm2(abs(neutral(:, :, i)))
      end do
      allocate (found%multipliers(size(neutral, 3)), source=(1.0_wp, 0.0_wp))
      n_families = nint(real(count(abs(values) > least_multiplier), wp)/n)
      allocate (order, source=by_width(width))
      do i = 1, size(order)
         k = order(i)
         if (abs(values(k)) <= least_multiplier .or. tail(k) > max_tail**2) cycle
         if (any(match_of(found, series(:, :, k), values(k), rho) > 0)) cycle
         found%series = reshape([found%series, series(:, :, k)], [size(maps, 1), n, size(found%series, 3) + 1])
         found%multipliers = [found%multipliers, values(k)]
         largest_tail = max(largest_tail, sqrt(tail(k)))
         if (size(found%multipliers) == n_families) exit
      end do
      is_known = size(found%multipliers) == n_families
      if (is_known) call represent(found, rho, size(neutral, 3), multipliers, is_known)
   end subroutine find_families

   !> Numbers of values, the smallest first.
   pure function by_width(width) result(order)
      real(wp), intent(in) :: width(:)
      integer :: order(size(width))
      logical :: is_left(size(width))
      integer :: i

      is_left = .true.
      do i = 1, size(width)
         order(i) = minloc(width, dim=1, mask=is_left)
         is_left(order(i)) = .false.
      end do
   end function by_width

   !> Makes multipliers of disturbances that equal their own conjugates real, and others pairs.
   subroutine represent(found, rho, n_neutral, multipliers, is_known)
      type(families_t), intent(in) :: found
      real(wp), intent(in) :: rho                                     !! [rad]
      integer, intent(in) :: n_neutral
      complex(wp), allocatable, intent(out) :: multipliers(:)
      logical, intent(out) :: is_known
      integer :: i, n, shift(size(found%multipliers)), partner
      complex(wp) :: m
      logical :: is_done(size(found%multipliers))

      allocate (multipliers(0))
      n = size(found%series, 2)
      is_done = .false.
      is_done(:n_neutral) = .true.
      is_known = .true.
      do i = n_neutral + 1, size(is_done)
         if (is_done(i)) cycle
         is_done(i) = .true.
         m = found%multipliers(i)
         shift = match_of(found, conjg(found%series(:, n:1:-1, i)), conjg(m), rho)
         partner = findloc(shift > 0 .and. .not. is_done, .true., dim=1)
         if (shift(i) > 0) then
            ! conj(v) = exp(i k theta) v, so that exp(i k theta/2) v is real
            associate (k => shift(i) - n)
               m = m*exp(cmplx(0.0_wp, -0.5_wp*k*rho, wp))
               if (modulo(k, 2) == 1) m = -abs(m)
            end associate
            multipliers = [multipliers, cmplx(sign(abs(m), real(m)), 0.0_wp, wp)]
         else if (partner > 0) then
            is_done(partner) = .true.
            multipliers = [multipliers, m, conjg(m)]
         else
            is_known = .false.
         end if
      end do
      call sort_by_size(multipliers)
   end subroutine represent

   !> The k for which each of some disturbances, times exp(i k theta), is another one, plus the number n of its terms; 0: none.
   pure function match_of(families, other, multiplier, rho) result(shift)
      type(families_t), intent(in) :: families
      complex(wp), intent(in) :: other(:, :)                          !! (size, n), of norm 1
      complex(wp), intent(in) :: multiplier                           !! of the other one
      real(wp), intent(in) :: rho                                     !! [rad]
      integer :: shift(size(families%multipliers))
      real(wp) :: cosine, largest
      integer :: i, k, n

      n = size(other, 2)
      shift = 0
      do i = 1, size(shift)
         largest = same_direction
         do k = 1 - n, n - 1
            if (abs(families%multipliers(i)*exp(cmplx(0.0_wp, -k*rho, wp)) - multiplier) > &
                same_multiplier*abs(multiplier)) cycle
            associate (first => max(1, 1 - k), last => min(n, n - k))
               cosine = abs(sum(conjg(families%series(:, first:last, i))*other(:, first + k:last + k)))
            end associate
            if (cosine <= largest) cycle
            largest = cosine
            shift(i) = n + k
         end do
      end do
   end function match_of

   !> Eigenvalues of functions on the circle and the series of their eigenfunctions, of norm 1; none if LAPACK fails.
   subroutine eigenfunctions(maps, rho, values, series)
      real(wp), intent(in) :: maps(:, :, :)                           !! (size, size, n)
      real(wp), intent(in) :: rho                                     !! [rad]
      complex(wp), allocatable, intent(out) :: values(:)
      complex(wp), allocatable, intent(out) :: series(:, :, :)        !! (size, -n/2:n/2, any)
      complex(wp), allocatable :: vector(:, :)
      real(wp), allocatable :: a(:, :), imaginary(:), right(:, :), real_part(:), work(:)
      complex(wp) :: transform(size(maps, 3), size(maps, 3))
      real(wp) :: left(1, 1)
      integer :: i, info, j, k, m, n, total

      m = size(maps, 1)
      n = size(maps, 3)
      total = m*n
      allocate (a(total, total), right(total, total), real_part(total), imaginary(total), work(8*total))
      do k = 1, n
         do j = 1, n
            a((j - 1)*m + 1:j*m, (k - 1)*m + 1:k*m) = kernel(two_pi*(j - k)/n - rho, n)*maps(:, :, k)
         end do
      end do
      call dgeev("N", "V", total, a, total, real_part, imaginary, left, 1, right, total, work, size(work), info)
      if (info /= 0) return
      do k = 1, n
         do j = 1, n
            transform(j, k) = exp(cmplx(0.0_wp, -two_pi*(j - 1)*(k - 1 - n/2)/n, wp))/n
         end do
      end do
      allocate (values, source=cmplx(real_part, imaginary, wp))
      allocate (series(m, n, total), vector(m, n))
      i = 1
      do while (i <= total)
         if (abs(imaginary(i)) > 0.0_wp) then
            vector = reshape(cmplx(right(:, i), right(:, i + 1), wp), [m, n])
            series(:, :, i) = matmul(vector, transform)
            series(:, :, i + 1) = matmul(conjg(vector), transform)
            i = i + 2
         else
            vector = reshape(cmplx(right(:, i), 0.0_wp, wp), [m, n])
            series(:, :, i) = matmul(vector, transform)
            i = i + 1
         end if
      end do
      do i = 1, total
         series(:, :, i) = series(:, :, i)/norm2(abs(series(:, :, i)))
      end do
   end subroutine eigenfunctions

   !> Value at a distance of the trigonometric polynomial that is 1 at one of an odd number of samples and 0 at the others.
   elemental real(wp) function kernel(distance, n)
      real(wp), intent(in) :: distance                                !! [rad]
      integer, intent(in) :: n

      kernel = 1.0_wp + 2.0_wp*sum_of_cosines()
      kernel = kernel/n

   contains

      pure real(wp) function sum_of_cosines() result(total)
         integer :: k

         total = 0.0_wp
         do k = 1, n/2
            total = total + cos(k*distance)
         end do
      end function sum_of_cosines
   end function kernel
end module hb_torus_multipliers
