"""Fig. 14 and 15: a model with too few modes, and its correction. Beyond the paper: when the bias begins decides what a correction is
worth."""
import numpy as np

import beam
from beam import TRUTH
from experiment import assimilate, corrected, draw, predicted, smoothed
from record import Chart, Figure, readable, with_uncertainty
from updating import KEYS, marginals_of

SMOOTHING = 10  # steps, of the evidence


def bias_runs(subject, few, *, marginals=False, joint=True):
    """The same data, from m = 6, assimilated by it and in four ways by a model of few modes."""
    ways = {"published": corrected("published"), "linear": corrected("linear")} | ({"joint": corrected("joint")} if joint else {})
    return {"m6": subject.assimilate(marginals=marginals), "m3": subject.assimilate(few, marginals=marginals),
            **{name: subject.assimilate(few, marginals=marginals, **way) for name, way in ways.items()}}


def less_true_residual(seen, exact, values):
    """The data less what Eq. 17-20 (two modes, a line through the last two steps) extrapolate to each step from the residuals that the
    model has at the true parameters without noise; all are steps x sensors."""
    residual, less = exact - seen, values.copy()
    for t in range(1, len(values)):
        amplitudes, sizes, shapes = np.linalg.svd(residual[:t], full_matrices=False)
        modes = (amplitudes * sizes)[:, :2]
        less[t] -= (modes[-1] if t == 1 else 2 * modes[-1] - modes[-2]) @ shapes[:2]
    return less


def distances(run) -> str:
    off = run.off_by().max(1)
    return f"{readable(off.max(), 2)} at step {off.argmax()}, at the end {' and '.join(readable(v, 2) for v in run.off_by()[-1])}"


def estimates(run) -> str:
    return ", ".join(f"{name} {with_uncertainty(run.mean[k], run.std[k])}" for k, name in enumerate(("Y₀", "A_d")))


def figures_14_15(subject, options):
    figure = Figure("14-15", "A model that is wrong, and its correction",
                    "As for Fig. 9, data from m = 6. The model that assimilates them has m = 3 modes, found one after the other as in the paper; "
                    "the table has the two best modes too. Corrected: mean and standard deviation of the residual at the 60 dofs, two modes of "
                    "each, extrapolated linearly, to the letter (Eq. 16-20, “published”) and with the recent errors of the modes added to the "
                    "covariance (“linear”); and by knothe's own correction, in which the discrepancy is unknown together with the "
                    "parameters.")
    three = subject.beam.three
    runs, best = bias_runs(subject, three, marginals=True), bias_runs(subject, subject.beam.three_best)
    for name, caption in (("m3", "Fig. 14 of the paper: without correction the marginals end beside the truth."),
                          ("published", "Fig. 15 of the paper, left and centre: corrected by the extrapolated residual, Eq. 16-20 to the letter."),
                          ("linear", "The same with the recent errors of the extrapolated modes added to the covariance."),
                          ("joint", "Beyond the paper: the discrepancy integrated out. Wide where data and model cannot tell.")):
        figure.panel(caption, *marginals_of(runs[name]))
    labels = {"m6": "m = 6 (reference)", "m3": "m = 3, uncorrected", "published": "m = 3, corrected (published)",
              "linear": "m = 3, corrected (linear)", "joint": "m = 3, corrected (joint)"}
    evidence = Chart("Log-evidence of a datum", "step [–]", f"log-evidence, mean of {SMOOTHING} steps [nats]")
    factor = Chart("Log Bayes factor for m = 6", "step [–]", "log Bayes factor [nats]").mark("equally good", y=0)
    for k, (name, run) in enumerate(runs.items()):
        evidence.curve(labels[name], smoothed(run.increments, SMOOTHING))
        if name != "m6":
            factor.curve(f"against {labels[name]}", np.cumsum(runs["m6"].increments - run.increments), colour=k)
    figure.panel("Fig. 15 of the paper, right: evidence of each datum, moving average over ten steps, and its sum against the reference "
                 "(above zero: m = 6 explains the data better).", evidence, factor)

    def row(quantity, paper, run, other=None, why=""):
        last = f"Last: {estimates(run)}."
        figure.row(quantity, "std", paper, distances(run), last if other is None else f"{last} With the two best modes: {distances(other)}.{why}",
                   run.off_by().max())

    row("m = 6: largest distance of the truth from the mean, Y₀ and A_d", "the reference", runs["m6"])
    row("m = 3: the same", "shifted marginals, means do not converge", runs["m3"], best["m3"])
    row("m = 3, corrected to the letter of Eq. 16-20: the same", "effect of the bias eliminated", runs["published"], best["published"],
        " A residual at the last posterior confirms the estimate from which it was computed: what the parameters have wrongly explained is not "
        "in it. The paper shows one draw; the next section says when the correction helps.")
    row("m = 3, corrected, the modes' error in the covariance (linear): the same", "not in the paper", runs["linear"], best["linear"])
    row("m = 3, corrected jointly: the same", "not in the paper", runs["joint"], best["joint"],
        " Its spread shows how little is known where bias and parameters look alike.")
    exact = predicted(subject.model, subject.sensors)
    control = subject.assimilate(three, less_true_residual(predicted(three, subject.sensors), exact, subject.values))
    row("m = 3, less what Eq. 17-20 extrapolate from the residual at the true parameters: the same", "not in the paper", control)
    figure.rows[-1].why += (" The same decomposition and line, from the right residual: the extrapolation works. What the correction lacks is "
                            "the residual at the truth, which is not known.")
    onset = runs["m6"].first_below(1, 0.9)

    def gain(better, worse):
        change = runs[better].increments - runs[worse].increments
        return [float(part.mean()) if len(part) else 0.0 for part in (change[:onset], change[onset:])]

    lost = gain("m6", "m3")
    figure.row("evidence lost by m = 3, per datum: before damage, after", "nats", "falls slowly below the reference",
               " and ".join(readable(v, 2) for v in lost), f"Damage begins near step {onset}. In all "
               f"{readable(runs['m6'].log_evidence - runs['m3'].log_evidence)} nats in favour of m = 6.", lost[1])
    for name, words, paper in (("published", "to the letter", "a loss at first, where only noise is extrapolated, then a gain"),
                               ("linear", "linear", "not in the paper")):
        gained = gain(name, "m3")
        figure.row(f"evidence gained by the correction ({words}), per datum: before damage, after", "nats", paper,
                   " and ".join(readable(v, 2) for v in gained),
                   ("A gain after the onset." if gained[1] > 0 else "No gain after the onset: a line through the last two residuals carries "
                    "their noise on, and nothing in the covariance allows for it.")
                   + f" In all {readable(runs[name].log_evidence - runs['m3'].log_evidence)} nats (joint: "
                     f"{readable(runs['joint'].log_evidence - runs['m3'].log_evidence)}).", gained[1])
    for name, label in (("m6", "m6"), ("m3", "m3"), ("published", "m3_published"), ("linear", "m3_corrected"), ("joint", "m3_joint")):
        figure.series(**{f"log_evidence_increment_{label}": runs[name].increments},
                      **{f"{what}_{key}_{label}": getattr(runs[name], f"{what}s")[:, k] for what in ("mean", "std") for k, key in enumerate(KEYS)})
    return figure


