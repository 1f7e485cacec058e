!> Access of several ranks to an HDF5 file: by MPI. A build without MPI has another module of this name.
module hb_hdf5_sharing
   use hb_mpi, only: comm_handle, comm_t, no_info_handle
   use hdf5, only: h5pset_fapl_mpio_f, hid_t
   implicit none
   private
   public :: share_access

contains

   !> Changes the properties with which a file is opened, so that all ranks of `comm` may write rows of it.
   subroutine share_access(access, comm, status)
      integer(hid_t), intent(in) :: access
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status

      call h5pset_fapl_mpio_f(access, comm_handle(comm), no_info_handle(), status)
   end subroutine share_access
end module hb_hdf5_sharing
