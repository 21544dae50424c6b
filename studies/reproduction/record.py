"""What the study says of a figure of the paper, and how it is written down: JSON lines, and one JSON file, of which `knothe report` makes
the page."""
import json
import math
import os
import platform
from dataclasses import dataclass, field
from pathlib import Path

LABELS = ("Y₀", "A_d")
LARGEST_DENSITIES = 30  # more cannot be told apart
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def shortened(values, digits=5):
    """Numbers of a drawing, None for a gap: a page holds many."""
    return [None if value is None or not math.isfinite(value) else float(f"{value:.{digits}g}") for value in values]


class Chart:
    """Curves over one axis. A colour is a name or a number of the page's theme; the curves' own order where none is given."""

    def __init__(self, title, x, y, **more):
        """Axes as "quantity [unit]". more: logarithmic=True; least, where the vertical one begins."""
        self.entry = {"kind": "chart", "title": title, "x": x, "y": y, **more, "curves": [], "bands": [], "marks": []}

    def curve(self, label, y, x=None, **look):
        """look: "line", points="points" (dots alone), bars; dashed=True; width; colour. None in y is a gap."""
        y = list(y)
        self.entry["curves"].append({"label": label, "x": shortened(range(len(y)) if x is None else x), "y": shortened(y), **look})
        return self

    def band(self, label, low, high, x=None, **look):
        low = list(low)
        self.entry["bands"].append({"label": label, "x": shortened(range(len(low)) if x is None else x), "low": shortened(low),
                                    "high": shortened(high), **look})
        return self

    def mark(self, label, colour="faint", **at):
        """A line at x=… or y=…"""
        self.entry["marks"].append({"label": label, "colour": colour, **{name: float(value) for name, value in at.items()}})
        return self

    def record(self, _):
        return self.entry


