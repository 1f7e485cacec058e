# FFTW 3 in double precision, with the folder of its Fortran interface file: target FFTW3::fftw3.
find_package(PkgConfig QUIET)
if(PKG_CONFIG_FOUND)
   pkg_check_modules(PC_FFTW3 QUIET fftw3)
endif()
find_library(FFTW3_LIBRARY fftw3 HINTS ${PC_FFTW3_LIBRARY_DIRS})
find_path(FFTW3_INCLUDE_DIR fftw3.f03 HINTS ${PC_FFTW3_INCLUDE_DIRS} /usr/include)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(FFTW3 REQUIRED_VARS FFTW3_LIBRARY FFTW3_INCLUDE_DIR VERSION_VAR PC_FFTW3_VERSION)
mark_as_advanced(FFTW3_LIBRARY FFTW3_INCLUDE_DIR)

if(FFTW3_FOUND AND NOT TARGET FFTW3::fftw3)
   add_library(FFTW3::fftw3 INTERFACE IMPORTED)
   set_target_properties(FFTW3::fftw3 PROPERTIES
      INTERFACE_LINK_LIBRARIES "${FFTW3_LIBRARY}"
      INTERFACE_INCLUDE_DIRECTORIES "${FFTW3_INCLUDE_DIR}")
endif()
