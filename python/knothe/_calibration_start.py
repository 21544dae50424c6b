"""Initial values of a calibration: homographies, Zhang's closed form, poses, and how the cameras stand to each other."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knothe._bundle import crossed, project, rotation_of
from knothe._errors import DataError
from knothe._values import Array

_LEAST_TILT = 0.5  # degrees, between the two pictures that differ most


def homography(plane: Array, pixels: Array) -> Array:
    """H (3, 3) with (u, v, 1) ~ H (x, y, 1), by the normalised direct linear transformation, reweighted against gross errors."""
    def normalising(points: Array) -> Array:
        centre = np.median(points, axis=0)
        size = np.median(np.linalg.norm(points - centre, axis=1))
        return np.array([[1 / size, 0, -centre[0] / size], [0, 1 / size, -centre[1] / size], [0, 0, 1]])

    from_plane, from_pixels = normalising(plane), normalising(pixels)
    p = np.c_[plane, np.ones(len(plane))] @ from_plane.T
    q = np.c_[pixels, np.ones(len(pixels))] @ from_pixels.T
    zero = np.zeros_like(p)
    equations = np.stack([np.c_[p, zero, -q[:, :1] * p], np.c_[zero, p, -q[:, 1:2] * p]], 1)
    weight = np.ones(len(p))
    for _ in range(6):
        h = np.linalg.svd((weight[:, None, None] * equations).reshape(-1, 9))[2][-1].reshape(3, 3)
        seen = p @ h.T
        off = np.linalg.norm(seen[:, :2] / seen[:, 2:] - q[:, :2], axis=1)
        weight = 1 / (1 + (off / (3 * np.median(off) + 1e-12))**2)
    h = np.linalg.inv(from_pixels) @ h @ from_plane
    return np.asarray(h / np.linalg.norm(h) * np.sign(h[2] @ [*plane.mean(0), 1]))


def _products(a: Array, b: Array) -> Array:
    """aᵀ B b = this times (B11, B22, B13, B23, B33), of B without skew."""
    return np.array([a[0] * b[0], a[1] * b[1], a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1], a[2] * b[2]])


def lens_of(homographies: Sequence[Array], size: tuple[int, int]) -> Array:
    """fx, fy, cx, cy by Zhang (2000) without skew; if these make no sense (noise, few pictures) with the picture's centre, or a guess.

    Returns (13,), without distortion."""
    largest, centre = float(max(size)), 0.5 * (np.asarray(size, float) - 1)
    to_unit = np.array([[1 / largest, 0, -centre[0] / largest], [0, 1 / largest, -centre[1] / largest], [0, 0, 1]])
    general, centred = [], []
    for each in homographies:
        h = to_unit @ each
        h = h / np.linalg.norm(h[:, :2])
        a, b = h[:, 0], h[:, 1]
        general += [_products(a, b), _products(a, a) - _products(b, b)]
        centred += [[a[0] * b[0] + a[1] * b[1], -a[2] * b[2]], [a[0]**2 + a[1]**2 - b[0]**2 - b[1]**2, b[2]**2 - a[2]**2]]
    lens = np.zeros(13)
    _, singular, vectors = np.linalg.svd(np.array(general))
    b11, b22, b13, b23, b33 = vectors[-1] * np.sign(vectors[-1][0])
    if len(homographies) > 2 and b11 > 0 and b22 > 0 and singular[-1] < 0.3 * singular[-2]:
        scale = b33 - b13**2 / b11 - b23**2 / b22
        if scale > 0:
            fx, fy, cx, cy = np.sqrt(scale / b11), np.sqrt(scale / b22), -b13 / b11, -b23 / b22
            if max(abs(cx), abs(cy)) < 0.25 and 0.7 < fx / fy < 1.4 and 0.2 < fx < 50:
                lens[:4] = largest * fx, largest * fy, largest * cx + centre[0], largest * cy + centre[1]
                return lens
    left, right = np.array(centred).T
    square = float(left @ right) / max(float(left @ left), 1e-300)  # 1 / f²; by least squares
    f = largest / np.sqrt(square) if 1 / 50**2 < square < 1 / 0.2**2 else 1.5 * largest
    lens[:4] = f, f, *centre
    return lens


def pose_of(h: Array, lens: Array) -> tuple[Array, Array]:
    """R, t of the target in the camera's axes."""
    matrix = np.array([[lens[0], lens[4], lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
    columns = np.linalg.inv(matrix) @ h
    columns /= 0.5 * (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1])) * np.sign(columns[2, 2])
    return nearest_rotation(np.c_[columns[:, :2], np.cross(columns[:, 0], columns[:, 1])]), columns[:, 2]


def nearest_rotation(matrix: Array) -> Array:
    u, _, v = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v)


def require_tilt(normals: Array, what: str) -> None:
    """Parallel targets leave the focal length open."""
    angles = np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1)))
    if angles.max() < _LEAST_TILT:
        raise DataError(f"{what}: the target is parallel to itself in all {len(normals)} pictures (within {angles.max():.1g}°), which leaves the focal "
                        "length open: tilt it by 20° to 40° in different directions")


def angle_between(one: Array, other: Array) -> float:
    """Of two rotations, rad."""
    return float(np.arccos(np.clip(0.5 * (np.trace(one @ other.T) - 1), -1, 1)))


