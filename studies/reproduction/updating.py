"""Fig. 8, 9 and 13: sequential assimilation, and the forecast of the crack length."""
import json

import numpy as np

import beam
from beam import ESTIMATE, ESTIMATE_STD, HIGH_ORDER, LENGTH_MEAN, LENGTH_MODE
from experiment import PAPER, assimilate, by_inverse_map, draw, forecasts_of, predicted
from record import LABELS, Chart, Densities, Figure, Map, readable, steps_text, with_uncertainty

KEYS = ("Y0", "Ad")


def marginals_of(run):
    """Successive marginals of both parameters."""
    return [Densities(f"Marginal of {LABELS[k]}", f"{LABELS[k]} over its reference", "–", [each[k] for each in run.marginals], run.priors[k],
                      beam.TRUTH[k]) for k in range(2)]


def stds_of(runs, published=None):
    """Standard deviations over the steps, of runs by label."""
    charts = []
    for k, name in enumerate(LABELS):
        chart = Chart(f"Posterior standard deviation of {name}", "step [–]", "std, logarithmic [–]", logarithmic=True)
        for label, run in runs.items():
            chart.curve(label, run.stds[:, k])
        if published is not None:
            chart.mark("paper, last step", "red", y=published[k])
        charts.append(chart)
    return charts


def sensors_map(subject):
    places = np.unique(subject.sensors.points[:, :2], axis=0)
    return Map("The beam and the measured nodes", beam.face_of(subject.model), "30 nodes, both components",
               sensors=[(x, y, "measured node") for x, y in places])


def repeated(subject, options):
    """The experiment again with other nodes and noise: last means and standard deviations, draws x parameters."""
    means, stds = [], []
    for i in range(options.repetitions):
        other = draw(subject.beam, options.seed + 1000 + i)
        run = assimilate(subject.model, other.sensors, predicted(subject.model, other.sensors) + other.noise, seed=options.seed + 1000 + i)
        means.append(run.mean)
        stds.append(run.std)
    return np.array(means), np.array(stds)


def figures_8_9(subject, soft, options):
    figure = Figure("8-9", "Sequential updating of the damage parameters",
                    "As in §6.3.1: data from the same separated model (m = 6) at (1, 1), 30 nodes drawn at random from the outer face with "
                    "|x| ≤ 120 mm, both components (60 dofs), white noise of 1 µm; prior N((0.9, 1.1), 0.2 I), truncated to the box in which "
                    "the model exists (half of its mass is outside); one map per datum, composed, by BFGS with the gradient, variance "
                    "diagnostic 10⁻³.")
    run, soft_run = subject.assimilate(marginals=True, **PAPER), soft.assimilate(**PAPER)
    without = subject.assimilate(**PAPER | {"minimiser": "nelder-mead"})
    collapsed = subject.assimilate()
    count = subject.beam.case.steps
    pictures = np.unique(np.round(count * np.arange(1, beam.PICTURES + 1) / beam.PICTURES).astype(int) - 1)
    camera = subject.assimilate(steps=pictures[pictures >= 0])
    means, stds = repeated(subject, options)

    figure.panel("Fig. 8 of the paper: the nodes that are observed.", sensors_map(subject))
    figure.panel("Fig. 9 of the paper, left and centre: wide while the beam is elastic, then narrow around the truth.", *marginals_of(run))
    order = Chart("Order that the map of each datum needed", "step [–]", "order of the map [–]", least=0)
    order.curve("order", run.orders, look="bars", colour="purple")
    times = Chart("CPU time to find the map of each datum", "step [–]", "CPU time, logarithmic [ms]", logarithmic=True)
    times.curve("with gradient", run.cpu_ms).curve("function alone", without.cpu_ms)
    figure.panel("Fig. 9 of the paper, right.", order, times)
    figure.panel("Standard deviations, and the paper's last ones. How well Y₀ is known depends on the mesh.",
                 *stds_of({"reference": run, "coarse, soft supports": soft_run}, ESTIMATE_STD))
    covered = np.sum(np.abs(means - beam.TRUTH) <= 2 * stds, axis=0)
    whys = ("The information on Y₀ is in how the crack starts, and grows with the width of the crack band, which is one element: the mesh of "
            "the paper is not given. Elements of 20 mm and softer supports give {}.",
            "The paper knows A_d less well than any mesh here does ({} with the coarse, soft beam). Noise, dofs and number of pictures "
            "change both std alike; where the loading ends changes their ratio (\"supports\", below).")
    for k, label in enumerate(LABELS):
        figure.row(f"{label}: maximum of the last marginal", "1", f"{ESTIMATE[k]:g}",
                   f"{readable(run.mode_of_marginal(k))} (mean {with_uncertainty(run.mean[k], run.std[k])})",
                   f"One draw of nodes and noise against another. Over {len(means)} draws the mean is {readable(means[:, k].min())} to "
                   f"{readable(means[:, k].max())}; the truth, 1, lies within two std in {covered[k]} of them.", run.mode_of_marginal(k), ESTIMATE[k])
        figure.row(f"{label}: std of the last marginal", "1", f"{ESTIMATE_STD[k]:g}", readable(run.std[k], 2),
                   whys[k].format(readable(soft_run.std[k], 2)), run.std[k], ESTIMATE_STD[k])
    fast, slow = run.first_below(1, 0.5), run.first_below(0, 0.5)
    figure.row("step at which the std is half the prior's: A_d, Y₀", "step", "A_d converges faster",
               f"{fast}, {'not reached' if slow == len(run.records) else slow}",
               "Agrees: A_d moves the observed displacements by up to 12 µm, Y₀ by less than 1 µm and only while the crack runs.", fast)
    high, high_soft = run.high_order_steps(), soft_run.high_order_steps()
    figure.row("steps with maps of higher order", "step", f"between {HIGH_ORDER[0]} and {HIGH_ORDER[1]}", steps_text(high),
               "Order rises where the posterior changes shape, which is when the crack starts to run: here the load peaks near step 19. The "
               f"step depends on supports and mesh: {steps_text(high_soft)} in the coarse, soft beam.", high[0] if high else 0, HIGH_ORDER[0])
    ratio = sum(without.cpu_ms) / sum(run.cpu_ms)
    figure.row("CPU time of all steps, function alone over with gradient", "1", "gradient much faster", readable(ratio),
               f"Agrees. {readable(1e-3 * sum(without.cpu_ms))} s and {readable(1e-3 * sum(run.cpu_ms))} s in all; Nelder-Mead simplex and BFGS, "
               "as in the paper.", ratio)
    apart = float(np.max(np.abs(run.mean - collapsed.mean) / collapsed.std))
    figure.row("composed maps against all data in one map, last means", "std", "composed maps only", readable(apart, 2),
               "The same posterior computed in two ways; the composition is checked against it and restarted where errors of many maps have "
               "added up.", apart)
    figure.row("27 pictures (3·10⁻³ mm/s, one every 5 s) in place of 100 steps: Y₀, A_d", "1", "not said which",
               ", ".join(with_uncertainty(camera.mean[k], camera.std[k]) for k in range(2)),
               "The paper computes 100 steps up to 0.4 mm; its camera would have taken 27 pictures.", camera.std[0])
    for prefix, each in (("", run), ("coarse_soft_", soft_run)):
        for k, key in enumerate(KEYS):
            figure.series(**{f"{prefix}mean_{key}": each.means[:, k], f"{prefix}std_{key}": each.stds[:, k]})
        figure.series(**{f"{prefix}steps_of_higher_order": each.high_order_steps()})
    figure.series(step_cpu_ms_with_gradient=run.cpu_ms, step_cpu_ms_function_alone=without.cpu_ms,
                  **{f"last_mean_of_repetitions_{key}": means[:, k] for k, key in enumerate(KEYS)})
    return figure


