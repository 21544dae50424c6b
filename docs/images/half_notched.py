"""The picture of docs/benchmarks/half-notched-beam.md.

usage: half_notched.py ENVELOPE.csv PEAK RESULTS PICTURE.svg     the folders that `knothe assimilate` leaves
"""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "examples" / "half_notched"))
import half_notched  # noqa: E402
from panel import Panel, picture  # noqa: E402

BAND, FORECAST = 'fill="#bbb" stroke="none"', 'fill="#2b6cb0" fill-opacity="0.35" stroke="none"'
MEAN, DATUM = 'fill="none" stroke="#2b6cb0" stroke-width="2"', 'fill="#c05621"'


def draw(rows, cases):
    """Left: seen up to the peak; right: up to 0.05 mm. `cases`: number of data and forecast of each."""
    panels = []
    for k, (seen, forecast) in enumerate(cases):
        panel = Panel((55 + 390 * k, 40, 340, 300), (0, 0.2), (0, 1300))
        thin = rows[::40] + rows[-1:]
        opening, low, high = zip(*[row for row in thin if row[0] <= 0.2])
        panel.path([*opening, *reversed(opening)], [*low, *reversed(high)], BAND, " Z")
        w = sorted(forecast)
        mean, std = ([forecast[o][i] for o in w] for i in (0, 1))
        mm = [1e-3 * o for o in w]
        panel.path([*mm, *reversed(mm)], [*(m - 1.645 * s for m, s in zip(mean, std)),
                                          *reversed([m + 1.645 * s for m, s in zip(mean, std)])], FORECAST, " Z")
        panel.path(mm, mean, MEAN)
        for o in half_notched.SEEN[:seen]:
            panel.dot(1e-3 * o, sum(half_notched.band_at(rows, o)) / 2, DATUM)
        panel.axes((0, 0.05, 0.1, 0.15, 0.2), range(0, 1201, 200) if k == 0 else (),
                   f"force, N: seen up to {1e-3 * half_notched.SEEN[seen - 1]:g} mm", "crack-mouth opening, mm")
        panel.legend([(BAND, "beams measured"), (DATUM, "data"), (MEAN, "forecast, mean"), (FORECAST, "forecast, 90 %")])
        panels.append(panel)
    return picture(panels)


if __name__ == "__main__":
    rows = half_notched.read_band(sys.argv[1])
    last = [half_notched.last_forecast(folder) for folder in sys.argv[2:4]]
    pathlib.Path(sys.argv[4]).write_text(draw(rows, [(line["step"] + 1, forecast) for line, forecast in last]), encoding="utf-8")
