#!/usr/bin/env python3
"""From picture file to forecast: how long each picture of examples/beam_pictures takes, phase by phase.

usage: picture_chain_bench.py KNOTHE PROJECT.toml [REPEATS]
PROJECT.toml names model and pictures (bench/run.sh makes them). Per picture, from its line of `knothe assimilate --json`: reading is in
`wait`, because the next picture is read and correlated while this one is assimilated. `period` is what a camera may send one after the other:
the process's time over the number of pictures. The best of the repeats by median, since other programs may run beside it.
"""
import json
import pathlib
import platform
import resource
import statistics
import subprocess
import sys
import time

knothe, project = sys.argv[1], pathlib.Path(sys.argv[2]).resolve()
repeats = int(sys.argv[3]) if len(sys.argv) > 3 else 3


def quantile(values, share):
    values = sorted(values)
    return values[min(len(values) - 1, int(share * len(values)))]


def processor():
    for line in open("/proc/cpuinfo"):
        if line.startswith("model name"):
            return line.split(":")[1].strip()
    return platform.machine()


best = None
for _ in range(repeats):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin = time.perf_counter()
    run = subprocess.run([knothe, "assimilate", str(project), "--json"], capture_output=True, text=True, cwd=project.parent)
    wall = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if run.returncode != 0:
        sys.exit(run.stderr)
    steps = [json.loads(line) for line in run.stdout.splitlines() if '"step"' in line]
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    totals = [step["elapsed_us"]["total"] / 1e3 for step in steps]
    if best is None or statistics.median(totals) < statistics.median(best[0]):
        best = totals, steps, wall, cpu, after.ru_maxrss
totals, steps, wall, cpu, memory = best
print(f"{processor()}; {len(steps)} pictures, 2 threads")
for phase in steps[0]["elapsed_us"]:
    values = [step["elapsed_us"][phase] / 1e3 for step in steps if phase in step["elapsed_us"]]
    print(f"  {phase:<12} median {statistics.median(values):7.1f} ms   p99 {quantile(values, 0.99):7.1f} ms")
print(f"  period       {1e3 * wall / len(steps):7.1f} ms a picture, {1e3 * cpu / len(steps):.1f} ms of processor time; "
      f"largest memory {memory / 1024:.0f} MB (model and results with it)")
