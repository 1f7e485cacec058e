# The in-tree test runner: add_pfunit_ctest with the keywords that the project uses, for machines without
# pFUnit. Needs Python3::Interpreter and, for tests of several processes, MPI::MPI_Fortran; is included by cmake/Pfunit.cmake.

set(HB_RUNNER_DIR "${CMAKE_CURRENT_LIST_DIR}")

add_library(hb_runner_funit STATIC EXCLUDE_FROM_ALL
  ${HB_RUNNER_DIR}/funit.f90
  ${HB_RUNNER_DIR}/runner_cases.f90
  ${HB_RUNNER_DIR}/runner_comparison.f90
  ${HB_RUNNER_DIR}/runner_conditions.f90
  ${HB_RUNNER_DIR}/runner_exceptions.f90
  ${HB_RUNNER_DIR}/runner_relations.F90
  ${HB_RUNNER_DIR}/runner_session.f90)
# runner_values.inc converts to the widest kind by assignment, on purpose
target_compile_options(hb_runner_funit PRIVATE $<$<Fortran_COMPILER_ID:GNU>:-Wno-conversion-extra>)

set(hb_runner_libraries hb_runner_funit)
if(TARGET MPI::MPI_Fortran)
  add_library(hb_runner_pfunit STATIC EXCLUDE_FROM_ALL
    ${HB_RUNNER_DIR}/pfunit.f90
    ${HB_RUNNER_DIR}/runner_mpi.f90)
  target_link_libraries(hb_runner_pfunit PUBLIC hb_runner_funit MPI::MPI_Fortran)
  list(APPEND hb_runner_libraries hb_runner_pfunit)
endif()

foreach(library IN LISTS hb_runner_libraries)
  set_target_properties(${library} PROPERTIES
    Fortran_MODULE_DIRECTORY "${CMAKE_CURRENT_BINARY_DIR}/${library}.mod")
  target_include_directories(${library} PUBLIC "${CMAKE_CURRENT_BINARY_DIR}/${library}.mod")
endforeach()

# add_pfunit_ctest(<name> TEST_SOURCES a.pf ... [OTHER_SOURCES x.f90 ...] [LINK_LIBRARIES ...] [LABELS ...]
#                  [MAX_PES n] [WORKING_DIRECTORY dir])
# One executable and one ctest, both called <name>; with MAX_PES it runs under mpiexec on that many processes.
function(add_pfunit_ctest name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "MAX_PES;WORKING_DIRECTORY"
    "TEST_SOURCES;OTHER_SOURCES;LINK_LIBRARIES;LABELS")
  if(arg_UNPARSED_ARGUMENTS OR arg_KEYWORDS_MISSING_VALUES)
    message(FATAL_ERROR "add_pfunit_ctest(${name}): not understood: "
      "${arg_UNPARSED_ARGUMENTS} ${arg_KEYWORDS_MISSING_VALUES}")
  endif()
  if(NOT arg_TEST_SOURCES)
    message(FATAL_ERROR "add_pfunit_ctest(${name}): TEST_SOURCES is empty")
  endif()

  if(arg_MAX_PES)
    set(runner runner_mpi)
    set(library hb_runner_pfunit)
  else()
    set(runner runner_session)
    set(library hb_runner_funit)
  endif()

  # The last file has the main program: objects of their own, a few lines each, took a tenth of the compilation of all suites.
  set(sources "")
  set(suites "")
  set(main "")
  list(GET arg_TEST_SOURCES -1 last)
  foreach(pf_file IN LISTS arg_TEST_SOURCES)
    if(IS_ABSOLUTE "${pf_file}" OR pf_file MATCHES "\\.\\./" OR NOT pf_file MATCHES "\\.pf$")
      message(FATAL_ERROR
        "add_pfunit_ctest(${name}): '${pf_file}' is not a .pf file below the current source folder")
    endif()
    set(source "${CMAKE_CURRENT_SOURCE_DIR}/${pf_file}")
    string(REGEX REPLACE "\\.pf$" ".F90" output "${CMAKE_CURRENT_BINARY_DIR}/${pf_file}")
    get_filename_component(stem "${pf_file}" NAME_WE)
    list(APPEND suites "${stem}_suite")
    if(pf_file STREQUAL last)
      set(main --main ${runner} ${suites})
    endif()
    # -S: no site packages, whose start takes longer than the translation
    add_custom_command(
      OUTPUT "${output}"
      COMMAND Python3::Interpreter -S -B "${HB_RUNNER_DIR}/pf_to_fortran.py" "${source}" "${output}" ${main}
      DEPENDS "${source}" "${HB_RUNNER_DIR}/pf_reader.py" "${HB_RUNNER_DIR}/pf_to_fortran.py"
      COMMENT "Translating ${pf_file}"
      VERBATIM)
    list(APPEND sources "${output}")
  endforeach()

  add_executable(${name} ${sources} ${arg_OTHER_SOURCES})
  set_target_properties(${name} PROPERTIES Fortran_MODULE_DIRECTORY "${CMAKE_CURRENT_BINARY_DIR}/mod/${name}")
  target_include_directories(${name} PRIVATE
    "${CMAKE_CURRENT_BINARY_DIR}/mod/${name}"
    "${CMAKE_CURRENT_SOURCE_DIR}")
  # no PRIVATE/PUBLIC: pFUnit's function has none, and CMake does not let the two styles meet on one target
  target_link_libraries(${name} ${arg_LINK_LIBRARIES} ${library})

  if(NOT arg_WORKING_DIRECTORY)
    set(arg_WORKING_DIRECTORY "${CMAKE_CURRENT_BINARY_DIR}")
  endif()
  if(arg_MAX_PES)
    add_test(NAME ${name} WORKING_DIRECTORY "${arg_WORKING_DIRECTORY}"
      COMMAND ${MPIEXEC_EXECUTABLE} ${MPIEXEC_NUMPROC_FLAG} ${arg_MAX_PES} ${MPIEXEC_PREFLAGS}
              $<TARGET_FILE:${name}> ${MPIEXEC_POSTFLAGS})
  else()
    add_test(NAME ${name} WORKING_DIRECTORY "${arg_WORKING_DIRECTORY}" COMMAND ${name})
  endif()
  if(arg_LABELS)
    set_tests_properties(${name} PROPERTIES LABELS "${arg_LABELS}")
  endif()
endfunction()
