"""Bundle adjustment: cameras, poses of a rigid body and its points by least squares, with exact derivatives and a Schur complement.

A pixel is P_c(R_c (R_v X + t_v) + t_c): camera c, pose v of the body, point X of it. The world is the first camera. Blocks of equal size, the
poses or the points, are eliminated; what is left (`dense`) are the cameras' parameters and what else couples them.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knothe._errors import NumericalError
from knothe._values import Array

Indices = NDArray[np.int64]
PARAMETERS = ("fx", "fy", "cx", "cy", "skew", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "wx", "wy", "wz", "tx", "ty", "tz")
_LENS = PARAMETERS.index("wx")


def crossed(v: Array) -> Array:
    """Matrices of v ×; of shape (..., 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2)


def rotation_of(turn: Array) -> Array:
    """exp(turn ×), by Rodrigues' formula; of shape (..., 3), rad."""
    turn = np.asarray(turn, float)
    angle = np.linalg.norm(turn, axis=-1)[..., None, None]
    k = crossed(turn)
    # sin(a) / a and (1 - cos(a)) / a², also at 0
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(0.5 * angle / np.pi)**2 * (k @ k))


def turn_of(rotation: Array) -> Array:
    """The turn of which this is the rotation; below 180°."""
    r = np.asarray(rotation, float)
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine, cosine = 0.5 * float(np.linalg.norm(axis)), 0.5 * (float(np.trace(r)) - 1)
    if sine < 1e-12:
        return np.asarray(0.5 * axis)
    return np.asarray(axis * (np.arctan2(sine, cosine) / (2 * sine)))


def project(lens: Array, at: Array) -> tuple[Array, Array, Array]:
    """Pixels of points in the camera's axes, and their derivatives; the formula is that of `imaging::Camera`.

    lens : (n, 13), at : (n, 3). Returns (n, 2), by the point (n, 2, 3), by the lens (n, 2, 13). NaN behind the camera."""
    fx, fy, cx, cy, skew, k1, k2, k3, k4, k5, k6, p1, p2 = lens.T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = np.where(at[:, 2] > 0, at[:, 2], np.nan)
        x, y = at[:, 0] / depth, at[:, 1] / depth
        s = x * x + y * y
        above, below = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
        g = above / below
        slope = (k1 + s * (2 * k2 + 3 * s * k3) - g * (k4 + s * (2 * k5 + 3 * s * k6))) / below
        xd = x * g + 2 * p1 * x * y + p2 * (s + 2 * x * x)
        yd = y * g + p1 * (s + 2 * y * y) + 2 * p2 * x * y
        one, o = np.ones_like(x), np.zeros_like(x)
        pixels = np.stack([fx * xd + skew * yd + cx, fy * yd + cy], -1)
        mixed = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        bent = _rows([[g + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, mixed], [mixed, g + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x]])
        sensor = _rows([[fx, skew], [o, fy]])
        central = _rows([[1 / depth, o, -x / depth], [o, 1 / depth, -y / depth]])
        powers = [s / below, s * s / below, s**3 / below]
        radial = [[x * p for p in powers] + [-x * g * p for p in powers] + [2 * x * y, s + 2 * x * x],
                  [y * p for p in powers] + [-y * g * p for p in powers] + [s + 2 * y * y, 2 * x * y]]
        by_lens = np.concatenate([_rows([[xd, o, one, o, yd], [o, yd, o, one, o]]), sensor @ _rows(radial)], -1)
        return pixels, np.asarray(sensor @ bent @ central), np.asarray(by_lens)


def _rows(entries: Sequence[Sequence[Array]]) -> Array:
    """A matrix for each point, of arrays for each entry."""
    return np.stack([np.stack(row, -1) for row in entries], -2)


@dataclass(frozen=True)
class Scene:
    """What is estimated: of C cameras, V poses, N points, P planes (of which q X = 1 are the points)."""

    lens: Array        # (C, 13)
    rotation: Array    # (C, 3, 3)
    translation: Array  # (C, 3)
    turned: Array      # (V, 3, 3)
    moved: Array       # (V, 3)
    points: Array      # (N, 3)
    planes: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True)
class Sights:
    """n pixels: which camera, pose and point each is of."""

    camera: Indices
    pose: Indices
    point: Indices
    pixels: Array  # (n, 2)

    def __len__(self) -> int:
        return len(self.camera)

    def only(self, chosen: NDArray[np.bool_]) -> "Sights":
        return Sights(self.camera[chosen], self.pose[chosen], self.point[chosen], self.pixels[chosen])

    @staticmethod
    def of(observed: Array) -> "Sights":
        """Of (C, V, N, 2), NaN where a point is not seen."""
        camera, pose, point = np.nonzero(np.isfinite(observed).all(-1))
        return Sights(camera, pose, point, observed[camera, pose, point])


