#!/usr/bin/env python3
"""Every row of docs/reference/equations.md names a file that exists and a name that occurs in it; no row says "not yet".

usage: check_equations.py REPOSITORY
"""
import pathlib
import re
import sys

root = pathlib.Path(sys.argv[1])
rows = {}
faults = []
for line in (root / "docs/reference/equations.md").read_text().splitlines():
    cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
    if len(cells) < 3 or not re.fullmatch(r"\d+", cells[0]):
        continue
    number = int(cells[0])
    rows[number] = cells[2]
    if re.search(r"\b(not yet|not there)\b", line):
        faults.append(f"Eq. {number}: all equations are there, none is \"not yet\"")
        continue
    places = re.findall(r"`([\w/.-]+\.[ch]pp)`: ((?:`[\w:~]+`(?:, )?)+)", cells[2])
    if not places:
        faults.append(f"Eq. {number}: no `file`: `name`")
    for file, names in places:
        path = root / file
        if not path.exists():
            faults.append(f"Eq. {number}: {file} does not exist")
            continue
        text = path.read_text()
        for name in re.findall(r"`([\w:~]+)`", names):
            if not re.search(rf"\b{re.escape(name.split('::')[-1])}\b", text):
                faults.append(f"Eq. {number}: {file} does not contain {name}")
for number in range(1, 35):
    if number not in rows:
        faults.append(f"Eq. {number} is missing")
print("\n".join(faults) or f"{len(rows)} equations, all accounted for")
sys.exit(1 if faults else 0)
