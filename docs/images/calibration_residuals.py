#!/usr/bin/env python3
"""Draws calibration-residuals.png: residuals of one drawn camera, its lens described and not described.

usage: PYTHONPATH=build/release/python docs/images/calibration_residuals.py
"""
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as pyplot

FOLDER = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent.parent / "bench"))
import drawn_rigs
import knothe.calibration
import knothe.plot

observed, target, sizes, _ = drawn_rigs.rig(5, cameras=1, noise=0.1)
figure, axes = pyplot.subplots(1, 2, figsize=(8, 3), layout="constrained")
for each, distortion, what in zip(axes, (["k1", "k2", "p1", "p2"], []), ("k1, k2, p1, p2 estimated", "no distortion estimated")):
    found = knothe.calibration.calibrate(observed, target, sizes, distortion=distortion)
    knothe.plot.calibration(found, axes=[each])
    each.set_title(f"{what}: {each.get_title().partition(': ')[2]}", fontsize="small")
    print(what, found, [reason.message for reason in found.verdict.reasons])
figure.savefig(FOLDER / "calibration-residuals.png", dpi=100)
