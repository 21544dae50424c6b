"""States as well as parameters: filters for models that step, smoothing, forecasts, and a verdict from the innovations.

>>> import knothe.states

A `StepModel` (or `LinearModel`, `oscillator`, `bouc_wen`, `lugre`, `fmu`) says how the state goes on and what is measured of it;
`estimate` gives the state at each time, and with priors of the model's parameters also these, by `knothe.infer` on the evidence of a filter.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from knothe import _notebook
from knothe._errors import UsageError, warned
from knothe._filters import Ensemble, Filter, Gaussian, MapEnsemble, Particles, of_mixture, quantiles_of_mixture, smooth
from knothe._fmu import fmu
from knothe._inference import InferenceResult, infer
from knothe._innovations import verdict_of
from knothe._map_update import Localisation, MapUpdate
from knothe._oscillators import bouc_wen, lugre, oscillator
from knothe._posterior import Verdict
from knothe._step_models import LinearModel, Points, StepModel, inputs_of, with_unknown_input
from knothe._values import Array, Prior, Seed, count_of, counted, log_prior, measured_values, numbers, seed_of

_LEVELS = np.array([0.025, 0.05, 0.25, 0.5, 0.75, 0.95, 0.975])
_GAUSSIAN = ("kalman", "extended", "unscented")
_METHODS = (*_GAUSSIAN, "ensemble", "particle", "map")
_OPTIONS = {"members": ("ensemble", "particle", "map"), "inflation": ("ensemble", "map"), "localisation": ("ensemble", "map"),
            "order": ("map",), "jitter": ("particle",)}  # and who uses them
_MEMBERS = {"ensemble": 200, "particle": 2000, "map": 500}


@dataclass(frozen=True, eq=False)
class StateForecast:
    """States and data after the last datum; or states at the times of all data, smoothed.

    Attributes
    ----------
    times : ndarray, shape (T,)
    mean, std : ndarray, shape (T, d)
        Of the state.
    covariance : ndarray, shape (T, d, d)
    lower, upper : ndarray, shape (T, d)
        The interval that holds the state with the probability asked for.
    data_mean, data_std : ndarray, shape (T, m)
        Of what would be measured, with its noise; empty where states are smoothed.

    Examples
    --------
    >>> model = knothe.states.oscillator(1.0, 0.4, 9.0, dt=0.1, noise=0.01, force_noise=0.1)
    >>> found = knothe.states.estimate(model, model.simulate(50)[1])
    >>> ahead = found.forecast(20)
    >>> ahead.mean.shape, ahead.data_mean.shape
    ((20, 2), (20, 1))
    """

    times: Array
    mean: Array
    covariance: Array
    lower: Array
    upper: Array
    data_mean: Array
    data_std: Array

    @property
    def std(self) -> Array:
        """Standard deviations of the states, shape (T, d).

        Examples
        --------
        >>> model = knothe.states.oscillator(1.0, 0.4, 9.0, dt=0.1, noise=0.01, force_noise=0.1)
        >>> knothe.states.estimate(model, model.simulate(50)[1]).smooth().std.shape
        (50, 2)
        """
        return _deviations(self.covariance)


class StateEstimate:
    """The result of `estimate`: the state at the time of each datum, given the data up to it.

    Attributes
    ----------
    method : str
    states : list of str
        Names.
    times : ndarray, shape (T,)
    mean, std : ndarray, shape (T, d)
    covariance : ndarray, shape (T, d, d)
    innovations : ndarray, shape (T, m)
        Data less what was forecast of them; NaN where a value is missing.
    innovation_covariance : ndarray, shape (T, m, m)
        As forecast, with the noise of the data; NaN there too.
    log_evidence : float
        Natural logarithm of p(data); with unknown parameters that of all, these integrated out.
    log_evidence_increments : ndarray, shape (T,)
        log p(datum | data before); with unknown parameters at their posterior.
    parameters : InferenceResult or None
        Posterior of the parameters.
    members, weights : ndarray, shapes (n, d) and (n,)
        The last ensemble; empty for Gaussian methods.
    verdict : Verdict
        Whether the innovations are what the model forecasts: of their size (code ``fit``), and independent from time to time (``model``);
        and whether the computation is good enough (``computation``).
    trusted : bool
        False where the computation is not accurate; `remark` says why.
    remark : str

    Examples
    --------
    >>> model = knothe.states.oscillator(1.0, 0.4, 9.0, dt=0.1, noise=0.01, force_noise=0.1)
    >>> found = knothe.states.estimate(model, model.simulate(100)[1])
    >>> found
    <StateEstimate by kalman, 100 times, states x, v. Result: usable>
    """

    def __init__(self, model: StepModel, method: str, times: Array, inputs: Array, run: "_Run", parameters: "InferenceResult | None") -> None:
        self.method, self.states, self.times = method, list(model.states), times
        self.mean, self.covariance = np.array(run.means), np.array(run.covariances)
        self.innovations, self.innovation_covariance = np.array(run.innovations), np.array(run.innovation_covariances)
        increments = np.array(run.increments)
        self.parameters = parameters
        self._run, self._model, self._last_input = run, model, inputs[-1]
        belief = run.belief
        weights = belief.weights if isinstance(belief, Gaussian) else np.ones(1)
        self.log_evidence_increments = np.log(np.maximum(np.exp(increments - increments.max(1, keepdims=True)) @ weights, 1e-300)) + increments.max(1)
        self.log_evidence = float(increments.sum()) if parameters is None else parameters.log_evidence
        self.members = belief.members if isinstance(belief, Ensemble) else np.zeros((0, model.dimension))
        self.weights = belief.weights if isinstance(belief, Ensemble) else np.zeros(0)
        self.verdict: Verdict = verdict_of(self.innovations, self.innovation_covariance, belief, parameters)
        doubts = [reason.message for reason in self.verdict.reasons if reason.code == "computation"]
        self.trusted, self.remark = not doubts, "; ".join(doubts)

    @property
    def std(self) -> Array:
        """Standard deviations of the states, shape (T, d).

        Examples
        --------
        >>> model = knothe.states.oscillator(1.0, 0.4, 9.0, dt=0.1, noise=0.01, force_noise=0.1)
        >>> knothe.states.estimate(model, model.simulate(50)[1]).std.shape
        (50, 2)
        """
        return _deviations(self.covariance)

    def interval(self, probability: float = 0.9) -> tuple[Array, Array]:
        """The interval that holds each state with this probability, as much below it as above.

        Parameters
        ----------
        probability : float
            0.5, 0.9 or 0.95.

        Returns
        -------
        lower, upper : ndarray, shape (T, d)

        Raises
        ------
        UsageError
            Another probability.

        Examples
        --------
        >>> model = knothe.states.oscillator(1.0, 0.4, 9.0, dt=0.1, noise=0.01, force_noise=0.1)
        >>> truth, data = model.simulate(50)
        >>> lower, upper = knothe.states.estimate(model, data).interval(0.9)
        >>> bool(np.mean((lower < truth) & (truth < upper)) > 0.7)
        True
        """
        low, high = _ends(probability)
        return tuple(np.array([values[k] for values in self._run.quantiles]) for k in (low, high))  # type: ignore[return-value]

    def smooth(self, probability: float = 0.9) -> StateForecast:
        """The states given all data (Rauch, Tung and Striebel 1965), also those of an extended or unscented filter.

        Parameters
        ----------
        probability : float
            Of `lower` to `upper`.

        Returns
        -------
        StateForecast
            Without data.

        Raises
        ------
        UsageError
            The method was an ensemble's.

        Examples
        --------
        >>> model = knothe.states.oscillator(1.0, 0.4, 9.0, dt=0.1, noise=0.01, force_noise=0.1)
        >>> found = knothe.states.estimate(model, model.simulate(50)[1])
        >>> bool(np.all(found.smooth().std <= found.std + 1e-12))
        True
        """
        belief = self._run.belief
        if not isinstance(belief, Gaussian):
            raise UsageError(f"smooth: method {self.method!r} has no smoother: use one of {', '.join(_GAUSSIAN)}")
        assert belief.steps is not None
        means, covariances = smooth(belief.steps, belief.mean, belief.covariance)
        levels = np.array([0.5 - 0.5 * probability, 0.5 + 0.5 * probability])
        mixed = [of_mixture(belief.weights, *pair) for pair in zip(means, covariances)]
        ends = np.array([quantiles_of_mixture(belief.weights, m, _deviations(c), levels) for m, c in zip(means, covariances)])
        nothing = np.zeros((len(means), 0))
        return StateForecast(self.times, np.array([m for m, _ in mixed]), np.array([c for _, c in mixed]), ends[:, 0], ends[:, 1], nothing, nothing)

    def forecast(self, steps: int, *, inputs: "ArrayLike | None" = None, probability: float = 0.9) -> StateForecast:
        """States and data after the last datum.

        Parameters
        ----------
        steps : int
            How many steps of the model's `dt`.
        inputs : array_like, shape (steps, k), optional
            At the times that are forecast. From the last datum to the first of them its own input is held.
        probability : float
            Of `lower` to `upper`: 0.5, 0.9 or 0.95.

        Returns
        -------
        StateForecast

        Examples
        --------
        >>> model = knothe.states.oscillator(1.0, 0.4, 9.0, dt=0.1, noise=0.01, force_noise=0.1)
        >>> ahead = knothe.states.estimate(model, model.simulate(50)[1]).forecast(200)
        >>> bool(ahead.std[-1, 0] > ahead.std[0, 0])  # of the process noise, no longer of the first state
        True
        """
        count = count_of(steps, "steps of a forecast")
        low, high = _ends(probability)
        given, belief, model = inputs_of(inputs, count, self._model.inputs), self._run.belief.forked(), self._model
        held, t, width = np.vstack([self._last_input[None], given]), float(self.times[-1]), self.innovations.shape[1]
        times, moments, quantiles, data = [], [], [], []
        for k in range(count):
            belief.predict(held[k], t, model.dt)
            t = float(self.times[-1]) + (k + 1) * model.dt
            times.append(t)
            moments.append(belief.moments())
            quantiles.append(belief.quantiles(_LEVELS[[low, high]]))
            data.append(belief.data_moments(given[k], t, width))
        d = model.dimension
        ends = np.array(quantiles).reshape(count, 2, d)
        return StateForecast(np.array(times), np.array([m for m, _ in moments]).reshape(count, d),
                             np.array([c for _, c in moments]).reshape(count, d, d), ends[:, 0], ends[:, 1],
                             np.array([m for m, _ in data]).reshape(count, width),
                             _deviations(np.array([c for _, c in data]).reshape(count, width, width)))

    def __repr__(self) -> str:
        found = f" and parameters {', '.join(self.parameters.parameters)}" if self.parameters is not None else ""
        return (f"<StateEstimate by {self.method}, {counted(len(self.times), 'time')}, states {', '.join(self.states)}{found}. "
                f"{_notebook.WORDS[self.verdict.level]}>")

    def _repr_html_(self) -> str:
        level = self.verdict.level
        rows = [(name, _notebook.quantity(mean, std, "", level)) for name, mean, std in zip(self.states, self.mean[-1], self.std[-1])]
        return self.verdict._repr_html_() + _notebook.table(repr(self).strip("<>"), ("at the last time", "value"), rows, "", level)


def _deviations(covariances: Array) -> Array:
    return np.sqrt(np.maximum(np.diagonal(covariances, axis1=-2, axis2=-1), 0.0))


def _ends(probability: float) -> tuple[int, int]:
    """Which of the levels."""
    found = np.flatnonzero(np.abs(_LEVELS - (0.5 - 0.5 * probability)) < 1e-9)
    if not len(found) or probability <= 0:
        raise UsageError(f"a probability of {probability!r}: give 0.5, 0.9 or 0.95")
    return int(found[0]), len(_LEVELS) - 1 - int(found[0])


class _Run:
    """A filter's way through the data."""

    def __init__(self, belief: Filter, data: Array, times: Array, inputs: Array) -> None:
        self.belief = belief
        self.means: list[Array] = []
        self.covariances: list[Array] = []
        self.quantiles: list[Array] = []
        self.innovations: list[Array] = []
        self.innovation_covariances: list[Array] = []
        self.increments: list[Array] = []
        for k, datum in enumerate(data):
            if k:
                belief.predict(inputs[k - 1], float(times[k - 1]), float(times[k] - times[k - 1]))
            update = belief.update(datum, inputs[k], float(times[k]))
            innovation, covariance = np.full(len(datum), np.nan), np.full((len(datum), len(datum)), np.nan)
            innovation[update.seen] = update.innovation
            covariance[update.seen[:, None], update.seen] = update.covariance
            mean, spread = belief.moments()
            for kept, value in ((self.means, mean), (self.covariances, spread), (self.quantiles, belief.quantiles(_LEVELS)),
                                (self.innovations, innovation), (self.innovation_covariances, covariance), (self.increments, update.log_density)):
                kept.append(value)


