!> Simulation of a run over any number of ranks: the blocks come from hb_schedule as in a real run, costs of points, counters
!> and file system from a model of the machine.
!>
!> Each rank has one event ahead of it, a draw or the writing of a block, in a heap ordered by time. A counter and the file
!> system serve one request after the other: what arrives while they are busy waits. Source of the method: A. M. Law,
!> Simulation Modeling and Analysis (5th edition, 2015), sections 1.3 and 2.8.
module schedule_simulation
   use hb_kinds, only: two_pi, wp
   use hb_schedule, only: cursor_t, schedule_t
   implicit none
   private
   public :: forecast_t, lognormal_costs, machine_t, simulate, stretched_costs, tasks_t

   !> A machine. The defaults are those of a cluster with remote atomics and a parallel file system.
   type :: machine_t
      real(wp) :: latency = 3.0e-6_wp                                 !! [s] to a counter and back
      real(wp) :: counter_rate = 1.0e6_wp                             !! [1/s] operations that one counter serves
      real(wp) :: write_latency = 5.0e-5_wp                           !! [s] of one write, for the rank that makes it
      real(wp) :: write_rate = 1.0e5_wp                               !! [1/s] writes that the file system takes from all ranks
      real(wp) :: bandwidth = 1.0e10_wp                               !! [B/s] that it takes from all ranks
      real(wp) :: hold = 0.0_wp                                       !! [s], above 0: how long results are held back, hb_row_buffer
   end type machine_t

   !> What there is to do.
   type :: tasks_t
      real(wp), allocatable :: ends(:)                                !! [s] cost of all points up to each, (0:n_points)
      integer :: writes_per_row = 1                                   !! datasets that a point, or a held block, writes to
      real(wp) :: bytes_per_point = 0.0_wp                            !! [B]
   end type tasks_t

   !> How a run would go. Shares are those of the time of all ranks.
   type :: forecast_t
      real(wp) :: seconds = 0.0_wp                                    !! [s] until the last rank is done
      real(wp) :: efficiency = 0.0_wp                                 !! share of solving
      real(wp) :: drawing = 0.0_wp, writing = 0.0_wp, idle = 0.0_wp   !! shares
      real(wp) :: draws = 0.0_wp                                      !! from all counters
      real(wp) :: writes = 0.0_wp                                     !! to the file
      real(wp) :: counter_load = 0.0_wp                               !! share of the run that the busiest counter is busy
      real(wp) :: file_load = 0.0_wp                                  !! share of the run that the file system is busy
   end type forecast_t

