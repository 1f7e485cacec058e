!> A flag that all ranks see: any rank raises it at any time, without the others waiting for it.
!> Source: MPI: A Message-Passing Interface Standard 3.1, chapter 11 (one-sided). It stands in the memory of rank 0; what
!> `hb_mpi` says of its work counter on several nodes holds here too.
module hb_shared_flag
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_ptr
   use hb_error, only: error_t, fail
   use hb_mpi, only: barrier, comm_t, rank_of, share_error
   use mpi_f08, only: MPI_ADDRESS_KIND, MPI_Comm_dup, MPI_Comm_free, MPI_COMM_NULL, MPI_Comm_set_errhandler, &
      MPI_ERRORS_ARE_FATAL, MPI_ERRORS_RETURN, MPI_Fetch_and_op, MPI_Finalized, MPI_INFO_NULL, MPI_INTEGER, &
      MPI_LOCK_EXCLUSIVE, MPI_NO_OP, MPI_Op, MPI_REPLACE, MPI_SUCCESS, MPI_Win, MPI_Win_allocate, MPI_Win_flush, &
      MPI_Win_free, MPI_Win_lock, MPI_Win_lock_all, MPI_WIN_NULL, MPI_Win_set_errhandler, MPI_Win_unlock, &
      MPI_Win_unlock_all, operator(/=)
   implicit none
   private
   public :: new_shared_flag, shared_flag_t

   integer, parameter :: owner = 0                     ! rank in whose memory the flag stands

   type :: shared_flag_t
      private
      type(MPI_Win) :: window = MPI_WIN_NULL
      type(comm_t) :: comm = MPI_COMM_NULL             ! own copy, so that errors here can be returned
   contains
      procedure :: destroy => shared_flag_destroy
      procedure :: is_raised => shared_flag_is_raised
      procedure :: raise => shared_flag_raise
   end type shared_flag_t

contains

   !> Makes a flag that is down, shared by the ranks of `comm`; collective, as `destroy` is.
   subroutine new_shared_flag(self, comm, error)
      type(shared_flag_t), intent(out) :: self
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: bytes_per_integer = storage_size(1)/8
      integer, pointer :: value
      type(c_ptr) :: memory
      integer :: status

      call MPI_Comm_dup(comm, self%comm, status)
      if (status == MPI_SUCCESS) then
         call MPI_Comm_set_errhandler(self%comm, MPI_ERRORS_RETURN)
         call MPI_Win_allocate(int(merge(bytes_per_integer, 0, rank_of(comm) == owner), MPI_ADDRESS_KIND), &
                               bytes_per_integer, MPI_INFO_NULL, self%comm, memory, self%window, status)
      end if
      if (status /= MPI_SUCCESS) call fail(error, "MPI cannot make a flag that all ranks share")
      call share_error(comm, error)
      if (allocated(error)) return

      ! From here on a failure is one of the machine and ends the run.
      call MPI_Win_set_errhandler(self%window, MPI_ERRORS_ARE_FATAL)
      if (rank_of(comm) == owner) then
         call MPI_Win_lock(MPI_LOCK_EXCLUSIVE, owner, 0, self%window)
         call c_f_pointer(memory, value)
         value = 0
         call MPI_Win_unlock(owner, self%window)
      end if
      call barrier(comm)
      call MPI_Win_lock_all(0, self%window)
   end subroutine new_shared_flag

   !> Raises the flag; it stays up.
   subroutine shared_flag_raise(self)
      class(shared_flag_t), intent(in) :: self
      integer :: before

      before = exchange(self, 1, MPI_REPLACE)
   end subroutine shared_flag_raise

   !> Whether any rank has raised the flag.
   logical function shared_flag_is_raised(self)
      class(shared_flag_t), intent(in) :: self

      shared_flag_is_raised = exchange(self, 0, MPI_NO_OP) /= 0
   end function shared_flag_is_raised

   !> Does an atomic operation on the flag and gives its value before.
   integer function exchange(self, value, operation) result(before)
      class(shared_flag_t), intent(in) :: self
      integer, intent(in) :: value
      type(MPI_Op), intent(in) :: operation
      integer, asynchronous :: given, found            ! MPI may touch both until the flush

      given = value
      call MPI_Fetch_and_op(given, found, MPI_INTEGER, owner, 0_MPI_ADDRESS_KIND, operation, self%window)
      call MPI_Win_flush(owner, self%window)
      before = found
   end function exchange

   !> Frees the flag; collective, safe to call twice.
   subroutine shared_flag_destroy(self)
      class(shared_flag_t), intent(inout) :: self
      logical :: is_over

      call MPI_Finalized(is_over)
      if (is_over) return
      if (self%window /= MPI_WIN_NULL) then
         call MPI_Win_unlock_all(self%window)
         call MPI_Win_free(self%window)
      end if
      if (self%comm /= MPI_COMM_NULL) call MPI_Comm_free(self%comm)
   end subroutine shared_flag_destroy
end module hb_shared_flag
