#!/usr/bin/env python3
"""Drawings of the documentation that no program's output is: the specimen, the way of the data, what a forecast means.

usage: drawings.py FOLDER        writes specimen.svg, workflow.svg and forecast.svg there
"""
import math
import pathlib
import random
import sys

BLUE, ORANGE, GREEN, RED, GREY = "#0072b2", "#b35900", "#00805e", "#b83a00", "#5b6673"


def text(x, y, words, colour="#1c2430", anchor="middle", size=13, weight="normal"):
    return f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" fill="{colour}" font-size="{size}" font-weight="{weight}">{words}</text>'


def path(d, colour="#1c2430", width=1.4, fill="none", dash="", end=""):
    more = (f' stroke-dasharray="{dash}"' if dash else "") + (' marker-end="url(#tip)"' if end else "")
    return f'<path d="{d}" stroke="{colour}" stroke-width="{width}" fill="{fill}"{more}/>'


def document(width, height, title, parts):
    tip = ('<marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" orient="auto">'
           '<path d="M0 0L10 5L0 10Z" fill="#1c2430"/></marker>')
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
            f'font-family="system-ui, sans-serif" role="img"><title>{title}</title><defs>{tip}</defs>'
            f'<rect width="{width}" height="{height}" fill="white"/>{"".join(parts)}</svg>\n')


def specimen():
    """The beam of the examples, mm."""
    scale, middle, foot = 0.78, 380, 150

    def at(x, y):
        return middle + scale * x, foot - scale * y

    left, right, top = at(-420, 0)[0], at(420, 0)[0], at(0, 100)[1]
    n, depth = scale * 2.5, foot - scale * 20
    parts = [path(f"M{left} {foot}H{middle - n}V{depth}H{middle + n}V{foot}H{right}V{top}H{left}Z", fill="#e4e9ef")]
    for x in (-400, 400):
        a = at(x, 0)[0]
        parts.append(path(f"M{a} {foot}l-10 17h20Z", fill="white"))
    parts.append(path(f"M{middle} {top - 44}V{top - 3}", width=2, end="tip"))
    parts.append(text(middle + 12, top - 26, "imposed displacement, 0 to 0.4 mm", anchor="start"))
    draw = random.Random(4)
    for _ in range(30):
        x, y = at(draw.uniform(-120, 120), draw.choice((2, 35, 50, 65, 80, 98)))
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="white" stroke="{BLUE}" stroke-width="1.5"/>')
    a, b = at(-120, 0)[0], at(120, 0)[0]
    parts.append(path(f"M{a} {top - 6}V{top}M{b} {top - 6}V{top}", BLUE))
    parts.append(text(a - 8, top - 8, "30 points, u_x and u_y of each", BLUE, "end"))
    parts.append(path(f"M{middle + 4} {depth + 6}L{middle + 96} {foot + 20}", GREY, 1))
    parts.append(text(middle + 100, foot + 25, "notch: the crack starts here", GREY, "start", 12))
    a, b, y = at(-400, 0)[0], at(400, 0)[0], foot + 46
    parts.append(path(f"M{a} {y}H{b}M{a} {y - 5}v10M{b} {y - 5}v10", GREY, 1))
    parts.append(text(middle, y + 17, "800 mm between the supports", GREY, size=12))
    parts.append(path(f"M{right + 12} {top}V{foot}M{right + 7} {top}h10M{right + 7} {foot}h10", GREY, 1))
    parts.append(text(right + 16, 0.5 * (top + foot) + 4, "100 mm", GREY, "start", 12))
    parts.append(text(right - 8, top + 20, "unknown: Y0, Ad", ORANGE, "end", weight=600))
    return document(775, 225, "Notched beam in three-point bending, with its sensors", parts)


