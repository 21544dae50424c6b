"""What the cases of `knothe infer` share: a server of their own, and exact answers."""
import json
import math
import pathlib
import signal
import subprocess
import sys
import urllib.request

from support import Case

SERVER = pathlib.Path(__file__).resolve().parent / "umbridge_server.py"


class InferCase(Case):
    project_name = "infer.toml"

    def serve(self, model, mode="good", after=0):
        """Starts a server and puts its port into the project file."""
        server = subprocess.Popen([sys.executable, str(SERVER), model, mode, str(after)], stdout=subprocess.PIPE, text=True)
        self.addCleanup(server.stdout.close)
        self.addCleanup(server.wait)
        self.addCleanup(server.send_signal, signal.SIGKILL)
        self.port = int(server.stdout.readline())
        self.edit("PORT", str(self.port))

    def ask_server(self, path, value={}):
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", data=json.dumps(value).encode())
        with urllib.request.urlopen(request) as answer:
            return json.load(answer)

    def server_calls(self):
        return self.ask_server("/Statistics")

    def infer(self, *arguments, status=0):
        """The line of `knothe infer --json`."""
        outcome = self.run_knothe("infer", self.project_name, "--json", *arguments)
        self.assertIn(outcome.status, status if isinstance(status, tuple) else (status,), str(outcome))
        lines = outcome.lines()
        self.assertEqual(len(lines), 1, str(outcome))
        return lines[0]

    def set_priors(self, *lines):
        text = self.project.read_text()
        begin, end = text.index("[parameters]"), text.index("[model]")
        self.project.write_text(text[:begin] + "[parameters]\n" + "\n".join(lines) + "\n\n" + text[end:])

    def set_observations(self, *lines):
        text = self.project.read_text()
        begin, end = text.index("[observations]"), text.index("[method]")
        kept = "[observations]\n" + "\n".join(lines) + "\n\n" if lines else ""
        self.project.write_text(text[:begin] + kept + text[end:])

    def expect_close(self, line, mean, covariance, log_evidence=None, mean_tolerance=0.01, std_tolerance=0.01,
                     evidence_tolerance=0.01):
        for k, exact in enumerate(mean):
            sigma = math.sqrt(covariance[k][k])
            self.assertAlmostEqual(line["mean"][k], exact, delta=mean_tolerance * sigma)
            self.assertAlmostEqual(math.sqrt(line["covariance"][k][k]), sigma, delta=std_tolerance * sigma)
        for i in range(len(mean)):
            for j in range(i):
                scale = math.sqrt(covariance[i][i] * covariance[j][j])
                self.assertAlmostEqual(line["covariance"][i][j], covariance[i][j], delta=2 * std_tolerance * scale)
        if log_evidence is not None:
            self.assertAlmostEqual(line["log_evidence"], log_evidence, delta=evidence_tolerance)


def solve(matrix, columns):
    """Gauss–Jordan; returns the solution and the determinant."""
    n = len(matrix)
    rows = [list(map(float, matrix[i])) + list(map(float, columns[i])) for i in range(n)]
    determinant = 1.0
    for i in range(n):
        pivot = max(range(i, n), key=lambda r: abs(rows[r][i]))
        if pivot != i:
            rows[i], rows[pivot] = rows[pivot], rows[i]
            determinant = -determinant
        determinant *= rows[i][i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for r in range(n):
            if r != i:
                rows[r] = [x - rows[r][i] * y for x, y in zip(rows[r], rows[i])]
    return [row[n:] for row in rows], determinant


def conjugate(matrix, values, noise_covariance, prior_mean, prior_std):
    """Posterior mean and covariance and log-evidence of y = A p + noise with a Gaussian prior."""
    m, d = len(matrix), len(prior_mean)
    predicted = [sum(matrix[i][k] * prior_mean[k] for k in range(d)) for i in range(m)]
    residual = [y - f for y, f in zip(values, predicted)]
    cross = [[prior_std[k] ** 2 * matrix[i][k] for i in range(m)] for k in range(d)]  # C Aᵀ, d × m
    marginal = [[sum(matrix[i][k] * cross[k][j] for k in range(d)) + noise_covariance[i][j] for j in range(m)] for i in range(m)]
    columns = [[residual[i]] + [cross[k][i] for k in range(d)] for i in range(m)]
    solution, determinant = solve(marginal, columns)
    mean = [prior_mean[k] + sum(cross[k][i] * solution[i][0] for i in range(m)) for k in range(d)]
    covariance = [[(prior_std[k] ** 2 if k == l else 0.0) - sum(cross[k][i] * solution[i][1 + l] for i in range(m))
                   for l in range(d)] for k in range(d)]
    quadratic = sum(r * s[0] for r, s in zip(residual, solution))
    return mean, covariance, -0.5 * (quadratic + math.log(determinant) + m * math.log(2 * math.pi))


def diagonal(std):
    return [[s * s if i == j else 0.0 for j in range(len(std))] for i, s in enumerate(std)]


def quadrature(log_density, boxes, nodes=400):
    """Log of the integral, means, variances of exp(log_density(x, y)) by the midpoint rule."""
    (a, b), (c, d) = boxes
    xs = [a + (b - a) * (i + 0.5) / nodes for i in range(nodes)]
    ys = [c + (d - c) * (j + 0.5) / nodes for j in range(nodes)]
    values = [[log_density(x, y) for y in ys] for x in xs]
    top = max(map(max, values))
    total = [0.0] * 6
    for x, row in zip(xs, values):
        for y, value in zip(ys, row):
            w = math.exp(value - top) if value > top - 700 else 0.0
            for k, moment in enumerate((1, x, y, x * x, y * y, x * y)):
                total[k] += w * moment
    cell = (b - a) * (d - c) / nodes ** 2
    s, x, y, xx, yy, xy = total
    mean = [x / s, y / s]
    covariance = [[xx / s - mean[0] ** 2, xy / s - mean[0] * mean[1]], [xy / s - mean[0] * mean[1], yy / s - mean[1] ** 2]]
    return top + math.log(s * cell), mean, covariance
