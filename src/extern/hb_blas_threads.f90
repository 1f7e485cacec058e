!> Number of threads and working memory of BLAS. Points are distributed over ranks, and the matrices of a point are
!> small: several threads only wait for each other, and may change the order of summation and thus the rounding.
!> Source of the interfaces: hb_blas.h.
module hb_blas_threads
   use, intrinsic :: iso_c_binding, only: c_int
   use hb_error, only: error_t, fail
   implicit none
   private
   public :: allocate_blas_memory, can_end_blas, limit_blas_threads, n_blas_threads

   logical :: is_short_of_memory = .false.

   interface
      !> Makes BLAS use one thread, or the number in the environment variable NHBM_BLAS_THREADS.
      subroutine limit_blas_threads() bind(c, name="hb_limit_blas_threads")
      end subroutine limit_blas_threads

      integer(c_int) function hb_allocate_blas_memory() bind(c, name="hb_allocate_blas_memory")
         import :: c_int
      end function hb_allocate_blas_memory

      !> Number of threads of OpenBLAS, MKL or BLIS; 0 with another library.
      integer(c_int) function n_blas_threads() bind(c, name="hb_n_blas_threads")
         import :: c_int
      end function n_blas_threads
   end interface

contains

   !> Makes BLAS allocate its working memory before its first call; fails if a limit leaves too little.
   subroutine allocate_blas_memory(error)
      type(error_t), allocatable, intent(out) :: error

      is_short_of_memory = hb_allocate_blas_memory() /= 0
      if (is_short_of_memory) call fail(error, "a limit on memory (ulimit -v) leaves less than the 144 MiB that "// &
         "each thread of OpenBLAS takes at its first call; raise it, or leave out NHBM_BLAS_THREADS")
   end subroutine allocate_blas_memory

   !> Whether the process may end as usual. Without its memory OpenBLAS would wait for threads that never stop to request theirs.
   logical function can_end_blas()
      can_end_blas = .not. is_short_of_memory
   end function can_end_blas
end module hb_blas_threads
