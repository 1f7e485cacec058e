!> The factor of a sparse, symmetric, positive definite matrix by CHOLMOD, behind one type; hb_cholmod.h alone knows the library.
!>
!> In the order of use: `factorise`, `solve` any number of times, `destroy`, which may be called twice. An assignment copies
!> the reference, not the factor.
module hb_cholmod
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_int, c_null_ptr, c_ptr
   use hb_kinds, only: wp
   implicit none
   private
   public :: cholesky_factor_t, has_cholmod

   type :: cholesky_factor_t
      type(c_ptr), private :: handle = c_null_ptr
   contains
      procedure :: factorise => cholesky_factor_factorise
      procedure :: is_there => cholesky_factor_is_there
      procedure :: solve => cholesky_factor_solve
      procedure :: solve_at => cholesky_factor_solve_at
      procedure :: bytes => cholesky_factor_bytes
      procedure :: destroy => cholesky_factor_destroy
   end type cholesky_factor_t

   interface
      integer(c_int) function hb_has_cholmod() bind(c)
         import :: c_int
      end function hb_has_cholmod

      type(c_ptr) function hb_cholmod_new(n, first, column, value, n_at, at) bind(c)
         import :: c_double, c_int, c_ptr
         integer(c_int), value :: n, n_at
         integer(c_int), intent(in) :: first(*), column(*), at(*)
         real(c_double), intent(in) :: value(*)
      end function hb_cholmod_new

      subroutine hb_cholmod_solve(self, n_columns, b) bind(c)
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: self
         integer(c_int), value :: n_columns
         real(c_double), intent(inout) :: b(*)
      end subroutine hb_cholmod_solve

      subroutine hb_cholmod_solve_at(self, n_columns, b) bind(c)
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: self
         integer(c_int), value :: n_columns
         real(c_double), intent(inout) :: b(*)
      end subroutine hb_cholmod_solve_at

      real(c_double) function hb_cholmod_bytes(self) bind(c)
         import :: c_double, c_ptr
         type(c_ptr), value :: self
      end function hb_cholmod_bytes

      subroutine hb_cholmod_delete(self) bind(c)
         import :: c_ptr
         type(c_ptr), value :: self
      end subroutine hb_cholmod_delete
   end interface

contains

   !> Whether the program was built with CHOLMOD; without it no matrix is factorised.
   logical function has_cholmod()
      has_cholmod = hb_has_cholmod() /= 0
   end function has_cholmod

   !> Factorises a matrix from its rows, in the place of an earlier factor; false if it is not positive definite, or if there is not
   !> enough memory. Its upper triangle is read.
   logical function cholesky_factor_factorise(self, first, column, value, at) result(is_done)
      class(cholesky_factor_t), intent(inout) :: self
      integer, intent(in) :: first(:)                                 !! (n + 1): row i has entries first(i) to first(i + 1) - 1
      integer, intent(in) :: column(:)                                !! of each entry
      real(wp), intent(in) :: value(:)
      integer, intent(in) :: at(:)                                    !! the unknowns of `solve_at`

      call self%destroy()
      self%handle = hb_cholmod_new(size(first) - 1, first - 1, column - 1, value, size(at), at - 1)
      is_done = self%is_there()
   end function cholesky_factor_factorise

   !> Whether a matrix has been factorised, and the factor not destroyed.
   logical function cholesky_factor_is_there(self) result(is_there)
      class(cholesky_factor_t), intent(in) :: self

      is_there = c_associated(self%handle)
   end function cholesky_factor_is_there

   !> Overwrites b with the solutions of A X = b of all right sides at once.
   subroutine cholesky_factor_solve(self, b)
      class(cholesky_factor_t), intent(in) :: self
      real(wp), intent(inout), contiguous :: b(:, :)                  !! (any, n)

      if (size(b, 1) > 0) call hb_cholmod_solve(self%handle, size(b, 1), b)
   end subroutine cholesky_factor_solve

   !> Likewise for some unknowns: the others have no right sides, and their solutions are not wanted.
   subroutine cholesky_factor_solve_at(self, b)
      class(cholesky_factor_t), intent(in) :: self
      real(wp), intent(inout), contiguous :: b(:, :)                  !! (any, size(at)) of `factorise`

      if (size(b, 1) > 0) call hb_cholmod_solve_at(self%handle, size(b, 1), b)
   end subroutine cholesky_factor_solve_at

   !> Memory of the factor.
   real(wp) function cholesky_factor_bytes(self) result(bytes)
      class(cholesky_factor_t), intent(in) :: self

      bytes = 0.0_wp
      if (self%is_there()) bytes = hb_cholmod_bytes(self%handle)
   end function cholesky_factor_bytes

   !> Frees the factor; safe to call twice.
   subroutine cholesky_factor_destroy(self)
      class(cholesky_factor_t), intent(inout) :: self

      if (self%is_there()) call hb_cholmod_delete(self%handle)
      self%handle = c_null_ptr
   end subroutine cholesky_factor_destroy
end module hb_cholmod
