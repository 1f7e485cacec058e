!> What an MPI test file sees with `use pfunit`: everything of `funit`, the MPI fixtures and, as in pFUnit,
!> all of `mpi`.
module pfunit
   use funit
   use mpi
   use runner_mpi, only: MpiTestCase, MpiTestMethod, MpiTestParameter
   implicit none
   public
end module pfunit
