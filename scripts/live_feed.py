#!/usr/bin/env python3
"""A simulated camera: asks the service for the displacements at the true parameters (UM-Bridge, `forward`), adds noise, and sends them.

usage: live_feed.py URL [--truth 1.0,1.0] [--rate 10] [--seed 1] [--steps N]
"""
import argparse
import json
import random
import time
import urllib.request


def ask(url, path, body=None):
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url.rstrip("/") + path, data, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request, timeout=30) as answer:
        return json.load(answer)


parser = argparse.ArgumentParser()
parser.add_argument("url")
parser.add_argument("--truth", default="1.0,1.0")
parser.add_argument("--rate", type=float, default=10)
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--steps", type=int)
arguments = parser.parse_args()

about = ask(arguments.url, "/v1/description")
std = [sensor["std"] for sensor in ask(arguments.url, "/v1/mesh")["sensors"]]
truth = [float(x) for x in arguments.truth.split(",")]
noise = random.Random(arguments.seed)
session = time.strftime("%Y-%m-%dT%H:%M:%S")
start = time.monotonic()
for seq, at in enumerate(about["times"][: arguments.steps]):
    exact = ask(arguments.url, "/Evaluate", {"name": "forward", "input": [truth], "config": {"step": seq}})["output"][0]
    values = [v + s * noise.gauss(0, 1) for v, s in zip(exact, std)]
    ask(arguments.url, "/v1/measurements", {"site": about["site"], "source": "simulated-camera", "session": session, "seq": seq,
                                            "time": at, "values": values})
    time.sleep(max(0, start + (seq + 1) / arguments.rate - time.monotonic()))
