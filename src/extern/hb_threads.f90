!> Threads that share the work of one large point (OpenMP): loops over functions of the torus, laws and harmonics, each of which
!> is computed by one thread in the same way, so that the results are the same to the last bit for any number of threads.
!>
!> The number belongs to the thread that solves a model, since each thread may solve one of its own. The threads that help it
!> have no helpers. Without OpenMP (HB_THREADS=OFF) there is one thread.
module hb_threads
   !$ use omp_lib, only: omp_get_thread_num, omp_in_parallel
   implicit none
   private
   public :: are_threads_available, has_helpers, n_threads, this_thread, use_threads

   integer, parameter :: min_work = 16384 !! operations; with less, threads take longer to start than they save
   integer, save :: team = 1
   !$omp threadprivate(team)

contains

   !> Whether the program was built with threads.
   pure logical function are_threads_available()
      are_threads_available = .false.
      !$ are_threads_available = .true.
   end function are_threads_available

   !> Sets the number of threads for what this thread computes from now on.
   subroutine use_threads(n)
      integer, intent(in) :: n                                        !! >= 1

      team = 1
      !$ team = n
   end subroutine use_threads

   !> Number of threads for a loop with this work; one within such a loop.
   integer function n_threads(work)
      integer, intent(in) :: work                                     !! operations of the whole loop, about

      n_threads = 1
      if (work >= min_work) n_threads = team
   end function n_threads

   !> Whether other threads share the present loop of this thread.
   logical function has_helpers()
      has_helpers = .false.
      !$ has_helpers = omp_in_parallel()
   end function has_helpers

   !> Number of the calling thread within its loop, from 1.
   integer function this_thread()
      this_thread = 1
      !$ this_thread = omp_get_thread_num() + 1
   end function this_thread
end module hb_threads
