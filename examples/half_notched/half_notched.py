"""The mesh and the data of the half-notched beam, and how good the forecasts were.

usage: half_notched.py mesh [FILE]               writes half_notched.msh (format 2.2 of Gmsh)
       half_notched.py data ENVELOPE.csv         writes measured.csv, up to an opening of 0.05 mm, and peak.csv with its peak.toml
       half_notched.py laws                      writes a project for each other law: LAW.toml, and LAW_peak.toml up to the peak
       half_notched.py score ENVELOPE.csv FOLDER of results…   compares their forecasts with the measured band, and how probable
                                                 each is beside the others of the same data
       half_notched.py evidence ENVELOPE.csv MODEL.h5…   the posterior from peak.csv and from measured.csv by dense quadrature over
                                                 the outputs of each model, beside knothe: least misfit, forecast of the law
                                                 alone, dissipated work (needs numpy and h5py)

ENVELOPE.csv: opening (mm), lowest and highest load (N) of the repeated tests (scripts/get-data.sh).
docs/benchmarks/half-notched-beam.md explains.
"""
import csv
import json
import math
import pathlib
import sys

NOTCH = 0.0025  # width, m; it is not in the data: one element
SIDE = [0.00375, 0.00625, 0.010, 0.015, 0.022, 0.032, 0.045, 0.0625, 0.075, 0.0875]  # beside the notch, m
HEIGHT = [0.005 * i for i in range(5)] + [0.025 + 0.0025 * i for i in range(10)] + [0.04875, 0.050]
THICKNESS = [0.0, 0.025]  # half of it
DAMAGED = 0.022  # no element can be damaged beyond, nor in the row of 1.25 mm under the load
GROUPS = {"elastic": (3, 1), "concrete": (3, 2), "symmetry": (2, 3), "support_left": (1, 4), "support_right": (1, 5),
          "load": (1, 6), "crack_mouth": (0, 7)}

SEEN = (2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 23, 26, 30, 35, 40, 45, 50)  # openings, µm; the peak is at 20
AHEAD = range(60, 201, 10)
GAUGE = 10.0  # standard deviation of a measured force, N: 1 % of the peak


def mesh():
    """Points, and elements (Gmsh's type, group, nodes)."""
    x = [-place for place in reversed(SIDE)] + [-NOTCH / 2, NOTCH / 2] + SIDE
    points, elements, number = [], [], {}

    def node(i, j, k):
        if (i, j, k) not in number:
            points.append((x[i], HEIGHT[j], THICKNESS[k]))
            number[i, j, k] = len(points)
        return number[i, j, k]

    top = len(HEIGHT) - 1
    for j in range(top):
        for i in range(len(x) - 1):
            across, up = 0.5 * (x[i] + x[i + 1]), 0.5 * (HEIGHT[j] + HEIGHT[j + 1])
            inside = abs(across) < NOTCH / 2
            if inside and up < 0.025:
                continue
            elastic = abs(across) > DAMAGED or (inside and j == top - 1)
            face = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            elements.append((5, "elastic" if elastic else "concrete",
                             [node(*corner, 0) for corner in face] + [node(*corner, 1) for corner in face]))
            elements.append((3, "symmetry", [node(*corner, 0) for corner in face]))
    for i, place in enumerate(x):
        if abs(place) == 0.0625:
            elements.append((1, "support_left" if place < 0 else "support_right", [node(i, 0, 0), node(i, 0, 1)]))
        if abs(place) <= NOTCH / 2:
            elements.append((1, "load", [node(i, top, 0), node(i, top, 1)]))
        if abs(place) == 0.010:  # between these the opening was measured
            elements.append((15, "crack_mouth", [node(i, 0, 1)]))
    return points, elements


def text_of(points, elements):
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(GROUPS))]
    lines += [f'{dimension} {tag} "{name}"' for name, (dimension, tag) in GROUPS.items()]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(points))]
    lines += [f"{n} {' '.join(f'{value:.8g}' for value in point)}" for n, point in enumerate(points, 1)]
    lines += ["$EndNodes", "$Elements", str(len(elements))]
    lines += [f"{n} {kind} 2 {GROUPS[group][1]} {GROUPS[group][1]} {' '.join(map(str, nodes))}"
              for n, (kind, group, nodes) in enumerate(elements, 1)]
    return "\n".join([*lines, "$EndElements", ""])


