!> How fast a shared counter is on the machine at hand, for the simulation of larger runs.
module hb_counter_speed
   use hb_clock, only: wall_clock
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_mpi, only: barrier, comm_t, max_over, new_work_counter, rank_of, size_of, work_counter_t
   implicit none
   private
   public :: measure_counter

   integer, parameter :: n_batches = 20, n_draws = 200                ! the best batch counts: others run on the machine too

contains

   !> Measures a counter of rank 0 as the last rank sees it; collective, the same on all ranks.
   subroutine measure_counter(comm, latency, rate, error)
      type(comm_t), intent(in) :: comm
      real(wp), intent(out) :: latency                                !! [s] of a draw while nobody else draws
      real(wp), intent(out) :: rate                                   !! [1/s] draws of all ranks together
      type(error_t), allocatable, intent(out) :: error
      type(work_counter_t) :: counter
      real(wp) :: seconds
      integer :: batch

      latency = huge(1.0_wp)
      rate = 0.0_wp
      call new_work_counter(counter, [0], comm, error)
      if (allocated(error)) return
      do batch = 1, n_batches
         call barrier(comm)
         seconds = 0.0_wp
         if (rank_of(comm) == size_of(comm) - 1) call draw(counter, seconds)
         latency = min(latency, max_over(comm, seconds)/n_draws)
      end do
      do batch = 1, n_batches
         call barrier(comm)
         call draw(counter, seconds)
         rate = max(rate, real(n_draws, wp)*size_of(comm)/max_over(comm, seconds))
      end do
      call barrier(comm)
      call counter%destroy()
   end subroutine measure_counter

   subroutine draw(counter, seconds)
      type(work_counter_t), intent(in) :: counter
      real(wp), intent(out) :: seconds                                !! [s] of n_draws draws
      integer :: i, number

      seconds = wall_clock()
      do i = 1, n_draws
         number = counter%next(1, 1)
      end do
      seconds = wall_clock() - seconds
   end subroutine draw
end module hb_counter_speed
