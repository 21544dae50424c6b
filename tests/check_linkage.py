#!/usr/bin/env python3
"""The online program links neither the finite-element library nor MPI, not even through another library; knothe-offline, which opens
that library when it needs it, does not either (knothe/offline/full_order/finite_element_library.hpp).

usage: check_linkage.py KNOTHE [KNOTHE_OFFLINE]
"""
import re
import subprocess
import sys

FINITE_ELEMENTS = r"deal_?ii|petsc|trilinos|slepc|p4est"
FORBIDDEN = [f"{FINITE_ELEMENTS}|mpi|umfpack|cholmod", FINITE_ELEMENTS]
ADVICE = ["that belongs to knothe-offline", "that belongs to libknothe-finite-elements.so"]


def faults_of(program, forbidden, advice):
    dynamic = subprocess.run(["readelf", "-d", program], check=True, capture_output=True, text=True).stdout
    needed = re.findall(r"\(NEEDED\).*\[(.+)\]", dynamic)
    loaded = re.findall(r"^\s*(\S+)", subprocess.run(["ldd", program], check=True, capture_output=True, text=True).stdout, re.MULTILINE)
    if not any("hdf5" in name for name in needed):
        return [f"{program}: readelf does not show HDF5 among its libraries: is this knothe? {needed}"]
    return [f"{program} loads {name}: {advice}" for name in sorted({*needed, *loaded}) if re.search(forbidden, name, re.IGNORECASE)]


faults = [fault for program, forbidden, advice in zip(sys.argv[1:], FORBIDDEN, ADVICE) for fault in faults_of(program, forbidden, advice)]
print("\n".join(faults))
sys.exit(1 if faults else 0)
