"""deploy/: the units are ones that systemd accepts, the container is made of the package, and the Grafana page asks for metrics that there are.

usage: check_deploy.py SOURCE PROGRAM
"""
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

source, program = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
wrong = []

if shutil.which("systemd-analyze"):
    with tempfile.TemporaryDirectory() as folder:
        # The programs need not be installed to look at the units.
        for name, start in (("knothe@", "knothe"), ("knothe-plant@", "/usr/bin/node")):
            unit = (source / f"deploy/{name}.service").read_text().replace(f"ExecStart={start} ", f"ExecStart={program.resolve()} ")
            path = pathlib.Path(folder) / f"{name}beam.service"
            path.write_text(unit)
            done = subprocess.run(["systemd-analyze", "verify", "--man=no", path], capture_output=True, text=True)
            said = [line for line in done.stderr.splitlines() if path.name in line]
            wrong += said if done.returncode or said else []
            # 0 is safest, 100 is open to all; what is left is the network, and that it may read what all may.
            done = subprocess.run(["systemd-analyze", "security", "--offline=yes", "--threshold=20", "--no-pager", path], capture_output=True, text=True)
            print(next((line.strip() for line in done.stdout.splitlines() if "Overall exposure" in line), "").replace("→ ", ""))
            if done.returncode:
                wrong.append(f"{path.name}: {(done.stdout + done.stderr).strip().splitlines()[-1]}")
    # Started again for ever, each time after a longer pause.
    for name in ("knothe@", "knothe-plant@"):
        unit = (source / f"deploy/{name}.service").read_text()
        with tempfile.TemporaryDirectory() as folder:
            (pathlib.Path(folder) / "sleep").write_text("#!/bin/sh\necho $1\n")
            (pathlib.Path(folder) / "sleep").chmod(0o755)
            command = re.search(r"^ExecStopPost=/bin/sh -c '(.*)'$", unit, re.M)[1].replace("$$", "$")
            command = re.sub(r"/run/[a-z-]+/%i", f"{folder}/beam", command)
            stop = lambda result: subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True,
                                                 env={"PATH": f"{folder}:/usr/bin:/bin", "SERVICE_RESULT": result}).stdout.strip()
            pauses = [stop("exit-code") for _ in range(9)]
            if pauses != ["1", "2", "4", "8", "16", "32", "60", "60", "60"] or stop("success") != "":
                wrong.append(f"{name}.service: the pauses before it is started again are {pauses}")
        if "StartLimitIntervalSec=0" not in unit or "Restart=on-failure" not in unit:
            wrong.append(f"{name}.service: is not started again for ever")
else:
    print("no systemd-analyze here: the units are not looked at")

image = (source / "deploy/Containerfile").read_text()
if "apt-get install" not in image or "/knothe_*.deb" not in image:
    wrong.append("deploy/Containerfile: is not made of the package knothe")

served = set()
for path in (source / "knothe/service").rglob("*.cpp"):
    served |= set(re.findall(r'"(knothe_[a-z_]+)"', path.read_text()))
board = json.loads((source / "deploy/grafana.json").read_text())
asked = set(re.findall(r"\bknothe_[a-z_]+", json.dumps(board)))
for name in sorted(asked):
    if name not in served and re.sub("_(bucket|count|sum)$", "", name) not in served:
        wrong.append(f"deploy/grafana.json: {name} is no metric of the service")
if not asked or not board.get("panels"):
    wrong.append("deploy/grafana.json: shows nothing")

print("\n".join(wrong) or f"deploy/ fits: {len(asked)} metrics")
sys.exit(1 if wrong else 0)
