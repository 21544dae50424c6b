"""`knothe.calibration`: against drawn rigs (bench/drawn_rigs.py, its own formulas), finite differences and OpenCV; what it writes is read by
`knothe dic`."""
import csv
import importlib.util
import math
import pathlib
import subprocess
import sys
import unittest

try:
    import numpy as np
except ImportError:
    print(f"skipped: {sys.executable} has no numpy (Debian: python3-numpy)")
    sys.exit(77)

from support import REPOSITORY, CaseInItsFolder, by_form, exit_status

sys.path.insert(0, str(REPOSITORY / "bench"))
import drawn_rigs
import knothe
import knothe.calibration
import two_cameras
from knothe import _bundle
from knothe.calibration import Target, calibrate, calibrate_specimen, find_target

NO_OPENCV = "find_target needs OpenCV: pip install opencv-python-headless, or Debian's python3-opencv"
SPECIMEN = {"distortion": ["k1"]}


def without_target(observed, sizes, priors, distances, planes):
    return calibrate_specimen(observed, sizes, priors, distances=distances, planes=planes, **SPECIMEN)


def write_picture(name, picture):
    pathlib.Path(name).write_bytes(b"P5 %d %d 255\n" % picture.shape[::-1] + picture.tobytes())


def normalised(found, drawn):
    """e C⁻¹ e / n."""
    e = drawn_rigs.errors(found, drawn)
    return float(e @ np.linalg.solve(found.covariance, e)) / len(e)


def parallel(base, scatter):
    """Six pictures of planes that are parallel but for `scatter` degrees."""
    rng = np.random.default_rng(2)
    camera, = drawn_rigs.cameras_of(rng, 1, 450.0)
    y, x = np.mgrid[:8, :11].reshape(2, -1)
    points = 10.0 * np.stack([x, y, 0 * x], -1)
    observed = np.empty((6, 88, 2))
    for v in range(6):
        rotation = drawn_rigs.turned(np.array(base) + np.radians(scatter) * rng.uniform(-1, 1, 3)) @ drawn_rigs.turned(np.array([0, 0, 0.1 * v]))
        place = np.array([rng.uniform(-40, 40), rng.uniform(-40, 40), 450 + rng.uniform(-40, 40)])
        observed[v] = drawn_rigs.seen_by(camera, (points - points.mean(0)) @ rotation.T + place)
    return observed + 0.05 * rng.standard_normal(observed.shape), points, drawn_rigs.SIZE


