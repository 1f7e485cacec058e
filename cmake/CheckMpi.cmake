# Refuses libraries that were built with another MPI than the one found: both would be in one process, which links and then
# crashes or is aborted as soon as results are written.

# Gives the MPI libraries that a program loads which calls MPI and another library, one a line of `ldd`; empty where that is not known.
function(hb_mpi_libraries result target header call)
   set(${result} "" PARENT_SCOPE)
   find_program(HB_LDD ldd)
   mark_as_advanced(HB_LDD)
   if(NOT HB_LDD)
      return()
   endif()
   set(folder ${CMAKE_CURRENT_BINARY_DIR}/CMakeFiles/check_mpi)
   file(WRITE ${folder}/both.c "#include <mpi.h>
#include <${header}>
int main(int argc, char **argv)
{
   return MPI_Init(&argc, &argv) || ${call};
}
")
   try_compile(links ${folder} ${folder}/both.c LINK_LIBRARIES MPI::MPI_C ${target}
      OUTPUT_VARIABLE output COPY_FILE ${folder}/both)
   if(NOT links)
      message(WARNING "A program that calls MPI and ${target} could not be linked:\n${output}")
      return()
   endif()
   execute_process(COMMAND ${HB_LDD} ${folder}/both OUTPUT_VARIABLE needed ERROR_QUIET)
   # the library itself: libmpi.so.40 of Open MPI, libmpich.so.12, libmpi.so.12; not those of a language, such as libmpi_mpifh
   string(REGEX MATCHALL "[ \t]libmpi(ch)?(_gnu_[0-9]+|_intel|_cray)?\\.so[^\n]*" libraries "${needed}")
   list(TRANSFORM libraries STRIP)
   list(REMOVE_DUPLICATES libraries)
   set(${result} "${libraries}" PARENT_SCOPE)
endfunction()

# Checks a library: its name, target, header, a call of it, and what to do.
function(hb_check_mpi_of name target header call remedy)
   hb_mpi_libraries(libraries ${target} ${header} ${call})
   list(LENGTH libraries n)
   if(n GREATER 1)
      list(JOIN libraries "\n   " text)
      message(FATAL_ERROR "MPI and ${name} belong to different MPI libraries; a program with both loads\n   ${text}\n${remedy}")
   endif()
endfunction()

# Checks HDF5, and CVODE if it is used; once for each choice of libraries.
function(hb_check_mpi)
   set(found "${MPI_C_LIBRARIES};${HDF5_LIBRARIES};${CVODE_LIBRARIES}")
   if("${HB_MPI_THAT_FITS}" STREQUAL "${found}")
      return()
   endif()
   hb_check_mpi_of(HDF5 HDF5::HDF5 hdf5.h "H5open() < 0"
      "Configure in an empty folder with the MPI that HDF5 was built with (-DMPI_C_COMPILER=... \
-DMPI_Fortran_COMPILER=..., such as mpicc.mpich and mpif90.mpich), or with an HDF5 built with this MPI \
(Debian: libhdf5-openmpi-dev or libhdf5-mpich-dev, HDF5_PREFER_PARALLEL takes that of the default MPI, \
-DHDF5_C_COMPILER_EXECUTABLE=/usr/bin/h5pcc.mpich -DHDF5_Fortran_COMPILER_EXECUTABLE=/usr/bin/h5pfc.mpich another; \
elsewhere -DHDF5_ROOT=...)")
   if(TARGET CVODE::cvode)
      hb_check_mpi_of(SUNDIALS CVODE::cvode cvode/cvode.h "CVodeCreate(0, 0) != 0"
         "Configure in an empty folder without CVODE (-DHB_CVODE=OFF), with the MPI that SUNDIALS was built with (of Debian 13: \
Open MPI), or with a SUNDIALS built with this MPI or without any (-DCMAKE_PREFIX_PATH=...)")
   endif()
   set(HB_MPI_THAT_FITS "${found}" CACHE INTERNAL "MPI, HDF5 and SUNDIALS that were checked")
endfunction()
