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
        for name in ("posterior", "posterior_predictive", "log_likelihood", "prior", "prior_predictive", "sample_stats"):
            group = self.group(name)
            of_data = name not in ("posterior", "prior", "sample_stats")
            for dimension in ("chain", "draw", "step") if of_data else ("chain", "draw"):
                self.assertEqual(group[dimension].dtype, np.int64, (name, dimension))
            self.assertEqual(group.attrs["inference_library"], "knothe", name)
            if of_data:
                np.testing.assert_allclose(group.time, [line["time"] for line in lines])
                self.assertEqual(group.time.dims, ("step",))
                self.assertEqual(group.displacement.dims, ("chain", "draw", "step", "observation"))
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
        whole = xarray.open_dataset(self.folder / "results" / "posterior.nc", engine="h5netcdf")
        self.assertEqual(whole.attrs["Conventions"], "CF-1.8")
        self.assertIn("posterior", whole.attrs["title"])
        self.assertRegex(whole.attrs["history"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:[\d.]+Z knothe \d+\.\d+")
        self.assertEqual({self.group(name).time.attrs["units"] for name in ("observed_data", "log_likelihood", "posterior_predictive")}, {"1"})
        self.assertIn("the posterior of all data", self.group("posterior").attrs["description"])
        for name in ("history", "posterior_predictive", "log_likelihood", "observed_data", "sample_stats", "weighted_posterior", "last_posterior"):
            self.assertTrue(self.group(name).attrs["description"], name)

    def test_draws_are_distinct_and_have_the_moments_of_the_last_line(self):
        for method in ("transport", "grid", "mcmc"):
            with self.subTest(method):
                line = self.assimilate("--method", method, "-o", method)[-1]
                posterior = self.group("posterior", method)
                draws = np.stack([posterior[name].values for name in NAMES], axis=-1)
                self.assertEqual(draws.shape, (4, 250, 2))
                flat, std = draws.reshape(-1, 2), np.sqrt(np.diag(line["covariance"]))
                self.assertEqual(len(np.unique(flat, axis=0)), 1000)
                if method != "mcmc":  # a chain stays where it is; its first return is moved in all parameters
                    self.assertEqual([len(np.unique(flat[:, k])) for k in range(2)], [1000, 1000])
                self.assertLess(np.max(abs(flat.mean(0) - line["mean"]) / std), 0.2)
                self.assertTrue(np.all(abs(flat.std(0) / std - 1) < 0.15))
                self.assertTrue(np.all((flat >= 0.5) & (flat <= 1.5)))
                # Chains are parts of one sample: their means differ as those of independent draws do.
                self.assertLess(np.max(abs(draws.mean(1) - line["mean"]) / std), 4 / np.sqrt(250))

    def test_draws_of_the_prior_have_its_moments(self):
        self.assimilate()
        prior = self.group("prior")
        for name, mean in zip(NAMES, (0.9, 1.1)):  # normal, std 0.447, within [0.5, 1.5]
            x = np.linspace(0.5, 1.5, 2001)
            density = np.exp(-0.5 * ((x - mean) / 0.4472135954999579) ** 2)
            exact = np.average(x, weights=density)
            spread = np.sqrt(np.average((x - exact) ** 2, weights=density))
            draws = prior[name].values.ravel()
            self.assertAlmostEqual(draws.mean(), exact, delta=4 * spread / np.sqrt(1000))
            self.assertAlmostEqual(draws.std() / spread, 1, delta=0.08)

    def drawn(self, group):
        """The parameters of the draws of a group, [draw, parameter]."""
        posterior = self.group("posterior").sel(draw=group.draw)
        return np.stack([posterior[name].values.ravel() for name in NAMES], axis=-1)

    def test_predictions_have_the_noise_of_the_sensors(self):
        self.assimilate()
        predicted = self.group("posterior_predictive")
        values = predicted.displacement.values.reshape(-1, 12, 24)
        residual = np.array([[values[i, step] - self.formula(predicted, float(predicted.time[step]), *p) for step in range(12)]
                             for i, p in list(enumerate(self.drawn(predicted)))[::10]])
        self.assertAlmostEqual(residual.std() / NOISE, 1, delta=0.03)
        self.assertLess(abs(residual.mean()) / NOISE, 0.03)
        flat = residual.reshape(len(residual), -1) / NOISE
        self.assertLess(np.max(abs(np.corrcoef(flat[:, :24].T) - np.eye(24))), 0.65)  # independent sensors

    def test_the_likelihood_is_that_of_the_formula(self):
        self.assimilate()
        likelihood, data, statistics = self.group("log_likelihood"), self.group("observed_data"), self.group("sample_stats")
        values = likelihood.displacement.values.reshape(-1, 12, 24)
        total = statistics.log_likelihood.values.ravel()
        drawn = self.drawn(likelihood)
        for draw in (0, 17, len(drawn) - 1):
            exact = np.array([-0.5 * ((data.displacement.values[step] - self.formula(data, float(data.time[step]), *drawn[draw])) / NOISE) ** 2
                              for step in range(12)]) - math.log(NOISE * math.sqrt(2 * math.pi))
            np.testing.assert_allclose(values[draw], exact, atol=2e-3, rtol=2e-3)  # the model is an interpolant
            self.assertAlmostEqual(total[draw], values[draw].sum(), delta=1e-3)

    def test_values_that_are_missing_say_nothing(self):
        rows = read_csv(self.folder / "data.csv")
        sensor = rows[0]["sensor"]
        write_csv(self.folder / "data.csv", [row for row in rows if row["sensor"] != sensor or row["time"] != rows[0]["time"]])
        self.edit('data = "data.h5"', 'data = "data.csv"')
        self.assimilate()
        data, likelihood = self.group("observed_data").displacement.values, self.group("log_likelihood").displacement.values
        self.assertTrue(np.isnan(data).any())
        self.assertTrue(np.all(likelihood[:, :, np.isnan(data)] == 0))
        self.assertTrue(np.all(np.isfinite(likelihood)))

    def test_leave_one_out_by_arviz_is_that_of_fits_without_the_value(self):
        """Of independent values, against importance sampling with exact weights on a dense grid."""
        try:
            import arviz
        except ImportError as missing:
            self.skipTest(f"{sys.executable} has no {missing.name}")
        lines = self.assimilate()
        data = arviz.from_netcdf(self.folder / "results" / "posterior.nc")
        summary = arviz.summary(data)
        self.assertEqual(list(summary.index), list(NAMES))
        self.assertTrue(np.all(summary["r_hat"] < 1.02))
        found = arviz.loo(data)
        observed = self.group("observed_data")
        grid = [np.linspace(lines[-1]["mean"][k] - 6 * lines[-1]["covariance"][k][k] ** 0.5,
                            lines[-1]["mean"][k] + 6 * lines[-1]["covariance"][k][k] ** 0.5, 41) for k in range(2)]
        points = [(a, b) for a in grid[0] for b in grid[1]]
        prior = np.array([-0.5 * (((a - 0.9) / 0.4472135954999579) ** 2 + ((b - 1.1) / 0.4472135954999579) ** 2) for a, b in points])
        each = np.array([[-0.5 * ((observed.displacement.values[step] - self.formula(observed, float(observed.time[step]), *p)) / NOISE) ** 2
                          for step in range(12)] for p in points]) - math.log(NOISE * math.sqrt(2 * math.pi))
        each = each.reshape(len(points), -1)
        whole = prior + each.sum(1)
        largest = whole.max()
        without = np.exp(whole[:, None] - each - (largest - each.max()))
        exact = np.log((without * np.exp(each)).sum(0) / without.sum(0)).sum()
        self.assertAlmostEqual(float(found.elpd_loo if hasattr(found, "elpd_loo") else found.elpd), exact, delta=0.4)

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
        statistics = self.group("history")
        np.testing.assert_array_equal(statistics.verdict, levels)
        for key in ("ess", "log_evidence", "map_order", "used", "time"):
            np.testing.assert_array_equal(statistics[key], [line[key] for line in lines])
        np.testing.assert_array_equal(statistics["mean"], [line["mean"] for line in lines])
        np.testing.assert_array_equal(statistics.quantiles, [line["quantiles"]["values"] for line in lines])
        self.assertEqual([bool(text) for text in statistics.verdict_reasons.values], [level > 0 for level in levels])

    def test_many_points_of_a_step_do_not_make_the_file_large(self):
        self.edit('kind = "transport"', 'kind = "smc"\nsamples = 20000')
        lines = self.assimilate()
        self.assertLess((self.folder / "results" / "posterior.nc").stat().st_size, 7e6)
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
