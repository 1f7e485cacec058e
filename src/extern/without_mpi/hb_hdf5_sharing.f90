!> Access of several processes of one computer to an HDF5 file, without MPI: each opens it with the ordinary driver. The file is
!> created whole, and afterwards raw data alone are written, so that their metadata remain those of the disk.
module hb_hdf5_sharing
   use hb_mpi, only: comm_t
   use hdf5, only: h5pset_sieve_buf_size_f, hid_t, size_t
   implicit none
   private
   public :: share_access

contains

   !> Changes the properties with which a file is opened, so that all ranks of `comm` may write rows of it.
   !>
   !> Nothing is read or written but the values themselves: a sieve buffer would hold neighbours' rows and write them back.
   subroutine share_access(access, comm, status)
      integer(hid_t), intent(in) :: access
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status

      call h5pset_sieve_buf_size_f(access, 0_size_t, status)
   end subroutine share_access
end module hb_hdf5_sharing
