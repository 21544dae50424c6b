"""The plate of examples/steel_plate under tension alone, by finite elements of this file's own (plane stress, nine nodes): what
steel_plate.py compares the programs with. Run by an interpreter that has numpy, scipy and h5py.

    steel_plate_reference.py posterior RESULTS           JSON: mean and std of E and nu by dense quadrature over the data in RESULTS
    steel_plate_reference.py fields FIELD FOLDER COUNT   COUNT fields at the places of FIELD, of truths drawn from the prior; JSON: truths
"""
import json
import pathlib
import sys

import h5py
import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from scipy.interpolate import CloughTocher2DInterpolator

STRESS, STD = 106.26e6, 3.7e-7
PRIOR = ((206e9, 5e9), (0.29, 0.02))
MOTION = (1e-3, 1e-3, np.pi / 180, 1e-3)


def half_width(x):
    into = np.clip(abs(x) - 0.04, 0, 0.015)
    return 0.01 + 0.025 - np.sqrt(0.025**2 - into**2)


def mesh():
    """Nodes, and cells of nine of them: three rows of three."""
    across = np.linspace(-1, 1, 33)
    outwards = np.interp(np.linspace(0, 1, 25), np.linspace(0, 1, 13), np.linspace(0, 1, 13) ** 1.3)[:, None]
    blocks = []
    for quarter in range(4):
        angle = (across / 4 + quarter / 2) * np.pi
        circle = 0.004 * np.array([np.cos(angle), np.sin(angle)])[:, None]
        blocks.append(circle + outwards * (circle * 0.01 / abs(circle).max(axis=0) - circle))
    for begin, end, rows in (-0.065, -0.04, 21), (-0.04, -0.01, 45), (0.01, 0.04, 45), (0.04, 0.065, 21):
        x = np.linspace(begin, end, rows)[:, None] + 0 * across
        blocks.append(np.array([x, half_width(x) * np.tan(across * np.pi / 4)]))
    points, cells = {}, []
    for x, y in blocks:
        number = np.array([[points.setdefault((round(a, 8) + 0.0, round(b, 8) + 0.0), len(points)) for a, b in zip(*row)] for row in zip(x, y)])
        cells += [number[i:i + 3, j:j + 3].ravel() for i in range(0, len(x) - 2, 2) for j in range(0, 32, 2)]
    return np.array(list(points)), np.array(cells)


POINTS, CELLS = mesh()
LAGRANGE = np.array([[0, -0.5, 0.5], [1, 0, -1], [0, 0.5, 0.5]])  # of -1, 0, 1: coefficients of 1, s, s²
GAUSS = np.array([-np.sqrt(0.6), 0, np.sqrt(0.6)]), np.array([5, 8, 5]) / 9


def shapes(s):
    return LAGRANGE @ [1, s, s * s], LAGRANGE @ [0, 1, 2 * s]


def displacement(nu):
    """E u at POINTS, n × 2."""
    n = len(POINTS)
    law = np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]]) / (1 - nu**2)
    stiffness = np.zeros((len(CELLS), 18, 18))
    for s, ws in zip(*GAUSS):
        for t, wt in zip(*GAUSS):
            (a, da), (b, db) = shapes(s), shapes(t)
            slopes = np.array([np.outer(da, b).ravel(), np.outer(a, db).ravel()])
            jacobian = slopes @ POINTS[CELLS]
            gradient = np.linalg.solve(jacobian, np.broadcast_to(slopes, (len(CELLS), 2, 9)))
            strain = np.zeros((len(CELLS), 3, 18))
            strain[:, 0, 0::2] = strain[:, 2, 1::2] = gradient[:, 0]
            strain[:, 1, 1::2] = strain[:, 2, 0::2] = gradient[:, 1]
            stiffness += (ws * wt * abs(np.linalg.det(jacobian)))[:, None, None] * (strain.transpose(0, 2, 1) @ law @ strain)
    dofs = (2 * CELLS[:, :, None] + [0, 1]).reshape(len(CELLS), 18)
    rows, columns = np.repeat(dofs, 18, axis=1).ravel(), np.tile(dofs, 18).ravel()
    matrix = scipy.sparse.csc_matrix((stiffness.ravel(), (rows, columns)), (2 * n, 2 * n))
    force = np.zeros(2 * n)
    for end in (-0.065, 0.065):
        edge = np.flatnonzero(abs(POINTS[:, 0] - end) < 1e-9)
        edge = edge[np.argsort(POINTS[edge, 1])]
        for k in range(0, len(edge) - 2, 2):
            y = POINTS[edge[k:k + 3], 1]
            for s, w in zip(*GAUSS):
                value, slope = shapes(s)
                force[2 * edge[k:k + 3]] += np.sign(end) * STRESS * 0.02 / (2 * half_width(0.065)) * w * value * (slope @ y)
    fixed = [2 * np.argmin(np.hypot(POINTS[:, 0] + 0.01, POINTS[:, 1])) + k for k in (0, 1)] + [2 * np.argmin(np.hypot(POINTS[:, 0] - 0.01, POINTS[:, 1])) + 1]
    free = np.setdiff1d(np.arange(2 * n), fixed)
    u = np.zeros(2 * n)
    u[free] = scipy.sparse.linalg.spsolve(matrix[free][:, free], force[free])
    return u.reshape(n, 2)


