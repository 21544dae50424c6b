"""posterior.nc as xarray and ArviZ read it: coordinates, draws, predictions with noise, likelihood, forecasts, size."""
import json
import math
import sys
import unittest

try:
    import h5netcdf  # noqa: F401, xarray reads the file by it
    import numpy as np
    import xarray
except ImportError as missing:
    print(f"skipped: {sys.executable} has no {missing.name} (Debian: python3-{missing.name})")
    sys.exit(77)

import analytic_model
from support import Case, parse_line, read_csv, write_csv

NAMES, NOISE, AXES = ("Y0", "Ad"), 3e-6, "xyz"


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def group(self, name, folder="results"):
        return xarray.load_dataset(self.folder / folder / "posterior.nc", group=name, engine="h5netcdf")

    @staticmethod
    def formula(places, time, y0, ad):
        """The displacements of the formula, [observation]."""
        return np.array([analytic_model.displacement(AXES.index(str(c)), (x, y, z), time, y0, ad) for c, x, y, z in zip(
            places.direction.values, places.x.values, places.y.values, places.z.values)])

    def test_dimensions_have_coordinates(self):
        lines = self.assimilate()
        for name in ("posterior", "posterior_predictive", "log_likelihood"):
            group = self.group(name)
            for dimension in ("chain", "draw", "step"):
                self.assertEqual(group[dimension].dtype, np.int64, (name, dimension))
            np.testing.assert_allclose(group.time, [line["time"] for line in lines])
            self.assertEqual(group.time.dims, ("step",))
        data = self.group("observed_data")
        self.assertEqual(data.displacement.dims, ("step", "observation"))
        self.assertEqual(len(set(data.observation.values)), 24)
        self.assertEqual([name[0] for name in data.observation.values], list(data.direction.values))
        np.testing.assert_array_equal(np.c_[data.x, data.y, data.z], self.group("constant_data").points)
        self.assertEqual(list(self.group("weighted_posterior").parameter.values), list(NAMES))
        draws = self.group("posterior")["Y0"]
        self.assertEqual((draws.attrs["units"], float(draws.attrs["reference"])), ("1", 216.0))

    def test_sensors_have_the_names_that_the_data_give_them(self):
        rows = read_csv(self.folder / "data.csv")
        first = rows[0]["sensor"]
        for row in rows:
            row["sensor"] = "gauge A" if row["sensor"] == first else f"point {row['sensor']}"
            row["value"] = "1.0" if row["sensor"] == "gauge A" and row["component"] == "x" else row["value"]
        write_csv(self.folder / "data.csv", rows)
        self.edit('data = "data.h5"', 'data = "data.csv"')
        message = self.assimilate(status=8)[-1]["verdict"]["reasons"][0]["message"]
        names = list(self.group("observed_data").observation.values)
        self.assertIn(names[0], ("gauge A", "gauge A x"))
        self.assertEqual(len(set(names)), 24)
        self.assertIn(f'sensor "{names[0]}" (x at ', message)

    def test_groups_say_what_they_are(self):
        self.assimilate()
        self.assertIn("has nothing to do with draw n of another", self.group("posterior").attrs["description"])
        for name in ("posterior_predictive", "log_likelihood", "observed_data", "sample_stats", "weighted_posterior", "last_posterior"):
            self.assertTrue(self.group(name).attrs["description"], name)

    def test_draws_are_distinct_and_have_the_moments_of_the_lines(self):
        for method in ("transport", "grid", "mcmc"):
            with self.subTest(method):
                lines = self.assimilate("--method", method, "-o", method)
                posterior = self.group("posterior", method)
                draws = np.stack([posterior[name].values[0] for name in NAMES], axis=-1)  # [draw, step, parameter]
                for step, line in enumerate(lines):
                    self.assertEqual(len(np.unique(draws[:, step], axis=0)), 500)
                    if method != "mcmc":  # a chain stays where it is; its first return is moved in all parameters
                        self.assertEqual([len(np.unique(draws[:, step, k])) for k in range(2)], [500, 500])
                    std = np.sqrt(np.diag(line["covariance"]))
                    self.assertLess(np.max(abs(draws[:, step].mean(0) - line["mean"]) / std), 0.25)
                    self.assertTrue(np.all(abs(draws[:, step].std(0) / std - 1) < 0.2))
                    self.assertTrue(np.all((draws[:, step] >= 0.5) & (draws[:, step] <= 1.5)))

    def test_predictions_have_the_noise_of_the_sensors(self):
        self.assimilate()
        predicted, posterior = self.group("posterior_predictive"), self.group("posterior")
        self.assertTrue(set(predicted.draw.values) <= set(posterior.draw.values))
        drawn = posterior.sel(draw=predicted.draw)
        residual = np.array([[predicted.displacement.sel(chain=0, draw=draw).isel(step=step).values - self.formula(
            predicted, float(predicted.time[step]), *(float(drawn[name].sel(chain=0, draw=draw)[step]) for name in NAMES))
            for step in range(12)] for draw in predicted.draw.values])
        self.assertAlmostEqual(residual.std() / NOISE, 1, delta=0.03)  # 14,400 numbers
        self.assertLess(abs(residual.mean()) / NOISE, 0.03)
        flat = residual.reshape(len(residual), -1) / NOISE
        self.assertLess(np.max(abs(np.corrcoef(flat[:, :24].T) - np.eye(24))), 0.65)  # independent sensors

    def test_the_likelihood_is_that_of_the_formula(self):
        self.assimilate()
        likelihood, posterior, data = self.group("log_likelihood"), self.group("posterior"), self.group("observed_data")
        for step, draw in ((0, 0), (5, 17), (11, 499)):
            p = [float(posterior[name].sel(chain=0, draw=draw)[step]) for name in NAMES]
            z = (data.displacement.values[step] - self.formula(data, float(data.time[step]), *p)) / NOISE
            exact = -0.5 * z @ z - 24 * math.log(NOISE * math.sqrt(2 * math.pi))
            self.assertAlmostEqual(float(likelihood.datum.sel(chain=0, draw=draw)[step]), exact, delta=0.05 + 1e-3 * z @ z)

    def test_forecasts_and_verdict_are_in_the_file(self):
        lines = self.assimilate()
        forecasts = self.group("forecast")
        self.assertEqual(list(forecasts.forecast.values), ["force", "deflection"])
        self.assertEqual(list(forecasts.units.values), ["N", "m"])
        np.testing.assert_allclose(forecasts.horizon, [0.75, 1.0])
        np.testing.assert_allclose(forecasts.threshold, [1150.0, -3.7e-4])
        for key in ("mean", "std", "probability_above_threshold", "probability_below_threshold"):
            np.testing.assert_array_equal(forecasts[key], [[f[key] for f in line["forecast"].values()] for line in lines])
        np.testing.assert_array_equal(forecasts.quantiles[-1, 0], lines[-1]["forecast"]["force"]["values"])
        summary = parse_line((self.folder / "results" / "summary.json").read_text())
        whole = xarray.open_dataset(self.folder / "results" / "posterior.nc", engine="h5netcdf")
        self.assertEqual(json.loads(whole.attrs["verdict"]), summary["verdict"])
        levels = [["ok", "caution", "reject"].index(line["verdict"]["level"]) for line in lines]
        statistics = self.group("sample_stats")
        np.testing.assert_array_equal(statistics.verdict, levels)
        self.assertEqual([bool(text) for text in statistics.verdict_reasons.values], [level > 0 for level in levels])

    def test_many_points_of_a_step_do_not_make_the_file_large(self):
        self.edit('kind = "transport"', 'kind = "smc"\nsamples = 20000')
        lines = self.assimilate()
        self.assertLess((self.folder / "results" / "posterior.nc").stat().st_size, 4.8e6)  # 40 MB for 100 steps
        weighted, last = self.group("weighted_posterior"), self.group("last_posterior")
        self.assertLessEqual(weighted.sizes["point"], 2048)
        np.testing.assert_allclose(weighted.weights.sum("point"), 1)
        np.testing.assert_allclose(last.weights @ last.points, lines[-1]["mean"], rtol=1e-12)
        for step, line in enumerate(lines):
            std = np.sqrt(np.diag(line["covariance"]))
            self.assertLess(np.max(abs((weighted.weights[step] @ weighted.points[step] - line["mean"]) / std)), 0.1)
        (forecast,) = self.expect(0, "forecast", self.project_name, "--json").lines()
        self.assertEqual(forecast["forecast"]["force"]["mean"], lines[-1]["forecast"]["force"]["mean"])


if __name__ == "__main__":
    unittest.main()
