# knothe_test_program(TARGET LABEL): its tests told to ctest, its sources in groups. Released programs are compiled with -O3, tests
# with -O2: what they time or compare is in the libraries, and -O3 here is half as long again.
# scripts/test.sh runs two slots per core: a test that computes takes two (PROCESSORS 2), one that mostly waits, as those of
# tests/cases do for servers, files and other programs, takes one.
function(knothe_test_program target label)
  knothe_unity(${target})
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O2>)
  gtest_discover_tests(${target} PROPERTIES LABELS ${label} PROCESSORS 2 TIMEOUT 600 DISCOVERY_TIMEOUT 60)
endfunction()

# knothe_room(NAME SOURCES … TESTS … BENCHES … PUBLIC … PRIVATE … [PORTABLE])
# One room of the house: a static library knothe_NAME, one test program of all its tests, one program per benchmark.
# PORTABLE: no machine-specific instructions (rooms that include deal.II).
function(knothe_room name)
  cmake_parse_arguments(ROOM "PORTABLE" "" "SOURCES;TESTS;BENCHES;PUBLIC;PRIVATE" ${ARGN})
  if(ROOM_PORTABLE)
    set(flags knothe_flags_portable)
  else()
    set(flags knothe_flags)
  endif()
  add_library(knothe_${name} STATIC ${ROOM_SOURCES})
  target_link_libraries(knothe_${name} PUBLIC ${flags} ${ROOM_PUBLIC} PRIVATE ${ROOM_PRIVATE})
  knothe_unity(knothe_${name})
  if(BUILD_TESTING AND ROOM_TESTS)
    add_executable(knothe_${name}_tests ${ROOM_TESTS})
    target_link_libraries(knothe_${name}_tests PRIVATE knothe_${name} ${ROOM_PRIVATE} GTest::gtest_main)
    knothe_test_program(knothe_${name}_tests ${name})
  endif()
  if(KNOTHE_BENCHMARKS)
    foreach(source ${ROOM_BENCHES})
      get_filename_component(stem ${source} NAME_WE)
      add_executable(${stem} EXCLUDE_FROM_ALL ${source})  # not for `make test`: bench/run.sh builds them
      add_dependencies(benchmarks ${stem})
      target_link_libraries(${stem} PRIVATE knothe_${name} ${ROOM_PRIVATE} benchmark::benchmark)
      set_target_properties(${stem} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bench)
    endforeach()
  endif()
endfunction()
