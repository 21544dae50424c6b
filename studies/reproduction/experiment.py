"""Synthetic measurements of the beam, and what their assimilation gives, step by step."""
import json
import os
import tempfile
import time
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import h5py
import numpy as np

import beam
import knothe
from beam import NOISE, TRUTH

PAPER = {"form": "composed", "minimiser": "bfgs"}  # one map per datum, composed, by BFGS with the gradient


def corrected(way, when="on"):
    """A correction of model bias: two modes, and a line where it is extrapolated."""
    return {"bias_correction": when, "bias_extrapolation": way}


@lru_cache(maxsize=32)
def model_of(path) -> knothe.Model:
    return knothe.Model.load(path)


def predicted(path, sensors, p=TRUTH) -> np.ndarray:
    """What the sensors show at parameters p without noise, steps x sensors."""
    seen = model_of(path).observe(sensors)
    return np.array([seen(p, step) for step in range(len(model_of(path).times))])


@dataclass
class Draw:
    """30 nodes of the outer face with |x| <= 120 mm (6.3.1: "in the central part of the beam"), and noise."""

    sensors: knothe.Sensors
    noise: np.ndarray  # steps x sensors


def draw(of, seed) -> Draw:
    with tempfile.TemporaryDirectory(prefix="knothe-") as folder:
        path = os.path.join(folder, "data.h5")
        beam.run("simulate", of.project, "--model", of.paper, "-o", path, "--seed", seed)
        with h5py.File(path) as file:
            sensors = knothe.Sensors(file["dofs/points"][:], [int(c) for c in file["dofs/component"]])
            return Draw(sensors, file["values"][:] - predicted(of.paper, sensors))


@dataclass
class Run:
    """An assimilation from beginning to end."""

    records: list = field(default_factory=list)
    priors: list = field(default_factory=list)  # (points, density) of each parameter
    marginals: list = field(default_factory=list)  # of each step that of each parameter, (points, density), if asked for
    cpu_ms: list = field(default_factory=list)

    def __post_init__(self):
        self._arrays = None

    @property
    def means(self) -> np.ndarray:
        return np.array([record["mean"] for record in self.records])

    @property
    def stds(self) -> np.ndarray:
        return np.sqrt(np.array([np.diag(record["covariance"]) for record in self.records]))

    @property
    def mean(self):
        return self.means[-1]

    @property
    def std(self):
        return self.stds[-1]

    @property
    def orders(self):
        return [record["map_order"] for record in self.records]

    @property
    def increments(self) -> np.ndarray:
        return np.array([record["log_evidence_increment"] for record in self.records])

    @property
    def log_evidence(self) -> float:
        return self.records[-1]["log_evidence"]

    def off_by(self, truth=TRUTH) -> np.ndarray:
        """Distance of the truth from the mean in standard deviations, steps x parameters."""
        return np.abs(self.means - truth) / self.stds

    def prior_std(self) -> np.ndarray:
        """Of the truncated priors."""
        stds = []
        for points, density in self.priors:
            weights = density / density.sum()
            stds.append(np.sqrt(weights @ points**2 - (weights @ points) ** 2))
        return np.array(stds)

    def first_below(self, k, fraction) -> int:
        """The first step at which the standard deviation is below a fraction of the prior's; the number of steps if none is."""
        below = np.flatnonzero(self.stds[:, k] < fraction * self.prior_std()[k])
        return int(below[0]) if len(below) else len(self.records)

    def high_order_steps(self):
        return [step for step, order in enumerate(self.orders) if order > 1]

    def mode_of_marginal(self, k) -> float:
        points, density = self.marginals[-1][k]
        return float(points[np.argmax(density)])


def project_text(model, data, seed, method, forecasts="") -> str:
    std = np.sqrt(beam.PRIOR_VARIANCE)
    priors = "".join(f'{name} = {{ prior = "normal", mean = {mean}, std = {std} }}\n' for name, mean in zip(("Y0", "Ad"), beam.PRIOR_MEAN))
    options = "".join(f"{key} = {json.dumps(value)}\n" for key, value in method.items())
    return (f'model = "{model}"\ndata = "{data}"\n[parameters]\n{priors}[method]\ntolerance = 1e-3\nseed = {seed}\n{options}{forecasts}')


