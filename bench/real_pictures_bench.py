#!/usr/bin/env python3
"""What a real picture costs `knothe dic`, all told: reading, prefilter, correlation, standard deviations, output.

usage: real_pictures_bench.py KNOTHE [REPEATS]
needs the pictures of the concrete beam (scripts/get-data.sh, or KNOTHE_DATA) and numpy and PIL. The series is made of the picture under
load: each moves by 0.05 px to the right and half of that down from the one before, with new noise of 100 of 65,536 levels. Processor
time of a picture is that of a series of 60 less that of one of 20, over 40: what is done once, and the cold first picture, are not in it.
The best of the repeats, since other programs may run beside it.
"""
import json
import multiprocessing
import os
import pathlib
import platform
import subprocess
import sys
import tempfile

import numpy
from PIL import Image

knothe, repeats = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 3
data = pathlib.Path(os.environ.get("KNOTHE_DATA") or pathlib.Path(__file__).resolve().parents[2] / "shared" / "data") / "concrete_bending"
SHORT, LONG = 20, 60


def quantile(values, share):
    values = sorted(values)
    return values[min(len(values) - 1, int(share * len(values)))]


def processor():
    for line in open("/proc/cpuinfo"):
        if line.startswith("model name"):
            return line.split(":")[1].strip()
    return platform.machine()


def make_series(folder):
    picture = numpy.array(Image.open(data / "IMG_0160.tif")).astype(float)
    spectrum = numpy.fft.fft2(picture)
    x, y = numpy.fft.fftfreq(picture.shape[1])[None, :], numpy.fft.fftfreq(picture.shape[0])[:, None]
    random = numpy.random.default_rng(1)
    names = []
    for k in range(LONG):
        shift = 0.05 * (k % 20 + 1)
        moved = numpy.fft.ifft2(spectrum * numpy.exp(-2j * numpy.pi * shift * (x + 0.5 * y))).real
        moved = numpy.clip(numpy.round(moved + random.normal(0, 100, moved.shape)), 0, 65535)
        names.append(str(folder / f"{k:02d}.tif"))
        Image.fromarray(moved.astype(numpy.uint16)).save(names[-1])
    return names


def run(pictures, output):
    """Processor time in ms, lines, largest memory in MB: of that process alone."""
    with tempfile.TemporaryFile("w+") as lines, tempfile.TemporaryFile("w+") as complaints:
        started = subprocess.Popen([knothe, "dic", data / "IMG_0155.tif", *pictures, "-o", output, "--json"], stdout=lines, stderr=complaints)
        _, status, used = os.wait4(started.pid, 0)
        started.returncode = os.waitstatus_to_exitcode(status)
        for file in (lines, complaints):
            file.seek(0)
        if started.returncode != 0:
            sys.exit(complaints.read())
        return 1e3 * (used.ru_utime + used.ru_stime), [json.loads(line) for line in lines], used.ru_maxrss / 1024


if not data.exists():
    sys.exit(f"{data} is not there: scripts/get-data.sh, or set KNOTHE_DATA to the folder of recorded data")
with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    # Elsewhere: a process begins with the memory of the one that starts it on its account.
    with multiprocessing.Pool(1) as maker:
        pictures = maker.apply(make_series, (folder,))
    for kind in ("u.h5", "u.pvd"):
        cpu, lines, memory = [], [], 0
        for _ in range(repeats):
            whole, lines, memory = run(pictures, folder / kind)
            cpu.append((whole - run(pictures[:SHORT], folder / kind)[0]) / (LONG - SHORT))
        wall = [line["elapsed_ms"] for line in lines[1:]]
        print(f"{processor()}; {os.cpu_count()} threads; {lines[1]['nodes']} nodes, 16 bits, prefilter 1 px, {kind}")
        print(f"  processor time of a picture, all told  {min(cpu):6.1f} ms (goal 30); repeats {', '.join(f'{c:.1f}' for c in cpu)}")
        print(f"  its correlation by the clock           median {quantile(wall, 0.5):.1f} ms   p99 {quantile(wall, 0.99):.1f} ms"
              f"   {lines[-1]['iterations']} iterations")
        print(f"  cold, with a crack (IMG_0160)          {lines[0]['elapsed_ms']:6.1f} ms, {lines[0]['iterations']} iterations")
        print(f"  largest memory                         {memory:6.0f} MB (goal 100)")
