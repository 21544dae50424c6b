#!/usr/bin/env python3
"""What `knothe.infer` costs beside the model: CPU time for a density of five dimensions that costs nothing, called with many points at once
and point by point, and what a point takes more that way than in a bare loop. The least of some runs.

usage: PYTHONPATH=build/release/python inference_cpu.py [RUNS]
"""
import sys
import time

import knothe

REGION = {f"p{k}": knothe.Normal(0, 1) for k in range(5)}


def cpu(function):
    start = time.process_time()
    result = function()
    return time.process_time() - start, result


def run(log, vectorized):
    points = []

    def counted(p):
        points.append(p.copy())
        return log(p)

    spent, found = cpu(lambda: knothe.infer(log, REGION, vectorized=vectorized))
    knothe.infer(counted, REGION, vectorized=vectorized)
    model, _ = cpu(lambda: [log(p) for p in points])
    return spent - model, found.record["model_evaluations"], found.trusted


def one(p):
    a, b, c, d, e = p.tolist()
    return -0.5 * (a * a + b * b + c * c + d * d + e * e)


def main():
    runs = range(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
    together, values, trusted = min(run(lambda p: -0.5 * (p * p).sum(1), True) for _ in runs)
    print(f"vectorised: {together:.3f} s of CPU beside the model's, {values} values, trusted: {trusted}")
    alone, values, trusted = min(run(one, False) for _ in runs)
    print(f"point by point: {alone:.3f} s, {1e6 * (alone - together) / values:.2f} µs more for each of {values} values, trusted: {trusted}")


main()
