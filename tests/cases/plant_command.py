"""deploy/plant: the decisions of a running `knothe serve` go to a test machine, the one of examples/driven_test over Modbus or a simulated OPC
UA server, and what goes wrong on the way ends in a hold.

Skipped, saying so, where node or (for OPC UA) the locked npm packages are missing.
"""
import json
import os
import random
import shutil
import signal
import struct
import sys
import threading
import time
import unittest

from decisions import FAILURE
from documentation import free_port
from plant_support import PlantCase
from service_support import Broker, Service, comparable, make_certificates
from support import REPOSITORY, exit_status

sys.path.insert(0, str(REPOSITORY / "examples" / "driven_test"))
from modbus_machine import HOLD, LOAD, STOP, Machine, Specimen

TRUTH = [1.05, 0.9]
LOOPS = int(os.environ.get("KNOTHE_LOOPS", "1"))  # of random kills; more at night


@unittest.skipUnless(shutil.which("node"), "node is not installed")
class Test(PlantCase):
    def decide(self, text='failure = "sag"\ncost = 0.2\n'):
        self.project.write_text(self.project.read_text().replace('results = "results/"\n', "") + "\n" + FAILURE + "[decide]\n" + text)

    def begin(self, rate=5.0, watchdog=20.0, **command):
        """A service that decides, and a machine; what the bridge is told of both. The set-point is the model's time."""
        service = Service(self.folder, self.project_name)
        self.addCleanup(lambda: service.process.poll() is None and service.kill())
        service.start(port=free_port())
        self.machine = Machine(Specimen(f"http://127.0.0.1:{service.port}", TRUTH, 1), 1.0, rate, watchdog)
        self.addCleanup(self.machine.end)
        channels = {str(k): {"register": 10 + 2 * k, "table": "input", "type": "float32"} for k in range(24)}
        self.configuration = {
            "service": {"address": f"http://127.0.0.1:{service.port}"}, "source": "machine", "session": "first",
            "spool": str(self.folder / "spool" / "first.jsonl"), "modbus": {"address": f"127.0.0.1:{self.machine.port}", "timeout": 20},
            "channels": channels,
            "command": {"armed": True, "timeout": 20, "dead_time": 300, "limits": {"lower": 0, "upper": 1, "step": 1},
                        "first": {"time": 1 / 12, "set_point": 1 / 12}, "set_point": {"register": 0, "type": "float32", "of": "time"},
                        "action": {"register": 2}, "sequence": {"register": 3}, "acknowledge": {"register": 0, "table": "input"},
                        "reached": {"register": 1, "table": "input"}, "heartbeat": {"register": 4, "every": 0.05}, **command}}
        self.write_configuration()
        return service

    def command(self, **changed):
        self.configuration["command"] |= changed
        self.write_configuration()

    def spooled(self, *keys):
        spool = self.folder / "spool" / "first.jsonl"
        lines = [json.loads(line) for line in spool.read_text().splitlines()] if spool.exists() else []
        return [line for line in lines if all(key in line for key in keys)]

    def orders(self):
        return self.spooled("command", "action")

    def ended(self, bridge, status=0):
        self.wait_until(lambda: bridge.poll() is not None)
        self.assertEqual(bridge.returncode, status, self.bridge_said()[-4000:])

    def heard(self, *texts):
        for text in texts:
            self.wait_until(lambda text=text: text in self.bridge_said())

    def expect_none_twice(self):
        """Every command that the machine had is in the spool, once, and it had none twice."""
        had = [(number, action) for action, number, _ in self.machine.history]
        self.assertEqual([number for number, _ in had], sorted({number for number, _ in had}))
        codes = {"hold": HOLD, "load": LOAD, "stop": STOP}
        kept = [(order["command"], codes[order["action"]]) for order in self.orders()]
        self.assertEqual(len(set(kept)), len(kept))
        self.assertLessEqual(set(had), set(kept))
        dropped = {line["dropped"] for line in self.spooled("dropped")}
        self.assertEqual({number for number, _ in kept} - {number for number, _ in had}, dropped)

    def expect_followed(self, service):
        """The test has gone as the service decided: its last line says stop, its lines are those of the journal."""
        service.settled()
        lines = service.states()
        self.assertEqual(lines[-1]["decision"]["action"], "stop")
        self.assertEqual(self.machine.action, STOP)
        loads = [order["time"] for order in self.orders() if order["action"] == "load" and order["command"] in {d["command"] for d in self.spooled("seq")}]
        self.assertEqual([line["time"] for line in lines], loads)
        self.assertEqual(sum(line["data"] for line in lines), len(self.spooled("seq")))
        self.assertAlmostEqual(self.machine.position, lines[-1]["time"], delta=1e-6)
        service.stop()
        replayed = self.expect(0, "replay", "assimilation.journal", "--project", self.project_name, "--json").lines()[:-1]
        self.assertEqual(list(map(comparable, replayed)), list(map(comparable, lines)))

    def test_a_test_over_modbus_goes_as_it_is_decided(self):
        self.decide()
        service = self.begin()
        self.ended(self.bridge())
        self.expect_none_twice()
        self.assertEqual(len(self.spooled("acknowledged")), len(self.orders()))
        self.assertEqual(self.orders()[0]["why"], "the first load")
        self.assertFalse(any("interrupts" in order for order in self.orders()))
        notes = [entry["text"] for entry in service.get("/v1/logbook")[1]["logbook"] if entry["by"] == "machine"]
        told = [f"command {order['command']}: {order['action']}" for order in self.orders()]
        self.assertEqual([note[:len(wanted)] for note, wanted in zip(notes, told, strict=True)], told)
        self.expect_followed(service)
        # Begun again, it confirms the stop and ends.
        commands = len(self.machine.history)
        service.start(port=service.port)
        self.ended(self.bridge())
        self.assertEqual(len(self.machine.history), commands)
        self.heard(f"command {self.machine.history[-1][1]} (stop): confirmed")

    def test_a_test_by_the_clock_hears_what_is_decided(self):
        self.decide()
        service = self.begin()
        start, self.seconds = round(time.time() + 1), 6
        self.configuration["time"] = {"start": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(start)), "seconds": self.seconds}
        for channel in self.configuration["channels"].values():
            channel["every"] = 0.25
        del self.configuration["command"]["reached"], self.configuration["command"]["first"]
        self.write_configuration()
        type(self.machine).position = property(lambda machine: max(0.0, min(1.0, (time.time() - start) / 6)), lambda machine, position: None)
        self.addCleanup(lambda: delattr(type(self.machine), "position"))
        self.ended(self.bridge())
        last = service.states()[-1]
        service.settled(len(self.spooled("seq")))
        self.assertEqual(last, service.states()[-1])
        self.assertEqual(last["step"], 11)
        self.assertEqual(self.orders()[-1]["action"], last["decision"]["action"])
        self.assertEqual(json.loads(self.orders()[-1]["decision"])[0], 11)
        self.assertGreater(len(self.orders()), 1)
        self.expect_none_twice()

    def test_nothing_is_sent_unless_it_is_armed(self):
        self.decide()
        service = self.begin()
        del self.configuration["command"]["armed"]
        self.write_configuration()
        bridge = self.bridge()
        self.heard('dry run ("armed" is not true): would send load to 0.08')
        service.send(self.data[0])
        service.settled(1)
        self.heard(f"would send load to {service.states()[0]['decision']['time']} (")
        bridge.send_signal(signal.SIGTERM)
        self.ended(bridge, 130)
        self.assertEqual((self.machine.history, bytes(self.machine.holding), self.orders()), ([], bytes(10), []))

    def test_the_service_dies_on_the_way_and_the_machine_holds(self):
        self.decide()
        service = self.begin(rate=0.4, timeout=3)
        bridge = self.bridge()
        self.wait_until(lambda: self.machine.history[1:] and self.machine.position > self.machine.history[0][2])
        received = service.get("/v1/state")[1]["received_at"]
        service.kill()
        self.wait_until(lambda: self.machine.action == HOLD)
        self.heard("held: the service does not answer: ")
        stands, beats = self.machine.position, self.machine.word(4)
        time.sleep(0.5)
        self.assertEqual((self.machine.position, self.machine.word(4)), (stands, beats))
        service.start(port=service.port)
        self.assertEqual(service.states()[0]["received_at"], received)  # so the decision's age is known
        self.ended(bridge)
        self.expect_none_twice()
        self.expect_followed(service)

    def test_the_bridge_dies_anywhere_and_the_machine_holds(self):
        self.decide()
        service = self.begin(rate=0.4, watchdog=1.0, timeout=5)
        for kills in range(1, 4):
            bridge = self.bridge()
            self.wait_until(lambda: bridge.poll() is not None or len(self.machine.history) >= 2 * kills - 1)
            bridge.send_signal(signal.SIGKILL)
            bridge.wait()
        self.wait_until(lambda: not self.machine.alive)
        time.sleep(0.1)
        stands = self.machine.position
        time.sleep(0.5)
        self.assertEqual(self.machine.position, stands)
        self.ended(self.bridge())
        self.expect_none_twice()
        self.expect_followed(service)

    def test_killed_at_any_time_nothing_is_sent_twice(self):
        self.decide()
        chance = random.Random(LOOPS)
        for _ in range(LOOPS):
            service = self.begin(rate=chance.choice((0.4, 2.0)), watchdog=1.0, timeout=4)
            bridge = self.bridge()
            for _ in range(6):
                time.sleep(chance.expovariate(2.0))  # wherever that is
                if bridge.poll() is not None:
                    break
                if chance.random() < 0.7:
                    bridge.send_signal(signal.SIGKILL)
                    bridge.wait()
                    bridge = self.bridge()
                else:
                    service.kill()
                    time.sleep(chance.choice((0, 5)))
                    service.start(port=service.port)
            self.ended(bridge)
            self.expect_none_twice()
            self.expect_followed(service)
            for path in [*self.folder.glob("assimilation.journal*"), self.folder / "spool" / "first.jsonl"]:
                path.unlink()

    def test_a_machine_that_does_not_acknowledge_is_held_until_somebody_has_looked(self):
        self.decide()
        service = self.begin(timeout=2)
        self.machine.delay = 10
        bridge = self.bridge()
        self.heard("ALARM: command 1 (load) is not acknowledged within 2 s; held until somebody has looked (--release)",
                   "ALARM: command 2 (hold) is not acknowledged within 2 s: there is no heartbeat until it is",
                   "command 2 (hold): acknowledged")  # late
        self.assertEqual([action for action, *_ in self.machine.history], [LOAD, HOLD])
        bridge.send_signal(signal.SIGTERM)
        self.ended(bridge, 130)
        self.machine.delay = 0
        bridge = self.bridge()
        self.heard("command 2 (hold): confirmed")
        bridge.kill()
        bridge.wait()
        self.ended(self.bridge("--release"))
        self.command(timeout=20)
        self.ended(self.bridge())
        self.expect_none_twice()
        self.expect_followed(service)

    def test_a_load_outside_the_limits_is_not_sent(self):
        self.decide()
        service = self.begin(limits={"lower": 0, "upper": 1, "step": 0.1})
        bridge = self.bridge()
        self.heard("more than command.limits.step, 0.1: somebody has to look")
        self.wait_until(lambda: self.machine.action == HOLD and self.spooled("acknowledged")[-1]["acknowledged"] == self.machine.history[-1][1])
        bridge.send_signal(signal.SIGTERM)
        self.ended(bridge, 130)
        self.assertNotIn("interrupts", self.orders()[-1])  # it was told already
        self.ended(self.bridge("--release"))
        self.command(limits={"lower": 0, "upper": 1, "step": 1})
        self.ended(self.bridge())
        self.expect_none_twice()
        self.expect_followed(service)

    def test_a_rejected_answer_holds(self):
        self.decide()
        service = self.begin()
        exact = self.machine.specimen.exact
        for step, values in enumerate(exact):
            exact[step] = [-20 * value for value in values]
        bridge = self.bridge()
        self.heard("the verdict is reject: do not load on", "it was measured 3 times again: somebody has to look")
        self.wait_until(lambda: len(self.spooled("acknowledged")) == len(self.orders()))
        self.assertEqual([order["action"] for order in self.orders() if "interrupts" not in order][1:], ["hold"] * 4)
        self.assertEqual(service.settled()["structure"], "reject")
        bridge.kill()
        bridge.wait()
        self.expect_none_twice()

    def test_a_risk_that_cannot_be_met_and_nothing_to_choose_from_stop(self):
        failed = FAILURE.replace("1e-3", "-1e-3")  # whatever is done
        for text, why in ((failed + '[decide]\nfailure = "sag"\n', "P(sag"), (FAILURE + '[decide]\nfailure = "sag"\nend = 0.09\ncost = 9\n', "")):
            with self.subTest(text):
                before = self.project.read_text()
                self.edit('results = "results/"\n', text.replace("[forecast", "[forecast"))
                service = self.begin()
                self.ended(self.bridge())
                self.assertEqual([action for action, *_ in self.machine.history], [LOAD, STOP])
                self.assertIn(why, self.orders()[-1]["why"])
                self.assertEqual(self.orders()[-1]["why"], service.states()[-1]["decision"]["message"])
                service.stop()
                self.project.write_text(before)
                for path in [*self.folder.glob("assimilation.journal*"), self.folder / "spool" / "first.jsonl"]:
                    path.unlink()

    def test_a_project_that_decides_nothing_holds(self):
        self.edit('results = "results/"\n', "")
        self.begin()
        bridge = self.bridge()
        self.heard("held: the service decides nothing: the project has no [decide]")
        self.wait_until(lambda: self.machine.action == HOLD)
        self.assertIsNone(bridge.poll())

    def test_a_machine_that_is_not_there_is_waited_for(self):
        self.decide()
        service = self.begin()
        port = self.machine.port
        self.configuration["modbus"]["address"] = f"127.0.0.1:{free_port()}"
        self.write_configuration()
        bridge = self.bridge()
        self.heard("ECONNREFUSED", "tried again")
        bridge.send_signal(signal.SIGTERM)
        self.ended(bridge, 130)
        self.configuration["modbus"]["address"] = f"127.0.0.1:{port}"
        self.configuration["command"]["reached"] = {"register": 5, "table": "input"}
        self.write_configuration()
        bridge = self.bridge()
        self.heard("command.reached: exception 2, illegal data address; tried again")
        bridge.send_signal(signal.SIGTERM)
        self.ended(bridge, 130)
        self.assertEqual(self.machine.history, [])
        self.command(reached={"register": 1, "table": "input"}, set_point={"register": 0, "type": "int16", "scale": 1e-6, "of": "time"})
        bridge = self.bridge()
        self.heard("ALARM: command.set_point: the machine refuses 83333.3", " is no int16; held until somebody has looked")
        self.wait_until(lambda: self.machine.history)
        self.assertEqual(self.machine.action, HOLD)
        bridge.kill()
        bridge.wait()
        self.expect_none_twice()
        service.stop()

    def test_what_the_service_refuses_holds_and_ends(self):
        self.decide()
        service = self.begin()
        service.post("/v1/tests/finish", {"by": "Ada", "comment": "too early"})
        self.command(first={"time": 1 / 12, "set_point": 0.0})
        bridge = self.bridge()
        self.heard("held: the service is FINISHED")
        self.assertIsNone(bridge.poll())
        service.post("/v1/tests/resume", {"by": "Ada", "comment": "go on"})
        self.ended(bridge)
        self.expect_none_twice()

    def over_mqtt(self, broker, **more):
        """Tells the bridge of topics in place of registers."""
        del self.configuration["modbus"]
        topic = lambda name: {"topic": f"m/{name}"}
        self.configuration |= {"mqtt": {"broker": f"127.0.0.1:{broker.port}", **more}, "channels": {str(k): topic(k) for k in range(24)}}
        self.command(set_point={**topic("set_point"), "of": "time", "scale": 1e-3}, action=topic("action"), sequence=topic("sequence"),
                     acknowledge=topic("taken"), reached=topic("done"), heartbeat={**topic("heartbeat"), "every": 0.1})

    @unittest.skipUnless(os.path.exists("/usr/sbin/mosquitto"), "mosquitto is not installed")
    def test_decisions_go_to_an_mqtt_broker(self):
        self.decide()
        service = self.begin()
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        self.over_mqtt(broker)
        specimen, had = self.machine.specimen, []
        set_points, sequences = broker.listen("m/set_point"), broker.listen("m/sequence")
        publish = lambda name, number: broker.publish(f"m/{name}", repr(number).encode(), retain=True)

        def machine():
            raw = 0.0
            while True:
                number = int(sequences.get())
                had.append(number)
                publish("taken", number)
                while not set_points.empty():  # it came before the number
                    raw = float(set_points.get())
                for k in range(24):
                    publish(k, specimen.measure(k, 1e-3 * raw))
                publish("done", number)

        threading.Thread(target=machine, daemon=True).start()
        bridge = self.bridge()
        self.heard("command.acknowledge: nothing was published; tried again")
        publish("taken", 0)
        publish("done", 0)
        self.wait_until(lambda: bridge.poll() is not None or len(self.spooled("seq")) >= 2)
        bridge.send_signal(signal.SIGKILL)
        bridge.wait()
        self.ended(self.bridge())
        self.assertEqual(service.settled()["records"], len(self.spooled("seq")))
        self.assertEqual(service.states()[-1]["decision"]["action"], "stop")
        dropped = {line["dropped"] for line in self.spooled("dropped")}
        self.assertEqual(had, [order["command"] for order in self.orders() if order["command"] not in dropped])
        self.assertEqual([line["time"] for line in service.states()], sorted({order["time"] for order in self.orders() if "time" in order}))

    @unittest.skipUnless(os.path.exists("/usr/sbin/mosquitto"), "mosquitto is not installed")
    def test_a_broker_with_tls_and_a_password_is_heard(self):
        self.decide()
        self.begin(armed=False)
        make_certificates(self.folder)
        broker = Broker(self.folder, password="correct horse")
        self.addCleanup(broker.stop)
        (self.folder / "password").write_text("wrong\n")
        self.over_mqtt(broker, user="gauge", password=str(self.folder / "password"), ca=str(self.folder / "ca.pem"))
        bridge = self.bridge()
        self.heard("the broker refuses the connection: code 5")
        bridge.kill()
        bridge.wait()
        (self.folder / "password").write_text("correct horse\n")
        for name in ("taken", "done"):
            broker.publish(f"m/{name}", b"0", retain=True)
        bridge = self.bridge()
        self.heard('dry run ("armed" is not true): would send load to 0.08')
        bridge.send_signal(signal.SIGTERM)
        self.ended(bridge, 130)

    def test_libmodbus_takes_what_is_sent(self):
        self.decide()
        server = self.libmodbus_server(0.0, 0.0)
        registers = server.mapping.contents.tab_registers
        wanted = {"float32": 1 / 12, "int32": 83333, "uint32": 83333, "int16": -333}
        self.begin(timeout=2)
        for kind, number in wanted.items():
            scale = {"float32": 1, "int16": -1 / 4000}.get(kind, 1e-6)
            self.configuration |= {"modbus": {"address": f"127.0.0.1:{server.port}", "timeout": 20}, "session": kind,
                                   "spool": str(self.folder / "spool" / f"{kind}.jsonl")}
            point = {"register": 0, "type": kind, "scale": scale, "of": "time", **({"word_order": "little"} if kind == "uint32" else {})}
            self.command(set_point=point, action={"register": 2, "codes": {"hold": 40, "load": 50, "stop": 60}},
                         acknowledge={"register": 8}, reached={"register": 9})
            (self.folder / "bridge.log").unlink(missing_ok=True)
            bridge = self.bridge()
            self.heard("is not acknowledged within 2 s")
            raw = struct.pack(">HH", registers[0], registers[1])
            raw = raw[2:] + raw[:2] if kind == "uint32" else raw
            found = struct.unpack({"float32": ">f", "int32": ">i", "uint32": ">I", "int16": ">hxx"}[kind], raw)[0]
            self.assertAlmostEqual(found, number, delta=1e-8)
            self.wait_until(lambda: registers[2] == 40)
            self.assertGreater(registers[4], 0)
            bridge.kill()
            bridge.wait()

    def test_what_is_wrong_is_said_with_its_place(self):
        self.decide()
        self.begin()
        good = json.dumps(self.configuration)
        self.configuration["time"] = {"start": "2026-11-23T09:00:00Z", "seconds": 1}
        self.configuration["channels"]["3"]["every"] = 0.1
        command = self.configuration["command"]
        del command["dead_time"], command["acknowledge"]
        command |= {"armed": "yes", "timeout": 0, "limits": {"lower": 0, "upper": "high"}, "action": {"register": 2, "codes": {"hold": 0, "go": 1}},
                    "sequence": {"register": 3, "table": "input"}, "set_point": {"register": 0, "type": "float", "of": "laod", "scale": 0}, "halt": 1}
        command["heartbeat"] = {"register": -1}
        self.write_configuration()
        self.refused(3, "time: must be absent with command.reached: data are taken where the machine has reached a command",
                     "channels.3.every: is not known here", "command.halt: is not known here; there are armed, timeout, travel, dead_time,",
                     'command.armed: must be true or false, not "yes"', "command.timeout: must be a positive number, not 0",
                     "command.dead_time: is missing", "command.acknowledge: is missing", 'command.limits.upper: must be a number, not "high"',
                     "command.limits.step: is missing", 'command.action.codes: must be {"hold": …, "load": …, "stop": …} with integers',
                     "command.sequence.table: is not known here", 'command.set_point.of: must be one of "load", "time", not "laod"',
                     "command.set_point.scale: must not be 0, not 0", 'command.set_point.type: must be one of "int16"',
                     "command.heartbeat.register: must be an integer from 0 to 65535, not -1", "command.heartbeat.every: is missing")
        self.configuration = json.loads(good)
        self.command(limits={"lower": 1, "upper": 0, "step": 1}, heartbeat={"register": 3, "every": 30}, action={"register": 1})
        self.refused(3, "command.limits: lower, 1, must be less than upper, 0", "command.first.set_point: 0.08333333333333333 is outside command.limits",
                     "command.heartbeat.every: 30 must be less than command.timeout, 20",
                     "command.action: holding register 1 is that of command.set_point", "command.heartbeat: holding register 3 is that of command.sequence")
        self.configuration = json.loads(good)
        del self.configuration["command"]["reached"]
        self.write_configuration()
        self.refused(3, "time: is missing", "command.first: is that of a driven test, which needs command.reached", "channels.0.every: is missing")
        self.configuration = json.loads(good)
        self.configuration["mqtt"] = {"broker": "broker"}
        del self.configuration["modbus"]
        self.command(acknowledge={"topic": "m/#"}, sequence={"topic": "m/a"}, action={"topic": "m/a"})
        self.refused(3, 'mqtt.broker: must be "HOST:PORT"; 1883 is usual, 8883 with TLS, not "broker"', "channels.0.topic: is missing",
                     "channels.0.register: is not known here", 'command.acknowledge.topic: must be one topic, without # and +, not "m/#"')
        self.configuration = json.loads(good)
        self.command(first={"time": 0.1, "set_point": 0.1})
        self.refused(3, "command.first.time: 0.1 is no time of the model; the nearest is 0.08333333333333333")
        self.assertEqual(self.machine.history, [])

    def test_decisions_go_to_an_opcua_server(self):
        self.need_packages()
        self.decide()
        service = self.begin()
        server, port = self.opcua_server()
        nodes = {"SetPoint": "Double", "Action": "UInt16", "Sequence": "UInt16", "Heartbeat": "UInt16"}
        signals = {name: {"type": kind} for name, kind in nodes.items()} | {name: {"type": "UInt16", "echo": "Sequence"} for name in ("Taken", "Done")}
        specimen = self.machine.specimen
        for k in range(24):
            values = [specimen.measure(k, t) for t in specimen.times]
            signals[f"u{k}"] = {"type": "Double", "follows": "SetPoint", "full": 1000, "values": values}
        server.stdin.write(json.dumps(signals).encode() + b"\n")
        server.stdin.flush()
        node = lambda name: {"node": f"ns=1;s={name}"}
        del self.configuration["modbus"]
        self.configuration |= {"opcua": {"endpoint": f"opc.tcp://127.0.0.1:{port}"}, "channels": {str(k): node(f"u{k}") for k in range(24)}}
        self.command(set_point={**node("SetPoint"), "of": "time", "scale": 1e-3}, action=node("Action"), sequence=node("Sequence"),
                     acknowledge=node("Taken"), reached=node("Done"), heartbeat={**node("Heartbeat"), "every": 0.1})
        bridge = self.bridge()
        self.wait_until(lambda: bridge.poll() is not None or len(self.spooled("seq")) >= 2)
        bridge.send_signal(signal.SIGKILL)
        bridge.wait()
        self.ended(self.bridge())
        self.assertEqual(service.settled()["records"], len(self.spooled("seq")))
        self.assertEqual([line["decision"]["action"] for line in service.states()][-1], "stop")
        written = [line.split() for line in (self.folder / "opcua.log").read_text().splitlines() if line.startswith("write")]
        numbers = [int(value) for _, name, value in written if name == "Sequence"]
        dropped = {line["dropped"] for line in self.spooled("dropped")}
        self.assertEqual(numbers, [order["command"] for order in self.orders() if order["command"] not in dropped])
        self.assertEqual(len(set(numbers)), len(numbers))
        points = {float(value) for _, name, value in written if name == "SetPoint"}
        self.assertEqual(points, {order["set_point"] / 1e-3 for order in self.orders() if order["action"] == "load"})
        self.assertEqual([name for _, name, _ in written if name != "Heartbeat"][:3], ["SetPoint", "Action", "Sequence"])
        self.assertTrue([value for _, name, value in written if name == "Heartbeat"])
        service.stop()


if __name__ == "__main__":
    sys.exit(exit_status(unittest.main(exit=False, verbosity=2).result))