@dataclass(frozen=True)
class Known:
    """What is known beside the pixels, each with its standard deviation."""

    lens: Mapping[tuple[int, int], tuple[float, float]] = dataclasses.field(default_factory=dict)  # (camera, parameter): mean, std
    points: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))  # where they are, and
    points_std: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))  # how well that is known; infinite: not at all, 0: exactly
    distances: Sequence[tuple[int, int, float, float]] = ()  # points, length, std
    planes: Sequence[tuple[Indices, float]] = ()  # points, std


@dataclass
class _Rows:
    """Residuals in standard deviations, and their derivatives by the dense unknowns and by those of the block of each."""

    residual: Array  # (m,)
    dense: Array     # (m, D)
    own: Array       # (m, b)
    block: Indices   # (m,); -1: of none


class Unknowns:
    """Which parameters are estimated, and where they are among the unknowns."""

    def __init__(self, scene: Scene, estimated: Sequence[Sequence[int]], known: Known, eliminate: str) -> None:
        """estimated: for each camera the parameters; eliminate: "poses" or "points" (then the first pose is the world)."""
        self.known, self.by_poses = known, eliminate == "poses"
        cameras, poses, points = len(scene.lens), len(scene.moved), len(scene.points)
        self.camera = np.full((cameras, len(PARAMETERS)), -1)
        self.count = 0
        for c, parameters in enumerate(estimated):
            self.camera[c, list(parameters)] = self._next(len(parameters))
        self.names = [f"camera{c}.{PARAMETERS[k]}" for c, parameters in enumerate(estimated) for k in sorted(parameters)]
        self.pose = np.full((poses, 6), -1)
        self.point = np.full((points, 3), -1)
        is_free = known.points_std > 0 if len(known.points_std) else np.zeros((points, 3), bool)
        if self.by_poses:
            self.blocks, self.size = poses, 6
            self.block_of_point = np.full(points, -1)
            self.point[is_free] = self._next(int(is_free.sum()))
        else:
            self.pose[1:] = self._next(6 * (poses - 1)).reshape(-1, 6)
            coupled = np.unique(np.array([k for i, j, _, _ in known.distances for k in (i, j)], int))
            self.point[coupled] = self._next(3 * len(coupled)).reshape(-1, 3)
            self.block_of_point = np.full(points, -1)
            alone = np.setdiff1d(np.arange(points), coupled)
            self.block_of_point[alone] = np.arange(len(alone))
            self.blocks, self.size = len(alone), 3
        self.plane = self._next(3 * len(known.planes)).reshape(-1, 3)

    def _next(self, count: int) -> Indices:
        self.count += count
        return np.arange(self.count - count, self.count)

    def changed(self, scene: Scene, dense: Array, own: Array) -> Scene:
        """The scene after a step; own: (blocks, size)."""
        step = np.append(dense, 0.0)  # -1: nothing
        of_camera, of_pose, of_point = step[self.camera], step[self.pose], step[self.point]
        if self.by_poses:
            of_pose = own
        else:
            alone = self.block_of_point >= 0
            of_point[alone] = own[self.block_of_point[alone]]
        return Scene(scene.lens + of_camera[:, :_LENS], rotation_of(of_camera[:, _LENS:_LENS + 3]) @ scene.rotation,
                     scene.translation + of_camera[:, _LENS + 3:], rotation_of(of_pose[:, :3]) @ scene.turned, scene.moved + of_pose[:, 3:],
                     scene.points + of_point, scene.planes + step[self.plane])

    def rows(self, scene: Scene, sights: Sights, scale: Array) -> _Rows:
        """scale: 1 / std of each pixel, (n,); the first 2n rows are the pixels' in their order."""
        c, v, i = sights.camera, sights.pose, sights.point
        turned = np.einsum("nij,nj->ni", scene.turned[v], scene.points[i])
        world = turned + scene.moved[v]
        about = np.einsum("nij,nj->ni", scene.rotation[c], world)
        pixels, by_place, by_lens = project(scene.lens[c], about + scene.translation[c])
        by_world = by_place @ scene.rotation[c]
        by_camera = np.concatenate([by_lens, -by_place @ crossed(about), by_place], -1)
        by_pose = np.concatenate([-by_world @ crossed(turned), by_world], -1)
        by_point = by_world @ scene.turned[v]
        dense = np.zeros((len(sights), 2, self.count + 1))  # the last column: of what is not estimated
        each = np.arange(len(sights))[:, None, None]
        axes = np.arange(2)[None, :, None]
        for columns, derivative in ((self.camera[c], by_camera), (self.pose[v], by_pose), (self.point[i], by_point)):
            dense[each, axes, columns[:, None, :]] += derivative
        block = v if self.by_poses else self.block_of_point[i]
        own = by_pose if self.by_poses else np.where(block[:, None, None] >= 0, by_point, 0.0)
        weight = np.asarray(scale)[:, None]
        rows = _Rows((weight * (pixels - sights.pixels)).ravel(), (weight[..., None] * dense[..., :-1]).reshape(-1, self.count),
                     (weight[..., None] * own).reshape(-1, self.size), np.repeat(block, 2))
        others = self._known_rows(scene)
        return _Rows(*(np.concatenate([getattr(rows, name), getattr(others, name)]) for name in ("residual", "dense", "own", "block")))

    def _known_rows(self, scene: Scene) -> _Rows:
        """Of the priors, the target's shape, distances and planes."""
        known = self.known
        residual: list[float] = []
        dense: list[tuple[Sequence[int], Array]] = []
        own: list[Array] = []
        block: list[int] = []

        def add(value: float, std: float, columns: Sequence[int], derivatives: Sequence[float], of_block: int = -1, by_block: "Array | None" = None) -> None:
            residual.append(value / std)
            dense.append((columns, np.asarray(derivatives) / std))
            own.append(np.zeros(self.size) if by_block is None else by_block / std)
            block.append(of_block)

        for (c, k), (mean, std) in known.lens.items():
            add((scene.lens[c, k] if k < _LENS else scene.translation[c, k - _LENS - 3]) - mean, std, [self.camera[c, k]], [1.0])
        if self.by_poses and len(known.points_std):
            for i, axis in np.argwhere(np.isfinite(known.points_std) & (known.points_std > 0)):
                add(scene.points[i, axis] - known.points[i, axis], known.points_std[i, axis], [self.point[i, axis]], [1.0])
        for i, j, length, std in known.distances:
            apart = scene.points[i] - scene.points[j]
            found = float(np.linalg.norm(apart))
            add(found - length, std, [*self.point[i], *self.point[j]], [*(apart / found), *(-apart / found)])
        for q, columns, (members, std) in zip(scene.planes, self.plane, known.planes):
            norm = float(np.linalg.norm(q))
            for i in members:
                off = float(q @ scene.points[i]) - 1
                by_plane = scene.points[i] / norm - off * q / norm**3
                if self.block_of_point[i] >= 0:
                    add(off / norm, std, columns, by_plane, self.block_of_point[i], q / norm)
                else:
                    add(off / norm, std, [*columns, *self.point[i]], [*by_plane, *(q / norm)])
        matrix = np.zeros((len(residual), self.count))
        for row, (columns, derivatives) in zip(matrix, dense):
            row[np.asarray(columns, int)] += derivatives
        return _Rows(np.array(residual), matrix, np.array(own).reshape(-1, self.size), np.array(block, int))


