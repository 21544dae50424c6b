"""Whose is a bias of image correlation? Pictures made from a real one with known displacements, and subsets.

known_displacements.py KNOTHE REFERENCE DEFORMED FOLDER prints JSON: the mean errors of `knothe dic` on pictures made from REFERENCE,
and how far it is from a correlation of independent subsets, written here, on the real pair. Nothing here knows how knothe
interpolates: pictures are moved as sums of waves, which is exact for whatever pixels hold, and subsets read a picture that was
refined fourfold in the same way.
"""
import csv
import json
import pathlib
import subprocess
import sys

import numpy
from PIL import Image
from scipy import ndimage

REGION = (100, 240, 1600, 1040)
POINTS = numpy.array([(x, y) for x in range(900, 1560, 30) for y in range(270, 1000, 30)], float)  # away from the crack
HALF_SUBSET = 20  # px
REFINEMENT = 4


def read(path):
    return numpy.array(Image.open(path)).astype(float)


def write(path, levels):
    Image.fromarray(numpy.clip(numpy.round(levels), 0, 65535).astype(numpy.uint16)).save(path)


def frequencies(shape):
    return numpy.fft.fftfreq(shape[1])[None, :], numpy.fft.fftfreq(shape[0])[:, None]


def shifted(picture, u, v):
    """g(x + u, y + v) = f(x, y), periodic: the region is far enough from the borders."""
    x, y = frequencies(picture.shape)
    return numpy.fft.ifft2(numpy.fft.fft2(picture) * numpy.exp(-2j * numpy.pi * (u * x + v * y))).real


def refined(picture):
    """The periodic interpolant of the pixels at REFINEMENT times as many."""
    rows, columns = picture.shape
    spectrum = numpy.fft.fftshift(numpy.fft.fft2(picture))
    fine = numpy.zeros((REFINEMENT * rows, REFINEMENT * columns), complex)
    top, left = [REFINEMENT * n // 2 - n // 2 for n in (rows, columns)]
    fine[top:top + rows, left:left + columns] = spectrum
    return numpy.fft.ifft2(numpy.fft.ifftshift(fine)).real * REFINEMENT ** 2


class Interpolant:
    """Of a part of a picture, about the region."""

    def __init__(self, picture):
        self.origin = numpy.array([REGION[1] - 60, REGION[0] - 60])
        part = picture[self.origin[0]:REGION[3] + 60, self.origin[1]:REGION[2] + 60]
        self.coefficients = ndimage.spline_filter(refined(part), 5)

    def __call__(self, x, y):
        at = [REFINEMENT * (y - self.origin[0]), REFINEMENT * (x - self.origin[1])]
        return ndimage.map_coordinates(self.coefficients, at, order=5, prefilter=False)


def wavy(x, y):
    """A smooth field over all fractions of a pixel."""
    return 0.5 + 0.6 * numpy.sin(2 * numpy.pi * y / 500), 0.5 + 0.6 * numpy.sin(2 * numpy.pi * x / 600)


def moved_by_field(picture):
    y, x = numpy.mgrid[REGION[1] - 20:REGION[3] + 20, REGION[0] - 20:REGION[2] + 20].astype(float)
    material_x, material_y = x, y
    for _ in range(30):  # x = X + u(X)
        u, v = wavy(material_x, material_y)
        material_x, material_y = x - u, y - v
    moved = picture.copy()
    moved[REGION[1] - 20:REGION[3] + 20, REGION[0] - 20:REGION[2] + 20] = Interpolant(picture)(material_x, material_y)
    return moved


def by_knothe(program, reference, deformed, folder):
    (folder / "points.csv").write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in POINTS))
    subprocess.run([program, "dic", reference, deformed, "--roi", ",".join(map(str, REGION)), "--element-size", "25", "--prefilter", "1",
                    "--at", folder / "points.csv", "-o", folder / "u.csv"], check=True, capture_output=True)
    with open(folder / "u.csv", newline="") as file:
        return numpy.array([[float(row["u"]), float(row["v"])] for row in csv.DictReader(file)])  # not a number where not measured


def mean_error(found, exact):
    error = found - exact
    error = error[numpy.isfinite(error[:, 0])]
    assert len(error) > 500, f"{len(error)} points were measured"
    return error.mean(axis=0).tolist()


def by_subsets(reference, deformed, points, start):
    """An affine motion, a gain and an offset for each window by itself: Gauss-Newton with the gradient of the reference, which does not
    take the noise of the deformed picture for a motion. Both pictures are smoothed by a Gaussian of 1 px, as knothe's are."""
    f = ndimage.gaussian_filter(read(reference), 1)
    g = Interpolant(ndimage.gaussian_filter(read(deformed), 1))
    fine = Interpolant(f)
    offsets = numpy.arange(-HALF_SUBSET, HALF_SUBSET + 1)
    dx, dy = [part.ravel().astype(float) for part in numpy.meshgrid(offsets, offsets)]
    found = []
    for (x, y), (u, v) in zip(points, start):
        px, py = x + dx, y + dy
        values = f[py.astype(int), px.astype(int)]
        step = 1e-3
        along = (fine(px + step, py) - fine(px - step, py)) / (2 * step)
        down = (fine(px, py + step) - fine(px, py - step)) / (2 * step)
        one = numpy.ones_like(dx)
        rows = numpy.stack([along, along * dx, along * dy, down, down * dx, down * dy, values, one], axis=1)
        p = numpy.array([u, 0, 0, v, 0, 0])
        for _ in range(20):
            seen = g(px + p[0] + p[1] * dx + p[2] * dy, py + p[3] + p[4] * dx + p[5] * dy)
            gain, offset = numpy.polyfit(seen, values, 1)
            change = numpy.linalg.lstsq(rows, values - gain * seen - offset, rcond=None)[0][:6]
            p = p + change
            if abs(change[[0, 3]]).max() < 1e-5:
                break
        found.append(p[[0, 3]])
    return numpy.array(found)


def main(program, reference, deformed, folder):
    folder = pathlib.Path(folder)
    made = str(folder / "made.tif")
    noisy = str(folder / "noisy.tif")
    first = read(reference)
    random = numpy.random.default_rng(1)
    result = {"shifts": [], "noisy": []}
    for u, v in ((0.25, 0.75), (0.4, 0.1), (1.2, -0.35)):
        moved = shifted(first, u, v)
        write(made, moved)
        result["shifts"].append(mean_error(by_knothe(program, reference, made, folder), (u, v)))
        write(noisy, first + random.normal(0, 150, first.shape))
        write(made, moved + random.normal(0, 150, first.shape))
        result["noisy"].append(mean_error(by_knothe(program, noisy, made, folder), (u, v)))
    write(made, moved_by_field(first))
    exact = numpy.stack(wavy(*POINTS.T), axis=1)
    found = by_knothe(program, reference, made, folder)
    result["field"] = {"mean": mean_error(found, exact), "rms": numpy.sqrt(numpy.nanmean((found - exact) ** 2, axis=0)).tolist()}
    whole = by_knothe(program, reference, deformed, folder)
    measured = numpy.isfinite(whole[:, 0])
    whole = whole[measured]
    apart = whole - by_subsets(reference, deformed, POINTS[measured], whole)
    result["pair"] = {"mean": apart.mean(axis=0).tolist(), "mean_std": (apart.std(axis=0) / len(apart) ** 0.5).tolist(),
                      "displacement": whole.mean(axis=0).tolist(), "points": int(measured.sum())}
    print(json.dumps(result))


if __name__ == "__main__":
    main(*sys.argv[1:])
