"""Densities with known means and standard deviations: closed form, quadrature, or published reference draws.

Each is vectorised, log density of points (n, d), given with the region that a user might state (Python's priors).
"""
import json
import math
import pathlib

import numpy as np

INFINITE = None  #: a moment that does not exist


class Density:
    def __init__(self, name, log, region, mean, std):
        self.name, self.log, self.region = name, log, region
        self.columns = None  #: of the parameters, those with known moments; None: all
        self.mean, self.std = (None if x is INFINITE else np.atleast_1d(np.asarray(x, float)) for x in (mean, std))


def normal(d, std=1.0, mean=0.0):
    return [("normal", mean, std)] * d


def gaussian(mean, covariance):
    mean, inverse = np.asarray(mean, float), np.linalg.inv(covariance)
    return lambda p: -0.5 * np.einsum("ni,ij,nj->n", p - mean, inverse, p - mean)


def by_lines(log, lower, upper, n=400001):
    """Mean and std of a density of one variable."""
    x = np.linspace(lower, upper, n)
    w = log(x[:, None])
    w = np.exp(w - w.max())
    mean = (w * x).sum() / w.sum()
    return mean, math.sqrt((w * (x - mean) ** 2).sum() / w.sum())


def by_planes(log, lower, upper, n=2401):
    """The same of two variables, on a square."""
    axis = np.linspace(lower, upper, n)
    x, y = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
    w = log(np.stack([x, y], 1))
    w = np.exp(w - w.max())
    mean = [(w * a).sum() / w.sum() for a in (x, y)]
    return mean, [math.sqrt((w * (a - m) ** 2).sum() / w.sum()) for a, m in zip((x, y), mean)]


def rosenbrock(p):
    return -(100 * (p[:, 1] - p[:, 0] ** 2) ** 2 + (1 - p[:, 0]) ** 2) / 20


def funnel(sigma):
    return lambda p: -0.5 * (p[:, 0] / sigma) ** 2 - 0.5 * (p[:, 1:] ** 2).sum(1) * np.exp(-p[:, 0]) - 0.5 * (p.shape[1] - 1) * p[:, 0]


def twisted(bend, s):
    return lambda p: -0.5 * p[:, 0] ** 2 - 0.5 * ((p[:, 1] - bend * p[:, 0] ** 2) / s) ** 2 - 0.5 * (p[:, 2:] ** 2).sum(1)


def student(nu):
    return lambda p: -0.5 * (nu + p.shape[1]) * np.log1p((p ** 2).sum(1) / nu)


def mixture(weights, means, stds):
    means = np.asarray(means, float)

    def log(p):
        d = p.shape[1]
        parts = [math.log(w) - d * math.log(s) - 0.5 * ((p - m) ** 2).sum(1) / s ** 2 for w, m, s in zip(weights, means, stds)]
        return np.logaddexp.reduce(parts, axis=0)

    weights = np.asarray(weights, float)
    mean = weights @ means
    second = sum(w * (m ** 2 + s ** 2) for w, m, s in zip(weights, means, stds))
    return log, mean, np.sqrt(second - mean ** 2)


def ring(radius, width):
    return lambda p: -0.5 * ((np.sqrt((p ** 2).sum(1)) - radius) / width) ** 2


def ring_std(radius, width, d):
    r = np.linspace(max(0, radius - 12 * width), radius + 12 * width, 100001)
    w = np.exp(-0.5 * ((r - radius) / width) ** 2) * r ** (d - 1)
    return math.sqrt((w * r * r).sum() / w.sum() / d)


def inside(condition, value=None):
    def log(p):
        with np.errstate(all="ignore"):
            return np.where(condition(p), 0.0 if value is None else value(p), -np.inf)
    return log


