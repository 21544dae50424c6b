"""What people do while a structure is watched: alarms acknowledged and sent out, sensors switched off, notes."""
import concurrent.futures
import http.server
import json
import os
import stat
import threading
import unittest

from service_support import Broker, Events, ServiceCase, comparable


class Webhook:
    """A server that answers the next POST with each of `statuses`, then 200, and keeps what it accepted."""

    def __init__(self, *statuses):
        self.left, self.accepted, self.tried = list(statuses), [], 0
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                outer.tried += 1
                status = outer.left.pop(0) if outer.left else 200
                if status == 200:
                    outer.accepted.append((self.path, body))
                self.send_response(status)
                self.send_header("Content-Length", "1000000000000")  # nobody should wait for the body
                self.end_headers()

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/hook"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def stop(self):
        self.server.shutdown()
        self.server.server_close()


class Test(ServiceCase):
    def implausible(self, k):
        """Quarantined, with an alarm."""
        return self.data[k] | {"values": [value + 0.05 for value in self.data[k]["values"]]}

    def metric(self, service, name, *labels):
        lines = service.get("/metrics")[1].decode().splitlines()
        return [float(line.split()[-1]) for line in lines if line.startswith(name) and all(label in line for label in labels)]

    def test_an_alarm_is_acknowledged_and_stays_so(self):
        service = self.serve()
        events = Events(service)
        service.send(self.implausible(0))
        service.settled(1)
        first, *others = service.get("/v1/alarms")[1]["alarms"]
        self.assertNotIn("acknowledged", first)
        open_before = service.get("/v1/status")[1]["unacknowledged"]
        service.wait_until(lambda: self.metric(service, "knothe_unacknowledged_alarms{") == [open_before])
        path = f"/v1/alarms/{first['id']}/acknowledge"
        status, entry = service.post(path, {"by": "Ada", "comment": "seen, ×2"})
        self.assertEqual((status, entry["kind"], entry["alarm"], entry["by"]), (200, "acknowledgement", first["id"], "Ada"))
        told = lambda: service.get("/v1/alarms")[1]["alarms"][0].get("acknowledged")
        self.assertEqual((told()["by"], told()["comment"], told()["at"]), ("Ada", "seen, ×2", entry["written_at"]))
        self.assertEqual(service.get("/v1/status")[1]["unacknowledged"], open_before - (first["severity"] != "info"))
        again = lambda e: e.get("event") == "alarm" and "acknowledged" in json.loads(e["data"])
        events.wait_for(lambda e: any(again(one) for one in list(e.events)))
        events.wait_for(lambda e: any(one.get("event") == "logbook" for one in list(e.events)))
        events.close()
        self.expect_error(service.post("/v1/alarms/7/acknowledge", {"by": "Ada"}), 404, "UnknownAlarm")
        self.expect_error(service.post(path, {}), 400, "Malformed")
        self.expect_error(service.post(path, {"by": "A", "comment": "x" * 4001}), 400, "Malformed")
        self.expect_error(service.post("/v1/alarms/x/acknowledge", {"by": "Ada"}), 404, "NotFound")
        kept = told()
        service.kill()
        service.start()
        service.settled(1)
        self.assertEqual(told(), kept)
        self.assertEqual([entry["text"] for entry in service.get("/v1/logbook")[1]["logbook"]], ["seen, ×2"])

    def test_a_sensor_switched_off_is_as_if_it_had_been_missing(self):
        without = [dict(datum) for datum in self.data]
        for datum in without[5:]:
            datum["values"] = [None if k == 3 else value for k, value in enumerate(datum["values"])]
        service = self.serve()
        for datum in without:
            service.send(datum)
        service.settled(12)
        expected = [comparable(line) for line in service.states()]
        service.stop()
        (self.folder / "assimilation.journal").unlink()
        service.start()
        events = Events(service)
        for datum in self.data[:8]:
            service.send(datum)
        service.settled(8)
        status, entry = service.post("/v1/sensors", {"sensor": 3, "active": False, "step": 5, "by": "Ada", "comment": "loose"})
        self.assertEqual((status, entry["kind"], entry["sensor"], entry["time"]), (200, "sensor_off", 3, self.data[5]["time"]))
        # Its values cannot be any more: what comes with them is not quarantined because of it.
        for datum in self.data[8:]:
            values = [1e3 if k == 3 else value for k, value in enumerate(datum["values"])]
            answer = service.send(datum | {"values": values})
            self.expect_stored(answer)
            self.assertNotIn("quarantined", answer[1])
        self.assertEqual(service.settled(12)["switched_off"], [3])
        self.assertEqual([comparable(line) for line in service.states()], expected)
        self.assertEqual([json.loads(e["data"])["step"] for e in events.events if e.get("event") == "withdrawn"], [])
        events.close()
        observed = service.get("/v1/observations?step=6")[1]
        self.assertEqual((observed["status"][3], observed["reason"]["3"]), ("missing", "switched off"))
        lines = self.expect(0, "replay", "assimilation.journal", "--project", self.project_name, "--json").lines()[:-1]
        self.assertEqual([comparable(line) for line in lines], expected)
        service.kill()
        service.start()
        service.settled(12)
        self.assertEqual([comparable(line) for line in service.states()], expected)
        self.expect(0, "backup", "assimilation.journal", "-o", "copy.journal")
        lines = self.expect(0, "replay", "copy.journal", "--project", self.project_name, "--json").lines()[:-1]
        self.assertEqual([comparable(line) for line in lines], expected)

    def test_a_sensor_switched_on_again_was_never_off(self):
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        service.settled(12)
        expected = [comparable(line) for line in service.states()]
        switch = lambda **more: service.post("/v1/sensors", {"sensor": 2, "by": "Ada"} | more)
        self.assertEqual(switch(active=False, step=0)[0], 200)
        self.assertNotEqual([comparable(line) for line in (service.settled(), service.states())[1]], expected)
        self.assertEqual(switch(active=True, step=0)[0], 200)
        self.assertNotIn("switched_off", service.settled(12))
        self.assertEqual([comparable(line) for line in service.states()], expected)
        self.expect_error(switch(), 400, "Malformed")
        self.expect_error(switch(active="no"), 400, "Malformed")
        self.expect_error(switch(active=False, step=1000), 400, "Malformed")
        answer = switch(active=False, sensor=1000)
        self.expect_error(answer, 400, "UnknownSensor")
        self.assertIn("0 to ", answer[1]["error"]["message"])
        self.assertEqual(len(service.get("/v1/logbook")[1]["logbook"]), 2)

    def test_a_finished_test_takes_no_more_data_and_the_next_has_a_journal_of_its_own(self):
        service = self.serve(extra="stale_after = 0.2\n")
        for datum in self.data[:4]:
            service.send(datum)
        service.settled(4)
        service.wait_until(lambda: service.get("/v1/status")[1]["state"] == "STALE")
        status, entry = service.post("/v1/tests/finish", {"by": "Ada", "comment": "broken"})
        self.assertEqual((status, entry["kind"], entry["time"]), (200, "test_finished", self.data[3]["time"]))
        self.expect_error(service.post("/v1/tests/finish", {"by": "Ada"}), 409, "TestFinished")
        said = service.get("/v1/status")[1]
        self.assertEqual((said["state"], said["reason"]), ("FINISHED", "the test was finished by Ada: broken"))
        answer = service.send(self.data[4])
        self.expect_error(answer, 409, "TestFinished")
        self.assertIn("the test was finished by Ada", answer[1]["error"]["message"])
        self.expect_stored(service.send(self.data[3]), 3, duplicate=True)
        service.kill()
        service.start()
        service.settled(4)
        self.expect_error(service.send(self.data[4]), 409, "TestFinished")
        self.assertEqual(service.post("/v1/tests/resume", {"by": "Bo"})[0], 200)
        self.expect_error(service.post("/v1/tests/resume", {"by": "Bo"}), 409, "TestFinished")
        self.expect_stored(service.send(self.data[4]), 4)
        with concurrent.futures.ThreadPoolExecutor(20) as people:  # all at once: one of them finishes it
            answers = list(people.map(lambda k: service.post("/v1/tests/finish", {"by": f"person {k}"})[0], range(40)))
        self.assertEqual(sorted(answers), [200] + 39 * [409])
        lines = [comparable(line) for line in (service.settled(5), service.states())[1]]
        service.stop()
        service.arguments = ("--test", "second")
        service.start()
        self.assertEqual(service.settled(0)["test"], "second")
        self.expect_stored(service.send(self.data[0]), 0)
        self.assertEqual([comparable(line) for line in (service.settled(1), service.states())[1]], lines[:1])
        self.assertEqual(service.get("/v1/tests")[1]["tests"],
                         [{"name": "", "journal": "assimilation.journal", "current": False, "records": 5, "finished": True},
                          {"name": "second", "journal": "assimilation.second.journal", "current": True, "records": 1, "finished": False}])
        replayed = self.expect(0, "replay", "assimilation.second.journal", "--json").lines()
        self.assertEqual([comparable(line) for line in replayed[:-1]], lines[:1])
        self.expect(2, "serve", self.project_name, "--test", "a/b", stderr="letters, digits")

    def test_notes_are_kept_in_their_order(self):
        service = self.serve()
        for datum in self.data[:4]:
            service.send(datum)
        service.settled(4)
        self.assertEqual(service.post("/v1/notes", {"by": "Ada", "text": "a crack\nis heard", "step": 2})[0], 200)
        self.assertEqual(service.post("/v1/notes", {"by": "Bo", "text": "load held"})[0], 200)
        self.expect_error(service.post("/v1/notes", {"by": "Bo"}), 400, "Malformed")
        notes = service.get("/v1/logbook")[1]["logbook"]
        self.assertEqual([(n["number"], n["kind"], n["time"], n["by"], n["text"]) for n in notes],
                         [(1, "note", self.data[2]["time"], "Ada", "a crack\nis heard"), (2, "note", self.data[3]["time"], "Bo", "load held")])
        service.stop()
        service.start()
        self.assertEqual(service.get("/v1/logbook")[1]["logbook"], notes)

    def sendmail(self, script):
        program = self.folder / "sendmail"
        program.write_text("#!/bin/sh\n" + script)
        os.chmod(program, os.stat(program).st_mode | stat.S_IXUSR)
        return 'sendmail = "sendmail"\n'

    def test_alarms_are_posted_published_and_mailed_and_tried_again(self):
        hook, broker = Webhook(503), Broker(self.folder)
        self.addCleanup(hook.stop)
        self.addCleanup(broker.stop)
        listener = broker.listen("knothe/v1/assimilation/alarm")
        mail = self.sendmail('printf "%s\\n" "$*" >> mail; cat >> mail\n')
        service = self.serve(extra=f'[serve.mqtt]\nbroker = "127.0.0.1:{broker.port}"\n[serve.notify]\nwebhook = "{hook.url}"\n'
                                   f'mqtt = "on"\nmail = ["ada@example.org"]\nmail_rest = 0.1\n{mail}severity = "alarm"\n')
        service.send(self.implausible(0))
        service.settled(1)
        expected = [alarm for alarm in service.get("/v1/alarms")[1]["alarms"] if alarm["severity"] == "alarm"]
        self.assertTrue(expected)
        service.wait_until(lambda: len(hook.accepted) == len(expected))
        self.assertEqual([body for _, body in hook.accepted], [{"site": "assimilation", "test": False, "alarm": alarm} for alarm in expected])
        self.assertEqual({path for path, _ in hook.accepted}, {"/hook"})
        self.assertEqual([json.loads(listener.get()) for _ in expected], [body for _, body in hook.accepted])
        sent = lambda channel: self.metric(service, "knothe_alarms_sent_total", f'channel="{channel}"', 'outcome="sent"')
        for channel in ("webhook", "mqtt", "mail"):
            service.wait_until(lambda: sent(channel) == [len(expected)])
        mailed = (self.folder / "mail").read_text()
        for part in ("-t -i\n", "To: ada@example.org\n", "Subject: knothe assimilation: ", expected[0]["message"]):
            self.assertIn(part, mailed)
        self.assertEqual(self.metric(service, "knothe_alarms_sent_total", 'channel="webhook"', 'outcome="failed"'), [1])
        self.assertEqual(self.metric(service, "knothe_alarms_unsent"), [0, 0, 0])
        self.assertIn("an alarm could not be sent", service.logged())
        service.stop()
        service.start()  # nothing is told twice
        service.settled(1)
        self.assertEqual(len(hook.accepted), len(expected))

    def test_what_cannot_be_sent_delays_nothing(self):
        mail = self.sendmail("exit 75\n")
        service = self.serve(extra=f'[serve.notify]\nwebhook = "http://127.0.0.1:1/"\nmail = ["a@b"]\n{mail}')
        for k, datum in enumerate(self.data):
            self.expect_stored(service.send(self.implausible(k) if k < 3 else datum), k)
        service.settled(12)
        failed = lambda channel: self.metric(service, "knothe_alarms_sent_total", f'channel="{channel}"', 'outcome="failed"')
        service.wait_until(lambda: failed("webhook")[0] > 0 and failed("mail")[0] > 0)
        self.assertIn("sendmail ended with 75", service.logged())
        self.assertGreater(min(self.metric(service, "knothe_alarms_unsent")), 0)
        self.assertEqual(service.stop(), 130)
        self.assertIn("alarms were not sent: the service stopped", service.logged())

    def test_a_test_message_says_which_channel_works(self):
        hook = Webhook()
        self.addCleanup(hook.stop)
        text = self.project.read_text()
        self.project.write_text(text + f'\n[serve.notify]\nwebhook = "{hook.url}"\nmail = ["ada@example.org"]\n' + self.sendmail("exit 1\n"))
        outcome = self.run_knothe("doctor", self.project_name, "--test-alarms")
        self.assertEqual(outcome.status, 1)
        out = outcome.out
        self.assertIn("ok   webhook      a test message was sent", out)
        self.assertRegex(out, r"!!   mail         .*sendmail ended with 1")
        ((_, body),) = hook.accepted
        self.assertEqual((body["test"], body["alarm"]["kind"]), (True, "test"))
        self.expect(2, "doctor", "--test-alarms", stderr="needs the project file")
        for wrong, said in (('webhook = "https://example.org/x"', "https is not supported"), ('mqtt = "on"', "there is no broker"),
                            ('mail = ["ada"]', "is not an address"), ('severity = "loud"', "severity")):
            self.project.write_text(text + f"\n[serve.notify]\n{wrong}\n")
            self.expect(3, "serve", self.project_name, "--port", "0", stderr=said)


if __name__ == "__main__":
    unittest.main()
