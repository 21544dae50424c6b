# Sources compiled together, N at a time, as one unit: headers are parsed and Eigen's templates compiled once per group, so
# a build from nothing takes half the time; but a change of one file compiles its group. Hence where nobody waits for one
# file: the sanitizers' presets, and the test programs of `make test` in a new build folder (scripts/test.sh). The rooms'
# libraries are never grouped in a release build: what the compiler inlines, and so the last bit of a result, stays one.
set(KNOTHE_UNITY 0 CACHE STRING "Sources of a library compiled together; 0: each alone")
set(KNOTHE_UNITY_PROGRAMS ${KNOTHE_UNITY} CACHE STRING "Sources of a test program compiled together; 0: each alone")
if(KNOTHE_UNITY OR KNOTHE_UNITY_PROGRAMS)
  find_package(Python3 REQUIRED COMPONENTS Interpreter)
endif()

# knothe_unity(TARGET SIZE): which sources go together is chosen by unity_groups.py.
function(knothe_unity target size)
  if(NOT size)
    return()
  endif()
  get_target_property(sources ${target} SOURCES)
  list(FILTER sources EXCLUDE REGEX "^/") # generated ones stay alone
  execute_process(COMMAND ${Python3_EXECUTABLE} ${CMAKE_SOURCE_DIR}/cmake/unity_groups.py ${size} ${sources}
                  WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR} OUTPUT_VARIABLE groups COMMAND_ERROR_IS_FATAL ANY)
  # A name that comes or goes may change the groups.
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${sources})
  foreach(source group IN ZIP_LISTS sources groups)
    set_source_files_properties(${source} PROPERTIES UNITY_GROUP ${target}_${group})
  endforeach()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
  # A type that is used in its own file alone looks to GCC as if it stood in a header.
  target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
endfunction()
