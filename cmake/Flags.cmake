# Compiler flags, as interface targets that only our own targets link. No other file has any: each stands here under the
# compiler that knows it. Compilers without an entry get what CMake gives them, -O3 or -g.

add_library(hb_warnings INTERFACE)
# A text that is cut is an error, and so is a function of C that no header declares: its pointers would lose their upper half.
# So is a trampoline, the code on the stack to which an inner procedure that is passed leads: it makes the stack of each program
# executable, and glibc 2.41 and later do not load such a library into Python.
# Off, because what they report is meant:
# -Wunused-dummy-argument: bindings of abstract types have arguments that not every law or structure uses
# -Wcompare-reals: exact zeros and unchanged values are compared on purpose
# -Wfunction-elimination: a function that is called twice with the same arguments may be called once
# -Wimplicit-interface, of no group: gfortran reports functions of the same module that give lengths
# -Wuninitialized, -Wmaybe-uninitialized, but for Release: at -O0 and -Og gfortran does not follow values, and reports bounds of arrays
#    that are set. In Release an assignment to an array that is not allocated yet may be reported, since gfortran reads its bounds
#    before it looks whether there are any (GCC bug 108889): write allocate (array, source=...),
#    with the bounds if the source has a vector subscript: else gfortran 12 counts from 0.
#    In Debug -fcheck=bounds does so where a local array becomes the result of a function, which valgrind reports: likewise.
target_compile_options(hb_warnings INTERFACE
   $<$<COMPILE_LANG_AND_ID:Fortran,GNU>:-std=f2018 -Wall -Wextra -Werror=character-truncation -Werror=trampolines
      -Wno-unused-dummy-argument -Wno-compare-reals -Wno-function-elimination>
   $<$<AND:$<NOT:$<CONFIG:Release>>,$<COMPILE_LANG_AND_ID:Fortran,GNU>>:-Wno-uninitialized -Wno-maybe-uninitialized>
   $<$<COMPILE_LANG_AND_ID:Fortran,LLVMFlang>:-std=f2018>
   $<$<COMPILE_LANG_AND_ID:C,GNU,Clang>:-std=c11 -Wall -Wextra -Wpedantic -Wconversion
      -Werror=implicit-function-declaration -Werror=int-conversion>)
# Errors with the compiler of Debian 12, by which each change is compiled. Others see more, such as gfortran 14 in an assignment to a
# new variable with arrays: a warning there must not end the build of a user.
if(CMAKE_Fortran_COMPILER_VERSION MATCHES "^12\\.2\\." AND CMAKE_SYSTEM_PROCESSOR STREQUAL "x86_64" AND NOT HB_NATIVE)
   target_compile_options(hb_warnings INTERFACE
      $<$<AND:$<CONFIG:Release>,$<COMPILE_LANG_AND_ID:Fortran,GNU>>:-Werror=uninitialized -Werror=maybe-uninitialized>)
endif()
if(HB_WARNINGS_AS_ERRORS)
   target_compile_options(hb_warnings INTERFACE -Werror)
endif()

add_library(hb_flags INTERFACE)
# The check of recursion takes two threads in one procedure for recursion, that of temporary arrays prints millions of lines; where
# variables are in registers is reported by half of the time of the compiler.
target_compile_options(hb_flags INTERFACE
   $<$<AND:$<CONFIG:Debug>,$<COMPILE_LANG_AND_ID:Fortran,GNU>>:-Og -fno-var-tracking -fcheck=all,no-recursion,no-array-temps -ffpe-trap=invalid,zero,overflow -fbacktrace>
   $<$<AND:$<CONFIG:Release>,$<COMPILE_LANG_AND_ID:Fortran,GNU>>:-O3 -fno-math-errno -fno-trapping-math>)
if(BUILD_SHARED_LIBS)                          # calls within a library are not for others to replace, and may be inlined
   target_compile_options(hb_flags INTERFACE $<$<COMPILE_LANG_AND_ID:Fortran,GNU>:-fno-semantic-interposition>)
endif()
# What suites do around what they test needs no speed, and compiles in a fifth of the time; stands behind hb_flags.
add_library(hb_test_flags INTERFACE)
target_compile_options(hb_test_flags INTERFACE $<$<COMPILE_LANG_AND_ID:Fortran,GNU>:-O0>)
find_program(HB_GOLD ld.gold)                  # links a suite in a third of the time of ld
mark_as_advanced(HB_GOLD)
if(HB_GOLD)
   target_link_options(hb_test_flags INTERFACE $<$<LINK_LANG_AND_ID:Fortran,GNU>:-fuse-ld=gold>)
endif()
if(HB_NATIVE)
   target_compile_options(hb_flags INTERFACE -march=native)
endif()
if((HB_SANITIZE OR HB_COVERAGE) AND NOT CMAKE_Fortran_COMPILER_ID STREQUAL "GNU")
   message(FATAL_ERROR "HB_SANITIZE and HB_COVERAGE need gfortran, the compiler is ${CMAKE_Fortran_COMPILER_ID}")
endif()
if(HB_SANITIZE)
   target_compile_options(hb_flags INTERFACE -fsanitize=address,undefined -fno-omit-frame-pointer -g)
   target_link_options(hb_flags INTERFACE -fsanitize=address,undefined)
endif()
if(HB_COVERAGE)
   target_compile_options(hb_flags INTERFACE --coverage)
   target_link_options(hb_flags INTERFACE --coverage)
endif()

# The same sources give the same bits in every folder, where the build is within them: gfortran writes the name of a source, as it is
# called, into messages of run time.
if(PROJECT_IS_TOP_LEVEL AND NOT HB_COVERAGE)
   execute_process(COMMAND realpath --relative-to=/ /tmp OUTPUT_QUIET ERROR_QUIET RESULT_VARIABLE has_no_realpath)
   if(has_no_realpath EQUAL 0)
      foreach(language IN ITEMS C Fortran)
         list(APPEND CMAKE_${language}_COMPILER_LAUNCHER sh ${CMAKE_CURRENT_LIST_DIR}/relative_source ${PROJECT_SOURCE_DIR})
      endforeach()
   endif()
   target_compile_options(hb_flags INTERFACE
      $<$<AND:$<CONFIG:Release>,$<COMPILE_LANG_AND_ID:C,GNU,Clang>>:-ffile-prefix-map=${PROJECT_SOURCE_DIR}=.>
      $<$<AND:$<CONFIG:Release>,$<COMPILE_LANG_AND_ID:Fortran,GNU>>:-ffile-prefix-map=${PROJECT_SOURCE_DIR}=.>)
endif()

# For generated sources with lines of any length.
set(HB_LONG_LINES $<$<Fortran_COMPILER_ID:GNU>:-ffree-line-length-none>)

# For sources that call kernels and have none: compiled in half of the time, to the same numbers. The library is for whole targets, and
# stands behind hb_flags.
set(HB_STEERING_FLAGS $<$<AND:$<CONFIG:Release>,$<Fortran_COMPILER_ID:GNU>>:-O1>
   $<$<AND:$<CONFIG:Debug>,$<Fortran_COMPILER_ID:GNU>>:-O0>)
add_library(hb_steering_flags INTERFACE)
target_compile_options(hb_steering_flags INTERFACE "$<$<COMPILE_LANGUAGE:Fortran>:${HB_STEERING_FLAGS}>")
