"""What a notebook shows of an object: a small table, with numbers as the report writes them."""
from __future__ import annotations

import html
import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

_COLOURS = {"ok": "#007a55", "caution": "#8a6100", "reject": "#b3261e"}
WORDS = {"ok": "Result: usable", "caution": "Result: usable with caveats", "reject": "Result: do not use"}
_PREFIXED = ("Pa", "N", "J", "W", "Hz", "V")
_LOOKS = {"ok": "", "caution": ";color:#6b7280", "reject": ";color:#6b7280;text-decoration:line-through"}


def pretty_units(units: str) -> str:
    """``N/m3`` as ``N/m³``; empty of a pure number."""
    return "" if units == "1" else re.sub(r"(?<=[A-Za-z])[23]", lambda power: "²³"[int(power[0]) - 2], units)


def readable_units(size: float, units: str) -> tuple[float, str]:
    """Factor and unit for a quantity of this size: metres in mm or µm, large forces in kN."""
    if units in ("", "1"):
        return 1.0, ""
    if units == "m":
        return (1e6, "µm") if size < 1e-5 else (1e3, "mm")
    if size < 1e4 or units.split()[0].split("/")[0] not in _PREFIXED:
        return 1.0, pretty_units(units)
    return (1e-3, f"k{units}") if size < 1e6 else (1e-6, f"M{units}") if size < 1e9 else (1e-9, f"G{units}")


def number(value: float, std: float) -> str:
    """To the decimals that two digits of the standard deviation need."""
    if not (std > 0 and math.isfinite(std)):
        return f"{value:.4g}"
    decimals = 1 - math.floor(math.log10(std))
    return f"{value:.{decimals}f}" if 0 <= decimals <= 8 else f"{value:.4g}"


def two_digits(value: float) -> str:
    """Of a number that is not worth more."""
    rounded = float(f"{value:.1e}")
    if not 1e-4 <= abs(rounded) < 1e5:
        return f"{rounded:g}"
    return f"{rounded:.{max(0, 1 - math.floor(math.log10(abs(rounded))))}f}"


def quantity(mean: float, std: float, units: str = "", level: str = "ok") -> str:
    """``41.2 ± 1.3 mm``; ``41 mm`` of an answer that is rejected."""
    factor, unit = readable_units(max(abs(mean), std), units)
    written = (two_digits(factor * mean) if level == "reject"
               else f"{number(factor * mean, factor * std)} ± {number(factor * std, factor * std)}")
    return f"{written} {unit}" if unit else written


def interval(low: float, high: float, std: float, units: str = "", level: str = "ok", size: float = 0) -> str:
    """``40.1 … 42.3 mm``, in the unit of a number of this size."""
    factor, unit = readable_units(size, units)
    ends = [two_digits(factor * value) if level == "reject" else number(factor * value, factor * std) for value in (low, high)]
    return f"{ends[0]} … {ends[1]} {unit}".rstrip()


def given(value: float, units: str) -> str:
    """A value that was given, not computed: ``40 mm``."""
    factor, unit = readable_units(abs(value), units)
    return f"{factor * value:.4g} {unit}".rstrip()


def percent(probability: float) -> str:
    """Of draws: none above is not impossible."""
    return "< 0.1 %" if probability < 0.001 else "> 99.9 %" if probability > 0.999 else f"{100 * probability:.3g} %"


def table(title: str, header: Sequence[str], rows: Iterable[Sequence[Any]], note: str = "", level: str = "ok", plain: int = 1) -> str:
    """As HTML; all texts are escaped. Beyond `plain` columns numbers are grey under a verdict of `caution`, struck out under `reject`."""
    def row(cells: Sequence[Any], kind: str) -> str:
        looks = ["" if k < plain or kind == "th" else _LOOKS[level] for k in range(len(cells))]
        return "<tr>" + "".join(f'<{kind} style="text-align:left{look}">{html.escape(str(cell))}</{kind}>'
                                for cell, look in zip(cells, looks)) + "</tr>"

    head = f"<thead>{row(header, 'th')}</thead>" if header else ""
    body = "".join(row(cells, "td") for cells in rows)
    after = f"<p>{html.escape(note)}</p>" if note else ""
    return f"<p><b>{html.escape(title)}</b></p><table>{head}<tbody>{body}</tbody></table>{after}"


def rejected(level: str) -> str:
    """What stands before numbers that are not to be used."""
    return "do not use: " if level == "reject" else ""


def verdict_line(level: str) -> str:
    """The verdict as the report says it, in its colour."""
    return f'<p style="color:{_COLOURS[level]}"><b>{WORDS[level]}</b></p>'
