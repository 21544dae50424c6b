"""The full-order model asked while a test is watched: a program that the test holds, breaks and counts the runs of. What it says is
compared with `knothe assimilate`, which asks the same."""
import os
import random
import re
import shutil
import sys
import unittest

from service_support import Service, comparable
from support import KNOTHE, REPOSITORY, Case, write_csv

# A full-order run as the test wants it: it waits for a token (or for all to be free), may fail, and leaves a line. One whose service was
# killed does not take a token of those that come later.
GATE = """
import os, pathlib, subprocess, sys, time
folder = pathlib.Path(sys.argv[1])
born = (folder / "generation").read_text()
(folder / "solvers").open("a").write(f"{os.getpid()}\\n")
while not (folder / "free").exists():
    try:
        os.rmdir(folder / "token")
        break
    except OSError:
        time.sleep(0.01)
if (folder / "generation").read_text() != born:
    sys.exit(9)
if (folder / "broken").exists():
    sys.exit("the licence server does not answer")
(folder / "runs").open("a").write(" ".join(sys.argv[2:]) + "\\n")
sys.exit(subprocess.call([sys.executable, "storeys.py", *sys.argv[2:]]))
"""
STDS = {"acceleration_1": 0.1, "acceleration_2": 0.1, "drift": 2e-4}


