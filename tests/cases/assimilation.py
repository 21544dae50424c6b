"""`knothe assimilate`: the lines that outside programs read, and what they say, judged by quadrature of the formula."""
import json
import math
import os
import re
import unittest

import analytic_model
from support import Case, parse_line, read_csv, without_times, write_csv

STEP_KEYS = ["step", "time", "mean", "covariance", "maximum_a_posteriori", "quantiles", "method", "map_order", "variance_diagnostic",
             "tolerance_reached", "ess", "verdict", "trusted", "log_evidence", "log_evidence_increment", "bias_correction", "used",
             "rejected", "missing", "elapsed_us", "forecast"]
FORECAST_KEYS = ["mean", "std", "maximum_a_posteriori", "probability_above_threshold", "levels", "values"]
PRIORS = [(0.9, 0.4472135954999579), (1.1, 0.4472135954999579)]
COMPONENT = {"x": 0, "y": 1, "z": 2}


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def exact_lines(self, posterior):
        """Adds the fixture's data to `posterior`, step by step; what it is after each."""
        rows = read_csv(self.folder / "data.csv")
        lines = []
        for step in range(analytic_model.STEPS):
            observations = [(COMPONENT[r["component"]], (float(r["x"]), float(r["y"]), float(r["z"])), float(r["value"]),
                             float(r["std"])) for r in rows[24 * step:24 * step + 24]]
            posterior.add(analytic_model.time(step), observations)
            lines.append(posterior.summary(step))
        return lines

    def test_simulated_data_as_csv_are_those_of_hdf5(self):
        for name in ("own.h5", "own.csv"):
            self.expect(0, "simulate", self.project_name, "--model", "model.h5", "-o", name)
        self.assertEqual(len(read_csv(self.folder / "own.csv")), 12 * 24)
        answers = []
        for name in ("own.h5", "own.csv"):
            self.edit('data = "data.h5"' if not answers else 'data = "own.h5"', f'data = "{name}"')
            answers.append([without_times(line) for line in self.assimilate()])
        self.assertEqual(*answers)

    def test_on_a_terminal_lines_that_stay_begin_where_the_moving_one_is_erased(self):
        rows = read_csv(self.folder / "data.csv")
        write_csv(self.folder / "turned.csv", [{**row, "value": -float(row["value"])} if row["component"] == "y" else row for row in rows])
        self.edit('data = "data.h5"', 'data = "turned.csv"')
        written = self.on_terminal(8, "assimilate", self.project_name)
        self.assertIn("\033[1;31mResult: do not use (verdict: reject)\033[0m", written)
        erased = re.compile(r".*\r\033\[K")
        for line in written.split("\n"):
            # Of what stands in a line only the last is seen; each moving one fits into the 80 columns.
            for moving in line.split("\r\033[K")[:-1]:
                self.assertLess(len(moving), 80)
            seen = re.sub("\033\\[[0-9;]*m", "", erased.sub("", line))
            self.assertLessEqual(len(seen), 100, seen)
            self.assertNotRegex(seen, r"\Sstep +\d")
        told = [line for line in written.split("\n") if "verdict: reject" in line]
        self.assertRegex(told[0], r"(\A|\033\[K)step +\d+: \033")
        for environment in ({"NO_COLOR": "1"}, {"TERM": "dumb"}):
            self.assertNotIn("\033[1;", self.on_terminal(8, "assimilate", self.project_name, **environment))

    def test_on_a_terminal_no_command_says_longer_lines_than_people_read(self):
        self.expect(0, "assimilate", self.project_name)
        for command in (("check", self.project_name), ("select", self.project_name, "-o", "chosen"), ("model", "info", "model.h5"),
                        ("forecast", self.project_name), ("infer", self.project_name, "-o", "one"), ("report", "results", "-o", "report.html")):
            for line in re.sub("\033\\[[0-9;]*[mK]", "", self.on_terminal(0, *command)).replace("\r", "\n").split("\n"):
                self.assertLessEqual(len(line), 100, f"{command}: {line}")

    def test_each_line_has_the_keys_and_shapes_of_the_interface(self):
        lines = self.assimilate()
        self.assertEqual([line["step"] for line in lines], list(range(12)))
        for line in lines:
            self.assertEqual([key for key in line if key in STEP_KEYS], STEP_KEYS)
            self.assertAlmostEqual(line["time"], analytic_model.time(line["step"]), places=12)
            self.assertEqual(len(line["mean"]), 2)
            self.assertEqual([len(row) for row in line["covariance"]], [2, 2])
            (_, upper), (lower, _) = line["covariance"]
            self.assertAlmostEqual(upper, lower, delta=1e-13)
            self.assertEqual(len(line["maximum_a_posteriori"]), 2)
            self.assertEqual(line["quantiles"]["levels"], [0.025, 0.25, 0.5, 0.75, 0.975])
            self.assertEqual([len(row) for row in line["quantiles"]["values"]], [5, 5])
            for row in line["quantiles"]["values"]:
                self.assertEqual(row, sorted(row))
            for key in ("step", "map_order", "used", "rejected", "missing"):
                self.assertIs(type(line[key]), int, key)
            for key in ("tolerance_reached", "trusted"):
                self.assertIs(type(line[key]), bool, key)
            self.assertTrue(0 < line["ess"] <= 1)
            self.assertEqual(line["bias_correction"], "off")
            self.assertEqual(line["trusted"] and (line["variance_diagnostic"] > 0.05 or line["ess"] < 0.9), False)
            self.assertTrue({"update", "forecast", "total"} <= set(line["elapsed_us"]))
            self.assertEqual(list(line["forecast"]), ["force", "deflection"])
            for forecast in line["forecast"].values():
                self.assertEqual([key for key in forecast if key in FORECAST_KEYS], FORECAST_KEYS)
                self.assertEqual(len(forecast["levels"]), len(forecast["values"]))

    def test_numbers_read_back_to_the_same_double(self):
        out = self.expect(0, "assimilate", self.project_name, "--json").out
        kept = [line for line in (self.folder / "results" / "steps.jsonl").read_text().splitlines()]
        for printed, stored in zip(out.splitlines(), kept):
            printed, stored = json.loads(printed), json.loads(stored)
            for key in ("mean", "covariance", "log_evidence", "quantiles"):
                self.assertEqual(printed[key], stored[key])

    def test_the_evidence_is_the_sum_of_its_increments(self):
        total = 0.0
        for line in self.assimilate():
            total += line["log_evidence_increment"]
            self.assertAlmostEqual(line["log_evidence"], total, delta=1e-9 * abs(total))

    def test_the_posterior_is_that_of_quadrature_at_every_step(self):
        """Mean, std, quantiles and log-evidence, all constants included, against the formula itself on 96 × 96 Gauss points."""
        self.expect_agreement(self.assimilate(), self.exact_lines(analytic_model.Posterior(PRIORS)))

    def test_the_grid_method_is_that_of_quadrature_too(self):
        self.expect_agreement(self.assimilate("--method", "grid"), self.exact_lines(analytic_model.Posterior(PRIORS)))

    def test_the_composed_form_agrees_with_the_collapsed_one(self):
        collapsed = self.assimilate()
        self.edit('form = "collapsed"', 'form = "composed"')
        self.expect_agreement(self.assimilate(), collapsed, mean=0.1, std=None, evidence=None, quantile=None)

    def test_the_forecasts_are_those_of_quadrature(self):
        last = self.assimilate()[-1]["forecast"]
        posterior = analytic_model.Posterior(PRIORS)
        self.exact_lines(posterior)
        mean, std = posterior.moments_of(lambda y0, ad: analytic_model.reaction_force(0.75, y0, ad))
        self.assertAlmostEqual(last["force"]["mean"], mean, delta=0.02 * std)
        self.assertAlmostEqual(last["force"]["std"], std, delta=0.02 * std)
        mean, std = posterior.moments_of(lambda y0, ad: analytic_model.displacement(1, (0.03, 0.05, 0.05), 1.0, y0, ad))
        self.assertAlmostEqual(last["deflection"]["mean"], mean, delta=0.02 * std)
        self.assertAlmostEqual(last["deflection"]["std"], std, delta=0.02 * std)

    def test_a_threshold_far_below_is_surely_passed(self):
        self.edit("threshold = 1150.0", "threshold = 1.0")
        self.edit("threshold = -3.7e-4", "threshold = 1.0")
        last = self.assimilate()[-1]["forecast"]
        self.assertAlmostEqual(last["force"]["probability_above_threshold"], 1, delta=1e-9)
        self.assertAlmostEqual(last["deflection"]["probability_above_threshold"], 0, delta=1e-9)

    def test_the_order_of_the_parameters_is_the_project_files(self):
        as_the_model = self.assimilate()
        text = self.project.read_text()
        y0, ad = [line for line in text.splitlines() if "prior" in line]
        self.project.write_text(text.replace(f"{y0}\n{ad}", f"{ad}\n{y0}"))
        swapped = self.assimilate()
        for line in swapped:
            line["mean"].reverse()
            line["covariance"] = [row[::-1] for row in line["covariance"][::-1]]
            line["quantiles"]["values"].reverse()
        self.expect_agreement(swapped, as_the_model)
        summary = json.loads((self.folder / "results" / "summary.json").read_text())
        self.assertEqual([p["name"] for p in summary["parameters"]], ["Ad", "Y0"])

    def test_a_second_run_gives_the_same_numbers(self):
        first = self.assimilate()
        kept = without_times([parse_line(x) for x in (self.folder / "results" / "steps.jsonl").read_text().splitlines()])
        self.assertEqual(without_times(self.assimilate()), without_times(first))
        again = without_times([parse_line(x) for x in (self.folder / "results" / "steps.jsonl").read_text().splitlines()])
        self.assertEqual(again, kept)

    def test_one_thread_and_two_give_the_same_numbers(self):
        one, two = [without_times(self.assimilate(env=dict(os.environ, KNOTHE_THREADS=n))) for n in "12"]
        self.assertEqual(one, two)

    def test_the_seed_moves_the_result_within_its_accuracy(self):
        first = self.assimilate()
        self.edit("max_order = 8\nseed = 1", "max_order = 8\nseed = 2")
        self.expect_agreement(self.assimilate(), first, mean=0.04, std=0.04, evidence=0.04, quantile=0.2)

    def test_a_lognormal_and_a_uniform_prior_stay_in_the_box(self):
        self.edit('prior = "normal", mean = 0.9, std = 0.4472135954999579', 'prior = "lognormal", mu = 0.0, sigma = 0.25')
        self.edit('prior = "normal", mean = 1.1, std = 0.4472135954999579', 'prior = "uniform", lower = 0.7, upper = 3.0')
        for line in self.assimilate():
            self.assertTrue(0.5 < line["quantiles"]["values"][0][0] and line["quantiles"]["values"][0][4] < 1.5)
            self.assertTrue(0.7 < line["quantiles"]["values"][1][0] and line["quantiles"]["values"][1][4] < 1.5)

    def test_without_json_stdout_is_for_people(self):
        outcome = self.expect(0, "assimilate", self.project_name)
        self.assertIn("Y0", outcome.out)
        self.assertRegex(outcome.out, r"12 steps in \d+\.\d+ s, computation trusted; results in ")

    def test_results_go_where_the_option_says(self):
        self.assimilate("-o", "elsewhere")
        self.assertTrue((self.folder / "elsewhere" / "summary.json").exists())
        self.assertFalse((self.folder / "results").exists())

    def test_paths_are_relative_to_the_project_file(self):
        self.expect(0, "assimilate", self.project, cwd="/")
        self.assertTrue((self.folder / "results" / "summary.json").exists())

    def test_interrupted_it_keeps_what_is_done(self):
        """A pipe that holds three lines stops the program in mid-run, however fast it is; then comes Ctrl-C."""
        lines, message = self.interrupt_after_first_line("assimilate", self.project_name, "--json")
        self.assertTrue(1 <= len(lines) < 12, len(lines))
        self.assertNotIn("done", lines[-1])
        self.assertIn(f"interrupted after {len(lines)} of 12 steps", message)
        kept = (self.folder / "results" / "steps.jsonl").read_text().splitlines()
        self.assertEqual([parse_line(line)["step"] for line in kept], list(range(len(lines))))
        self.assertEqual(json.loads((self.folder / "results" / "summary.json").read_text())["steps"], len(lines))
        self.assertEqual(without_times(self.assimilate())[:len(lines)], without_times(lines))

    def test_correlation_is_within_minus_one_and_one(self):
        for line in self.assimilate():
            (a, c), (_, b) = line["covariance"]
            self.assertLess(abs(c), math.sqrt(a * b))

    def test_redone_steps_are_corrected_and_say_so(self):
        lines = self.assimilate("--redo", "3:5")
        self.assertEqual([line["step"] for line in lines if line["bias_correction"] == "on"], [3, 4, 5])
        self.assertEqual(len(lines), 12)

    def test_a_range_to_redo_is_checked(self):
        for text, message in (("5:12", "the data have steps 0 to 11"), ("7:5", "FROM is not after TO"), ("3", "give two steps")):
            self.assertIn(message, self.expect(2, "assimilate", self.project_name, "--redo", text).err)

    def test_a_model_that_is_right_stays_as_it_is(self):
        plain = self.assimilate()
        self.edit("max_order = 8\nseed = 1", 'max_order = 8\nseed = 1\nbias_correction = "auto"')
        for line, before in zip(self.assimilate(), plain):
            self.assertEqual(line["bias_correction"], "off")
            self.assertFalse(line["monitor"]["alarm"])
            self.assertAlmostEqual(line["log_evidence"], before["log_evidence"], delta=0.05)

    def test_models_side_by_side_have_probabilities(self):
        self.edit('model = "model.h5"', 'model = { separated = "model.h5", candidates = ["./model.h5"] }')
        self.edit("max_order = 8\nseed = 1", 'max_order = 8\nseed = 1\nbias_order = 0')
        for line in self.assimilate():
            self.assertAlmostEqual(sum(m["probability"] for m in line["models"].values()) / len(line["models"]), 0.5, delta=1e-9)
            for model in line["models"].values():
                self.assertEqual(model["evidence_against"], "barely worth mentioning")


if __name__ == "__main__":
    unittest.main()
