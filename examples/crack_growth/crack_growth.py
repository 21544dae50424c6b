"""What the first 24 specimens say of a 25th, and the data and project files of any of the last 24.

usage: crack_growth.py prior RECORDS.csv [FOLDER]        fits the first 24; writes departure.csv and crack_growth.toml
       crack_growth.py specimen RECORDS.csv N [FOLDER]   writes specimen_N.csv (rows up to 12 mm) and specimen_N.toml
       crack_growth.py compare RECORDS.csv               cross-validation within the first 24, by which the model was chosen

RECORDS.csv: half crack length (mm), then the cycles of each specimen. Needs numpy and scipy. docs/benchmarks/crack-growth.md explains.
"""
import math
import pathlib
import sys

import numpy as np
from scipy.optimize import minimize

import paris

TRAINED = 24  # specimens that anything is estimated from
SEEN = 3  # intervals up to 12 mm
LENGTHS = np.array([*range(9, 38), 37.8, 39, 40.2, 41, 42.2, 43.4, 44.2, 45, 45.8, 47.4, 49.8])  # mm
HORIZONS = (13, 14, 16, 18, 20, 24, 28, 32, 36, 40.2, 45, 49.8)  # mm
MIDDLES, WIDTHS = 0.5 * (LENGTHS[1:] + LENGTHS[:-1]), np.diff(LENGTHS)
SLOPES = np.log([paris.stress_intensity(a) / paris.REFERENCE for a in MIDDLES])  # of m
BOX = {"ln_c": 6, "m": 5, "wander": 5}  # half width of the model's box, in prior standard deviations
NODES = {"ln_c": 9, "m": 3, "wander": 5}


