"""Reduced models."""
from __future__ import annotations

import copy
import inspect
import json
import math
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from knothe import _knothe, _notebook
from knothe._errors import UsageError
from knothe._values import Array, Axis, OfNative, Sensors, counted, numbers, points_of, require_progress, step_of


def _in_order(at: ArrayLike | Mapping[str, float], parameters: Sequence[str]) -> ArrayLike:
    """Numbers in the order of the parameters, of what has names: a mapping, or a Series or DataFrame of pandas."""
    names: Any = getattr(at, "columns", getattr(at, "index", None)) if hasattr(at, "iloc") else None
    if names is not None and all(isinstance(name, str) for name in names):
        names = list(names)
    elif isinstance(at, Mapping):
        names = list(at)
    else:
        return at
    if set(names) != set(parameters):
        raise UsageError(f"parameters {', '.join(names)}: the model has {', '.join(parameters)}")
    if hasattr(at, "columns"):
        return np.column_stack([numbers(at[name], f"parameter {name}") for name in parameters])  # type: ignore[index,call-overload]
    return [float(at[name]) for name in parameters]  # type: ignore[index,call-overload]


def _at_points(call: Callable[[Array], Array], at: ArrayLike | Mapping[str, float], parameters: Sequence[str]) -> Array:
    """What `call` gives of points n x d; of one alone (d numbers, or a number by name) without the first index."""
    at = _in_order(at, parameters)
    values = call(points_of(at, len(parameters), "parameters"))
    return values[0] if np.ndim(at) == 1 else values


class ObservedModel(OfNative):
    """A reduced model seen through sensors; from `Model.observe`.

    Examples
    --------
    >>> seen = knothe.Model.load("model.h5").observe([[0.4, 0.0, 0.0]], "y")
    >>> seen([1.0, 1.0], step=4).shape, seen.jacobian([1.0, 1.0], step=4).shape
    ((1,), (1, 2))
    """

    def __init__(self, model: Model, sensors: Sensors) -> None:
        self._native = model._native.observe(sensors.points, sensors.components, sensors.series)
        self._model, self._sensors, self.parameters = model, copy.deepcopy(sensors), model.parameters
        self._steps = self._native.steps()

    def __reduce__(self) -> tuple[Any, ...]:
        return ObservedModel, (self._model, self._sensors)

    def __call__(self, at: ArrayLike | Mapping[str, float], step: int) -> Array:
        """The noise-free values of the sensors.

        Parameters
        ----------
        at : array_like, shape (d,) or (n, d), or mapping
            Parameters, inside the model's box.
        step : int
            Time step; negative ones count from the end.

        Returns
        -------
        ndarray, shape (sensors,) or (n, sensors), m

        Raises
        ------
        UsageError
            A point outside the model's box, or a step that the model does not have.

        Examples
        --------
        >>> seen = knothe.Model.load("model.h5").observe([[1.0, 0.0, 0.0]], "y")
        >>> seen({"E": 1.0, "F": 1.0}, step=-1).round(7)
        array([0.002])
        """
        index = step_of(step, self._steps)
        return _at_points(lambda points: self._native.predict(points, index, False)[0], at, self.parameters)

    def jacobian(self, at: ArrayLike | Mapping[str, float], step: int) -> Array:
        """Exact derivatives of the sensors' values with respect to the parameters.

        Parameters
        ----------
        at, step : as of the call

        Returns
        -------
        ndarray, shape (sensors, d) or (n, sensors, d)
            In the sensor's unit (m for displacements) per unit of the parameter.

        Examples
        --------
        >>> seen = knothe.Model.load("model.h5").observe([[0.4, 0.0, 0.0]], "y")
        >>> seen.jacobian([[1.0, 1.0], [1.0, 1.2]], step=4).shape
        (2, 1, 2)
        """
        index = step_of(step, self._steps)
        return _at_points(lambda points: self._native.predict(points, index, True)[1], at, self.parameters)


