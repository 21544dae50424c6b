#!/usr/bin/env python3
"""Tests that drive themselves (docs/explanation/decisions.md): how often the specimen fails, and how many measurements are made.

Specimens: full-order runs of examples/driven_test at 32 x 32 points, drawn by the prior with replacement; noise of 1 um at 30 sensors. Each
is loaded as knothe decides until it says stop and, for comparison, one step of load after the other up to the same load.
A specimen fails if its crack passes 40 mm, by its own displacements: the elastic crack nearest to them, as in `knothe forecast`.

usage: driven_tests.py KNOTHE [TESTS] [SEED] [RISK]     (the package `knothe`, python3-h5py, python3-scipy; keeps out/bench/driven)
"""
import os
import pathlib
import platform
import subprocess
import sys
import warnings

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import h5py
import numpy as np
from scipy.interpolate import make_interp_spline

import knothe

KNOTHE = str(pathlib.Path(sys.argv[1]).resolve())
TESTS, SEED = (int(sys.argv[2]) if len(sys.argv) > 2 else 1000), (int(sys.argv[3]) if len(sys.argv) > 3 else 1)
RISK = float(sys.argv[4]) if len(sys.argv) > 4 else 0.05
PROJECT = (pathlib.Path(__file__).resolve().parent.parent / "examples" / "driven_test" / "driven_test.toml").read_text()
PRIOR, NODES, FIRST, THRESHOLD = ((0.9, 0.2**0.5), (1.1, 0.2**0.5)), 32, 4, 0.04


def call(folder, *arguments):
    found = subprocess.run([KNOTHE, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    if found.returncode:
        sys.exit(f"knothe {' '.join(arguments)}: {found.stderr}")


def specimens(folder, dofs_wanted):
    """Full-order displacements at the sensors, {(Y0, Ad): times x sensors}."""
    text = PROJECT.replace("nodes = 37", f"nodes = {NODES}").replace('scaling = "on"', 'scaling = "off"')
    (folder / "specimens.toml").write_text(text)
    if not (folder / "specimens.h5.parts").exists():
        call(folder, "offline", "specimens.toml", "--share", "0/1", "-o", "specimens.h5")
    found = {}
    for file in sorted((folder / "specimens.h5.parts").glob("run-*.h5")):
        with h5py.File(file) as run:
            found[run["parameters/Y0"][0], run["parameters/Ad"][0]] = np.squeeze(run["snapshots"][:])[:, dofs_wanted]
    return found


class Driver:
    """One engine for all tests: data are withdrawn afterwards, without a trace."""

    def __init__(self, project):
        self.twin, self.seconds = knothe.Twin(project), []

    def run(self, field, noise, last=None):
        """Steps at which it was measured, and results: as decided, or one step after the other up to `last`."""
        step, given, results, holds = FIRST, [], [], 0
        while step is not None:
            values = field[step] + 1e-6 * noise.standard_normal(field.shape[1])
            result = self.twin.assimilate(knothe.Datum(step, values, seq=len(given)))
            given.append(step)
            results.append(result)
            if last is not None:
                step = step + 1 if step < last else None
                continue
            self.seconds.append(1e-6 * result.record["elapsed_us"]["decision"])
            holds = holds + 1 if result.verdict.level == "reject" else 0
            done = result.decision.action == "stop" or holds == 3 or len(given) == 300
            step = None if done else int(np.argmin(abs(self.twin.times - result.decision.time)))
        for seq, step in enumerate(given):
            self.twin.withdraw(step, seq=seq)
        return given, results


class ElasticCrack:
    """The length of the elastic crack whose displacements at the sensors are nearest, in numpy."""

    def __init__(self, model, dofs):
        length, solutions = model["crack/length"][:], model["crack/coefficients"][:] @ model["crack/modes"][:][:, dofs]
        self.length = np.linspace(length[0], length[-1], 4001)
        self.fields = make_interp_spline(length, solutions)(self.length)

    def __call__(self, field, imposed):
        return self.length[np.argmin(((imposed * self.fields - field) ** 2).sum(1))]


def main():
    warnings.simplefilter("ignore", knothe.UntrustedWarning)  # the verdict is in the decision
    folder = pathlib.Path("out/bench/driven")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "decided.toml").write_text(PROJECT.replace("risk = 0.05", f"risk = {RISK!r}"))
    call(folder, "offline", "decided.toml", "-o", "beam.h5")
    call(folder, "simulate", "decided.toml", "-o", "sensors.h5")
    with h5py.File(folder / "sensors.h5") as data, h5py.File(folder / "beam.h5") as model:
        points = [list(zip(file["dofs/points"][:].round(9).tolist(), file["dofs/component"][:].tolist())) for file in (data, model)]
        dofs = [points[1].index(sensor) for sensor in points[0]]
        crack, imposed = ElasticCrack(model, dofs), model["outputs/imposed_displacement"][:].reshape(-1, len(model["time"]))[0]
    fields = specimens(folder, dofs)
    weight = np.array([np.exp(-0.5 * sum(((x - m) / s) ** 2 for x, (m, s) in zip(p, PRIOR))) for p in fields])
    draw = np.random.default_rng(SEED)
    chosen = draw.choice(len(fields), TESTS, p=weight / weight.sum())
    truths = list(fields)
    lengths = {k: np.array([crack(u, x) for u, x in zip(fields[truths[k]], imposed)]) for k in set(chosen)}
    print(f"{platform.processor() or platform.machine()}, 1 thread; {TESTS} tests, seed {SEED}, risk {RISK}")
    driver, rows = Driver(folder / "decided.toml"), []
    for number, k in enumerate(chosen):
        field = fields[truths[k]]
        steps, results = driver.run(field, np.random.default_rng([SEED, number]))
        _, monotone = driver.run(field, np.random.default_rng([SEED, number]), last=max(steps))
        enough = next((n for n, result in enumerate(monotone, 1) if result.std[0] <= results[-1].std[0]), np.inf)
        rows.append({"failed": lengths[k][: max(steps) + 1].max() > THRESHOLD, "stopped": results[-1].decision.action == "stop",
                     "measurements": len(steps), "loads": len(set(steps)), "end": driver.twin.times[max(steps)], "std": results[-1].std[0],
                     "monotone": enough, "monotone_std": monotone[-1].std[0], "monotone_all": len(monotone)})
    column = {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]}
    median = {name: np.median(values) for name, values in column.items()}
    share = column["measurements"] / column["monotone"]
    print(f"failed: {column['failed'].sum():.0f} of {TESTS}; not ended by `stop`, but by three rejects: {(1 - column['stopped']).sum():.0f}")
    print(f"medians: {median['measurements']:.0f} measurements at {median['loads']:.0f} loads, the last {median['end']:.2f}; std of Y0 {median['std']:.3f}")
    print(f"one step after the other to the same load: {median['monotone_all']:.0f} measurements, std of Y0 {median['monotone_std']:.3f}")
    print(f"measurements for the same std of Y0, decided / one step after the other: median {np.median(share):.2f}, 90 % below {np.quantile(share, 0.9):.2f}")
    print(f"a decision: median {1e3 * np.median(driver.seconds):.1f} ms, p99 {1e3 * np.quantile(driver.seconds, 0.99):.1f} ms, of {len(driver.seconds)}")
    if os.environ.get("KNOTHE_EACH"):
        for k, row in zip(chosen, rows):
            print([round(x, 3) for x in truths[k]], {name: round(float(value), 3) for name, value in row.items()})


main()