class Normal:
    """Normal equations [A B; Bᵀ C] of rows, C of blocks; S = A - B C⁻¹ Bᵀ."""

    def __init__(self, rows: _Rows, blocks: int, damping: float = 0.0) -> None:
        self.rows = rows
        count, size = rows.dense.shape[1], rows.own.shape[1]
        order = np.argsort(rows.block, kind="stable")
        dense, own, residual = rows.dense[order], rows.own[order], rows.residual[order]
        bounds = np.searchsorted(rows.block[order], np.arange(blocks + 1))
        a, b, c = rows.dense.T @ rows.dense, np.zeros((blocks, count, size)), np.zeros((blocks, size, size))
        own_force = np.zeros((blocks, size))
        for k in range(blocks):
            part = slice(bounds[k], bounds[k + 1])
            b[k], c[k], own_force[k] = dense[part].T @ own[part], own[part].T @ own[part], own[part].T @ residual[part]
        diagonal = np.einsum("kii->ki", c)
        least = 1e-300 + 1e-14 * diagonal.max(initial=0.0)
        own_scale = 1 / np.sqrt(np.maximum(diagonal, least))  # equilibrated: parameters have very different units
        self.inverse = np.linalg.inv(own_scale[:, :, None] * own_scale[:, None, :] * c + max(damping, 1e-14) * np.eye(size))
        self.inverse *= own_scale[:, :, None] * own_scale[:, None, :]
        self.coupling = b @ self.inverse  # B C⁻¹, (blocks, D, size)
        schur = a - np.tensordot(self.coupling, b, ((0, 2), (0, 2)))
        self.scale = 1 / np.sqrt(np.maximum(np.diag(a), 1e-300))
        self.scaled = self.scale[:, None] * schur * self.scale + damping * np.eye(count)
        self.force = rows.dense.T @ rows.residual - np.einsum("kds,ks->d", self.coupling, own_force)
        self.own_force, self.cross = own_force, b

    def step(self) -> tuple[Array, Array]:
        """Of Gauss-Newton, or of Levenberg-Marquardt with a damping."""
        dense = -self.scale * np.linalg.solve(self.scaled, self.scale * self.force)
        own = -np.einsum("kst,kt->ks", self.inverse, self.own_force + np.einsum("kds,d->ks", self.cross, dense))
        return dense, own

    def undetermined(self) -> "tuple[float, Array]":
        """The smallest eigenvalue of S, scaled to a unit diagonal, and the direction among the dense unknowns."""
        diagonal = 1 / np.sqrt(np.maximum(np.diag(self.scaled), 1e-300))
        values, vectors = np.linalg.eigh(diagonal[:, None] * self.scaled * diagonal)
        return float(values[0]), np.asarray(vectors[:, 0])

    def covariance(self) -> Array:
        """Of the dense unknowns: S⁻¹."""
        if not np.all(np.diag(self.scaled) > 0):
            raise np.linalg.LinAlgError("not positive definite")
        diagonal = 1 / np.sqrt(np.diag(self.scaled))
        inverse = np.linalg.inv(diagonal[:, None] * self.scaled * diagonal)
        scale = self.scale * diagonal
        return np.asarray(scale[:, None] * (0.5 * (inverse + inverse.T)) * scale)

    def roots(self) -> Array:
        """Z (m, D + b) so that Z Zᵀ is the hat matrix within each block of rows; the sum of squares of a row is its leverage."""
        block = self.rows.block
        inside = block >= 0
        dense, own = self.rows.dense.copy(), np.zeros_like(self.rows.own)
        dense[inside] -= np.einsum("ms,mds->md", self.rows.own[inside], self.coupling[block[inside]])
        root = np.linalg.cholesky(self.inverse)
        own[inside] = np.einsum("ms,mst->mt", self.rows.own[inside], root[block[inside]])
        return np.concatenate([dense @ np.linalg.cholesky(self.covariance()), own], 1)


