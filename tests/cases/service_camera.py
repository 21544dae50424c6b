"""`knothe serve` with a GigE camera: Aravis' own fake camera on this machine (fake_camera.cpp) shows drawn pictures. Judged by
`knothe assimilate` on the same pictures. Skipped where the program is built without Aravis."""
import fcntl
import json
import math
import os
import pathlib
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import unittest

from service_support import Broker, Events, ServiceCase
from support import SOURCE

BUILD = pathlib.Path(os.environ["KNOTHE_BUILD"])
FAKE_CAMERA = BUILD / "tests/cases/fake_camera"
FRAME_RATE = 3 if "KNOTHE_SANITIZED" in os.environ else 10  # at which no frame is lost on a busy machine
LINE_KEYS = ("time", "used", "missing", "mean", "covariance", "quantiles", "log_evidence", "log_evidence_increment", "monitor")


class FakeCamera:
    """A camera that shows the pictures of a folder, one a frame; there can be one on a machine at a time."""

    def __init__(self, folder, *arguments):
        self.folder, self.arguments = folder, arguments

    def start(self, *arguments):
        self.process = subprocess.Popen([FAKE_CAMERA, "KN1", self.folder / "pictures", "--heartbeat", "1500", *self.arguments, *arguments],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout.readline() == "ready\n"
        return self

    def started(self):
        """Unix time, µs, of the first picture; waits for it."""
        word, when = self.process.stdout.readline().split()
        assert word == "start"
        return when

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.process.stdin.close()


has_aravis = FAKE_CAMERA.exists()
needs_aravis = unittest.skipUnless(has_aravis, "knothe is built without Aravis (libaravis-dev)")


class Test(ServiceCase):
    project_name = "picture_assimilation.toml"

    def setUp(self):
        super().setUp()
        lock = open(pathlib.Path(tempfile.gettempdir()) / "knothe-fake-camera.lock", "w")
        self.addCleanup(lock.close)
        fcntl.flock(lock, fcntl.LOCK_EX)
        self.edit("every = 3", "every = 1")
        self.edit('kind = "transport"', 'kind = "auto"')  # keeps up with a camera on a loaded machine
        self.live = self.folder / "live"

    def draw(self, steps=12):
        """A picture of each step of the model."""
        if steps != 12:
            (self.folder / "model.h5").unlink()
            (self.folder / "made").mkdir()
            subprocess.run([BUILD / "tests/cases/make_snapshots", self.folder / "made", str(steps)], check=True, capture_output=True)
            self.expect(0, "model", "import", "made/snapshots.h5", "-o", "model.h5")
        self.expect(0, "simulate", self.project_name, "--model", "model.h5", "--images", "-o", "pictures")
        self.pictures = sorted((self.folder / "pictures").glob("picture_*.tif"))
        self.live.mkdir()
        for name in ("reference_1.tif", "reference_2.tif"):
            shutil.copy(self.folder / "pictures" / name, self.live / name)

    def camera(self, *arguments):
        camera = FakeCamera(self.folder, *arguments)
        self.addCleanup(lambda: camera.process.poll() is None and camera.kill())
        return camera.start()

    def serve_camera(self, options, keep=True, size="640, 290"):
        where = 'keep = "live/"\n' if keep else ""
        return self.serve(extra=f"period = 60.0\n[serve.camera]\n{where}region = [0, 0, {size}]\npacket_size = 60000\n{options}")

    def metric(self, service, name):
        lines = [line for line in service.get("/metrics")[1].decode().splitlines() if line.startswith(f"knothe_camera_{name}{{")]
        self.assertEqual(len(lines), 1, lines)
        return float(lines[0].split()[-1])

    def messages(self, service):
        return [alarm["message"] for alarm in service.get("/v1/alarms")[1]["alarms"]]

    def wait_for_step(self, service, step):
        """Until the line of a step is there: `step` counts from 0."""
        service.wait_until(lambda: (service.get("/v1/status")[1].get("step", -1)) >= step)
        service.settled()
        return service.states()

    def expect_equal(self, lines, others):
        self.assertEqual([line["step"] for line in lines], [other["step"] for other in others])
        for line, other in zip(lines, others):
            for key in LINE_KEYS:
                self.assertEqual(line[key], other[key], f"step {line['step']}")
            for name, forecast in other["forecast"].items():
                self.assertEqual(line["forecast"][name], forecast)

    def kept(self):
        """Names in the table of frames that were kept, those of frames that did not come included."""
        return [line.split(",")[1] for line in (self.live / "pictures.csv").read_text().splitlines()[1:]]

    def expect_kept(self, numbers):
        """Those frames were kept, byte by byte the pictures of their numbers."""
        names = sorted(path.name for path in self.live.glob("frame_*"))
        self.assertEqual(names, [f"frame_{number:06}.tif" for number in numbers])
        for number in numbers:
            self.assertEqual((self.live / f"frame_{number:06}.tif").read_bytes(), self.pictures[number].read_bytes())

    def frames_become_the_lines_of_assimilate(self, steps, options):
        self.draw(steps)
        expected = self.assimilate()
        service = self.serve_camera(options)
        self.camera()
        self.expect_equal(self.wait_for_step(service, steps - 1), expected)
        service.wait_until(lambda: "the last model time has passed" in service.logged())
        self.expect_kept(range(steps))
        self.assertEqual([self.metric(service, f"{name}_total") for name in ("incomplete_frames", "lost_frames", "reconnects")], [0, 0, 0])
        self.assertGreaterEqual(self.metric(service, "frames_total"), steps)
        self.assertEqual(self.metric(service, "connected"), 1)
        status, headers, _ = service.request("GET", "/v1/picture?step=3")
        self.assertEqual((status, headers["Content-Type"]), (200, "image/png"))
        service.stop()
        # What was kept is a folder for `knothe assimilate`.
        self.project.write_text(self.project.read_text().replace('pictures = "pictures/"', 'pictures = "live/"'))
        self.expect_equal(self.assimilate(), expected)

    @needs_aravis
    def test_frames_become_the_lines_of_assimilate(self):
        self.frames_become_the_lines_of_assimilate(12, f'serial = "KN1"\nframe_rate = {FRAME_RATE}\nexposure = 0.004\ngain = 2\n')

    @needs_aravis
    def test_another_test_begins_with_frame_0_in_a_folder_of_its_own(self):
        self.draw()
        self.camera()
        service = self.serve_camera(f'serial = "KN1"\nframe_rate = {FRAME_RATE}\n')
        self.wait_for_step(service, 11)
        begin = lambda: service.post("/v1/tests", {"name": "second", "by": "Ada"})
        answer = begin()
        self.expect_error(answer, 409, "NotBegun")
        self.assertIn("reference", answer[1]["error"]["message"])
        self.assertEqual(service.get("/v1/status")[1]["step"], 11)
        (self.live / "second").mkdir()
        for name in ("reference_1.tif", "reference_2.tif"):
            shutil.copy(self.live / name, self.live / "second" / name)
        status, entry = begin()
        self.assertEqual((status, entry.get("name")), (200, "second"), entry)
        self.wait_for_step(service, 3)
        self.assertEqual([line["step"] for line in service.states()][:4], [0, 1, 2, 3])
        self.assertEqual([message for message in self.messages(service) if "not seen" in message or "clock" in message], [])
        self.assertEqual(self.metric(service, "connected"), 1)
        service.stop()
        self.expect_kept(range(12))
        # The camera shows its last picture for ever.
        self.live = self.live / "second"
        self.assertEqual(self.kept()[:4], [f"frame_{number:06}.tif" for number in range(4)])
        self.assertEqual((self.live / "frame_000000.tif").read_bytes(), self.pictures[11].read_bytes())

    @needs_aravis
    def test_a_hundred_frames_at_10_hz(self):
        self.frames_become_the_lines_of_assimilate(100, 'address = "127.0.0.1"\nframe_rate = 10\n')

    @needs_aravis
    def test_a_camera_a_broker_and_viewers_for_days(self):
        """The soak: a structure with a camera, whose specimens change, beside one with a broker and a sender by HTTP, and viewers
        of both that come and go; 10⁵ data at night."""
        count, parts = int(os.environ.get("KNOTHE_SOAK", "100")), 10
        self.draw()
        shutil.copy(SOURCE / "assimilation.toml", self.folder)
        broker = Broker(self.folder)
        self.addCleanup(broker.stop)
        self.camera()
        service = self.serve(extra=f'others = ["assimilation.toml"]\nmqtt = {{ broker = "127.0.0.1:{broker.port}" }}\nperiod = 60.0\n'
                                   '[serve.camera]\nserial = "KN1"\nkeep = "live/"\nregion = [0, 0, 640, 290]\npacket_size = 60000\nframe_rate = 10\n')
        service.wait_until(lambda: service.logged().count("subscribed at the MQTT broker") == 4)
        beside = lambda: service.get("/v1/status?site=assimilation")[1]
        of_process = lambda name: int(re.search(rf"^{name}:\s+(\d+)", pathlib.Path(f"/proc/{service.process.pid}/status").read_text(), re.M)[1])
        descriptors = lambda: len(os.listdir(f"/proc/{service.process.pid}/fd"))
        connection, sent, by_broker, memory = service.connection(), 0, 0, None
        for part in range(parts):
            if part > 0:
                specimen = self.live / f"specimen-{part}"
                specimen.mkdir()
                for reference in self.live.glob("reference_*.tif"):
                    shutil.copy(reference, specimen)
                answer = service.post("/v1/tests", {"name": specimen.name, "by": "Ada"})
                self.assertEqual(answer[0], 200, answer)
            viewers = [Events(service, f"?site={site}") for site in ("picture_assimilation", "assimilation") for _ in range(4)]
            for _ in range(count // parts):
                datum = {**self.data[sent % 12], "site": "assimilation", "session": f"day {sent // 1200}", "seq": sent}
                self.assertEqual(service.send(datum, connection)[0], 200)
                sent += 1
                if sent % 20 == 0:
                    datum = {**datum, "source": "gauge", "session": "broker", "seq": by_broker}
                    broker.publish("knothe/v1/assimilation/gauge/data", json.dumps(datum).encode())
                    by_broker += 1
            self.wait_for_step(service, 11)
            service.wait_until(lambda: (s := beside())["records"] == sent + by_broker and s["pending"] == s["behind"] == 0, 100 + count / 100)
            for viewer in viewers:
                viewer.wait_for(lambda v: v.steps())
                viewer.close()
            service.wait_until(lambda: "knothe_event_streams 0\n" in service.get("/metrics")[1].decode())
            if part == 1:
                memory, taken, open_files, threads = of_process("VmRSS"), sent + by_broker, descriptors(), of_process("Threads")
        service.wait_until(lambda: descriptors() <= open_files + 1 and of_process("Threads") <= threads)
        connection.close()
        tests = service.get("/v1/tests")[1]["tests"]
        self.assertEqual(sorted(test["name"] for test in tests), ["", *(f"specimen-{part}" for part in range(1, parts))])
        self.assertGreaterEqual(self.metric(service, "frames_total"), 12 * parts)
        self.assertEqual((beside()["quarantined"], beside()["conflicts"], beside()["malformed"]), (0, 0, 0))
        if "KNOTHE_SANITIZED" not in os.environ:
            grown = 1024 * (of_process("VmRSS") - memory)
            self.assertLess(grown, 16e6 + 1000 * (sent + by_broker - taken), f"{grown} bytes for {sent + by_broker - taken} data")
        self.assertEqual(service.stop(), 130)

    def triggered_frames_become_the_lines_of_assimilate(self, options, *camera, **size):
        """Not kept, of the first camera that is found."""
        self.draw()
        self.edit("[dic]", '[dic]\nreferences = ["reference_1.tif", "reference_2.tif"]')
        expected = self.assimilate()
        self.camera(*camera)
        service = self.serve_camera(options, keep=False, **size)
        self.expect_equal(self.wait_for_step(service, 11), expected)
        self.assertEqual(self.metric(service, "lost_frames_total"), 0)
        self.assertEqual([path.name for path in self.folder.rglob("frame_*")], [])
        self.expect_error(service.get("/v1/picture?step=3"), 404, "NoPicture")

    @needs_aravis
    def test_the_service_triggers(self):
        """With pictures of 12 bits, and half the size: the first frame comes before Aravis has enlarged the socket's buffer."""
        for old, new in (("noise = 1\n", "noise = 1\nbit_depth = 12\n"), ("width = 640", "width = 320"), ("height = 290", "height = 145"),
                         ("scale = 4e-4", "scale = 8e-4"), ("origin = [320, 270]", "origin = [160, 135]")):
            self.edit(old, new)
        self.triggered_frames_become_the_lines_of_assimilate('trigger = "software"\nframe_rate = 10\npixel_format = "Mono16"\n', "--rate", "10",
                                                             size="320, 145")

    @needs_aravis
    def test_a_line_triggers(self):
        self.triggered_frames_become_the_lines_of_assimilate('trigger = "hardware"\ntrigger_line = "Line0"\n', "--trigger", "10")

    def expect_gap(self, service, steps):
        """One gap was reported, and nothing else is missing or was taken twice: every frame that is there is the picture of its
        number, and the posterior is that of those pictures."""
        lines = self.wait_for_step(service, steps - 1)
        (said,) = [message for message in self.messages(service) if "were not seen" in message]
        first, last = map(int, re.match(r"frames (\d+) to (\d+) were not seen: the camera or the service was away$", said).groups())
        seen = [*range(first), *range(last + 1, steps)]
        self.assertEqual([line["step"] for line in lines], seen)
        self.assertEqual(service.settled()["records"], len(seen))
        (self.live / f"frame_{first:06}.tif").unlink(missing_ok=True)  # kept, and then killed before it was in the journal
        # On a busy machine a frame may lose packets: it is missing then, and said to be.
        lost = [line["step"] for line in lines if line["used"] == 0]
        self.assertLessEqual(len(lost), 3)
        self.expect_kept([number for number in seen if number not in lost])
        self.assertEqual(self.kept(), [f"frame_{number:06}.tif" for number in seen])
        self.project.write_text(self.project.read_text().replace('pictures = "pictures/"', 'pictures = "live/"'))
        judge = self.assimilate()
        self.expect_equal(lines[:first], judge[:first])
        # After the gap the first picture starts from coarse to fine, and ends within the correlation's tolerance.
        for line, other in zip(lines, judge):
            for k in range(2):
                self.assertAlmostEqual(line["mean"][k], other["mean"][k], delta=0.02 * math.sqrt(other["covariance"][k][k]))
        return first, last

    @needs_aravis
    def test_a_restart_reports_the_gap_and_takes_nothing_twice(self):
        self.draw(70)
        service = self.serve_camera('serial = "KN1"\nframe_rate = 10\n')
        self.camera()
        self.wait_for_step(service, 6)
        service.kill()
        # As if it had been killed after its last frame was in the journal and before that was in the table.
        with sqlite3.connect(f"file:{self.project.with_suffix('.journal')}?mode=ro", uri=True) as journal:
            (stored,) = journal.execute("SELECT count(*) FROM measurement").fetchone()
        table = self.live / "pictures.csv"
        table.write_text("".join(table.read_text().splitlines(keepends=True)[:stored]))
        service.start()
        self.expect_gap(service, 70)

    @needs_aravis
    def test_a_camera_that_was_away_is_read_again(self):
        self.draw(70)
        camera = self.camera()
        service = self.serve_camera('serial = "KN1"\nframe_rate = 5\n')
        self.wait_for_step(service, 6)
        start = camera.started()
        camera.kill()
        service.wait_until(lambda: self.metric(service, "connected") == 0)
        self.assertTrue(any("the camera is away: " in message for message in self.messages(service)))
        camera.start("--start", start)
        self.expect_gap(service, 70)
        self.assertEqual(self.metric(service, "reconnects_total"), 1)
        self.assertEqual(self.metric(service, "connected"), 1)

    @needs_aravis
    def test_frames_that_lose_packets_are_missing(self):
        self.draw()
        service = self.serve_camera('serial = "KN1"\nframe_rate = 10\n')
        self.camera("--lose", "4", "6")
        lines = self.wait_for_step(service, 11)
        whole = [0, 1, 2, 3, 7, 8, 9, 10, 11]
        self.assertEqual([line["step"] for line in lines if line["missing"] == 0], whole)
        self.assertEqual([line["used"] for line in lines[4:7]], [0, 0, 0])
        self.assertEqual(self.metric(service, "lost_frames_total"), 3)
        self.assertGreaterEqual(self.metric(service, "incomplete_frames_total"), 1)
        self.assertTrue(any(message.startswith("missing: frames 4 to 6: incomplete: ") for message in self.messages(service)))
        self.expect_kept(whole)
        self.assertEqual(self.kept(), [f"frame_{number:06}.tif" for number in range(12)])  # three of which are not there
        self.project.write_text(self.project.read_text().replace('pictures = "pictures/"', 'pictures = "live/"'))
        self.expect_equal(lines, self.assimilate())

    @needs_aravis
    def test_what_the_camera_refuses_is_said(self):
        self.draw()
        self.camera()
        service = self.serve_camera('serial = "KN1"\npixel_format = "Mono99"\n')
        service.wait_until(lambda: any("serve.camera.pixel_format: " in message for message in self.messages(service)))

    def test_options_that_do_not_go_together(self):
        self.project.write_text(self.project.read_text() + """
[serve]
watch_pictures = "live/"
[serve.camera]
address = "10.0.0.2"
serial = "KN1"
region = [0, 0, 640]
trigger = "software"
""")
        outcome = self.expect(3, "check", self.project_name)
        for text in ('[serve.camera] has both "address" and "serial": give one', '"serve.camera.region" must be four integers, [x, y, width, height]',
                     'a software trigger needs "frame_rate"', '"serve.watch_pictures" and [serve.camera] both say where pictures come from'):
            self.assertIn(text, outcome.err)

    def test_without_references_it_says_how_to_give_them(self):
        self.project.write_text(self.project.read_text() + "\n[serve.camera]\n")
        outcome = self.expect(3, "serve", self.project_name, "--port", "0")
        self.assertIn("[serve.camera] keeps no frames, and there is no picture whose name begins with `reference`" if has_aravis
                      else "install libaravis-dev and libusb-1.0-0-dev and build it again", outcome.err)


if __name__ == "__main__":
    result = unittest.main(exit=False).result
    sys.exit(77 if result.skipped and result.wasSuccessful() else 0 if result.wasSuccessful() else 1)
