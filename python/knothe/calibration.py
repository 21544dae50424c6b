"""Calibration of one's own cameras, with the covariance that `calibration_std` of a project takes.

>>> import knothe.calibration

From pictures of a target (`find_target`, `calibrate`), or of matched points of the specimen itself while it moves as a rigid body
(`calibrate_specimen`). In the examples, `rig` is what `calibrate` gives of `observed`, corners of the `target` seen by two cameras. The command `python3 -m knothe.calibration` does the former. The world is the first camera, x right, y down, z away.
"""
from __future__ import annotations

import argparse
import math
import os
import pathlib
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knothe import _bundle, _calibration_start as _start, _cameras, _notebook
from knothe._bundle import PARAMETERS, Known, Normal, Scene, Sights, Unknowns
from knothe._cameras import Camera
from knothe._errors import DataError, Error, Interrupted, UsageError
from knothe._innovations import chi_squared_above
from knothe._pictures import Correlation, read_picture
from knothe._posterior import Reason, Verdict
from knothe._targets import Target, find_target
from knothe._values import Array, Normal as NormalPrior, counted, numbers

_DISTORTION = PARAMETERS[5:13]
_LEAST_CORNERS, _LEAST_PICTURES = 6, 3
_CELLS = (6, 4)  # of a picture, in which residuals are averaged
_LARGEST_FOCAL_STD, _LARGE_FOCAL_STD = 0.05, 0.01  # relative
_CAUTION, _REJECT, _LARGE = 3e-5, 1e-12, 3.0  # probabilities as of the verdict of an assimilation; a factor
Priors = Mapping[str, "tuple[float, float] | NormalPrior"]


@dataclass(frozen=True)
class GrossError:
    """A corner that is not where the others say, and is left out.

    Attributes
    ----------
    camera, picture, corner : int
        Which one it is, from 0.
    name : str
        Of the picture.
    residual : ndarray, shape (2,)
        Where it was found, less where it should be, px.

    Examples
    --------
    >>> print(knothe.calibration.GrossError(0, 3, 17, "left/03.png", np.array([2.5, -0.25])))
    left/03.png: corner 17 is off by (2.5, -0.2) px
    """

    camera: int
    picture: int
    corner: int
    name: str
    residual: Array

    def __str__(self) -> str:
        return f"{self.name}: corner {self.corner} is off by ({self.residual[0]:.1f}, {self.residual[1]:.1f}) px"


