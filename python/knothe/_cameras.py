"""A camera, and calibration files as other programs write them and `knothe dic` reads them (knothe/imaging/camera/calibration_file.hpp)."""
from __future__ import annotations

import math
import os
import pathlib
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from knothe import _bundle
from knothe._errors import IoError, UsageError
from knothe._values import Array, ByValue, numbers

_WRITERS = {".yaml": "OpenCV", ".yml": "OpenCV", ".xml": "DICe", ".caldat": "MatchID"}


@dataclass(frozen=True, eq=False)
class Camera(ByValue):
    """A camera: pinhole, skew, and OpenCV's radial and tangential distortion.

    Attributes
    ----------
    lens : ndarray, shape (13,)
        fx, fy, cx, cy, skew (px), k1 ... k6, p1, p2.
    rotation : ndarray, shape (3, 3)
        World to camera.
    translation : ndarray, shape (3,)
        X_c = R X + t, in the target's unit of length.
    size : (int, int)
        Width and height of its pictures, px.

    Examples
    --------
    >>> camera = knothe.calibration.Camera(np.array([800, 800, 320, 240, *np.zeros(9)]), np.eye(3), np.zeros(3), (640, 480))
    >>> camera.project([[0.1, 0.0, 1.0]])
    array([[400., 240.]])
    """

    lens: Array
    rotation: Array
    translation: Array
    size: tuple[int, int]

    @property
    def matrix(self) -> Array:
        """OpenCV's camera matrix, shape (3, 3).

        Examples
        --------
        >>> knothe.calibration.Camera(np.arange(13.0), np.eye(3), np.zeros(3), (640, 480)).matrix
        array([[0., 4., 2.],
               [0., 1., 3.],
               [0., 0., 1.]])
        """
        fx, fy, cx, cy, skew = self.lens[:5]
        return np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1]])

    @property
    def distortion(self) -> Array:
        """In OpenCV's order: k1, k2, p1, p2, k3 ... k6; shape (5,), or (8,) where k4 to k6 are not 0.

        Examples
        --------
        >>> knothe.calibration.Camera(np.arange(13.0), np.eye(3), np.zeros(3), (640, 480)).distortion
        array([ 5.,  6., 11., 12.,  7.,  8.,  9., 10.])
        """
        k, p = self.lens[5:11], self.lens[11:13]
        return np.array([*k[:2], *p, *(k[2:] if k[3:].any() else k[2:3])])

    def project(self, points: ArrayLike) -> Array:
        """Where points of the world are in the picture.

        Parameters
        ----------
        points : array_like, shape (n, 3)

        Returns
        -------
        ndarray, shape (n, 2)
            Pixels, whose centres are at whole numbers; NaN behind the camera.

        Examples
        --------
        >>> camera = knothe.calibration.Camera(np.array([800, 800, 320, 240, *np.zeros(9)]), np.eye(3), np.zeros(3), (640, 480))
        >>> camera.project([[0.0, 0.0, -1.0]])
        array([[nan, nan]])
        """
        world = np.atleast_2d(numbers(points, "points"))
        return _bundle.project(np.broadcast_to(self.lens, (len(world), 13)), world @ self.rotation.T + self.translation)[0]


def format_of(path: "str | os.PathLike[str]", cameras: int, has_skew: bool, has_denominator: bool) -> str:
    """By how the name ends; refuses what the format does not have. has_denominator: k4 to k6."""
    suffix = pathlib.Path(path).suffix
    if suffix not in _WRITERS:
        raise UsageError(f"{os.fspath(path)}: a calibration is saved as .yaml (OpenCV: one or two cameras), .xml (DICe: any number) or .caldat "
                         "(MatchID: two, with skew)")
    program = _WRITERS[suffix]
    if program != "MatchID" and has_skew:
        raise UsageError(f"{os.fspath(path)}: {program}'s files have no skew: save as .caldat, or calibrate without skew")
    if program == "MatchID" and has_denominator:
        raise UsageError(f"{os.fspath(path)}: MatchID's files have k1 to k3 only: save as .yaml or .xml, or calibrate without k4 to k6")
    if program == "MatchID" and cameras != 2 or program == "OpenCV" and cameras > 2:
        raise UsageError(f"{os.fspath(path)}: {program}'s file is one of two cameras, here are {cameras}: save as .xml")
    return program


def text_of(cameras: Sequence[Camera], path: "str | os.PathLike[str]") -> str:
    """The file's text."""
    program = format_of(path, len(cameras), any(camera.lens[4] != 0 for camera in cameras), any(np.any(camera.lens[8:11]) for camera in cameras))
    if program == "OpenCV":
        return _opencv(cameras)
    return _dice(cameras) if program == "DICe" else _matchid(cameras)


