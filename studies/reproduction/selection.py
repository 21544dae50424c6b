"""Fig. 16 to 18: which of the displacements that a camera measures are worth assimilating."""
import json
import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np

import beam
import knothe
from beam import NOISE, TRUTH
from experiment import assimilate, model_of, predicted, project_text, write_data
from record import LABELS, Chart, Figure, Map, readable
from updating import KEYS, marginals_of, stds_of

SCALE = 0.25e-3  # m per px
HALF_WIDTH = 0.12  # m, of the part that is looked at
BORDER, MARGIN = 2e-3, 20  # m left out along the beam's outline; px around it
ELEMENT = 24  # px
CHOSEN = 30


class Camera:
    """The central part of the beam (|x| <= 120 mm) as image correlation sees it: a speckle picture of 0.25 mm a pixel, linear triangles of
    6 mm on it without those that touch the notch, and M_DIC of its u and v of each node in turn, v upwards."""

    def __init__(self, case, seed):
        random = np.random.default_rng(seed)
        width, height = round(2 * HALF_WIDTH / SCALE + 2 * MARGIN), round(beam.HEIGHT / SCALE + 2 * MARGIN)
        waves = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None])
        spots = np.fft.irfft2(np.fft.rfft2(random.standard_normal((height, width))) * np.exp(-2 * (2 * np.pi * waves) ** 2), (height, width))
        picture = np.clip(127 + 45 * spots / spots.std(), 0, 254)

        x = np.linspace(-HALF_WIDTH, HALF_WIDTH, round(2 * HALF_WIDTH / SCALE / ELEMENT) + 1)
        y = np.linspace(BORDER, beam.HEIGHT - BORDER, round((beam.HEIGHT - 2 * BORDER) / SCALE / ELEMENT) + 1)
        numbers = np.arange(len(x) * len(y)).reshape(len(x), len(y))
        # One pixel more on each side: nodes must lie in the beam's own mesh.
        beside = np.maximum(x[:-1], -x[1:]) >= case.notch_half_width + SCALE
        above = y[:-1] >= beam.NOTCH_DEPTH + SCALE
        kept = beside[:, None] | above[None]
        quads = np.stack([numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]], -1)[kept]
        used, quads = np.unique(quads, return_inverse=True)
        self.cells = quads.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        self.points = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)[used]
        origin = (MARGIN + HALF_WIDTH / SCALE, MARGIN + beam.HEIGHT / SCALE)
        pixels = np.column_stack([origin[0] + self.points[:, 0] / SCALE, origin[1] - self.points[:, 1] / SCALE])
        correlation = knothe.Correlation(picture, mesh=(pixels, self.cells[:, ::-1].astype(np.int32)), threads=1)
        moved = correlation.correlate(picture + random.standard_normal(picture.shape))
        up = np.tile([1.0, -1.0], len(self.points))
        self.matrix = up[:, None] * moved.precision().toarray() * up  # M / (2 gamma^2), px
        self.sensors = correlation.sensors(SCALE, origin, z=beam.HALF_THICKNESS)
        self.right = self.sensors.points[:, 0] > 0
        self.horizontal = np.array(self.sensors.components) == 0
        # The noise of image correlation, N(0, 2 gamma^2 M^-1), with the gamma for which the median std is 1 um.
        covariance = np.linalg.inv(self.matrix)
        factor = (NOISE / np.median(np.sqrt(np.diag(covariance)))) ** 2
        self.covariance, self.precision = covariance * factor, self.matrix / factor

    def part(self, dofs):
        return knothe.Sensors(self.sensors.points[dofs], [self.sensors.components[i] for i in dofs])

    def at_random(self, seed):
        return np.random.default_rng(seed).choice(len(self.sensors), CHOSEN, replace=False)

    def select_as_published(self, model, step):
        """The 30 dofs of the largest |M_DIC S_12|, where S_12 = |S_1| |S_2| at a step (Eq. 34); and M_DIC S_12."""
        weighted = self.matrix @ np.prod(np.abs(model_of(model).observe(self.sensors).jacobian(TRUTH, step)), axis=1)
        return np.argsort(-np.abs(weighted), kind="stable")[:CHOSEN], weighted

    def select_d_optimal(self, model, correlated=False):
        """30 dofs by `knothe select`: greedily by the information of all steps about the parameters."""
        with tempfile.TemporaryDirectory(prefix="knothe-") as folder:
            times = model_of(model).times
            write_data(Path(folder, "data.h5"), times, self.sensors, np.zeros((len(times), len(self.sensors))),
                       rows_of(self.precision) if correlated else None)
            project = Path(folder, "project.toml")
            at = "".join(f"{name} = {value}\n" for name, value in zip(KEYS, TRUTH))
            project.write_text(project_text(Path(model).resolve(), "data.h5", 1, {}, f'[select]\ncriterion = "d-optimal"\ncount = {CHOSEN}\n'
                                            f'candidates = "data"\n[select.at]\n{at}'))
            return np.array(json.loads(beam.run("select", project, "--json", "-o", Path(folder, "results")).splitlines()[-1])["dofs"])


