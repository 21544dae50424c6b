"""A small UM-Bridge 1.0 server for the cases, standard library only, with modes in which a server goes wrong.

usage: umbridge_server.py MODEL [MODE [N]]; prints its port. MODE, after N good requests to the model:
good, hold, hang, die, wrong-size, nan, null, error, not-json, old-protocol, close (connections, as HTTP/1.0 does).
What `hold` holds is never answered; POST /Good with {"more": N} lets the next N requests pass, /Statistics counts as "held" those since.
"""
import http.server
import json
import math
import os
import sys
import threading
import time


class Model:
    """One function of a list of numbers, with derivatives by hand where it has them."""

    name = "forward"
    inputs, outputs = [2], [2]
    support = {"Evaluate": True, "Gradient": False, "ApplyJacobian": False, "ApplyHessian": False}

    def value(self, p, config):
        raise NotImplementedError

    def jacobian(self, p, config):
        """Rows: outputs."""
        raise NotImplementedError

    def hessian(self, p, config):
        """One matrix per output."""
        raise NotImplementedError


class Linear(Model):
    """y = A p with A of three rows."""

    inputs, outputs = [2], [3]
    matrix = [[1.0, 0.5], [0.3, -1.0], [1.0, 2.0]]

    def value(self, p, config):
        scale = config.get("scale", 1.0)
        return [scale * sum(a * x for a, x in zip(row, p)) for row in self.matrix]

    def jacobian(self, p, config):
        return self.matrix

    def hessian(self, p, config):
        return [[[0.0] * len(p) for _ in p] for _ in self.matrix]


class Moving(Linear):
    """Other values for every client that asks what the model can do: two runs see two models."""

    runs = 0

    def value(self, p, config):
        return [y + 2.0 * self.runs for y in super().value(p, config)]


class Linear3(Linear):
    """Three parameters in two input vectors, outputs in two vectors."""

    inputs, outputs = [2, 1], [1, 3]
    matrix = [[1.0, 0.5, 0.2], [0.3, -1.0, 0.0], [1.0, 2.0, -0.5], [0.0, 0.4, 1.5]]


class Banana(Model):
    """(x, y − x²)."""

    def value(self, p, config):
        return [p[0], p[1] - p[0] ** 2]

    def jacobian(self, p, config):
        return [[1.0, 0.0], [-2 * p[0], 1.0]]

    def hessian(self, p, config):
        return [[[0.0, 0.0], [0.0, 0.0]], [[-2.0, 0.0], [0.0, 0.0]]]


class Identity(Model):
    """y = p."""

    def value(self, p, config):
        return list(p)

    def jacobian(self, p, config):
        return [[1.0, 0.0], [0.0, 1.0]]


class TwoModes(Model):
    """|x|: the sign is not seen."""

    inputs, outputs = [2], [2]

    def value(self, p, config):
        return [p[0] ** 2, p[1]]


class Density(Model):
    """log N(p; (1, −2), C) + 3 of p itself, not centred, not normalised."""

    name = "posterior"
    inputs, outputs = [2], [1]
    mean, precision = [1.0, -2.0], [[2.0, 0.6], [0.6, 1.0]]

    def value(self, p, config):
        c = [p[0] - self.mean[0], p[1] - self.mean[1]]
        q = sum(c[i] * self.precision[i][j] * c[j] for i in range(2) for j in range(2))
        return [-0.5 * q + 3.0]

    def jacobian(self, p, config):
        c = [p[0] - self.mean[0], p[1] - self.mean[1]]
        return [[-sum(self.precision[i][j] * c[j] for j in range(2)) for i in range(2)]]

    def hessian(self, p, config):
        return [[[-x for x in row] for row in self.precision]]


class Exponential(Model):
    """log-density of a gamma(3, rate 2) variable and a beta(2, 3) one, −∞ outside."""

    name = "posterior"
    inputs, outputs = [1, 1], [1]

    def value(self, p, config):
        if p[0] <= 0 or not 0 < p[1] < 1:
            return [-math.inf]
        return [2 * math.log(p[0]) - 2 * p[0] + math.log(p[1]) + 2 * math.log(1 - p[1])]