def forecast_run(subject, horizons, options):
    return forecasts_of(subject.model, subject.sensors, subject.values, horizons, seed=options.seed, **PAPER)


def damaged_length(subject) -> float:
    """Of the damage field itself at (1, 1) after the last step, mm: height above the notch over which the damage exceeds 1/2."""
    law = "crack-band" if subject.beam.case.crack_band else "none"
    out = beam.run("model", "mesh-study", subject.beam.project, "--elements", subject.beam.case.element, "--laws", law, "--json")
    return 1e3 * next(json.loads(line)["crack_length_m"] for line in out.splitlines() if "crack_length_m" in line)


def figure_13(subject, soft, options):
    figure = Figure("13", "The crack length at the end, forecast as the data come in",
                    "For each posterior sample, the elastic crack whose sensor displacements match the damaged beam at the final "
                    "displacement. Beside it Eq. 33 with the predicted field as a normal one, prior N(40 mm, (13 mm)²), and the "
                    "distance of the two fields estimated (the paper does not give it). Also at 0.12 mm, where the length is still uncertain.")
    run = forecast_run(subject, {"end": 1.0, "early": 0.3}, options)
    soft_run = forecast_run(soft, {"end": 1.0}, options)

    def of(which, name="end", key=None):
        """Mean and std over the steps, mm."""
        entries = [record["forecast"][name] if key is None else record["forecast"][name][key] for record in which.records]
        return 1e3 * np.array([[entry["mean"], entry["std"]] for entry in entries])

    def drawn(which, name, words):
        """Densities over the steps, and mean with spread."""
        densities = [(entry["points"], entry["values"]) for entry in (record["forecast"][name]["density"] for record in which.records)]
        mean, std = of(which, name).T
        chart = Chart(f"Crack length {words}, mean and spread", "step [–]", "crack length [mm]")
        chart.band("± 2 std", mean - 2 * std, mean + 2 * std, colour="blue").curve("mean", mean, colour="blue")
        return [Densities(f"Crack length {words}, density", f"crack length {words}", "m", densities), chart]

    figure.panel("Fig. 13 of the paper, left and centre: the reference beam, at the end.", *drawn(run, "end", "at the end"))
    figure.panel("The same beam at 0.12 mm.", *drawn(run, "early", "at 0.12 mm"))
    figure.panel("Elements of 20 mm, and 0.18 of the 0.4 mm reaching the beam: near the paper's numbers.",
                 *drawn(soft_run, "end", "of the coarse, soft beam"))
    update, forecast = (1e-3 * np.array([record["elapsed_us"][key] for record in run.records]) for key in ("update", "forecast"))
    time = Chart("Time of each step", "step [–]", "time [ms]", least=0)
    time.curve("parameters and crack length", update + forecast, look="bars", colour="orange")
    time.curve("parameters alone", update, look="bars", colour="blue")
    figure.panel("Fig. 13 of the paper, right.", time)

    last, soft_last = run.records[-1]["forecast"]["end"], soft_run.records[-1]["forecast"]["end"]
    here, early, there = of(run), of(run, "early"), of(soft_run)
    why = ("At 0.4 mm this beam has lost 98 % of its stiffness whatever the parameters, and an elastic crack of equal compliance is that "
           "long: the paper's beam must have been softer at its supports, coarser, or both. The coarse, soft beam gives "
           f"{with_uncertainty(*there[-1])} mm; a spring in series does not (docs/benchmarks/reproduction.md). At 0.12 mm the reference gives "
           f"{with_uncertainty(*early[-1])} mm.")
    figure.row("crack length at the end, mean", "mm", f"{LENGTH_MEAN:g}", with_uncertainty(*here[-1]), why, here[-1, 0], LENGTH_MEAN)
    most = [1e3 * entry["maximum_a_posteriori"] for entry in (last, soft_last)]
    figure.row("crack length at the end, maximum a posteriori", "mm", f"{LENGTH_MODE:g}", readable(most[0]), "As for the mean.", most[0],
               LENGTH_MODE)
    figure.row("the same, coarse beam on soft supports", "mm", f"{LENGTH_MODE:g}", readable(most[1]),
               "A guess at what the paper leaves open that gives its length; not evidence that it is right.", most[1], LENGTH_MODE)
    normal, normal_early = of(run, key="published"), of(run, "early", "published")

    def ends(values):
        return f"{with_uncertainty(*values[0])} and {with_uncertainty(*values[-1])}"

    figure.row("crack length at the end by Eq. 33 with a normal field, first and last step", "mm", "Eq. 33 with inverse transport maps",
               ends(normal), f"From the posterior's points: {ends(here)}. At 0.12 mm: {ends(early)}, by Eq. 33 {ends(normal_early)}. A field "
               "of mean displacement is that of no crack while little is known.", normal[0, 0])
    first, final = ({name: 1e3 * value for name, value in by_inverse_map(
        subject.model, subject.sensors, subject.values[:steps], {"end": 1.0, "early": 0.3}, seed=options.seed, **PAPER).items()}
        for steps in (1, len(subject.values)))
    figure.row("the same with the inverse transport map of the predicted field", "mm", "Eq. 33 with inverse transport maps",
               ends([first["end"], final["end"]]), f"At 0.12 mm: {ends([first['early'], final['early']])}. The field's distribution is right "
               "then, and at the end of the data the two agree. The remaining difference is Eq. 33's own: a second prior, and a weight for "
               "fields that look like a crack's.", first["end"][0])
    damaged = [damaged_length(each) for each in (subject, soft)]
    figure.row("crack length of the damage field itself at (1, 1): reference, coarse and soft", "mm", "not given",
               f"{readable(damaged[0])} and {readable(damaged[1])}",
               "Height above the notch over which the damage exceeds ½ in the full-order run: no elastic crack in between.", damaged[0])
    figure.row("std of the length at 0.12 mm, first and last step", "mm", "coarse at first, then converges",
               f"{readable(early[0, 1], 2)} and {readable(early[-1, 1], 2)}",
               "Agrees. (At the end the length hardly depends on the parameters, so there is little to learn.)", early[-1, 1])
    slowest = 1e-3 * float(np.max(update + forecast))
    figure.row("slowest step, update and forecast", "s", f"< {beam.SECONDS_PER_STEP:g}", readable(slowest, 2),
               "By the clock. Composed maps as in the paper; with all data in one map a step takes about a millisecond "
               "(docs/explanation/assimilation.md). The machine is named at the end.", slowest, beam.SECONDS_PER_STEP)
    residuals = [1e6 * entry["bridge_residual_rms"] for entry in (last, soft_last)]
    figure.row("distance of the elastic crack from the damaged beam, sensor by sensor", "µm", "not given",
               f"{readable(residuals[0], 2)} (coarse, soft: {readable(residuals[1], 2)})",
               "What Eq. 33 has to allow for, estimated with the length (docs/explanation/forecast.md).", residuals[0])
    for prefix, values in (("", here), ("coarse_soft_", there)):
        figure.series(**{f"{prefix}length_m_mean": 1e-3 * values[:, 0], f"{prefix}length_m_std": 1e-3 * values[:, 1]})
    return figure