def read_records(path):
    """ln(dN/da), the mean over each interval of LENGTHS, intervals × specimens."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    rows = [int(np.argmin(abs(table[:, 0] - length))) for length in LENGTHS]
    assert np.allclose(table[rows, 0], LENGTHS)
    return np.log(np.diff(table[rows, 1:], axis=0) / WIDTHS[:, None])


class Scatter:
    """Covariance of ln(dN/da) between the intervals of a specimen, and between specimens.

    m_std: scatter of m; white: interval of 1 mm; wander, length: of an Ornstein-Uhlenbeck process along the path;
    level: scatter of ln C from specimen to specimen, drift: its step from one record to the next."""

    names = ("m_std", "white", "wander", "length", "level", "drift")

    def __init__(self, values):
        self.__dict__.update(zip(self.names, values))

    def along(self):
        distance = np.abs(MIDDLES[:, None] - MIDDLES)
        return (self.m_std**2 * np.outer(SLOPES, SLOPES) + np.diag(self.white**2 / WIDTHS)
                + self.wander**2 * np.exp(-distance / self.length))

    def across(self, places):
        """Of ln C, between the specimens at these places of the table."""
        return self.level**2 * np.eye(len(places)) + self.drift**2 * np.minimum.outer(places + 1.0, places + 1.0)


def misfit(scatter, z):
    """−ln of the restricted likelihood: the mean of each interval over the specimens is unknown and drops out."""
    count = z.shape[1]
    contrasts = np.linalg.qr(np.c_[np.ones(count), np.eye(count)[:, 1:]])[0][:, 1:]
    eigenvalues, vectors = np.linalg.eigh(contrasts.T @ scatter.across(np.arange(count)) @ contrasts)
    factor = np.linalg.cholesky(scatter.along())
    y, one = (np.linalg.solve(factor, v) for v in (z @ contrasts @ vectors, np.ones(len(z))))
    square = one @ one
    gain = eigenvalues / (1 + eigenvalues * square)
    return (np.log(np.diag(factor)).sum() * (count - 1)
            + 0.5 * (np.log1p(eigenvalues * square).sum() + (y**2).sum() - ((one @ y) ** 2 * gain).sum()))


def fit(z, kind="drift"):
    """Scatter that fits z best, with ln C that drifts from record to record, or is exchangeable."""
    def scatter(logs):
        *rest, last = np.exp(logs)
        return Scatter([*rest, *((0, last) if kind == "drift" else (last, 0))])

    starts = [np.log([0.05, 0.1, 0.1, length, 0.02]) for length in (3, 10)]
    runs = [minimize(lambda logs: misfit(scatter(logs), z), start, method="L-BFGS-B", bounds=[(-7, 4)] * 5) for start in starts]
    best = min(runs, key=lambda run: run.fun)
    return scatter(best.x), -best.fun


def curve_before_data(scatter, z, places, place):
    """Mean and covariance of ln(dN/da) of the specimen at `place`, from those at `places`: kriging with an unknown mean
    of each interval."""
    count, n = len(places), len(MIDDLES)
    across = scatter.across(np.r_[places, place])
    covariance = np.kron(np.eye(count + 1), scatter.along()) + np.kron(across, np.ones((n, n)))
    old, new = slice(0, count * n), slice(count * n, None)
    design = np.tile(np.eye(n), (count + 1, 1))
    y = z[:, places].T.ravel()
    weighted = np.linalg.solve(covariance[old, old], np.c_[design[old], covariance[old, new], y])
    spread = np.linalg.inv(design[old].T @ weighted[:, :n])
    mean = spread @ (design[old].T @ weighted[:, -1])
    from_old = weighted[:, n:-1]
    left = design[new] - from_old.T @ design[old]
    return (mean + from_old.T @ (y - design[old] @ mean),
            covariance[new, new] - covariance[new, old] @ from_old + left @ spread @ left.T)


class Prior:
    """What knothe is told before it sees a specimen: priors, the mean departure from Paris' law, and what is left."""

    def __init__(self, z, place):
        self.scatter, _ = fit(z[:, :TRAINED])
        places = np.arange(TRAINED)
        curve, covariance = curve_before_data(self.scatter, z, places, place)
        design = np.c_[np.ones(len(curve)), SLOPES]
        (level, slope), *_ = np.linalg.lstsq(design, curve, rcond=None)
        self.share = np.exp(-np.abs(MIDDLES - paris.START) / self.scatter.length)
        far = np.abs(MIDDLES[:, None] - MIDDLES) > 15  # there all covariance is that of ln C
        common = covariance - self.scatter.along()
        self.means = {"ln_c": -level, "m": -slope, "wander": 0.0}
        self.stds = {"ln_c": math.sqrt(common[far].mean()), "m": self.scatter.m_std, "wander": self.scatter.wander}
        # The specimen's own path, given the process at 12 mm, and the error of the mean of 24 such paths.
        own = self.scatter.along() - self.scatter.m_std**2 * np.outer(SLOPES, SLOPES)
        self.left = own * (1 + 1 / TRAINED) - self.scatter.wander**2 * np.outer(self.share, self.share)
        self.departure = curve - design @ (level, slope)
        self.factor = np.exp(0.5 * np.diag(self.left))  # mean of a lognormal variable to its median

    def noise(self):
        """Standard deviations of the three data: what wanders up to 12 mm beside the parameters. One number: a series has one."""
        return math.sqrt(np.diag(self.left)[:SEEN].mean())

    def error(self, horizon):
        """Standard deviation of the cycles from 12 mm to the horizon, of what the parameters leave open."""
        cycles = np.exp(-self.means["ln_c"] - self.means["m"] * SLOPES + self.departure) * self.factor * WIDTHS
        cycles[(MIDDLES < paris.START) | (MIDDLES > horizon)] = 0
        return math.sqrt(cycles @ self.left @ cycles)

    def table(self):
        rows = zip(LENGTHS[1:], self.departure, self.factor, self.share)
        return [(LENGTHS[0], 0.0, 1.0, 0.0), *((float(l), round(float(d), 5), round(float(f), 5), round(float(s), 5)) for l, d, f, s in rows)]


HEAD = """# Fatigue crack growth in 48 aluminium sheets (Virkler, Hillberry and Goel 1979): a model without a mesh. From a record up to
# 12 mm of half crack length: the cycles until 49.8 mm, and the curve between. Model time is the half crack length in mm.
#
#   ../../scripts/get-data.sh                                     the records, into data/ (docs/benchmarks/crack-growth.md)
#   knothe offline crack_growth.toml -o paris.h5                  {runs} runs of paris.py
#   python3 crack_growth.py specimen RECORDS.csv {specimen}               specimen_{specimen}.csv and specimen_{specimen}.toml
#   knothe assimilate specimen_{specimen}.toml
#
# Made by `crack_growth.py prior`: every number comes from the first {trained} specimens.

model = "paris.h5"
data = "specimen_{specimen}.csv"
results = "specimen_{specimen}/"
"""