class Calibration:
    """The result of `calibrate` and `calibrate_specimen`.

    Attributes
    ----------
    cameras : list of Camera
    names : list of str
        What was estimated: camera0.fx ...; wx, wy, wz are turns about the camera's axes, rad.
    covariance : ndarray, shape (n, n)
        Of these, as `calibration_std` reads it: of changes about `cameras`, R becoming exp(ω×) R.
    noise : ndarray, shape (C,)
        Standard deviation of a corner's place in each camera, px; estimated, unless it was given.
    chi_square : float
        Of the residuals, in standard deviations; with an estimated noise it is `degrees_of_freedom`.
    degrees_of_freedom : float
    residuals : ndarray, shape (C, V, N, 2)
        Found less projected, px; NaN where there is no corner.
    used : ndarray of bool, shape (C, V, N)
        False of gross errors, and where there is no corner.
    rejected : list of GrossError
        Corners that were left out.
    rejected_pictures : list of str
        Pictures of which most corners would have been left out.
    turned : list of str
        Pictures whose corners were numbered the other way round than those of the first camera, which was put right.
    poses : ndarray, shape (V, 4, 4)
        Target (or specimen) to world.
    points : ndarray, shape (N, 3)
        Of the target or specimen.
    verdict : Verdict
        Whether residuals look like noise: over the picture and over the target (code ``model``), in size (``fit``); gross errors (``outlier``).

    Examples
    --------
    >>> rig
    <Calibration: 2 cameras, 12 pictures, noise 0.051 px. Result: usable>
    """

    def __init__(self, cameras: list[Camera], names: list[str], covariance: Array, noise: Array, chi_square: float, degrees_of_freedom: float,
                 residuals: Array, used: NDArray[np.bool_], rejected: list[GrossError], rejected_pictures: list[str], turned: list[str],
                 scene: Scene, verdict: Verdict) -> None:
        self.cameras, self.names, self.covariance, self.noise = cameras, names, covariance, noise
        self.chi_square, self.degrees_of_freedom, self.residuals, self.used = chi_square, degrees_of_freedom, residuals, used
        self.rejected, self.rejected_pictures, self.turned, self.verdict = rejected, rejected_pictures, turned, verdict
        self.points = scene.points
        self.poses = np.tile(np.eye(4), (len(scene.moved), 1, 1))
        self.poses[:, :3, :3], self.poses[:, :3, 3] = scene.turned, scene.moved

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each parameter by name.

        Examples
        --------
        >>> 0.1 < rig.std["camera0.fx"] < 1
        True
        """
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist()))

    @property
    def picture_rms(self) -> Array:
        """Root mean square of the residuals of each picture, px; shape (C, V), NaN where the target is not seen.

        Examples
        --------
        >>> rig.picture_rms.shape
        (2, 12)
        """
        squares = np.where(self.used[..., None], self.residuals, 0.0)**2
        count = 2 * self.used.sum(-1)
        return np.asarray(np.where(count > 0, np.sqrt(squares.sum((-1, -2)) / np.maximum(count, 1)), np.nan))

    def save(self, path: "str | os.PathLike[str]") -> None:
        """Writes the calibration for `knothe dic --cameras`.

        Parameters
        ----------
        path : path
            ``.yaml``: as OpenCV, one (for `[dic] lens` of a project) or two cameras; ``.xml``: as DICe, any number; ``.caldat``: as
            MatchID, two, with skew.

        Raises
        ------
        UsageError
            The format does not have what was estimated.
        IoError
            The file cannot be written.

        Examples
        --------
        >>> rig.save("rig.yaml")
        """
        _cameras.write(path, _cameras.text_of(self.cameras, path))

    def save_covariance(self, path: "str | os.PathLike[str]") -> None:
        """Writes the covariance for `calibration_std` of a project, or `knothe dic --calibration-std`.

        Parameters
        ----------
        path : path
            CSV: a row and a column for each parameter.

        Raises
        ------
        IoError
            The file cannot be written.

        Examples
        --------
        >>> rig.save_covariance("rig.csv")
        """
        _cameras.write(path, _cameras.covariance_text(self.names, self.covariance))

    def table(self) -> str:
        """What was estimated, as text: each parameter ± its standard deviation.

        Returns
        -------
        str

        Examples
        --------
        >>> print(rig.table().splitlines()[0].split()[0])
        camera0.fx
        """
        lines = []
        for name, std in self.std.items():
            camera, parameter = self.cameras[int(name[6:name.index(".")])], name.partition(".")[2]
            if parameter.startswith("w"):
                value = float(np.degrees(_bundle.turn_of(camera.rotation)["xyz".index(parameter[1])]))
                lines.append(f"{name:12} {_notebook.quantity(value, math.degrees(std))}°")
            else:
                k = PARAMETERS.index(parameter)
                value = float(camera.lens[k] if k < 13 else camera.translation[k - 16])
                lines.append(f"{name:12} {_notebook.quantity(value, std)}{' px' if k < 5 else ''}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        noise = ", ".join(_notebook.two_digits(float(value)) for value in self.noise[:1 if np.ptp(self.noise) < 0.1 * self.noise[0] else None])
        return (f"<Calibration: {counted(len(self.cameras), 'camera')}, {counted(len(self.poses), 'picture')}, noise {noise} px. "
                f"{_notebook.WORDS[self.verdict.level]}>")

    def _repr_html_(self) -> str:
        rows = [tuple(line.split(None, 1)) for line in self.table().splitlines()]
        return (_notebook.verdict_line(self.verdict.level) + _notebook.table(repr(self)[1:-1], ("parameter", "value"), rows)
                + (_notebook.table("Reasons", ("level", "what", "why"), [(r.level, r.code, r.message) for r in self.verdict.reasons])
                   if self.verdict.reasons else ""))


class _Adjustment:
    """One calibration on its way: what is observed, the unknowns, and the scene that fits best so far."""

    def __init__(self, observed: Array, scene: Scene, sizes: Sequence[tuple[int, int]], estimated: Sequence[Sequence[int]], known: Known, eliminate: str,
                 names: Sequence[Sequence[str]], noise_std: "ArrayLike | None", radius: float = 0.0) -> None:
        self.observed, self.scene, self.sizes, self.known, self.names, self.radius = observed, scene, sizes, known, names, radius
        self.sights = Sights.of(observed)
        self.unknowns = Unknowns(scene, estimated, known, eliminate)
        self.is_given = noise_std is not None
        self.noise = np.array(np.broadcast_to(np.asarray(1.0 if noise_std is None else noise_std, float), len(observed)))
        if not np.all(np.isfinite(self.noise) & (self.noise > 0)):
            raise UsageError(f"noise_std {noise_std!r}: give the standard deviation of a corner's place, px, > 0, one for all cameras or one each")
        self.used = np.ones(len(self.sights), bool)
        self.offset = np.zeros((len(self.sights), 2))  # of the middle of a dot as it is seen, from where its middle is
        self.bad_pictures: list[tuple[int, int]] = []

    def now(self) -> Sights:
        """All that was seen, the middles of dots put right."""
        return replace(self.sights, pixels=self.sights.pixels - self.offset)

    def residuals(self) -> Array:
        """Found less projected, px."""
        sights = self.now()
        return -self.unknowns.rows(self.scene, sights, np.ones(len(sights))).residual[:2 * len(sights)].reshape(-1, 2)

    def solve(self, progress: Callable[[str], None]) -> None:
        """A robust beginning; gross errors are found and left out until they remain the same; then the noise."""
        progress("initial values")
        self.used = np.isfinite(self.residuals()).all(1)  # in front of the cameras
        for _ in range(1 if self.is_given else 3):  # what is known beside the pixels has its weight by the noise
            self.scene = _bundle.minimised(self.unknowns, self.scene, self.now().only(self.used), self._scale()[self.used], robust=True)
            self._correct_dots()
            if not self.is_given:
                self.noise = np.sqrt(np.maximum(self._spread(), 1e-12))
        for repetition in range(12):
            used = self._judged()
            if repetition and np.array_equal(used, self.used):
                break
            self.used = used
            progress(f"least squares, {int(np.sum(~used))} of {len(used)} corners left out")
            self._fit()
        self._require_determined()

    def _scale(self) -> Array:
        return np.asarray(1 / self.noise[self.sights.camera])

    def _fit(self) -> None:
        """Least squares and the noise by turns, of the corners that are used."""
        for _ in range(20):
            sights = self.now().only(self.used)
            self.scene = _bundle.minimised(self.unknowns, self.scene, sights, self._scale()[self.used])
            self._correct_dots()
            before = self.noise.copy()
            if not self.is_given:
                self._estimate_noise()
            if np.allclose(before, self.noise, rtol=1e-4) and not self.radius:
                break
            if np.allclose(before, self.noise, rtol=1e-6):
                break

    def rows_and_leverage(self) -> "tuple[_bundle._Rows, Normal, Array]":
        """At the solution; leverage of the pixels' rows, (2n,)."""
        sights = self.now().only(self.used)
        rows = self.unknowns.rows(self.scene, sights, self._scale()[self.used])
        normal = Normal(rows, self.unknowns.blocks)
        try:
            roots = normal.roots()
        except np.linalg.LinAlgError:
            self._require_determined()
            raise
        return rows, normal, roots[:2 * len(sights)]

    def _estimate_noise(self) -> None:
        """Of each camera: squares of the residuals over the number of values less the parameters that they determine."""
        rows, _, roots = self.rows_and_leverage()
        camera = np.repeat(self.sights.camera[self.used], 2)
        squares, free = rows.residual[:len(camera)]**2, 1 - (roots**2).sum(1)
        for c in range(len(self.noise)):
            if (camera == c).any():
                ratio = squares[camera == c].sum() / max(free[camera == c].sum(), 1e-300)
                self.noise[c] = max(self.noise[c] * math.sqrt(ratio), 1e-10)

    def _spread(self) -> Array:
        """Variance of a corner's place in each camera, from the median: of a Rayleigh distribution, and corrected for the number of parameters, as
        fitted corners are nearer than noise is large."""
        off = (self.residuals()**2).sum(1)
        variance = np.ones(len(self.noise))
        parameters = (self.unknowns.count + self.unknowns.blocks * self.unknowns.size) / len(self.noise)
        for c in range(len(self.noise)):
            mine = off[self.sights.camera == c]
            if np.isfinite(mine).any():
                variance[c] = float(np.nanmedian(mine)) / (2 * math.log(2)) / max(1 - parameters / (2 * len(mine)), 0.1)
        return variance

    def _judged(self) -> NDArray[np.bool_]:
        """Which corners are used: not those that noise explains in one calibration of a hundred at most; nor any of a picture of which half
        are not."""
        residual = self.residuals()
        off, variance = (residual**2).sum(1), self._spread()
        limit = -2 * math.log(0.01 / len(off))
        used = np.ones(len(off), bool)
        self.bad_pictures = []
        s = self.sights
        for c in range(len(self.noise)):
            mine = s.camera == c
            least = max(float(variance[c]), self.noise[c]**2 if self.is_given else 0.0)
            used[mine] = off[mine] <= max(limit * least, 1e-16)
            for v in np.unique(s.pose[mine]):
                picture = mine & (s.pose == v)
                if used[picture].sum() < max(0.5 * picture.sum(), 1):
                    used[picture] = False
                    self.bad_pictures.append((c, int(v)))
        if used.mean() < 0.5:
            raise DataError(f"calibration: {int(np.sum(~used))} of {len(used)} corners contradict the others: are columns, rows and the order of the corners "
                            "those of the target, and the pictures of each camera in one order?")
        if not self.unknowns.by_poses:  # a point needs two cameras
            seen_by = np.zeros((len(self.noise), self.observed.shape[2]), bool)
            seen_by[s.camera[used], s.point[used]] = True
            used &= (seen_by.sum(0) > 1)[s.point]
        for i, j, length, _ in self.known.distances:
            if min(int(used[s.point == k].sum()) for k in (i, j)) < 2:
                raise DataError(f"calibration: the stated distance {length:g} of the points {i} and {j} contradicts the pictures: are these the points, and "
                                "is its std not too small?")
        return used

    def _correct_dots(self) -> None:
        """The middle of a dot's picture is not the picture of its middle: ∫ P |∂P| / ∫ |∂P| over the dot, by 16 nodes."""
        if not self.radius:
            return
        s, scene = self.sights, self.scene
        turned = scene.rotation[s.camera] @ scene.turned[s.pose]
        world = np.einsum("nij,nj->ni", scene.turned[s.pose], scene.points[s.point]) + scene.moved[s.pose]
        at = np.einsum("nij,nj->ni", scene.rotation[s.camera], world) + scene.translation[s.camera]
        middle = _bundle.project(scene.lens[s.camera], at)[0]
        total, moment = np.zeros(len(s)), np.zeros((len(s), 2))
        for share in (0.5 - math.sqrt(1 / 12), 0.5 + math.sqrt(1 / 12)):
            for angle in np.arange(8) * math.pi / 4:
                node = self.radius * math.sqrt(share) * np.array([math.cos(angle), math.sin(angle)])
                pixels, by_place, _ = _bundle.project(scene.lens[s.camera], at + turned[:, :, :2] @ node)
                area = abs(np.linalg.det(by_place @ turned[:, :, :2]))
                total, moment = total + area, moment + area[:, None] * (pixels - middle)
        self.offset = np.where(np.isfinite(total)[:, None], moment / total[:, None], 0.0)

    def _require_determined(self) -> None:
        sights = self.now().only(self.used)
        normal = Normal(self.unknowns.rows(self.scene, sights, self._scale()[self.used]), self.unknowns.blocks)
        least, direction = normal.undetermined()
        if not least > 1e-12:
            weak = [self.unknowns.names[k] for k in np.argsort(-abs(direction)) if k < len(self.unknowns.names) and abs(direction[k]) > 0.2]
            body = "target" if self.unknowns.by_poses else "specimen"
            raise DataError(f"calibration: the pictures do not determine {', '.join(weak[:4]) or 'the poses'}: tilt the {body} by 20° to 40° in different "
                            "directions and fill the picture, estimate fewer parameters (distortion=...), or give (narrower) priors")

    def result(self, turned: list[str]) -> Calibration:
        rows, normal, roots = self.rows_and_leverage()
        count = len(self.unknowns.names)
        covariance = normal.covariance()[:count, :count]
        cameras = [Camera(*each) for each in zip(self.scene.lens, self.scene.rotation, self.scene.translation, self.sizes)]
        residuals = np.full(self.observed.shape, np.nan)
        s, off = self.sights, self.residuals()
        residuals[s.camera, s.pose, s.point] = off
        used = np.zeros(self.observed.shape[:3], bool)
        used[s.camera[self.used], s.pose[self.used], s.point[self.used]] = True
        bad = set(self.bad_pictures)
        rejected = [GrossError(int(s.camera[k]), int(s.pose[k]), int(s.point[k]), self.names[s.camera[k]][s.pose[k]], off[k])
                    for k in np.flatnonzero(~self.used) if (s.camera[k], s.pose[k]) not in bad]
        pictures = [self.names[c][v] for c, v in self.bad_pictures]
        pixels = rows.residual[:len(roots)]
        chi_square, freedom = float(pixels @ pixels), float(len(pixels) - (roots**2).sum())
        reasons = [*self._of_size(chi_square, freedom), *self._of_patterns(pixels.reshape(-1, 2), rows, roots)]
        reasons += [*self._of_distances(), *self._of_focal_lengths(cameras, covariance)]
        if len(rejected) > 0.02 * len(s) or pictures:
            reasons.append(Reason("outlier", "caution", f"{counted(len(rejected), 'corner')} and {counted(len(pictures), 'whole picture')} were left out: look "
                                  "at them, and leave bad pictures out", len(rejected) / len(s), 0.02))
        level = "reject" if any(reason.level == "reject" for reason in reasons) else "caution" if reasons else "ok"
        verdict = Verdict(level, reasons, chi_squared_above(chi_square, round(freedom)) if self.is_given else 1.0, np.zeros(0), np.zeros(0))
        return Calibration(cameras, list(self.unknowns.names), covariance, self.noise, chi_square, freedom, residuals, used, rejected, pictures, turned,
                           self.scene, verdict)

    def _of_size(self, chi_square: float, freedom: float) -> list[Reason]:
        factor = math.sqrt(chi_square / max(freedom, 1.0))
        if self.is_given and chi_squared_above(chi_square, round(freedom)) < _CAUTION:
            return [Reason("fit", "reject" if factor > _LARGE else "caution", f"residuals are {factor:.2g} times as large as noise_std says: leave it out, "
                           "and it is estimated", factor, _LARGE, "noise_level")]
        return []

    def _of_distances(self) -> Iterator[Reason]:
        for i, j, length, std in self.known.distances:
            off = (float(np.linalg.norm(self.scene.points[i] - self.scene.points[j])) - length) / std
            if abs(off) > 4:
                yield Reason("outlier", "caution", f"the distance of the points {i} and {j} is {off:.1f} std from the stated {length:g}: measure it again, or "
                             "leave it out", abs(off), 4.0, "distance")

    def _of_focal_lengths(self, cameras: Sequence[Camera], covariance: Array) -> Iterator[Reason]:
        for name, std in zip(self.unknowns.names, np.sqrt(np.diag(covariance))):
            c, _, parameter = name[6:].partition(".")
            if parameter in ("fx", "fy"):
                share = float(std / cameras[int(c)].lens[PARAMETERS.index(parameter)])
                if share > _LARGE_FOCAL_STD:
                    yield Reason("computation", "caution", f"{name} is known to {100 * share:.1f} % only, for which a covariance says little: tilt the target by "
                                 "20° to 40° in different directions", share, _LARGE_FOCAL_STD)

    def _of_patterns(self, pixels: Array, rows: "_bundle._Rows", roots: Array) -> Iterator[Reason]:
        """Mean residuals of the cells of a picture, and of each corner of the target over all pictures, against what noise gives."""
        s = self.sights.only(self.used)
        size = np.asarray(self.sizes, float)[s.camera]
        cell = np.clip((s.pixels / size * _CELLS).astype(int), 0, np.array(_CELLS) - 1)
        of_cell = (s.camera * _CELLS[0] + cell[:, 0]) * _CELLS[1] + cell[:, 1]
        patterns = [("lens", of_cell, "the lens is not of this form: estimate more of its distortion (k3), or the pictures' corners of one place are "
                     "found with an error in common")]
        if self.unknowns.by_poses:
            patterns.append(("target", s.camera * self.observed.shape[2] + s.point, "the target is not flat or not regular: give flatness_std, or a better target"))
        for cause, label, advice in patterns:
            found, expected = _group_squares(label, pixels, rows.block[:2 * len(s)], roots, self.unknowns.count)
            probability = chi_squared_above(found, max(round(expected), 1))
            factor = math.sqrt(found / max(expected, 1e-300))
            if probability < _CAUTION and factor > 1:
                level = "reject" if probability < _REJECT and factor > _LARGE else "caution"
                yield Reason("model", level, f"mean residuals over the {'picture' if cause == 'lens' else 'target'} are {factor:.2g} times as large as noise "
                             f"gives (probability {probability:.1g}): {advice}; errors may be as many times larger than stated", factor, _LARGE, cause)


