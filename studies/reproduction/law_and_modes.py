"""Fig. 5 to 7 and 10 to 12: the damage law, the modes of the reduced model, the elastic beams with a crack."""
import h5py
import numpy as np

import beam
from experiment import model_of
from record import LABELS, Chart, Figure, Map, readable

LEAST_SHOWN = 1e-3  # µm, of a mode
LEVELS = (0.5, 0.75, 1.0, 1.25, 1.5)


def stress(strain, threshold=1.0, brittleness=1.0):
    """Traction in one direction with free sides, Eq. 29, in Pa. Only the longitudinal strain e is positive, so
    Y = (lambda + 2 mu) e^2 / 2 and sigma = E e / (1 + Ad (Y - Y0)) beyond Y0; parameters over their references."""
    lame = beam.YOUNG * beam.POISSON / ((1 + beam.POISSON) * (1 - 2 * beam.POISSON))
    energy = 0.5 * (lame + beam.YOUNG / (1 + beam.POISSON)) * strain**2
    excess = np.maximum(0, energy - threshold * beam.THRESHOLD)
    return beam.YOUNG * strain / (1 + brittleness * beam.BRITTLENESS * excess)


def figure_5(options):
    figure = Figure("5", "What the parameters of the damage law do",
                    "Traction in one direction with free sides, Eq. 29 at one material point, with the reference values of §6.2 and "
                    "parameters over the ±50 % box.")
    strain = np.linspace(0, 4e-4, 161)
    figure.series(**{"strain_1e-4": 1e4 * strain})
    peaks, charts = [], []
    for name, other, key in zip(LABELS, LABELS[::-1], ("Y0", "Ad")):
        chart = Chart(f"Stress over strain where {name} varies and {other} is its reference", "strain [10⁻⁴]", "stress [MPa]", least=0)
        peak = []
        for level in LEVELS:
            curve = 1e-6 * stress(strain, **{"threshold" if key == "Y0" else "brittleness": level})
            chart.curve(f"{name} = {level:g}", curve, 1e4 * strain, width=3 if level == 1 else 1.6)
            peak.append(curve.max())
            figure.series(**{f"stress_MPa_{key}_{level:g}": curve})
        charts.append(chart)
        peaks.append(peak)
    figure.panel("Parameters as multiples of their reference values.", *charts)
    lame = beam.YOUNG * beam.POISSON / ((1 + beam.POISSON) * (1 - 2 * beam.POISSON))
    onset = np.sqrt(2 * beam.THRESHOLD / (lame + beam.YOUNG / (1 + beam.POISSON)))
    figure.row("strain at which damage starts, reference values", "1e-4", "not given in figures", f"{1e4 * onset:.3f}",
               "Y = ½(λ + 2μ)ε² = Y₀: a closed form.", 1e4 * onset)
    figure.row("largest stress, Y₀ from 0.5 to 1.5", "MPa", "Y₀ sets where damage begins", f"{peaks[0][0]:.2f} to {peaks[0][-1]:.2f}",
               "Agrees. The curve leaves the elastic line at a strain that grows with √Y₀.", peaks[0][2])
    figure.row("largest stress, A_d from 0.5 to 1.5", "MPa", "A_d drives the post-peak behaviour",
               f"{peaks[1][0]:.2f} to {peaks[1][-1]:.2f}",
               "Agrees: the onset does not move, what follows does. The slope at onset is E (1 − 2 A_d Y₀): nearly zero at the reference, "
               "strongly negative at the brittle end, where each element's onset is a jump.", peaks[1][2])
    return figure


def modes_of(face, fields, name):
    """Modes as they move the face, horizontal component scaled to 1."""
    return [Map(f"{name} {k}", face, "horizontal component, largest 1", "1", signed=True,
                field=np.array(face.components(mode)) / np.abs(face.component(mode, 0)).max()) for k, mode in enumerate(fields, 1)]


