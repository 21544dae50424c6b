"""Two storeys on a shaken ground, x1 and x2 against it, damping,
and a restoring force k x / sqrt(1 + s x²) in each storey.

usage: storeys.py K1 DAMPING     writes storeys.csv: time, accelerations of both floors, drift of the first storey
K1: stiffness of the first storey, N/m; DAMPING: of each storey, N s/m. Any program would do that writes such a file.
"""
import math
import sys

MASS, K2, SOFTENING = 1000.0, 1.2e6, 2e3  # kg, N/m, 1/m²
STEP, EVERY, COUNT = 0.01, 5, 60  # s; a row every fifth step


def ground(t):
    """Its acceleration, m/s²."""
    return 2.5 * math.exp(-((t - 2.0) / 1.2) ** 2) * math.sin(2 * math.pi * 2.1 * t) + 1.2 * math.sin(9.0 * t) * math.exp(-0.4 * t)


def rates(t, state, k1, damping):
    x1, x2, v1, v2 = state
    first = k1 * x1 / math.sqrt(1 + SOFTENING * x1 * x1) + damping * v1
    drift = x2 - x1
    second = K2 * drift / math.sqrt(1 + SOFTENING * drift * drift) + damping * (v2 - v1)
    return v1, v2, (second - first) / MASS - ground(t), -second / MASS - ground(t)


def solve(k1, damping):
    """Rows [time, acceleration_1, acceleration_2, drift] (absolute accelerations), by Runge and Kutta's classical method."""
    state, rows = (0.0, 0.0, 0.0, 0.0), []
    for i in range(1, EVERY * COUNT + 1):
        t = (i - 1) * STEP
        a = rates(t, state, k1, damping)
        b = rates(t + STEP / 2, [x + STEP / 2 * r for x, r in zip(state, a)], k1, damping)
        c = rates(t + STEP / 2, [x + STEP / 2 * r for x, r in zip(state, b)], k1, damping)
        d = rates(t + STEP, [x + STEP * r for x, r in zip(state, c)], k1, damping)
        state = [x + STEP / 6 * (p + 2 * q + 2 * r + s) for x, p, q, r, s in zip(state, a, b, c, d)]
        if i % EVERY == 0:
            now = rates(i * STEP, state, k1, damping)
            rows.append([i * STEP, now[2] + ground(i * STEP), now[3] + ground(i * STEP), state[0]])
    return rows


if __name__ == "__main__":
    with open("storeys.csv", "w") as file:
        file.write("time [s],acceleration_1 [m/s2],acceleration_2 [m/s2],drift [mm]\n")
        for time, first, second, drift in solve(float(sys.argv[1]), float(sys.argv[2])):
            file.write(f"{time:.2f},{first!r},{second!r},{1e3 * drift!r}\n")
