#!/usr/bin/env python3
"""How long the programs take to begin: commands that end before any work, 41 times each.

usage: start_bench.py FOLDER_OF_THE_PROGRAMS
"""
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

RUNS = 41


def times(*command):
    """(wall, CPU) of each run, s."""
    for _ in range(RUNS):
        start, before = time.perf_counter(), os.times()
        subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
        wall, after = time.perf_counter() - start, os.times()
        yield wall, after.children_user + after.children_system - before.children_user - before.children_system


def main():
    folder = pathlib.Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as elsewhere:
        missing = os.path.join(elsewhere, "missing.toml")
        print(f"{'command':44} {'wall, ms: median':>16} {'least':>6} {'CPU, ms: mean':>15} {'libraries':>10}")
        for name, *words in (("knothe", "--help"), ("knothe-offline", "--help"), ("knothe-offline", "offline", "--bad"),
                             ("knothe-offline", "offline", missing, "-o", "model.h5")):
            program = folder / name
            wall, cpu = zip(*times(program, *words))
            libraries = len(subprocess.run(["ldd", program], capture_output=True, text=True, check=True).stdout.splitlines())
            shown = " ".join([name, *words]).replace(elsewhere + "/", "")
            print(f"{shown:44} {1e3 * statistics.median(wall):16.1f} {1e3 * min(wall):6.1f} {1e3 * statistics.mean(cpu):15.1f} {libraries:10}")


if __name__ == "__main__":
    main()