def _evidence(model: StepModel, method: str, points: Points, data: Array, times: Array, inputs: Array) -> Array:
    """log p(data) at each point of the parameters; -inf where the model fails."""
    belief = Gaussian(model, points, method, keep=False)
    total = np.zeros(points.count)
    with np.errstate(all="ignore"):
        for k, datum in enumerate(data):
            if k:
                belief.predict(inputs[k - 1], float(times[k - 1]), float(times[k] - times[k - 1]))
            total = total + belief.update(datum, inputs[k], float(times[k])).log_density
            failed = ~np.isfinite(total)
            if failed.any():  # a harmless place, so that the others go on
                total[failed] = -np.inf
                belief.mean = np.where(failed[:, None], 0.0, belief.mean)
                belief.covariance = np.where(failed[:, None, None], np.eye(model.dimension), belief.covariance)
    return total


def _given(model: StepModel, data: ArrayLike, times: "ArrayLike | None", inputs: "ArrayLike | None") -> tuple[Array, Array, Array]:
    values = measured_values(data)
    values = values.reshape(-1, 1) if values.ndim == 1 else values
    if values.ndim != 2 or not values.size:
        raise UsageError(f"data of shape {np.shape(data)}: give one row for each time; NaN is a missing value")
    if np.any(np.isinf(values)):
        raise UsageError(f"data: row {int(np.flatnonzero(np.isinf(values).any(1))[0])} is infinite; a missing value is NaN")
    at = np.arange(len(values)) * model.dt if times is None else numbers(times, "times").ravel()
    if len(at) != len(values) or not np.all(np.isfinite(at)) or np.any(np.diff(at) <= 0):
        raise UsageError(f"times: {counted(len(at), 'time')} for {counted(len(values), 'row')} of data: one each, strictly increasing")
    return values, at, inputs_of(inputs, len(values), model.inputs)