class Test(Case):
    def setUp(self):
        super().setUp()
        self.project_name = "storeys.toml"
        for name in ("storeys.toml", "storeys.py"):
            shutil.copy(REPOSITORY / "examples" / "command" / name, self.folder / name)
        sys.path.insert(0, str(self.folder))
        self.addCleanup(sys.path.remove, str(self.folder))
        (self.folder / "gate.py").write_text(GATE)
        self.generation(0)
        self.free()
        self.edit('["python3", "storeys.py", "{{k1}}", "{{damping}}"]',
                  f'["{sys.executable}", "gate.py", "{self.folder}", "{{{{k1}}}}", "{{{{damping}}}}"]')
        self.edit('files = ["storeys.py"]', 'files = ["storeys.py", "gate.py"]')
        self.edit("retries = 1", "retries = 0")
        self.edit("nodes = 13", "nodes = 4")
        self.edit("nodes = 7", "nodes = 3")
        self.edit('data = "data.h5"', 'data = "data.csv"')
        self.edit("[offline]", '[method]\nverify = "full-order"\nverify_runs = 4\n\n[offline]')
        self.expect(0, "offline", self.project_name, "-o", "storeys.h5")
        self.write_data()
        self.runs(forget=True)
        (self.folder / "solvers").unlink()

    def write_data(self, steps=slice(None)):
        """Noisy data of a direct run; the service's, and in a file."""
        import storeys
        noise, rows, self.data = random.Random(7), [], []
        for time_, *values in storeys.solve(0.913e6, 1730.0):
            noisy = [value + noise.gauss(0, std) for value, std in zip(values, STDS.values())]
            self.data.append({"source": "rig", "session": "s", "seq": len(self.data), "time": time_, "values": noisy})
        self.data = self.data[steps]
        for datum in self.data:
            for (name, std), value in zip(STDS.items(), datum["values"]):
                rows.append({"time": repr(datum["time"]), "sensor": name, "x": "", "y": "", "z": "", "component": name,
                             "value": repr(value), "std": std})
        write_csv(self.folder / "data.csv", rows)

    def generation(self, number):
        (self.folder / "generation").write_text(str(number))

    def free(self):
        (self.folder / "free").touch()

    def hold(self):
        (self.folder / "free").unlink()

    def runs(self, forget=False):
        file = self.folder / "runs"
        lines = file.read_text().splitlines() if file.exists() else []
        if forget:
            file.unlink(missing_ok=True)
        return lines

    def serve(self, **options):
        self.service = Service(self.folder, self.project_name, **options)
        self.addCleanup(lambda: self.service.process and self.service.process.poll() is None and self.service.kill())
        return self.service.start()

    def refinement(self):
        return self.service.get("/v1/status")[1]["refinement"]

    def verified(self, version=None):
        """Waits until nothing is asked any more."""
        kinds = lambda: [e["kind"] for e in self.service.get("/v1/logbook")[1]["logbook"]]
        done = lambda: not self.refinement()["asking"] and (version is None or self.refinement()["version"] >= version)
        self.service.wait_until(done)
        self.service.settled()
        return kinds()

    def lines(self):
        return [comparable(line) for line in self.service.states()]

    def reasons(self):
        return " ".join(reason["message"] for reason in self.lines()[-1]["verdict"]["reasons"])

    def ask(self):
        """As docs/how-to/read-a-verdict.md has it."""
        request = re.search(r"^curl .*?/v1/verify .*? -d '(.*?)'$", (REPOSITORY / "docs/how-to/read-a-verdict.md").read_text(), re.M)
        status, entry = self.service.post("/v1/verify", request[1])
        self.assertEqual((status, entry["kind"], entry["by"]), (200, "verification_asked", "Ada"), entry)

    def test_the_end_of_a_test_gives_what_assimilate_gives(self):
        self.write_data(slice(30, 31))  # one time: both ask at its posterior
        self.edit("verify_runs = 4", "verify_runs = 7")
        outcome = self.run_knothe("assimilate", self.project_name, "--json")
        self.assertIn(outcome.status, (0, 8), str(outcome))
        *batch, end = outcome.lines()
        self.assertGreater(batch[-1]["model_version"], 1)
        asked = self.runs(forget=True)
        # The datum is in the journal, and the test at its end, before anybody asks.
        self.edit('verify = "full-order"', 'verify = "off"')
        self.serve()
        self.service.send(self.data[0] | {"seq": 0})
        self.service.settled(1)
        self.assertEqual(self.service.post("/v1/tests/finish", {"by": "Ada"})[0], 200)
        self.assertEqual(self.service.stop(), 130)
        self.edit('verify = "off"', 'verify = "full-order"')
        self.service.start()
        kinds = self.verified(version=1)
        self.assertEqual(kinds, ["test_finished", "verification"])
        self.assertEqual(sorted(self.runs()), sorted(asked))
        (line,) = self.lines()
        # The service numbers its steps by the model's times.
        self.assertEqual(line | {"step": 0}, comparable(batch[-1]))
        self.assertEqual(self.refinement()["full_order_runs"], len(asked))
        self.assertEqual(self.refinement()["version"], batch[-1]["model_version"])
        entry = self.service.get("/v1/logbook")[1]["logbook"][-1]
        self.assertEqual((entry["by"], entry["version"], entry["full_order_runs"]), ("knothe", line["model_version"], len(asked)))
        self.assertIn(f"{len(asked)} full-order runs: model version", entry["text"])

    def test_a_datum_that_comes_while_the_solver_runs_is_updated_at_once(self):
        self.hold()
        self.serve()
        for datum in self.data[:40]:
            self.service.send(datum)
        self.ask()
        self.service.wait_until(lambda: (self.folder / "solvers").exists() and self.refinement()["asking"])
        for datum in self.data[40:]:
            self.service.send(datum)
        status = self.service.settled(60)
        self.assertEqual((status["refinement"]["asking"], status["refinement"]["version"]), (True, 0))
        self.assertEqual([line["step"] for line in self.lines()], list(range(60)))
        self.assertNotIn("model_version", self.lines()[-1])
        self.assertEqual(self.runs(), [])
        # What is withdrawn meanwhile is not in the answer either.
        self.service.post("/v1/withdraw", {key: self.data[50][key] for key in ("source", "session", "seq")})
        self.service.settled()
        self.free()
        self.verified(version=1)
        self.service.wait_until(lambda: {line.get("model_version") for line in self.lines()} == {self.refinement()["version"]})
        lines = self.lines()
        self.assertEqual([line["step"] for line in lines], [step for step in range(60) if step != 50])
        self.assertEqual(self.service.stop(), 130)
        replayed = self.expect(0, "replay", "storeys.journal", "--json").lines()[:-1]
        self.assertEqual([comparable(line) for line in replayed], lines)

    def test_what_was_solved_before_a_kill_is_kept(self):
        self.hold()
        self.edit("processes = 2", "processes = 1")
        self.serve()
        for datum in self.data[:20]:
            self.service.send(datum)
        self.service.settled(20)
        self.ask()
        kept = lambda: list((self.folder / "storeys.refinement").glob("*/solution-*.h5"))
        (self.folder / "token").mkdir()
        self.service.wait_until(lambda: kept() and len((self.folder / "solvers").read_text().splitlines()) > 1)
        self.service.kill()
        self.generation(1)  # a solver that has outlived its service is not that of the next
        self.free()
        first = self.runs()
        self.service.start()
        kinds = self.verified(version=1)
        self.assertEqual(kinds.count("verification_asked"), 1)
        self.assertEqual(self.runs()[:len(first)], first)
        self.assertEqual(len(set(self.runs())), len(self.runs()), self.runs())
        self.assertEqual(self.refinement()["full_order_runs"], len(self.runs()))
        self.service.wait_until(lambda: all("model_version" in line for line in self.lines()))
        lines, runs = self.lines(), self.runs()
        self.service.kill()
        self.service.start()
        self.service.settled(20)
        self.assertEqual(self.lines(), lines)
        replayed = self.expect(0, "replay", "storeys.journal", "--json").lines()[:-1]
        self.assertEqual([comparable(line) for line in replayed], lines)
        self.service.stop()
        self.assertEqual(self.runs(), runs)
        # A copy of the journal takes its refinement with it, and says the same.
        (self.folder / "storeys.refinement" / ".solution.part").touch()
        self.expect(0, "backup", "storeys.journal", "-o", "copy/storeys.journal")
        self.expect(0, "recover", "storeys.journal", "-o", "recovered.journal")
        self.assertFalse((self.folder / "copy" / "storeys.refinement" / ".solution.part").exists())
        for copy in "copy/storeys.journal", "recovered.journal":
            replayed = self.expect(0, "replay", copy, "--project", "storeys.toml", "--json").lines()[:-1]
            self.assertEqual([comparable(line) for line in replayed], lines)
        (self.folder / "other.refinement").mkdir()
        self.expect(2, "backup", "storeys.journal", "-o", "other.journal", stderr="other.refinement: is there already, of another journal")
        # A refined model that was lost is told, and nothing is guessed.
        (model,) = (self.folder / "storeys.refinement").glob(f"*/model-{lines[-1]['model_version']}.h5")
        model.unlink()
        self.expect(4, "replay", "storeys.journal", "--json", stderr=[model.name, "is missing, the refined model that the data of"])
        self.service.start()
        self.service.settled(20)
        self.assertNotIn("model_version", self.lines()[-1])
        alarms = [alarm["message"] for alarm in self.service.get("/v1/alarms")[1]["alarms"] if alarm["kind"] == "journal"]
        self.assertIn("put it back; the project's own model is used", " ".join(alarms))

    def test_a_solver_that_fails_costs_a_caution(self):
        (self.folder / "broken").touch()
        self.serve()
        for datum in self.data[:20]:
            self.service.send(datum)
        self.service.settled(20)
        self.ask()
        said = "the full-order model could not be used, so the error of the reduced model is not verified: "
        self.service.wait_until(lambda: said in self.reasons())
        self.verified()
        self.assertIn("the licence server does not answer", self.refinement()["trouble"])
        self.assertNotIn("model_version", self.lines()[-1])
        self.assertNotEqual(self.service.get("/v1/status")[1]["structure"], "ok")
        # Not asked again by itself, but by request.
        self.service.send(self.data[20])
        self.service.settled(21)
        self.ask()
        kinds = lambda: [entry["kind"] for entry in self.service.get("/v1/logbook")[1]["logbook"]]
        self.service.wait_until(lambda: kinds()[-2:] == ["verification_asked", "verification"])
        self.verified()
        lines = self.lines()
        self.service.kill()
        self.service.start()
        self.service.settled(21)
        self.assertEqual(self.lines(), lines)
        (self.folder / "broken").unlink()
        self.assertEqual(self.runs(), [])
        self.ask()
        self.verified(version=1)
        self.service.wait_until(lambda: said not in self.reasons())
        self.assertNotIn("trouble", self.refinement())
        runs = f'knothe_full_order_runs{{site="storeys"}} {self.refinement()["full_order_runs"]}'
        self.service.wait_until(lambda: runs in self.service.get("/metrics")[1].decode())

    def test_a_solver_that_is_not_installed_is_named(self):
        alone = self.folder / "bin" / "knothe"
        alone.parent.mkdir()
        shutil.copy(KNOTHE, alone)
        self.serve(program=alone, env=dict(os.environ, PATH=str(self.folder / "empty")))
        self.expect_error(self.service.post("/v1/verify", {"by": "Ada"}), 409, "NoState")
        self.service.send(self.data[0])
        self.service.settled(1)
        self.ask()
        self.service.wait_until(lambda: "cannot run: knothe-offline" in self.reasons())

    def test_a_stop_ends_the_solver(self):
        self.hold()
        self.serve()
        self.service.send(self.data[0])
        self.service.settled(1)
        self.ask()
        solvers = self.folder / "solvers"
        self.service.wait_until(lambda: solvers.exists() and solvers.read_text().endswith("\n"))
        self.assertEqual(self.service.stop(), 130)
        for process in map(int, solvers.read_text().split()):
            with self.assertRaises(ProcessLookupError):
                os.kill(process, 0)
        self.assertEqual(self.runs(), [])

    def test_what_it_needs_is_said(self):
        text = self.project.read_text()
        self.project.write_text(text.replace('verify = "full-order"', 'verify = "off"'))
        self.serve()
        self.service.send(self.data[0])
        self.service.settled(1)
        self.expect_error(self.service.post("/v1/verify", {"by": "Ada"}), 409, "NotVerified")
        self.expect_error(self.service.post("/v1/verify", {}), 400, "Malformed")
        self.assertNotIn("refinement", self.service.get("/v1/status")[1])
        self.service.stop()
        self.project.write_text(text[:text.index("[offline]")])
        self.expect(3, "serve", self.project_name, stderr="the table [offline] that the model was made from")

    def expect_error(self, answer, status, kind):
        self.assertEqual((answer[0], answer[1]["error"]["type"]), (status, kind), answer[1])


if __name__ == "__main__":
    unittest.main(verbosity=2)
