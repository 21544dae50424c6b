"""What three pictures of a beam in bending say without a model: where roller and support are, and how its two halves move.

usage: halves.py REFERENCE.tif FIELDS.h5     FIELDS.h5: of `knothe dic … --crack -o FIELDS.h5`. Prints one line of JSON; px.
Needs h5py, numpy, scipy and Pillow.
"""
import json
import sys

import h5py
import numpy as np
from PIL import Image
from scipy.optimize import least_squares

GAP = 60  # px on either side of the crack that belong to neither half
SMOOTH = np.ones(15) / 15  # px


def beam_edges(picture):
    """Rows of the upper and the lower edge, where the mean of a row is half-way between beam and background."""
    columns = slice(1000, 1300)  # without roller and support
    rows = np.convolve(picture[:, columns].mean(axis=1), SMOOTH, "same")
    bright = np.flatnonzero(rows > 0.5 * np.median(rows))
    return int(bright[0]), int(bright[-1])


def outline(picture, rows, columns):
    """Ends [x, y] of the brightest stretch of each row between two columns, where they are not those columns."""
    points, (low, high) = [], columns
    for y in rows:
        row = np.convolve(picture[y], SMOOTH, "same")
        bright = np.flatnonzero(row[low:high] > 1.25 * np.median(row)) + low
        if len(bright) < 30:
            continue
        stretch = max(np.split(bright, np.flatnonzero(np.diff(bright) > 40) + 1), key=len)
        points += [(x, y) for x in (stretch[0], stretch[-1]) if low + 20 < x < high - 20]
    return np.array(points, float)


def circle(points, start):
    """Centre and radius through most of the points (Cauchy's weights)."""
    fit = least_squares(lambda c: np.hypot(points[:, 0] - c[0], points[:, 1] - c[1]) - c[2], start, loss="cauchy", f_scale=3)
    return fit.x


def rigid_motion(points, displacement):
    """[shift right, shift down, turn] about the origin, elements of the tail left out; root mean square of what is left."""
    rows = np.zeros((2 * len(points), 3))
    rows[0::2, 0], rows[0::2, 2] = 1, -points[:, 1]
    rows[1::2, 1], rows[1::2, 2] = 1, points[:, 0]
    values, use = displacement.ravel(), np.full(2 * len(points), True)
    for _ in range(6):
        motion, *_ = np.linalg.lstsq(rows[use], values[use], rcond=None)
        left = values - rows @ motion
        use = np.abs(left) < 4 * 1.4826 * np.median(np.abs(left))
    return motion, float(np.sqrt((left[use] ** 2).mean()))


def turn_std(points, displacement, parts=8):
    """Of the turn of a rigid motion: what is left of it is no noise, so by leaving out one strip of the columns at a time."""
    strip = np.minimum((np.argsort(np.argsort(points[:, 0])) * parts) // len(points), parts - 1)
    turns = np.array([rigid_motion(points[strip != k], displacement[strip != k])[0][2] for k in range(parts)])
    return float(np.sqrt((parts - 1) / parts * ((turns - turns.mean()) ** 2).sum()))


def on_path(path, length):
    """Point of a crack's path, from the mouth on, at this length along it."""
    along = np.r_[0, np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))]
    return [float(np.interp(length, along, path[:, k])) for k in (0, 1)]


def halves(file, picture, lower_edge):
    """The two halves of a picture's beam as rigid bodies that turn about a hinge."""
    nodes, displacement = file["picture_frame/nodes"][:], file["picture_frame/displacement"][picture]
    path = file[f"crack/paths/{picture}"][:]
    measured = np.zeros(len(nodes), bool)
    measured[np.unique(file["mesh/cells"][:][file["elements/valid"][picture] > 0])] = True
    order = np.argsort(path[:, 1])
    crack = np.interp(nodes[:, 1], path[order, 1], path[order, 0])
    sides = [measured & (nodes[:, 0] < crack - GAP), measured & (nodes[:, 0] > crack + GAP)]
    motions, rests = zip(*(rigid_motion(nodes[side], displacement[side]) for side in sides))
    jump = motions[1] - motions[0]
    opening = path[np.isfinite(path[:, 4])]
    length, length_std = float(file["crack/length"][picture]), float(file["crack/length_std"][picture])
    return {"rotation": float(-jump[2]), "rotation_std": float(np.hypot(*(turn_std(nodes[side], displacement[side]) for side in sides))),
            "hinge_y": float(jump[0] / jump[2]), "opening_at_lower_edge": float(jump[0] - jump[2] * lower_edge),
            "rest": list(rests), "tip": file["crack/tip"][picture].tolist(), "length": length, "length_std": length_std,
            "tip_interval": [on_path(path, length + 1.96 * sign * length_std) for sign in (-1, 1)], "path": path[:, :2].tolist(),
            "openings": opening[:, [1, 4, 5]].tolist()}


def look(reference, fields):
    picture = np.array(Image.open(reference)).astype(float)
    upper, lower = beam_edges(picture)
    roller = circle(outline(picture, range(5, upper - 18, 3), (300, 1200)), [720, -150, 300])
    support = circle(outline(picture, range(lower + 8, len(picture) - 2, 3), (1300, picture.shape[1])), [1590, lower + 250, 260])
    with h5py.File(fields) as file:
        pictures = [halves(file, k, lower) for k in range(len(file["time"]))]
    ratio = pictures[1]["rotation"] / pictures[0]["rotation"]
    return {"edges": [upper, lower], "roller": roller.tolist(), "support": support.tolist(), "pictures": pictures,
            "rotation_ratio": ratio, "rotation_ratio_std": ratio * float(np.hypot(*(p["rotation_std"] / p["rotation"] for p in pictures)))}


if __name__ == "__main__":
    print(json.dumps(look(*sys.argv[1:3])))
