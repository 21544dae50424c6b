"""Beyond the paper: data of the beam itself and what six modes are; where the loading ends; the conclusions under other choices."""
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

import beam
from beam import ESTIMATE_STD, MODES, TRUTH
from bias import bias_runs
from experiment import Subject, draw, predicted
from record import LABELS, Chart, Figure, extent, readable, steps_text, with_uncertainty
from selection import assimilate_chosen, camera_of, mean_step
from updating import KEYS, forecast_run

# (Y0, Ad): nodes of the grid, then centres between four of them, as far from all nodes as can be.
TRUTHS = ((1, 1), (0.9375, 1.0625), (1.1875, 0.8125), (1.125, 0.875), (0.8125, 1.1875), (1.0625, 1.1875), (0.6875, 0.9375))
QUICK_TRUTHS = 3


def latin_model(subject):
    """Six modes of the solution of LATIN-PGD."""
    of = subject.beam
    path, text = of.path("_m6_latin.h5"), of.identity.replace('form = "tree"', 'form = "canonical"')
    text = "\n".join(f"modes = {MODES - 1}" if line.startswith("modes") else line for line in text.splitlines()) + "\n"
    if not of.kept(path, text):
        project = of.path("_latin.toml")
        project.write_text(text)
        beam.run("offline", project, "--method", "latin", "-o", path)
    return path


def candidates(subject):
    """Models by name; the first is the judge of the others. Those of six modes begin with "m = 6"."""
    of = subject.beam
    tree = min(50, of.case.nodes ** 2 - 1)
    return {"uncompressed snapshots": of.runs.path,
            f"tree form, {tree} modes": of.model("tree", f"tree, {tree} modes", lambda runs: (
                "tree", runs.separated(runs.coefficients, "tree", tree))),
            "m = 6, alternating least squares": of.paper,
            "m = 6, LATIN-PGD": latin_model(subject),
            "m = 6, mode by mode": of.model("m6_greedy", "the elastic mode and five, one by one", lambda runs: (
                "canonical", beam.one_by_one(runs, MODES - 1))),
            "m = 3, two best modes": of.three_best, "m = 3": of.three}


def solution(subject, p):
    """What the full-order model shows the sensors, which are at its dofs, steps x sensors."""
    with tempfile.TemporaryDirectory(prefix="knothe-") as folder:
        path = Path(folder, "solution.h5")
        beam.run("model", "solve", subject.beam.project, "--at", f"Y0={p[0]},Ad={p[1]}", "-o", path)
        with h5py.File(path) as file:
            field_ = file["snapshots"][:].reshape(len(file["time"]), -1)
            points, components = file["dofs/points"][:], file["dofs/component"][:]
    place = {(int(c), *np.round(1e9 * point).astype(int)): i for i, (c, point) in enumerate(zip(components, points))}
    sensors = subject.sensors
    return field_[:, [place[(c, *np.round(1e9 * point).astype(int))] for c, point in zip(sensors.components, sensors.points)]]


@dataclass
class Outcomes:
    """A model at all truths; distances in std."""

    error: list = field(default_factory=list)  # of the model at the truth, largest on any sensor at any step, um
    last: list = field(default_factory=list)  # truth off by
    worst: list = field(default_factory=list)
    shift: list = field(default_factory=list)  # of the mean from the judge's, in its std, by step
    ratio: list = field(default_factory=list)  # last std over the judge's, the parameter where it differs more
    nats: list = field(default_factory=list)  # log-evidence beyond the judge's
    estimates: list = field(default_factory=list)


