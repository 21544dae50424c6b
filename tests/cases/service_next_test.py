"""A new specimen without a restart: another test takes the place of the one that runs, and nothing of either is lost."""
import json
import os
import shutil
import threading
import time
import unittest

from service_logbook import Webhook
from service_support import Broker, Events, ServiceCase, comparable


class Test(ServiceCase):
    def begin(self, service, name, **more):
        return service.post("/v1/tests", {"name": name, "by": "Ada"} | more)

    def lines(self, service, records):
        service.settled(records)
        return [comparable(line) for line in service.states()]

    def replayed(self, journal):
        lines = self.expect(0, "replay", journal, "--project", self.project_name, "--json").lines()
        return [comparable(line) for line in lines[:-1]]

    def known(self, service):
        return {test["name"]: test for test in service.get("/v1/tests")[1]["tests"]}

    def test_another_test_begins_from_the_prior_and_the_stream_changes_over(self):
        service = self.serve()
        for datum in self.data[:4]:
            service.send(datum)
        first = self.lines(service, 4)
        before = service.get("/v1/status")[1]
        run = service.get("/v1/description")[1]["run"]
        events = Events(service)
        status, entry = self.begin(service, "second", comment="notch of 12 mm")
        self.assertEqual((status, entry["kind"], entry["name"], entry["by"], entry["text"]),
                         (200, "test_begun", "second", "Ada", "notch of 12 mm"), entry)
        after = service.settled(0)
        self.assertEqual((after["test"], after["journal"]), ("second", entry["journal"]))
        self.assertNotEqual(after["journal"], before["journal"])
        self.assertNotIn("step", after)
        self.assertEqual(service.states(), [])
        said = service.get("/v1/description")[1]
        self.assertEqual((said["test"], said["journal"]), ("second", entry["journal"]))
        self.assertNotEqual(said["run"], run)
        metrics = service.get("/metrics")[1].decode()
        for gauge in ("knothe_step{", "knothe_data_age_seconds{", "knothe_log_evidence{", "knothe_structure{"):
            self.assertNotIn("\n" + gauge, metrics)
        # The same data give the same lines: nothing of the first specimen is in them.
        for datum in self.data[:4]:
            self.expect_stored(service.send(datum))
        self.assertEqual(self.lines(service, 4), first)
        events.wait_for(lambda e: len([1 for _, line in e.steps()[1:] if line["step"] == 3]) > 0)
        kinds = [(e["event"], json.loads(e["data"])) for e in events.events if "event" in e]
        changed = next(k for k, (kind, body) in enumerate(kinds) if kind == "status" and body["journal"] == after["journal"])
        self.assertTrue(all(kind != "step" or body["step"] == 3 for kind, body in kinds[:changed]))
        self.assertIn("test_begun", [body["kind"] for kind, body in kinds[changed:] if kind == "logbook"])
        ids = [event for event, _ in events.steps()]
        self.assertEqual(ids, sorted(set(ids)))
        events.close()
        # Whoever comes back with an event of the first test hears all of the second.
        again = Events(service, Last_Event_ID=str(ids[0]))
        again.wait_for(lambda e: len(e.steps()) == 4)
        again.close()
        tests = self.known(service)
        self.assertEqual([(t["records"], t["finished"], t["current"], t.get("followed_by")) for t in tests.values()],
                         [(4, True, False, "second"), (4, False, True, None)])
        self.assertGreater(tests["second"]["begun_at"], 1.7e9)
        self.assertEqual(self.replayed("assimilation.journal"), first)
        # A program that dies is started as it was, and goes on with the second.
        service.kill()
        service.start()
        self.assertEqual(self.lines(service, 4), first)
        self.assertEqual(service.get("/v1/status")[1]["test"], "second")
        self.assertIn("a test is served that has followed the one asked for", service.logged())
        self.expect_stored(service.send(self.data[3]), 3, duplicate=True)
        again = Events(service, Last_Event_ID=str(ids[-1]))
        again.wait_for(lambda e: len(e.steps()) == 4)
        again.close()

    def test_an_earlier_test_is_set_beside_the_one_that_runs(self):
        service = self.serve()
        for datum in self.data[:6]:
            service.send(datum)
        service.post("/v1/withdraw", {"source": "camera", "session": "s", "seq": 4})
        service.post("/v1/sensors", {"sensor": 2, "active": False, "step": 3, "by": "Ada"})
        service.settled(6)
        lines = {line["step"]: line for line in service.states()}
        self.begin(service, "second")
        for datum in self.data[:3]:
            service.send(datum)
        service.settled(3)
        status, earlier = service.get("/v1/states?test=")
        self.assertEqual((status, [line["step"] for line in earlier]), (200, [0, 1, 2, 3, 5]))
        for line in earlier:
            same = comparable(lines[line["step"]])
            same.pop("marginals", None)
            for forecast in same["forecast"].values():
                forecast.pop("density", None)
            self.assertEqual(comparable(line), same)
        self.assertEqual([line["step"] for line in service.get("/v1/states?test=&from=3")[1]], [3, 5])
        self.assertEqual(service.get("/v1/states?test=second")[1], service.states())
        self.expect_error(service.get("/v1/states?test=third"), 404, "UnknownTest")
        self.expect_error(service.get("/v1/states?test=../second"), 404, "UnknownTest")
        # What changes in an earlier test is seen: gone back to, and left again.
        service.post("/v1/tests/resume", {"name": "", "by": "Ada"})
        service.send(self.data[6])
        service.settled(7)
        service.post("/v1/tests/resume", {"name": "second", "by": "Ada"})
        self.assertEqual([line["step"] for line in service.get("/v1/states?test=")[1]], [0, 1, 2, 3, 5, 6])
        with open(self.folder / "assimilation.journal", "r+b") as journal:
            journal.seek(6000)
            journal.write(bytes(4000))
        answer = service.get("/v1/states?test=")
        self.expect_error(answer, 409, "NotComparable")
        self.assertIn("damaged", answer[1]["error"]["message"])
        self.assertEqual(service.get("/v1/states?test=second")[0], 200)

    def test_what_cannot_be_begun_is_refused_and_the_test_goes_on(self):
        service = self.serve()
        service.send(self.data[0])
        journal = service.settled(1)["journal"]
        for body, kind, said in (({"by": "Ada"}, "Malformed", '"name" is missing'), ({"name": "b"}, "Malformed", '"by"'),
                                 ({"name": "a/b", "by": "Ada"}, "Malformed", "letters, digits"),
                                 ({"name": "", "by": "Ada"}, "Malformed", "must not be empty"),
                                 ({"name": "x" * 65, "by": "Ada"}, "Malformed", "at most 64"),
                                 ({"name": 3, "by": "Ada"}, "Malformed", '"name" must be a string')):
            answer = service.post("/v1/tests", body)
            self.expect_error(answer, 400, kind)
            self.assertIn(said, answer[1]["error"]["message"])
        self.expect_error(service.post("/v1/tests", {"name": "b", "by": "Ada", "site": "x"}), 404, "UnknownSite")
        (self.folder / "assimilation.broken.journal").write_text("no journal at all, but long enough to look at")
        answer = self.begin(service, "broken")
        self.expect_error(answer, 409, "TestExists")
        self.assertIn("cannot be read", answer[1]["error"]["message"])
        self.assertEqual(self.begin(service, "second")[0], 200)
        self.expect_stored(service.send(self.data[0]))
        self.expect_error(self.begin(service, "second"), 409, "TestExists")
        self.assertEqual(self.begin(service, "third")[0], 200)
        answer = self.begin(service, "second")
        self.expect_error(answer, 409, "TestExists")
        self.assertIn("with 1 records", answer[1]["error"]["message"])
        model = self.folder / "model.h5"
        away = model.rename(self.folder / "away.h5")
        answer = self.begin(service, "fourth")
        self.expect_error(answer, 409, "NotBegun")
        self.assertIn("model.h5", answer[1]["error"]["message"])
        away.rename(model)
        self.assertEqual(service.get("/v1/status")[1]["test"], "third")
        self.expect_stored(service.send(self.data[0]))
        self.expect_error(service.post("/v1/tests/resume", {"name": "none", "by": "Ada"}), 404, "UnknownTest")
        self.expect_error(service.post("/v1/tests/resume", {"name": "../x", "by": "Ada"}), 404, "UnknownTest")
        self.expect_error(service.post("/v1/tests/resume", {"name": "third", "by": "Ada"}), 409, "TestFinished")
        self.assertNotEqual(service.get("/v1/status")[1]["journal"], journal)

    def test_a_token_is_asked_for(self):
        (self.folder / "ingest").write_text("a secret of sixteen characters\n")
        service = self.serve(extra='ingest_token = "ingest"\n')
        self.expect_error(self.begin(service, "second"), 401, "Unauthorized")
        self.assertNotIn("test", service.get("/v1/status")[1])
        status, _ = service.post("/v1/tests", {"name": "second", "by": "Ada"}, Authorization="Bearer a secret of sixteen characters")
        self.assertEqual(status, 200)

    def test_a_datum_of_another_specimen_is_refused(self):
        service = self.serve()
        self.expect_stored(service.send(self.data[0] | {"test": ""}), step=0)
        self.begin(service, "second")
        late = self.data[1] | {"test": ""}
        self.expect_error(service.send(late), 409, "OtherTest")
        self.assertIn('the datum is for the unnamed test, and the test "second" runs', service.send(late)[1]["error"]["message"])
        self.expect_error(service.send(late | {"test": "third"}), 409, "OtherTest")
        self.expect_error(service.send(late | {"test": 2}), 400, "Malformed")
        self.expect_stored(service.send(self.data[1] | {"test": "second"}), step=1)
        self.expect_stored(service.send(self.data[2]), step=2)
        self.assertEqual(service.settled(2)["test"], "second")
        outcomes = service.get("/metrics")[1].decode()
        self.assertIn('outcome="other_test"} 3', outcomes)

    def test_an_alarm_that_is_sent_names_its_test(self):
        hook = Webhook()
        self.addCleanup(hook.stop)
        service = self.serve("--test", "second", extra=f'[serve.notify]\nwebhook = "{hook.url}"\n')
        service.send(self.data[0] | {"values": [value + 0.05 for value in self.data[0]["values"]]})
        service.wait_until(lambda: hook.accepted)
        body = hook.accepted[0][1]
        self.assertEqual((body["site"], body["test"], body["test_name"]), ("assimilation", False, "second"))

    def test_a_test_begun_by_mistake_is_gone_back_from(self):
        service = self.serve()
        for datum in self.data[:3]:
            service.send(datum)
        first = self.lines(service, 3)
        self.begin(service, "second")
        service.send(self.data[0])
        self.assertEqual(service.post("/v1/tests/resume", {"name": "", "by": "Bo", "comment": "not yet"})[0], 200)
        self.assertEqual(self.lines(service, 3), first)
        self.assertNotIn("test", service.get("/v1/status")[1])
        self.expect_stored(service.send(self.data[3]), 3)
        tests = self.known(service)
        self.assertEqual((tests[""]["current"], tests[""]["finished"], tests["second"]["followed_by"]), (True, False, ""))
        self.assertEqual([e["kind"] for e in service.get("/v1/logbook")[1]["logbook"]], ["test_followed", "test_resumed"])
        service.kill()
        service.start()
        self.assertNotIn("test", service.settled(4))
        self.assertEqual(service.post("/v1/tests/resume", {"name": "second", "by": "Bo"})[0], 200)
        service.stop()
        service.start()
        self.assertEqual(service.settled(1)["test"], "second")

    def test_killed_while_a_test_begins_it_serves_the_one_or_the_other(self):
        """Whatever was acknowledged is in the journal of the test it was sent to; what was cut short is begun again."""
        service = self.serve()
        running, kept = "", {"": 0}
        for k in range(8):
            datum = self.data[0] | {"seq": k}
            self.expect_stored(service.send(datum))
            kept[running] += 1
            name, answers = f"specimen-{k}", []

            def ask():
                try:
                    answers.append(self.begin(service, name)[0])
                except OSError:
                    pass

            asking = threading.Thread(target=ask)
            asking.start()
            time.sleep(0.004 * k * k)
            service.kill()
            asking.join()
            service.start()
            now = service.settled().get("test", "")
            self.assertIn(now, (name,) if answers == [200] else (running, name))
            if now != name:
                self.assertEqual(service.settled()["records"], kept[running])
                status, answer = self.begin(service, name)
                self.assertEqual(status, 200, answer)
            self.assertEqual(service.settled(0)["test"], name)
            running, kept[name] = name, 0
        tests = self.known(service)
        self.assertEqual({name: test["records"] for name, test in tests.items()}, kept)
        self.assertEqual([name for name, test in tests.items() if test["current"]], [running])

    def test_a_sender_that_never_stops_loses_nothing(self):
        """Each datum that is acknowledged while tests change is in one journal; what is refused is refused for now (503)."""
        service = self.serve(extra="window = 100000\n")
        stored, refused, over = [], [], threading.Event()

        def send(sender):
            one, seq = service.connection(), 0
            while not over.is_set():
                status, _ = service.send(self.data[seq % 12] | {"source": f"camera-{sender}", "seq": seq}, one)
                (stored if status == 200 else refused).append((status, sender, seq))
                seq += status == 200
            one.close()

        senders = [threading.Thread(target=send, args=(k,)) for k in range(3)]
        for one in senders:
            one.start()
        for name in ("b", "c", "d"):
            time.sleep(0.3)
            self.assertEqual(self.begin(service, name)[0], 200)
        time.sleep(0.2)
        over.set()
        for one in senders:
            one.join()
        self.assertEqual({status for status, _, _ in refused} - {503}, set())
        service.settled()
        tests = self.known(service)
        self.assertEqual(sum(test["records"] for test in tests.values()), len(stored))
        self.assertTrue(all(test["records"] > 0 for test in tests.values()), tests)

    def test_files_of_the_specimen_before_are_left_alone(self):
        rows = (self.folder / "data.csv").read_text().splitlines()
        of = lambda k: "\n".join([rows[0]] + [row for row in rows[1:] if float(row.split(",")[0]) == self.data[k]["time"]]) + "\n"
        (self.folder / "in").mkdir()
        service = self.serve(extra='watch_csv = "in"\nsettle = 0.1\n')
        put = lambda name, k: (self.folder / "in" / name).write_text(of(k))
        put("a.csv", 0)
        service.settled(1)
        self.assertEqual(self.begin(service, "second")[0], 200)
        put("b.csv", 1)
        self.assertEqual([line["step"] for line in (service.settled(1), service.states())[1]], [1])
        service.wait_until(lambda: "files that came while another test had its turn are left alone" in service.logged())
        service.kill()
        service.start()
        put("c.csv", 2)
        self.assertEqual([line["step"] for line in (service.settled(2), service.states())[1]], [1, 2])
        self.assertEqual(service.post("/v1/tests/resume", {"name": "", "by": "Ada"})[0], 200)
        put("d.csv", 3)
        self.assertEqual([line["step"] for line in (service.settled(2), service.states())[1]], [0, 3])

    def test_nothing_that_is_done_to_old_files_makes_them_the_new_specimens(self):
        """Permission, time, a new copy, another name: the content tells. Of the new specimen is what differs, whatever its name."""
        rows = (self.folder / "data.csv").read_text().splitlines()
        of = lambda k: "\n".join([rows[0]] + [row for row in rows[1:] if float(row.split(",")[0]) == self.data[k]["time"]]) + "\n"
        inside = self.folder / "in"
        inside.mkdir()
        service = self.serve(extra='watch_csv = "in"\nsettle = 0.1\n')
        for k in range(5):
            (inside / f"{k}.csv").write_text(of(k))
        service.settled(5)
        (inside / "unread.csv").write_text("not finished")  # no test will have taken it
        self.assertEqual(self.begin(service, "second")[0], 200)
        service.wait_until(lambda: any("1 files came before this test" in a["message"] for a in service.get("/v1/alarms")[1]["alarms"]))

        def disturb():
            os.chmod(inside / "0.csv", 0o600)
            os.utime(inside / "1.csv")
            (inside / "2.csv").write_text(of(2))
            os.replace(inside / "3.csv", inside / "renamed.csv") if (inside / "3.csv").exists() else os.utime(inside / "renamed.csv")
            shutil.copy(inside / "4.csv", inside / ".copy")
            os.replace(inside / ".copy", inside / "4.csv")

        disturb()
        (inside / "0.csv").write_text(of(6))  # the new specimen's, by the name of an old one
        service.wait_until(lambda: service.get("/v1/status")[1]["records"] == 1)
        (inside / "last.csv").write_text(of(7))
        self.assertEqual([line["step"] for line in (service.settled(2), service.states())[1]], [6, 7])
        service.kill()
        # Archived, as its project's test was: what was its data is known all the same.
        for path in self.folder.glob("assimilation.journal*"):
            path.rename(path.with_name("archived-" + path.name))
        service.start(wait=False)
        self.assertEqual(service.end(), 4)
        self.assertRegex(service.logged(), r'assimilation.journal: is missing, and the test \\?"second\\?" goes on')
        self.assertFalse((self.folder / "assimilation.journal").exists())
        service.arguments = ("--test", "second")
        disturb()
        service.start()
        (inside / "later.csv").write_text(of(8))
        self.assertEqual([line["step"] for line in (service.settled(3), service.states())[1]], [6, 7, 8])

    def test_the_broker_and_outside_models_go_over_to_the_new_test(self):
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        service = self.serve(extra=f'[serve.mqtt]\nbroker = "127.0.0.1:{broker.port}"\n')
        service.wait_until(lambda: service.logged().count("subscribed at the MQTT broker") == 2)
        publish = lambda k: broker.publish("knothe/v1/assimilation/camera/data", json.dumps(self.data[k]).encode())
        evaluate = lambda: service.post("/Evaluate", {"name": "posterior", "input": [service.states()[-1]["mean"]], "config": {}})[1]["output"]
        publish(0)
        service.settled(1)
        first = evaluate()
        self.assertEqual(self.begin(service, "second")[0], 200)
        publish(1)
        service.settled(1)
        self.assertEqual([line["step"] for line in service.states()], [1])
        self.assertNotEqual(evaluate(), first)
        self.assertEqual([test["records"] for test in self.known(service).values()], [1, 1])


if __name__ == "__main__":
    unittest.main()