def of_gaussians():
    yield Density("Gaussian, 2", gaussian([1, -2], np.diag([1, 4])), normal(2), [1, -2], [1, 2])
    yield Density("Gaussian, 5", gaussian([0] * 5, np.eye(5)), normal(5), [0] * 5, [1] * 5)
    yield Density("Gaussian, 10", gaussian([0] * 10, np.eye(10)), normal(10), [0] * 10, [1] * 10)
    yield Density("Gaussian, 20", gaussian([0] * 20, np.eye(20)), normal(20), [0] * 20, [1] * 20)
    yield Density("Gaussian, 3, region 10 times too wide", gaussian([0] * 3, np.eye(3)), normal(3, 10), [0] * 3, [1] * 3)
    yield Density("Gaussian, 3, region 10 times too narrow", gaussian([0] * 3, np.eye(3)), normal(3, 0.1), [0] * 3, [1] * 3)
    yield Density("Gaussian, 2, region beside", gaussian([6, -6], np.eye(2)), normal(2), [6, -6], [1, 1])
    yield Density("Gaussian, 2, correlation 0.999", gaussian([0, 0], [[1, 0.999], [0.999, 1]]), normal(2), [0, 0], [1, 1])
    c = 0.9 * np.ones((5, 5)) + 0.1 * np.eye(5)
    yield Density("Gaussian, 5, correlation 0.9", gaussian([0] * 5, c), normal(5), [0] * 5, [1] * 5)
    scales = np.geomspace(0.1, 10, 10)
    yield Density("Gaussian, 10, widths 0.1 to 10", gaussian([0] * 10, np.diag(scales ** 2)), normal(10, 2), [0] * 10, scales)


def of_bends():
    for name, region in (("", [("normal", 0, 5), ("normal", 0, 20)]), (", region too wide", [("normal", 0, 20), ("normal", 0, 80)]),
                         (", region too narrow", normal(2, 1.5))):
        yield Density("banana 100:1" + name, rosenbrock, region, [1, 11], [math.sqrt(10), math.sqrt(0.1 + 4 * 10 + 2 * 100)])
    yield Density("banana 10:1", twisted(0.5, 0.1), normal(2, 2), [0, 0.5], [1, math.sqrt(0.5 + 0.01)])
    yield Density("banana mild", twisted(0.3, 1), normal(2, 2), [0, 0.3], [1, math.sqrt(0.18 + 1)])
    yield Density("banana mild, region beside", twisted(0.3, 1), normal(2, 1, 4), [0, 0.3], [1, math.sqrt(0.18 + 1)])
    yield Density("banana mild, 10", twisted(0.3, 1), normal(10, 2), [0, 0.3] + [0] * 8, [1, math.sqrt(0.18 + 1)] + [1] * 8)
    yield Density("banana, 5", twisted(0.5, 0.3), normal(5, 2), [0, 0.5, 0, 0, 0], [1, math.sqrt(0.5 + 0.09), 1, 1, 1])
    for d in (2, 5):
        yield Density(f"funnel mild, {d}", funnel(1.5), normal(d, 3), [0] * d, [1.5] + [math.exp(0.5 * 1.5 ** 2 / 2 * 1)] * (d - 1))
    yield Density("funnel 1, 3", funnel(1.0), normal(3, 2), [0] * 3, [1.0] + [math.exp(0.25)] * 2)
    for d in (2, 10):
        yield Density(f"Neal's funnel, {d}", funnel(3.0), normal(d, 5), [0] * d, [3.0] + [math.exp(9 / 4)] * (d - 1))
    yield Density("ring", ring(2, 0.2), normal(2, 2), [0, 0], [ring_std(2, 0.2, 2)] * 2)
    yield Density("ring, region 10 times too wide", ring(2, 0.2), normal(2, 20), [0, 0], [ring_std(2, 0.2, 2)] * 2)
    yield Density("ring, region 10 times too narrow", ring(2, 0.2), normal(2, 0.2), [0, 0], [ring_std(2, 0.2, 2)] * 2)
    yield Density("ring, region beside", ring(2, 0.2), normal(2, 1, 4), [0, 0], [ring_std(2, 0.2, 2)] * 2)
    yield Density("ring thin", ring(2, 0.05), normal(2, 2), [0, 0], [ring_std(2, 0.05, 2)] * 2)
    yield Density("shell, 3", ring(2, 0.3), normal(3, 2), [0] * 3, [ring_std(2, 0.3, 3)] * 3)


