"""examples/linear: a model by progressive Galerkin, without a snapshot, through the same online phase as any other."""
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

from support import KNOTHE, REPOSITORY, parse_line


class Test(unittest.TestCase):
    def run_in(self, folder, *command):
        done = subprocess.run([str(word) for word in command], cwd=folder, capture_output=True, text=True, timeout=100)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def test_the_weld_is_assimilated_like_any_other_model(self):
        with tempfile.TemporaryDirectory(prefix="knothe-case-") as name:
            folder = pathlib.Path(name)
            shutil.copy(REPOSITORY / "examples/linear/weld.toml", folder)
            said = self.run_in(folder, os.environ["KNOTHE_EXAMPLE_WELD"], "weld.h5")
            self.assertIn("differs from time marching by", said)
            self.assertIn("820 dofs [K]", self.run_in(folder, KNOTHE, "model", "info", "weld.h5"))
            self.run_in(folder, KNOTHE, "simulate", "weld.toml", "--model", "weld.h5", "-o", "weld_data.h5")
            lines = [parse_line(line) for line in self.run_in(folder, KNOTHE, "assimilate", "weld.toml", "--json").splitlines()]
            last = lines[-2]
            for mean, variance, truth in zip(last["mean"], (last["covariance"][0][0], last["covariance"][1][1]), (0.11, 1.2)):
                self.assertLess(abs(mean - truth), 4 * variance ** 0.5)
                self.assertLess(variance ** 0.5, 0.02 * truth)
            self.assertEqual(lines[-1]["untrusted"], [])


if __name__ == "__main__":
    unittest.main()
