!> Sparse matrices by rows (CSR): the form in which models come.
module hb_sparse
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_text, only: to_text
   implicit none
   private
   public :: new_sparse, sparse_t

   type :: sparse_t
      integer :: n_rows = 0, n_columns = 0
      integer, allocatable :: first(:)                                !! (n_rows + 1): row i has entries first(i) to first(i+1)-1
      integer, allocatable :: column(:)                               !! (n_entries)
      real(wp), allocatable :: value(:)                               !! (n_entries)
   contains
      procedure :: dense => sparse_dense
      procedure :: n_entries => sparse_n_entries
   end type sparse_t

contains

   !> Makes a matrix from its rows as files have them, counted from zero. Fails, naming the entry, where an index is out of range,
   !> rows do not follow each other, a row names a column twice, or a value is not finite.
   subroutine new_sparse(self, n_columns, starts, columns, values, error)
      type(sparse_t), intent(out) :: self
      integer, intent(in) :: n_columns
      integer, intent(in) :: starts(:)                                !! (n_rows + 1), from 0
      integer, intent(in) :: columns(:)                               !! (n_entries), from 0
      real(wp), intent(in) :: values(:)                               !! (n_entries)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: last_row(:)                             ! that had an entry in a column
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

   !> Number of stored entries.
   pure integer function sparse_n_entries(self) result(n)
      class(sparse_t), intent(in) :: self

      n = 0
      if (allocated(self%value)) n = size(self%value)
   end function sparse_n_entries

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