class Test(CaseInItsFolder):
    def expect_chi_square(self, make, solve, rigs, low, high):
        """Σ e C⁻¹ e over all rigs is χ² of all their parameters: within `low` and `high` of its expectation."""
        squares, count, inside = drawn_rigs.normalised_squares(rigs, make, solve)
        print(f"{rigs} rigs of {count} parameters: e C^-1 e / n = {squares.mean() / count:.4f}, 90 % intervals hold {100 * inside:.1f} %")
        self.assertGreater(squares.mean() / count, low)
        self.assertLess(squares.mean() / count, high)

    @staticmethod
    def bounds(degrees):
        """That χ² / n exceeds in one of a thousand cases on either side (Wilson and Hilferty 1931)."""
        spread = math.sqrt(2 / (9 * degrees))
        return [(1 - 2 / (9 * degrees) + z * spread)**3 for z in (-3.09, 3.09)]

    def test_errors_are_as_large_as_the_covariance_says(self):
        """Two cameras of 22 parameters: 20 rigs, in the long form 200, whose mean is within 0.95 and 1.05 of the expectation."""
        rigs = by_form(20, 200)
        self.expect_chi_square(drawn_rigs.rig, calibrate, rigs, *by_form(self.bounds(22 * rigs), (0.95, 1.05)))

    def test_without_a_target_errors_are_as_large_as_the_covariance_says(self):
        """Points of a flat specimen at eight places, priors of the lenses, four distances; 16 parameters."""
        rigs = by_form(3, 40)
        self.expect_chi_square(lambda seed: drawn_rigs.specimen(seed, points=60), without_target, rigs, *self.bounds(16 * rigs))

    def test_every_option_keeps_the_covariance_right(self):
        """One and three cameras; skew and k3; a target that is not flat; each three rigs."""
        lens = ("k1", "k2", "k3", "p1", "p2")
        for cameras, parameters, drawn, options in ((1, 8, {}, {}), (3, 36, {}, {}), (2, 26, {"distorted": lens, "skew": True}, {"distortion": lens, "skew": True}),
                                                    (2, 22, {"flatness": 0.1}, {"flatness_std": 0.1})):
            with self.subTest(cameras=cameras, **options):
                self.expect_chi_square(lambda seed: drawn_rigs.rig(seed + 50, cameras=cameras, **drawn), lambda *given: calibrate(*given, **options), 3,
                                       *self.bounds(3 * parameters))

    def test_a_specimen_need_not_be_flat_and_is_seen_by_any_number_of_cameras(self):
        *given, drawn = drawn_rigs.specimen(4, cameras=3, points=60, flat=False)
        found = without_target(*given)
        low, high = self.bounds(len(found.names))
        self.assertTrue(low < normalised(found, drawn) < high)
        self.assertEqual((found.verdict.level, len(found.cameras)), ("ok", 3))

    def test_a_wide_lens_needs_all_of_its_distortion(self):
        """k1 to k6 of a lens that sees 94°: within the covariance, in which k1 and k4 nearly cancel each other; k1 alone is not enough."""
        rng = np.random.default_rng(0)
        lens = dict(zip(drawn_rigs.NAMES, (900, 905, 960, 600, 0, -0.28, 0.08, -0.01, 0.02, 0.01, 0.005, 1e-3, -5e-4)))
        camera = lens, np.eye(3), np.zeros(3)
        points = Target(11, 8, 10.0).points
        observed = np.empty((15, 88, 2))
        for v in range(15):
            rotation = drawn_rigs.turned(np.array([0, 0, rng.uniform(-0.4, 0.4)])) @ drawn_rigs.turned(np.radians(30) * np.array([np.cos(2.4 * v), np.sin(2.4 * v), 0]))
            place = np.array([rng.uniform(-70, 70), rng.uniform(-40, 40), 120 + rng.uniform(0, 30)])
            observed[v] = drawn_rigs.seen_by(camera, (points - points.mean(0)) @ rotation.T + place)
        observed += 0.05 * rng.standard_normal(observed.shape)
        observed[((observed < 0) | (observed > np.array(drawn_rigs.SIZE) - 1)).any(-1)] = np.nan
        found = calibrate(observed, points, drawn_rigs.SIZE, distortion=["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"])
        self.assertLess(normalised(found, [camera]), self.bounds(12)[1])
        self.assertGreater(found.std["camera0.k1"], 0.1)
        self.assertEqual(found.verdict.level, "ok")
        short = calibrate(observed, points, drawn_rigs.SIZE, distortion=["k1"])
        self.assertEqual((short.verdict.level, short.verdict.reasons[0].cause), ("reject", "lens"))

    def test_derivatives_are_those_of_finite_differences(self):
        """Of all rows: pixels, priors, shape, distances, planes; by all unknowns."""
        rng = np.random.default_rng(1)
        lens = np.tile([1000, 1010, 320, 240, 1.0, -0.1, 0.05, 0.01, 0.02, -0.01, 0.005, 1e-3, -2e-3], (2, 1)) * (1 + 0.01 * rng.standard_normal((2, 13)))
        points = np.c_[rng.uniform(-100, 100, (12, 2)), rng.standard_normal(12)]
        scene = _bundle.Scene(lens, np.stack([np.eye(3), _bundle.rotation_of([0.01, -0.3, 0.02])]), np.array([[0, 0, 0], [150.0, 2, 20]]),
                              _bundle.rotation_of(0.3 * rng.standard_normal((3, 3))), np.c_[10 * rng.standard_normal((3, 2)), 500 + 30 * rng.standard_normal(3)], points)
        observed = np.ones((2, 3, 12, 2))
        observed[0, 0, 0] = np.nan
        sights = _bundle.Sights.of(observed)
        scale = rng.uniform(0.5, 2, len(sights))
        prior = {(0, 0): (1000.0, 10.0), (1, 16): (150.0, 1.0)}
        shape = _bundle.Known(prior, points + 0.1, np.tile([0, 0, 0.1], (12, 1)))
        others = _bundle.Known(prior, distances=[(0, 1, 50.0, 0.1), (1, 2, 40.0, 0.1)], planes=[(np.arange(6), 0.01)])
        for known, eliminate in ((shape, "poses"), (others, "points")):
            begin = _bundle.Scene(*(getattr(scene, name) for name in ("lens", "rotation", "translation", "turned", "moved", "points")),
                                  np.array([[1e-3, 2e-3, 5e-3]][:len(known.planes)]).reshape(-1, 3))
            unknowns = _bundle.Unknowns(begin, [range(13), range(19)], known, eliminate)
            rows = unknowns.rows(begin, sights, scale)
            self.assertGreater(len(rows.residual), 2 * len(sights))

            def difference(dense, own):
                there, back = (unknowns.rows(unknowns.changed(begin, sign * dense, sign * own), sights, scale).residual for sign in (1, -1))
                return there - back

            for k in range(unknowns.count + unknowns.size):
                exact = rows.dense[:, k] if k < unknowns.count else np.where(rows.block >= 0, rows.own[:, k - unknowns.count], 0)
                step = 1e-4 / abs(exact).max()
                dense, own = np.zeros(unknowns.count), np.zeros((unknowns.blocks, unknowns.size))
                if k < unknowns.count:
                    dense[k] = step
                else:
                    own[:, k - unknowns.count] = step
                np.testing.assert_allclose(difference(dense, own) / (2 * step), exact, atol=1e-6 * abs(exact).max())

    def test_the_schur_complement_is_that_of_the_whole_matrix(self):
        *given, drawn = drawn_rigs.specimen(1, points=20, places=4)
        found = without_target(*given)
        observed, _, priors, distances, planes = given
        prior = {(int(name[6]), _bundle.PARAMETERS.index(name[8:])): value for name, value in priors.items()}
        scene = _bundle.Scene(np.array([c.lens for c in found.cameras]), np.array([c.rotation for c in found.cameras]),
                              np.array([c.translation for c in found.cameras]), found.poses[:, :3, :3], found.poses[:, :3, 3], found.points,
                              np.array([knothe.calibration._plane(found.points)]))
        unknowns = _bundle.Unknowns(scene, [[0, 1, 2, 3, 5], [0, 1, 2, 3, 5, *range(13, 19)]],
                                    _bundle.Known(prior, distances=distances, planes=[(np.arange(20), 0.01)]), "points")
        sights = _bundle.Sights.of(observed)
        rows = unknowns.rows(scene, sights, 1 / found.noise[sights.camera])
        normal = _bundle.Normal(rows, unknowns.blocks)
        whole = np.zeros((len(rows.residual), unknowns.count + unknowns.blocks * unknowns.size))
        whole[:, :unknowns.count] = rows.dense
        for row, own, block in zip(whole, rows.own, rows.block):
            if block >= 0:
                begin = unknowns.count + block * unknowns.size
                row[begin:begin + unknowns.size] = own
        inverse = np.linalg.inv(whole.T @ whole)
        np.testing.assert_allclose(normal.covariance(), inverse[:unknowns.count, :unknowns.count], rtol=1e-4, atol=0)
        leverage = np.einsum("mi,ij,mj->m", whole, inverse, whole)
        np.testing.assert_allclose((normal.roots()**2).sum(1), leverage, atol=1e-6)
        self.assertAlmostEqual(leverage.sum(), whole.shape[1], delta=1e-4)

    def test_the_rotation_of_a_turn_and_back(self):
        for turn in ([0.3, -1.2, 0.5], [0, 0, 0], [1e-9, 0, 2e-9], [3.0, 0.2, 0.1]):
            rotation = _bundle.rotation_of(turn)
            np.testing.assert_allclose(rotation, drawn_rigs.turned(np.array(turn)), atol=1e-13)
            np.testing.assert_allclose(_bundle.turn_of(rotation), turn, atol=1e-12)

    def test_corners_that_are_wrong_are_found_and_named(self):
        """5 % of them off by 1 to 40 px: these are left out, and no other."""
        observed, points, sizes, drawn = drawn_rigs.rig(7)
        rng = np.random.default_rng(3)
        seen = np.argwhere(np.isfinite(observed[..., 0]))
        spoilt = {tuple(map(int, place)) for place in rng.permutation(seen)[:len(seen) // 20]}
        for place in spoilt:
            observed[place] += rng.choice([-1, 1], 2) * rng.uniform(1, 40, 2)
        names = [[f"{side}/{v:02}.png" for v in range(12)] for side in ("left", "right")]
        found = calibrate(observed, points, sizes, pictures=names)
        self.assertEqual({(each.camera, each.picture, each.corner) for each in found.rejected}, spoilt)
        self.assertRegex(str(found.rejected[0]), r"^left/\d\d\.png: corner \d+ is off by \(-?\d+\.\d, -?\d+\.\d\) px$")
        self.assertLess(normalised(found, drawn), self.bounds(22)[1])
        self.assertEqual(found.verdict.level, "caution")
        self.assertIn("corners and 0 whole pictures were left out", found.verdict.reasons[0].message)

    def test_pictures_numbered_the_other_way_round_are_turned_and_wrong_ones_left_out(self):
        observed, points, sizes, drawn = drawn_rigs.rig(8)
        for v in (1, 4):
            observed[1, v] = observed[1, v, ::-1]
        observed[1, 3] = observed[1, 3].reshape(8, 11, 2)[:, ::-1].reshape(-1, 2)  # mirrored
        observed[0, 6] = np.random.default_rng(1).permutation(observed[0, 6])
        found = calibrate(observed, points, sizes)
        self.assertEqual(found.turned, ["camera 1, picture 1", "camera 1, picture 4"])
        self.assertEqual((found.rejected, found.rejected_pictures), ([], ["camera 0, picture 6", "camera 1, picture 3"]))
        self.assertLess(normalised(found, drawn), self.bounds(22)[1])

    def test_what_does_not_fit_is_said(self):
        """A lens with more distortion than is estimated; a target that is not flat; a noise that is stated too small."""
        reasons = lambda found: {(each.code, each.cause): each.message for each in found.verdict.reasons}
        observed, points, sizes, _ = drawn_rigs.rig(3)
        self.assertEqual(reasons(calibrate(observed, points, sizes)), {})
        self.assertIn("the lens is not of this form", reasons(calibrate(observed, points, sizes, distortion=[]))["model", "lens"])
        self.assertIn("residuals are 2.5 times as large as noise_std says", reasons(calibrate(observed, points, sizes, noise_std=0.02))["fit", "noise_level"])
        observed, points, sizes, _ = drawn_rigs.rig(3, flatness=0.05)
        self.assertIn("the target is not flat", reasons(calibrate(observed, points, sizes))["model", "target"])
        self.assertNotIn(("model", "target"), reasons(calibrate(observed, points, sizes, flatness_std=0.05)))

    def test_the_noise_of_each_camera_is_estimated_or_given(self):
        observed, points, sizes, _ = drawn_rigs.rig(2)
        observed[1] += 0.15 * np.random.default_rng(1).standard_normal(observed[1].shape)
        found = calibrate(observed, points, sizes)
        np.testing.assert_allclose(found.noise, [0.05, math.hypot(0.05, 0.15)], rtol=0.05)
        self.assertAlmostEqual(found.chi_square, found.degrees_of_freedom, delta=1e-2 * found.degrees_of_freedom)
        given = calibrate(observed, points, sizes, noise_std=[0.05, 0.158])
        self.assertLess(abs(given.chi_square / given.degrees_of_freedom - 1), 0.1)

    def test_spacing_and_priors_are_in_the_covariance(self):
        observed, points, sizes, _ = drawn_rigs.rig(2)
        plain, spaced = calibrate(observed, points, sizes), calibrate(observed, points, sizes, spacing_std=1e-3)
        added = spaced.covariance - plain.covariance
        t = plain.cameras[1].translation
        np.testing.assert_allclose(added[-3:, -3:], 1e-6 * np.outer(t, t), rtol=1e-6)
        self.assertEqual(np.abs(added[:-3, :]).max(), 0)
        known = calibrate(observed, points, sizes, priors={"camera0.cx": (plain.cameras[0].lens[2], 0.01), "camera1.fx": knothe.Normal(plain.cameras[1].lens[0], 0.01)})
        self.assertLess(max(known.std["camera0.cx"], known.std["camera1.fx"]), 0.01)
        self.assertLess(known.std["camera0.fx"], plain.std["camera0.fx"])

    def test_bad_input_is_refused(self):
        observed, points, sizes, _ = drawn_rigs.rig(2)
        usage, data = knothe.UsageError, knothe.DataError
        refuse = lambda kind, text, *given, **options: self.refused(kind, text, call=lambda: calibrate(*given, **options))
        refuse(usage, "observed pixels of shape (2, 12, 87, 2): give (cameras, pictures, 88, 2)", observed[:, :, 1:], points, sizes)
        refuse(usage, "there are 2 cameras", observed, points, sizes[:1])
        refuse(usage, "distortion ['k7']: give a list of some of k1, k2", observed, points, sizes, distortion=["k7"])
        refuse(usage, "priors: 'camera2.fx' is not estimated; there are camera0.fx", observed, points, sizes, priors={"camera2.fx": (1, 1)})
        refuse(usage, "priors: camera1.wx: a rotation takes none", observed, points, sizes, priors={"camera1.wx": (1, 1)})
        refuse(usage, "noise_std -1", observed, points, sizes, noise_std=-1)
        refuse(usage, "it is flat (see flatness_std)", observed, points + np.arange(88)[:, None], sizes)
        refuse(data, "camera 0 sees the target in 2 pictures: 3 are needed, 10 to 20 are good", observed[:, :2], points, sizes)
        few = observed.copy()
        few[0, 3, 5:] = np.nan
        refuse(data, "camera 0, picture 3: 5 corners, or all on a line: a picture needs 6 or more that are not; leave it out", few, points, sizes)
        apart = observed.copy()
        apart[0, 6:], apart[1, :6] = np.nan, np.nan
        refuse(data, "camera 1 sees the target in no picture together with another camera", apart, points, sizes)
        for base in ((0, 0, 0), (0.3, 0.1, 0)):
            self.refused(data, "tilt it by 20° to 40° in different directions", call=lambda: calibrate(*parallel(base, 0)))
        refuse(data, "the pictures do not determine camera0.k", observed[0], points, sizes[:1], distortion=["k1", "k2", "k3", "k4", "k5", "k6"])
        shuffled = observed.copy()
        shuffled[:] = np.random.default_rng(1).permuted(shuffled, axis=2)
        refuse(data, "the corners are those of no plane: are columns, rows and the order", shuffled, points, sizes)
        self.refused(usage, "a square grid looks the same when it is turned", call=lambda: Target(8, 8, 10.0))
        self.refused(usage, "give chessboard or dots", call=lambda: Target(11, 8, 10.0, "rings"))
        self.refused(usage, "a diameter of 12", call=lambda: Target(11, 8, 10.0, "dots", 12))
        found = calibrate(observed, points, sizes)
        self.refused(usage, "a calibration is saved as .yaml (OpenCV", call=lambda: found.save("rig.txt"))
        self.refused(knothe.IoError, "cannot be written", call=lambda: found.save("nowhere/rig.yaml"))
        self.refused(usage, "DICe's files have no skew: save as .caldat", call=lambda: calibrate(observed, points, sizes, skew=True).save("rig.xml"))

    def test_without_a_target_bad_input_is_refused(self):
        observed, sizes, priors, distances, planes, _ = drawn_rigs.specimen(2, points=30)
        usage, data = knothe.UsageError, knothe.DataError
        refuse = lambda kind, text, *given, **options: self.refused(kind, text, call=lambda: calibrate_specimen(*given, **options))
        refuse(usage, "1 camera, 8 places", observed[:1], sizes[:1], priors)
        refuse(usage, "no prior of camera1.fx, camera1.fy", observed, sizes, {k: v for k, v in priors.items() if not k.startswith("camera1.f")}, distances=distances)
        refuse(usage, "nothing gives the scale", observed, sizes, priors)
        refuse(usage, "distance (0, 99, 10.0, 0.1): give two of 30 points", observed, sizes, priors, distances=[(0, 99, 10.0, 0.1)])
        refuse(usage, "a plane needs four or more of 30 points", observed, sizes, priors, distances=distances, planes=[([1, 2], 0.1)])
        (i, j, length, std), *others = distances
        options = {"planes": planes, "distortion": ["k1"]}
        refuse(data, f"the stated distance {length + 5:g} of the points 0 and 1 contradicts the pictures", observed, sizes, priors,
               distances=[(i, j, length + 5, std), *others], **options)
        found = calibrate_specimen(observed, sizes, priors, distances=[(i, j, length + 0.2, std), *others], **options)
        self.assertRegex(found.verdict.reasons[0].message, r"the distance of the points 0 and 1 is -\d.\d std from the stated")
        scattered = np.random.default_rng(1).uniform(100, 1100, observed.shape)
        with self.assertRaises(data):
            calibrate_specimen(scattered, sizes, priors, distances=distances)

    def test_from_speckle_to_a_calibration(self):
        """Matched by the package's own correlation. These matches are not quite independent: errors are up to three times what is stated."""
        size = 320, 240
        pictures, places_of, body, drawn = drawn_rigs.moving_speckle(0, size)
        observed = knothe.calibration.match(pictures, (48, 36, 272, 204), element_size=20)
        off = observed - places_of(observed[0, 0])
        self.assertLess(float(np.abs(np.nanmean(off, 2)).max()), 0.004)
        self.assertLess(float(np.nanstd(off)), 0.01)
        self.assertGreater(np.isfinite(off).mean(), 0.9)  # rejected elements have none
        rng = np.random.default_rng(1)
        priors = {f"camera{c}.{name}": (lens[name] + std * rng.standard_normal(), std) for c, (lens, _, _) in enumerate(drawn)
                  for name, std in (("fx", 5.0), ("fy", 5.0), ("cx", 5.0), ("cy", 5.0))}
        points = body(observed[0, 0])
        found = calibrate_specimen(observed, [size] * 2, priors, distances=[(0, len(points) - 1, float(np.linalg.norm(points[0] - points[-1])), 0.01)],
                                   planes=[(range(len(points)), 0.005)], distortion=["k1", "k2", "p1", "p2"])
        self.assertLess(normalised(found, drawn), 9)
        self.assertLess(abs(found.cameras[0].lens[0] / drawn[0][0]["fx"] - 1), 1e-3)
        self.refused(knothe.UsageError, "[2, 1] pictures of the cameras: give as many of each", call=lambda: knothe.calibration.match([pictures[0][:2], pictures[1][:1]]))

    def expect_motion_measured(self, drawn, size, calibrations, covariance):
        """`knothe dic` with each calibration: the motion of a plane with speckle, drawn as the true cameras see it."""
        rng = np.random.default_rng(5)
        rotation, place, motion = drawn_rigs.turned(np.array([0.05, 0.2, 0])), np.array([5, -3, 325.0]), np.array([0.05, -0.03, 0.4])
        for camera, side in zip(drawn, ("left", "right")):
            rays = drawn_rigs.directions(camera[0], size, 2)
            for v in (0, 1):
                write_picture(f"{side}{v}.pgm", drawn_rigs.speckle_of(camera, rays, (rotation, place + v * motion), 4.0, 2, 1.0, rng))
        width, height = size
        region = ",".join(str(int(share * side)) for share in (0.28, 0.72) for side in (width, height))
        found = []
        for calibration in calibrations:
            line = self.expect(0, "dic", "left0.pgm", "left1.pgm", "--cameras", calibration, "--other", "right0.pgm", "right1.pgm", "--calibration-std", covariance,
                               "--roi", region, "--element-size", 28, "-o", "u.vtu", "--json").lines()[0]
            self.assertLess(line["surface_epipolar_rms_px"], 0.05)
            self.assertLess(line["epipolar_rms_px"], 0.02)
            self.assertGreater(min(line["calibration_std_m"]), 0)
            values = np.reshape(two_cameras.values_of(self.folder / "u.vtu", "displacement"), (-1, 3))
            # a mean over nodes whose errors are nearly independent, and the calibration's
            std = np.array(line["noise_std_m"]) / math.sqrt(len(values) / 4) + line["calibration_std_m"]
            np.testing.assert_array_less(abs(values.mean(0) - 1e-3 * motion), 4 * std)
            found.append(values)
        for values in found:
            np.testing.assert_allclose(values, found[0], atol=1e-12)

    def test_every_format_is_read_by_the_program_and_measures_a_motion(self):
        """OpenCV's, DICe's and MatchID's of one rig: dic measures the same by each, and what the speckle did."""
        _, true, drawn = drawn_rigs.drawn_pictures(5, size=(320, 240), is_drawn=False)
        pair = calibrate(true + 0.02 * np.random.default_rng(1).standard_normal(true.shape), Target(11, 8, 10.0), [(320, 240)] * 2)
        pair.save_covariance("pair.csv")
        names = ["pair.yaml", "pair.xml", "pair.caldat"]
        for name in names:
            pair.save(name)
        self.expect_motion_measured(drawn, (320, 240), names, "pair.csv")
        text = (self.folder / "pair.csv").read_text()
        rows = list(csv.reader(text.splitlines()))
        self.assertEqual(rows[0], ["parameter", *pair.names])
        self.assertEqual([row[0] for row in rows[1:]], pair.names)
        np.testing.assert_array_equal(np.array([row[1:] for row in rows[1:]], float), pair.covariance)
        observed, points, sizes, _ = drawn_rigs.rig(2, cameras=3, pictures=8)
        self.refused(knothe.UsageError, "OpenCV's file is one of two cameras, here are 3", call=lambda: calibrate(observed, points, sizes).save("three.yaml"))
        calibrate(observed[0], points, sizes[0]).save("one.yaml")
        self.assertIn("camera_matrix", (self.folder / "one.yaml").read_text())

    def run_command(self, *arguments, status=0, **options):
        done = subprocess.run([sys.executable, "-m", "knothe.calibration", *map(str, arguments)], capture_output=True, text=True, timeout=280, **options)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        self.assertNotIn("Traceback", done.stderr)
        return done

    def test_wrong_usage_of_the_command(self):
        write_picture("a.pgm", np.zeros((16, 16), np.uint8))
        common = ["--target", "chessboard", "11x8", "-o", "rig"]
        self.assertIn("give a length > 0 with its unit, 10mm", self.run_command("a.pgm", *common, "--spacing", "10", status=2).stderr)
        self.assertIn("give columns x rows, 11x8", self.run_command("a.pgm", "--target", "dots", "11", "-o", "rig", "--spacing", "10mm", status=2).stderr)
        self.assertIn("1 pictures of the first camera and 2 of camera 1", self.run_command("a.pgm", "--right", "a.pgm", "a.pgm", *common, "--spacing", "10mm", status=2).stderr)
        self.assertIn("no skew: save as .caldat", self.run_command("a.pgm", *common, "--spacing", "1cm", "--skew", status=2).stderr)
        self.assertIn("none.png", self.run_command("none.png", *common, "--spacing", "10mm", status=4).stderr)
        if importlib.util.find_spec("cv2") is None:
            self.assertIn("OpenCV is not installed for this Python: apt install python3-opencv", self.run_command("a.pgm", *common, "--spacing", "10mm", status=2).stderr)
        else:
            self.assertIn("the target was found in none of 1 pictures", self.run_command("a.pgm", *common, "--spacing", "10mm", status=4).stderr)

    @unittest.skipIf(importlib.util.find_spec("cv2") is None, NO_OPENCV)
    def test_one_and_two_cameras_are_those_of_opencv(self):
        import cv2
        observed, points, sizes, _ = drawn_rigs.rig(5)
        observed = observed.astype(np.float32).astype(float)  # what OpenCV takes
        precise = cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-16
        observed[:, ~np.isfinite(observed).all((0, 3))] = np.nan
        seen = np.isfinite(observed[0, ..., 0])
        places = [points[each].astype(np.float32) for each in seen]
        pixels = [[corners[each].astype(np.float32) for corners, each in zip(observed[c], seen)] for c in (0, 1)]
        guess = []
        for c in (0, 1):
            _, matrix, distortion, _, _, deviations, *_ = cv2.calibrateCameraExtended(places, pixels[c], sizes[0], None, None, flags=cv2.CALIB_FIX_K3, criteria=precise)
            guess += [matrix, distortion]
            found = calibrate(observed[c], points, sizes[c])
            np.testing.assert_allclose(found.cameras[0].matrix, matrix, rtol=1e-8)
            np.testing.assert_allclose(found.cameras[0].distortion, distortion.ravel()[:5], atol=1e-8)
            # OpenCV's fx, fy, cx, cy, k1, k2, p1, p2
            np.testing.assert_allclose(list(found.std.values()), deviations.ravel()[:8], rtol=1e-5)
        _, first, bent, second, other_bent, r, t, *_ = cv2.stereoCalibrate(places, *pixels, *guess, sizes[0], criteria=precise,
                                                                           flags=cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3)
        found = calibrate(observed, points, sizes, noise_std=0.05)
        for camera, matrix, distortion in zip(found.cameras, (first, second), (bent, other_bent)):
            np.testing.assert_allclose(camera.matrix, matrix, rtol=1e-7)
            np.testing.assert_allclose(camera.distortion, distortion.ravel()[:5], atol=1e-7)
        np.testing.assert_allclose(found.cameras[1].rotation, r, atol=1e-8)
        np.testing.assert_allclose(found.cameras[1].translation, t.ravel(), atol=1e-6)

    @unittest.skipIf(importlib.util.find_spec("cv2") is None, NO_OPENCV)
    def test_corners_and_dots_are_found_where_they_are(self):
        for diameter, limit in ((0.0, 0.012), (5.0, 0.012)):
            pictures, true, _ = drawn_rigs.drawn_pictures(1, pictures=2, diameter=diameter)
            target = Target(11, 8, 10.0, "dots" if diameter else "chessboard", diameter)
            for camera, places in zip(pictures, true):
                for picture, place in zip(camera, places):
                    found = find_target(picture, target)
                    off = min((found - place, found[::-1] - place), key=lambda each: abs(each).mean())
                    self.assertLess((off - off.mean(0)).std(), limit)
                    self.assertLess(np.linalg.norm(off.mean(0)), 0.03 if diameter else 0.004)  # of dots what `calibrate` puts right
        self.assertIsNone(find_target(np.random.default_rng(1).uniform(0, 255, (240, 320)), Target(11, 8, 10.0)))
        self.refused(knothe.UsageError, "give grey levels, (height, width)", call=lambda: find_target(np.zeros((9, 9, 3)), Target(3, 4, 1.0)))

    @unittest.skipIf(importlib.util.find_spec("cv2") is None, NO_OPENCV)
    def test_from_pictures_to_a_calibration_that_the_program_reads(self):
        """Chessboard and dots, by the command; one picture shows no target."""
        for diameter in (0.0, 5.0):
            pictures, _, drawn = drawn_rigs.drawn_pictures(3, pictures=8, diameter=diameter)
            files = [[f"{side}-{v:02}.pgm" for v in range(8)] for side in ("left", "right")]
            for names, camera in zip(files, pictures):
                for name, picture in zip(names, camera):
                    write_picture(name, picture)
            write_picture("right-03.pgm", np.full((480, 640), 99, np.uint8))
            kind = ["dots", "11x8", "--diameter", "5mm"] if diameter else ["chessboard", "11x8"]
            figure = ["--figure", "residuals.png"] if importlib.util.find_spec("matplotlib") else []
            done = self.run_command(*files[0], "--right", *files[1], "--target", *kind[:2], *kind[2:], "--spacing", "10mm", "-o", "rig", *figure)
            self.assertIn("target not found in 1 of 16 pictures: right-03.pgm", done.stderr)
            self.assertRegex(done.stdout, r"camera1\.tx +[\d.]+ ± 0\.0\d+\n")
            self.assertIn("Result: usable", done.stdout)
            self.assertIn("written: rig.yaml, rig.csv", done.stdout)
            self.expect_motion_measured(drawn, (640, 480), ["rig.yaml"], "rig.csv")
            self.assertTrue(not figure or (self.folder / "residuals.png").stat().st_size > 5000)
            target = Target(11, 8, 10.0, kind[0], diameter)
            seen = np.array([[np.full((88, 2), np.nan) if (c, v) == (1, 3) else find_target(picture, target) for v, picture in enumerate(camera)]
                             for c, camera in enumerate(pictures)])
            found = calibrate(seen, target, [(640, 480)] * 2)
            self.assertLess(normalised(found, drawn), 2.5)  # detection is not quite independent noise
            self.assertLess(max(found.noise), 0.02)


if __name__ == "__main__":
    sys.exit(exit_status(unittest.main(exit=False).result))
