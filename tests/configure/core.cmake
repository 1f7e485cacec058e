# nhbm::core alone as a shared library: it needs nothing of MPI, HDF5 and SUNDIALS, handles no signals, ends no process and prints
# nothing. Takes a minute.
set(build ${FOLDER}/build)
file(REMOVE_RECURSE ${FOLDER})
execute_process(COMMAND ${CMAKE_COMMAND} -S ${ROOT} -B ${build} -DHB_CORE_ONLY=ON -DBUILD_SHARED_LIBS=ON -DCMAKE_BUILD_TYPE=None
   -DCMAKE_DISABLE_FIND_PACKAGE_MPI=ON -DCMAKE_DISABLE_FIND_PACKAGE_HDF5=ON -DCMAKE_DISABLE_FIND_PACKAGE_CVODE=ON
   OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} --build ${build} --parallel 2 OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} --install ${build} --prefix ${FOLDER}/installed OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
file(GLOB_RECURSE library ${FOLDER}/installed/*/libhb_core.so)
find_program(NM nm REQUIRED)
execute_process(COMMAND ${NM} --dynamic --undefined-only ${library} OUTPUT_VARIABLE symbols COMMAND_ERROR_IS_FATAL ANY)
set(forbidden "MPI_[a-z]|mpi_|H5[A-Z]|CVode|SUN[A-Z]|sigaction|signal|setitimer|_[Ee]xit|exit|abort|puts|printf|_gfortran_stop|_gfortran_error_stop")
string(REGEX MATCHALL " U (${forbidden})[^\n@]*" found "${symbols}")
if(found)
   message(FATAL_ERROR "nhbm::core uses ${found}")
endif()
set(example ${FOLDER}/example)
execute_process(COMMAND ${CMAKE_COMMAND} -S ${ROOT}/examples/wall -B ${example} -DCMAKE_PREFIX_PATH=${FOLDER}/installed OUTPUT_QUIET
   COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} --build ${example} OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${example}/wall OUTPUT_VARIABLE output COMMAND_ERROR_IS_FATAL ANY)
if(NOT output MATCHES "cos tau_1 at midspan:  1\\.0939[0-9]+E-03 m")
   message(FATAL_ERROR "the example says\n${output}")
endif()
file(REMOVE_RECURSE ${FOLDER})
