"""Displacements of two cameras in `knothe assimilate`: the error of the calibration, which all pictures share, and from drawn pictures
to the posterior of the parameters that drew them."""
import json
import math
import pathlib
import subprocess
import unittest

import analytic_model
from support import Case, python_with

TRUTH = (1.06, 0.96)

# Displacements by the formula with noise and with an error that all times share, whose effect grows with the displacement.
SHARED_ERRORS = """
import sys
import h5py, numpy
sys.path.insert(0, sys.argv[1])
import analytic_model
dofs = range(0, analytic_model.DOFS, 7)
places = [analytic_model.dof(i) for i in dofs]
time = numpy.array([analytic_model.time(s) for s in range(0, analytic_model.STEPS, 2)])
exact = numpy.array([[analytic_model.displacement(c, x, t, 1.06, 0.96) for c, x in places] for t in time])
random = numpy.random.default_rng(3)
effects = numpy.stack([4e-2 * exact, numpy.full_like(exact, 8e-6) * time[:, None]], axis=-1)
with h5py.File("u.h5", "w") as file:
    file["time"], file["dofs/points"] = time, numpy.array([x for _, x in places])
    file["dofs/component"] = numpy.array([c for c, _ in places])
    file["values"] = exact + random.normal(0, 2e-6, exact.shape) + effects @ [1.3, -0.8]
    file["noise/std"] = numpy.full(len(places), 2e-6)
    file["noise/shared_errors"] = effects
    file["noise/shared_errors"].attrs["names"] = ["camera0.fx", "camera1.tz"]
"""

# Mean and standard deviations of the parameters, on a grid, with the covariance of all displacements of all pictures.
QUADRATURE = """
import json, sys
import h5py, numpy
sys.path.insert(0, sys.argv[1])
import analytic_model
with h5py.File("u.h5") as file:
    time, values = file["time"][:], file["values"][:]
    points, component = file["dofs/points"][:], file["dofs/component"][:]
    n = len(component)
    if "noise/std" in file:
        one, shared = numpy.diag(file["noise/std"][:] ** 2), numpy.zeros((n, n))
    else:
        csr, precision = file["noise/precision"], numpy.zeros((n, n))
        for i in range(n):
            row = slice(csr["indptr"][i], csr["indptr"][i + 1])
            precision[i, csr["indices"][row]] = csr["data"][row]
        one = numpy.linalg.inv(precision)
        shared = one / (int(csr.attrs["shared_reference"]) + 1)
    factor = numpy.zeros((len(time) * n, 0))
    if "noise/shared_errors" in file:
        factor = file["noise/shared_errors"][:].reshape(len(time) * n, -1)
whole = numpy.kron(numpy.eye(len(time)), one - shared) + numpy.kron(numpy.ones((len(time), len(time))), shared)
inverse = numpy.linalg.inv(whole + factor @ factor.T)
shapes = [analytic_model.shapes(int(c), tuple(x)) for c, x in zip(component, points)]
elastic, others = numpy.array([s[0] for s in shapes]), numpy.array([s[1] for s in shapes])
y0, ad = numpy.linspace(0.5, 1.5, 61), numpy.linspace(0.5, 1.5, 61)

def log_posterior(a, b):
    misfit = numpy.concatenate([values[i] - 4e-4 * t * elastic - others @ analytic_model.factors(t, a, b) for i, t in enumerate(time)])
    return -0.5 * (misfit @ inverse @ misfit + ((a - 0.9) ** 2 + (b - 1.1) ** 2) / 0.2)

for _ in range(4):  # narrower about the mass
    table = numpy.array([[log_posterior(a, b) for b in ad] for a in y0])
    weight = numpy.exp(table - table.max())
    weight /= weight.sum()
    mean = [(weight.sum(1) * y0).sum(), (weight.sum(0) * ad).sum()]
    std = [max(((weight.sum(1) * (y0 - mean[0]) ** 2).sum()) ** 0.5, (y0[1] - y0[0])),
           max(((weight.sum(0) * (ad - mean[1]) ** 2).sum()) ** 0.5, (ad[1] - ad[0]))]
    y0, ad = (numpy.linspace(max(0.5, m - 6 * s), min(1.5, m + 6 * s), 61) for m, s in zip(mean, std))
print(json.dumps({"mean": mean, "std": std}))
"""


class Test(Case):
    project_name = "stereo_assimilation.toml"
    fixture = "analytic"

    def setUp(self):
        super().setUp()
        if python_with("h5py", "numpy") is None:
            self.skipTest("no python3 with h5py here")

    def run_python(self, script):
        done = subprocess.run([python_with("h5py", "numpy"), "-c", script, pathlib.Path(__file__).parent], cwd=self.folder,
                              capture_output=True, text=True, timeout=200)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout or "null")

    def expect_posterior(self, line, judge, mean=0.05, std=0.03):
        for k in range(2):
            own = math.sqrt(line["covariance"][k][k])
            self.assertLess(abs(line["mean"][k] - judge["mean"][k]), mean * judge["std"][k], (line, judge))
            self.assertLess(abs(own / judge["std"][k] - 1), std, (line, judge))

    def test_errors_that_all_data_share_are_in_the_posterior(self):
        self.run_python(SHARED_ERRORS)
        last = self.assimilate()[-1]
        self.expect_posterior(last, self.run_python(QUADRATURE))
        self.assertEqual(list(last["nuisances"]), ["camera0.fx", "camera1.tz"])
        for name, truth in (("camera0.fx", 1.3), ("camera1.tz", -0.8)):
            found = last["nuisances"][name]
            self.assertLess(abs(found["mean"] - truth), 3.5 * found["std"], found)
            self.assertLess(found["std"], 0.9)
        self.expect(0, "report", "results", "-o", "report.html")
        self.assertIn("The error of camera0.fx that all data share is 1.", (self.folder / "report.html").read_text())
        # As exact the same data contradict the model.
        self.run_python('import h5py\nwith h5py.File("u.h5", "a") as file: del file["noise/shared_errors"]')
        self.assertEqual(self.run_knothe("assimilate", self.project_name, "--json").status, 8)


if __name__ == "__main__":
    unittest.main()
