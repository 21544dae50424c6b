"""Image correlation."""
from __future__ import annotations

import os
from dataclasses import dataclass
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knothe import _knothe, _notebook
from knothe._errors import UsageError
from knothe._twin import Datum
from knothe._values import Array, ByValue, Precision, Sensors, counted, points_of

Picture = NDArray[np.float32]


def read_picture(path: "str | os.PathLike[str]") -> Picture:
    """Reads a TIFF, PNG, JPEG, BMP or PGM of 8 or 16 bits.

    Parameters
    ----------
    path : path

    Returns
    -------
    ndarray of float32, shape (height, width)
        Grey levels; row 0 is the top.

    Raises
    ------
    DataError
        The file is missing, damaged, or not a picture.

    Examples
    --------
    >>> with open("grey.pgm", "wb") as file:
    ...     _ = file.write(b"P5 3 2 255\\n" + bytes([0, 50, 100, 150, 200, 250]))
    >>> knothe.read_picture("grey.pgm")
    array([[  0.,  50., 100.],
           [150., 200., 250.]], dtype=float32)
    """
    return _knothe.read_picture(os.fspath(path))[0]


def _picture(picture: "ArrayLike | str | os.PathLike[str]") -> tuple[Picture, float]:
    """Grey levels, and that of a saturated pixel: of integers the largest of their type."""
    if isinstance(picture, (str, os.PathLike)):
        return _knothe.read_picture(os.fspath(picture))
    if isinstance(picture, np.ma.MaskedArray) and np.ma.count_masked(picture) > 0:
        raise UsageError("a picture has masked pixels: give grey levels everywhere, and leave parts out by roi or mesh")
    pixels = np.asarray(picture)
    if pixels.dtype.kind == "f" and pixels.ndim == 2 and not np.isfinite(pixels).all():
        row, column = np.argwhere(~np.isfinite(pixels))[0]
        raise UsageError(f"a picture of {pixels.shape[0]} x {pixels.shape[1]} pixels is not finite at row {row}, column {column}; "
                         "give grey levels everywhere, and leave parts out by roi or mesh")
    if pixels.dtype.kind == "u":
        return np.ascontiguousarray(pixels, np.float32), float(np.iinfo(pixels.dtype).max)
    return np.ascontiguousarray(pixels, np.float32), 65535.0 if pixels.size and pixels.max() > 255 else 255.0


def _mesh(mesh: "str | os.PathLike[str] | tuple[ArrayLike, ArrayLike] | None") -> tuple[Array, NDArray[np.int32]]:
    """Nodes n x 2 and elements m x 4, -1 as a triangle's fourth node; none at all where no mesh is given."""
    if mesh is None:
        return np.zeros((0, 2)), np.zeros((0, 4), np.int32)
    if isinstance(mesh, (str, os.PathLike)):
        x, y, elements = _knothe.read_mesh(os.fspath(mesh))
        return np.column_stack([x, y]), elements
    nodes, given = points_of(mesh[0], 2, "nodes of a mesh"), np.asarray(mesh[1])
    if given.ndim != 2 or given.shape[1] not in (3, 4) or len(given) == 0 or given.dtype.kind not in "iu":
        raise UsageError(f"mesh: elements of shape {given.shape} and type {given.dtype}: give integers, m x 3 or m x 4")
    rows = np.full((len(given), 4), -1, np.int32)
    rows[:, :given.shape[1]] = given
    return nodes, rows


def _require_scale(scale: float) -> None:
    if not 0 < scale < np.inf:
        raise UsageError(f"scale {scale}: give metres per pixel, > 0")


