#!/usr/bin/env python3
"""Every #include between rooms points up the house (shared design: docs/explanation/architecture.md), never down.

usage: check_layers.py REPOSITORY
"""
import pathlib
import re
import sys

MAY_KNOW = {
    "base": [],
    "files": ["base"],
    "numerics": ["base"],
    "sampling": ["base", "files", "numerics"],
    "transport": ["base", "files", "numerics", "sampling"],
    "reduction": ["base", "files", "numerics"],
    "simulator": ["base", "files", "numerics", "reduction"],
    "imaging": ["base", "files", "numerics"],
    "assimilation": ["base", "files", "numerics", "sampling", "transport", "reduction", "imaging"],
    "inference": ["base", "files", "numerics", "sampling", "transport", "reduction", "imaging", "assimilation"],
    "forecast": ["base", "files", "numerics", "sampling", "transport", "reduction", "imaging", "assimilation"],
}
ONLINE = list(MAY_KNOW) + ["engine", "project", "report", "service"]
MAY_KNOW["engine"] = list(MAY_KNOW)
MAY_KNOW["project"] = list(MAY_KNOW)
MAY_KNOW["library"] = MAY_KNOW["engine"] + ["engine"]  # nobody includes it
MAY_KNOW["report"] = MAY_KNOW["project"] + ["project"]
MAY_KNOW["service"] = MAY_KNOW["report"] + ["report"]
MAY_KNOW["mechanics"] = ["base", "files", "numerics", "reduction", "simulator", "project"]
MAY_KNOW["offline"] = MAY_KNOW["report"] + ["report", "mechanics"]

root = pathlib.Path(sys.argv[1])
include = re.compile(r'#include\s+"knothe/([a-z]+)/')
faults = []
for room, known in MAY_KNOW.items():
    for source in sorted((root / "knothe" / room).rglob("*.[ch]pp")):
        for number, line in enumerate(source.read_text().splitlines(), 1):
            match = include.search(line)
            if match and match[1] != room and match[1] not in known:
                faults.append(f"{source.relative_to(root)}:{number}: '{room}' must not include '{match[1]}'")
            if room != "mechanics" and ("<deal.II/" in line or "<mpi.h>" in line):
                faults.append(f"{source.relative_to(root)}:{number}: only 'mechanics' may know deal.II and MPI")
for source in sorted((root / "apps" / "knothe").rglob("*.[ch]pp")):
    for number, line in enumerate(source.read_text().splitlines(), 1):
        if any(f'"knothe/{room}/' in line for room in ("mechanics", "offline")):
            faults.append(f"{source.relative_to(root)}:{number}: the online program must not know 'mechanics' or 'offline'")
print("\n".join(faults) or "every include points up the house")
sys.exit(1 if faults else 0)
