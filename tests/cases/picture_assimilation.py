"""Pictures in `knothe simulate --images` and `knothe assimilate`: from drawn pictures to the posterior of the parameters that
drew them."""
import json
import math
import pathlib
import random
import shutil
import struct
import subprocess
import unittest

import analytic_model
from support import Case, python_with

TRUTH = (1.06, 0.96)

# The force of machine.csv, linear between its values, beside the displacements of u.h5.
ADD_FORCE = """
import h5py, numpy
table = numpy.loadtxt("machine.csv", delimiter=",", skiprows=1)
with h5py.File("u.h5", "a") as file:
    file["outputs/reaction_force"] = numpy.interp(file["time"], table[:, 0], table[:, 2])
"""

# Mean and standard deviations of the parameters, on a grid, with the covariance of all displacements of all pictures.
QUADRATURE = """
import json, sys
import h5py, numpy
sys.path.insert(0, sys.argv[1])
import analytic_model
with h5py.File("u.h5") as file:
    time, values = file["time"][:], file["values"][:]
    points, component, force = file["dofs/points"][:], file["dofs/component"][:], file["outputs/reaction_force"][:]
    csr, pictures = file["noise/precision"], file["noise"].attrs.get("shared_reference")
    if pictures is None:
        pictures = file["noise/precision"].attrs["shared_reference"]
    n = len(component)
    precision = numpy.zeros((n, n))
    for i in range(n):
        row = slice(csr["indptr"][i], csr["indptr"][i + 1])
        precision[i, csr["indices"][row]] = csr["data"][row]
one = numpy.linalg.inv(precision)
shared = one / (int(pictures) + 1)
whole = numpy.kron(numpy.eye(len(time)), one - shared) + numpy.kron(numpy.ones((len(time), len(time))), shared)
inverse = numpy.linalg.inv(whole)

shapes = [analytic_model.shapes(int(c), tuple(x)) for c, x in zip(component, points)]
elastic, others = numpy.array([s[0] for s in shapes]), numpy.array([s[1] for s in shapes])

def log_posterior(a, b):
    misfit = numpy.concatenate([values[i] - 4e-4 * t * elastic - others @ analytic_model.factors(t, a, b)
                                for i, t in enumerate(time)])
    cell = numpy.array([force[i] - analytic_model.reaction_force(t, a, b) for i, t in enumerate(time)])
    return -0.5 * (misfit @ inverse @ misfit + (cell**2).sum() / 4 + ((a - 0.9) ** 2 + (b - 1.1) ** 2) / 0.2)

print(json.dumps(analytic_model.moments_on_a_grid(log_posterior)))
"""


def shift_picture(path, pixels):
    """Moves the content of an uncompressed TIFF of one channel to the right; the left border is repeated."""
    data = bytearray(path.read_bytes())
    order = "<" if data[:2] == b"II" else ">"
    at, = struct.unpack_from(order + "I", data, 4)
    tags = {}
    for k in range(struct.unpack_from(order + "H", data, at)[0]):
        tag, kind, count = struct.unpack_from(order + "HHI", data, at + 2 + 12 * k)
        size = {3: "H", 4: "I"}.get(kind)
        if size is None:
            continue
        place = at + 10 + 12 * k
        if count * struct.calcsize(size) > 4:
            place, = struct.unpack_from(order + "I", data, place)
        tags[tag] = struct.unpack_from(f"{order}{count}{size}", data, place)
    assert tags.get(259, (1,)) == (1,), "compressed"
    row = tags[256][0] * tags[258][0] // 8
    pixel = tags[258][0] // 8
    for offset, count in zip(tags[273], tags[279]):
        for start in range(offset, offset + count, row):
            line = data[start:start + row]
            data[start:start + row] = line[:pixel] * pixels + line[:-pixel * pixels]
    path.write_bytes(data)


