"""Makes the model that several cases share.

usage: make_fixture.py analytic MAKE_SNAPSHOTS | make_fixture.py beam | make_fixture.py paper
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys

KNOTHE, SOURCE = os.environ["KNOTHE"], pathlib.Path(__file__).resolve().parent
kind = sys.argv[1]
folder = pathlib.Path(os.environ["KNOTHE_CASES_FIXTURES"]) / kind
shutil.rmtree(folder, ignore_errors=True)
folder.mkdir(parents=True)


def run(*command, **options):
    print("$", *command, flush=True)
    subprocess.run(list(map(str, command)), check=True, timeout=1150, **options)


if kind == "analytic":
    run(sys.argv[2], folder)
    run(KNOTHE, "model", "import", folder / "snapshots.h5", "-o", folder / "model.h5", "--tolerance", "1e-9")
    project = SOURCE / "assimilation.toml"
elif kind == "beam":
    project = SOURCE / "beam.toml"
    run(KNOTHE, "offline", project, "-o", folder / "model.h5")
else:
    # The example with a run at each node of a grid, and the 30 modes that the accuracy is stated for; what it prints is looked at by the case.
    example = (SOURCE.parent.parent / "examples/beam/beam.toml").read_text()
    example = re.sub(r"(?m)^scaling.*\n", "", example).replace("nodes = 37", "nodes = 9")
    project = folder / "paper.toml"
    project.write_text(re.sub(r"(?m)^modes = .*", "modes = 30", example).replace('model = "beam.h5"', 'model = "model.h5"'))
    with open(folder / "study.jsonl", "w") as study:
        run(KNOTHE, "offline", project, "-o", folder / "model.h5", "--study", "--json", stdout=study)
run(KNOTHE, "simulate", project, "--model", folder / "model.h5", "-o", folder / "data.h5")
run(os.environ["KNOTHE_DATA_TO_CSV"], folder / "data.h5", folder / "data.csv")
if kind == "paper":
    with open(folder / "lines.jsonl", "w") as lines:  # by maps, which several tests look at
        run(KNOTHE, "assimilate", project, "--json", stdout=lines)
