#!/usr/bin/env python3
"""Calibrations of drawn rigs: is the error as large as the covariance says?

usage: PYTHONPATH=build/release/python drawn_rigs.py [rigs|specimens|chessboards|dots|dots_of_unknown_diameter|speckle] [COUNT]
prints e C⁻¹ e / n over all, and the share of intervals that hold their truth; chessboards and dots need OpenCV
"""
import sys

import numpy as np

SIZE = 1920, 1200
NAMES = "fx fy cx cy skew k1 k2 k3 k4 k5 k6 p1 p2".split()


def turned(turn):
    """Rotation by |turn| about turn, as the exponential series of the cross product."""
    x, y, z = turn
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    term, total = np.eye(3), np.eye(3)
    for i in range(1, 40):
        term = term @ k / i
        total = total + term
    return total


def seen_by(camera, world):
    """Pixels of points of the world, written out as OpenCV's manual has it."""
    lens, rotation, translation = camera
    pixels = []
    for point in world.reshape(-1, 3):
        x, y, z = rotation @ point + translation
        x, y = x / z, y / z
        r2 = x**2 + y**2
        radial = (1 + lens["k1"] * r2 + lens["k2"] * r2**2 + lens["k3"] * r2**3) / (1 + lens["k4"] * r2 + lens["k5"] * r2**2 + lens["k6"] * r2**3)
        xd = x * radial + 2 * lens["p1"] * x * y + lens["p2"] * (r2 + 2 * x**2)
        yd = y * radial + lens["p1"] * (r2 + 2 * y**2) + 2 * lens["p2"] * x * y
        pixels.append((lens["fx"] * xd + lens["skew"] * yd + lens["cx"], lens["fy"] * yd + lens["cy"]))
    return np.array(pixels).reshape(*world.shape[:-1], 2)


def cameras_of(rng, count, distance, distorted=("k1", "k2", "p1", "p2"), skew=False):
    """The first is the world; all look at a point in front of it."""
    cameras = []
    for c in range(count):
        lens = dict.fromkeys(NAMES, 0.0)
        f = rng.uniform(2200, 3200)
        lens.update(fx=f, fy=f * rng.uniform(0.998, 1.002), cx=SIZE[0] / 2 + rng.uniform(-30, 30), cy=SIZE[1] / 2 + rng.uniform(-30, 30))
        typical = dict(k1=0.15, k2=0.2, k3=0.3, k4=0.1, k5=0.1, k6=0.1, p1=1e-3, p2=1e-3)
        lens.update({name: rng.uniform(-1, 1) * typical[name] for name in distorted})
        if skew:
            lens["skew"] = rng.uniform(-2, 2)
        rotation, translation = np.eye(3), np.zeros(3)
        if c:
            rotation = turned(np.array([rng.uniform(-0.03, 0.03), (-1)**c * np.radians(rng.uniform(12, 30)), rng.uniform(-0.03, 0.03)]))
            focus = np.array([0, 0, distance])
            translation = focus + rng.uniform(-0.02, 0.02, 3) * distance - rotation @ focus
        cameras.append((lens, rotation, translation))
    return cameras


def rig(seed, cameras=2, pictures=12, columns=11, rows=8, noise=0.05, distorted=("k1", "k2", "p1", "p2"), skew=False, flatness=0.0):
    """Pixels (C, V, N, 2) with noise, NaN outside of the pictures; the target's points; sizes; and the cameras."""
    rng = np.random.default_rng(seed)
    spacing = 10.0
    y, x = np.mgrid[:rows, :columns].reshape(2, -1)
    points = spacing * np.stack([x, y, 0 * x], -1).astype(float)
    real = points + flatness * np.stack([0 * x, 0 * x, rng.standard_normal(len(x))], -1)
    middle = points.mean(0)
    drawn = cameras_of(rng, cameras, 450.0, distorted, skew)
    observed = np.empty((cameras, pictures, len(points), 2))
    for v in range(pictures):
        tilt = np.radians(rng.uniform(10, 40)) * np.array([np.cos(2.4 * v), np.sin(2.4 * v), 0])
        rotation = turned(np.array([0, 0, rng.uniform(-0.4, 0.4)])) @ turned(tilt)
        place = np.array([rng.uniform(-80, 80), rng.uniform(-50, 50), 450 + rng.uniform(-80, 80)])
        world = (real - middle) @ rotation.T + place
        for c in range(cameras):
            observed[c, v] = seen_by(drawn[c], world)
    observed += noise * rng.standard_normal(observed.shape)
    outside = ((observed < 0) | (observed > np.array(SIZE) - 1)).any(-1)
    observed[outside] = np.nan
    few = np.isfinite(observed[..., 0]).sum(-1) < 12
    observed[few] = np.nan
    return observed, points, [SIZE] * cameras, drawn


