!> LAPACK and BLAS: explicit interfaces of the routines that the project calls; their only declarations.
!>
!> Names and arguments are those of the reference (https://netlib.org/lapack); `info` < 0 is a wrong argument,
!> `info` > 0 is described at each routine. Leading dimensions must be at least 1, also for empty matrices.
module hb_lapack
   use hb_kinds, only: sp, wp
   implicit none
   private
   public :: cgetrf, cgetrs, dgeev, dgemm, dgemv, dgeqrf, dgetrf, dgetrs
   public :: dggev, dnrm2, dorgqr, dpotrf, dpotrs, dsygv, sgbtrf, sgbtrs, sgetrf, sgetrs
   public :: zgbtrf, zgbtrs, zgemm, zgemv, zgetrf, zgetrs

   ! Linear equations, dense
   interface
      !> LU factors with row exchanges of a real matrix; info = i > 0: pivot i is exactly zero.
      subroutine dgetrf(m, n, a, lda, ipiv, info)
         import :: wp
         integer, intent(in) :: m, n, lda
         real(wp), intent(inout) :: a(lda, *)
         integer, intent(out) :: ipiv(*)
         integer, intent(out) :: info
      end subroutine dgetrf

      !> Solves A X = B (trans = "N") or its transpose with the factors of `dgetrf`.
      subroutine dgetrs(trans, n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         character, intent(in) :: trans
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(in) :: a(lda, *)
         integer, intent(in) :: ipiv(*)
         real(wp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine dgetrs

      !> `dgetrf` in single precision.
      subroutine sgetrf(m, n, a, lda, ipiv, info)
         import :: sp
         integer, intent(in) :: m, n, lda
         real(sp), intent(inout) :: a(lda, *)
         integer, intent(out) :: ipiv(*)
         integer, intent(out) :: info
      end subroutine sgetrf

      !> `dgetrs` in single precision.
      subroutine sgetrs(trans, n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: sp
         character, intent(in) :: trans
         integer, intent(in) :: n, nrhs, lda, ldb
         real(sp), intent(in) :: a(lda, *)
         integer, intent(in) :: ipiv(*)
         real(sp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine sgetrs

      !> LU factors with row exchanges of a complex matrix; info = i > 0: pivot i is exactly zero.
      subroutine zgetrf(m, n, a, lda, ipiv, info)
         import :: wp
         integer, intent(in) :: m, n, lda
         complex(wp), intent(inout) :: a(lda, *)
         integer, intent(out) :: ipiv(*)
         integer, intent(out) :: info
      end subroutine zgetrf

      !> Solves A X = B (trans = "N") or its transpose with the factors of `zgetrf`.
      subroutine zgetrs(trans, n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         character, intent(in) :: trans
         integer, intent(in) :: n, nrhs, lda, ldb
         complex(wp), intent(in) :: a(lda, *)
         integer, intent(in) :: ipiv(*)
         complex(wp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine zgetrs

      !> `zgetrf` in single precision.
      subroutine cgetrf(m, n, a, lda, ipiv, info)
         import :: sp
         integer, intent(in) :: m, n, lda
         complex(sp), intent(inout) :: a(lda, *)
         integer, intent(out) :: ipiv(*)
         integer, intent(out) :: info
      end subroutine cgetrf

      !> `zgetrs` in single precision.
      subroutine cgetrs(trans, n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: sp
         character, intent(in) :: trans
         integer, intent(in) :: n, nrhs, lda, ldb
         complex(sp), intent(in) :: a(lda, *)
         integer, intent(in) :: ipiv(*)
         complex(sp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine cgetrs

      !> Cholesky factors of a positive definite matrix; info = i > 0: leading minor i is not positive.
      subroutine dpotrf(uplo, n, a, lda, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, lda
         real(wp), intent(inout) :: a(lda, *)
         integer, intent(out) :: info
      end subroutine dpotrf

      !> Solves A X = B with the factor of `dpotrf`.
      subroutine dpotrs(uplo, n, nrhs, a, lda, b, ldb, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(in) :: a(lda, *)
         real(wp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine dpotrs
   end interface

   ! Linear equations, band matrices
   interface
      !> LU factors of a band matrix, ldab >= 2 kl + ku + 1, entry (i, j) at ab(kl + ku + 1 + i - j, j).
      subroutine zgbtrf(m, n, kl, ku, ab, ldab, ipiv, info)
         import :: wp
         integer, intent(in) :: m, n, kl, ku, ldab
         complex(wp), intent(inout) :: ab(ldab, *)
         integer, intent(out) :: ipiv(*)
         integer, intent(out) :: info
      end subroutine zgbtrf

      !> LU factors of a real band matrix in single precision, stored as for `zgbtrf`.
      subroutine sgbtrf(m, n, kl, ku, ab, ldab, ipiv, info)
         import :: sp
         integer, intent(in) :: m, n, kl, ku, ldab
         real(sp), intent(inout) :: ab(ldab, *)
         integer, intent(out) :: ipiv(*)
         integer, intent(out) :: info
      end subroutine sgbtrf

      !> Solves with the factors of `sgbtrf`.
      subroutine sgbtrs(trans, n, kl, ku, nrhs, ab, ldab, ipiv, b, ldb, info)
         import :: sp
         character, intent(in) :: trans
         integer, intent(in) :: n, kl, ku, nrhs, ldab, ldb
         real(sp), intent(in) :: ab(ldab, *)
         integer, intent(in) :: ipiv(*)
         real(sp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine sgbtrs

      !> Solves with the factors of `zgbtrf`.
      subroutine zgbtrs(trans, n, kl, ku, nrhs, ab, ldab, ipiv, b, ldb, info)
         import :: wp
         character, intent(in) :: trans
         integer, intent(in) :: n, kl, ku, nrhs, ldab, ldb
         complex(wp), intent(in) :: ab(ldab, *)
         integer, intent(in) :: ipiv(*)
         complex(wp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine zgbtrs
   end interface

   ! Eigenvalues
   interface
      !> Eigenvalues wr + i wi and, if requested, left and right eigenvectors; `a` is overwritten.
      subroutine dgeev(jobvl, jobvr, n, a, lda, wr, wi, vl, ldvl, vr, ldvr, work, lwork, info)
         import :: wp
         character, intent(in) :: jobvl, jobvr
         integer, intent(in) :: n, lda, ldvl, ldvr, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: wr(*), wi(*), vl(ldvl, *), vr(ldvr, *)
         real(wp), intent(inout) :: work(*)
         integer, intent(out) :: info
      end subroutine dgeev

      !> Eigenvalues (alphar + i alphai)/beta of A x = lambda B x and, if requested, left and right eigenvectors; `a` and `b`
      !> are overwritten, beta = 0 is an infinite one.
      subroutine dggev(jobvl, jobvr, n, a, lda, b, ldb, alphar, alphai, beta, vl, ldvl, vr, ldvr, work, lwork, info)
         import :: wp
         character, intent(in) :: jobvl, jobvr
         integer, intent(in) :: n, lda, ldb, ldvl, ldvr, lwork
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         real(wp), intent(out) :: alphar(*), alphai(*), beta(*), vl(ldvl, *), vr(ldvr, *)
         real(wp), intent(inout) :: work(*)
         integer, intent(out) :: info
      end subroutine dggev

      !> Eigenvalues in ascending order of A x = w B x (itype = 1), A symmetric, B positive definite.
      subroutine dsygv(itype, jobz, uplo, n, a, lda, b, ldb, w, work, lwork, info)
         import :: wp
         integer, intent(in) :: itype
         character, intent(in) :: jobz, uplo
         integer, intent(in) :: n, lda, ldb, lwork
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         real(wp), intent(out) :: w(*)
         real(wp), intent(inout) :: work(*)
         integer, intent(out) :: info
      end subroutine dsygv
   end interface

   ! Products
   interface
      !> Euclidean norm, safe against overflow.
      function dnrm2(n, x, incx) result(value)
         import :: wp
         integer, intent(in) :: n, incx
         real(wp), intent(in) :: x(*)
         real(wp) :: value
      end function dnrm2

      !> y := alpha op(A) x + beta y.
      subroutine dgemv(trans, m, n, alpha, a, lda, x, incx, beta, y, incy)
         import :: wp
         character, intent(in) :: trans
         integer, intent(in) :: m, n, lda, incx, incy
         real(wp), intent(in) :: alpha, beta
         real(wp), intent(in) :: a(lda, *), x(*)
         real(wp), intent(inout) :: y(*)
      end subroutine dgemv

      !> Factors Q R of a matrix, Q by its reflectors.
      subroutine dgeqrf(m, n, a, lda, tau, work, lwork, info)
         import :: wp
         integer, intent(in) :: m, n, lda, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: tau(*), work(*)
         integer, intent(out) :: info
      end subroutine dgeqrf

      !> The first columns of Q from the reflectors of dgeqrf.
      subroutine dorgqr(m, n, k, a, lda, tau, work, lwork, info)
         import :: wp
         integer, intent(in) :: m, n, k, lda, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(in) :: tau(*)
         real(wp), intent(out) :: work(*)
         integer, intent(out) :: info
      end subroutine dorgqr

      !> C := alpha op(A) op(B) + beta C.
      subroutine dgemm(transa, transb, m, n, k, alpha, a, lda, b, ldb, beta, c, ldc)
         import :: wp
         character, intent(in) :: transa, transb
         integer, intent(in) :: m, n, k, lda, ldb, ldc
         real(wp), intent(in) :: alpha, beta
         real(wp), intent(in) :: a(lda, *), b(ldb, *)
         real(wp), intent(inout) :: c(ldc, *)
      end subroutine dgemm

      !> C := alpha op(A) op(B) + beta C.
      subroutine zgemm(transa, transb, m, n, k, alpha, a, lda, b, ldb, beta, c, ldc)
         import :: wp
         character, intent(in) :: transa, transb
         integer, intent(in) :: m, n, k, lda, ldb, ldc
         complex(wp), intent(in) :: alpha, beta
         complex(wp), intent(in) :: a(lda, *), b(ldb, *)
         complex(wp), intent(inout) :: c(ldc, *)
      end subroutine zgemm

      !> y := alpha op(A) x + beta y.
      subroutine zgemv(trans, m, n, alpha, a, lda, x, incx, beta, y, incy)
         import :: wp
         character, intent(in) :: trans
         integer, intent(in) :: m, n, lda, incx, incy
         complex(wp), intent(in) :: alpha, beta
         complex(wp), intent(in) :: a(lda, *), x(*)
         complex(wp), intent(inout) :: y(*)
      end subroutine zgemv
   end interface
end module hb_lapack