class Model(OfNative):
    """A reduced model: a field of parameters and time, from the file of `knothe offline`, `knothe model import` or `offline`.

    Attributes
    ----------
    path : str
        The file.
    parameters : list of str
        Names, in the order of points.
    times : ndarray, shape (steps,)
        Model times: s, or what takes the place of time.
    points, components : ndarray, shapes (dofs, 3) and (dofs,)
        Place (m) and direction of each dof; empty if the field is not a displacement.

    Examples
    --------
    >>> model = knothe.Model.load("model.h5")
    >>> model.parameters, model([1.0, 1.2], step=4).shape
    (['E', 'F'], (5,))
    >>> model({"E": 1.0, "F": 1.2}, step=4, dofs=[4]).round(9)
    array([0.0022])
    """

    def __init__(self, native: _knothe.Model, path: str) -> None:
        self._native, self.path, self._file = native, path, os.path.abspath(path)
        self.parameters: list[str] = native.parameters()
        self.times: Array = native.times()
        self.points, self.components = native.dofs()

    def __reduce__(self) -> tuple[Any, ...]:
        return Model.load, (self._file,)

    @classmethod
    def load(cls, path: "str | os.PathLike[str]") -> "Model":
        """Reads a model's file.

        Parameters
        ----------
        path : path

        Returns
        -------
        Model

        Raises
        ------
        DataError
            Names what is missing or damaged in the file.

        Examples
        --------
        >>> knothe.Model.load("model.h5")
        <Model model.h5: parameters E, F, 5 steps>
        """
        return cls(_knothe.Model.load(os.fspath(path)), os.fspath(path))

    def __call__(self, at: ArrayLike | Mapping[str, float], step: int, dofs: Sequence[int] | None = None) -> Array:
        """The field at parameters and a time step.

        Parameters
        ----------
        at : array_like, shape (d,) or (n, d), or mapping
            Parameters, inside the model's box.
        step : int
            Time step; negative ones count from the end.
        dofs : sequence of int, optional
            Indices of the dofs; all by default.

        Returns
        -------
        ndarray, shape (dofs,) or (n, dofs)
            In the field's unit, m for displacements.

        Raises
        ------
        UsageError
            A point outside the model's box, or a step or dof that the model does not have.

        Examples
        --------
        >>> knothe.Model.load("model.h5")([1.0, 1.0], step=-1, dofs=[4]).round(7)
        array([0.002])
        """
        index, chosen = step_of(step, len(self.times)), self._dofs(dofs)
        return _at_points(lambda points: self._native.evaluate(points, index, chosen, False)[0], at, self.parameters)

    @staticmethod
    def _dofs(dofs: Sequence[int] | None) -> list[int]:
        """As the module wants them: none stands for all."""
        if dofs is not None and len(dofs) == 0:
            raise UsageError("dofs: none is named; leave it out for all")
        if dofs is not None and min(dofs) < 0:
            raise UsageError(f"dofs: {min(dofs)}: they count from 0")
        return [] if dofs is None else [int(dof) for dof in dofs]

    def jacobian(self, at: ArrayLike | Mapping[str, float], step: int, dofs: Sequence[int] | None = None) -> Array:
        """Exact derivatives of the field with respect to the parameters.

        Parameters
        ----------
        at : array_like, shape (d,) or (n, d), or mapping
            Parameters, inside the model's box.
        step : int
            Time step; negative ones count from the end.
        dofs : sequence of int, optional
            Indices of the dofs; all by default.

        Returns
        -------
        ndarray, shape (dofs, d) or (n, dofs, d)
            In the field's unit per unit of the parameter.

        Examples
        --------
        >>> knothe.Model.load("model.h5").jacobian([1.0, 1.0], step=4, dofs=[0, 4]).shape
        (2, 2)
        """
        index, chosen = step_of(step, len(self.times)), self._dofs(dofs)
        return _at_points(lambda points: self._native.evaluate(points, index, chosen, True)[1], at, self.parameters)

    def output(self, name: str, at: ArrayLike | Mapping[str, float]) -> Array:
        """A further output (reaction force ...) at all time steps.

        Parameters
        ----------
        name : str
            One of ``info["outputs"]``.
        at : array_like, shape (d,) or (n, d), or mapping
            Parameters, inside the model's box.

        Returns
        -------
        ndarray, shape (steps,) or (n, steps)
            In the output's unit, ``info["output_units"][name]``.

        Raises
        ------
        UsageError
            The model has no such output, or a point is outside its box.

        Examples
        --------
        >>> nodes, t = np.linspace(0.5, 1.5, 5), np.array([1.0, 2.0])
        >>> spring = knothe.offline(lambda k: (t[:, np.newaxis] / k, {"force": t}), {"k": nodes}, t, "spring.h5",
        ...                         points=[[0, 0, 0]], outputs={"force": "N"})
        >>> spring.output("force", [1.0]).round(6)
        array([1., 2.])
        """
        return _at_points(lambda points: self._native.evaluate_output(name, points, False)[0], at, self.parameters)

    def observe(self, points: ArrayLike | Sensors, components: str | int | Sequence[str | int] = "y") -> ObservedModel:
        """The model at arbitrary points, interpolated by the elements' shape functions.

        Parameters
        ----------
        points : array_like, shape (n, 3), m, or Sensors
        components : as of `Sensors`

        Returns
        -------
        ObservedModel

        Raises
        ------
        DataError
            A point that is neither at a dof nor in the model's mesh.
        UsageError
            The model has no series of that name.

        Examples
        --------
        >>> seen = knothe.Model.load("model.h5").observe([[0.4, 0.0, 0.0], [1.0, 0.0, 0.0]], "y")
        >>> seen([1.0, 1.0], step=4).round(7)
        array([0.00104, 0.002  ])
        """
        sensors = points if isinstance(points, Sensors) else Sensors(points, components)
        return ObservedModel(self, sensors)

    @property
    def info(self) -> dict[str, Any]:
        """What ``knothe model info --json`` prints: axes, units, outputs and errors of the model.

        Examples
        --------
        >>> [axis["name"] for axis in knothe.Model.load("model.h5").info["parameters"]]
        ['E', 'F']
        """
        return json.loads(self._native.info_json())

    def __repr__(self) -> str:
        names = f"parameter{'' if len(self.parameters) == 1 else 's'} {', '.join(self.parameters)}"
        return f"<Model {self.path}: {names}, {counted(len(self.times), 'step')}>"

    def _repr_html_(self) -> str:
        info = self.info
        rows = [(axis["name"], f"{axis['lower']:.4g} … {axis['upper']:.4g}", axis["long_name"] or axis["units"])
                for axis in info["parameters"]]
        size = f"{counted(len(self.times), 'step')}, {counted(len(self.components), 'dof')}"
        return _notebook.table(f"Model {self.path}: {size}", ("parameter", "range", "what"), rows)

    def _mesh(self) -> tuple[Array, Any, str] | None:
        """Nodes n x 3, cells m x k and their type in VTK's words; nothing if the file has no mesh."""
        found = self._native.mesh()
        return None if found is None else (found[0], found[1], found[2].removeprefix("VTK_"))


