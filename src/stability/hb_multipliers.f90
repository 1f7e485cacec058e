!> Floquet multipliers: the eigenvalues of a monodromy matrix, without those that are known.
module hb_multipliers
   use hb_kinds, only: wp
   use hb_lapack, only: dgeev
   implicit none
   private
   public :: deflate, eigenvalues_of

contains

   !> Eigenvalues of a real matrix, the largest first; none where LAPACK fails.
   subroutine eigenvalues_of(matrix, values)
      real(wp), intent(in) :: matrix(:, :)                            !! (n, n)
      complex(wp), allocatable, intent(out) :: values(:)
      real(wp), allocatable :: a(:, :), imaginary(:), real_part(:), work(:)
      real(wp) :: left(1, 1), right(1, 1)
      integer :: i, info, k, n
      complex(wp) :: kept

      n = size(matrix, 1)
      if (n == 2) then
         values = eigenvalues_of_two(matrix)
      else
         a = matrix
         allocate (real_part(n), imaginary(n), work(8*n))
         call dgeev("N", "N", n, a, n, real_part, imaginary, left, 1, right, 1, work, size(work), info)
         if (info /= 0) then
            allocate (values(0))
            return
         end if
         values = cmplx(real_part, imaginary, wp)
      end if
      do i = 2, n                                                     ! pairs stay together: the order of equals is kept
         kept = values(i)
         do k = i - 1, 1, -1
            if (abs(values(k)) >= abs(kept)) exit
            values(k + 1) = values(k)
         end do
         values(k + 1) = kept
      end do
   end subroutine eigenvalues_of

   !> Those of two rows, without cancellation.
   pure function eigenvalues_of_two(a) result(values)
      real(wp), intent(in) :: a(:, :)
      complex(wp) :: values(2)
      real(wp) :: determinant, half, root, square

      half = 0.5_wp*(a(1, 1) + a(2, 2))
      determinant = a(1, 1)*a(2, 2) - a(1, 2)*a(2, 1)
      square = (0.5_wp*(a(1, 1) - a(2, 2)))**2 + a(1, 2)*a(2, 1)
      root = sqrt(abs(square))
      if (square < 0.0_wp) then
         values = [cmplx(half, root, wp), cmplx(half, -root, wp)]
      else
         root = half + sign(root, half)
         values = root
         if (abs(root) > 0.0_wp) values(2) = determinant/root
      end if
   end function eigenvalues_of_two

   !> Takes a known eigenvector out of a matrix, exactly so where it is one: by a reflection that turns it into the first unit
   !> vector, whose row and column go.
   subroutine deflate(matrix, vector)
      real(wp), allocatable, intent(inout) :: matrix(:, :)            !! (n, n), then (n - 1, n - 1)
      real(wp), intent(in) :: vector(:)                               !! (n), not zero
      real(wp) :: normal(size(vector))
      integer :: n

      n = size(vector)
      normal = vector/norm2(vector)
      normal(1) = normal(1) + sign(1.0_wp, normal(1))
      normal = normal*sqrt(2.0_wp)/norm2(normal)
      matrix = matrix - spread(normal, 2, n)*spread(matmul(normal, matrix), 1, n)
      matrix = matrix - spread(matmul(matrix, normal), 2, n)*spread(normal, 1, n)
      matrix = matrix(2:, 2:)
   end subroutine deflate
end module hb_multipliers