contains

   !> Costs of points with a logarithmic normal distribution, always the same: mean*exp(spread*z - spread**2/2).
   pure subroutine lognormal_costs(n_points, mean, spread, ends)
      integer, intent(in) :: n_points
      real(wp), intent(in) :: mean                                    !! [s]
      real(wp), intent(in) :: spread                                  !! standard deviation of the logarithm
      real(wp), allocatable, intent(out) :: ends(:)                   !! as in tasks_t
      integer, parameter :: i64 = selected_int_kind(18)
      integer(i64), parameter :: multiplier = 48271_i64, modulus = 2147483647_i64
      integer(i64) :: state
      real(wp) :: u(2)
      integer :: i, k

      allocate (ends(0:n_points))
      ends(0) = 0.0_wp
      state = 20060917_i64
      do i = 1, n_points
         do k = 1, 2
            state = modulo(multiplier*state, modulus)                 ! Park, Miller, Communications of the ACM 31 (1988)
            u(k) = real(state, wp)/real(modulus, wp)
         end do
         ends(i) = ends(i - 1) + mean*exp(spread*sqrt(-2.0_wp*log(u(1)))*cos(two_pi*u(2)) - 0.5_wp*spread**2)
      end do
   end subroutine lognormal_costs

   !> Measured costs stretched to more or fewer points, in their order: neighbours stay alike.
   pure subroutine stretched_costs(n_points, measured, ends)
      integer, intent(in) :: n_points
      real(wp), intent(in) :: measured(:)                             !! [s], one or more
      real(wp), allocatable, intent(out) :: ends(:)                   !! as in tasks_t
      integer :: i, k

      allocate (ends(0:n_points))
      ends(0) = 0.0_wp
      do i = 1, n_points
         k = 1 + int((real(i, wp) - 0.5_wp)*size(measured)/n_points)
         ends(i) = ends(i - 1) + measured(min(k, size(measured)))
      end do
   end subroutine stretched_costs

   !> Runs all tasks over `n_ranks` ranks.
   pure subroutine simulate(schedule, n_ranks, tasks, machine, forecast)
      type(schedule_t), intent(in) :: schedule                        !! made for n_ranks
      integer, intent(in) :: n_ranks
      type(tasks_t), intent(in) :: tasks
      type(machine_t), intent(in) :: machine
      type(forecast_t), intent(out) :: forecast
      type(cursor_t) :: cursors(0:n_ranks - 1)
      integer :: heap(n_ranks), drawn(schedule%n_counters), n, n_active, n_writes, rank
      integer :: held(0:n_ranks - 1)                                  ! points of a block that waits to be written
      real(wp) :: time(0:n_ranks - 1), solving(0:n_ranks - 1)
      real(wp) :: counter_free(schedule%n_counters), counter_busy(schedule%n_counters), file_busy, file_free
      real(wp) :: drawing, writing, end_of_all, served
      integer :: counter, first, first_point, last, last_point, unused

      cursors = [(schedule%cursor_of(rank), rank=0, n_ranks - 1)]
      heap = [(rank, rank=0, n_ranks - 1)]
      time = 0.0_wp
      held = 0
      drawn = 0
      counter_free = 0.0_wp
      counter_busy = 0.0_wp
      file_free = 0.0_wp
      file_busy = 0.0_wp
      drawing = 0.0_wp
      writing = 0.0_wp
      end_of_all = 0.0_wp
      n_active = n_ranks
      do while (n_active > 0)
         rank = heap(1)
         if (held(rank) > 0) then
            n_writes = tasks%writes_per_row*max(1, ceiling(min(real(held(rank), wp), solving(rank)/machine%hold)))
            served = n_writes/machine%write_rate + held(rank)*tasks%bytes_per_point/machine%bandwidth
            file_busy = file_busy + served
            file_free = max(file_free, time(rank)) + served
            served = max(file_free, time(rank) + n_writes*machine%write_latency)
            writing = writing + served - time(rank)
            forecast%writes = forecast%writes + n_writes
            time(rank) = served
            held(rank) = 0
         else
            counter = cursors(rank)%counter
            served = max(time(rank) + 0.5_wp*machine%latency, counter_free(counter)) + 1.0_wp/machine%counter_rate
            counter_free(counter) = served
            counter_busy(counter) = counter_busy(counter) + 1.0_wp/machine%counter_rate
            served = served + 0.5_wp*machine%latency
            drawing = drawing + served - time(rank)
            time(rank) = served
            n = schedule%ask(cursors(rank))
            call schedule%block_of(cursors(rank), drawn(counter), n, first, last)
            drawn(counter) = drawn(counter) + n
            forecast%draws = forecast%draws + 1.0_wp
            if (first <= last) then
               call schedule%points_of(first, first_point, unused)
               call schedule%points_of(last, unused, last_point)
               held(rank) = last_point - first_point + 1
               solving(rank) = tasks%ends(last_point) - tasks%ends(first_point - 1)
               time(rank) = time(rank) + solving(rank)
               call cursors(rank)%note(last - first + 1, solving(rank))
            else if (cursors(rank)%is_done) then
               end_of_all = max(end_of_all, time(rank))
               heap(1) = heap(n_active)
               n_active = n_active - 1
            end if
         end if
         call sift_down(time, n_active, heap)
      end do

      forecast%seconds = end_of_all
      served = n_ranks*end_of_all
      forecast%efficiency = tasks%ends(ubound(tasks%ends, 1))/served
      forecast%drawing = drawing/served
      forecast%writing = writing/served
      forecast%idle = max(0.0_wp, 1.0_wp - forecast%efficiency - forecast%drawing - forecast%writing)
      forecast%counter_load = maxval(counter_busy)/end_of_all
      forecast%file_load = file_busy/end_of_all
   end subroutine simulate

   !> Moves the first of a heap of ranks down to its place; the rank with the earliest event is then the first.
   pure subroutine sift_down(time, n, heap)
      real(wp), intent(in) :: time(0:)
      integer, intent(in) :: n
      integer, intent(inout) :: heap(:)
      integer :: child, moved, parent

      if (n == 0) return
      parent = 1
      moved = heap(1)
      do
         child = 2*parent
         if (child > n) exit
         if (child < n) then
            if (time(heap(child + 1)) < time(heap(child))) child = child + 1
         end if
         if (time(heap(child)) >= time(moved)) exit
         heap(parent) = heap(child)
         parent = child
      end do
      heap(parent) = moved
   end subroutine sift_down
end module schedule_simulation
