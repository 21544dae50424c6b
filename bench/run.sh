#!/usr/bin/env bash
# Runs every benchmark of the project (or those whose name contains $1): machine, threads, median and p99 are printed by each.
set -euo pipefail
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
for program in build/release/bench/*_bench; do
  case "$program" in *"${1:-}"*) echo "== $(basename "$program")"; "$program";; esac
done
