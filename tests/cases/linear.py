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
        done = subprocess.run([str(word) for word in command], cwd=folder, capture_output=True, text=True, timeout=280)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def assimilate(self, name, said, dofs, truth, relative_std):
        """Model, data, posterior: the truth within 4 std, each std below `relative_std` of it."""
        with tempfile.TemporaryDirectory(prefix="knothe-case-") as place:
            folder = pathlib.Path(place)
            shutil.copy(REPOSITORY / f"examples/linear/{name}.toml", folder)
            self.assertIn(said, self.run_in(folder, os.environ[f"KNOTHE_EXAMPLE_{name.upper()}"], f"{name}.h5"))
            self.assertIn(dofs, self.run_in(folder, KNOTHE, "model", "info", f"{name}.h5"))
            self.run_in(folder, KNOTHE, "simulate", f"{name}.toml", "--model", f"{name}.h5", "-o", f"{name}_data.h5")
            lines = [parse_line(line) for line in self.run_in(folder, KNOTHE, "assimilate", f"{name}.toml", "--json").splitlines()]
            last = lines[-2]
            for mean, variance, true in zip(last["mean"], (last["covariance"][0][0], last["covariance"][1][1]), truth):
                self.assertLess(abs(mean - true), 4 * variance ** 0.5)
                self.assertLess(variance ** 0.5, relative_std * true)
            self.assertEqual(lines[-1]["untrusted"], [])

    def test_the_weld_is_assimilated_like_any_other_model(self):
        self.assimilate("weld", "differs from time marching by", "820 dofs [K]", (0.11, 1.2), 0.02)

    def test_two_moduli_are_found_from_displacements(self):
        self.assimilate("two_moduli", "differs from direct solutions by", "880 dofs [m]", (24.0, 35.0), 0.05)


if __name__ == "__main__":
    unittest.main()