def estimate(model: StepModel, data: ArrayLike, method: str = "auto", *, times: "ArrayLike | None" = None, inputs: "ArrayLike | None" = None,
             parameters: "Mapping[str, Prior] | None" = None, members: "int | None" = None, inflation: "float | None" = None,
             order: "int | None" = None, localisation: "Localisation | None" = None, jitter: "float | None" = None, draws: int = 200,
             inference: "Mapping[str, Any] | None" = None, seed: Seed = 1) -> StateEstimate:
    """The states of a model that steps, from data; and its parameters.

    Parameters
    ----------
    model : StepModel
    data : array_like, shape (T, m)
        NaN is a missing value.
    method : str
        ``kalman``: exact for a `LinearModel`; ``extended``: linearised at the mean; ``unscented``: by 2 d + 1 points; ``ensemble``: ensemble
        Kalman filter; ``particle``: exact for many members; ``map``: the stochastic map filter, nonlinear in what it does with an
        ensemble. ``auto``: ``kalman`` if the model is linear, else ``unscented``.
    times : array_like, shape (T,), optional
        Of the data; else `model.dt` apart, from 0.
    inputs : array_like, shape (T, k), optional
        From each time to the next.
    parameters : mapping of name to Normal, Uniform or Lognormal, optional
        Priors of parameters to be found, by `infer` on the evidence of the filter (one of the Gaussian methods). The states are then
        averaged over `draws` of their posterior.
    members : int, optional
        Of an ensemble: 200, of ``map`` 500, of ``particle`` 2000.
    inflation : float, optional
        Factor of the deviations of an ensemble from its mean before each datum: 1; of ``map`` without a localisation only in what the maps
        are fitted to.
    order : int, optional
        Of maps: 2; 1 is linear.
    localisation : Localisation, optional
        For ensembles that are small against the number of states.
    jitter : float, optional
        Of particles: the share of the ensemble's standard deviation by which resampled ones are scattered; 0. For models without process
        noise, whose particles would otherwise stay together.
    draws : int
        Of the parameters.
    inference : mapping, optional
        Further arguments of `infer`.
    seed : int or numpy.random.Generator

    Returns
    -------
    StateEstimate

    Raises
    ------
    UsageError
        Arrays that do not fit, an unknown method, or an option that it has no use for.
    DataError
        The model gives a value that is not finite (of ``particle``, such a member has no weight).
    NumericalError
        No member can explain a datum.

    Examples
    --------
    The stiffness and damping of an oscillator under an unknown random force, with its states:

    >>> model = knothe.states.oscillator(1.0, "c", "k", dt=0.1, noise=0.01, force_noise=0.3, covariance=0.1, parameters={"c": 0.4, "k": 9.0})
    >>> truth, data = model.simulate(100)
    >>> found = knothe.states.estimate(model, data, parameters={"c": knothe.Lognormal(-1, 0.5), "k": knothe.Lognormal(2, 0.5)})
    >>> bool(np.all(abs(found.parameters.mean - [0.4, 9.0]) < 3 * found.parameters.std)), found.verdict.level
    (True, 'ok')
    """
    if not isinstance(model, StepModel):
        raise UsageError(f"estimate: {model!r} is not a StepModel")
    chosen = method if method != "auto" else "kalman" if isinstance(model, LinearModel) else "unscented"
    if chosen not in _METHODS:
        raise UsageError(f"estimate: method {method!r}: there are auto, {', '.join(_METHODS)}")
    if chosen == "kalman" and not isinstance(model, LinearModel):
        raise UsageError("estimate: method 'kalman' is for a LinearModel; for this model use 'extended' or 'unscented'")
    options = {"members": members, "inflation": inflation, "order": order, "localisation": localisation, "jitter": jitter}
    for name, value in options.items():
        if value is not None and chosen not in _OPTIONS[name]:
            raise UsageError(f"estimate: {name} is an option of {', '.join(_OPTIONS[name])}, not of method {chosen!r}")
    values, at, given = _given(model, data, times, inputs)
    if parameters:
        if chosen not in _GAUSSIAN:
            raise UsageError(f"estimate: parameters are found by the evidence of {', '.join(_GAUSSIAN)}; that of {chosen!r} is random")
        return _with_parameters(model, chosen, values, at, given, parameters, draws, {"seed": seed, **(inference or {})})
    if inference:
        raise UsageError("estimate: inference is for parameters that have priors")
    points = Points(model.parameters)
    if chosen in _GAUSSIAN:
        belief: Filter = Gaussian(model, points, chosen)
    else:
        belief = _ensemble(model, points, chosen, options, seed, values.shape[1])
    return warned(StateEstimate(model, chosen, at, given, _Run(belief, values, at, given), None))


