"""docs/reference/formats.md: its Python programs run in their order, with knothe between them, and what knothe writes is what the page says."""
import functools
import json
import os
import re
import shutil
import subprocess
import unittest

from dic_pictures import Speckle, write_pgm
from support import FIXTURES, REPOSITORY, SOURCE, Case, python_with, read_csv

PAGE = REPOSITORY / "docs" / "reference" / "formats.md"
PROJECT = """model = "model.h5"
data = "data.h5"
results = "results/"
[parameters]
stiffness = { prior = "uniform", lower = 0.5, upper = 1.5 }
damage = { prior = "uniform", lower = 0.0, upper = 1.0 }
"""
LIST = """
import h5py, json, sys
names = []
with h5py.File(sys.argv[1]) as file:
    file.visititems(lambda name, what: names.append("/" + name) if isinstance(what, h5py.Dataset) else None)
    print(json.dumps([names, list(file.attrs)]))
"""


@functools.lru_cache(maxsize=None)
def programs():
    """name.py → text, in the page's order."""
    blocks = re.findall(r"^```python\n(# (\w+\.py): .*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    return {name: text for text, name in blocks}


def stretch(x, y):
    return 0.4 + 0.004 * (x - 80), -0.3 - 0.003 * (y - 60)


class Test(Case):
    def setUp(self):
        super().setUp()
        if python_with("h5py", "numpy") is None:
            self.skipTest("no python3 with h5py here: python3-h5py of scripts/packages.txt")

    def run_python(self, *arguments, **options):
        outcome = subprocess.run([python_with("h5py", "numpy"), *map(str, arguments)], cwd=self.folder, capture_output=True, text=True, timeout=120, **options)
        self.assertEqual(outcome.returncode, 0, outcome.stderr)
        return outcome.stdout

    def run_program(self, name, **options):
        self.ran.append(name)
        (self.folder / name).write_text(programs()[name])
        return self.run_python(name, **options)

    def listed(self, path):
        return json.loads(self.run_python("-c", LIST, path))

    def described(self, heading):
        """[(pattern, whether it is always there)] of data sets and of attributes in the tables below a heading of the page."""
        section = re.search(rf"^#+ {heading}\n(.*?)(?=^#+ |\Z)", PAGE.read_text(), re.MULTILINE | re.DOTALL)[1]
        sets, attributes = [], []
        for row in re.findall(r"^\| (.*) \|$", section, re.MULTILINE):
            name, _, there = [cell.strip() for cell in row.split(" | ")][:3] if row.count(" | ") > 2 else (row, "", "")
            for word in re.findall(r"`([^`]+)`", name):
                if word.startswith("/"):
                    pattern = re.sub(r"\b(NAME|GROUP)\b", "[^/]+", re.sub(r"/I\b", r"/\\d+", word))
                    sets.append((pattern, there == "always"))
                elif name.startswith("attribute"):
                    attributes.append((word, there == "always"))
        self.assertTrue(sets, heading)
        return sets, attributes

    def expect_described(self, path, heading):
        for found, said in zip(self.listed(path), self.described(heading)):
            for name in found:
                self.assertTrue(any(re.fullmatch(pattern, name) for pattern, _ in said), f"{path}: {name} is not on the page")
            for pattern, always in said:
                if always:
                    self.assertTrue(any(re.fullmatch(pattern, name) for name in found), f"{path}: {pattern} is not in the file")

    def draw(self):
        speckle = Speckle()
        for seed, (name, motion) in enumerate({"reference": None, "a": stretch, "b": stretch}.items()):
            write_pgm(self.folder / f"{name}.pgm", speckle.picture(motion, noise=1, seed=seed))

    def test_the_programs_of_the_page_write_and_read_what_knothe_reads_and_writes(self):
        self.ran = []
        self.run_program("write_snapshots.py")
        (line,) = self.expect(0, "model", "import", "snapshots.h5", "-o", "model.h5", "--tolerance", "1e-8", "--json").lines()
        self.assertLess(line["relative_error"], 1e-8)
        out = self.run_program("read_model.py")
        self.assertIn("tree {'stiffness': 7, 'damage': 5}", out)
        # −1e-4 / e − 2e-5 a sin 3.6 at the tip and t = 1
        tip = float(re.search(r"node \[0\.8333\d*, 0\.75\] tip (\S+)", out)[1])
        self.assertAlmostEqual(tip, -1e-4 / (5 / 6) - 2e-5 * 0.75 * -0.4425204432948524, delta=1e-11)

        (self.folder / "project.toml").write_text(PROJECT)
        self.run_program("write_data.py")
        subprocess.run([os.environ["KNOTHE_DATA_TO_CSV"], "data.h5", "data.csv"], cwd=self.folder, check=True)
        lines = self.expect(0, "assimilate", "project.toml", "--json").out
        out = self.run_program("read_lines.py", input=lines)
        self.assertRegex(out, r"(?m)^1 0\.4 .* missing 1$")
        self.assertRegex(out, r"(?m)^4 1\.0 1\.1\d\d ± 0\.0\d\d 0\.\d+ ± 0\.\d+ \w+ missing 0\n5 steps, verdict ")
        out = self.run_program("read_results.py")
        self.assertRegex(out, r"^5 steps, verdict \w+ by knothe ")
        weighted = json.loads(re.search(r"weighted (.*)", out)[1].replace("'", '"'))
        self.assertEqual(weighted, json.loads(re.search(r"lines (.*)", out)[1].replace("'", '"')))
        self.assertAlmostEqual(float(re.search(r"stiffness draws (\S+)", out)[1]), weighted["stiffness"], delta=0.01)
        # The table says the same as the file it was made from.
        (self.folder / "csv.toml").write_text(PROJECT.replace("data.h5", "data.csv"))
        again = self.expect(0, "assimilate", "csv.toml", "--json", "-o", "of_csv/").lines()
        self.assertEqual([line["mean"] for line in again[:-1]], [json.loads(line)["mean"] for line in lines.splitlines()[:-1]])

        self.draw()
        shutil.copy(SOURCE / "dic.toml", self.folder)
        self.expect(0, "dic", "dic.toml", "-o", "displacements.h5", "--json")
        out = self.run_program("read_displacements.py")
        self.assertIn("values in m\n", out)
        for name in "ab":
            self.assertRegex(out, rf"{name}\.pgm strain 0\.004\d, residual \d\.\d grey levels")

        for name in ("project.toml", "project.journal", "model.h5", "data.h5"):
            shutil.copy(SOURCE / "made_by_0.1.0" / name, self.folder)
        self.expect(0, "export", "project.journal", "-o", "out.csv")
        rows = read_csv(self.folder / "out.csv")
        times = {float(row["time"]) for row in rows}
        self.assertEqual((len(times), max(times)), (8, 1.0))
        self.assertTrue(all(abs(float(row["value"])) < 1 for row in rows if (row["sensor"], row["component"]) == ("s0", "x") and row["value"]))
        self.assertEqual(self.ran, list(programs()))
        for text in programs().values():
            self.assertLessEqual(text.count("\n"), 25)

    def test_files_hold_what_the_page_says_and_nothing_else(self):
        self.run_python("-c", programs()["write_snapshots.py"])
        self.expect_described("snapshots.h5", "Snapshots")
        (self.folder / "project.toml").write_text(PROJECT)
        for form in ("tree", "canonical"):
            self.expect(0, "model", "import", "snapshots.h5", "-o", "model.h5", "--form", form, "--modes", "3")
            self.expect_described("model.h5", "Reduced model")
        self.run_python("-c", programs()["write_data.py"])
        self.expect_described("data.h5", "HDF5")
        self.expect(0, "assimilate", "project.toml")
        self.expect_described("results/posterior.nc", "Results folder")
        self.draw()
        shutil.copy(SOURCE / "dic.toml", self.folder)
        self.expect(0, "dic", "dic.toml", "-o", "displacements.h5")
        self.expect_described("displacements.h5", "Displacements from pictures")
        # By `knothe offline`, of 0.1, and by `knothe simulate`.
        self.expect_described(SOURCE / "made_by_0.1.0" / "model.h5", "Reduced model")
        self.expect_described(FIXTURES / "analytic" / "data.h5", "HDF5")
        self.expect_described(FIXTURES / "analytic" / "model.h5", "Reduced model")

    def words(self, *sections):
        """What the named sections of this page and of report.md have in code."""
        text = PAGE.read_text() + PAGE.with_name("report.md").read_text()
        found = set()
        for heading in sections:
            section = re.search(rf"^(#+) {heading}\n(.*?)(?=^#{{1,2}} |\Z)", text, re.MULTILINE | re.DOTALL)[2]
            for code in re.findall(r"```(.*?)```|`([^`]+)`", section, re.DOTALL):
                found.update(re.findall(r"\w+", " ".join(code)))
            found.update(re.findall(r"\w+", " ".join(re.findall(r"\(([^()]*)\)", section))))
        return found

    def keys(self, value, named=False):
        """All keys of a JSON value, without those that are the names of somebody's quantities."""
        if isinstance(value, list):
            return set().union(*(self.keys(one) for one in value[:3]))
        if not isinstance(value, dict):
            return set()
        own = set() if named else set(value)
        maps = {"physical", "forecast", "forecasts", "models", "scores", "marginals", "prior_marginals", "draws", "series", "machine", "nuisances"}
        return own.union(*(self.keys(one, not named and key in maps) for key, one in value.items()))

    def test_every_key_of_the_lines_is_on_the_page(self):
        shutil.copytree(FIXTURES / "analytic", self.folder, dirs_exist_ok=True)
        project = (SOURCE / "assimilation.toml").read_text()
        method = re.search(r"\[method\].*?(?=\n\n)", project, re.DOTALL)[0]
        variants = {"plain": project,
                    "gate": project.replace(method, "[method]\ngate = 5"),
                    "student_t": project.replace(method, '[method]\nlikelihood = "student-t"'),
                    "joint": project.replace(method, '[method]\nbias_correction = "on"'),
                    "models": project.replace('model = "model.h5"', 'model = { separated = "model.h5", candidates = ["./model.h5"] }')}
        seen = set()
        for name, text in variants.items():
            (self.folder / f"{name}.toml").write_text(text)
            lines = self.expect(0, "assimilate", f"{name}.toml", "--json", "-o", name).lines()
            seen |= self.keys(lines)
            kept = [json.loads(line) for line in (self.folder / name / "steps.jsonl").read_text().splitlines()]
            seen |= self.keys(kept)
        page = self.words("Line of a step", "Verdict", "Results folder")
        self.assertEqual(sorted(seen - page), [])
        self.assertIn("monitor", seen)
        self.assertIn("test_ratio", seen)
        summary = self.keys(json.loads((self.folder / "plain" / "summary.json").read_text()))
        self.assertEqual(sorted(summary - page - self.words("What it reads")), [])

    def test_what_the_page_does_not_name_is_found(self):
        self.run_python("-c", programs()["write_snapshots.py"])
        self.run_python("-c", 'import h5py; h5py.File("snapshots.h5", "a")["colour"] = 1')
        with self.assertRaisesRegex(AssertionError, "/colour is not on the page"):
            self.expect_described("snapshots.h5", "Snapshots")
        self.run_python("-c", 'import h5py; f = h5py.File("snapshots.h5", "a"); del f["colour"], f["time"]')
        with self.assertRaisesRegex(AssertionError, "/time is not in the file"):
            self.expect_described("snapshots.h5", "Snapshots")

    def test_the_help_of_import_names_the_page(self):
        self.assertIn("docs/reference/formats.md", self.expect(0, "model", "import", "--help").out)


if __name__ == "__main__":
    unittest.main()