def read_band(path):
    """The rows (opening in mm, lowest, highest load in N) in order: the first two are not, in the file."""
    with open(path, encoding="utf-8") as file:
        return sorted(tuple(map(float, row)) for row in list(csv.reader(file))[1:])


def band_at(rows, micrometres):
    """Lowest and highest load at an opening, linear between the rows."""
    opening = 1e-3 * micrometres
    after = next(i for i, row in enumerate(rows) if row[0] >= opening)
    (w0, *before), (w1, *behind) = rows[after - 1], rows[after]
    share = (opening - w0) / (w1 - w0)
    return [a + share * (b - a) for a, b in zip(before, behind)]


def data_text(rows, last):
    """The middle of the band; the scatter of beams, its half width, is one error of the whole curve (shared_std)."""
    lines = ["time,sensor,x,y,z,component,value,std,shared_std"]
    for opening in (o for o in SEEN if o <= last):
        low, high = band_at(rows, opening)
        lines.append(f"{opening}e-6,load cell,,,,reaction_force,{0.5 * (low + high):.2f},{GAUGE:g},{0.5 * (high - low):.2f}")
    return "\n".join([*lines, ""])


def write_data(rows):
    """With the scatter of beams at the last opening that is seen, no row beyond it is looked at."""
    project = pathlib.Path("half_notched.toml").read_text(encoding="utf-8")
    for last, name in ((50, "measured"), (20, "peak")):
        pathlib.Path(f"{name}.csv").write_text(data_text(rows, last), encoding="utf-8")
        low, high = band_at(rows, last)
        scatter = f"model_error_std = {0.5 * (high - low):.0f}"
        if name == "peak":
            project = project.replace("measured.csv", "peak.csv").replace("results/", "peak/")
            pathlib.Path("peak.toml").write_text(project.replace("model_error_std = 130", scatter), encoding="utf-8")
        elif scatter not in project:
            raise SystemExit(f"half_notched.toml: the scatter at {last} µm is {scatter}")


def write_laws():
    """The same project with other laws, each in a box of its own: stress against opening, with the fracture energy in place of
    A_d; the gradient; and the brittle law with other widths of its band, which A_d grows with."""
    energy = [("\nAd = { prior", "\nGf = { prior"), ("Ad = { reference = 2.5e-3", "Gf = { reference = 70")]
    band = "regularisation = \"crack-band\", reference_size = 0.02"
    laws = {"gradient": [(band, 'regularisation = "gradient", internal_length = 0.005'),
                         ("Y0 = { reference = 200", "Y0 = { reference = 60"), ("Ad = { reference = 2.5e-3", "Ad = { reference = 1e-2")],
            **{law: [("damage = { ", f'damage = {{ law = "{law}", '), *energy] for law in ("exponential", "bilinear")},
            **{f"band{width}": [("reference_size = 0.02", f"reference_size = {1e-3 * width:g}"),
                                ("Ad = { reference = 2.5e-3", f"Ad = {{ reference = {2.5e-3 * width / 20:g}")] for width in (10, 40, 80)}}
    for law, changes in laws.items():
        for source, name in (("half_notched.toml", law), ("peak.toml", f"{law}_peak")):
            text = pathlib.Path(source).read_text(encoding="utf-8")
            for old, new in [*changes, ("brittle.h5", f"{law}.h5"), ('results = "', f'results = "{law}_')]:
                if old not in text:
                    raise SystemExit(f"{source}: there is no {old!r}")
                text = text.replace(old, new)
            pathlib.Path(f"{name}.toml").write_text(text, encoding="utf-8")


def probabilities(log_evidence):
    """Of models that are equally probable before the data."""
    best = max(log_evidence.values())
    weight = {name: math.exp(value - best) for name, value in log_evidence.items()}
    return {name: round(value / sum(weight.values()), 6) for name, value in weight.items()}


def last_forecast(folder):
    """The line of the last datum, and (mean, std) by opening in µm of its forecasts."""
    lines = (pathlib.Path(folder) / "steps.jsonl").read_text(encoding="utf-8").splitlines()
    line = [step for step in map(json.loads, lines) if "forecast" in step][-1]
    return line, {int(name[-3:]): (f["mean"], f["std"]) for name, f in line["forecast"].items()}


