#!/usr/bin/env python3
"""Trusted means right: over the densities of densities.py, how many answers of `knothe.infer` are trusted, and of those how many are off by
more than they may be (0.1 std of a mean, 5 % of a std), and by more than twice that.

usage: PYTHONPATH=build/release/python inference_trust.py [--seeds N] [--first SEED] [--published REFERENCE_POSTERIORS] [--only NAME]
"""
import argparse
import itertools

import densities
import knothe
import numpy as np

PRIORS = {"normal": knothe.Normal, "uniform": knothe.Uniform, "lognormal": knothe.Lognormal}


def error_of(density, found):
    """The largest error, as a share of what is tolerated."""
    if density.mean is None or density.std is None:
        return np.inf
    columns = list(density.columns or range(len(density.region)))
    mean, std = found.mean[columns], found.std[columns]
    return max(np.abs((mean - density.mean) / density.std).max() / 0.1, np.abs(std / density.std - 1).max() / 0.05)


def answers(density, seeds):
    """Of each seed: its values, and its error if it is trusted; nothing without an answer."""
    region = {f"p{k}": PRIORS[family](a, b) for k, (family, a, b) in enumerate(density.region)}
    for seed in seeds:
        try:
            found = knothe.infer(density.log, region, vectorized=True, seed=seed)
        except knothe.Error:
            yield None
        else:
            yield found.record["model_evaluations"], error_of(density, found) if found.trusted else None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--published")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    published = densities.published(options.published) if options.published else []
    print(f"{'density':<42} trusted    off  twice  worst   values")
    all_seeds, all_errors = 0, []
    for density in itertools.chain(densities.families(), published):
        if options.only not in density.name:
            continue
        given = list(answers(density, seeds))
        ended = [answer for answer in given if answer]
        errors = [error for _, error in ended if error is not None]
        print(f"{density.name:<42} {len(errors):>3}/{len(seeds):<3} {sum(e > 1 for e in errors):>6} {sum(e > 2 for e in errors):>6}"
              f" {max(errors, default=np.nan):>6.2f} {np.mean([values for values, _ in ended] or [np.nan]):>8.0f}"
              + (f"  no answer: {given.count(None)}" if None in given else ""), flush=True)
        if density.std is not None:  # else none can be trusted
            all_seeds += len(seeds)
        all_errors += errors
    print(f"of {all_seeds} answers to densities with finite moments {len(all_errors)} are trusted ({len(all_errors) / all_seeds:.1%}),"
          f" {sum(e > 1 for e in all_errors)} of them off, {sum(e > 2 for e in all_errors)} by more than twice")


main()
