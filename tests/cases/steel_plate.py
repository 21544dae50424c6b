"""The field of a steel plate with a hole, as another program exported it (docs/how-to/fields-of-other-programs.md): the example, and the
same plate under tension alone against finite elements of another kind and dense quadrature (steel_plate_reference.py)."""
import json
import re
import shutil
import subprocess
import unittest

from support import DATA, REPOSITORY, Case, python_with

EXAMPLE = REPOSITORY / "examples" / "steel_plate"
FIELD = DATA / "s235_plate_hole" / "20231116_displacements_raw.csv"
PAGE = REPOSITORY / "docs" / "how-to" / "fields-of-other-programs.md"
MODULES = "numpy", "scipy.sparse", "h5py"


class Test(Case):
    def setUp(self):
        super().setUp()
        if not FIELD.is_file():
            self.skipTest(f"{FIELD} is not there: set KNOTHE_DATA to the folder of recorded data")
        if python_with(*MODULES) is None or shutil.which("ccx") is None:
            self.skipTest("python3-scipy, python3-h5py or calculix-ccx of scripts/packages.txt is not here")
        for file in (*EXAMPLE.iterdir(), FIELD):
            shutil.copy(file, self.folder)
        self.project_name = "plate.toml"

    def python(self, *arguments):
        outcome = subprocess.run([python_with(*MODULES), *map(str, arguments)], cwd=self.folder, capture_output=True, text=True, timeout=280)
        self.assertEqual(outcome.returncode, 0, outcome.stderr)
        return outcome.stdout

    def reference(self, *arguments):
        return json.loads(self.python(REPOSITORY / "tests" / "cases" / "steel_plate_reference.py", *arguments))

    def rewrite(self, file, *changes):
        text = (self.folder / file).read_text()
        for old, new in changes:
            text, count = re.subn(old, new, text)
            self.assertGreater(count, 0, old)
        (self.folder / file).write_text(text)

    def make_model(self):
        self.python("mesh.py")
        self.expect(0, "offline", self.project_name, "-o", "plate.h5")

    def make_model_of_tension(self):
        """Elements of plane stress; thin, for CalculiX makes solids of them, whose thickness stiffens the hole's edge by 2 %."""
        self.rewrite("mesh.py", ("S8R", "CPS8"))
        self.rewrite("plate.inp", ("SHELL SECTION", "SOLID SECTION"), ("\n0.004\n", "\n4e-5\n"), ("1, 3\nROLLER, 2, 3\nEDGE, 3, 3", "1, 2\nROLLER, 2"),
                     (r"(?s)\*AMPLITUDE.*?(?=\*STEP)", ""), (r"(?s)\*CLOAD.*?(?=\*NODE FILE)", ""), ("EDNOR4, -283360", "P4, -70.84e6"),
                     ("EDNOR2, -283360", "P2, -70.84e6"), (r"NODE FILE", "NODE FILE, OUTPUT=2D"), (r"(?m)^\*\* Forces.*\n", ""))
        self.rewrite("plate.toml", (r"(?m)^(bending|slope) = .*\n", ""), (r"(?s)\[offline\.parameters\.(bending|slope)\].*?(?=\[)", ""))
        self.make_model()

    def last(self, status=0):
        line = self.assimilate(status=status)[-1]
        return {name: (value["mean"], value["std"]) for name, value in line["physical"].items()}, line["verdict"]

    def test_under_tension_alone_the_posterior_is_that_of_other_elements_and_rejected(self):
        self.make_model_of_tension()
        found, verdict = self.last(status=8)
        for name, (mean, std) in zip(("E", "nu"), self.reference("posterior", self.folder / "results")):
            self.assertAlmostEqual(found[name][0], mean, delta=0.05 * std)
            self.assertAlmostEqual(found[name][1], std, delta=0.02 * std)
        self.assertEqual(verdict["level"], "reject")
        self.assertIn("the values of x do not fit the model", verdict["reasons"][0]["message"])
        self.rewrite("plate.toml", (r"(?m)^region = .*\n", ""))
        self.assertRegex(self.expect(0, "check", self.project_name).out, r"not used, as they lie outside the model's mesh: \d+ of 5475 points")

    def test_the_example_is_as_the_page_says(self):
        self.make_model()
        said = self.expect(0, "check", self.project_name).out
        for words in ("table, 5475 points, 0 lost, mm, positions of the reference, y up, time 1",
                      "not used, as they stand out from their neighbours: 194 of 5475 points"):
            self.assertIn(words, said)
        found, verdict = self.last()
        self.assertEqual(verdict["level"], "ok", verdict)
        row = re.search(r"\| tension and bending \| ([\d.]+) ± ([\d.]+) \| ([\d.]+) ± ([\d.]+) \|", PAGE.read_text())
        e, e_std, nu, nu_std = map(float, row.groups())
        self.assertAlmostEqual(found["E"][0] / 1e9, e, delta=0.2 * e_std)
        self.assertAlmostEqual(found["nu"][0], nu, delta=0.2 * nu_std)
        self.assertAlmostEqual(found["E"][1] / 1e9, e_std, delta=0.1 * e_std)
        # A prior that says more than anybody knows, from a published fit without bending.
        self.rewrite("plate.toml", ("mean = 206e9, std = 5e9", "mean = 185e9, std = 1.5e9"))
        _, verdict = self.last()
        self.assertEqual(verdict["level"], "caution")
        said = re.search(r"the prior of E, 1.85e\+11 ± 1.5e\+09 Pa, is [\d.]+ of its standard deviations away from what the data alone give, "
                         r"([\d.e+]+) ± ([\d.e+]+) Pa", " ".join(reason["message"] for reason in verdict["reasons"]))
        self.assertIsNotNone(said, verdict)
        alone, alone_std = (float(number) / 1e9 for number in said.groups())
        self.assertAlmostEqual(alone, e, delta=2 * alone_std)  # linear about the compromise, 185 + 5 GPa

    def test_intervals_of_two_hundred_drawn_plates_hold_their_truths(self):
        """Fields of the other elements, with noise, a rigid motion and one towards the camera, of truths from the prior."""
        self.make_model_of_tension()
        truths = self.reference("fields", FIELD, self.folder, 200)
        held = {"E": 0, "nu": 0}
        for k, truth in enumerate(truths):
            self.rewrite("plate.toml", (r'files = "[^m].*csv"', f'files = "plate-{k}.csv"'))
            found, _ = self.last()
            for (name, (mean, std)), value in zip(found.items(), truth):
                held[name] += abs(value - mean) < 1.6449 * std
        print(held)
        for name, count in held.items():
            self.assertTrue(170 <= count <= 190, held)


if __name__ == "__main__":
    unittest.main()
