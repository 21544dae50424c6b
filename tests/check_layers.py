#!/usr/bin/env python3
"""Every #include between rooms points up the house (shared design: docs/explanation/architecture.md), never down.

usage: check_layers.py REPOSITORY
"""
import pathlib
import re
import sys

LOW = ["base", "files", "numerics"]
MAY_KNOW = {
    "base": [],
    "files": ["base"],
    "numerics": ["base"],
    "imaging": LOW,
    "posterior": LOW,
    "model": LOW,
    "likelihood": LOW + ["imaging", "posterior", "model"],
    "assimilation": LOW + ["imaging", "posterior", "model", "likelihood"],
}
ONLINE = list(MAY_KNOW)
for room in ("project", "record", "report", "service", "offline"):
    MAY_KNOW[room] = [other for other in MAY_KNOW if other != "service"]
MAY_KNOW["library"] = ONLINE  # nobody includes it

root = pathlib.Path(sys.argv[1])
include = re.compile(r'#include\s+"knothe/([a-z]+)/')
faults = []
for room, known in MAY_KNOW.items():
    for source in sorted((root / "knothe" / room).rglob("*.[ch]pp")):
        for number, line in enumerate(source.read_text().splitlines(), 1):
            match = include.search(line)
            if match and match[1] != room and match[1] not in known:
                faults.append(f"{source.relative_to(root)}:{number}: '{room}' must not include '{match[1]}'")
            if room != "offline" and ("<deal.II/" in line or "<mpi.h>" in line):
                faults.append(f"{source.relative_to(root)}:{number}: only 'offline' may know deal.II and MPI")
for source in sorted((root / "apps" / "knothe").rglob("*.[ch]pp")):
    for number, line in enumerate(source.read_text().splitlines(), 1):
        if '"knothe/offline/' in line:
            faults.append(f"{source.relative_to(root)}:{number}: the online program must not know 'offline'")
print("\n".join(faults) or "every include points up the house")
sys.exit(1 if faults else 0)
