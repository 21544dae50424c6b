"""`knothe serve`: what it answers. Judged by `knothe assimilate` on the same data."""
import json
import math
import re
import socket
import statistics
import struct
import threading
import time
import unittest

import analytic_model
from service_support import Broker, Events, ServiceCase, comparable, make_certificates
from support import read_csv, write_csv


class Test(ServiceCase):
    def test_a_source_with_a_clock_of_its_own_is_as_in_a_batch(self):
        """A load cell whose clock is off, its file read where the sensors are; also where the recorded data end early."""
        force = [(k / 100, analytic_model.reaction_force(k / 100 - 0.04, 1.05, 0.9)) for k in range(101)]
        (self.folder / "cell.csv").write_text("\n".join(["time,reaction_force", *(f"{t!r},{v!r}" for t, v in force)]) + "\n")
        self.edit('data = "data.h5"\n', "")
        self.edit("[parameters]", '''[data]
file = "data.csv"
[data.std]
reaction_force = 10.0
[data.sources.cell]
file = "cell.csv"
time_offset_std = 0.05
time_drift_std = 0.02

[parameters]''')
        rows = read_csv(self.folder / "data.csv")  # the first two times are not measured: the drift is from the model's first
        write_csv(self.folder / "data.csv", [row for row in rows if float(row["time"]) > 0.2])
        self.data = self.data[2:]
        batch = self.assimilate()
        for datum in self.data:
            after = next(k for k in range(1, 101) if force[k][0] >= datum["time"] - 1e-9)
            (t0, v0), (t1, v1) = force[after - 1], force[after]
            datum["values"].append(v0 + (v1 - v0) * (datum["time"] - t0) / (t1 - t0))
        for is_whole, tolerance in ((True, 1e-6), (False, 1.0)):  # in standard deviations; else the model's rates are used
            if not is_whole:
                rows = read_csv(self.folder / "data.csv")
                write_csv(self.folder / "data.csv", [row for row in rows if float(row["time"]) < 0.5])
                (self.folder / "cell.csv").write_text("time,reaction_force\n0.0,0.0\n0.3,400.0\n")
                for path in self.folder.glob("*.journal*"):
                    path.unlink()
            with self.subTest(is_whole=is_whole):
                service = self.serve()
                for datum in self.data:
                    self.expect_stored(service.send(datum))
                service.settled(10)
                states = service.states()
                service.stop()
                for one, other in zip(states, batch, strict=True):
                    for k in range(2):
                        self.assertAlmostEqual(one["mean"][k], other["mean"][k], delta=tolerance * other["covariance"][k][k] ** 0.5)
                    self.assertEqual(one["verdict"]["level"], "ok")
                    offset, expected = one["nuisances"]["cell.time_offset"], other["nuisances"]["cell.time_offset"]
                    if is_whole:
                        self.assertAlmostEqual(offset["mean"], expected["mean"], delta=tolerance * expected["std"])
                self.assertLess(abs(offset["mean"] - 0.04), 3 * offset["std"])

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
        over_noise = [abs(v) / s["std"] for v, s in zip(self.data[-1]["values"], service.get("/v1/mesh")[1]["sensors"])]
        first = int(service.get("/v1/description")[1]["signal"])
        self.assertGreater(over_noise[first], 0.9 * max(over_noise))
        self.assertNotEqual(first, 0)
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

    def test_a_structure_that_changes_is_served_as_it_is_assimilated(self):
        self.edit("[method]\n", '[method]\nforgetting = 0.9\nchange_points = [6]\nchange_retention = 0.3\non_alarm = "restart"\n')
        expected = [comparable(line) for line in self.assimilate()]
        service = self.serve()
        for k in (0, 3, 1, 2, 4, 7, 5, 6, 8, 11, 9, 10):
            service.send(self.data[k])
        service.settled(12)
        self.assertEqual([comparable(line) for line in service.states()], expected)

    def test_methods_that_take_data_in_order_are_served_as_they_assimilate(self):
        for method in ("gate = 3.0", 'likelihood = "student-t"', 'kind = "ukf"'):
            with self.subTest(method):
                self.setUp()
                self.edit("[method]\n", f"[method]\n{method}\n") if "kind" not in method else self.edit('kind = "transport"', method)
                expected = [comparable(line) for line in self.assimilate()]
                service = self.serve()
                for k in (0, 3, 1, 2, 4, 7, 5, 6, 8, 11, 9, 10):
                    service.send(self.data[k])
                service.settled(12)
                self.assertEqual([comparable(line) for line in service.states()], expected)
                self.assertEqual(service.stop(), 130)

    def test_a_known_parameter_with_a_value_is_served_as_it_is_assimilated(self):
        """Batch takes its value at each time from the data: here a series of the same number."""
        self.edit('Ad = { prior = "normal", mean = 1.1, std = 0.4472135954999579 }', 'Ad = { prior = "known" }')
        self.expect(3, "serve", self.project_name, stderr=['give it a "value", which then holds for all of them'])
        self.edit('prior = "known" }', 'prior = "known", value = 0.8 }')
        alone, compared = 'model = "model.h5"', 'model = { separated = "model.h5", candidates = ["./model.h5"] }'
        self.edit(alone, compared)
        self.expect(3, "serve", self.project_name, stderr="or beside [model] candidates")
        self.edit(compared, alone)
        rows = read_csv(self.folder / "data.csv")
        times = sorted({row["time"] for row in rows}, key=float)
        self.edit('data = "data.h5"', 'data = "known.csv"')
        blank = {key: "" for key in rows[0]}
        write_csv(self.folder / "known.csv", rows + [{**blank, "time": t, "sensor": "Ad", "component": "Ad", "value": "0.8"} for t in times])
        expected = self.assimilate()[-1]
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        service.settled(12)
        last = service.get("/v1/state")[1]
        self.assertEqual(len(last["mean"]), 1)
        std = expected["covariance"][0][0] ** 0.5
        self.assertAlmostEqual(last["mean"][0], expected["mean"][0], delta=1e-6 * std)
        self.assertAlmostEqual(last["covariance"][0][0] ** 0.5, std, delta=1e-6 * std)
        for name, forecast in expected["forecast"].items():
            self.assertAlmostEqual(last["forecast"][name]["mean"], forecast["mean"], delta=1e-6 * abs(forecast["mean"]))

    def test_a_correction_beside_offsets_is_served_as_it_is_assimilated(self):
        self.edit("[method]\n", '[method]\nbias_correction = "on"\noffset_std = 1e-6\n')
        expected = [comparable(line) for line in self.assimilate()]
        self.assertEqual({line["bias_correction"] for line in expected}, {"on"})
        service = self.serve()
        for k in (0, 3, 1, 2, 4, 7, 5, 6, 8, 11, 9, 10):
            service.send(self.data[k])
        service.settled(12)
        self.assertEqual([comparable(line) for line in service.states()], expected)

    def check_signal(self, service):
        """What the load cell measured up to a step, beside the formula under draws of that step's posterior."""
        signal = service.get("/v1/signal?sensor=reaction_force&step=3")[1]
        self.assertEqual((signal["name"], signal["units"], signal["step"], signal["time"]), ("reaction_force", "N", 3, self.data[3]["time"]))
        self.assertEqual(signal["measured"]["time"], [datum["time"] for datum in self.data[:4]])
        for value, datum in zip(signal["measured"]["value"], self.data):
            self.assertAlmostEqual(value, datum["values"][24], delta=1e-9 * abs(value))
        self.assertEqual(signal["times"], [datum["time"] for datum in self.data])
        self.assertEqual(signal["loading"]["name"], "imposed_displacement")
        draws = service.get("/v1/samples?step=3")[1]["samples"]
        for i, time in enumerate(signal["times"]):
            forces = [analytic_model.reaction_force(time, *p) for p in draws]
            mean, low, high = (signal["predicted"][key][i] for key in ("mean", "low", "high"))
            spread = math.hypot(statistics.pstdev(forces), 5)  # the load cell's noise is 5 N
            self.assertAlmostEqual(mean, statistics.fmean(forces), delta=0.2 * spread)
            self.assertAlmostEqual((high - low) / (2 * 1.96 * spread), 1, delta=0.2)
        self.expect_error(service.get("/v1/signal?sensor=nothing&step=3"), 400, "UnknownSensor")
        self.expect_error(service.get("/v1/signal?sensor=99&step=3"), 400, "UnknownSensor")

    def test_forces_stand_behind_the_displacements(self):
        header, *rows = (self.folder / "data.csv").read_text().splitlines()
        columns = header.split(",")
        for datum in self.data:
            force = round(analytic_model.reaction_force(datum["time"], 1.0, 1.0) + 3 * math.sin(7 * datum["time"]), 6)
            datum["values"].append(force)
            row = {"time": repr(datum["time"]), "sensor": "cell", "component": "reaction_force", "value": repr(force), "std": "5"}
            rows.append(",".join(row.get(column, "") for column in columns))
        (self.folder / "data.csv").unlink()  # it is the fixture's
        (self.folder / "data.csv").write_text("\n".join([header] + rows) + "\n")
        self.edit('data = "data.h5"', 'data = "data.csv"')
        expected = [comparable(line) for line in self.assimilate()]
        self.assertEqual(expected[0]["used"], 25)
        service = self.serve()
        answer = service.send({**self.data[0], "values": self.data[0]["values"][:24]})
        self.expect_error(answer, 400, "WrongSize")
        self.assertIn("24 displacements, then reaction_force", answer[1]["error"]["message"])
        for k in (0, 3, 1, 2, 4, 7, 5, 6, 8, 11, 9):
            self.expect_stored(service.send(self.data[k]), k)
        service.send({**self.data[10], "values": self.data[10]["values"][:24] + [None]})
        service.settled(12)
        self.assertEqual([comparable(line) for line in service.states()][:10], expected[:10])
        self.assertEqual(service.get("/v1/states?from=10")[1][0]["missing"], 1)
        self.assertEqual(service.get("/v1/mesh")[1]["scalars"], [{"name": "reaction_force", "std": 5.0}])
        self.assertEqual(service.get("/v1/description")[1]["signal"], "reaction_force")
        self.assertEqual(len(service.get("/v1/field?name=residual&step=3")[1]["values"]), 24)
        self.check_signal(service)
        seen = service.get("/v1/observations?step=3")[1]
        self.assertEqual((len(seen["status"]), seen["scalars"]["reaction_force"]["status"]), (24, "used"))
        mean = service.get("/v1/states?from=3")[1][0]["mean"]
        self.assertAlmostEqual(seen["scalars"]["reaction_force"]["residual"],
                               self.data[3]["values"][24] - analytic_model.reaction_force(self.data[3]["time"], *mean), delta=0.01)
        self.assertEqual(service.get("/v1/observations?step=10")[1]["scalars"], {"reaction_force": {"status": "missing"}})
        status, answer = service.send({**self.data[3], "source": "second", "values": self.data[3]["values"][:24] + [-1e9]})
        self.assertEqual((status, answer.get("quarantined")), (200, True))
        self.assertRegex(answer["reason"], r"^reaction_force is -1e\+09, beyond the limit of [0-9.e+]+$")
        service.stop()
        self.project.write_text(self.project.read_text() + "\n[serve.limits]\nreaction_force = 1e10\nreaction_forse = 1.0\n")
        for command in ("check", "serve"):
            self.expect(3, command, self.project_name, stderr=(
                self.position_of("reaction_forse"), 'error: "reaction_forse" in [serve.limits] is not measured (did you mean '
                '"reaction_force"?); there are: displacement, reaction_force'))

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

    def key_of(self, datum):
        return {name: datum[name] for name in ("source", "session", "seq")}

    def withdraw(self, service, datum, step):
        self.assertEqual(service.post("/v1/withdraw", self.key_of(datum)), (200, {"withdrawn": True, "step": step}))

    def with_one_metre(self, datum, sensor=3):
        values = list(datum["values"])
        values[sensor] = 1.0
        return {**datum, "source": "gauges", "values": values}

    def sensor_alarms(self, service):
        return [(a["step"], a["severity"], a["message"]) for a in service.get("/v1/alarms")[1]["alarms"] if a["kind"] == "sensors"]

    def test_a_value_that_cannot_be_is_quarantined_and_told(self):
        expected = [comparable(line) for line in self.assimilate()]
        service = self.serve()
        wrong = self.with_one_metre(self.data[7])
        for datum in self.data[:7]:
            service.send(datum)
        status, answer = service.send(wrong)
        self.assertEqual((status, answer["accepted"], answer["quarantined"]), (200, True, True))
        reason = answer["reason"]
        self.assertRegex(reason, r"^sensor 3, y at \([0-9., -]+\) m, is 1 m, beyond the limit of 0\.0\d+ m$")
        self.assertEqual(service.send(wrong)[1], {**answer, "duplicate": True})
        for datum in self.data[7:]:
            self.expect_stored(service.send(datum))
        told = [(7, "alarm", "in quarantine: " + reason)]
        held = [{**self.key_of(wrong), "time": wrong["time"], "step": 7, "reason": reason}]
        for restart in (False, True):
            if restart:
                service.kill()
                service.start()
            self.assertEqual(service.settled(13)["quarantined"], 1)
            self.assertEqual([comparable(line) for line in service.states()], expected)
            self.assertEqual(self.sensor_alarms(service), told)
            self.assertEqual(service.get("/v1/quarantine")[1]["quarantined"], held)
        lines = self.expect(0, "replay", "assimilation.journal", "--json").lines()
        self.assertEqual([comparable(line) for line in lines[:-1]], expected)
        said = self.on_terminal(0, "replay", "assimilation.journal")
        self.assertIn("13 records, 1 in quarantine", said)
        self.assertIn("\033[1;32mResult: usable (verdict: ok)\033[0m", said)
        self.assertNotIn("\033[1;", self.on_terminal(0, "replay", "assimilation.journal", NO_COLOR="1"))
        self.expect_stored(service.post("/v1/quarantine", self.key_of(wrong)), 7)
        service.settled(13)
        released = [comparable(line) for line in service.states()]
        self.assertNotEqual(released, expected)
        self.assertEqual(service.get("/v1/states?from=7")[1][0]["data"], 2)
        service.stop()
        trusting = self.serve(extra='journal = "second.journal"\nlimits = { displacement = 2.0 }\n')
        for datum in [*self.data, wrong]:
            self.assertNotIn("quarantined", trusting.send(datum)[1])
        trusting.settled(13)
        self.assertEqual([comparable(line) for line in trusting.states()], released)
        self.assertEqual(self.sensor_alarms(trusting), [])

    def test_what_is_said_to_be_bad_is_not_judged_and_a_corrected_value_takes_the_place(self):
        expected = [comparable(line) for line in self.assimilate()]
        service = self.serve()
        bad = {**self.with_one_metre(self.data[1]), "source": "camera"}
        self.expect_stored(service.send(self.data[0]), 0)
        self.assertTrue(service.send(bad)[1]["quarantined"])
        for datum in self.data[2:]:
            service.send(datum)
        self.withdraw(service, bad, 1)
        self.assertEqual(service.send(bad)[1]["replacement"], True)
        self.assertEqual(len(service.get("/v1/quarantine")[1]["quarantined"]), 1)  # no way round
        self.withdraw(service, bad, 1)
        status, answer = service.send(self.data[1])  # ten places late, but what it corrects was not
        self.assertEqual((status, answer), (200, {"accepted": True, "duplicate": False, "step": 1, "record": 14, "replacement": True}))
        service.settled(14)
        self.assertEqual([comparable(line) for line in service.states()], expected)
        known = {**self.with_one_metre(self.data[2]), "status": ["bad" if i == 3 else "good" for i in range(24)]}
        self.assertNotIn("quarantined", service.send(known)[1])

    def test_the_limits_of_the_project_file_hold_for_what_comes(self):
        service = self.serve(extra="limits = { displacement = 1e-9 }\n")
        status, answer = service.send(self.data[0])
        self.assertEqual((status, answer["quarantined"]), (200, True))
        self.assertRegex(answer["reason"], r"^sensor 0, x at .*, beyond the limit of 1e-09 m \(and \d+ more\)$")
        service.stop()
        self.edit("limits = { displacement = 1e-9 }\n", "")
        service.start()  # the decision stays; the words are of the limits that hold now
        service.send(self.data[1])
        service.settled(2)
        self.assertEqual([line["step"] for line in service.states()], [1])
        self.assertEqual([held["reason"] for held in service.get("/v1/quarantine")[1]["quarantined"]], ["a value was beyond the limit of that time"])
        service.stop()
        for limit, text in (("0", '"serve.limits.displacement" must be a positive number, not 0'), ("inf", "must be a positive number, not inf"),
                            ('"1 m"', 'must be a positive number, not "1 m"')):
            self.edit("[serve]\n", f"[serve]\nlimits = {{ displacement = {limit} }}\n")
            self.expect(3, "serve", self.project_name, stderr=text)
            self.edit(f"limits = {{ displacement = {limit} }}\n", "")

    def test_a_withdrawn_datum_is_as_if_it_had_never_come(self):
        without = self.serve()
        for k in (0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11):
            without.send(self.data[k])
        without.settled(11)
        expected = [comparable(line) for line in without.states()]
        without.stop()
        service = self.serve(extra='journal = "second.journal"\n')
        wrong = {**self.data[7], "source": "gauges", "seq": 0, "values": [v + 1e-4 for v in self.data[7]["values"]]}
        for datum in [*self.data, wrong]:
            self.expect_stored(service.send(datum))
        service.settled(13)
        self.assertNotEqual([comparable(line) for line in service.states()], expected)
        self.expect_error(service.post("/v1/withdraw", {**self.key_of(wrong), "seq": 1}), 404, "UnknownDatum")
        self.expect_error(service.post("/v1/withdraw?site=none", self.key_of(wrong)), 404, "UnknownSite")
        self.expect_error(service.post("/v1/withdraw", {"source": "gauges", "session": "s"}), 400, "Malformed")
        self.withdraw(service, wrong, 7)
        self.withdraw(service, self.data[5], 5)
        self.withdraw(service, self.data[5], 5)
        service.settled(13)
        self.assertEqual([comparable(line) for line in service.states()], expected)
        self.expect_error(service.get("/v1/observations?step=5"), 404, "NoState")
        service.kill()
        service.start()
        service.settled(13)
        self.assertEqual([comparable(line) for line in service.states()], expected)
        lines = self.expect(0, "replay", "second.journal", "--project", self.project_name, "--json").lines()
        self.assertEqual([comparable(line) for line in lines[:-1]], expected)
        self.assertIn("13 records, 0 in quarantine, 2 withdrawn", self.expect(0, "replay", "second.journal").out)
        self.assertIn("11 data written", self.expect(0, "export", "second.journal", "-o", "left.csv", "--project", self.project_name).out)

    def test_methods_that_take_data_in_order_forget_what_is_withdrawn(self):
        self.edit("[method]\n", "[method]\ngate = 3.0\n")
        expected = [comparable(line) for line in self.assimilate()]
        service = self.serve()
        wrong = {**self.data[4], "source": "gauges", "seq": 0, "values": [v + 1e-4 for v in self.data[4]["values"]]}
        for datum in [*self.data, wrong]:
            service.send(datum)
        self.withdraw(service, wrong, 4)
        service.settled(13)
        self.assertEqual([comparable(line) for line in service.states()], expected)

    def test_a_withdrawn_datum_may_come_again_corrected(self):
        expected = [comparable(line) for line in self.assimilate()]
        service = self.serve()
        wrong = {**self.data[2], "values": [10 * v for v in self.data[2]["values"]]}
        for datum in [*self.data[:2], wrong, *self.data[3:]]:
            service.send(datum)
        self.expect_error(service.send(self.data[2]), 409, "Conflict")
        self.withdraw(service, wrong, 2)
        # Nine places late, but in the place of one that was in time.
        status, answer = service.send(self.data[2])
        self.assertEqual((status, answer), (200, {"accepted": True, "duplicate": False, "step": 2, "record": 13, "replacement": True}))
        self.expect_stored(service.send(self.data[2]), 2, duplicate=True)
        service.settled(13)
        self.assertEqual([comparable(line) for line in service.states()], expected)
        self.withdraw(service, self.data[2], 2)
        service.settled(13)
        self.assertNotIn(2, [line["step"] for line in service.states()])
        self.expect_stored(service.send(self.data[2]), 2)  # the same values: the withdrawal is undone
        service.settled(14)
        service.kill()
        service.start()
        service.settled(14)
        self.assertEqual([comparable(line) for line in service.states()], expected)

    def test_a_quarantined_datum_can_be_withdrawn_and_a_wrong_seq_is_no_more_in_the_way(self):
        service = self.serve()
        for k in range(6):
            service.send(self.data[k])
        far = [{**self.data[6], "seq": 1000 + k} for k in range(4)]  # one more than the window
        for datum in far:
            self.expect_stored(service.send(datum), 6)
        self.assertTrue(service.send(self.data[7])[1]["quarantined"])
        self.withdraw(service, self.data[7], 7)
        self.assertEqual(service.get("/v1/quarantine")[1]["quarantined"], [])
        self.expect_error(service.post("/v1/quarantine", self.key_of(self.data[7])), 404, "NotQuarantined")
        for datum in far:
            self.withdraw(service, datum, 6)
        service.settled(11)
        self.assertEqual(service.get("/v1/status")[1]["step"], 5)
        for k in range(6, 12):
            status, answer = service.send(self.data[k])
            self.assertEqual((status, answer.get("quarantined")), (200, None))
        service.settled(17)
        self.assertEqual([comparable(line) for line in service.states()], [comparable(line) for line in self.assimilate()])

    def test_readers_of_events_hear_that_a_line_is_gone(self):
        service = self.serve()
        for datum in self.data[:3]:
            service.send(datum)
        service.settled(3)
        before = service.states()
        events = Events(service, Last_Event_ID=str(before[-1]["event"]))
        self.withdraw(service, self.data[1], 1)
        gone = lambda e: [json.loads(x["data"]) for x in e.events if x.get("event") == "withdrawn"]
        events.wait_for(lambda e: gone(e) and len(e.steps()) >= 1)
        events.close()
        (line,) = gone(events)
        self.assertEqual((line["step"], line["withdrawn"]), (1, True))
        self.assertEqual([line["step"] for line in service.states()], [0, 2])
        self.assertEqual(events.steps()[-1][1], service.states()[-1])
        self.withdraw(service, self.data[0], 0)
        self.withdraw(service, self.data[2], 2)
        service.settled(3)
        self.assertEqual(service.states(), [])
        self.assertNotIn("step", service.get("/v1/status")[1])
        self.expect_error(service.get("/v1/state"), 404, "NoState")
        service.kill()
        service.start()
        late = Events(service, Last_Event_ID=str(before[-1]["event"]))  # away meanwhile: hears of it all the same
        late.wait_for(lambda e: len(gone(e)) == 3)
        late.close()

    def test_the_structure_has_a_state_of_its_own(self):
        service = self.serve(extra="budget = 60.0\nstale_after = 60.0\n")
        self.assertNotIn("structure", service.get("/v1/status")[1])
        for datum in self.data[:5]:
            service.send(datum)
        service.settled(5)
        line = service.get("/v1/state")[1]
        self.assertEqual(service.get("/v1/status")[1]["structure"], line["verdict"]["level"])
        shifted = {**self.data[5], "values": [v + (3e-5 if i % 2 else -3e-5) for i, v in enumerate(self.data[5]["values"])]}
        service.send(shifted)
        status = service.settled(6)
        verdict = service.get("/v1/state")[1]["verdict"]
        self.assertEqual((status["structure"], verdict["level"]), ("reject", "reject"), verdict)
        message = next(reason["message"] for reason in verdict["reasons"] if reason["level"] == "reject")
        told = [(a["step"], a["severity"], a["message"]) for a in service.get("/v1/alarms")[1]["alarms"] if a["kind"] == "verdict"]
        self.assertEqual(told[-1], (5, "alarm", message))
        service.wait_until(lambda: 'knothe_structure{site="assimilation",level="reject"} 1' in service.get("/metrics")[1].decode())
        self.withdraw(service, shifted, 5)
        self.assertEqual(service.settled(6)["structure"], line["verdict"]["level"])

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
        self.expect_error(service.post("/v1/withdraw", self.key_of(self.data[0]), Authorization="Bearer read-token-of-32-characters-xxxx"), 401, "Unauthorized")
        self.expect_error(service.post("/v1/measurements", self.data[0], Authorization="Bearer read-token-of-32-characters-xxxx"), 401, "Unauthorized")
        self.expect_stored(service.post("/v1/measurements", self.data[0], Authorization="Bearer send-token-of-32-characters-xxxx"), 0)
        self.assertEqual(service.post("/v1/withdraw", self.key_of(self.data[0]), Authorization="Bearer send-token-of-32-characters-xxxx")[0], 200)

    def test_a_token_with_a_name_signs_what_is_done_with_it(self):
        tokens = {"Ada": "ada-token-of-32-characters-xxxxx", "Bob": "bob-token-of-32-characters-xxxxx", "wall": "wall-token-of-32-characters-xxxx"}
        file = self.folder / "tokens"
        file.write_text("# who may do what\n" + "".join(f"{name} {token}{' read' * (name == 'wall')}\n" for name, token in tokens.items()))
        self.project.write_text(self.project.read_text() + '\n[serve]\ntokens = "tokens"\nwindow = 0\n')
        file.chmod(0o644)
        self.expect(3, "serve", self.project_name, "--port", "0", stderr=["assimilation.toml:", "chmod o="])
        file.chmod(0o600)
        service = self.serve()
        as_one = lambda name: {"Authorization": f"Bearer {tokens[name]}"}
        self.expect_error(service.get("/v1/status"), 401, "Unauthorized")
        self.expect_error(service.send(self.data[0]), 401, "Unauthorized")
        self.assertEqual(service.get("/v1/status", **as_one("wall"))[0], 200)
        self.expect_error(service.post("/v1/measurements", self.data[0], **as_one("wall")), 401, "Unauthorized")
        for datum in (self.data[0], self.data[2], self.data[1]):  # the last is late
            self.assertEqual(service.post("/v1/measurements", datum, **as_one("Ada"))[0], 200)
        signed = service.post("/v1/notes", {"text": "begun"}, **as_one("Ada"))
        self.assertEqual((signed[0], signed[1]["by"]), (200, "Ada"))
        self.assertEqual(service.post("/v1/notes", {"by": "Ada", "text": "still"}, **as_one("Ada"))[0], 200)
        for path, body in (("/v1/notes", {"text": "x"}), ("/v1/withdraw", self.key_of(self.data[0])), ("/v1/quarantine", self.key_of(self.data[1]))):
            refused = service.post(path, {**body, "by": "Bob"}, **as_one("Ada"))
            self.expect_error(refused, 403, "OtherName")
            self.assertIn('"by" must be "Ada", or left out', refused[1]["error"]["message"])
        self.assertEqual(service.post("/v1/quarantine", {**self.key_of(self.data[1]), "comment": "it is right"}, **as_one("Bob"))[0], 200)
        for _ in range(2):  # what is done already is not signed again
            self.assertEqual(service.post("/v1/withdraw", self.key_of(self.data[0]), **as_one("Bob"))[0], 200)
        service.stop()
        service.start()
        entries = service.get("/v1/logbook", **as_one("wall"))[1]["logbook"]
        self.assertEqual(
            [(entry["kind"], entry["by"], entry["text"], entry.get("record")) for entry in entries[2:]],
            [("released", "Bob", "camera, s, 1 released from quarantine: it is right", 3), ("withdrawn", "Bob", "camera, s, 0 withdrawn", 1)],
        )

    def test_other_addresses_need_tokens(self):
        self.project.write_text(self.project.read_text() + '\n[serve]\naddress = "0.0.0.0"\n')
        self.expect(3, "serve", self.project_name, "--port", "0", stderr=["assimilation.toml:", "serve.read_token"])

    def test_a_token_that_no_client_can_send_is_refused(self):
        self.project.write_text(self.project.read_text() + '\n[serve]\nread_token = "token"\n')
        for content in (b"\xef\xbb\xbf0123456789abcdef", "0123456789abcdef".encode("utf-16"), b" 0123456789abcdef", b"\t0123456789abcdef"):
            (self.folder / "token").write_bytes(content + b"\n")
            self.expect(3, "serve", self.project_name, "--port", "0", stderr=["assimilation.toml:", "no client can send it"])

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

    def test_mqtt_is_another_way_in_and_waits_for_the_service(self):
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        service = self.serve(extra=f'[serve.mqtt]\nbroker = "127.0.0.1:{broker.port}"\n')
        topic = "knothe/v1/assimilation/camera/data"
        service.wait_until(lambda: "subscribed at the MQTT broker" in service.logged())
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

    def test_mqtt_withdraws_too(self):
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        service = self.serve(extra=f'[serve.mqtt]\nbroker = "127.0.0.1:{broker.port}"\n')
        service.wait_until(lambda: re.search("subscribed at the MQTT broker.*/withdraw", service.logged()))
        for datum in self.data[:3]:
            service.send(datum)
        key = self.key_of(self.data[1])
        topic = "knothe/v1/assimilation/camera/withdraw"
        for payload in ({**key, "seq": 99}, {**key, "source": "another"}, {**key, "site": "another"}, {"source": "camera"}, key):
            broker.publish(topic, json.dumps(payload).encode())
        service.wait_until(lambda: "a datum was withdrawn" in service.logged())
        service.settled(3)
        self.assertEqual([line["step"] for line in service.states()], [0, 2])
        self.assertEqual(service.post("/v1/withdraw", key), (200, {"withdrawn": True, "step": 1}))
        self.assertEqual(service.get("/v1/status")[1]["malformed"], 3)
        self.expect_stored(service.send(self.data[1]), 1)

    def test_what_a_broker_keeps_does_nothing_twice(self):
        """Retained messages come again at each start: the withdrawal leaves the corrected datum, the datum stays withdrawn."""
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        service = self.serve(extra=f'[serve.mqtt]\nbroker = "127.0.0.1:{broker.port}"\n')
        service.wait_until(lambda: service.logged().count("subscribed at the MQTT broker") == 2)
        publish = lambda what, body: broker.publish(f"knothe/v1/assimilation/camera/{what}", json.dumps(body).encode(), retain=True)
        wrong = {**self.data[1], "values": [1.5 * v for v in self.data[1]["values"]]}
        self.expect_stored(service.send(self.data[0]))
        self.assertEqual(service.send(wrong)[1]["record"], 2)
        publish("withdraw", self.key_of(wrong))
        service.wait_until(lambda: "a datum was withdrawn" in service.logged())
        self.assertEqual(service.send(self.data[1])[1]["record"], 3)
        publish("data", self.data[2])
        service.settled(4)
        self.assertEqual(service.post("/v1/withdraw", {**self.key_of(self.data[2]), "record": 4})[0], 200)
        service.settled(4)
        expected = service.states()
        self.assertEqual([line["step"] for line in expected], [0, 1])
        for _ in range(2):
            service.stop()
            told = service.logged().count("subscribed at the MQTT broker")
            answers = broker.listen("knothe/v1/assimilation/camera/answer")
            service.start()
            service.wait_until(lambda: service.logged().count("subscribed at the MQTT broker") == told + 2)
            said = sorted(json.dumps(json.loads(answers.get(timeout=60))) for _ in range(2))
            self.assertIn('"withdrawn": true', said[1])
            self.assertIn("does not restore it", said[0])
            self.assertEqual([comparable(line) for line in (service.settled(4), service.states())[1]], [comparable(line) for line in expected])
        # A withdrawal that is sent again after the correction names its record, too.
        self.assertEqual(service.post("/v1/withdraw", {**self.key_of(wrong), "record": 2})[0], 200)
        self.expect_error(service.post("/v1/withdraw", {**self.key_of(wrong), "record": 1}), 404, "UnknownDatum")
        self.assertEqual(len((service.settled(4), service.states())[1]), 2)
        self.assertEqual(service.post("/v1/withdraw", {**self.key_of(wrong), "record": 3})[0], 200)
        self.assertEqual(len((service.settled(4), service.states())[1]), 1)

    def test_mqtt_with_tls_and_a_password(self):
        make_certificates(self.folder)
        broker = Broker(self.folder, password="known to gauge and service")
        self.addCleanup(broker.stop)
        (self.folder / "password").write_text("wrong\n")
        service = self.serve(extra=f'[serve.mqtt]\nbroker = "127.0.0.1:{broker.port}"\nuser = "gauge"\npassword = "password"\nca = "ca.pem"\n')
        service.wait_until(lambda: "the MQTT broker refused" in service.logged())
        service.stop()
        (self.folder / "password").write_text("known to gauge and service\n")
        service.start()
        service.wait_until(lambda: "subscribed at the MQTT broker" in service.logged())
        broker.publish("knothe/v1/assimilation/camera/data", json.dumps(self.data[0]).encode())
        self.assertEqual(service.settled(1)["step"], 0)

    def test_a_subscription_that_the_broker_refuses_is_said(self):
        """A broker that lets anybody in (CONNACK) and gives nobody anything (SUBACK with 128)."""
        with socket.create_server(("127.0.0.1", 0)) as broker:
            def refuse():
                connection = broker.accept()[0]
                with connection:
                    self.assertEqual(connection.recv(4096)[0], 0x10)
                    connection.sendall(b"\x20\x02\x00\x00")
                    asked = connection.recv(4096)
                    self.assertEqual(asked[0], 0x82)
                    connection.sendall(b"\x90\x03" + asked[2:4] + b"\x80")
                    while connection.recv(4096):
                        pass

            thread = threading.Thread(target=refuse, daemon=True)
            thread.start()
            service = self.serve(extra=f'[serve.mqtt]\nbroker = "127.0.0.1:{broker.getsockname()[1]}"\n')
            service.wait_until(lambda: "the MQTT broker refused a subscription" in service.logged())
            self.assertIn("knothe/v1/assimilation/+/data", service.logged())
            self.assertNotIn("subscribed at the MQTT broker", service.logged())
            self.assertEqual(service.stop(), 130)
            thread.join(10)

    def test_csv_files_left_in_a_folder_are_taken(self):
        expected = [comparable(line) for line in self.assimilate()]
        header, *rows = (self.folder / "data.csv").read_text().splitlines()
        watched = self.folder / "tables"
        watched.mkdir()
        place = header.split(",").index("time")
        of_time = lambda k: [row for row in rows if float(row.split(",")[place]) == self.data[k]["time"]]
        (watched / "first.csv").write_text("\n".join([header] + of_time(0)[::-1] + of_time(1)) + "\n")
        service = self.serve(extra='watch_csv = "tables/"\nsettle = 0.1\n')
        for k in range(2, 12):
            (watched / ".half").write_text("\n".join([header] + of_time(k)) + "\n")
            (watched / ".half").rename(watched / f"step{k}.csv")
        service.settled(12)
        self.assertEqual([comparable(line) for line in service.states()], expected)
        (watched / "other.csv").write_text(header + "\n" + of_time(0)[0].replace(rows[0].split(",")[2], "0.77", 1) + "\n")
        service.wait_until(lambda: "this site has no sensor at" in str(service.get("/v1/alarms")[1]))
        service.kill()
        service.start()
        time.sleep(0.5)
        self.assertEqual(service.settled(12)["records"], 12)

    def test_doctor_says_what_is_there(self):
        outcome = self.run_knothe("doctor")
        self.assertIn(outcome.status, (0, 1))
        for word in ("knothe", "libraries", "processor", "BLAS", "disk", "permissions", "sync"):
            self.assertIn(f" {word} ", outcome.out)

    def test_doctor_says_whether_a_service_can_run(self):
        service = self.serve()
        service.send(self.data[0])
        service.settled(1)
        self.project.write_text(self.project.read_text() + f"\n[serve]\nport = {service.port}\n")
        line = lambda word, outcome: next(x for x in outcome.out.splitlines() if f" {word} " in x)
        outcome = self.run_knothe("doctor", self.project_name)
        self.assertEqual(outcome.status, 1)
        self.assertRegex(line("model", outcome), "^ok .*2 parameters, 12 steps, 24 sensors")
        self.assertRegex(line("journal", outcome), "^ok .*1 records, whole")
        self.assertRegex(line("tokens", outcome), "^ok .*none")
        self.assertRegex(line("address", outcome), f"^!! .*cannot listen at 127.0.0.1:{service.port}: Address already in use")
        self.assertRegex(line("clock", outcome), "synchronised")
        service.stop()
        (self.folder / "token").write_text("0123456789abcdef\n")
        (self.folder / "token").chmod(0o644)
        self.edit("[serve]\n", '[serve]\nread_token = "token"\naddress = "0.0.0.0"\n')
        outcome = self.run_knothe("doctor", self.project_name)
        self.assertRegex(line("address", outcome), "^ok .*is free")
        self.assertRegex(line("tokens", outcome), "^!! .*can be read by everybody here")
        (self.folder / "token").chmod(0o600)
        outcome = self.run_knothe("doctor", self.project_name)
        self.assertRegex(line("tokens", outcome), r"^!! .*0.0.0.0 is not a loopback address: \[serve\] ingest_token must name")
        self.assertRegex(self.run_knothe("doctor", "absent.toml").out, r"!! +project +.*absent.toml")


if __name__ == "__main__":
    unittest.main()