class Laplace(Model):
    """-|a - 1.7|."""

    name = "posterior"
    inputs, outputs = [1], [1]

    def value(self, p, config):
        return [-abs(p[0] - 1.7)]


class HalfNormal(Laplace):
    def value(self, p, config):
        return [-0.5 * p[0] ** 2 if p[0] >= 0 else -1e308]


class Cauchy(Laplace):
    def value(self, p, config):
        return [-math.log(math.pi * (1 + p[0] ** 2))]


class Disc(Laplace):
    inputs = [2]

    def value(self, p, config):
        return [0.0 if p[0] ** 2 + p[1] ** 2 < 1 else -1e308]


class Improper(Density):
    """Log-densities of no finite integral: flat along y; rising along x; tails of 1/r in two dimensions; growing like a square."""

    def value(self, p, config):
        x, y = p
        return [{"flat": -0.5 * x * x, "rising": x - 0.5 * y * y, "heavy": -0.5 * math.log(1 + x * x + y * y),
                 "growing": 0.5 * x * x - 0.5 * y * y}[config["shape"]]]


class EightSchools(Model):
    """Log-density of the eight schools (D. Rubin 1981), not centred: theta_j = mu + tau eta_j, mu = 5 z_0, tau = exp(1 + z_1)."""

    name = "posterior"
    inputs, outputs = [10], [1]
    effects, errors = [28, 8, -3, 7, -1, 1, 18, 12], [15, 10, 16, 11, 9, 11, 10, 18]

    def residuals(self, p):
        tau = math.exp(1 + p[1])
        return tau, [(y - 5 * p[0] - tau * eta) / s for y, s, eta in zip(self.effects, self.errors, p[2:])]

    def value(self, p, config):
        _, residuals = self.residuals(p)
        return [-0.5 * sum(r * r for r in residuals) - 0.5 * sum(x * x for x in p)]

    def jacobian(self, p, config):
        tau, residuals = self.residuals(p)
        scaled = [r / s for r, s in zip(residuals, self.errors)]
        slope = [5 * sum(scaled), tau * sum(r * eta for r, eta in zip(scaled, p[2:]))] + [tau * r for r in scaled]
        return [[g - x for g, x in zip(slope, p)]]


class Growth(Model):
    """Four parameters: y(t) = a (1 - exp(-b t)) + c + d t at eight times."""

    inputs, outputs = [4], [8]
    times = [0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0]

    def value(self, p, config):
        a, b, c, d = p
        return [a * (1 - math.exp(-b * t)) + c + d * t for t in self.times]


class Growth3(Growth):
    """The same without the drift, d = 0."""

    inputs = [3]

    def value(self, p, config):
        return super().value([*p, 0.0], config)


class Growth1(Growth):
    """Of b alone: 2 (1 - exp(-b t)) + 0.3."""

    inputs = [1]

    def value(self, p, config):
        return super().value([2.0, p[0], 0.3, 0.0], config)


class WrongSlope(Banana):
    """A sign forgotten in the derivative."""

    def jacobian(self, p, config):
        return [[1.0, 0.0], [2 * p[0], 1.0]]


