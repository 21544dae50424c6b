#!/usr/bin/env python3
"""Biochemical oxygen demand, B(t) = a (1 − exp(−b t)), as a UM-Bridge 1.0 model with the standard library alone.

Any UM-Bridge server will do in its place; most are written with the packages of https://github.com/UM-Bridge/umbridge.
usage: python3 examples/umbridge/server.py [PORT]
"""
import http.server
import json
import math
import sys

TIMES = [1.0, 2.0, 3.0, 4.0, 5.0]


def evaluate(a, b):
    return [a * (1 - math.exp(-b * t)) for t in TIMES]


def jacobian(a, b):
    return [[1 - math.exp(-b * t), a * t * math.exp(-b * t)] for t in TIMES]


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"  # connections stay open
    disable_nagle_algorithm = True

    def do_GET(self):
        self.reply({"protocolVersion": 1.0, "models": ["forward"]})

    def do_POST(self):
        request = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        if self.path == "/ModelInfo":
            self.reply({"support": {"Evaluate": True, "Gradient": True, "ApplyJacobian": True, "ApplyHessian": False}})
        elif self.path == "/InputSizes":
            self.reply({"inputSizes": [2]})
        elif self.path == "/OutputSizes":
            self.reply({"outputSizes": [len(TIMES)]})
        elif self.path == "/Evaluate":
            self.reply({"output": [evaluate(*request["input"][0])]})
        elif self.path == "/Gradient":
            rows = jacobian(*request["input"][0])
            self.reply({"output": [sum(s * row[k] for s, row in zip(request["sens"], rows)) for k in range(2)]})
        elif self.path == "/ApplyJacobian":
            rows = jacobian(*request["input"][0])
            self.reply({"output": [sum(v * x for v, x in zip(request["vec"], row)) for row in rows]})
        else:
            self.reply({"error": {"type": "UnsupportedFeature", "message": f"{self.path} is not supported"}}, 400)

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
    http.server.ThreadingHTTPServer(("127.0.0.1", port), Handler).serve_forever()
