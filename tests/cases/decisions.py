"""[decide]: what every entrance says of the next action, and a simulated machine that does it."""
import os
import pathlib
import subprocess
import sys
import unittest

from service_support import ServiceCase, comparable
from support import read_csv, write_csv

EXAMPLE = pathlib.Path(__file__).resolve().parents[2] / "examples" / "driven_test" / "machine.py"
KEYS = ["action", "time", "information", "plan", "furthest", "message", "failure_probability", "allowed_probability"]
FAILURE = '[forecast.sag]\nquantity = "displacement"\npoint = [0.03, 0.05, 0.05]\ncomponent = "y"\nhorizon = 1.0\nthreshold = 1e-3\n'


class Test(ServiceCase):
    def decide(self, text='failure = "sag"\n'):
        self.project.write_text(self.project.read_text() + "\n" + FAILURE + "[decide]\n" + text)

    def test_every_line_has_a_decision_and_the_console_says_it(self):
        plain = [dict(comparable(line)) for line in self.assimilate()]
        self.decide()
        lines = self.assimilate()
        self.assertTrue(all(line["elapsed_us"]["decision"] > 0 for line in lines))
        for before, line in zip(plain, map(comparable, lines)):
            decision = line.pop("decision")
            self.assertEqual(list(decision)[:8], KEYS)
            self.assertIn(decision["action"], ("load", "hold", "stop"))
            self.assertGreaterEqual(decision["time"], line["time"] - 1e-12)
            self.assertEqual(decision["plan"], sorted(decision["plan"]))
            self.assertEqual(decision["plan"][:1], [decision["time"]] if decision["action"] != "stop" else [])
            self.assertLessEqual(decision["failure_probability"], decision["allowed_probability"])
            line["forecast"].pop("sag")
            self.assertEqual(before, line)  # nothing else has changed
        self.assertEqual(lines[0]["decision"]["action"], "load")
        said = self.expect(0, "assimilate", self.project_name).out
        self.assertRegex(said, r"(?m)^next: (hold|stop): ")
        self.assertRegex(said, r"step +9 .* next: ")

    def test_the_service_says_what_assimilate_says_and_replay_too(self):
        self.decide()
        wanted = [line["decision"] for line in self.assimilate()]
        service = self.serve()
        for datum in self.data:
            service.send(datum)
        service.settled(len(self.data))
        self.assertEqual([line["decision"] for line in service.states()], wanted)
        service.stop()
        replayed = self.expect(0, "replay", "assimilation.journal", "--project", self.project_name, "--json").lines()[:-1]
        self.assertEqual([line["decision"] for line in replayed], wanted)

    def test_a_rejected_answer_is_not_loaded_on(self):
        self.decide()
        rows = read_csv(self.folder / "data.csv")
        write_csv(self.folder / "turned.csv", [{**row, "value": -float(row["value"])} if row["component"] == "y" else row for row in rows])
        self.edit('data = "data.h5"', 'data = "turned.csv"')
        last = self.assimilate(status=8)[-1]
        self.assertEqual(last["verdict"]["level"], "reject")
        self.assertEqual(last["decision"]["action"], "hold")
        self.assertIn("the verdict is reject: do not load on", last["decision"]["message"])
        self.assertNotIn("failure_probability", last["decision"])

    def test_a_mistake_is_found_at_its_place(self):
        before = self.project.read_text()
        for text, message in (
                ('failure = "sagg"\n', '"sagg" is not a forecast (did you mean "sag"?)'),
                ('failure = "sag"\nabout = "Y1"\n', '"Y1" is neither a parameter nor a forecast (did you mean "Y0"?)'),
                ('failure = "sag"\nend = 7\n', "[decide] end = 7: the model knows the times"),
                ('failure = "sag"\nincrements = [0.1, 0]\n', "decide.increments must be positive"),
                ('failure = "sag"\nincrements = [0.1]\n', "no two times of the model are 0.1 apart"),
                ('failure = "sag"\nrisk = 2\n', "risk"),
                ('failure = "sag"\nrisk = 0\n', "risk"),
                ('risk = 0.1\n', "failure")):
            self.project.write_text(before)
            self.decide(text)
            for command in (("check",), ("assimilate",)):
                said = self.expect(3, *command, self.project_name, stderr=message).err
                self.assertRegex(said, rf"{self.project_name}:\d+:\d+: error: ")

    def test_a_simulated_machine_is_driven_until_it_stops(self):
        self.decide('failure = "sag"\ncost = 0.2\n')
        service = self.serve()
        told = subprocess.run([sys.executable, EXAMPLE, f"http://127.0.0.1:{service.port}", "--truth", "1.05,0.9", "--first", "0.1"], check=False,
                              capture_output=True, text=True, timeout=120, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"})
        self.assertEqual(told.returncode, 0, told.stdout + told.stderr)
        lines = told.stdout.strip().split("\n")
        self.assertRegex(lines[0], r"^0\.0833: ok; load to ")
        self.assertIn("; stop: ", lines[-1])
        self.assertLess(len(lines), 40)
        states = service.states()
        self.assertEqual(sum(line["data"] for line in states), len(lines))
        self.assertLess(len(states), 12)  # it was not loaded step by step


if __name__ == "__main__":
    unittest.main()
