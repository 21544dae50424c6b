# The offline phase lives on sparse direct factorisations, and with the reference BLAS those are five times slower.
execute_process(COMMAND sh -c "readlink -f /usr/lib/*/libblas.so.3" OUTPUT_VARIABLE KNOTHE_BLAS
                OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
if(KNOTHE_BLAS MATCHES "openblas|mkl|blis")
  message(STATUS "knothe: BLAS is ${KNOTHE_BLAS}")
else()
  message(WARNING "knothe: BLAS is the reference (Netlib) build '${KNOTHE_BLAS}': the offline phase will be about "
                  "five times slower. Install a fast one: apt-get install libopenblas0-serial")
endif()
