# CVODE of SUNDIALS, by its C interface: target CVODE::cvode.
find_path(CVODE_INCLUDE_DIR cvode/cvode.h)
set(CVODE_LIBRARIES)
foreach(part IN ITEMS cvode nvecserial)
   find_library(CVODE_${part}_LIBRARY sundials_${part})
   mark_as_advanced(CVODE_${part}_LIBRARY)
   list(APPEND CVODE_LIBRARIES ${CVODE_${part}_LIBRARY})
endforeach()
if(CVODE_INCLUDE_DIR)
   file(STRINGS ${CVODE_INCLUDE_DIR}/sundials/sundials_config.h CVODE_VERSION REGEX "define SUNDIALS_VERSION ")
   string(REGEX REPLACE ".*\"(.*)\".*" "\\1" CVODE_VERSION "${CVODE_VERSION}")
endif()

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(CVODE REQUIRED_VARS CVODE_cvode_LIBRARY CVODE_nvecserial_LIBRARY CVODE_INCLUDE_DIR
   VERSION_VAR CVODE_VERSION)
mark_as_advanced(CVODE_INCLUDE_DIR)

if(CVODE_FOUND AND NOT TARGET CVODE::cvode)
   add_library(CVODE::cvode INTERFACE IMPORTED)
   set_target_properties(CVODE::cvode PROPERTIES INTERFACE_LINK_LIBRARIES "${CVODE_LIBRARIES}")
endif()
