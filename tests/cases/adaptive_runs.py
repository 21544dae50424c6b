"""[offline.adaptive] grid_shift: the program chooses the full-order runs. The judge is the formula itself, by dense quadrature."""
import json
import math
import os
import random
import signal
import subprocess
import time
import unittest

from support import KNOTHE, Case, python_with, write_csv

FORMULA = """import math, sys


def solve(amplitude, rate, drift):
    rows = []
    for k in range(1, 11):
        t = 0.3 * k
        rows.append((t, amplitude * math.exp(-rate * t) + drift, amplitude * (1 - math.exp(-rate * t)) + 0.5 * drift * t))
    return rows


if __name__ == "__main__":
    with open("formula.csv", "w") as file:
        file.write("time,near,far\\n")
        for row in solve(*map(float, sys.argv[1:])):
            file.write(",".join(map(repr, row)) + "\\n")
"""
STD = 0.02

# Four signals that decay, of five parameters, each half as influential as the one before.
MANY = """import math, sys


def solve(p, exp=math.exp, cos=math.cos):
    rows = []
    for k in range(1, 11):
        t = 0.3 * k
        rows.append((t,) + tuple(sum(exp(-(0.5 + 0.3 * i) * t * (1 + 0.4 * 0.5**i * x)) * cos(0.7 * i * s + 0.3 * s * t)
                                     for i, x in enumerate(p)) for s in range(4)))
    return rows


if __name__ == "__main__":
    with open("formula.csv", "w") as file:
        file.write("time,a,b,c,d\\n")
        for row in solve(list(map(float, sys.argv[1:]))):
            file.write(",".join(map(repr, row)) + "\\n")
"""
# Uniform priors on [-1, 1]; Student-t draws about the posterior to be judged, each with its own weight.
IMPORTANCE = """
import json, sys, numpy as np
sys.path.insert(0, ".")
import formula
data, mean, covariance = map(np.array, json.load(open("judge.json")))
d, n = len(mean), 400000
random = np.random.default_rng(1)
factor = np.linalg.cholesky(1.5 * covariance)
normal, chi = random.standard_normal((n, d)), random.chisquare(5, n) / 5
points = mean + (normal / np.sqrt(chi)[:, None]) @ factor.T
log_proposal = -0.5 * (5 + d) * np.log1p((normal**2).sum(1) / chi / 5)
predicted = np.stack([v for row in formula.solve(points.T, np.exp, np.cos) for v in row[1:]])
log = -0.5 * (((predicted - data[:, None]) / STD) ** 2).sum(0) - log_proposal
log[np.abs(points).max(1) > 1] = -np.inf
w = np.exp(log - log.max())
w /= w.sum()
centre = w @ points
print(json.dumps([list(centre), list(np.sqrt(w @ (points - centre) ** 2)), 1 / (w**2).sum()]))
"""