def _group_squares(label: NDArray[np.int64], pixels: Array, block: NDArray[np.int64], roots: Array, dense: int) -> tuple[float, float]:
    """Sum over groups of n |mean residual|², in standard deviations, and its expectation Σ uᵀ (I - H) u / n, u the group's indicator."""
    names, group = np.unique(label, return_inverse=True)
    count = np.bincount(group).astype(float)
    found = expected = 0.0
    for axis in (0, 1):
        z, of = roots[axis::2], block[axis::2]
        found += float((np.bincount(group, pixels[:, axis])**2 / count).sum())
        shared = np.zeros((len(names), dense))
        np.add.at(shared, group, z[:, :dense])
        pair, place = np.unique(np.stack([group, of]), axis=1, return_inverse=True)
        own = np.zeros((pair.shape[1], z.shape[1] - dense))
        np.add.at(own, place.ravel(), z[:, dense:])
        hat = (shared**2).sum(1) + np.bincount(pair[0], (own**2).sum(1), len(names))
        expected += float((1 - hat / count).sum())
    return found, expected


def _observed(observed: ArrayLike, points: "int | None", what: str) -> Array:
    values = np.array(observed, float)
    if values.ndim == 3:
        values = values[None]
    if values.ndim != 4 or values.shape[-1] != 2 or points is not None and values.shape[2] != points:
        raise UsageError(f"{what}: observed pixels of shape {np.shape(observed)}: give (cameras, pictures, {points or 'points'}, 2), or "
                         f"(pictures, {points or 'points'}, 2) of one camera, NaN where a point is not seen")
    half = np.isnan(values).any(-1)
    values[half] = np.nan
    return values


