"""Fig. 5 to 7 and 10 to 12: the damage law, the modes of the reduced model, the elastic beams with a crack."""
import h5py
import numpy as np
from matplotlib import pyplot

import beam
from experiment import model_of
from record import COLOURS, Figure, readable

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
    drawn, both = pyplot.subplots(1, 2, figsize=(9, 3.4))
    peaks = []
    for axes, name, key in zip(both, ("Y₀", "A_d"), ("Y0", "Ad")):
        peak = []
        for level, colour in zip(LEVELS, COLOURS):
            curve = 1e-6 * stress(strain, **{"threshold" if key == "Y0" else "brittleness": level})
            axes.plot(1e4 * strain, curve, color=colour, linewidth=2.4 if level == 1 else 1.4, label=f"{name} = {level:g}")
            peak.append(curve.max())
            figure.series(**{f"stress_MPa_{key}_{level:g}": curve})
        axes.set(xlabel="strain (10⁻⁴)", ylabel="stress (MPa)", ylim=(0, None),
                 title=f"{name} varies, {'A_d' if key == 'Y0' else 'Y₀'} at its reference")
        axes.legend()
        peaks.append(peak)
    figure.panel(drawn, "Parameters as multiples of their reference values.")
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


def exaggerated(face, field):
    """The field as movement of the face's nodes, the largest 3 % of its length."""
    both = np.column_stack([face.component(field, 0), face.component(field, 1)])
    return 0.03 * np.ptp(face.points[:, 0]) / np.abs(both).max() * both


def fields_figure(face, fields, titles, label=None):
    """Horizontal components on the face, of modes scaled to 1; with a label as they are."""
    drawn, all_axes = pyplot.subplots(-(-len(fields) // 2), 2, figsize=(11, 2 * -(-len(fields) // 2)), squeeze=False)
    for axes, field, title in zip(all_axes.ravel(), fields, titles):
        shown = face.component(field, 0)
        if label is None:
            face.draw(axes, shown / np.abs(shown).max(), exaggerated(face, field), "largest = 1", "RdBu_r", (-1, 1))
        else:
            face.draw(axes, shown, exaggerated(face, field), label)
        axes.set_title(title)
    for axes in all_axes.ravel()[len(fields):]:
        axes.set_axis_off()
    return drawn


def figures_6_7(subject):
    models, case = subject.beam, subject.beam.case
    with h5py.File(models.paper) as file:
        lift, space, temporal = file["lift"][:], file["modes/space"][:], file["modes/time"][:]
        parameters = [file["modes/parameters"][name][:] for name in ("Y0", "Ad")]
        nodes = [file["parameters"][name][:] for name in ("Y0", "Ad")]
        times = file["time"][:]
    figure = Figure("6-7", "The modes of the reduced model, m = 6",
                    f"{case.what}; {case.nodes ** 2} full-order runs on a {case.nodes} × {case.nodes} grid of (Y₀, A_d) in [0.5, 1.5]², "
                    f"{case.steps} load steps to {1e3 * case.displacement:g} mm, {space.shape[1]} dofs. The elastic solution is taken out "
                    "exactly and is mode 1 here; five canonical modes follow (alternating least squares on the snapshots in place of "
                    "the paper's LATIN-PGD, which finds modes of the same form one by one).")
    shape = lift[-1] / np.linalg.norm(lift[-1])
    space, temporal = np.vstack([shape, space]), np.vstack([lift @ shape, temporal])
    parameters = [np.vstack([np.ones(values.shape[1]), values]) for values in parameters]
    face = beam.Face(models.paper)
    figure.panel(fields_figure(face, space, [f"mode {k + 1}" for k in range(len(space))]),
                 "Fig. 6: space modes on the outer face, horizontal component scaled to 1, deformed shape exaggerated.")
    largest = 1e6 * np.abs(temporal).max(1) * np.abs(space).max(1)
    drawn, three = pyplot.subplots(1, 3, figsize=(11, 3.4))
    for k, colour in zip(range(len(space)), COLOURS):
        sign = np.sign(temporal[k][np.argmax(np.abs(temporal[k]))])
        three[0].plot(times, 1e6 * sign * temporal[k] * np.abs(space[k]).max(), color=colour, label=f"mode {k + 1}")
        for axes, values, x in zip(three[1:], parameters, nodes):
            axes.plot(x, values[k] / np.abs(values[k]).max(), ".-", color=colour)
    three[0].set(xlabel="time (fraction of the loading)", ylabel="largest displacement (µm)", yscale="symlog")
    for axes, name in zip(three[1:], ("Y₀", "A_d")):
        axes.set(xlabel=f"{name} over its reference", ylabel="parameter mode, largest = 1")
    three[0].legend(ncols=2)
    figure.panel(drawn, "Fig. 7: time modes as the largest displacement that each makes (left), parameter modes (centre, right). Mode 1 "
                        "is elastic: it grows with the load and does not depend on the parameters.")
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
    face = beam.Face(subject.model)
    shown = [int(np.argmin(np.abs(lengths - length))) for length in (0.0, 0.025, 0.075)]
    figure.panel(fields_figure(face, [coefficients[i] @ modes for i in shown],
                               [f"crack of {1e3 * lengths[i]:.0f} mm" for i in shown], "u_x / imposed"),
                 "Fig. 10: horizontal displacement for three lengths.")
    figure.panel(fields_figure(face, modes[:6], [f"mode {k + 1}" for k in range(6)]),
                 "Fig. 11: the first six space modes, scaled to 1.")
    drawn, both = pyplot.subplots(1, 2, figsize=(9, 3.2))
    for k in range(6):
        both[0 if k < 2 else 1].plot(1e3 * lengths, coefficients[:, k], color=COLOURS[k], label=f"mode {k + 1}")
    for axes in both:
        axes.set(xlabel="crack length (mm)", ylabel="function times singular value")
        axes.legend()
    figure.panel(drawn, "Fig. 12: the functions of the length, times their singular values; the small ones apart.")
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
