"""Figures (matplotlib): each function draws into given axes, or a figure of its own, and returns the axes.

>>> import knothe.plot
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from knothe._errors import UsageError
from knothe._pictures import Correlation
from knothe._posterior import Posterior
from knothe._results import Results
from knothe._twin import StepResult, Twin

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
    axes.set_xlabel(name)


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
    """Each parameter against each other: draws below the diagonal, marginal densities on it.

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
                if names[j] in known and names[i] in known:
                    each.plot(known[names[j]], known[names[i]], "+", color=_TRUTH, markersize=10, markeredgewidth=2)
            each.set_xlabel(names[j] if i == d - 1 else "")
            each.set_ylabel(names[i] if j == 0 and i > 0 else "")
    for j in range(d):  # a column has one scale
        for i in range(j + 1, d):
            rows[i][j].set_xlim(rows[j][j].get_xlim())
            rows[i][j].set_ylim(rows[i][i].get_xlim())
    return [list(row) for row in rows]


def _records(steps: Any) -> tuple[list[str], Sequence[Mapping[str, Any]]]:
    """Names of the parameters, and the lines of the steps."""
    if isinstance(steps, Posterior):
        raise UsageError(f"{type(steps).__name__}: one posterior has no steps over time; give a Twin, Results or a list of StepResult")
    if isinstance(steps, Twin):
        if not steps.steps:
            raise UsageError("there are no steps to draw: the twin has no data yet")
        return steps.parameters, [steps.result(step).record for step in steps.steps]
    if isinstance(steps, Results):
        if "time" not in steps.steps[0]:
            raise UsageError(f"{steps.folder}: the results of an inference have no steps over time")
        return steps.parameters, steps.steps
    results = list(steps)
    if not results:
        raise UsageError("there are no steps to draw")
    return results[0].parameters, [result.record for result in results]


def _quantiles(records: Sequence[Mapping[str, Any]], parameters: list[str], what: str) -> tuple[Any, str]:
    """Quantiles of a parameter or a forecast, steps x levels, and their unit."""
    if what in parameters:
        k = parameters.index(what)
        return np.array([record["quantiles"]["values"][k] for record in records]), ""
    if all(what in record.get("forecast", {}) for record in records):
        return (np.array([record["forecast"][what]["values"] for record in records]),
                str(records[0]["forecast"][what].get("units", "")))
    names = parameters + list(records[0].get("forecast", {}))
    raise UsageError(f"\"{what}\" is neither a parameter nor a forecast of every step; there are {', '.join(names)}")


def fan(steps: Steps, what: str, *, truth: float | None = None, axes: "Axes | None" = None) -> "Axes":
    """Evolution of a parameter or forecast: median, 50 % and 95 % intervals over time.

    Parameters
    ----------
    steps : Twin, Results or sequence of StepResult
        In order of time.
    what : str
        Name of a parameter or of a forecast.
    truth : float, optional
        Drawn as a line, in the unit of `what`.
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
    parameters, records = _records(steps)
    values, units = _quantiles(records, parameters, what)
    time = [record["time"] for record in records]
    drawn = _figure(1, 1, 5.5, 3)[0][0] if axes is None else axes
    marker = "." if len(time) < 30 else None
    drawn.fill_between(time, values[:, 0], values[:, -1], color=_BLUE, alpha=0.18, linewidth=0, label="95 %")
    drawn.fill_between(time, values[:, 1], values[:, -2], color=_BLUE, alpha=0.35, linewidth=0, label="50 %")
    drawn.plot(time, values[:, values.shape[1] // 2], color=_BLUE, marker=marker, label="median")
    if truth is not None:
        drawn.axhline(truth, color=_TRUTH, linewidth=1, label="truth")
    drawn.set_xlabel("model time")
    drawn.set_ylabel(f"{what} [{units}]" if units else what)
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
    _, records = _records(steps)
    time = np.array([record["time"] for record in records])
    levels = [record["verdict"]["level"] for record in records]
    probability = np.maximum([record["verdict"]["fit_probability"] for record in records], 1e-12)
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
    drawn.set_xlabel("model time")
    drawn.set_ylabel("probability of such a misfit")
    drawn.legend(frameon=False, title="verdict")
    return drawn


def field(model: Any, values: Any, *, component: str = "y", plane: str = "xy", axes: "Axes | None" = None) -> "Axes":
    """One component of a displacement field at the dofs of a model, seen along an axis; or at the nodes of a correlation.

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
    if isinstance(model, Correlation):
        drawn = _figure(1, 1, 6, 3)[0][0] if axes is None else axes
        shown = drawn.scatter(model.x, model.y, c=np.asarray(values), cmap="viridis", s=18)
        drawn.figure.colorbar(shown, ax=drawn, label="displacement [px]")
        drawn.set_xlabel("x [px]")
        drawn.set_ylabel("y [px]")
        drawn.set_aspect("equal", adjustable="datalim")
        drawn.invert_yaxis()
        return drawn
    chosen = np.asarray(model.components) == "xyz".index(component)
    if not chosen.any():
        raise UsageError(f"the model has no displacements in direction {component}")
    across, up = ("xyz".index(letter) for letter in plane)
    drawn = _figure(1, 1, 6, 3)[0][0] if axes is None else axes
    points = model.points[chosen]
    shown = drawn.scatter(points[:, across], points[:, up], c=np.asarray(values)[chosen], cmap="viridis", s=18)
    drawn.figure.colorbar(shown, ax=drawn, label=f"displacement {component} [m]")
    drawn.set_xlabel(f"{plane[0]} [m]")
    drawn.set_ylabel(f"{plane[1]} [m]")
    drawn.set_aspect("equal", adjustable="datalim")
    return drawn