def _cauchy(unknowns: Unknowns, scene: Scene, sights: Sights) -> Array:
    """Square roots of Cauchy's weights of the pixels, by the spread of each camera's own."""
    off = np.linalg.norm(unknowns.rows(scene, sights, np.ones(len(sights))).residual[:2 * len(sights)].reshape(-1, 2), axis=1)
    spread = np.ones(len(scene.lens))
    for c in np.unique(sights.camera):
        spread[c] = max(float(np.median(off[sights.camera == c])), 1e-9)
    return np.asarray(1 / np.sqrt(1 + (0.5 * off / spread[sights.camera])**2))


def minimised(unknowns: Unknowns, scene: Scene, sights: Sights, scale: Array, robust: bool = False, iterations: int = 200) -> Scene:
    """By Levenberg-Marquardt. Robust: with Cauchy's weights, renewed at each step; to few digits, as a beginning."""
    damping, weights = 1e-4, scale
    for _ in range(iterations):
        if robust:
            weights = scale * _cauchy(unknowns, scene, sights)
        rows = unknowns.rows(scene, sights, weights)
        cost = float(rows.residual @ rows.residual)
        if not np.isfinite(cost):
            raise NumericalError("calibration: the initial values put points behind a camera; give better initial values or priors")
        gained = -np.inf
        while gained < 0 and damping < 1e8:
            trial = unknowns.changed(scene, *Normal(rows, unknowns.blocks, damping).step())
            residual = unknowns.rows(trial, sights, weights).residual
            gained = cost - float(residual @ residual)
            gained = gained if np.isfinite(gained) else -np.inf
            damping = damping * 10 if gained < 0 else max(damping / 10, 1e-12)
        if gained >= 0:
            scene = trial
        if gained <= (1e-4 if robust else 1e-14) * cost + 1e-16:
            break
    return scene
