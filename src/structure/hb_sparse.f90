!> Sparse matrices by rows (CSR), the format of models.
module hb_sparse
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_text, only: to_text
   implicit none
   private
   public :: new_sparse, sparse_from_entries, sparse_identity, sparse_product, sparse_sum, sparse_t, sparse_transpose

   type :: sparse_t
      integer :: n_rows = 0, n_columns = 0
      integer, allocatable :: first(:)                                !! (n_rows + 1): row i has entries first(i) to first(i+1)-1
      integer, allocatable :: column(:)                               !! (n_entries)
      real(wp), allocatable :: value(:)                               !! (n_entries)
   contains
      procedure :: at => sparse_at
      procedure :: dense => sparse_dense
      procedure :: diagonal => sparse_diagonal
      procedure :: equal => sparse_equal
      procedure :: is_symmetric => sparse_is_symmetric
      procedure :: n_entries => sparse_n_entries
      procedure :: n_in_row => sparse_n_in_row
      procedure :: times => sparse_times
   end type sparse_t

contains

   !> Creates a matrix from its rows as stored in files, counted from zero. Fails and names the entry if an index is
   !> out of range, rows are not contiguous, a row contains a column twice, or a value is not finite.
   subroutine new_sparse(self, n_columns, starts, columns, values, error)
      type(sparse_t), intent(out) :: self
      integer, intent(in) :: n_columns
      integer, intent(in) :: starts(:)                                !! (n_rows + 1), from 0
      integer, intent(in) :: columns(:)                               !! (n_entries), from 0
      real(wp), intent(in) :: values(:)                               !! (n_entries)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: last_row(:)                             ! last row with an entry in a column
      integer :: e, i

      if (size(starts) < 1) then
         call fail(error, "indptr is empty")
         return
      else if (starts(1) /= 0) then
         call fail(error, "indptr(1) is "//to_text(starts(1))//", not 0")
         return
      else if (size(columns) /= size(values)) then
         call fail(error, to_text(size(columns))//" indices for "//to_text(size(values))//" values")
         return
      else if (starts(size(starts)) /= size(values)) then
         call fail(error, "indptr ends with "//to_text(starts(size(starts)))//", there are "//to_text(size(values))//" values")
         return
      end if
      allocate (last_row(n_columns), source=0)
      do i = 1, size(starts) - 1
         if (starts(i + 1) < starts(i) .or. starts(i + 1) > size(values)) then
            call fail(error, "indptr("//to_text(i + 1)//") is "//to_text(starts(i + 1))//" after "//to_text(starts(i)))
            return
         end if
         do e = starts(i) + 1, starts(i + 1)
            if (columns(e) < 0 .or. columns(e) >= n_columns) then
               call fail(error, "indices("//to_text(e)//") is "//to_text(columns(e))//", not between 0 and "// &
                         to_text(n_columns - 1))
            else if (last_row(columns(e) + 1) == i) then
               call fail(error, "row "//to_text(i)//" names column "//to_text(columns(e) + 1)//" twice")
            else if (.not. ieee_is_finite(values(e))) then
               call fail(error, "the entry in row "//to_text(i)//" and column "//to_text(columns(e) + 1)//" is not a finite number")
            end if
            if (allocated(error)) return
            last_row(columns(e) + 1) = i
         end do
      end do
      self%n_rows = size(starts) - 1
      self%n_columns = n_columns
      self%first = starts + 1
      self%column = columns + 1
      self%value = values
   end subroutine new_sparse

   !> Whether two matrices have the same entries at the same positions, in the same order.
   pure logical function sparse_equal(self, other) result(are_equal)
      class(sparse_t), intent(in) :: self
      type(sparse_t), intent(in) :: other

      are_equal = self%n_rows == other%n_rows .and. self%n_columns == other%n_columns .and. self%n_entries() == other%n_entries()
      if (are_equal) are_equal = all(self%first == other%first)
      if (are_equal) are_equal = all(self%column == other%column)
      if (are_equal) are_equal = all(self%value == other%value)
   end function sparse_equal

   !> Matrix from entries in any order, by default a square one; entries at the same position are added.
   function sparse_from_entries(n, row, column, value, n_columns) result(self)
      integer, intent(in) :: n                                        !! rows
      integer, intent(in) :: row(:), column(:)                        !! from 1
      real(wp), intent(in) :: value(:)
      integer, intent(in), optional :: n_columns
      type(sparse_t) :: self
      type(sparse_t) :: raw
      integer, allocatable :: next(:)
      integer :: e

      allocate (next(n + 1))
      raw%n_rows = n
      raw%n_columns = n
      if (present(n_columns)) raw%n_columns = n_columns
      allocate (raw%first(n + 1), raw%column(size(row)), raw%value(size(row)))
      next = 0
      do e = 1, size(row)
         next(row(e) + 1) = next(row(e) + 1) + 1
      end do
      next(1) = 1
      do e = 1, n
         next(e + 1) = next(e) + next(e + 1)
      end do
      raw%first = next
      do e = 1, size(row)
         raw%column(next(row(e))) = column(e)
         raw%value(next(row(e))) = value(e)
         next(row(e)) = next(row(e)) + 1
      end do
      self = sparse_sum(1.0_wp, raw, 0.0_wp, raw)
   end function sparse_from_entries

   !> The unit matrix.
   function sparse_identity(n) result(self)
      integer, intent(in) :: n
      type(sparse_t) :: self
      integer :: i

      self = sparse_from_entries(n, [(i, i=1, n)], [(i, i=1, n)], spread(1.0_wp, 1, n))
   end function sparse_identity

   !> The sum of a times one matrix and b times another of the same shape, with the entries of both; a factor of 0
   !> omits one.
   function sparse_sum(a, one, b, other) result(total)
      real(wp), intent(in) :: a, b
      type(sparse_t), intent(in) :: one, other
      type(sparse_t) :: total
      integer, allocatable :: position(:)                             ! position of a column among the entries of the row so far
      integer :: i, n

      total%n_rows = one%n_rows
      total%n_columns = one%n_columns
      n = merge(one%n_entries(), 0, abs(a) > 0.0_wp) + merge(other%n_entries(), 0, abs(b) > 0.0_wp)
      allocate (total%first(one%n_rows + 1), total%column(n), total%value(n))
      allocate (position(one%n_columns), source=0)
      n = 0
      do i = 1, one%n_rows
         total%first(i) = n + 1
         if (abs(a) > 0.0_wp) call add_row(a, one)
         if (abs(b) > 0.0_wp) call add_row(b, other)
      end do
      total%first(one%n_rows + 1) = n + 1
      total%column = total%column(:n)
      total%value = total%value(:n)

   contains

      subroutine add_row(factor, matrix)
         real(wp), intent(in) :: factor
         type(sparse_t), intent(in) :: matrix
         integer :: e

         do e = matrix%first(i), matrix%first(i + 1) - 1
            associate (at => position(matrix%column(e)))
               if (at < total%first(i)) then
                  n = n + 1
                  at = n
                  total%column(n) = matrix%column(e)
                  total%value(n) = 0.0_wp
               end if
               total%value(at) = total%value(at) + factor*matrix%value(e)
            end associate
         end do
      end subroutine add_row
   end function sparse_sum

   !> The transpose of a square matrix.
   function sparse_transpose(matrix) result(turned)
      type(sparse_t), intent(in) :: matrix
      type(sparse_t) :: turned
      integer, allocatable :: row(:)
      integer :: e, i

      allocate (row(matrix%n_entries()))
      do i = 1, matrix%n_rows
         do e = matrix%first(i), matrix%first(i + 1) - 1
            row(e) = i
         end do
      end do
      turned = sparse_from_entries(matrix%n_rows, matrix%column, row, matrix%value)
   end function sparse_transpose

   !> The product of two square matrices.
   function sparse_product(one, other) result(product)
      type(sparse_t), intent(in) :: one, other
      type(sparse_t) :: product
      integer, allocatable :: column(:), row(:)
      real(wp), allocatable :: value(:)
      integer :: e, f, i, k, n

      n = 0
      do e = 1, one%n_entries()
         n = n + other%first(one%column(e) + 1) - other%first(one%column(e))
      end do
      allocate (row(n), column(n), value(n))
      n = 0
      do i = 1, one%n_rows
         do e = one%first(i), one%first(i + 1) - 1
            k = one%column(e)
            do f = other%first(k), other%first(k + 1) - 1
               n = n + 1
               row(n) = i
               column(n) = other%column(f)
               value(n) = one%value(e)*other%value(f)
            end do
         end do
      end do
      product = sparse_from_entries(one%n_rows, row, column, value)
   end function sparse_product

   !> One entry, zero if none is stored. Bisection finds it where columns ascend, as they do in most files.
   pure real(wp) function sparse_at(self, i, j) result(value)
      class(sparse_t), intent(in) :: self
      integer, intent(in) :: i, j
      integer :: e, last

      value = 0.0_wp
      e = self%first(i)
      last = self%first(i + 1) - 1
      do while (e < last)
         associate (middle => (e + last)/2)
            if (self%column(middle) < j) then
               e = middle + 1
            else
               last = middle
            end if
         end associate
      end do
      if (e == last) then
         if (self%column(e) == j) then
            value = self%value(e)
            return
         end if
      end if
      do e = self%first(i), self%first(i + 1) - 1
         if (self%column(e) == j) value = self%value(e)
      end do
   end function sparse_at

   !> The diagonal of a square matrix.
   pure function sparse_diagonal(self) result(diagonal)
      class(sparse_t), intent(in) :: self
      real(wp), allocatable :: diagonal(:)
      integer :: i

      diagonal = [(self%at(i, i), i=1, self%n_rows)]
   end function sparse_diagonal

   !> Whether a square matrix is symmetric but for rounding, relative to each pair of entries and to the diagonals of its rows, so
   !> that rows in other units do not hide a difference.
   logical function sparse_is_symmetric(self) result(is_symmetric)
      class(sparse_t), intent(in) :: self
      real(wp), parameter :: rounding = 1.0e-9_wp
      type(sparse_t) :: mirrored
      real(wp) :: diagonal(self%n_rows), row(self%n_rows)
      integer :: e, i

      is_symmetric = .true.
      if (self%n_entries() == 0) return
      diagonal = sqrt(abs(self%diagonal()))
      mirrored = sparse_transpose(self)
      row = 0.0_wp
      do i = 1, self%n_rows
         call add_row(self, 1.0_wp)
         call add_row(mirrored, -1.0_wp)
         call compare(self)
         call compare(mirrored)
         if (.not. is_symmetric) return
      end do

   contains

      subroutine add_row(matrix, factor)
         class(sparse_t), intent(in) :: matrix
         real(wp), intent(in) :: factor

         do e = matrix%first(i), matrix%first(i + 1) - 1
            row(matrix%column(e)) = row(matrix%column(e)) + factor*matrix%value(e)
         end do
      end subroutine add_row

      !> Compares and clears the differences at the entries of a row.
      subroutine compare(matrix)
         class(sparse_t), intent(in) :: matrix

         do e = matrix%first(i), matrix%first(i + 1) - 1
            associate (k => matrix%column(e))
               is_symmetric = is_symmetric .and. &
                              abs(row(k)) <= rounding*(abs(matrix%value(e)) + diagonal(i)*diagonal(k))
               row(k) = 0.0_wp
            end associate
         end do
      end subroutine compare
   end function sparse_is_symmetric

   !> Number of stored entries.
   pure integer function sparse_n_entries(self) result(n)
      class(sparse_t), intent(in) :: self

      n = 0
      if (allocated(self%value)) n = size(self%value)
   end function sparse_n_entries

   !> Number of stored entries of a row.
   pure integer function sparse_n_in_row(self, i) result(n)
      class(sparse_t), intent(in) :: self
      integer, intent(in) :: i

      n = self%first(i + 1) - self%first(i)
   end function sparse_n_in_row

   !> Y^T = A X^T: the right sides of a row lie beside each other.
   pure subroutine sparse_times(self, x, y)
      class(sparse_t), intent(in) :: self
      real(wp), intent(in), contiguous :: x(:, :)                     !! (any, n_columns)
      real(wp), intent(out), contiguous :: y(:, :)                    !! (any, n_rows)
      integer :: e, i

      do i = 1, self%n_rows
         y(:, i) = 0.0_wp
         do e = self%first(i), self%first(i + 1) - 1
            y(:, i) = y(:, i) + self%value(e)*x(:, self%column(e))
         end do
      end do
   end subroutine sparse_times

   !> The whole matrix.
   pure function sparse_dense(self) result(matrix)
      class(sparse_t), intent(in) :: self
      real(wp), allocatable :: matrix(:, :)
      integer :: e, i

      allocate (matrix(self%n_rows, self%n_columns), source=0.0_wp)
      do i = 1, self%n_rows
         do e = self%first(i), self%first(i + 1) - 1
            matrix(i, self%column(e)) = self%value(e)
         end do
      end do
   end function sparse_dense
end module hb_sparse
