# Runs nhbm-bench over a folder of inputs: cmake -DBENCH=... -DINPUTS=... -DRESULTS=... -P Benchmarks.cmake
file(GLOB inputs ${INPUTS}/*.nml)
file(MAKE_DIRECTORY ${RESULTS})
set(ENV{OPENBLAS_NUM_THREADS} 1)
foreach(input IN LISTS inputs)
   get_filename_component(name ${input} NAME_WE)
   if(name MATCHES "^sweep_")
      continue() # many points, to be solved and not to be timed one by one
   endif()
   message(STATUS ${name})
   execute_process(COMMAND ${BENCH} ${input} --output ${RESULTS}/${name}.h5 --overwrite COMMAND_ERROR_IS_FATAL ANY)
endforeach()