def write_data(path, times, sensors, values, precision=None, std=NOISE):
    with h5py.File(path, "w") as file:
        file["time"], file["values"] = times, values
        file["dofs/points"], file["dofs/component"] = sensors.points, np.array(sensors.components)
        if precision is None:
            file["noise/std"] = np.full(len(sensors), std)
        else:
            for name, part in zip(("data", "indices", "indptr"), precision.rows()):
                file[f"noise/precision/{name}"] = part


def assimilate(model, sensors, values, *, seed=1, steps=None, marginals=False, std=NOISE, precision=None, **method) -> Run:
    """Assimilates values, steps x sensors, of all model times or of `steps`."""
    times = model_of(model).times
    if steps is not None:
        times, values = times[steps], values[steps]
    with tempfile.TemporaryDirectory(prefix="knothe-") as folder:
        write_data(os.path.join(folder, "data.h5"), times, sensors, values, precision, std)
        project = Path(folder, "project.toml")
        project.write_text(project_text(Path(model).resolve(), "data.h5", seed, method))
        twin = knothe.Twin(project)
        run = Run()
        for datum in twin.data:
            start = time.process_time()
            result = twin.assimilate(datum)
            run.cpu_ms.append(1e3 * (time.process_time() - start))
            run.records.append(result.record)
            if marginals:
                run.marginals.append([result.marginal(k) for k in range(2)])
        run.priors = [(points, density) for _, _, points, density in result.densities]
    return run


def forecasts_of(model, sensors, values, horizons, *, seed=1, **method) -> Run:
    """The same by `knothe assimilate`, with the crack length at each of the horizons (name to model time): the records have Eq. 33 with
    a normal field besides, as `published`."""
    with tempfile.TemporaryDirectory(prefix="knothe-") as folder:
        forecast_project(folder, model, sensors, values, horizons, seed, method)
        return Run([json.loads(line) for line in Path(folder, "results", "steps.jsonl").read_text().splitlines()])


def by_inverse_map(model, sensors, values, horizons, *, seed=1, **method):
    """Crack lengths by Eq. 33 with the inverse transport map of the predicted field, from the first steps' values: mean and std, m."""
    with tempfile.TemporaryDirectory(prefix="knothe-") as folder:
        project = forecast_project(folder, model, sensors, values, horizons, seed, method)
        found = json.loads(beam.run("forecast", project, "--inverse-map", "--json"))["published"]
        return {name: np.array([found[name]["mean"], found[name]["std"]]) for name in horizons}


def forecast_project(folder, model, sensors, values, horizons, seed, method) -> Path:
    """A project in that folder, and its results there."""
    tables = "".join(f'[forecast.{name}]\nquantity = "crack_length"\nhorizon = {at}\nthreshold = {beam.LENGTH_PRIOR[0]}\n'
                     f"prior = {{ mean = {beam.LENGTH_PRIOR[0]}, std = {beam.LENGTH_PRIOR[1]} }}\n" for name, at in horizons.items())
    write_data(Path(folder, "data.h5"), model_of(model).times[:len(values)], sensors, values)
    project = Path(folder, "project.toml")
    project.write_text(project_text(Path(model).resolve(), "data.h5", seed, method, tables))
    beam.run("assimilate", project, accept=(0, 8))
    return project


class Subject:
    """One case, observed as in 6.3.1: data of its own m = 6 at the reference parameters, 30 random nodes (60 dofs)."""

    def __init__(self, case, options):
        self.beam, self.options = beam.Beam(case, options), options
        self.model = self.beam.paper
        self.drawn = draw(self.beam, options.seed)
        self.sensors = self.drawn.sensors
        self.values = predicted(self.model, self.sensors) + self.drawn.noise

    def assimilate(self, model=None, values=None, **how) -> Run:
        how.setdefault("seed", self.options.seed)
        return assimilate(model or self.model, self.sensors, self.values if values is None else values, **how)


def smoothed(values, width):
    """Moving average over `width` values around each; fewer at the ends."""
    return [np.mean(values[max(0, i - width // 2):i + (width + 1) // 2]) for i in range(len(values))]
