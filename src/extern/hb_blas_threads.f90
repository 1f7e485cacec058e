!> How many threads BLAS works with. Points are spread over ranks, and the matrices of one are small: more threads than one
!> only wait for each other, and their sums may be rounded in another order.
!> Source of the interfaces: hb_blas.h.
module hb_blas_threads
   use, intrinsic :: iso_c_binding, only: c_int
   implicit none
   private
   public :: n_blas_threads, use_one_blas_thread

   interface
      !> Has OpenBLAS work with one thread, unless the user's environment asks for a number (OPENBLAS_NUM_THREADS,
      !> GOTO_NUM_THREADS, OMP_NUM_THREADS).
      subroutine use_one_blas_thread() bind(c, name="hb_use_one_blas_thread")
      end subroutine use_one_blas_thread

      !> Threads that OpenBLAS works with; 0 with another library.
      integer(c_int) function n_blas_threads() bind(c, name="hb_n_blas_threads")
         import :: c_int
      end function n_blas_threads
   end interface
end module hb_blas_threads
