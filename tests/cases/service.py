"""`knothe serve`: what it answers, and that nothing is lost. Judged by `knothe assimilate` on the same data."""
import http.client
import json
import math
import random
import resource
import signal
import socket
import struct
import threading
import time
import unittest

import analytic_model
from service_support import Broker, Events, ServiceCase, comparable
from support import parse_line


class Test(ServiceCase):
    def test_the_lines_are_those_of_assimilate(self):
        expected = [comparable(line) for line in self.assimilate()]
        service = self.serve()
        self.expect_error(service.get("/v1/state"), 404, "NoState")
        for step, datum in enumerate(self.data):
            self.expect_stored(service.send(datum), step)
        service.settled(12)
        self.assertEqual([comparable(line) for line in service.states()], expected)
        self.assertEqual(comparable(service.get("/v1/state")[1]), expected[-1])
        self.assertEqual([line["step"] for line in service.get("/v1/states?from=9")[1]], [9, 10, 11])
        self.assertEqual(service.stop(), 130)

    def test_a_restart_changes_no_bit(self):
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        service.settled(12)
        before = [comparable(line) for line in service.states()]
        service.kill()
        service.start()
        service.settled(12)
        self.assertEqual([comparable(line) for line in service.states()], before)
        self.assertEqual(service.stop(), 130)

    def test_duplicates_are_known_and_conflicts_refused(self):
        service = self.serve()
        self.expect_stored(service.send(self.data[0]), 0)
        self.expect_stored(service.send(self.data[0]), 0, duplicate=True)
        self.expect_stored(service.send({**self.data[0], "status": ["good"] * 24}), 0, duplicate=True)
        changed = {**self.data[0], "values": [0.0] + self.data[0]["values"][1:]}
        self.expect_error(service.send(changed), 409, "Conflict")
        self.expect_error(service.send({**self.data[0], "time": self.data[1]["time"]}), 409, "Conflict")
        status = service.settled(1)
        self.assertEqual((status["accepted"], status["duplicates"], status["conflicts"]), (1, 2, 2))
        self.assertEqual(service.get("/v1/state")[1]["data"], 1)

    def test_missing_values_are_null_nan_or_a_status(self):
        lines = []
        gap = [1, 5, 20]
        values = [v if i not in gap else None for i, v in enumerate(self.data[0]["values"])]
        status = ["good" if i not in gap else "bad" for i in range(24)]
        array = struct.pack("<24d", *[math.nan if v is None else v for v in values])
        header = "{'descr': '<f8', 'fortran_order': False, 'shape': (24,), }"
        npy = b"\x93NUMPY\x01\x00" + struct.pack("<H", 118) + header.ljust(117).encode() + b"\n" + array
        for k, way in enumerate(("null", "status", "npy")):
            service = self.serve(extra=f'journal = "{way}.journal"\n') if k == 0 else None
            if service is None:
                self.edit(f'"{("null", "status", "npy")[k - 1]}.journal"', f'"{way}.journal"')
                service = self.serve()
            if way == "null":
                answer = service.send({**self.data[0], "values": values})
            elif way == "status":
                answer = service.send({**self.data[0], "status": status})
            else:
                answer = service.post("/v1/measurements", npy, **{"Content-Type": "application/x-npy", "source": "camera",
                                                                  "session": "s", "seq": "0", "time": repr(self.data[0]["time"])})
            self.expect_stored(answer, 0)
            service.settled(1)
            lines.append(comparable(service.get("/v1/state")[1]))
            self.assertEqual(service.get("/v1/observations")[1]["status"].count("missing"), 3)
            service.stop()
        self.assertEqual(lines[0]["missing"], 3)
        self.assertEqual(lines[1], lines[0])
        self.assertEqual(lines[2], lines[0])

    def test_what_is_wrong_is_refused_by_name(self):
        service = self.serve(extra="max_body = 100000\n")
        good = self.data[0]
        for body, kind in ((b"", "Malformed"), (b"{", "Malformed"), (b"[]", "Malformed"), (b"\xff\xfe", "Malformed"),
                           ({**good, "seq": -1}, "Malformed"), ({**good, "seq": "0"}, "Malformed"), ({**good, "source": ""}, "Malformed"),
                           ({**good, "values": good["values"][:-1]}, "WrongSize"), ({**good, "values": "x"}, "Malformed"),
                           ({**good, "values": [1e300] * 24}, "Malformed"), ({**good, "status": ["good"]}, "Malformed"),
                           ({**good, "time": 0.1234}, "UnknownTime"), ({**good, "time": 1e308}, "UnknownTime"),
                           ({**good, "site": "another"}, "UnknownSite"), ({k: v for k, v in good.items() if k != "time"}, "Malformed")):
            self.expect_error(service.send(body), 400, kind)
        self.expect_error(service.send(b"x" * 200000), 413, "TooLarge")
        self.expect_error(service.get("/v1/nothing"), 404, "NotFound")
        self.expect_error(service.get("/../../etc/passwd"), 404, "NotFound")
        self.expect_error(service.get("/v1/measurements"), 405, "MethodNotAllowed")
        self.expect_error(service.get("/v1/states?from=x"), 400, "Malformed")
        self.expect_error(service.get("/v1/field?name=displacement"), 404, "NoState")
        self.expect_error(service.get("/v1/state?site=another"), 404, "UnknownSite")
        self.assertEqual(service.settled(0)["accepted"], 0)
        self.expect_stored(service.send(good), 0)

    def test_data_out_of_order_give_what_they_give_in_order(self):
        expected = [comparable(line) for line in self.assimilate()]
        service = self.serve()
        for k in (0, 3, 1, 2, 4, 7, 5, 6, 5, 8, 11, 9, 10):
            self.assertNotIn("quarantined", service.send(self.data[k])[1])
        service.settled(12)
        self.assertEqual([comparable(line) for line in service.states()], expected)

    def test_what_comes_too_late_is_quarantined_and_can_be_let_in(self):
        expected = [comparable(line) for line in self.assimilate()]
        service = self.serve()
        for k in range(1, 12):
            service.send(self.data[k])
        status, answer = service.send(self.data[0])
        self.assertEqual((status, answer.get("quarantined")), (200, True))
        service.settled(12)
        self.assertEqual([line["step"] for line in service.states()], list(range(1, 12)))
        key = {k: self.data[0][k] for k in ("source", "session", "seq")}
        self.assertEqual([{k: q[k] for k in key} for q in service.get("/v1/quarantine")[1]["quarantined"]], [key])
        service.kill()  # it stays there
        service.start()
        self.assertEqual(len(service.get("/v1/quarantine")[1]["quarantined"]), 1)
        self.expect_error(service.post("/v1/quarantine", {**key, "seq": 99}), 404, "NotQuarantined")
        self.expect_stored(service.post("/v1/quarantine", key), 0)
        self.expect_stored(service.post("/v1/quarantine", key), 0, duplicate=True)
        service.settled()
        self.assertEqual([comparable(line) for line in service.states()], expected)
        self.assertEqual(service.get("/v1/quarantine")[1]["quarantined"], [])
        service.kill()
        service.start()
        service.settled()
        self.assertEqual([comparable(line) for line in service.states()], expected)

    def test_several_data_of_one_time_are_one_step(self):
        service = self.serve()
        other = {**self.data[0], "source": "gauges", "values": [v + 1e-6 for v in self.data[0]["values"]]}
        service.send(self.data[0])
        service.send(other)
        service.settled(2)
        line = service.get("/v1/state")[1]
        self.assertEqual((line["step"], line["data"], line["used"]), (0, 2, 48))

    def test_events_come_in_order_and_resume(self):
        service = self.serve()
        events = Events(service)
        for datum in self.data[:6]:
            service.send(datum)
        events.wait_for(lambda e: len(e.steps()) >= 6)
        got = events.steps()
        events.close()
        self.assertEqual([line["step"] for _, line in got], list(range(6)))
        self.assertEqual([i for i, _ in got], sorted({i for i, _ in got}))
        self.assertEqual([line for _, line in got], service.states())
        for datum in self.data[6:]:
            service.send(datum)
        service.settled(12)
        resumed = Events(service, Last_Event_ID=str(got[2][0]))
        resumed.wait_for(lambda e: len(e.steps()) >= 9)
        self.assertEqual([line["step"] for _, line in resumed.steps()], list(range(3, 12)))
        resumed.close()
        latest = Events(service)
        latest.wait_for(lambda e: e.steps() and any(x.get("event") == "status" for x in e.events))
        self.assertEqual([line["step"] for _, line in latest.steps()], [11])
        latest.close()
        service.kill()
        service.start()
        service.settled(12)
        again = Events(service, Last_Event_ID=str(resumed.steps()[-1][0]))  # of an earlier life: all have changed since
        again.wait_for(lambda e: len(e.steps()) >= 12)
        self.assertEqual([comparable(line) for _, line in again.steps()], [comparable(line) for line in service.states()])
        again.close()

    def test_nothing_acknowledged_is_lost_however_often_it_is_killed(self):
        """kill -9 at random instants while data come from two senders, with repetitions; short form of the nightly thousand."""
        expected = [comparable(line) for line in self.assimilate()]
        chance = random.Random(11)
        service = self.serve()
        acknowledged = set()
        for kill in range(20):
            order = sorted(range(12), key=lambda k: k + 2 * chance.random())
            stop = threading.Timer(0.002 + 0.05 * chance.random(), service.kill)
            stop.start()
            try:
                connection = service.connection()
                for k in order[: 1 + kill]:
                    if service.send(self.data[k], connection)[0] == 200:
                        acknowledged.add(k)
            except (OSError, http.client.HTTPException):
                pass  # it was killed in the middle
            stop.join()
            service.start()
            records = self.expect(0, "replay", "assimilation.journal", "--project", self.project_name).out
            self.assertGreaterEqual(int(records.split(": ")[1].split(" ")[0]), len(acknowledged), records)
        for datum in self.data:
            self.assertEqual(service.send(datum)[0], 200)
        held = service.get("/v1/quarantine")[1]["quarantined"]
        for key in held:
            service.post("/v1/quarantine", {k: key[k] for k in ("source", "session", "seq")})
        service.settled(12)
        self.assertEqual([comparable(line) for line in service.states()], expected)
        self.assertEqual([line["data"] for line in service.states()], [1] * 12)

    def test_a_full_disk_is_507_and_passes(self):
        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

        service = self.serve(preexec_fn=limit, restore_signals=False)
        self.expect_stored(service.send(self.data[0]), 0)
        service.settled(1)
        largest = (self.folder / "assimilation.journal-wal").stat().st_size
        resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, (largest, resource.RLIM_INFINITY))
        self.expect_error(service.send(self.data[1]), 507, "DiskFull")
        status = service.get("/v1/status")[1]
        self.assertEqual((status["state"], status["read_only"], status["records"]), ("DEGRADED", True, 1))
        self.assertEqual(service.get("/v1/state")[1]["step"], 0)
        resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        end = time.monotonic() + 30
        while service.get("/v1/status")[1]["read_only"]:
            self.assertLess(time.monotonic(), end)
            time.sleep(0.1)
        self.expect_stored(service.send(self.data[1]), 1)
        self.assertEqual(service.settled(2)["records"], 2)

    def test_a_damaged_journal_is_refused_by_name_and_recovered(self):
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        service.stop()
        path = self.folder / "assimilation.journal"
        content = bytearray(path.read_bytes())
        at = content.index(struct.pack("<d", self.data[7]["values"][3]))
        content[at + 3] ^= 16
        path.write_bytes(content)
        self.expect(4, "serve", self.project_name, "--port", "0", stderr=["record 8", "knothe recover"])
        self.expect(4, "replay", path, stderr="record 8")
        out = self.expect(0, "recover", path, "-o", "saved.journal").out
        self.assertIn("11 records saved", out)
        self.assertIn("record 8", out)
        again = self.serve(extra='journal = "saved.journal"\n')
        again.settled(11)
        self.assertEqual([line["step"] for line in again.states()], [0, 1, 2, 3, 4, 5, 6, 8, 9, 10, 11])

    def test_replay_and_export_are_what_was_served(self):
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        service.settled(12)
        served = [comparable(line) for line in service.states()]
        lines = self.expect(0, "replay", "assimilation.journal", "--project", self.project_name, "--json").lines()  # beside the writer
        self.assertEqual(lines.pop()["done"], True)
        self.assertEqual([comparable(line) for line in lines], served)
        service.stop()
        self.expect(0, "export", "assimilation.journal", "-o", "exported.csv")
        self.expect(0, "export", "assimilation.journal", "-o", "exported/")
        self.assertTrue((self.folder / "exported" / "posterior.nc").exists())
        kept = [parse_line(line) for line in (self.folder / "exported" / "steps.jsonl").read_text().splitlines()]
        self.assertEqual([line["mean"] for line in kept], [line["mean"] for line in served])
        self.edit('data = "data.h5"', 'data = "exported.csv"')
        self.assertEqual([line["mean"] for line in self.assimilate()], [line["mean"] for line in served])

    def test_another_writer_is_refused(self):
        self.serve()
        self.expect(4, "serve", self.project_name, "--port", "0", stderr="another process writes this journal")

    def test_other_sensors_are_refused(self):
        self.serve().stop()
        self.edit("random = 12", "random = 11")
        self.expect(0, "simulate", self.project_name, "--model", "model.h5", "-o", "other.h5")
        self.edit('data = "data.h5"', 'data = "other.h5"')
        self.expect(4, "serve", self.project_name, "--port", "0", stderr="other sensors")

    def test_a_missed_deadline_under_strict_ends_with_7(self):
        service = self.serve("--strict-deadline", extra="budget = 1e-9\n")
        self.expect_stored(service.send(self.data[0]), 0)
        self.assertEqual(service.end(), 7)
        self.assertIn("--strict-deadline", (self.folder / "serve.log").read_text())

    def test_a_missed_deadline_is_degraded_and_counted(self):
        service = self.serve(extra="budget = 1e-9\n")
        service.send(self.data[0])
        status = service.settled(1)
        self.assertEqual((status["state"], status["deadline_misses"]), ("DEGRADED", 1))
        self.assertIn("budget", status["reason"])
        self.assertEqual(service.get("/v1/state")[1]["step"], 0)  # shown all the same

    def test_a_datum_that_does_not_fit_is_biased_and_an_alarm(self):
        service = self.serve(extra="budget = 60.0\nstale_after = 60.0\n")
        for datum in self.data[:5]:
            service.send(datum)
        service.settled(5)
        self.assertEqual(service.get("/v1/status")[1]["state"], "OK")
        shifted = {**self.data[5], "values": [v + (3e-5 if i % 2 else -3e-5) for i, v in enumerate(self.data[5]["values"])]}
        service.send(shifted)
        status = service.settled(6)
        self.assertEqual(status["state"], "BIASED", status)
        self.assertIn("bias", [alarm["kind"] for alarm in service.get("/v1/alarms")[1]["alarms"]])

    def test_tokens_guard_reading_and_sending_each(self):
        (self.folder / "read").write_text("read-token-of-32-characters-xxxx\n")
        (self.folder / "send").write_text("send-token-of-32-characters-xxxx\n")
        service = self.serve(extra='read_token = "read"\ningest_token = "send"\n')
        self.assertEqual(service.get("/livez")[0], 200)
        self.assertEqual(service.get("/")[0], 200)
        for path in ("/v1/state", "/v1/events", "/metrics", "/Info", "/v1/status"):
            self.expect_error(service.get(path), 401, "Unauthorized")
        self.expect_error(service.get("/v1/status", Authorization="Bearer send-token-of-32-characters-xxxx"), 401, "Unauthorized")
        self.assertEqual(service.get("/v1/status", Authorization="Bearer read-token-of-32-characters-xxxx")[0], 200)
        self.expect_error(service.send(self.data[0]), 401, "Unauthorized")
        self.expect_error(service.post("/v1/measurements", self.data[0], Authorization="Bearer read-token-of-32-characters-xxxx"), 401, "Unauthorized")
        self.expect_stored(service.post("/v1/measurements", self.data[0], Authorization="Bearer send-token-of-32-characters-xxxx"), 0)

    def test_other_addresses_need_tokens(self):
        self.project.write_text(self.project.read_text() + '\n[serve]\naddress = "0.0.0.0"\n')
        self.expect(3, "serve", self.project_name, "--port", "0", stderr=["assimilation.toml:", "serve.read_token"])

    def test_a_port_in_use_is_said(self):
        service = self.serve()
        self.project.write_text(self.project.read_text() + '\n[serve]\njournal = "second.journal"\n')
        self.expect(5, "serve", self.project_name, "--port", service.port, stderr=["cannot listen", "--port"])

    def test_the_page_asks_nobody_else_and_other_pages_get_nothing(self):
        service = self.serve()
        status, headers, content = service.request("GET", "/")
        self.assertEqual(status, 200)
        self.assertIn(b"<!doctype html", content[:200].lower())
        self.assertIn("connect-src 'self'", headers["Content-Security-Policy"])
        for name in ("X-Content-Type-Options", "X-Frame-Options", "Referrer-Policy"):
            self.assertIn(name, headers)
        self.expect_error(service.get("/v1/status", Host="evil.example"), 403, "WrongHost")
        self.expect_error(service.get("/v1/status", Origin="http://evil.example"), 403, "WrongOrigin")
        self.assertEqual(service.get("/v1/status", Origin=f"http://127.0.0.1:{service.port}")[0], 200)
        self.assertEqual(service.request("HEAD", "/")[2], b"")

    def test_slow_and_silent_and_greedy_clients_hold_up_nobody(self):
        service = self.serve(extra="timeout = 2.0\n")
        idle = [socket.create_connection(("127.0.0.1", service.port)) for _ in range(200)]
        slow = socket.create_connection(("127.0.0.1", service.port))
        slow.sendall(b"GET /livez HT")
        greedy = socket.create_connection(("127.0.0.1", service.port))
        greedy.sendall(b"POST /v1/measurements HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000000\r\n\r\n" + b"x" * 100000)
        self.assertIn(b" 413 ", greedy.recv(100))
        chunked = socket.create_connection(("127.0.0.1", service.port))
        chunked.sendall(b"POST /v1/measurements HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nffffffffff\r\nxxx")
        self.assertIn(b" 413 ", chunked.recv(100))
        header = socket.create_connection(("127.0.0.1", service.port))
        header.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"y" * 20000)
        self.assertIn(b" 431 ", header.recv(100))
        nonsense = socket.create_connection(("127.0.0.1", service.port))
        nonsense.sendall(b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n")
        self.assertIn(b" 400 ", nonsense.recv(100))
        viewers = [Events(service) for _ in range(32)]
        for step, datum in enumerate(self.data):
            self.expect_stored(service.send(datum), step)
            self.assertEqual(service.get("/livez")[0], 200)
        for viewer in viewers:
            viewer.wait_for(lambda e: e.steps() and e.steps()[-1][1]["step"] == 11)
        slow.settimeout(20)
        self.assertEqual(slow.recv(100), b"")  # its time was over
        for one in idle + [slow, greedy, chunked, header, nonsense]:
            one.close()
        for viewer in viewers:
            viewer.close()

    def test_what_the_page_asks_for_fits_together(self):
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        service.settled(12)
        about = service.get("/v1/description")[1]
        self.assertEqual([p["name"] for p in about["parameters"]], ["Y0", "Ad"])
        self.assertEqual([f["name"] for f in about["forecasts"]], ["force", "deflection"])
        self.assertEqual(about["steps"], 12)
        mesh = service.get("/v1/mesh")[1]
        self.assertEqual(len(mesh["sensors"]), 24)
        mean = service.get("/v1/state")[1]["mean"]
        field = service.get("/v1/field?name=displacement&step=11")[1]
        self.assertEqual(len(field["values"]), len(mesh["points"]))
        for point, value in list(zip(mesh["points"], field["values"]))[::7]:
            for c in range(3):
                exact = analytic_model.displacement(c, point, 1.0, *mean)
                self.assertAlmostEqual(value[c], exact, delta=1e-10)  # of the model to its formula
        sensitivity = service.get("/v1/field?name=sensitivity&parameter=Ad")[1]["values"]
        std = math.sqrt(service.get("/v1/state")[1]["covariance"][1][1])
        point, h = mesh["points"][5], 1e-5
        slope = (analytic_model.displacement(0, point, 1.0, mean[0], mean[1] + h) - analytic_model.displacement(0, point, 1.0, mean[0], mean[1] - h)) / (2 * h)
        self.assertAlmostEqual(sensitivity[5][0], slope * std, delta=1e-4 * abs(slope * std) + 1e-12)
        residual = service.get("/v1/field?name=residual&step=3")[1]["values"]
        line = service.get("/v1/states?from=3")[1][0]
        sensor, value = mesh["sensors"][4], self.data[3]["values"][4]
        exact = analytic_model.displacement(sensor["component"], (sensor["x"], sensor["y"], sensor["z"]), self.data[3]["time"], *line["mean"])
        self.assertAlmostEqual(residual[4], value - exact, delta=1e-10)
        samples = service.get("/v1/samples")[1]["samples"]
        self.assertAlmostEqual(sum(s[0] for s in samples) / len(samples), mean[0], delta=0.2 * std)

    def test_every_route_of_the_document_is_there(self):
        service = self.serve()
        service.send(self.data[0])
        service.settled(1)
        document = service.get("/v1/openapi.json")[1]
        required = document["components"]["schemas"]["Line"]["required"]
        self.assertLessEqual(set(required), set(service.get("/v1/state")[1]))
        for path, methods in document["paths"].items():
            for method in methods:
                if path == "/v1/events":
                    continue
                status, _, body = service.request(method.upper(), path, "{}" if method == "post" else None)
                self.assertIn(status, (200, 400, 404), (path, body))
                if status == 404:
                    self.assertNotEqual(body["error"]["type"], "NotFound", path)

    def test_metrics_count_what_happened(self):
        service = self.serve()
        for datum in self.data[:3] + self.data[:1]:
            service.send(datum)
        service.settled(3)
        text = service.get("/metrics")[1].decode()
        self.assertIn('knothe_measurements_total{site="assimilation",outcome="accepted"} 3', text)
        self.assertIn('knothe_measurements_total{site="assimilation",outcome="duplicates"} 1', text)
        self.assertIn('knothe_phase_seconds_count{site="assimilation",phase="commit"}', text)
        for line in text.splitlines():
            self.assertTrue(line.startswith("#") or math.isfinite(float(line.rsplit(" ", 1)[1])), line)

    def test_it_is_a_umbridge_server(self):
        service = self.serve()
        for datum in self.data[:4]:
            service.send(datum)
        service.settled(4)
        self.assertEqual(service.get("/Info")[1], {"protocolVersion": 1.0, "models": ["forward", "posterior", "predict"]})
        p = [1.02, 0.93]
        ask = lambda path, name, **more: service.post(path, {"name": name, "config": {"step": 3}, "input": [p], **more})[1]
        self.assertEqual(ask("/InputSizes", "forward"), {"inputSizes": [2]})
        self.assertEqual([ask("/OutputSizes", name)["outputSizes"] for name in ("forward", "posterior", "predict")], [[24], [1], [2]])
        self.assertEqual(ask("/ModelInfo", "predict")["support"], {"Evaluate": True, "Gradient": False, "ApplyJacobian": False, "ApplyHessian": False})
        sensors = service.get("/v1/mesh")[1]["sensors"]
        forward = ask("/Evaluate", "forward")["output"][0]
        for sensor, value in zip(sensors, forward):
            exact = analytic_model.displacement(sensor["component"], (sensor["x"], sensor["y"], sensor["z"]), self.data[3]["time"], *p)
            self.assertAlmostEqual(value, exact, delta=1e-12)
        predict = ask("/Evaluate", "predict")["output"][0]
        self.assertAlmostEqual(predict[0], analytic_model.reaction_force(0.75, *p), delta=1e-3)
        self.assertAlmostEqual(predict[1], analytic_model.displacement(1, (0.03, 0.05, 0.05), 1.0, *p), delta=1e-11)
        # The density, all constants included: priors restricted to the box times Gaussian likelihood, from the formula.
        exact = 0.0
        for value, mean in zip(p, (0.9, 1.1)):
            s = 0.4472135954999579
            mass = 0.5 * (math.erf((1.5 - mean) / s / math.sqrt(2)) - math.erf((0.5 - mean) / s / math.sqrt(2)))
            exact += -0.5 * ((value - mean) / s) ** 2 - math.log(s * math.sqrt(2 * math.pi) * mass)
        for datum in self.data[:4]:
            for sensor, value in zip(sensors, datum["values"]):
                model = analytic_model.displacement(sensor["component"], (sensor["x"], sensor["y"], sensor["z"]), datum["time"], *p)
                exact += -0.5 * ((value - model) / 3e-6) ** 2 - math.log(3e-6 * math.sqrt(2 * math.pi))
        self.assertAlmostEqual(ask("/Evaluate", "posterior")["output"][0][0], exact, delta=1e-4)
        self.check_derivatives(service, p)
        for body, kind in (({"name": "nothing"}, "ModelNotFound"), ({"name": "forward", "input": [[1]]}, "InvalidInput"),
                           ({"name": "forward", "input": [[1, 9]]}, "InvalidInput"), ({"name": "forward", "input": [p], "config": {"step": 99}}, "InvalidInput"),
                           ({"name": "forward"}, "InvalidInput"), ("nonsense", "InvalidInput")):
            self.expect_error(service.post("/Evaluate", body), 400, kind)
        self.expect_error(service.post("/Gradient", {"name": "predict", "input": [p], "outWrt": 0, "inWrt": 0, "sens": [1, 1]}), 400, "UnsupportedFeature")
        self.assertEqual(service.post("/Evaluate", {"name": "posterior", "input": [[9, 9]]})[1], {"output": [[-1.7976931348623157e308]]})

    def check_derivatives(self, service, p):
        def call(path, name, at, **more):
            status, body = service.post(path, {"name": name, "config": {"step": 3}, "input": [at], **more})
            self.assertEqual(status, 200, body)
            return body["output"]

        h, direction = 1e-5, [0.6, -0.8]
        ahead, behind = ([x + sign * h * v for x, v in zip(p, direction)] for sign in (1, -1))
        for name, sens, scale in (("forward", [1.0 - 0.1 * i for i in range(24)], 1e-4), ("posterior", [2.0], 1e3)):
            difference = [(a - b) / (2 * h) for a, b in zip(call("/Evaluate", name, ahead)[0], call("/Evaluate", name, behind)[0])]
            jacobian = call("/ApplyJacobian", name, p, outWrt=0, inWrt=0, vec=direction)
            for a, b in zip(jacobian, difference):
                self.assertAlmostEqual(a, b, delta=1e-5 * scale)
            gradient = call("/Gradient", name, p, outWrt=0, inWrt=0, sens=sens)
            self.assertAlmostEqual(sum(g * v for g, v in zip(gradient, direction)), sum(s * j for s, j in zip(sens, jacobian)), delta=1e-9 * scale)
            hessian = call("/ApplyHessian", name, p, outWrt=0, inWrt1=0, inWrt2=0, sens=sens, vec=direction)
            up, down = (call("/Gradient", name, at, outWrt=0, inWrt=0, sens=sens) for at in (ahead, behind))
            for a, u, d in zip(hessian, up, down):
                self.assertAlmostEqual(a, (u - d) / (2 * h), delta=1e-3 * scale)

    def test_sites_are_apart(self):
        text = self.project.read_text()
        (self.folder / "second.toml").write_text(text)
        service = self.serve(extra='others = ["second.toml"]\n')
        self.assertEqual(service.get("/v1/sites")[1]["sites"], ["assimilation", "second"])
        self.expect_error(service.send(self.data[0]), 400, "Malformed")
        self.expect_stored(service.send({**self.data[0], "site": "second"}), 0)
        self.expect_error(service.get("/v1/state?site=assimilation"), 404, "NoState")
        service.send({**self.data[0], "site": "assimilation"})
        service.send({**self.data[1], "site": "assimilation"})
        service.settled(2)
        self.assertEqual(service.get("/v1/state?site=assimilation")[1]["step"], 1)
        self.assertEqual(service.get("/v1/state?site=second")[1]["site"], "second")

    def test_a_flood_is_committed_in_groups_and_nothing_is_lost(self):
        service = self.serve()
        answers = []

        def sender(name):
            connection = service.connection()
            for seq in range(60):
                answers.append(service.send({**self.data[seq % 12], "source": name, "seq": seq}, connection)[0])

        threads = [threading.Thread(target=sender, args=(f"sender{k}",)) for k in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(answers, [200] * 480)
        service.settled(480)
        self.assertEqual([line["data"] for line in service.states()], [40] * 12)

    def test_mqtt_is_another_way_in_and_waits_for_the_service(self):
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        service = self.serve(extra=f'[serve.mqtt]\nbroker = "127.0.0.1:{broker.port}"\n')
        topic = "knothe/v1/assimilation/camera/data"
        for _ in range(200):
            if b"connected to the MQTT broker" in (self.folder / "serve.log").read_bytes():
                break
            time.sleep(0.05)
        time.sleep(0.2)
        for datum in self.data[:3]:
            broker.publish(topic, json.dumps(datum).encode())
        broker.publish(topic, b"nonsense")
        broker.publish("knothe/v1/assimilation/another/data", json.dumps(self.data[3]).encode())
        service.settled(3)
        self.assertEqual([line["step"] for line in service.states()], [0, 1, 2])
        self.assertEqual(service.stop(), 130)
        broker.publish(topic, json.dumps(self.data[3]).encode())  # nobody is there but the broker
        service.start()
        service.settled(4)
        self.assertEqual([line["step"] for line in service.states()], [0, 1, 2, 3])
        self.expect_stored(service.send(self.data[3]), 3, duplicate=True)

    def test_doctor_says_what_is_there(self):
        outcome = self.run_knothe("doctor")
        self.assertIn(outcome.status, (0, 1))
        for word in ("knothe", "libraries", "processor", "BLAS", "disk", "permissions", "sync"):
            self.assertIn(f" {word} ", outcome.out)


if __name__ == "__main__":
    unittest.main()
