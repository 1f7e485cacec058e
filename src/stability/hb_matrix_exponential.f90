!> The exponential of a real matrix.
!>
!> For two rows a closed form. Otherwise scaling by a power of two to a norm of at most 1/2, the diagonal Pade
!> approximant of degree 6 (backward error below 1e-16 there), then squaring. Source: N. J. Higham, Functions of
!> Matrices, SIAM 2008, section 10.3.
module hb_matrix_exponential
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: wp
   use hb_lapack, only: dgemm, dgetrf, dgetrs
   implicit none
   private
   public :: count_exponential, exponential_of, exponential_of_two, per_multiplication, product_of

   integer, parameter :: degree = 6
   integer, parameter :: largest_plain = 12                           ! rows up to which the compiler's products are faster
   real(wp), parameter :: uncut = 1.0e8_wp                            ! [ns] of work between two checks of the cancellation

contains

   !> exp(a); not finite if beyond the range of numbers.
   subroutine exponential_of(a, e)
      real(wp), intent(in) :: a(:, :)                                 !! (n, n)
      real(wp), intent(out) :: e(:, :)                                !! (n, n)
      real(wp), dimension(size(a, 1), size(a, 1)) :: denominator, power, scaled
      real(wp) :: factor
      integer :: i, info, k, n, n_squarings, pivots(size(a, 1))

      n = size(a, 1)
      if (n == 2) then
         call exponential_of_two(a(1, 1), a(1, 2), a(2, 1), a(2, 2), e)
         return
      end if
      n_squarings = squarings_for(norm_of(a))
      scaled = a*0.5_wp**n_squarings
      e = 0.0_wp
      do i = 1, n
         e(i, i) = 1.0_wp
      end do
      denominator = e
      power = e
      factor = 1.0_wp
      do k = 1, degree
         factor = factor*real(degree - k + 1, wp)/real(k*(2*degree - k + 1), wp)
         if (n > largest_plain) then
            if (work_is_over()) return                                ! a product takes milliseconds or more
         end if
         power = product_of(scaled, power)
         e = e + factor*power
         denominator = denominator + merge(-factor, factor, modulo(k, 2) == 1)*power
      end do
      call dgetrf(n, n, denominator, n, pivots, info)
      do i = 1, n, panel_of(n)
         if (i > 1) then
            if (work_is_over()) return
         end if
         call dgetrs("N", n, min(panel_of(n), n - i + 1), denominator, n, pivots, e(:, i:), n, info)
      end do
      do i = 1, n_squarings
         if (n > largest_plain) then
            if (work_is_over()) return
         end if
         e = product_of(e, e)
      end do
   end subroutine exponential_of

   !> exp(a) = exp(m) (cosh s I + sinh s/s (a - m I)), m half the trace, s**2 = -det(a - m I).
   pure subroutine exponential_of_two(a11, a12, a21, a22, e)
      real(wp), intent(in) :: a11, a12, a21, a22
      real(wp), intent(out) :: e(2, 2)
      real(wp) :: c, d, m, s, square
      real(wp), parameter :: small = 0.1_wp                           ! the series to the sixth power are exact to rounding
      real(wp), parameter :: of_c(6) = 1.0_wp/[2.0_wp, 24.0_wp, 720.0_wp, 40320.0_wp, 3628800.0_wp, 479001600.0_wp]
      real(wp), parameter :: of_s(6) = of_c/[3, 5, 7, 9, 11, 13]

      m = 0.5_wp*(a11 + a22)
      d = 0.5_wp*(a11 - a22)
      square = d**2 + a12*a21
      if (abs(square) < small) then
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
      if (n > 2) work = per_multiplication(n)*real(n, wp)**3*(degree + 1.4_wp + squarings_for(norm)) + 500.0_wp
   end function count_exponential

   !> Approximate time of one multiplication of `product_of` in nanoseconds.
   pure real(wp) function per_multiplication(n)
      integer, intent(in) :: n

      per_multiplication = merge(0.5_wp, 0.12_wp, n <= largest_plain)
   end function per_multiplication

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

   !> Columns of a product with n rows, or solutions, that take no longer than `uncut`.
   pure integer function panel_of(n)
      integer, intent(in) :: n

      panel_of = max(1, int(min(real(n, wp), uncut/(per_multiplication(n)*real(n, wp)**2))))
   end function panel_of

   !> a b, (n, any); incomplete if the work of the thread was cancelled.
   function product_of(a, b) result(c)
      real(wp), intent(in), contiguous :: a(:, :), b(:, :)
      real(wp) :: c(size(a, 1), size(b, 2))
      integer :: first, n, n_columns

      if (size(a, 1) <= largest_plain) then
         c = matmul(a, b)
      else
         n = size(a, 1)
         do first = 1, size(b, 2), panel_of(n)
            if (first > 1) then
               if (work_is_over()) exit
            end if
            n_columns = min(panel_of(n), size(b, 2) - first + 1)
            call dgemm("N", "N", n, n_columns, n, 1.0_wp, a, n, b(:, first:), n, 0.0_wp, c(:, first:), n)
         end do
      end if
   end function product_of
end module hb_matrix_exponential
