"""The engine: data in, one by one and in any order; posterior, forecasts and verdict out."""
from __future__ import annotations

import copy
import json
import os
import pathlib
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from knothe import _knothe, _notebook
from knothe._errors import UsageError, warned
from knothe._models import Model, _at_points
from knothe._posterior import Decision, Forecast, Posterior, Verdict
from knothe._records import StepRecord
from knothe._results import groups_of
from knothe._values import (Array, OfNative, Prior, Seed, Sensors, counted, measured_values, noise_values, prior_values,
                            seed_of, step_of)

if TYPE_CHECKING:
    import xarray


class Datum(OfNative):
    """The measurements of all sensors at one time.

    Parameters
    ----------
    step : int
        Index of its time: in the recorded data of a project file, or in the model's times.
    values : array_like, shape (sensors,)
        In the units of the sensors, m for displacements; NaN where missing.
    std : float or array_like, optional
        Standard deviations of this datum's noise; by default those of the sensors.
    precision : Precision or matrix, optional
        Inverse covariance of this datum's noise.
    source, session : str
        Identify the source if several deliver data for one step.
    seq : int, optional
        Number of the datum at its source; the step by default.

    Examples
    --------
    >>> datum = knothe.Datum(3, [1.2e-3, np.nan], std=1e-5)
    >>> datum.step, datum.values
    (3, array([0.0012,    nan]))
    """

    def __init__(self, step: int, values: ArrayLike, std: ArrayLike | None = None, precision: Any = None,
                 source: str = "", session: str = "", seq: int | None = None) -> None:
        if not isinstance(step, (int, np.integer)) or step < 0:
            raise UsageError(f"step {step}: steps of data are integers ≥ 0")
        numbers = measured_values(values).ravel()
        deviations, rows = noise_values(std, precision, len(numbers))
        self._make(int(step), numbers, deviations, rows, source, session, step if seq is None else seq)

    def _make(self, *arguments: Any) -> None:
        self._arguments, self._native = copy.deepcopy(arguments), _knothe.Datum(*arguments)

    @classmethod
    def _of(cls, native: _knothe.Datum) -> "Datum":
        """Of recorded data."""
        datum = cls.__new__(cls)
        datum._native = native
        rows = native.precision()
        deviations = np.zeros(0) if rows is not None or native.std is None else native.std
        datum._arguments = (native.step, native.values, deviations, rows, native.source, native.session, native.seq)
        return datum

    def __reduce__(self) -> tuple[Any, ...]:
        return _datum_of, self._arguments

    @property
    def step(self) -> int:
        """Index of its time, from 0.

        Examples
        --------
        >>> knothe.Datum(3, [1.2e-3]).step
        3
        """
        return self._native.step

    @property
    def values(self) -> Array:
        """Measured values, shape (sensors,), in the units of the sensors (m for displacements); NaN where missing.

        Examples
        --------
        >>> knothe.Datum(3, [1.2e-3, np.nan]).values
        array([0.0012,    nan])
        """
        return self._native.values

    @property
    def std(self) -> Array | None:
        """Standard deviations of this datum's noise, shape (sensors,), in units of `values`; None where the sensors' apply.

        Examples
        --------
        >>> knothe.Datum(3, [1.2e-3], std=1e-5).std
        array([1.e-05])
        >>> knothe.Datum(3, [1.2e-3]).std is None
        True
        """
        return self._native.std

    def __repr__(self) -> str:
        return f"<Datum of step {self.step}: {counted(len(self.values), 'value')}>"


def _datum_of(*arguments: Any) -> Datum:
    datum = Datum.__new__(Datum)
    datum._make(*arguments)
    return datum


@dataclass(frozen=True)
class _PickledResult:
    """In place of the module's result, which is not pickled: what it says of the forecasts and the prior."""

    text: str
    values: dict[str, Any]

    def forecasts_json(self) -> str:
        return self.text

    def prior(self) -> dict[str, Any]:
        return self.values