def figures_6_7(subject):
    models, case = subject.beam, subject.beam.case
    with h5py.File(models.paper) as file:
        lift, space, temporal = file["lift"][:], file["modes/space"][:], file["modes/time"][:]
        parameters = [file["modes/parameters"][name][:] for name in ("Y0", "Ad")]
        nodes = [file["parameters"][name][:] for name in ("Y0", "Ad")]
        times = file["time"][:]
    figure = Figure("6-7", "The modes of the reduced model, m = 6",
                    f"{case.what.capitalize()}; {case.nodes ** 2} full-order runs on a {case.nodes} × {case.nodes} grid of (Y₀, A_d) in [0.5, 1.5]², "
                    f"{case.steps} load steps to {1e3 * case.displacement:g} mm, {space.shape[1]} dofs. The elastic solution is taken out "
                    "exactly and is mode 1 here; five canonical modes follow (alternating least squares on the snapshots in place of "
                    "the paper's LATIN-PGD, which finds modes of the same form one by one).")
    shape = lift[-1] / np.linalg.norm(lift[-1])
    space, temporal = np.vstack([shape, space]), np.vstack([lift @ shape, temporal])
    parameters = [np.vstack([np.ones(values.shape[1]), values]) for values in parameters]
    figure.panel("Fig. 6 of the paper: the space modes on the outer face, as they move it.",
                 *modes_of(beam.face_of(models.paper), space, "Space mode"))
    made = 1e6 * np.abs(temporal) * np.abs(space).max(1)[:, None]
    largest = made.max(1)
    over_time = Chart("Largest displacement that each mode makes", "time, fraction of the loading [–]", "displacement, logarithmic [µm]",
                      logarithmic=True)
    over = [Chart(f"Parameter modes over {name}", f"{name} over its reference [–]", "parameter mode, largest 1 [–]") for name in LABELS]
    for k in range(len(space)):
        over_time.curve(f"mode {k + 1}", [v if v > LEAST_SHOWN else None for v in made[k]], times)
        for chart, values, x in zip(over, parameters, nodes):
            chart.curve(f"mode {k + 1}", values[k] / np.abs(values[k]).max(), x, points=True)
    figure.panel("Fig. 7 of the paper: time modes, less than a thousandth of the noise left out, and parameter modes. Mode 1 is elastic: it "
                 "grows with the load and does not depend on the parameters.", over_time, *over)
    figure.series(largest_displacement_by_mode_um=largest)
    paper_error, three_error, best_error = (beam.error_of(path) for path in (models.paper, models.three, models.three_best))
    figure.row("parameter modes of mode 1", "1", "unit functions: elastic", "1 everywhere, exactly",
               "The elastic solution for the imposed displacement does not depend on the damage law.", 1)
    figure.row("largest displacement by mode 6 over that by mode 1", "1", "time modes get smaller and smaller",
               f"{largest[-1] / largest[0]:.3f} ({', '.join(readable(v, 2) for v in largest)} µm)",
               "Agrees in kind. Modes 2 to 6 fall slowly: a running crack is a travelling front, which separates badly.",
               largest[-1] / largest[0])
    figure.row("error of m = 6, relative, all dofs, steps and grid points", "1", "“accurate”", readable(paper_error[0], 2),
               "This norm is optimistic: most of u is elastic. The largest error on a dof is "
               f"{readable(1e6 * paper_error[1], 2)} µm, more than the whole effect of Y₀ on the data, and more than the noise.",
               paper_error[0])
    figure.row("error of m = 3, relative", "1", "“non-negligible truncation error” (§6.4)", readable(three_error[0], 2),
               f"Two modes beside the elastic one, found one after the other; at most {readable(1e6 * three_error[1], 2)} µm on a dof. "
               f"The best two: {readable(best_error[0], 2)}.", three_error[0])
    return figure


def figures_10_12(subject):
    with h5py.File(subject.model) as file:
        lengths, modes, coefficients = (file[f"crack/{name}"][:] for name in ("length", "modes", "coefficients"))
    figure = Figure("10-12", "Elastic beams with a crack, and their modes",
                    f"{len(lengths)} elastic solutions for a unit imposed displacement, with a vertical crack of 0 to 79 mm from the right "
                    "corner of the notch, on a mesh of their own with 1 mm elements along the crack; interpolated to the dofs of the "
                    "damage model, then a singular value decomposition (Eq. 32).")
    face = beam.face_of(subject.model)
    shown = [int(np.argmin(np.abs(lengths - length))) for length in (0.0, 0.025, 0.075)]
    figure.panel("Fig. 10 of the paper: horizontal displacement for three lengths of the crack.",
                 *(Map(f"Elastic beam, crack of {1e3 * lengths[i]:.0f} mm", face, "horizontal displacement per imposed one", "1", signed=True,
                       field=face.components(coefficients[i] @ modes)) for i in shown))
    figure.panel("Fig. 11 of the paper: the first six space modes of these beams.", *modes_of(face, modes[:6], "Mode of the crack"))
    charts = [Chart(f"Functions of the crack length, {which}", "crack length [mm]", "function times singular value [–]")
              for which in ("modes 1 and 2", "modes 3 to 6")]
    for k in range(6):
        charts[k > 1].curve(f"mode {k + 1}", coefficients[:, k], 1e3 * lengths, colour=k)
    figure.panel("Fig. 12 of the paper: the functions of the length, times their singular values; the small ones apart.", *charts)
    sigma = np.linalg.norm(coefficients, axis=0)  # the coefficients are sigma_k v_k with orthonormal v_k
    rest = np.sqrt(np.maximum(0, 1 - np.concatenate([[0], np.cumsum(sigma**2)]) / np.sum(sigma**2)))
    needed = [int(np.argmax(rest <= tolerance)) for tolerance in (1e-2, 1e-3)]
    last = np.sqrt(np.sum(coefficients[-1, 2:] ** 2) / np.sum(coefficients[-1] ** 2))
    figure.series(singular_values=sigma)
    figure.row("modes for an error of 1 % and of 0.1 %", "1", "“a few”", f"{needed[0]} and {needed[1]}",
               "Agrees: the lengths differ by how far the same two halves have turned.", needed[0])
    figure.row("third singular value over the first", "1", "rapidly decreasing", readable(sigma[2] / sigma[0], 2),
               "Agrees: the first two modes hold the beam broken in two and the whole one; the others open and close parts of the crack, "
               "as the paper's stitching patches.", sigma[2] / sigma[0])
    figure.row("error of two modes for the longest crack (79 mm), relative", "1",
               "the first two modes: the kinematics with a full-length crack", readable(last, 2),
               "Agrees: nearly all of the broken beam is in them.", last)
    return figure