@dataclass(frozen=True, eq=False, repr=False)
class Displacements(ByValue):
    """Displacements of the nodes, px, positive to the right and down.

    Attributes
    ----------
    u, v : ndarray, shape (nodes,)
        NaN where nothing could be measured.
    std_u, std_v : ndarray, shape (nodes,)
        From the noise of the pictures.
    converged : bool
    message : str
        Why it did not converge.
    iterations : int
    elements_rejected : int
        Number of elements rejected for a residual that no displacement explains, e.g. at a crack.
    residual_rms, picture_noise : float
        Grey levels.

    Examples
    --------
    >>> moved.converged, bool(np.nanmax(abs(moved.u - 0.3)) < 0.05)
    (True, True)
    """

    u: Array
    v: Array
    std_u: Array
    std_v: Array
    converged: bool
    message: str
    iterations: int
    elements_rejected: int
    residual_rms: float
    picture_noise: float
    _precision: tuple[Array, NDArray[np.int64], NDArray[np.int64]]

    @property
    def values(self) -> Array:
        """u and v in turn, (u_0, v_0, u_1, ...), shape (2 nodes,), px, v down; `datum` has them in metres, for a model.

        Examples
        --------
        >>> bool(np.all(moved.values[::2] == moved.u))
        True
        """
        return np.column_stack([self.u, self.v]).ravel()

    def precision(self) -> Precision:
        """Inverse covariance of `values`.

        Returns
        -------
        Precision
            Of 2 x nodes values, 1/px².

        Raises
        ------
        UsageError
            The noise of the picture could not be estimated.

        Examples
        --------
        >>> covariance = np.linalg.inv(moved.precision().toarray())
        >>> bool(np.allclose(np.sqrt(np.diag(covariance))[::2], moved.std_u))
        True
        """
        if len(self._precision[2]) == 0:
            raise UsageError("the picture has no noise that could be estimated: it may show something else than the reference")
        return Precision(*self._precision)

    def __repr__(self) -> str:
        state = "" if self.converged else f"; not converged: {self.message}"
        return (f"<Displacements of {counted(len(self.u), 'node')}: u {np.nanmin(self.u):.3g} to {np.nanmax(self.u):.3g} px, "
                f"v {np.nanmin(self.v):.3g} to {np.nanmax(self.v):.3g} px{state}>" if np.isfinite(self.u).any() else
                f"<Displacements of {counted(len(self.u), 'node')}: nothing measured{state}>")

    def _repr_html_(self) -> str:
        rows = [(name, f"{np.nanmin(values):.3g} … {np.nanmax(values):.3g} px", f"{np.nanmean(std):.2g} px")
                for name, values, std in (("u", self.u, self.std_u), ("v", self.v, self.std_v)) if np.isfinite(values).any()]
        state = "" if self.converged else f"Not converged: {self.message}"
        return _notebook.table(f"Displacements of {counted(len(self.u), 'node')}", ("", "range", "mean noise"), rows, state)

    def datum(self, step: int, scale: float) -> Datum:
        """The measurements for a model with y up, v positive upwards; for `Correlation.sensors`.

        Parameters
        ----------
        step : int
            As of `Datum`.
        scale : float
            m per px.

        Returns
        -------
        Datum
            2 x nodes values, m.

        Examples
        --------
        >>> bool(np.allclose(moved.datum(3, scale=1e-4).values[1::2], -1e-4 * moved.v))
        True
        """
        _require_scale(scale)
        up = np.where(np.arange(2 * len(self.u)) % 2 == 0, scale, -scale)  # of u and v
        data, indices, indptr = self.precision().rows()
        rows = np.repeat(np.arange(len(up)), np.diff(indptr))
        return Datum(step, up * self.values, precision=Precision(data / (up[rows] * up[indices]), indices, indptr))


