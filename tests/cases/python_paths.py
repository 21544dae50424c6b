"""Twins whose data are pictures, or whose model is refined by the full-order one: to the bit what the command prints."""
import json
import os
import pathlib
import shutil
import sys
import unittest
import unittest.mock

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
        self.the_frame_of_the_model_is_that_of_the_command(project)
        covered = np.abs(predicted.isel(step=-1).mean(("chain", "draw")) - data[-1].values) < 4 * predicted.isel(step=-1).std(("chain", "draw"))
        self.assertGreater(float(covered.mean()), 0.95)

    def the_frame_of_the_model_is_that_of_the_command(self, project):
        """Pictures have y down: `sensors` and `datum` beside what `knothe dic` writes with a scale."""
        import h5py

        self.expect(0, "dic", project, "-o", "fields.h5")
        with h5py.File("fields.h5") as file:
            nodes, cells = file["picture_frame/nodes"][:], file["mesh/cells"][:]
            points, components, values = (file[name][:] for name in ("dofs/points", "dofs/component", "values"))
        correlation = knothe.Correlation("pictures/reference_1.tif", mesh=(nodes, cells))
        moved = correlation.correlate("pictures/picture_0012.tif")
        sensors, datum = correlation.sensors(4e-4, origin=(320, 270), z=0.05), moved.datum(0, 4e-4)
        np.testing.assert_allclose(sensors.points, points, atol=1e-12)
        np.testing.assert_array_equal(sensors.components, components)
        far = np.abs(values[-1]) > 0.2 * 4e-4  # 0.2 px
        self.assertGreater(far[components == 1].sum(), 5)
        np.testing.assert_allclose(datum.values[far], values[-1][far], rtol=0.2)
        with unittest.mock.patch("knothe._pictures.Datum") as made:
            moved.datum(0, 4e-4)
        px, m = moved.precision().toarray(), made.call_args.kwargs["precision"].toarray()
        signs = np.where(np.arange(len(px)) % 2 == 0, 1, -1)
        np.testing.assert_allclose(m, px * np.outer(signs, signs) / 4e-4**2, rtol=1e-12)

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
