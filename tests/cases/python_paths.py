"""Twins whose data are pictures, or whose model is refined by the full-order one: to the bit what the command prints."""
import json
import os
import pathlib
import shutil
import sys
import unittest

try:
    import numpy as np
    import xarray  # noqa: F401, needed by what is tested
except ImportError as missing:
    print(f"skipped: {sys.executable} has no {missing.name} (Debian: python3-{missing.name})")
    sys.exit(77)

from support import FIXTURES, KNOTHE, SOURCE, Case, parse_line, without_times

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
        predicted = twin.to_xarray()["posterior_predictive"]["displacement"]
        self.assertEqual(predicted.sizes["observation"], len(data[-1].values))
        covered = np.abs(predicted.isel(step=-1).mean(("chain", "draw")) - data[-1].values) < 4 * predicted.isel(step=-1).std(("chain", "draw"))
        self.assertGreater(float(covered.mean()), 0.95)

    def test_verification(self):
        if not (pathlib.Path(KNOTHE).parent / "knothe-offline").exists():
            self.skipTest("knothe-offline is not built")
        project = "refinement.toml"
        self.begin(project)
        file = self.folder / project
        file.write_text(file.read_text().replace('verify = "full-order"', 'verify = "full-order"\nverify_runs = 3'))
        self.addCleanup(os.environ.__setitem__, "PATH", os.environ["PATH"])
        os.environ["PATH"] = f"{pathlib.Path(KNOTHE).parent}:{os.environ['PATH']}"  # where the package looks for knothe-offline
        self.expect(0, "offline", project, "-o", "model.h5")
        self.expect(0, "simulate", project, "-o", "data.h5", "--seed", "1")
        lines, last = self.lines_of(project)
        self.assertGreater(lines[-1]["model_version"], 0)
        twin = knothe.Twin(project)
        records = [without_times(parse_line(json.dumps(twin.assimilate(datum).record))) for datum in twin.data]
        self.assertEqual(records, lines)
        for reason in last["verdict"]["reasons"]:  # what is set already is no advice
            self.assertNotIn("set method.verify", reason["message"])


if __name__ == "__main__":
    unittest.main()