def _sizes(sizes: Sequence[Any], cameras: int) -> list[tuple[int, int]]:
    given = [sizes] if len(sizes) == 2 and np.ndim(sizes[0]) == 0 else list(sizes)
    if len(given) != cameras or any(len(size) != 2 or not min(size) > 0 for size in given):
        raise UsageError(f"sizes {sizes!r}: give (width, height) of each camera's pictures, px; there are {counted(cameras, 'camera')}")
    return [(int(size[0]), int(size[1])) for size in given]


def _parameters(distortion: Sequence[str], skew: bool, cameras: int) -> list[list[int]]:
    wrong = [name for name in distortion if name not in _DISTORTION]
    if isinstance(distortion, str) or wrong:
        raise UsageError(f"distortion {distortion!r}: give a list of some of {', '.join(_DISTORTION)}")
    lens = [0, 1, 2, 3, *([4] if skew else []), *sorted(PARAMETERS.index(name) for name in set(distortion))]
    return [lens if c == 0 else [*lens, *range(13, 19)] for c in range(cameras)]


def _priors(priors: "Priors | None", estimated: Sequence[Sequence[int]]) -> dict[tuple[int, int], tuple[float, float]]:
    result = {}
    for name, prior in (priors or {}).items():
        found = re.fullmatch(r"camera(\d+)\.(\w+)", name)
        place = (int(found[1]), PARAMETERS.index(found[2])) if found and found[2] in PARAMETERS else (-1, -1)
        if not (0 <= place[0] < len(estimated) and place[1] in estimated[place[0]]):
            raise UsageError(f"priors: {name!r} is not estimated; there are "
                             f"{', '.join(f'camera{c}.{PARAMETERS[k]}' for c, each in enumerate(estimated) for k in each)}")
        if PARAMETERS[place[1]].startswith("w"):
            raise UsageError(f"priors: {name}: a rotation takes none")
        mean, std = (prior.mean, prior.std) if isinstance(prior, NormalPrior) else prior
        if not (math.isfinite(mean) and 0 < std < math.inf):
            raise UsageError(f"priors: {name}: {prior!r}: give (mean, std), std > 0")
        result[place] = (float(mean), float(std))
    return result


def _names(pictures: "Sequence[Any] | None", observed: Array) -> list[list[str]]:
    cameras, views = observed.shape[:2]
    if pictures is None:
        return [[f"camera {c}, picture {v}" if cameras > 1 else f"picture {v}" for v in range(views)] for c in range(cameras)]
    given = [list(pictures)] if pictures and isinstance(pictures[0], (str, os.PathLike)) else [list(each) for each in pictures]
    if [len(each) for each in given] != [views] * cameras:
        raise UsageError(f"pictures: give the names of {counted(views, 'picture')} for each of {counted(cameras, 'camera')}")
    return [[os.fspath(name) for name in each] for each in given]


