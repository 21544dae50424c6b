"""Posteriors, verdicts and forecasts: what the results of all functions have in common."""
from __future__ import annotations

import math
from dataclasses import dataclass
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from knothe import _knothe, _notebook
from knothe._errors import UsageError, untrusted
from knothe._values import Array, ByValue, count_of

if TYPE_CHECKING:
    import xarray

_CHAINS = 4
_ONE_SIGMA = "±: one standard deviation, with the reduced model's error where it is known."


@dataclass(frozen=True)
class Reason:
    """A reason to use an answer with care, or not at all.

    Attributes
    ----------
    code : str
        ``computation``, ``fit``, ``prior``, ``range``, ``model``, ``bias`` or ``outlier``.
    level : str
        ``caution`` or ``reject``.
    message : str
        What it is, and what to do.
    value, limit : float
        The value found, and the limit beyond which it is a reason.
    cause : str or None
        Of a misfit: ``sign``, ``scale``, ``time_shift`` ...

    Examples
    --------
    >>> for reason in result.verdict.reasons:
    ...     print(reason.level, reason.code, reason.message)
    """

    code: str
    level: str
    message: str
    value: float
    limit: float
    cause: str | None = None


@dataclass(frozen=True, eq=False)
class Verdict(ByValue):
    """Whether an answer may be used.

    Attributes
    ----------
    level : str
        ``ok``, ``caution`` or ``reject``.
    reasons : list of Reason
        Empty if the level is ``ok``.
    fit_probability : float
        Probability, under a correct model, of a misfit at least as large as observed.
    edge_mass : ndarray, shape (d,)
        Posterior mass in the outer 2 % of the model's box, at either side.
    model_shift_std : ndarray, shape (d,)
        How far the error of the reduced model shifts each mean, in posterior standard deviations; empty if it is not known.

    Examples
    --------
    >>> result.verdict.level
    'ok'
    """

    level: str
    reasons: list[Reason]
    fit_probability: float
    edge_mass: Array
    model_shift_std: Array

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> "Verdict":
        """From the entry ``verdict`` of a line of JSON.

        Parameters
        ----------
        record : mapping
            As of ``json.loads``.

        Returns
        -------
        Verdict

        Examples
        --------
        >>> knothe.Verdict.of(result.record["verdict"]).level
        'ok'
        """
        return cls(record["level"], [Reason(**reason) for reason in record["reasons"]], record["fit_probability"],
                   np.array(record["edge_mass"]), np.array(record["model_shift_std"]))

    def __bool__(self) -> bool:
        return self.level != "reject"

    def _repr_html_(self) -> str:
        reasons = [(reason.level, reason.code, reason.message) for reason in self.reasons]
        return _notebook.verdict_line(self.level) + (_notebook.table("Reasons", ("level", "what", "why"), reasons) if reasons else "")