def _solutions(function: Callable[..., Any], axes: Mapping[str, Array], time: Array, outputs: Sequence[str],
               progress: Callable[[int, int], object] | None) -> tuple[Array, dict[str, Array]]:
    """The function at all grid points, [n_1, ..., n_d, n_t, n_dof], and its further outputs, [n_1, ..., n_d, n_t]."""
    shape = tuple(len(nodes) for nodes in axes.values())
    total = math.prod(shape)
    values: Array | None = None
    further = {name: np.empty((*shape, len(time))) for name in outputs}
    for done, index in enumerate(np.ndindex(*shape), 1):
        point = [float(nodes[i]) for nodes, i in zip(axes.values(), index)]
        found = function(*point)
        if outputs and not (isinstance(found, tuple) and len(found) == 2 and isinstance(found[1], Mapping)):
            raise UsageError(f"offline: at {tuple(point)} the function gave no outputs; it has to return the solution and a mapping "
                             f"with {', '.join(outputs)}")
        if not outputs and isinstance(found, tuple):
            raise UsageError("offline: the function gave a tuple; name its further outputs, outputs={name: unit}")
        solution = numbers(found[0] if outputs else found, "the model's solution")
        if solution.ndim != 2 or len(solution) != len(time):
            raise UsageError(f"offline: at {tuple(point)} the function gave an array of shape {solution.shape}; it has to be "
                             f"[{counted(len(time), 'time')}, dofs]")
        if values is None:
            values = np.empty(shape + solution.shape)
        if solution.shape != values.shape[len(shape):]:
            raise UsageError(f"offline: at {tuple(point)} the function gave {counted(solution.shape[1], 'dof')}, "
                             f"elsewhere {values.shape[-1]}")
        if not np.isfinite(solution).all():
            raise UsageError(f"offline: at {tuple(point)} the function gave a value that is not finite, at time "
                             f"{time[np.argwhere(~np.isfinite(solution))[0][0]]:g}")
        values[index] = solution
        for name, series in further.items():
            if np.shape(found[1].get(name)) != (len(time),):
                raise UsageError(f"offline: at {tuple(point)} the output {name} has to be one number for each time, {len(time)} "
                                 "in all")
            series[index] = numbers(found[1][name], f"the output {name}")
        if progress is not None:
            progress(done, total)
    assert values is not None
    return values, further


