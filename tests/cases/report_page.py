"""Reports of an assimilation, an inference, two methods compared, a selection and pictures, opened in headless Chromium. Skipped like
dashboard.py.

Of the model and data that knothe 0.1.0 wrote (made_by_0.1.0/): no full-order run is made.
"""
import shutil
import sys
import unittest

from dashboard import exit_status, run_part
from dic_pictures import Speckle, write_pgm
from support import SOURCE, Case


class Test(Case):
    def setUp(self):
        super().setUp()
        shutil.copytree(SOURCE / "made_by_0.1.0", self.folder, dirs_exist_ok=True)

    def test_pages_in_chromium(self):
        self.expect(0, "assimilate", "project.toml")
        self.expect(0, "report", "results", "-o", "assimilation.html")
        self.expect(0, "infer", "project.toml", "-o", "one")
        self.expect(0, "report", "one", "-o", "inference.html")
        self.expect(0, "infer", "project.toml", "--compare", "transport,grid", "-o", "two")
        self.expect(0, "report", "two", "-o", "comparison.html")
        self.expect(0, "select", "project.toml", "-o", "chosen")
        shutil.copy(self.folder / "chosen" / "selection.html", self.folder)
        for name, pull in ("reference", 0), ("a", 0.004), ("b", 0.008):
            write_pgm(self.folder / f"{name}.pgm", Speckle().picture(lambda x, y: (pull * (x - 80), 0), noise=1, seed=len(name)))
        self.expect(0, "dic", "reference.pgm", "a.pgm", "b.pgm", "--element-size", 15, "--roi", "12,12,147,107", "--maps", "maps")
        pages = ("assimilation", "inference", "comparison", "selection", "maps/index")
        run_part(self, "reports", KNOTHE_REPORTS=":".join(str(self.folder / f"{page}.html") for page in pages))

    def test_a_report_is_a_page(self):
        self.expect(2, "report", "results", "-o", "report.svg", stderr="a report is a page (.html)")


if __name__ == "__main__":
    sys.exit(exit_status(unittest.main(exit=False).result))