def of_mixtures():
    for name, w, m, s, spread in (
            ("two modes", [0.5, 0.5], [[-3, 0], [3, 0]], [0.5, 0.5], 3), ("two modes, 0.1 to 0.9", [0.1, 0.9], [[-4, 0], [3, 1]], [0.5, 1.0], 3),
            ("narrow in wide", [0.5, 0.5], [[0, 0], [2, 2]], [2.0, 0.2], 3), ("three modes, 1", [0.2, 0.5, 0.3], [[-5], [0], [4]], [0.5, 1.0, 0.3], 4),
            ("two modes, 4", [0.3, 0.7], [[-2] * 4, [2] * 4], [0.7, 0.5], 2), ("two modes, 10", [0.3, 0.7], [[-1] * 10, [1] * 10], [0.7, 0.5], 2),
            ("two modes, region 10 times too wide", [0.5, 0.5], [[-3, 0], [3, 0]], [0.5, 0.5], 30),
            ("two modes, region too narrow", [0.3, 0.7], [[-3, 0], [3, 0]], [0.5, 0.5], 1),
            ("narrow in wide, 5", [0.5, 0.5], [[0] * 5, [1] * 5], [1.0, 0.2], 2)):
        log, mean, std = mixture(w, m, s)
        yield Density(name, log, normal(len(m[0]), spread), mean, std)


def of_tails():
    yield Density("Cauchy", student(1), normal(1, 3), INFINITE, INFINITE)
    yield Density("Cauchy, 2", student(1), normal(2, 3), INFINITE, INFINITE)
    yield Density("Student-t 2", student(2), normal(1, 3), [0], INFINITE)
    for nu, d in ((3, 1), (5, 1), (5, 2), (5, 5), (10, 5), (10, 10)):
        yield Density(f"Student-t {nu}, {d}", student(nu), normal(d, 2), [0] * d, [math.sqrt(nu / (nu - 2))] * d)
    yield Density("Laplace", lambda p: -np.abs(p[:, 0] - 1.7), normal(1), [1.7], [math.sqrt(2)])
    for d in (3, 10):
        yield Density(f"Laplace, {d}", lambda p: -np.abs(p).sum(1), normal(d), [0] * d, [math.sqrt(2)] * d)
    for name, region in (("10 times too wide", normal(2, 10)), ("10 times too narrow", normal(2, 0.1)), ("beside", normal(2, 1, 6))):
        yield Density(f"Student-t 5, 2, region {name}", student(5), region, [0] * 2, [math.sqrt(5 / 3)] * 2)
    log = lambda p: -np.abs(p[:, :1] - np.array([1, 2, 4, 2.5, 3])).sum(1)  # noqa: E731
    yield Density("L1 of five data", log, normal(1), *by_lines(log, -20, 25))
    yield Density("lognormal 1", inside(lambda p: p[:, 0] > 0, lambda p: -0.5 * np.log(p[:, 0]) ** 2 - np.log(p[:, 0])), normal(1, 2),
                  [math.exp(0.5)], [math.sqrt((math.e - 1) * math.e)])


def of_bounds():
    yield Density("exponential", inside(lambda p: p[:, 0] >= 0, lambda p: -p[:, 0]), normal(1, 2), [1], [1])
    yield Density("half normal", inside(lambda p: p[:, 0] >= 0, lambda p: -0.5 * p[:, 0] ** 2), normal(1, 2), [math.sqrt(2 / math.pi)],
                  [math.sqrt(1 - 2 / math.pi)])
    yield Density("half normal, region beside", inside(lambda p: p[:, 0] >= 0, lambda p: -0.5 * p[:, 0] ** 2), normal(1, 1, -3), [math.sqrt(2 / math.pi)],
                  [math.sqrt(1 - 2 / math.pi)])
    yield Density("half normal, 4", inside(lambda p: (p >= 0).all(1), lambda p: -0.5 * (p ** 2).sum(1)), normal(4, 2), [math.sqrt(2 / math.pi)] * 4,
                  [math.sqrt(1 - 2 / math.pi)] * 4)
    yield Density("disc", inside(lambda p: (p ** 2).sum(1) < 1), normal(2), [0, 0], [0.5, 0.5])
    yield Density("triangle", inside(lambda p: (p[:, 0] > 0) & (p[:, 0] < p[:, 1]) & (p[:, 1] < 1)), normal(2), [1 / 3, 2 / 3], [math.sqrt(1 / 18)] * 2)
    yield Density("square", inside(lambda p: (np.abs(p - 1) < 2).all(1)), normal(2), [1, 1], [2 / math.sqrt(3)] * 2)
    yield Density("square, region 10 times too wide", inside(lambda p: (np.abs(p - 1) < 2).all(1)), normal(2, 10), [1, 1], [2 / math.sqrt(3)] * 2)
    yield Density("cube, 6", inside(lambda p: ((p > 0) & (p < 1)).all(1)), [("uniform", -1, 2)] * 6, [0.5] * 6, [math.sqrt(1 / 12)] * 6)
    yield Density("plateau", lambda p: -((p ** 2).sum(1)) ** 4, normal(2, 2), *by_planes(lambda p: -((p ** 2).sum(1)) ** 4, -2, 2))
    yield Density("gamma 1.2", inside(lambda p: p[:, 0] > 0, lambda p: 0.2 * np.log(p[:, 0]) - p[:, 0]), normal(1, 2), [1.2], [math.sqrt(1.2)])
    yield Density("beta 2 3", inside(lambda p: (p[:, 0] > 0) & (p[:, 0] < 1), lambda p: np.log(p[:, 0]) + 2 * np.log1p(-p[:, 0])), [("uniform", 0, 1)],
                  [0.4], [0.2])


