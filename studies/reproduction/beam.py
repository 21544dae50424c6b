"""The beam of the paper with all that it leaves open decided, its published values, and the reduced models of it."""
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import h5py
import numpy as np

import knothe

PROGRAM = os.environ.get("KNOTHE", "knothe")

# Rubio, Chamoin, Louf (2019), section 6
PRIOR_MEAN, PRIOR_VARIANCE = (0.9, 1.1), 0.2  # of (Y0, Ad) over their references, 6.3.1
NOISE = 1e-6  # m
NODES = 30  # measurement points, 60 dofs (6.4)
ESTIMATE, ESTIMATE_STD = (1.04, 1.00), (0.041, 0.022)  # last marginals: maxima and standard deviations
LENGTH_PRIOR = (0.04, 0.013)  # m, mean and std
LENGTH_MEAN, LENGTH_MODE = 37.2, 37.6  # mm
SECONDS_PER_STEP = 5.0  # between two pictures
HIGH_ORDER = (30, 40)  # steps of maps of higher order, Fig. 9
PICTURES = 27  # 3e-3 mm/s, a picture every 5 s, up to 0.4 mm
MODES, FEW_MODES = 6, 3  # m of the accurate model and of the biased one (6.4), the elastic one being counted

YOUNG, POISSON = 30e9, 0.23  # Pa
THRESHOLD, BRITTLENESS = 216.0, 2.25e-3  # Y0 in J/m3, Ad in m3/J: references
HEIGHT, HALF_THICKNESS, NOTCH_DEPTH = 0.1, 0.05, 0.02  # m
TRUTH = np.ones(2)


class Failed(Exception):
    """A program has failed and said why; `status` is its exit status."""

    def __init__(self, status):
        super().__init__(f"exit status {status}")
        self.status = status


def run(*words, accept=(0,)) -> str:
    """Runs knothe and gives its stdout. An interruption is passed on to it: what it has finished is kept."""
    process = subprocess.Popen([PROGRAM, *map(str, words)], stdout=subprocess.PIPE, text=True, start_new_session=True)
    try:
        out, _ = process.communicate()
    except KeyboardInterrupt:
        process.send_signal(signal.SIGINT)
        process.communicate()
        raise
    if process.returncode not in accept:
        raise Failed(process.returncode)
    return out


@dataclass(frozen=True)
class Case:
    """A choice of everything that the paper does not say. Lengths in m."""

    name: str
    what: str
    nodes: int = 5  # of the parameter grid, per axis
    element: float = 0.005
    displacement: float = 4e-4
    steps: int = 100
    layers: int = 1
    left_support: str = "line"
    crack_band: float = 0.0  # reference size of the regularised law; 0: the local law

    @property
    def notch_half_width(self) -> float:
        return 0.5 * max(self.element, 0.005)  # one element, or 5 mm where elements are smaller

    def project(self) -> str:
        band = f'\ndamage = {{ regularisation = "crack-band", reference_size = {self.crack_band} }}' if self.crack_band else ""
        axes = "".join(f"[offline.parameters.{name}]\nreference = {reference}\nlower = 0.5\nupper = 1.5\nnodes = {self.nodes}\n"
                       for name, reference in (("Y0", THRESHOLD), ("Ad", BRITTLENESS)))
        return f"""# {self.what}; knothe {knothe.__version__}
[offline]
mesh = {{ element = {self.element}, layers = {self.layers} }}
left_support = "{self.left_support}"
steps = {self.steps}
displacement = {self.displacement}
young_modulus = {YOUNG}
poisson_ratio = {POISSON}{band}
form = "tree"
modes = {self.nodes ** 2}
{axes}[simulate]
truth = {{ Y0 = 1.0, Ad = 1.0 }}
noise_std = {NOISE}
dofs = {{ random = {NODES}, face = "z", x = [-0.12, 0.12], components = ["x", "y"] }}
"""


REFERENCE = Case("reference", "elements and notch 5 mm, line supports", nodes=9)
# A guess that comes near the paper's numbers: elements (and so crack band and notch) of 20 mm, and 0.18 of the 0.4 mm reaching the
# beam, the rest being taken up by supports and plates.
SOFT = Case("coarse_soft", "elements and notch 20 mm, 0.18 of the 0.4 mm reach the beam", element=0.02, displacement=1.8e-4)
ELEMENTS_20 = Case("elements_20", "elements and notch 20 mm", element=0.02)
# One thing changed in each; the first is the quickest.
OTHERS = [Case("elements_10", "elements and notch 10 mm", element=0.01), ELEMENTS_20,
          Case("layers_2", "two layers of elements over the half thickness", layers=2),
          Case("left_face", "u_x = 0 on the whole left face", left_support="face"),
          Case("band_20", "elements and notch 5 mm, crack band of 20 mm (regularised law)", crack_band=0.02),
          Case("elements_2", "elements 2.5 mm, notch 5 mm", element=0.0025)]