def rows_of(matrix) -> knothe.Precision:
    symmetric = 0.5 * (matrix + matrix.T)
    rows, columns = np.nonzero(symmetric)
    return knothe.Precision(symmetric[rows, columns], columns, np.searchsorted(rows, np.arange(len(matrix) + 1)))


@lru_cache(maxsize=2)
def camera_of(case, seed):
    return Camera(case, seed)


def assimilate_chosen(model, sensors, seed, covariance=None, **how):
    """What m = 6 predicts at the truth, with white noise of 1 um, or with this covariance in the data and in the likelihood."""
    exact = predicted(model, sensors)
    white = np.random.default_rng(seed).standard_normal(exact.shape)
    if covariance is None:
        return assimilate(model, sensors, exact + NOISE * white, seed=seed, **how)
    return assimilate(model, sensors, exact + white @ np.linalg.cholesky(covariance).T, seed=seed,
                      precision=rows_of(np.linalg.inv(covariance)), **how)


def mean_step(model) -> int:
    """The mean time, as the paper chooses it."""
    return len(model_of(model).times) // 2 - 1


def figures_16_17(subject, options):
    model, step = subject.model, mean_step(subject.model)
    camera = camera_of(subject.beam.case, options.seed)
    chosen, weighted = camera.select_as_published(model, step)
    figure = Figure("16-17", "Sensitivity fields, and the dofs chosen by them",
                    f"Eq. 34 at the mean time (step {step}) and the reference parameters. The camera: a speckle picture of the central 240 mm, "
                    f"0.25 mm a pixel, linear triangles of 6 mm ({len(camera.sensors)} dofs), M_DIC by Eq. 27; S₁₂ weighted by it.")
    face = beam.face_of(model)
    sensitivity = np.abs(model_of(model).jacobian(TRUTH, step))
    figure.panel("Fig. 16 of the paper: |∂u/∂Y₀|, |∂u/∂A_d| and their product, horizontal and vertical.",
                 *(Map(f"{name}, {'xy'[component]}", face, label, unit, value=face.component(field, component)) for component in (0, 1)
                   for field, name, label, unit in ((sensitivity[:, 0], "S₁ (Y₀)", "∂u per unit of Y₀", "m"),
                                                    (sensitivity[:, 1], "S₂ (A_d)", "∂u per unit of A_d", "m"),
                                                    (1e12 * sensitivity.prod(1), "S₁₂ = S₁ S₂", "product", "µm²"))))
    scaled = weighted / np.abs(weighted).max()
    figure.panel("Fig. 17 of the paper: the product weighted by the matrix of the image correlation, and the 30 dofs where it is largest "
                 "(circles).",
                 *(Map(f"M_DIC S₁₂, {word}, and the dofs chosen there", camera, "over the largest of both components", "1", value=scaled[component::2],
                       signed=True, sensors=[(*camera.sensors.points[i, :2], f"chosen, {word}") for i in chosen
                                             if camera.horizontal[i] == (component == 0)])
                   for component, word in ((0, "horizontal"), (1, "vertical"))))
    figure.row("chosen dofs right of mid-span", "%", "all", f"{100 * camera.right[chosen].mean():.0f}",
               "u_x = 0 on the left: as the crack opens the right half moves to the right, and all of it by the same amount.",
               100 * camera.right[chosen].mean(), 100)
    figure.row("chosen dofs that are horizontal", "%", "area of the larger horizontal displacement",
               f"{100 * camera.horizontal[chosen].mean():.0f}", "As above.", 100 * camera.horizontal[chosen].mean())
    seen = model_of(model).observe(camera.sensors)
    size = 1e6 * np.array([np.sqrt(np.mean(seen.jacobian(TRUTH, t) ** 2, axis=0)) for t in range(len(model_of(model).times))])
    chart = Chart("When each parameter moves the surface", "step [–]", "sensitivity, rms [µm per unit]").mark("mean time", x=step)
    for k, label in enumerate(LABELS):
        chart.curve(label, size[:, k])
    figure.panel("The mean time, at which the dofs are chosen, is one instant of this.", chart)
    peak = size.argmax(0)
    share = size[step] / size.max(0)
    figure.row("step where the sensitivity is largest: Y₀, A_d", "step", "mean time chosen", f"{peak[0]} and {peak[1]}",
               f"At the mean time it is {readable(share[0], 2)} and {readable(share[1], 2)} of that.", peak[0])
    figure.series(sensitivity_um_rms_Y0=size[:, 0], sensitivity_um_rms_Ad=size[:, 1], chosen_dofs_of_the_camera=chosen)
    return figure