def specimen(seed, cameras=2, places=8, points=150, noise=0.02, flat=True):
    """Of a specimen without a target: pixels, sizes, priors of lenses, distances of points, planes; and the cameras. Focal lengths are known to
    2 %, centres to 20 px."""
    rng = np.random.default_rng(seed)
    body = np.c_[rng.uniform(-60, 60, points), rng.uniform(-40, 40, points), np.zeros(points) if flat else rng.uniform(-15, 15, points)]
    drawn = cameras_of(rng, cameras, 450.0, ("k1",))
    observed = np.empty((cameras, places, points, 2))
    for v in range(places):
        rotation = turned(np.radians(25) * np.array([np.cos(2.4 * v), np.sin(2.4 * v), rng.uniform(-0.5, 0.5)]))
        place = np.array([rng.uniform(-40, 40), rng.uniform(-30, 30), 450 + rng.uniform(-60, 60)])
        for c in range(cameras):
            observed[c, v] = seen_by(drawn[c], body @ rotation.T + place)
    observed += noise * rng.standard_normal(observed.shape)
    priors = {}
    for c, (lens, _, _) in enumerate(drawn):
        for name, std in (("fx", 0.02 * lens["fx"]), ("fy", 0.02 * lens["fy"]), ("cx", 20.0), ("cy", 20.0)):
            priors[f"camera{c}.{name}"] = lens[name] + std * rng.standard_normal(), std
    distances = []
    for i, j in ((0, 1), (2, 3), (4, 5), (6, 7)):
        distances.append((i, j, float(np.linalg.norm(body[i] - body[j])) + 0.02 * rng.standard_normal(), 0.02))
    return observed, [SIZE] * cameras, priors, distances, [(range(points), 0.01)] if flat else [], drawn


def directions(lens, size, finer):
    """(x, y) at depth 1 of the parts of each pixel, (height finer, width finer, 2): the distortion undone by repetition."""
    at = (np.arange(size[0] * finer) + 0.5) / finer - 0.5, (np.arange(size[1] * finer) + 0.5) / finer - 0.5
    u, v = np.meshgrid(*at)
    yd = (v - lens["cy"]) / lens["fy"]
    xd = (u - lens["cx"] - lens["skew"] * yd) / lens["fx"]
    x, y = xd, yd
    for _ in range(12):
        r2 = x**2 + y**2
        radial = 1 + lens["k1"] * r2 + lens["k2"] * r2**2 + lens["k3"] * r2**3
        x, y = ((xd - 2 * lens["p1"] * x * y - lens["p2"] * (r2 + 2 * x**2)) / radial,
                (yd - lens["p1"] * (r2 + 2 * y**2) - 2 * lens["p2"] * x * y) / radial)
    return np.stack([x, y], -1)


def on_plane(camera, rays, pose):
    """Where rays hit the plane z = 0 of a body of which X_world = R X + t: (a, b), there r[:, :2] (a, b) + t is parallel to the ray."""
    _, rotation, translation = camera
    r, t = rotation @ pose[0], rotation @ pose[1] + translation
    plane = np.linalg.inv(np.c_[r[:, :2], t])
    a, b, w = np.moveaxis(rays @ plane[:, :2].T + plane[:, 2], -1, 0)
    return a / w, b / w


