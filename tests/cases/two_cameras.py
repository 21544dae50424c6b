"""`knothe dic` with two cameras: a plane a metre away, drawn as each of them sees it, against its motion in space."""
import functools
import math
import shutil
import struct
import subprocess
import unittest
import xml.etree.ElementTree

from dic_pictures import Speckle, write_pgm
from support import DATA, Case, python_with

STEREO = DATA / "stereo_gt4"
STEREO_CALIBRATION = [  # of its README: cx, cy, fx, fy, k1, k2, k3, angles, place
    (955.0537385, 645.2301624, 6636.033383, 6636.440175, -1.957515272e-4, 0.8739544595, -26.91426143,
     179.9332210, 9.415993919, -0.05775865407, -58.20738494, 0.1641145944, 20.16820788),
    (971.3275619, 615.7965508, 6609.847619, 6609.166930, -5.225966870e-3, 1.077694686, -30.05404073,
     -179.9418875, -9.416050875, 0.04747312256, 59.84373321, 0.2184759676, 21.04719884)]
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


def values_of(path, name):
    """Of an array of a VTK file, which are appended in binary form."""
    head, _, rest = path.read_bytes().partition(b"<AppendedData")
    root = xml.etree.ElementTree.fromstring(head + b"</VTKFile>")
    (array,) = root.findall(f".//DataArray[@Name='{name}']")
    at = rest.index(b"_") + 1 + int(array.get("offset"))
    assert (root.get("header_type"), array.get("type")) == ("UInt64", "Float64")
    (size,) = struct.unpack_from("<Q", rest, at)
    return struct.unpack_from(f"<{size // 8}d", rest, at + 8)


