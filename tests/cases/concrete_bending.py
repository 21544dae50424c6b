"""Three pictures of a real concrete beam (docs/benchmarks/concrete-beam.md): fields and crack with the defaults, what they say without a model,
and that the notched beam's model is rejected on them."""
import json
import math
import re
import shutil
import subprocess
import unittest

from support import DATA, REPOSITORY, Case, python_with

EXAMPLE = REPOSITORY / "examples" / "concrete_bending"
PICTURES = [DATA / "concrete_bending" / f"IMG_{number}.tif" for number in ("0155", "0160", "0179")]


class Test(Case):
    project_name = "concrete_bending.toml"

    def setUp(self):
        self.project_name, name = None, self.project_name
        super().setUp()
        self.project_name = name
        if not all(path.is_file() for path in PICTURES):
            self.skipTest(f"{PICTURES[0].parent} is not there: scripts/get-data.sh, or set KNOTHE_DATA to the folder of recorded data")
        for path in (EXAMPLE / name, EXAMPLE / "halves.py", *PICTURES):
            shutil.copy(path, self.folder)

    def test_two_halves_about_a_hinge(self):
        """What can be known beforehand: the roller touches the upper edge; a half that is no longer held together moves as a rigid
        body, so its opening is a straight line; the crack only grows."""
        if python_with("h5py", "numpy", "scipy.optimize", "PIL") is None:
            self.skipTest("no python3 with h5py, numpy, scipy and PIL here: scripts/packages.txt")
        self.expect(0, "dic", *(path.name for path in PICTURES), "--crack", "-o", "fields.h5")
        command = [python_with("h5py", "numpy", "scipy.optimize", "PIL"), "halves.py", PICTURES[0].name, "fields.h5"]
        outcome = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, timeout=280)
        self.assertEqual(outcome.returncode, 0, outcome.stderr)
        seen = json.loads(outcome.stdout)
        x, y, radius = seen["roller"]
        self.assertAlmostEqual(y + radius, seen["edges"][0], delta=5)
        first, second = seen["pictures"]
        self.assertGreater(second["length"] - first["length"], 3 * math.hypot(first["length_std"], second["length_std"]))
        for p in (first, second):
            self.assertTrue(0 < p["rotation_std"] < 0.05 * p["rotation"], p["rotation_std"])
            (_, least), (_, most) = p["tip_interval"]
            self.assertTrue(most < p["tip"][1] < least, p["tip_interval"])
        for p, rest in ((first, 0.03), (second, 0.1)):
            self.assertTrue(all(r < rest for r in p["rest"]), p["rest"])
        about_hinge = [opening - second["rotation"] * (y - second["hinge_y"]) for y, opening, _ in second["openings"]]
        self.assertGreater(len(about_hinge), 30)
        self.assertLess(math.sqrt(sum(e * e for e in about_hinge) / len(about_hinge)), 0.5)  # of 15 px
        ahead = [(opening, std) for y, opening, std in first["openings"] if y < first["tip"][1] - 4 * first["length_std"]]
        self.assertGreater(len(ahead), 5)
        self.assertTrue(all(abs(opening) < 0.03 for opening, _ in ahead), ahead)

    def test_the_notched_beam_is_rejected(self):
        """Whatever time of its loading the first picture is given."""
        self.expect(0, "offline", self.project_name, "-o", "beam.h5")
        for time in ("0.3", "0.1", "0.6"):
            text = self.project.read_text()
            self.project.write_text(re.sub(r"times = \[[\d.]+,", f"times = [{time},", text))
            for line in self.assimilate(status=8):
                self.assertEqual(line["verdict"]["level"], "reject")
                self.assertIn(("fit", "reject"), [(r["code"], r["level"]) for r in line["verdict"]["reasons"]])


if __name__ == "__main__":
    unittest.main()