class Densities:
    """Successive densities of one number, (points, values) by step; SI, or a number of its own unit."""

    def __init__(self, title, label, units, densities, prior=None, truth=None):
        stride = -(-len(densities) // LARGEST_DENSITIES)
        shown = [i for i in range(len(densities)) if (len(densities) - 1 - i) % stride == 0]
        self.entry = {"kind": "densities", "title": title, "label": label, "units": units,
                      "steps": [{"step": i, **self._density(densities[i])} for i in shown]}
        if prior is not None:
            self.entry["prior"] = self._density(prior)
        if truth is not None:
            self.entry["truth"] = float(truth)

    @staticmethod
    def _density(density):
        points, values = density
        return {"points": shortened(points, 7), "density": shortened(values)}

    def record(self, _):
        return self.entry


class Map:
    """A face with a value at each node, or moved by a field of two components of which the first is the value; sensors on it."""

    def __init__(self, title, face, label="", units="", value=None, field=None, signed=False, sensors=()):
        """face: its `points` (m) and `cells`. sensors: (x, y, words)."""
        self.face = face
        self.entry = {"kind": "map", "title": title, "label": label, "units": units, "signed": signed}
        if value is not None:
            self.entry["value"] = shortened(value, 4)
        if field is not None:
            self.entry["field"] = {name: shortened(part, 4) for name, part in zip("xy", field)}
        if len(sensors):
            self.entry["sensors"] = [{"x": float(x), "y": float(y), "words": words} for x, y, words in sensors]

    def record(self, faces):
        """`faces`: those of all drawings, each once; the drawing has its number."""
        if not any(face is self.face for face in faces):
            faces.append(self.face)
        return {**self.entry, "face": next(i for i, face in enumerate(faces) if face is self.face)}


@dataclass
class Row:
    """Paper, here, and why the two differ: a line of a figure's table. `unit` is "1" for a pure number."""

    quantity: str
    unit: str
    paper: str
    here: str
    why: str
    paper_value: float | None = None
    here_value: float | None = None


@dataclass
class Figure:
    """One figure of the paper, or a group that belongs together."""

    number: str  # of the paper: "5", "6-7"; a word for what goes beyond it
    title: str
    setting: str  # what was computed, and what was chosen
    panels: list[tuple[list, str]] = field(default_factory=list)  # drawings side by side, and what is to be seen
    rows: list[Row] = field(default_factory=list)
    tables: list[tuple[str, list[str], list[list[str]]]] = field(default_factory=list)  # caption, header, rows
    data: dict[str, list[float]] = field(default_factory=dict)  # the series behind the plots

    @property
    def heading(self) -> str:
        return f"Fig. {self.number} of the paper: {self.title}" if set(self.number) <= set("0123456789-") else self.title

    def row(self, quantity, unit, paper, here, why, here_value=None, paper_value=None):
        self.rows.append(Row(quantity, unit, paper, here, why, paper_value, None if here_value is None else float(here_value)))

    def panel(self, caption, *drawings):
        self.panels.append((drawings, caption))

    def series(self, **named):
        for name, values in named.items():
            self.data[name] = [float(value) for value in values]

    def row_records(self):
        records = []
        for row in self.rows:
            record = {"figure": self.number, "quantity": row.quantity, "unit": row.unit, "paper": row.paper, "here": row.here,
                      "why": row.why}
            for name in ("paper_value", "here_value"):
                if getattr(row, name) is not None:
                    record[name] = getattr(row, name)
            records.append(record)
        return records

    def record(self, faces):
        entry = {"figure": self.number, "title": self.title, "heading": self.heading, "setting": self.setting,
                 "panels": [{"caption": caption, "drawings": [each.record(faces) for each in drawings]} for drawings, caption in self.panels],
                 "rows": self.row_records()}
        if self.tables:
            entry["tables"] = [dict(zip(("caption", "header", "rows"), table)) for table in self.tables]
        return entry | ({"data": self.data} if self.data else {})


def readable(value: float, digits: int = 3) -> str:
    """So many significant digits, without an exponent where that is short."""
    if not math.isfinite(value):
        raise ValueError(f"{value} is no number to print")
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if not -4 <= int(exponent) < 6:
        return mantissa.replace("-", "−") + "·10" + str(int(exponent)).translate(_SUPERSCRIPT)
    return f"{value:.{max(0, digits - 1 - int(exponent))}f}".replace("-", "−")


def with_uncertainty(mean: float, std: float) -> str:
    """The standard deviation with two digits, the mean with as many decimals."""
    if not std > 0:
        return readable(mean, 4) + " ± 0"
    decimals = min(max(1 - int(f"{std:.1e}".split("e")[1]), 0), 12)
    return f"{mean:.{decimals}f} ± {std:.{decimals}f}".replace("-", "−")


def extent(values, scale=1.0) -> str:
    """ "least to most", two digits each."""
    low, high = readable(scale * min(values), 2), readable(scale * max(values), 2)
    return low if low == high else f"{low} to {high}"


def steps_text(steps) -> str:
    return "none" if len(steps) == 0 else str(steps[0]) if len(steps) == 1 else f"{steps[0]} to {steps[-1]}"


def machine() -> dict:
    try:
        lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return {"system": f"{platform.system()} {platform.release()}", "processor": names[0] if names else platform.machine(),
            "cores": os.cpu_count(), "python": platform.python_version()}


_FIRST = (("Y₀, truth 1", "8-9", "Y₀: maximum", ""), ("A_d, truth 1", "8-9", "A_d: maximum", ""),
          ("final crack length", "13", "crack length at the end, mean", " mm"),
          ("the same, coarse beam on soft supports", "13", "the same, coarse", " mm"), ("slowest step", "13", "slowest step", " s"))


def first_numbers(figures) -> list:
    """What a reader asks first: quantity, paper, here."""
    return [[name, row.paper + unit, readable(row.here_value) + unit] for name, number, begins, unit in _FIRST
            for figure in figures if figure.number == number for row in figure.rows if row.quantity.startswith(begins)]


def study_record(figures, about) -> dict:
    faces = []
    record = {"created_by": about["program"], "publication": "Rubio, Chamoin, Louf, Comptes Rendus Mécanique 347 (2019) 762–779",
              **{key: about[key] for key in ("quick", "seed", "repetitions", "reference")}, "machine": machine(),
              "elapsed_s": about["elapsed_s"], "first": first_numbers(figures), "figures": [figure.record(faces) for figure in figures]}
    return record | {"faces": [{"points": [shortened(point, 6) for point in face.points], "cells": [[int(i) for i in cell] for cell in face.cells]}
                               for face in faces]}


def write(folder, figures, about) -> str:
    """The record, whole or not at all. Gives its name."""
    path = folder / "reproduce.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    fresh.write_text(json.dumps(study_record(figures, about), ensure_ascii=False, allow_nan=False) + "\n")
    fresh.replace(path)
    return str(path)
