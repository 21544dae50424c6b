"""Figures (matplotlib): each function draws into given axes, or a figure of its own, and returns the axes.

>>> import knothe.plot
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from knothe._errors import UsageError
from knothe._pictures import Correlation
from knothe._posterior import Posterior
from knothe._results import Results
from knothe._models import Model
from knothe._notebook import pretty_units, readable_units
from knothe._twin import StepResult, Twin
from knothe._values import Array
from knothe.calibration import Calibration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BLUE, _GREY, _TRUTH = "#1f5fa8", "#8a8a8a", "#c2410c"
_LEVEL_COLOURS = {"ok": "#2e8b57", "caution": "#e0a100", "reject": "#c0392b"}

Steps = Union[Twin, Results, Iterable[StepResult]]


def _figure(rows: int, columns: int, width: float, height: float) -> Any:
    import matplotlib.pyplot as pyplot

    return pyplot.subplots(rows, columns, figsize=(width, height), squeeze=False, layout="constrained")[1]


def _truths(posterior: Posterior, truth: Mapping[str, float] | None) -> dict[str, float]:
    unknown = set(truth or {}) - set(posterior.parameters)
    if unknown:
        raise UsageError(f"truth: {', '.join(sorted(unknown))}: there are {', '.join(posterior.parameters)}")
    return dict(truth or {})


def _draw_marginal(axes: "Axes", posterior: Posterior, k: int, truth: Mapping[str, float]) -> None:
    """Posterior and prior densities of one parameter."""
    points, density = posterior.marginal(k)
    axes.fill_between(points, density, color=_BLUE, alpha=0.25, linewidth=0)
    axes.plot(points, density, color=_BLUE, label="posterior")
    if posterior.densities and len(posterior.densities[k][2]):
        axes.plot(*posterior.densities[k][2:], color=_GREY, linestyle="--", label="prior")
    name = posterior.parameters[k]
    if name in truth:
        axes.axvline(truth[name], color=_TRUTH, linewidth=1, label="truth")
    axes.set_ylim(0, 1.1 * density.max())
    seen = points[density > 1e-4 * density.max()]
    spread = seen[-1] - seen[0]
    axes.set_xlim(max(points[0], seen[0] - 0.3 * spread), min(points[-1], seen[-1] + 0.3 * spread))
    axes.set_xlabel(_parameter_label(name, posterior._labels.get(name, {})))


def _posterior(given: Any) -> Posterior:
    if isinstance(given, Results):
        return given.posterior
    if isinstance(given, Posterior):
        return given
    raise UsageError(f"{type(given).__name__}: give a StepResult, an InferenceResult, a Fit or Results")


def marginals(posterior: "Posterior | Results", *, truth: Mapping[str, float] | None = None, axes: "Sequence[Axes] | None" = None
              ) -> "list[Axes]":
    """The marginal density of each parameter, beside its prior.

    Parameters
    ----------
    posterior : StepResult, InferenceResult, Fit or Results
        Of Results the last step.
    truth : mapping of parameter to value, optional
        Drawn as lines, in units of the parameters.
    axes : sequence of d Axes, optional
        A figure of its own by default.

    Returns
    -------
    list of matplotlib.axes.Axes
        One for each parameter.

    Raises
    ------
    UsageError
        `truth` names a parameter that is not there.

    Examples
    --------
    >>> axes = knothe.plot.marginals(result, truth={"E": 0.9, "F": 1.1})
    >>> [a.get_xlabel() for a in axes]
    ['E', 'F']
    """
    posterior = _posterior(posterior)
    known = _truths(posterior, truth)
    d = len(posterior.parameters)
    drawn = list(_figure(1, d, 2.8 * d + 1.2, 2.4)[0]) if axes is None else list(axes)
    for k, each in enumerate(drawn[:d]):
        _draw_marginal(each, posterior, k, known)
    drawn[0].set_ylabel("density")
    drawn[d - 1].legend(bbox_to_anchor=(1.02, 1), loc="upper left", borderaxespad=0, frameon=False)
    return drawn


def pair(posterior: "Posterior | Results", *, truth: Mapping[str, float] | None = None, draws: int = 700) -> "list[list[Axes]]":
    """Each parameter against each other: draws and the regions of 50 % and 95 % below the diagonal, marginal densities on it.

    Parameters
    ----------
    posterior : StepResult, InferenceResult, Fit or Results
        Of Results the last step.
    truth : mapping of parameter to value, optional
        Drawn as crosses and lines, in units of the parameters.
    draws : int
        How many are shown.

    Returns
    -------
    list of list of matplotlib.axes.Axes
        d x d; those above the diagonal are off.

    Raises
    ------
    UsageError
        `truth` names a parameter that is not there.

    Examples
    --------
    >>> rows = knothe.plot.pair(result)
    >>> rows[1][0].get_xlabel(), rows[1][0].get_ylabel()
    ('E', 'F')
    """
    posterior = _posterior(posterior)
    known = _truths(posterior, truth)
    names, d = posterior.parameters, len(posterior.parameters)
    labels = [_parameter_label(name, posterior._labels.get(name, {})) for name in names]
    shown = posterior.draws(draws)
    rows = _figure(d, d, 2.4 * d + 0.6, 2.4 * d + 0.4)
    for i in range(d):
        for j in range(d):
            each = rows[i][j]
            if j > i:
                each.set_axis_off()
                continue
            if i == j:
                _draw_marginal(each, posterior, i, known)
                each.set_yticks([])
            else:
                each.plot(shown[:, j], shown[:, i], ".", color=_BLUE, markersize=3, alpha=0.35, markeredgewidth=0)
                each.plot([], [], ".", color=_BLUE, label="draws")
                _draw_regions(each, shown[:, j], shown[:, i])
                if names[j] in known and names[i] in known:
                    each.plot(known[names[j]], known[names[i]], "+", color=_TRUTH, markersize=10, markeredgewidth=2, label="truth")
            each.set_xlabel(labels[j] if i == d - 1 else "")
            each.set_ylabel(labels[i] if j == 0 and i > 0 else "")
    for j in range(d):  # a column has one scale
        for i in range(j + 1, d):
            rows[i][j].set_xlim(rows[j][j].get_xlim())
            rows[i][j].set_ylim(rows[i][i].get_xlim())
    if d > 1:
        meanings = {label: handle for each in (rows[0][0], rows[1][0]) for handle, label in zip(*each.get_legend_handles_labels())}
        rows[0][d - 1].legend(list(meanings.values()), list(meanings), loc="center", frameon=False)
    return [list(row) for row in rows]


def _draw_regions(axes: "Axes", x: Array, y: Array) -> None:
    """Smallest regions that hold 50 % and 95 % of the draws, by a kernel density."""
    if min(np.ptp(x), np.ptp(y)) <= 0:
        return
    draws = np.stack([x, y])
    root = np.linalg.inv(np.linalg.cholesky(np.cov(draws) * len(x) ** (-1 / 3)))  # Scott's rule, d = 2

    def density(points: Array) -> Array:
        far = root @ points
        near = root @ draws
        return np.exp(-0.5 * ((far[:, :, np.newaxis] - near[:, np.newaxis, :]) ** 2).sum(axis=0)).sum(axis=1)

    levels = np.quantile(density(draws), [0.05, 0.5])
    margin = 0.15
    grid = np.meshgrid(*(np.linspace(v.min() - margin * np.ptp(v), v.max() + margin * np.ptp(v), 50) for v in (x, y)))
    values = density(np.stack([g.ravel() for g in grid])).reshape(grid[0].shape)
    axes.contour(*grid, values, levels=levels, colors="black", linewidths=[0.8, 1.2], linestyles=["--", "-"])
    axes.plot([], [], color="black", linewidth=1.2, label="50 %")
    axes.plot([], [], color="black", linewidth=0.8, linestyle="--", label="95 %")


@dataclass(frozen=True)
class _Steps:
    """What is drawn over time: the lines of the steps; attributes of each parameter, by name."""

    records: Sequence[Mapping[str, Any]]
    parameters: Mapping[str, Mapping[str, Any]]
    time_units: str

    @property
    def time(self) -> list[float]:
        return [record["time"] for record in self.records]

    def label_time(self, axes: "Axes") -> None:
        axes.set_xlabel(_axis_label("model time", self.time_units))


def _steps(steps: Any) -> _Steps:
    if isinstance(steps, Posterior):
        raise UsageError(f"{type(steps).__name__}: one posterior has no steps over time; give a Twin, Results or a list of StepResult")
    if isinstance(steps, Twin):
        if not steps.steps:
            raise UsageError("there are no steps to draw: the twin has no data yet")
        return _steps(steps.result(step) for step in steps.steps)
    if isinstance(steps, Results):
        if "time" not in steps.steps[0]:
            raise UsageError(f"{steps.folder}: the results of an inference have no steps over time")
        described = {entry["name"]: {**entry, "reference_units": entry.get("units", "")} for entry in steps.summary["parameters"]}
        return _Steps(steps.steps, described, steps.summary.get("time_units", ""))
    results = list(steps)
    if not results:
        raise UsageError("there are no steps to draw")
    described = {name: results[0]._labels.get(name, {}) for name in results[0].parameters}
    return _Steps([result.record for result in results], described, results[0].time_units)


def _quantiles(records: Sequence[Mapping[str, Any]], parameters: list[str], what: str) -> tuple[Any, str]:
    """Quantiles of a parameter or a forecast, steps x levels, and the unit of a forecast."""
    if what in parameters:
        k = parameters.index(what)
        return np.array([record["quantiles"]["values"][k] for record in records]), ""
    if all(what in record.get("forecast", {}) for record in records):
        return (np.array([record["forecast"][what]["values"] for record in records]),
                str(records[0]["forecast"][what].get("units", "")))
    names = parameters + list(records[0].get("forecast", {}))
    raise UsageError(f"\"{what}\" is neither a parameter nor a forecast of every step; there are {', '.join(names)}")


def _draw_limits(axes: "Axes", forecast: Mapping[str, Any], scale: float = 1) -> None:
    """Threshold and horizon of a forecast."""
    if forecast.get("threshold") is not None:
        axes.axhline(scale * forecast["threshold"], color="black", linestyle="--", linewidth=1, label="threshold")
    axes.axvline(forecast["horizon"], color="#2e8b57", linestyle=":", linewidth=1, label="horizon")


def fan(steps: Steps, what: str, *, truth: float | None = None, axes: "Axes | None" = None) -> "Axes":
    """Evolution of a parameter or forecast: median, 50 % and 95 % intervals over time, a forecast's threshold and horizon.

    Parameters
    ----------
    steps : Twin, Results or sequence of StepResult
        In order of time.
    what : str
        Name of a parameter or of a forecast.
    truth : float, optional
        Drawn as a line; of a forecast in SI units, which the axis writes as mm, µm or kN where that reads better.
    axes : Axes, optional
        A figure of its own by default.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    UsageError
        `what` is neither a parameter nor a forecast, or there are no steps.

    Examples
    --------
    >>> knothe.plot.fan(twin, "E", truth=0.9).get_ylabel()
    'E'
    """
    of = _steps(steps)
    values, units = _quantiles(of.records, list(of.parameters), what)
    scale, units = readable_units(float(np.abs(values).max()), units)
    values, time = scale * values, of.time
    drawn = _figure(1, 1, 5.5, 3)[0][0] if axes is None else axes
    marker = "." if len(time) < 30 else None
    drawn.fill_between(time, values[:, 0], values[:, -1], color=_BLUE, alpha=0.18, linewidth=0, label="95 %")
    drawn.fill_between(time, values[:, 1], values[:, -2], color=_BLUE, alpha=0.35, linewidth=0, label="50 %")
    drawn.plot(time, values[:, values.shape[1] // 2], color=_BLUE, marker=marker, label="median")
    if truth is not None:
        drawn.axhline(scale * truth, color=_TRUTH, linewidth=1, label="truth")
    if what not in of.parameters:
        _draw_limits(drawn, of.records[-1]["forecast"][what], scale)
    of.label_time(drawn)
    drawn.set_ylabel(_parameter_label(what, of.parameters[what]) if what in of.parameters else _axis_label(what, units))
    drawn.legend(frameon=False)
    return drawn


def verdict(steps: Steps, *, axes: "Axes | None" = None) -> "Axes":
    """The verdict of each step, and the probability of a misfit as large as that of the data so far.

    Parameters
    ----------
    steps : Twin, Results or sequence of StepResult
        In order of time.
    axes : Axes, optional
        A figure of its own by default.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    UsageError
        There are no steps.

    Examples
    --------
    >>> knothe.plot.verdict(twin).get_ylabel()
    'probability of such a misfit'
    """
    of = _steps(steps)
    time = np.array(of.time)
    levels = [record["verdict"]["level"] for record in of.records]
    probability = np.maximum([record["verdict"]["fit_probability"] for record in of.records], 1e-12)
    drawn = _figure(1, 1, 5.5, 3)[0][0] if axes is None else axes
    middle = 0.5 * (time[1:] + time[:-1])
    edges = np.concatenate([time[:1], middle, time[-1:]])
    for level, colour in _LEVEL_COLOURS.items():
        for i in [i for i, each in enumerate(levels) if each == level]:
            drawn.axvspan(edges[i], edges[i + 1], color=colour, alpha=0.25, linewidth=0)
        if level in levels:
            drawn.fill_between([], [], [], color=colour, alpha=0.4, label=level)
    drawn.plot(time, probability, color="black", marker="." if len(time) < 30 else None)
    drawn.set_yscale("log")
    drawn.set_ylim(min(1e-3, 0.5 * probability.min()), 1.5)
    of.label_time(drawn)
    drawn.set_ylabel("probability of such a misfit")
    drawn.legend(frameon=False, title="verdict")
    return drawn


def field(model: Any, values: Any, *, component: str = "y", plane: str = "xy", axes: "Axes | None" = None) -> "Axes":
    """One component of a displacement field on the mesh of a model, seen along an axis (at its dofs without a mesh); or of a correlation.

    Parameters
    ----------
    model : Model or Correlation
        Where the values are.
    values : array_like, shape (dofs,) or (nodes,)
        As ``model(at, step)`` gives it, m; or one component of `Displacements`, px.
    component : {"x", "y", "z"}
        Of a model.
    plane : str
        Two of the axes: where the dofs of a model are drawn.
    axes : Axes, optional
        A figure of its own by default.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    UsageError
        The model has no displacements in that direction.

    Examples
    --------
    >>> model = knothe.Model.load("model.h5")
    >>> knothe.plot.field(model, model([1.0, 1.0], step=4)).get_xlabel()
    'x [m]'
    >>> knothe.plot.field(correlation, moved.u).get_xlabel()
    'x [px]'
    """
    given = np.asarray(values)
    drawn = _figure(1, 1, 6, 3)[0][0] if axes is None else axes
    if isinstance(model, Correlation):
        _draw_cells(drawn, np.c_[model.x, model.y], model.elements, given, "displacement [px]")
        drawn.set_xlabel("x [px]")
        drawn.set_ylabel("y [px]")
        drawn.set_aspect("equal", adjustable="datalim")
        drawn.invert_yaxis()
        return drawn
    chosen = np.asarray(model.components) == "xyz".index(component)
    if not chosen.any():
        raise UsageError(f"the model has no displacements in direction {component}")
    across, up = ("xyz".index(letter) for letter in plane)
    factor, unit = readable_units(float(np.max(abs(given[chosen]))), "m")
    label = f"displacement {component} [{unit}]"
    points, shown = model.points[chosen], factor * given[chosen]
    found = _seen_cells(model, points, 3 - across - up)
    if found is None:
        drawn.figure.colorbar(drawn.scatter(points[:, across], points[:, up], c=shown, cmap="viridis", s=18), ax=drawn, label=label)
    else:
        nodes, cells, of_dof = found
        _draw_cells(drawn, nodes[:, [across, up]], cells, shown[of_dof], label)
    drawn.set_xlabel(f"{plane[0]} [m]")
    drawn.set_ylabel(f"{plane[1]} [m]")
    drawn.set_aspect("equal", adjustable="datalim")
    return drawn


_HEXAHEDRON = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


def _seen_cells(model: Any, points: Array, along: int) -> tuple[Array, Any, Any] | None:
    """What is seen along an axis: nodes, cells of 3 or 4, and the dof at each node; nothing where there is no mesh of known cells.

    Of hexahedra the outermost plane."""
    mesh = model._mesh() if isinstance(model, Model) else None
    if mesh is None:
        return None
    nodes, cells, kind = mesh
    if kind == "HEXAHEDRON":
        faces = cells[:, np.array(_HEXAHEDRON)].reshape(-1, 4)
        outermost = nodes[:, along].max()
        cells = faces[np.all(abs(nodes[faces, along] - outermost) < 1e-9 + 1e-6 * np.ptp(nodes), axis=1)]
    elif kind not in ("TRIANGLE", "QUAD"):
        return None
    at = {tuple(np.round(point, 9)): i for i, point in enumerate(points)}
    of_dof = {node: at.get(tuple(np.round(nodes[node], 9))) for node in np.unique(cells)}
    if not len(cells) or None in of_dof.values():
        return None
    number = {node: i for i, node in enumerate(of_dof)}
    return nodes[list(of_dof)], np.vectorize(number.get)(cells), np.array(list(of_dof.values()))


def _draw_cells(axes: "Axes", nodes: Array, cells: Any, values: Array, label: str) -> None:
    """Coloured between the nodes (triangles and quadrilaterals; -1 as a triangle's fourth node), with the edges of the elements."""
    from matplotlib.collections import PolyCollection

    cells = np.asarray(cells)
    triangles = cells[:, :3]
    if cells.shape[1] == 4:
        triangles = np.concatenate([triangles, cells[cells[:, 3] >= 0][:, [0, 2, 3]]])
    known = np.isfinite(values)
    hidden = ~known[triangles].all(axis=1)
    shown = axes.tripcolor(nodes[:, 0], nodes[:, 1], triangles, np.where(known, values, 0.0), shading="gouraud", cmap="viridis",
                           mask=hidden, vmin=np.min(values[known], initial=np.inf) if known.any() else 0,
                           vmax=np.max(values[known], initial=-np.inf) if known.any() else 1)
    edges = [nodes[cell[cell >= 0]] for cell in cells]
    axes.add_collection(PolyCollection(edges, facecolors="none", edgecolors="#00000040", linewidths=0.4))
    axes.figure.colorbar(shown, ax=axes, label=label)


def load_displacement(results: "Results | Posterior", model: Model, *, output: str = "reaction_force",
                      over: str = "imposed_displacement", draws: int = 200, axes: "Axes | None" = None) -> "Axes":
    """A force, or any output, over what is imposed: measured, the posterior's band, and the forecast behind the last datum.

    Parameters
    ----------
    results : Results, StepResult, InferenceResult or Fit
        Of Results the last step; they have the measured values, and the forecasts' thresholds and horizons, too.
    model : Model
        The reduced model of the results.
    output, over : str
        Outputs of the model, in their units; without `over` in the model, over time.
    draws : int
        Number of draws from which the band (95 %) is made.
    axes : Axes, optional
        A figure of its own by default.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    UsageError
        The model has no such output.

    Examples
    --------
    >>> t = np.array([1.0, 2.0])
    >>> spring = knothe.offline(lambda k: (t[:, np.newaxis] / k, {"force": t * k}), {"k": np.linspace(0.5, 1.5, 5)}, t, "spring.h5",
    ...                         points=[[0, 0, 0]], outputs={"force": "N"})
    >>> watch = knothe.Twin(model=spring, sensors=knothe.Sensors([[0, 0, 0]], "y"), std=0.1, parameters={"k": knothe.Normal(1, 0.2)})
    >>> found = watch.assimilate(knothe.Datum(0, [1.1]))
    >>> knothe.plot.load_displacement(found, spring, output="force").get_ylabel()
    'force [N]'
    """
    known = model.info
    if output not in known["outputs"]:
        raise UsageError(f"the model has no output \"{output}\"; there are {', '.join(known['outputs'])}")
    posterior = _posterior(results)
    order = [posterior.parameters.index(name) for name in model.parameters]
    forces = model.output(output, posterior.draws(draws)[:, order])
    steps = len(model.times)
    imposed = model.output(over, posterior.mean[order]) if over in known["outputs"] else model.times
    across, across_unit = readable_units(float(np.max(abs(imposed))), known["output_units"].get(over, "") if over in known["outputs"]
                                         else known.get("time_units", ""))
    up, up_unit = readable_units(float(np.max(abs(forces))), known["output_units"][output])
    x = across * imposed
    low, middle, high = up * np.quantile(forces, [0.025, 0.5, 0.975], axis=0)
    last = int(np.searchsorted(model.times, posterior.record.get("time", model.times[-1]) * (1 - 1e-9)))
    drawn = _figure(1, 1, 5.5, 3.2)[0][0] if axes is None else axes
    drawn.fill_between(x, low, high, color=_BLUE, alpha=0.2, linewidth=0, label="95 %")
    drawn.plot(x[:last + 1], middle[:last + 1], color=_BLUE, label="median")
    if last + 1 < steps:
        drawn.plot(x[last:], middle[last:], color=_BLUE, linestyle="--", label="forecast")
        drawn.axvline(x[last], color=_GREY, linewidth=1, linestyle=":", label="last datum")
    if isinstance(results, Results):
        _draw_measured(drawn, results, output, model.times, x, up)
    drawn.set_xlabel(_axis_label(over.replace("_", " ") if over in known["outputs"] else "model time", across_unit))
    drawn.set_ylabel(_axis_label(output.replace("_", " "), up_unit))
    drawn.legend(frameon=False)
    return drawn


def _axis_label(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _parameter_label(name: str, known: Mapping[str, Any]) -> str:
    """``k1 [N/m]``; of a multiple of a reference ``Y0 (1 = 216 J/m³)``."""
    unit, reference = pretty_units(str(known.get("reference_units", ""))), float(known.get("reference", 1))
    return f"{name} (1 = {reference:.4g} {unit})" if unit and reference != 1 else _axis_label(name, unit)


def _draw_measured(axes: "Axes", results: Results, output: str, times: Array, x: Array, scale: float) -> None:
    """What was measured of an output, and the limits of its forecasts."""
    series = (results.summary.get("residuals") or {}).get("series", {}).get(output)
    if series:
        time_of = {record["step"]: record["time"] for record in results.steps}
        at = np.interp([time_of[step] for step in series["step"]], times, x)
        axes.plot(at, scale * np.array(series["measured"]), ".", color="black", markersize=4, label="measured")
    for forecast in results.summary.get("forecasts", {}).values():
        if forecast.get("output") == output:
            _draw_limits(axes, {**forecast, "horizon": np.interp(forecast["horizon"], times, x)}, scale)


def residuals(results: "Results | Twin", *, axes: "Sequence[Axes] | None" = None) -> "list[Axes]":
    """Measured minus predicted, in standard deviations of the prediction with its noise: over time, and beside a normal's quantiles.

    Where only noise is left, 95 % lie within ±2 and the quantiles on the line.

    Parameters
    ----------
    results : Results or Twin
        Of the last step's posterior.
    axes : sequence of two Axes, optional
        A figure of its own by default.

    Returns
    -------
    list of matplotlib.axes.Axes

    Raises
    ------
    UsageError
        There are no data.

    Examples
    --------
    >>> [a.get_ylabel() for a in knothe.plot.residuals(twin)]
    ['standardised residual [σ]', 'quantile of the residuals [σ]']
    """
    groups = results.to_xarray()
    if "observed_data" not in groups or "posterior_predictive" not in groups:
        raise UsageError("there are no measured values to compare with")
    time, found = [], []
    for name, measured in groups["observed_data"].data_vars.items():
        if name not in groups["posterior_predictive"]:
            continue
        predicted = groups["posterior_predictive"][name]
        values = ((measured - predicted.mean(("chain", "draw"))) / predicted.std(("chain", "draw"))).transpose("step", ...).values
        found.append(values.reshape(len(values), -1))
        time.append(np.repeat(np.arange(len(values)), found[-1].shape[1]))
    x, y = np.concatenate(time), np.concatenate([values.ravel() for values in found])
    x, y = x[np.isfinite(y)], y[np.isfinite(y)]
    drawn = list(_figure(1, 2, 8, 3)[0]) if axes is None else list(axes)
    drawn[0].plot(x, y, ".", color=_BLUE, markersize=3, alpha=0.5)
    for limit in (-2, 2):
        drawn[0].axhline(limit, color=_GREY, linestyle="--", linewidth=1, label="95 % within ±2" if limit > 0 else None)
    drawn[0].set_xlabel("step with data")
    drawn[0].set_ylabel("standardised residual [σ]")
    drawn[0].legend(frameon=False)
    normal = [NormalDist().inv_cdf((i + 0.5) / len(y)) for i in range(len(y))]
    drawn[1].plot(normal, np.sort(y), ".", color=_BLUE, markersize=3)
    drawn[1].axline((0, 0), slope=1, color=_GREY, linestyle="--", linewidth=1, label="standard normal")
    drawn[1].set_xlabel("quantile of a standard normal")
    drawn[1].set_ylabel("quantile of the residuals [σ]")
    drawn[1].legend(frameon=False)
    return drawn


def calibration(found: Calibration, *, axes: "Sequence[Axes] | None" = None) -> "list[Axes]":
    """Residuals of a calibration where they are in the picture: an arrow for each corner, all pictures over each other.

    Arrows that point all ways are noise. Those that agree in a part of the picture show a lens that is not described, long ones (red, left out)
    a corner that was found wrong.

    Parameters
    ----------
    found : knothe.calibration.Calibration
    axes : sequence of Axes, one for each camera, optional
        A figure of its own by default.

    Returns
    -------
    list of matplotlib.axes.Axes

    Examples
    --------
    >>> [a.get_title() for a in knothe.plot.calibration(rig)]
    ['camera 0: ± 0.051 px, arrows × 760', 'camera 1: ± 0.05 px, arrows × 780']
    """
    drawn = list(_figure(1, len(found.cameras), 5 * len(found.cameras), 3.4)[0]) if axes is None else list(axes)
    for c, (each, camera, noise) in enumerate(zip(drawn, found.cameras, found.noise)):
        width, height = camera.size
        larger = float(f"{0.02 * max(width, height) / noise:.1e}")  # a standard deviation is a fiftieth of the picture
        for pose, off, used in zip(found.poses, found.residuals[c], found.used[c]):
            place = camera.project(found.points @ pose[:3, :3].T + pose[:3, 3])
            for chosen, colour in ((used, _BLUE), (np.isfinite(off[:, 0]) & ~used, _TRUTH)):
                if chosen.any():
                    each.quiver(*place[chosen].T, *off[chosen].T, angles="xy", scale_units="xy", scale=1 / larger, color=colour, width=0.002)
        each.set_title(f"camera {c}: ± {noise:.2g} px, arrows × {larger:.0f}", fontsize="medium")
        each.set_xlim(0, width)
        each.set_ylim(height, 0)
        each.set_aspect("equal")
        each.set_xlabel("x [px]")
    drawn[0].set_ylabel("y [px]")
    return drawn