class StepResult(OfNative, Posterior):
    """The result of a step: the posterior of all data up to it, a `Posterior` with further attributes.

    Attributes
    ----------
    record : dict
        The line of ``knothe assimilate --json``.
    step : int
    time : float
        Model time.
    time_units : str
        Of the model's time; empty where its solver states none.
    verdict : Verdict

    Examples
    --------
    >>> result.step, result.trusted, result.verdict.level
    (4, True, 'ok')
    """

    record: StepRecord

    def __init__(self, native: _knothe.Result, parameters: list[str]) -> None:
        super().__init__(json.loads(native.json()), parameters, native.points(), native.weights(), native.densities(),
                         native.labels())
        self._native = native
        self.step: int = self.record["step"]
        self.time: float = self.record["time"]
        self.time_units: str = native.time_units()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_native": _PickledResult(self._native.forecasts_json(), self._native.prior())}

    def _prior(self) -> dict[str, Any]:
        return self._native.prior()

    @property
    def verdict(self) -> Verdict:
        """Whether the answer may be used.

        Examples
        --------
        >>> result.verdict.level
        'ok'
        """
        return Verdict.of(self.record["verdict"])

    @property
    def decision(self) -> Decision | None:
        """What to do next; None if the project has no table ``[decide]``.

        Examples
        --------
        >>> result.decision is None
        True
        """
        return Decision(**self.record["decision"]) if "decision" in self.record else None

    @property
    def forecast(self) -> dict[str, Forecast]:
        """Forecasts by name, with their densities.

        Examples
        --------
        >>> result.forecast["tip"].horizon
        1.0
        """
        verdict = self.record.get("verdict")
        return {name: Forecast.of(record, verdict) for name, record in json.loads(self._native.forecasts_json()).items()}


