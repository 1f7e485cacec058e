!> Tests on several processes. Each runs on a communicator of the first `npes` processes, the others wait in
!> the collection of the messages, which ends the test on all of them.
module runner_mpi
   use, intrinsic :: ieee_exceptions, only: ieee_all, ieee_get_status, ieee_set_halting_mode, ieee_set_status, ieee_status_type
   use mpi, only: MPI_Allreduce, MPI_Bcast, MPI_CHARACTER, MPI_Comm_free, MPI_COMM_NULL, MPI_Comm_rank, MPI_Comm_size, &
      MPI_Comm_split, MPI_COMM_WORLD, MPI_Finalize, MPI_Gather, MPI_Gatherv, MPI_Init, MPI_INTEGER, MPI_LOGICAL, MPI_LOR, &
      MPI_UNDEFINED
   use runner_cases, only: AbstractTestParameter, ParameterizedTestCase
   use runner_exceptions, only: anyExceptions, take_report, throw
   use runner_session, only: is_selected, print_totals, read_command_line, record_test, set_root, start_test
   implicit none
   private
   public :: MpiTestCase, MpiTestMethod, MpiTestParameter
   public :: finish_run, start_run
   public :: runner_any_failed, runner_enter, runner_finish_mpi, runner_run_mpi, runner_takes_part, &
      runner_wants_mpi

   !> Fixture with a communicator, valid from `setUp` to `tearDown`.
   type, abstract, extends(ParameterizedTestCase) :: MpiTestCase
      private
      integer :: communicator = MPI_COMM_NULL
   contains
      procedure :: getMpiCommunicator
      procedure :: getNumProcesses
      procedure :: getProcessRank
   end type MpiTestCase

   !> What a test procedure with `@test(npes=[...])` and no own fixture gets.
   type, extends(MpiTestCase) :: MpiTestMethod
   end type MpiTestMethod

   !> Parameter of an MPI case. The component is public and has no default, as in pFUnit: structure
   !> constructors of extending types begin with it.
   type, extends(AbstractTestParameter) :: MpiTestParameter
      integer :: numProcessesRequested
   contains
      procedure :: setNumProcessesRequested
      procedure :: getNumProcessesRequested
      procedure :: toString
   end type MpiTestParameter

   abstract interface
      subroutine mpi_procedure(this)
         import :: MpiTestMethod
         class(MpiTestMethod), intent(inout) :: this
      end subroutine mpi_procedure
   end interface

