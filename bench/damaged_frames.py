#!/usr/bin/env python3
"""Drawn frames of four storeys: how often knothe.modes finds and locates a loss of stiffness, and how often it finds one that is none.

Storeys scatter by 15 % from frame to frame and soften by 0.2 % per kelvin; natural frequencies are identified to 0.5 % (--scatter), mode shapes
to 3 % of their norm, of any sign, scale and order, in half of the sessions without one of the modes; temperatures scatter by 10 K. Ten
sessions are the baseline, one is the inspection.

usage: PYTHONPATH=build/release/python damaged_frames.py [--cases N] [--loss SHARE] [--scatter SHARE] [--inspections N]
"""
import argparse
import platform
import time

import knothe
import knothe.modes
import numpy as np

STOREYS, STIFFNESS, MASS = 4, 2e7, 1e4
ELEMENTS = [f"k{i}" for i in range(STOREYS)]
PRIORS = {**{f"k{i}": knothe.Lognormal(np.log(STIFFNESS), 0.3) for i in range(STOREYS)}, "softening": knothe.Normal(0.002, 0.001)}


def structure(p, temperature):
    kept = 1 - p["softening"] * (temperature - 15)
    return knothe.modes.frame([p[f"k{i}"] * kept for i in range(STOREYS)], [MASS] * STOREYS)


def drawn(seed, scatter=0.005):
    """A frame, and a function that identifies its modes, or those of another."""
    rng = np.random.default_rng(seed)
    truth = {f"k{i}": np.array([STIFFNESS * np.exp(0.15 * rng.standard_normal())]) for i in range(STOREYS)}
    truth["softening"] = np.array([0.002 + 0.0005 * rng.standard_normal()])

    def session(p):
        temperature = 15 + 10 * rng.standard_normal()
        frequencies, shapes = (each[0] for each in structure(p, temperature))
        frequencies = frequencies * np.exp(scatter * rng.standard_normal(STOREYS))
        shapes = shapes / np.linalg.norm(shapes, axis=1)[:, None] + 0.03 * rng.standard_normal(shapes.shape)
        shapes = shapes * (rng.choice([-1, 1], STOREYS) * np.exp(rng.standard_normal(STOREYS)))[:, None]
        kept = rng.permutation(STOREYS)[:STOREYS - rng.integers(2)]
        return knothe.modes.Modes(frequencies[kept], shapes[kept], temperature)

    return truth, session


def learnt(sessions, seed, scatter=0.005, **options):
    return knothe.modes.learn(structure, sessions, PRIORS, knothe.modes.Scatter(scatter, 0.03), seed=seed, **options)


def counted(cases, loss, scatter=0.005, inspections=1, evaluations=0):
    """Of so many frames with a loss: found, located; and false alarms of as many without."""
    found = located = false_alarms = 0
    for case in range(cases):
        truth, session = drawn(case, scatter)
        where, options = f"k{case % STOREYS}", {"inference": {"evaluations": evaluations}} if evaluations else {}
        baseline = learnt([session(truth) for _ in range(10)], case + 1, scatter, **options)
        hurt = {**truth, where: truth[where] * (1 - loss)}
        after, same = ([session(p) for _ in range(inspections)] for p in (hurt, truth))
        with_loss = baseline.assess(after, ELEMENTS)
        found, located = found + with_loss.alarm, located + (with_loss.alarm and with_loss.located == where)
        false_alarms += baseline.assess(same, ELEMENTS).alarm
    return found, located, false_alarms


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--inspections", type=int, default=1)
    for name, default in (("loss", 0.25), ("scatter", 0.005)):
        parser.add_argument(f"--{name}", type=float, default=default)
    given = parser.parse_args()
    began = time.process_time()
    found, located, false_alarms = counted(given.cases, given.loss, given.scatter, given.inspections)
    print(f"{platform.machine()}, numpy {np.__version__}: loss {given.loss:g}, frequencies to {given.scatter:g}, {given.cases} frames: found {found}, "
          f"located {located}, false alarms {false_alarms} ({time.process_time() - began:.0f} s of CPU)")


if __name__ == "__main__":
    main()