class Test(Case):
    project_name = "picture_assimilation.toml"
    fixture = "analytic"

    def draw(self):
        self.expect(0, "simulate", self.project_name, "--model", "model.h5", "--images", "-o", "pictures")

    def test_pictures_are_drawn_with_their_times(self):
        self.draw()
        names = sorted(path.name for path in (self.folder / "pictures").iterdir())
        self.assertEqual(names[-2:], ["reference_1.tif", "reference_2.tif"])
        lines = (self.folder / "pictures" / "pictures.csv").read_text().splitlines()
        self.assertEqual(lines[0], "time,file")
        self.assertEqual([line.split(",")[1] for line in lines[1:]], [n for n in names if n.startswith("picture_")])

    def test_the_posterior_covers_the_parameters_that_drew_them(self):
        self.draw()
        lines = self.assimilate()
        last = lines[-1]
        truth = [1.06, 0.96]
        for k in range(2):
            self.assertLess(abs(last["mean"][k] - truth[k]), 3.3 * math.sqrt(last["covariance"][k][k]), last)
            self.assertLess(last["covariance"][k][k], 0.5 * lines[0]["covariance"][k][k])
        for line in lines:
            self.assertEqual(line["missing"], 0)
            self.assertIs(line["picture"]["missing"], False)
            self.assertTrue({"correlation", "precision", "update", "forecast", "total"} <= set(line["elapsed_us"]))
        self.assertTrue((self.folder / "results" / "displacements.h5").exists())

    def test_a_lens_is_taken_out(self):
        """It moves the corners by 4 px. Drawn without noise, measured and compared with the formula; then as data."""
        python = python_with("h5py", "numpy")
        if python is None:
            self.skipTest("no python3 with h5py here")
        (self.folder / "lens.yaml").write_text(
            "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
            "   data: [ 1500., 0., 310., 0., 1500., 150., 0., 0., 1. ]\n"
            "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.2, 0.1, 1.e-3, -2.e-3, 0. ]\n")
        self.edit('mesh = "model"', 'mesh = "model"\nnoise = 257\nlens = "lens.yaml"')
        self.edit("noise = 1\n", "noise = 0\nbit_depth = 16\n")
        self.draw()
        worst = "\n".join(QUADRATURE.split("with h5py")[0].splitlines()) + (
            '\nwith h5py.File("u.h5") as file:\n'
            '    points, component, time, values = (file[name][:] for name in ("dofs/points", "dofs/component", "time", "values"))\n'
            "exact = numpy.array([[analytic_model.displacement(int(c), tuple(x), t, 1.06, 0.96) for c, x in zip(component, points)] for t in time])\n"
            "print(json.dumps(float(numpy.nanmax(abs(values - exact)))))\n")

        def error():
            self.expect(0, "dic", self.project_name, "-o", "u.h5")
            return json.loads(subprocess.run([python, "-c", worst, pathlib.Path(__file__).parent], cwd=self.folder, check=True,
                                             capture_output=True, text=True).stdout)

        self.assertLess(error(), 1e-6)  # m, of 3.9e-4; 0.0025 px
        last = self.assimilate()[-1]
        for k in range(2):
            self.assertLess(abs(last["mean"][k] - TRUTH[k]), 3.3 * math.sqrt(last["covariance"][k][k]), last)
        self.edit('lens = "lens.yaml"\n', "")
        self.assertGreater(error(), 5e-6)
        self.edit('mesh = "model"', 'registration = "outline"\nlens = "lens.yaml"\nmesh = "model"')
        self.expect(3, "check", self.project_name, stderr='"dic.lens" needs "dic.scale", or "dic.pixels" and "dic.points"')

    def test_displacements_first_and_then_the_posterior_give_the_same(self):
        """`knothe dic -o u.h5` and assimilating that file, against pictures straight away: one noise, known from two references.
        Searches begin at other displacements (the model's, the last picture's): the iteration goes on to 1e-5 px."""
        self.edit('mesh = "model"', 'mesh = "model"\ntolerance = 1e-5')
        self.draw()
        at_once = self.assimilate()
        self.expect(0, "dic", self.project_name, "-o", "u.h5")
        self.edit('pictures = "pictures/"', 'file = "u.h5"')
        for one, other in zip(at_once, self.assimilate()):
            for k in range(2):
                self.assertAlmostEqual(one["mean"][k], other["mean"][k], delta=1e-6)

    def test_a_camera_that_moves_is_taken_out(self):
        """Every other picture is taken by a camera that stands a pixel further left."""
        self.draw()
        for path in sorted((self.folder / "pictures").glob("picture_*.tif"))[1::2]:
            shift_picture(path, 1)
        truth = [1.06, 0.96]

        def worst(lines):
            return max(abs(lines[-1]["mean"][k] - truth[k]) / math.sqrt(lines[-1]["covariance"][k][k]) for k in range(2))

        still = worst(self.assimilate(status=8))
        self.edit('mesh = "model"', 'mesh = "model"\ndrift = "rigid"')
        lines = self.assimilate()
        self.assertEqual([line["missing"] for line in lines], [0] * len(lines))
        self.assertLess(worst(lines), 3.5)
        self.assertGreater(still, 10)
        at_once = lines[-1]["mean"]
        self.expect(0, "dic", self.project_name, "-o", "u.h5")
        self.edit('pictures = "pictures/"', 'file = "u.h5"')
        for k, mean in enumerate(self.assimilate()[-1]["mean"]):
            self.assertAlmostEqual(mean, at_once[k], delta=1e-6)

    def test_the_outline_of_the_model_tells_where_the_picture_is(self):
        """Begun 1 % and some pixels off, or with nothing given: the same posterior as with the scale it was drawn with."""
        self.draw()
        exact = self.assimilate()[-1]
        for start in ("scale = 4.04e-4\norigin = [325, 274]", ""):
            self.edit('scale = 4e-4\norigin = [320, 270]', f'registration = "outline"\n{start}')
            outcome = self.expect(0, "dic", self.project_name, "--maps", "maps", "--table", "table.txt",
                                  stderr="registered by the outline: 0.")
            self.assertEqual((self.folder / "maps" / "registration.png").read_bytes()[:4], b"\x89PNG")
            self.assertIn("Registration", (self.folder / "table.txt").read_text())
            self.assertLess(abs(float(outcome.err.split("outline: ")[1].split()[0]) - 0.4), 0.0005)
            last = self.assimilate(stderr="registered by the outline")[-1]
            for k in range(2):
                std = math.sqrt(exact["covariance"][k][k])
                self.assertLess(abs(last["mean"][k] - exact["mean"][k]), 1.5 * std)
                self.assertLess(std, 1.05 * math.sqrt(last["covariance"][k][k]))  # the scale is not known exactly
            self.edit(f'registration = "outline"\n{start}', 'scale = 4e-4\norigin = [320, 270]')

    def test_an_outline_that_does_not_fit_is_told(self):
        self.draw()
        self.edit("scale = 4e-4", 'registration = "outline"\nscale = 4e-4')
        self.edit("origin = [320, 270]", "origin = [420, 100]")
        self.expect(4, "dic", self.project_name, stderr="reference_1.tif: error: ")
        self.edit("origin = [420, 100]", "origin = [320, 270]\noutline = [[-0.3, 0], [0.3, 0], [0.3, 0.1], [-0.3, 0.1]]")
        self.expect(4, "dic", self.project_name, stderr=["reference_1.tif: error: the outline does not tell the place to the right",
                                                         "on the upper and lower sides only"])
        self.edit("[0.3, 0.1], ", "[0.6, 0], [0.9, 0], ")
        self.edit(", [-0.3, 0.1]]", "]")
        self.expect(3, "dic", self.project_name, stderr="the outline has no area")
        self.edit('registration = "outline"\n', "")
        self.expect(3, "dic", self.project_name, stderr='"dic.outline" needs "dic.registration" = "outline"')

    def test_the_lower_face_is_seen_from_below(self):
        self.edit('mesh = "model"', 'mesh = "model"\nview = "bottom"')
        self.edit("origin = [320, 270]", "origin = [320, 145]")
        self.draw()
        last = self.assimilate()[-1]
        for k, truth in enumerate((1.06, 0.96)):
            self.assertLess(abs(last["mean"][k] - truth), 3.3 * math.sqrt(last["covariance"][k][k]), last)
            self.assertLess(math.sqrt(last["covariance"][k][k]), 0.2)

    def test_pictures_start_from_what_the_model_predicts(self):
        """Three pictures, far apart: more than a tenth of a pixel between them."""
        self.edit("every = 3", "every = 4")
        self.draw()
        starts = [line["picture"]["start"] for line in self.assimilate()]
        self.assertIn("model", starts[2:])
        self.assertEqual(set(starts[1:]) - {"model", "last"}, set())

    def test_a_picture_that_is_gone_is_missing_data(self):
        self.draw()
        gone = sorted((self.folder / "pictures").glob("picture_*.tif"))[2]
        gone.unlink()
        outcome = self.expect(0, "assimilate", self.project_name, "--json", stderr=f"{gone.name}: error: there is no such picture")
        lines = outcome.lines()
        self.assertEqual([line["picture"]["missing"] for line in lines[:-1]], [i == 2 for i in range(len(lines) - 1)])
        self.assertEqual(lines[2]["used"], 0)
        self.assertEqual(lines[2]["mean"], lines[1]["mean"])

    def test_what_is_lacking_is_said(self):
        self.draw()
        self.edit("scale = ", "#scale = ")
        self.expect(3, "assimilate", self.project_name, stderr='needs "dic.scale"')
        self.edit("#scale = ", "scale = ")
        self.edit('pictures = "pictures/"', 'pictures = "nothing/"')
        self.expect(4, "assimilate", self.project_name, stderr="no such folder of pictures")

    # A load cell and a clock beside the camera

    def machine(self, rows, header="time [s],imposed_displacement [m],reaction_force [N]"):
        (self.folder / "machine.csv").write_text("\n".join([header, *(",".join(map(repr, row)) for row in rows)]) + "\n")

    def with_machine(self, lines="", std="reaction_force = 2.0"):
        self.edit('pictures = "pictures/"\n', f'pictures = "pictures/"\nfile = "machine.csv"\n{lines}\n[data.std]\n{std}\n\n')

    def run_python(self, script, *arguments):
        done = subprocess.run([python_with("h5py", "numpy"), "-c", script, *map(str, arguments)], cwd=self.folder,
                              capture_output=True, text=True, timeout=200)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout or "null")

    def test_a_load_cell_beside_the_pictures(self):
        """The force at times of its own, in one posterior with the pictures: as by the displacements in a file with the force at
        their times, and as by dense quadrature of both with the formula and the whole covariance of all pictures."""
        if python_with("h5py", "numpy") is None:
            self.skipTest("no python3 with h5py here")
        self.edit('mesh = "model"', 'mesh = "model"\ntolerance = 1e-5')
        self.draw()
        noise = random.Random(7)
        rows = [(k / 37, 4e-4 * k / 37, analytic_model.reaction_force(k / 37, *TRUTH) + noise.gauss(0, 2)) for k in range(38)]
        self.machine(rows)
        alone = self.assimilate()[-1]
        self.with_machine()
        both = self.assimilate()
        self.assertLess(both[-1]["covariance"][0][0], 0.8 * alone["covariance"][0][0])
        self.expect(0, "dic", self.project_name, "-o", "u.h5")
        self.run_python(ADD_FORCE)
        judge = self.run_python(QUADRATURE, pathlib.Path(__file__).parent)
        for k in range(2):
            std = math.sqrt(both[-1]["covariance"][k][k])
            self.assertAlmostEqual(both[-1]["mean"][k], judge["mean"][k], delta=0.05 * std)
            self.assertAlmostEqual(std, judge["std"][k], delta=0.05 * std)
        self.edit('pictures = "pictures/"\nfile = "machine.csv"', 'file = "u.h5"')
        for one, other in zip(both, self.assimilate()):
            for k in range(2):
                self.assertAlmostEqual(one["mean"][k], other["mean"][k], delta=1e-6)

    def test_a_load_cell_is_simulated_with_the_pictures(self):
        """[simulate.noise] names an output: machine.csv beside the pictures, and a series beside displacements; both are assimilated."""
        self.edit("[simulate.camera]", "[simulate.noise]\nreaction_force = 2.0\n\n[simulate.camera]")
        self.draw()
        head, *lines = (self.folder / "pictures" / "machine.csv").read_text().splitlines()
        self.assertEqual(head, "time,reaction_force [N]")
        rows = [[float(x) for x in line.split(",")] for line in lines]
        errors = [force - analytic_model.reaction_force(t, *TRUTH) for t, force in rows]
        self.assertGreater(len(rows), 10)
        self.assertLess(math.sqrt(sum(e * e for e in errors) / len(errors)), 4)
        self.assertGreater(math.sqrt(sum(e * e for e in errors) / len(errors)), 0.8)
        alone = self.assimilate()[-1]
        shutil.copy(self.folder / "pictures" / "machine.csv", self.folder / "machine.csv")
        self.with_machine()
        both = self.assimilate()[-1]
        self.assertEqual(both["used"], alone["used"] + 1)
        for k in range(2):
            self.assertLess(both["covariance"][k][k], alone["covariance"][k][k])
            self.assertLess(abs(both["mean"][k] - TRUTH[k]), 4 * math.sqrt(both["covariance"][k][k]))
        self.edit("[simulate.camera]", '[simulate.dofs]\nrandom = 3\n\n[simulate.camera]')
        self.expect(0, "simulate", self.project_name, "--model", "model.h5", "-o", "points.h5")
        self.edit('pictures = "pictures/"\nfile = "machine.csv"', 'file = "points.h5"')
        self.assertEqual(self.assimilate()[-1]["used"], 7)
        self.edit("[simulate.noise]\nreaction_force", "[simulate.noise]\nreaction_forc")
        self.expect(3, "simulate", self.project_name, "--model", "model.h5", "--images", "-o", "pictures",
                    stderr='simulate.noise.reaction_forc is no quantity or output of the model (did you mean "reaction_force"?)')
        self.expect(3, "check", self.project_name, stderr="simulate.noise.reaction_forc")

    def test_a_clock_of_the_machine_that_is_off_from_the_cameras(self):
        """Times in seconds; the machine's stroke tells how far the test is, and its clock is 0.6 s ahead."""
        self.draw()
        table = (self.folder / "pictures" / "pictures.csv").read_text().splitlines()
        times = [f"{60 * float(line.split(',')[0])!r},{line.split(',')[1]}" for line in table[1:]]
        (self.folder / "pictures" / "pictures.csv").write_text("\n".join([table[0], *times]) + "\n")
        at = [0.25 * k for k in range(260)]
        self.machine([(s, 0.4 * (s - 0.6) / 60, 1e-3 * analytic_model.reaction_force((s - 0.6) / 60, *TRUTH)) for s in at],
                     "time [s],imposed_displacement [mm],reaction_force [kN]")
        std = "imposed_displacement = 1e-5\nreaction_force = 6e-3"
        self.with_machine('clock = "imposed_displacement"', std)

        def worst(lines):
            return max(abs(lines[-1]["mean"][k] - TRUTH[k]) / math.sqrt(lines[-1]["covariance"][k][k]) for k in range(2))

        lines = self.assimilate(status=8)  # as if there were one clock
        self.assertGreater(worst(lines), 6)
        self.edit('clock = "imposed_displacement"\n', 'clock = "imposed_displacement"\ntime_offset_std = 1.0\n')
        lines = self.assimilate()
        self.assertLess(worst(lines), 3)
        offset = lines[-1]["nuisances"]["time_offset"]
        self.assertLess(abs(offset["mean"] - 0.6), 2.5 * offset["std"])
        self.assertLess(offset["std"], 0.2)
        self.expect(0, "report", "results", "-o", "report.html")
        self.assertRegex((self.folder / "report.html").read_text(), r"The clock of the data file is 0\.\d+ ± 0\.\d+ ahead")
        self.assertAlmostEqual(lines[-1]["time"], (60 * float(table[-1].split(",")[0]) - 0.6) / 60, places=9)

    def test_what_a_file_beside_pictures_lacks_is_told(self):
        self.draw()
        self.with_machine()
        self.machine([(5.0, 0.0, 1.0), (6.0, 1e-4, 2.0)])
        self.expect(4, "assimilate", self.project_name, stderr=["machine.csv", "its times, 5 to 6", "those of the pictures, 0.", "one clock"])
        self.machine([(0.0, 0.0), (1.0, 1e-4)], "time,imposed_displacement")
        self.expect(3, "assimilate", self.project_name,
                    stderr=[self.position_of("reaction_force = 2.0"), "machine.csv has no series \"reaction_force\"", "imposed_displacement"])
        self.machine([(0.0, 1.0), (0.0, 2.0)], "time,reaction_force")
        self.expect(4, "assimilate", self.project_name, stderr=["machine.csv:3:1: error: column time: the times of a table of series increase"])
        self.machine([(0.0, 1.0), (1.0, 2.0)], "time,reaction_force (mm)")
        self.expect(4, "assimilate", self.project_name, stderr=['"reaction_force" is in mm, in the model in N'])
        self.edit('file = "machine.csv"', 'file = "u.h5"')
        (self.folder / "machine.csv").unlink()
        self.edit('file = "u.h5"\n\n[data.std]\nreaction_force = 2.0\n', "")
        self.expect(0, "dic", self.project_name, "-o", "u.h5")
        self.with_machine()
        self.edit('file = "machine.csv"', 'file = "u.h5"')
        self.expect(4, "assimilate", self.project_name, stderr=["u.h5: its displacements have correlated noise", "noise/precision"])
        self.edit('file = "u.h5"\n', "time_offset_std = 1.0\n")
        self.expect(3, "assimilate", self.project_name, stderr=[self.position_of("time_offset_std"), "it needs both"])


if __name__ == "__main__":
    unittest.main()
