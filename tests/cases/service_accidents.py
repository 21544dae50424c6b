"""`knothe serve` when its model, journal, disk, broker or log change under it: nothing goes wrong in silence."""
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import sqlite3
import subprocess
import time
import unittest

from service_support import Broker, Events, Service, ServiceCase, comparable
from support import KNOTHE


class Test(ServiceCase):
    def alarms(self, service):
        return service.get("/v1/alarms")[1]["alarms"]

    def journal(self, *more):
        return self.folder / ("assimilation.journal" + "".join(more))

    # The model

    def model_of(self, steps):
        """The same formula with as many time steps, in the place of the model."""
        build = pathlib.Path(os.environ["KNOTHE_BUILD"]) / "tests/cases/make_snapshots"
        subprocess.run([build, self.folder / "other", str(steps)], check=True)
        for name in ("model.h5", "data.h5"):
            (self.folder / name).unlink()
        self.expect(0, "model", "import", "other/snapshots.h5", "-o", "model.h5", "--tolerance", "1e-9")

    def test_data_stay_at_their_times_when_the_model_has_others(self):
        (self.folder / "other").mkdir()
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        wild = {**self.data[5], "source": "gauges", "values": [1.0] + self.data[5]["values"][1:]}
        self.assertIs(service.send(wild)[1]["quarantined"], True)
        service.settled(13)
        before = service.states()
        service.stop()
        data = (self.folder / "data.h5").read_bytes()
        self.model_of(24)  # every second of its times is one of the first
        (self.folder / "data.h5").write_bytes(data)
        without_step = lambda line: {k: v for k, v in comparable(line).items() if k != "step"}
        expected = [without_step(line) for line in self.assimilate()]
        service.start()
        service.settled(13)
        lines = service.states()
        self.assertEqual([without_step(line) for line in lines], expected)
        self.assertEqual([(line["step"], line["time"]) for line in lines], [(2 * line["step"] + 1, line["time"]) for line in before])
        for now, then in zip(lines, before):
            for k in range(2):
                self.assertAlmostEqual(now["mean"][k], then["mean"][k], delta=0.01 * then["covariance"][k][k] ** 0.5)
        self.expect_stored(service.send(self.data[3]), 7, duplicate=True)
        key = {name: wild[name] for name in ("source", "session", "seq")}
        self.assertEqual(service.get("/v1/quarantine")[1]["quarantined"][0]["step"], 11)
        self.expect_stored(service.post("/v1/quarantine", key), 11)
        self.assertEqual(service.post("/v1/withdraw", key), (200, {"withdrawn": True, "step": 11}))
        service.settled(13)
        self.assertEqual([without_step(line) for line in service.states()], expected)
        service.stop()
        replayed = self.expect(0, "replay", self.journal(), "--json").lines()[:-1]
        self.assertEqual([without_step(line) for line in replayed], expected)

    def test_data_of_times_that_the_model_lacks_are_refused_by_name(self):
        (self.folder / "other").mkdir()
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        service.stop()
        self.model_of(6)
        self.expect(0, "simulate", self.project_name, "--model", "model.h5", "-o", "data.h5")  # the same sensors
        said = ["record 1 (source \"camera\", session \"s\", seq 0) is of time 0.0833", "Put that model back, or begin another journal"]
        self.expect(4, "serve", self.project_name, "--port", "0", stderr=said)
        self.expect(4, "replay", self.journal(), "--json", stderr=said)
        self.expect(4, "export", self.journal(), "-o", "out.csv", stderr=said)

    # The journal

    def test_what_is_lost_with_the_log_is_said(self):
        for accident in ("flipped", "lost"):
            with self.subTest(accident):
                self.setUp()
                service = self.serve()
                for datum in self.data[:4]:
                    service.send(datum)
                service.settled(4)
                service.wait_until(lambda: self.journal("-wal").stat().st_size == 0)  # idle: all is in the journal itself
                for datum in self.data[4:]:
                    service.send(datum)
                service.kill()
                log = self.journal("-wal")
                if accident == "lost":
                    log.unlink()
                else:
                    content = bytearray(log.read_bytes())
                    content[32 + 24 + 100] ^= 1
                    log.write_bytes(content)
                said = "acknowledged and gone: records 5 to 12"
                self.assertIn(said, self.expect(0, "replay", self.journal()).out)
                service.start()
                self.assertEqual(service.settled(4)["records"], 4)
                self.assertIn(said, service.logged())
                (alarm,) = [a for a in self.alarms(service) if a["kind"] == "journal"]
                self.assertIn(said, alarm["message"])
                self.expect_stored(service.send(self.data[4]), 4)  # they may be sent again
                service.stop()
                service.start()
                self.assertEqual(len([a for a in self.alarms(service) if a["kind"] == "journal"]), 1)  # said once, and kept
                service.stop()

    def test_a_journal_that_is_deleted_or_renamed_takes_no_more(self):
        for accident in ("renamed", "deleted", "replaced", "truncated", "copied over", "log deleted"):
            with self.subTest(accident):
                self.setUp()
                service = self.serve()
                self.expect_stored(service.send(self.data[0]), 0)
                service.settled(1)
                time.sleep(0.3)  # alarms of the datum are written behind it: an accident in that moment is noticed later
                if accident == "log deleted":
                    self.journal("-wal").unlink()
                elif accident == "truncated":
                    with open(self.journal(), "r+b") as journal:
                        journal.truncate(0)
                elif accident == "copied over":
                    with open(self.journal(), "r+b") as journal:
                        journal.write(b"another journal")
                else:
                    shutil.copy(self.journal(), self.folder / "copy")
                    self.journal().rename(self.folder / "elsewhere")
                if accident == "replaced":
                    (self.folder / "copy").rename(self.journal())
                answer = service.send(self.data[1])
                self.expect_error(answer, 507, "DiskFull")
                self.assertIn("deleted, renamed, replaced or overwritten", answer[1]["error"]["message"])
                status = service.get("/v1/status")[1]
                self.assertEqual((status["state"], status["read_only"], status["records"]), ("DEGRADED", True, 1))
                self.assertIn("deleted, renamed, replaced or overwritten", status["reason"])
                if accident == "renamed":
                    (self.folder / "elsewhere").rename(self.journal())
                    service.wait_until(lambda: not service.get("/v1/status")[1]["read_only"])
                    self.expect_stored(service.send(self.data[1]), 1)
                service.stop()
                self.assertEqual("All acknowledged data are saved" in service.logged(), accident == "renamed")

    def test_a_journal_that_goes_while_nothing_comes_is_noticed(self):
        service = self.serve()
        self.expect_stored(service.send(self.data[0]), 0)
        self.journal().unlink()
        service.wait_until(lambda: service.get("/v1/status")[1]["state"] == "DEGRADED")
        service.stop()

    def test_a_second_server_is_refused_whatever_the_journal_is_called(self):
        self.serve()
        (self.folder / "link.journal").symlink_to(self.journal())
        for name in self.folder.glob("*.lock"):
            name.unlink()
        said = "another process writes this journal"
        self.expect(4, "serve", self.project_name, "--port", "0", stderr=said)
        self.project.write_text(self.project.read_text() + '\n[serve]\njournal = "link.journal"\n')
        self.expect(4, "serve", self.project_name, "--port", "0", stderr=said)

    def test_a_stream_says_of_which_journal_it_is(self):
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        service.settled(12)
        run = service.get("/v1/description")[1]["run"]
        journal = service.get("/v1/status")[1]["journal"]
        self.assertRegex(journal, "^[0-9a-f]{16}$")
        last = service.get("/v1/status")[1]["event"]
        service.stop()
        service.start()
        self.assertEqual((service.get("/v1/description")[1]["run"], service.get("/v1/status")[1]["journal"]), (run, journal))
        service.stop()
        for part in ("", "-wal", "-shm"):
            self.journal(part).unlink(missing_ok=True)
        service.start()
        self.expect_stored(service.send(self.data[3]), 3)
        service.settled(1)
        self.assertNotEqual(service.get("/v1/description")[1]["run"], run)
        events = Events(service, Last_Event_ID=str(last + 100))
        events.wait_for(lambda e: e.steps() and any(x.get("event") == "status" for x in e.events))
        self.assertEqual([line["step"] for _, line in events.steps()], [3])
        status = json.loads(next(x["data"] for x in events.events if x.get("event") == "status"))
        self.assertEqual(status["journal"], service.get("/v1/status")[1]["journal"])
        self.assertNotEqual(status["journal"], journal)
        events.close()
        (alarm,) = [a for a in self.alarms(service) if a["kind"] == "journal"]
        self.assertEqual(alarm["message"], "the journal that had this name, with 12 records, no longer exists")

    def test_a_journal_is_copied_while_it_is_written(self):
        service = self.serve()
        for datum in self.data[:6]:
            service.send(datum)
        service.settled(6)
        lines = [comparable(line) for line in service.states()]
        self.assertIn("6 records, whole", self.expect(0, "backup", self.journal(), "-o", "copy.journal").out)
        for datum in self.data[6:]:
            self.expect_stored(service.send(datum))
        self.expect(2, "backup", self.journal(), "-o", "copy.journal", stderr="is there already")
        self.expect(4, "backup", "absent.journal", "-o", "other.journal", stderr="there is no such journal")
        service.stop()
        self.assertEqual(sorted(p.name for p in self.folder.glob("copy*")), ["copy.journal"])
        again = self.serve(extra='journal = "copy.journal"\n')
        again.settled(6)
        self.assertEqual([comparable(line) for line in again.states()], lines)

    # The alarms

    def test_alarms_are_kept_over_restarts_as_they_were_told(self):
        service = self.serve()
        wild = [{**d, "values": [v + (2e-5 if d["seq"] in (4, 5, 9, 10, 11) else 0) for v in d["values"]]} for d in self.data]
        for datum in wild[:7]:
            service.send(datum)
            service.settled()
        told = self.alarms(service)
        self.assertTrue([a for a in told if a["severity"] == "alarm"], told)
        # A machine that is busy raises more of those about deadlines.
        but_new_delays = lambda alarms, kept: [a for a in alarms if a in kept or a["kind"] != "deadline"]
        for stop in (service.stop, service.kill):
            service.wait_until(lambda: self.kept() >= len(told))
            stop()
            service.start()
            service.settled()
            self.assertEqual(but_new_delays(self.alarms(service), told), told)
        for datum in wild[7:]:
            service.send(datum)
            service.settled()
        more = self.alarms(service)
        self.assertEqual(but_new_delays(more, told)[: len(told)], told)
        self.assertGreater(len(more), len(told))
        service.wait_until(lambda: self.kept() >= len(more))
        service.kill()
        service.start()
        service.settled()
        self.assertEqual(but_new_delays(self.alarms(service), more), more)
        self.assertLess(abs(more[-1]["raised_at"] - time.time()), 600)
        service.stop()
        self.expect(0, "recover", self.journal(), "-o", "saved.journal")
        again = self.serve(extra='journal = "saved.journal"\n')
        self.assertEqual(but_new_delays(self.alarms(again), more), more)

    def kept(self):
        with sqlite3.connect(f"file:{self.journal()}?mode=ro", uri=True) as journal:
            return journal.execute("SELECT count(*) FROM alarm WHERE severity <> ''").fetchone()[0]

    def test_a_datum_that_is_held_again_is_told_again(self):
        service = self.serve()
        wild = {**self.data[0], "values": [1.0] + self.data[0]["values"][1:]}
        key = {name: wild[name] for name in ("source", "session", "seq")}
        for _ in range(2):
            self.assertIs(service.send(wild)[1]["quarantined"], True)
            self.assertEqual(service.post("/v1/withdraw", key)[0], 200)
        self.assertEqual(len([a for a in self.alarms(service) if a["kind"] == "sensors"]), 2)

    # Names and numbers

    def test_a_wrong_number_ahead_of_all_quarantines_nothing(self):
        expected = [comparable(line) for line in self.assimilate()]
        service = self.serve()
        self.expect_stored(service.send({**self.data[0], "seq": 2**53}), 0)
        for datum in self.data[1:]:
            self.assertNotIn("quarantined", service.send(datum)[1])
        service.settled(12)
        self.assertEqual([comparable(line) for line in service.states()], expected)
        service.kill()
        service.start()
        self.assertNotIn("quarantined", service.send({**self.data[0], "source": "second"})[1])
        self.assertTrue(service.send({**self.data[0], "seq": 1000})[1].get("quarantined") is None)
        self.assertIs(service.send(self.data[0])[1]["quarantined"], True)  # 12 have come before it that should be behind

    def test_a_name_that_is_no_text_is_refused(self):
        service = self.serve()
        headers = {"Content-Type": "application/x-npy", "source": b"cam\xff".decode("latin-1"), "session": "s", "seq": "0", "time": "0.1"}
        answer = service.request("POST", "/v1/measurements", b"\x93NUMPY", headers)
        self.expect_error((answer[0], answer[2]), 400, "Malformed")
        self.assertEqual(answer[2]["error"]["message"], '"source" is not UTF-8')
        self.assertEqual(service.get("/v1/quarantine"), (200, {"quarantined": []}))

    def test_what_is_no_file_is_no_journal(self):
        os.mkfifo(self.folder / "pipe.journal")
        self.project.write_text(self.project.read_text() + '\n[serve]\njournal = "pipe.journal"\n')
        self.expect(4, "serve", self.project_name, "--port", "0", stderr="pipe.journal: is not a file")

    def test_what_is_no_table_in_a_watched_folder_holds_up_nothing(self):
        """Files that are no files, never end, or have a name or content that is no text, before one that is right."""
        header, *rows = (self.folder / "data.csv").read_text().splitlines()
        tables = self.folder / "tables"
        tables.mkdir()
        (tables / "a.csv").symlink_to("/dev/zero")
        os.mkfifo(tables / "b.csv")
        (tables / "c.csv").mkdir()
        (tables / "d.csv").symlink_to("d.csv")
        (tables / "e.csv").touch()
        os.truncate(tables / "e.csv", 100 << 30)  # of which nothing is on the disk
        (tables / "f.csv").write_bytes("\n".join([header, *rows[:24]]).encode("utf-16"))
        pathlib.Path(os.fsdecode(os.fsencode(tables) + b"/g\xff.csv")).write_text("\n".join([header, *rows[:24]]) + "\n")
        (tables / "h.csv").write_text("\n".join([header, *rows[24:48]]) + "\n")
        service = self.serve(extra='watch_csv = "tables/"\nsettle = 0.1\n')
        service.settled(1)
        self.assertEqual([line["step"] for line in service.states()], [1])
        told = lambda: [alarm["message"] for alarm in self.alarms(service) if alarm["kind"] == "sensors"]
        for said in ("e.csv: the file has 102400 MB; at most 64 are read", "f.csv", "its name is not UTF-8"):
            service.wait_until(lambda: said in "\n".join(told()))
        self.assertEqual((service.get("/v1/quarantine")[0], service.stop()), (200, 130))

    def test_a_watched_folder_that_goes_is_told_and_what_comes_after_is_taken(self):
        """A share that is unmounted, and files of another kind than are taken."""
        header, *rows = (self.folder / "data.csv").read_text().splitlines()
        tables, away = self.folder / "tables", self.folder / "away"
        tables.mkdir()
        service = self.serve(extra='watch_csv = "tables/"\nsettle = 0.1\n')
        told = lambda text: [alarm["severity"] for alarm in self.alarms(service) if text in alarm["message"]]
        (tables / "data.xlsx").write_text("no table")
        service.wait_until(lambda: told("data.xlsx is not taken: tables have names that end in .csv") == ["info"])
        tables.rename(away)
        service.wait_until(lambda: told("tables/ cannot be read: No such file or directory; what is left there waits until it can") == ["alarm"])
        (away / "a.csv").write_text("\n".join([header, *rows[:24]]) + "\n")
        away.rename(tables)
        service.settled(1)
        self.assertEqual([line["step"] for line in service.states()], [0])
        self.assertEqual(len(told("cannot be read")), 1)

    def test_what_takes_the_place_of_the_mark_is_neither_waited_for_nor_written(self):
        for replacement in ("pipe", "link"):
            with self.subTest(replacement):
                self.setUp()
                service = self.serve()
                self.expect_stored(service.send(self.data[0]), 0)
                other, new = self.folder / "other", self.folder / "new"
                other.write_text("another file of the same user\n")
                os.mkfifo(new) if replacement == "pipe" else new.symlink_to(other)
                os.replace(new, self.journal("-mark"))  # in one step: the service may be writing the mark of the datum before
                self.expect_stored(service.send(self.data[1]), 1)
                self.assertEqual(other.read_text(), "another file of the same user\n")
                service.stop()
                if replacement == "pipe":
                    service.start()
                    self.assertEqual(service.settled(2)["records"], 2)
                    service.stop()

    def test_a_checkpoint_by_another_program_is_no_accident(self):
        """Backup programs and browsers of databases move SQLite's log into the file."""
        service = self.serve()
        for k, mode in enumerate(("PASSIVE", "FULL", "RESTART", "TRUNCATE") * 2):
            for seq in range(4):  # enough for the file to grow
                self.expect_stored(service.send({**self.data[k], "source": f"camera {seq}"}), k)
            with contextlib.closing(sqlite3.connect(self.journal())) as other:
                other.execute(f"PRAGMA wal_checkpoint({mode})").fetchall()
                other.execute("SELECT count(*) FROM measurement").fetchall()
            self.expect_stored(service.send({**self.data[k], "source": "after"}), k)
        self.assertFalse(service.get("/v1/status")[1]["read_only"])
        service.settled(40)
        # Another journal over it is one, though its tables are the same.
        with contextlib.closing(sqlite3.connect(self.journal())) as it, contextlib.closing(sqlite3.connect(self.folder / "other")) as other:
            it.backup(other)
            other.execute("UPDATE meta SET value = value + 1 WHERE key = 'journal'")
            other.commit()
        self.journal().write_bytes((self.folder / "other").read_bytes())
        self.expect_error(service.send(self.data[9]), 507, "DiskFull")

    def test_a_log_lost_with_its_mark_is_said(self):
        service = self.serve()
        self.expect_stored(service.send(self.data[0]), 0)
        service.wait_until(lambda: self.journal("-wal").stat().st_size == 0)
        for datum in self.data[1:]:
            service.send(datum)
        service.kill()
        self.journal("-wal").unlink()
        self.journal("-mark").unlink()
        said = "assimilation.journal-mark, which says how much was acknowledged, is missing or damaged"
        self.assertIn(said, self.expect(0, "replay", self.journal()).out)
        service.start()
        self.assertIn(said, service.logged())
        self.assertTrue([a for a in self.alarms(service) if a["kind"] == "journal" and said in a["message"]])
        for datum in self.data:
            self.assertEqual(service.send(datum)[0], 200)
        service.stop()
        self.assertNotIn(said, self.expect(0, "replay", self.journal()).out)
        self.expect(0, "backup", self.journal(), "-o", "copy.journal")
        self.assertNotIn("acknowledged", self.expect(0, "replay", "copy.journal", "--project", self.project_name).out)

    def test_what_the_service_writes_is_nobody_elses_business(self):
        service = self.serve(umask=0)
        self.expect_stored(service.send(self.data[0]), 0)
        service.settled(1)
        self.expect(0, "backup", self.journal(), "-o", "copy.journal")
        for path in (*self.folder.glob("assimilation.journal*"), self.folder / "copy.journal"):
            self.assertEqual(path.stat().st_mode & 0o777, 0o600, path)
        service.stop()

    # Broker and log

    def test_what_is_refused_though_it_was_acknowledged_is_kept(self):
        """A dead letter and an alarm for each kind; a flood of them leaves the log readable."""
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        service = self.serve(extra=f'mqtt = {{ broker = "127.0.0.1:{broker.port}" }}\n')
        service.wait_until(lambda: service.logged().count("subscribed at the MQTT broker") == 2)
        topic = "knothe/v1/assimilation/camera/data"
        other = {**self.data[0], "values": [2 * v for v in self.data[0]["values"]]}
        for body in (self.data[0], other, {**self.data[1], "values": [1.0]}):
            broker.publish(topic, json.dumps(body).encode())
        for k in range(400):
            broker.publish(topic, b"nonsense %d" % k)
        letters = self.journal("-refused.jsonl")
        service.wait_until(lambda: letters.exists() and len(letters.read_text().splitlines()) == 402)
        kept = [json.loads(line) for line in letters.read_text().splitlines()]
        self.assertEqual([letter["type"] for letter in kept[:3]], ["Conflict", "WrongSize", "Malformed"])
        self.assertEqual(json.loads(kept[0]["payload"]), other)
        self.assertEqual([letter["payload"] for letter in kept[2:]], [f"nonsense {k}" for k in range(400)])
        told = [a["message"] for a in self.alarms(service) if "refused" in a["message"]]
        self.assertEqual(len(told), 3, told)
        self.assertIn("assimilation.journal-refused.jsonl", told[0])
        self.assertEqual(letters.stat().st_mode & 0o777, 0o600)
        self.assertEqual(service.stop(), 130)
        lines = [json.loads(line) for line in service.logged().splitlines() if line.startswith("{")]
        written = [line for line in lines if line["event"] == "a message was refused"]
        self.assertLess(len(written), 200)
        left_out = sum(line.get("left_out_before", 0) for line in written)
        left_out += sum(line["lines"] for line in lines if line["event"] == "lines of one kind were left out")
        self.assertEqual(len(written) + left_out, 402)

    def test_two_services_at_one_broker_keep_all(self):
        """Machines whose journals have the same path: one broker, and none takes the other's place."""
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        text = self.project.read_text()
        services = []
        for site in ("one", "other"):
            folder = self.folder / site
            folder.mkdir()
            for name in ("model.h5", "data.h5", "data.csv"):
                shutil.copy(self.folder / name, folder / name)
            (folder / self.project_name).write_text(text + f'\n[serve]\nsite = "{site}"\nmqtt = {{ broker = "127.0.0.1:{broker.port}" }}\n')
            service = Service(folder, self.project_name)
            self.addCleanup(lambda service=service: service.process and service.process.poll() is None and service.kill())
            services.append(service.start())
        for service in services:
            service.wait_until(lambda service=service: service.logged().count("subscribed at the MQTT broker") == 2)
        for datum in self.data:
            for site in ("one", "other"):
                broker.publish(f"knothe/v1/{site}/camera/data", json.dumps(datum).encode())
        for service in services:
            service.settled(12)
            self.assertNotIn("the MQTT broker is away", service.logged())
            service.stop()

    def test_a_broker_that_comes_later_is_found(self):
        first = Broker(self.folder)
        first.stop()
        service = self.serve(extra=f'mqtt = {{ broker = "127.0.0.1:{first.port}" }}\n')
        service.wait_until(lambda: "the MQTT broker cannot be reached" in service.logged())
        self.assertIn("Connection refused", service.logged())
        options = f"listener {first.port} 127.0.0.1\nallow_anonymous true\nuser root\nlog_dest stderr\n"
        (self.folder / "mosquitto.conf").write_text(options)
        program = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
        for attempt in range(2):
            with open(self.folder / "mosquitto.log", "w") as log:
                first.process = subprocess.Popen([program, "-c", str(self.folder / "mosquitto.conf")], stdout=log, stderr=log)
            service.wait_until(lambda: len(re.findall("subscribed at the MQTT broker.*/data", service.logged())) == attempt + 1)
            answers = first.listen("knothe/v1/assimilation/camera/answer")
            first.publish("knothe/v1/assimilation/camera/data", b'{"source":"\xff"}')
            self.assertEqual(json.loads(answers.get(timeout=60))["error"]["type"], "Malformed")  # though it quotes what is no text
            first.publish("knothe/v1/assimilation/camera/data", json.dumps(self.data[attempt]).encode())
            service.settled(attempt + 1)
            first.stop()
            service.wait_until(lambda: service.logged().count("the MQTT broker is away") == attempt + 1)
        self.assertEqual(service.stop(), 130)

    def test_a_log_that_nobody_reads_holds_up_nothing(self):
        reader, writer = os.pipe()
        self.project.write_text(self.project.read_text() + '\n[serve]\nlog = "steps"\nwindow = 1000\n')
        process = subprocess.Popen([KNOTHE, "serve", self.project_name, "--port", "0"], cwd=self.folder, stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=writer)
        self.addCleanup(lambda: process.poll() is None and process.kill())
        os.close(writer)
        service = Service(self.folder, self.project_name)
        service.process, service.log = process, open(self.folder / "serve.log", "ab")
        service.port = int(re.search(rb":(\d+)/$", process.stdout.readline().strip())[1])
        service.wait_until(lambda: service.get("/readyz")[0] == 200)
        for k in range(900):  # 100 bytes a step, and more
            service.send({**self.data[k % 12], "seq": k})
        service.settled(900)
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.wait(timeout=60), 130)
        process.stdout.close()
        service.log.close()
        os.close(reader)


if __name__ == "__main__":
    unittest.main()
