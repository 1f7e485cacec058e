!> The exponential of a real matrix.
!>
!> For two rows a closed form. Otherwise scaling by a power of two to a norm of at most 1/2, the diagonal Pade
!> approximant of degree 6 (backward error below 1e-16 there), then squaring. Source: N. J. Higham, Functions of
!> Matrices, SIAM 2008, section 10.3. For few rows without BLAS, whose calls take longer than the products.
module hb_matrix_exponential
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: wp
   use hb_lapack, only: dgemm, dgetrf, dgetrs
   implicit none
   private
   public :: count_exponential, exponential_of, exponential_of_two, exponential_with_noise, multiply_by, turn_covariance, &
      work_of_product

   integer, parameter :: pade_degree = 6
   integer, parameter :: terms_of_noise = 12                          ! of its series, at a norm of at most 1/4
   integer, parameter :: max_few = 10                                 ! rows; with more, BLAS is faster
   real(wp), parameter :: max_unchecked_cost = 1.0e6_wp               ! [ns] of a product: a check takes up to half a microsecond

contains

   !> exp(a); not finite if beyond the range of numbers.
   subroutine exponential_of(a, e)
      real(wp), intent(in) :: a(:, :)                                 !! (n, n)
      real(wp), intent(out) :: e(:, :)                                !! (n, n)
      real(wp), dimension(size(a, 1), size(a, 1)) :: denominator, power, scaled
      real(wp) :: factor
      integer :: i, info, k, n, n_squarings, pivots(size(a, 1))
      logical :: is_long

      n = size(a, 1)
      if (n == 2) then
         call exponential_of_two(a(1, 1), a(1, 2), a(2, 1), a(2, 2), e)
         return
      end if
      is_long = work_of_product(n) > max_unchecked_cost
      n_squarings = squarings_for(norm_of(a))
      if (n <= max_few) then
         call exponential_of_few(n, a, n_squarings, e)
         return
      end if
      scaled = a*0.5_wp**n_squarings
      e = 0.0_wp
      do i = 1, n
         e(i, i) = 1.0_wp
      end do
      denominator = e
      power = e
      factor = 1.0_wp
      do k = 1, pade_degree
         factor = factor*real(pade_degree - k + 1, wp)/real(k*(2*pade_degree - k + 1), wp)
         if (is_long) then                                            ! up to a second
            if (work_is_over()) return
         end if
         power = product_of(scaled, power)
         e = e + factor*power
         denominator = denominator + merge(-factor, factor, modulo(k, 2) == 1)*power
      end do
      call dgetrf(n, n, denominator, n, pivots, info)
      call dgetrs("N", n, n, denominator, n, pivots, e, n, info)
      do i = 1, n_squarings
         if (is_long) then
            if (work_is_over()) return
         end if
         e = product_of(e, e)
      end do
   end subroutine exponential_of

   !> e = exp(a), and the covariance q at time 1 of x' = a x + white noise of density b that begins at 0, the integral of exp(a s) b
   !> exp(a^T s) over s from 0 to 1: by its series at a small norm, then q(2 t) = q(t) + exp(a t) q(t) exp(a^T t), which adds
   !> nothing but positive matrices, for any stiffness.
   subroutine exponential_with_noise(a, b, e, q)
      real(wp), intent(in) :: a(:, :), b(:, :)                        !! (n, n), b symmetric
      real(wp), intent(out), contiguous :: e(:, :), q(:, :)           !! (n, n)
      real(wp), dimension(size(a, 1), size(a, 1)) :: scaled, term
      integer :: i, k, n_squarings

      n_squarings = squarings_for(2.0_wp*norm_of(a))
      scaled = a*0.5_wp**n_squarings
      term = b*0.5_wp**n_squarings
      q = term
      do k = 2, terms_of_noise
         call multiply_by(scaled, term)
         term = (term + transpose(term))/k
         q = q + term
      end do
      call exponential_of(scaled, e)
      do i = 1, n_squarings
         if (work_is_over()) return
         term = q
         call turn_covariance(e, term)
         q = q + term
         term = e
         call multiply_by(term, e)
      end do
   end subroutine exponential_with_noise

   !> q = a q a^T of a symmetric q.
   subroutine turn_covariance(a, q)
      real(wp), intent(in), contiguous :: a(:, :)                     !! (n, n)
      real(wp), intent(inout), contiguous :: q(:, :)                  !! (n, n)

      call multiply_by(a, q)
      q = transpose(q)
      call multiply_by(a, q)
   end subroutine turn_covariance

   !> The same for few rows: even and odd powers apart, which takes four products instead of six.
   pure subroutine exponential_of_few(n, a, n_squarings, e)
      integer, intent(in) :: n                                        !! up to max_few
      real(wp), intent(in) :: a(n, n)
      integer, intent(in) :: n_squarings
      real(wp), intent(out) :: e(n, n)
      real(wp), dimension(max_few**2) :: fourth, odd, scaled, second  ! of fixed size: allocating them would take as long
      integer :: i, k

      call approximate(n, a, 0.5_wp**n_squarings, scaled, second, fourth, odd, e)
      do i = 1, n_squarings
         call multiply_few(n, n, e, e, second)
         do k = 1, n
            e(:, k) = second((k - 1)*n + 1:k*n)
         end do
      end do
   end subroutine exponential_of_few

   !> The Pade approximant of exp(factor a). Its denominator, at a norm of at most 1/2, needs no row exchanges: off its
   !> diagonal, columns sum to at most 0.3. Source of the coefficients: Higham, eq. (10.25).
   pure subroutine approximate(n, a, factor, scaled, second, fourth, odd, e)
      integer, intent(in) :: n
      real(wp), intent(in) :: a(n, n), factor
      real(wp), intent(out), dimension(n, n) :: scaled, second, fourth, odd   ! work
      real(wp), intent(out) :: e(n, n)
      real(wp), parameter :: c(pade_degree) = [0.5_wp, 5.0_wp/44.0_wp, 1.0_wp/66.0_wp, 1.0_wp/792.0_wp, 1.0_wp/15840.0_wp, &
                                          1.0_wp/665280.0_wp]
      real(wp) :: share
      integer :: i, k

      scaled = factor*a
      call multiply_few(n, n, scaled, scaled, second)
      call multiply_few(n, n, second, second, fourth)
      call multiply_few(n, n, second, fourth, e)
      e = c(2)*second + c(4)*fourth + c(6)*e
      second = c(3)*second + c(5)*fourth
      do i = 1, n
         e(i, i) = e(i, i) + 1.0_wp
         second(i, i) = second(i, i) + c(1)
      end do
      call multiply_few(n, n, scaled, second, odd)
      associate (denominator => second)
         denominator = e - odd
         e = e + odd
         do k = 1, n
            do i = k + 1, n
               share = denominator(i, k)/denominator(k, k)
               denominator(i, k + 1:) = denominator(i, k + 1:) - share*denominator(k, k + 1:)
               e(i, :) = e(i, :) - share*e(k, :)
            end do
         end do
         do k = n, 1, -1
            e(k, :) = e(k, :)/denominator(k, k)
            do i = 1, k - 1
               e(i, :) = e(i, :) - denominator(i, k)*e(k, :)
            end do
         end do
      end associate
   end subroutine approximate

   !> c = a b of few rows. The numbers of one to four degrees of freedom, with a slider or without, are known to the compiler,
   !> which is twice as fast.
   pure subroutine multiply_few(n, m, a, b, c)
      integer, intent(in) :: n, m
      real(wp), intent(in) :: a(n, n), b(n, m)
      real(wp), intent(out) :: c(n, m)
      integer :: j, k

      select case (n)
      case (3)
         do j = 1, m
            c(:3, j) = a(:3, 1)*b(1, j) + a(:3, 2)*b(2, j) + a(:3, 3)*b(3, j)
         end do
      case (4)
         do j = 1, m
            c(:4, j) = a(:4, 1)*b(1, j) + a(:4, 2)*b(2, j) + a(:4, 3)*b(3, j) + a(:4, 4)*b(4, j)
         end do
      case (5)
         do j = 1, m
            c(:5, j) = a(:5, 1)*b(1, j) + a(:5, 2)*b(2, j) + a(:5, 3)*b(3, j) + a(:5, 4)*b(4, j) + a(:5, 5)*b(5, j)
         end do
      case (6)
         do j = 1, m
            c(:6, j) = a(:6, 1)*b(1, j) + a(:6, 2)*b(2, j) + a(:6, 3)*b(3, j) + a(:6, 4)*b(4, j) + a(:6, 5)*b(5, j) + &
                       a(:6, 6)*b(6, j)
         end do
      case (7)
         do j = 1, m
            c(:7, j) = a(:7, 1)*b(1, j) + a(:7, 2)*b(2, j) + a(:7, 3)*b(3, j) + a(:7, 4)*b(4, j) + a(:7, 5)*b(5, j) + &
                       a(:7, 6)*b(6, j) + a(:7, 7)*b(7, j)
         end do
      case (8)
         do j = 1, m
            c(:8, j) = a(:8, 1)*b(1, j) + a(:8, 2)*b(2, j) + a(:8, 3)*b(3, j) + a(:8, 4)*b(4, j) + a(:8, 5)*b(5, j) + &
                       a(:8, 6)*b(6, j) + a(:8, 7)*b(7, j) + a(:8, 8)*b(8, j)
         end do
      case default
         do j = 1, m
            c(:, j) = a(:, 1)*b(1, j)
            do k = 2, n
               c(:, j) = c(:, j) + a(:, k)*b(k, j)
            end do
         end do
      end select
   end subroutine multiply_few

   !> exp(a) = exp(m) (cosh s I + sinh s/s (a - m I)), m half the trace, s**2 = -det(a - m I).
   pure subroutine exponential_of_two(a11, a12, a21, a22, e)
      real(wp), intent(in) :: a11, a12, a21, a22
      real(wp), intent(out) :: e(2, 2)
      real(wp) :: c, d, m, s, square
      real(wp), parameter :: max_series_argument = 0.1_wp             ! the series to the sixth power are exact to rounding
      real(wp), parameter :: of_c(6) = 1.0_wp/[2.0_wp, 24.0_wp, 720.0_wp, 40320.0_wp, 3628800.0_wp, 479001600.0_wp]
      real(wp), parameter :: of_s(6) = of_c/[3, 5, 7, 9, 11, 13]

      m = 0.5_wp*(a11 + a22)
      d = 0.5_wp*(a11 - a22)
      square = d**2 + a12*a21
      if (abs(square) < max_series_argument) then
         c = 1.0_wp + square*(of_c(1) + square*(of_c(2) + square*(of_c(3) + square*(of_c(4) + square*(of_c(5) + square*of_c(6))))))
         s = 1.0_wp + square*(of_s(1) + square*(of_s(2) + square*(of_s(3) + square*(of_s(4) + square*(of_s(5) + square*of_s(6))))))
      else if (square > 0.0_wp) then
         s = sqrt(square)
         c = cosh(s)
         s = sinh(s)/s
      else
         s = sqrt(-square)
         c = cos(s)
         s = sin(s)/s
      end if
      m = exp(m)
      c = m*c
      s = m*s
      e(1, 1) = c + s*d
      e(2, 2) = c - s*d
      e(1, 2) = s*a12
      e(2, 1) = s*a21
   end subroutine exponential_of_two

   !> Approximate work of `exponential_of` in nanoseconds for a matrix of n rows and this norm, from counts alone.
   pure real(wp) function count_exponential(n, norm) result(work)
      integer, intent(in) :: n
      real(wp), intent(in) :: norm

      work = 30.0_wp
      if (n > 2) work = work_of_product(n)*(pade_degree + 1.4_wp + squarings_for(norm))
   end function count_exponential

   !> Approximate time of a product of two matrices of n rows in nanoseconds.
   pure real(wp) function work_of_product(n) result(work)
      integer, intent(in) :: n

      work = 150.0_wp + 0.08_wp*real(n, wp)**3                         ! 0.7 to 1.6 times the time of an exponential up to 40 rows
      if (n <= max_few) work = 10.0_wp + 0.2_wp*real(n, wp)**3
   end function work_of_product

   pure integer function squarings_for(norm)
      real(wp), intent(in) :: norm

      squarings_for = 0
      if (norm > 0.5_wp) squarings_for = min(1000, exponent(2.0_wp*norm))
   end function squarings_for

   !> Largest sum of a column.
   pure real(wp) function norm_of(a)
      real(wp), intent(in) :: a(:, :)

      norm_of = maxval(sum(abs(a), dim=1))
   end function norm_of

   !> x = a x.
   subroutine multiply_by(a, x)
      real(wp), intent(in), contiguous :: a(:, :)                     !! (n, n)
      real(wp), intent(inout), contiguous :: x(:, :)                  !! (n, any)
      real(wp) :: column(max_few)
      integer :: j, n

      n = size(a, 1)
      if (n > max_few) then
         x = product_of(a, x)
         return
      end if
      do j = 1, size(x, 2)
         column(:n) = x(:, j)
         call multiply_few(n, 1, a, column, x(:, j))
      end do
   end subroutine multiply_by

   !> a b, (n, any), of many rows.
   function product_of(a, b) result(c)
      real(wp), intent(in), contiguous :: a(:, :), b(:, :)
      real(wp) :: c(size(a, 1), size(b, 2))
      integer :: n

      n = size(a, 1)
      call dgemm("N", "N", n, size(b, 2), n, 1.0_wp, a, n, b, n, 0.0_wp, c, n)
   end function product_of
end module hb_matrix_exponential
