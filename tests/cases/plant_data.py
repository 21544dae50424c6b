"""deploy/plant: load cells and gauges of a simulated OPC UA and a simulated Modbus server, to a running `knothe serve`.

Skipped, saying so, where node or (for OPC UA) the locked npm packages are missing. KNOTHE_PLANT_STEPS: times of the model, 12 in 6 s
by default; 600 in 60 s at night.
"""
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import unittest

from documentation import free_port
from plant_support import PLANT, LibmodbusServer, PlantCase
from service_support import Broker, Service
from support import exit_status, read_csv, write_csv

STEPS = int(os.environ.get("KNOTHE_PLANT_STEPS", "12"))
SECONDS = 60 if STEPS > 12 else 6
START = 1  # s from when it is configured
FORCE, GAUGE = (50.0, 20.0), (1e-6, 5e-6)  # values at the start, and their rates per s


class ModbusServer:
    """Registers that are computed when they are asked for: `registers`(function, address, count) gives them, or an exception's code."""

    def __init__(self, registers):
        self.registers, self.connections = registers, 0
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        with contextlib.suppress(OSError):
            while True:
                self.connections += 1
                threading.Thread(target=self.serve, args=self.listener.accept()[:1], daemon=True).start()

    def serve(self, client):
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with contextlib.suppress(OSError), client, client.makefile("rb") as stream:
            while request := stream.read(12):
                transaction, protocol, length, device, code, address, count = struct.unpack(">HHHBBHH", request)
                assert (protocol, length, device) == (0, 6, 7)
                found = self.registers(code, address, count)
                body = bytes([code | 0x80, found]) if isinstance(found, int) else bytes([code, len(found)]) + found
                header = struct.pack(">HHHB", transaction, 0, 1 + len(body), device)
                client.sendall(header[:3])  # a network may cut an answer anywhere
                client.sendall(header[3:] + body)