def _check_order(function: Callable[..., Any], names: Sequence[str]) -> None:
    """Arguments go by position: those of the same names have to be in the same order."""
    try:
        arguments = [name for name, p in inspect.signature(function).parameters.items() if p.default is p.empty]
    except (TypeError, ValueError):  # a compiled function
        return
    if arguments != list(names) and sorted(arguments) == sorted(names):
        raise UsageError(f"offline: the function takes {', '.join(arguments)}, in this order, and the parameters are {', '.join(names)}: "
                         "give them in the function's order")


def offline(function: Callable[..., Any], parameters: Mapping[str, ArrayLike | Axis], time: ArrayLike,
            output: "str | os.PathLike[str]", *, points: ArrayLike | None = None,
            components: str | int | Sequence[str | int] = "y", quantities: Mapping[str, str] | None = None,
            outputs: Mapping[str, str] | None = None, units: str = "m", time_units: str = "", form: str = "tree", modes: int = 0,
            tolerance: float | None = None, snapshots: "str | os.PathLike[str] | None" = None,
            progress: Callable[[int, int], object] | None = None) -> Model:
    """Makes a reduced model of your own solver: solutions on a grid of parameters, separated.

    The same as ``knothe model import``: the solutions are written to a file of snapshots, from which the model is made.

    Parameters
    ----------
    function : callable
        ``function(p_1, ..., p_d)``: the solution at these parameters, shape (times, dofs); with `outputs` that and a mapping of
        each of their names to its values, shape (times,).
    parameters : mapping of name to array_like or Axis
        Nodes of the grid, strictly increasing, in the order of the function's arguments; the model is defined between the first and
        the last. An `Axis` has units too.
    time : array_like, shape (times,)
        Model times, strictly increasing: in s, or a variable that takes the place of time, such as the fraction of the load. The
        model keeps them as they are; data, horizons and forecasts refer to them.
    output : path
        The model's file (HDF5).
    points : array_like, shape (dofs, 3), optional
        Where each dof is, m; for displacements.
    components : as of `Sensors`
        Direction of each dof.
    quantities : mapping of name to unit, optional
        Names and units of the dofs, in place of points. Values in known units (mm, kN, MPa, ...) are converted to SI.
    outputs : mapping of name to unit, optional
        Further results of the solver, one value per time: a reaction force ... Known units are converted to SI too.
    units : str
        Of the field. A displacement in km, cm, mm, um or nm is converted to m.
    time_units : str
        Of `time`, as figures and texts say it: ``"s"``; times in ``"min"`` and the like are converted to s. Empty: none.
    form : {"tree", "canonical"}
        Tree: space modes times functions of all parameters; canonical: products of functions of one parameter each.
    modes : int
        0: as many as the tolerance needs.
    tolerance : float, optional
        Relative error on the grid.
    snapshots : path, optional
        Where to keep the solutions; by default they are not kept.
    progress : callable, optional
        ``progress(done, total)`` after each solution: how many are made, of how many. An exception ends the call.

    Returns
    -------
    Model
        As from `Model.load` of `output`.

    Raises
    ------
    UsageError
        Inconsistent arguments, or the function returns an array of the wrong shape or with a value that is not finite.
    DataError
        Times or nodes that do not increase, or an axis of one node.
    NumericalError
        The canonical form does not reach the tolerance.
    IoError
        A file cannot be written.

    Examples
    --------
    A bar of unit length under its load `F`, of stiffness `E`, at five places and five times:

    >>> x, t = np.linspace(0.2, 1.0, 5), np.linspace(0.2, 1.0, 5)
    >>> def bar(E, F):
    ...     return 1e-3 * np.outer(t, x * (2 - x)) / E + 1e-3 * F * np.outer(t**2, x)
    >>> nodes = np.linspace(0.5, 1.5, 9)
    >>> model = knothe.offline(bar, {"E": nodes, "F": nodes}, t, "model.h5", points=np.c_[x, 0 * x, 0 * x])
    >>> bool(np.allclose(model([0.9, 1.1], step=4), bar(0.9, 1.1)[4], atol=3e-7))
    True

    With the force of the load, 200 N at F = 1 in the end:

    >>> model = knothe.offline(lambda E, F: (bar(E, F), {"load": 200 * F * t}), {"E": nodes, "F": nodes}, t, "loaded.h5",
    ...                        points=np.c_[x, 0 * x, 0 * x], outputs={"load": "N"})
    >>> model.output("load", [0.9, 1.1]).round(3)
    array([ 44.,  88., 132., 176., 220.])

    Showing how many solutions are made:

    >>> model = knothe.offline(lambda E: bar(E, 1.0), {"E": [0.5, 1.0, 1.5]}, t, "shown.h5", points=np.c_[x, 0 * x, 0 * x],
    ...                        progress=lambda done, total: print(done, "of", total))
    1 of 3
    2 of 3
    3 of 3
    """
    require_progress(progress)
    if not isinstance(parameters, Mapping):
        raise UsageError("offline: give the parameters as a mapping, {name: nodes of its grid}")
    if points is not None and quantities is not None:
        raise UsageError("offline: points and quantities exclude each other: a dof is a displacement at a point, or has a name")
    if points is None and quantities is None:
        raise UsageError("offline: give points (the places of the displacements) or quantities ({name: unit})")
    labelled = [(nodes if isinstance(nodes, Axis) else Axis(nodes))._labels(name) for name, nodes in parameters.items()]
    axes = {name: np.array(nodes) for name, nodes, *_ in labelled}
    times = numbers(time, "times")
    _check_order(function, list(axes))
    values, further = _solutions(function, axes, times, list(outputs or ()), progress)
    places = Sensors(np.zeros((0, 3)) if points is None else points, [] if points is None else components)
    parts = {"axes": labelled, "time": list(times), "time_units": time_units, "values": values,
             "units": units, "long_name": "displacement" if points is not None else "field", "points": places.points,
             "components": places.components, "quantities": list((quantities or {}).items()),
             "outputs": [(name, unit, further[name]) for name, unit in (outputs or {}).items()]}
    with tempfile.TemporaryDirectory(prefix="knothe-") as folder:
        file = os.path.join(folder, "snapshots.h5") if snapshots is None else os.fspath(snapshots)
        _knothe.write_snapshots(parts, file)
        _knothe.import_model(file, os.fspath(output), form, modes, tolerance or 0.0)
    return Model.load(output)