def _ensemble(model: StepModel, points: Points, method: str, options: Mapping[str, Any], seed: Seed, data: int) -> Ensemble:
    members = count_of(options["members"] or _MEMBERS[method], "members")
    if members < 2:
        raise UsageError(f"estimate: {counted(members, 'member')}: an ensemble has at least two")
    generator, local = np.random.default_rng(seed_of(seed)), options["localisation"]
    if local is not None:
        if not isinstance(local, Localisation) or len(local.distances) != model.dimension or len(local.observed) != data:
            raise UsageError(f"estimate: {local!r}, with {counted(len(getattr(local, 'observed', ())), 'place')} of data, for "
                             f"{counted(model.dimension, 'state')} and data of {counted(data, 'value')}")
        noise = model._data_noise(points, data)[0]
        if np.any(noise - np.diag(np.diag(noise))):
            raise UsageError("estimate: a localisation needs data whose noise is independent: give standard deviations")
    inflation = float(options["inflation"] or 1.0)
    if not inflation > 0:
        raise UsageError(f"estimate: inflation {inflation!r}: it is a factor > 0")
    if method == "particle":
        return Particles(model, points, members, generator, float(options["jitter"] or 0.0))
    taper = None if local is None else local._taper()
    if method == "ensemble":
        return Ensemble(model, points, members, generator, inflation, taper)
    order = count_of(2 if options["order"] is None else options["order"], "as order of maps")
    return MapEnsemble(model, points, members, generator, inflation, MapUpdate(order, taper, members, model.dimension))


def _with_parameters(model: StepModel, method: str, data: Array, times: Array, inputs: Array, priors: Mapping[str, Prior], draws: int,
                     options: Mapping[str, Any]) -> StateEstimate:
    names = list(priors)

    def points_at(values: Array) -> Points:
        return Points({**model.parameters, **dict(zip(names, values.T))}, len(values))

    def log_posterior(values: Array) -> Array:
        prior = log_prior(priors, values)
        result = np.full(len(values), -np.inf)
        possible = np.flatnonzero(np.isfinite(prior))
        if len(possible):
            result[possible] = prior[possible] + _evidence(model, method, points_at(values[possible]), data, times, inputs)
        return result

    found = infer(log_posterior, priors, vectorized=True, **options)
    drawn = found.draws(count_of(draws, "draws of the parameters"))
    belief = Gaussian(model, points_at(drawn), method)
    return warned(StateEstimate(model, method, times, inputs, _Run(belief, data, times, inputs), found))


__all__ = ["LinearModel", "Localisation", "StateEstimate", "StateForecast", "StepModel", "bouc_wen", "estimate", "fmu", "lugre", "oscillator",
           "with_unknown_input"]
