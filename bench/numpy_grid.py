#!/usr/bin/env python3
"""The rival of an update by quadrature: a tensor grid of two parameters in thirty lines of numpy, on the beam's model and data.

usage: numpy_grid.py MODEL.h5 DATA.h5 [NODES]   (bench/run.sh makes them; needs numpy, scipy and h5py)
Each datum joins the quadratic form of w; its density at NODES x NODES nodes (101) gives mean and standard deviation, and a window of six of
these where the grid has become too coarse for them. Prints median, 99th percentile and maximum over the steps, and by how much mean and
standard deviation are off from those of four times as many nodes along each axis.
"""
import sys
import time

import h5py
import numpy as np
from scipy.interpolate import RectBivariateSpline

with h5py.File(sys.argv[1]) as model, h5py.File(sys.argv[2]) as data:
    names = [name.decode() if isinstance(name, bytes) else name for name in model.attrs["parameters"]]
    axes = [model["parameters"][name][:] for name in names]
    place = {(*np.round(point, 9), component): i
             for i, (point, component) in enumerate(zip(model["dofs/points"][:], model["dofs/component"][:]))}
    dofs = [place[(*np.round(point, 9), component)] for point, component in zip(data["dofs/points"][:], data["dofs/component"][:])]
    space, core, lift = model["modes/space"][:][:, dofs], model["modes/time"][:], model["lift"][:][:, dofs]
    functions = [RectBivariateSpline(*axes, table, s=0) for table in model["modes/parameters/joint"][:]]
    values, std = data["values"][:], data["noise/std"][:]
PRIOR = np.array([0.9, 1.1]), np.sqrt(0.2)


class Grid:
    """Nodes in a window, the parameter functions and the prior there."""

    def __init__(self, low, high, nodes):
        self.low, self.high = np.maximum(low, [a[0] for a in axes]), np.minimum(high, [a[-1] for a in axes])
        self.nodes = [np.linspace(a, b, nodes) for a, b in zip(self.low, self.high)]
        self.w = np.stack([f(*self.nodes).ravel() for f in functions], axis=1)
        self.prior = -0.5 * sum((((x - m) / PRIOR[1]) ** 2)[s] for x, m, s in
                                zip(self.nodes, PRIOR[0], (np.s_[:, None], np.s_[None, :]))).ravel()

    def moments(self, G, g):
        log_density = self.prior + self.w @ g - 0.5 * np.einsum("ij,ij->i", self.w @ G, self.w)
        density = np.exp(log_density - log_density.max()).reshape(len(self.nodes[0]), -1)
        marginals = density.sum(1), density.sum(0)
        mean = np.array([x @ m / m.sum() for x, m in zip(self.nodes, marginals)])
        return mean, np.sqrt([(x - a) ** 2 @ m / m.sum() for x, a, m in zip(self.nodes, mean, marginals)])


def update(grid, G, g):
    mean, deviation = grid.moments(G, g)
    if np.any(12 * deviation < 0.3 * (grid.high - grid.low)):  # four nodes to a standard deviation are left
        grid = Grid(mean - 6 * deviation, mean + 6 * deviation, len(grid.nodes[0]))
        mean, deviation = grid.moments(G, g)
    return grid, mean, deviation


nodes = int(sys.argv[3]) if len(sys.argv) > 3 else 101
elapsed, off_mean, off_std = [], [], []
for repeat in range(6):
    grid = Grid([-9, -9], [9, 9], nodes)
    G, g = np.zeros((core.shape[2],) * 2), np.zeros(core.shape[2])
    for t, datum in enumerate(values):
        begin = time.perf_counter()
        weighted = (space.T @ core[t]) / std[:, None]
        G, g = G + weighted.T @ weighted, g + weighted.T @ ((datum - lift[t]) / std)
        grid, mean, deviation = update(grid, G, g)
        if repeat > 0:
            elapsed.append(1e6 * (time.perf_counter() - begin))
            continue
        exact_mean, exact = Grid(mean - 8 * deviation, mean + 8 * deviation, 4 * nodes + 1).moments(G, g)
        off_mean.append(np.max(np.abs(mean - exact_mean) / exact))
        off_std.append(np.max(np.abs(deviation / exact - 1)))
print(f"numpy {np.__version__}, {nodes} x {nodes} nodes, r = {core.shape[2]}: median {np.median(elapsed):.1f} µs   "
      f"p99 {np.quantile(elapsed, 0.99):.1f} µs   max {max(elapsed):.1f} µs   "
      f"mean off by {max(off_mean):.2g} std, std by {100 * max(off_std):.2g} %")
