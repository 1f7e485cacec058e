# The installed program looks for libraries beside itself and where they were found, and runs without help.
file(REMOVE_RECURSE ${FOLDER})
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --config ${CONFIG} --prefix ${FOLDER}
   OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} -E env --unset=LD_LIBRARY_PATH ${FOLDER}/${PROGRAM} version
   OUTPUT_VARIABLE output COMMAND_ERROR_IS_FATAL ANY)
if(NOT output MATCHES "^nhbm [0-9]")
   message(FATAL_ERROR "the installed program says\n${output}")
endif()
file(STRINGS ${FOLDER}/${PROGRAM} path REGEX "[$]ORIGIN/\\.\\./|@loader_path/\\.\\./")
if(path STREQUAL "")
   message(FATAL_ERROR "the installed program does not look for libraries beside itself")
endif()
file(REMOVE_RECURSE ${FOLDER})