@unittest.skipUnless(shutil.which("node"), "node is not installed")
class Test(PlantCase):
    def setUp(self):
        super().setUp()
        self.seconds = SECONDS
        if STEPS != 12:
            self.make_long_model()
        sensors = read_csv(self.folder / "data.csv")[:24]
        self.displacements = len(sensors)
        (self.folder / "data.csv").unlink()
        rows = [{**row, "time": f"{1 / STEPS!r}"} for row in sensors]
        for name, value, std in (("reaction_force", 100.0, 60.0), ("gauge", 1e-6, 2e-5)):
            rows.append({"time": f"{1 / STEPS!r}", "sensor": name, "x": "", "y": "", "z": "", "component": name, "value": value, "std": std})
        write_csv(self.folder / "data.csv", rows)
        self.edit('data = "data.h5"', '[data]\nfile = "data.csv"\n[data.sensors.gauge]\nkind = "strain"\nfrom = [-0.03, 0.0, 0.0]\nto = [0.03, 0.05, 0.0]')
        self.edit('results = "results/"\n', "")

    def make_long_model(self):
        for name in ("snapshots.h5", "model.h5"):
            (self.folder / name).unlink(missing_ok=True)
        subprocess.run([pathlib.Path(os.environ["KNOTHE_DATA_TO_CSV"]).with_name("make_snapshots"), self.folder, str(STEPS)], check=True)
        self.expect(0, "model", "import", "snapshots.h5", "-o", "model.h5", "--tolerance", "1e-9")

    def configure(self, port, channels, session="first", **more):
        """Begins the test in a second from now, which lasts `self.seconds`; `self.instants`: the steps of the model, Unix time in s."""
        self.start = round(time.time() + START, 3)
        begins = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(self.start)) + f".{round(self.start * 1000) % 1000:03d}Z"
        self.configuration = {"service": {"address": f"http://127.0.0.1:{port}"}, "source": "frame", "session": session,
                              "time": {"start": begins, "seconds": self.seconds}, "spool": str(self.folder / "spool" / f"{session}.jsonl"),
                              "channels": channels, **more}
        self.write_configuration()
        self.instants = [self.start + self.seconds * (k + 1) / STEPS for k in range(STEPS)]

    def series(self, journal="assimilation.journal"):
        """What a journal has of each sensor: [(step, value)], missing values left out."""
        self.expect(0, "export", journal, "-o", "export.csv")
        found = {}
        for row in read_csv(self.folder / "export.csv"):
            if row["value"] not in ("", "nan"):
                found.setdefault(row["sensor"], []).append((round(float(row["time"]) * STEPS) - 1, float(row["value"])))
        return found

    def run_with_kills(self, service, port, between=lambda: None, meanwhile=lambda: time.sleep(1)):
        """The bridge is killed with -9 at a third of the test (at night five times), the service at a half; both come back."""
        bridge = self.bridge()
        for share in (0.1, 0.15, 0.2, 0.25, 1 / 3) if STEPS > 12 else (1 / 3,):
            self.wait_until(lambda: bridge.poll() is not None or service.get("/v1/status")[1]["records"] >= STEPS * share)
            bridge.send_signal(signal.SIGKILL)
            bridge.wait()
            between()
            bridge = self.bridge()
        self.wait_until(lambda: bridge.poll() is not None or service.get("/v1/status")[1]["records"] >= STEPS // 2)
        service.kill()
        meanwhile()
        service.start(port=port)
        self.assertEqual(bridge.wait(120 + self.seconds), 0, self.bridge_said())
        return service.settled()

    def test_each_datum_of_an_opcua_server_is_stored_once_with_the_time_of_its_source(self):
        self.need_packages()
        service, port = Service(self.folder, self.project_name), free_port()
        self.addCleanup(lambda: service.process.poll() is None and service.kill())
        service.start(port=port)
        server, opcua = self.opcua_server()
        self.configure(port, {"reaction_force": {"node": "ns=1;s=Load", "every": 0.1, "scale": 1000.0, "unit": "kN"},
                              "gauge": {"node": "ns=1;s=Gauge", "every": 0.04}}, wait=60, opcua={"endpoint": f"opc.tcp://127.0.0.1:{opcua}"})
        bad, uncertain = ([self.start + self.seconds * a, self.start + self.seconds * b] for a, b in ((0.55, 0.7), (0.8, 0.9)))
        nodes = {"Load": {"start": self.start, "value": FORCE[0] / 1000, "rate": FORCE[1] / 1000, "every": 0.1},
                 "Gauge": {"start": self.start, "value": GAUGE[0], "rate": GAUGE[1], "every": 0.04, "bad": bad, "uncertain": uncertain}}
        server.stdin.write(json.dumps(nodes).encode() + b"\n")
        server.stdin.flush()
        (self.folder / "password").write_text("correct horse\n")

        def encrypt():  # the first bridge speaks in the clear, those after it do not
            self.configuration["opcua"] |= {"security": "sign_and_encrypt", "user": "gauge", "password": str(self.folder / "password")}
            self.write_configuration()

        def freeze():  # the server, which then tells what is newest: the rest is in its history
            server.send_signal(signal.SIGSTOP)
            time.sleep(0.7)
            server.send_signal(signal.SIGCONT)
            time.sleep(0.5)

        status = self.run_with_kills(service, port, encrypt, freeze)
        self.assertEqual(status["records"], STEPS, self.bridge_said())
        found = self.series()
        # The history tells what was measured while the bridge was dead: nothing is missing, nothing twice.
        self.assertEqual([step for step, _ in found["reaction_force"]], list(range(STEPS)))
        for step, value in found["reaction_force"]:
            self.assertAlmostEqual(value, FORCE[0] + FORCE[1] * (self.instants[step] - self.start), delta=1e-6 * FORCE[1])  # a microsecond
        # A node's clock goes in steps of `every`: an instant within one of the edges may be either.
        sure = lambda step, edge: all(abs(self.instants[step] - t) > edge for t in bad + uncertain)
        inside = lambda step: any(a < self.instants[step] < b for a, b in (bad, uncertain))
        gauge = dict(found["gauge"])
        self.assertEqual(len(gauge), len(found["gauge"]))
        for step in filter(lambda step: sure(step, 0.05), range(STEPS)):
            self.assertEqual(step in gauge, not inside(step), step)
        for step, value in gauge.items():
            self.assertAlmostEqual(value, GAUGE[0] + GAUGE[1] * (self.instants[step] - self.start), delta=1e-6 * GAUGE[1])
        self.assertTrue([step for step in range(STEPS) if inside(step) and sure(step, 0.05)])
        self.assertIn("channels.gauge: missing (BadSensorFailure", self.bridge_said())
        self.assertNotIn("no sample for", self.bridge_said())

    def modbus_registers(self, code, address, count):
        now = time.time() - self.start
        force, gauge = FORCE[0] + FORCE[1] * now, GAUGE[0] + GAUGE[1] * now
        if 0.7 < now / self.seconds < 0.85 and address == 40:
            return 4  # server device failure
        found = {(3, 100, 2): struct.pack(">f", force), (4, 40, 2): struct.pack(">i", round((gauge - 5e-5) * 1e12)),
                 (3, 7, 1): struct.pack(">h", -123), (3, 8, 1): struct.pack(">H", 65535), (4, 9, 2): struct.pack(">I", 4294967295),
                 (4, 11, 2): struct.pack(">f", float("nan"))}.get((code, address, count), 2)  # illegal data address
        return found[2:] + found[:2] if address in (40, 9) else found  # low word first

    def read_modbus(self, session):
        """One test under `session`: what the journal has, and the steps of its data."""
        service, port = Service(self.folder, self.project_name, "--test", session), free_port()
        self.addCleanup(lambda: service.process.poll() is None and service.kill())
        service.start(port=port)
        slow = {"scale": 1e-12, "every": 0.2}
        self.configure(port, {
            "reaction_force": {"register": 100, "type": "float32", "every": 0.1, "unit": "N"},
            "gauge": {"register": 40, "table": "input", "type": "int32", "word_order": "little", "scale": 1e-12, "offset": 5e-5, "every": 0.04},
            "3": {"register": 7, "type": "int16", **slow}, "4": {"register": 8, "type": "uint16", **slow},
            "5": {"register": 9, "table": "input", "type": "uint32", "word_order": "little", "scale": 1e-15, "every": 0.2},
            "6": {"register": 11, "table": "input", "type": "float32", **slow},
            "7": {"register": 13, "type": "float32", **slow}}, session, modbus={"address": f"127.0.0.1:{self.server.port}", "device": 7})
        (self.folder / "bridge.log").unlink(missing_ok=True)
        records = self.run_with_kills(service, port)["records"]
        spooled = [json.loads(line) for line in (self.folder / "spool" / f"{session}.jsonl").read_text().splitlines()]
        data = [line["seq"] for line in spooled if "channels" in line]
        self.assertEqual(sorted(set(data)), data)
        self.assertEqual(records, len(data))
        self.assertEqual(sorted({line["sent"] for line in spooled if "sent" in line}), data)
        if records < data[-1] - data[0] + 1:  # while the bridge was dead nobody asked; that is said
            self.assertIn("nothing was measured", self.bridge_said())
        # Killed before it had noted that all of it was stored, it sends all of it again.
        kept = [line for line in spooled if "sent" not in line]
        (self.folder / "spool" / f"{session}.jsonl").write_text("".join(json.dumps(line) + "\n" for line in kept))
        self.assertEqual(self.bridge().wait(60), 0, self.bridge_said())
        status = service.settled()
        self.assertEqual((status["records"], status["duplicates"] >= records), (records, True))
        return self.series(f"assimilation.{session}.journal"), data

    def test_each_datum_of_a_modbus_server_is_stored_once(self):
        self.server = ModbusServer(self.modbus_registers)
        self.addCleanup(self.server.listener.close)
        for session in ("first", "second", "third"):
            found, data = self.read_modbus(session)
            for name, (value, rate) in (("reaction_force", FORCE), ("gauge", GAUGE)):
                self.assertEqual(len(dict(found.get(name, []))), len(found.get(name, [])))
                # It was read somewhere between question and answer: half the time-out of 1 s is the bound.
                for step, read in found.get(name, []):
                    self.assertAlmostEqual(read, value + rate * (self.instants[step] - self.start), delta=0.5 * rate)
            if set(data) >= set(range(STEPS // 2, STEPS)):
                break
            self.seconds *= 3  # the machine was too busy to measure: no fault of the bridge's
        names = {index: row["sensor"] for index, row in enumerate(read_csv(self.folder / "data.csv"))}
        gauge = dict(found["gauge"])
        for step in range(STEPS // 2, STEPS):
            share = (step + 1) / STEPS
            if 0.72 < share < 0.83:
                self.assertNotIn(step, gauge)
        self.assertEqual(max(gauge), STEPS - 1)
        self.assertEqual(max(dict(found["reaction_force"])), STEPS - 1)
        self.assertIn("channels.gauge: missing (exception 4, server device failure)", self.bridge_said())
        self.assertIn("channels.6: missing (NaN)", self.bridge_said())
        self.assertIn("channels.7: missing (exception 2, illegal data address)", self.bridge_said())
        for index, value in ((3, -123e-12), (4, 65535e-12), (5, 4294967295e-15)):
            self.assertEqual({round(read, 18) for _, read in found[names[index]]}, {round(value, 18)})
        self.assertFalse({names[6], names[7]} & set(found))

    def test_samples_become_data_as_they_should(self):
        done = subprocess.run(["node", "--test", *sorted((PLANT / "test").glob("*.test.mjs"))], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertRegex(done.stdout, "pass [1-9]")

    def test_what_libmodbus_serves_is_read(self):
        server = self.libmodbus_server(480.25, -3e-6)
        service, found = self.serve(), {}
        for session in ("first", "second", "third"):
            self.configure(service.port, {
                "reaction_force": {"register": 100, "type": "float32", "every": 0.1},
                "gauge": {"register": 40, "table": "input", "type": "float32", "word_order": "little", "every": 0.1},
                "3": {"register": 109, "type": "float32", "every": 0.1}}, session, modbus={"address": f"127.0.0.1:{server.port}"})
            self.assertEqual(self.bridge().wait(120 + self.seconds), 0, self.bridge_said())
            service.settled()
            found = self.series()
            if {"reaction_force", "gauge"} <= set(found):
                break
            self.seconds *= 3  # the machine was too busy to measure
        self.assertIn("reaction_force", found, self.bridge_said())
        self.assertEqual({value for _, value in found.pop("reaction_force")}, {480.25})
        self.assertEqual({round(value, 12) for _, value in found.pop("gauge")}, {-3e-6})
        self.assertEqual(found, {})
        self.assertIn("channels.3: missing (exception 2, illegal data address)", self.bridge_said())

    @unittest.skipUnless(os.path.exists("/usr/sbin/mosquitto"), "mosquitto is not installed")
    def test_what_is_published_at_a_broker_is_read(self):
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        service, stop = self.serve(), threading.Event()
        broker.publish("m/force", b"9e9", retain=True)  # of an earlier time
        for session in ("first", "second", "third"):
            self.configure(service.port, {"reaction_force": {"topic": "m/force", "every": 0.1, "scale": 1000.0, "unit": "kN"},
                                          "gauge": {"topic": "m/gauge", "every": 0.1}}, session, mqtt={"broker": f"127.0.0.1:{broker.port}"})
            stop.clear()

            def publish():
                while not stop.wait(0.03):
                    broker.publish("m/force", b"0.48025")
                    broker.publish("m/gauge", b"broken" if time.time() > self.start + 0.6 * self.seconds else b"-3e-6")

            threading.Thread(target=publish, daemon=True).start()
            self.assertEqual(self.bridge().wait(120 + self.seconds), 0, self.bridge_said())
            stop.set()
            service.settled()
            found = self.series()
            if {"reaction_force", "gauge"} <= set(found):
                break
            self.seconds *= 3  # the machine was too busy to measure
        self.assertEqual({round(value, 9) for _, value in found["reaction_force"]}, {480.25})
        self.assertEqual({round(value, 12) for _, value in found["gauge"]}, {-3e-6})
        self.assertIn('channels.gauge: missing ("broken" is no number)', self.bridge_said())

    def test_what_is_wrong_is_said_with_its_place(self):
        channels = {"reaction_force": {"register": 1, "type": "float32", "every": 0.1}}
        for example in ("opcua.example.json", "modbus.example.json", "command.example.json"):
            self.configuration = json.loads((PLANT / example).read_text())
            self.configuration["spool"] = "/dev/null/spool"
            self.write_configuration()
            self.refused(3, "/dev/null/spool: error: ")  # all that is before it is right
        self.configure(1, channels, modbus={"address": "127.0.0.1:1"})
        good = json.dumps(self.configuration)
        (self.folder / "plant.json").write_text('{\n "source": "frame",\n "session" "first"\n}')
        self.refused(3, "plant.json:3:", "error: not JSON")
        self.configuration.update(sesion="x", channels={"reaction_force": {"register": 70000, "type": "float", "every": "fast"}}, opcua={})
        del self.configuration["session"]
        self.configuration["time"] = {"start": "yesterday", "seconds": 0}
        self.write_configuration()
        self.refused(3, "session: is missing", "sesion: is not known here; there are service, source, session,",
                     'one of "opcua", "modbus" and "mqtt"', 'time.start: must be a time with its zone, such as "2026-11-23T09:00:00Z", not "yesterday"',
                     "time.seconds: must be a positive number, not 0", 'channels.reaction_force.every: must be a positive number, not "fast"')
        self.configuration = json.loads(good)
        self.configuration["channels"] = {"reaction_force": {"register": 70000, "type": "float", "every": 0.1}}
        self.write_configuration()
        self.refused(3, "register: must be an integer from 0 to 65535, not 70000",
                     'type: must be one of "int16", "uint16", "int32", "uint32", "float32", not "float"')
        service = self.serve()
        self.configuration = json.loads(good)
        self.configuration["service"]["address"] = f"http://127.0.0.1:{service.port}"
        self.configuration["channels"]["reaction_forze"] = self.configuration["channels"].pop("reaction_force")
        self.write_configuration()
        self.refused(3, "channels.reaction_forze: the project's data file has no such sensor", "displacements 0 to 23 and gauge, reaction_force")
        spool = self.folder / "spool" / "first.jsonl"
        spool.write_text('{"identity":{},"layout":{"times":[]}}\n')
        self.refused(3, "first.jsonl: error: was written for another source, session, time or other channels", 'another "session"')
        spool.write_text("{}}\n")
        self.refused(3, "first.jsonl:1: error: not a line of a spool")
        service.get("/v1/status")
        self.configuration["service"]["read_token"] = "nothing"
        self.write_configuration()
        spool.unlink()
        self.refused(3, "nothing: error: ENOENT")

    def test_what_the_service_refuses_stays_in_the_spool(self):
        service = self.serve()
        self.configure(service.port, {"reaction_force": {"register": 1, "type": "float32", "every": 0.1}}, modbus={"address": "127.0.0.1:1"})
        identity = {key: self.configuration[key] for key in ("source", "session", "time", "channels")}
        identity["channels"]["reaction_force"] = {"scale": 1, "offset": 0, **identity["channels"]["reaction_force"]}
        layout = {"displacements": 24, "scalars": ["gauge", "reaction_force"], "times": [0.5, 0.77]}
        datum = {"seq": 1, "time": 0.77, "channels": {"reaction_force": {"value": 3.0, "stamps": []}}}
        spool = self.folder / "spool" / "first.jsonl"
        spool.parent.mkdir()
        lines = "".join(json.dumps(line) + "\n" for line in ({"identity": identity, "layout": layout}, datum))
        spool.write_text(lines + '{"sen')  # killed in the middle of a line
        self.refused(4, "400: ", "0.77")
        self.assertEqual(spool.read_text(), lines)


if __name__ == "__main__":
    sys.exit(exit_status(unittest.main(exit=False, verbosity=2).result))
