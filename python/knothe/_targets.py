"""Calibration targets, and where they are in pictures (by OpenCV, which is imported only here)."""
from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knothe._errors import UsageError
from knothe._pictures import read_picture
from knothe._values import Array

_KINDS = ("chessboard", "dots")


@dataclass(frozen=True)
class Target:
    """A flat target: the inner corners of a chessboard, or the dots of a grid.

    Parameters
    ----------
    columns, rows : int
        Corners or dots in a row, and rows; not the same number, so that a picture shows which is which.
    spacing : float
        Distance of neighbours, in the unit of length that the calibration then has.
    kind : str
        ``chessboard`` or ``dots``.
    diameter : float
        Of a dot; the middle of its picture is then put right, which is not the picture of its middle where the target is tilted.

    Examples
    --------
    >>> target = knothe.calibration.Target(11, 8, 10.0)
    >>> target.points[[0, 1, 11]]
    array([[ 0.,  0.,  0.],
           [10.,  0.,  0.],
           [ 0., 10.,  0.]])
    """

    columns: int
    rows: int
    spacing: float
    kind: str = "chessboard"
    diameter: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise UsageError(f"Target: kind {self.kind!r}: give {' or '.join(_KINDS)}")
        if not (self.columns > 1 and self.rows > 1 and self.columns != self.rows):
            raise UsageError(f"Target: {self.columns} x {self.rows}: count the inner corners (of a chessboard) or dots of a row and a column: two or more, "
                             "and not the same number, as a square grid looks the same when it is turned")
        if not (self.spacing > 0 and math.isfinite(self.spacing)):
            raise UsageError(f"Target: a spacing of {self.spacing!r}: give the distance of neighbours, > 0")
        if not 0 <= self.diameter < self.spacing or self.diameter > 0 and self.kind != "dots":
            raise UsageError(f"Target: a diameter of {self.diameter!r}: that of dots, less than their spacing")

    @property
    def points(self) -> Array:
        """Where its corners or dots are, row by row.

        Returns
        -------
        ndarray, shape (columns * rows, 3)

        Examples
        --------
        >>> knothe.calibration.Target(3, 2, 1.0).points.shape
        (6, 3)
        """
        y, x = np.mgrid[:self.rows, :self.columns].reshape(2, -1)
        return np.asarray(self.spacing * np.stack([x, y, np.zeros_like(x)], -1), float)


def find_target(picture: "ArrayLike | str | os.PathLike[str]", target: Target) -> "Array | None":
    """Where a target's corners or dots are in a picture; needs OpenCV.

    The first row is such that the target is not mirrored; if a chessboard has an odd number of rows and an even number of columns, or the reverse,
    the first square between corners is a dark one. Of others, turned by 180°, `calibrate` finds out which one agrees with the other cameras.

    Parameters
    ----------
    picture : array_like, shape (height, width), or path
        Grey levels, or a file as of `read_picture`.
    target : Target

    Returns
    -------
    ndarray, shape (columns * rows, 2), or None
        Pixels, in the order of `target.points`; None where the target is not found whole.

    Raises
    ------
    UsageError
        OpenCV is not installed.
    DataError
        The file is missing or not a picture.

    Examples
    --------
    >>> knothe.calibration.find_target(np.zeros((60, 80)), knothe.calibration.Target(4, 3, 10.0)) is None  # doctest: +SKIP
    True
    """
    try:
        import cv2
    except ImportError:
        raise UsageError("find_target: OpenCV is not installed for this Python: apt install python3-opencv (Debian), or "
                         "pip install opencv-python-headless") from None
    grey = read_picture(picture) if isinstance(picture, (str, os.PathLike)) else np.asarray(picture, np.float32)
    if grey.ndim != 2:
        raise UsageError(f"find_target: a picture of shape {grey.shape}: give grey levels, (height, width)")
    dark, bright = np.percentile(grey, [0.5, 99.5])
    if not bright > dark:
        return None
    eight_bit = np.clip((grey - dark) * (255 / (bright - dark)), 0, 255).astype(np.uint8)
    if target.kind == "chessboard":
        corners = _chessboard(cv2, eight_bit, target)
        # blurred by 0.8 px: where a sharp edge goes over a pixel unseen, a fit has several minima
        found = None if corners is None else _saddles(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 0.8).astype(float), corners)
    else:
        found = _dots(cv2, eight_bit, target)
    return None if found is None else _ordered(found, np.asarray(grey, float), target)


