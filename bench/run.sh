#!/usr/bin/env bash
# Runs every benchmark of the project, or those of the room $1 (bench/run.sh transport), or those whose name contains $1;
# each prints machine, threads, median and p99 (accuracy_bench: tables of accuracy).
set -euo pipefail
cd "$(dirname "$0")/.."
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
knothe=$PWD/build/release/bin/knothe

# Models of the beam with r = 10 and r = 30, and synthetic data, for the benchmark of the update.
beam() {
  local folder=out/bench/r$1
  mkdir -p "$folder"
  sed -e "s/^modes = .*/modes = $1/" examples/beam/beam.toml >"$folder/beam.toml"
  [ -f "$folder/data.h5" ] && return
  "$knothe" offline "$folder/beam.toml" -o "$folder/beam.h5" >/dev/null
  "$knothe" simulate "$folder/beam.toml" --model "$folder/beam.h5" -o "$folder/data.h5"
}

cmake --preset release -DKNOTHE_BENCHMARKS=ON >/dev/null
cmake --build --preset release --target benchmarks
for program in build/release/bench/*_bench; do
  name=$(basename "$program")
  if [ -n "${1:-}" ] && [ -d "knothe/$1" ]; then
    [ -n "$(find "knothe/$1" -name "$name.cpp")" ] || continue
  else
    case "$name" in *"${1:-}"*) ;; *) continue ;; esac
  fi
  echo "== $name"
  if [ "$name" = update_bench ]; then
    for r in 10 30; do
      beam $r
      for method in auto transport; do "$program" out/bench/r$r/beam.toml 10 $method; done
      /usr/bin/python3 bench/numpy_grid.py out/bench/r$r/beam.h5 out/bench/r$r/data.h5 # the rival
    done
  else
    "$program"
  fi
done

case start_bench in *"${1:-}"*)
  echo "== start_bench"
  python3 bench/start_bench.py "$(dirname "$knothe")"
esac

# From picture file to forecast: model, pictures (drawn once), all 100 assimilated three times.
case picture_chain_bench in *"${1:-}"*)
  echo "== picture_chain_bench"
  folder=out/bench/pictures
  mkdir -p "$folder"
  cp examples/beam_pictures/beam_pictures.toml "$folder"
  [ -f "$folder/beam.h5" ] || "$knothe" offline "$folder/beam_pictures.toml" -o "$folder/beam.h5" >/dev/null
  [ -f "$folder/pictures/pictures.csv" ] || "$knothe" simulate "$folder/beam_pictures.toml" --images -o "$folder/pictures"
  python3 bench/picture_chain_bench.py "$knothe" "$folder/beam_pictures.toml"
esac

case driven_tests in *"${1:-}"*)
  echo "== driven_tests"
  PYTHONPATH=build/release/python /usr/bin/python3 bench/driven_tests.py "$knothe"
esac

case pictures_with_force in *"${1:-}"*)
  echo "== pictures_with_force"
  PYTHONPATH=build/release/python /usr/bin/python3 bench/pictures_with_force.py "$knothe"
esac

case inference_calls in *"${1:-}"*)
  echo "== inference_calls"
  python3 bench/inference_calls.py "$knothe"
esac

case real_pictures_bench in *"${1:-}"*)
  echo "== real_pictures_bench"
  /usr/bin/python3 bench/real_pictures_bench.py "$knothe"
esac

case many_parameters in *"${1:-}"*)
  echo "== many_parameters"
  python3 bench/many_parameters.py "$knothe"
esac

case reduced_model in *"${1:-}"*)
  echo "== reduced_model"
  /usr/bin/python3 bench/reduced_model.py "$knothe"
esac

case service_ages in *"${1:-}"*)
  echo "== service_ages"
  /usr/bin/python3 bench/service_ages.py "$knothe" out/bench/ages
esac

case service_bench in *"${1:-}"*)
  echo "== service_bench"
  beam 30
  python3 bench/service_bench.py "$knothe" out/bench/r30/beam.toml
esac
