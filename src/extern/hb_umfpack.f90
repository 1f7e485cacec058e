!> UMFPACK: factors of sparse complex matrices of one pattern, analysed once (T. A. Davis, ACM Trans. Math. Softw. 30 (2004)).
!>
!> In the order of use: `analyse` with the pattern by columns, then for each set of values `factorise` and `solve` any
!> number of times; `destroy` frees all memory and may be called twice.
module hb_umfpack
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_double_complex, c_int, c_loc, c_null_ptr, c_ptr
   use hb_kinds, only: wp
   implicit none
   private
   public :: umfpack_t

   integer(c_int), parameter :: of_matrix = 0, of_conjugate_transpose = 1           ! UMFPACK_A, UMFPACK_At
   integer(c_int), parameter :: is_good = 0                                         ! UMFPACK_OK; positive is a warning
   integer, parameter :: n_control = 20, n_info = 90
   integer, parameter :: strategy_index = 6, symmetric_strategy = 3                  ! UMFPACK_STRATEGY, counted from 1
   integer, parameter :: refinement_steps = 8                                       ! UMFPACK_IRSTEP, likewise

   type :: umfpack_t
      private
      integer(c_int) :: n = 0
      integer(c_int), allocatable :: first(:), row(:)                 ! by columns, from 0
      complex(c_double_complex), allocatable :: value(:)
      type(c_ptr) :: symbolic = c_null_ptr, numeric = c_null_ptr
   contains
      procedure :: analyse => umfpack_analyse
      procedure :: factorise => umfpack_factorise
      procedure :: solve => umfpack_solve
      procedure :: destroy => umfpack_destroy
   end type umfpack_t

   interface
      subroutine umfpack_zi_defaults(control) bind(c)
         import :: c_double
         real(c_double), intent(out) :: control(*)
      end subroutine umfpack_zi_defaults

      integer(c_int) function umfpack_zi_symbolic(n_row, n_col, ap, ai, ax, az, symbolic, control, info) bind(c)
         import :: c_double, c_int, c_ptr
         integer(c_int), value :: n_row, n_col
         integer(c_int), intent(in) :: ap(*), ai(*)
         type(c_ptr), value :: ax, az
         type(c_ptr), intent(out) :: symbolic
         real(c_double), intent(in) :: control(*)
         real(c_double), intent(out) :: info(*)
      end function umfpack_zi_symbolic

      integer(c_int) function umfpack_zi_numeric(ap, ai, ax, az, symbolic, numeric, control, info) bind(c)
         import :: c_double, c_int, c_ptr
         integer(c_int), intent(in) :: ap(*), ai(*)
         type(c_ptr), value :: ax, az, symbolic
         type(c_ptr), intent(out) :: numeric
         real(c_double), intent(in) :: control(*)
         real(c_double), intent(out) :: info(*)
      end function umfpack_zi_numeric

      integer(c_int) function umfpack_zi_solve(sys, ap, ai, ax, az, xx, xz, bx, bz, numeric, control, info) bind(c)
         import :: c_double, c_int, c_ptr
         integer(c_int), value :: sys
         integer(c_int), intent(in) :: ap(*), ai(*)
         type(c_ptr), value :: ax, az, xx, xz, bx, bz, numeric
         real(c_double), intent(in) :: control(*)
         real(c_double), intent(out) :: info(*)
      end function umfpack_zi_solve

      subroutine umfpack_zi_free_symbolic(symbolic) bind(c)
         import :: c_ptr
         type(c_ptr), intent(inout) :: symbolic
      end subroutine umfpack_zi_free_symbolic

      subroutine umfpack_zi_free_numeric(numeric) bind(c)
         import :: c_ptr
         type(c_ptr), intent(inout) :: numeric
      end subroutine umfpack_zi_free_numeric
   end interface

contains

   !> Orders the rows and columns of a square matrix by its pattern, which is that of its transpose; false if memory
   !> is insufficient.
   logical function umfpack_analyse(self, first, row) result(is_done)
      class(umfpack_t), intent(inout) :: self
      integer, intent(in) :: first(:)                                 !! (n + 1): column j has entries first(j) to first(j + 1) - 1
      integer, intent(in) :: row(:)                                   !! of each entry, ascending in a column
      real(c_double) :: control(n_control), info(n_info)

      call self%destroy()
      self%n = size(first) - 1
      self%first = first - 1
      self%row = row - 1
      call umfpack_zi_defaults(control)
      control(strategy_index) = symmetric_strategy
      is_done = umfpack_zi_symbolic(self%n, self%n, self%first, self%row, c_null_ptr, c_null_ptr, self%symbolic, control, info) &
                == is_good
   end function umfpack_analyse

   !> Factorises for the values of the entries, in the order of the pattern; false if the matrix is singular.
   logical function umfpack_factorise(self, value) result(is_done)
      class(umfpack_t), intent(inout), target :: self
      complex(wp), intent(in) :: value(:)
      real(c_double) :: control(n_control), info(n_info)

      if (c_associated(self%numeric)) call umfpack_zi_free_numeric(self%numeric)
      self%value = value
      call umfpack_zi_defaults(control)
      is_done = umfpack_zi_numeric(self%first, self%row, c_loc(self%value), c_null_ptr, self%symbolic, self%numeric, control, &
                                   info) == is_good
   end function umfpack_factorise

   !> Solves A x = b, or A**H x = b, in place, with one or two steps of refinement unless these are not wanted.
   subroutine umfpack_solve(self, b, of_transpose, is_refined)
      class(umfpack_t), intent(in), target :: self
      complex(wp), intent(inout), contiguous, target :: b(:)          !! (n)
      logical, intent(in) :: of_transpose                             !! conjugate transpose
      logical, intent(in), optional :: is_refined                     !! default true
      complex(c_double_complex), allocatable, target :: x(:)
      real(c_double) :: control(n_control), info(n_info)
      integer(c_int) :: status

      allocate (x(self%n))
      call umfpack_zi_defaults(control)
      if (present(is_refined)) then
         if (.not. is_refined) control(refinement_steps) = 0.0_c_double
      end if
      status = umfpack_zi_solve(merge(of_conjugate_transpose, of_matrix, of_transpose), self%first, self%row, c_loc(self%value), &
                                c_null_ptr, c_loc(x), c_null_ptr, c_loc(b), c_null_ptr, self%numeric, control, info)
      b = x
   end subroutine umfpack_solve

   !> Frees the memory of the library.
   subroutine umfpack_destroy(self)
      class(umfpack_t), intent(inout) :: self

      if (c_associated(self%numeric)) call umfpack_zi_free_numeric(self%numeric)
      if (c_associated(self%symbolic)) call umfpack_zi_free_symbolic(self%symbolic)
      self%numeric = c_null_ptr
      self%symbolic = c_null_ptr
   end subroutine umfpack_destroy
end module hb_umfpack
