#!/usr/bin/env python3
"""The closed loop, live: `knothe serve` decides, the bridge of deploy/plant writes to a simulated test machine over Modbus, the machine loads
its specimen, and what it measures goes back. Ends when the decision is to stop, and prints in five lines what was seen.

usage: closed_loop.py [--truth 1.1,0.9] [--seed 1] [--rate 0.02] [--port 0] [--folder FOLDER]
                                                                      (KNOTHE: the program, if it is not on the path)

FOLDER, of its own in /tmp, keeps the model (the first time it is built: about 15 s on 2 idle cores), the journal, the bridge's configuration and
its spool. --rate: of the machine, mm/s; slower is easier to watch on the live page.
"""
import argparse
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

from modbus_machine import ACKNOWLEDGE, ACTION, HEARTBEAT, LOAD, REACHED, SENSORS, SEQUENCE, SET_POINT, Machine, Specimen, ask

HERE = pathlib.Path(__file__).resolve().parent
BRIDGE = next((path for path in (HERE.parents[1] / "deploy/plant/knothe-plant.mjs", pathlib.Path("/usr/share/knothe/plant/knothe-plant.mjs"))
               if path.exists()), None)
KNOTHE = os.environ.get("KNOTHE", "knothe")
FULL = 0.4  # mm at model time 1: [offline] displacement
FIRST = 0.05  # model time of the first load, about
LIMIT = 0.04  # m: [forecast.crack] threshold


def configuration(service, modbus, specimen, spool):
    """Of the bridge (docs/how-to/drive-a-machine.md). The machine is told mm, knothe decides m."""
    first = min(specimen.times, key=lambda t: abs(t - FIRST))
    return {
        "service": {"address": service},
        "source": "machine",
        "session": "closed-loop",
        "spool": str(spool),
        "modbus": {"address": f"127.0.0.1:{modbus}"},
        "channels": {str(k): {"register": SENSORS + 2 * k, "table": "input", "type": "float32"} for k in range(len(specimen.deviations))},
        "command": {
            "armed": True, "timeout": 5, "dead_time": 60,
            "limits": {"lower": 0, "upper": 1e-3 * FULL, "step": 1e-4},
            "first": {"time": first, "set_point": 1e-3 * FULL * first},
            "set_point": {"register": SET_POINT, "type": "float32", "scale": 1e-3, "unit": "mm"},
            "action": {"register": ACTION, "codes": {"hold": 0, "load": 1, "stop": 2}},
            "sequence": {"register": SEQUENCE},
            "acknowledge": {"register": ACKNOWLEDGE, "table": "input"},
            "reached": {"register": REACHED, "table": "input"},
            "heartbeat": {"register": HEARTBEAT, "every": 0.2},
        },
    }


