"""A storey with hysteresis under an earthquake: from its acceleration alone its displacement, its stiffness and the shape of its loops, while
a force that nobody measured acts too; then the next earthquake, forecast before it is run.

usage: oscillator.py [SEED]     prints the result and draws oscillator.png; half a minute
"""
import sys

import knothe
import knothe.states
import numpy as np

DT, SEEN, AHEAD = 0.05, 160, 160  # s, and numbers of data
TRUTH = {"k": 40.0, "beta": 25.0}  # N/m per kg, and 1/m
PRIORS = {"k": knothe.Lognormal(np.log(35), 0.3), "beta": knothe.Lognormal(np.log(20), 0.5)}


def earthquake(seed, count):
    """Minus the ground's acceleration, m/s²: noise that begins, lasts and ends."""
    rng, t = np.random.default_rng(seed), np.linspace(0, 1, count)
    colour = np.convolve(rng.standard_normal(count + 6), np.hanning(7) / np.sqrt((np.hanning(7)**2).sum()), "valid")
    return 2.5 * colour * np.minimum(1, 6 * t) * np.minimum(1, 3 * (1 - t))


def main(seed):
    model = knothe.states.bouc_wen(1.0, 0.3, "k", share=0.2, beta="beta", gamma=10.0, dt=DT, noise=0.1, observe="acceleration", force_noise=0.05,
                                   substeps=2, parameters=TRUTH)
    load = np.r_[earthquake(seed, SEEN), earthquake(seed + 1, AHEAD)]
    states, data = model.simulate(SEEN + AHEAD, inputs=load, seed=seed)

    found = knothe.states.estimate(model, data[:SEEN], inputs=load[:SEEN], parameters=PRIORS)
    print(found)
    for name, mean, std in zip(found.parameters.parameters, found.parameters.mean, found.parameters.std):
        print(f"{name}: {mean:.1f} ± {std:.1f}, true {TRUTH[name]:g}")
    ahead = found.forecast(AHEAD, inputs=load[SEEN:])
    inside = np.mean((ahead.lower[:, 0] < states[SEEN:, 0]) & (states[SEEN:, 0] < ahead.upper[:, 0]))
    print(f"next earthquake: {100 * inside:.0f} % of the displacements in the 90 % interval")
    draw(states, found, ahead)


def draw(states, found, ahead):
    import matplotlib.pyplot as pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9, 3.2), width_ratios=(2.2, 1), layout="constrained")
    smoothed, t = found.smooth(), DT * np.arange(len(states))
    for result, colour, label in ((smoothed, "#1f5fa8", "estimated"), (ahead, "#c2410c", "forecast")):
        left.fill_between(result.times, 1e3 * result.lower[:, 0], 1e3 * result.upper[:, 0], color=colour, alpha=0.3, linewidth=0, label=f"{label}, 90 %")
    left.plot(t, 1e3 * states[:, 0], color="black", linewidth=0.9, label="true")
    left.set(xlabel="time [s]", ylabel="displacement [mm]", xlim=(0, t[-1]))
    left.legend(frameon=False, loc="lower left", ncols=3)
    right.plot(1e3 * states[:SEEN, 0], 1e3 * states[:SEEN, 2], color="black", linewidth=0.9, label="true")
    right.plot(1e3 * smoothed.mean[:, 0], 1e3 * smoothed.mean[:, 2], color="#1f5fa8", linewidth=0.9, label="estimated")
    right.set(xlabel="displacement [mm]", ylabel="hysteretic displacement z [mm]", title="loops of the first earthquake")
    right.legend(frameon=False, loc="lower right", fontsize=8)
    left.set_title("from its acceleration, 0 to 8 s; then forecast")
    low, high = left.get_ylim()
    left.set_ylim(low - 0.25 * (high - low), high)
    figure.savefig("oscillator.png", dpi=150)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1)
