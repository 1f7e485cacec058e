# CVODE of SUNDIALS, by its C interface: target CVODE::cvode. Its numbers must have double precision; its indices may have 32 bits, as
# where SUNDIALS is built with LAPACK (conda-forge), or 64.
find_path(CVODE_INCLUDE_DIR cvode/cvode.h)
if(CVODE_INCLUDE_DIR)
   file(READ ${CVODE_INCLUDE_DIR}/sundials/sundials_config.h config)
   string(REGEX MATCH "\n#define SUNDIALS_VERSION \"([^\"]*)\"" CVODE_VERSION "${config}")
   set(CVODE_VERSION "${CMAKE_MATCH_1}")
   string(REGEX MATCH "\n#define SUNDIALS_DOUBLE_PRECISION" CVODE_HAS_DOUBLE_PRECISION "${config}")
endif()
set(CVODE_parts cvode nvecserial)
set(CVODE_needs)
set(CVODE_mpi)
if(CVODE_VERSION VERSION_GREATER_EQUAL 7)
   list(APPEND CVODE_parts core)
   if(config MATCHES "\n#define SUNDIALS_MPI_ENABLED 1")              # its headers include mpi.h
      find_package(MPI QUIET COMPONENTS C)
      set(CVODE_needs MPI_C_FOUND)
      set(CVODE_mpi MPI::MPI_C)
   endif()
endif()
set(CVODE_LIBRARIES)
foreach(part IN LISTS CVODE_parts)
   find_library(CVODE_${part}_LIBRARY sundials_${part})
   mark_as_advanced(CVODE_${part}_LIBRARY)
   list(APPEND CVODE_LIBRARIES ${CVODE_${part}_LIBRARY})
   list(APPEND CVODE_needs CVODE_${part}_LIBRARY)
endforeach()

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(CVODE HANDLE_VERSION_RANGE VERSION_VAR CVODE_VERSION
   REQUIRED_VARS ${CVODE_needs} CVODE_INCLUDE_DIR CVODE_HAS_DOUBLE_PRECISION
   REASON_FAILURE_MESSAGE "nhbm calls CVODE of SUNDIALS 6 or 7 in double precision: libsundials-dev of Debian 12 or 13. \
-DCMAKE_PREFIX_PATH=... says where it is, -DHB_CVODE=OFF builds without it.")
mark_as_advanced(CVODE_INCLUDE_DIR)

if(CVODE_FOUND AND NOT TARGET CVODE::cvode)
   add_library(CVODE::cvode INTERFACE IMPORTED)
   set_target_properties(CVODE::cvode PROPERTIES INTERFACE_LINK_LIBRARIES "${CVODE_LIBRARIES};${CVODE_mpi}"
      INTERFACE_INCLUDE_DIRECTORIES ${CVODE_INCLUDE_DIR})
endif()
