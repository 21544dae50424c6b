"""A model of eight parameters from the command line: runs that the program chooses, then a step and a verified point. Times are of
single calls, the solver's processes counted in.

usage: many_parameters.py KNOTHE
"""
import json
import os
import pathlib
import platform
import re
import statistics
import subprocess
import sys
import tempfile
import time

FORMULA = """import math, sys
p = [float(text) for text in sys.argv[1:]]
with open("formula.csv", "w") as file:
    file.write("time,a,b,c,d\\n")
    for k in range(1, 21):
        t = 0.15 * k
        row = [t] + [sum(math.exp(-(0.5 + 0.3 * i) * t * (1 + 0.4 * 0.5**i * x)) * math.cos(0.7 * i * s + 0.3 * s * t) for i, x in enumerate(p))
                     for s in range(4)]
        file.write(",".join(map(repr, row)) + "\\n")
"""
names = [f"p{i}" for i in range(1, 9)]
project = ['model = "model.h5"', 'data = "data.h5"', 'results = "results/"', "[parameters]"]
project += [f'{name} = {{ prior = "uniform", lower = -1, upper = 1 }}' for name in names]
project += ["[offline]", "modes = 30", "adaptive = { grid_shift = 0.1, runs = 300 }", "[offline.command]",
            'run = ["python3", "-S", "formula.py", ' + ", ".join(f'"{{{{{name}}}}}"' for name in names) + "]",
            'files = ["formula.py"]', 'field = "formula.csv"']
for name in names:
    project += [f"[offline.parameters.{name}]", "lower = -1", "upper = 1"]
project += ["[simulate]", "truth = { " + ", ".join(f"{name} = {0.3 * (-1) ** i}" for i, name in enumerate(names)) + " }", "seed = 1",
            "[simulate.noise]"] + [f"{sensor} = 0.05" for sensor in "abcd"]

print(f"machine: {platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    (folder / "formula.py").write_text(FORMULA)
    (folder / "p.toml").write_text("\n".join(project) + "\n")

    def run(*words):
        begin = time.perf_counter()
        done = subprocess.run([sys.argv[1], *words], cwd=folder, check=True, capture_output=True, text=True)
        return time.perf_counter() - begin, done.stdout

    seconds, said = run("offline", "p.toml", "-o", "model.h5")
    print(f"offline: {re.search(r'([0-9]+) full-order runs', said)[1]} runs, {seconds:.1f} s")
    run("simulate", "p.toml", "-o", "data.h5")
    _, said = run("assimilate", "p.toml", "--json")
    updates = sorted(1e-6 * line["elapsed_us"]["update"] for line in map(json.loads, said.splitlines()) if "elapsed_us" in line)
    print(f"update of {len(updates)} steps: median {statistics.median(updates):.2f} s, p99 {updates[-1]:.2f} s")
    seconds, _ = run("model", "verify", "p.toml", "model.h5", "--points", "1")
    print(f"model verify: {seconds:.1f} s a point")