def calibrate(observed: ArrayLike, target: "Target | ArrayLike", sizes: Sequence[Any], *, distortion: Sequence[str] = ("k1", "k2", "p1", "p2"),
              skew: bool = False, priors: "Priors | None" = None, noise_std: "ArrayLike | None" = None, flatness_std: float = 0.0,
              spacing_std: float = 0.0, pictures: "Sequence[Any] | None" = None, progress: "Callable[[str], None] | None" = None) -> Calibration:
    """Cameras from pictures of a flat target, by bundle adjustment: the target's poses are integrated out, gross errors are left out.

    Parameters
    ----------
    observed : array_like, shape (C, V, N, 2) or (V, N, 2)
        Where corner n of the target is in picture v of camera c, px, pixel centres at whole numbers; NaN where it is not seen.
    target : Target, or array_like, shape (N, 2) or (N, 3)
        Where its corners are, in the unit of length that the calibration then has.
    sizes : (width, height) of each camera
        Of the pictures, px.
    distortion : sequence of str
        Which of k1 ... k6, p1, p2 are estimated; the others are 0.
    skew : bool
        Whether pixels may be skew.
    priors : mapping of str to (mean, std), optional
        Of parameters by name, ``{"camera0.cx": (960, 20)}``: lens, tx, ty, tz.
    noise_std : float or one for each camera, optional
        Of a corner's place, px; by default it is estimated.
    flatness_std : float
        How far the target's corners are out of plane, which is then estimated too; in its unit of length.
    spacing_std : float
        Relative standard deviation of the target's size, which adds to the covariance of tx, ty, tz.
    pictures : sequence of str, or one for each camera, optional
        Names, for messages.
    progress : callable, optional
        Is called with a line of text.

    Returns
    -------
    Calibration

    Raises
    ------
    UsageError
        Shapes or options that do not fit.
    DataError
        Too few pictures, all of them parallel, cameras that see nothing in common, or corners that contradict each other.

    Examples
    --------
    >>> rig = knothe.calibration.calibrate(observed, target, sizes=[(1920, 1200), (1920, 1200)])
    >>> rig.std["camera1.tx"] < 0.1
    True
    """
    points = target.points if isinstance(target, Target) else numbers(target, "target")
    if points.ndim != 2 or points.shape[1] not in (2, 3) or points.shape[1] == 3 and np.ptp(points[:, 2]) > 0:
        raise UsageError(f"calibrate: a target of shape {points.shape}: give (n, 2), or (n, 3) with one z: it is flat (see flatness_std)")
    points = np.c_[points[:, :2], np.zeros(len(points))]
    seen = _observed(observed, len(points), "calibrate")
    cameras = len(seen)
    resolution, names, estimated = _sizes(sizes, cameras), _names(pictures, seen), _parameters(distortion, skew, cameras)
    known = Known(_priors(priors, estimated), points, np.c_[np.zeros((len(points), 2)), np.full(len(points), float(flatness_std))])
    if not (0 <= flatness_std < math.inf and 0 <= spacing_std < 1):
        raise UsageError(f"calibrate: flatness_std={flatness_std!r} is a length ≥ 0, spacing_std={spacing_std!r} a share of the spacing")
    scene, turned, contradictory = _scene_of_target(seen, points, resolution, names)
    kept = np.isfinite(seen).all(-1).any((0, 2))
    if not kept.all():  # pictures in which nobody sees the target
        scene = replace(scene, turned=scene.turned[kept], moved=scene.moved[kept])
    adjustment = _Adjustment(seen[:, kept], scene, resolution, estimated, known, "poses",
                             [[each[v] for v in np.flatnonzero(kept)] for each in names], noise_std,
                             0.5 * target.diameter if isinstance(target, Target) else 0.0)
    adjustment.solve(progress or (lambda text: None))
    found = adjustment.result(turned)
    found.rejected_pictures[:0] = contradictory
    _require_focal_length(found, priors)
    if spacing_std:
        _add_spacing(found, spacing_std)
    return found


def _scene_of_target(seen: Array, points: Array, sizes: Sequence[tuple[int, int]], names: Sequence[Sequence[str]]) -> tuple[Scene, list[str], list[str]]:
    """Initial values; turns the numbering of corners in `seen` where a picture has it the other way round, and takes out pictures that show no plane;
    names of both."""
    cameras, views = seen.shape[:2]
    contradictory = []
    lens = np.zeros((cameras, 13))
    poses: list[dict[int, tuple[Array, Array]]] = []
    for c in range(cameras):
        whole = [v for v in range(views) if np.isfinite(seen[c, v, :, 0]).any()]
        for v in whole:
            corners = points[np.isfinite(seen[c, v, :, 0])]
            if len(corners) < _LEAST_CORNERS or np.linalg.matrix_rank(corners - corners.mean(0), tol=1e-9 * np.ptp(points)) < 2:
                raise DataError(f"{names[c][v]}: {counted(len(corners), 'corner')}, or all on a line: a picture needs {_LEAST_CORNERS} or more that are not; "
                                "leave it out")
        if len(whole) < _LEAST_PICTURES:
            raise DataError(f"camera {c} sees the target in {counted(len(whole), 'picture')}: {_LEAST_PICTURES} are needed, 10 to 20 are good, with the target "
                            "tilted in different directions and all over the picture")
        homographies = {v: _homography(seen[c, v], points) for v in whole}
        for v in whole:
            if not _shows_a_plane(homographies[v], seen[c, v], points, sizes[c]):
                del homographies[v]
                seen[c, v] = np.nan
                contradictory.append(names[c][v])
        if len(homographies) < max(_LEAST_PICTURES, len(whole) / 2):
            raise DataError(f"camera {c}: in {len(whole) - len(homographies)} of {counted(len(whole), 'picture')} the corners are those of no plane: are columns, "
                            "rows and the order of the corners those of the target?")
        lens[c] = _start.lens_of(list(homographies.values()), sizes[c])
        poses.append({v: _start.pose_of(h, lens[c]) for v, h in homographies.items()})
        guess = np.array([1.5 * max(sizes[c])] * 2 + [0.5 * side for side in sizes[c]] + [0.0] * 9)
        _start.require_tilt(np.array([_start.pose_of(h, guess)[0][:, 2] for h in homographies.values()]), f"camera {c}")
    rotation, translation = np.tile(np.eye(3), (cameras, 1, 1)), np.zeros((cameras, 3))
    world, turned, placed = dict(poses[0]), [], {0}
    while len(placed) < cameras:
        common = {c: sorted(set(poses[c]) & set(world)) for c in range(cameras) if c not in placed}
        c = max(common, key=lambda each: len(common[each]))
        if not common[c]:
            raise DataError(f"camera {c} sees the target in no picture together with another camera: take pictures in which both see it whole")
        other_way = {v: _start.pose_of(_homography(seen[c, v, ::-1], points), lens[c]) for v in common[c]}
        relative = _start.Relative([(v, world[v], poses[c][v], other_way[v]) for v in common[c]])
        rotation[c], translation[c] = relative.rotation, relative.translation
        for v in relative.turned:
            seen[c, v] = seen[c, v, ::-1].copy()
            poses[c][v] = other_way[v]
            turned.append(names[c][v])
        for v in set(poses[c]) - set(world):
            r, t = poses[c][v]
            world[v] = rotation[c].T @ r, rotation[c].T @ (t - translation[c])
        placed.add(c)
    absent = np.eye(3), np.array([0, 0, 1.0])
    order = [world.get(v, absent) for v in range(views)]
    return Scene(lens, rotation, translation, np.array([r for r, _ in order]), np.array([t for _, t in order]), points), turned, contradictory


def _homography(pixels: Array, points: Array) -> Array:
    visible = np.isfinite(pixels[:, 0])
    return _start.homography(points[visible, :2], pixels[visible])