def score(rows, forecast):
    """Share of the measured band that 90 % intervals hold, and their width over its width, the mean from 0.05 to 0.2 mm."""
    held, wide = [], []
    for opening in [50, *AHEAD]:
        (mean, std), (low, high) = forecast[opening], band_at(rows, opening)
        left, right = mean - 1.645 * std, mean + 1.645 * std
        held.append(max(min(right, high) - max(left, low), 0) / (high - low))
        wide.append((right - left) / (high - low))
    return sum(held) / len(held), sum(wide) / len(wide)


def opening_shape(share):
    """Opening of the mouth over force, but for a factor, of a crack of this share of the depth (Tada, Paris and Irwin)."""
    return share * (0.76 - 2.28 * share + 3.87 * share**2 - 2.04 * share**3 + 0.66 / (1 - share) ** 2)


def equivalent_crack(compliance_ratio):
    """Depth in mm, notch and crack, of the elastic beam whose mouth opens so many times as much as that of the notch alone."""
    low, high = 0.5, 0.999
    for _ in range(60):
        middle = 0.5 * (low + high)
        if opening_shape(middle) < compliance_ratio * opening_shape(0.5):
            low = middle
        else:
            high = middle
    return 50 * low


def crack_at(opening, force, first):
    """`first`: opening and force before there is damage."""
    return round(equivalent_crack(opening / force / (first[0] / first[1])), 1) if force > 0 else 50.0


def cardinal_splines(nodes, x):
    """Values at x of the cubic splines (not-a-knot; of three nodes the parabola) that are one at a node, len(x) × len(nodes)."""
    import numpy as np

    def powers(points):
        t = (np.asarray(points) - nodes[0]) / (nodes[-1] - nodes[0])
        knots = (nodes[2:-2] - nodes[0]) / (nodes[-1] - nodes[0])
        return np.stack([*(t**k for k in range(min(4, len(nodes)))), *(np.maximum(t - knot, 0) ** 3 for knot in knots)], axis=-1)
    return powers(x) @ np.linalg.inv(powers(nodes))


class Outputs:
    """Outputs of a model on a dense grid over its box."""

    def __init__(self, path, nodes=41):
        import h5py
        import numpy as np
        with h5py.File(path) as file:
            axes = [file["parameters/" + name][:] for name in ("E", "Y0", "Ad" if "Ad" in file["parameters"] else "Gf")]
            self.time = file["time"][:]
            self.force, self.displacement = (file["outputs/" + name][:] for name in ("reaction_force", "imposed_displacement"))
        fine = [np.linspace(a[0], a[-1], nodes) for a in axes]
        for k, (a, x) in enumerate(zip(axes, fine)):
            splines = cardinal_splines(a, x)
            self.force, self.displacement = (np.moveaxis(np.tensordot(values, splines, (k, 1)), -1, k)
                                             for values in (self.force, self.displacement))
        self.force, self.displacement = (values.reshape(-1, len(self.time)) for values in (self.force, self.displacement))
        self.points = np.stack(np.meshgrid(*fine, indexing="ij"), axis=-1).reshape(-1, 3)
        ends = np.r_[0.5, np.ones(nodes - 2), 0.5] / (nodes - 1)
        self.prior = np.einsum("i,j,k->ijk", ends, ends, ends).ravel()

    def at(self, micrometres):
        return int(abs(self.time - 1e-6 * micrometres).argmin())

    def dissipated(self):
        """Work of the force less the elastic energy that unloading to the origin gives back, J, by time; the beam is whole here."""
        import numpy as np
        steps = 0.5 * (self.force[:, 1:] + self.force[:, :-1]) * np.diff(self.displacement, axis=1)
        first = 0.5 * self.force[:, :1] * self.displacement[:, :1]
        return np.hstack([first, first + np.cumsum(steps, axis=1)]) - 0.5 * self.force * self.displacement