ONSETS, RAMP, EARLY = (15, 25, 35, 50, 65), 20, 40  # steps of 100
SIZE = 3  # times what m = 6 adds to m = 3 where that is largest
JOINT_DRAWS, QUICK_JOINT_DRAWS = 10, 2  # the joint correction takes a second and more
TREATMENTS = {"uncorrected": {}, "published": corrected("published"), "linear": corrected("linear"), "joint": corrected("joint"),
              "published, from the alarm": corrected("published", "auto"), "linear, from the alarm": corrected("linear", "auto")}


def ramped(few, many, onset):
    """What m = 3 predicts, and from `onset` on, more and more, a field of one shape: what m = 6 adds where that is largest."""
    left_out = many - few
    steps = np.arange(len(few))
    growth = np.clip((steps - onset + 1) / (RAMP * len(few) / 100), 0, 1)
    return few + SIZE * growth[:, None] * left_out[np.argmax(np.sum(left_out**2, 1))]


class Outcomes:
    """What came of all draws of noise and nodes with one onset and one treatment."""

    def __init__(self):
        self.worst, self.last, self.nats, self.alarmed, self.errors = [], [], [], [], []

    def add(self, run, onset, uncorrected):
        off = run.off_by().max(1)
        self.worst.append(off[onset:].max())
        self.last.append(off[-1])
        self.nats.append(run.log_evidence - uncorrected)
        self.errors.append(100 * (run.mean[1] - TRUTH[1]))
        came = [step for step, record in enumerate(run.records) if record["bias_correction"] == "on"]
        self.alarmed.extend(came[:1])

    def row(self, name):
        return [name, spread(self.worst), spread(self.last), readable(float(np.sqrt(np.mean(np.square(self.errors)))), 2),
                "0" if name == "uncorrected" else f"{np.median(self.nats):+.0f}"]


def spread(values) -> str:
    """Median, and the range of the middle 90 %."""
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
    return f"{readable(middle, 2)} ({readable(low, 2)} to {readable(high, 2)})"


def onset_runs(subject, options, joint_draws):
    study = {(onset, name): Outcomes() for onset in ONSETS for name in TREATMENTS}
    for i in range(options.repetitions):
        seed = options.seed + 5000 + i
        other = draw(subject.beam, seed)
        few, many = predicted(subject.beam.three, other.sensors), predicted(subject.model, other.sensors)
        for at in ONSETS:
            onset = at * len(few) // 100
            values = ramped(few, many, onset) + other.noise
            uncorrected = None
            for name, how in TREATMENTS.items():
                if name == "joint" and i >= joint_draws:
                    continue
                run = assimilate(subject.beam.three, other.sensors, values, seed=seed, **how)
                uncorrected = run.log_evidence if uncorrected is None else uncorrected
                study[at, name].add(run, onset, uncorrected)
        options.say(f"onset of a bias: {i + 1} of {options.repetitions} draws")
    return study


