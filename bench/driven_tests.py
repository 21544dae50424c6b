#!/usr/bin/env python3
"""Tests that drive themselves (docs/explanation/decisions.md): how often the specimen fails, and how many measurements are made.

Specimens: full-order runs of examples/driven_test at 32 x 32 points, drawn by the prior with replacement; noise of 1 um at 30 sensors. Each
is loaded as knothe decides until it says stop, with all later times to choose from and, for comparison, one step of load at a time.
A specimen fails if its crack passes 40 mm, by its own displacements: the elastic crack nearest to them, as in `knothe forecast`.

usage: driven_tests.py KNOTHE [TESTS] [SEED] [RISK]     (the package `knothe`, python3-h5py, python3-scipy)
"""
import os
import pathlib
import platform
import subprocess
import sys
import tempfile

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import h5py
import numpy as np
from scipy.interpolate import make_interp_spline

import knothe

KNOTHE = str(pathlib.Path(sys.argv[1]).resolve())
TESTS, SEED = (int(sys.argv[2]) if len(sys.argv) > 2 else 1000), (int(sys.argv[3]) if len(sys.argv) > 3 else 1)
RISK = float(sys.argv[4]) if len(sys.argv) > 4 else 0.05
PROJECT = (pathlib.Path(__file__).resolve().parent.parent / "examples" / "driven_test" / "driven_test.toml").read_text()
PRIOR, BOX, NODES, FIRST, THRESHOLD = ((0.9, 0.2**0.5), (1.1, 0.2**0.5)), (0.5, 1.5), 32, 4, 0.04


def call(folder, *arguments):
    found = subprocess.run([KNOTHE, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    if found.returncode:
        sys.exit(f"knothe {' '.join(arguments)}: {found.stderr}")


def specimens(folder, dofs_wanted):
    """Full-order displacements at the sensors, {(Y0, Ad): times x sensors}."""
    text = PROJECT.replace("nodes = 37", f"nodes = {NODES}").replace('scaling = "on"', 'scaling = "off"')
    (folder / "specimens.toml").write_text(text)
    call(folder, "offline", "specimens.toml", "--share", "0/1", "-o", "specimens.h5")
    found = {}
    for file in sorted((folder / "specimens.h5.parts").glob("run-*.h5")):
        with h5py.File(file) as run:
            found[run["parameters/Y0"][0], run["parameters/Ad"][0]] = np.squeeze(run["snapshots"][:])[:, dofs_wanted]
    return found


class Driven:
    """One engine for all tests: data are withdrawn afterwards, without a trace."""

    def __init__(self, project):
        self.twin, self.times = knothe.Twin(project), None
        self.seconds = []

    def run(self, field, noise):
        """Steps at which it was measured, results."""
        step, given, results, holds = FIRST, [], [], 0
        while True:
            values = field[step] + 1e-6 * noise.standard_normal(field.shape[1])
            datum = knothe.Datum(step, values, seq=len(given))
            given.append(datum)
            result = self.twin.assimilate(datum)
            self.seconds.append(1e-6 * result.record["elapsed_us"]["decision"])
            results.append(result)
            holds = holds + 1 if result.verdict.level == "reject" else 0
            if result.decision.action == "stop" or holds == 3 or len(given) == 300:
                break
            step = int(np.argmin(abs(self.twin.times - result.decision.time)))
        for datum in given:
            self.twin.withdraw(datum.step, seq=datum.seq)
        return [datum.step for datum in given], results


class ElasticCrack:
    """The length of the elastic crack whose displacements at the sensors are nearest, in numpy."""

    def __init__(self, model, dofs):
        length, solutions = model["crack/length"][:], model["crack/coefficients"][:] @ model["crack/modes"][:][:, dofs]
        self.length = np.linspace(length[0], length[-1], 4001)
        self.fields = make_interp_spline(length, solutions)(self.length)

    def __call__(self, field, imposed):
        return self.length[np.argmin(((imposed * self.fields - field) ** 2).sum(1))]


def tell(name, rows, steps_of, fails):
    """A line of the table."""
    measured = np.array([len(steps) for steps, _ in rows])
    std = np.array([results[-1].std[0] for _, results in rows])
    ends = [results[-1] for _, results in rows]
    stopped = sum(end.decision.action == "stop" for end in ends)
    print(f"{name:<28} {fails:>5} of {len(rows)}   {measured.mean():6.1f} {np.median(measured):5.0f}   {np.median(std):.4f}   "
          f"{np.median([steps_of[max(steps)] for steps, _ in rows]):.3f}   {len(rows) - stopped}")


def main():
    with tempfile.TemporaryDirectory() as made:
        folder = pathlib.Path(made)
        (folder / "decided.toml").write_text(PROJECT.replace("risk = 0.05", f"risk = {RISK!r}"))
        (folder / "one-by-one.toml").write_text((folder / "decided.toml").read_text() + "increments = [0.01]\n")
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
        print(f"{'':<28} failed         measurements   std Y0   load   not stopped\n{'':<44}mean median  median   median")
        rows, seconds = {}, []
        for name in ("decided", "one-by-one"):
            driven = Driven(folder / f"{name}.toml")
            rows[name] = [driven.run(fields[truths[k]], np.random.default_rng([SEED, number])) for number, k in enumerate(chosen)]
            fails = sum(lengths[k][: max(steps) + 1].max() > THRESHOLD for k, (steps, _) in zip(chosen, rows[name]))
            tell(name, rows[name], driven.twin.times, fails)
            seconds += driven.seconds
        needed = []
        for (steps, results), (_, slow) in zip(rows["decided"], rows["one-by-one"]):
            enough = [k for k, result in enumerate(slow, 1) if result.std[0] <= results[-1].std[0]]
            needed.append(len(steps) / (enough[0] if enough else len(slow)))
        print(f"measurements for the same std of Y0, decided / one by one: median {np.median(needed):.2f}, 90 % below {np.quantile(needed, 0.9):.2f}")
        print(f"a decision: median {1e3 * np.median(seconds):.1f} ms, p99 {1e3 * np.quantile(seconds, 0.99):.1f} ms, of {len(seconds)}")


main()
