#!/usr/bin/env python3
"""A simulated test machine that speaks Modbus/TCP: it does the commands that it finds in its registers, and measures its specimen.

Holding registers, which are written: 0 and 1 the set-point in mm, 2 the action (0 hold, 1 load, 2 stop), 3 the sequence number, at whose
change it acts, 4 the heartbeat. Input registers, which are read: 0 the sequence number that it has taken, 1 the last that it has done,
10 + 2k and 11 + 2k displacement k, m. Where two registers are one number it is a float32, its high word first. Without a new heartbeat for
--watchdog seconds it holds until the heart beats again.

The specimen is the model of `knothe serve` at --truth, with noise; what it will show is asked for once, at the beginning.

usage: modbus_machine.py URL [--port 5020] [--truth 1.1,0.9] [--full 0.4] [--rate 0.02] [--watchdog 2] [--seed 1]
"""
import argparse
import json
import random
import socket
import struct
import sys
import threading
import time
import urllib.request

HOLD, LOAD, STOP = range(3)
SET_POINT, ACTION, SEQUENCE, HEARTBEAT, HOLDING = 0, 2, 3, 4, 5  # the last: how many there are
ACKNOWLEDGE, REACHED, SENSORS = 0, 1, 10
TICK = 0.01  # s


def ask(url, path, body=None):
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url.rstrip("/") + path, data, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request, timeout=30) as answer:
        return json.load(answer)


class Specimen:
    """What the model predicts for one truth, at each of its times and, on straight lines, between them."""

    def __init__(self, url, truth, seed):
        self.times = ask(url, "/v1/description")["times"]
        self.deviations = [sensor["std"] for sensor in ask(url, "/v1/mesh")["sensors"]]
        at = lambda step: ask(url, "/Evaluate", {"name": "forward", "input": [truth], "config": {"step": step}})["output"][0]
        self.exact = [at(step) for step in range(len(self.times))]
        self.noise = random.Random(seed)

    def measure(self, sensor, moment):
        later = next((k for k, t in enumerate(self.times) if t >= moment - 1e-9), len(self.times) - 1)
        before = max(later - 1, 0)
        span = self.times[later] - self.times[before]
        share = 1.0 if span == 0 or abs(self.times[later] - moment) < 1e-6 else (moment - self.times[before]) / span
        exact = (1 - share) * self.exact[before][sensor] + share * self.exact[later][sensor]
        return exact + self.deviations[sensor] * self.noise.gauss(0, 1)


