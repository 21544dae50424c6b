"""Makes the model that several cases share.

usage: make_fixture.py analytic MAKE_SNAPSHOTS | make_fixture.py beam
"""
import os
import pathlib
import shutil
import subprocess
import sys

KNOTHE, SOURCE = os.environ["KNOTHE"], pathlib.Path(__file__).resolve().parent
kind = sys.argv[1]
folder = pathlib.Path(os.environ["KNOTHE_CASES_FIXTURES"]) / kind
shutil.rmtree(folder, ignore_errors=True)
folder.mkdir(parents=True)


def run(*command):
    print("$", *command, flush=True)
    subprocess.run(list(map(str, command)), check=True, timeout=280)


if kind == "analytic":
    run(sys.argv[2], folder)
    run(KNOTHE, "model", "import", folder / "snapshots.h5", "-o", folder / "model.h5", "--tolerance", "1e-9")
    project = SOURCE / "assimilation.toml"
else:
    project = SOURCE / "beam.toml"
    run(KNOTHE, "offline", project, "-o", folder / "model.h5")
run(KNOTHE, "simulate", project, "--model", folder / "model.h5", "-o", folder / "data.h5")
run(os.environ["KNOTHE_DATA_TO_CSV"], folder / "data.h5", folder / "data.csv")
