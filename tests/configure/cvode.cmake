# Which SUNDIALS the configuration takes: 6 and 7 in double precision, whatever its indices.
include(${CMAKE_CURRENT_LIST_DIR}/expect.cmake)
set(version 6.7.0)
set(index SUNDIALS_INT64_T)
set(precision SUNDIALS_DOUBLE_PRECISION)
set(refusal "nhbm calls CVODE of SUNDIALS 6 or 7 in double precision")
if(CASE STREQUAL "32_bit")
   set(index SUNDIALS_INT32_T)
elseif(CASE STREQUAL "single")
   set(precision SUNDIALS_SINGLE_PRECISION)
else()
   set(version ${CASE})
endif()
if(CASE MATCHES "^(6.7.0|7.1.1|32_bit)$")
   set(refusal "")
endif()

file(REMOVE_RECURSE ${FOLDER})
foreach(file IN ITEMS include/cvode/cvode.h lib/libsundials_cvode.so lib/libsundials_nvecserial.so
      lib/libsundials_core.so)
   file(WRITE ${FOLDER}/prefix/${file} "")
endforeach()
# as SUNDIALS writes it, with all choices in comments
file(WRITE ${FOLDER}/prefix/include/sundials/sundials_config.h "
#define SUNDIALS_VERSION \"${version}\"
/* One of these:
 *     #define SUNDIALS_DOUBLE_PRECISION 1
 *     #define SUNDIALS_INT64_T 1
 */
#define ${precision} 1
#define ${index} 1
")
file(STRINGS ${ROOT}/CMakeLists.txt command REGEX "^ *find_package\\(CVODE")
file(WRITE ${FOLDER}/CMakeLists.txt "
cmake_minimum_required(VERSION 3.25)
project(probe LANGUAGES NONE)
list(APPEND CMAKE_MODULE_PATH ${ROOT}/cmake)
set(CMAKE_FIND_LIBRARY_PREFIXES lib)
set(CMAKE_FIND_LIBRARY_SUFFIXES .so)
${command}
")
expect("${refusal}" -DCMAKE_FIND_ROOT_PATH=${FOLDER}/prefix -DCMAKE_FIND_ROOT_PATH_MODE_INCLUDE=ONLY
   -DCMAKE_FIND_ROOT_PATH_MODE_LIBRARY=ONLY -DCMAKE_PREFIX_PATH=/)