def rotated(d, condition):
    """A covariance in no special direction."""
    axes = np.linalg.qr(np.random.default_rng(d).standard_normal((d, d)))[0]
    return axes * np.geomspace(1 / math.sqrt(condition), math.sqrt(condition), d) @ axes.T


def positive(log):
    return inside(lambda p: (p >= 0).all(1), log)


def shapes():
    """Name, logarithm, means and deviations of some in more dimensions."""
    for d in (10, 20):
        yield f"Gaussian rotated, {d}", gaussian([0] * d, rotated(d, 100)), [0] * d, np.sqrt(np.diag(rotated(d, 100)))
        yield f"Gaussian, {d}, correlation 0.9", gaussian([1] * d, 0.1 * np.eye(d) + 0.9), [1] * d, [1] * d
    for d in (2, 3, 5):
        yield f"Student-t 3, {d}", student(3), [0] * d, [math.sqrt(3)] * d
    for d in (2, 3, 5, 10):
        yield f"exponential, {d}", positive(lambda p: -p.sum(1)), [1] * d, [1] * d
    for d in (2, 6, 10):
        yield (f"half normal, {d}", positive(lambda p: -0.5 * (p ** 2).sum(1)), [math.sqrt(2 / math.pi)] * d,
               [math.sqrt(1 - 2 / math.pi)] * d)
    for d in (2, 5, 20):
        yield f"Laplace, {d}", lambda p: -np.abs(p).sum(1), [0] * d, [math.sqrt(2)] * d
    for d in (1, 2, 5):
        yield f"0.9 wide, 0.1 narrow, {d}", *mixture([0.9, 0.1], [[0] * d, [1.5 / math.sqrt(d)] * d], [1, 0.1])
        yield f"0.9 narrow, 0.1 wide, {d}", *mixture([0.9, 0.1], [[0] * d, [3 / math.sqrt(d)] * d], [0.1, 1])


def of_regions():
    """Each shape over a region that fits it; one of each kind over those that do not."""
    plateau = lambda p: -((p ** 2).sum(1)) ** 4  # noqa: E731
    others = [("plateau", plateau, *by_planes(plateau, -2, 2)), ("funnel 1, 3", funnel(1.0), [0] * 3, [1.0] + [math.exp(0.25)] * 2),
              ("banana, 5", twisted(0.5, 0.3), [0, 0.5, 0, 0, 0], [1, math.sqrt(0.5 + 0.09), 1, 1, 1]),
              ("shell, 3", ring(2, 0.3), [0] * 3, [ring_std(2, 0.3, 3)] * 3)]
    regions = {"10 times too wide": (10, 0), "10 times too narrow": (0.1, 0), "beside": (1, 4)}
    hard = ("Gaussian, 10, correlation 0.9", "exponential, 3", "half normal, 6", "Laplace, 5", "0.9 wide, 0.1 narrow, 2")
    for name, log, mean, std in shapes():
        yield Density(name, log, [("normal", m, 2 * s) for m, s in zip(mean, std)], mean, std)
        others += [(name, log, mean, std)] * (name in hard)
    for name, log, mean, std in others:
        for region, (width, beside) in regions.items():
            yield Density(f"{name}, region {region}", log, [("normal", m + beside * s, width * s) for m, s in zip(mean, std)], mean, std)


