!> Eigenvalues of the map of disturbances over a period, by size, and deflation of the directions of known ones.
module hb_map_eigenvalues
   use hb_kinds, only: wp
   use hb_lapack, only: dgeev
   implicit none
   private
   public :: deflate, deflate_all, eigenvalues_of, shifts_of_eigenvalues, sort_by_size

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

   !> How far an error of the entries of a matrix moves its eigenvalues: by the error over the cosine between left and right
   !> eigenvector; of two that nearly coincide by its square root, since their difference is the root of an entry's. Huge if LAPACK
   !> fails. Source: G. W. Stewart and J.-G. Sun, Matrix Perturbation Theory, Academic Press 1990, sections IV.2 and IV.3.
   function shifts_of_eigenvalues(matrix, values, error) result(shifts)
      real(wp), intent(in) :: matrix(:, :)                            !! (n, n)
      complex(wp), intent(in) :: values(:)                            !! some of its eigenvalues
      real(wp), intent(in) :: error                                   !! of its entries
      real(wp) :: shifts(size(values))
      real(wp), dimension(size(matrix, 1)) :: gap, imaginary, real_part, shift
      real(wp), dimension(size(matrix, 1), size(matrix, 1)) :: a, left, right
      complex(wp) :: own(size(matrix, 1))
      real(wp) :: condition, work(8*size(matrix, 1))
      integer :: i, info, n

      n = size(matrix, 1)
      shifts = huge(1.0_wp)
      if (n == 0) return
      a = matrix
      call dgeev("V", "V", n, a, n, real_part, imaginary, left, n, right, n, work, size(work), info)
      if (info /= 0) return
      own = cmplx(real_part, imaginary, wp)
      do i = 1, n
         gap(i) = minval([2.0_wp*maxval(abs(own)), abs(own(i) - own(:i - 1)), abs(own(i) - own(i + 1:))])
         condition = 1.0_wp/max(abs(dot_product(vector_of(left, i), vector_of(right, i))), tiny(1.0_wp))
         shift(i) = error*condition
         if (shift(i) > 0.5_wp*gap(i)) shift(i) = max(error, min(shift(i), sqrt(error*condition*gap(i))))
      end do
      do i = 1, size(values)
         shifts(i) = shift(minloc(abs(own - values(i)), dim=1))
      end do

   contains

      !> Eigenvector i of those that LAPACK returns, of length 1: of a pair real and imaginary part stand one after the other.
      pure function vector_of(columns, i) result(vector)
         real(wp), intent(in) :: columns(:, :)
         integer, intent(in) :: i
         complex(wp) :: vector(size(columns, 1))

         if (imaginary(i) > 0.0_wp) then
            vector = cmplx(columns(:, i), columns(:, i + 1), wp)
         else if (imaginary(i) < 0.0_wp) then
            vector = cmplx(columns(:, i - 1), -columns(:, i), wp)
         else
            vector = columns(:, i)
         end if
      end function vector_of
   end function shifts_of_eigenvalues

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
