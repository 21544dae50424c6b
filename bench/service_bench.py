#!/usr/bin/env python3
"""How long from sending a measurement to its line on /v1/events: durable, with viewers; then how many a second, in a flood; then a replay.

usage: service_bench.py KNOTHE PROJECT.toml [--viewers 8] [--count 300]
PROJECT.toml names model and data, as for `knothe serve`; the journal is made anew beside it. The client is Python: its own time (some 0.3 ms a
request) is in the figures.
"""
import argparse
import http.client
import json
import math
import os
import pathlib
import platform
import random
import re
import signal
import socket
import statistics
import subprocess
import threading
import time

parser = argparse.ArgumentParser()
parser.add_argument("knothe")
parser.add_argument("project", type=pathlib.Path)
parser.add_argument("--viewers", type=int, default=8)
parser.add_argument("--count", type=int, default=300)
parser.add_argument("--period", type=float, default=0.03)
arguments = parser.parse_args()
text = arguments.project.read_text()
project = arguments.project.with_name("bench_service.toml")
project.write_text(text + "\n[serve]\nsite = \"bench\"\nwindow = 1000000\n")
for old in project.parent.glob("bench_service.journal*"):
    old.unlink()


def start():
    process = subprocess.Popen([arguments.knothe, "serve", str(project), "--port", "0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    port = int(re.search(r":(\d+)/", process.stdout.readline().decode())[1])
    begin = time.perf_counter()
    while ask(port, "GET", "/readyz")[0] != 200:
        time.sleep(0.005)
    return process, port, time.perf_counter() - begin


def ask(port, method, path, body=None, connection=None):
    connection = connection or http.client.HTTPConnection("127.0.0.1", port)
    connection.request(method, path, body, {"Content-Type": "application/json"})
    answer = connection.getresponse()
    content = answer.read()
    return answer.status, json.loads(content) if content[:1] in b"{[" else content


def quantiles(times):
    times = sorted(times)
    p99 = times[math.ceil(0.99 * len(times)) - 1]  # nearest rank
    return f"p50 {1e3 * statistics.median(times):.2f} ms, p99 {1e3 * p99:.2f} ms, at most {1e3 * times[-1]:.2f} ms"


def viewer(port, seen):
    connection = http.client.HTTPConnection("127.0.0.1", port)
    connection.request("GET", "/v1/events")
    for line in connection.getresponse():
        if seen is not None and line.startswith(b"data: ") and b'"received_at"' in line:
            seen.append((time.perf_counter(), json.loads(line[6:])))


print(f"machine: {platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
process, port, _ = start()
about = ask(port, "GET", "/v1/description")[1]
std = [s["std"] for s in ask(port, "GET", "/v1/mesh")[1]["sensors"]] if "displacement" in about["fields"] else None
truth = [p["quantiles"]["values"][2] for p in about["parameters"]]
data, noise = [], random.Random(1)
for step, t in enumerate(about["times"]):
    values = ask(port, "POST", "/Evaluate", json.dumps({"name": "forward", "input": [truth], "config": {"step": step}}))[1]["output"][0]
    # Data without noise fit better than they can: each step would look for the reason.
    data.append({"source": "camera", "time": t, "values": [v + noise.gauss(0, s) for v, s in zip(values, std or [0] * len(values))]})
seen = []
for k in range(arguments.viewers):
    threading.Thread(target=viewer, args=(port, seen if k == 0 else None), daemon=True).start()
time.sleep(0.5)
connection = http.client.HTTPConnection("127.0.0.1", port)
acknowledged, visible = [], []
for k in range(arguments.count):
    session, seq = divmod(k, len(data))
    datum = json.dumps({**data[seq], "session": f"s{session}", "seq": seq})
    before = len(seen)
    begin = time.perf_counter()
    status, answer = ask(port, "POST", "/v1/measurements", datum, connection)
    acknowledged.append(time.perf_counter() - begin)
    assert status == 200, answer
    while not any(line["step"] == seq for _, line in seen[before:]):
        time.sleep(0.0002)
    visible.append(next(at for at, line in seen[before:] if line["step"] == seq) - begin)
    time.sleep(max(0, arguments.period - (time.perf_counter() - begin)))
first = visible[: len(data)]
print(f"durable ingest, acknowledged: {quantiles(acknowledged)}")
print(f"durable ingest to line on /v1/events with {arguments.viewers} viewers, data in order: {quantiles(first)}")
print(f"from the acknowledgement to the line: {quantiles([max(0, v - a) for v, a in zip(first, acknowledged)])}")
synced = []
with open(project.parent / "bench_service.sync", "wb") as file:
    for _ in range(100):
        begin = time.perf_counter()
        file.write(b"x" * 4096)
        file.flush()
        os.fdatasync(file.fileno())
        synced.append(time.perf_counter() - begin)
        time.sleep(0.01)
print(f"for comparison, 4 kB written and synced beside the journal: {quantiles(synced)}")
print(f"the same, all {arguments.count} (from the second round on each datum makes all later lines anew): {quantiles(visible)}")

# Viewers, silent, slow and greedy clients: rounds with and without them, turn about, since the machine has other work too.
def crowd():
    ones = [socket.create_connection(("127.0.0.1", port)) for _ in range(200)]
    slow = socket.create_connection(("127.0.0.1", port))
    slow.sendall(b"GET /livez HT")
    greedy = socket.create_connection(("127.0.0.1", port))
    greedy.sendall(b"POST /v1/measurements HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000000\r\n\r\n" + b"x" * 100000)
    for _ in range(24):
        one = socket.create_connection(("127.0.0.1", port))
        one.sendall(b"GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")  # never read: the slowest of viewers
        ones.append(one)
    return [*ones, slow, greedy]


times = {"alone": ([], []), "in the crowd": ([], [])}
for turn in range(6):
    name = "in the crowd" if turn % 2 else "alone"
    clients = crowd() if turn % 2 else []
    for k in range(60):
        datum = json.dumps({**data[0], "session": f"crowd{turn}", "seq": k})
        begin = time.perf_counter()
        assert ask(port, "POST", "/v1/measurements", datum, connection)[0] == 200
        times[name][0].append(time.perf_counter() - begin)
        begin = time.perf_counter()
        assert ask(port, "GET", "/livez")[0] == 200
        times[name][1].append(time.perf_counter() - begin)
        time.sleep(0.01)
    for client in clients:
        client.close()
for name, (ingest, alive) in times.items():
    print(f"{name}: ingest {quantiles(ingest)}; /livez {quantiles(alive)}")

done = []


def flood(name):
    one = http.client.HTTPConnection("127.0.0.1", port)
    for seq in range(100):
        assert ask(port, "POST", "/v1/measurements", json.dumps({**data[0], "source": name, "session": "f", "seq": seq}), one)[0] == 200
        done.append(time.perf_counter())


begin = time.perf_counter()
threads = [threading.Thread(target=flood, args=(f"sender{k}",)) for k in range(8)]
[t.start() for t in threads]
[t.join() for t in threads]
print(f"flood of 8 senders: {len(done) / (max(done) - begin):.0f} durable measurements a second")
memory = re.search(rb"process_resident_memory_bytes (\d+)", ask(port, "GET", "/metrics")[1])
print(f"memory: {int(memory[1]) / 1e6:.0f} MB")
records = ask(port, "GET", "/v1/status")[1]["records"]
process.send_signal(signal.SIGKILL)
process.wait()
process, port, ready = start()
print(f"start-up with {records} records: ready after {ready:.2f} s")
process.send_signal(signal.SIGINT)
process.wait()
