#!/usr/bin/env python3
"""A simulated test machine that does what `knothe serve` decides: it loads the specimen, measures, sends the datum, and asks what is next.

The specimen is the service's own model at --truth, with noise. A machine of your own has its own `load` and `measure`. It holds where the
service does not answer, and where the answer does not have its datum yet.

usage: machine.py URL [--truth 1.1,0.9] [--first 0.05] [--seed 1]
"""
import argparse
import json
import random
import sys
import time
import urllib.request

HOLDS = 3  # in a row that are not to learn (under `reject`), before somebody has to look


def ask(path, body=None):
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(arguments.url.rstrip("/") + path, data, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request, timeout=30) as answer:
        return json.load(answer)


def asked_again(path, body=None):
    """Until it is answered: a specimen that is held is safe."""
    while True:
        try:
            return ask(path, body)
        except OSError as error:
            if getattr(error, "code", 500) < 500 and getattr(error, "code", 500) != 404:
                raise
            time.sleep(0.2)


def load(step):
    """Takes the specimen to the load of the step."""


def measure(step):
    exact = asked_again("/Evaluate", {"name": "forward", "input": [truth], "config": {"step": step}})["output"][0]
    return [value + std * noise.gauss(0, 1) for value, std in zip(exact, deviations)]


def line_with(step, data):
    """The line of the step once all its data are in it. One of a later step is not of this specimen."""
    while True:
        line = asked_again("/v1/state")
        if line["step"] > step:
            sys.exit("the service has data of later loads: begin a test of its own (docs/reference/service.md)")
        if line["step"] == step and line["data"] >= data and "decision" in line:  # a preview has none
            return line
        time.sleep(0.01)


parser = argparse.ArgumentParser()
parser.add_argument("url")
parser.add_argument("--truth", default="1.1,0.9")
parser.add_argument("--first", type=float, default=0.05, help="model time of the first load")
parser.add_argument("--seed", type=int, default=1)
arguments = parser.parse_args()

truth = [float(x) for x in arguments.truth.split(",")]
noise = random.Random(arguments.seed)
times = asked_again("/v1/description")["times"]
deviations = [sensor["std"] for sensor in asked_again("/v1/mesh")["sensors"]]
session = time.strftime("%Y-%m-%dT%H:%M:%S")
step = min(range(len(times)), key=lambda k: abs(times[k] - arguments.first))
if asked_again("/v1/states"):
    sys.exit("the service has data already: begin a test of its own (docs/reference/service.md)")
data, blind = {}, 0
while True:
    load(step)
    data[step] = data.get(step, 0) + 1
    asked_again("/v1/measurements", {"source": "machine", "session": session, "seq": sum(data.values()) - 1, "time": times[step],
                                     "values": measure(step)})
    line = line_with(step, data[step])
    decision = line["decision"]
    print(f"{times[step]:.3g}: {line['verdict']['level']}; {decision['action']}", end="")
    if decision["action"] == "load":
        print(f" to {1e3 * decision['load']:.3g} mm" if "load" in decision else f" to time {decision['time']:.3g}", end="")
    print(":", decision["message"], flush=True)
    blind = blind + 1 if decision["action"] == "hold" and not decision["plan"] else 0
    if decision["action"] == "stop" or blind == HOLDS:
        sys.exit(0 if decision["action"] == "stop" else f"{HOLDS} holds without a plan: somebody has to look")
    step = max(step, min(range(len(times)), key=lambda k: abs(times[k] - decision["time"])))
