"""A frame of four storeys, seen by its natural frequencies and mode shapes through a year of warm and cold days; in the end one storey has lost
a quarter of its stiffness. Found by knothe.modes, which knows the temperatures; draws damaged_frame.png.

usage: damaged_frame.py
"""
import knothe
import knothe.modes
import numpy as np

MASS, STIFFNESS = 1e4, np.array([2.2e7, 2.0e7, 1.8e7, 1.9e7])  # kg, N/m
SCATTER = knothe.modes.Scatter(frequency=0.005, shape=0.03)
STOREYS = [f"storey {i + 1}" for i in range(4)]
PRIORS = {**{name: knothe.Lognormal(np.log(2e7), 0.3) for name in STOREYS}, "softening": knothe.Normal(0.002, 0.001)}  # 1/K


def structure(p, temperature):
    kept = 1 - p["softening"] * (temperature - 15)
    return knothe.modes.frame([p[name] * kept for name in STOREYS], [MASS] * 4)


def identified(rng, stiffness, temperature):
    """As from a test: noisy, in any order, with any sign, and now and then a mode is missing."""
    p = {**dict(zip(STOREYS, stiffness)), "softening": 0.0025}
    frequencies, shapes = structure(p, temperature)
    frequencies = frequencies * np.exp(0.005 * rng.standard_normal(4))
    shapes = shapes / np.linalg.norm(shapes, axis=1)[:, None] + 0.03 * rng.standard_normal((4, 4))
    kept = rng.permutation(4)[:4 - rng.integers(2)]
    return knothe.modes.Modes(frequencies[kept], shapes[kept] * rng.choice([-1, 1], len(kept))[:, None], temperature)


def main():
    rng = np.random.default_rng(1)
    temperatures = 15 + 12 * np.sin(np.linspace(0, 2 * np.pi, 24)) + 3 * rng.standard_normal(24)
    damaged = STIFFNESS * [1, 1, 0.75, 1]
    sessions = [identified(rng, STIFFNESS if k < 16 else damaged, temperature) for k, temperature in enumerate(temperatures)]
    baseline = knothe.modes.learn(structure, sessions[:10], PRIORS, SCATTER)
    results = {k: baseline.assess([sessions[k]], STOREYS) for k in range(10, 24)}
    for k, health in results.items():
        print(f"session {k + 1}, {temperatures[k]:.0f} °C: {health}")
    draw(sessions, results)


def draw(sessions, results):
    import matplotlib.pyplot as pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for k, session in enumerate(sessions):
        left.plot([k + 1] * len(session.frequencies), session.frequencies, "o", color="#1f5fa8" if k < 16 else "#c2410c", markersize=4)
    left.set(xlabel="session", ylabel="natural frequency [Hz]")
    left.set_title("identified; orange: with the loss", fontsize=10)
    for i, name in enumerate(STOREYS):
        right.plot([k + 1 for k in results], [health.elements[name] for health in results.values()], "o-", markersize=4, label=name)
    right.axvline(16.5, color="#8a8a8a", linewidth=1)
    right.set(xlabel="session", ylabel="probability of damage", ylim=(-0.03, 1.03))
    right.legend(frameon=False, loc="center left")
    figure.savefig("damaged_frame.png", dpi=150)


if __name__ == "__main__":
    main()
