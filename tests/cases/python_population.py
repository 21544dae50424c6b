"""`knothe.population` and `knothe.PosteriorOf`; and Virkler's 48 sheets, each left out of the population of the others."""
import math
import re
import subprocess
import sys
import unittest

try:
    import numpy as np
except ImportError:
    print(f"skipped: {sys.executable} has no numpy (Debian: python3-numpy)")
    sys.exit(77)

from support import DATA, REPOSITORY, CaseInItsFolder, by_form

import knothe

EFFECTS, ERRORS = np.array([28, 8, -3, 7, -1, 1, 18, 12]), np.array([15, 10, 16, 11, 9, 11, 10, 18])  # Rubin 1981
RECORDS = DATA / "virkler_crack_growth" / "virkler_specimens_01_48.csv"


def school(effect, error, std=30.0):
    return knothe.infer(lambda p: p, {"effect": knothe.Normal(0, std)}, observed=[effect], std=error, vectorized=True, method="transport")


class Test(CaseInItsFolder):
    def test_eight_schools_as_by_dense_quadrature(self):
        found = knothe.population({str(k): school(*pair) for k, pair in enumerate(zip(EFFECTS, ERRORS))}, output="schools")
        self.assertTrue(found.trusted, found.remark)
        mu, tau = np.meshgrid(np.linspace(-150, 150, 1501), np.linspace(0, 180, 1801), indexing="ij")
        log_density = -0.5 * (mu / 30) ** 2 - 0.5 * (tau / 30) ** 2
        for y, s in zip(EFFECTS, ERRORS):
            log_density += -0.5 * (y - mu) ** 2 / (s**2 + tau**2) - 0.5 * np.log(s**2 + tau**2)
        weight = np.exp(log_density - log_density.max())
        weight[:, 0] /= 2
        weight /= weight.sum()

        def judged(mean, std, values, variance=0.0):
            exact = (weight * values).sum()
            deviation = math.sqrt((weight * ((values - exact) ** 2 + variance)).sum())
            self.assertAlmostEqual(mean, exact, delta=0.1 * deviation)
            self.assertAlmostEqual(std, deviation, delta=0.1 * deviation)

        judged(found.mean[0], found.record["mean"]["std"][0], mu)
        judged(found.spread[0], found.record["spread"]["std"][0], tau)
        judged(found.new_specimen.mean(), found.new_specimen.std(), mu, tau**2)
        for k, (y, s) in enumerate(zip(EFFECTS, ERRORS)):
            specimen = found.specimens[str(k)]
            judged(specimen["mean"][0], specimen["std"][0], (y * tau**2 + mu * s**2) / (s**2 + tau**2), s**2 * tau**2 / (s**2 + tau**2))
            self.assertTrue(specimen["belongs"])

    def test_a_notebook_shows_the_population_and_each_specimen(self):
        found = knothe.population({"<A>": school(10.0, 3.0), "B": school(14.0, 3.0)})
        table = found._repr_html_()
        for name, each in {"&lt;A&gt;": found.specimens["<A>"], "population: spread": found.record["spread"]}.items():
            mean, std = re.search(rf">{name}</td><td[^>]*>([-\d.]+) ± ([\d.]+)<", table).groups()
            self.assertAlmostEqual(float(mean), each["mean"][0], delta=0.051 * each["std"][0])
            self.assertAlmostEqual(float(std), each["std"][0], delta=0.051 * each["std"][0])
        self.assertIn(found.remark.split()[0], table)

    def test_the_population_is_a_prior(self):
        found = knothe.population([school(y, 3.0) for y in (10.0, 14.0, 12.0, 11.0)], output="four")
        prior = knothe.PosteriorOf("four", name="effect")
        self.assertEqual(prior, knothe.PosteriorOf("four", name="effect"))
        after = knothe.infer(lambda p: p, {"score": prior}, observed=[30.0], std=20.0, vectorized=True)
        variance = float(found.new_specimen.var())
        expected = found.new_specimen.mean() + variance / (variance + 400) * (30 - found.new_specimen.mean())
        self.assertAlmostEqual(after.mean[0], expected, delta=0.3 * math.sqrt(variance))
        with self.assertRaisesRegex(knothe.ProjectError, 'four holds the posterior of effect, not of "score"'):
            knothe.infer(lambda p: p, {"score": knothe.PosteriorOf("four")}, observed=[30.0], std=20.0)

    def test_what_is_wrong_is_told(self):
        one = school(10.0, 3.0)
        with self.assertRaisesRegex(knothe.UsageError, "at least two specimens, not 1"):
            knothe.population([one])
        density = knothe.infer(lambda p: -0.5 * p @ p, {"effect": knothe.Normal(0, 1)})
        with self.assertRaisesRegex(knothe.UsageError, "specimen 2: its prior is not known .a density given by its logarithm has none"):
            knothe.population([one, density])

    def test_lives_of_sheets_from_those_of_the_others(self):
        if not RECORDS.is_file():
            self.skipTest(f"{RECORDS} is not there: scripts/get-data.sh, or set KNOTHE_DATA to the folder of recorded data")
        try:
            import scipy.optimize  # noqa: F401
        except ImportError:
            self.skipTest("no scipy here: python3-scipy of scripts/packages.txt")
        program = REPOSITORY / "examples" / "crack_growth" / "population.py"
        left_out = by_form(["1", "1"], ["1", "48"])
        outcome = subprocess.run([sys.executable, program, RECORDS, *left_out], capture_output=True, text=True)
        self.assertEqual(outcome.returncode, 0, outcome.stderr)
        print(outcome.stdout)
        held, count = map(int, re.search(r"(\d+) of (\d+) in the 90 % interval", outcome.stdout).groups())
        if count == 48:
            self.assertTrue(0.85 * count <= held <= 0.95 * count, outcome.stdout)


if __name__ == "__main__":
    unittest.main()
