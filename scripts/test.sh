#!/usr/bin/env bash
# test.sh PRESET…: builds each test preset of CMakePresets.json, which says the labels, and passes its tests (before `release`:
# formatting). The last line is `N passed, N failed`.
set -uo pipefail
cd "$(dirname "$0")/.."
passed=0
failed=0
failures=() # presets of which tests failed
broken=()   # what failed and is no test

# Two slots per core: tests that compute take two (PROCESSORS, cmake/KnotheRoom.cmake), those that mostly wait take one.
slots=$((2 * $(nproc)))

# One thread in BLAS: parallelism is ours.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

# What is no test and failed: a word, and the log whose end says why.
break_off() {
  failed=$((failed + 1))
  broken+=("$1 $2")
}

format() {
  if scripts/check-format.sh 2>&1 | tee build/format.log; then passed=$((passed + 1)); else break_off format build/format.log; fi
}

# Of a test preset: release-slow is of build/release.
folder_of() { local folder=${1%-slow}; echo "${folder%-full}"; }

run() {  # preset
  local folder
  folder=$(folder_of "$1")
  echo "== $1: configure and build"
  if ! scripts/configure.sh "$folder" -DBUILD_TESTING=ON >"build/$1.configure.log" 2>&1; then
    cat "build/$1.configure.log"; break_off "$1:configure" "build/$1.configure.log"; return
  fi
  grep -A4 -i warning "build/$1.configure.log"
  if ! cmake --build --preset "$folder"; then
    cmake --build --preset "$folder" >"build/$1.build.log" 2>&1 # what is wrong, without the hundreds of lines of what is not
    break_off "$1:build" "build/$1.build.log"; return
  fi
  echo "== $1: tests"
  local log="build/$1.test.log"
  ctest --preset "$1" -j "$slots" --no-tests=error 2>&1 | tee "$log"
  local total bad
  bad=$(sed -nE 's/.* ([0-9]+) tests? failed out of ([0-9]+).*/\1/p' "$log" | tail -1)
  total=$(sed -nE 's/.* ([0-9]+) tests? failed out of ([0-9]+).*/\2/p' "$log" | tail -1)
  if [ -z "$total" ]; then break_off "$1:ctest" "$log"; return; fi
  passed=$((passed + total - bad))
  failed=$((failed + bad))
  [ "$bad" -eq 0 ] || failures+=("$1")
}

# What failed and what it printed, again at the end: whoever reads only the end of a long log has to see it.
tell_failures() {
  local preset name what
  for what in "${broken[@]}"; do
    echo "== failed: ${what% *}"
    tail -40 "${what##* }"
  done
  for preset in "${failures[@]}"; do
    sed -n '/^The following tests FAILED:/,/^Errors while/p' "build/$preset.test.log"
    while IFS= read -r name; do
      echo "== failed in $preset: $name"
      awk -v name="$name" 'index($0, "/") && substr($0, index($0, "Testing: ")) == "Testing: " name { on = 1 }
                           on { print } on && /^<end of output>/ { exit }' "build/$(folder_of "$preset")/Testing/Temporary/LastTest.log" | tail -120
    done < <(sed 's/^[0-9]*://' "build/$(folder_of "$preset")/Testing/Temporary/LastTestsFailed.log" | head -20)
  done
}

mkdir -p build
for preset in "$@"; do
  case $preset in release | release-full) format ;; esac
  run "$preset"
done
tell_failures
echo "$passed passed, $failed failed"
[ "$failed" -eq 0 ]
