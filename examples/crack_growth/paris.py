"""Paris' law for a centre crack in a sheet, and how 24 specimens depart from it in the mean.

usage: paris.py LN_C M WANDER     writes cycles.csv, a row for each length of departure.csv: the time is the half crack
length (mm), `log_cycles_per_mm` the logarithm of the cycles per mm from the length before to it, `cycles` those since 12 mm.

    ln(dN/da) = −LN_C − M ln(ΔK / 15 MPa√m) + departure(a) + WANDER · exp(−|a − 12 mm| / wander length)
"""
import csv
import math
import pathlib
import sys

WIDTH, THICKNESS, LOAD_RANGE = 152.4, 2.54, 23.35e3 - 4.67e3  # mm, mm, N
REFERENCE = 15.0  # MPa√m, about the middle of the test: there ln C and m are told apart best
START = 12.0  # mm, where the forecast begins


def stress_intensity(a):
    """ΔK in MPa√m of a centre crack of half length a (mm)."""
    stress = LOAD_RANGE / (WIDTH * THICKNESS)
    return stress * math.sqrt(math.pi * 1e-3 * a / math.cos(math.pi * a / WIDTH))


def solve(ln_c, m, wander, table):
    """Rows [length, log_cycles_per_mm, cycles since START]; `table`: rows [length, departure, factor of the mean, wander]."""
    rows, cycles, before = [], 0.0, table[0][0]
    for length, departure, factor, share in table[1:]:
        x = math.log(stress_intensity(0.5 * (before + length)) / REFERENCE)
        log_rate = -ln_c - m * x + departure + wander * share
        if before >= START - 1e-9:
            cycles += (length - before) * math.exp(log_rate) * factor
        rows.append((length, log_rate, cycles))
        before = length
    return rows


def read_table(path):
    with open(path, newline="") as file:
        return [[float(value) for value in row] for row in list(csv.reader(file))[1:]]


if __name__ == "__main__":
    table = read_table(pathlib.Path("departure.csv"))
    with open("cycles.csv", "w") as file:
        file.write("time,log_cycles_per_mm,cycles\n")
        for row in solve(*map(float, sys.argv[1:4]), table):
            file.write(",".join(map(repr, row)) + "\n")
