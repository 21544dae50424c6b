#!/usr/bin/env bash
# Builds and installs the library for any x86-64 machine: once for the oldest, and beside that for newer instruction sets, of which the
# loader takes the best that the machine can run (docs/how-to/library.md).   usage: install-library.sh PREFIX [CMAKE_OPTION…]
set -euo pipefail
cd "$(dirname "$0")/.."
prefix=$(realpath -m "${1:?usage: install-library.sh PREFIX [CMAKE_OPTION…]}")
shift
for arch in "" x86-64-v3 x86-64-v4; do
  build=build/library${arch:+-$arch}
  cmake -G Ninja -S . -B "$build" -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX="$prefix" -DKNOTHE_LIBRARY=ON -DKNOTHE_ARCH="$arch" \
    -DKNOTHE_NATIVE=OFF -DKNOTHE_PROGRAMS=OFF -DKNOTHE_OFFLINE=OFF -DKNOTHE_BENCHMARKS=OFF -DBUILD_TESTING=OFF "$@"
  cmake --build "$build"
  cmake --install "$build" --component library
done