def figure_18(subject, options):
    model = subject.model
    figure = Figure("18", "Selected measurements against random ones",
                    "Data of m = 6 at (1, 1), white noise of 1 µm (in two rows that of image correlation), at the 30 dofs of Fig. 17, at 30 dofs "
                    "of the camera drawn at random, and at the 30 random nodes of Fig. 8: §6.4 says that those are 60 dofs, §6.5 that they are "
                    "30.")
    camera = camera_of(subject.beam.case, options.seed)
    chosen, _ = camera.select_as_published(model, mean_step(model))
    optimal = camera.select_d_optimal(model)
    runs = {"30 dofs, selected (paper)": assimilate_chosen(model, camera.part(chosen), options.seed, marginals=True),
            "30 dofs, random": assimilate_chosen(model, camera.part(camera.at_random(options.seed)), options.seed, marginals=True),
            "30 nodes, random (60 dofs)": assimilate_chosen(model, subject.sensors, options.seed, marginals=True),
            "30 dofs, D-optimal": assimilate_chosen(model, camera.part(optimal), options.seed)}
    selected, random_dofs, random_nodes, d_optimal = runs.values()
    seeds = [options.seed + 2000 + i for i in range(max(5, options.repetitions // 2))]
    random = [assimilate_chosen(model, camera.part(camera.at_random(seed)), seed) for seed in seeds]
    half = np.median([[run.first_below(k, 0.5) for k in range(2)] for run in random], axis=0)
    stds = np.median([run.std for run in random], axis=0)

    def with_correlated_noise(dofs, seed):
        dofs = np.sort(dofs)
        return assimilate_chosen(model, camera.part(dofs), seed, covariance=camera.covariance[np.ix_(dofs, dofs)]).std

    same = {"selected": with_correlated_noise(chosen, options.seed),
            "optimal": with_correlated_noise(camera.select_d_optimal(model, correlated=True), options.seed),
            "random": np.median([with_correlated_noise(camera.at_random(seed), seed) for seed in seeds], axis=0)}
    for run, caption in ((selected, "Fig. 18 of the paper, left: 30 selected dofs."),
                         (random_dofs, "Fig. 18 of the paper, right, read as 30 random dofs."),
                         (random_nodes, "Fig. 18 of the paper, right, read as 30 random nodes (60 dofs).")):
        figure.panel(caption, *marginals_of(run))
    figure.panel("The same as standard deviations; besides, 30 dofs chosen by the information of all steps.", *stds_of(runs))

    def step_or_never(step):
        return "never" if step >= len(selected.records) else f"{step:g}"

    for k, label in enumerate(LABELS):
        figure.row(f"{label}: last std, selected over random 30 dofs", "1", "selected is better", readable(selected.std[k] / stds[k], 2),
                   f"{readable(selected.std[k], 2)} against {readable(stds[k], 2)} (median of {len(seeds)} random choices); 60 random dofs: "
                   f"{readable(random_nodes.std[k], 2)}; 30 D-optimal dofs, which use all steps: {readable(d_optimal.std[k], 2)}.",
                   selected.std[k] / stds[k])
        figure.row(f"{label}: step where the std is half the prior's, selected and random", "step", "selected is faster",
                   f"{step_or_never(selected.first_below(k, 0.5))} and {step_or_never(half[k])}",
                   f"60 random dofs: {step_or_never(random_nodes.first_below(k, 0.5))}; D-optimal: {step_or_never(d_optimal.first_below(k, 0.5))}.",
                   selected.first_below(k, 0.5))
        figure.row(f"{label}: last std, selected over random, the noise 2γ²M⁻¹ assimilated too", "1",
                   "M_DIC weights the choice; the noise assimilated is white", readable(same["selected"][k] / same["random"][k], 2),
                   f"{readable(same['selected'][k], 2)} against {readable(same['random'][k], 2)}; 30 dofs that are D-optimal for that noise: "
                   f"{readable(same['optimal'][k], 2)}. γ is such that the median std of a dof is 1 µm; errors of neighbours are correlated, "
                   "so 30 dofs together give less information.", same["selected"][k] / same["random"][k])
        figure.series(**{f"random_std_{KEYS[k]}": [run.std[k] for run in random]},
                      **{f"std_{KEYS[k]}_{name}": run.stds[:, k] for name, run in
                         zip(("selected", "random_30_dofs", "random_30_nodes", "d_optimal"), runs.values())})
    figure.series(selected_dofs_of_the_camera=chosen, d_optimal_dofs_of_the_camera=optimal)
    return figure
