# The code of a wheel once more for each of KNOTHE_VARIANTS, built in a folder of its own with the same options; where the loader looks
# for it: KnotheDispatch.cmake.
include(ExternalProject)
string(REPLACE ";" "|" prefixes "${CMAKE_PREFIX_PATH}")
foreach(variant ${KNOTHE_VARIANTS})
  set(folder ${PROJECT_BINARY_DIR}/${variant})
  ExternalProject_Add(knothe_${variant} SOURCE_DIR ${PROJECT_SOURCE_DIR} BINARY_DIR ${folder} BUILD_ALWAYS ON LIST_SEPARATOR |
    CMAKE_ARGS -DKNOTHE_ARCH=${variant} -DCMAKE_BUILD_TYPE=${CMAKE_BUILD_TYPE} -DBUILD_TESTING=OFF -DKNOTHE_WHEEL=ON -DKNOTHE_NATIVE=OFF
               -DKNOTHE_OFFLINE=OFF -DKNOTHE_ARAVIS=OFF -DKNOTHE_DISPATCH=ON -DKNOTHE_UNITY=${KNOTHE_UNITY} -DKNOTHE_PYTHON=ON
               -DPython_EXECUTABLE=${Python_EXECUTABLE} -Dpybind11_DIR=${pybind11_DIR} -DCMAKE_PREFIX_PATH=${prefixes}
    BUILD_COMMAND ${CMAKE_COMMAND} --build ${folder} --target knothe_code knothe_python_code INSTALL_COMMAND "")
  add_dependencies(knothe_python knothe_${variant})
  install(FILES ${folder}/apps/knothe/libknothe-online.so ${folder}/python/libknothe-python.so
          DESTINATION knothe/lib/glibc-hwcaps/${variant} COMPONENT python)
endforeach()