@dataclass(frozen=True)
class Decision:
    """What to do next with the specimen: of a project with a table ``[decide]``.

    Attributes
    ----------
    action : str
        ``load``: on to ``time``, and measure there; ``hold``: measure again at the present load; ``stop``.
    time : float
        Model time to load to; the present one if there is no load.
    information : float
        Expected from the next measurement, nats.
    plan : list of float
        Model times of all measurements that are worth making now.
    furthest : float
        The largest model time that the risk allows now.
    message : str
        Why.
    failure_probability : float or None
        That the specimen fails by ``time``; None where the answer does not tell.
    allowed_probability : float or None
        The largest for this action.
    load : float or None
        What is imposed at ``time``, in ``units``, where the model knows it.
    units : str or None

    Examples
    --------
    >>> result.decision is None  # the project does not ask
    True
    """

    action: str
    time: float
    information: float
    plan: list[float]
    furthest: float
    message: str
    failure_probability: float | None = None
    allowed_probability: float | None = None
    load: float | None = None
    units: str | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Forecast(ByValue):
    """The forecast of one quantity of interest.

    Attributes
    ----------
    mean, std, maximum_a_posteriori : float
        In `units`.
    probability_above_threshold : float
        P(q > threshold).
    probability_below_threshold : float
        P(q < threshold).
    horizon, threshold : float
        Model time for which it is made; `threshold` in `units`.
    at : str
        The horizon in words, by what is imposed then where that is known: ``0.12 mm``.
    levels, values : ndarray
        Quantiles.
    points, density : ndarray
        The density of q, per unit of q; empty where it is not known.
    verdict : str
        Level of the verdict on the answer that it is of.
    model_shift_std : float
        How far the error of the reduced model may shift it, in its standard deviations.

    Examples
    --------
    >>> tip = twin.forecast["tip"]
    >>> bool(abs(tip.mean - 2.211e-3) < 3 * tip.std), tip.units
    (True, 'm')
    """

    mean: float
    std: float
    maximum_a_posteriori: float
    probability_above_threshold: float
    probability_below_threshold: float
    horizon: float
    threshold: float
    levels: Array
    values: Array
    units: str
    points: Array
    density: Array
    at: str = ""
    verdict: str = "ok"
    model_shift_std: float = 0.0

    @classmethod
    def of(cls, record: Mapping[str, Any], verdict: "Mapping[str, Any] | None" = None) -> "Forecast":
        """From an entry of ``forecast`` in a line of JSON.

        Parameters
        ----------
        record : mapping
            As of ``json.loads``.
        verdict : mapping, optional
            The entry ``verdict`` of that line.

        Returns
        -------
        Forecast

        Examples
        --------
        >>> knothe.Forecast.of(result.record["forecast"]["tip"]).units
        'm'
        """
        density = record.get("density", {"points": [], "values": []})
        return cls(record["mean"], record["std"], record["maximum_a_posteriori"], record["probability_above_threshold"],
                   record["probability_below_threshold"], record["horizon"], record["threshold"], np.array(record["levels"]),
                   np.array(record["values"]), record["units"], np.array(density["points"]), np.array(density["values"]), record.get("at", ""),
                   (verdict or {}).get("level", "ok"), max([0.0, *((verdict or {}).get("model_shift_std") or [])]))

    @property
    def _horizon(self) -> str:
        return self.at or f"time {self.horizon:g}"

    @property
    def _spread(self) -> float:
        return self.std * math.hypot(1, self.model_shift_std)

    def _value(self) -> str:
        return _notebook.quantity(self.mean, self._spread, self.units, self.verdict)

    def __repr__(self) -> str:
        above = f"P(above {_notebook.given(self.threshold, self.units)}): {_notebook.percent(self.probability_above_threshold)}"
        return (f"<Forecast at {self._horizon}: {_notebook.rejected(self.verdict)}{self._value()}"
                f"{'' if self.verdict == 'reject' else ', ' + above}>")

    def _row(self, name: str) -> tuple[str, ...]:
        ends = _notebook.interval(self.values[0], self.values[-1], self._spread, self.units, self.verdict, max(abs(self.mean), self.std))
        return (name, self._horizon, self._value(), ends,
                f"P(> {_notebook.given(self.threshold, self.units)}) {_notebook.percent(self.probability_above_threshold)}")

    def _repr_html_(self) -> str:
        return (_notebook.verdict_line(self.verdict) if self.verdict == "reject" else "") + _forecast_table({"": self})


def _forecast_table(forecasts: Mapping[str, Forecast]) -> str:
    worst = max((forecast.verdict for forecast in forecasts.values()), key=["ok", "caution", "reject"].index)
    return _notebook.table("Forecast" if len(forecasts) == 1 else "Forecasts", ("", "at", "value", "95 %", "threshold"),
                           [forecast._row(name) for name, forecast in forecasts.items()], _ONE_SIGMA, worst, 2)


