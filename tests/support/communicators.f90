!> Communicators of the test runner, which gives an integer handle of the old `mpi` module or a communicator.
module communicators
   use hb_mpi, only: comm_t
   implicit none
   private
   public :: as_comm

   interface as_comm
      module procedure as_comm_integer
      module procedure as_comm_same
   end interface as_comm

contains

   pure type(comm_t) function as_comm_integer(comm)
      integer, intent(in) :: comm
      as_comm_integer%MPI_VAL = comm
   end function as_comm_integer

   pure type(comm_t) function as_comm_same(comm)
      type(comm_t), intent(in) :: comm
      as_comm_same = comm
   end function as_comm_same
end module communicators
