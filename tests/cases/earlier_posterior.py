"""The posterior of an earlier test as the prior of the next; judged by dense quadrature of all data at once."""
import unittest

import analytic_model
from support import Case, correlation, read_csv, write_csv

PRIORS = [(0.9, 0.4472135954999579), (1.1, 0.4472135954999579)]
COMPONENT = {"x": 0, "y": 1, "z": 2}
PLAIN = "{ prior = \"normal\", mean = 0.9, std = 0.4472135954999579 }", "{ prior = \"normal\", mean = 1.1, std = 0.4472135954999579 }"


class Test(Case):
    project_name = "assimilation.toml"
    fixture = "analytic"

    def setUp(self):
        super().setUp()
        self.rows = read_csv(self.folder / "data.csv")
        (self.folder / "data.csv").unlink()
        self.edit('data = "data.h5"', 'data = "data.csv"')

    def measure(self, times):
        """Writes the data of these times."""
        write_csv(self.folder / "data.csv", [row for row in self.rows if float(row["time"]) in times])

    def take_as_priors(self, where="first", names=("Y0", "Ad")):
        for name, plain in zip(names, PLAIN):
            self.edit(plain, f'{{ prior = "posterior", of = "{where}" }}')

    def halves(self):
        times = sorted({float(row["time"]) for row in self.rows})
        return times[:len(times) // 2], times[len(times) // 2:]

    def judge(self):
        """All data, with the priors of the first test."""
        posterior = analytic_model.Posterior(PRIORS, 96)
        for time in sorted({float(row["time"]) for row in self.rows}):
            posterior.add(time, [(COMPONENT[row["component"]], tuple(float(row[k]) for k in "xyz"), float(row["value"]), float(row["std"]))
                                 for row in self.rows if float(row["time"]) == time and row["value"]])
        return posterior.summary(0)

    def test_data_of_two_tests_are_data_of_one(self):
        first, second = self.halves()
        self.measure(first)
        before = self.assimilate("-o", "first")[-1]
        self.measure(second)
        self.take_as_priors()
        exact = self.judge()
        for kind in ("auto", "grid", "transport", "ukf"):
            after = self.assimilate("--method", kind)[-1]
            for k in range(2):
                sigma = exact["covariance"][k][k] ** 0.5
                self.assertLess(abs(after["mean"][k] - exact["mean"][k]) / sigma, 0.02 if kind != "ukf" else 0.2, kind)
                self.assertLess(abs(after["covariance"][k][k] ** 0.5 / sigma - 1), 0.02 if kind != "ukf" else 0.1, kind)
            self.assertLess(abs(correlation(after) - correlation(exact)), 0.02 if kind != "ukf" else 0.1)
            if kind != "ukf":
                self.assertLess(abs(before["log_evidence"] + after["log_evidence"] - exact["log_evidence"]), 0.02)
                self.assertEqual(after["verdict"]["level"], "ok")

    def test_infer_takes_it_too(self):
        first, second = self.halves()
        self.measure(first)
        self.expect(0, "infer", self.project_name, "--json", "--method", "grid", "-o", "first")
        self.measure(second)
        self.take_as_priors("first/samples.nc")
        found = self.expect(0, "infer", self.project_name, "--json", "--method", "smc").lines()[0]
        exact = self.judge()
        for k in range(2):
            sigma = exact["covariance"][k][k] ** 0.5
            self.assertLess(abs(found["mean"][k] - exact["mean"][k]) / sigma, 0.1)
            self.assertLess(abs(found["covariance"][k][k] ** 0.5 / sigma - 1), 0.05)

    def test_what_is_wrong_is_told_where(self):
        first, second = self.halves()
        self.measure(first)
        self.assimilate("-o", "first")
        self.take_as_priors(names=("Y0",))
        self.edit("of = \"first\"", "from = \"first\"")
        self.expect(3, "check", self.project_name, stderr=("[parameters.Y0]: a posterior prior needs \"of\"", "from"))
        self.edit("from = \"first\"", "of = \"secnd\"")
        self.expect(4, "assimilate", self.project_name, stderr="secnd")
        (self.folder / "secnd").mkdir()
        self.expect(4, "assimilate", self.project_name, stderr="secnd: holds neither posterior.nc nor samples.nc")
        self.edit("of = \"secnd\"", "of = \"first\", mean = 1")
        self.expect(3, "assimilate", self.project_name, stderr="\"mean\" does not belong to a posterior prior, which takes of")

    def test_a_parameter_that_the_earlier_test_has_not_is_named(self):
        times = self.halves()[0]
        self.rows += [{**self.rows[0], "time": repr(time), "sensor": "Ad", "x": "", "y": "", "z": "", "component": "Ad", "value": "0.9", "std": ""}
                      for time in times]
        self.measure(times)
        self.edit("Ad = " + PLAIN[1], 'Ad = { prior = "known", value = 0.9 }')
        self.assimilate("-o", "first")
        self.edit('Ad = { prior = "known", value = 0.9 }', 'Ad = { prior = "posterior", of = "first" }')
        self.expect(3, "assimilate", self.project_name, stderr=("holds the posterior of Y0, not of \"Ad\"; where it has another name there",
                                                                self.position_of('of = "first"')))
        self.edit('of = "first"', 'of = "first", of_name = "Y1"')
        self.expect(3, "assimilate", self.project_name, stderr=("holds the posterior of Y0, not of \"Y1\" (did you mean \"Y0\"?)",
                                                                self.position_of('of_name = "Y1"')))
        # What one calls Y0 is the other's Ad.
        self.edit('of_name = "Y1"', 'of_name = "Y0"')
        self.edit("Y0 = " + PLAIN[0], 'Y0 = { prior = "known", value = 0.9 }')
        for row in self.rows:
            row.update(sensor="Y0", component="Y0") if row["component"] == "Ad" else None
        self.measure(times)
        self.assimilate()


if __name__ == "__main__":
    unittest.main()
