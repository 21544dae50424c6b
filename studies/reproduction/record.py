"""What the study says of a figure of the paper, and how it is written down: JSON lines, one JSON file, one page."""
import base64
import html
import io
import json
import math
import os
import platform
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as pyplot  # noqa: E402
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter  # noqa: E402

pyplot.rcParams.update({"font.size": 9, "axes.grid": True, "grid.alpha": 0.25, "legend.frameon": False, "legend.fontsize": 8,
                        "axes.titlesize": 10, "figure.constrained_layout.use": True, "savefig.dpi": 130})
COLOURS = [f"C{i}" for i in range(10)]
TRUTH = "#c44e52"
LABELS = ("Y₀", "A_d")
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


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
    panels: list[tuple[bytes, str]] = field(default_factory=list)  # PNG and caption
    rows: list[Row] = field(default_factory=list)
    tables: list[tuple[str, list[str], list[list[str]]]] = field(default_factory=list)  # caption, header, rows
    data: dict[str, list[float]] = field(default_factory=dict)  # the series behind the plots

    @property
    def heading(self) -> str:
        return f"Fig. {self.number}. {self.title}" if set(self.number) <= set("0123456789-") else self.title

    def row(self, quantity, unit, paper, here, why, here_value=None, paper_value=None):
        self.rows.append(Row(quantity, unit, paper, here, why, paper_value, None if here_value is None else float(here_value)))

    def panel(self, drawn, caption):
        """Keeps a figure of matplotlib as PNG, and closes it."""
        buffer = io.BytesIO()
        drawn.savefig(buffer, format="png")
        pyplot.close(drawn)
        self.panels.append((buffer.getvalue(), caption))

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

    def record(self):
        entry = {"figure": self.number, "title": self.title, "setting": self.setting, "rows": self.row_records()}
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


def log_axis(axis):
    """Logarithmic, labelled at 1, 2 and 5 of each decade."""
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


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


def study_record(figures, about) -> dict:
    return {"created_by": about["program"], "publication": "Rubio, Chamoin, Louf, Comptes Rendus Mecanique 347 (2019) 762-779",
            **{key: about[key] for key in ("quick", "seed", "repetitions", "reference")}, "machine": machine(),
            "elapsed_s": about["elapsed_s"], "figures": [figure.record() for figure in figures]}


_STYLE = """body{font:16px/1.5 sans-serif;max-width:1080px;margin:2em auto;padding:0 1em;color:#1b2a33}
img{max-width:100%}figure{margin:1em 0}figcaption,.caption{color:#53646f;font-size:.9em}h2{margin-top:2.2em}
table{border-collapse:collapse;font-size:.9em;margin:1em 0}td,th{border-top:1px solid #cfd8df;padding:.35em .6em;text-align:left;
vertical-align:top}.cards{display:flex;flex-wrap:wrap;gap:1em}.cards div{border:1px solid #cfd8df;border-radius:6px;padding:.6em 1em}
.cards b{font-size:1.4em;display:block}"""
_CARDS = (("Y₀, truth 1", "8-9", "Y₀: maximum", ""), ("A_d, truth 1", "8-9", "A_d: maximum", ""),
          ("Final crack length", "13", "crack length at the end, mean", " mm"),
          ("the same, coarse beam on soft supports", "13", "the same, coarse", " mm"), ("Slowest step", "13", "slowest step", " s"))


def _table(header, rows) -> str:
    cells = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>\n" for row in rows)
    head = "<tr>" + "".join(f"<th>{html.escape(cell)}</th>" for cell in header) + "</tr>\n" if header else ""
    return f"<table>\n{head}{cells}</table>\n"


def study_page(figures, about) -> str:
    """One page that needs no other file."""
    parts = [f"<!DOCTYPE html><html lang=\"en\"><meta charset=\"utf-8\"><title>The published study, reproduced</title><style>{_STYLE}</style>",
             "<body><h1>The published study, reproduced</h1>",
             "<p>Rubio, Chamoin, Louf: Real-time Bayesian data assimilation with data selection, correction of model bias, and "
             f"on-the-fly uncertainty propagation (2019), section 6, figure by figure. {about['program']}, seed {about['seed']}, "
             f"{'quick' if about['quick'] else 'full'} study in {about['elapsed_s']:.0f} s.</p><div class=\"cards\">"]
    for name, number, begins, unit in _CARDS:
        for row in (row for figure in figures if figure.number == number for row in figure.rows if row.quantity.startswith(begins)):
            parts.append(f"<div>{name}<b>{readable(row.here_value)}{unit}</b>paper: {html.escape(row.paper)}{unit}</div>")
    parts.append("</div><p>Each section computes a figure of the paper, draws it as the paper does, and compares it with the published "
                 "values. The paper does not give supports, notch width and mesh; the last section repeats the conclusions under other "
                 "choices.</p>")
    for figure in figures:
        parts.append(f"<h2>{html.escape(figure.heading)}</h2><p>{html.escape(figure.setting)}</p>")
        for png, caption in figure.panels:
            parts.append(f"<figure><img alt=\"{html.escape(caption)}\" src=\"data:image/png;base64,{base64.b64encode(png).decode()}\">"
                         f"<figcaption>{html.escape(caption)}</figcaption></figure>")
        parts.append(_table(["quantity", "paper", "here", "why they differ"],
                            [[row.quantity + ("" if row.unit == "1" else f", {row.unit}"), row.paper, row.here, row.why]
                             for row in figure.rows]))
        for caption, header, rows in figure.tables:
            parts.append(f"<p class=\"caption\">{html.escape(caption)}</p>{_table(header, rows)}")
    parts.append("<h2>Provenance</h2>" + _table([], [["Program", about["program"]], ["Seed", str(about["seed"])],
                                                     *([f"Machine: {key}", str(value)] for key, value in machine().items())]))
    return "\n".join(parts) + "</body></html>\n"


def write(folder, figures, about) -> tuple[str, str]:
    """Page, record and pictures; each file whole or not at all. Gives the names of the first two."""
    def whole(path, content):
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = path.with_name(f".{path.name}.{os.getpid()}")
        fresh.write_bytes(content)
        fresh.replace(path)

    for figure in figures:
        for i, (png, _) in enumerate(figure.panels, 1):
            whole(folder / "figures" / f"{figure.number}_{i}.png", png)
    whole(folder / "reproduce.html", study_page(figures, about).encode())
    whole(folder / "reproduce.json", (json.dumps(study_record(figures, about), ensure_ascii=False, allow_nan=False) + "\n").encode())
    return str(folder / "reproduce.html"), str(folder / "reproduce.json")