class Relative:
    """Where a camera is relative to one that is known, from the poses that both see, some of them perhaps numbered the other way round."""

    def __init__(self, seen: Sequence[tuple[int, "tuple[Array, Array]", "tuple[Array, Array]", "tuple[Array, Array]"]]) -> None:
        """seen: view, the target's pose in the world, its pose in the camera, the same with the numbering turned by 180°."""
        candidates = [[self._relative(world, pose) for pose in poses] for _, world, *poses in seen]
        depth = np.median([np.linalg.norm(own[1]) for _, _, own, _ in seen])

        def apart(one: tuple[Array, Array], other: tuple[Array, Array]) -> float:
            return angle_between(one[0], other[0]) + float(np.linalg.norm(one[1] - other[1]) / depth)

        def cost(candidate: tuple[Array, Array]) -> float:
            return float(np.median([min(apart(candidate, other) for other in pair) for pair in candidates]))

        # as numbered, unless the other way is clearly better
        costs = [(cost(pair[turned]) + 0.02 * turned, k, turned) for k, pair in enumerate(candidates) for turned in (0, 1)]
        _, k, turned = min(costs)
        self.rotation, self.translation = best = candidates[k][turned]
        self.turned = [view for (view, *_), pair in zip(seen, candidates) if apart(best, pair[1]) < 0.5 * apart(best, pair[0])]

    @staticmethod
    def _relative(world: tuple[Array, Array], camera: tuple[Array, Array]) -> tuple[Array, Array]:
        rotation = camera[0] @ world[0].T
        return rotation, camera[1] - rotation @ world[1]


def rays(lens: Array, pixels: Array) -> Array:
    """(x, y) in the camera's axes at depth 1 of pixels (n, 2), by Newton's method."""
    many = np.broadcast_to(lens, (len(pixels), 13))
    y = (pixels[:, 1] - lens[3]) / lens[1]
    at = np.c_[(pixels[:, 0] - lens[2] - lens[4] * y) / lens[0], y]
    for _ in range(20):
        found, by_place, _ = project(many, np.c_[at, np.ones(len(at))])
        at = at + np.linalg.solve(by_place[:, :, :2], (pixels - found)[..., None])[..., 0]
    return np.asarray(at)


def rig_of_matches(one: Array, other: Array) -> tuple[Array, Array]:
    """R, t (of length 1) of a second camera from rays (n, 2) of matched points: the least Sampson distance over five unknowns, from many
    beginnings, as matches on a plane alone have several minima. Most points are in front of both cameras."""
    p, q = np.c_[one, np.ones(len(one))], np.c_[other, np.ones(len(other))]

    def distances(rotation: Array, direction: Array) -> Array:
        essential = crossed(direction) @ rotation
        of_p, of_q = p @ essential.T, q @ essential
        return np.asarray(np.einsum("ni,ni->n", q, of_p) / np.sqrt((of_p[:, :2]**2).sum(1) + (of_q[:, :2]**2).sum(1) + 1e-300))

    def changed(rotation: Array, direction: Array, step: Array) -> tuple[Array, Array]:
        basis = np.linalg.svd(direction[None])[2][1:]  # what is perpendicular
        moved = direction + step[3:] @ basis
        return rotation_of(step[:3]) @ rotation, moved / np.linalg.norm(moved)

    def refined(rotation: Array, direction: Array) -> tuple[float, Array, Array]:
        damping = 1e-3
        residual = distances(rotation, direction)
        for _ in range(40):
            slopes = np.stack([(distances(*changed(rotation, direction, 1e-7 * unit)) - residual) / 1e-7 for unit in np.eye(5)], 1)
            normal = slopes.T @ slopes
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)) + 1e-12 * np.eye(5), slopes.T @ residual)
            trial = changed(rotation, direction, step)
            better = distances(*trial)
            if better @ better < residual @ residual:
                gained = 1 - (better @ better) / (residual @ residual)
                (rotation, direction), residual, damping = trial, better, max(damping / 10, 1e-9)
                if gained < 1e-8:
                    break
            else:
                damping *= 10
                if damping > 1e6:
                    break
        return float(residual @ residual), rotation, direction

    best: list[tuple[float, float, int, Array, Array]] = []
    for axis in (0, 1):
        for angle in np.radians([-50, -25, -10, 10, 25, 50]):
            turn = np.zeros(3)
            turn[axis] = angle
            rotation = rotation_of(turn)  # about a point in front of the cameras, at distance 1
            direction = np.array([0, 0, 1.0]) - rotation @ [0, 0, 1.0]
            squares, rotation, direction = refined(rotation, direction / np.linalg.norm(direction))
            for sign in (1, -1):
                in_front = float((depths(rotation, sign * direction, one, other) > 0).all(1).mean())
                best.append((-round(in_front, 1), squares, len(best), rotation, sign * direction))
    front, _, _, rotation, direction = min(best, key=lambda each: each[:3])
    if front > -0.9:
        raise DataError("calibrate_specimen: no place of the second camera sees the matched points in front of both: are the matches right, and the "
                        "priors of the focal lengths and centres?")
    return rotation, direction


def depths(rotation: Array, translation: Array, one: Array, other: Array) -> Array:
    """Of points seen along rays, in both cameras, (n, 2), by least squares: other z_2 = R one z_1 + t."""
    p = np.c_[one, np.ones(len(one))] @ rotation.T
    q = np.c_[other, np.ones(len(other))]
    a, b, c = (p * p).sum(1), (p * q).sum(1), (q * q).sum(1)
    d, e = p @ translation, q @ translation
    determinant = a * c - b * b + 1e-300
    return np.stack([(b * e - c * d) / determinant, (a * e - b * d) / determinant], 1)
