# Sources compiled together, N at a time, as one unit: headers are parsed and Eigen's templates compiled once per group, so a
# build from nothing takes a third of the time; but a change of one file compiles its group. `make` groups in a new build
# folder, as do the sanitizers' presets; `cmake --preset release` compiles each file alone, for those who work on one.
set(KNOTHE_UNITY 0 CACHE STRING "Sources compiled together; 0: each alone")
if(KNOTHE_UNITY)
  find_package(Python3 REQUIRED COMPONENTS Interpreter)
endif()

# knothe_unity(TARGET): which sources go together is chosen by unity_groups.py.
function(knothe_unity target)
  if(NOT KNOTHE_UNITY)
    return()
  endif()
  get_target_property(sources ${target} SOURCES)
  list(FILTER sources EXCLUDE REGEX "^${PROJECT_BINARY_DIR}/") # generated ones stay alone
  execute_process(COMMAND ${Python3_EXECUTABLE} ${PROJECT_SOURCE_DIR}/cmake/unity_groups.py ${KNOTHE_UNITY} ${sources}
                  WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR} OUTPUT_VARIABLE groups COMMAND_ERROR_IS_FATAL ANY)
  # A name that comes or goes may change the groups.
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${sources})
  foreach(source group IN ZIP_LISTS sources groups)
    set_source_files_properties(${source} PROPERTIES UNITY_GROUP ${target}_${group})
  endforeach()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
  # A type that is used in its own file alone looks to GCC as if it stood in a header. And GCC need not look for memory to
  # give back before it has 512 MB: that is an eighth of the time.
  target_compile_options(${target} PRIVATE
    $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage;SHELL:--param ggc-min-heapsize=524288>)
endfunction()