def _toml(value: Any) -> str:
    """A value of a project file."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, np.generic):
        value = value.item()
    return json.dumps(value, ensure_ascii=False)


class Twin:
    """Watches a structure: data in, one by one and in any order; posterior, forecasts and verdict out.

    The posterior depends on the set of data alone: a datum that is withdrawn leaves no trace, to the bit.

    Parameters
    ----------
    project : path, optional
        A project file, as of ``knothe assimilate``; then `data` are its recorded data.
    method : str, optional
        In place of the project's ``method.kind``.
    model : path or Model
        Without a project: the reduced model.
    sensors : Sensors
        What is measured.
    std : float or array_like
        Standard deviation of the noise of each sensor, m; or
    precision : Precision or matrix
        its inverse covariance.
    parameters : mapping of name to Normal, Uniform or Lognormal
        A prior for each parameter of the model; their order is that of the results.
    forecasts : mapping of name to mapping
        The tables ``[forecast.NAME]`` of a project file.
    tolerance : float
        Tolerance on the variance diagnostic of maps.
    max_order : int
        Highest order of maps.
    seed : int or numpy.random.Generator
        Seed of the random numbers.

    Raises
    ------
    UsageError
        Inconsistent arguments.
    ProjectError
        The project file is missing or invalid.
    DataError
        A model or data file is missing or damaged, or does not match the sensors.

    Examples
    --------
    >>> model = knothe.Model.load("model.h5")
    >>> sensors = knothe.Sensors(model.points, "y")
    >>> twin = knothe.Twin(model=model, sensors=sensors, std=1e-5,
    ...                    parameters={"E": knothe.Normal(1, 0.3), "F": knothe.Normal(1, 0.3)})
    >>> noise = np.random.default_rng(1)
    >>> for step in range(len(model.times)):
    ...     measured = model([0.9, 1.1], step) + 1e-5 * noise.standard_normal(len(sensors))
    ...     result = twin.assimilate(knothe.Datum(step, measured))
    >>> bool(np.all(abs(result.mean - [0.9, 1.1]) < 3 * result.std))
    True
    """

    def __init__(self, project: "str | os.PathLike[str] | None" = None, *, method: str | None = None,
                 model: "str | os.PathLike[str] | Model | None" = None, sensors: Sensors | None = None,
                 std: ArrayLike | None = None, precision: Any = None,
                 parameters: Mapping[str, Prior] | None = None, forecasts: Mapping[str, Mapping[str, Any]] | None = None,
                 tolerance: float = 1e-3, max_order: int = 8, seed: Seed = 1) -> None:
        values = (model, sensors, std, precision, parameters, forecasts)
        if project is not None:
            if any(value is not None for value in values):
                raise UsageError("Twin: a project file says everything; leave out model, sensors, noise, parameters and forecasts")
            self._native = _knothe.Twin.of_project(os.fspath(project), method or "")
            self._made_by: tuple[Any, ...] = ("of_project", os.path.abspath(project), method or "")
        else:
            if model is None or sensors is None or not parameters or method is not None:
                raise UsageError("Twin: give a project file, or model, sensors, std or precision, and parameters")
            path = model.path if isinstance(model, Model) else os.fspath(model)
            deviations, rows = noise_values(std, precision, len(sensors))
            text = "".join(f"[forecast.{json.dumps(name)}]\n" + "".join(f"{key} = {_toml(value)}\n" for key, value in table.items())
                           for name, table in (forecasts or {}).items())
            arguments = (copy.deepcopy(sensors.points), list(sensors.components), list(sensors.series), copy.deepcopy(deviations),
                         copy.deepcopy(rows), prior_values(parameters), tolerance, max_order, seed_of(seed), text)
            self._native = _knothe.Twin.of_values(path, *arguments)
            self._made_by = ("of_values", os.path.abspath(path), *arguments)
        self._describe()

    def _describe(self) -> None:
        self.parameters: list[str] = self._native.parameters()
        self.times: Array = self._native.times()
        self._given: dict[tuple[int, str, str, int], Datum] = {}  # what is assimilated, in the order of arrival
        self._read = 0  # of the recorded data

    def __reduce__(self) -> tuple[Any, ...]:
        return _twin_of, (self._made_by, list(self._given.values()), self._read)

    def _result(self, native: _knothe.Result | None) -> StepResult:
        if native is None:
            raise UsageError("no datum has been assimilated yet")
        result = StepResult(native, self.parameters)
        if not native.warned:
            native.warned = True
            warned(result)
        return result

    def _assimilate(self, datum: Datum) -> _knothe.Result:
        found = self._native.assimilate(datum._native)
        self._given[datum.step, datum._native.source, datum._native.session, datum._native.seq] = datum
        return found

    @property
    def data(self) -> Iterator[Datum]:
        """The recorded data of the project file that are still to come, one by one; pictures are correlated meanwhile.

        An iterator: each datum comes once. ``list(twin.data)`` keeps them.

        Examples
        --------
        >>> [datum.step for datum in knothe.Twin("project.toml").data]
        [0, 1, 2, 3, 4]
        """
        while (native := self._native.next()) is not None:
            self._read += 1
            yield Datum._of(native)

    def assimilate(self, datum: Datum) -> StepResult:
        """Adds a datum.

        Parameters
        ----------
        datum : Datum
            In any order of steps.

        Returns
        -------
        StepResult
            The posterior of all data up to the step of `datum`.

        Raises
        ------
        UsageError
            The datum has the wrong size or time, or is there already; nothing has changed then.

        Examples
        --------
        >>> project = knothe.Twin("project.toml")
        >>> project.assimilate(next(project.data)).step
        0
        """
        if not isinstance(datum, Datum):
            raise UsageError(f"assimilate takes a Datum, not {type(datum).__name__}: knothe.Datum(step, values)")
        return self._result(self._assimilate(datum))

    def withdraw(self, step: int, source: str = "", session: str = "", seq: int | None = None) -> None:
        """Withdraws a datum: everything is then, to the bit, as if it had never been assimilated.

        Parameters
        ----------
        step : int
            Step of the datum; negative ones count from the end.
        source, session : str
            As of the `Datum`.
        seq : int, optional
            Likewise; the step by default.

        Raises
        ------
        UsageError
            There is no such datum.

        Examples
        --------
        >>> project = knothe.Twin("project.toml")
        >>> for datum in project.data:
        ...     last = project.assimilate(datum)
        >>> project.withdraw(3)
        >>> project.steps
        [0, 1, 2, 4]
        """
        step = step_of(step, len(self.times))
        number = step if seq is None else seq
        self._native.withdraw(step, source, session, number)
        del self._given[step, source, session, number]

    def result(self, step: int) -> StepResult:
        """The posterior of all data up to a step.

        Parameters
        ----------
        step : int
            Negative ones count from the end.

        Returns
        -------
        StepResult

        Raises
        ------
        UsageError
            The step has no data.

        Examples
        --------
        >>> twin.result(0).std[0] > twin.result(4).std[0]
        True
        """
        return self._result(self._native.result(step_of(step, len(self.times))))

    @property
    def steps(self) -> list[int]:
        """Steps with data, in order.

        Examples
        --------
        >>> twin.steps
        [0, 1, 2, 3, 4]
        """
        return self._native.steps()

    @property
    def last(self) -> StepResult:
        """The posterior of all data. `UsageError` before the first.

        Examples
        --------
        >>> twin.last.step
        4
        """
        return self._result(self._native.last())

    @property
    def posterior(self) -> "xarray.Dataset":
        """1,000 draws from the posterior of all data, dims (chain, draw), a variable for each parameter, in its unit.

        Examples
        --------
        >>> dict(twin.posterior.sizes)
        {'chain': 4, 'draw': 250}
        """
        return self.last.to_xarray()["posterior"]

    @property
    def forecast(self) -> dict[str, Forecast]:
        """Forecasts from all data, by name.

        Examples
        --------
        >>> twin.forecast["tip"].units
        'm'
        """
        return self.last.forecast

    @property
    def verdict(self) -> Verdict:
        """Whether the answer may be used, as in the last line of ``knothe assimilate``, for the whole run.

        Examples
        --------
        >>> twin.verdict.level
        'ok'
        """
        if not self.steps:
            raise UsageError("no datum has been assimilated yet")
        return Verdict.of(json.loads(self._native.run_verdict()))

    def predict(self, at: ArrayLike | Mapping[str, float], step: int) -> Array:
        """The noise-free values of the sensors.

        Parameters
        ----------
        at, step : as of `ObservedModel`

        Returns
        -------
        ndarray, shape (sensors,) or (n, sensors)
            m for displacements, else the unit of the series.

        Raises
        ------
        UsageError
            A point outside the model's box, or a step that the model does not have.

        Examples
        --------
        >>> twin.predict(twin.last.mean, step=4).shape
        (5,)
        """
        index = step_of(step, len(self.times))
        return _at_points(lambda points: self._native.predict(points, index, False)[0], at, self.parameters)

    def to_xarray(self, draws: int = 1000) -> "dict[str, xarray.Dataset]":
        """One Dataset for each of ArviZ's groups, as ``knothe assimilate`` writes them.

        Parameters
        ----------
        draws : int
            Number of draws from the posterior and from the prior, in four chains.

        Returns
        -------
        dict of str to xarray.Dataset
            ``posterior`` (chain, draw) of the last step with data; ``posterior_predictive`` and ``log_likelihood`` (chain,
            draw, step, observation) of the data of all steps under these draws, or fewer of them with many sensors;
            ``prior``, ``prior_predictive``, ``observed_data`` (step, observation); ``history`` (step) of the posteriors
            before; ``forecast`` (step, forecast). The measured values are `displacement`, m; scalar series have their own names.

        Raises
        ------
        UsageError
            No datum has been assimilated yet.

        Examples
        --------
        >>> groups = twin.to_xarray()
        >>> groups["observed_data"]["displacement"].dims, groups["forecast"]["mean"].shape
        (('step', 'observation'), (5, 1))
        """
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "posterior.nc"
            self._native.write_posterior(str(file), -(-draws // 4))
            groups = groups_of(file)
            loaded = {name: group.load() for name, group in groups.items()}
            for group in groups.values():
                group.close()
        return loaded

    def __repr__(self) -> str:
        names = f"parameter{'' if len(self.parameters) == 1 else 's'} {', '.join(self.parameters)}"
        return f"<Twin: {names}; data at {len(self.steps)} of {counted(len(self.times), 'step')}>"

    def _repr_html_(self) -> str:
        title = _notebook.table(f"Twin: data at {len(self.steps)} of {counted(len(self.times), 'step')}", (), ())
        return title + (self.last._repr_html_() if self.steps else "")


def _twin_of(made_by: tuple[Any, ...], data: list[Datum], read: int) -> Twin:
    """A twin made again, from files that are read again, with these data and behind so many of the recorded ones."""
    twin = Twin.__new__(Twin)
    way, *arguments = made_by
    twin._made_by, twin._native = made_by, getattr(_knothe.Twin, way)(*arguments)
    twin._describe()
    for _ in range(read):
        next(twin.data)
    for datum in data:
        twin._assimilate(datum)
    return twin