MODELS = {cls.__name__.lower(): cls for cls in (Linear, Linear3, Moving, Laplace, HalfNormal, Cauchy, Disc, Banana, Identity, TwoModes, Density, Exponential, Improper, EightSchools, Growth, Growth3, Growth1, WrongSlope)}
DERIVATIVES = {"gradient": ["Gradient"], "jacobian": ["ApplyJacobian"], "hessian": ["Gradient", "ApplyJacobian", "ApplyHessian"]}


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def log_message(self, *arguments):
        pass

    def answer(self, value, status=200):
        self.raw(json.dumps(value).encode(), status)

    def raw(self, body, status=200):
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def fail(self, kind, message, status):
        self.answer({"error": {"type": kind, "message": message}}, status)

    def do_GET(self):
        if self.path != "/Info":
            return self.fail("NotFound", self.path, 404)
        self.answer({"protocolVersion": 0.9 if self.server.mode == "old-protocol" else 1.0,
                     "models": [self.server.model.name, "another"]})

    def do_POST(self):
        server, model = self.server, self.server.model
        request = json.loads(self.rfile.read(int(self.headers.get("Content-Length", 0))) or "{}")
        server.count(self.path)
        if self.path == "/Info":
            return self.do_GET()
        if self.path == "/Statistics":
            return self.answer({**server.calls, "held": server.held})
        if self.path == "/Good":
            server.let_pass(request["more"])
            return self.answer({})
        if request.get("name") != model.name:
            return self.fail("ModelNotFound", f"Model {request.get('name')} not found!", 400)
        if self.path == "/ModelInfo":
            model.runs = getattr(model, "runs", 0) + 1
            return self.answer({"support": model.support})
        if self.path == "/InputSizes":
            return self.answer({"inputSizes": model.inputs})
        if self.path == "/OutputSizes":
            return self.answer({"outputSizes": model.outputs})
        if server.goes_wrong(self):
            return
        self.compute(request, model)

    def compute(self, request, model):
        feature, config = self.path[1:], request.get("config", {})
        if not model.support.get(feature):
            return self.fail("UnsupportedFeature", f"{feature} not supported by model!", 400)
        if [len(v) for v in request["input"]] != model.inputs:
            return self.fail("InvalidInput", "wrong sizes", 400)
        p = [x for vector in request["input"] for x in vector]
        if feature == "Evaluate":
            return self.answer({"output": cut(model.value(p, config), model.outputs)})
        rows = part(model.outputs, request["outWrt"])
        if feature == "Gradient":
            j, columns = model.jacobian(p, config), part(model.inputs, request["inWrt"])
            self.answer({"output": [sum(s * j[r][c] for s, r in zip(request["sens"], rows)) for c in columns]})
        elif feature == "ApplyJacobian":
            j, columns = model.jacobian(p, config), part(model.inputs, request["inWrt"])
            self.answer({"output": [sum(v * j[r][c] for v, c in zip(request["vec"], columns)) for r in rows]})
        else:
            h = model.hessian(p, config)
            first, second = part(model.inputs, request["inWrt1"]), part(model.inputs, request["inWrt2"])
            self.answer({"output": [sum(s * v * h[r][a][b] for s, r in zip(request["sens"], rows)
                                        for v, b in zip(request["vec"], second)) for a in first]})


def part(sizes, i):
    return range(sum(sizes[:i]), sum(sizes[:i + 1]))


def cut(values, sizes):
    return [[values[k] for k in part(sizes, i)] for i in range(len(sizes))]


class Server(http.server.ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = 64  # many connections may come at once

    def __init__(self, model, mode, after):
        super().__init__(("127.0.0.1", 0), Handler)
        self.model, self.mode, self.after = model, mode, after
        self.calls, self.held, self.lock = {}, 0, threading.Lock()

    def let_pass(self, more):
        with self.lock:
            self.after, self.held = more, 0

    def count(self, path):
        with self.lock:
            self.calls[path] = self.calls.get(path, 0) + 1

    def goes_wrong(self, handler):
        """Whether this request was answered wrongly, or not at all."""
        with self.lock:
            self.after -= 1
            if self.after >= 0:
                return False
            self.held += 1
        mode = self.mode
        if mode == "hold":
            threading.Event().wait()
        elif mode == "hang":
            time.sleep(60)
        elif mode == "die":
            os._exit(1)
        elif mode == "wrong-size":
            handler.answer({"output": [[0.0] * (sum(self.model.outputs) + 1)]})
        elif mode == "nan":
            handler.raw(b'{"output": [[NaN, 0.0, 0.0]] }')
        elif mode == "null":
            handler.answer({"output": [[None, 0.0, 0.0]]})
        elif mode == "error":
            handler.fail("InvalidInput", "the mesh is inverted at element 17", 500)
        elif mode == "not-json":
            handler.raw(b"<html>Bad gateway</html>", 502)
        return mode in ("hang", "wrong-size", "nan", "null", "error", "not-json")


def main():
    words = sys.argv[1:]
    name, *derivatives = words[0].split("+")
    model = MODELS[name]()
    model.support = dict(model.support)
    for word in derivatives:
        for feature in DERIVATIVES[word]:
            model.support[feature] = True
    mode = words[1] if len(words) > 1 else "good"
    if mode == "close":
        Handler.protocol_version = "HTTP/1.0"
    server = Server(model, mode, int(words[2]) if len(words) > 2 else 0)
    print(server.server_address[1], flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main()