def write(path: "str | os.PathLike[str]", text: str) -> None:
    """The whole file, or the one that was there before."""
    target = pathlib.Path(path)
    try:
        with tempfile.NamedTemporaryFile("w", encoding="utf-8", dir=target.parent, prefix=f".{target.name}.", delete=False) as file:
            file.write(text)
        os.chmod(file.name, 0o644)
        os.replace(file.name, target)
    except OSError as error:
        raise IoError(f"{target}: cannot be written: {error.strerror}") from error


def covariance_text(names: Sequence[str], covariance: Array) -> str:
    """A row for each parameter, and a column: what `calibration_std` reads."""
    lines = [",".join(["parameter", *names])]
    lines += [",".join([name, *(repr(float(value)) for value in row)]) for name, row in zip(names, covariance)]
    return "\n".join(lines) + "\n"


def _opencv(cameras: Sequence[Camera]) -> str:
    def matrix(name: str, values: Array) -> str:
        rows, columns = values.shape
        data = ", ".join(repr(float(value)) for value in values.ravel())
        return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {data} ]\n"

    head = "%YAML:1.0\n---\n"
    if len(cameras) == 1:
        return head + matrix("camera_matrix", cameras[0].matrix) + matrix("distortion_coefficients", cameras[0].distortion[None])
    parts = [matrix(f"M{c}", camera.matrix) + matrix(f"D{c}", camera.distortion[None]) for c, camera in enumerate(cameras, 1)]
    return head + "".join(parts) + matrix("R", cameras[1].rotation) + matrix("T", cameras[1].translation[:, None])


def _dice(cameras: Sequence[Camera]) -> str:
    def parameter(name: str, value: object, kind: str = "double") -> str:
        return f'<Parameter name="{name}" type="{kind}" value="{value}" />\n'

    lines = ["<ParameterList>\n", parameter("xml_file_format", "DICe_xml_camera_system_file", "string")]
    for c, camera in enumerate(cameras):
        fx, fy, cx, cy, _, *radial, p1, p2 = map(float, camera.lens)
        lines += [f'<ParameterList name="CAMERA {c}">\n', parameter("LENS_DISTORTION_MODEL", "OPENCV_LENS_DISTORTION", "string")]
        lines += [parameter(name, repr(value)) for name, value in zip("CX CY FX FY".split(), (cx, cy, fx, fy))]
        lines += [parameter(f"K{k}", repr(value)) for k, value in enumerate(radial, 1)] + [parameter("P1", repr(p1)), parameter("P2", repr(p2))]
        lines += [parameter(f"T{axis}", repr(float(value))) for axis, value in zip("XYZ", camera.translation)]
        lines += [parameter("IMAGE_WIDTH", camera.size[0], "int"), parameter("IMAGE_HEIGHT", camera.size[1], "int")]
        lines += ['<ParameterList name="rotation_3x3_matrix">\n']
        lines += [parameter(f"ROW {k}", "{" + ", ".join(repr(float(value)) for value in row) + "}", "string")
                  for k, row in enumerate(camera.rotation)]
        lines += ["</ParameterList>\n", "</ParameterList>\n"]
    return "".join([*lines, "</ParameterList>\n"])


def _matchid(cameras: Sequence[Camera]) -> str:
    lines = []
    for c, camera in enumerate(cameras):
        fx, fy, cx, cy, skew, k1, k2, k3, _, _, _, p1, p2 = map(float, camera.lens)
        lines += [f"Cam{c}_{name} [{unit}];{value!r}" for name, unit, value in (
            ("Fx", "pixels", fx), ("Fy", "pixels", fy), ("Fs", "pixels", skew), ("Kappa 1", "-", k1), ("Kappa 2", "-", k2), ("Kappa 3", "-", k3),
            ("P1", "-", p1), ("P2", "-", p2), ("Cx", "pixels", cx), ("Cy", "pixels", cy))]
    r, t = cameras[1].rotation, cameras[1].translation
    # R = Rz(psi) Ry(phi) Rx(theta)
    angles = math.atan2(r[2, 1], r[2, 2]), math.asin(max(-1.0, min(1.0, -float(r[2, 0])))), math.atan2(r[1, 0], r[0, 0])
    lines += [f"T{axis} [mm];{float(value)!r}" for axis, value in zip("xyz", t)]
    lines += [f"{name} [deg];{math.degrees(angle)!r}" for name, angle in zip(("Theta", "Phi", "Psi"), angles)]
    return "\n".join(lines) + "\n"
