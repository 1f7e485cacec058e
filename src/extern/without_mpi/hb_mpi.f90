!> Processes of one computer in the place of MPI, in a build without it (HB_MPI=OFF): the interface of `src/extern/hb_mpi.f90`.
!>
!> `start_workers` starts the processes, which are the ranks; without it this process is the only one. Collective calls and
!> counters use memory that they share. There is one communicator, that of all ranks. Source of the interfaces: hb_processes.h.
module hb_mpi
   use, intrinsic :: iso_c_binding, only: c_int, c_loc, c_null_ptr, c_ptr, c_size_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_text, only: parse_integer, to_text
   implicit none
   private
   public :: barrier, broadcast_integers, broadcast_text, comm_t, gather_rows, max_over, new_work_counter, rank_of, ranks_on_node, &
      share_error, size_of, start_mpi, start_workers, stop_mpi, sum_over, work_counter_t, world

   interface
      integer(c_int) function hb_start_processes(n, status) bind(c, name="hb_start_processes")
         import :: c_int
         integer(c_int), value :: n
         integer(c_int), intent(out) :: status
      end function hb_start_processes

      subroutine hb_note_end() bind(c, name="hb_note_end")
      end subroutine hb_note_end

      subroutine hb_wait_for_all() bind(c, name="hb_wait_for_all")
      end subroutine hb_wait_for_all

      subroutine hb_broadcast_bytes(bytes, n_bytes, root) bind(c, name="hb_broadcast_bytes")
         import :: c_int, c_ptr, c_size_t
         type(c_ptr), value :: bytes
         integer(c_size_t), value :: n_bytes
         integer(c_int), value :: root
      end subroutine hb_broadcast_bytes

      subroutine hb_gather_bytes(bytes, n_bytes, all) bind(c, name="hb_gather_bytes")
         import :: c_ptr, c_size_t
         type(c_ptr), value :: bytes, all
         integer(c_size_t), value :: n_bytes
      end subroutine hb_gather_bytes

      integer(c_int) function hb_add_to_counter(i, increment) bind(c, name="hb_add_to_counter")
         import :: c_int
         integer(c_int), value :: i, increment
      end function hb_add_to_counter

      integer(c_int) function hb_value_of_counter(i) bind(c, name="hb_value_of_counter")
         import :: c_int
         integer(c_int), value :: i
      end function hb_value_of_counter

      subroutine hb_clear_counter(i) bind(c, name="hb_clear_counter")
         import :: c_int
         integer(c_int), value :: i
      end subroutine hb_clear_counter
   end interface

   !> Returns the largest value of all ranks on every rank, an integer or a real number.
   interface max_over
      module procedure max_over_integer
      module procedure max_over_real
   end interface max_over

   integer, parameter :: max_workers = 1024                           ! HB_MAX_PROCESSES
   integer, parameter :: n_shared = 256                               ! HB_N_COUNTERS
   integer, parameter :: n_slots = 3                                  ! integers of a counter
   integer, parameter :: next_slot = 0, done_slot = 1, failed_slot = 2
   integer(c_size_t), parameter :: bytes_per_integer = storage_size(1)/8, bytes_per_real = storage_size(1.0_wp)/8

   !> The ranks; by default this process alone.
   type :: comm_t
      private
      integer :: n_ranks = 1
      integer :: rank = 0
   end type comm_t

   type(comm_t) :: everyone = comm_t()
   logical :: is_taken(0:(n_shared - mod(n_shared, n_slots))/n_slots - 1) = .false. ! the same on all ranks: made collectively

   !> Counters shared by all ranks: `next` returns each number of a counter once over all ranks.
   !>
   !> Each counter has two tallies, of the points done and of those among them that failed, which any rank can read at
   !> any time.
   type :: work_counter_t
      private
      integer, allocatable :: positions(:)             ! of each counter among those that are shared
      type(comm_t) :: comm
   contains
      procedure :: add_done => work_counter_add_done
      procedure :: destroy => work_counter_destroy
      procedure :: n_done => work_counter_n_done
      procedure :: next => work_counter_next
      procedure :: read_tallies => work_counter_read_tallies
   end type work_counter_t