def families():
    for family in (of_gaussians, of_bends, of_mixtures, of_tails, of_bounds, of_regions):
        yield from family()


def columns(p):
    return [p[:, k] for k in range(p.shape[1])]


def normal_log(x, mean, std):
    return -0.5 * ((x - mean) / std) ** 2 - np.log(std) + 0 * x


def ark(data):
    y, k = np.asarray(data["y"], float), data["K"]
    past = np.stack([np.ones(len(y) - k)] + [y[k - 1 - i:len(y) - 1 - i] for i in range(k)])

    def log(p):
        sigma = p[:, -1:]
        misfit = ((y[k:] - p[:, :-1] @ past) / sigma) ** 2
        return (-0.5 * misfit.sum(1) - (len(y) - k) * np.log(sigma[:, 0]) - 0.5 * (p[:, :-1] ** 2).sum(1) / 100
                - np.log1p((sigma[:, 0] / 2.5) ** 2))
    return log


def garch(data):
    y = np.asarray(data["y"], float)

    def log(p):
        mu, a0, a1, b1 = columns(p)
        variance, total = np.full(len(p), data["sigma1"] ** 2), np.zeros(len(p))
        for t in range(len(y)):
            if t > 0:
                variance = a0 + a1 * (y[t - 1] - mu) ** 2 + b1 * variance
            total += -0.5 * np.log(variance) - 0.5 * (y[t] - mu) ** 2 / variance
        return total
    return inside(lambda p: (p[:, 1] > 0) & (p[:, 2] > 0) & (p[:, 2] < 1) & (p[:, 3] > 0) & (p[:, 3] < 1 - p[:, 2]), log)


def lotka_volterra(data):
    times, y = [0.0] + list(data["ts"]), np.log(np.asarray([data["y_init"]] + data["y"], float))

    def log(p):
        th, z, sigma = p[:, :4], np.log(p[:, 4:6]), p[:, 6:8]
        slope = lambda z: np.stack([th[:, 0] - th[:, 1] * np.exp(z[:, 1]), -th[:, 2] + th[:, 3] * np.exp(z[:, 0])], 1)  # noqa: E731
        total = (-0.5 * ((th[:, 0] - 1) ** 2 + (th[:, 2] - 1) ** 2) / 0.25 - 0.5 * ((th[:, 1] - 0.05) ** 2 + (th[:, 3] - 0.05) ** 2) / 0.0025
                 + (-0.5 * (np.log(sigma) + 1) ** 2 - np.log(sigma)).sum(1) + (-0.5 * (z - math.log(10)) ** 2 - z).sum(1))
        for i, t in enumerate(times):
            if i > 0:
                h = (t - times[i - 1]) / 20
                for _ in range(20):
                    k1 = slope(z)
                    k2 = slope(z + h / 2 * k1)
                    k3 = slope(z + h / 2 * k2)
                    z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope(z + h * k3))
            total = total + normal_log(y[i], z, sigma).sum(1)
        return np.where(np.isfinite(total), total, -np.inf)
    return inside(lambda p: (p > 0).all(1), log)


def line(data):
    x, y = (np.asarray(data[key], float) for key in ("x", "y"))
    return inside(lambda p: p[:, 2] > 0, lambda p: normal_log(y, p[:, :1] + p[:, 1:2] * x, p[:, 2:3]).sum(1)
                  + normal_log(p[:, 0], data["pmualpha"], data["psalpha"]) + normal_log(p[:, 1], data["pmubeta"], data["psbeta"]))


def gaussian_mixture(data):
    y = np.asarray(data["y"], float)

    def log(p):
        m1, m2, s1, s2, theta = columns(p)
        one = np.log(theta)[:, None] + normal_log(y, m1[:, None], s1[:, None])
        two = np.log1p(-theta)[:, None] + normal_log(y, m2[:, None], s2[:, None])
        return np.logaddexp(one, two).sum(1) - 0.5 * (p[:, :4] ** 2).sum(1) / 4 + 4 * np.log(theta * (1 - theta))
    return inside(lambda p: (p[:, 0] < p[:, 1]) & (p[:, 2] > 0) & (p[:, 3] > 0) & (p[:, 4] > 0) & (p[:, 4] < 1), log)