def _chessboard(cv2: Any, grey: NDArray[np.uint8], target: Target) -> "Array | None":
    size = target.columns, target.rows
    found, corners = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_EXHAUSTIVE + cv2.CALIB_CB_ACCURACY)
    if not found:
        found, corners = cv2.findChessboardCorners(grey, size)
    return np.asarray(corners, float).reshape(target.rows, target.columns, 2) if found else None


def _saddles(grey: Array, corners: Array) -> Array:
    """Corners of squares, each by least squares of c + d tanh(s1) tanh(s2), s the distances from two lines through it over the blur's width; the
    lines, the blur and the contrast are fitted too. Corners for which that fails stay where they are."""
    least = min(float(np.linalg.norm(np.diff(corners, axis=axis), axis=-1).min()) for axis in (0, 1))
    half = int(np.clip(0.35 * least, 2, 12))  # without the next squares' edges
    start = corners.reshape(-1, 2)
    height, width = grey.shape
    middle = np.rint(start).astype(int)
    inside = ((middle >= half) & (middle < np.array([width, height]) - half)).all(1)
    middle = middle[inside]
    v, u = np.mgrid[-half:half + 1, -half:half + 1].reshape(2, -1)
    value = grey[middle[:, 1, None] + v, middle[:, 0, None] + u]  # (n, pixels)
    normals = []
    for axis in (1, 0):
        along = np.gradient(corners, axis=axis).reshape(-1, 2)[inside]
        normals.append(np.arctan2(along[:, 0], -along[:, 1]))
    x, y = (start[inside] - middle).T
    contrast = 0.5 * np.ptp(value, axis=1)
    unknowns = np.stack([x, y, *normals, np.ones(len(x)), value.mean(1), contrast], -1)
    s = _saddle(unknowns, u, v)[0]
    unknowns[:, 6] *= np.sign(((value - value.mean(1, keepdims=True)) * (s - unknowns[:, 5:6])).sum(1))
    for _ in range(20):
        model, slopes = _saddle(unknowns, u, v)
        normal = slopes.swapaxes(1, 2) @ slopes
        normal += 1e-6 * np.einsum("nii->ni", normal)[:, :, None] * np.eye(7) + 1e-12 * np.eye(7)
        step = np.linalg.solve(normal, slopes.swapaxes(1, 2) @ (value - model)[:, :, None])[..., 0]
        step[:, :2] = np.clip(step[:, :2], -1, 1)
        step[:, 2:4] = np.clip(step[:, 2:4], -0.2, 0.2)
        unknowns = unknowns + step
        unknowns[:, 4] = np.clip(unknowns[:, 4], 0.3, half)
    refined = start.copy()
    place = unknowns[:, :2] + middle
    good = np.isfinite(place).all(1) & (np.linalg.norm(place - start[inside], axis=1) < 0.5 * half) & (abs(step[:, :2]).max(1) < 0.01)
    refined[np.flatnonzero(inside)[good]] = place[good]
    return refined.reshape(corners.shape)


