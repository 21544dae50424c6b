# knothe_test_program(TARGET LABEL [SLOW …] [SANITIZER_SKIP …]): its tests told to ctest, its sources in groups. Released programs are
# compiled with -O3, tests with -O2: what they time or compare is in the libraries, and -O3 here is half as long again.
# scripts/test.sh runs two slots per core: a test that computes takes two (PROCESSORS 2), one that mostly waits, as those of
# tests/cases do for servers, files and other programs, takes one.
# SLOW: tests, as --gtest_filter writes them, with a long form beside the short one: the same again as <name>.slow, with KNOTHE_SLOW=1
# (knothe/base/testing/long_form.hpp) and the label `slow`. A short form of 10 s is too long. SANITIZER_SKIP: what takes a sanitizer
# minutes and runs nothing that others do not; the label `sanitizer-skip`.
function(knothe_test_program target label)
  cmake_parse_arguments(PROGRAM "" "" "SLOW;SANITIZER_SKIP" ${ARGN})
  knothe_unity(${target})
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O2>)
  set(skipped)
  if(KNOTHE_SANITIZE)
    set(skipped ${PROGRAM_SANITIZER_SKIP})
  endif()
  list(JOIN skipped ":" skipped)
  list(JOIN PROGRAM_SLOW ":" slow)
  set(others)
  if(skipped)
    set(others TEST_FILTER "-${skipped}")
    gtest_discover_tests(${target} TEST_FILTER "${skipped}"
                         PROPERTIES LABELS sanitizer-skip PROCESSORS 2 TIMEOUT 600 DISCOVERY_TIMEOUT 60)
  endif()
  gtest_discover_tests(${target} ${others} PROPERTIES LABELS ${label} PROCESSORS 2 TIMEOUT 600 DISCOVERY_TIMEOUT 60)
  if(slow AND NOT KNOTHE_SANITIZE)
    gtest_discover_tests(${target} TEST_FILTER "${slow}" TEST_SUFFIX .slow
                         PROPERTIES LABELS slow ENVIRONMENT KNOTHE_SLOW=1 PROCESSORS 2 TIMEOUT 1200 DISCOVERY_TIMEOUT 60)
  endif()
endfunction()

# knothe_embed_page(FILE FUNCTION NAMESPACE VARIABLE OTHERWISE): a source that holds dashboard/dist/FILE, or the text OTHERWISE where that
# was not built; its path is in VARIABLE.
function(knothe_embed_page file name namespace variable otherwise)
  set(page ${PROJECT_SOURCE_DIR}/dashboard/dist/${file})
  set(out ${CMAKE_CURRENT_BINARY_DIR}/${name}.cpp)
  set(dependency)
  if(EXISTS ${page})
    set(dependency ${page})
  endif()
  add_custom_command(OUTPUT ${out} DEPENDS ${dependency} ${PROJECT_SOURCE_DIR}/cmake/embed_page.cmake VERBATIM
                     COMMAND ${CMAKE_COMMAND} -DPAGE=${page} -DNAME=${name} -DNAMESPACE=${namespace} "-DOTHERWISE=${otherwise}"
                             -DOUT=${out} -P ${PROJECT_SOURCE_DIR}/cmake/embed_page.cmake)
  set(${variable} ${out} PARENT_SCOPE)
endfunction()

# knothe_room(NAME SOURCES … TESTS … BENCHES … PUBLIC … PRIVATE … [PORTABLE] [SLOW …] [SANITIZER_SKIP …])
# One room of the house: a static library knothe_NAME, one test program of all its tests, one program per benchmark.
# PORTABLE: no machine-specific instructions (rooms that include deal.II).
function(knothe_room name)
  cmake_parse_arguments(ROOM "PORTABLE" "" "SOURCES;TESTS;BENCHES;PUBLIC;PRIVATE;SLOW;SANITIZER_SKIP" ${ARGN})
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
    knothe_test_program(knothe_${name}_tests ${name} SLOW ${ROOM_SLOW} SANITIZER_SKIP ${ROOM_SANITIZER_SKIP})
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
