"""Displacements of two cameras in `knothe assimilate`: the error of the calibration, which all pictures share, and from drawn pictures
to the posterior of the parameters that drew them."""
import json
import math
import pathlib
import shutil
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

def log_posterior(a, b):
    misfit = numpy.concatenate([values[i] - 4e-4 * t * elastic - others @ analytic_model.factors(t, a, b) for i, t in enumerate(time)])
    return -0.5 * (misfit @ inverse @ misfit + ((a - 0.9) ** 2 + (b - 1.1) ** 2) / 0.2)

print(json.dumps(analytic_model.moments_on_a_grid(log_posterior)))
"""


# The displacements of the formula in place of those measured.
EXACT = """
import sys
import h5py, numpy
sys.path.insert(0, sys.argv[1])
import analytic_model
with h5py.File("u.h5", "a") as file:
    points, component = file["dofs/points"][:], file["dofs/component"][:]
    exact = numpy.array([[analytic_model.displacement(int(c), tuple(x), t, 1.06, 0.96) for c, x in zip(component, points)]
                         for t in file["time"][:]])
    measured = file["values"][:]
    assert exact.shape == measured.shape and not numpy.isnan(measured).any()
    file["values"][:] = exact
    import json
    print(json.dumps([float(abs((measured - exact)[:, component == k]).max()) for k in range(3)]))
"""

WIDTH, HEIGHT, FOCAL = 340, 170, 1250  # px
DISTANCE = 1  # m; elements of 3 cm, in which perspective moves material by 0.1 px from one camera to the other
CENTRE = (0, 0.05, 0.05)  # of the face, m
CAMERAS = """
[dic]
cameras = "cameras.xml"
camera_unit = "m"
other_pictures = ["pictures/camera_1"]
mesh = "model"

[simulate]
truth = { Y0 = 1.06, Ad = 0.96 }
seed = 4

[simulate.camera]
width = 340
height = 170
noise = 1
dot_radius = 2.5
references = 2
every = 4
"""


def product(a, b):
    return [[sum(x * y for x, y in zip(row, column)) for column in zip(*b)] for row in a]


def applied(matrix, vector):
    return [sum(x * y for x, y in zip(row, vector)) for row in matrix]


def pose(angle):
    """R and t of a camera in front of the face, turned about the vertical; the model's y is up, its z towards the cameras."""
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    rotation = product([[c, 0, s], [0, 1, 0], [-s, 0, c]], [[1, 0, 0], [0, -1, 0], [0, 0, -1]])
    return rotation, [a - b for a, b in zip((0, 0, DISTANCE), applied(rotation, CENTRE))]


POSES = [pose(12.5), pose(-12.5)]


