#!/usr/bin/env bash
# The service on the coarse beam, fed by a simulated camera with 10 (RATE) pictures' worth of displacements a second. Ctrl-C ends it.
set -euo pipefail
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
bin=$PWD/build/release/bin
out=$PWD/out/live
mkdir -p "$out"
if [ ! -f "$out/beam.h5" ]; then
  cp examples/beam/quick.toml "$out/model.toml"
  if [ -f out/demo/beam.h5 ]; then cp out/demo/beam.h5 "$out/"; else (cd "$out" && "$bin/knothe" offline model.toml -o beam.h5); fi
fi
(cd "$out" && cp ../../examples/beam/quick.toml model.toml && "$bin/knothe" simulate model.toml --model beam.h5 -o data.h5 >/dev/null)
rate=${RATE:-10}
# Each run has a journal of its own.
name=live-$(date +%Y%m%d-%H%M%S)
{ cat examples/beam/quick.toml; printf '\n[serve]\nsite = "beam"\nperiod = %s\n' "$(python3 -c "print(1 / $rate)")"; } >"$out/$name.toml"
"$bin/knothe" serve "$out/$name.toml" --port "${PORT:-8080}" >"$out/url" 2>"$out/log" &
service=$!
trap 'kill -INT $service 2>/dev/null; wait $service 2>/dev/null || true' EXIT
while [ ! -s "$out/url" ]; do kill -0 $service || { cat "$out/log"; exit 1; }; sleep 0.1; done
url=$(cat "$out/url")
echo "Open $url"
sleep 1
python3 scripts/live_feed.py "$url" --rate "$rate" ${STEPS:+--steps $STEPS}
echo "The test is over; the page stays until Ctrl-C. Journal: $out/$name.journal"
[ -n "${STEPS:-}" ] || wait $service