class Test(Case):

    def draw(self):
        (self.folder / "stereo.yaml").write_text(CALIBRATION)
        for camera in ("left", "right"):
            (self.folder / camera).mkdir()
            for name, moved in (("0_reference", False), ("1_moved", True)):
                write_pgm(self.folder / camera / f"{name}.pgm", drawn(camera, moved))

    def dic(self, *arguments, status=0, **options):
        return self.expect(status, "dic", "left/0_reference.pgm", "left/1_moved.pgm", *OPTIONS, *arguments, **options)

    def test_motion_towards_the_cameras_is_no_strain(self):
        self.draw()
        line = self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", "right/1_moved.pgm", "-o", "u.vtu",
                        "--json").lines()[0]
        self.assertIs(line["converged"], True)
        self.assertLess(line["epipolar_rms_px"], 0.05)
        self.assertLess(line["surface_epipolar_rms_px"], 0.05)
        self.assertTrue(0.3 < line["chi_square_per_value"] < 2, line)
        values = values_of(self.folder / "u.vtu", "displacement")
        self.assertEqual(len(values), 3 * line["nodes"])
        for axis, exact in enumerate((0, 0, -1e-3 * TOWARDS)):
            of_axis = values[axis::3]
            mean = sum(of_axis) / len(of_axis)
            std = line["noise_std_m"][axis]
            self.assertLess(abs(mean - exact), 2 * std, axis)
            self.assertLess(math.sqrt(sum((v - exact) ** 2 for v in of_axis) / len(of_axis)), 2.5 * std, axis)

    def test_a_project_names_the_other_cameras_folder(self):
        self.draw()
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
        self.draw()
        wrong = CALIBRATION.replace(f", {FOCAL}., {CENTRE[1]}., 0., 0., 1. ]\nD2", f", {FOCAL}., {CENTRE[1] + 40}., 0., 0., 1. ]\nD2")
        self.assertNotEqual(wrong, CALIBRATION)
        (self.folder / "stereo.yaml").write_text(wrong)
        self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", "right/1_moved.pgm", status=4,
                 stderr=["the lines of sight of matched points miss each other by 4", " px (root mean square), more than 0.5 px: the "
                         "calibration does not belong to these pictures"])

    def test_wrong_usage(self):
        self.draw()
        self.dic("--camera-unit", "m", status=2, stderr="--camera-unit and --calibration-std are those of a calibration: give --cameras")
        self.dic("--cameras", "stereo.yaml", status=2, stderr=["--cameras CALIBRATION and --other PICTURES… belong together"])
        self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", status=2,
                 stderr=["--other takes the pictures of the further cameras, 2 of each: its reference, then the deformed ones in the "
                         "same order; 1 are given"])
        self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", "right/1_moved.pgm", "--table", "t.txt", status=2,
                 stderr=["--at, --std and --table are for one camera; with --cameras use -o"])
        self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", "right/1_moved.pgm", "--resume", status=2,
                 stderr=["--resume needs -o FILE.h5, what it goes on with"])
        (self.folder / "stereo.yaml").write_text(CALIBRATION.replace("T: !!opencv", "S: !!opencv"))
        self.dic("--cameras", "stereo.yaml", "--other", "right/0_reference.pgm", "right/1_moved.pgm", status=4, stderr=["stereo.yaml", "T"])

    def real(self):
        """The real stereo pair in folders of its own, its calibration as DICe writes one (without the skew, which DICe has not)."""
        if not STEREO.exists():
            self.skipTest(f"{STEREO} is not there: set KNOTHE_DATA to the folder of recorded data")
        for camera, name in enumerate(("left", "right")):
            (self.folder / name).mkdir()
            for number, picture in (("0000", "reference"), ("0003", "a")):
                shutil.copy(STEREO / f"GT4-{number}_{camera}.tif", self.folder / name / f"{picture}.tif")
        keys = "CX CY FX FY K1 K2 K3 ALPHA BETA GAMMA TX TY TZ".split()
        lists = ["".join(f'<Parameter name="{key}" type="double" value="{value}" />\n' for key, value in zip(keys, values))
                 for values in STEREO_CALIBRATION]
        model = '<Parameter name="LENS_DISTORTION_MODEL" type="string" value="OPENCV_LENS_DISTORTION" />\n'
        (self.folder / "cameras.xml").write_text(
            '<ParameterList>\n<Parameter name="xml_file_format" type="string" value="DICe_xml_camera_system_file" />\n'
            + "".join(f'<ParameterList name="CAMERA {c}">\n{model}{text}</ParameterList>\n' for c, text in enumerate(lists))
            + "</ParameterList>\n")

    def test_the_real_pair_is_measured(self):
        """The specimen hardly moved: DICe's own solution is 0.05 px in x and -0.045 px in y of the left picture, 0.055 mm a pixel."""
        self.real()
        left, right = (["%s/reference.tif" % name, "%s/a.tif" % name] for name in ("left", "right"))
        common = ["--roi", "600,300,1200,900", "--json"]
        line, = self.expect(0, "dic", *left, "--cameras", "cameras.xml", "--other", *right, *common, "--element-size", 40, "-o", "u.vtu").lines()
        self.assertEqual(line["picture"], "left/a.tif")
        self.assertLess(line["surface_epipolar_rms_px"], 0.3)
        self.assertLess(line["epipolar_rms_px"], 0.03)
        self.assertLess(max(line["noise_std_m"]), 3e-6)
        # With small elements the two views match when they are filtered.
        small, = self.expect(0, "dic", *left, "--cameras", "cameras.xml", "--other", *right, *common, "--element-size", 20, "-o", "s.vtu").lines()
        self.assertLess(small["epipolar_rms_px"], 0.03)
        self.assertLess(small["surface_epipolar_rms_px"], 0.3)
        (self.folder / "stereo.toml").write_text(
            '[data]\npictures = "left"\n[dic]\ncameras = "cameras.xml"\nother_pictures = ["right"]\n'
            'roi = [600, 300, 1200, 900]\nelement_size = 40\n')
        self.expect(0, "check", "stereo.toml")
        same, = self.expect(0, "dic", "stereo.toml", "--json", "-o", "u.h5").lines()
        self.assertEqual([same[key] for key in ("nodes", "epipolar_rms_px", "noise_std_m")],
                         [line[key] for key in ("nodes", "epipolar_rms_px", "noise_std_m")])
        python = python_with("h5py")
        if python is None:
            return
        read = ("import h5py, numpy; f = h5py.File('u.h5'); u = f['values'][0].reshape(-1, 3); p = f['mesh/points'][:]; "
                "print(f.attrs['length_unit'].decode(), *numpy.median(u, axis=0), *numpy.median(p, axis=0))")
        unit, *numbers = subprocess.run([python, "-c", read], cwd=self.folder, capture_output=True, text=True, check=True).stdout.split()
        u, v, w, _, _, depth = map(float, numbers)
        self.assertEqual(unit, "m")
        self.assertAlmostEqual(depth, -0.367, delta=0.002)  # in the calibration's frame, z towards the cameras
        self.assertLess(abs(u), 4e-6)
        self.assertAlmostEqual(v, 2.5e-6, delta=1e-6)  # up, where the picture's y is down
        self.assertLess(abs(w), 2e-5)

    def test_what_is_needed_is_said(self):
        self.real()
        left, right = (["%s/reference.tif" % name, "%s/a.tif" % name] for name in ("left", "right"))
        both = ["dic", *left, "--cameras", "cameras.xml", "--other", *right, "--roi", "600,300,1200,900", "--element-size", 40]
        self.expect(2, *both, "extra.tif", stderr="--other takes the pictures of the further cameras, 3 of each")
        self.expect(2, *both, "--crack", stderr="--pattern and --crack are for one camera")
        text = (self.folder / "cameras.xml").read_text()
        (self.folder / "cameras.xml").write_text(text.replace('"TY" type="double" value="0.1641145944"', '"TY" type="double" value="1.1641145944"'))
        self.expect(4, *both, stderr="the calibration does not belong to these pictures")
        (self.folder / "cameras.xml").write_text(text.replace('value="645.2301624"', 'value="high"'))
        self.expect(4, *both, stderr="cameras.xml: calibration: CAMERA 0 CY: 'high' is not a number")
        (self.folder / "stereo.toml").write_text('[data]\npictures = "left"\n[dic]\ncameras = "cameras.xml"\nscale = 1e-5\n')
        self.expect(3, "dic", "stereo.toml", stderr=['"dic.scale" is for one camera', '"dic.cameras" needs `[data] pictures`'])
        (self.folder / "stereo.toml").write_text('[data]\npictures = "left"\n[dic]\nother_pictures = ["right"]\n')
        self.expect(3, "dic", "stereo.toml", stderr='"dic.other_pictures" needs "dic.cameras", a calibration')


if __name__ == "__main__":
    unittest.main()
