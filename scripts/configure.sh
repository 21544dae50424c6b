#!/usr/bin/env bash
# configure.sh PRESET [OPTION…]: configures build/PRESET; in a new folder with sources in groups, for nobody waits for one file
# (cmake/KnotheUnity.cmake). What follows in the same folder compiles nothing again: `make test` after `make demo`.
set -euo pipefail
cd "$(dirname "$0")/.."
grouped=()
[ -e "build/$1/CMakeCache.txt" ] || grouped=(-DKNOTHE_UNITY=8)
exec cmake --preset "$1" "${grouped[@]}" "${@:2}"
