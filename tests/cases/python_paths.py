"""A twin whose data are pictures: to the bit what the command prints."""
import json
import os
import shutil
import sys
import unittest

try:
    import numpy as np
    import xarray  # noqa: F401, needed by what is tested
except ImportError as missing:
    print(f"skipped: {sys.executable} has no {missing.name} (Debian: python3-{missing.name})")
    sys.exit(77)

from support import FIXTURES, SOURCE, Case, parse_line, without_times

import knothe


class Test(Case):
    def begin(self, project):
        """The folder of a case of the command, and that as working folder."""
        shutil.copy(SOURCE / project, self.folder / project)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)

    def lines_of(self, project):
        outcome = self.run_knothe("assimilate", project, "--json", "-o", "command/")
        self.assertIn(outcome.status, (0, 8), str(outcome))
        lines = outcome.lines()
        return [{k: v for k, v in without_times(line).items() if k != "picture"} for line in lines[:-1]], lines[-1]

    def test_pictures(self):
        project = "picture_assimilation.toml"
        self.begin(project)
        shutil.copy(FIXTURES / "analytic" / "model.h5", self.folder)
        self.expect(0, "simulate", project, "--model", "model.h5", "--images", "-o", "pictures")
        lines, last = self.lines_of(project)
        twin = knothe.Twin(project)
        data = []
        for datum in twin.data:
            data.append(datum)
            self.assertGreater(np.isfinite(datum.values).sum(), 30)
            twin.assimilate(datum)
        self.assertEqual([without_times(parse_line(json.dumps(twin.result(step).record))) for step in twin.steps], lines)
        self.assertEqual(twin.verdict.level, last["verdict"]["level"])
        predicted = twin.to_xarray()["posterior_predictive"]["measured"]
        self.assertEqual(predicted.sizes["observation"], len(data[-1].values))
        covered = np.abs(predicted.isel(step=-1).mean(("chain", "draw")) - data[-1].values) < 4 * predicted.isel(step=-1).std(("chain", "draw"))
        self.assertGreater(float(covered.mean()), 0.95)


if __name__ == "__main__":
    unittest.main()