class Test(Case):
    project_name = "adaptive_runs.toml"

    def setUp(self):
        super().setUp()
        (self.folder / "formula.py").write_text(FORMULA)
        names = {}
        exec(FORMULA.split("if __name__")[0], names)  # noqa: S102
        self.solve = names["solve"]
        os.environ["RUNS"] = str(self.folder / "runs.log")

    def runs_made(self):
        return len((self.folder / "runs.log").read_text().splitlines())

    def test_few_runs_give_the_posterior_of_the_formula(self):
        lines = self.expect(0, "offline", self.project_name, "-o", "model.h5", "--json").lines()
        rounds = [line for line in lines if "expected_shift" in line]
        self.assertEqual(rounds[-1]["runs"], self.runs_made())
        self.assertLessEqual(max(rounds[-1]["expected_shift"], rounds[-1]["held_out_shift"]), 0.1)
        self.assertLess(rounds[-1]["runs"], 60)
        # Linear in two parameters, and curved in the rate.
        degrees = dict(zip(["amplitude", "rate", "drift"], rounds[-1]["degrees"]))
        self.assertLessEqual(max(degrees["amplitude"], degrees["drift"]), 2)
        self.assertGreaterEqual(degrees["rate"], 4)
        noise, data = random.Random(7), []
        for t, near, far in self.solve(1.7, 0.9, 0.2):
            for name, value in (("near", near), ("far", far)):
                data.append({"time": repr(t), "sensor": name, "x": "", "y": "", "z": "", "component": name,
                             "value": repr(value + noise.gauss(0, STD)), "std": STD})
        write_csv(self.folder / "data.csv", data)
        line = self.assimilate()[-1]
        exact = self.quadrature([float(entry["value"]) for entry in data], line["mean"],
                                [math.sqrt(line["covariance"][k][k]) for k in range(3)])
        for k, (mean, std) in enumerate(exact):
            self.assertLess(abs(line["mean"][k] - mean), 0.2 * std)
            self.assertLess(abs(math.sqrt(line["covariance"][k][k]) / std - 1), 0.1)

    def quadrature(self, data, mean, std, nodes=25):
        """Mean and std of each parameter by the trapezoidal rule within five standard deviations."""
        axes = [[m + s * (10 * i / (nodes - 1) - 5) for i in range(nodes)] for m, s in zip(mean, std)]
        logs = {}
        for a in axes[0]:
            for b in axes[1]:
                for c in axes[2]:
                    if not (1 <= a <= 3 and 0.2 <= b <= 1.4 and -1 <= c <= 1):
                        continue
                    predicted = [v for row in self.solve(a, b, c) for v in row[1:]]
                    logs[a, b, c] = (-0.5 * ((b - 0.8) / 0.2) ** 2
                                     - 0.5 * sum(((d - p) / STD) ** 2 for d, p in zip(data, predicted)))
        top = max(logs.values())
        weights = {point: math.exp(value - top) for point, value in logs.items()}
        total = sum(weights.values())
        result = []
        for k in range(3):
            centre = sum(w * point[k] for point, w in weights.items()) / total
            result.append((centre, math.sqrt(sum(w * (point[k] - centre) ** 2 for point, w in weights.items()) / total)))
        return result

    def test_five_parameters(self):
        """A tenth of a grid's runs; the posterior is that of weighted draws over the formula itself."""
        python = python_with("numpy")
        if python is None:
            self.skipTest("no python3 with numpy here: python3-numpy of scripts/packages.txt")
        (self.folder / "formula.py").write_text(MANY)
        names = [f"p{i}" for i in range(5)]
        text = ['model = "model.h5"', 'data = "data.csv"', 'results = "results/"', "[parameters]"]
        text += [f'{name} = {{ prior = "uniform", lower = -1, upper = 1 }}' for name in names]
        text += ["[offline]", "modes = 30", "processes = 2", "adaptive = { grid_shift = 0.1, runs = 120 }", "[offline.command]",
                 'run = ["python3", "-S", "formula.py", ' + ", ".join(f'"{{{{{name}}}}}"' for name in names) + "]",
                 'files = ["formula.py"]', 'field = "formula.csv"']
        for name in names:
            text += [f"[offline.parameters.{name}]", "lower = -1", "upper = 1"]
        truth = [0.4, -0.3, 0.5, -0.2, 0.1]
        text += ["[simulate]", "truth = { " + ", ".join(f"{n} = {v}" for n, v in zip(names, truth)) + " }", "[simulate.noise]"]
        text += [f"{sensor} = {STD}" for sensor in "abcd"]
        self.project.write_text("\n".join(text) + "\n")
        lines = self.expect(0, "offline", self.project_name, "-o", "model.h5", "--json").lines()
        last = [line for line in lines if "expected_shift" in line][-1]
        self.assertLessEqual(max(last["expected_shift"], last["held_out_shift"]), 0.1)
        self.assertLess(last["runs"], 100)  # 4**5 = 1,024
        names = {}
        exec(MANY.split("if __name__")[0], names)  # noqa: S102
        noise, data = random.Random(7), []
        for t, *values in names["solve"](truth):
            for name, value in zip("abcd", values):
                data.append({"time": repr(t), "sensor": name, "x": "", "y": "", "z": "", "component": name,
                             "value": repr(value + noise.gauss(0, STD)), "std": STD})
        write_csv(self.folder / "data.csv", data)
        line = self.assimilate()[-1]
        (self.folder / "judge.json").write_text(json.dumps([[float(entry["value"]) for entry in data], line["mean"], line["covariance"]]))
        judged = subprocess.run([python, "-c", IMPORTANCE.replace("STD", str(STD))], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(judged.returncode, 0, judged.stderr)
        mean, std, effective = json.loads(judged.stdout)
        self.assertGreater(effective, 10_000)
        for k in range(5):
            self.assertLess(abs(line["mean"][k] - mean[k]), 0.2 * std[k])
            self.assertLess(abs(math.sqrt(line["covariance"][k][k]) / std[k] - 1), 0.1)
        verified = self.expect(0, "model", "verify", self.project_name, "model.h5", "--points", "2", "--json").lines()[-1]
        self.assertLess(verified["posterior_shift"]["worst"], 0.1)

    def test_an_interrupted_selection_goes_on_to_the_same_model(self):
        self.expect(0, "offline", self.project_name, "-o", "whole.h5")
        in_one_go = self.runs_made()
        process = subprocess.Popen([KNOTHE, "offline", self.project_name, "-o", "model.h5"], cwd=self.folder,
                                   stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        while process.poll() is None and self.runs_made() < in_one_go + 12:
            time.sleep(0.005)
        process.send_signal(signal.SIGINT)
        _, message = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 130, message)
        self.assertRegex(message, r"the same command goes on from there \(the \d+ of the rounds before are kept too\)")
        kept = len(list((self.folder / "model.h5.parts").glob("run-*.h5")))
        self.assertGreater(kept, 0)
        before = self.runs_made()
        outcome = self.expect(0, "offline", self.project_name, "-o", "model.h5")
        self.assertEqual(self.runs_made() - before, in_one_go - kept)
        self.assertIn(f"{in_one_go} full-order runs ({kept} reused from an earlier call)", outcome.out)
        for at in ("amplitude=1.234,rate=0.567,drift=0.1", "amplitude=2.9,rate=1.3,drift=-0.9"):
            values = [self.expect(0, "model", "evaluate", model, "--at", at, "--step", "9", "--json").out for model in ("whole.h5", "model.h5")]
            self.assertEqual(json.dumps(values[0]).replace("whole", "model"), json.dumps(values[1]))

    def test_a_number_of_runs_that_does_not_suffice_is_a_warning(self):
        self.edit("grid_shift = 0.1, runs = 80", "grid_shift = 1e-7, runs = 20")
        outcome = self.expect(0, "offline", self.project_name, "-o", "model.h5", stderr=[
            "posterior shift", "grid_shift = 1e-07 is not met with", "Allow more than runs = 20"])
        self.assertLessEqual(self.runs_made(), 20)
        self.assertIn("runs more", outcome.err)

    def test_runs_that_fail_are_left_out_where_that_is_asked_for(self):
        """No solution where rate and drift are both at the end of their axes: their common term is not in the model."""
        self.edit("exec python3 -S formula.py", "test {{rate}}/{{drift}} != 1.4/1 || exit 3; exec python3 -S formula.py")
        build = "offline", self.project_name, "-o", "model.h5", "--json"
        stopped = self.run_knothe(*build)
        self.assertEqual(stopped.status, 6, str(stopped))
        self.assertIn("failed: sh ended with status 3", stopped.err)
        self.edit("[offline]\n", '[offline]\nfailed_runs = "leave-out"\n')
        outcome = self.expect(0, *build, stderr=["full-order runs failed and is left out:\n", "rate = 1.4, drift = 1): sh ended with status 3",
                                                 "the model is made without 1 failed run(s)"])
        rounds = [line for line in outcome.lines() if "expected_shift" in line]
        self.assertLessEqual(max(rounds[-1]["expected_shift"], rounds[-1]["held_out_shift"]), 0.1)
        # The formula has no such term.
        (line,) = self.expect(0, "model", "evaluate", "model.h5", "--at", "amplitude=1.7,rate=1.3,drift=0.8", "--step", "9", "--json").lines()
        for value, exact in zip(line["values"], self.solve(1.7, 1.3, 0.8)[9][1:]):
            self.assertAlmostEqual(value, exact, delta=0.3 * STD)

    def test_what_does_not_go_with_it_is_refused_before_the_first_run(self):
        build = "offline", self.project_name, "-o", "model.h5"
        text = self.project.read_text()

        def refused(old, new, message):
            self.project.write_text(text)
            self.edit(old, new)
            self.expect(3, *build, stderr=message)

        refused("runs = 80", "runs = 14", "runs is 14: grid_shift needs 15 at least for 3 parameters, 8 held out to judge by")
        refused("runs = 80", "grid_error = 1e-6", 'give "grid_error" or "grid_shift", not both')
        refused("modes = 20", 'sparse_level = 3\nfailed_runs = "leave-out"', '"leave-out" does not go with "sparse_level"')
        refused("modes = 20", "sparse_level = 3", '"sparse_level" says which runs to make, and so does "grid_shift"')
        refused("grid_shift = 0.1", "grid_shift = 0", "must be a positive number, not 0")
        refused("drift = { prior", "# drift = { prior", "a prior for each axis: offline.adaptive.grid_shift asks")
        refused("[simulate]", "[unused]", "unused")
        self.assertFalse((self.folder / "runs.log").exists())


if __name__ == "__main__":
    unittest.main()
