#!/usr/bin/env python3
"""What the reduced model of examples/beam/quick.toml does to a posterior, for grids of runs and for `scaling`, beside posteriors of the
full-order model itself: 121 of its runs around each truth, splines of χ² between them. Data without noise, weighted as if it were 1 µm.

Columns: full-order runs (those off the grid, which only judge, in brackets) of so many load steps; seconds of CPU to make the model;
error of the displacements at the truths, rms; shift of the posterior means, in standard deviations of the full-order posterior, rms and
worst; ratio of the standard deviations; how often what the verdict says of the shift (with noise) is right within 1.5, and how
often so or both are below 0.3.

usage: reduced_model.py KNOTHE [TRUTHS] [SEED] [LOW HIGH]     (python3-h5py, python3-scipy)
       LOW, HIGH: between which both parameters are drawn, else 0.6 and 1.4
"""
import json
import os
import pathlib
import random
import resource
import subprocess
import sys
import tempfile

import h5py
import numpy
from scipy.interpolate import RectBivariateSpline, make_interp_spline

KNOTHE = str(pathlib.Path(sys.argv[1]).resolve())
TRUTHS, SEED = (int(sys.argv[2]) if len(sys.argv) > 2 else 10), (int(sys.argv[3]) if len(sys.argv) > 3 else 1)
LOW, HIGH = map(float, sys.argv[4:6]) if len(sys.argv) > 5 else (0.6, 1.4)
PROJECT = (pathlib.Path(__file__).resolve().parent.parent / "examples" / "beam" / "quick.toml").read_text()
TRUTH = "truth = { Y0 = 1.0, Ad = 1.0 }"
NOISE, STEPS = 1e-6, 100
NODES = next(line for line in PROJECT.split("\n") if line.startswith("nodes"))
SCALING = next(line for line in PROJECT.split("\n") if line.startswith("scaling"))
MODELS = [(f"tensor grid {n} x {n}", n, "", f"{n * n} (8) of {STEPS}") for n in (7, 13, 19)]
MODELS += [(f"scaling, {runs} runs", 37, f'scaling = "on"\nscaling_runs = {runs}\nscaling_steps = {steps}',
            f"{runs} (24) of {round(1.15 * steps)}") for runs, steps in ((7, 800), (13, 800), (13, 1600), (25, 1600))]
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def call(folder, *arguments, status=(0,)):
    found = subprocess.run([KNOTHE, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    if found.returncode not in status:
        sys.exit(f"knothe {' '.join(arguments)}: {found.stderr}")
    return found.stdout


def project(nodes, scaling, truth=(1, 1)):
    text = PROJECT.replace(NODES, f"nodes = {nodes}").replace(SCALING, scaling)
    return text.replace(TRUTH, "truth = { Y0 = %r, Ad = %r }" % tuple(truth))


def runs(folder, centre, reach, nodes):
    """Full-order solutions on a grid around `centre`: {(Y0, Ad): u}."""
    text = project(nodes, "")
    for value, radius, name in zip(centre, reach, ("Y0", "Ad")):
        head, tail = text.split(f"[offline.parameters.{name}]")
        tail = tail.replace("lower = 0.5", f"lower = {value - radius!r}", 1).replace("upper = 1.5", f"upper = {value + radius!r}", 1)
        text = f"{head}[offline.parameters.{name}]{tail}"
    (folder / "judge.toml").write_text(text)
    call(folder, "offline", "judge.toml", "--share", "0/1", "-o", "judge.h5")
    found = {}
    for file in (folder / "judge.h5.parts").glob("run-*.h5"):
        with h5py.File(file) as run:
            found[run["parameters/Y0"][0], run["parameters/Ad"][0]] = numpy.squeeze(run["snapshots"][:])
        file.unlink()
    return found


class Model:
    """A model of the tree form, read without knothe."""

    def __init__(self, file):
        with h5py.File(file) as model:
            self.axes = [model[f"parameters/{name}"][:] for name in ("Y0", "Ad")]
            self.space, self.time, self.lift = model["modes/space"][:], model["modes/time"][:], model["lift"][:]
            joint = numpy.moveaxis(model["modes/parameters/joint"][:], 0, -1)
            self.points = list(zip(model["dofs/points"][:].round(9).tolist(), model["dofs/component"][:].tolist()))
        self.count = joint.shape[-1]
        self.first = make_interp_spline(self.axes[0], joint.reshape(len(self.axes[0]), -1))

    def __call__(self, p, dofs=slice(None)):
        along = self.first(p[0]).reshape(len(self.axes[1]), self.count)
        w = make_interp_spline(self.axes[1], along)(p[1])
        return self.lift[:, dofs] + (self.time @ w) @ self.space[:, dofs]


def moments(first, second, misfit):
    """Mean and standard deviation of exp(−misfit / 2), flat outside of what the data say; misfits at the nodes of a grid."""
    dense = [numpy.linspace(axis[0], axis[-1], 401) for axis in (first, second)]
    density = numpy.exp(-0.5 * RectBivariateSpline(first, second, misfit - misfit.min())(*dense).clip(0))
    density /= density.sum()
    mean = numpy.array([density.sum(1) @ dense[0], density.sum(0) @ dense[1]])
    square = numpy.array([density.sum(1) @ dense[0] ** 2, density.sum(0) @ dense[1] ** 2])
    return mean, numpy.sqrt(square - mean**2)


def posterior_of(field, centre, reach, dofs, data):
    axes = [numpy.linspace(c - r, c + r, 25).clip(0.5, 1.5) for c, r in zip(centre, reach)]
    axes = [numpy.unique(axis) for axis in axes]
    misfit = [[((field((y0, ad), dofs) - data) ** 2).sum() / NOISE**2 for ad in axes[1]] for y0 in axes[0]]
    return moments(*axes, numpy.array(misfit))


def near(field, truth, dofs, data):
    """The posterior of a model: its range is widened until it holds the posterior."""
    mean, reach = numpy.array(truth), numpy.array([0.1, 0.1])
    for _ in range(8):
        mean, std = posterior_of(field, mean, reach, dofs, data)
        if numpy.all(reach > 4 * std) and numpy.all(reach < 8 * std):
            break
        reach = 5.5 * std
    return mean, std


def right_within(claim, true, least):
    claim, true = max(claim, least), max(true, least)
    return max(claim, true) <= 1.5 * min(claim, true)


def main():
    draw = random.Random(SEED)
    truths = [(draw.uniform(LOW, HIGH), draw.uniform(LOW, HIGH)) for _ in range(TRUTHS)]
    with tempfile.TemporaryDirectory() as made:
        folder = pathlib.Path(made)
        models = []
        for name, nodes, scaling, count in MODELS:
            (folder / "quick.toml").write_text(project(nodes, scaling))
            before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            call(folder, "offline", "quick.toml", "-o", f"{len(models)}.h5")
            models.append((name, nodes, scaling, count, resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before))
        read = [Model(folder / f"{k}.h5") for k in range(len(models))]
        (folder / "quick.toml").write_text(project(37, SCALING))
        rows = [[] for _ in models]
        for seed, truth in enumerate(truths, 1):
            (folder / "quick.toml").write_text(project(37, SCALING, truth))
            call(folder, "simulate", "quick.toml", "-o", "data.h5", "--seed", str(seed))
            with h5py.File(folder / "data.h5") as data:
                wanted = list(zip(data["dofs/points"][:].round(9).tolist(), data["dofs/component"][:].tolist()))
            dofs = [read[-1].points.index(sensor) for sensor in wanted]
            (exact,) = [u for p, u in runs(folder, truth, (0.01, 0.01), 3).items() if numpy.allclose(p, truth, atol=1e-9)]
            data = exact[:, dofs]
            _, guess = near(read[-1], truth, dofs, data)
            around = runs(folder, truth, 3.5 * guess, 11)
            axes = [numpy.linspace(t - 3.5 * g, t + 3.5 * g, 11) for t, g in zip(truth, guess)]
            misfit = numpy.full((11, 11), numpy.nan)
            for p, u in around.items():
                at = [int(numpy.abs(axis - value).argmin()) for axis, value in zip(axes, p)]
                if all(abs(axis[k] - value) < 1e-9 for axis, k, value in zip(axes, at, p)):
                    misfit[tuple(at)] = ((u[:, dofs] - data) ** 2).sum() / NOISE**2
            mean, std = moments(*axes, misfit)
            for k, row in enumerate(rows):
                found, width = near(read[k], truth, dofs, data)
                shift = numpy.abs(found - mean) / std
                text = project(37, SCALING, truth).replace('model = "beam.h5"', f'model = "{k}.h5"')
                (folder / "assimilate.toml").write_text(text)
                end = json.loads(call(folder, "assimilate", "assimilate.toml", "--json", status=(0, 8)).strip().split("\n")[-2])
                claim = max(end["verdict"]["model_shift_std"])
                row.append((numpy.sqrt(((read[k](truth) - exact) ** 2).mean()), shift, width / std, claim))
            print(f"truth {seed} of {TRUTHS}", file=sys.stderr)
    print("| reduced model | full-order runs of load steps | CPU, s | error, µm | shift, std: rms, worst | ratio of stds | claim within 1.5, or both below 0.3 |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for (name, _, _, count, cpu), row in zip(models, rows):
        errors, shifts, widths, claims = (numpy.array(column) for column in zip(*row))
        largest = shifts.max(1)
        within = [sum(right_within(c, s, least) for c, s in zip(claims, largest)) for least in (1e-9, 0.3)]
        print(f"| {name} | {count} | {cpu:.0f} | {1e6 * numpy.sqrt((errors**2).mean()):.4f} | {numpy.sqrt((shifts**2).mean()):.2f}, {largest.max():.2f} "
              f"| {widths.min():.2f}–{widths.max():.2f} | {within[0]}, {within[1]} of {TRUTHS} |")


main()
