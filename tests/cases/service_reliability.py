"""`knothe serve`: that nothing is lost, whatever happens to it."""
import http.client
import json
import math
import os
import pathlib
import random
import re
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


FROM, TO = (-0.03, 0.0, 0.0), (0.03, 0.05, 0.0)


class Test(ServiceCase):
    def test_nothing_acknowledged_is_lost_however_often_it_is_killed(self):
        """kill -9 at random instants while data come, with repetitions: 20 times, a thousand at night."""
        expected = [comparable(line) for line in self.assimilate()]
        chance = random.Random(11)
        service = self.serve()
        acknowledged = set()
        for kill in range(int(os.environ.get("KNOTHE_KILLS", "20"))):
            order = sorted(range(12), key=lambda k: k + 2 * chance.random())
            stop = threading.Timer(0.002 + 0.05 * chance.random(), service.kill)
            stop.start()
            connection = service.connection()
            try:
                for k in order[: 1 + kill % 20]:
                    if service.send(self.data[k], connection)[0] == 200:
                        acknowledged.add(k)
            except (OSError, http.client.HTTPException):
                pass  # it was killed in the middle
            connection.close()
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

    def test_four_sources_give_the_same_lines_to_the_bit_however_often_it_is_killed(self):
        """A camera, a load cell, a gauge and a clip gauge, each for itself, in any order, at 20 kills: as without any."""
        header, *rows = (self.folder / "data.csv").read_text().splitlines()
        columns = header.split(",")
        stds = {"reaction_force": 5.0, "gauge": 2e-5, "mouth": 2e-6}
        noise = random.Random(5)
        data = []
        for k, datum in enumerate(self.data):
            t = datum["time"]
            true = analytic_model.reaction_force(t, 1.05, 0.9)
            u = [[analytic_model.displacement(c, x, t, 1.05, 0.9) for c in range(3)] for x in (FROM, TO)]
            opening = sum((u[1][c] - u[0][c]) * (TO[c] - FROM[c]) for c in range(3)) / math.dist(FROM, TO)
            measured = {"reaction_force": true, "gauge": opening / math.dist(FROM, TO), "mouth": opening}
            data.append({**datum, "values": datum["values"] + 3 * [None]})
            for name, value in measured.items():
                value += noise.gauss(0, stds[name])
                data.append({"source": name, "session": "s", "seq": k, "time": t, "series": {name: value}})
                row = {"time": repr(t), "sensor": name, "component": name, "value": repr(value), "std": repr(stds[name])}
                rows.append(",".join(row.get(column, "") for column in columns))
        (self.folder / "data.csv").unlink()  # it is the fixture's
        (self.folder / "data.csv").write_text("\n".join([header] + rows) + "\n")
        ends = f"from = {list(FROM)}\nto = {list(TO)}\n"
        self.edit('data = "data.h5"\n', "")
        self.edit("[parameters]", f'[data]\nfile = "data.csv"\n[data.sensors.gauge]\nkind = "strain"\n{ends}[data.sensors.mouth]\nkind = "opening"\n{ends}\n[parameters]')

        def lines_of(service):
            for datum in data:
                self.assertEqual(service.send(datum)[0], 200)
            for key in service.get("/v1/quarantine")[1]["quarantined"]:
                service.post("/v1/quarantine", {k: key[k] for k in ("source", "session", "seq")})
            service.settled(len(data))
            return [comparable(line) for line in service.states()]

        service = self.serve()
        expected = lines_of(service)
        service.stop()
        for path in self.folder.glob("*.journal*"):
            path.unlink()
        chance = random.Random(11)
        service.start()
        for kill in range(20):
            order = sorted(range(len(data)), key=lambda k: k + 8 * chance.random())
            stop = threading.Timer(0.002 + 0.08 * chance.random(), service.kill)
            stop.start()
            connection = service.connection()
            try:
                for k in order[: 1 + 3 * kill]:
                    service.send(data[k], connection)
            except (OSError, http.client.HTTPException):
                pass  # it was killed in the middle
            connection.close()
            stop.join()
            service.start()
        self.assertEqual(lines_of(service), expected)
        self.assertEqual([line["data"] for line in service.states()], [4] * 12)
        self.assertEqual(expected[-1]["verdict"]["level"], "ok")

    def test_any_sequence_of_requests_files_and_kills_gives_the_lines_of_a_batch_run(self):
        """Sent by HTTP and MQTT, repeated, contradicted, withdrawn either way, sent again, left as files, killed, stopped: whenever it is
        asked, the lines are those of `assimilate` on the data that are left, to the bit. A few sequences, an hour of them at night."""
        header, *rows = (self.folder / "data.csv").read_text().splitlines()
        place = header.split(",").index("time")
        rows_of = lambda k: [row for row in rows if float(row.split(",")[place]) == self.data[k]["time"]]
        by_http, by_file = range(8), range(8, 12)
        without_step = lambda line: {key: value for key, value in comparable(line).items() if key != "step"}
        (self.folder / "batch.toml").write_text(self.project.read_text().replace('data = "data.h5"', 'data = "left.csv"').replace('"results/"', '"batch/"'))
        tables = self.folder / "tables"
        tables.mkdir()
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        answers = broker.listen("knothe/v1/assimilation/camera/answer")
        service = self.serve(extra=f'watch_csv = "tables/"\nsettle = 0.05\nwindow = 1000\n[serve.mqtt]\nbroker = "127.0.0.1:{broker.port}"\n')
        for seed in range(int(os.environ.get("KNOTHE_SEQUENCES", "3"))):
            chance, left, withdrawn, replaced, log = random.Random(seed), set(), set(), set(), []

            def told(request, *arguments):
                """Its answer; where the service dies first, that of the same request again after a restart."""
                if chance.random() < 0.15:
                    log.append("kill")
                    stop = threading.Timer(0.01 * chance.random(), service.kill)
                    stop.start()
                    try:
                        request(*arguments)
                    except (OSError, http.client.HTTPException):
                        pass
                    stop.join()
                    service.start()
                return request(*arguments)

            def key_of(k):
                return {name: self.data[k][name] for name in ("source", "session", "seq")}

            def send(k):
                answer = told(service.send, self.data[k])
                self.assertEqual(answer[0], 200, (seed, log, answer))
                left.add(k)
                if k in withdrawn:
                    replaced.add(k)
                withdrawn.discard(k)

            def publish(what, body):
                """A message and its answer; where the service dies in between, the broker brings it again, be it handled or not."""
                send = lambda what, body: broker.publish(f"knothe/v1/assimilation/camera/{what}", json.dumps(body).encode())
                if chance.random() >= 0.3:
                    send(what, body)
                    return json.loads(answers.get(timeout=60))
                log.append("kill")
                stop = threading.Timer(0.02 * chance.random(), service.kill)
                stop.start()
                send(what, body)
                stop.join()
                service.start()
                send("withdraw", {"source": "camera", "session": f"end {len(log)}", "seq": 0})  # behind all that come again
                said = []
                while f"end {len(log)}" not in (text := answers.get(timeout=60).decode()):
                    said.append(json.loads(text))
                return said[0]

            def send_by_mqtt(k):
                answer = publish("data", self.data[k])
                if k in withdrawn:  # as far as anybody can tell it is the broker that repeats it
                    self.assertIn("does not restore it", answer["error"]["message"], (seed, log, answer))
                else:
                    self.assertTrue(answer.get("accepted"), (seed, log, answer))
                    left.add(k)

            def withdraw_by_mqtt(k):
                answer = publish("withdraw", key_of(k))
                if k in replaced and k in left:
                    self.assertIn("its replacement stays", answer["error"]["message"], (seed, log, answer))
                elif k in left:
                    self.assertTrue(answer.get("withdrawn"), (seed, log, answer))
                    left.remove(k)
                    withdrawn.add(k)

            def contradict(k):
                other = {**self.data[k], "values": [value + 1e-7 for value in self.data[k]["values"]]}
                if k in left:
                    self.assertEqual(told(service.send, other)[0], 409, (seed, log))

            def withdraw(k):
                answer = told(service.post, "/v1/withdraw", key_of(k))
                self.assertEqual(answer[0], 200 if k in left | withdrawn else 404, (seed, log, answer))
                if k in left:
                    left.remove(k)
                    withdrawn.add(k)

            def leave_file(k):
                k = by_file[k % len(by_file)]
                (tables / f"{k}.csv").write_text("\n".join([header] + rows_of(k)) + "\n")
                left.add(k)

            def ask_nonsense(k):
                body = chance.choice(['{"source":', "[]", {**key_of(k), "seq": 99, "time": -7.0, "values": [0.0]}, {**self.data[k], "seq": "one"}])
                self.assertEqual(service.post(chance.choice(["/v1/measurements", "/v1/withdraw"]), body)[0] // 100, 4, (seed, log, body))

            def restart(k):
                service.stop() if k % 2 else service.kill()
                service.start()

            def compare(k):
                if not left:
                    return
                times = [self.data[i]["time"] for i in sorted(left)]
                service.wait_until(lambda: [line["time"] for line in service.states()] == times)
                service.settled()
                (self.folder / "left.csv").write_text("\n".join([header] + [row for i in sorted(left) for row in rows_of(i)]) + "\n")
                lines = self.expect(0, "assimilate", "batch.toml", "--json").lines()[:-1]
                self.assertEqual([without_step(line) for line in service.states()], [without_step(line) for line in lines], (seed, log))

            actions = [send] * 8 + [withdraw] * 4 + [send_by_mqtt] * 3 + [withdraw_by_mqtt] * 2 + [leave_file] * 2 + [contradict, ask_nonsense, restart, compare]
            for _ in range(40):
                action, k = chance.choice(actions), chance.choice(by_http)
                log.append(f"{action.__name__} {k}")
                action(k)
            send(0)
            compare(0)
            service.stop()
            for path in [*self.folder.glob("*.journal*"), *tables.iterdir()]:
                path.unlink()
            service.start()

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
        service.wait_until(lambda: not service.get("/v1/status")[1]["read_only"])
        self.expect_stored(service.send(self.data[1]), 1)
        self.assertEqual(service.settled(2)["records"], 2)

    def test_a_file_left_while_the_disk_is_full_is_taken_once_there_is_room(self):
        header, *rows = (self.folder / "data.csv").read_text().splitlines()
        place = header.split(",").index("time")
        (self.folder / "tables").mkdir()
        ignore = lambda: signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        service = self.serve(extra='watch_csv = "tables/"\nsettle = 0.1\n', preexec_fn=ignore, restore_signals=False)
        self.expect_stored(service.send(self.data[0]), 0)
        service.settled(1)
        largest = (self.folder / "assimilation.journal-wal").stat().st_size
        resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, (largest, resource.RLIM_INFINITY))
        of_one = [row for row in rows if float(row.split(",")[place]) == self.data[1]["time"]]
        (self.folder / "tables" / "one.csv").write_text("\n".join([header] + of_one) + "\n")
        service.wait_until(lambda: "the journal cannot be written" in service.logged())
        resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
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

    def test_slow_and_silent_and_greedy_clients_hold_up_nobody(self):
        service = self.serve(extra="timeout = 2.0\n")
        idle = [socket.create_connection(("127.0.0.1", service.port)) for _ in range(200)]
        slow = socket.create_connection(("127.0.0.1", service.port))
        slow.sendall(b"GET /livez HT")
        post = b"POST /v1/measurements HTTP/1.1\r\nHost: localhost\r\n"
        for sent, status in ((post + b"Content-Length: 1000000000\r\n\r\n" + b"x" * 100000, b" 413 "),
                             (post + b"Transfer-Encoding: chunked\r\n\r\nffffffffff\r\nxxx", b" 413 "),
                             (b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"y" * 20000, b" 431 "),
                             (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", b" 400 ")):
            client = socket.create_connection(("127.0.0.1", service.port))
            client.sendall(sent)
            self.assertIn(status, client.recv(100))
            idle.append(client)
        viewers = [Events(service) for _ in range(32)]
        for step, datum in enumerate(self.data):
            self.expect_stored(service.send(datum), step)
            self.assertEqual(service.get("/livez")[0], 200)
        for viewer in viewers:
            viewer.wait_for(lambda e: e.steps() and e.steps()[-1][1]["step"] == 11)
        slow.settimeout(20)
        self.assertEqual(slow.recv(100), b"")  # its time was over
        for one in idle + [slow]:
            one.close()
        for viewer in viewers:
            viewer.close()

    def test_days_of_data_cost_no_descriptors_and_little_memory(self):
        """The soak: many data, duplicates and conflicts among them, with readers that come and go; 10⁵ at night."""
        count = int(os.environ.get("KNOTHE_SOAK", "600"))
        service = self.serve()
        status = pathlib.Path(f"/proc/{service.process.pid}/status")
        of_process = lambda name: int(next(x for x in status.read_text().splitlines() if x.startswith(name)).split()[1])
        gauge = lambda name: float(re.search(rf"^{name} (\S+)$", service.get("/metrics")[1].decode(), re.MULTILINE)[1])
        descriptors = lambda: len(os.listdir(f"/proc/{service.process.pid}/fd"))
        connection, seq, memory = service.connection(), 0, None
        for part in range(10):
            for _ in range(count // 10):
                datum = {**self.data[seq % 12], "session": f"day {seq // 1200}", "seq": seq}
                self.assertEqual(service.send(datum, connection)[0], 200)
                if seq % 50 == 0:
                    self.assertTrue(service.send(datum, connection)[1]["duplicate"])
                    self.assertEqual(service.send({**datum, "values": [0.0] * 24}, connection)[0], 409)
                seq += 1
            events = Events(service)
            events.wait_for(lambda e: e.steps())
            events.close()
            service.settled(seq, seconds=100 + count / 100)
            # The service sees a little later than we do that a reader has gone.
            service.wait_until(lambda: gauge("knothe_event_streams") == 0 and gauge("knothe_connections") <= 2)
            if part == 1:
                memory, taken, open_files, threads = of_process("VmRSS"), seq, descriptors(), of_process("Threads")
        service.wait_until(lambda: descriptors() <= open_files + 1 and of_process("Threads") == threads)
        connection.close()
        if "KNOTHE_SANITIZED" in os.environ:
            return  # the address sanitizer keeps what is freed
        grown = 1024 * (of_process("VmRSS") - memory)
        # What is kept of a datum, so that a late one can still be put in its place: its g, c and key.
        self.assertLess(grown, 4e6 + 1000 * (seq - taken), f"{grown} bytes for {seq - taken} data")

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


if __name__ == "__main__":
    unittest.main()
