# UMFPACK of SuiteSparse: target UMFPACK::umfpack.
find_library(UMFPACK_LIBRARY umfpack)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(UMFPACK REQUIRED_VARS UMFPACK_LIBRARY)
mark_as_advanced(UMFPACK_LIBRARY)

if(UMFPACK_FOUND AND NOT TARGET UMFPACK::umfpack)
   add_library(UMFPACK::umfpack INTERFACE IMPORTED)
   set_target_properties(UMFPACK::umfpack PROPERTIES INTERFACE_LINK_LIBRARIES "${UMFPACK_LIBRARY}")
endif()