def early_runs(subject, options):
    """A model fitted to what comes before the crack has run, with data of m = 6."""
    beginning = EARLY * subject.beam.case.steps // 100
    early = subject.beam.model("m3_early", f"the elastic mode and the two best of {beginning} steps", lambda runs: (
        "canonical", beam.fitted_to_beginning(runs, beginning, beam.FEW_MODES - 1)))
    study = {name: Outcomes() for name in list(TREATMENTS)[:3]}
    for i in range(options.repetitions):
        seed = options.seed + 6000 + i
        other = draw(subject.beam, seed)
        values, uncorrected = predicted(subject.model, other.sensors) + other.noise, None
        for name, outcomes in study.items():
            run = assimilate(early, other.sensors, values, seed=seed, **TREATMENTS[name])
            uncorrected = run.log_evidence if uncorrected is None else uncorrected
            outcomes.add(run, beginning, uncorrected)
    return study


def bias_onset(subject, options):
    figure = Figure("onset", "When the bias begins",
                    "Not in the paper. The model with m = 3 is exact until a step. From there on a field of one shape is added to the data, "
                    f"{SIZE} times what m = 6 adds to m = 3 where that is largest; it is there in full after {RAMP} steps. Uncorrected; corrected "
                    "at every step, to the letter of Eq. 16-20 (published), with the modes' errors in the covariance (linear), and jointly; and "
                    "the first two from the alarm on, the data since the drift began being assimilated again (§4.3).")
    joint_draws = min(options.repetitions, QUICK_JOINT_DRAWS if options.quick else JOINT_DRAWS)
    study, early = onset_runs(subject, options, joint_draws), early_runs(subject, options)
    charts = []
    for what, words in (("worst", "worst step after the onset"), ("last", "last step")):
        for way, names in (("corrected at every step", ("uncorrected", "published", "linear", "joint")),
                           ("corrected from the alarm on", ("uncorrected", "published, from the alarm", "linear, from the alarm"))):
            chart = Chart(f"Truth off by at the {words}, {way}", "step at which the bias begins [–]", "truth off by, logarithmic [std]",
                          logarithmic=True)
            for name in names:
                low, middle, high = np.array([np.quantile(getattr(study[at, name], what), (0.05, 0.5, 0.95)) for at in ONSETS]).T
                colour = list(TREATMENTS).index(name)
                chart.band(f"{name}, middle 90 %", low, high, ONSETS, colour=colour)
                chart.curve(name, middle, ONSETS, points=True, colour=colour)
            charts.append(chart)
    figure.panel("Distance of the truth from the mean, the worse parameter: median over the draws, and the range of the middle 90 %.", *charts)
    header = ["bias from step", "correction", "worst after it, std", "last, std", "error of A_d, rms, %", "evidence, nats",
              "came on: runs, median step"]
    draws = f"over {options.repetitions} draws of noise and nodes"
    figure.tables.append((f"Medians {draws} (joint: {joint_draws}); in brackets the range of the middle 90 %.", header,
                          [[str(at), *study[at, name].row(name), ", ".join([str(len(study[at, name].alarmed)),
                            *([f"{np.median(study[at, name].alarmed):.0f}"] if study[at, name].alarmed else [])])
                            if "alarm" in name else ""] for at in ONSETS for name in TREATMENTS]))
    figure.tables.append((f"A model with m = 3 fitted to the first {EARLY} steps, of which later steps have the time functions alone; data of "
                          f"m = 6. Medians {draws}; in brackets the range of the middle 90 %.",
                          ["correction", f"worst after step {EARLY}, std", *header[3:6]], [outcomes.row(name) for name, outcomes in early.items()]))
    medians = [[float(np.median(getattr(early[name], what))) for name in ("uncorrected", "published")] for what in ("last", "worst")]
    figure.row(f"m = 3 fitted to steps before {EARLY}: truth off by at the end, uncorrected and published", "std", "not done",
               " and ".join(readable(v, 2) for v in medians[0]), "At the worst step after it " + " and ".join(readable(v, 2) for v in medians[1])
               + ". The parameters are identified before the model fails.", medians[0][1])
    for at in ONSETS[1:4]:
        before = {what: np.median(getattr(study[at, "uncorrected"], what)) for what in ("last", "worst")}
        for name in ("published", "linear", "joint"):
            last, worst = np.median(study[at, name].last), np.median(study[at, name].worst)
            figure.row(f"bias from step {at}, {name}: truth off by at the end", "std", "not done", readable(last, 2),
                       f"Uncorrected {readable(before['last'], 2)}. At the worst step after the onset {readable(worst, 2)}, uncorrected "
                       f"{readable(before['worst'], 2)}.", last)
    figure.series(onset=ONSETS)
    for name in TREATMENTS:
        for label, level in (("low", 0.05), ("median", 0.5), ("high", 0.95)):
            figure.series(**{f"{what}_{label}_{name}": [np.quantile(getattr(study[at, name], what), level) for at in ONSETS]
                             for what in ("worst", "last")})
    return figure
