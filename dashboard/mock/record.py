#!/usr/bin/env python3
"""Makes recording.json.gz, which the mock server replays: real lines of `knothe assimilate --json` on the coarse beam, with the
fields the service would answer with. Run again when the format of the lines changes:

    apt-get install python3-h5py
    /usr/bin/python3 mock/record.py ../build/release/bin

The data are spoilt on purpose: steps 52 to 57 have no datum, steps 33 to 35 do not exist, some sensors fall out at times.
Fields are kept at every tenth step as 16-bit numbers; the mock interpolates between them.
"""
import base64
import gzip
import json
import pathlib
import subprocess
import sys
import tempfile

import h5py
import numpy

HERE = pathlib.Path(__file__).resolve().parent
BEAM = HERE.parent.parent / "examples" / "beam" / "quick.toml"
THRESHOLDS = (("threshold = 0.04", "threshold = 0.0283"), ("threshold = 0.04", "threshold = 0.0704"),
              ("threshold = 1000.0", "threshold = 1390.0"))  # where the probabilities stay worth looking at
NO_DATUM, NO_STEP = range(52, 58), range(33, 36)
DRAWS = 100


def run(program, *arguments, folder):
    done = subprocess.run([program, *map(str, arguments)], cwd=folder, capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def spoil(path):
    """Takes data away: whole steps, and single sensors."""
    random = numpy.random.default_rng(7)
    with h5py.File(path, "r+") as file:
        values = file["values"][:]
        values[NO_DATUM.start:NO_DATUM.stop] = numpy.nan
        values[20:45, 7] = numpy.nan
        values[60:, 41] = numpy.nan
        for step in random.choice(len(values), 25, replace=False):
            values[step, random.choice(values.shape[1], 3)] = numpy.nan
        keep = [i for i in range(len(values)) if i not in NO_STEP]
        for name, content in (("time", file["time"][:][keep]), ("values", values[keep])):
            attributes = dict(file[name].attrs)
            del file[name]
            file[name] = content
            file[name].attrs.update(attributes)
        return file["time"][:], values[keep]


def packed(array):
    """16 bits per number, scaled by the largest."""
    scale = float(numpy.abs(array).max()) / 32000 or 1.0
    return {"scale": scale, "shape": list(array.shape),
            "int16": base64.b64encode(numpy.round(array / scale).astype("<i2").tobytes()).decode()}


def rounded(value, digits=6):
    return [rounded(v, digits) for v in value] if isinstance(value, list) else float(f"{value:.{digits}g}")


def main():
    programs = pathlib.Path(sys.argv[1]).resolve()
    knothe = programs / "knothe"
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        project = BEAM.read_text()
        for old, new in THRESHOLDS:
            project = project.replace(old, new, 1)
        (folder / "quick.toml").write_text(project)
        run(knothe, "offline", "quick.toml", "-o", "beam.h5", folder=folder)
        run(knothe, "simulate", "quick.toml", "--model", "beam.h5", "-o", "data.h5", folder=folder)
        times, values = spoil(folder / "data.h5")
        lines = run(knothe, "assimilate", "quick.toml", "--json", folder=folder)[:-1]
        summary = json.loads((folder / "results" / "summary.json").read_text())
        names = [p["name"] for p in summary["parameters"]]
        with h5py.File(folder / "beam.h5") as model, h5py.File(folder / "data.h5") as data, \
                h5py.File(folder / "results" / "posterior.nc") as posterior:
            mesh = {"points": rounded(model["mesh/points"][:].tolist()),
                    "cells": [{"type": "hexahedron", "connectivity": model["mesh/cells"][:].tolist()}]}
            dofs = numpy.column_stack([model["dofs/points"][:], model["dofs/component"][:]])
            nodes = model["mesh/points"][:]
            sensors = numpy.column_stack([data["dofs/points"][:], data["dofs/component"][:]])
            std = data["noise/std"][:]
            chosen = numpy.random.default_rng(1)
            draws = numpy.stack([points[chosen.choice(len(points), DRAWS, p=weights / weights.sum())] for points, weights in zip(
                posterior["weighted_posterior/points"][:], posterior["weighted_posterior/weights"][:])], axis=1)  # draw × step × parameter
        # Dofs of the model in the order node × component.
        where = {(*numpy.round(d[:3], 7), int(d[3])): i for i, d in enumerate(dofs)}
        order = numpy.array([[where[(*numpy.round(x, 7), c)] for c in range(3)] for x in nodes])
        observed = [where[(*numpy.round(s[:3], 7), int(s[3]))] for s in sensors]
        fields, residual = {}, []
        for i, line in enumerate(lines):
            model_step = round(line["time"] * 100) - 1
            at = ",".join(f"{n}={m!r}" for n, m in zip(names, line["mean"]))
            keep = i % 10 == 0 or i == len(lines) - 1
            answer = run(knothe, "model", "evaluate", "beam.h5", "--at", at, "--step", model_step, "--json",
                         *(["--derivatives"] if keep else []), folder=folder)[0]
            u = numpy.array(answer["values"])
            residual.append([None if numpy.isnan(v) else rounded((v - p) / s, 4)
                             for v, p, s in zip(values[i].tolist(), u[observed].tolist(), std.tolist())])
            if keep:
                gradient = numpy.array(answer["gradient"])
                fields[i] = {"displacement": packed(u[order]),
                             **{f"sensitivity:{n}": packed(gradient[:, k][order]) for k, n in enumerate(names)}}
        priors = [{"name": p["name"], "prior": p["prior"], "lower": p["lower"], "upper": p["upper"], "units": p["units"],
                   "quantiles": prior_quantiles(summary["prior_marginals"][p["name"]])} for p in summary["parameters"]]
        recording = {
            "lines": lines, "mesh": mesh, "sensors": [{"x": s[0], "y": s[1], "z": s[2], "component": int(s[3])}
                                                      for s in rounded(sensors.tolist())],
            "parameters": priors, "forecasts": [{"name": n, "quantity": f["quantity"], "horizon": f["horizon"], "threshold": f["threshold"],
                                                       "units": f["unit"]} for n, f in summary["forecasts"].items()],
            "residual": residual, "samples": rounded(draws.transpose(1, 0, 2).tolist(), 4), "fields": fields,
            "steps": 100, "version": summary["created_by"].split()[-1]}
        with gzip.GzipFile(HERE / "recording.json.gz", "wb", 9, mtime=0) as file:
            file.write(json.dumps(recording, separators=(",", ":")).encode())


def prior_quantiles(marginal, levels=(0.025, 0.25, 0.5, 0.75, 0.975)):
    points, density = numpy.array(marginal["points"]), numpy.array(marginal["density"])
    mass = numpy.concatenate([[0], numpy.cumsum(0.5 * (density[1:] + density[:-1]) * numpy.diff(points))])
    return {"levels": list(levels), "values": rounded(numpy.interp(levels, mass / mass[-1], points).tolist())}


if __name__ == "__main__":
    main()
