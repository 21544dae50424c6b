#!/usr/bin/env bash
# Every C++ source is as clang-format (.clang-format) writes it; `scripts/check-format.sh fix` makes it so.
set -euo pipefail
cd "$(dirname "$0")/.."
mapfile -t sources < <(git ls-files '*.cpp' '*.hpp')
if [ "${1:-}" = fix ]; then
  clang-format -i "${sources[@]}"
elif ! clang-format --dry-run -Werror "${sources[@]}"; then
  echo "knothe: formatting differs: run scripts/check-format.sh fix" >&2
  exit 1
fi
