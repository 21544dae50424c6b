#!/usr/bin/env python3
"""The last five lines of `make demo`: what was seen, and what to open.

usage: demo_summary.py RESULTS REPORT.html
"""
import json
import math
import pathlib
import sys


def rounded(mean, std):
    """To the decimals of the standard deviation's second digit."""
    decimals = max(0, 1 - math.floor(math.log10(std)))
    return f"{mean:.{decimals}f} ± {std:.{decimals}f}"


def imposed(time):
    """What is imposed at the model's step nearest to that time."""
    nearest = min(range(len(curve["time"])), key=lambda i: abs(curve["time"][i] - time))
    return f"{1e3 * curve['displacement'][nearest]:.3g} mm"


results, report = map(pathlib.Path, sys.argv[1:])
summary = json.loads((results / "summary.json").read_text())
steps = [json.loads(line) for line in (results / "steps.jsonl").read_text().splitlines()]
last, curve = steps[-1], summary["load_displacement"]
parameters, truths, distances = [], [], []
shifts = summary["verdict"]["model_shift_std"] or [0] * len(summary["parameters"])  # by the reduced model's own error
for k, parameter in enumerate(summary["parameters"]):
    std = math.sqrt(last["covariance"][k][k]) * math.hypot(1, shifts[k])  # ± as the report has it
    parameters.append(f"{parameter['name']} = {rounded(last['mean'][k], std)}")
    truths.append(f"{parameter['truth']:g}")
    distances.append(f"{abs(last['mean'][k] - parameter['truth']) / std:.1f}")
horizon = summary["forecasts"]["crack"]["horizon"]
ahead = [step for step in steps if step["time"] <= 0.85 * horizon][-1]
early, late = (rounded(1e3 * f["mean"], 1e3 * f["std"]) for f in (ahead["forecast"]["crack"], last["forecast"]["crack"]))
levels = [step["verdict"]["level"] for step in steps]
words = {"ok": "usable", "caution": "usable with caveats", "reject": "do not use"}[summary["verdict"]["level"]]
print(f"Result: {words}; verdict ok at {levels.count('ok')} of {len(levels)} steps.")
print(f"Parameters: {', '.join(parameters)}; true values {', '.join(truths)} ({', '.join(distances)} σ away).")
print(f"Crack at {imposed(horizon)}: {early} mm by the forecast at {imposed(ahead['time'])}, {late} mm after all data.")
print(f"Open {report.resolve()} in a browser: the result, the specimen, all figures.")
print("Next: make demo-live, the same test live on a page; docs/tutorials/beam.md, step by step.")
