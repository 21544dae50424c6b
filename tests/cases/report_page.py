"""Reports of an assimilation, one that is rejected, an inference, two methods compared, a selection, pictures and the study of the paper, opened in headless Chromium. Skipped like
dashboard.py.

Of the model and data that knothe 0.1.0 wrote (made_by_0.1.0/): no full-order run is made.
"""
import math
import os
import shutil
import subprocess
import sys
import unittest

from dashboard import run_part
from dic_pictures import Speckle, write_pgm
from support import REPOSITORY, SOURCE, Case, exit_status, read_csv, write_csv

sys.path.insert(0, str(REPOSITORY / "studies" / "reproduction"))
import record  # noqa: E402


class Face:
    """A plate of 100 by 20 mm."""

    points = [(0.01 * i, 0.01 * j) for j in range(3) for i in range(11)]
    cells = [(11 * j + i, 11 * j + i + 1, 11 * j + i + 12, 11 * j + i + 11) for j in range(2) for i in range(10)]


def bell(x, middle, width):
    return math.exp(-0.5 * ((x - middle) / width) ** 2) / width / math.sqrt(2 * math.pi)


def small_study(folder):
    """What `knothe reproduce` writes, with a drawing of each kind."""
    figure = record.Figure("8-9", "Sequential updating", "Data of a known model.")
    points = [0.5 + 0.005 * i for i in range(201)]
    densities = [(points, [bell(x, 1, 0.2 / (1 + step)) for x in points]) for step in range(10)]
    figure.panel("A marginal, and its spread.", record.Densities("Marginal of Y₀", "Y₀ over its reference", "–", densities, densities[0], 1),
                 record.Chart("Spread of Y₀", "step [–]", "std, logarithmic [–]", logarithmic=True)
                 .band("middle 90 %", [0.1 / (1 + i) for i in range(10)], [0.3 / (1 + i) for i in range(10)])
                 .curve("std", [0.2 / (1 + i) for i in range(10)]).mark("paper", "red", y=0.04))
    figure.panel("A mode, and the nodes that are observed.",
                 record.Map("Mode 1", Face, "horizontal component, largest 1", "1", signed=True,
                            field=([x / 0.1 for x, _ in Face.points], [0 for _ in Face.points])),
                 record.Map("The nodes", Face, sensors=[(0.05, 0.01, "measured node")]))
    figure.row("Y₀: maximum of the last marginal", "1", "1.04", "1.00", "One draw of noise.", 1, 1.04)
    figure.tables.append(("Other choices.", ["choice", "Y₀"], [["1: coarse", "1.01 ± 0.02"]]))
    record.write(folder, [figure], {"program": "knothe", "quick": True, "seed": 1, "repetitions": 1, "reference": "plate", "elapsed_s": 1.0})


class Test(Case):
    def setUp(self):
        super().setUp()
        shutil.copytree(SOURCE / "made_by_0.1.0", self.folder, dirs_exist_ok=True)

    def reject(self):
        """The same test with an axis turned, wrong.toml."""
        subprocess.run([os.environ["KNOTHE_DATA_TO_CSV"], "data.h5", "wrong.csv"], cwd=self.folder, check=True)
        rows = read_csv(self.folder / "wrong.csv")
        for row in rows:
            if row["component"] == "y":
                row["value"] = repr(-float(row["value"]))
        write_csv(self.folder / "wrong.csv", rows)
        project = (self.folder / "project.toml").read_text()
        (self.folder / "wrong.toml").write_text(project.replace('data = "data.h5"', 'data = "wrong.csv"'))
        self.expect(8, "assimilate", "wrong.toml", "-o", "wrong")
        self.expect(0, "report", "wrong", "-o", "rejected.html")

    def test_pages_in_chromium(self):
        self.expect(0, "assimilate", "project.toml")
        self.expect(0, "report", "results", "-o", "assimilation.html")
        self.reject()
        self.expect(0, "infer", "project.toml", "-o", "one")
        self.expect(0, "report", "one", "-o", "inference.html")
        self.expect(0, "infer", "project.toml", "--compare", "transport,grid", "-o", "two")
        self.expect(0, "report", "two", "-o", "comparison.html")
        self.expect(0, "select", "project.toml", "-o", "chosen")
        shutil.copy(self.folder / "chosen" / "selection.html", self.folder)
        for name, pull in ("reference", 0), ("a", 0.004), ("b", 0.008):
            write_pgm(self.folder / f"{name}.pgm", Speckle().picture(lambda x, y: (pull * (x - 80), 0), noise=1, seed=len(name)))
        self.expect(0, "dic", "reference.pgm", "a.pgm", "b.pgm", "--element-size", 15, "--roi", "12,12,147,107", "--maps", "maps")
        small_study(self.folder / "study")
        self.expect(0, "report", "study", "-o", "study.html")
        pages = ("assimilation", "rejected", "inference", "comparison", "selection", "maps/index", "study")
        run_part(self, "reports", KNOTHE_REPORTS=":".join(str(self.folder / f"{page}.html") for page in pages))

    def test_a_report_is_a_page(self):
        self.expect(2, "report", "results", "-o", "report.svg", stderr="a report is a page (.html)")


if __name__ == "__main__":
    sys.exit(exit_status(unittest.main(exit=False).result))