def schools(data):
    y, sigma = (np.asarray(data[key], float) for key in ("y", "sigma"))

    def log(p):
        t, mu, tau = p[:, :8], p[:, 8:9], p[:, 9:]
        return (-0.5 * ((y - mu - tau * t) / sigma) ** 2 - 0.5 * t ** 2).sum(1) - 0.5 * mu[:, 0] ** 2 / 25 - np.log1p((tau[:, 0] / 5) ** 2)
    return inside(lambda p: p[:, 9] > 0, log)


def process(data):
    x, y = (np.asarray(data[key], float) for key in ("x", "y"))
    square = (x[:, None] - x) ** 2

    def log(p):
        rho, alpha, sigma = columns(p)
        c = alpha[:, None, None] ** 2 * np.exp(-0.5 * square / rho[:, None, None] ** 2) + sigma[:, None, None] * np.eye(len(x))
        try:
            lower = np.linalg.cholesky(c)
        except np.linalg.LinAlgError:  # of one of them: each for itself
            return np.array([-np.inf]) if len(p) == 1 else np.concatenate([log(one[None]) for one in p])
        z = np.linalg.solve(lower, np.broadcast_to(y[:, None], (len(p), len(y), 1)))[..., 0]
        return (-0.5 * (z ** 2).sum(1) - np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(1) + 24 * np.log(rho) - 4 * rho
                - alpha ** 2 / 8 - sigma ** 2 / 2)
    return inside(lambda p: (p > 1e-6).all(1) & (p < 1e6).all(1), log)


def regression(data):
    x, y = (np.asarray(data[key], float) for key in ("X", "y"))
    return inside(lambda p: p[:, 5] > 0, lambda p: normal_log(y, p[:, :5] @ x.T, p[:, 5:]).sum(1) - 0.5 * (p ** 2).sum(1) / 100)


PUBLISHED = {"arK-arK": ark, "garch-garch11": garch, "hudson_lynx_hare-lotka_volterra": lotka_volterra, "kilpisjarvi_mod-kilpisjarvi": line,
             "low_dim_gauss_mix-low_dim_gauss_mix": gaussian_mixture, "eight_schools-eight_schools_noncentered": schools,
             "gp_pois_regr-gp_regr": process, "sblrc-blr": regression}


def guarded(log):
    """Outside the support NumPy computes before it is masked: silently, and only where the mask lets it."""
    def quiet(p):
        with np.errstate(all="ignore"):
            value = log(p)
        return np.where(np.isnan(value), -np.inf, value)
    return quiet


def published(folder):
    """Of the data base's posteriors, over regions three times as wide as they are and one deviation beside."""
    for name, make in PUBLISHED.items():
        content = json.loads((pathlib.Path(folder) / f"{name}.json").read_text())
        reference = content["reference"]
        if name.startswith("eight"):  # t of the file's θ = μ + τ t has no reference: nearly N(0, 1)
            region = normal(8) + [("normal", 4, 4), ("lognormal", 1, 1)]
            density = Density(name, make(content["data"]), region, [reference[k]["mean"] for k in ("mu", "tau")],
                              [reference[k]["std"] for k in ("mu", "tau")])
            density.columns = [8, 9]
        else:
            region = []
            middle = np.array([[r["mean"] for r in reference.values()]])
            for k, r in enumerate(reference.values()):
                mirrored = middle.copy()
                mirrored[0, k] *= -1
                if np.isneginf(guarded(make(content["data"]))(mirrored)[0]) and middle[0, k] > 0:  # a positive parameter
                    region.append(("lognormal", math.log(r["q50"]) + r["std"] / r["mean"], 3 * r["std"] / r["mean"]))
                else:
                    region.append(("normal", r["mean"] + r["std"], 3 * r["std"]))
            density = Density(name, make(content["data"]), region, [r["mean"] for r in reference.values()], [r["std"] for r in reference.values()])
        density.log = guarded(density.log)
        yield density