def ending_at(case: Case, end_mm: float) -> Case:
    """The beam loaded to `end_mm` in as many steps."""
    return replace(case, name=f"{case.name}_to_{end_mm:g}", what=f"{case.what}, loaded to {end_mm:g} mm", displacement=1e-3 * end_mm)


@dataclass
class Options:
    folder: Path  # of the models
    quick: bool = False
    seed: int = 1
    repetitions: int = 40
    processes: int = 2
    reference: Case = REFERENCE
    soft: Case = SOFT
    others: tuple = tuple(OTHERS)

    def say(self, text):
        print(f"knothe: {text}", file=sys.stderr, flush=True)


@dataclass
class Runs:
    """All full-order runs of a grid, as coefficients of an orthonormal basis of space, to rounding: u = lift + coefficients @ space."""

    path: Path
    names: list
    nodes: list
    time: np.ndarray
    lift: np.ndarray  # t x n
    space: np.ndarray  # l x n
    coefficients: np.ndarray  # n_1 x n_2 x t x l

    @classmethod
    def read(cls, path):
        with h5py.File(path) as file:
            names = [name.decode() if isinstance(name, bytes) else name for name in file.attrs["parameters"]]
            core, joint = file["modes/time"][:], file["modes/parameters/joint"][:]
            return cls(path, names, [file["parameters"][name][:] for name in names], file["time"][:], file["lift"][:],
                       file["modes/space"][:], np.einsum("tlr,rpq->pqtl", core, joint, optimize=True))

    @property
    def size(self) -> float:
        """Norm of u over the grid, all steps and dofs."""
        return np.sqrt(sum(np.sum((self.lift + c @ self.space) ** 2) for row in self.coefficients for c in row))

    def largest(self, coefficients) -> float:
        """Largest displacement on any dof of a field without lift."""
        space = self.space.astype(np.float32)
        return float(max(np.abs(c.astype(np.float32) @ space).max() for row in coefficients for c in row))

    def separated(self, coefficients, form, modes):
        """What `knothe model import` makes of these coefficients: the modes' arrays by name. The basis being orthonormal, the same
        modes as of the whole field."""
        with tempfile.TemporaryDirectory(prefix="knothe-") as folder:
            snapshots, model = os.path.join(folder, "snapshots.h5"), os.path.join(folder, "model.h5")
            count = coefficients.shape[-1]
            with h5py.File(snapshots, "w") as file:
                file.attrs["parameters"] = self.names
                for name, nodes in zip(self.names, self.nodes):
                    file[f"parameters/{name}"] = nodes
                file["time"] = self.time[:coefficients.shape[2]]
                file["snapshots"], file["lift"] = coefficients, np.zeros(coefficients.shape[2:])
                file["dofs/points"] = np.column_stack([np.arange(count), np.zeros((count, 2))]).astype(float)  # any will do
                file["dofs/component"] = np.zeros(count, int)
            run("model", "import", snapshots, "-o", model, "--form", form, "--modes", modes)
            with h5py.File(model) as file:
                found = {name: file["modes"][name][:] for name in ("space", "time")}
                for name in ["joint"] if form == "tree" else self.names:
                    found[name] = file["modes/parameters"][name][:]
        return found

    def values(self, modes):
        """The coefficients that a canonical model has on the grid."""
        first, second = (modes[name] for name in self.names)
        return np.einsum("mp,mq,mt,ml->pqtl", first, second, modes["time"], modes["space"], optimize=True)

    def write(self, path, text, form, modes, error=(0.0, 0.0)):
        """A model's file with these modes: mesh, dofs, outputs and crack solutions as those of the runs."""
        fresh = path.with_suffix(".part")
        with h5py.File(self.path) as source, h5py.File(fresh, "w") as file:
            for name in source:
                if name not in ("modes", "truncation"):
                    source.copy(name, file)
            for name, value in source.attrs.items():
                if not name.startswith("off_grid"):
                    file.attrs[name] = value
            file.attrs["form"], file.attrs["project"] = form, text
            file.attrs["relative_error"], file.attrs["max_error_m"] = error
            units = {"space": "1", "time": "m"}
            for name, values in {**modes, "space": modes["space"] @ self.space}.items():
                data = file.create_dataset(f"modes/{name}" if name in units else f"modes/parameters/{name}", data=values)
                data.attrs["units"], data.attrs["long_name"] = units.get(name, "1"), name
                if name not in units and "basis" in source["modes/parameters/joint"].attrs:
                    data.attrs["basis"] = source["modes/parameters/joint"].attrs["basis"]
        fresh.replace(path)


def one_by_one(runs, modes):
    """Each mode the best for what those before it leave, as LATIN-PGD finds them."""
    rest, found = runs.coefficients.copy(), []
    for _ in range(modes):
        found.append(runs.separated(rest, "canonical", 1))
        rest -= runs.values(found[-1])
    return {name: np.concatenate([mode[name] for mode in found]) for name in found[0]}


