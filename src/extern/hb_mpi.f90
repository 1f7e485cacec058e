!> All calls of MPI. A build without MPI has another module of this name, in `without_mpi/`.
!>
!> In the order of use: `start_mpi`, `world`, `rank_of` and `size_of`, the collective calls, a `work_counter_t` that
!> distributes points, `stop_mpi`. All take the communicator as an argument, so that a test can pass its own. A process that
!> no launcher has started does not start MPI, which would take longer than many a run: its communicator is MPI_COMM_NULL,
!> of this process alone, and each call returns what one rank would get. Source:
!> MPI: A Message-Passing Interface Standard 3.1, chapters 5 (collective) and 11 (one-sided).
module hb_mpi
   use, intrinsic :: ieee_exceptions, only: ieee_all, ieee_get_status, ieee_set_halting_mode, ieee_set_status, ieee_status_type
   use, intrinsic :: iso_c_binding, only: c_char, c_f_pointer, c_long_long, c_null_char, c_ptr
   use, intrinsic :: iso_fortran_env, only: int64
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_text, only: to_text
   use mpi_f08, only: comm_t => MPI_Comm, MPI_ADDRESS_KIND, MPI_Allreduce, MPI_Barrier, MPI_Bcast, MPI_CHARACTER, &
      MPI_Comm_dup, MPI_Comm_free, MPI_COMM_NULL, MPI_Comm_rank, MPI_Comm_set_errhandler, MPI_Comm_size, &
      MPI_Comm_split_type, MPI_COMM_TYPE_SHARED, MPI_COMM_WORLD, MPI_DOUBLE_PRECISION, MPI_Error_string, &
      MPI_ERRORS_ARE_FATAL, MPI_ERRORS_RETURN, MPI_Fetch_and_op, MPI_Finalize, MPI_Finalized, MPI_Gather, &
      MPI_Get_library_version, MPI_INFO_NULL, MPI_Init, MPI_Initialized, MPI_INTEGER, MPI_LOCK_EXCLUSIVE, MPI_MAX, &
      MPI_MAX_ERROR_STRING, MPI_MAX_LIBRARY_VERSION_STRING, MPI_MIN, MPI_NO_OP, MPI_SUCCESS, MPI_SUM, MPI_Win, &
      MPI_Win_allocate, MPI_Win_flush, MPI_Win_free, MPI_Win_lock, MPI_Win_lock_all, MPI_WIN_NULL, &
      MPI_Win_set_errhandler, MPI_Win_unlock, MPI_Win_unlock_all, operator(/=), operator(==)
   implicit none
   private
   public :: barrier, broadcast_integers, broadcast_text, comm_handle, comm_t, gather_rows, is_alone, max_over, &
      new_work_counter, no_info_handle, rank_of, ranks_on_node, share_error, size_of, start_mpi, start_workers, stop_mpi, &
      sum_over, work_counter_t, world

   interface
      subroutine hb_set_default(name, value) bind(c, name="hb_set_default")
         import :: c_char
         character(c_char), intent(in) :: name(*), value(*)
      end subroutine hb_set_default

      !> Source: hb_files.h.
      integer(c_long_long) function hb_free_bytes(path) bind(c, name="hb_free_bytes")
         import :: c_char, c_long_long
         character(c_char), intent(in) :: path(*)
      end function hb_free_bytes
   end interface

   !> Returns the largest value of all ranks on every rank, an integer or a real number.
   interface max_over
      module procedure max_over_integer
      module procedure max_over_real
   end interface max_over

   !> Variables that launchers set for each process: mpirun of Open MPI, of MPICH and Intel MPI, of MVAPICH, srun, jsrun, flux,
   !> aprun, and those of PMIx and PALS.
   character(*), parameter :: launched_by(*) = [character(22) :: "OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK", "PMI_SIZE", &
      "MPI_LOCALRANKID", "MV2_COMM_WORLD_RANK", "SLURM_STEP_ID", "JSM_NAMESPACE_RANK", "FLUX_TASK_RANK", "ALPS_APP_PE", &
      "PALS_RANKID"]

   integer, parameter :: n_slots = 3                                  ! integers in the window of an owner
   integer(MPI_ADDRESS_KIND), parameter :: next_slot = 0, done_slot = 1, failed_slot = 2

   !> Counters shared by all ranks: `next` returns each number of a counter once over all ranks, without a dedicated
   !> server rank.
   !>
   !> Each counter has two tallies, of the points done and of those among them that failed, which any rank can read at
   !> any time. A counter is stored on one rank, its owner. On one node it is in shared memory and can be accessed
   !> while the owner computes; between nodes that needs a network with remote atomics, and without one a request
   !> waits for the next MPI call of the owner, for example its own `next`.
   type :: work_counter_t
      private
      integer, allocatable :: owners(:)                ! owner of each counter
      integer, pointer :: own(:) => null()             ! the slots of a process that is alone
      type(MPI_Win) :: window = MPI_WIN_NULL
      type(comm_t) :: comm = MPI_COMM_NULL             ! own copy, so that errors can be returned
   contains
      procedure :: add_done => work_counter_add_done
      procedure :: destroy => work_counter_destroy
      procedure :: n_done => work_counter_n_done
      procedure :: next => work_counter_next
      procedure :: read_tallies => work_counter_read_tallies
   end type work_counter_t

