#!/usr/bin/env python3
"""What a datum, a status, an idle second, a late datum, memory and a restart cost, as a test grows old.

usage: service_ages.py KNOTHE FOLDER [--ages 1000,10000,30000] [--late 300] [--missing] [--sessions]
Makes in FOLDER a small model (12 sensors, two parameters, rank 5) with a time for each datum, sends data in order and measures at each age: the
figures of the last age over those of the first are what age costs. Written for Linux (/proc).
"""
import argparse
import concurrent.futures
import http.client
import json
import os
import pathlib
import re
import signal
import subprocess
import threading
import time

import h5py
import numpy as np

parser = argparse.ArgumentParser()
parser.add_argument("knothe")
parser.add_argument("folder", type=pathlib.Path)
parser.add_argument("--ages", default="1000,10000,30000")
parser.add_argument("--late", type=int, default=300, help="steps that the late datum is late")
parser.add_argument("--missing", action="store_true", help="each datum lacks a value")
parser.add_argument("--sessions", action="store_true", help="each datum is of a session of its own")
arguments = parser.parse_args()
ages = [int(age) for age in arguments.ages.split(",")]
folder = arguments.folder
folder.mkdir(parents=True, exist_ok=True)
STEPS, SENSORS, STD = max(ages) + 100, 12, 1e-6
KEPT_OPEN = threading.local()
PROJECT = """model = "model.h5"
data = "data.h5"
[parameters]
a = { prior = "normal", mean = 1.0, std = 0.2 }
b = { prior = "normal", mean = 1.0, std = 0.2 }
[serve]
site = "ages"
window = 1000000
"""


def displacements(a, b):
    """m, at all times and sensors; not linear in the parameters."""
    t, x = np.linspace(0, 1, STEPS)[:, None], np.linspace(0.1, 1, SENSORS)
    return 1e-6 * (a * (1 + 0.1 * np.sin(3 * x + 20 * t)) + b * x * (1 + 0.3 * a) * (1 + t) + 0.2 * b**2 * np.cos(5 * x))


def make_model():
    nodes = np.linspace(0.5, 1.5, 5)
    points = np.column_stack([np.linspace(0.1, 1, SENSORS), np.zeros(SENSORS), np.zeros(SENSORS)])
    with h5py.File(folder / "snapshots.h5", "w") as file:
        file.attrs["parameters"] = ["a", "b"]
        shape = (5, 5, STEPS, SENSORS)
        snapshots = file.create_dataset("snapshots", shape, "f8")
        for i, a in enumerate(nodes):
            for j, b in enumerate(nodes):
                snapshots[i, j] = displacements(a, b)
        file["parameters/a"], file["parameters/b"], file["time"] = nodes, nodes, np.arange(STEPS) * 1.0
        file["dofs/points"], file["dofs/component"] = points, np.zeros(SENSORS, "i4")
    with h5py.File(folder / "data.h5", "w") as file:
        file["time"], file["values"] = [0.0], np.zeros((1, SENSORS))
        file["dofs/points"], file["dofs/component"] = points, np.zeros(SENSORS, "i4")
        file["noise/std"] = np.full(SENSORS, STD)
    (folder / "ages.toml").write_text(PROJECT)
    subprocess.run([arguments.knothe, "model", "import", folder / "snapshots.h5", "-o", folder / "model.h5", "--modes", "5"], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    (folder / "snapshots.h5").unlink()


def start():
    begin = time.perf_counter()
    process = subprocess.Popen([arguments.knothe, "serve", folder / "ages.toml", "--port", "0"], stdout=subprocess.PIPE, stderr=open(folder / "log", "a"))
    port = int(re.search(r":(\d+)/", process.stdout.readline().decode())[1])
    while (state := ask(port, "GET", "/v1/state")[0]) != 200 and ask(port, "GET", "/readyz")[0] != 200:
        time.sleep(0.01)
    shown = time.perf_counter() - begin
    while ask(port, "GET", "/readyz")[0] != 200:
        time.sleep(0.01)
    return process, port, shown, time.perf_counter() - begin


def ask(port, method, path, body=None):
    connection = getattr(KEPT_OPEN, str(port), None)
    if connection is None:
        connection = http.client.HTTPConnection("127.0.0.1", port)
        setattr(KEPT_OPEN, str(port), connection)
    connection.request(method, path, body, {"Content-Type": "application/json"})
    answer = connection.getresponse()
    return answer.status, answer.read()


def datum(step, session):
    values = (truth[step] + np.random.default_rng(step).normal(0, STD, SENSORS)).tolist()
    if arguments.missing:
        values[step % SENSORS] = None
    return json.dumps({"source": "ages", "session": session, "seq": step, "time": float(step), "values": values})


def send(port, step, session=""):
    status, body = ask(port, "POST", "/v1/measurements", datum(step, session or (f"s{step}" if arguments.sessions else "s")))
    assert status == 200, body


def await_lines(port):
    while (status := json.loads(ask(port, "GET", "/v1/status")[1]))["behind"] or status["pending"]:
        time.sleep(0.002)


def cpu_of(pid):
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_of(pid):
    return int(re.search(r"VmRSS:\s+(\d+)", pathlib.Path(f"/proc/{pid}/status").read_text())[1]) / 1e3


def median(seconds):
    return f"{1e3 * sorted(seconds)[len(seconds) // 2]:.2f}"


def timed(act):
    begin = time.perf_counter()
    act()
    return time.perf_counter() - begin


def measure(process, port, age):
    """Of a test with `age` steps; leaves it with as many and 40 more."""
    def one(step):
        send(port, step)
        await_lines(port)

    before = cpu_of(process.pid)
    lines = [timed(lambda step=step: one(step)) for step in range(age, age + 40)]
    cpu = (cpu_of(process.pid) - before) / 40
    status = [timed(lambda: ask(port, "GET", "/v1/status")) for _ in range(20)]
    before = cpu_of(process.pid)
    time.sleep(5)
    idle = (cpu_of(process.pid) - before) / 5
    memory = memory_of(process.pid)
    last = json.loads(ask(port, "GET", "/v1/state")[1])["event"]
    begin = time.perf_counter()
    send(port, age + 40 - arguments.late, "late")
    while json.loads(ask(port, "GET", "/v1/state")[1])["event"] == last:
        time.sleep(0.002)
    present = time.perf_counter() - begin
    await_lines(port)
    late = time.perf_counter() - begin
    process.send_signal(signal.SIGKILL)
    process.wait()
    process, port, shown, ready = start()
    every = ready + timed(lambda: await_lines(port))
    print(f"| {age} | {median(lines)} ms ({1e3 * cpu:.1f} of CPU) | {median(status)} ms | {100 * idle:.1f} % | {memory:.0f} MB | {present:.2f}, {late:.2f} s | {shown:.2f}, {ready:.2f}, {every:.2f} s | {memory_of(process.pid):.0f} MB |", flush=True)
    return process, port


make_model()
truth = displacements(1.05, 0.95)
for old in folder.glob("ages.journal*"):
    old.unlink()
process, port, _, _ = start()
print("| steps | datum to line | status | idle | memory | late datum: present line, all | restart: present line, ready, all | memory then |")
print("| --- | --- | --- | --- | --- | --- | --- | --- |", flush=True)
done = 0
with concurrent.futures.ThreadPoolExecutor(8) as senders:
    for age in ages:
        list(senders.map(lambda step: send(port, step), range(done, age)))
        await_lines(port)
        process, port = measure(process, port, age)
        done = age + 40
process.terminate()
process.wait()