class Correlation:
    """One reference picture and its mesh, many deformed pictures: global finite-element image correlation.

    Parameters
    ----------
    reference : array_like, shape (height, width), or path
        Grey levels; pixel centres are at integer coordinates, x to the right, y down.
    roi : (x0, y0, x1, y1), optional
        Opposite corners of the mesh, inclusive, px; by default the picture less a margin.
    mesh : path or (nodes, elements), optional
        In place of `roi` and `element_size`: a file of Gmsh (.msh) or VTK (.vtu) whose x and y are pixels, or nodes, shape (n, 2),
        px, and for each element its nodes from 0, shape (m, 3) or (m, 4): triangles, or quadrilaterals (a fourth node of -1: a
        triangle).
    element_size : float
        px, adjusted to divide the region evenly.
    prefilter : float
        Standard deviation of a Gaussian filter on both pictures, px; 1 for sharp, aliased speckle.
    max_iterations : int
    tolerance : float
        On the largest change of a displacement, px.
    threads : int

    Raises
    ------
    UsageError
        Inconsistent arguments, or elements without texture.
    DataError
        A picture or mesh file is missing or damaged.

    Attributes
    ----------
    x, y : ndarray, shape (nodes,)
        Coordinates of the nodes, px.
    elements : ndarray, shape (elements, 4)
        Their nodes; the fourth of a triangle is -1.

    Examples
    --------
    A speckle, and the same moved by 0.3 px to the right:

    >>> spots = np.random.default_rng(1).uniform(0, 96, (2, 400))
    >>> def picture(shift):
    ...     y, x = np.mgrid[:96, :96]
    ...     near = (x - spots[0, :, None, None] - shift) ** 2 + (y - spots[1, :, None, None]) ** 2
    ...     return 20 + 25 * np.exp(-near / 8).sum(0)
    >>> correlation = knothe.Correlation(picture(0), element_size=24)
    >>> moved = correlation.correlate(picture(0.3))
    >>> moved.converged, bool(np.max(abs(moved.u - 0.3)) < 0.05)
    (True, True)

    The same on two triangles of one's own:

    >>> mesh = ([[10, 10], [80, 10], [80, 80], [10, 80]], [[0, 1, 2], [0, 2, 3]])
    >>> knothe.Correlation(picture(0), mesh=mesh).correlate(picture(0.3)).u.round(1)
    array([0.3, 0.3, 0.3, 0.3])
    """

    def __init__(self, reference: "ArrayLike | str | os.PathLike[str]", roi: Sequence[float] | None = None, *,
                 mesh: "str | os.PathLike[str] | tuple[ArrayLike, ArrayLike] | None" = None, element_size: float = 32,
                 prefilter: float = 0, max_iterations: int = 50, tolerance: float = 1e-3,
                 threads: int = 1) -> None:
        if roi is not None and len(roi) != 4:
            raise UsageError(f"roi: {counted(len(roi), 'number')}; give x0, y0, x1, y1, two opposite corners in px")
        if roi is not None and mesh is not None:
            raise UsageError("Correlation: a mesh has its own region; leave out roi")
        nodes, elements = _mesh(mesh)
        pixels, maximum = _picture(reference)
        region: Any = [0.0] * 4 if roi is None else [float(value) for value in roi]
        self._make(pixels.copy(), maximum, nodes.copy(), elements.copy(), element_size, region, prefilter, max_iterations, tolerance, threads)

    def _make(self, *arguments: Any) -> None:
        self._arguments, self._native = arguments, _knothe.Correlation(*arguments)
        self.x, self.y, self.elements = self._native.mesh()

    def __reduce__(self) -> tuple[Any, ...]:
        return _correlation_of, self._arguments

    def correlate(self, deformed: "ArrayLike | str | os.PathLike[str]") -> Displacements:
        """Displacements of the nodes in a deformed picture; the iteration starts from those of the last one.

        Parameters
        ----------
        deformed : array_like, shape (height, width), or path

        Returns
        -------
        Displacements
            Whether they converged is in `converged`.

        Raises
        ------
        UsageError
            The picture has another size than the reference.

        Examples
        --------
        >>> bool(np.max(abs(correlation.correlate(picture(0.1)).u - 0.1)) < 0.05)
        True
        """
        pixels, maximum = _picture(deformed)
        found = self._native.correlate(pixels, maximum)
        return Displacements(_precision=found.pop("precision"), **found)

    def __repr__(self) -> str:
        return f"<Correlation: {counted(len(self.x), 'node')}, {counted(len(self.elements), 'element')}>"

    def _repr_html_(self) -> str:
        rows = [(f"{np.min(each):.5g} … {np.max(each):.5g} px",) for each in (self.x, self.y)]
        return _notebook.table(repr(self).strip("<>"), ("", "region"), [("xy"[k], *row) for k, row in enumerate(rows)])

    def sensors(self, scale: float, origin: Sequence[float] = (0, 0), *, z: float = 0) -> Sensors:
        """The nodes as sensors of a model with y up: u and v of each in turn, as in `Displacements.datum`.

        Parameters
        ----------
        scale : float
            m per px.
        origin : sequence of 2
            Pixel at which the model's origin appears.
        z : float
            Of the surface that the camera sees, m.

        Returns
        -------
        Sensors
            2 x nodes displacements, at points in m.

        Examples
        --------
        >>> sensors = correlation.sensors(scale=1e-4, origin=(0, 90))
        >>> len(sensors) == 2 * len(correlation.x), bool(np.allclose(sensors.points[::2, 1], 1e-4 * (90 - correlation.y)))
        (True, True)
        """
        _require_scale(scale)
        places = np.column_stack([scale * (self.x - origin[0]), -scale * (self.y - origin[1]), 0 * self.x + z])
        return Sensors(np.repeat(places, 2, axis=0), ["x", "y"] * len(places))

    def at(self, points: ArrayLike) -> Array:
        """Displacements at any points, in the picture that was correlated last.

        Parameters
        ----------
        points : array_like, shape (k, 2)
            x and y, px.

        Returns
        -------
        ndarray, shape (k, 2)
            u and v, px, v down; NaN outside the mesh.

        Raises
        ------
        UsageError
            No picture has been correlated yet.

        Examples
        --------
        >>> moved = correlation.correlate(picture(0.3))
        >>> correlation.at([[48.0, 48.0], [-5.0, 48.0]])[:, 0].round(1)
        array([0.3, nan])
        """
        return self._native.at(points_of(points, 2, "points of a picture"))


def _correlation_of(*arguments: Any) -> Correlation:
    """A correlation made again, as a copy of one: it has correlated no picture yet."""
    correlation = Correlation.__new__(Correlation)
    correlation._make(*arguments)
    return correlation
