"""The notched beam end to end: transport against quadrature through the crack run, the two forms, the crack forecast."""
import json
import math
import os
import re
import subprocess
import sys
import unittest

from support import REPOSITORY, Case, read_csv, without_times, write_csv


class Test(Case):
    project_name = "beam.toml"
    fixture = "beam"

    def test_transport_agrees_with_the_grid_at_every_step(self):
        self.expect_agreement(self.assimilate(), self.assimilate("--method", "grid"))

    def test_the_default_agrees_with_the_grid_at_every_step(self):
        self.edit('kind = "transport"', "")
        lines = self.assimilate()
        self.assertEqual({line["method"] for line in lines}, {"grid"})
        self.assertEqual([line["step"] for line in lines if not line["trusted"]], [])
        self.expect_agreement(lines, self.assimilate("--method", "grid"), mean=0.002, std=0.003, evidence=1e-3, quantile=0.01)

    def test_every_step_is_trusted(self):
        self.assertEqual([line["step"] for line in self.assimilate() if not line["trusted"]], [])

    def test_the_composed_form_agrees_with_the_collapsed_one(self):
        collapsed = self.assimilate()
        self.edit('form = "collapsed"', 'form = "composed"')
        self.expect_agreement(self.assimilate(), collapsed, mean=0.1, std=None, evidence=None, quantile=None)

    def test_the_truth_is_found(self):
        """Data of the model itself at (1, 1): in the end within four standard deviations, and those much less than the prior's."""
        last = self.assimilate()[-1]
        for k, largest in ((0, 0.2), (1, 0.05)):
            std = math.sqrt(last["covariance"][k][k])
            self.assertLess(std, largest)
            self.assertLess(abs(last["mean"][k] - 1), 4 * std)

    def input_errors(self):
        return {e["input"]: e for e in json.loads((self.folder / "results/summary.json").read_text())["input_errors"]}

    def test_a_modulus_hides_behind_the_parameters_as_the_equations_say(self):
        """The exact invariance of docs/explanation/verdict.md: E by c, as Y0 by c and Ad by 1/c."""
        last = self.assimilate()[-1]
        error = self.input_errors()["youngs_modulus"]
        for k, power in enumerate((1, -1)):
            self.assertAlmostEqual(error["shift"][k] / last["mean"][k], 1.01**power - 1, delta=0.002)
            self.assertAlmostEqual(error["shift_std"][k], error["shift"][k] / math.sqrt(last["covariance"][k][k]), delta=0.05)

    def test_an_error_of_the_displacements_does_what_data_do_that_have_it(self):
        before = self.assimilate()[-1]
        error = self.input_errors()["displacements"]
        self.assertTrue(error["limited"])  # data that are a hundredth too large do not fit
        # As docs/explanation/verdict.md says.
        self.assertEqual((f"{100 * error['relative']:.2f}", f"{error['shift_std'][0]:.0f}"), ("0.07", "-3"))
        self.edit('data = "data.h5"', 'data = "altered.csv"')
        write_csv(self.folder / "altered.csv",
                  [{**row, "value": (1 + error["relative"]) * float(row["value"])} for row in read_csv(self.folder / "data.csv")])
        after = self.assimilate()[-1]
        for k in range(2):
            moved = (after["mean"][k] - before["mean"][k]) / math.sqrt(before["covariance"][k][k])
            self.assertAlmostEqual(error["shift_std"][k], moved, delta=0.02 + 0.02 * abs(moved))

    def test_a_tolerance_changes_its_error_alone_and_zero_leaves_it_out(self):
        self.edit("[parameters]", "[tolerances]\nclock = 0\nyoungs_modulus = 0.005\n\n[parameters]")
        self.assimilate()
        errors = json.loads((self.folder / "results/summary.json").read_text())["input_errors"]
        self.assertEqual([e["input"] for e in errors], ["displacements", "displacements and clock", "youngs_modulus"])
        self.assertEqual((errors[2]["relative"], errors[2]["limited"]), (0.005, False))

    def test_a_tolerance_of_nothing_is_told_with_what_there_is(self):
        self.edit("[parameters]", "[tolerances]\nyoung_modulus = 0.02\n\n[parameters]")
        run = self.expect(3, "assimilate", self.project_name)
        self.assertIn('error: "young_modulus" is no input of this test (did you mean "youngs_modulus"?); its inputs are displacements, '
                      "clock, displacements and clock, youngs_modulus", run.err)

    def test_one_thread_and_two_give_the_same_numbers(self):
        one, two = [without_times(self.assimilate(env=dict(os.environ, KNOTHE_THREADS=n))) for n in "12"]
        self.assertEqual(one, two)

    def test_csv_and_hdf5_give_the_same_posterior(self):
        from_hdf5 = without_times(self.assimilate())
        self.edit('data = "data.h5"', 'data = "data.csv"')
        self.assertEqual(without_times(self.assimilate()), from_hdf5)
        self.assertEqual(len(read_csv(self.folder / "data.csv")), 50 * 60)

    def test_the_crack_length_has_a_density_that_fits_its_numbers(self):
        self.assimilate()
        (line,) = self.expect(0, "forecast", self.project_name, "--json").lines()
        crack = line["forecast"]["crack"]
        x, f = crack["density"]["points"], crack["density"]["values"]
        self.assertTrue(0 <= x[0] and x[-1] <= 0.08)

        def integral(weight):
            return sum((x[i + 1] - x[i]) * (weight(x[i]) * f[i] + weight(x[i + 1]) * f[i + 1]) / 2 for i in range(len(x) - 1))

        self.assertAlmostEqual(integral(lambda _: 1), 1, delta=0.01)
        self.assertAlmostEqual(integral(lambda l: l), crack["mean"], delta=0.1 * crack["std"])
        variance = integral(lambda l: (l - crack["mean"]) ** 2)
        self.assertAlmostEqual(math.sqrt(variance), crack["std"], delta=0.05 * crack["std"])
        self.assertEqual(crack["values"], sorted(crack["values"]))
        self.assertAlmostEqual(crack["probability_above_threshold"], integral(lambda l: 1.0 if l > 0.04 else 0.0), delta=0.02)
        self.assertIn("crack", line["published"])

    def test_eq_33_is_marked_where_it_says_what_the_points_say(self):
        self.assimilate()
        steps = [json.loads(text) for text in (self.folder / "results" / "steps.jsonl").read_text().splitlines()]
        for crack in (step["forecast"]["crack"] for step in steps):
            published = crack["published"]
            near = abs(published["mean"] - crack["mean"]) <= crack["std"] / 2
            self.assertEqual(published["agrees"], near and 0.5 <= published["std"] / crack["std"] <= 2)
        self.assertEqual({step["forecast"]["crack"]["published"]["agrees"] for step in steps}, {False, True})

    def test_the_report_shows_beam_and_crack(self):
        self.assimilate()
        self.expect(0, "report", "results", "-o", "report.html")
        page = (self.folder / "report.html").read_text()
        for word in ("crack", "Ad", "Y0"):
            self.assertIn(word, page)

    def test_the_last_lines_of_the_demo_say_what_was_seen(self):
        lines = self.assimilate()
        said = subprocess.run([sys.executable, REPOSITORY / "scripts" / "demo_summary.py", "results", "report.html"], cwd=self.folder,
                              capture_output=True, text=True, check=True).stdout.splitlines()
        self.assertEqual(len(said), 5)
        right = [line["verdict"]["level"] for line in lines].count("ok")
        self.assertRegex(said[0], rf"^Result: usable.*; verdict ok at {right} of 50 steps\.$")
        early, late = (lines[i]["forecast"]["crack"] for i in (11, 49))  # of 0.4 mm in 50 steps
        found = re.fullmatch(r"Crack at 0\.12 mm: ([\d.]+) ± ([\d.]+) mm by the forecast at 0\.096 mm, ([\d.]+) ± ([\d.]+) mm after all data\.", said[2])
        for text, value, std in zip(found.groups(), (early["mean"], early["std"], late["mean"], late["std"]), 2 * [early["std"]] + 2 * [late["std"]]):
            self.assertAlmostEqual(float(text), 1e3 * value, delta=51 * std)
        for k, name in enumerate(("Y0", "Ad")):
            mean, std = map(float, re.search(rf"{name} = ([\d.]+) ± ([\d.]+)", said[1]).groups())
            self.assertAlmostEqual(mean, lines[-1]["mean"][k], delta=0.051 * std)
        self.assertIn(str(self.folder / "report.html"), said[3])


if __name__ == "__main__":
    unittest.main()
