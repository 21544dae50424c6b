"""Scores of the forecasts of the last 24 specimens (docs/benchmarks/crack-growth.md), and their picture.

usage: crack_growth.py RECORDS.csv RESULTS [PICTURE.svg]     RESULTS: the folder of the folders specimen_25/ to specimen_48/ that
`knothe assimilate` left. Prints one line of JSON.
"""
import json
import math
import pathlib
import sys

import numpy as np
from scipy.stats import norm, t

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "examples" / "crack_growth"))
import crack_growth as model  # noqa: E402
from panel import Panel, picture  # noqa: E402

TESTED = range(model.TRAINED, 48)
ENDS = [int(np.argmin(abs(model.LENGTHS[model.SEEN + 1:] - horizon))) for horizon in model.HORIZONS]


def normal_crps(mean, std, y):
    u = (y - mean) / std
    return std * (u * (2 * norm.cdf(u) - 1) + 2 * norm.pdf(u) - 1 / math.sqrt(math.pi))


def forecasts(results):
    """Mean and standard deviation, specimens × horizons × 2, after the last datum."""
    table = []
    for specimen in TESTED:
        lines = (results / f"specimen_{specimen + 1}" / "steps.jsonl").read_text().splitlines()
        last = [line for line in map(json.loads, lines) if "forecast" in line][-1]["forecast"]
        names = [f"cycles_to_{str(horizon).replace('.', '_')}" for horizon in model.HORIZONS]
        table.append([[last[name]["mean"], last[name]["std"]] for name in names])
    return np.array(table)


def of_knothe(table, cycles):
    held = np.abs(cycles - table[:, :, 0]) < norm.ppf(0.95) * table[:, :, 1]
    return held, normal_crps(table[:, :, 0], table[:, :, 1], cycles)


def of_regression(z, cycles):
    """ln of the cycles from 12 mm on against ln of those before, a line through the first 24, for each horizon."""
    early = np.log(np.exp(z[:model.SEEN]).T @ model.WIDTHS[:model.SEEN])
    design = np.c_[np.ones(len(early)), early]
    old, new = design[:model.TRAINED], design[model.TRAINED:]
    levels = (np.arange(2000) + 0.5) / 2000
    held, scores = [], []
    for y in np.log(cycles).T:
        line, *_ = np.linalg.lstsq(old, y[:model.TRAINED], rcond=None)
        freedom = model.TRAINED - 2
        variance = ((y[:model.TRAINED] - old @ line) ** 2).sum() / freedom
        stds = np.sqrt(variance * (1 + np.einsum("ij,jk,ik->i", new, np.linalg.inv(old.T @ old), new)))
        held.append(np.abs(y[model.TRAINED:] - new @ line) < stds * t(freedom).ppf(0.95))
        scores.append([model.crps(np.exp(mean + std * t(freedom).ppf(levels)), truth)
                       for mean, std, truth in zip(new @ line, stds, np.exp(y[model.TRAINED:]))])
    return np.array(held).T, np.array(scores).T


def of_plain_paris(z, cycles):
    """ln C and m of a specimen, their prior from least squares of the first 24, independent residuals, and nothing else."""
    design = np.c_[np.ones(len(z)), model.SLOPES]
    lines, *_ = np.linalg.lstsq(design, z[:, :model.TRAINED], rcond=None)
    variance = ((z[:, :model.TRAINED] - design @ lines) ** 2).mean()
    prior, seen = np.cov(lines), design[:model.SEEN]
    gain = prior @ seen.T @ np.linalg.inv(seen @ prior @ seen.T + variance * np.eye(model.SEEN))
    held, scores = [], []
    for specimen in TESTED:
        mean = lines.mean(axis=1) + gain @ (z[:model.SEEN, specimen] - seen @ lines.mean(axis=1))
        draws = np.random.default_rng(specimen).multivariate_normal(mean, prior - gain @ seen @ prior, 4000)
        paths = (np.exp(draws @ design[model.SEEN:].T) * model.WIDTHS[model.SEEN:]).cumsum(axis=1)[:, ENDS]
        low, high = np.quantile(paths, [0.05, 0.95], axis=0)
        held.append((low < cycles[specimen]) & (cycles[specimen] < high))
        scores.append([model.crps(*pair) for pair in zip(paths.T, cycles[specimen])])
    return np.array(held), np.array(scores)


def summary(held, scores):
    return {"held_at_the_end": int(held[:, -1].sum()), "held": held.sum(axis=0).tolist(), "crps_at_the_end": float(scores[:, -1].mean()),
            "crps": scores.mean(axis=0).tolist(), "crps_of_the_curve": float(scores.mean())}


def draw(table, cycles, held):
    """Left: the 24 curves and the forecast of one; right: the intervals of all at 49.8 mm. Thousands of cycles."""
    left = Panel((60, 30, 330, 330), (12, 50), (0, 250))
    for path in cycles[model.TRAINED:] / 1e3:
        left.path([12, *model.HORIZONS], [0, *path], 'fill="none" stroke="#bbb"')
    mean, reach = table[0, :, 0] / 1e3, norm.ppf(0.95) * table[0, :, 1] / 1e3
    left.path([12, *model.HORIZONS, *model.HORIZONS[::-1]], [0, *(mean + reach), *(mean - reach)[::-1]],
              'fill="#2b6cb0" fill-opacity="0.25"', " Z")
    left.path([12, *model.HORIZONS], [0, *mean], 'fill="none" stroke="#2b6cb0" stroke-width="2"')
    left.path([12, *model.HORIZONS], [0, *cycles[model.TRAINED] / 1e3], 'fill="none" stroke="#c05621" stroke-width="2"')
    left.axes(range(15, 50, 10), range(0, 251, 50), "cycles from 12 mm on, in thousands", "half crack length, mm")
    right = Panel((450, 30, 330, 330), (24, 49), (140, 250))
    for i, (mean, std) in enumerate(table[:, -1] / 1e3):
        reach, specimen = norm.ppf(0.95) * std, model.TRAINED + 1 + i
        right.path([specimen] * 2, [mean - reach, mean + reach], 'stroke="#2b6cb0" stroke-width="4" stroke-opacity="0.45"')
        colour = "#333" if held[i, -1] else "#c53030"
        right.dot(specimen, cycles[model.TRAINED + i, -1] / 1e3, f'fill="{colour}"')
    right.axes(range(25, 49, 5), range(140, 251, 20), "to 49.8 mm: 90 % intervals and what came", "specimen")
    return picture([left, right])


if __name__ == "__main__":
    z = model.read_records(sys.argv[1])
    cycles = (np.exp(z[model.SEEN:]).T * model.WIDTHS[model.SEEN:]).cumsum(axis=1)[:, ENDS]
    table = forecasts(pathlib.Path(sys.argv[2]))
    knothe = of_knothe(table, cycles[model.TRAINED:])
    print(json.dumps({"horizons": model.HORIZONS, "knothe": summary(*knothe), "regression": summary(*of_regression(z, cycles)),
                      "plain_paris": summary(*of_plain_paris(z, cycles))}))
    if len(sys.argv) > 3:
        pathlib.Path(sys.argv[3]).write_text(draw(table, cycles, knothe[0]))
