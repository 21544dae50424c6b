"""The formula of make_snapshots.cpp once more, and the posterior it gives by dense quadrature: an answer that shares nothing with knothe."""
import math

HALF_LENGTH, HEIGHT, THICKNESS = 0.12, 0.1, 0.05
LOWER, UPPER, NODES, STEPS = 0.5, 1.5, 7, 12
LEVELS = [0.025, 0.25, 0.5, 0.75, 0.975]


def time(step):
    return (step + 1) / STEPS


def node(index):
    return LOWER + (UPPER - LOWER) * index / (NODES - 1)


def dof(index):
    """Component and point of a dof: nodes x fastest, three components each."""
    n, c = divmod(index, 3)
    return c, (HALF_LENGTH * (2 * (n % 9) / 8 - 1), HEIGHT * (n // 9 % 3) / 2, THICKNESS * (n // 27))


DOFS = 3 * 9 * 3 * 2


def shapes(c, point):
    """The field at a point is lift(t) + sum over these three of their factor (see factors)."""
    x, y, z = point
    s, r = x / HALF_LENGTH, y / HEIGHT
    elastic = [0.2 * s * (1 - 2 * r), s * s - 1, 0.05 * s * z / THICKNESS][c]
    brittle = [math.sin(20 * x), math.cos(15 * x), 0.3][c]
    onset = [math.cos(25 * x + 10 * y), math.sin(25 * x + 10 * y), 0.2][c]
    return elastic, (brittle, onset, r * math.cos(10 * x))


def factors(t, y0, ad):
    return (12e-6 * ad * t * t, 8e-6 * math.exp(-y0) * math.sin(math.pi * t), 5e-6 * t * math.exp(-0.5 * y0 * ad))


def displacement(c, point, t, y0, ad):
    elastic, others = shapes(c, point)
    return 4e-4 * t * elastic + sum(f * s for f, s in zip(factors(t, y0, ad), others))


def reaction_force(t, y0, ad):
    return 2000 * t * math.exp(-0.3 * y0 * ad)


def gauss_legendre(n):
    """Nodes and weights on [LOWER, UPPER], by Newton's method on the Legendre polynomial."""
    nodes, weights = [], []
    for i in range(n):
        x = math.cos(math.pi * (i + 0.75) / (n + 0.5))
        for _ in range(50):
            p, q = 1.0, 0.0
            for k in range(n):
                p, q = ((2 * k + 1) * x * p - k * q) / (k + 1), p
            derivative = n * (x * p - q) / (x * x - 1)
            step = p / derivative
            x -= step
            if abs(step) < 1e-15:
                break
        half = (UPPER - LOWER) / 2
        nodes.append((LOWER + UPPER) / 2 + half * x)
        weights.append(half * 2 / ((1 - x * x) * derivative * derivative))
    return nodes, weights


class Posterior:
    """Gaussian noise, normal priors truncated to the box; after each step the moments by quadrature on n × n Gauss points."""

    def __init__(self, priors, n=96):
        self.nodes, weights = gauss_legendre(n)
        self.log_prior = [self._log_density(mean, std) for mean, std in priors]
        self.points = [(a, b) for a in self.nodes for b in self.nodes]
        self.log_weights = [math.log(v) + math.log(w) for v in weights for w in weights]
        self.log_weights = [w + self.log_prior[0](a) + self.log_prior[1](b)
                            for w, (a, b) in zip(self.log_weights, self.points)]

    @staticmethod
    def _log_density(mean, std):
        def cumulative(x):
            return 0.5 * math.erfc((mean - x) / (std * math.sqrt(2)))

        constant = -math.log(std * math.sqrt(2 * math.pi)) - math.log(cumulative(UPPER) - cumulative(LOWER))
        return lambda p: constant - 0.5 * ((p - mean) / std) ** 2

    def add(self, t, observations):
        """observations: (component, point, value, std). The misfit is a quadratic form in the three factors."""
        gram = [[0.0] * 3 for _ in range(3)]
        right, constant = [0.0] * 3, 0.0
        for c, point, value, std in observations:
            elastic, s = shapes(c, point)
            residual = value - 4e-4 * t * elastic
            constant -= 0.5 * (residual / std) ** 2 + math.log(std * math.sqrt(2 * math.pi))
            for i in range(3):
                right[i] += s[i] * residual / std ** 2
                for j in range(3):
                    gram[i][j] += s[i] * s[j] / std ** 2
        for index, (y0, ad) in enumerate(self.points):
            f = factors(t, y0, ad)
            quadratic = sum(f[i] * f[j] * gram[i][j] for i in range(3) for j in range(3))
            self.log_weights[index] += constant + sum(f[i] * right[i] for i in range(3)) - 0.5 * quadratic

    def add_number(self, value, std, formula):
        """One number measured with the standard deviation `std`, of which the model says `formula`(Y0, Ad)."""
        for index, (y0, ad) in enumerate(self.points):
            miss = (value - formula(y0, ad)) / std
            self.log_weights[index] -= 0.5 * miss * miss + math.log(std * math.sqrt(2 * math.pi))

    def summary(self, step, swap=False):
        """A line as knothe prints it, as far as quadrature gives it."""
        top = max(self.log_weights)
        w = [math.exp(v - top) for v in self.log_weights]
        total = sum(w)
        mean = [sum(v * p[k] for v, p in zip(w, self.points)) / total for k in (0, 1)]
        covariance = [[sum(v * (p[i] - mean[i]) * (p[j] - mean[j]) for v, p in zip(w, self.points)) / total
                       for j in (0, 1)] for i in (0, 1)]
        quantiles = [self._quantiles(w, total, k) for k in (0, 1)]
        return {"step": step, "mean": mean, "covariance": covariance,
                "quantiles": {"levels": LEVELS, "values": quantiles}, "log_evidence": top + math.log(total)}

    def _quantiles(self, w, total, k):
        """From the marginal's masses at the sorted Gauss points, each spread half before and half after its point."""
        n = len(self.nodes)
        masses = [sum(w[i * n + j] if k == 0 else w[j * n + i] for j in range(n)) / total for i in range(n)]
        pairs = sorted(zip(self.nodes, masses))
        found, below, values = [], 0.0, []
        for x, mass in pairs:
            found.append((x, below + mass / 2))
            below += mass
        for level in LEVELS:
            for (x0, c0), (x1, c1) in zip([(LOWER, 0.0)] + found, found + [(UPPER, 1.0)]):
                if c0 <= level <= c1 and c1 > c0:
                    values.append(x0 + (x1 - x0) * (level - c0) / (c1 - c0))
                    break
        return values

    def moments_of(self, function):
        top = max(self.log_weights)
        w = [math.exp(v - top) for v in self.log_weights]
        values = [function(*p) for p in self.points]
        mean = sum(v * q for v, q in zip(w, values)) / sum(w)
        return mean, math.sqrt(sum(v * (q - mean) ** 2 for v, q in zip(w, values)) / sum(w))


def moments_on_a_grid(log_posterior):
    """Mean and standard deviations of log_posterior(Y0, Ad), on a grid that narrows about the mass."""
    import numpy  # which not every case has

    y0, ad = numpy.linspace(LOWER, UPPER, 61), numpy.linspace(LOWER, UPPER, 61)
    for _ in range(4):
        table = numpy.array([[log_posterior(a, b) for b in ad] for a in y0])
        weight = numpy.exp(table - table.max())
        weight /= weight.sum()
        mean = [(weight.sum(1) * y0).sum(), (weight.sum(0) * ad).sum()]
        std = [max(((weight.sum(1) * (y0 - mean[0]) ** 2).sum()) ** 0.5, (y0[1] - y0[0])),
               max(((weight.sum(0) * (ad - mean[1]) ** 2).sum()) ** 0.5, (ad[1] - ad[0]))]
        y0, ad = (numpy.linspace(max(LOWER, m - 6 * s), min(UPPER, m + 6 * s), 61) for m, s in zip(mean, std))
    return {"mean": mean, "std": std}
