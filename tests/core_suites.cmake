# The suites that use the kernel and nothing above it, for a build of nhbm::core alone: those whose modules are all of hb_core or
# of the support below. Others read models from texts.
add_library(test_support STATIC EXCLUDE_FROM_ALL support/laws_from_numbers.f90 support/messages.f90 support/model_balances.f90
   support/named_values.f90 support/periodic_motions.f90 support/random_numbers.f90
   solve/matrix_problems.f90 solve/curve_problems.f90 solve/small_problems.f90
   ${CMAKE_CURRENT_BINARY_DIR}/law_examples.f90 ${CMAKE_CURRENT_BINARY_DIR}/user_law_paths.f90)
add_dependencies(test_support user_law_samples cubic_c cubic_f)
set_source_files_properties(${CMAKE_CURRENT_BINARY_DIR}/law_examples.f90 ${CMAKE_CURRENT_BINARY_DIR}/user_law_paths.f90 PROPERTIES COMPILE_OPTIONS "${HB_LONG_LINES}")
set_target_properties(test_support PROPERTIES Fortran_MODULE_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/support_modules)
target_include_directories(test_support PUBLIC ${CMAKE_CURRENT_BINARY_DIR}/support_modules)
target_link_libraries(test_support PUBLIC nhbm::core PRIVATE hb_warnings hb_flags)

set(permitted funit law_examples_of_table ieee_arithmetic ieee_exceptions iso_c_binding iso_fortran_env)
get_target_property(kernel_sources hb_core SOURCES)
get_target_property(support_sources test_support SOURCES)
foreach(source IN LISTS kernel_sources support_sources)
   cmake_path(GET source STEM module)
   list(APPEND permitted ${module})
endforeach()
set(n_suites 0)
file(GLOB suites CONFIGURE_DEPENDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR}/*/test_*.pf)
list(FILTER suites INCLUDE REGEX "^(base|extern|solve|hypertime|structure|laws|balance|stability|motion)/")
list(FILTER suites EXCLUDE REGEX "test_two_threads|test_hb_processes")   # with sources of their own
foreach(suite IN LISTS suites)
   file(STRINGS ${suite} lines REGEX "^ *use[ ,]")
   list(TRANSFORM lines REPLACE "^ *use *(, *intrinsic *::)? *([a-z0-9_]+).*" "\\2" OUTPUT_VARIABLE modules)
   list(REMOVE_ITEM modules ${permitted})
   if(modules)
      continue()
   endif()
   cmake_path(GET suite STEM name)
   hb_add_test(${name} TEST_SOURCES ${suite} LINK_LIBRARIES test_support nhbm::core hb_flags)
   math(EXPR n_suites "${n_suites} + 1")
endforeach()
message(STATUS "Tests: ${n_suites} suites use nhbm::core alone")