class Plate:
    """E u at places: a polynomial in nu through five of them."""

    def __init__(self, places):
        self.nodes = np.linspace(0.2, 0.38, 5)
        self.fields = [CloughTocher2DInterpolator(POINTS, displacement(nu))(places) for nu in self.nodes]

    def at(self, nu):
        weights = [np.prod([(nu - b) / (a - b) for b in self.nodes if b != a]) for a in self.nodes]
        return sum(w * field for w, field in zip(weights, self.fields))


def posterior(results):
    with h5py.File(pathlib.Path(results) / "posterior.nc") as file:
        places = file["constant_data/points"][:, :2]
        component = file["constant_data/component"][:]
        measured = file["observed_data/displacement"][0]
    plate = Plate(places)
    arm = places - places.mean(axis=0)
    along = component == 0
    motion = np.array([along, ~along, np.where(along, -arm[:, 1], arm[:, 0]), np.where(along, arm[:, 0], arm[:, 1])]).T * MOTION / STD
    inner = np.linalg.inv(np.eye(4) + motion.T @ motion)

    def product(a, b):
        a, b = a / STD, b / STD
        return a @ b - (motion.T @ a) @ inner @ (motion.T @ b)

    e, nu = np.linspace(180e9, 235e9, 1201), np.linspace(0.2, 0.38, 181)
    log = np.empty((len(e), len(nu)))
    for k, value in enumerate(nu):
        field = plate.at(value)[np.arange(len(component)), component]
        log[:, k] = product(measured, field) / e - 0.5 * product(field, field) / e**2
    for axis, (values, (mean, std)) in enumerate(zip((e, nu), PRIOR)):
        log -= 0.5 * np.expand_dims(((values - mean) / std) ** 2, 1 - axis)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    moments = []
    for axis, values in enumerate((e, nu)):
        marginal = weight.sum(axis=1 - axis)
        mean = marginal @ values
        moments.append([mean, np.sqrt(marginal @ (values - mean) ** 2)])
    return moments


def fields(measured, folder, count):
    table = np.loadtxt(measured, delimiter=",", skiprows=1)
    places = table[::8, :2]
    places = places[(abs(places[:, 0] - 39.8) < 38) & (abs(places[:, 1] - 10.2) < 9) & (np.hypot(*(places - [39.8, 10.2]).T) > 5)]
    inside = (places - [39.8, 10.2]) / 1e3
    plate, random, truths = Plate(inside), np.random.default_rng(1), []
    arm = inside - inside.mean(axis=0)
    for k in range(count):
        e, nu = (random.normal(*prior) for prior in PRIOR)
        shift_x, shift_y, turn, towards = random.normal(size=4) * MOTION
        u = plate.at(nu) / e + [shift_x, shift_y] + turn * arm[:, ::-1] * [-1, 1] + towards * arm + STD * random.normal(size=arm.shape)
        np.savetxt(pathlib.Path(folder) / f"plate-{k}.csv", np.hstack([places, 1e3 * u]), delimiter=",", comments="",
                   header="x-coordinate [mm],y-coordinate [mm],x-displacement [mm],y-displacement [mm]")
        truths.append([e, nu])
    return truths


if __name__ == "__main__":
    arguments = sys.argv[2:]
    print(json.dumps(posterior(*arguments) if sys.argv[1] == "posterior" else fields(arguments[0], arguments[1], int(arguments[2]))))