def _saddle(unknowns: Array, u: NDArray[np.int64], v: NDArray[np.int64]) -> tuple[Array, Array]:
    """The model of a corner (n, pixels), and its derivatives by place, both normals' angles, blur, mean and contrast (n, pixels, 7)."""
    x, y, first, second, blur, mean, contrast = (each[:, None] for each in unknowns.T)
    edges, by_distance, turning = [], [], []
    for angle in (first, second):
        distance = (u - x) * np.cos(angle) + (v - y) * np.sin(angle)
        edge = np.tanh(distance / blur)
        edges.append(edge)
        by_distance.append((1 - edge**2) / blur)
        turning.append((distance, (v - y) * np.cos(angle) - (u - x) * np.sin(angle)))
    one, other = contrast * by_distance[0] * edges[1], contrast * by_distance[1] * edges[0]
    slopes = [-one * np.cos(first) - other * np.cos(second), -one * np.sin(first) - other * np.sin(second), one * turning[0][1], other * turning[1][1],
              -(one * turning[0][0] + other * turning[1][0]) / blur, np.ones_like(one), edges[0] * edges[1]]
    return mean + contrast * edges[0] * edges[1], np.stack(slopes, -1)


def _dots(cv2: Any, grey: NDArray[np.uint8], target: Target) -> "Array | None":
    for inverse in (False, True):  # bright dots too
        own = 255 - grey if inverse else grey
        settings = cv2.SimpleBlobDetector_Params()
        settings.minArea, settings.maxArea = 12, own.size / (2 * target.columns * target.rows)
        settings.minDistBetweenBlobs = 4
        found, centres = cv2.findCirclesGrid(own, (target.columns, target.rows), flags=cv2.CALIB_CB_SYMMETRIC_GRID,
                                             blobDetector=cv2.SimpleBlobDetector_create(settings))
        if found:
            return _centroids(own.astype(float), centres.reshape(target.rows, target.columns, 2).astype(float))
    return None


def _centroids(grey: Array, centres: Array) -> Array:
    """Of dark dots: weighted by how much darker than the brightest a pixel is, within half of the distance to the nearest neighbour."""
    found = centres.copy()
    for _ in range(3):
        steps = [np.linalg.norm(np.diff(found, axis=axis), axis=-1) for axis in (0, 1)]
        for place in np.ndindex(found.shape[:2]):
            radius = 0.5 * min(float(step[tuple(np.clip([place[0] - (axis == 0) * d, place[1] - (axis == 1) * d], 0, np.array(step.shape) - 1))])
                               for axis, step in enumerate(steps) for d in (0, 1))
            x, y = found[place]
            low = np.maximum(np.floor([x - radius, y - radius]).astype(int), 0)
            part = grey[low[1]:int(y + radius) + 2, low[0]:int(x + radius) + 2]
            v, u = np.mgrid[:part.shape[0], :part.shape[1]]
            off = np.hypot(u + low[0] - x, v + low[1] - y)
            inside = off < radius
            ring = inside & (off > 0.8 * radius)
            if ring.sum() < 4:
                continue
            background = float(np.median(part[ring]))
            noise = 3 * 1.4826 * float(np.median(np.abs(part[ring] - background)))
            weight = np.where(inside, np.maximum(background - part - noise, 0.0), 0.0)
            if weight.sum() > 0:
                found[place] = (u * weight).sum() / weight.sum() + low[0], (v * weight).sum() / weight.sum() + low[1]
    return found


def _ordered(found: Array, grey: Array, target: Target) -> Array:
    """Not mirrored, and of a chessboard that shows it, a dark square first."""
    right, down = found[0, -1] - found[0, 0], found[-1, 0] - found[0, 0]
    if right[0] * down[1] - right[1] * down[0] < 0:
        found = found[:, ::-1]
    if target.kind == "chessboard" and (target.columns + target.rows) % 2:
        middles = 0.25 * (found[1:, 1:] + found[:-1, 1:] + found[1:, :-1] + found[:-1, :-1])
        x, y = np.clip(np.rint(middles).astype(int).reshape(-1, 2), 0, np.array(grey.shape)[::-1] - 1).T
        values = grey[y, x].reshape(middles.shape[:2])
        row, column = np.indices(values.shape)
        if values[(row + column) % 2 == 0].mean() > values[(row + column) % 2 == 1].mean():
            found = found[::-1, ::-1]
    return np.ascontiguousarray(found.reshape(-1, 2))