class Posterior:
    """A posterior of d parameters: n weighted points, and what follows from them.

    Moments, quantiles and evidence are importance-corrected: accurate even where the map is only approximate. The unit of a
    parameter is that of its prior: for a reduced model that of the axis, often a multiple of a reference value.

    Attributes
    ----------
    record : dict
        The line of JSON that the command prints, as Python has it.
    parameters : list of str
        Names, in the order of everything below.
    points, weights : ndarray, shapes (n, d) and (n,)
        The weights add up to 1.
    densities : list of (lower, upper, points, density)
        Support and density of each prior; empty where there are none.

    Examples
    --------
    >>> result.parameters, result.mean.shape, result.covariance.shape
    (['E', 'F'], (2,), (2, 2))
    """

    record: Mapping[str, Any]

    def __init__(self, record: Mapping[str, Any], parameters: Sequence[str], points: Array, weights: Array,
                 densities: Sequence[tuple[float, float, Array, Array]] = (),
                 labels: Mapping[str, Mapping[str, Any]] | None = None) -> None:
        self.record, self.parameters, self.points, self.weights = record, list(parameters), points, weights
        self.densities = list(densities)
        self._labels = dict(labels or {})  # of the parameters: attributes as in the files of the command

    @property
    def mean(self) -> Array:
        """Posterior mean, shape (d,), in units of the parameters.

        Examples
        --------
        >>> bool(np.all(abs(result.mean - [0.9, 1.1]) < 3 * result.std))
        True
        """
        return np.array(self.record["mean"])

    @property
    def covariance(self) -> Array:
        """Posterior covariance, shape (d, d), in products of the parameters' units.

        Examples
        --------
        >>> bool(result.covariance[0, 1] == result.covariance[1, 0])
        True
        """
        return np.array(self.record["covariance"])

    @property
    def std(self) -> Array:
        """Posterior standard deviations, shape (d,), in units of the parameters.

        Examples
        --------
        >>> bool(np.all(result.std < 0.05))  # of the prior 0.3
        True
        """
        return np.sqrt(np.diag(self.covariance))

    @property
    def maximum_a_posteriori(self) -> Array:
        """Where the density of the parameters is largest, shape (d,), in units of the parameters.

        Examples
        --------
        >>> bool(np.all(abs(result.maximum_a_posteriori - result.mean) < result.std))
        True
        """
        return np.array(self.record["maximum_a_posteriori"])

    @property
    def levels(self) -> Array:
        """Levels of the quantiles, shape (levels,), between 0 and 1.

        Examples
        --------
        >>> result.levels
        array([0.025, 0.25 , 0.5  , 0.75 , 0.975])
        """
        return np.array(self.record["quantiles"]["levels"])

    @property
    def quantiles(self) -> Array:
        """Marginal quantiles, shape (d, levels), in units of the parameters.

        Examples
        --------
        >>> lower, upper = result.quantiles[result.index("E")][[0, -1]]  # 95 %
        >>> bool(lower < 0.9 < upper)
        True
        """
        return np.array(self.record["quantiles"]["values"])

    @property
    def log_evidence(self) -> float:
        """Natural logarithm of the evidence.

        Examples
        --------
        >>> found = knothe.fit(lambda p: -0.5 * p @ p, dimension=1)
        >>> bool(abs(found.log_evidence - 0.5 * np.log(2 * np.pi)) < 1e-6)
        True
        """
        return float(self.record["log_evidence"])

    @property
    def map_order(self) -> int:
        """Order of the transport map; 0 where there is none.

        Examples
        --------
        >>> knothe.fit(lambda p: -0.5 * p @ p, dimension=1).map_order
        1
        """
        return int(self.record["map_order"])

    @property
    def variance_diagnostic(self) -> float:
        """Variance diagnostic of the map, dimensionless, on points other than the training ones (Rubio et al. 2019, Eq. 9).

        Examples
        --------
        >>> knothe.fit(lambda p: -0.5 * p @ p, dimension=1).variance_diagnostic < 1e-3
        True
        """
        return float(self.record["variance_diagnostic"])

    @property
    def ess(self) -> float:
        """Effective sample size of the weights, as a fraction of their number: above 0, at most 1.

        Examples
        --------
        >>> 0 < result.ess <= 1
        True
        """
        return float(self.record["ess"])

    @property
    def trusted(self) -> bool:
        """Whether the computation is accurate; `Verdict` rates the answer itself.

        Examples
        --------
        >>> result.trusted
        True
        """
        return bool(self.record["trusted"])

    @property
    def remark(self) -> str:
        """Why the tolerance was not reached, or the computation is not trusted; else empty.

        Examples
        --------
        >>> result.remark
        ''
        """
        return str(self.record.get("remark", ""))

    def index(self, parameter: str | int) -> int:
        """The index of a parameter.

        Parameters
        ----------
        parameter : str or int
            Name; an index is returned as it is.

        Returns
        -------
        int
            From 0.

        Raises
        ------
        UsageError
            There is no parameter of that name.

        Examples
        --------
        >>> result.index("F")
        1
        """
        if isinstance(parameter, str):
            if parameter not in self.parameters:
                raise UsageError(f"there is no parameter \"{parameter}\"; there are {', '.join(self.parameters)}")
            return self.parameters.index(parameter)
        return int(parameter)

    def _prior(self) -> dict[str, Any] | None:
        """Values of the prior at the points, which `population` divides out; None where they are not known."""
        return None

    def draws(self, count: int = 500) -> Array:
        """Equally weighted draws, no two of them equal; for an assimilation those of `posterior.nc`.

        Parameters
        ----------
        count : int
            Number of draws.

        Returns
        -------
        ndarray, shape (count, d)
            In units of the parameters.

        Examples
        --------
        >>> result.draws(100).shape
        (100, 2)
        """
        bounds = [density[:2] for density in self.densities] or [(-np.inf, np.inf)] * len(self.parameters)
        return _knothe.distinct_draws(self.points, self.weights, count_of(count, "draws"), np.array([lower for lower, _ in bounds]),
                                      np.array([upper for _, upper in bounds]))

    def marginal(self, parameter: str | int) -> tuple[Array, Array]:
        """The marginal density of one parameter, from the weighted points.

        Parameters
        ----------
        parameter : str or int
            Name or index.

        Returns
        -------
        points : ndarray, shape (k,)
            In the parameter's unit.
        density : ndarray, shape (k,)
            Per unit of the parameter; it integrates to 1.

        Raises
        ------
        UsageError
            There is no parameter of that name.

        Examples
        --------
        >>> points, density = result.marginal("E")
        >>> round(float(density @ np.gradient(points)), 2)
        1.0
        """
        k = self.index(parameter)
        lower, upper = self.densities[k][:2] if self.densities else (-np.inf, np.inf)
        return _knothe.marginal_density(self.points[:, k], self.weights, lower, upper)

    def to_xarray(self, draws: int = 1000) -> "dict[str, xarray.Dataset]":
        """One Dataset for each of ArviZ's groups.

        Parameters
        ----------
        draws : int
            Number of draws, in four chains: they are independent, but r̂ compares chains.

        Returns
        -------
        dict of str to xarray.Dataset
            ``posterior`` (chain, draw), ``weighted_posterior`` (point, parameter), and ``history`` (step): one step.

        Examples
        --------
        >>> groups = result.to_xarray(draws=100)
        >>> sorted(groups), groups["posterior"]["E"].shape
        (['history', 'posterior', 'weighted_posterior'], (4, 25))
        """
        per_chain = -(-draws // _CHAINS)
        return self._groups(self.draws(_CHAINS * per_chain).reshape(_CHAINS, per_chain, -1))

    def _groups(self, chains: Array) -> "dict[str, xarray.Dataset]":
        """With draws of shape (chain, draw, parameter)."""
        import xarray

        posterior = {name: (("chain", "draw"), chains[..., k], self._labels.get(name)) for k, name in enumerate(self.parameters)}
        coordinates = {"chain": np.arange(chains.shape[0]), "draw": np.arange(chains.shape[1])}
        weighted = {"points": (("point", "parameter"), self.points), "weights": (("point",), self.weights)}
        numbers = {name: ("step", [value]) for name, value in self.record.items()
                   if isinstance(value, (bool, int, float)) and name != "step"}
        return {"posterior": xarray.Dataset(posterior, coordinates),
                "weighted_posterior": xarray.Dataset(weighted, {"parameter": self.parameters}),
                "history": xarray.Dataset(numbers, {"step": [self.record.get("step", 0)]})}

    def _worth(self) -> tuple[str, list[float]]:
        """The verdict's level, and by what factor the reduced model's own error widens each standard deviation."""
        verdict = self.record.get("verdict")
        if not isinstance(verdict, Mapping):
            return "ok", [1.0] * len(self.parameters)
        shifts = verdict.get("model_shift_std") or [0.0] * len(self.parameters)
        return verdict["level"], [math.hypot(1, shift) for shift in shifts]

    def __repr__(self) -> str:
        level, wider = self._worth()
        numbers = ", ".join(f"{name} = {_notebook.quantity(m, by * s, level=level)}{self._physical(name, level, by, ' ({})')}"
                            for name, m, s, by in zip(self.parameters, self.mean, self.std, wider))
        return f"<{type(self).__name__}: {_notebook.rejected(level)}{numbers}{'' if self.trusted else '; ' + untrusted(self.remark)}>"

    def _physical(self, name: str, level: str, wider: float, form: str = "{}") -> str:
        """The parameter's value in its unit, where that is known and is not the number itself."""
        known = self.record.get("physical", {}).get(name, {})
        units = known.get("units", "1")
        return "" if units == "1" else form.format(_notebook.quantity(known["mean"], wider * known["std"], units, level))

    def _repr_html_(self) -> str:
        level, wider = self._worth()
        rows = [(name, _notebook.quantity(m, by * s, level=level), _notebook.interval(q[0], q[-1], by * s, level=level),
                 self._physical(name, level, by))
                for name, m, s, q, by in zip(self.parameters, self.mean, self.std, self.quantiles, wider)]
        shown = _notebook.table(type(self).__name__, ("parameter", "estimate", "95 %", "in its unit"), rows, _ONE_SIGMA, level)
        verdict = self.record.get("verdict")
        known = {name: Forecast.of(each, verdict if isinstance(verdict, Mapping) else None) for name, each in self.record.get("forecast", {}).items()}
        forecasts: Mapping[str, Forecast] = getattr(self, "forecast", known)
        if isinstance(verdict, Mapping):
            shown = Verdict.of(verdict)._repr_html_() + shown
        elif not self.trusted:
            shown = _notebook.table("Not trusted", (), [(self.remark,)]) + shown
        return shown + (_forecast_table(forecasts) if forecasts else "")
