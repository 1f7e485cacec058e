# libnhbm.so without SUNDIALS, MPI and HDF5, of shared libraries: a program in C links it alone, and is told what it lacks. Takes a
# minute.
set(build ${FOLDER}/build)
file(REMOVE_RECURSE ${FOLDER})
execute_process(COMMAND ${CMAKE_COMMAND} -S ${ROOT} -B ${build} -DHB_LIBRARY_ONLY=ON -DHB_CVODE=OFF -DBUILD_SHARED_LIBS=ON
   -DCMAKE_BUILD_TYPE=None -DCMAKE_DISABLE_FIND_PACKAGE_MPI=ON -DCMAKE_DISABLE_FIND_PACKAGE_HDF5=ON
   -DCMAKE_DISABLE_FIND_PACKAGE_CVODE=ON
   OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} --build ${build} --parallel 2 OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} --install ${build} --prefix ${FOLDER}/installed OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
file(GLOB_RECURSE library ${FOLDER}/installed/*/libnhbm.so)
get_filename_component(folder ${library} DIRECTORY)
execute_process(COMMAND ${C_COMPILER} -I ${FOLDER}/installed/include ${ROOT}/tests/configure/without_cvode.c ${library}
   -Wl,-rpath,${folder} -o ${FOLDER}/program COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${FOLDER}/program COMMAND_ERROR_IS_FATAL ANY)
file(REMOVE_RECURSE ${FOLDER})