def _shows_a_plane(h: Array, pixels: Array, points: Array, size: tuple[int, int]) -> bool:
    """Whether half of the corners are within a fiftieth of the picture of where the homography has them, and all in front."""
    visible = np.isfinite(pixels[:, 0])
    seen = np.c_[points[visible, :2], np.ones(visible.sum())] @ h.T
    return bool((seen[:, 2] > 0).all() and np.median(np.linalg.norm(seen[:, :2] / seen[:, 2:] - pixels[visible], axis=1)) < 0.02 * max(size))


def _require_focal_length(found: Calibration, priors: "Priors | None") -> None:
    for c, camera in enumerate(found.cameras):
        for k, name in enumerate(("fx", "fy")):
            std = found.std[f"camera{c}.{name}"]
            if not std < _LARGEST_FOCAL_STD * camera.lens[k]:
                normals = (camera.rotation @ found.poses[:, :3, :3])[:, :, 2]
                tilt = np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1).min()))
                raise DataError(f"camera {c}: {name} is {camera.lens[k]:.4g} ± {std:.2g} px, which is no calibration: the target's planes differ by {tilt:.1f}° "
                                "at most; tilt it by 20° to 40° in different directions, or give a prior of the focal lengths")


def _add_spacing(found: Calibration, spacing_std: float) -> None:
    """A target that is larger by a factor has all lengths larger by it."""
    direction = np.zeros(len(found.names))
    for k, name in enumerate(found.names):
        camera, _, parameter = name.partition(".")
        if parameter.startswith("t"):
            direction[k] = found.cameras[int(camera[6:])].translation["xyz".index(parameter[1])]
    found.covariance = found.covariance + spacing_std**2 * np.outer(direction, direction)


def match(pictures: Sequence[Sequence[Any]], roi: "Sequence[float] | None" = None, *, element_size: float = 24) -> Array:
    """Matched points of a specimen's own speckle, for `calibrate_specimen`, by `Correlation`: one for each element, at one of its Gauss points,
    where a bilinear element is right to second order.

    Parameters
    ----------
    pictures : for each camera those of all places, in one order
        Grey levels or files; the first of the first camera is the reference.
    roi : (x0, y0, x1, y1), optional
        Region of the reference, px.
    element_size : float
        px.

    Returns
    -------
    ndarray, shape (C, V, N, 2)
        Pixels; NaN of elements that are rejected, and of pictures that do not correlate: seen from too far aside, or turned too far.

    Raises
    ------
    UsageError
        The cameras have different numbers of pictures, or the reference has no texture.
    DataError
        A file is missing or not a picture.

    Examples
    --------
    >>> y, x = np.mgrid[:96, :96]
    >>> speckle = lambda shift: 127 + 30 * (np.cos(0.9 * (x - shift)) + np.cos(0.8 * y + 0.3 * (x - shift)) + np.cos(0.5 * y - 0.6 * (x - shift)))
    >>> found = knothe.calibration.match([[speckle(0), speckle(0.2)], [speckle(0.1), speckle(0.3)]])
    >>> bool(np.max(abs(found[1, 1] - found[0, 0] - [0.3, 0])) < 0.02)
    True
    """
    counts = [len(of_camera) for of_camera in pictures]
    if not counts or min(counts) < 1 or len(set(counts)) > 1:
        raise UsageError(f"match: {counts} pictures of the cameras: give as many of each, in one order")
    correlation = Correlation(pictures[0][0], roi, element_size=element_size)
    corners = np.stack([correlation.x, correlation.y], -1)[np.asarray(correlation.elements)]
    low, high = corners.min(1), corners.max(1)
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])[np.arange(len(low)) % 4]
    points = 0.5 * (low + high) + 0.5 * (high - low) * signs / math.sqrt(3)
    found = np.full((len(pictures), counts[0], len(points), 2), np.nan)
    found[0, 0] = points
    for c, of_camera in enumerate(pictures):
        for v, picture in enumerate(of_camera):
            if (c, v) != (0, 0) and correlation.correlate(picture).converged:
                found[c, v] = points + correlation.at(points)
    return found


def calibrate_specimen(observed: ArrayLike, sizes: Sequence[Any], priors: Priors, *, distances: Sequence[tuple[int, int, float, float]] = (),
                       planes: Sequence[tuple[Sequence[int], float]] = (), distortion: Sequence[str] = (), skew: bool = False,
                       noise_std: "ArrayLike | None" = None, pictures: "Sequence[Any] | None" = None,
                       progress: "Callable[[str], None] | None" = None) -> Calibration:
    """Cameras without a target: from points of a rigid specimen, matched in all cameras and at several of its places; the points' positions are
    unknown too.

    Parameters
    ----------
    observed : array_like, shape (C, V, N, 2)
        Where point n is in camera c while the specimen has its place v, px; NaN where it is not seen. Two cameras or more, and the first place
        is seen by the first two.
    sizes : (width, height) of each camera
    priors : mapping of str to (mean, std)
        Of parameters by name: fx, fy, cx, cy of every camera at least, from the lens and the sensor.
    distances : sequence of (i, j, length, std)
        Known distances of points, which give the scale; or a prior of tx, ty or tz does.
    planes : sequence of (points, std)
        Points that lie on one plane, up to a standard deviation.
    distortion, skew, noise_std, pictures, progress
        As of `calibrate`.

    Returns
    -------
    Calibration

    Raises
    ------
    UsageError
        Shapes or options that do not fit; no scale; focal lengths or centres without a prior.
    DataError
        Matches that contradict each other, or do not determine the cameras.

    Examples
    --------
    >>> priors = {f"camera{c}.{name}": (rig.cameras[c].lens[k], 30) for c in (0, 1) for k, name in enumerate(("fx", "fy", "cx", "cy"))}
    >>> found = knothe.calibration.calibrate_specimen(observed, [(1920, 1200)] * 2, priors, distances=[(0, 87, 122.07, 0.01)],
    ...                                               planes=[(range(88), 0.01)], distortion=["k1", "k2"])
    >>> found.std["camera1.tx"] < 0.5
    True
    """
    seen = _observed(observed, None, "calibrate_specimen")
    cameras, views, count = seen.shape[:3]
    if cameras < 2 or views < 2 or count < 8:
        raise UsageError(f"calibrate_specimen: {counted(cameras, 'camera')}, {counted(views, 'place')} of the specimen, {counted(count, 'point')}: two, two and "
                         "eight are the least")
    resolution, names, estimated = _sizes(sizes, cameras), _names(pictures, seen), _parameters(distortion, skew, cameras)
    prior = _priors(priors, estimated)
    missing = [f"camera{c}.{PARAMETERS[k]}" for c in range(cameras) for k in range(4) if (c, k) not in prior]
    if missing:
        raise UsageError(f"calibrate_specimen: no prior of {', '.join(missing)}: state what the lens and the sensor say, and how well that is known")
    if not distances and not any(k >= 16 for _, k in prior):
        raise UsageError("calibrate_specimen: nothing gives the scale: state a distance of two points, or a prior of camera1.tx")
    for i, j, length, std in distances:
        if not (0 <= i < count and 0 <= j < count and i != j and length > 0 and std > 0):
            raise UsageError(f"calibrate_specimen: distance ({i}, {j}, {length}, {std}): give two of {count} points, a length > 0 and its std > 0")
    members = [(np.asarray(points, np.int64), float(std)) for points, std in planes]
    for points, std in members:
        if len(points) < 4 or points.min() < 0 or points.max() >= count or not std > 0:
            raise UsageError(f"calibrate_specimen: a plane needs four or more of {count} points, and a std > 0")
    scene, usable = _scene_of_specimen(seen, prior, distances, members)
    for i, j, length, _ in distances:
        if not usable[[i, j]].all():
            raise UsageError(f"calibrate_specimen: the distance {length:g} of the points {i} and {j}: both must be seen by the first two cameras at one place")
    known = Known(prior, distances=[(int(i), int(j), float(length), float(std)) for i, j, length, std in distances], planes=members)
    seen[:, :, ~usable] = np.nan
    adjustment = _Adjustment(seen, scene, resolution, estimated, known, "points", names, noise_std)
    adjustment.solve(progress or (lambda text: None))
    return adjustment.result([])


