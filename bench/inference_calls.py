#!/usr/bin/env python3
"""What `knothe infer` asks of a UM-Bridge server, counted there: calls of each kind, and how far the answer is from the same by long chains.

usage: inference_calls.py KNOTHE [SEED…]
The problems are those of the tests (tests/cases/umbridge_server.py). Standard library only.
"""
import json
import os
import pathlib
import platform
import subprocess
import sys
import tempfile
import urllib.request

SERVER = pathlib.Path(__file__).resolve().parents[1] / "tests" / "cases" / "umbridge_server.py"
KINDS = ("Evaluate", "Gradient", "ApplyJacobian", "ApplyHessian")
NORMALS = "\n".join(f'z{k} = {{ prior = "normal", mean = 0.0, std = 1.0 }}' for k in range(10))
GROWTH = "[observations]\nvalues = [0.86, 1.42, 1.92, 2.20, 2.74, 2.96, 3.22, 3.36]\nstd = [0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05]"
PROBLEMS = {
    "banana": ("banana", 'name = "forward"', "[observations]\nvalues = [0.5, -0.3]\nstd = [1.0, 0.1]",
               'x = { prior = "normal", mean = 0.0, std = 1.0 }\ny = { prior = "normal", mean = 0.0, std = 1.0 }'),
    "two modes": ("twomodes", 'name = "forward"', "[observations]\nvalues = [2.0, 0.0]\nstd = [0.3, 0.5]",
                  'x = { prior = "normal", mean = 0.0, std = 1.0 }\ny = { prior = "normal", mean = 0.0, std = 1.0 }'),
    "growth, one parameter": ("growth1", 'name = "forward"', GROWTH, 'b = { prior = "lognormal", mu = 0.0, sigma = 0.5 }'),
    "growth, three parameters": ("growth3", 'name = "forward"', GROWTH,
                                 'a = { prior = "normal", mean = 1.5, std = 1.0 }\nb = { prior = "lognormal", mu = 0.0, sigma = 0.5 }\n'
                                 'c = { prior = "normal", mean = 0.0, std = 0.5 }'),
    "growth": ("growth", 'name = "forward"',
               GROWTH, 'a = { prior = "normal", mean = 1.5, std = 1.0 }\nb = { prior = "lognormal", mu = 0.0, sigma = 0.5 }\n'
               'c = { prior = "normal", mean = 0.0, std = 0.5 }\nd = { prior = "normal", mean = 0.0, std = 0.3 }'),
    "eight schools, gradients": ("eightschools+gradient", 'name = "posterior"\nkind = "density"', "", NORMALS),
    "eight schools, values alone": ("eightschools", 'name = "posterior"\nkind = "density"', "", NORMALS),
}


def ask(port, path):
    with urllib.request.urlopen(urllib.request.Request(f"http://127.0.0.1:{port}{path}", data=b"{}")) as answer:
        return json.load(answer)


def run(knothe, problem, method, seed, folder):
    model, header, observations, parameters = PROBLEMS[problem]
    server = subprocess.Popen([sys.executable, str(SERVER), model], stdout=subprocess.PIPE, text=True)
    try:
        port = int(server.stdout.readline())
        project = folder / "infer.toml"
        project.write_text(f'results = "results/"\n[parameters]\n{parameters}\n[model]\numbridge = "http://127.0.0.1:{port}"\n{header}\n'
                           f"{observations}\n[method]\nseed = {seed}\n")
        outcome = subprocess.run([knothe, "infer", str(project), "--method", method, "--json"], capture_output=True, text=True)
        calls = ask(port, "/Statistics")
    finally:
        server.kill()
        server.wait()
    return json.loads(outcome.stdout.splitlines()[-1]), [calls.get("/" + kind, 0) for kind in KINDS]


def main():
    knothe, seeds = os.path.abspath(sys.argv[1]), [int(s) for s in sys.argv[2:]] or [1]
    print(f"{platform.processor() or platform.machine()}, seeds {seeds}")
    print(f"{'problem':<28} {'method':<10} {'seed':>4} " + " ".join(f"{kind:>13}" for kind in KINDS) + "  trusted  mean off, std off")
    for problem in PROBLEMS:
        for seed in seeds:
            lines = {}
            for method in ("mcmc", "auto"):
                with tempfile.TemporaryDirectory() as folder:
                    lines[method], calls = run(knothe, problem, method, seed, pathlib.Path(folder))
                difference = ""
                if method == "auto":
                    std = [lines["mcmc"]["covariance"][k][k] ** 0.5 for k in range(len(lines["mcmc"]["mean"]))]
                    mean = max(abs(a - b) / s for a, b, s in zip(lines["auto"]["mean"], lines["mcmc"]["mean"], std))
                    ratio = max(abs(lines["auto"]["covariance"][k][k] ** 0.5 / s - 1) for k, s in enumerate(std))
                    difference = f"{mean:.3f} std, {100 * ratio:.1f} %"
                name = lines[method]["method"]
                print(f"{problem:<28} {name:<10} {seed:>4} " + " ".join(f"{n:>13}" for n in calls) +
                      f"  {str(lines[method]['trusted']):<7}  {difference}", flush=True)


main()
