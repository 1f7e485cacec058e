# Refuses an HDF5 that was built with another MPI library than the one found: both would be in one process, which links, runs
# and is aborted as soon as results are written.

# Gives the MPI libraries that a program which calls MPI and HDF5 loads, one a line of `ldd`; empty where that is not known.
function(hb_mpi_libraries result)
   set(${result} "" PARENT_SCOPE)
   find_program(HB_LDD ldd)
   mark_as_advanced(HB_LDD)
   if(NOT HB_LDD)
      return()
   endif()
   set(folder ${CMAKE_CURRENT_BINARY_DIR}/CMakeFiles/check_mpi)
   file(WRITE ${folder}/both.c "#include <hdf5.h>
#include <mpi.h>
int main(int argc, char **argv)
{
   return MPI_Init(&argc, &argv) || H5open() < 0;
}
")
   try_compile(links ${folder} ${folder}/both.c LINK_LIBRARIES MPI::MPI_C HDF5::HDF5
      OUTPUT_VARIABLE output COPY_FILE ${folder}/both)
   if(NOT links)
      message(WARNING "A program that calls MPI and HDF5 could not be linked:\n${output}")
      return()
   endif()
   execute_process(COMMAND ${HB_LDD} ${folder}/both OUTPUT_VARIABLE needed ERROR_QUIET)
   # the library itself: libmpi.so.40 of Open MPI, libmpich.so.12, libmpi.so.12; not those of a language, such as libmpi_mpifh
   string(REGEX MATCHALL "[ \t]libmpi(ch)?(_gnu_[0-9]+|_intel|_cray)?\\.so[^\n]*" libraries "${needed}")
   list(TRANSFORM libraries STRIP)
   list(REMOVE_DUPLICATES libraries)
   set(${result} "${libraries}" PARENT_SCOPE)
endfunction()

# Checks what was found, once for each pair.
function(hb_check_mpi_of_hdf5)
   if("${HB_MPI_FITS_HDF5}" STREQUAL "${MPI_C_LIBRARIES};${HDF5_LIBRARIES}")
      return()
   endif()
   hb_mpi_libraries(libraries)
   list(LENGTH libraries n)
   if(n GREATER 1)
      list(JOIN libraries "\n   " text)
      message(FATAL_ERROR "MPI and HDF5 belong to different MPI libraries; a program with both loads\n   ${text}\n"
         "Configure in an empty folder with the MPI that HDF5 was built with (-DMPI_C_COMPILER=... "
         "-DMPI_Fortran_COMPILER=..., such as mpicc.mpich and mpif90.mpich), or with an HDF5 built with this MPI "
         "(Debian: libhdf5-openmpi-dev or libhdf5-mpich-dev, HDF5_PREFER_PARALLEL takes that of the default MPI; "
         "elsewhere -DHDF5_ROOT=...)")
   endif()
   set(HB_MPI_FITS_HDF5 "${MPI_C_LIBRARIES};${HDF5_LIBRARIES}" CACHE INTERNAL "MPI and HDF5 that were checked")
endfunction()
