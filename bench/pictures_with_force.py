#!/usr/bin/env python3
"""Pictures and a load cell, the stiffness unknown (docs/how-to/pictures-with-a-load-cell.md): examples/beam_pictures with E and a force.

One test against dense quadrature; the same without the force; a machine whose clock is off; then tests of truths drawn from the prior, each
with pictures of a full-order run: how many 90 % intervals hold.

usage: pictures_with_force.py KNOTHE [TESTS] [SEED]     (the package `knothe`, python3-h5py; keeps out/bench/pictures_with_force)
"""
import itertools
import json
import os
import pathlib
import platform
import subprocess
import sys
import time

os.environ |= {"OPENBLAS_NUM_THREADS": "2"}

import h5py
import numpy as np

import knothe

KNOTHE = str(pathlib.Path(sys.argv[1]).resolve())
TESTS, SEED = (int(sys.argv[2]) if len(sys.argv) > 2 else 200), (int(sys.argv[3]) if len(sys.argv) > 3 else 1)
EXAMPLE = pathlib.Path(__file__).resolve().parent.parent / "examples" / "beam_pictures" / "beam_pictures.toml"
NAMES, MEAN, STD, LOWER, UPPER = ("Y0", "Ad", "E"), (0.9, 1.1, 1.0), (0.2**0.5, 0.2**0.5, 0.1), (0.5, 0.5, 0.7), (1.5, 1.5, 1.3)
NOISE = 6.0  # N
CHANGES = (('pictures = "pictures/"', f'pictures = "pictures/"\nfile = "pictures/machine.csv"\n[data.std]\nreaction_force = {NOISE}'),
           ("\n[method]", "E = { prior = \"normal\", mean = 1.0, std = 0.1 }\n\n[method]"),
           ("\n[simulate]\n", "\n[offline.parameters.E]\nreference = 37e9\nlower = 0.7\nupper = 1.3\nnodes = 13\n\n[simulate]\n"),
           ('bias_correction = "on"', 'bias_correction = "off"'),  # 0.3 s an update, beside three parameters
           ('mesh = "model"', 'mesh = "model"\ntolerance = 1e-5'),
           ("[simulate.camera]\n", f"[simulate.noise]\nreaction_force = {NOISE}\n\n[simulate.camera]\nevery = 10\n"))


