!> Null space of a matrix, from the columns that depend on those before them (Gram-Schmidt, with reorthogonalisation).
!> Source: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., section 5.2.
module hb_null_space
   use hb_kinds, only: wp
   implicit none
   private
   public :: find_null_space

contains

   !> Finds the columns that depend on those before them, and for each the vector v with a v = 0 that has 1 there and no other
   !> dependent column.
   pure subroutine find_null_space(a, threshold, is_dependent, vectors)
      real(wp), intent(in) :: a(:, :)                                 !! (m, n), with columns of similar size
      real(wp), intent(in) :: threshold                               !! norm of the remainder of a dependent column
      logical, intent(out) :: is_dependent(:)                         !! (n)
      real(wp), allocatable, intent(out) :: vectors(:, :)             !! (n, number of dependent columns)
      real(wp), allocatable :: orthonormal(:, :), triangle(:, :)
      real(wp) :: change(size(a, 2)), rest(size(a, 1))
      integer :: independent(size(a, 2))
      integer :: i, k, n, pass

      allocate (vectors(size(a, 2), 0))
      allocate (orthonormal(size(a, 1), size(a, 2)), triangle(size(a, 2), size(a, 2)), source=0.0_wp)
      n = 0
      do k = 1, size(a, 2)
         rest = a(:, k)
         do pass = 1, 2
            change(:n) = matmul(rest, orthonormal(:, :n))
            rest = rest - matmul(orthonormal(:, :n), change(:n))
            triangle(:n, k) = triangle(:n, k) + change(:n)
         end do
         is_dependent(k) = norm2(rest) < threshold
         if (is_dependent(k)) then
            change = 0.0_wp
            change(k) = 1.0_wp
            do i = n, 1, -1
               associate (later => independent(i + 1:n))
                  change(independent(i)) = -(triangle(i, k) + dot_product(triangle(i, later), change(later)))/ &
                                           triangle(i, independent(i))
               end associate
            end do
            vectors = reshape([vectors, change], [size(a, 2), size(vectors, 2) + 1])
         else
            n = n + 1
            independent(n) = k
            triangle(n, k) = norm2(rest)
            orthonormal(:, n) = rest/triangle(n, k)
         end if
      end do
   end subroutine find_null_space
end module hb_null_space
