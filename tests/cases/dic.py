"""`knothe dic`: displacements from pictures, against the motion with which the pictures were drawn."""
import csv
import functools
import json
import math
import pathlib
import random
import re
import subprocess
import unittest
import zlib
import xml.etree.ElementTree

from dic_pictures import Speckle, write_pages, write_pgm, write_tiff, write_tiff16
from support import DATA, KNOTHE, Case, python_with

KEYS = ["picture", "iterations", "converged", "residual_rms", "nodes", "elements_rejected", "elapsed_ms", "noise_std_px"]
REAL = DATA / "concrete_bending"
ROI = "12,12,147,107"


def stretch(x, y):
    return 0.4 + 0.004 * (x - 80), -0.3 + 0.002 * (x - 80) - 0.003 * (y - 60)


def shift(x, y):
    return 3.3, -2.6


@functools.lru_cache(maxsize=None)
def drawn(name):
    speckle = Speckle()
    return {"reference": lambda: speckle.picture(noise=1, seed=1), "a": lambda: speckle.picture(stretch, noise=1, seed=2),
            "b": lambda: speckle.picture(shift, noise=1, seed=3),
            "dark": lambda: speckle.picture(stretch, noise=1, seed=4, gain=0.75, offset=12)}[name]()


class Test(Case):
    project_name = "dic.toml"

    def draw(self, *names):
        for name in names:
            write_pgm(self.folder / f"{name}.pgm", drawn(name))

    def write_points(self):
        points = [(x, y) for x in range(16, 145, 16) for y in range(16, 105, 11)] + [(2, 2)]
        (self.folder / "points.csv").write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in points))
        return points

    def table(self, path):
        with open(self.folder / path, newline="") as file:
            rows = list(csv.reader(file))
        self.assertEqual(rows[0], ["x", "y", "u", "v", "inside"])
        return [[float(v) for v in row] for row in rows[1:]]

    def expect_motion(self, path, motion, rms, bias):
        rows = self.table(path)
        errors = []
        for x, y, u, v, inside in rows:
            if inside == 0:
                self.assertTrue(math.isnan(u) and math.isnan(v))
                continue
            exact = motion(x, y)
            errors += [u - exact[0], v - exact[1]]
        self.assertEqual(rows[-1][:2] + rows[-1][4:], [2, 2, 0])
        self.assertEqual(len(errors), 2 * (len(rows) - 1))
        self.assertLess(math.sqrt(sum(e * e for e in errors) / len(errors)), rms)
        self.assertLess(abs(sum(errors) / len(errors)), bias)

    def test_displacements_at_points_are_those_drawn(self):
        self.draw("reference", "a")
        self.write_points()
        out = self.expect(0, "dic", "reference.pgm", "a.pgm", "--element-size", 15, "--roi", ROI, "--at", "points.csv",
                          "-o", "u.csv", "--json")
        line, = out.lines()
        self.assertEqual([key for key in line if key in KEYS], KEYS)
        self.assertEqual(line["picture"], "a.pgm")
        self.assertIs(line["converged"], True)
        self.assertEqual((line["nodes"], line["elements_rejected"]), (70, 0))
        # The noise is 1 grey level in both pictures, a little less after interpolation.
        self.assertTrue(1.1 < line["residual_rms"] < 1.5, line)
        self.assertTrue(0.002 < line["noise_std_px"] < 0.03, line)
        self.expect_motion("u.csv", stretch, rms=2 * line["noise_std_px"], bias=0.003)

    def test_standard_deviations_at_points_are_those_of_the_errors(self):
        self.draw("reference", "a")
        self.write_points()
        common = ["dic", "reference.pgm", "a.pgm", "--element-size", 15, "--roi", ROI, "--at", "points.csv"]
        self.expect(0, *common, "-o", "plain.csv")
        line, = self.expect(0, *common, "-o", "u.csv", "--std", "--json").lines()
        with open(self.folder / "u.csv", newline="") as file:
            header, *rows = csv.reader(file)
        self.assertEqual(header, ["x", "y", "u", "v", "inside", "u_std", "v_std"])
        self.assertEqual([[float(v) for v in row[:5]] for row in rows[:-1]], self.table("plain.csv")[:-1])
        self.assertEqual(rows[-1][2:], ["nan", "nan", "0", "nan", "nan"])
        squares = []
        for x, y, u, v, _, u_std, v_std in ([float(v) for v in row] for row in rows[:-1]):
            exact = stretch(x, y)
            squares += [((u - exact[0]) / u_std) ** 2, ((v - exact[1]) / v_std) ** 2]
            # Between the nodes errors partly cancel.
            self.assertTrue(0.2 * line["noise_std_px"] < u_std < 1.6 * line["noise_std_px"], (x, y, u_std, line))
        self.assertTrue(0.7 < math.sqrt(sum(squares) / len(squares)) < 1.4, sum(squares) / len(squares))
        self.expect(2, *common[:7], "--std", stderr="--std needs --at")

    def test_brightness_and_contrast_do_not_matter(self):
        self.draw("reference", "dark")
        self.write_points()
        self.expect(0, "dic", "reference.pgm", "dark.pgm", "--element-size", 15, "--roi", ROI, "--at", "points.csv", "-o", "u.csv")
        self.expect_motion("u.csv", stretch, rms=0.02, bias=0.005)

    def test_a_large_rotation_is_found_without_a_start(self):
        angle = math.radians(15)

        def turn(x, y):
            dx, dy = x - 80, y - 60
            return 9 + (math.cos(angle) - 1) * dx - math.sin(angle) * dy, -5 + math.sin(angle) * dx + (math.cos(angle) - 1) * dy
        self.draw("reference")
        write_pgm(self.folder / "turned.pgm", Speckle().picture(turn, noise=1, seed=5))
        self.write_points()
        line, = self.expect(0, "dic", "reference.pgm", "turned.pgm", "--element-size", 15, "--roi", "30,25,130,95", "--at",
                            "points.csv", "-o", "u.csv", "--json").lines()
        self.assertIs(line["converged"], True)
        errors = [math.hypot(u - turn(x, y)[0], v - turn(x, y)[1]) for x, y, u, v, inside in self.table("u.csv") if inside == 1]
        self.assertGreater(len(errors), 20)
        self.assertLess(math.sqrt(sum(e * e for e in errors) / len(errors)), 0.03)

    def test_corners_of_the_region_may_come_in_any_order(self):
        self.draw("reference", "a")
        first, second = [self.expect(0, "dic", "reference.pgm", "a.pgm", "--element-size", 15, "--roi", roi, "--json").lines()[0]
                         for roi in (ROI, "147,107,12,12")]
        self.assertEqual(first["residual_rms"], second["residual_rms"])

    def test_sixteen_bits_are_read_at_full_depth(self):
        """A motion of a dim 16-bit picture whose upper bytes alone hold six grey levels."""
        speckle = Speckle()
        write_tiff16(self.folder / "reference.tif", speckle.picture(top=1500))
        write_tiff16(self.folder / "a.tif", speckle.picture(stretch, top=1500))
        self.write_points()
        self.expect(0, "dic", "reference.tif", "a.tif", "--element-size", 15, "--roi", ROI, "--at", "points.csv", "-o", "u.csv")
        self.expect_motion("u.csv", stretch, rms=0.004, bias=0.002)

    def test_several_pictures_give_a_folder_of_tables(self):
        self.draw("reference", "a", "b")
        self.write_points()
        lines = self.expect(0, "dic", "reference.pgm", "a.pgm", "b.pgm", "--element-size", 15, "--roi", ROI, "--at", "points.csv",
                            "-o", "u", "--json").lines()
        self.assertEqual([line["picture"] for line in lines], ["a.pgm", "b.pgm"])
        self.expect_nothing_but(self.folder / "u", ["a.csv", "b.csv"])
        self.expect_motion("u/a.csv", stretch, rms=0.03, bias=0.005)
        self.expect_motion("u/b.csv", shift, rms=0.03, bias=0.005)

    def test_a_project_gives_a_file_in_metres(self):
        out = self.expect(0, "check", "dic.toml").out
        self.assertIn("reference.pgm, a.pgm, b.pgm are missing so far", out.replace(f"{self.folder}/", ""))
        self.draw("reference", "a", "b")
        lines = self.expect(0, "dic", "dic.toml", "-o", "u.h5", "--json").lines()
        self.assertEqual([line["converged"] for line in lines], [True, True])
        content = (self.folder / "u.h5").read_bytes()
        for name in (b"precision", b"shared_reference", b"length_unit", b"indptr"):
            self.assertIn(name, content)

    def test_fields_and_maps_are_written(self):
        self.draw("reference", "a", "b")
        self.expect(0, "dic", "dic.toml", "-o", "fields.pvd", "--maps", "maps")
        series = (self.folder / "fields.pvd").read_text()
        for name in ("fields_a.vtu", "fields_b.vtu"):
            self.assertIn(name, series)
            self.assertIn(b"displacement_std", (self.folder / name).read_bytes())
        # With a scale in the project displacements are in m, and the times are the project's.
        self.assertEqual(re.findall(r'timestep="(.*?)"', series), ["0.5", "1"])
        time, units = self.time_and_units("fields_a.vtu")
        self.assertEqual(time, 0.5)
        self.assertEqual(units, {"displacement": "m", "displacement_std": "m", "strain_xx_yy_xy": "1", "measured": None,
                                 "residual_grey_levels": "grey levels", "valid": None})
        self.expect(0, "dic", "reference.pgm", "b.pgm", "--element-size", 15, "--roi", ROI, "-o", "b.vtu")
        time, units = self.time_and_units("b.vtu")
        self.assertEqual((time, units["displacement"], units["displacement_std"]), (0, "px", "px"))
        page = (self.folder / "maps" / "index.html").read_text()
        for text in ("a.pgm", "b.pgm", 'src="a.png"', "noise of a displacement, px", "Result: usable<", "2 of 2 pictures measured; "):
            self.assertIn(text, page)
        for name in ("a.png", "b.png"):
            self.assertEqual((self.folder / "maps" / name).read_bytes()[:8], b"\x89PNG\r\n\x1a\n")

    def time_and_units(self, name):
        """Of a field file, as VTK stores them."""
        root = xml.etree.ElementTree.fromstring((self.folder / name).read_bytes().partition(b"<AppendedData")[0] + b"</VTKFile>")
        (time,) = root.findall(".//FieldData/DataArray[@Name='TimeValue']")
        arrays = root.findall(".//PointData/DataArray") + root.findall(".//CellData/DataArray")
        return float(time.text), {array.get("Name"): array.findtext("InformationKey[@name='UNITS_LABEL']") for array in arrays}

    def test_a_bad_picture_is_named_and_the_series_goes_on(self):
        self.draw("reference", "a", "b")
        write_pgm(self.folder / "black.pgm", [[0] * 160] * 120)
        write_pgm(self.folder / "grey.pgm", [[90] * 160] * 120)
        write_pgm(self.folder / "small.pgm", [[1, 2]] * 2)
        write_pgm(self.folder / "copy.pgm", drawn("a"))
        write_pgm(self.folder / "other.pgm", Speckle(seed=9).picture())
        (self.folder / "cut.pgm").write_bytes((self.folder / "a.pgm").read_bytes()[:5000])
        (self.folder / "colour.ppm").write_bytes(b"P6\n2 2\n255\n" + bytes(range(12)))
        (self.folder / "text.tif").write_text("this is no picture at all")
        bad = {"black.pgm": "black", "grey.pgm": "uniform", "small.pgm": "2 × 2 pixels", "cut.pgm": "truncated",
               "colour.ppm": "colour", "text.tif": "unsupported picture format", "gone.tif": "no such picture", "copy.pgm": "the same as a.pgm",
               "other.pgm": "not converged"}
        names = ["black.pgm", "grey.pgm", "small.pgm", "a.pgm", "copy.pgm", "cut.pgm", "colour.ppm", "text.tif", "gone.tif",
                 "other.pgm", "b.pgm"]
        outcome = self.expect(0, "dic", "reference.pgm", *names, "--element-size", 15, "--roi", ROI, "-o", "u.h5", "--json")
        lines = outcome.lines()
        self.assertEqual([line["picture"] for line in lines], names)
        for line in lines:
            name = line["picture"]
            self.assertEqual(line["missing"], name in bad, name)
            self.assertEqual(line["converged"], name not in bad, name)
            if name in bad:
                self.assertIn(bad[name], line["message"])
                self.assertIn(f"{name}: error: ", outcome.err)
        self.assertTrue((self.folder / "u.h5").exists())

    def test_a_picture_that_diverges_does_not_end_the_series(self):
        self.draw("reference", "a")
        rows = [[(37 * i + i * i // 7) % 256 for i in range(160 * y, 160 * (y + 1))] for y in range(120)]
        write_pgm(self.folder / "stripes.pgm", rows)
        outcome = self.expect(0, "dic", "reference.pgm", "stripes.pgm", "a.pgm", "--element-size", 15, "--roi", ROI, "-o", "u.h5",
                              "--json")
        stripes, a = outcome.lines()
        self.assertIn("stripes.pgm: error: not converged: the iteration diverged", stripes["message"])
        self.assertTrue(stripes["missing"] and a["converged"], str(outcome))
        # What is left is the residual of no motion.
        self.assertTrue(20 < stripes["residual_rms"] < 150, stripes)
        self.assertTrue((self.folder / "u.h5").exists())

    def test_the_pages_of_a_tiff_are_a_series(self):
        names = ("reference", "a", "b")
        self.draw(*names)
        write_pages(self.folder / "stack.tif", 160, 120, [bytes(level for row in drawn(name) for level in row) for name in names])
        (self.folder / "stack.toml").write_text(f'[data]\npictures = "stack.tif"\n[dic]\nroi = [{ROI}]\n')
        points = self.write_points()
        self.expect(0, "dic", "stack.toml", "--at", "points.csv", "-o", "pages")
        self.expect(0, "dic", "reference.pgm", "a.pgm", "b.pgm", "--roi", ROI, "--at", "points.csv", "-o", "files")
        for page, name in (("stack_2", "a"), ("stack_3", "b")):
            rows = self.table(f"pages/{page}.csv")
            self.assertEqual(len(rows), len(points))
            self.assertEqual(str(rows), str(self.table(f"files/{name}.csv")))

    def test_a_broken_tiff_is_refused_with_a_reason(self):
        self.draw("reference")
        noise = random.Random(1).randbytes(160 * 120)
        write_tiff(self.folder / "zip.tif", 160, 120, zlib.compress(noise)[:9000], bits=8, compression=8)
        write_tiff(self.folder / "fax.tif", 160, 120, noise[:3000], bits=1, compression=3)
        outcome = self.expect(4, "dic", "reference.pgm", "zip.tif", "fax.tif", "--roi", ROI)
        self.assertRegex(outcome.err, r"zip\.tif: error: row \d+ cannot be read: the file is truncated or damaged \(ZLib error\)")
        self.assertRegex(outcome.err, r"fax\.tif: error: row \d+ cannot be read: the file is truncated or damaged \(.*line \d+ of strip 0")

    def test_no_more_iterations_than_allowed(self):
        self.draw("reference", "a", "b")
        self.edit("element_size = 15", "element_size = 15\ntolerance = 1e-12\nmax_iterations = 14\nrejection_factor = 0")
        outcome = self.run_knothe("dic", self.project_name, "--json")
        self.assertEqual(outcome.status, 6, str(outcome))
        for line in outcome.lines():
            self.assertEqual(line["iterations"], 14)
            self.assertIn("after 14 iterations displacements still change by", line["message"])

    def test_when_nothing_could_be_measured_the_status_says_so(self):
        self.draw("reference")
        write_pgm(self.folder / "other.pgm", Speckle(seed=9).picture())
        arguments = ["--element-size", 15, "--roi", ROI]
        self.expect(4, "dic", "reference.pgm", "gone.pgm", *arguments, stderr="gone.pgm: error: there is no such picture")
        self.assertEqual(self.run_knothe("dic", "reference.pgm", "other.pgm", *arguments).status, 6)
        self.expect(4, "dic", "gone.pgm", "reference.pgm", *arguments, stderr="gone.pgm")

    def test_wrong_usage(self):
        self.draw("reference", "a")
        both = ["reference.pgm", "a.pgm"]
        self.expect(2, "dic", "reference.pgm", stderr="a reference picture and at least one deformed")
        self.expect(2, "dic", *both, "--roi", "1,2,3", stderr="--roi takes two opposite corners")
        self.expect(2, "dic", *both, "--roi", "12,12,200,107", stderr="outside the picture of 160 × 120 px")
        self.expect(2, "dic", *both, "--element-size", 2, stderr="at least 3 × 3 pixels")
        self.expect(2, "dic", *both, "-o", "u.txt", stderr="HDF5 file (.h5)")
        self.expect(2, "dic", *both, "--element-size", "-1", stderr="--element-size: must be a positive number, not -1")
        self.expect(2, "dic", *both, "--prefilter", "x", stderr="--prefilter: must be a non-negative number, not x")
        self.write_points()
        self.expect(2, "dic", *both, "--at", "points.csv", stderr="--at needs -o")
        (self.folder / "wrong.csv").write_text("x,z\n1,2\n")
        self.expect(2, "dic", *both, "a.pgm", "--at", "points.csv", "-o", "u.csv", stderr="it takes a folder, whose name has no ending")
        self.expect(4, "dic", *both, "--at", "wrong.csv", "-o", "u.csv", stderr="wrong.csv:1")
        write_pgm(self.folder / "mask.pgm", [[255] * 20] * 20)
        self.expect(2, "dic", *both, "--mask", "mask.pgm", stderr="the mask mask.pgm has 20 × 20 pixels")
        write_pgm(self.folder / "none.pgm", [[0] * 160] * 120)
        self.expect(2, "dic", *both, "--mask", "none.pgm", stderr="the mask is black everywhere")
        self.expect(2, "dic", *both, "--mask", "none.pgm", "--roi", ROI, stderr="mask")
        self.expect(2, "dic", "reference.pgm", "--pattern", "-o", "u.h5", stderr="--pattern measures nothing")
        self.expect(2, "dic", *both, "-o", "u.csv", "--at", "points.csv", "--resume", stderr="--resume needs -o FILE.h5")
        self.expect(2, "dic", *both, "--table", "t.pdf", stderr="must end in .txt, .json or .html")
        write_pgm(self.folder / "flat.pgm", [[90] * 160] * 120)
        self.expect(2, "dic", "flat.pgm", "a.pgm", stderr="no texture")

    def test_a_pattern_of_black_and_white_is_measured_where_white_is_no_saturation(self):
        for name in ("reference", "a"):
            rows = drawn(name)
            write_pgm(self.folder / f"{name}.pgm", [[255 if level > 127 else 0 for level in row] for row in rows])
        both = ["dic", "reference.pgm", "a.pgm", "--element-size", 15, "--roi", ROI]
        self.expect(2, *both, stderr="where white belongs to the pattern set another level (--saturation, dic.saturation)")
        outcome = self.run_knothe(*both, "--saturation", 300)
        self.assertEqual(outcome.status, 0, str(outcome))
        self.assertIn("the fields are not kept: -o FILE.h5", outcome.err)

    def test_mistakes_in_the_project_are_placed(self):
        self.draw("reference", "a", "b")
        self.edit("element_size = 15", "element_sise = 15")
        self.expect(3, "dic", "dic.toml", stderr=[f"dic.toml:{self.position_of('element_sise')}", 'did you mean "element_size"'])
        self.edit("element_sise = 15", 'element_size = 15\nshape = "round"')
        self.expect(3, "dic", "dic.toml", stderr='"quadrilateral", "triangle"')
        self.edit('shape = "round"', "angle = 2")
        self.edit("scale = 2e-5\n", "")
        self.expect(3, "dic", "dic.toml", stderr='"dic.angle" needs "dic.scale"')
        self.edit("angle = 2", 'mesh_file = "plate.msh"\nmesh_unit = "m"\nregularisation_kind = "mechanical"\nreference_update = 0.5')
        self.expect(3, "dic", "dic.toml", stderr=['"dic.mesh_unit" = "m" needs "dic.scale"', '"dic.regularisation_kind" needs "dic.regularisation"',
                                                  '"dic.reference_update" is a factor of the residual, above 1'])

    def test_a_mesh_comes_from_a_file(self):
        self.draw("reference", "a")
        self.write_points()
        nodes = ["12 12", "80 20", "147 12", "14 60", "76 66", "147 60", "12 107", "84 100", "147 107"]
        cells = ["3 2 1 1 1 2 5 4", "3 2 1 1 2 3 6 5", "3 2 1 1 4 5 8 7", "2 2 1 1 5 6 9", "2 2 1 1 5 9 8"]
        text = ("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n9\n" + "".join(f"{i + 1} {n} 0\n" for i, n in enumerate(nodes))
                + "$EndNodes\n$Elements\n5\n" + "".join(f"{i + 1} {c}\n" for i, c in enumerate(cells)) + "$EndElements\n")
        (self.folder / "plate.msh").write_text(text)
        both = ["reference.pgm", "a.pgm", "--mesh", "plate.msh"]
        line, = self.expect(0, "dic", *both, "--at", "points.csv", "-o", "u.csv", "--json").lines()
        self.assertEqual((line["nodes"], line["elements"]), (9, 5))
        rows = [row for row in self.table("u.csv") if row[4] == 1]
        self.assertGreater(len(rows), 60)
        for x, y, u, v, _ in rows:
            exact = stretch(x, y)
            self.assertLess(math.hypot(u - exact[0], v - exact[1]), 0.03)
        (self.folder / "plate.msh").write_text(text.replace("147 60", "147 sixty"))
        self.expect(4, "dic", *both, stderr='plate.msh:11:7: error: "sixty" is not a finite number')
        (self.folder / "plate.msh").write_text(text.replace("76 66", "13 13"))
        self.expect(2, "dic", *both, stderr="neither a triangle with an area nor a convex quadrilateral")
        small = text
        for node in nodes:  # as if they were in another unit
            small = small.replace(f" {node} 0\n", " {:.3f} {:.3f} 0\n".format(*(0.02 * float(x) for x in node.split())))
        (self.folder / "plate.msh").write_text(small)
        self.expect(2, "dic", *both, stderr="at least 3 × 3 pixels")
        self.expect(4, "dic", *both[:3], "plate.stl", stderr="Gmsh (.msh) and VTK (.vtu)")

    def test_a_file_of_a_mixed_mesh_has_a_value_for_each_of_its_cells(self):
        """A quadrilateral between two triangles is two cells."""
        self.draw("reference", "a", "b")
        nodes = ["12 12", "80 20", "147 12", "14 107", "76 100", "147 107"]
        cells = ["2 2 1 1 1 5 4", "3 2 1 1 1 2 6 5", "2 2 1 1 2 3 6"]
        (self.folder / "plate.msh").write_text(
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n6\n" + "".join(f"{i + 1} {n} 0\n" for i, n in enumerate(nodes))
            + "$EndNodes\n$Elements\n3\n" + "".join(f"{i + 1} {c}\n" for i, c in enumerate(cells)) + "$EndElements\n")
        python = python_with("h5py")
        if python is None:
            self.skipTest("no python3 with h5py here: scripts/packages.txt")
        command = ["dic", "reference.pgm", "a.pgm", "b.pgm", "--mesh", "plate.msh", "-o", "u.h5", "--json"]
        self.expect(0, *command[:3], *command[4:])
        program = """import h5py, json
file = h5py.File("u.h5")
print(json.dumps([file["mesh/cells"].shape, file["elements/valid"].shape, file["elements/residual"][0].tolist()]))"""
        outcome = subprocess.run([python, "-c", program], capture_output=True, text=True, cwd=self.folder)
        self.assertEqual(outcome.returncode, 0, outcome.stderr)
        shape, valid, residual = json.loads(outcome.stdout)
        self.assertEqual((shape, valid), ([4, 3], [1, 4]))
        self.assertEqual(residual[1], residual[2])
        self.assertEqual(len(set(residual)), 3)
        line, = self.expect(0, *command, "--resume").lines()
        self.assertIs(line["converged"], True)

    def test_a_mask_takes_its_pixels_out(self):
        self.draw("reference", "a")
        mask = [[0 if 60 <= x < 100 and 40 <= y < 80 else 255 for x in range(160)] for y in range(120)]
        write_pgm(self.folder / "mask.pgm", mask)
        (self.folder / "points.csv").write_text("x,y\n80,60\n30,30\n")
        self.expect(0, "dic", "reference.pgm", "a.pgm", "--element-size", 15, "--roi", ROI, "--mask", "mask.pgm",
                    "--at", "points.csv", "-o", "u.csv")
        self.assertEqual([row[4] for row in self.table("u.csv")], [0, 1])

    def test_repeated_references_tell_the_noise(self):
        self.draw("reference", "a", "b")
        for k in range(4):
            write_pgm(self.folder / f"repeat{k}.pgm", Speckle().picture(noise=1, seed=10 + k))
        self.edit('["reference.pgm"]', '["repeat0.pgm", "repeat1.pgm", "repeat2.pgm", "repeat3.pgm"]')
        line = self.expect(0, "dic", "dic.toml", "--json").lines()[0]
        # Rounding to whole levels adds 1/12 to the variance.
        self.assertAlmostEqual(line["noise_grey_levels"], math.sqrt(1 + 1 / 12), delta=0.03)

    def test_interrupted_it_keeps_what_is_done(self):
        self.draw("reference", "a", "b")
        names = ["a.pgm", "b.pgm"] * 400
        lines, message = self.interrupt_after_first_line("dic", "reference.pgm", *names, "--element-size", "15", "--roi", ROI,
                                                         "-o", "u.h5", "--json")
        self.assertTrue(1 <= len(lines) < 800)
        self.assertIn(f"interrupted after {len(lines)} of 800 pictures; their results are in u.h5", message)
        self.assertTrue((self.folder / "u.h5").exists())

    def test_interrupted_it_goes_on(self):
        """The end of a series from the file that its beginning left is that of the whole series."""
        self.draw("reference", "a", "b")
        common = ["--element-size", 15, "--roi", ROI, "--json"]
        names = ["a.pgm", "b.pgm", "a.pgm"]
        whole = self.expect(0, "dic", "reference.pgm", *names, *common, "-o", "whole.h5").lines()
        self.expect(0, "dic", "reference.pgm", *names[:2], *common, "-o", "u.h5")
        outcome = self.expect(0, "dic", "reference.pgm", *names, *common, "-o", "u.h5", "--resume")
        line, = outcome.lines()
        self.assertIn("2 of 3 pictures are in u.h5 already", outcome.err)
        for key in ("picture", "iterations", "residual_rms", "elements_rejected"):
            self.assertEqual(line[key], whole[2][key])
        self.expect(4, "dic", "reference.pgm", *names, "--roi", ROI, "--element-size", 20, "-o", "u.h5", "--resume",
                    stderr="u.h5: error: it holds the mesh of another series")
        self.expect(4, "dic", "reference.pgm", "b.pgm", *common, "-o", "u.h5", "--resume",
                    stderr="it holds the pictures of another series")

    def test_a_pattern_is_judged_before_the_test(self):
        self.draw("reference")
        write_pgm(self.folder / "repeat.pgm", Speckle().picture(noise=1, seed=10))
        line, = self.expect(0, "dic", "reference.pgm", "repeat.pgm", "--pattern", "--element-size", 15, "--roi", ROI, "--json",
                            "--maps", "maps", "--table", "table.html").lines()
        self.assertAlmostEqual(line["noise_grey_levels"], math.sqrt(1 + 1 / 12), delta=0.06)
        self.assertIs(line["noise_is_assumed"], False)
        self.assertTrue(3 < line["speckle_size_px"][0] < 9, line)
        self.assertTrue(0.002 < line["noise_std_px"] < line["largest_std_px"] < 0.05, line)
        self.assertEqual((self.folder / "maps" / "pattern.png").read_bytes()[:4], b"\x89PNG")
        self.assertIn("quintic B-spline", (self.folder / "table.html").read_text())
        text = self.expect(0, "dic", "reference.pgm", "--pattern", "--roi", ROI).out
        self.assertIn("the noise is assumed", text)
        # A loaded surface is no repeat; and noise is no pattern.
        self.draw("a")
        outcome = self.run_knothe("dic", "reference.pgm", "a.pgm", "--pattern", "--roi", ROI)
        self.assertEqual(outcome.status, 0, str(outcome))
        self.assertIn("a.pgm: the surface has moved since reference.pgm", outcome.err)
        self.assertNotIn("moved", self.run_knothe("dic", "reference.pgm", "repeat.pgm", "--pattern", "--roi", ROI).err)
        for name in "no_pattern", "again":
            noise = random.Random(name)
            write_pgm(self.folder / f"{name}.pgm", [[round(128 + noise.gauss(0, 2)) for _ in range(160)] for _ in range(120)])
        self.expect(4, "dic", "no_pattern.pgm", "again.pgm", "--pattern", "--roi", ROI, stderr="there is no pattern to follow")

    def real(self, *names):
        if not REAL.exists():
            self.skipTest(f"{REAL} is not there: set KNOTHE_DATA to the folder of recorded data")
        return [REAL / f"IMG_{name}.tif" for name in names]

    def test_the_real_pair_goes_forth_and_back(self):
        """Displacements of 0155 → 0160 and back add up to nothing, away from the crack, within 0.01 px rms."""
        first, second = self.real("0155", "0160")
        common = ["--element-size", 25, "--prefilter", 1, "--roi", "100,240,1600,1040"]
        points = [(x, y) for x in range(620, 1580, 24) for y in range(260, 1000, 24)]
        (self.folder / "p.csv").write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in points))
        self.expect(0, "dic", first, second, *common, "--at", "p.csv", "-o", "forth.csv")
        forth = self.table("forth.csv")
        moved = [(x, y, x + u, y + v, u, v) for x, y, u, v, inside in forth if inside == 1]
        (self.folder / "q.csv").write_text("x,y\n" + "".join(f"{m[2]!r},{m[3]!r}\n" for m in moved))
        self.expect(0, "dic", second, first, *common, "--at", "q.csv", "-o", "back.csv")
        squares = [(m[4] + row[2]) ** 2 + (m[5] + row[3]) ** 2 for m, row in zip(moved, self.table("back.csv")) if row[4] == 1]
        self.assertGreater(len(squares), 0.95 * len(points))
        self.assertLess(math.sqrt(sum(squares) / (2 * len(squares))), 0.01)

    def test_a_spot_does_not_reject_an_element(self):
        """At (982, 352) a reflection of some 20 pixels has changed; three other programs agree there to 0.015 px."""
        common = ["--element-size", 25, "--prefilter", 1, "--roi", "800,240,1200,440"]
        (self.folder / "p.csv").write_text("x,y\n972,352\n988,352\n1032,352\n")
        line, = self.expect(0, "dic", *self.real("0155", "0160"), *common, "--at", "p.csv", "-o", "u.csv", "--json").lines()
        self.assertEqual(line["elements_rejected"], 0)
        left, spot, right = self.table("u.csv")
        for k in (2, 3):
            self.assertAlmostEqual(spot[k], left[k] + (right[k] - left[k]) * 16 / 60, delta=0.03)

    def test_the_real_pair_is_measured_without_bias(self):
        """Pictures made from the reference with known displacements, and subsets that are correlated by themselves
        (known_displacements.py)."""
        first, second = self.real("0155", "0160")
        python = python_with("numpy", "scipy", "PIL")
        if python is None:
            self.skipTest("no python3 with numpy, scipy and PIL here: scripts/packages.txt")
        command = [python, pathlib.Path(__file__).parent / "known_displacements.py", KNOTHE, first, second, self.folder]
        outcome = subprocess.run(command, capture_output=True, text=True, timeout=280)
        self.assertEqual(outcome.returncode, 0, outcome.stderr)
        seen = json.loads(outcome.stdout)
        for bias in seen["shifts"] + seen["noisy"] + [seen["field"]["mean"]]:
            for component in bias:
                self.assertLess(abs(component), 3e-4, seen)
        for bias, std in zip(seen["pair"]["mean"], seen["pair"]["mean_std"]):
            self.assertLess(abs(bias), 3e-4 + 2 * std, seen)
        self.assertGreater(seen["pair"]["points"], 500)

    def test_the_real_pictures_converge_with_the_defaults(self):
        """The beam is found before the dark background, without the roller; its aliased speckle is filtered."""
        pictures = self.real("0155", "0160", "0179")
        for size in (16, 25, 32):
            arguments = () if size == 25 else ("--element-size", size)
            outcome = self.expect(0, "dic", *pictures, *arguments, "--json")
            region = [float(v) for v in re.search(r"the region ([\d,]+), which is measured", outcome.err)[1].split(",")]
            # The beam's edges in the picture, by eye: 166 and 1083; the roller stands on it from 500 to 960.
            self.assertTrue(166 < region[1] < 200 and 1050 < region[3] < 1083 and region[0] == 10 and region[2] == 1726, region)
            self.assertIn("aliased: pictures are filtered by a Gaussian of 1 px", outcome.err)
            for line in outcome.lines():
                self.assertIs(line["converged"], True)
                self.assertLess(line["elements_rejected"], 0.05 * line["elements"])
            self.assertAlmostEqual(line["gain"], 1.27, delta=0.02)

    def test_what_does_not_converge_says_what_to_try(self):
        outcome = self.run_knothe("dic", *self.real("0155", "0160"), "--prefilter", 0, "--roi", "10,10,1726,1146")
        self.assertEqual(outcome.status, 6, str(outcome))
        self.assertIn("try a Gaussian on the pictures (--prefilter 1), or larger elements (--element-size 50), or a region", outcome.err)

    def test_pictures_of_another_depth_are_recognised(self):
        """The deformed picture in 16 bits, the reference in 8; and 8 bits' levels in a file of 16."""
        self.draw("reference", "b")
        rows = drawn("b")
        for name, factor in (("full", 257), ("small", 1)):
            write_tiff16(self.folder / f"{name}.tif", [[factor * level for level in row] for row in rows])
        outcome = self.expect(0, "dic", "reference.pgm", "b.pgm", "full.tif", "--roi", ROI, "--json")
        eight, sixteen = outcome.lines()
        self.assertIn("full.tif: 16 bits, the reference 8: grey levels are multiplied by 0.00390625", outcome.err)
        self.assertAlmostEqual(sixteen["gain"] * 257 / 256, eight["gain"], delta=1e-4)
        self.assertAlmostEqual(sixteen["noise_std_px"], eight["noise_std_px"], delta=0.02 * eight["noise_std_px"])
        small, = self.expect(0, "dic", "reference.pgm", "small.tif", "--roi", ROI, "--json").lines()
        self.assertAlmostEqual(small["gain"], eight["gain"], delta=1e-4)

    def test_the_luminance_of_a_coloured_picture_is_taken_on_request(self):
        self.draw("reference")
        rows = drawn("b")
        bytes_of = bytes(v for row in rows for level in row for v in (level, level, max(0, level - 9)))
        (self.folder / "b.ppm").write_bytes(b"P6\n%d %d\n255\n" % (len(rows[0]), len(rows)) + bytes_of)
        self.expect(4, "dic", "reference.pgm", "b.ppm", "--roi", ROI, stderr="a picture in colour")
        self.expect(0, "dic", "reference.pgm", "b.ppm", "--roi", ROI, "--grey")
        self.edit("[dic]", '[dic]\ncolour = "gray"')
        self.expect(3, "dic", self.project_name, stderr='did you mean "grey"?')

    def test_the_real_cracked_picture_converges(self):
        line = self.expect(0, "dic", *self.real("0155", "0179"), "--element-size", 25, "--prefilter", 1, "--roi",
                           "100,240,1600,1040", "--json").lines()[0]
        self.assertIs(line["converged"], True)
        self.assertTrue(30 < line["elements_rejected"] < 120, line)
        self.assertAlmostEqual(line["gain"], 1.27, delta=0.02)  # 22 % darker

    def test_the_real_beam_shows_two_sides_which_do_not_tell_the_place_along_them(self):
        """Its ends are out of view; a loading roller covers part of the upper side."""
        first, second = self.real("0155", "0160")
        self.project.write_text(f'[dic]\nreferences = ["{first}"]\npictures = ["{second}"]\nregistration = "outline"\n'
                                "outline = [[-1, 0], [1, 0], [1, 0.1], [-1, 0.1]]\nscale = 1.08e-4\norigin = [868, 1082]\n")
        self.expect(4, "dic", self.project_name, stderr="IMG_0155.tif: error: the outline does not tell the place to the right: edges were "
                    "found on the upper and lower sides only")

    def test_the_real_crack_runs_where_the_eye_sees_it(self):
        """In 0160 from (667, 1040) up to where its last trace in the residual is, (558, 462), read off the map by eye."""
        first, second = self.real("0155", "0160")
        arguments = ("dic", first, second, "--element-size", 25, "--prefilter", 1, "--roi", "100,240,1600,1040", "--crack")
        line, = self.expect(0, *arguments, "--maps", "maps", "--json").lines()
        crack = line["crack"]
        self.assertIs(crack["found"], True)
        self.assertIs(crack["tip_in_view"], True)
        self.assertAlmostEqual(crack["mouth"][0], 667, delta=15)
        self.assertAlmostEqual(crack["mouth"][1], 1040, delta=2)
        self.assertAlmostEqual(crack["tip"][0], 552, delta=25)
        self.assertTrue(380 < crack["tip"][1] < 490, crack)
        self.assertTrue(0.9 < crack["mouth_opening"] < 1.5, crack)
        self.assertTrue((self.folder / "maps" / "IMG_0160.png").exists())
        # The same for people.
        picture, said = self.expect(0, *arguments).out.splitlines()
        self.assertRegex(picture, r"IMG_0160\.tif: \d+ iterations, residual .* grey levels, noise .* px, .* ms$")
        self.assertRegex(said, rf"^    crack {crack['length']:.4g} ± .* px long, tip at \({crack['tip'][0]:.0f}, {crack['tip'][1]:.0f}\) px, "
                         r"mouth open by .* px")


if __name__ == "__main__":
    unittest.main()
