# A build for 64-bit Arm on another processor, by the cross compilers and multiarch libraries of Debian (gfortran-aarch64-linux-gnu,
# libhdf5-dev:arm64 and others): -DCMAKE_TOOLCHAIN_FILE=cmake/aarch64-linux-gnu.cmake. Tests are not built: they would run here.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_Fortran_COMPILER aarch64-linux-gnu-gfortran)
set(HB_BUILD_TESTS OFF CACHE BOOL "Build the unit tests and register all tests with ctest")
set(ENV{PKG_CONFIG_LIBDIR} /usr/lib/aarch64-linux-gnu/pkgconfig:/usr/share/pkgconfig)
