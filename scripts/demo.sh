#!/usr/bin/env bash
# The main job on the coarse beam: reduced model, 100 pictures' worth of noisy data, assimilation step by step, report.
set -euo pipefail
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
bin=$PWD/build/release/bin
out=$PWD/out/demo
mkdir -p "$out"
cp examples/beam/quick.toml "$out/"
cd "$out"
echo "1/4  reduced model of the damageable beam (full-order runs on a grid of parameters)"
"$bin/knothe" offline quick.toml -o beam.h5
echo "2/4  synthetic measurements, by the full-order model"
"$bin/knothe" simulate quick.toml -o data.h5
echo "3/4  assimilation, step by step"
"$bin/knothe" assimilate quick.toml
echo "4/4  report"
"$bin/knothe" report results -o report.html
echo
../../scripts/demo_summary.py results report.html