def seen_by_the_first(point):
    x, y, z = (a + b for a, b in zip(applied(POSES[0][0], point), POSES[0][1]))
    return [WIDTH / 2 + FOCAL * x / z, HEIGHT / 2 + FOCAL * y / z]


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

    def with_cameras(self):
        """Two cameras in the model's frame, as DICe writes them."""
        lists = []
        for number, (rotation, translation) in enumerate(POSES):
            values = {"CX": WIDTH / 2, "CY": HEIGHT / 2, "FX": FOCAL, "FY": FOCAL, **dict(zip(("TX", "TY", "TZ"), translation))}
            values = {key: repr(value) for key, value in values.items()}
            values.update({f"ROW {k}": "{" + ", ".join(map(repr, row)) + "}" for k, row in enumerate(rotation)})
            lists.append(f'<ParameterList name="CAMERA {number}">\n' + "".join(
                f'<Parameter name="{key}" type="string" value="{value}" />\n' for key, value in values.items()) + "</ParameterList>\n")
        (self.folder / "cameras.xml").write_text(
            '<ParameterList>\n<Parameter name="xml_file_format" type="string" value="DICe_xml_camera_system_file" />\n'
            + "".join(lists) + "</ParameterList>\n")
        self.edit('file = "u.h5"\n', 'pictures = "pictures/camera_0"\n' + CAMERAS)

    def draw(self):
        self.expect(0, "simulate", self.project_name, "--model", "model.h5", "--images", "-o", "pictures")

    def test_drawn_without_noise_they_give_the_posterior_of_exact_displacements(self):
        """One noise is stated, one covariance: what differs is the bias of drawing, correlation and triangulation."""
        self.with_cameras()
        self.edit("noise = 1\n", "noise = 0\nbit_depth = 16\n")
        self.edit('mesh = "model"\n', 'mesh = "model"\nnoise = 257\n')
        self.draw()
        self.expect(0, "dic", self.project_name, "-o", "u.h5")
        at_once = self.assimilate()
        self.edit('pictures = "pictures/camera_0"\n' + CAMERAS.split("[simulate]")[0].replace('mesh = "model"\n', 'mesh = "model"\nnoise = 257\n'),
                  'file = "u.h5"\n')
        measured = self.assimilate()
        self.assertEqual([line["mean"] for line in measured], [line["mean"] for line in at_once])
        worst = self.run_python(EXACT)
        self.assertLess(max(worst[:2]), 2e-6)
        exact = self.assimilate()
        self.expect_posterior(exact[-1], self.run_python(QUADRATURE))
        for one, other in zip(measured, exact):
            for k in range(2):
                std = math.sqrt(other["covariance"][k][k])
                self.assertLess(abs(one["mean"][k] - other["mean"][k]), 0.05 * std)
                self.assertAlmostEqual(math.sqrt(one["covariance"][k][k]), std, delta=0.01 * std)

    def test_pictures_with_noise_cover_the_truth_in_any_frame(self):
        """With the calibration in the model's frame, and as OpenCV has it, in the first camera's, with four points of the face."""
        self.with_cameras()
        self.draw()
        exact = self.assimilate()[-1]
        for k in range(2):
            self.assertLess(abs(exact["mean"][k] - TRUTH[k]), 3.3 * math.sqrt(exact["covariance"][k][k]), exact)
        (first, t), (second, s) = POSES
        between = product(second, [list(row) for row in zip(*first)])
        place = [1e3 * (a - b) for a, b in zip(s, applied(between, t))]
        intrinsics = f"data: [ {FOCAL}., 0., {WIDTH / 2}, 0., {FOCAL}., {HEIGHT / 2}, 0., 0., 1. ]"
        keys = {"M1": intrinsics, "M2": intrinsics, "D1": "data: [ 0., 0., 0., 0. ]", "D2": "data: [ 0., 0., 0., 0. ]",
                "R": f"data: {sum(between, [])}", "T": f"data: {place}"}
        (self.folder / "cameras.yaml").write_text(
            "%YAML:1.0\n---\n" + "".join(f"{key}: !!opencv-matrix\n   {value}\n" for key, value in keys.items()))
        (self.folder / "std.csv").write_text("parameter,std\ncamera0.fx,0.5\ncamera1.fx,0.5\ncamera1.wy,1e-5\ncamera1.tx,0.05\n")
        corners = [[-0.12, 0], [0.12, 0], [0.12, 0.1], [-0.12, 0.1]]
        pixels = [seen_by_the_first((x, y, 0.05)) for x, y in corners]
        self.edit('cameras = "cameras.xml"\ncamera_unit = "m"\n',
                  f'cameras = "cameras.yaml"\ncalibration_std = "std.csv"\npixels = {pixels}\npoints = {corners}\npoint_std = 0.3\n')
        self.expect(3, "simulate", self.project_name, "--model", "model.h5", "--images", "-o", "others",
                    stderr=[self.position_of("pixels = "), "to draw those, give a calibration in the model's frame"])
        outcome = self.expect(0, "assimilate", self.project_name, "--json", stderr="registered by 4 points: at most 0.")
        line = outcome.lines()[-2]
        self.assertEqual(list(line["nuisances"]), ["camera0.fx", "camera1.fx", "camera1.wy", "camera1.tx", "registration.turn"])
        for k in range(2):
            std = math.sqrt(exact["covariance"][k][k])
            self.assertLess(abs(line["mean"][k] - exact["mean"][k]), 0.5 * std)
            self.assertGreater(math.sqrt(line["covariance"][k][k]), 0.999 * std)
        shutil.copy(self.folder / "results" / "displacements.h5", self.folder / "u.h5")
        self.expect_posterior(line, self.run_python(QUADRATURE))  # with the shared reference and the shared errors
        # What the calibration's error does is said beside the noise.
        one, *_ = self.expect(0, "dic", self.project_name, "--json").lines()
        self.assertEqual([value > 0 for value in one["calibration_std_m"]], [True] * 3)
        (self.folder / "one.msh").write_text(
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 100 60 0\n2 160 60 0\n3 160 120 0\n4 100 120 0\n$EndNodes\n"
            "$Elements\n1\n1 3 2 0 0 1 2 3 4\n$EndElements\n")
        one, *_ = self.expect(0, "dic", self.project_name, "--mesh", "one.msh", "-o", "one.h5", "--json").lines()
        self.assertEqual(one["nodes"], 4)
        places = self.run_python("import h5py, json; print(json.dumps(h5py.File('one.h5')['mesh/points'][:].tolist()))")
        for place, pixel in zip(places, [(100, 60), (160, 60), (160, 120), (100, 120)]):  # in the model's frame
            self.assertAlmostEqual(place[2], 0.05, delta=1e-3)  # one element, 2 m away
            self.assertLess(math.dist(seen_by_the_first(place), pixel), 0.05)
        self.edit("pixels = [[", "pixels = [[9.0, 9.0], [")
        self.expect(2, "dic", self.project_name, stderr="5 pixels and 4 points; at least two of each, as many, are needed")
        self.edit("pixels = [[9.0, 9.0], [", "pixels = [[")
        self.edit('calibration_std', 'camera_unit = "m"\ncalibration_std')
        self.expect(4, "dic", self.project_name, stderr=["a point is ", " mm from where the cameras see it", "the unit of the calibration"])

    def test_a_series_goes_on_where_it_was(self):
        self.with_cameras()
        self.draw()
        names = sorted(path.name for path in (self.folder / "pictures" / "camera_0").glob("picture_*.tif"))
        self.assertEqual(len(names), 3)

        def dic(count, output, *more, **options):
            lists = [[f"pictures/camera_{c}/{name}" for name in ["reference_1.tif", *names[:count]]] for c in (0, 1)]
            return self.expect(0, "dic", *lists[0], "--cameras", "cameras.xml", "--camera-unit", "m", "--other", *lists[1],
                               "--element-size", 30, "-o", output, *more, **options)

        whole = dic(3, "whole.h5", "--json").lines()
        dic(2, "u.h5")
        rest = dic(3, "u.h5", "--resume", "--maps", "maps", "--json", stderr="2 of 3 sets of pictures are in u.h5 already").lines()
        self.assertEqual([{**line, "elapsed_ms": 0} for line in rest], [{**line, "elapsed_ms": 0} for line in whole[2:]])
        self.assertEqual([path.name for path in (self.folder / "maps").iterdir()], [names[2].replace("tif", "png")])
        self.run_python("""
import h5py, numpy
with h5py.File("whole.h5") as one, h5py.File("u.h5") as other:
    for name in ("values", "displacement_std", "noise/precision/data", "cameras/1/picture_frame/displacement"):
        assert numpy.array_equal(one[name][:], other[name][:], equal_nan=True), name
""")
        text = (self.folder / "cameras.xml").read_text()
        (self.folder / "cameras.xml").write_text(text.replace(f'value="{POSES[1][1][0]!r}"', f'value="{POSES[1][1][0] + 1e-4!r}"'))
        lists = [[f"pictures/camera_{c}/{name}" for name in ["reference_1.tif", *names]] for c in (0, 1)]
        self.expect(4, "dic", *lists[0], "--cameras", "cameras.xml", "--camera-unit", "m", "--other", *lists[1], "--element-size", 30,
                    "-o", "u.h5", "--resume", stderr="u.h5: error: it holds the mesh of another series")


if __name__ == "__main__":
    unittest.main()
