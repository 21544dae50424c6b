"""Fatigue cracks of 48 specimens (docs/benchmarks/crack-growth.md): a prior from the first 24, forecasts of the last 24 by knothe, and what
came. Nothing but the forecasts sees a row of the last 24 beyond 12 mm."""
import csv
import hashlib
import json
import re
import shutil
import subprocess
import unittest

from support import DATA, REPOSITORY, Case, by_form, python_with

EXAMPLE = REPOSITORY / "examples" / "crack_growth"
RECORDS = DATA / "virkler_crack_growth" / "virkler_specimens_01_48.csv"
NUMBER = re.compile(r"-?\d+\.?\d*(?:e-?\d+)?")


class Test(Case):
    def copy_example(self):
        if not RECORDS.is_file():
            self.skipTest(f"{RECORDS} is not there: scripts/get-data.sh, or set KNOTHE_DATA to the folder of recorded data")
        if python_with("numpy", "scipy.optimize") is None:
            self.skipTest("no python3 with numpy and scipy here: python3-scipy of scripts/packages.txt")
        for file in EXAMPLE.iterdir():
            if file.is_file():
                shutil.copy(file, self.folder)

    def run_python(self, *arguments):
        outcome = subprocess.run([python_with("numpy", "scipy.optimize"), *map(str, arguments)], cwd=self.folder, capture_output=True, text=True, timeout=280)
        self.assertEqual(outcome.returncode, 0, outcome.stderr)
        return outcome.stdout

    def test_the_prior_is_that_of_the_first_24(self):
        """The numbers of the example are those of the script, and the last 24 records have no part in them."""
        self.copy_example()
        with open(RECORDS, newline="") as file:
            rows = list(csv.reader(file))
        spoilt = self.folder / "spoilt.csv"
        spoilt.write_text("\n".join(",".join(row[:25] + [row[25]] * 24) for row in rows) + "\n")
        self.run_python("crack_growth.py", "prior", spoilt)
        for name in ("crack_growth.toml", "departure.csv"):
            made, committed = (self.folder / name).read_text(), (EXAMPLE / name).read_text()
            self.assertEqual(NUMBER.sub("#", made), NUMBER.sub("#", committed))
            for a, b in zip(NUMBER.findall(made), NUMBER.findall(committed)):
                self.assertAlmostEqual(float(a), float(b), delta=1e-3 + 1e-3 * abs(float(b)))

    def test_forecasts_of_the_last_24(self):
        self.copy_example()
        self.expect(0, "offline", "crack_growth.toml", "-o", "paris.h5")
        for specimen in range(25, by_form(27, 49)):
            self.run_python("crack_growth.py", "specimen", RECORDS, specimen)
            self.assertEqual(len((self.folder / f"specimen_{specimen}.csv").read_text().splitlines()), 4)
            self.project_name = f"specimen_{specimen}.toml"
            lines = self.assimilate()
            self.assertEqual(lines[-1]["time"], 12)
            self.assertTrue(lines[-1]["trusted"])
        if not by_form(False, True):  # two specimens have no score
            return
        scores = json.loads(self.run_python(REPOSITORY / "docs" / "images" / "crack_growth.py", RECORDS, self.folder, "picture.svg"))
        print(json.dumps(scores, indent=1))
        self.assertIn("</svg>", (self.folder / "picture.svg").read_text())
        own, regression, plain = (scores[name] for name in ("knothe", "regression", "plain_paris"))
        self.assertTrue(19 <= own["held_at_the_end"] <= 24, own)
        over_the_curve = sum(own["held"]) / len(own["held"])
        self.assertTrue(19 <= over_the_curve <= 24, own)
        for key in ("crps_at_the_end", "crps_of_the_curve"):
            self.assertLess(own[key], regression[key])
            self.assertLess(own[key], plain[key])

    def get_data(self, *arguments):
        return subprocess.run([REPOSITORY / "scripts" / "get-data.sh", *map(str, arguments)], capture_output=True, text=True)

    def test_checksums_of_the_downloads(self):
        """scripts/get-data.sh, as far as it goes without a network."""
        script = (REPOSITORY / "scripts" / "get-data.sh").read_text()
        sums = dict(re.findall(r"^(\S+/\S+) ([0-9a-f]{64}) ", script, re.MULTILINE))
        self.assertEqual(len(sums), 5)
        for path, expected in sums.items():
            if (DATA / path).is_file():
                self.assertEqual(hashlib.sha256((DATA / path).read_bytes()).hexdigest(), expected, path)
        wrong = self.folder / "virkler_crack_growth" / RECORDS.name
        wrong.parent.mkdir()
        wrong.write_text("something else\n")
        outcome = self.get_data("--check", self.folder)
        self.assertEqual(outcome.returncode, 1)
        self.assertIn(f"get-data: {wrong}: the checksum is wrong: expected SHA-256 {sums['virkler_crack_growth/' + RECORDS.name]}", outcome.stderr)
        self.assertEqual(outcome.stderr.count("is missing"), 4)
        self.assertEqual(wrong.read_text(), "something else\n")


if __name__ == "__main__":
    unittest.main()
