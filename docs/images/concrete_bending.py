"""The picture of docs/benchmarks/concrete-beam.md.

usage: concrete_bending.py REFERENCE.tif FIELDS.h5 PICTURE.svg     as halves.py of examples/concrete_bending
"""
import math
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "examples" / "concrete_bending"))
import halves  # noqa: E402
from panel import Panel, picture  # noqa: E402

COLOURS = ("#2b6cb0", "#c05621")
NAMES = ("0160", "0179")


def arc(panel, centre_x, centre_y, radius):
    """A circle, as far as it is in the picture."""
    points = [(centre_x + radius * math.cos(k * math.pi / 180), centre_y + radius * math.sin(k * math.pi / 180)) for k in range(361)]
    inside = [(x, -y) for x, y in points if 0 <= x <= 1737 and 0 <= y <= 1157]
    for begin, end in zip(inside, inside[1:]):
        if math.dist(begin, end) < 0.1 * radius:
            panel.path(*zip(begin, end), 'fill="none" stroke="#555"')


def draw(seen):
    """Left: what is seen where, px; right: the opening along the crack, and that of two rigid halves about the hinge."""
    left = Panel((55, 60, 400, 266), (0, 1737), (-1157, 0))
    for edge in seen["edges"]:
        left.path([0, 1737], [-edge] * 2, 'stroke="#999"')
    arc(left, *seen["roller"])
    arc(left, *seen["support"])
    right = Panel((520, 60, 260, 266), (150, 1100), (0, 27))
    for p, colour, name, factor in zip(seen["pictures"], COLOURS, NAMES, (10, 1)):
        path = [point for point in p["path"] if point[1] >= p["tip"][1]]
        left.path([x for x, _ in path], [-y for _, y in path], f'fill="none" stroke="{colour}" stroke-width="2"')
        left.dot(p["tip"][0], -p["tip"][1], f'fill="{colour}"')
        ends = (p["hinge_y"], seen["edges"][1])
        right.path(ends, [factor * p["rotation"] * (y - p["hinge_y"]) for y in ends], f'stroke="{colour}" stroke-dasharray="5 3"')
        for y, opening, _ in p["openings"]:
            right.dot(y, factor * opening, f'fill="{colour}"')
    left.axes(range(0, 1737, 400), (), "edges, roller, support; crack of 0160 (blue) and 0179 (orange)", "px")
    right.axes(range(200, 1101, 200), range(0, 26, 5), "opening, px (of 0160 ten times)", "place along the depth, px")
    return picture([left, right])


if __name__ == "__main__":
    pathlib.Path(sys.argv[3]).write_text(draw(halves.look(*sys.argv[1:3])))
