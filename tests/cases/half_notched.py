"""The half-notched concrete beams of Grégoire et al. (docs/benchmarks/half-notched-beam.md): openings as the axis, real forces as data."""
import filecmp
import json
import math
import shutil
import subprocess
import sys
import unittest

from support import DATA, REPOSITORY, Case, python_with

EXAMPLE = REPOSITORY / "examples" / "half_notched"
OTHER_LAWS = ("exponential", "bilinear", "gradient", "band10", "band40", "band80")
ENVELOPE = DATA / "gregoire_half_notched" / "load_cmod_envelope.csv"


class Test(Case):
    project_name = "half_notched.toml"

    def setUp(self):
        self.project_name, name = None, self.project_name
        super().setUp()
        self.project_name = name
        for file in EXAMPLE.iterdir():
            if file.is_file():
                shutil.copy(file, self.folder)

    def script(self, *arguments, python=sys.executable):
        outcome = subprocess.run([python, "half_notched.py", *map(str, arguments)], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(outcome.returncode, 0, outcome.stderr)
        return [json.loads(line) for line in outcome.stdout.splitlines()]

    def make_data(self):
        if not ENVELOPE.is_file():
            self.skipTest(f"{ENVELOPE} is not there: scripts/get-data.sh, or set KNOTHE_DATA to the folder of recorded data")
        self.script("data", ENVELOPE)

    def make_small(self):
        """18 runs of 30 steps, and forces up to the peak only."""
        self.edit("nodes = 7", "nodes = 3", 2)
        self.edit("steps = 150", "steps = 50")
        self.edit("2e-6, 4e-6, ", "")

    def test_the_mesh_is_that_of_the_script(self):
        self.script("mesh", "again.msh")
        self.assertTrue(filecmp.cmp(self.folder / "again.msh", EXAMPLE / "half_notched.msh", shallow=False))

    def test_projects_of_the_other_laws_are_valid(self):
        self.make_data()
        self.script("laws")
        for name in OTHER_LAWS:
            self.expect(0, "check", f"{name}.toml")
            self.expect(0, "check", f"{name}_peak.toml")

    def test_a_run_that_cannot_be_put_on_the_axis_is_named(self):
        self.make_small()
        self.edit("displacement = 1.5e-4", "displacement = 1e-5")
        self.expect(6, "offline", self.project, "-o", "short.h5", stderr=["full-order runs failed", "crack_mouth_opening reaches",
                                                                          "m only, and [offline] time_values end at 0.0002"])

    def test_real_forces_up_to_the_peak(self):
        """An error that is the same along the curve, against dense quadrature over the model's own outputs."""
        self.make_data()
        self.make_small()
        table = (self.folder / "peak.csv").read_text().splitlines()
        for file in ("measured.csv", "peak.csv"):
            (self.folder / file).write_text("\n".join([table[0], *table[3:]]) + "\n")
        self.expect(0, "offline", self.project, "-o", "brittle.h5")
        outcome = self.expect(8, "assimilate", self.project, "--json")
        last = [line for line in outcome.lines() if "mean" in line][-1]
        exact = self.by_quadrature("brittle.h5")[-1]
        for k in range(3):
            self.assertAlmostEqual(last["mean"][k], exact["mean"][k], delta=0.05 * exact["std"][k])
            self.assertAlmostEqual(math.sqrt(last["covariance"][k][k]), exact["std"][k], delta=0.05 * exact["std"][k])
        self.assertAlmostEqual(last["log_evidence"], exact["log_evidence"], delta=0.05)
        # Of three nodes an axis: the error of the reduced model in the force, the only datum, is known, and rejects it.
        self.assertIn(("model", "reject"), [(reason["code"], reason["level"]) for reason in last["verdict"]["reasons"]])
        self.assertGreater(min(last["verdict"]["model_shift_std"]), 1)
        self.assertAlmostEqual(last["forecast"]["force_200"]["mean"], exact["force_200"], delta=3)

    def by_quadrature(self, *models):
        """What the script says of them, in numpy: of each from peak.csv and from measured.csv."""
        if python_with("h5py", "numpy") is None:
            self.skipTest("no python3 with h5py and numpy here: scripts/packages.txt")
        return self.script("evidence", ENVELOPE, *models, python=python_with("h5py", "numpy"))[1:]

    def test_the_dissipated_work_of_a_law_that_softens_along_a_line(self):
        """A triangle of force against displacement, up to 1 at 1 and down to 0 at 3: its area, 1.5, at the end."""
        if python_with("h5py", "numpy") is None:
            self.skipTest("no python3 with h5py and numpy here: scripts/packages.txt")
        program = ("import numpy as np\nfrom half_notched import Outputs\no = Outputs.__new__(Outputs)\n"
                   "o.displacement = np.array([[0.5, 1, 2, 3]])\no.force = np.array([[0.5, 1, 0.5, 0]])\nprint(list(o.dissipated()[0]))")
        outcome = subprocess.run([python_with("h5py", "numpy"), "-c", program], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(json.loads(outcome.stdout), [0, 0, 0.75, 1.5], outcome.stderr)

    def test_the_whole_example(self):
        """What the page states: the verdict after 0.05 mm says that the law does not follow the beams. Nightly."""
        self.make_data()
        self.expect(0, "offline", self.project, "-o", "brittle.h5")
        for project in ("peak.toml", self.project):
            outcome = self.run_knothe("assimilate", project)
            self.assertIn(outcome.status, (0, 8), str(outcome))
        peak, later = self.script("score", ENVELOPE, "peak", "results")
        for seen in (peak, later):
            self.assertGreaterEqual(seen["held"], 0.9)
            self.assertLessEqual(seen["width"], 2)
        self.assertEqual(later["verdict"], "reject")
        for seen, exact in zip((peak, later), self.by_quadrature("brittle.h5")):
            self.assertAlmostEqual(seen["log_evidence"], exact["log_evidence"], delta=0.1)

    def test_the_whole_example_with_each_other_law(self):
        """The evidences on the page, by knothe and by quadrature. Nightly."""
        stated = {"band10": -159.0, "band40": -111.1, "band80": -115.5, "exponential": -132.6, "bilinear": -131.6, "gradient": -253.6}
        self.make_data()
        self.script("laws")
        for law, evidence in stated.items():
            self.expect(0, "offline", f"{law}.toml", "-o", f"{law}.h5")
            self.expect(8, "assimilate", f"{law}.toml")
            (seen,) = self.script("score", ENVELOPE, f"{law}_results")
            self.assertAlmostEqual(seen["log_evidence"], evidence, delta=0.2, msg=law)
            self.assertEqual(seen["verdict"], "reject")
            exact = self.by_quadrature(f"{law}.h5")[1]
            self.assertAlmostEqual(seen["log_evidence"], exact["log_evidence"], delta=2.5 if law == "gradient" else 0.1, msg=law)


if __name__ == "__main__":
    unittest.main()