def averaged(fine, finer, noise, rng):
    """Grey levels of pixels, of those of their parts."""
    grey = fine.reshape(fine.shape[0] // finer, finer, -1, finer).mean((1, 3))
    return np.clip(np.rint(grey + noise * rng.standard_normal(grey.shape)), 0, 255).astype(np.uint8)


def speckle_of(camera, rays, pose, finest, finer, noise, rng):
    """A plane with a smooth random pattern, whose waves are `finest` and up to four times as long."""
    a, b = on_plane(camera, rays, pose)
    waves = np.random.default_rng(1)
    total = np.zeros_like(a)
    for _ in range(50):
        angle, length, phase = waves.uniform(0, np.pi), finest * 4**waves.uniform(), waves.uniform(0, 2 * np.pi)
        total += np.cos(2 * np.pi / length * (a * np.cos(angle) + b * np.sin(angle)) + phase)
    return averaged(127 + 100 * np.tanh(total / 6), finer, noise, rng)


def picture_of(camera, rays, pose, columns, rows, spacing, diameter, finer, noise, rng):
    """Grey levels of a chessboard, or with a diameter of a grid of dots: bright is 200, dark 40."""
    a, b = (each / spacing for each in on_plane(camera, rays, pose))

    def inside(distance):
        """1 where a function is positive, 0 where it is negative, between within half a part of a pixel from where it is 0."""
        return np.clip(0.5 + distance / np.maximum(np.hypot(*np.gradient(distance)), 1e-9), 0, 1)

    def striped(x):
        """1 in even cells."""
        nearest = np.rint(x)
        share = np.clip(0.5 + (x - nearest) / np.hypot(*np.gradient(x)), 0, 1)
        return np.where(nearest % 2 == 0, share, 1 - share)

    if diameter:
        dark = inside(0.5 * diameter / spacing - np.hypot(a - np.clip(np.rint(a), 0, columns - 1), b - np.clip(np.rint(b), 0, rows - 1)))
    else:
        even = striped(a), striped(b)
        dark = even[0] * even[1] + (1 - even[0]) * (1 - even[1])
        dark = dark * inside(a + 1) * inside(columns - a) * inside(b + 1) * inside(rows - b)
    on_it = (a > -2) & (a < columns + 1) & (b > -2) & (b < rows + 1)
    fine = np.where(on_it, 200.0 - 160.0 * dark, 120.0)
    return averaged(fine, finer, noise, rng)


def drawn_pictures(seed, cameras=2, pictures=10, columns=11, rows=8, size=(640, 480), diameter=0.0, finer=2, noise=2.0, is_drawn=True):
    """Pictures [C][V] of a target of 10 mm (none unless is_drawn), true places of its corners (C, V, N, 2), and the cameras."""
    rng = np.random.default_rng(seed)
    drawn = []
    for lens, rotation, translation in cameras_of(rng, cameras, 320.0):
        for name in ("fx", "fy", "cx", "cy"):
            lens[name] *= size[0] / SIZE[0]
        drawn.append((lens, rotation, translation))
    y, x = np.mgrid[:rows, :columns].reshape(2, -1)
    points = 10.0 * np.stack([x, y, 0 * x], -1)
    shown, true = [], np.empty((cameras, pictures, len(points), 2))
    poses = []
    for v in range(pictures):
        rotation = turned(np.array([0, 0, rng.uniform(-0.3, 0.3)])) @ turned(np.radians(25) * np.array([np.cos(2.4 * v), np.sin(2.4 * v), 0]))
        poses.append((rotation, np.array([rng.uniform(-8, 8), rng.uniform(-8, 8), 330 + rng.uniform(-20, 30)]) - rotation @ points.mean(0)))
    for c, camera in enumerate(drawn):
        if is_drawn:
            rays = directions(camera[0], size, finer)
            shown.append([picture_of(camera, rays, pose, columns, rows, 10.0, diameter, finer, noise, rng) for pose in poses])
        for v, (rotation, place) in enumerate(poses):
            true[c, v] = seen_by(camera, points @ rotation.T + place)
    return shown, true, drawn


def moving_speckle(seed, size=(320, 240), places=5, tilt=15.0, noise=1.0):
    """Pictures [C][V] of a speckled plane half-way between two cameras, tilted; where points (n, 2) of the first picture are in all (a function);
    points' places on the body (a function); the cameras."""
    rng = np.random.default_rng(seed)
    *_, drawn = drawn_pictures(seed, size=size, is_drawn=False, pictures=1)
    half = -0.5 * np.arctan2(drawn[1][1][0, 2], drawn[1][1][0, 0])
    poses = []
    for v in range(places):
        turn = (v > 0) * np.radians(tilt) * np.array([np.cos(2.4 * v), np.sin(2.4 * v), 0])
        poses.append((turned(turn) @ turned(np.array([0, half, 0])), np.array([*rng.uniform(-3, 3, 2), 330 + rng.uniform(-8, 8)])))
    pictures = []
    for camera in drawn:
        rays = directions(camera[0], size, 2)
        pictures.append([speckle_of(camera, rays, pose, 4.0, 2, noise, rng) for pose in poses])

    def body(points):
        lens = drawn[0][0]
        x, y = (points[:, 0] - lens["cx"]) / lens["fx"], (points[:, 1] - lens["cy"]) / lens["fy"]
        for _ in range(30):  # a ray of which the picture is the point
            off = points - seen_by(drawn[0], np.stack([x, y, np.ones_like(x)], -1))
            x, y = x + off[:, 0] / lens["fx"], y + off[:, 1] / lens["fy"]
        return np.stack([*on_plane(drawn[0], np.stack([x, y], -1), poses[0]), np.zeros_like(x)], -1)

    def places_of(points):
        return np.array([[seen_by(camera, body(points) @ rotation.T + place) for rotation, place in poses] for camera in drawn])

    return pictures, places_of, body, drawn


def errors(found, drawn):
    """True less estimated, in the order of the names: turns about the camera's axes."""
    result = []
    for name in found.names:
        camera, parameter = int(name[6:name.index(".")]), name.partition(".")[2]
        lens, rotation, translation = drawn[camera]
        own = found.cameras[camera]
        if parameter in NAMES:
            result.append(lens[parameter] - own.lens[NAMES.index(parameter)])
        elif parameter[0] == "w":
            small = rotation @ own.rotation.T
            result.append(0.5 * (small - small.T)[{"x": (2, 1), "y": (0, 2), "z": (1, 0)}[parameter[1]]])
        else:
            result.append((translation - own.translation)["xyz".index(parameter[1])])
    return np.array(result)


def normalised_squares(rigs, make, solve):
    """Of each rig e C⁻¹ e, and the number of parameters."""
    squares, count, inside = [], 0, []
    for seed in range(rigs):
        *given, drawn = make(seed)
        found = solve(*given)
        e = errors(found, drawn)
        squares.append(float(e @ np.linalg.solve(found.covariance, e)))
        inside += list(abs(e) < 1.645 * np.sqrt(np.diag(found.covariance)))
        count = len(e)
    return np.array(squares), count, float(np.mean(inside))


def in_pictures(seed, diameter, is_known=True):
    """Corners found in drawn pictures (needs OpenCV), the target, sizes, and the cameras."""
    target = knothe.calibration.Target(11, 8, 10.0, "dots" if diameter else "chessboard", diameter * is_known)
    pictures, _, drawn = drawn_pictures(seed, diameter=diameter)
    missed = np.full((88, 2), np.nan)
    found = [[knothe.calibration.find_target(picture, target) for picture in of_camera] for of_camera in pictures]
    return np.array([[missed if each is None else each for each in of_camera] for of_camera in found]), target, [(640, 480)] * 2, drawn


def in_speckle(seed):
    """Matched points of speckle, as of `specimen`; seeds of which all pictures correlate."""
    rng = np.random.default_rng(seed)
    pictures, _, body, drawn = moving_speckle((0, 1, 4, 6, 7)[seed % 5])
    observed = knothe.calibration.match(pictures, (48, 36, 272, 204), element_size=20)
    priors = {f"camera{c}.{name}": (lens[name] + 5 * rng.standard_normal(), 5.0) for c, (lens, _, _) in enumerate(drawn) for name in ("fx", "fy", "cx", "cy")}
    points = body(observed[0, 0])
    length = float(np.linalg.norm(points[0] - points[-1])) + 0.01 * rng.standard_normal()
    return observed, [(320, 240)] * 2, priors, [(0, len(points) - 1, length, 0.01)], [(range(len(points)), 0.005)], drawn


if __name__ == "__main__":
    import knothe.calibration

    def without_target(distortion):
        return lambda observed, sizes, priors, distances, planes: knothe.calibration.calibrate_specimen(
            observed, sizes, priors, distances=distances, planes=planes, distortion=distortion)

    calibrate = knothe.calibration.calibrate
    WHAT = {"rigs": (200, rig, calibrate), "specimens": (40, specimen, without_target(["k1"])),
            "chessboards": (16, lambda seed: in_pictures(seed, 0.0), calibrate), "dots": (12, lambda seed: in_pictures(seed, 5.0), calibrate),
            "dots_of_unknown_diameter": (12, lambda seed: in_pictures(seed, 5.0, False), calibrate),
            "speckle": (5, in_speckle, without_target(["k1", "k2", "p1", "p2"]))}
    what = sys.argv[1] if len(sys.argv) > 1 else "rigs"
    count, make, solve = WHAT[what]
    count = int(sys.argv[2]) if len(sys.argv) > 2 else count
    squares, parameters, inside = normalised_squares(count, make, solve)
    print(f"{what}, {count} of {parameters} parameters: e C^-1 e / n = {squares.mean() / parameters:.4f}, 90 % intervals hold {100 * inside:.1f} % of the truths")