def project(prior, box, specimen):
    lines = [HEAD.format(runs=math.prod(NODES.values()), specimen=specimen, trained=TRAINED), "[parameters]"]
    for name, mean in prior.means.items():
        lines.append(f'{name} = {{ prior = "normal", mean = {mean:.4f}, std = {prior.stds[name]:.4f} }}')
    lines += ["", "[offline]", "processes = 2", "modes = 15", "", "[offline.command]",
              'run = ["python3", "paris.py", "{{ln_c}}", "{{m}}", "{{wander}}"]', 'files = ["paris.py", "departure.csv"]',
              'field = "cycles.csv"', "time_limit = 60", "retries = 1"]
    meanings = {"ln_c": "logarithm of the growth at 15 MPa√m, mm a cycle", "m": "exponent of Paris' law",
                "wander": "departure of ln(dN/da) at 12 mm"}
    for name, mean in box.means.items():
        reach = BOX[name] * box.stds[name]
        lines += ["", f"[offline.parameters.{name}]", f'long_name = "{meanings[name]}"', f"lower = {mean - reach:.3f}",
                  f"upper = {mean + reach:.3f}", f"nodes = {NODES[name]}"]
    for horizon in HORIZONS:
        lines += ["", f"[forecast.cycles_to_{str(horizon).replace('.', '_')}]", 'quantity = "output"', 'output = "cycles"',
                  f"horizon = {horizon}", f"model_error_std = {prior.error(horizon):.0f}"]
    return "\n".join(lines) + "\n"


def data_rows(prior, z, specimen):
    lines = ["time,sensor,x,y,z,component,value,std"]
    for length, value in zip(LENGTHS[1:SEEN + 1], z[:SEEN, specimen - 1]):
        lines.append(f"{length!r},record,,,,log_cycles_per_mm,{value!r},{prior.noise():.4f}")
    return "\n".join(lines) + "\n"


def write_specimen(z, specimen, folder):
    prior, box = Prior(z, specimen - 1), Prior(z, z.shape[1] - 1)
    (folder / f"specimen_{specimen}.csv").write_text(data_rows(prior, z, specimen))
    (folder / f"specimen_{specimen}.toml").write_text(project(prior, box, specimen))


def write_prior(z, folder):
    first, last = Prior(z, TRAINED), Prior(z, z.shape[1] - 1)
    print("  ".join(f"{name} {getattr(first.scatter, name):.4f}" for name in Scatter.names))
    rows = ["length,departure,factor,share", *(",".join(map(repr, row)) for row in first.table())]
    (folder / "departure.csv").write_text("\n".join(rows) + "\n")
    (folder / "crack_growth.toml").write_text(project(first, last, TRAINED + 1))


def crps(sample, y):
    """Continuous ranked probability score of a sample."""
    sample, n = np.sort(sample), len(sample)
    return np.abs(sample - y).mean() - ((2 * np.arange(1, n + 1) - n - 1) * sample).sum() / n**2


def compare(z):
    """Each of the first 24 from 12 mm on, from those before it (from the 9th on) or from all others, by the exact
    Gaussian process: intervals of 90 % that hold, mean score, mean log score of the cycles to 49.8 mm."""
    z = z[:, :TRAINED]
    for kind in ("exchangeable", "drift"):
        scatter, likelihood = fit(z, "drift" if kind == "drift" else "")
        for way, tests in (("those before", range(8, TRAINED)), ("all others", range(TRAINED))):
            held, scores, logs = 0, [], []
            for s in tests:
                places = np.array([p for p in (range(s) if way == "those before" else range(TRAINED)) if p != s])
                mean, covariance = curve_before_data(scatter, z, places, s)
                gain = np.linalg.solve(covariance[:SEEN, :SEEN], covariance[:SEEN, SEEN:]).T
                mean, covariance = (mean[SEEN:] + gain @ (z[:SEEN, s] - mean[:SEEN]),
                                    covariance[SEEN:, SEEN:] - gain @ covariance[:SEEN, SEEN:])
                paths = np.random.default_rng(s).multivariate_normal(mean, covariance, 4000)
                cycles, truth = np.exp(paths) @ WIDTHS[SEEN:], np.exp(z[SEEN:, s]) @ WIDTHS[SEEN:]
                low, high = np.quantile(cycles, [0.05, 0.95])
                held += low < truth < high
                scores.append(crps(cycles, truth))
                logs.append(-0.5 * ((truth - cycles.mean()) / cycles.std()) ** 2 - math.log(cycles.std() * math.sqrt(2 * math.pi)))
            print(f"{kind:13s} log-likelihood {likelihood:.1f}  from {way:13s} {held} of {len(tests)}  "
                  f"CRPS {np.mean(scores):.0f} cycles  log score {np.mean(logs):.3f}")


if __name__ == "__main__":
    command, records, *rest = sys.argv[1:]
    z = read_records(records)
    number = [int(rest.pop(0))] if command == "specimen" else []
    folder = pathlib.Path(rest[0] if rest else ".")
    if command == "compare":
        compare(z)
    elif command == "specimen":
        write_specimen(z, *number, folder)
    else:
        write_prior(z, folder)
