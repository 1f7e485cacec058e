!> A square matrix that is multiplied many times: by its non-zero entries where they are few, else as it is.
module hb_integration_matrix
   use hb_kinds, only: wp
   implicit none
   private
   public :: integration_matrix_t, new_integration_matrix

   type :: integration_matrix_t
      integer :: n = 0
      logical :: is_sparse = .false.
      real(wp), allocatable :: entries(:, :)                          !! (n, n) unless sparse
      integer, allocatable :: first(:)                                !! (n + 1) first entry of each column
      integer, allocatable :: row(:)
      real(wp), allocatable :: value(:)
   contains
      procedure :: subtract_product => matrix_subtract_product
   end type integration_matrix_t

contains

   !> Takes a matrix; where few entries are other than zero, these alone.
   pure subroutine new_integration_matrix(self, entries)
      type(integration_matrix_t), intent(out) :: self
      real(wp), intent(in) :: entries(:, :)                           !! (n, n)
      integer :: e, i, j

      self%n = size(entries, 1)
      self%is_sparse = 2*count(abs(entries) > 0.0_wp) < self%n**2
      if (.not. self%is_sparse) then
         self%entries = entries
         return
      end if
      allocate (self%first(self%n + 1), self%row(count(abs(entries) > 0.0_wp)))
      allocate (self%value(size(self%row)))
      e = 0
      do j = 1, self%n
         self%first(j) = e + 1
         do i = 1, self%n
            if (.not. abs(entries(i, j)) > 0.0_wp) cycle
            e = e + 1
            self%row(e) = i
            self%value(e) = entries(i, j)
         end do
      end do
      self%first(self%n + 1) = e + 1
   end subroutine new_integration_matrix

   !> y = y - A x.
   pure subroutine matrix_subtract_product(self, x, y)
      class(integration_matrix_t), intent(in) :: self
      real(wp), intent(in), contiguous :: x(:)                        !! (n)
      real(wp), intent(inout), contiguous :: y(:)                     !! (n)
      integer :: e, i, j

      if (self%is_sparse) then
         do j = 1, self%n
            do e = self%first(j), self%first(j + 1) - 1
               y(self%row(e)) = y(self%row(e)) - self%value(e)*x(j)
            end do
         end do
      else
         do j = 1, self%n
            do i = 1, self%n
               y(i) = y(i) - self%entries(i, j)*x(j)
            end do
         end do
      end if
   end subroutine matrix_subtract_product
end module hb_integration_matrix