def fitted_to_beginning(runs, steps, modes):
    """The best modes of the first steps; at the others only their time functions, where they fit best."""
    found = runs.separated(runs.coefficients[:, :, :steps], "canonical", modes)
    shapes = np.einsum("mp,mq,ml->mpql", *(found[name] for name in runs.names), found["space"]).reshape(modes, -1)
    every = runs.coefficients.transpose(0, 1, 3, 2).reshape(shapes.shape[1], -1)
    found["time"] = np.linalg.lstsq(shapes.T, every, rcond=None)[0]
    return found


@dataclass
class Beam:
    """A case with the project file and the models of it."""

    case: Case
    options: Options

    def __post_init__(self):
        self.options.folder.mkdir(parents=True, exist_ok=True)
        self.identity = self.case.project()
        self.project = self.path(".toml")
        self.project.write_text(self.identity.replace("[offline]\n", f"[offline]\nprocesses = {self.options.processes}\n"))
        self._runs = None

    def path(self, end):
        return self.options.folder / (self.case.name + end)

    def kept(self, path, text):
        """Whether this model's file is there, and of this case."""
        try:
            with h5py.File(path) as file:
                found = file.attrs["project"]
        except (OSError, KeyError):
            return False
        found = found.decode() if isinstance(found, bytes) else found
        return [line for line in found.splitlines() if not line.startswith("processes")] == text.splitlines()

    @property
    def runs(self) -> Runs:
        if self._runs is None:
            path = self.path(".h5")
            if not self.kept(path, self.identity):
                run("offline", self.project, "-o", path)
            self._runs = Runs.read(path)
        return self._runs

    def model(self, name, what, make) -> Path:
        """The model's file, made by `make(runs)` -> (form, modes) unless it is there and of this case."""
        path, text = self.path(f"_{name}.h5"), f"{self.identity}# {what}\n"
        if not self.kept(path, text):
            form, modes = make(self.runs)
            error = (0.0, 0.0)
            if form == "canonical":
                rest = self.runs.coefficients - self.runs.values(modes)
                error = (np.linalg.norm(rest) / self.runs.size, self.runs.largest(rest))
            self.runs.write(path, text, form, modes, error)
        return path

    # The elastic solution is taken out exactly and counted as a mode: m modes are it and m - 1 others.
    @property
    def paper(self) -> Path:
        return self.model("m6", "the elastic mode and the five best", lambda runs: (
            "canonical", runs.separated(runs.coefficients, "canonical", MODES - 1)))

    @property
    def three(self) -> Path:
        return self.model("m3", "the elastic mode and two, one by one", lambda runs: ("canonical", one_by_one(runs, FEW_MODES - 1)))

    @property
    def three_best(self) -> Path:
        return self.model("m3_best", "the elastic mode and the two best", lambda runs: (
            "canonical", runs.separated(runs.coefficients, "canonical", FEW_MODES - 1)))


def error_of(path) -> tuple:
    """Relative, and largest on any dof in m, on the grid."""
    with h5py.File(path) as file:
        return float(file.attrs["relative_error"]), float(file.attrs["max_error_m"])


def output_at_reference(path, name) -> np.ndarray:
    """A further output at the middle of the grid, (1, 1), over the steps."""
    with h5py.File(path) as file:
        values = file["outputs"][name][:]
    return values[values.shape[0] // 2, values.shape[1] // 2]


class Face:
    """The outer face of a model, for drawing: its elements and the dofs that move their nodes; `face_of` reads it once."""

    def __init__(self, path):
        with h5py.File(path) as file:
            points, cells = file["mesh/points"][:], file["mesh/cells"][:]
            dofs, components = file["dofs/points"][:], file["dofs/component"][:]
        outer = np.isclose(points[:, 2], points[:, 2].max())
        quads = np.array([cell[outer[cell]] for cell in cells if outer[cell].sum() == 4])
        angle = points[quads][:, :, :2] - points[quads][:, :, :2].mean(1, keepdims=True)
        order = np.argsort(np.arctan2(angle[..., 1], angle[..., 0]), axis=1)
        nodes, self.cells = np.unique(np.take_along_axis(quads, order, 1), return_inverse=True)
        self.cells = self.cells.reshape(-1, 4)
        self.points = points[nodes, :2]
        place = {(c, *np.round(1e9 * p).astype(int)): i for i, (p, c) in enumerate(zip(dofs, components))}
        self.dofs = [np.array([place.get((c, *np.round(1e9 * points[node]).astype(int)), -1) for node in nodes]) for c in (0, 1)]

    def component(self, field, which):
        """Of a field of all dofs at the face's nodes; 0 where it has no such dof."""
        return np.where(self.dofs[which] < 0, 0.0, np.asarray(field)[np.maximum(self.dofs[which], 0)])

    def components(self, field):
        return [self.component(field, which) for which in (0, 1)]


@lru_cache
def face_of(path) -> Face:
    return Face(path)
