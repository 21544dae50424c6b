#!/usr/bin/env python3
"""Trusted means right: over the densities of densities.py, how many answers of `knothe.infer` are trusted, and of those how many are off by
more than they state, and by more than twice that (0.1 std of a mean, 5 % of a std at most).

usage: PYTHONPATH=build/release/python inference_trust.py [SEEDS [REFERENCE_POSTERIORS]]
"""
import itertools
import sys

import densities
import knothe
import numpy as np

PRIORS = {"normal": lambda a, b: knothe.Normal(a, b), "uniform": lambda a, b: knothe.Uniform(a, b), "lognormal": lambda a, b: knothe.Lognormal(a, b)}


def error_of(density, found):
    """The largest error, as a share of what is tolerated."""
    if density.mean is None or density.std is None:
        return np.inf
    columns = density.columns or range(len(density.region))
    mean, std = found.mean[list(columns)], found.std[list(columns)]
    return max(np.abs((mean - density.mean) / density.std).max() / 0.1, np.abs(std / density.std - 1).max() / 0.05)


def main():
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    published = densities.published(sys.argv[2]) if len(sys.argv) > 2 else []
    print(f"{'density':<42} trusted   off  twice   values")
    for density in itertools.chain(densities.families(), published):
        region = {f"p{k}": PRIORS[family](a, b) for k, (family, a, b) in enumerate(density.region)}
        errors, values, trusted = [], [], 0
        for seed in range(1, seeds + 1):
            found = knothe.infer(density.log, region, vectorized=True, seed=seed)
            values.append(found.record["model_evaluations"])
            if found.trusted:
                trusted += 1
                errors.append(error_of(density, found))
        print(f"{density.name:<42} {trusted:>3}/{seeds:<3} {sum(e > 1 for e in errors):>5} {sum(e > 2 for e in errors):>6} {np.mean(values):>8.0f}", flush=True)


main()
