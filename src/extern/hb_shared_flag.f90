!> A flag shared by all ranks: any rank sets it at any time without synchronisation. It is a work counter from which a number has
!> been drawn.
module hb_shared_flag
   use hb_error, only: annotate, error_t
   use hb_mpi, only: comm_t, new_work_counter, work_counter_t
   implicit none
   private
   public :: new_shared_flag, shared_flag_t

   type :: shared_flag_t
      private
      type(work_counter_t) :: counter
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

      call new_work_counter(self%counter, [0], comm, error)
      call annotate(error, "MPI cannot make a flag that all ranks share")
   end subroutine new_shared_flag

   !> Raises the flag; it stays up.
   subroutine shared_flag_raise(self)
      class(shared_flag_t), intent(in) :: self

      if (.not. self%is_raised()) call self%counter%add_done(1, 1, 0)
   end subroutine shared_flag_raise

   !> Whether any rank has raised the flag.
   logical function shared_flag_is_raised(self)
      class(shared_flag_t), intent(in) :: self

      shared_flag_is_raised = self%counter%n_done(1) > 0
   end function shared_flag_is_raised

   !> Frees the flag; collective, safe to call twice.
   subroutine shared_flag_destroy(self)
      class(shared_flag_t), intent(inout) :: self

      call self%counter%destroy()
   end subroutine shared_flag_destroy
end module hb_shared_flag
