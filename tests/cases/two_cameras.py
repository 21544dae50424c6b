"""`knothe dic` with two cameras: a plane a metre away, drawn as each of them sees it, against its motion in space."""
import functools
import math
import struct
import unittest
import xml.etree.ElementTree

from dic_pictures import Speckle, write_pgm
from support import Case

FOCAL, DISTANCE, BASE = 2000, 1000, 350  # px, mm, mm
CENTRE = (80, 60)
TOWARDS = 2  # mm
# Both look straight at the plane; the other's centre is moved so that it sees the same part of it.
OFFSET = FOCAL * BASE / DISTANCE
CALIBRATION = f"""%YAML:1.0
---
M1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {FOCAL}., 0., {CENTRE[0]}., 0., {FOCAL}., {CENTRE[1]}., 0., 0., 1. ]
D1: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0., 0., 0., 0., 0. ]
M2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {FOCAL}., 0., {CENTRE[0] + OFFSET}, 0., {FOCAL}., {CENTRE[1]}., 0., 0., 1. ]
D2: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0., 0., 0., 0., 0. ]
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
T: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ {-BASE}., 0., 0. ]
"""
OPTIONS = ("--element-size", 20, "--roi", "12,12,147,107")


def seen_by(other):
    """What the plane's motion towards the cameras is in a picture, px."""
    def motion(x, y):
        closer = DISTANCE / (DISTANCE - TOWARDS) - 1
        return closer * (x - CENTRE[0] - (OFFSET if other else 0)), closer * (y - CENTRE[1])
    return motion


@functools.lru_cache(maxsize=None)
def drawn(camera, moved):
    return Speckle().picture(seen_by(camera == "right") if moved else None, noise=1, seed=2 * (camera == "right") + moved)


class Test(Case):

    def setUp(self):
        super().setUp()
        (self.folder / "stereo.yaml").write_text(CALIBRATION)
        for camera in ("left", "right"):
            (self.folder / camera).mkdir()
            for name, moved in (("0_reference", False), ("1_moved", True)):
                write_pgm(self.folder / camera / f"{name}.pgm", drawn(camera, moved))

    def dic(self, *arguments, status=0, **options):
        return self.expect(status, "dic", "left/0_reference.pgm", "left/1_moved.pgm", *OPTIONS, *arguments, **options)

    def values(self, file, name):
        """Of an array of a VTK file, which are appended in binary form."""
        head, _, rest = (self.folder / file).read_bytes().partition(b"<AppendedData")
        root = xml.etree.ElementTree.fromstring(head + b"</VTKFile>")
        (array,) = root.findall(f".//DataArray[@Name='{name}']")
        at = rest.index(b"_") + 1 + int(array.get("offset"))
        self.assertEqual((root.get("header_type"), array.get("type")), ("UInt64", "Float64"))
        (size,) = struct.unpack_from("<Q", rest, at)
        return struct.unpack_from(f"<{size // 8}d", rest, at + 8)

    def test_motion_towards_the_cameras_is_no_strain(self):
        line = self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", "right/1_moved.pgm", "-o", "u.vtu",
                        "--json").lines()[0]
        self.assertIs(line["converged"], True)
        self.assertLess(line["epipolar_rms_px"], 0.05)
        self.assertLess(line["surface_epipolar_rms_px"], 0.05)
        self.assertTrue(0.3 < line["chi_square_per_value"] < 2, line)
        values = self.values("u.vtu", "displacement")
        self.assertEqual(len(values), 3 * line["nodes"])
        for axis, exact in enumerate((0, 0, -1e-3 * TOWARDS)):
            of_axis = values[axis::3]
            mean = sum(of_axis) / len(of_axis)
            std = line["noise_std_m"][axis]
            self.assertLess(abs(mean - exact), 2 * std, axis)
            self.assertLess(math.sqrt(sum((v - exact) ** 2 for v in of_axis) / len(of_axis)), 2.5 * std, axis)

    def test_a_project_names_the_other_cameras_folder(self):
        (self.folder / "dic.toml").write_text("""[data]
pictures = "left"
[dic]
cameras = "stereo.yaml"
other_pictures = ["right"]
element_size = 20
roi = [12, 12, 147, 107]
""")
        line = self.expect(0, "dic", "dic.toml", "-o", "u.h5", "--json").lines()[0]
        self.assertIs(line["converged"], True)
        self.assertEqual(len(line["noise_std_m"]), 3)
        self.assertIn(b"epipolar_rms", (self.folder / "u.h5").read_bytes())

    def test_a_calibration_of_other_pictures_is_refused(self):
        wrong = CALIBRATION.replace(f", {FOCAL}., {CENTRE[1]}., 0., 0., 1. ]\nD2", f", {FOCAL}., {CENTRE[1] + 40}., 0., 0., 1. ]\nD2")
        self.assertNotEqual(wrong, CALIBRATION)
        (self.folder / "stereo.yaml").write_text(wrong)
        self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", "right/1_moved.pgm", status=4,
                 stderr=["the lines of sight of matched points miss each other by 4", " px (root mean square), more than 0.5 px: the "
                         "calibration does not belong to these pictures"])

    def test_wrong_usage(self):
        self.dic("--cameras", "stereo.yaml", status=2, stderr=["--cameras CALIBRATION and --other PICTURES… belong together"])
        self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", status=2,
                 stderr=["--other takes the pictures of the further cameras, 2 of each: its reference, then the deformed ones in the "
                         "same order; 1 are given"])
        self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", "right/1_moved.pgm", "--maps", "maps", status=2,
                 stderr=["--at, --std, --maps, --table and --resume are for one camera; with --cameras use -o"])
        (self.folder / "stereo.yaml").write_text(CALIBRATION.replace("T: !!opencv", "S: !!opencv"))
        self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", "right/1_moved.pgm", status=4, stderr=["stereo.yaml", "T"])


if __name__ == "__main__":
    unittest.main()