contains

   !> Fails if `n`, the number of processes that nhbm would start itself, is not 0: mpirun does it. In a build without MPI
   !> the status is not -1 in the process that has started others, but the exit status with which it must end.
   subroutine start_workers(n, status, error)
      integer, intent(in) :: n
      integer, intent(out) :: status
      type(error_t), allocatable, intent(out) :: error

      status = -1
      if (n > 0) call fail(error, "this nhbm was built with MPI: instead of --workers "//to_text(n)//" give mpirun -n "// &
                           to_text(n)//" nhbm ...")
   end subroutine start_workers

   !> Starts MPI if a launcher (mpirun, srun ...) has started this process, possibly with others, unless MPI runs.
   subroutine start_mpi()
      logical :: is_started
      type(ieee_status_type) :: floating_point

      call MPI_Initialized(is_started)
      if (is_started .or. .not. is_launched()) return
      ! OMPIO opens an unused shared file pointer, by default through a semaphore of the machine with the name of the file: a
      ! leftover one would hang the run. ROMIO opens none before it is used; Open MPI has none from version 6 on, and there
      ! the pointer is made of files beside the result, which a killed run leaves.
      if (has_romio()) then
         call hb_set_default("OMPI_MCA_io"//c_null_char, "^ompio"//c_null_char)
      else
         call hb_set_default("OMPI_MCA_sharedfp"//c_null_char, "individual"//c_null_char)
      end if
      call hb_set_default("HOME"//c_null_char, "/"//c_null_char)       ! without one, Open MPI 5 ends the process
      call ieee_get_status(floating_point)
      call ieee_set_halting_mode(ieee_all, .false.)                   ! Open MPI 5 divides by zero when it looks for networks
      call MPI_Init()
      call ieee_set_status(floating_point)
   end subroutine start_mpi

   !> Whether MPI is an Open MPI with ROMIO beside its own OMPIO: before version 6. Other kinds do not read its settings.
   logical function has_romio()
      character(*), parameter :: begin = "Open MPI v"
      character(MPI_MAX_LIBRARY_VERSION_STRING) :: version
      integer :: length, major, status

      call MPI_Get_library_version(version, length)                    ! the standard permits it before MPI_Init
      has_romio = index(version, begin) == 1
      if (.not. has_romio) return
      read (version(len(begin) + 1:len(begin) + scan(version(len(begin) + 1:), ".") - 1), *, iostat=status) major
      has_romio = status == 0
      if (has_romio) has_romio = major < 6
   end function has_romio

   logical function is_launched()
      integer :: i, status

      is_launched = .false.
      do i = 1, size(launched_by)
         call get_environment_variable(trim(launched_by(i)), status=status)
         is_launched = is_launched .or. status /= 1                   ! 1: there is no such variable
      end do
   end function is_launched

   !> Ends MPI if it runs; the last MPI call of a program, safe to call twice.
   subroutine stop_mpi()
      if (is_running()) call MPI_Finalize()
   end subroutine stop_mpi

   logical function is_running()
      logical :: is_started, is_stopped

      call MPI_Initialized(is_started)
      call MPI_Finalized(is_stopped)
      is_running = is_started .and. .not. is_stopped
   end function is_running

   !> Returns the communicator of all ranks.
   type(comm_t) function world()
      world = MPI_COMM_NULL
      if (is_running()) world = MPI_COMM_WORLD
   end function world

   !> Whether a communicator is that of a process without MPI.
   logical function is_alone(comm)
      type(comm_t), intent(in) :: comm

      is_alone = comm == MPI_COMM_NULL
   end function is_alone

   !> Gives the integer handle of a communicator, for libraries with an older interface.
   pure integer function comm_handle(comm)
      type(comm_t), intent(in) :: comm

      comm_handle = comm%MPI_VAL
   end function comm_handle

   !> Returns the integer handle of the empty info object, for libraries with an older interface.
   integer function no_info_handle()
      no_info_handle = MPI_INFO_NULL%MPI_VAL
   end function no_info_handle

   !> Returns the number of this rank, from 0.
   integer function rank_of(comm)
      type(comm_t), intent(in) :: comm

      rank_of = 0
      if (.not. is_alone(comm)) call MPI_Comm_rank(comm, rank_of)
   end function rank_of

   !> Returns the number of ranks.
   integer function size_of(comm)
      type(comm_t), intent(in) :: comm

      size_of = 1
      if (.not. is_alone(comm)) call MPI_Comm_size(comm, size_of)
   end function size_of

   !> Returns the number of ranks that share the memory of this rank's computer.
   integer function ranks_on_node(comm)
      type(comm_t), intent(in) :: comm
      type(comm_t) :: node

      ranks_on_node = 1
      if (is_alone(comm)) return
      call MPI_Comm_split_type(comm, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, node)
      call MPI_Comm_size(node, ranks_on_node)
      call MPI_Comm_free(node)
   end function ranks_on_node

   !> Waits for all ranks; collective.
   subroutine barrier(comm)
      type(comm_t), intent(in) :: comm

      if (.not. is_alone(comm)) call MPI_Barrier(comm)
   end subroutine barrier

   !> Copies the text of rank `root` (default 0) to every rank; an unallocated text remains unallocated. Collective.
   subroutine broadcast_text(comm, text, root)
      type(comm_t), intent(in) :: comm
      character(:), allocatable, intent(inout) :: text
      integer, intent(in), optional :: root
      integer :: source, length

      if (is_alone(comm)) return
      source = 0
      if (present(root)) source = root
      length = -1
      if (allocated(text)) length = len(text)
      call MPI_Bcast(length, 1, MPI_INTEGER, source, comm)
      if (rank_of(comm) /= source) then
         if (allocated(text)) deallocate (text)
         if (length >= 0) allocate (character(length) :: text)
      end if
      if (length > 0) call MPI_Bcast(text, length, MPI_CHARACTER, source, comm)
   end subroutine broadcast_text

   !> Copies the integers of rank 0 to every rank, as many as it has. Collective.
   subroutine broadcast_integers(comm, values)
      type(comm_t), intent(in) :: comm
      integer, allocatable, intent(inout) :: values(:)
      integer :: n

      if (is_alone(comm)) then
         if (.not. allocated(values)) allocate (values(0))
         return
      end if
      n = 0
      if (allocated(values)) n = size(values)
      call MPI_Bcast(n, 1, MPI_INTEGER, 0, comm)
      if (rank_of(comm) > 0) then
         if (allocated(values)) deallocate (values)
         allocate (values(n))
      end if
      call MPI_Bcast(values, n, MPI_INTEGER, 0, comm)
   end subroutine broadcast_integers

   !> Returns the sum of `value` over all ranks on every rank; collective.
   integer function sum_over(comm, value)
      type(comm_t), intent(in) :: comm
      integer, intent(in) :: value

      sum_over = value
      if (is_alone(comm)) return
      call MPI_Allreduce(value, sum_over, 1, MPI_INTEGER, MPI_SUM, comm)
   end function sum_over

   !> Returns the largest `value` of all ranks on every rank; collective.
   integer function max_over_integer(comm, value) result(largest)
      type(comm_t), intent(in) :: comm
      integer, intent(in) :: value

      largest = value
      if (is_alone(comm)) return
      call MPI_Allreduce(value, largest, 1, MPI_INTEGER, MPI_MAX, comm)
   end function max_over_integer

   !> Returns the largest `value` of all ranks on every rank; collective.
   real(wp) function max_over_real(comm, value) result(largest)
      type(comm_t), intent(in) :: comm
      real(wp), intent(in) :: value

      largest = value
      if (is_alone(comm)) return
      call MPI_Allreduce(value, largest, 1, MPI_DOUBLE_PRECISION, MPI_MAX, comm)
   end function max_over_real

   !> Returns the values of all ranks on rank 0, (n_values, n_ranks); elsewhere the table has no columns. Collective.
   subroutine gather_rows(comm, values, table)
      type(comm_t), intent(in) :: comm
      real(wp), intent(in) :: values(:)                !! the same number on all ranks
      real(wp), allocatable, intent(out) :: table(:, :)

      allocate (table(size(values), merge(size_of(comm), 0, rank_of(comm) == 0)))
      if (is_alone(comm)) then
         table(:, 1) = values
         return
      end if
      call MPI_Gather(values, size(values), MPI_DOUBLE_PRECISION, table, size(values), MPI_DOUBLE_PRECISION, 0, comm)
   end subroutine gather_rows

   !> Shares an error of any rank: afterwards all ranks have the error of the lowest rank that had one, or none has.
   !> Collective.
   subroutine share_error(comm, error)
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(inout) :: error
      character(:), allocatable :: message
      integer :: mine, first

      if (is_alone(comm)) return
      mine = size_of(comm)
      if (allocated(error)) mine = rank_of(comm)
      call MPI_Allreduce(mine, first, 1, MPI_INTEGER, MPI_MIN, comm)
      if (first == size_of(comm)) return
      if (rank_of(comm) == first) message = error%message
      call broadcast_text(comm, message, root=first)
      call fail(error, message)
   end subroutine share_error

   !> Creates counters at 0 with empty tallies, shared by the ranks of `comm`; collective, as `destroy` is.
   subroutine new_work_counter(self, owners, comm, error)
      type(work_counter_t), intent(out) :: self
      integer, intent(in) :: owners(:)                 !! ranks, from 0, that store a counter each; all different
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: bytes_per_integer = storage_size(1)/8
      integer, pointer :: slots(:)
      integer(MPI_ADDRESS_KIND) :: n_bytes
      type(c_ptr) :: memory
      integer :: rank, status

      self%owners = owners
      if (is_alone(comm)) then
         allocate (self%own(n_slots), source=0)
         return
      end if
      call check_shared_memory(comm, error)
      if (allocated(error)) return
      rank = rank_of(comm)
      call MPI_Comm_dup(comm, self%comm, status)
      if (status == MPI_SUCCESS) then
         call MPI_Comm_set_errhandler(self%comm, MPI_ERRORS_RETURN)
         n_bytes = 0
         if (any(owners == rank)) n_bytes = n_slots*bytes_per_integer
         call MPI_Win_allocate(n_bytes, bytes_per_integer, MPI_INFO_NULL, self%comm, memory, self%window, &
                               status)
      end if
      if (status /= MPI_SUCCESS) call fail(error, "shared work counter: "//mpi_text(status))
      call share_error(comm, error)
      if (allocated(error)) return

      ! From here on a failure is one of the machine and ends the run, because next() cannot return it.
      call MPI_Win_set_errhandler(self%window, MPI_ERRORS_ARE_FATAL)
      if (any(owners == rank)) then
         call MPI_Win_lock(MPI_LOCK_EXCLUSIVE, rank, 0, self%window)
         call c_f_pointer(memory, slots, [n_slots])
         slots = 0
         call MPI_Win_unlock(rank, self%window)
      end if
      call MPI_Barrier(comm)
      call MPI_Win_lock_all(0, self%window)
   end subroutine new_work_counter

   !> Fails if shared memory of one of the machines is used up: the window would then fail on one rank alone, and the others would
   !> wait for it. Open MPI and MPICH have its file in /dev/shm; where there is none, or another folder was requested, nothing is
   !> known.
   subroutine check_shared_memory(comm, error)
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      integer(c_long_long), parameter :: bytes_of_window = 65536_c_long_long, bytes_of_rank = 8192_c_long_long
      character(*), parameter :: folder = "/dev/shm"
      integer(c_long_long) :: free, needed
      integer :: length

      needed = bytes_of_window + bytes_of_rank*ranks_on_node(comm)
      free = hb_free_bytes(folder//c_null_char)
      call get_environment_variable("OMPI_MCA_osc_sm_backing_directory", length=length)
      if (free >= 0_c_long_long .and. free < needed .and. length == 0) &
         call fail(error, "shared work counter: "//folder//" has "//to_text(int(free/1024))//" kB left, and needs "// &
                   to_text(int(needed/1024))//" kB for the ranks of this machine; remove files there, give it more room "// &
                   "(in a container --shm-size), or run on one rank")
      call share_error(comm, error)
   end subroutine check_shared_memory

   !> Returns the first of the next `n` numbers of a counter, from 0; every number is returned once over all ranks.
   integer function work_counter_next(self, counter, n) result(number)
      class(work_counter_t), intent(in) :: self
      integer, intent(in) :: counter                   !! from 1
      integer, intent(in) :: n                         !! 1 or more

      number = fetch_and_add(self, self%owners(counter), next_slot, n)
   end function work_counter_next

   !> Adds to the tallies of a counter.
   subroutine work_counter_add_done(self, counter, done, failed)
      class(work_counter_t), intent(in) :: self
      integer, intent(in) :: counter                   !! from 1
      integer, intent(in) :: done                      !! points
      integer, intent(in) :: failed                    !! points among them
      integer :: before

      before = fetch_and_add(self, self%owners(counter), done_slot, done) ! first: no rank sees failed > done
      if (failed > 0) before = fetch_and_add(self, self%owners(counter), failed_slot, failed)
   end subroutine work_counter_add_done

   !> Reads how many points are done over all ranks, and how many of them failed; any rank, at any time.
   subroutine work_counter_read_tallies(self, done, failed)
      class(work_counter_t), intent(in) :: self
      integer, intent(out) :: done, failed
      integer :: i

      done = 0
      failed = 0
      do i = 1, size(self%owners)
         failed = failed + fetch(self, self%owners(i), failed_slot)       ! before done, so that failed <= done
         done = done + self%n_done(i)
      end do
   end subroutine work_counter_read_tallies

   !> Reads the number of points done of one counter; any rank, at any time.
   integer function work_counter_n_done(self, counter)
      class(work_counter_t), intent(in) :: self
      integer, intent(in) :: counter                   !! from 1

      work_counter_n_done = fetch(self, self%owners(counter), done_slot)
   end function work_counter_n_done

   integer function fetch_and_add(self, owner, slot, increment) result(before)
      class(work_counter_t), intent(in) :: self
      integer, intent(in) :: owner
      integer(MPI_ADDRESS_KIND), intent(in) :: slot
      integer, intent(in) :: increment
      integer, asynchronous :: addend, found           ! MPI may access both until the flush

      if (associated(self%own)) then
         before = self%own(slot + 1)
         self%own(slot + 1) = before + increment
         return
      end if
      addend = increment
      call MPI_Fetch_and_op(addend, found, MPI_INTEGER, owner, slot, MPI_SUM, self%window)
      call MPI_Win_flush(owner, self%window)
      before = found
   end function fetch_and_add

   integer function fetch(self, owner, slot) result(value)
      class(work_counter_t), intent(in) :: self
      integer, intent(in) :: owner
      integer(MPI_ADDRESS_KIND), intent(in) :: slot
      integer, asynchronous :: nothing, found

      if (associated(self%own)) then
         value = self%own(slot + 1)
         return
      end if
      nothing = 0
      call MPI_Fetch_and_op(nothing, found, MPI_INTEGER, owner, slot, MPI_NO_OP, self%window)
      call MPI_Win_flush(owner, self%window)
      value = found
   end function fetch

   !> Frees the window; collective, safe to call twice.
   subroutine work_counter_destroy(self)
      class(work_counter_t), intent(inout) :: self

      if (associated(self%own)) deallocate (self%own)
      if (.not. is_running()) return
      if (self%window /= MPI_WIN_NULL) then
         call MPI_Win_unlock_all(self%window)
         call MPI_Win_free(self%window)
      end if
      if (self%comm /= MPI_COMM_NULL) call MPI_Comm_free(self%comm)
   end subroutine work_counter_destroy

   function mpi_text(status) result(text)
      integer, intent(in) :: status
      character(:), allocatable :: text
      character(MPI_MAX_ERROR_STRING) :: buffer
      integer :: length

      call MPI_Error_string(status, buffer, length)
      text = buffer(:length)
   end function mpi_text
end module hb_mpi
