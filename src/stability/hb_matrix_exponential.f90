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
   public :: count_exponential, exponential_of, exponential_of_two, product_of, work_of_product

   integer, parameter :: degree = 6
   real(wp), parameter :: unchecked = 1.0e6_wp                        ! [ns] of a product: a check takes up to half a microsecond

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
      is_long = work_of_product(n) > unchecked
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
      if (n > 2) work = work_of_product(n)*(degree + 1.4_wp + squarings_for(norm))
   end function count_exponential

   !> Approximate time of a product of two matrices of n rows in nanoseconds.
   pure real(wp) function work_of_product(n) result(work)
      integer, intent(in) :: n

      work = 150.0_wp + 0.08_wp*real(n, wp)**3                         ! 0.7 to 1.6 times the time of an exponential up to 40 rows
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

   !> a b, (n, any); the compiler's product is at most 20 ns faster, for 3 and 4 rows.
   function product_of(a, b) result(c)
      real(wp), intent(in), contiguous :: a(:, :), b(:, :)
      real(wp) :: c(size(a, 1), size(b, 2))
      integer :: n

      n = size(a, 1)
      call dgemm("N", "N", n, size(b, 2), n, 1.0_wp, a, n, b, n, 0.0_wp, c, n)
   end function product_of
end module hb_matrix_exponential