contains

   !> Communicator of the processes that run the test.
   integer function getMpiCommunicator(this)
      class(MpiTestCase), intent(in) :: this
      getMpiCommunicator = this%communicator
   end function getMpiCommunicator

   !> Number of processes that run the test.
   integer function getNumProcesses(this)
      class(MpiTestCase), intent(in) :: this
      integer :: ierror

      call MPI_Comm_size(this%communicator, getNumProcesses, ierror)
   end function getNumProcesses

   !> Rank of this process among them, from 0.
   integer function getProcessRank(this)
      class(MpiTestCase), intent(in) :: this
      integer :: ierror

      call MPI_Comm_rank(this%communicator, getProcessRank, ierror)
   end function getProcessRank

   pure subroutine setNumProcessesRequested(this, numProcessesRequested)
      class(MpiTestParameter), intent(inout) :: this
      integer, intent(in) :: numProcessesRequested
      this%numProcessesRequested = numProcessesRequested
   end subroutine setNumProcessesRequested

   pure integer function getNumProcessesRequested(this)
      class(MpiTestParameter), intent(in) :: this
      getNumProcessesRequested = this%numProcessesRequested
   end function getNumProcessesRequested

   !> Empty, to be overridden where there is more to tell than the number of processes.
   function toString(this) result(string)
      class(MpiTestParameter), intent(in) :: this
      character(:), allocatable :: string

      string = ""
      if (.not. same_type_as(this, this)) string = "never"      ! an unused argument would be a warning
   end function toString

   !> Begin of an MPI executable.
   subroutine start_run()
      integer :: ierror, rank
      type(ieee_status_type) :: floating_point

      call ieee_get_status(floating_point)
      call ieee_set_halting_mode(ieee_all, .false.)             ! Open MPI 5 divides by zero when it looks for networks
      call MPI_Init(ierror)
      call ieee_set_status(floating_point)
      call MPI_Comm_rank(MPI_COMM_WORLD, rank, ierror)
      call set_root(rank == 0)
      call read_command_line()
   end subroutine start_run

   !> End of an MPI executable: totals, and status 2 on every process if a test has failed.
   subroutine finish_run()
      integer :: ierror, rank
      logical :: has_failed

      call MPI_Comm_rank(MPI_COMM_WORLD, rank, ierror)
      has_failed = .false.
      if (rank == 0) call print_totals(has_failed)
      call MPI_Bcast(has_failed, 1, MPI_LOGICAL, 0, MPI_COMM_WORLD, ierror)
      call MPI_Finalize(ierror)
      if (has_failed) stop 2, quiet=.true.
   end subroutine finish_run

   !> Run a test procedure on `npes` processes.
   subroutine runner_run_mpi(label, npes, method, before, after)
      character(*), intent(in) :: label
      integer, intent(in) :: npes
      procedure(mpi_procedure) :: method
      procedure(mpi_procedure), optional :: before, after
      type(MpiTestMethod) :: test

      if (.not. runner_wants_mpi(label, npes)) return
      call runner_enter(test, npes)
      if (runner_takes_part(test)) then
         if (present(before)) call before(test)
         if (.not. runner_any_failed(test)) then
            call method(test)
            if (present(after)) call after(test)
         end if
      end if
      call runner_finish_mpi(test)
   end subroutine runner_run_mpi

   !> True, on all processes alike, if the test is to be run; it is then the running test.
   logical function runner_wants_mpi(label, npes)
      character(*), intent(in) :: label
      integer, intent(in) :: npes
      character(20) :: number

      write (number, "(i0)") npes
      runner_wants_mpi = is_selected(label//" (npes="//trim(number)//")")
      if (runner_wants_mpi) call start_test(label//" (npes="//trim(number)//")")
   end function runner_wants_mpi

   !> Give the first `npes` processes their communicator; too few processes are a failure, and no process
   !> takes part.
   subroutine runner_enter(this, npes)
      class(MpiTestCase), intent(inout) :: this
      integer, intent(in) :: npes
      integer :: color, ierror, n_processes, rank

      call MPI_Comm_size(MPI_COMM_WORLD, n_processes, ierror)
      call MPI_Comm_rank(MPI_COMM_WORLD, rank, ierror)
      if (npes > n_processes) then
         if (rank == 0) call throw("Insufficient processes to run this test.")
         this%communicator = MPI_COMM_NULL
         return
      end if
      color = merge(0, MPI_UNDEFINED, rank < npes)
      call MPI_Comm_split(MPI_COMM_WORLD, color, rank, this%communicator, ierror)
   end subroutine runner_enter

   !> True on the processes that run the test.
   logical function runner_takes_part(this)
      class(MpiTestCase), intent(in) :: this
      runner_takes_part = this%communicator /= MPI_COMM_NULL
   end function runner_takes_part

   !> True on all processes of the test if one of them has failed. Collective.
   logical function runner_any_failed(this)
      class(MpiTestCase), intent(in) :: this
      integer :: ierror

      call MPI_Allreduce(anyExceptions(), runner_any_failed, 1, MPI_LOGICAL, MPI_LOR, this%communicator, &
         ierror)
   end function runner_any_failed

   !> End of the running test: collects the messages on rank 0. Collective over all processes of the run.
   subroutine runner_finish_mpi(this)
      class(MpiTestCase), intent(inout) :: this
      character(:), allocatable :: all_reports, report
      character(20) :: suffix
      integer, allocatable :: lengths(:), offsets(:)
      integer :: i, ierror, n_processes, rank

      if (this%communicator /= MPI_COMM_NULL) call MPI_Comm_free(this%communicator, ierror)
      call MPI_Comm_size(MPI_COMM_WORLD, n_processes, ierror)
      call MPI_Comm_rank(MPI_COMM_WORLD, rank, ierror)
      write (suffix, "(a, i0, a)") " (PE=", rank, ")"
      call take_report(report, trim(suffix))
      allocate (lengths(n_processes), offsets(n_processes), source=0)
      call MPI_Gather([len(report)], 1, MPI_INTEGER, lengths, 1, MPI_INTEGER, 0, MPI_COMM_WORLD, ierror)
      offsets = [(sum(lengths(:i - 1)), i=1, n_processes)]
      allocate (character(sum(lengths)) :: all_reports)
      call MPI_Gatherv(report, len(report), MPI_CHARACTER, all_reports, lengths, offsets, MPI_CHARACTER, 0, &
         MPI_COMM_WORLD, ierror)
      if (rank == 0) call record_test(all_reports)
   end subroutine runner_finish_mpi
end module runner_mpi
