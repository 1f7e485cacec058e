!> LU factors of small complex matrices in the format of LAPACK's `zgetrf`.
!>
!> Up to some twenty rows LAPACK's calls take longer than the arithmetic: a beam under two tones has hundreds of
!> matrices of order seven. Source: Golub and Van Loan, Matrix Computations, 4th ed., section 3.4 (outer products with
!> partial pivoting).
module hb_small_lu
   use hb_kinds, only: wp
   implicit none
   private
   public :: factorise_small, largest_small, solve_small

   integer, parameter :: largest_small = 16                           !! rows up to which these routines are faster

contains

   !> Overwrites a with its factors, without the unit diagonal of L. `is_singular` if a pivot is too small for
   !> division; the factors are then invalid.
   pure subroutine factorise_small(a, pivots, is_singular)
      complex(wp), intent(inout), contiguous :: a(:, :)               !! (n, n)
      integer, intent(out) :: pivots(:)                               !! (n) row with which row i was exchanged
      logical, intent(out) :: is_singular
      complex(wp) :: factor, inverse, retained
      integer :: i, j, k, n
      real(wp) :: largest

      n = size(a, 1)
      is_singular = .true.
      do k = 1, n
         pivots(k) = k
         largest = -1.0_wp
         do i = k, n
            associate (size_of => abs(real(a(i, k))) + abs(aimag(a(i, k))))
               if (size_of <= largest) cycle
               largest = size_of
               pivots(k) = i
            end associate
         end do
         if (.not. largest >= tiny(1.0_wp)) return
         if (pivots(k) /= k) then
            do j = 1, n
               retained = a(k, j)
               a(k, j) = a(pivots(k), j)
               a(pivots(k), j) = retained
            end do
         end if
         inverse = (1.0_wp, 0.0_wp)/a(k, k)
         do i = k + 1, n
            a(i, k) = inverse*a(i, k)
         end do
         do j = k + 1, n
            factor = a(k, j)
            if (.not. abs(real(factor)) + abs(aimag(factor)) > 0.0_wp) cycle
            do i = k + 1, n
               a(i, j) = a(i, j) - factor*a(i, k)
            end do
         end do
      end do
      is_singular = .false.
   end subroutine factorise_small

   !> Overwrites b with the solution of A X = B, from the factors of A.
   pure subroutine solve_small(a, pivots, b)
      complex(wp), intent(in), contiguous :: a(:, :)                  !! (n, n)
      integer, intent(in) :: pivots(:)                                !! (n)
      complex(wp), intent(inout), contiguous :: b(:, :)               !! (n, any)
      complex(wp) :: inverse(size(a, 1)), retained
      integer :: i, j, k, n

      n = size(a, 1)
      do k = 1, n
         inverse(k) = (1.0_wp, 0.0_wp)/a(k, k)
      end do
      do k = 1, n                                                     ! all exchanges before elimination: L has been exchanged too
         do j = 1, size(b, 2)
            retained = b(pivots(k), j)
            b(pivots(k), j) = b(k, j)
            b(k, j) = retained
         end do
      end do
      do k = 1, n                                                     ! right-hand sides together: their dependencies differ
         do j = 1, size(b, 2)
            retained = b(k, j)
            do i = k + 1, n
               b(i, j) = b(i, j) - retained*a(i, k)
            end do
         end do
      end do
      do k = n, 1, -1
         do j = 1, size(b, 2)
            retained = inverse(k)*b(k, j)
            b(k, j) = retained
            do i = 1, k - 1
               b(i, j) = b(i, j) - retained*a(i, k)
            end do
         end do
      end do
   end subroutine solve_small
end module hb_small_lu
