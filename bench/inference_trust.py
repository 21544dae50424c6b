#!/usr/bin/env python3
"""Trusted means right: over the densities of densities.py, how many answers of `knothe.infer` are trusted, and of those how many are off by
more than they may be (0.1 std of a mean, 5 % of a std), by more than each states itself, and by more than twice what it states.

usage: PYTHONPATH=build/release/python inference_trust.py [--seeds N] [--first SEED] [--published REFERENCE_POSTERIORS] [--only NAME]
"""
import argparse
import itertools
import warnings

import densities
import knothe
import numpy as np

PRIORS = {"normal": knothe.Normal, "uniform": knothe.Uniform, "lognormal": knothe.Lognormal}


def errors_of(density, found):
    """The largest error as a share of what is tolerated, and of what is stated."""
    if density.mean is None or density.std is None:
        return np.inf, np.inf
    columns = list(density.columns or range(len(density.region)))
    of_mean = np.abs((found.mean[columns] - density.mean) / density.std).max()
    of_std = np.abs(found.std[columns] / density.std - 1).max()
    return tuple(max(of_mean / mean, of_std / std)
                 for mean, std in ((0.1, 0.05), (found.record["mean_error"], found.record["deviation_error"])))


def answers(density, seeds):
    """Of each seed: its values, and its errors if it is trusted; nothing without an answer."""
    region = {f"p{k}": PRIORS[family](a, b) for k, (family, a, b) in enumerate(density.region)}
    for seed in seeds:
        try:
            found = knothe.infer(density.log, region, vectorized=True, seed=seed)
        except knothe.Error:
            yield None
        else:
            yield found.record["model_evaluations"], errors_of(density, found) if found.trusted else None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--published")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # not trusted: that is counted
    seeds = range(options.first, options.first + options.seeds)
    published = densities.published(options.published) if options.published else []
    print(f"{'density':<58} trusted    off  worst   stated  twice  worst   values")
    finite, all_errors = 0, []
    for density in itertools.chain(densities.families(), published):
        if options.only not in density.name:
            continue
        given = list(answers(density, seeds))
        ended = [answer for answer in given if answer]
        errors = [errors for _, errors in ended if errors]
        off, off_stated = np.array(errors or np.empty((0, 2))).T
        print(f"{density.name:<58} {len(errors):>3}/{len(seeds):<3} {sum(off > 1):>6} {max(off, default=np.nan):>6.2f}   "
              f"{sum(off_stated > 1):>6} {sum(off_stated > 2):>6} {max(off_stated, default=np.nan):>6.2f} "
              f"{np.mean([values for values, _ in ended] or [np.nan]):>8.0f}"
              + (f"  no answer: {given.count(None)}" if None in given else ""), flush=True)
        if density.std is not None:  # else none can be trusted
            finite += len(seeds)
        all_errors += [(density.std is not None, *of_one) for of_one in errors]
    right, off, off_stated = np.array(all_errors or np.empty((0, 3))).T
    print(f"of {finite} answers to densities with finite moments {right.sum():.0f} are trusted ({right.sum() / finite:.1%}), "
          f"of others {(1 - right).sum():.0f}; of the trusted {sum(off > 1)} are off, {sum(off_stated > 1)} by more than stated, "
          f"{sum(off_stated > 2)} by more than twice that")


main()
