# Chooses the test framework, pFUnit or the in-tree runner, and offers hb_add_test, the same with both.

set(HB_PFUNIT AUTO CACHE STRING
  "Run the tests with pFUnit: AUTO uses it if 4.14 or later with MPI is found, ON demands it, OFF uses the in-tree runner")
set_property(CACHE HB_PFUNIT PROPERTY STRINGS AUTO ON OFF)
string(TOUPPER "${HB_PFUNIT}" hb_pfunit_choice)
if(NOT hb_pfunit_choice MATCHES "^(AUTO|ON|OFF)$")
  message(FATAL_ERROR "HB_PFUNIT is '${HB_PFUNIT}', must be AUTO, ON or OFF")
endif()

if(HB_CORE_ONLY) # without MPI
  if(hb_pfunit_choice STREQUAL "ON")
    message(FATAL_ERROR "HB_PFUNIT=ON, but HB_CORE_ONLY=ON leaves out MPI, which the tests with pFUnit need: set HB_PFUNIT=OFF")
  endif()
  set(hb_pfunit_choice OFF)
else()
  find_package(MPI REQUIRED COMPONENTS Fortran) # before pFUnit, whose add_pfunit_ctest uses MPIEXEC_EXECUTABLE
endif()

if(NOT hb_pfunit_choice STREQUAL "OFF")
  find_package(PFUNIT QUIET)
  if(NOT PFUNIT_FOUND)
    set(hb_pfunit_lack "no pFUnit was found: give its prefix in CMAKE_PREFIX_PATH")
  elseif(PFUNIT_VERSION VERSION_LESS 4.14)
    set(hb_pfunit_lack "pFUnit ${PFUNIT_VERSION} of ${PFUNIT_DIR} is older than 4.14")
  elseif(NOT PFUNIT_MPI_FOUND)
    set(hb_pfunit_lack "pFUnit ${PFUNIT_VERSION} of ${PFUNIT_DIR} was built without MPI")
  endif()
endif()
if(NOT hb_pfunit_choice STREQUAL "OFF" AND NOT DEFINED hb_pfunit_lack)
  message(STATUS "Tests: pFUnit ${PFUNIT_VERSION} of ${PFUNIT_DIR}; HB_PFUNIT=OFF takes the in-tree runner")
elseif(hb_pfunit_choice STREQUAL "ON")
  message(FATAL_ERROR "HB_PFUNIT=ON, but ${hb_pfunit_lack}")
else()
  find_package(Python3 REQUIRED COMPONENTS Interpreter)
  include("${CMAKE_CURRENT_LIST_DIR}/../tests/runner/runner.cmake")
  if(DEFINED hb_pfunit_lack AND PFUNIT_FOUND)
    message(STATUS "Tests: ${hb_pfunit_lack}")
  endif()
  message(STATUS "Tests: in-tree runner (tests/runner)")
endif()

# What every test process gets: Open MPI may run as root and on more processes than cores, BLAS on one thread.
set(HB_TEST_ENVIRONMENT
  OMPI_ALLOW_RUN_AS_ROOT=1
  OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
  OMPI_MCA_rmaps_base_oversubscribe=1
  PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe # from version 5 on
  OPENBLAS_NUM_THREADS=1)
if(HB_SANITIZE) # what the undefined-behaviour sanitizer only reports would pass for a success
  list(APPEND HB_TEST_ENVIRONMENT UBSAN_OPTIONS=halt_on_error=1)
endif()

# hb_add_test(<name> TEST_SOURCES a.pf ... [OTHER_SOURCES x.f90 ...] [LINK_LIBRARIES ...] [LABELS ...]
#             [MAX_PES n] [WORKING_DIRECTORY dir])
# A test executable and ctest <name> of one or more .pf files. LABELS is `unit` if not given; a test with MAX_PES
# runs on that many processes and is labelled `mpi` in addition.
function(hb_add_test name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "MAX_PES;WORKING_DIRECTORY"
    "TEST_SOURCES;OTHER_SOURCES;LINK_LIBRARIES;LABELS")
  if(arg_UNPARSED_ARGUMENTS OR arg_KEYWORDS_MISSING_VALUES OR NOT arg_TEST_SOURCES)
    message(FATAL_ERROR "hb_add_test(${name}): TEST_SOURCES missing, or not understood: "
      "${arg_UNPARSED_ARGUMENTS} ${arg_KEYWORDS_MISSING_VALUES}")
  endif()
  if(IS_DIRECTORY "${CMAKE_CURRENT_SOURCE_DIR}/${name}")
    # the build folder would hold an executable and a folder of this name
    message(FATAL_ERROR "hb_add_test(${name}): choose another name, '${name}' is a folder here")
  endif()
  if(NOT arg_LABELS)
    set(arg_LABELS unit)
  endif()
  list(APPEND arg_LINK_LIBRARIES hb_test_flags) # the last one: its options count
  set(n_processes 1)
  set(passed_on "")
  set(environment ${HB_TEST_ENVIRONMENT})
  if(arg_MAX_PES)
    list(APPEND arg_LABELS mpi)
    # Open MPI itself loses memory, which the leak sanitizer would blame on us; the serial tests are watched
    list(APPEND environment LSAN_OPTIONS=detect_leaks=0)
    set(n_processes ${arg_MAX_PES})
  endif()
  foreach(keyword IN ITEMS TEST_SOURCES OTHER_SOURCES LINK_LIBRARIES MAX_PES WORKING_DIRECTORY)
    if(arg_${keyword})
      list(APPEND passed_on ${keyword} ${arg_${keyword}})
    endif()
  endforeach()

  add_pfunit_ctest(${name} ${passed_on})
  if("unit" IN_LIST arg_LABELS)
    add_dependencies(unit_suites ${name})
    if(HB_CORE_ONLY OR NOT HB_UNIT_SUITES)
      set_target_properties(${name} PROPERTIES EXCLUDE_FROM_ALL ON)
    endif()
  endif()
  set_tests_properties(${name} PROPERTIES
    ENVIRONMENT "${environment}"
    LABELS "${arg_LABELS}"
    PROCESSORS ${n_processes}
    TIMEOUT 300)
endfunction()