def posterior(outputs, path, gauge, scatter):
    """Weights of the points, log-evidence, and the misfit where it is least; the errors of the file times `gauge` and `scatter`."""
    import numpy as np
    with open(path, encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    at = [outputs.at(1e6 * float(row["time"])) for row in rows]
    value, std, shared = (np.array([float(row[key]) for row in rows]) for key in ("value", "std", "shared_std"))
    std, shared = gauge * std, scatter * shared
    factor = np.linalg.cholesky(np.diag(std**2) + np.outer(shared, shared))
    square = (np.linalg.solve(factor, (value - outputs.force[:, at]).T) ** 2).sum(axis=0)
    log = -0.5 * square - np.log(np.diag(factor)).sum() - 0.5 * len(rows) * np.log(2 * np.pi)
    weight = outputs.prior * np.exp(log - log.max())
    best = int(square.argmin())
    residual = value - outputs.force[best, at]
    common = (shared / std**2) @ residual / (1 + (shared / std) @ (shared / std))
    return (weight / weight.sum(), log.max() + np.log(weight.sum()), square[best],
            {round(1e6 * float(row["time"])): round(float(r), 1) for row, r in zip(rows, residual - common * shared)})


def by_quadrature(rows, model):
    import numpy as np
    outputs = Outputs(model)
    work = outputs.dissipated()[:, outputs.at(200)]
    for last, path in ((20, "peak.csv"), (50, "measured.csv")):
        low, high = band_at(rows, last)
        line = {"model": model, "up_to_um": last}
        for name, gauge, scatter in (("", 1, 1), (" gauge 20 N", 2, 1), (" half width 1.645 std", 1, 1 / 1.645)):
            weight, evidence, least, residual = posterior(outputs, path, gauge, scatter)
            law, beam = {}, {}
            for opening in (50, *AHEAD):
                force = outputs.force[:, outputs.at(opening)]
                mean = weight @ force
                variance = weight @ (force - mean) ** 2
                law[opening] = mean, math.sqrt(variance)
                beam[opening] = mean, math.sqrt(variance + (0.5 * scatter * (high - low)) ** 2)
            line |= {"log_evidence" + name: round(evidence, 2), "least_chi2" + name: round(float(least), 1), "of": len(residual),
                     "held, width" + name: [round(x, 3) for x in score(rows, beam)]}
            if not name:
                mean = weight @ outputs.points
                line |= {"mean": list(mean), "std": list(np.sqrt(weight @ (outputs.points - mean) ** 2)), "force_200": law[200][0],
                         "held, width of the law alone": [round(x, 3) for x in score(rows, law)], "measured minus law, N": residual,
                         "dissipated, J": round(weight @ work, 4)}
        yield line


def exponents(rows):
    """Of the fall of the middle of the band."""
    middle = {opening: sum(band_at(rows, opening)) / 2 for opening in (50, 100, 200)}
    return {f"{a} to {b} um": round(math.log2(middle[a] / middle[b]), 2) for a, b in ((50, 100), (100, 200))}


if __name__ == "__main__":
    command, *rest = sys.argv[1:]
    if command == "mesh":
        pathlib.Path(rest[0] if rest else "half_notched.msh").write_text(text_of(*mesh()), encoding="utf-8")
    elif command == "data":
        write_data(read_band(rest[0]))
    elif command == "laws":
        write_laws()
    elif command == "evidence":
        rows = read_band(rest[0])
        print(json.dumps({"measured falls like the power": exponents(rows)}))
        for model in rest[1:]:
            for line in by_quadrature(rows, model):
                print(json.dumps(line))
    else:
        rows = read_band(rest[0])
        first = (2, sum(band_at(rows, 2)) / 2)
        evidence = {}
        for folder in rest[1:]:
            line, forecast = last_forecast(folder)
            held, wide = score(rows, forecast)
            mean, std = forecast[200]
            evidence.setdefault(SEEN[line["step"]], {})[folder] = line["log_evidence"]
            print(json.dumps({"results": folder, "up_to_um": SEEN[line["step"]], "verdict": line["verdict"]["level"],
                              "log_evidence": round(line["log_evidence"], 2), "held": round(held, 3), "width": round(wide, 3),
                              "crack_mm": [crack_at(200, mean + 1.645 * sign * std, first) for sign in (1, 0, -1)],
                              "measured_crack_mm": [crack_at(200, force, first) for force in reversed(band_at(rows, 200))]}))
        for last, of_folder in evidence.items():
            if len(of_folder) > 1:
                print(json.dumps({"up_to_um": last, "probability": probabilities(of_folder)}))
