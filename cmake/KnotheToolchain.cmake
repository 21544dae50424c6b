# Compiler settings that every target of the project shares; ordinary variables, so that a project around this one keeps its own.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
if(KNOTHE_LIBRARY OR KNOTHE_OFFLINE) # the rooms go into libraries, and nothing of them is seen from outside
  set(CMAKE_POSITION_INDEPENDENT_CODE ON)
  set(CMAKE_CXX_VISIBILITY_PRESET hidden)
  set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)
endif()
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
if(KNOTHE_OFFLINE)
  set(CMAKE_BUILD_RPATH ${CMAKE_RUNTIME_OUTPUT_DIRECTORY}) # of the library that is opened (knothe/offline)
endif()
if(PROJECT_IS_TOP_LEVEL AND NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "" FORCE)
endif()

# Looked for once in a build folder: a ccache that comes later would change every command, and everything would be compiled again.
if(NOT DEFINED CACHE{KNOTHE_CCACHE})
  find_program(found_ccache ccache NO_CACHE)
  if(NOT found_ccache)
    set(found_ccache "")
  endif()
  set(KNOTHE_CCACHE "${found_ccache}" CACHE FILEPATH "ccache, through which the compiler is called; empty: without")
endif()
if(KNOTHE_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # Paths below the source folder are hashed as relative: another clone of the same commit compiles nothing anew, but for sources in groups
  # (KnotheUnity.cmake), which are named by their whole paths. What a unit includes
  # is read from the compiler's list (DEPEND): without it every unit is preprocessed first, only to be found missing.
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_BASEDIR=${PROJECT_SOURCE_DIR} CCACHE_NOHASHDIR=1 CCACHE_DEPEND=1
                                  ${KNOTHE_CCACHE})
endif()

# What every target is compiled with. knothe_flags_portable has no machine-specific instructions: translation
# units that include deal.II use it, because Debian's deal.II is an SSE2 build and its inline functions must
# not be compiled twice with different vector widths. Eigen types never cross that border: spans do.
add_library(knothe_flags_portable INTERFACE)
# Members that an initialiser leaves out have their default: that is meant.
target_compile_options(knothe_flags_portable INTERFACE
  -Wall -Wextra -Wpedantic -Wno-missing-field-initializers $<$<CXX_COMPILER_ID:GNU>:-Wshadow=local> -Wno-psabi -fno-math-errno)
target_include_directories(knothe_flags_portable INTERFACE ${PROJECT_SOURCE_DIR} ${PROJECT_BINARY_DIR}/generated)
if(KNOTHE_SANITIZE)
  target_compile_options(knothe_flags_portable INTERFACE
    -fsanitize=${KNOTHE_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer -g1
    ${KNOTHE_SANITIZE_LESS})
  # RPATH in place of RUNPATH: dlopen is the sanitizer's own then, which does not see the program's RUNPATH.
  target_link_options(knothe_flags_portable INTERFACE -fsanitize=${KNOTHE_SANITIZE} LINKER:--disable-new-dtags)
endif()

add_library(knothe_flags INTERFACE)
target_link_libraries(knothe_flags INTERFACE knothe_flags_portable)
if(KNOTHE_NATIVE)
  # GCC 12 takes the deliberately undefined operands of its own AVX-512 intrinsics for uninitialised variables.
  target_compile_options(knothe_flags INTERFACE -march=native -Wno-uninitialized -Wno-maybe-uninitialized)
elseif(KNOTHE_ARCH)
  target_compile_options(knothe_flags INTERFACE -march=${KNOTHE_ARCH} -Wno-uninitialized -Wno-maybe-uninitialized)
endif()
# One alignment for Eigen everywhere, and no threads of its own: threads are ours (base/threads.hpp).
target_compile_definitions(knothe_flags INTERFACE EIGEN_MAX_ALIGN_BYTES=64 EIGEN_DONT_PARALLELIZE)