def decompositions(subject, options):
    case = subject.beam.case
    truths = [np.array(p, float) for p in TRUTHS[:QUICK_TRUTHS if options.quick else len(TRUTHS)]]
    nodes = np.linspace(0.5, 1.5, case.nodes)
    on_node = np.array([all(np.isclose(nodes, v).any() for v in p) for p in truths])
    figure = Figure("models", "Data of the beam itself, and what six modes are",
                    "Not in the paper, whose data are of the model that assimilates them. Here the full-order model makes the data: the same 60 "
                    f"dofs, white noise of 1 µm. They are assimilated with the uncompressed snapshots ({case.nodes ** 2} runs, splines between "
                    "them), and with several separated models of them: six modes by alternating least squares (the first mode being the elastic "
                    "solution), of LATIN-PGD's solution, and found one after the other.")
    models = candidates(subject)
    outcomes = {name: Outcomes() for name in models}
    for i, truth in enumerate(truths):
        exact = solution(subject, truth)
        noise = draw(subject.beam, options.seed + i).noise
        judge = None
        for name, path in models.items():
            run = subject.assimilate(path, exact + noise)
            judge = judge or run
            o, ratio = outcomes[name], run.std / judge.std
            o.error.append(1e6 * np.abs(predicted(path, subject.sensors, truth) - exact).max())
            o.last.append(run.off_by(truth)[-1].max())
            o.worst.append(run.off_by(truth).max())
            o.shift.append(np.max(np.abs(run.means - judge.means) / judge.stds, axis=1))
            o.ratio.append(ratio[np.argmax(np.abs(np.log(ratio)))])
            o.nats.append(run.log_evidence - judge.log_evidence)
            o.estimates.append([with_uncertainty(run.mean[k], run.std[k]) for k in range(2)])
        options.say(f"decompositions: {i + 1} of {len(truths)} truths")
    shown = int(np.argmin(on_node))
    chart = Chart("How far the mean is from that of the uncompressed snapshots", "step [–]", "shift of the mean, logarithmic [std]",
                  logarithmic=True)
    for name, o in list(outcomes.items())[1:]:
        chart.curve(name, np.maximum(o.shift[shown], 1e-3))
    figure.panel(f"Data of the beam at ({truths[shown][0]:g}, {truths[shown][1]:g}), between the nodes of the grid.", chart)
    figure.tables.append(("Data of the full-order model at (1, 1) in place of data of m = 6: the effect of truncation on a real assimilation, "
                          "which the paper's own test cannot show.",
                          ["model that assimilates", "Y₀", "A_d", "truth off by, std", "std over that of the snapshots",
                           "log-evidence beyond the snapshots'"],
                          [[name, *o.estimates[0], readable(o.last[0], 2), readable(o.ratio[0], 2), f"{o.nats[0]:+.1f}"]
                           for name, o in outcomes.items()]))

    def both(values):
        return ", ".join(extent([v if v > 1e-6 else 0.0 for v in np.array(values)[which]]) for which in (on_node, ~on_node))

    def most(o):
        """Largest shift of the mean over the truths: at the worst step, at the end."""
        return max(s.max() for s in o.shift), max(s[-1] for s in o.shift)

    figure.tables.append((f"{len(truths)} truths, {on_node.sum()} of them nodes of the grid, the others half-way between nodes in both "
                          "directions. \"Mean moved\" is from that of the uncompressed snapshots, in their std, largest over the truths.",
                          ["model that assimilates", "error at the sensors, µm: nodes, between", "truth off by at the end, std: nodes, between",
                           "at the worst step: nodes, between", "mean moved at the worst step, at the end, std"],
                          [[name, both(o.error), both(o.last), both(o.worst), ", ".join(readable(v, 2) for v in most(o))]
                           for name, o in outcomes.items()]))
    judge, tree = list(outcomes.values())[:2]
    last = np.array(judge.last)
    figure.row("uncompressed snapshots: truth off by at the end, on nodes and between", "std", "not done",
               f"{extent(last[on_node])} and {extent(last[~on_node])}", f"At (1, 1) they give {' and '.join(judge.estimates[0])}. Between the "
               f"nodes the splines are off by up to {readable(np.array(judge.error)[~on_node].max(), 2)} µm.", last[~on_node].max())
    six = {name: o for name, o in outcomes.items() if name.startswith("m = 6")}
    moved, worst = [most(o)[1] for o in six.values()], [most(o)[0] for o in six.values()]
    wrong = [name for name, o in six.items() if max(o.last) > 2.5]
    figure.row(f"{len(six)} decompositions of m = 6: largest shift of the mean at the end", "std", "one decomposition", extent(moved),
               f"At the worst step {extent(worst)}. Their errors are alike, {extent([beam.error_of(models[name])[0] for name in six])}: what the "
               "modes leave out decides, not how much of it. At some truth the answer is more than 2.5 std off at the end with "
               f"{'; '.join(wrong) or 'none'}.", max(moved))
    figure.row(f"{list(outcomes)[1]}: largest shift of the mean, worst step and end", "std", "not done",
               " and ".join(readable(v, 2) for v in most(tree)), "What is left then is the grid, not the modes.", most(tree)[1])
    for name, o in outcomes.items():
        figure.series(**{f"error_um, {name}": o.error, f"truth_off_by_std, {name}": o.last,
                         f"worst_shift_std, {name}": [s.max() for s in o.shift]})
    figure.series(truth_is_node=on_node)
    return figure


ENDS = (0.108, 0.112, 0.116, 0.12, 0.14, 0.2, 0.4)  # mm, of the displacement imposed
SHORT_ENDS = (0.115, 0.12)  # mm, of runs whose 100 steps end there
FINE_NOISE = 0.5e-6  # m


