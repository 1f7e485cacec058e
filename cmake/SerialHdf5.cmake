# Finds an HDF5 without MPI, for a program without MPI: its processes write one file.

# Leaves the reason in `result` if there is none, else an empty text. A wheel takes static libraries where there are any: the shared
# ones of Debian bring libcurl, OpenSSL and Kerberos, for files in the cloud.
macro(hb_find_serial_hdf5 result)
   set(${result} "")
   if(SKBUILD AND NOT HB_HDF5_IS_SHARED)
      set(HDF5_USE_STATIC_LIBRARIES ON)
      find_package(HDF5 QUIET COMPONENTS C Fortran HL Fortran_HL)
      if(NOT HDF5_FOUND)
         set(HB_HDF5_IS_SHARED TRUE CACHE INTERNAL "There is no static HDF5")
      endif()
   endif()
   if(NOT HDF5_FOUND)
      set(HDF5_USE_STATIC_LIBRARIES OFF)
      find_package(HDF5 COMPONENTS C Fortran HL Fortran_HL)
   endif()
   if(NOT HDF5_FOUND)
      set(${result} "no HDF5 with its Fortran interface was found (Debian: libhdf5-dev; elsewhere -DHDF5_ROOT=...)")
   elseif(HDF5_IS_PARALLEL)
      set(${result} "the HDF5 that was found needs MPI; install a serial one (Debian: libhdf5-dev; elsewhere -DHDF5_ROOT=...)")
   endif()
endmacro()
