#!/usr/bin/env python3
"""A function in Python as a UM-Bridge 1.0 model, with the standard library alone.

Without a file it is the biochemical oxygen demand B(t) = a (1 − exp(−b t)). Any UM-Bridge server will do in its place; most are
written with the packages of https://github.com/UM-Bridge/umbridge.

usage: python3 examples/umbridge/server.py [PORT [MODEL.py]]
MODEL.py has evaluate(p1, p2, …), which returns all outputs, OUTPUTS, their number, and jacobian(p1, p2, …), rows: outputs, if it can.
"""
import http.server
import importlib.util
import inspect
import json
import math
import sys
import threading
import types

TIMES = [1.0, 2.0, 3.0, 4.0, 5.0]


def evaluate(a, b):
    return [a * (1 - math.exp(-b * t)) for t in TIMES]


def jacobian(a, b):
    return [[1 - math.exp(-b * t), a * t * math.exp(-b * t)] for t in TIMES]


MODEL = types.SimpleNamespace(evaluate=evaluate, jacobian=jacobian, OUTPUTS=len(TIMES))
ONE_AT_A_TIME = threading.Lock()  # solvers may not be made for several threads


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"  # connections stay open
    disable_nagle_algorithm = True

    def do_GET(self):
        self.reply({"protocolVersion": 1.0, "models": ["forward"]})

    def do_POST(self):
        request = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        try:
            with ONE_AT_A_TIME:
                self.reply(self.answer(request))
        except Exception as error:  # told to whoever asked; the server goes on
            self.reply({"error": {"type": "InvalidInput", "message": f"{self.path}: {error}"}}, 500)

    def answer(self, request):
        differentiable = hasattr(MODEL, "jacobian")
        if self.path == "/ModelInfo":
            return {"support": {"Evaluate": True, "Gradient": differentiable, "ApplyJacobian": differentiable, "ApplyHessian": False}}
        if self.path == "/InputSizes":
            return {"inputSizes": [len(inspect.signature(MODEL.evaluate).parameters)]}
        if self.path == "/OutputSizes":
            return {"outputSizes": [MODEL.OUTPUTS]}
        parameters = request["input"][0]
        if self.path == "/Evaluate":
            return {"output": [[float(value) for value in MODEL.evaluate(*parameters)]]}
        rows = MODEL.jacobian(*parameters)
        if self.path == "/Gradient":
            return {"output": [sum(s * row[k] for s, row in zip(request["sens"], rows)) for k in range(len(parameters))]}
        if self.path == "/ApplyJacobian":
            return {"output": [sum(v * x for v, x in zip(request["vec"], row)) for row in rows]}
        raise ValueError("not supported")

    def reply(self, value, status=200):
        body = json.dumps(value).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments):
        pass


if __name__ == "__main__":
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 4242
    if len(sys.argv) > 2:
        specification = importlib.util.spec_from_file_location("model", sys.argv[2])
        MODEL = importlib.util.module_from_spec(specification)
        specification.loader.exec_module(MODEL)
    http.server.ThreadingHTTPServer(("127.0.0.1", port), Handler).serve_forever()
