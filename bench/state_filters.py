#!/usr/bin/env python3
"""Filters of knothe.states on Lorenz's models, at the published setting of Spantini, Baptista and Marzouk (2022): RMSE of the mean, spread,
cover of 90 % intervals, seconds of CPU.

Lorenz-63: all three observed every 0.1, noise N(0, 4), process noise N(0, 1e-4). Lorenz-96: 40 states, every second one observed every 0.4,
noise N(0, 0.5).

usage: PYTHONPATH=build/release/python state_filters.py 63|96 [--cycles N] [--seeds N] [--method NAME] [--members N] [--inflation F] [--order P]
       [--radius R]       one line; without --method the table
"""
import argparse
import platform
import time

import knothe
import knothe.states
import numpy as np


def runge_kutta(rates, x, dt, count):
    for _ in range(count):
        a = rates(x)
        b = rates(x + dt / 2 * a)
        c = rates(x + dt / 2 * b)
        x = x + dt / 6 * (a + 2 * b + 2 * c + rates(x + dt * c))
    return x


def lorenz_63(x):
    return np.stack([10 * (x[:, 1] - x[:, 0]), x[:, 0] * (28 - x[:, 2]) - x[:, 1], x[:, 0] * x[:, 1] - 8 / 3 * x[:, 2]], 1)


def lorenz_96(x):
    return (np.roll(x, -1, 1) - np.roll(x, 2, 1)) * np.roll(x, 1, 1) - x + 8


def model_63():
    return knothe.states.StepModel(lambda x, p, u, t, dt: runge_kutta(lorenz_63, x, 0.05, 2), np.eye(3), mean=[1.5, -1.5, 25.0], covariance=2.0,
                                   noise=2.0, process_noise=1e-2, dt=0.1)


def model_96():
    return knothe.states.StepModel(lambda x, p, u, t, dt: runge_kutta(lorenz_96, x, 0.01, 40), np.eye(40)[::2], mean=np.full(40, 2.0),
                                   covariance=3.0, noise=0.5**0.5, dt=0.4)


def measured(case, cycles, seed, method, **options):
    """RMSE, spread, cover and seconds; the first cycles, up to 200, are left out."""
    model = model_63() if case == 63 else model_96()
    start = model.simulate(200, seed=seed + 100, noise=False, state=np.random.default_rng(seed).standard_normal(model.dimension) + 1)[0][-1]
    truth, data = model.simulate(cycles, state=start, seed=seed)
    began = time.process_time()
    found = knothe.states.estimate(model, data, method, seed=seed, **options)
    spent = time.process_time() - began
    rest = slice(min(200, cycles // 4), None)
    rmse = np.sqrt(np.mean((found.mean - truth)[rest]**2, 1)).mean()
    low, high = found.interval(0.9)
    return rmse, np.sqrt(np.mean(found.std[rest]**2, 1)).mean(), np.mean(((low < truth) & (truth < high))[rest]), spent


def line(case, cycles, seeds, method, radius, **options):
    options = {name: value for name, value in options.items() if value is not None}
    if radius:
        options["localisation"] = knothe.states.Localisation.ring(40, radius, range(0, 40, 2))
    values = np.array([measured(case, cycles, seed, method, **options) for seed in range(1, seeds + 1)])
    rmse, spread, cover, spent = values.mean(0)
    said = " ".join(f"{name} {value}" for name, value in options.items() if name != "localisation") + (f" radius {radius:g}" if radius else "")
    print(f"Lorenz-{case} {method} {said}: RMSE {rmse:.3f} ± {values[:, 0].std():.3f}, spread {spread:.3f}, cover {100 * cover:.1f} %, "
          f"{spent:.1f} s", flush=True)


TABLE = {63: [{"method": "unscented"}, {"method": "ensemble", "members": 500}, {"method": "map", "members": 200, "inflation": 1.05},
              {"method": "map", "members": 500, "inflation": 1.05}, {"method": "particle", "members": 4000, "jitter": 0.1}],
         96: [{"method": "ensemble", "members": 100, "inflation": 1.05, "radius": 7.3}, {"method": "map", "members": 100, "inflation": 1.05, "radius": 5.0},
              {"method": "ensemble", "members": 200, "inflation": 1.04, "radius": 9.0}, {"method": "map", "members": 200, "inflation": 1.04, "radius": 7.0}]}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", type=int, choices=(63, 96))
    parser.add_argument("--cycles", type=int, default=2000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--method")
    parser.add_argument("--radius", type=float, default=0.0)
    for name, kind in (("members", int), ("inflation", float), ("order", int), ("jitter", float)):
        parser.add_argument(f"--{name}", type=kind)
    given = vars(parser.parse_args())
    case, method = given.pop("case"), given.pop("method")
    print(f"{platform.machine()}, numpy {np.__version__}, {given['cycles']} cycles, seeds 1 to {given['seeds']}")
    for options in [{**given, "method": method}] if method else [{**given, **row} for row in TABLE[case]]:  # a row's own options count
        line(case, **options)


if __name__ == "__main__":
    main()