class Machine:
    """`full`: the set-point at model time 1, mm; `rate`: mm/s. `mute`: it acknowledges nothing; `delay`: s before it does."""

    def __init__(self, specimen, full, rate, watchdog, port=0):
        self.specimen, self.full, self.rate, self.watchdog = specimen, full, rate, watchdog
        self.mute, self.delay, self.ended = False, 0.0, False
        self.holding, self.acknowledged, self.reached = bytearray(2 * HOLDING), 0, 0
        self.position = self.target = 0.0
        self.action, self.due = HOLD, []
        self.beat = time.monotonic()
        self.history = []  # of commands: (action, sequence number, set-point)
        self.held_by_watchdog = 0
        self.listener = socket.create_server(("127.0.0.1", port))
        self.port = self.listener.getsockname()[1]
        self.lock = threading.Lock()
        for work in (self.accept, self.run):
            threading.Thread(target=work, daemon=True).start()

    def end(self):
        self.ended = True
        self.listener.close()

    def word(self, register):
        return struct.unpack_from(">H", self.holding, 2 * register)[0]

    @property
    def set_point(self):
        return struct.unpack_from(">f", self.holding, 2 * SET_POINT)[0]

    @property
    def alive(self):
        return time.monotonic() - self.beat <= self.watchdog

    def run(self):
        """Moves the crosshead, while the heart beats."""
        was_alive, last = True, time.monotonic()
        while not self.ended:
            time.sleep(TICK)
            now = time.monotonic()
            with self.lock:
                for number in [number for moment, number in self.due if moment <= now]:
                    self.acknowledged = number
                self.due = [one for one in self.due if one[0] > now]
                self.held_by_watchdog += was_alive and not self.alive and self.action == LOAD
                was_alive = self.alive
                if self.action == LOAD and self.alive:
                    way = self.target - self.position
                    self.position += max(-self.rate * (now - last), min(self.rate * (now - last), way))
                if not self.mute and (self.action != LOAD or self.position == self.target):
                    self.reached = self.acknowledged
                last = now

    def written(self, first, registers):
        """What is new in the registers from `first` on, and what follows."""
        before = self.word(SEQUENCE), self.word(HEARTBEAT)
        self.holding[2 * first:2 * first + len(registers)] = registers
        if self.word(HEARTBEAT) != before[1]:
            self.beat = time.monotonic()
        if self.word(SEQUENCE) == before[0]:
            return
        self.action, number = self.word(ACTION), self.word(SEQUENCE)
        self.history.append((self.action, number, self.set_point))
        if self.action == LOAD:
            self.target = self.set_point
        if not self.mute:
            self.due.append((time.monotonic() + self.delay, number))

    def read(self, first, count):
        """Input registers, or None where there are none."""
        sensors = len(self.specimen.deviations)
        if first in (ACKNOWLEDGE, REACHED) and count == 1:
            return struct.pack(">H", self.reached if first == REACHED else self.acknowledged)
        sensor, odd = divmod(first - SENSORS, 2)
        if odd or count != 2 or not 0 <= sensor < sensors:
            return None
        return struct.pack(">f", self.specimen.measure(sensor, self.position / self.full))

    def answer(self, code, body):
        """Of Modbus's functions 3, 4, 6 and 16; an exception's code is an int."""
        first, count = struct.unpack_from(">HH", body)
        if code == 3:
            found = self.holding[2 * first:2 * (first + count)] if first + count <= HOLDING else None
        elif code == 4:
            found = self.read(first, count)
        elif code in (6, 16):
            registers = body[2:] if code == 6 else body[5:]
            if 2 * first + len(registers) > len(self.holding):
                return 2
            self.written(first, registers)
            return body[:4]
        else:
            return 1
        return 2 if found is None else bytes([len(found)]) + found

    def accept(self):
        try:
            while True:
                threading.Thread(target=self.serve, args=self.listener.accept()[:1], daemon=True).start()
        except OSError:
            pass  # it has ended

    def serve(self, client):
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            with client, client.makefile("rb") as stream:
                while head := stream.read(8):
                    transaction, _, length, device, code = struct.unpack(">HHHBB", head)
                    request = stream.read(length - 2)
                    with self.lock:
                        found = self.answer(code, request)
                    body = bytes([code | 0x80, found]) if isinstance(found, int) else bytes([code]) + found
                    client.sendall(struct.pack(">HHHB", transaction, 0, 1 + len(body), device) + body)
        except (OSError, struct.error):
            pass  # whoever it was is gone


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("url")
    parser.add_argument("--port", type=int, default=5020)
    parser.add_argument("--truth", default="1.1,0.9")
    parser.add_argument("--full", type=float, default=0.4, help="set-point at model time 1, mm")
    parser.add_argument("--rate", type=float, default=0.02, help="mm/s")
    parser.add_argument("--watchdog", type=float, default=2, help="s")
    parser.add_argument("--seed", type=int, default=1)
    told = parser.parse_args()
    specimen = Specimen(told.url, [float(x) for x in told.truth.split(",")], told.seed)
    machine = Machine(specimen, told.full, told.rate, told.watchdog, told.port)
    print(f"listening at 127.0.0.1:{machine.port}", flush=True)
    shown = 0
    while machine.action != STOP:
        time.sleep(0.1)
        for action, number, set_point in machine.history[shown:]:
            print(f"{number}: {('hold', 'load', 'stop')[action]}" + (f" to {set_point:.4g} mm" if action == LOAD else ""), flush=True)
        shown = len(machine.history)
    return 0


if __name__ == "__main__":
    sys.exit(main())
