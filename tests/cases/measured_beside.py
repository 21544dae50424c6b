"""Data beside displacements at model times: a measured clock, load cells, strain gauges, openings; judged by quadrature."""
import json
import math
import random
import unittest

import analytic_model
from support import Case, read_csv, write_csv

PRIORS = [(0.9, 0.4472135954999579), (1.1, 0.4472135954999579)]
TRUTH = (1.05, 0.9)
COMPONENT = {"x": 0, "y": 1, "z": 2}
FROM, TO = (-0.03, 0.0, 0.0), (0.03, 0.05, 0.0)


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def setUp(self):
        super().setUp()
        self.sensors = read_csv(self.folder / "data.csv")[:24]
        (self.folder / "data.csv").unlink()
        self.edit('data = "data.h5"', '[data]\nfile = "data.csv"')
        # `results` must stay a top-level key.
        self.edit('results = "results/"\n', "")
        self.project.write_text('results = "results/"\n' + self.project.read_text())
        self.random = random.Random(3)

    def measure(self, times, extra=None, error=lambda i: 0.0):
        """Writes data.csv: displacements at the model times `times` (true time: plus `error`), and the rows of `extra`(i, t)."""
        self.data, rows = [], []
        for i, t in enumerate(times):
            observations = []
            for sensor in self.sensors:
                c, point, std = COMPONENT[sensor["component"]], tuple(float(sensor[k]) for k in "xyz"), float(sensor["std"])
                value = analytic_model.displacement(c, point, t + error(i), *TRUTH) + self.random.gauss(0, std)
                observations.append((c, point, value, std))
                rows.append({**sensor, "time": 10.0 * i, "value": repr(value)})
            self.data.append((t, observations))
            for name, value, std in extra(i, t) if extra else ():
                rows.append({"time": 10.0 * i, "sensor": name, "x": "", "y": "", "z": "", "component": name,
                             "value": repr(value), "std": std})
        write_csv(self.folder / "data.csv", rows)

    def posterior_by_quadrature(self, numbers=()):
        """The posterior by quadrature of the formula; `numbers`[i]: (value, std, formula) of step i."""
        posterior, lines = analytic_model.Posterior(PRIORS, 64), []
        for i, (t, observations) in enumerate(self.data):
            posterior.add(t, observations)
            for number in numbers[i] if numbers else ():
                posterior.add_number(*number)
            lines.append(posterior.summary(i))
        return lines

    def test_a_clock_tells_the_model_time_between_the_models_times(self):
        self.edit("[data]\n", '[data]\nclock = "imposed_displacement"\n')
        times = [0.11, 0.3, 0.52, 0.52, 0.77, 1.0]
        self.measure(times, lambda i, t: [("imposed_displacement", 4e-4 * t, "")])
        lines = self.assimilate()
        for line, t in zip(lines, times):
            self.assertAlmostEqual(line["time"], t, places=12)
        self.expect_agreement(lines, self.posterior_by_quadrature())

    def test_an_error_of_the_clock_is_not_taken_for_a_parameter(self):
        """Readings off by 5 % of the range: taken as exact they move the estimate by many of its standard deviations."""
        std = 2e-5
        errors = [self.random.gauss(0, std / 4e-4) for _ in range(8)]
        self.edit("[data]\n", '[data]\nclock = "imposed_displacement"\n')
        distance = {}
        for given in (std, ""):
            self.measure([0.25 + 0.06 * i for i in range(8)], lambda i, t: [("imposed_displacement", 4e-4 * t, given)],
                         lambda i: errors[i])
            # Without it the values are not the model's at those times, which the verdict sees.
            last = self.assimilate(status=0 if given else 8)[-1]
            if given:
                self.expect_same_as_the_last_step()
            distance[given] = max(abs(last["mean"][k] - TRUTH[k]) / last["covariance"][k][k] ** 0.5 for k in (0, 1))
        self.assertLess(distance[std], 3)
        self.assertGreater(distance[""], 6)

    def test_what_no_clock_can_be_is_refused_with_words(self):
        self.edit("[data]\n", '[data]\nclock = "imposed_displacement"\n')
        reading = [0.2, 0.5, 0.4, 0.8]
        for values, std, texts in (
                (reading, "", ["outputs/imposed_displacement[2]", "unloaded", "index 1"]),
                (reading, 1e-6, ["unloaded"]),
                ([0.2, 0.5, 1.2, 1.3], "", ["outside what the model covers", "imposed_displacement[2]"]),
                ([0.2, float("nan"), 0.6, 0.7], "", ["imposed_displacement[1] is missing"])):
            self.measure([0.2, 0.3, 0.4, 0.5], lambda i, t: [("imposed_displacement", 4e-4 * values[i], std)])
            self.expect(4, "assimilate", self.project_name, stderr=texts)
        self.measure([0.2, 0.3], lambda i, t: [])
        self.expect(4, "assimilate", self.project_name, stderr=["no series of that name", "/outputs/imposed_displacement"])
        self.edit('"imposed_displacement"', '"reaction_force"')
        self.measure([0.2, 0.3], lambda i, t: [("reaction_force", 400.0, 1.0)])
        self.expect(4, "assimilate", self.project_name, stderr="depends on the parameters")
        self.edit('"reaction_force"', '"reaction_forc"', 1)
        self.measure([0.2, 0.3], lambda i, t: [("reaction_forc", 400.0, 1.0)])
        self.expect(4, "assimilate", self.project_name, stderr="reaction_force")
        self.expect(3, "serve", self.project_name, "--port", "0", stderr="data.clock is for `knothe assimilate`")

    def test_forces_strains_and_openings_join_the_displacements(self):
        """A load cell, a strain gauge, an opening and a rotation, each as good as quadrature with its own formula."""
        self.edit("[parameters]", f'''[data.sensors.gauge]
kind = "strain"
from = {list(FROM)}
to = {list(TO)}
[data.sensors.mouth]
kind = "opening"
from = {list(FROM)}
to = {list(TO)}
[data.sensors.twist]
kind = "combination"
points = [[-0.06, 0.0, 0.0], [0.06, 0.1, 0.05]]
components = ["y", "x"]
coefficients = [2.0, -0.5]

[parameters]''')
        length = sum((b - a) ** 2 for a, b in zip(FROM, TO)) ** 0.5

        def opening(t, p):
            u = [[analytic_model.displacement(c, x, t, *p) for c in range(3)] for x in (FROM, TO)]
            return sum((u[1][c] - u[0][c]) * (TO[c] - FROM[c]) / length for c in range(3))

        formulas = {
            "gauge": (lambda t, p: opening(t, p) / length, 2e-5),
            "mouth": (lambda t, p: opening(t, p), 2e-6),
            "reaction_force": (lambda t, p: analytic_model.reaction_force(t, *p), 60.0),
            "twist": (lambda t, p: 2 * analytic_model.displacement(1, (-0.06, 0, 0), t, *p)
                      - 0.5 * analytic_model.displacement(0, (0.06, 0.1, 0.05), t, *p), 4e-6)}
        numbers = []

        def measured(i, t):
            numbers.append([(f(t, TRUTH) + self.random.gauss(0, std), std, lambda y0, ad, f=f: f(t, (y0, ad)))
                            for f, std in formulas.values()])
            return [(name, value, std) for name, (value, std, _) in zip(formulas, numbers[i])]

        self.measure([analytic_model.time(step) for step in (1, 5, 11)], measured)
        self.use_model_times()
        lines = self.assimilate()
        self.assertEqual([line["used"] for line in lines], [28, 28, 28])
        self.expect_agreement(lines, self.posterior_by_quadrature(numbers))

    def test_displacements_of_a_second_device_are_as_those_of_the_first(self):
        """Half of the sensors in a file of their own, half way between whose times lie those of the first: linear in time."""
        times = [analytic_model.time(step) for step in (1, 5, 11)]
        self.measure(times)
        self.use_model_times()
        rows = read_csv(self.folder / "data.csv")
        together = self.assimilate()
        names = sorted({row["sensor"] for row in rows})[::2]
        write_csv(self.folder / "data.csv", [row for row in rows if row["sensor"] not in names])
        second = [row for row in rows if row["sensor"] in names]
        either_side = []
        for shift in (-0.01, 0.01):
            either_side += [{**row, "time": float(row["time"]) + shift, "value": float(row["value"]) + 7e-4 * shift} for row in second]
        write_csv(self.folder / "second.csv", sorted(either_side, key=lambda row: row["time"]))
        self.edit("[parameters]", '[data.sources.lasers]\nfile = "second.csv"\n\n[parameters]')
        apart = self.assimilate()
        for one, other in zip(apart, together, strict=True):
            self.assertEqual(one["used"], other["used"])
            for k in range(2):
                self.assertAlmostEqual(one["mean"][k], other["mean"][k], delta=1e-5 * other["covariance"][k][k] ** 0.5)
                self.assertAlmostEqual(one["covariance"][k][k], other["covariance"][k][k], delta=1e-5 * other["covariance"][k][k])

    def test_each_source_has_a_clock_of_its_own(self):
        """A load cell that is ahead by a constant, a gauge whose clock runs fast: both are found with the parameters."""
        self.edit("[parameters]", f'''[data.std]
reaction_force = 10.0
gauge = 5e-7

[data.sensors.gauge]
kind = "strain"
from = {list(FROM)}
to = {list(TO)}

[data.sources.cell]
file = "cell.csv"
time_offset_std = 0.05
[data.sources.logger]
file = "logger.csv"
time_offset_std = 0.05
time_drift_std = 0.1

[parameters]''')
        ahead = {"reaction_force": lambda t: 0.04, "gauge": lambda t: -0.03 + 0.08 * (t - times[0])}
        times = [analytic_model.time(step) for step in range(1, 11)]
        self.measure(times)
        self.use_model_times()

        def strain(t):
            length = math.dist(FROM, TO)
            u = [[analytic_model.displacement(c, x, t, *TRUTH) for c in range(3)] for x in (FROM, TO)]
            return sum((u[1][c] - u[0][c]) * (TO[c] - FROM[c]) for c in range(3)) / length ** 2

        for file, name, value, std in (("cell.csv", "reaction_force", lambda t: analytic_model.reaction_force(t, *TRUTH), 10.0),
                                       ("logger.csv", "gauge", strain, 5e-7)):
            rows = [(t + ahead[name](t), value(t) + self.random.gauss(0, std)) for t in (k / 100 for k in range(101))]
            (self.folder / file).write_text("\n".join([f"time,{name}", *(f"{t!r},{v!r}" for t, v in rows)]) + "\n")
        last = self.assimilate()[-1]
        for k in range(2):
            self.assertLess(abs(last["mean"][k] - TRUTH[k]), 3 * last["covariance"][k][k] ** 0.5)
        for name, truth in (("cell.time_offset", 0.04), ("logger.time_offset", -0.03), ("logger.time_drift", 0.08)):
            found = last["nuisances"][name]
            self.assertLess(abs(found["mean"] - truth), 3 * found["std"], name)
            self.assertLess(found["std"], 0.03, name)
        self.assertNotIn("cell.time_drift", last["nuisances"])
        self.expect_same_as_the_last_step()
        self.expect(0, "report", "results", "-o", "report.html")
        self.assertRegex((self.folder / "report.html").read_text(), r"The clock of the source logger runs faster by a share of 0\.\d+")
        for name in ("cell", "logger"):  # as if there were one clock
            self.edit(f'file = "{name}.csv"\ntime_offset_std = 0.05\n', f'file = "{name}.csv"\n')
        self.edit("time_drift_std = 0.1\n", "")
        self.assimilate(status=8)

    def test_a_strain_of_image_correlation_has_the_window_that_it_was_fitted_over(self):
        """As the weighted sum of displacements that a plane of least squares is, written down here."""
        at, window, side = (0.01, 0.055, 0.05), 0.012, 9
        offsets = [((i + 0.5) / side - 0.5) * window for i in range(side)]
        squares = side * sum(o * o for o in offsets)
        terms = [((at[0] + a, at[1] + b, at[2]), c, (b if c == "x" else a) / squares / 2) for a in offsets for b in offsets for c in "xy"]
        head = "[data.sensors.shear]\n"
        plain = head + f'''kind = "combination"
points = {[list(p) for p, _, _ in terms]}
components = {json.dumps([c for _, c, _ in terms])}
coefficients = {[w for _, _, w in terms]}
'''
        windowed = head + f'kind = "strain-in-window"\nat = {list(at)}\nstrain = "xy"\nwindow = {window}\n'
        self.measure([analytic_model.time(step) for step in (1, 5, 11)], lambda i, t: [
            ("shear", sum(w * analytic_model.displacement("xyz".index(c), p, t, *TRUTH) for p, c, w in terms), 3e-5)])
        self.use_model_times()
        self.edit("[parameters]", windowed + "\n[parameters]")
        lines = self.assimilate()
        self.assertEqual([line["used"] for line in lines], [25, 25, 25])
        self.edit(windowed, plain)
        for one, other in zip(lines, self.assimilate(), strict=True):
            for k in range(2):
                self.assertAlmostEqual(one["mean"][k], other["mean"][k], delta=1e-9)
        self.edit(plain, windowed)
        for old, new, text in ((f"window = {window}", "window = 0.0", "window"), ('strain = "xy"', 'strain = "yx"', '"xx", "yy", "zz"'),
                               (f"at = {list(at)}", "at = [0.0]", '"at" = [x, y, z]'), (f"window = {window}\n", "", 'needs "window"')):
            self.edit(old, new)
            self.expect(3, "check", self.project_name, stderr=text)
            self.edit(new, old) if new else None

    def test_what_a_source_cannot_be_is_told(self):
        self.measure([analytic_model.time(3), analytic_model.time(5)], lambda i, t: [("reaction_force", 400.0 + i, 60.0)])
        self.use_model_times()
        self.edit("[parameters]", '[data.sources.cell]\nfile = "cell.csv"\n\n[parameters]')
        self.expect(4, "assimilate", self.project_name, stderr=["cell.csv"])
        cell = self.folder / "cell.csv"
        cell.write_text("time,reaction_force\n0.0,0.0\n1.0,900.0\n")
        self.expect(4, "assimilate", self.project_name, stderr=['cell.csv: its series "reaction_force" is in another file of [data] too'])
        cell.write_text("time,imposed_displacement\n5.0,0.0\n6.0,900.0\n")
        self.expect(4, "assimilate", self.project_name, stderr=["cell.csv: its times, 5 to 6", "those of the data file"])
        self.edit("[data]\n", "[data]\ntime_drift_std = 0.1\n")
        self.expect(3, "check", self.project_name, stderr=[self.position_of("time_drift_std"), "it needs both"])
        self.edit("time_drift_std = 0.1\n", "")
        self.edit('file = "cell.csv"', 'fil = "cell.csv"')
        self.expect(3, "check", self.project_name, stderr=["data.sources.cell", '"file"'])

    def test_series_that_nobody_knows_and_sensors_without_values_are_named(self):
        times = [analytic_model.time(3)]
        self.measure(times, lambda i, t: [("reaction_forze", 400.0, 1.0)])
        self.use_model_times()
        self.expect(4, "assimilate", self.project_name, stderr=["reaction_forze", "neither an output", 'did you mean "reaction_force"?'])
        self.measure(times, lambda i, t: [("reaction_force", 400.0, "")])
        self.use_model_times()
        self.expect(0, "assimilate", self.project_name, stderr='the series "reaction_force" is not used: it has no std')
        self.edit("[parameters]", '[data.sensors.gauge]\nkind = "strain"\nfrom = [0.0, 0.0, 0.0]\nto = [0.03, 0.0, 0.0]\n\n[parameters]')
        self.expect(3, "assimilate", self.project_name, stderr=['no series "gauge"', self.position_of("[data.sensors.gauge]")])
        self.edit("to = [0.03, 0.0, 0.0]", "to = [0.0, 0.0, 0.0]")
        self.expect(3, "check", self.project_name, stderr="between a point and itself")

    def test_a_parameter_that_is_known_is_given_not_inferred(self):
        """Ad goes with the temperature, say: Y0 alone is inferred, as quadrature over it does with the Ad of each time."""
        self.edit('Ad = { prior = "normal", mean = 1.1, std = 0.4472135954999579 }', 'Ad = { prior = "known" }')
        known = [0.7 + 0.06 * i for i in range(6)]
        times = [analytic_model.time(2 * i + 1) for i in range(6)]

        def measure(values, std="", scale=1.0):
            """Displacements of the true Ad of each time, always with the same noise."""
            self.random = random.Random(3)
            self.measure(times, lambda i, t: [("Ad", values[i], std)])
            rows = read_csv(self.folder / "data.csv")
            for row in rows:
                i = round(float(row["time"]) / 10)
                row["time"] = repr(times[i])
                if row["component"] in COMPONENT:
                    c, point = COMPONENT[row["component"]], tuple(float(row[k]) for k in "xyz")
                    row["std"] = repr(scale * float(row["std"]))
                    row["value"] = repr(analytic_model.displacement(c, point, times[i], 1.05, known[i])
                                        + self.random.gauss(0, float(row["std"])))
            write_csv(self.folder / "data.csv", rows)
            return rows

        def moments_by_quadrature(rows, errors):
            """Mean and std of Y0 by quadrature, also over the error of each known value, weighted `errors`."""
            nodes = [0.5 + (k + 0.5) / 200 for k in range(200)]
            density = [-0.5 * ((y0 - 0.9) / PRIORS[0][1]) ** 2 for y0 in nodes]
            for i, t in enumerate(times):
                data = [(COMPONENT[r["component"]], tuple(float(r[k]) for k in "xyz"), float(r["value"]), float(r["std"]))
                        for r in rows if r["component"] in COMPONENT and float(r["time"]) == t]
                for k, y0 in enumerate(nodes):
                    terms = [log_weight - 0.5 * sum(((value - analytic_model.displacement(c, x, t, y0, known[i] + e)) / std) ** 2
                                                    for c, x, value, std in data) for e, log_weight in errors]
                    density[k] += max(terms) + math.log(sum(math.exp(v - max(terms)) for v in terms))
            weight = [math.exp(v - max(density)) for v in density]
            mean = sum(w * y for w, y in zip(weight, nodes)) / sum(weight)
            return mean, math.sqrt(sum(w * (y - mean) ** 2 for w, y in zip(weight, nodes)) / sum(weight))

        rows = measure(known)
        last = self.assimilate()[-1]
        mean, std = moments_by_quadrature(rows, [(0.0, 0.0)])
        self.assertEqual(len(last["mean"]), 1)
        self.assertAlmostEqual(last["mean"][0], mean, delta=0.02 * std)
        self.assertAlmostEqual(math.sqrt(last["covariance"][0][0]), std, delta=0.02 * std)
        # Forecasts are those at the last value, or at one that is given.
        force = last["forecast"]["force"]["mean"]
        self.assertAlmostEqual(force, analytic_model.reaction_force(0.75, mean, known[-1]), delta=3)
        self.edit('prior = "known" }', 'prior = "known", value = 0.6 }')
        self.assertAlmostEqual(self.assimilate()[-1]["forecast"]["force"]["mean"],
                               analytic_model.reaction_force(0.75, mean, 0.6), delta=3)
        # An error of what is known makes the answer wider, as quadrature over it says.
        rows = measure(known, 0.15, 0.1)
        last = self.assimilate()[-1]
        surer = moments_by_quadrature(rows, [(0.0, 0.0)])[1]
        mean, std = moments_by_quadrature(rows, [(0.15 * k / 2, -0.5 * (k / 2) ** 2) for k in range(-6, 7)])
        self.assertGreater(std, 1.05 * surer)
        self.assertAlmostEqual(last["mean"][0], mean, delta=0.3 * std)  # it goes in linearised
        self.assertAlmostEqual(math.sqrt(last["covariance"][0][0]), std, delta=0.025 * std)
        measure([2.0] * 6)
        self.expect(4, "assimilate", self.project_name, stderr=["outputs/Ad[0] = 2", "outside the model's axis, 0.5 to 1.5"])
        self.measure(times)
        self.use_model_times()
        self.expect(4, "assimilate", self.project_name, stderr=["the parameter Ad is known", "no series of that name"])
        self.edit("value = 0.6", "mean = 0.6")
        self.expect(3, "check", self.project_name, stderr='"mean" does not belong to a known parameter')

    def test_forecasts_are_scored_when_they_come_true(self):
        """The displacement of a sensor and a force, forecast and then measured."""
        sensor = self.sensors[0]
        self.edit('point = [0.03, 0.05, 0.05]\ncomponent = "y"',
                  f'point = [{sensor["x"]}, {sensor["y"]}, {sensor["z"]}]\ncomponent = "{sensor["component"]}"')
        times = [analytic_model.time(step) for step in range(12)]
        self.measure(times, lambda i, t: [("reaction_force", analytic_model.reaction_force(t, *TRUTH) + 20, 30.0)])
        self.use_model_times()
        lines = self.assimilate()
        scores = {}
        for line in lines:
            scores.update(line.get("scores", {}))
        self.assertIn("force", lines[8]["scores"])  # 0.75 is the time of step 8
        self.assertEqual(sorted(scores), ["deflection", "force"])
        self.assertEqual(json.loads((self.folder / "results" / "summary.json").read_text())["scores"], scores)
        for name, noise in (("force", 30.0), ("deflection", float(sensor["std"]))):
            score = scores[name]
            self.assertEqual(score["step"], list(range(8 if name == "force" else 11)))
            for step, lead, crps, probability in zip(score["step"], score["lead_time"], score["crps"], score["probability"]):
                self.assertAlmostEqual(lead, score["time"] - times[step], places=12)
                forecast = lines[step]["forecast"][name]
                # The forecast is nearly normal; the noise of the measurement joins it.
                spread = math.hypot(forecast["std"], noise)
                z = (score["observed"] - forecast["mean"]) / spread
                phi, cdf = math.exp(-z * z / 2) / math.sqrt(2 * math.pi), 0.5 * math.erfc(-z / math.sqrt(2))
                self.assertAlmostEqual(crps, spread * (z * (2 * cdf - 1) + 2 * phi - 1 / math.sqrt(math.pi)), delta=0.05 * spread)
                self.assertAlmostEqual(probability, cdf, delta=0.05)

    def test_a_structure_that_changes_is_forgotten_by_the_project_file(self):
        """The truth is another one from step 6 on; with the change known the answer is that of the later data alone."""
        self.edit("[method]\n", "[method]\nchange_points = [6]\n")
        times = [analytic_model.time(step) for step in range(12)]
        self.measure(times)
        self.use_model_times()
        rows = read_csv(self.folder / "data.csv")
        for row in rows:
            if float(row["time"]) < times[6]:
                row["value"] = repr(float(row["value"]) + 2e-5)
        write_csv(self.folder / "data.csv", rows)
        changed = self.assimilate()[-1]
        self.edit("change_points = [6]\n", "")
        write_csv(self.folder / "data.csv", [row for row in rows if float(row["time"]) >= times[6]])
        alone = self.assimilate()[-1]
        for k in (0, 1):
            self.assertAlmostEqual(changed["mean"][k], alone["mean"][k], places=12)
        for text, message in (('forgetting = 1.5', "at most 1"), ('change_points = [1.5]', "must be steps"),
                              ('forgetting = 0.9\nbias_correction = "on"', "cannot be combined with bias_correction")):
            self.edit("[method]\n", f"[method]\n{text}\n")
            self.expect(2 if "bias" in text else 3, "assimilate", self.project_name, stderr=message)
            self.edit(f"[method]\n{text}\n", "[method]\n")

    def use_model_times(self):
        """The data file's times are the model's where there is no clock."""
        rows = read_csv(self.folder / "data.csv")
        for row in rows:
            row["time"] = repr(self.data[round(float(row["time"]) / 10)][0])
        write_csv(self.folder / "data.csv", rows)


if __name__ == "__main__":
    unittest.main()
