!> Eigenvalues of the map of disturbances over a period, by size, and deflation of the directions of known ones.
module hb_map_eigenvalues
   use hb_kinds, only: wp
   use hb_lapack, only: dgeev
   implicit none
   private
   public :: deflate, deflate_all, eigenvalues_of, sort_by_size

contains

   !> Eigenvalues of a real matrix, the largest first; none if LAPACK fails.
   subroutine eigenvalues_of(matrix, values)
      real(wp), intent(in) :: matrix(:, :)                            !! (n, n)
      complex(wp), allocatable, intent(out) :: values(:)
      real(wp), allocatable :: a(:, :), imaginary(:), real_part(:), work(:)
      real(wp) :: left(1, 1), right(1, 1)
      integer :: info, n

      n = size(matrix, 1)
      if (n == 0) then                                                ! no mass moves
         allocate (values(0))
         return
      else if (n == 2) then
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
      call sort_by_size(values)
   end subroutine eigenvalues_of

   !> Sorts values, the largest first; pairs stay adjacent, because the sort is stable.
   pure subroutine sort_by_size(values)
      complex(wp), intent(inout) :: values(:)
      complex(wp) :: retained
      integer :: i, k

      do i = 2, size(values)
         retained = values(i)
         do k = i - 1, 1, -1
            if (abs(values(k)) >= abs(retained)) exit
            values(k + 1) = values(k)
         end do
         values(k + 1) = retained
      end do
   end subroutine sort_by_size

   !> Eigenvalues of a matrix of two rows, without cancellation.
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

   !> Removes a known eigenvector from a matrix, exactly if it is one: by a reflection that maps it to the first unit
   !> vector, whose row and column are removed.
   subroutine deflate(matrix, vector, others)
      real(wp), allocatable, intent(inout) :: matrix(:, :)            !! (n, n), then (n - 1, n - 1)
      real(wp), intent(in) :: vector(:)                               !! (n), not zero
      real(wp), allocatable, intent(inout), optional :: others(:, :)  !! vectors after this one, (n, this one and others), then
                                                                      !! (n - 1, others)
      real(wp) :: normal(size(vector))
      integer :: n

      n = size(vector)
      normal = vector/norm2(vector)
      normal(1) = normal(1) + sign(1.0_wp, normal(1))
      normal = normal*sqrt(2.0_wp)/norm2(normal)
      matrix = matrix - spread(normal, 2, n)*spread(matmul(normal, matrix), 1, n)
      matrix = matrix - spread(matmul(matrix, normal), 2, n)*spread(normal, 1, n)
      matrix = matrix(2:, 2:)
      if (.not. present(others)) return
      others = others - spread(normal, 2, size(others, 2))*spread(matmul(normal, others), 1, n)
      others = others(2:, 2:)
   end subroutine deflate

   !> Removes directions that a period leaves as they are.
   subroutine deflate_all(matrix, directions)
      real(wp), allocatable, intent(inout) :: matrix(:, :)            !! (n, n), then (n - m, n - m)
      real(wp), intent(in) :: directions(:, :)                        !! (n, m)
      real(wp), allocatable :: first(:), left(:, :)

      allocate (left, source=directions)
      do while (size(left, 2) > 0)
         first = left(:, 1)
         call deflate(matrix, first, left)
      end do
   end subroutine deflate_all
end module hb_map_eigenvalues