def call(folder, *arguments, statuses=(0,)):
    found = subprocess.run([KNOTHE, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    if found.returncode not in statuses:
        sys.exit(f"knothe {' '.join(arguments)}: {found.stderr}")
    return found.stdout


def project_of(truth, seed):
    text = EXAMPLE.read_text()
    for old, new in CHANGES:
        if old not in text:
            sys.exit(f"{EXAMPLE} has no {old!r}")
        text = text.replace(old, new, 1)
    text = text.replace("truth = { Y0 = 1.07, Ad = 0.93 }\nseed = 1", f"truth = {{ {', '.join(f'{n} = {x!r}' for n, x in zip(NAMES, truth))} }}\nseed = {seed}")
    return text


def assimilated(folder, name):
    """The last step's line; the command says by its status what it thinks of it."""
    lines = map(json.loads, call(folder, "assimilate", name, "--json", statuses=(0, 7, 8)).strip().split("\n"))
    return [line for line in lines if "covariance" in line][-1]


def draw(folder, truth, seed):
    (folder / "test.toml").write_text(project_of(truth, seed))
    for old in (folder / "pictures").glob("*"):
        old.unlink()
    call(folder, "simulate", "test.toml", "--images", "-o", "pictures")


def residual_precisions(displacements):
    """Sensors, values (times x dofs), and the precisions of the pictures' scatter about their mean and of that mean times the root of their number:
    the noise of the reference is shared by all."""
    with h5py.File(displacements) as file:
        values, csr = file["values"][:], file["noise/precision"]
        references = int(file["noise"].attrs.get("shared_reference", csr.attrs.get("shared_reference")))
        precision = np.zeros((values.shape[1],) * 2)
        for i in range(len(precision)):
            row = slice(csr["indptr"][i], csr["indptr"][i + 1])
            precision[i, csr["indices"][row]] = csr["data"][row]
        sensors = knothe.Sensors(file["dofs/points"][:], file["dofs/component"][:].tolist(), series=["reaction_force"])
    one = np.linalg.inv(precision)
    shared = one / (references + 1)
    return sensors, values, np.linalg.inv(one - shared), np.linalg.inv(one - shared + len(values) * shared)


def quadrature(folder, line):
    """Mean and standard deviations by a grid of 25^3 points about the answer, which is no more than where to look; in numpy."""
    call(folder, "dic", "test.toml", "-o", "u.h5")
    sensors, values, scatter, middle = residual_precisions(folder / "u.h5")
    observed = knothe.Model.load(str(folder / "beam.h5")).observe(sensors)
    forces = np.loadtxt(folder / "pictures" / "machine.csv", delimiter=",", skiprows=1)[9::10, 1]
    factor, nodes = np.linalg.cholesky(np.array(line["covariance"])), np.linspace(-6, 6, 25)
    points = np.array(line["mean"]) + np.array(list(itertools.product(nodes, repeat=3))) @ factor.T
    points = points[((points > LOWER) & (points < UPPER)).all(1)]
    log = -0.5 * (((points - MEAN) / STD) ** 2).sum(1)
    total = np.zeros((len(points), values.shape[1]))
    for step, (field, force) in enumerate(zip(values, forces)):
        residual = np.hstack([field, force]) - observed(points, 10 * step + 9)
        log -= 0.5 * (np.einsum("ij,ij->i", residual[:, :-1] @ scatter, residual[:, :-1]) + (residual[:, -1] / NOISE) ** 2)
        total += residual[:, :-1]
    mean = total / len(values)
    log += 0.5 * len(values) * np.einsum("ij,ij->i", mean @ (scatter - middle), mean)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    found = weight @ points
    return found, np.sqrt(weight @ (points - found) ** 2)


def main():
    folder = pathlib.Path("out/bench/pictures_with_force")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores")
    truth = (1.07, 0.93, 1.04)
    if not (folder / "beam.h5").exists():
        (folder / "test.toml").write_text(project_of(truth, 1))
        call(folder, "offline", "test.toml", "-o", "beam.h5")
    draw(folder, truth, 1)
    line = assimilated(folder, "test.toml")
    mean, std = quadrature(folder, line)
    print("one test, against quadrature: means off by", (np.array(line["mean"]) - mean) / std, "std; ratio of std",
          np.sqrt(np.diag(line["covariance"])) / std, line["verdict"]["level"])
    text = (folder / "test.toml").read_text()
    (folder / "test.toml").write_text(text.replace('file = "pictures/machine.csv"\n[data.std]', "[data.std]").replace(f"reaction_force = {NOISE}\n", "", 1))
    line = assimilated(folder, "test.toml")
    print("without:", line["verdict"]["level"], [r["message"] for r in line["verdict"]["reasons"]], line["mean"], np.sqrt(np.diag(line["covariance"])))
    random, inside, levels = np.random.default_rng(SEED), [], []
    while len(inside) < TESTS:
        truth = random.normal(MEAN, STD)
        if ((truth < LOWER) | (truth > UPPER)).any():
            continue
        draw(folder, [float(x) for x in truth], len(inside) + 1)
        line = assimilated(folder, "test.toml")
        low, high = np.array(line["mean"]) - 1.645 * np.sqrt(np.diag(line["covariance"])), np.array(line["mean"]) + 1.645 * np.sqrt(np.diag(line["covariance"]))
        inside.append((low < truth) & (truth < high))
        levels.append(line["verdict"]["level"])
        if os.environ.get("KNOTHE_EACH"):
            print(truth.round(3), np.round((np.array(line["mean"]) - truth) / np.sqrt(np.diag(line["covariance"])), 1), levels[-1], flush=True)
    print(f"{TESTS} tests, seed {SEED}: 90 % intervals that hold: {dict(zip(NAMES, np.sum(inside, 0).tolist()))};",
          {level: levels.count(level) for level in ("ok", "caution", "reject")})


main()
