!> CHOLMOD: Cholesky factors of large sparse matrices. Source of the interfaces: hb_cholmod.h.
module hb_cholmod
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_int, c_int64_t, c_null_ptr, c_ptr
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   implicit none
   private
   public :: cholesky_t

   real(wp), parameter :: mib = 1024.0_wp**2
   integer(c_int), parameter :: is_good = 0, is_not_definite = 1

   !> In the order of use: `factorise`, `solve` as often as wanted, `destroy`, which may be called twice.
   type :: cholesky_t
      integer :: n = 0
      logical :: is_indefinite = .false.                              !! why `factorise` failed
      real(wp) :: bytes = 0.0_wp                                      !! that the factors take
      type(c_ptr), private :: factors = c_null_ptr
   contains
      procedure :: factorise => cholesky_factorise
      procedure :: solve => cholesky_solve
      procedure :: destroy => cholesky_destroy
   end type cholesky_t

   interface
      integer(c_int) function hb_cholesky_factorise(n, first, row, value, most_bytes, factors, bytes) bind(c)
         import :: c_double, c_int, c_int64_t, c_ptr
         integer(c_int64_t), value :: n
         integer(c_int64_t), intent(in) :: first(*), row(*)
         real(c_double), intent(in) :: value(*)
         real(c_double), value :: most_bytes
         type(c_ptr), intent(out) :: factors
         real(c_double), intent(out) :: bytes
      end function hb_cholesky_factorise

      integer(c_int) function hb_cholesky_solve(factors, n_rhs, b, x) bind(c)
         import :: c_double, c_int, c_int64_t, c_ptr
         type(c_ptr), value :: factors
         integer(c_int64_t), value :: n_rhs
         real(c_double), intent(in) :: b(*)
         real(c_double), intent(out) :: x(*)
      end function hb_cholesky_solve

      subroutine hb_cholesky_destroy(factors) bind(c)
         import :: c_ptr
         type(c_ptr), value :: factors
      end subroutine hb_cholesky_destroy
   end interface

contains

   !> Factorises a symmetric matrix; fails where it is not positive definite, or memory is short.
   subroutine cholesky_factorise(self, first, row, value, most_bytes, error)
      class(cholesky_t), intent(inout) :: self
      integer, intent(in) :: first(:)                                 !! (n + 1): column j of the lower triangle has entries
                                                                      !! first(j) to first(j + 1) - 1
      integer, intent(in) :: row(:)                                   !! of each entry, ascending in a column
      real(wp), intent(in) :: value(:)
      real(wp), intent(in) :: most_bytes                              !! that the factors may take
      type(error_t), allocatable, intent(out) :: error
      integer(c_int) :: status

      call self%destroy()
      self%n = size(first) - 1
      status = hb_cholesky_factorise(int(self%n, c_int64_t), int(first - 1, c_int64_t), int(row - 1, c_int64_t), value, &
                                     most_bytes, self%factors, self%bytes)
      self%is_indefinite = status == is_not_definite
      if (status == is_good) return
      self%factors = c_null_ptr
      if (self%is_indefinite) then
         call fail(error, "the matrix is not positive definite")
      else
         call fail(error, "memory is short for the factors of a matrix of order "//text_of(real(self%n, wp))//": they take "// &
                   text_of(self%bytes/mib)//" MiB")
      end if
   end subroutine cholesky_factorise

   !> Solves A X = B.
   subroutine cholesky_solve(self, b, x, error)
      class(cholesky_t), intent(in) :: self
      real(wp), intent(in), contiguous :: b(:, :)                     !! (n, any)
      real(wp), intent(out), contiguous :: x(:, :)                    !! as b
      type(error_t), allocatable, intent(out) :: error

      if (size(b) == 0) return
      if (hb_cholesky_solve(self%factors, int(size(b, 2), c_int64_t), b, x) /= is_good) &
         call fail(error, "memory is short for solutions with the factors of a matrix of order "//text_of(real(self%n, wp)))
   end subroutine cholesky_solve

   !> Gives the memory of the library back.
   subroutine cholesky_destroy(self)
      class(cholesky_t), intent(inout) :: self

      if (c_associated(self%factors)) call hb_cholesky_destroy(self%factors)
      self%factors = c_null_ptr
   end subroutine cholesky_destroy

   function text_of(number) result(text)
      real(wp), intent(in) :: number
      character(:), allocatable :: text
      character(24) :: digits

      write (digits, "(f24.0)") number
      text = trim(adjustl(digits))
      text = text(:len(text) - 1)                                     ! without the point
   end function text_of
end module hb_cholmod