def workflow():
    def box(x, y, w, h, head, lines, colour):
        inner = [text(x + w / 2, y + 22, head, colour, weight=600)]
        inner += [text(x + w / 2, y + 42 + 17 * k, line, size=12) for k, line in enumerate(lines)]
        return f'<rect x="{x}" y="{y}" width="{w}" height="{h}" rx="8" fill="#f6f8fa" stroke="{colour}" stroke-width="1.6"/>' + "".join(inner)

    parts = [box(10, 10, 190, 82, "project file", ["what is unknown, the prior,", "what to forecast"], GREY),
             box(260, 10, 210, 82, "knothe offline", ["full-order runs, once, become", "a reduced model"], BLUE),
             box(10, 150, 190, 82, "measurements", ["camera, load cell, gauges,", "a file or a network"], GREY),
             box(260, 150, 210, 82, "knothe assimilate, serve", ["each datum updates", "the posterior, in milliseconds"], BLUE),
             box(530, 112, 220, 42, "", [], GREEN), text(640, 138, "parameters, each ± …", GREEN, weight=600),
             box(530, 170, 220, 42, "", [], ORANGE), text(640, 196, "forecast, before it happens", ORANGE, weight=600),
             box(530, 228, 220, 42, "", [], RED), text(640, 254, "verdict: may it be used?", RED, weight=600),
             path("M200 51H257", end="tip"), path("M365 92V147", end="tip"), path("M200 191H257", end="tip"),
             path("M470 180C500 170 500 140 527 134", end="tip"), path("M470 191H527", end="tip"),
             path("M470 202C500 212 500 242 527 248", end="tip"),
             text(365, 258, "report and live page show all three", GREY, size=12)]
    return document(760, 280, "From project file and measurements to parameters, forecast and verdict", parts)


def forecast():
    left, right, top, foot = 70, 500, 30, 250

    def at(t, q):
        return left + (right - left) * t, foot - (foot - top) * q / 50

    def band(half, opacity):
        times = [k / 60 for k in range(61)]
        middle = [28 + 3 * math.exp(-6 * t) * math.cos(22 * t) for t in times]
        width = [half * (1 if t < 0.12 else math.exp(-9 * (t - 0.12))) + 0.6 for t in times]
        points = [at(t, m + w) for t, m, w in zip(times, middle, width)] + [at(t, m - w) for t, m, w in zip(times, middle, width)][::-1]
        return f'<path d="M{"L".join(f"{x:.1f} {y:.1f}" for x, y in points)}Z" fill="{ORANGE}" fill-opacity="{opacity}"/>'

    y, h = at(0, 40)[1], at(0.45, 0)[0]
    parts = [path(f"M{left} {top}V{foot}H{right}"), band(18, 0.22), band(9, 0.3),
             path(f"M{left} {y}H{right}", dash="7 4"), text(right, y - 6, "threshold", anchor="end", weight=600),
             path(f"M{h} {top}V{foot}", GREEN, dash="2 3"), text(h + 6, foot - 8, "horizon", GREEN, "start", weight=600),
             text(0.5 * (left + h), top - 10, "forecasts: the horizon lies ahead", size=12),
             text(0.5 * (h + right), top - 10, "estimates: the data have passed it", GREY, size=12),
             text(0.5 * (left + right), foot + 24, "when it was said (model time of the last datum)", GREY, size=12),
             f'<g transform="translate(24 {0.5 * (top + foot)}) rotate(-90)">{text(0, 0, "the same number: the length at the horizon", GREY, size=12)}</g>']
    # The density of an early one, on its side.
    x0, early = 560, at(0.1, 0)[0]
    parts.append(path(f"M{early} {top}V{foot}", GREY, 1, dash="4 3"))
    values = [k / 2 for k in range(101)]
    density = [110 * math.exp(-0.5 * ((q - 30) / 9) ** 2) for q in values]
    line = "L".join(f"{x0 + d:.1f} {at(0, q)[1]:.1f}" for q, d in zip(values, density))
    above = "L".join(f"{x0 + d:.1f} {at(0, q)[1]:.1f}" for q, d in zip(values, density) if q >= 40)
    parts += [f'<path d="M{x0} {y:.1f}L{above}L{x0} {top}Z" fill="{RED}" fill-opacity="0.35"/>', path(f"M{line}", ORANGE, 2),
              path(f"M{x0} {top}V{foot}"), path(f"M{x0} {y}H{x0 + 130}", dash="7 4"),
              text(x0 + 56, y - 14, "P(q &gt; threshold)", RED, "start", weight=600),
              text(x0 + 60, foot + 24, "one early forecast: a density", GREY, size=12)]
    return document(760, 285, "A forecast over the steps: bands that narrow, the horizon, the threshold", parts)


if __name__ == "__main__":
    folder = pathlib.Path(sys.argv[1])
    for make in (specimen, workflow, forecast):
        (folder / f"{make.__name__}.svg").write_text(make())