def supports_and_loading(subject, soft, options):
    coarse = Subject(beam.ELEMENTS_20, options)
    figure = Figure("supports", "Load, crack length, and where the loading ends",
                    "Not in the paper, which gives neither mesh nor supports. Three beams; and stds where the loading ends earlier, noise of "
                    "0.5 µm, m = 6. That a spring in series does not give the paper's crack length is in docs/benchmarks/reproduction.md.")
    rows, chart = [], Chart("The load that each beam bears", "imposed displacement [mm]", "load [kN]", least=0)
    for each in (subject, coarse, soft):
        force = beam.output_at_reference(each.model, "reaction_force")
        chart.curve(each.beam.case.what, 1e-3 * force, 0.4 * (np.arange(len(force)) + 1) / len(force))
        run = forecast_run(each, {"end": 1.0}, options)
        length = run.records[-1]["forecast"]["end"]
        rows.append([each.beam.case.what, str(force.argmax()), steps_text(run.high_order_steps()),
                     *(with_uncertainty(run.mean[k], run.std[k]) for k in range(2)),
                     with_uncertainty(1e3 * length["mean"], 1e3 * length["std"])])
    figure.panel("At the reference parameters, before and after each beam cracks.", chart)
    figure.tables.append(("Data of each beam's own m = 6 at (1, 1), 60 dofs, 1 µm.",
                          ["beam", "load peaks at step", "steps with maps of higher order", "Y₀", "A_d", "crack length at the end, mm"], rows))

    def finely(of):
        """Stds over the steps with less noise."""
        return of.assimilate(values=of.values - 0.5 * of.drawn.noise, std=FINE_NOISE).stds

    def cell(std):
        return f"{readable(std[0], 2)}, {readable(std[1], 2)}, {readable(std[0] / std[1], 2)}"

    stds = {"20_mm": finely(coarse), "5_mm": finely(subject)}
    at = [max(1, round(end / 0.4 * len(stds["5_mm"]))) - 1 for end in ENDS]
    table = [[f"{end:g}", cell(stds["20_mm"][step]), cell(stds["5_mm"][step])] for end, step in zip(ENDS, at)]
    short = []
    for end in SHORT_ENDS[:1] if options.quick else SHORT_ENDS:
        short.append(finely(Subject(beam.ending_at(beam.ELEMENTS_20, end), options))[-1])
        table.append([f"{end:g}, in 100 steps", cell(short[-1]), ""])
    published = ESTIMATE_STD[0] / ESTIMATE_STD[1]
    figure.tables.append((f"Loading that ends earlier: std of both parameters and their ratio ({published:.2f} in the paper: {ESTIMATE_STD[0]:g} "
                          f"and {ESTIMATE_STD[1]:g}).", ["loading ends at, mm", "20 mm elements: Y₀, A_d, ratio", "5 mm elements: Y₀, A_d, ratio"],
                          table))
    ratios = stds["20_mm"][-1, 0] / stds["20_mm"][-1, 1], short[0][0] / short[0][1]
    figure.row(f"std of Y₀ over std of A_d, 20 mm elements, 100 steps: to 0.4 mm, to {SHORT_ENDS[0]:g} mm", "1", readable(published, 2),
               " and ".join(readable(v, 2) for v in ratios), f"The stds are {readable(short[0][0], 2)} and {readable(short[0][1], 2)} where the "
               "loading ends near the peak (0.5 µm). Noise, dofs, prior and number of pictures do not change the ratio; where the loading ends "
               "does.", ratios[1], published)
    figure.series(loading_ends_mm=ENDS, **{f"std_{key}_{name}": values[at, k] for name, values in stds.items() for k, key in enumerate(KEYS)},
                  **{f"std_{key}_20_mm_in_100_steps": [s[k] for s in short] for k, key in enumerate(KEYS)})
    return figure


@dataclass
class Conclusions:
    """The paper's conclusions, in numbers, for one choice. Distances of the truth from the mean in std."""

    choice: str
    estimates: list
    off: float  # with m = 6 at the end, the larger of both parameters
    learnt: list  # step at which the std is half the prior's
    length: float  # final crack length, mm
    worst: dict  # at the worst step, by way of assimilation
    lost: float  # evidence, by m = 3, nats
    right: float  # share of the chosen dofs right of mid-span
    ratio: list  # last std, selected over random dofs


