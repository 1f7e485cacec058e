!> Access of several ranks to an HDF5 file: by MPI. A build without MPI has another module of this name.
module hb_hdf5_sharing
   use hb_mpi, only: comm_handle, comm_t, is_alone, no_info_handle
   use hdf5, only: h5pset_fapl_mpio_f, h5pset_sieve_buf_size_f, hid_t, size_t
   implicit none
   private
   public :: share_access

contains

   !> Changes the properties with which a file is opened, so that all ranks of `comm` may write rows of it. A process that is
   !> alone writes values at once, as MPI does: no sieve buffer holds them until the file is closed.
   subroutine share_access(access, comm, status)
      integer(hid_t), intent(in) :: access
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status

      if (is_alone(comm)) then
         call h5pset_sieve_buf_size_f(access, 0_size_t, status)
      else
         call h5pset_fapl_mpio_f(access, comm_handle(comm), no_info_handle(), status)
      end if
   end subroutine share_access
end module hb_hdf5_sharing
