"""How many cycles will the next sheet last, from 9 to 49.8 mm? Each record is a test of its own, of Paris' law alone; the
population of the others is the prior of one more.

usage: population.py RECORDS.csv [FIRST LAST]   leaves out each of these specimens: does the 90 % interval hold its life?

Needs the package knothe, numpy and scipy.
"""
import sys

import numpy as np

import knothe
from crack_growth import SLOPES, WIDTHS, read_records

PRIORS = {"ln_c": knothe.Normal(-8.5, 0.5), "m": knothe.Normal(3.0, 0.5)}
DESIGN = np.c_[np.ones(len(SLOPES)), SLOPES]


def fit(record, std):
    """Paris' constants of one specimen. The departure of the mean from a straight line is orthogonal to it: it moves nothing."""
    return knothe.infer(lambda p: -p @ DESIGN.T, PRIORS, observed=record, std=std, vectorized=True, method="transport")


def life(fits, others, std):
    """Draws of the cycles of a specimen of the population that the others are of."""
    curve = others.mean(axis=1)
    departure = curve - DESIGN @ np.linalg.lstsq(DESIGN, curve, rcond=None)[0]
    constants = knothe.population(fits).new_specimen
    noise = np.random.default_rng(1).normal(0, std, (len(constants), len(SLOPES)))
    return np.exp(departure - constants @ DESIGN.T + noise) @ WIDTHS


if __name__ == "__main__":
    z = read_records(sys.argv[1])
    first, last = map(int, sys.argv[2:4] or (1, z.shape[1]))
    residuals = z - DESIGN @ np.linalg.lstsq(DESIGN, z, rcond=None)[0]
    std = residuals.std()
    fits = [fit(record, std) for record in z.T]
    held = 0
    for s in range(first - 1, last):
        others = np.arange(z.shape[1]) != s
        low, high = np.quantile(life([f for f, other in zip(fits, others) if other], z[:, others], std), [0.05, 0.95])
        came = np.exp(z[:, s]) @ WIDTHS
        held += low < came < high
        print(f"specimen {s + 1}: {low:.0f} … {high:.0f} cycles, and it lasted {came:.0f}")
    print(f"{held} of {last - first + 1} in the 90 % interval")
