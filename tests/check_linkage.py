#!/usr/bin/env python3
"""The online program links neither the finite-element library nor MPI, not even through another library.

usage: check_linkage.py KNOTHE
"""
import re
import subprocess
import sys

FORBIDDEN = re.compile(r"deal_?ii|mpi|petsc|trilinos|slepc|umfpack|cholmod", re.IGNORECASE)
program = sys.argv[1]
dynamic = subprocess.run(["readelf", "-d", program], check=True, capture_output=True, text=True).stdout
needed = re.findall(r"\(NEEDED\).*\[(.+)\]", dynamic)
loaded = re.findall(r"^\s*(\S+)", subprocess.run(["ldd", program], check=True, capture_output=True, text=True).stdout, re.MULTILINE)
if not any("hdf5" in name for name in needed):
    sys.exit(f"{program}: readelf does not show HDF5 among its libraries: is this knothe? {needed}")
faults = sorted({name for name in needed + loaded if FORBIDDEN.search(name)})
for fault in faults:
    print(f"{program} loads {fault}: that belongs to knothe-offline")
sys.exit(1 if faults else 0)