def conclude(subject, options) -> Conclusions:
    runs = bias_runs(subject, subject.beam.three, joint=False)
    best = subject.assimilate(subject.beam.three_best)
    six = runs["m6"]
    length = forecast_run(subject, {"end": 1.0}, options).records[-1]["forecast"]["end"]["maximum_a_posteriori"]
    camera = camera_of(subject.beam.case, options.seed)
    chosen, _ = camera.select_as_published(subject.model, mean_step(subject.model))
    selected = assimilate_chosen(subject.model, camera.part(chosen), options.seed).std
    random = np.median([assimilate_chosen(subject.model, camera.part(camera.at_random(seed)), seed).std
                        for seed in range(options.seed + 3000, options.seed + 3005)], axis=0)
    return Conclusions(subject.beam.case.what, [with_uncertainty(six.mean[k], six.std[k]) for k in range(2)], six.off_by()[-1].max(),
                       [six.first_below(k, 0.5) for k in range(2)], 1e3 * length,
                       {name: run.off_by().max() for name, run in (runs | {"best": best}).items()},
                       six.log_evidence - runs["m3"].log_evidence, camera.right[chosen].mean(), list(selected / random))


def other_choices(subject, soft, options):
    figure = Figure("choices", "What the paper leaves open",
                    "Supports, mesh and boundary condition are not given in the paper. Each conclusion is computed again with other choices.")
    found = [conclude(subject, options), conclude(soft, options)]
    for i, case in enumerate(options.others, 1):
        found.append(conclude(Subject(case, options), options))
        options.say(f"other choices: {i} of {len(options.others)}, {case.what}")
    chart = Chart("How far the truth is from the mean at the worst step", "choice, number in the table [–]", "truth off by, logarithmic [std]",
                  logarithmic=True)
    for name, label in (("m6", "m = 6"), ("m3", "m = 3"), ("best", "m = 3, best"), ("published", "m = 3, published"),
                        ("linear", "m = 3, linear")):
        chart.curve(label, [c.worst[name] for c in found], range(1, len(found) + 1), look="points")
    figure.panel("With each choice of the table below.", chart)
    figure.tables.append(("One thing changed at a time; data of each choice's own m = 6, 60 dofs, 1 µm.",
                          ["choice", *LABELS, "half the prior's std at step: A_d, Y₀", "final crack length, mm",
                           "truth off by at the worst step, std: m = 6, m = 3, m = 3 (best), m = 3 published, m = 3 linear",
                           "evidence lost by m = 3, nats", "chosen dofs on the right, %", "std selected / random: Y₀, A_d"],
                          [[f"{i}: {c.choice}", *c.estimates, ", ".join("never" if s >= 100 else str(s) for s in c.learnt[::-1]), readable(c.length),
                            ", ".join(readable(c.worst[name], 2) for name in ("m6", "m3", "best", "published", "linear")), readable(c.lost),
                            f"{100 * c.right:.0f}", ", ".join(readable(v, 2) for v in c.ratio)] for i, c in enumerate(found, 1)]))

    def count(conclusion, paper, why, holds):
        failing = [c.choice for c in found if not holds(c)]
        figure.row(conclusion, "choices", paper, f"{len(found) - len(failing)} of {len(found)}",
                   why + (f" Not with: {'; '.join(failing)}." if failing else ""), len(found) - len(failing))

    count("the truth is within 2.5 std of the means", "close to the reference values", "The data come from the model that assimilates them.",
          lambda c: c.off < 2.5)
    count("A_d is identified before Y₀", "slower convergence of Y₀", "Y₀ acts only while the crack starts.", lambda c: c.learnt[1] < c.learnt[0])
    count("with m = 3 the truth is off by more than 3 std at some step", "wrong estimation", "And with m = 6 it is not.",
          lambda c: c.worst["m3"] > 3 > c.worst["m6"])
    count("evidence is lost with m = 3", "evidence drops", "Whether or not the estimate is wrong.", lambda c: c.lost > 0)
    count("the paper's correction brings the worst mean nearer to the truth, in std", "bias eliminated",
          "The residual is extrapolated while the crack runs, when it changes fastest.", lambda c: c.worst["published"] < c.worst["m3"])
    count("the same with the modes' error in the covariance", "not in the paper", "As above.", lambda c: c.worst["linear"] < c.worst["m3"])
    count("at least 90 % of the chosen dofs are right of mid-span", "all",
          "Where the crack has not begun to run at the mean time, the dofs beside it matter.", lambda c: c.right >= 0.9)
    for k, label in ((1, "A_d"), (0, "Y₀")):
        count(f"30 selected dofs give more information than 30 random ones about {label}", "faster convergence",
              "The mean time, at which they are selected, is not when the parameter acts most.", lambda c, k=k: c.ratio[k] < 1)
    return figure
