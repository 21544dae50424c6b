"""`knothe serve` with a folder in which a camera leaves its pictures. Judged by `knothe assimilate` on the same pictures."""
import contextlib
import math
import os
import pathlib
import random
import re
import shutil
import sqlite3
import struct
import time
import unittest
import zlib

import analytic_model
from service_support import ServiceCase


def tiff_layout(content):
    """Width, height, bytes of a pixel and where the rows begin, of a little-endian uncompressed TIFF."""
    (directory,) = struct.unpack_from("<I", content, 4)
    (count,) = struct.unpack_from("<H", content, directory)
    tags = {}
    for k in range(count):
        tag, kind, number, value = struct.unpack_from("<HHII", content, directory + 2 + 12 * k)
        tags[tag] = struct.unpack_from("<H", content, directory + 10 + 12 * k)[0] if kind == 3 and number == 1 else (value, number)
    offsets = tags[273]
    first = struct.unpack_from("<I", content, offsets[0])[0] if isinstance(offsets, tuple) and offsets[1] > 1 else offsets[0]
    size = lambda tag: tags[tag][0] if isinstance(tags[tag], tuple) else tags[tag]
    return size(256), size(257), size(258) // 8, first


class Test(ServiceCase):
    project_name = "picture_assimilation.toml"

    def setUp(self):
        super().setUp()
        self.expect(0, "simulate", self.project_name, "--model", "model.h5", "--images", "-o", "pictures")
        self.camera, self.live = self.folder / "pictures", self.folder / "live"
        self.pictures = sorted(path.name for path in self.camera.glob("picture_*.tif"))
        self.live.mkdir()
        for name in ("reference_1.tif", "reference_2.tif", "pictures.csv"):
            shutil.copy(self.camera / name, self.live / name)

    def watch(self, settle=0.1):
        return self.serve(extra=f'watch_pictures = "live/"\nsettle = {settle}\nperiod = 60.0\n')

    def cover_a_corner(self, name):
        """A black patch on a picture: the elements under it are rejected, and the picture has a noise of its own."""
        content = bytearray((self.camera / name).read_bytes())
        width, height, size, rows = tiff_layout(content)
        for y in range(height // 3, 2 * height // 3):
            start, end = (rows + size * (y * width + x) for x in (width // 5, width // 3))
            content[start:end] = bytes(end - start)
        (self.camera / name).write_bytes(content)

    def rename_into_place(self, name):
        shutil.copy(self.camera / name, self.live / ".arriving")
        os.rename(self.live / ".arriving", self.live / name)

    def wait_for_records(self, service, count):
        service.wait_until(lambda: service.get("/v1/status")[1]["records"] >= count)
        return service.settled(count)

    def test_pictures_become_the_lines_of_assimilate(self):
        self.cover_a_corner(self.pictures[-1])
        expected = self.assimilate()
        service = self.watch(settle=0.3)
        for k, name in enumerate(self.pictures):
            if k == 1:  # written slowly, in pieces shorter than the time to settle
                content = (self.camera / name).read_bytes()
                with open(self.live / name, "wb") as file:
                    for piece in range(5):
                        file.write(content[piece * len(content) // 5:(piece + 1) * len(content) // 5])
                        file.flush()
                        time.sleep(0.04)
            else:
                self.rename_into_place(name)
            self.wait_for_records(service, k + 1)
        lines = service.states()
        self.assertEqual(len(lines), len(expected))
        for line, other in zip(lines, expected):
            for key in ("time", "used", "missing", "mean", "covariance", "quantiles", "log_evidence", "log_evidence_increment", "monitor"):
                self.assertEqual(line[key], other[key])
            for name, forecast in other["forecast"].items():
                self.assertEqual(line["forecast"][name], forecast)
        self.assertIn("model", [other["picture"]["start"] for other in expected])
        self.assertGreater(max(other["picture"]["elements_rejected"] for other in expected), 0)
        self.expect_pictures(service)

    def expect_pictures(self, service):
        """The picture of a step, by what the service found: never by a name that a request gives."""
        corners = service.get("/v1/description")[1]["picture"]["corners"]
        self.assertEqual([len(corner) for corner in corners], [3, 3, 3])
        sensors = service.get("/v1/mesh")[1]["sensors"]
        self.assertLess(corners[0][0], min(s["x"] for s in sensors))  # the structure is in the picture
        self.assertGreater(corners[1][0], max(s["x"] for s in sensors))
        self.assertLess(corners[2][1], min(s["y"] for s in sensors))
        step = service.states()[0]["step"]
        status, headers, first = service.request("GET", f"/v1/picture?step={step}")
        self.assertEqual((status, headers["Content-Type"], first[:8]), (200, "image/png", b"\x89PNG\r\n\x1a\n"))
        width, height = struct.unpack(">II", first[16:24])
        self.assertAlmostEqual(width / height, math.dist(*corners[:2]) / math.dist(corners[0], corners[2]), delta=0.02)
        for name in ("../model.h5", "/etc/passwd", "reference_1.tif"):
            self.assertEqual(service.request("GET", f"/v1/picture?step={step}&file={name}&name={name}&path={name}")[2], first)
        self.expect_error(service.get("/v1/picture?step=../../model.h5"), 400, "Malformed")
        for path in self.live.glob("picture_*"):
            path.unlink()
        self.expect_error(service.get(f"/v1/picture?step={step}"), 404, "NoPicture")

    def test_a_restart_takes_what_came_meanwhile_and_nothing_twice(self):
        service = self.watch()
        for k, name in enumerate(self.pictures[:2]):
            self.rename_into_place(name)
            self.wait_for_records(service, k + 1)
        before = [line["mean"] for line in service.states()]
        service.kill()
        for name in self.pictures[2:]:
            self.rename_into_place(name)
        service.start()
        self.wait_for_records(service, len(self.pictures))
        lines = service.states()
        self.assertEqual([line["mean"] for line in lines[:2]], before)
        for line, other in zip(lines, self.assimilate()):
            for k in range(2):
                self.assertAlmostEqual(line["mean"][k], other["mean"][k], delta=0.02 * math.sqrt(other["covariance"][k][k]))
        # The same name with another content: what is in the journal stays.
        shutil.copy(self.camera / self.pictures[0], self.live / self.pictures[1])
        time.sleep(0.6)
        self.assertEqual(service.settled()["records"], len(self.pictures))
        self.assertEqual([line["mean"] for line in service.states()], [line["mean"] for line in lines])

    def test_a_load_cell_by_http_beside_the_pictures(self):
        """Force and picture of a step in any order, by two ways: as `assimilate` of both, and after a restart the same lines."""
        noise = random.Random(11)
        times = [float(line.split(",")[0]) for line in (self.camera / "pictures.csv").read_text().splitlines()[1:]]
        forces = [analytic_model.reaction_force(t, 1.06, 0.96) + noise.gauss(0, 2) for t in times]
        (self.folder / "machine.csv").write_text("time,reaction_force\n" + "".join(f"{t!r},{f!r}\n" for t, f in zip(times, forces)))
        self.cover_a_corner(self.pictures[-1])
        self.edit('pictures = "pictures/"\n', 'pictures = "pictures/"\nfile = "machine.csv"\n\n[data.std]\nreaction_force = 2.0\n\n')
        expected = self.assimilate()
        self.edit('file = "machine.csv"\n', "")
        service = self.watch()
        for k, (name, t, force) in enumerate(zip(self.pictures, times, forces)):
            cell = {"source": "cell", "session": "s", "seq": k, "time": t, "series": {"reaction_force": force}}
            if k % 2:
                self.assertEqual(service.send(cell)[0], 200)
            self.rename_into_place(name)
            self.wait_for_records(service, 2 * k + 1 + k % 2)
            if not k % 2:
                self.assertEqual(service.send(cell)[0], 200)
        service.settled(2 * len(times))
        lines = service.states()
        for line, other in zip(lines, expected):
            self.assertEqual(line["data"], 2)
            for k in range(2):
                self.assertAlmostEqual(line["mean"][k], other["mean"][k], delta=0.02 * math.sqrt(other["covariance"][k][k]))
                self.assertAlmostEqual(line["covariance"][k][k] / other["covariance"][k][k], 1, delta=0.02)
        wrong = {"source": "cell", "session": "s", "seq": 99, "time": times[0]}
        for content, text in (({"series": {"reaction_forc": 1.0}}, 'does not take the series "reaction_forc" (did you mean "reaction_force"?)'),
                              ({"series": {"reaction_force": 1.0}, "values": []}, '"series" stands in place of "values"'),
                              ({"series": {}}, "an object of numbers by name"), ({"series": {"reaction_force": "1"}}, "neither a number nor null")):
            answer = service.send({**wrong, **content})
            self.expect_error(answer, 400, "Malformed")
            self.assertIn(text, answer[1]["error"]["message"])
        service.kill()
        service.start()
        service.settled(2 * len(times))
        self.assertEqual([(line["mean"], line["log_evidence"]) for line in service.states()], [(line["mean"], line["log_evidence"]) for line in lines])

    def test_the_clock_of_a_load_cell_beside_watched_pictures_may_be_off(self):
        """Its forces are those of 0.02 earlier: the offset is found with the parameters."""
        noise = random.Random(11)
        times = [float(line.split(",")[0]) for line in (self.camera / "pictures.csv").read_text().splitlines()[1:]]
        self.edit('pictures = "pictures/"\n', 'pictures = "pictures/"\ntime_offset_std = 0.05\n\n[data.std]\nreaction_force = 2.0\n\n')
        service = self.watch()
        for k, (name, t) in enumerate(zip(self.pictures, times)):
            self.rename_into_place(name)
            force = analytic_model.reaction_force(t - 0.02, 1.06, 0.96) + noise.gauss(0, 2)
            self.assertEqual(service.send({"source": "cell", "session": "s", "seq": k, "time": t, "series": {"reaction_force": force}})[0], 200)
            self.wait_for_records(service, 2 * k + 2)
        service.settled(2 * len(times))
        last = service.states()[-1]
        self.assertEqual(last["verdict"]["level"], "ok")
        self.assertAlmostEqual(last["nuisances"]["time_offset"]["mean"], 0.02, delta=0.01)
        for k, truth in enumerate((1.06, 0.96)):
            self.assertLess(abs(last["mean"][k] - truth), 3 * math.sqrt(last["covariance"][k][k]))

    def test_a_bad_picture_is_missing_and_said(self):
        service = self.watch()
        content = (self.camera / self.pictures[0]).read_bytes()
        (self.live / self.pictures[0]).write_bytes(content[: len(content) // 3])
        (self.live / "picture_9999.tif").write_bytes(content)  # not in the table of times
        self.rename_into_place(self.pictures[1])
        self.wait_for_records(service, 2)
        first, second = service.states()
        self.assertEqual(first["used"], 0)
        self.assertEqual(second["missing"], 0)
        alarms = lambda: " ".join(alarm["message"] for alarm in service.get("/v1/alarms")[1]["alarms"])
        service.wait_until(lambda: "picture_9999.tif" in alarms() and self.pictures[0] in alarms())
        said = alarms()
        self.assertIn("missing: ", said)
        self.assertIn("does not say its time", said)

    def alarms(self, service):
        return [alarm["message"] for alarm in service.get("/v1/alarms")[1]["alarms"]]

    def wait_for_alarms(self, service, *texts):
        service.wait_until(lambda: all(any(text in message for message in self.alarms(service)) for text in texts))

    def files_in_journal(self):
        with contextlib.closing(sqlite3.connect(f"file:{self.project.with_suffix('.journal')}?mode=ro", uri=True)) as journal:
            return {name for name, in journal.execute("SELECT name FROM file")}

    def test_pictures_of_one_number_are_said_and_one_of_them_is_taken(self):
        """As stereo programs write them: shot-0003_1.tif is camera 1's. Each file leaves a word, also after a restart."""
        (self.live / "pictures.csv").unlink()
        names = ["shot-0001_1.tif", "shot-0003_1.tif", "shot-0006_1.tif", "shot-0009_1.tif"]
        for name, picture in zip(names, self.pictures * 2):
            shutil.copy(self.camera / picture, self.live / name)
        service = self.watch()
        self.wait_for_alarms(service, *(f"{name}: is not taken: its number 1 is that of shot-0001_1.tif" for name in names[1:]))
        self.assertEqual(service.settled()["records"], 1)
        self.assertIn("shot-0001_1.tif", self.files_in_journal())  # noted with its datum
        service.wait_until(lambda: len(self.files_in_journal()) == 4)  # no file without its alarm
        service.kill()
        service.start()
        self.assertEqual(service.settled()["records"], 1)
        self.assertEqual(sum("shot-0001_1.tif" in message for message in self.alarms(service)), 3)

    def test_what_is_no_picture_holds_nothing_up_and_is_said(self):
        """Pipes (a share that hangs), links, a folder, a header of 400 million pixels; the pictures behind them are measured."""
        os.mkfifo(self.live / "a_pipe_0001.tif")
        (self.folder / "private.csv").write_text("a secret\n")
        os.symlink(self.folder / "private.csv", self.live / "b_link_0002.tif")
        (self.live / "c_folder_0003.tif").mkdir()
        chunk = lambda kind, body: struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        huge = zlib.compressobj(9)
        body = b"".join(huge.compress(bytes(20001)) for _ in range(20000)) + huge.flush()
        name = self.pictures[0]
        table = (self.live / "pictures.csv").read_text()
        (self.live / "pictures.csv").write_text(table.replace(name, "d_huge.png"))
        (self.live / "d_huge.png").write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 20000, 20000, 8, 0, 0, 0, 0))
                                               + chunk(b"IDAT", body) + chunk(b"IEND", b""))
        service = self.watch()
        for name in self.pictures[1:3]:
            self.rename_into_place(name)
        self.wait_for_records(service, 3)
        self.wait_for_alarms(service, *(f"{name}: is a symbolic link, a pipe, a device or a folder" for name in
                                        ("a_pipe_0001.tif", "b_link_0002.tif", "c_folder_0003.tif")))
        self.wait_for_alarms(service, "a picture of 20000 × 20000 pixels, more than the")
        self.assertNotIn("a secret", service.logged() + " ".join(self.alarms(service)))
        self.assertNotIn("/proc/self", service.logged())
        peak = int(re.search(r"VmHWM:\s+(\d+) kB", pathlib.Path(f"/proc/{service.process.pid}/status").read_text())[1])
        self.assertLess(peak, 600_000)
        self.assertEqual(service.get("/livez")[0], 200)
        self.assertEqual(service.stop(), 130)

    def test_a_table_of_times_that_is_a_pipe_is_said(self):
        table = (self.live / "pictures.csv").read_text()
        (self.live / "pictures.csv").unlink()
        os.mkfifo(self.live / "pictures.csv")
        service = self.watch()
        self.rename_into_place(self.pictures[0])
        self.wait_for_alarms(service, "pictures.csv: is a symbolic link, a pipe")
        os.unlink(self.live / "pictures.csv")
        (self.live / "pictures.csv").write_text(table)
        self.rename_into_place(self.pictures[1])
        self.wait_for_records(service, 1)
        self.assertEqual(service.stop(), 130)

    def test_a_table_of_times_in_another_order_brings_nothing_twice(self):
        service = self.watch()
        for k, name in enumerate(self.pictures[:2]):
            self.rename_into_place(name)
            self.wait_for_records(service, k + 1)
        service.stop()
        head, *lines = (self.live / "pictures.csv").read_text().splitlines()
        (self.live / "pictures.csv").write_text("\n".join([head, *lines[::-1]]) + "\n")
        service.start()
        time.sleep(0.6)
        self.assertEqual(service.settled()["records"], 2)

    def test_a_picture_of_what_cannot_be_is_quarantined(self):
        service = self.serve(extra='watch_pictures = "live/"\nsettle = 0.1\nlimits = { displacement = 1e-9 }\n')
        self.rename_into_place(self.pictures[0])
        self.wait_for_records(service, 1)
        self.assertEqual(service.states(), [])
        (held,) = service.get("/v1/quarantine")[1]["quarantined"]
        self.assertIn("beyond the limit of 1e-09 m", held["reason"])
        self.assertEqual([a["severity"] for a in service.get("/v1/alarms")[1]["alarms"]], ["alarm"])

    def test_a_picture_that_was_not_finished_is_taken_when_it_is(self):
        service = self.watch(settle=0.3)  # what cannot be read may rest ten times as long
        name = self.pictures[0]
        content = (self.camera / name).read_bytes()
        with open(self.live / name, "wb") as file:
            file.write(content[:1000])
            file.flush()
            time.sleep(0.6)  # longer than the time to settle
            file.write(content[1000:])
        self.wait_for_records(service, 1)
        self.assertEqual(service.get("/v1/state")[1]["missing"], 0)


if __name__ == "__main__":
    unittest.main()