contains

   !> Starts `n` processes that are the ranks of `world`. In each of them `status` is -1; in the calling process, after
   !> they have ended, it is the exit status with which it must end. Called before any work; 0 stands for no processes but
   !> this one.
   subroutine start_workers(n, status, error)
      integer, intent(in) :: n
      integer, intent(out) :: status
      type(error_t), allocatable, intent(out) :: error
      integer(c_int) :: rank, its_status
      integer :: n_launched

      status = -1
      n_launched = launched_processes()
      if (n_launched > 1) then
         call fail(error, "this nhbm was built without MPI, and mpirun would run it "//to_text(n_launched)// &
                   " times; give --workers "//to_text(n_launched)//" instead")
      else if (n > max_workers) then
         call fail(error, "--workers "//to_text(n)//" are more than "//to_text(max_workers)//" processes")
      end if
      if (allocated(error) .or. n <= 1) return
      rank = hb_start_processes(int(n, c_int), its_status)
      if (rank >= 0) then
         everyone = comm_t(n, int(rank))
      else if (rank == -1) then
         status = int(its_status)
      else
         call fail(error, "the system cannot start "//to_text(n)//" processes (error number "//to_text(int(its_status))// &
                   "); give fewer --workers")
      end if
   end subroutine start_workers

   !> Number of processes that mpirun, or a similar launcher, has started with this one; 1 without.
   integer function launched_processes() result(n)
      character(*), parameter :: variables(2) = [character(20) :: "OMPI_COMM_WORLD_SIZE", "PMI_SIZE"]
      character(20) :: text
      logical :: is_number
      integer :: i, status, found

      n = 1
      do i = 1, size(variables)
         call get_environment_variable(trim(variables(i)), text, status=status)
         if (status /= 0) cycle
         call parse_integer(trim(text), found, is_number)
         if (is_number) n = max(n, found)
      end do
   end function launched_processes

   !> Does nothing: `start_workers` has started the ranks.
   subroutine start_mpi()
   end subroutine start_mpi

   !> Notes that this rank ends as it should; safe to call twice.
   subroutine stop_mpi()
      call hb_note_end()
   end subroutine stop_mpi

   !> Returns the communicator of all ranks.
   type(comm_t) function world()
      world = everyone
   end function world

   !> Returns the number of this rank, from 0.
   integer function rank_of(comm)
      type(comm_t), intent(in) :: comm

      rank_of = comm%rank
   end function rank_of

   !> Returns the number of ranks.
   integer function size_of(comm)
      type(comm_t), intent(in) :: comm

      size_of = comm%n_ranks
   end function size_of

   !> Returns the number of ranks that share the memory of this rank's computer: all.
   integer function ranks_on_node(comm)
      type(comm_t), intent(in) :: comm

      ranks_on_node = comm%n_ranks
   end function ranks_on_node

   !> Waits for all ranks; collective.
   subroutine barrier(comm)
      type(comm_t), intent(in) :: comm

      if (comm%n_ranks > 1) call hb_wait_for_all()
   end subroutine barrier

   !> Copies the text of rank `root` (default 0) to every rank; an unallocated text remains unallocated. Collective.
   subroutine broadcast_text(comm, text, root)
      type(comm_t), intent(in) :: comm
      character(:), allocatable, intent(inout) :: text
      integer, intent(in), optional :: root
      character(:), allocatable, target :: copy
      integer, target :: length
      integer :: source

      if (comm%n_ranks == 1) return
      source = 0
      if (present(root)) source = root
      length = -1
      if (allocated(text)) length = len(text)
      call hb_broadcast_bytes(c_loc(length), bytes_per_integer, int(source, c_int))
      if (comm%rank == source .and. length > 0) then
         copy = text
         call hb_broadcast_bytes(c_loc(copy), int(length, c_size_t), int(source, c_int))
      else if (comm%rank /= source) then
         if (allocated(text)) deallocate (text)
         if (length < 0) return
         allocate (character(length) :: copy)
         if (length > 0) call hb_broadcast_bytes(c_loc(copy), int(length, c_size_t), int(source, c_int))
         call move_alloc(copy, text)
      end if
   end subroutine broadcast_text

   !> Copies the integers of rank 0 to every rank, as many as it has. Collective.
   subroutine broadcast_integers(comm, values)
      type(comm_t), intent(in) :: comm
      integer, allocatable, intent(inout), target :: values(:)
      integer, target :: n

      if (comm%n_ranks == 1) then
         if (.not. allocated(values)) allocate (values(0))
         return
      end if
      n = 0
      if (allocated(values)) n = size(values)
      call hb_broadcast_bytes(c_loc(n), bytes_per_integer, 0_c_int)
      if (comm%rank > 0) then
         if (allocated(values)) deallocate (values)
         allocate (values(n))
      end if
      if (n > 0) call hb_broadcast_bytes(c_loc(values), n*bytes_per_integer, 0_c_int)
   end subroutine broadcast_integers

   !> Gives the values of all ranks on every rank.
   function integers_of(comm, value) result(values)
      type(comm_t), intent(in) :: comm
      integer, intent(in), target :: value
      integer, target :: values(comm%n_ranks)

      values = value
      if (comm%n_ranks > 1) call hb_gather_bytes(c_loc(value), bytes_per_integer, c_loc(values))
   end function integers_of

   !> Returns the sum of `value` over all ranks on every rank; collective.
   integer function sum_over(comm, value)
      type(comm_t), intent(in) :: comm
      integer, intent(in) :: value

      sum_over = sum(integers_of(comm, value))
   end function sum_over

   !> Returns the largest `value` of all ranks on every rank; collective.
   integer function max_over_integer(comm, value) result(largest)
      type(comm_t), intent(in) :: comm
      integer, intent(in) :: value

      largest = maxval(integers_of(comm, value))
   end function max_over_integer

   !> Returns the largest `value` of all ranks on every rank; collective.
   real(wp) function max_over_real(comm, value) result(largest)
      type(comm_t), intent(in) :: comm
      real(wp), intent(in), target :: value
      real(wp), target :: values(comm%n_ranks)

      values = value
      if (comm%n_ranks > 1) call hb_gather_bytes(c_loc(value), bytes_per_real, c_loc(values))
      largest = maxval(values)
   end function max_over_real

   !> Returns the values of all ranks on rank 0, (n_values, n_ranks); elsewhere the table has no columns. Collective.
   subroutine gather_rows(comm, values, table)
      type(comm_t), intent(in) :: comm
      real(wp), intent(in) :: values(:)                !! the same number on all ranks
      real(wp), allocatable, intent(out), target :: table(:, :)
      real(wp), allocatable, target :: row(:)
      type(c_ptr) :: all

      allocate (table(size(values), merge(comm%n_ranks, 0, comm%rank == 0)))
      allocate (row(size(values)), source=values)
      if (size(values) == 0) return
      if (comm%n_ranks == 1) then
         table(:, 1) = values
         return
      end if
      all = c_null_ptr
      if (comm%rank == 0) all = c_loc(table)
      call hb_gather_bytes(c_loc(row), size(values)*bytes_per_real, all)
   end subroutine gather_rows

   !> Shares an error of any rank: afterwards all ranks have the error of the lowest rank that had one, or none has.
   !> Collective.
   subroutine share_error(comm, error)
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(inout) :: error
      character(:), allocatable :: message
      integer :: mine, first

      mine = size_of(comm)
      if (allocated(error)) mine = rank_of(comm)
      first = -max_over(comm, -mine)
      if (first == size_of(comm)) return
      message = ""
      if (rank_of(comm) == first) message = error%message
      call broadcast_text(comm, message, root=first)
      call fail(error, message)
   end subroutine share_error

   !> Creates counters at 0 with empty tallies, shared by the ranks of `comm`; collective, as `destroy` is.
   subroutine new_work_counter(self, owners, comm, error)
      type(work_counter_t), intent(out) :: self
      integer, intent(in) :: owners(:)                 !! as many as counters; no rank owns one here
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      integer :: i, slot

      self%comm = comm
      allocate (self%positions(0))
      if (count(.not. is_taken) < size(owners)) then
         call fail(error, "shared work counter: more than "//to_text(size(is_taken))//" counters")
         return
      end if
      do i = 1, size(owners)
         self%positions = [self%positions, findloc(is_taken, .false., dim=1) - 1]
         is_taken(self%positions(i)) = .true.
         if (comm%rank > 0) cycle
         do slot = 0, n_slots - 1
            call hb_clear_counter(address(self, i, slot))
         end do
      end do
      call barrier(comm)
   end subroutine new_work_counter

   !> Returns the first of the next `n` numbers of a counter, from 0; every number is returned once over all ranks.
   integer function work_counter_next(self, counter, n) result(number)
      class(work_counter_t), intent(in) :: self
      integer, intent(in) :: counter                   !! from 1
      integer, intent(in) :: n                         !! 1 or more

      number = int(hb_add_to_counter(address(self, counter, next_slot), int(n, c_int)))
   end function work_counter_next

   !> Adds to the tallies of a counter.
   subroutine work_counter_add_done(self, counter, done, failed)
      class(work_counter_t), intent(in) :: self
      integer, intent(in) :: counter                   !! from 1
      integer, intent(in) :: done                      !! points
      integer, intent(in) :: failed                    !! points among them
      integer(c_int) :: before

      before = hb_add_to_counter(address(self, counter, done_slot), int(done, c_int)) ! first: no rank sees failed > done
      if (failed > 0) before = hb_add_to_counter(address(self, counter, failed_slot), int(failed, c_int))
   end subroutine work_counter_add_done

   !> Reads how many points are done over all ranks, and how many of them failed; any rank, at any time.
   subroutine work_counter_read_tallies(self, done, failed)
      class(work_counter_t), intent(in) :: self
      integer, intent(out) :: done, failed
      integer :: i

      done = 0
      failed = 0
      do i = 1, size(self%positions)
         failed = failed + int(hb_value_of_counter(address(self, i, failed_slot))) ! before done, so that failed <= done
         done = done + self%n_done(i)
      end do
   end subroutine work_counter_read_tallies

   !> Reads the number of points done of one counter; any rank, at any time.
   integer function work_counter_n_done(self, counter)
      class(work_counter_t), intent(in) :: self
      integer, intent(in) :: counter                   !! from 1

      work_counter_n_done = int(hb_value_of_counter(address(self, counter, done_slot)))
   end function work_counter_n_done

   !> Number of an integer of a counter among those that are shared, from 0.
   pure integer(c_int) function address(self, counter, slot)
      class(work_counter_t), intent(in) :: self
      integer, intent(in) :: counter                   !! from 1
      integer, intent(in) :: slot

      address = int(n_slots*self%positions(counter) + slot, c_int)
   end function address

   !> Gives the counters back; collective, safe to call twice.
   subroutine work_counter_destroy(self)
      class(work_counter_t), intent(inout) :: self

      if (.not. allocated(self%positions)) return
      call barrier(self%comm)                          ! no rank uses them any more
      is_taken(self%positions) = .false.
      deallocate (self%positions)
   end subroutine work_counter_destroy
end module hb_mpi