def _scene_of_specimen(seen: Array, prior: Mapping[tuple[int, int], tuple[float, float]], distances: Sequence[tuple[int, int, float, float]],
                       planes: Sequence[tuple[NDArray[np.int64], float]]) -> tuple[Scene, NDArray[np.bool_]]:
    """Initial values: the second camera by its rays, points of the first place, then the other places and cameras; which points have them."""
    cameras, views, count = seen.shape[:3]
    lens = np.zeros((cameras, 13))
    for (c, k), (mean, _) in prior.items():
        if k < 13:
            lens[c, k] = mean
    ray = np.full(seen.shape, np.nan)
    for c in range(cameras):
        visible = np.isfinite(seen[c]).all(-1)
        ray[c][visible] = _start.rays(lens[c], seen[c][visible])
    both = np.isfinite(ray[:2]).all((0, -1))
    r, t = _start.rig_of_matches(ray[0][both], ray[1][both])
    place = np.full((views, count, 3), np.nan)
    depth = _start.depths(r, t, ray[0][both], ray[1][both])[:, 0]
    place[both] = np.where(depth > 0, depth, np.nan)[:, None] * np.c_[ray[0][both], np.ones(len(depth))]
    if distances:
        ratios = np.array([length / np.linalg.norm(place[:, i] - place[:, j], axis=-1) for i, j, length, _ in distances])
        scale = float(np.median(ratios[np.isfinite(ratios)])) if np.isfinite(ratios).any() else math.nan
    else:
        (k, (mean, _)), *_ = [(k, each) for (c, k), each in prior.items() if c == 1 and k >= 16]
        scale = abs(mean / t[k - 16])
    if not math.isfinite(scale):
        raise DataError("calibrate_specimen: the points of the stated distances are not seen by the first two cameras at any place")
    place, t = scale * place, scale * t
    points = place[0].copy()
    turned, moved = np.tile(np.eye(3), (views, 1, 1)), np.zeros((views, 3))
    for v in range(1, views):
        common = np.isfinite(points[:, 0]) & np.isfinite(place[v, :, 0])
        if common.sum() < 4:
            raise DataError(f"calibrate_specimen: the first two cameras see {counted(int(common.sum()), 'point')} at place {v} that they see at the first "
                            "place too: four are the least; leave the place out, or state another one first")
        turned[v], moved[v] = _aligned(points[common], place[v, common])
        new = np.isfinite(place[v, :, 0]) & ~np.isfinite(points[:, 0])
        points[new] = (place[v, new] - moved[v]) @ turned[v]
    rotation, translation = np.tile(np.eye(3), (cameras, 1, 1)), np.zeros((cameras, 3))
    rotation[1], translation[1] = r, t
    usable = np.isfinite(points[:, 0])
    for c in range(2, cameras):
        rotation[c], translation[c] = _resected(points, turned, moved, ray[c])
    points[~usable] = [0, 0, 1.0]
    surfaces = np.array([_plane(points[members]) for members, _ in planes]).reshape(-1, 3)
    return Scene(lens, rotation, translation, turned, moved, points, surfaces), usable


def _aligned(one: Array, other: Array) -> tuple[Array, Array]:
    """R, t with other = R one + t (Kabsch), reweighted against gross errors."""
    weight = np.ones(len(one))
    for _ in range(6):
        share = (weight / weight.sum())[:, None]
        a, b = (share * one).sum(0), (share * other).sum(0)
        r = _start.nearest_rotation((share * (other - b)).T @ (one - a))
        off = np.linalg.norm((one - a) @ r.T + b - other, axis=1)
        weight = 1 / (1 + (off / (2 * np.median(off) + 1e-12))**2)
    return r, b - r @ a


def _resected(points: Array, turned: Array, moved: Array, ray: Array) -> tuple[Array, Array]:
    """R, t of a further camera from points whose place is known, by the direct linear transformation."""
    visible = np.isfinite(ray[..., 0]) & np.isfinite(points[:, 0])
    world = np.einsum("vij,nj->vni", turned, points) + moved[:, None]
    x, (u, v) = world[visible], ray[visible].T
    if len(x) < 6:
        raise DataError("calibrate_specimen: a further camera sees fewer than six points of those that the first two see")
    centre, size = x.mean(0), x.std()
    h = np.c_[(x - centre) / size, np.ones(len(x))]
    rows = np.r_[np.c_[h, 0 * h, -u[:, None] * h], np.c_[0 * h, h, -v[:, None] * h]]
    p = np.linalg.svd(rows)[2][-1].reshape(3, 4)
    p *= np.sign(np.linalg.det(p[:, :3])) / np.cbrt(abs(np.linalg.det(p[:, :3])))
    r = _start.nearest_rotation(p[:, :3])
    return r, size * p[:, 3] - r @ centre


def _plane(points: Array) -> Array:
    """q with q X = 1."""
    centre = points.mean(0)
    normal = np.linalg.svd(points - centre)[2][-1]
    return np.asarray(normal / (normal @ centre))


def _length(text: str) -> float:
    """In mm."""
    found = re.fullmatch(r"([\d.]+(?:e-?\d+)?)\s*(mm|cm|m)", text.strip())
    factor = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
    try:
        value = float(found[1]) * factor[found[2]] if found else 0.0
    except ValueError:
        value = 0.0
    if not value > 0:
        raise argparse.ArgumentTypeError(f"{text!r}: give a length > 0 with its unit, 10mm, 1cm or 0.01m")
    return value


