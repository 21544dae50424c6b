"""examples/beam_pictures as a user runs it: 100 pictures drawn from the full-order model, true parameters off the grid."""
import math
import pathlib
import shutil
import unittest

from support import SOURCE, Case

TRUTH = [1.07, 0.93]
EXAMPLE = pathlib.Path(SOURCE).parent.parent / "examples/beam_pictures/beam_pictures.toml"
ONSET = 26  # from this picture on the crack runs: the load is past its peak


class Test(Case):
    def setUp(self):
        super().setUp()
        self.project_name = EXAMPLE.name
        shutil.copy(EXAMPLE, self.project)

    def test_posterior_and_forecast_cover_the_truth_at_every_picture(self):
        """95 % intervals of both parameters at all pictures; of crack and force, against those that the model forecasts at the
        true parameters, from the onset on. (Without bias_correction the parameters are covered at 47 of the 100.)"""
        self.expect(0, "offline", self.project_name, "-o", "beam.h5", timeout=1500)
        self.expect(0, "simulate", self.project_name, "--images", "-o", "pictures", timeout=900)
        lines = self.assimilate(timeout=600)
        self.assertEqual(len(lines), 100)
        for prior, value in (("mean = 0.9", TRUTH[0]), ("mean = 1.1", TRUTH[1])):
            self.edit(f"{prior}, std = 0.4472135954999579", f"mean = {value}, std = 1e-4")
        true = self.assimilate(timeout=600)[-1]["forecast"]
        for line in lines:
            for k, (low, *_, high) in enumerate(line["quantiles"]["values"]):
                self.assertTrue(low <= TRUTH[k] <= high, (line["step"], k, low, high))
            if line["step"] < ONSET:
                continue
            for name, forecast in line["forecast"].items():
                low, high = forecast["values"][0], forecast["values"][-1]
                self.assertTrue(low <= true[name]["mean"] <= high, (line["step"], name, low, true[name]["mean"], high))
        # And they say something: a tenth of the prior's width, and a millimetre of crack.
        last = lines[-1]
        for k in range(2):
            self.assertLess(math.sqrt(last["covariance"][k][k]), 0.045)
        self.assertLess(last["forecast"]["crack"]["std"], 1e-3)


if __name__ == "__main__":
    unittest.main()