def prepare(folder):
    """Project, model and sensors in a folder; nothing of an earlier run but the model."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("driven_test.journal", "truth.journal", "spool.jsonl", "log.txt"):
        for path in folder.glob(f"{name}*"):
            path.unlink()
    shutil.copy(HERE / "driven_test.toml", folder)
    run = lambda *arguments: subprocess.run([KNOTHE, *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    if not (folder / "beam.h5").exists():
        run("offline", "driven_test.toml", "-o", "beam.h5")
    run("simulate", "driven_test.toml", "-o", "sensors.h5")


def serve(folder, project, port, log):
    """The process, and its address once it is ready."""
    service = subprocess.Popen([KNOTHE, "serve", project, "--port", str(port)], cwd=folder, stdout=subprocess.PIPE, stderr=log)
    found = re.search(r"http://\S+", service.stdout.readline().decode())
    if not found:
        sys.exit(f"knothe serve did not start: {log.name}")
    url = found[0].rstrip("/")
    while True:
        try:
            ask(url, "/readyz")
            return service, url
        except OSError:  # 503: not yet
            time.sleep(0.05)


def cracks_of(folder, truth, times, log):
    """The specimen's crack at each of the model's times, m: each is the horizon of a forecast of another, short service."""
    text = (folder / "driven_test.toml").read_text().split("[forecast.crack]")[0]
    forecasts = (f'[forecast.at_{k}]\nquantity = "crack_length"\nhorizon = {t}\nprior = {{ mean = 0.04, std = 0.013 }}\n'
                 for k, t in enumerate(times))
    (folder / "truth.toml").write_text(text + "".join(forecasts))
    service, url = serve(folder, "truth.toml", 0, log)
    try:
        return ask(url, "/Evaluate", {"name": "predict", "input": [truth], "config": {}})["output"][0]
    finally:
        service.terminate()
        service.wait()


def run_bridge(folder, spool, log):
    """Its exit status: until the test has stopped, or is held until somebody has looked, and there is nobody."""
    bridge = subprocess.Popen(["node", BRIDGE, folder / "plant.json"], stderr=log)
    try:
        while bridge.poll() is None:
            time.sleep(0.2)
            if spool.exists() and "somebody has to look" in spool.read_text():
                bridge.terminate()
                return {130: 0}.get(bridge.wait(), bridge.returncode)
        return bridge.returncode
    finally:
        bridge.kill()


def report(url, truth, machine, cracks, spool):
    """What was seen, in five lines."""
    line = ask(url, "/v1/state")
    lines = [json.loads(text) for text in spool.read_text().splitlines()]
    orders = [entry for entry in lines if "command" in entry and "action" in entry]
    acknowledged = {entry["acknowledged"] for entry in lines if "acknowledged" in entry}
    loads = [f"{1e3 * order['set_point']:.3g}" for order in orders if order["action"] == "load"]
    print(f"commands:  {len(orders)} sent, {len(acknowledged)} acknowledged; loaded to {', '.join(loads)} mm")
    holds = [order for order in orders if order["action"] == "hold"]
    again = sum("time" in hold for hold in holds)
    print(f"held:      {again} times to measure again, {len(holds) - again} times for safety, {machine.held_by_watchdog} times by the machine's watchdog")
    estimates = [f"{name} = {mean:.3f} ± {variance[k] ** 0.5:.3f} (truth {truth[k]})"
                 for k, (name, mean, variance) in enumerate(zip(line["parameters"], line["mean"], line["covariance"]))]
    print(f"posterior: {', '.join(estimates)} after {sum('channels' in entry for entry in lines)} measurements; {line['verdict']['level']}")
    times = machine.specimen.times
    here = min(range(len(times)), key=lambda k: abs(times[k] * FULL - machine.position))
    fails = next((FULL * t for t, crack in zip(times, cracks) if crack > LIMIT), None)
    state = "did not fail" if max(cracks[:here + 1]) <= LIMIT else "failed"
    later = "the whole load would not break it" if fails is None else f"more than {1e3 * LIMIT:.0f} mm, failure, from {fails:.3g} mm on"
    print(f"specimen:  {state}: its crack is {1e3 * cracks[here]:.3g} mm at {machine.position:.3g} mm; {later}")
    print(f"{line['decision']['action']}:      {line['decision']['message']}", flush=True)
    return 0 if state == "did not fail" else 1


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--truth", default="1.1,0.9")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate", type=float, default=0.02, help="of the machine, mm/s")
    parser.add_argument("--port", type=int, default=0, help="of the service's page")
    parser.add_argument("--folder", type=pathlib.Path, default=pathlib.Path(tempfile.gettempdir()) / f"knothe-closed-loop-{os.getuid()}")
    told = parser.parse_args()
    if not BRIDGE or not shutil.which("node"):
        sys.exit("the bridge needs Node.js (apt install nodejs) and deploy/plant/ of the repository, or the package knothe")
    truth = [float(x) for x in told.truth.split(",")]
    folder = told.folder
    prepare(folder)
    log = open(folder / "log.txt", "wb")
    service, url = serve(folder, "driven_test.toml", told.port, log)
    try:
        print(f"{url}/ is the live page; {folder} has the rest", file=sys.stderr, flush=True)
        machine = Machine(Specimen(url, truth, told.seed), FULL, told.rate, watchdog=2)
        cracks = cracks_of(folder, truth, machine.specimen.times, log)
        spool = folder / "spool.jsonl"
        wanted = configuration(url, machine.port, machine.specimen, spool)
        (folder / "plant.json").write_text(json.dumps(wanted, indent=1))
        status = run_bridge(folder, spool, log)
        if status:
            sys.exit(f"the bridge ended with status {status}: {folder}/log.txt")
        return report(url, truth, machine, cracks, spool)
    finally:
        service.terminate()
        service.wait()


if __name__ == "__main__":
    sys.exit(main())