def _grid(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)x(\d+)", text)
    if not found:
        raise argparse.ArgumentTypeError(f"{text!r}: give columns x rows, 11x8: of a chessboard its inner corners")
    return int(found[1]), int(found[2])


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python3 -m knothe.calibration", description="Calibrates cameras from pictures of a flat target, all lengths in "
                                     "mm. Writes RIG.yaml (or .xml, .caldat), for `knothe dic --cameras`, and RIG.csv, its covariance, for "
                                     "--calibration-std.")
    parser.add_argument("pictures", nargs="+", metavar="PICTURE", help="of the (first) camera")
    parser.add_argument("--right", nargs="+", action="append", default=[], metavar="PICTURE", help="of a further camera, in the same order; may be repeated")
    parser.add_argument("--target", nargs=2, required=True, metavar=("KIND", "COLUMNSxROWS"), help="chessboard and its inner corners, 11x8; or dots")
    parser.add_argument("--spacing", required=True, type=_length, help="of corners or dots, 10mm")
    parser.add_argument("--diameter", type=_length, default=0.0, help="of dots, 4mm: corrects where their middles are seen")
    parser.add_argument("-o", "--output", required=True, metavar="RIG", help="RIG.yaml and RIG.csv; or RIG.xml (DICe), RIG.caldat (MatchID)")
    parser.add_argument("--distortion", default="k1,k2,p1,p2", help="what is estimated of k1 ... k6, p1, p2 (default %(default)s); none: \"\"")
    parser.add_argument("--skew", action="store_true", help="estimates the skew of pixels (.caldat)")
    parser.add_argument("--flatness", type=_length, default=0.0, help="standard deviation of the target out of plane, 0.05mm: its shape is estimated")
    parser.add_argument("--spacing-std", type=float, default=0.0, metavar="SHARE", help="relative standard deviation of the spacing, 1e-4")
    parser.add_argument("--figure", metavar="FILE", help="draws the residuals (.png, .svg; needs matplotlib)")
    return parser


def _found_in(files: Sequence[Sequence[str]], target: Target) -> tuple[Array, list[tuple[int, int]]]:
    """Corners in all pictures, and each camera's size; says how far it is."""
    count, total, missed = 0, sum(map(len, files)), []
    observed = np.full((len(files), len(files[0]), target.columns * target.rows, 2), np.nan)
    sizes: list[tuple[int, int]] = []
    for c, of_camera in enumerate(files):
        for v, name in enumerate(of_camera):
            picture = read_picture(name)
            size = picture.shape[1], picture.shape[0]
            if v == 0:
                sizes.append(size)
            elif size != sizes[c]:
                raise DataError(f"{name}: {size[0]} x {size[1]} px, but {of_camera[0]} has {sizes[c][0]} x {sizes[c][1]}: give pictures of one camera and setting")
            corners = find_target(picture, target)
            count += 1
            if corners is None:
                missed.append(name)
            else:
                observed[c, v] = corners
            _say(f"{count} of {total} pictures: {name}: {'found' if corners is not None else 'no target found'}", True)
    if missed:
        _say(f"target not found in {len(missed)} of {total} pictures: {', '.join(missed[:5])}{' ...' if len(missed) > 5 else ''}: is it whole in them, sharp, and "
             f"of {target.columns} x {target.rows} {'inner corners' if target.kind == 'chessboard' else 'dots'}?")
    if len(missed) == total:
        raise DataError(f"the target was found in none of {total} pictures")
    return observed, sizes


def _say(text: str, is_passing: bool = False) -> None:
    """On stderr; what is passing on a terminal alone, where it is written over."""
    is_terminal = sys.stderr.isatty()
    if is_terminal or not is_passing:
        print(f"\r\033[K{text}" if is_terminal else text, end="" if is_passing else "\n", file=sys.stderr, flush=True)


def _calibrated(options: argparse.Namespace) -> None:
    output = pathlib.Path(options.output)
    if output.suffix not in (".yaml", ".yml", ".xml", ".caldat"):
        output = output.with_name(output.name + ".yaml")
    distortion = [name for name in options.distortion.split(",") if name]
    _cameras.format_of(output, 1 + len(options.right), options.skew, bool({"k4", "k5", "k6"} & set(distortion)))
    kind, size = options.target
    target = Target(*_grid(size), options.spacing, kind, options.diameter)
    files = [options.pictures, *options.right]
    for c, of_camera in enumerate(files):
        if len(of_camera) != len(files[0]):
            raise UsageError(f"{len(files[0])} pictures of the first camera and {len(of_camera)} of camera {c}: give as many of each, in one order; where a camera "
                             "does not see the target, its picture still has its place")
    observed, sizes = _found_in(files, target)
    found = calibrate(observed, target, sizes, distortion=distortion, skew=options.skew,
                      flatness_std=options.flatness, spacing_std=options.spacing_std, pictures=files, progress=lambda text: _say(text, True))
    _say(f"{counted(int(found.used.sum()), 'corner')} used")
    found.save(output)
    found.save_covariance(output.with_suffix(".csv"))
    if options.figure:
        from knothe import plot
        figure = plot.calibration(found)[0].figure
        figure.savefig(options.figure)
    print(found.table())
    for c, noise in enumerate(found.noise):
        worst = int(np.nanargmax(found.picture_rms[c]))
        print(f"camera{c}: corners ± {_notebook.two_digits(float(noise))} px; largest residuals in {files[c][worst]}, "
              f"{_notebook.two_digits(float(found.picture_rms[c, worst]))} px")
    for name in found.turned:
        print(f"{name}: corners numbered the other way round, put right")
    for name in found.rejected_pictures:
        print(f"{name}: left out: it contradicts the other pictures")
    for error in found.rejected:
        print(f"{error}: left out")
    print(_notebook.WORDS[found.verdict.level])
    for reason in found.verdict.reasons:
        print(f"  {reason.level}: {reason.message}")
    print(f"written: {output}, {output.with_suffix('.csv')}")


def main(arguments: "Sequence[str] | None" = None) -> int:
    """The command ``python3 -m knothe.calibration``.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the command line by default.

    Returns
    -------
    int
        Exit status: 0, or that of the error.

    Examples
    --------
    >>> knothe.calibration.main(["left.png", "--target", "chessboard", "8x8", "--spacing", "10mm", "-o", "rig"])
    2
    """
    parser = _arguments()
    options = parser.parse_args(arguments)
    try:
        _calibrated(options)
    except argparse.ArgumentTypeError as error:
        print(f"knothe.calibration: error: --target: {error}", file=sys.stderr)
        return UsageError.status
    except Error as error:
        print(f"knothe.calibration: error: {error}", file=sys.stderr)
        return error.status
    except KeyboardInterrupt:
        return Interrupted.status
    return 0


__all__ = ["Calibration", "Camera", "GrossError", "Target", "calibrate", "calibrate_specimen", "find_target", "main", "match"]

if __name__ == "__main__":
    sys.exit(main())
