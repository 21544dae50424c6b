"""Health from modes: loss of stiffness from natural frequencies and mode shapes, with the temperature as a known input.

>>> import knothe.modes

Modes as they are identified from vibrations have no sign, scale or order that could be relied upon, and some are missing or spurious.
`log_likelihood` sums over all ways of pairing identified modes with the model's. `learn` finds the healthy structure's parameters, and the
`Baseline` that it gives assesses inspections: healthy, or which element has lost how much.
"""
from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from knothe import _notebook
from knothe._errors import UsageError
from knothe._inference import InferenceResult, infer
from knothe._innovations import chi_squared_above
from knothe._posterior import Reason, Verdict
from knothe._values import Array, ByValue, Prior, Seed, counted, log_prior, numbers

Structure = Callable[[Mapping[str, Any], float], "tuple[ArrayLike, ArrayLike]"]
_MOST_MODES = 12


@dataclass(frozen=True, eq=False)
class Modes(ByValue):
    """Modes identified in one session.

    Parameters
    ----------
    frequencies : array_like, shape (e,)
        Natural frequencies, Hz, in any order.
    shapes : array_like, shape (e, s), optional
        Of each its values at s sensors, of any sign and scale.
    temperature : float
        Of the structure, in the unit that the model has.

    Raises
    ------
    UsageError
        Frequencies that are not > 0, or shapes that do not fit.

    Examples
    --------
    >>> knothe.modes.Modes([1.2, 3.5], [[0.5, 1.0], [1.0, -0.4]], temperature=12.0).temperature
    12.0
    """

    frequencies: ArrayLike
    shapes: "ArrayLike | None" = None
    temperature: float = 0.0

    def __post_init__(self) -> None:
        frequencies = numbers(self.frequencies, "frequencies").ravel()
        if not len(frequencies) or not np.all(np.isfinite(frequencies) & (frequencies > 0)):
            raise UsageError(f"Modes: frequencies {self.frequencies!r}: give at least one, in Hz, > 0; leave out a mode that was not identified")
        object.__setattr__(self, "frequencies", frequencies)
        if not np.isfinite(self.temperature):
            raise UsageError(f"Modes: a temperature of {self.temperature!r}")
        if self.shapes is not None:
            shapes = np.atleast_2d(numbers(self.shapes, "shapes"))
            if len(shapes) != len(frequencies) or shapes.shape[1] < 2:
                raise UsageError(f"Modes: shapes of shape {shapes.shape} for {counted(len(frequencies), 'frequency').replace('ys', 'ies')}: give a row "
                                 "for each, at two sensors or more")
            norms = np.linalg.norm(shapes, axis=1)
            if not np.all(np.isfinite(norms) & (norms > 0)):
                raise UsageError("Modes: a mode shape is zero or not finite")
            object.__setattr__(self, "shapes", shapes)


def of_matrices(stiffness: ArrayLike, mass: ArrayLike, sensors: "Sequence[int] | None" = None) -> tuple[Array, Array]:
    """Natural frequencies and mode shapes of K x = w² M x; also of many structures at once.

    Parameters
    ----------
    stiffness, mass : array_like, shape (..., n, n)
        N/m and kg; symmetric, M positive definite.
    sensors : sequence of int, optional
        Degrees of freedom at which shapes are wanted; else all.

    Returns
    -------
    frequencies : ndarray, shape (..., n)
        Hz, rising; 0 of a structure that is not stable.
    shapes : ndarray, shape (..., n, s)
        A mode in each row.

    Examples
    --------
    >>> frequencies, shapes = knothe.modes.of_matrices([[2.0, -1.0], [-1.0, 1.0]], np.eye(2))
    >>> (2 * np.pi * frequencies).round(3)
    array([0.618, 1.618])
    """
    k, m = numbers(stiffness, "stiffness"), numbers(mass, "mass")
    inverse = np.linalg.inv(np.linalg.cholesky(m))
    values, vectors = np.linalg.eigh(inverse @ k @ inverse.swapaxes(-1, -2))
    shapes = (inverse.swapaxes(-1, -2) @ vectors).swapaxes(-1, -2)
    return np.sqrt(np.maximum(values, 0.0)) / (2 * math.pi), shapes if sensors is None else shapes[..., list(sensors)]


def frame(stiffness: Sequence[ArrayLike], mass: Sequence[float]) -> tuple[Array, Array]:
    """Natural frequencies and mode shapes of a frame with rigid floors; also of many at once.

    Parameters
    ----------
    stiffness : sequence of n float or arrays of one shape
        Of each storey against shear, N/m, from the ground up.
    mass : sequence of n float
        Of each floor, kg.

    Returns
    -------
    frequencies, shapes
        As of `of_matrices`.

    Examples
    --------
    >>> frequencies, _ = knothe.modes.frame([4e6, 4e6], [1e4, 1e4])
    >>> frequencies.round(2)
    array([1.97, 5.15])
    """
    storeys = np.stack(np.broadcast_arrays(*[np.asarray(k, float) for k in stiffness]), -1)
    n = len(mass)
    if storeys.shape[-1] != n:
        raise UsageError(f"frame: {storeys.shape[-1]} storeys and {counted(n, 'floor')}")
    k = np.zeros((*storeys.shape[:-1], n, n))
    for i in range(n):
        k[..., i, i] += storeys[..., i]
        if i:
            k[..., i - 1, i - 1] += storeys[..., i]
            k[..., i, i - 1] -= storeys[..., i]
            k[..., i - 1, i] -= storeys[..., i]
    return of_matrices(k, np.diag(np.asarray(mass, float)))


def assurance(one: ArrayLike, other: ArrayLike) -> Array:
    """Modal assurance criterion (Allemang 2003): 1 for modes of one shape, whatever their signs and scales, 0 for orthogonal ones.

    Parameters
    ----------
    one : array_like, shape (e, s)
    other : array_like, shape (..., r, s)

    Returns
    -------
    ndarray, shape (..., e, r)

    Examples
    --------
    >>> knothe.modes.assurance([[1.0, 1.0]], [[-2.0, -2.0], [1.0, -1.0]])
    array([[1., 0.]])
    """
    a, b = np.asarray(one, float), np.asarray(other, float)
    products = np.abs(a @ b.swapaxes(-1, -2))**2
    sizes = (a**2).sum(-1)[:, None] * np.maximum((b**2).sum(-1), 1e-300)[..., None, :]
    return np.asarray(products / sizes)


def _log_watson_constant(concentration: float, sensors: int) -> float:
    """Logarithm of the mean over all directions of exp(concentration MAC): the constant of Watson's distribution (Mardia and Jupp 2000, 9.4.2)."""
    angle = np.linspace(0, 0.5 * math.pi, 20001)
    # near the pole the integrand is narrow: nodes that crowd there
    angle = 0.5 * math.pi * (1 - (1 - angle / (0.5 * math.pi))**2)
    density = np.cos(angle)**(sensors - 2)
    integrand = np.exp(concentration * (np.sin(angle)**2 - 1)) * density
    return concentration + math.log(float(np.trapz(integrand, angle) / np.trapz(density, angle)))


@dataclass(frozen=True)
class Scatter:
    """How well modes are identified.

    Parameters
    ----------
    frequency : float
        Standard deviation of a natural frequency, as a share of it.
    shape : float
        Of each value of a mode shape, as a share of its norm.
    spurious : float
        Probability that a mode is none of the model's.

    Examples
    --------
    >>> knothe.modes.Scatter(0.005, 0.03)
    Scatter(frequency=0.005, shape=0.03, spurious=0.01)
    """

    frequency: float
    shape: float = 0.05
    spurious: float = 0.01

    def __post_init__(self) -> None:
        if not (0 < self.frequency < 1 and 0 < self.shape < 1 and 0 <= self.spurious < 1):
            raise UsageError(f"{self!r}: frequency and shape are shares between 0 and 1, spurious is a probability below 1")


def log_likelihood(session: Modes, frequencies: ArrayLike, shapes: "ArrayLike | None", scatter: Scatter) -> Array:
    """Logarithm of the density of identified modes, for many structures at once.

    Each identified mode is one of the model's, no two the same, or spurious; all ways of pairing are summed. A pair has a log-normal density of
    the frequency, and of the shape Watson's density, exp(MAC / (2 shape²)) normalised, which knows neither sign nor scale. Spurious
    modes have any direction, and frequencies spread evenly in logarithm over a decade.

    Parameters
    ----------
    session : Modes
        e modes.
    frequencies : array_like, shape (n, r)
        Of n structures, r modes, Hz.
    shapes : array_like, shape (n, r, s), or None
        At the sensors.
    scatter : Scatter

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    UsageError
        Shapes at another number of sensors, or more than 12 modes.

    Examples
    --------
    The order does not matter:

    >>> f, phi = knothe.modes.frame([4e6, 4e6], [1e4, 1e4])
    >>> scatter = knothe.modes.Scatter(0.01)
    >>> one, other = (knothe.modes.log_likelihood(knothe.modes.Modes(f[order], phi[order]), f[None], phi[None], scatter)
    ...               for order in ([0, 1], [1, 0]))
    >>> bool(abs(one - other)[0] < 1e-12)
    True
    """
    own = np.atleast_2d(np.asarray(frequencies, float))
    measured, r = np.asarray(session.frequencies), own.shape[1]
    if r > _MOST_MODES:
        raise UsageError(f"log_likelihood: {r} modes of the model: give the lowest {_MOST_MODES}, or fewer")
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = (np.log(measured)[:, None] - np.log(own)[:, None, :]) / scatter.frequency
    pairs = -0.5 * apart**2 - math.log(scatter.frequency * math.sqrt(2 * math.pi)) - np.log(measured)[:, None]
    alone = -math.log(math.log(10)) - np.log(measured)
    if session.shapes is not None and shapes is not None:
        modes = np.asarray(shapes, float).reshape(len(own), r, -1)
        sensors = np.shape(session.shapes)[1]
        if modes.shape[2] != sensors:
            raise UsageError(f"log_likelihood: mode shapes at {counted(sensors, 'sensor')}, but the model has them at {modes.shape[2]}")
        concentration = 0.5 / scatter.shape**2
        pairs = pairs + concentration * assurance(session.shapes, modes) - _log_watson_constant(concentration, sensors)
    return _summed_over_pairings(np.where(np.isnan(pairs), -np.inf, pairs), alone, scatter.spurious)


def _summed_over_pairings(pairs: Array, alone: Array, spurious: float) -> Array:
    """Over all ways in which e modes are different ones of r, or spurious; (n, e, r) and (e,). By dynamic programming over the sets of model modes
    that are taken. Without spurious modes each of the r! / (r - e)! ways has the same probability."""
    n, e, r = pairs.shape
    # sums[taken] over the modes so far; a choice among those that are left has equal probabilities
    sums: dict[int, Array] = {0: np.zeros(n)}
    log_spurious = math.log(spurious) if spurious > 0 else -math.inf
    for j in range(e):
        following: dict[int, Array] = {}
        for taken, total in sums.items():
            free = [i for i in range(r) if not taken >> i & 1]
            choices = [(taken | 1 << i, pairs[:, j, i] + math.log1p(-spurious) - math.log(len(free))) for i in free]
            if spurious > 0:
                choices.append((taken, np.full(n, alone[j] + log_spurious)))
            for now, value in choices:
                following[now] = np.logaddexp(following[now], total + value) if now in following else total + value
        sums = following
    if not sums:
        return np.full(n, -np.inf)
    return np.asarray(np.logaddexp.reduce(np.stack(list(sums.values())), axis=0))


class _Compared:
    """A structure against sessions, at many points of its parameters."""

    def __init__(self, structure: Structure, scatter: Scatter, vectorized: bool) -> None:
        self.structure, self.scatter, self.vectorized = structure, scatter, vectorized

    def modes(self, p: Mapping[str, Array], temperature: float) -> tuple[Array, "Array | None"]:
        count = len(next(iter(p.values())))
        if self.vectorized:
            frequencies, shapes = self.structure(p, temperature)
        else:
            answers = [self.structure({name: float(value[k]) for name, value in p.items()}, temperature) for k in range(count)]
            frequencies = np.array([each[0] for each in answers], float)
            shapes = None if answers[0][1] is None else np.array([each[1] for each in answers], float)
        f = np.asarray(frequencies, float)
        if f.ndim != 2 or len(f) != count:
            raise UsageError(f"structure: frequencies of shape {f.shape} for {counted(count, 'structure')}: give a row for each, or leave out vectorized")
        return f, None if shapes is None else np.asarray(shapes, float)

    def log_likelihood(self, p: Mapping[str, Array], sessions: Sequence[Modes]) -> Array:
        total: Array = np.zeros(len(next(iter(p.values()))))
        known: dict[float, tuple[Array, "Array | None"]] = {}
        for session in sessions:
            if session.temperature not in known:
                known = {session.temperature: self.modes(p, session.temperature)}
            total = total + log_likelihood(session, *known[session.temperature], self.scatter)
        return total


class Health:
    """The result of `Baseline.assess`.

    Attributes
    ----------
    probability : float
        That an element has lost stiffness.
    elements : dict of str to float
        For each element the probability that it is the one.
    loss, loss_std : dict of str to float
        Of each its loss of stiffness, if it is the one: posterior mean and standard deviation, shares.
    loss_interval : dict of str to (float, float)
        That hold it with 90 %.
    alarm : bool
        `probability` exceeds 0.9. With a prior probability of 0.1 that happens to at most one healthy structure in 81.
    verdict : Verdict
        Whether the frequencies of the inspection are those of any of the cases (``fit``), and the baseline's computation good enough.

    Examples
    --------
    >>> structure = lambda p, temperature: knothe.modes.frame([p["k"], 1.0], [1e-3, 1e-3])
    >>> before, after = (knothe.modes.Modes(*structure({"k": k}, 0.0)) for k in (1.0, 0.75))
    >>> baseline = knothe.modes.learn(structure, [before], {"k": knothe.Lognormal(0, 0.3)}, knothe.modes.Scatter(0.005))
    >>> baseline.assess([after], ["k"])
    <Health: damage in k with probability > 99.9 %, loss 25 %. Result: usable>
    """

    def __init__(self, log_odds: Mapping[str, float], losses: Mapping[str, "tuple[Array, Array]"], damage: float,
                 verdict: Verdict) -> None:
        logarithms = np.array([math.log1p(-damage), *(math.log(damage / len(log_odds)) + value for value in log_odds.values())])
        weights = np.exp(logarithms - logarithms.max())
        weights /= weights.sum()
        self.probability = float(weights[1:].sum())
        self.elements = dict(zip(log_odds, weights[1:].tolist()))
        self.loss = {name: float(w @ x) for name, (x, w) in losses.items()}
        self.loss_std = {name: math.sqrt(float(w @ (x - self.loss[name])**2)) for name, (x, w) in losses.items()}
        self.loss_interval: dict[str, tuple[float, float]] = {
            name: (float(np.interp(0.05, np.cumsum(w), x)), float(np.interp(0.95, np.cumsum(w), x))) for name, (x, w) in losses.items()}
        self.verdict = verdict

    @property
    def alarm(self) -> bool:
        """Whether damage is more probable than 0.9.

        Examples
        --------
        >>> structure = lambda p, temperature: knothe.modes.frame([p["k"], 1.0], [1e-3, 1e-3])
        >>> before, after = (knothe.modes.Modes(*structure({"k": k}, 0.0)) for k in (1.0, 0.8))
        >>> baseline = knothe.modes.learn(structure, [before], {"k": knothe.Lognormal(0, 0.3)}, knothe.modes.Scatter(0.005))
        >>> baseline.assess([after], ["k"]).alarm
        True
        """
        return self.probability > 0.9

    @property
    def located(self) -> str:
        """The element that has most probably lost stiffness.

        Examples
        --------
        >>> structure = lambda p, temperature: knothe.modes.frame([p["k"], 1.0], [1e-3, 1e-3])
        >>> same = knothe.modes.Modes(*structure({"k": 1.0}, 0.0))
        >>> baseline = knothe.modes.learn(structure, [same], {"k": knothe.Lognormal(0, 0.3)}, knothe.modes.Scatter(0.005))
        >>> healthy = baseline.assess([same], ["k"])
        >>> healthy.located, healthy.alarm
        ('k', False)
        """
        return max(self.elements, key=lambda name: self.elements[name])

    def __repr__(self) -> str:
        where = self.located
        share = _notebook.percent(self.probability)
        said = f"damage in {where} with probability {share}, loss {100 * self.loss[where]:.0f} %" if self.alarm else f"damage with probability {share}"
        return f"<Health: {said}. {_notebook.WORDS[self.verdict.level]}>"

    def _repr_html_(self) -> str:
        rows = [(name, _notebook.percent(share), f"{100 * self.loss[name]:.0f} ± {100 * self.loss_std[name]:.0f} %")
                for name, share in self.elements.items()]
        return self.verdict._repr_html_() + _notebook.table(repr(self).strip("<>"), ("element", "probability of damage", "loss, if so"), rows, "",
                                                            self.verdict.level)


class Baseline:
    """The result of `learn`: what is known of the healthy structure.

    Attributes
    ----------
    posterior : InferenceResult
        Of its parameters.

    Examples
    --------
    >>> structure = lambda p, temperature: knothe.modes.frame([p["k"], 1.0], [1e-3, 1e-3])
    >>> same = knothe.modes.Modes(*structure({"k": 1.0}, 0.0))
    >>> baseline = knothe.modes.learn(structure, [same], {"k": knothe.Lognormal(0, 0.3)}, knothe.modes.Scatter(0.005))
    >>> baseline.posterior.parameters
    ['k']
    """

    def __init__(self, compared: _Compared, posterior: InferenceResult, draws: int) -> None:
        self._compared, self.posterior, self._draws = compared, posterior, draws
        self._drawn = dict(zip(posterior.parameters, posterior.draws(draws).T))

    def assess(self, inspection: Sequence[Modes], elements: Sequence[str], *, damage: float = 0.1, largest_loss: float = 0.9) -> Health:
        """Whether one of the elements has lost stiffness, which, and how much.

        The evidence of the inspection, averaged over the baseline's posterior, is compared between the healthy structure and a loss in each of
        the elements, all losses being as probable before the data.

        Parameters
        ----------
        inspection : sequence of Modes
        elements : sequence of str
            Parameters that are stiffnesses which may be lost, one of them at a time.
        damage : float
            Prior probability that one has lost stiffness.
        largest_loss : float
            Share.

        Returns
        -------
        Health

        Raises
        ------
        UsageError
            No session, or an element that is no parameter.

        Examples
        --------
        A frame that softens by 0.2 % per kelvin, inspected on a warm day:

        >>> def structure(p, temperature):
        ...     softer = 1 - p["softening"] * temperature
        ...     return knothe.modes.frame([p[f"k{i}"] * softer for i in range(3)], [1.0, 1.0, 1.0])
        >>> priors = {**{f"k{i}": knothe.Lognormal(np.log(1000), 0.2) for i in range(3)}, "softening": knothe.Normal(0, 0.003)}
        >>> healthy = {"k0": 1000.0, "k1": 1000.0, "k2": 1000.0, "softening": 0.002}
        >>> measured = lambda p, t: knothe.modes.Modes(*structure(p, t), temperature=t)
        >>> cold = [measured(healthy, t) for t in (0.0, 10.0, 20.0)]
        >>> baseline = knothe.modes.learn(structure, cold, priors, knothe.modes.Scatter(0.005))
        >>> baseline.assess([measured(healthy, 30.0)], ["k0", "k1", "k2"]).alarm
        False
        >>> baseline.assess([measured({**healthy, "k1": 800.0}, 30.0)], ["k0", "k1", "k2"]).located
        'k1'
        """
        if not inspection:
            raise UsageError("assess: give at least one session")
        unknown = [name for name in elements if name not in self._drawn]
        if unknown or not elements:
            raise UsageError(f"assess: elements {', '.join(unknown) or 'none'}: there are parameters {', '.join(self._drawn)}")
        if not (0 < damage < 1 and 0 < largest_loss < 1):
            raise UsageError(f"assess: damage={damage!r} and largest_loss={largest_loss!r} are between 0 and 1")
        nodes, weights = np.polynomial.legendre.leggauss(60)
        losses = 0.5 * largest_loss * (nodes + 1)
        healthy, _ = self._evidence(inspection, None, np.zeros(1), np.ones(1))
        damaged = {name: self._evidence(inspection, name, losses, 0.5 * weights) for name in elements}
        best = max(damaged, key=lambda name: damaged[name][0])
        reasons = self._misfit(inspection, *((best, float(damaged[best][1] @ losses)) if damaged[best][0] > healthy else (None, 0.0)))
        if not self.posterior.trusted:
            reasons.append(Reason("computation", "caution", f"the baseline's posterior is not trusted: {self.posterior.remark}", 0.0, 0.0))
        level = "reject" if any(reason.level == "reject" for reason in reasons) else "caution" if reasons else "ok"
        return Health({name: value - healthy for name, (value, _) in damaged.items()}, {name: (losses, shares) for name, (_, shares) in damaged.items()},
                      damage, Verdict(level, reasons, 1.0, np.zeros(0), np.zeros(0)))

    def _evidence(self, inspection: Sequence[Modes], element: "str | None", losses: Array, weights: Array) -> tuple[float, Array]:
        """log E p(inspection) over the posterior and the loss, and how probable each loss is then."""
        p = {name: np.repeat(value, len(losses)) for name, value in self._drawn.items()}
        if element is not None:
            p[element] = p[element] * np.tile(1 - losses, self._draws)
        values = self._compared.log_likelihood(p, inspection).reshape(self._draws, -1)
        largest = values.max()
        by_loss = np.exp(values - largest).mean(0) * weights
        return float(largest + np.log(by_loss.sum())), by_loss / by_loss.sum()

    def _misfit(self, inspection: Sequence[Modes], element: "str | None", loss: float) -> list[Reason]:
        """Are the frequencies those of the case that explains them best? Each against the nearest one, at the mean of the posterior."""
        p = {name: np.array([value.mean()]) for name, value in self._drawn.items()}
        if element is not None:
            p[element] = p[element] * (1 - loss)
        total, count = 0.0, 0
        for session in inspection:
            spread = np.log(self._compared.modes(self._drawn, session.temperature)[0]).std(0)
            apart = np.log(np.asarray(session.frequencies))[:, None] - np.log(self._compared.modes(p, session.temperature)[0][0])
            nearest = np.abs(apart).argmin(1)
            scaled = apart[np.arange(len(nearest)), nearest]**2 / (self._compared.scatter.frequency**2 + spread[nearest]**2)
            total, count = total + float(scaled.sum()), count + len(scaled)
        probability = chi_squared_above(total, count)
        if probability >= 3e-5:
            return []
        factor = math.sqrt(total / count)
        return [Reason("fit", "reject" if probability < 1e-12 or factor > 1.5 else "caution", "the frequencies fit neither the healthy structure nor the "
                       f"loss of one element: they are {factor:.2g} times as far away as their scatter (probability {probability:.1g}): several "
                       "elements, or another cause", factor, 1.5)]

    def __repr__(self) -> str:
        return f"<Baseline: {', '.join(self._drawn)}>"


def learn(structure: Structure, sessions: Sequence[Modes], parameters: Mapping[str, Prior], scatter: Scatter, *, vectorized: bool = True,
          draws: int = 400, inference: "Mapping[str, Any] | None" = None, seed: Seed = 1) -> Baseline:
    """The healthy structure's parameters, from sessions in which it was healthy, by `infer`.

    Parameters
    ----------
    structure : callable
        ``structure(p, temperature)``: frequencies and mode shapes at the sensors (or None), as of `frame` and `of_matrices`; p maps names to
        arrays of n.
    sessions : sequence of Modes
    parameters : mapping of name to Normal, Uniform or Lognormal
        Priors, those of the temperature's effect among them.
    scatter : Scatter
    vectorized : bool
        If false, `structure` is called with numbers, for one structure at a time.
    draws : int
        Of the posterior, for what follows.
    inference : mapping, optional
        Further arguments of `infer`.
    seed : int or numpy.random.Generator

    Returns
    -------
    Baseline

    Raises
    ------
    UsageError
        No sessions, or arrays that do not fit.

    Examples
    --------
    >>> structure = lambda p, temperature: knothe.modes.frame([p["k"], 1.0], [1e-3, 1e-3])
    >>> healthy = [knothe.modes.Modes(*structure({"k": k}, 0.0)) for k in (0.99, 1.01)]
    >>> baseline = knothe.modes.learn(structure, healthy, {"k": knothe.Lognormal(0, 0.3)}, knothe.modes.Scatter(0.005))
    >>> bool(abs(baseline.posterior.mean[0] - 1) < 0.02)
    True
    """
    if not sessions:
        raise UsageError("learn: give at least one session")
    compared, names = _Compared(structure, scatter, vectorized), list(parameters)
    by_temperature = sorted(sessions, key=lambda session: session.temperature)  # those of one temperature one after the other

    def log_posterior(values: Array) -> Array:
        prior = log_prior(parameters, values)
        result = np.full(len(values), -np.inf)
        possible = np.flatnonzero(np.isfinite(prior))
        if len(possible):
            result[possible] = prior[possible] + compared.log_likelihood(dict(zip(names, values[possible].T)), by_temperature)
        return result

    options: dict[str, Any] = {"seed": seed, **(inference or {})}
    return Baseline(compared, infer(log_posterior, parameters, vectorized=True, **options), draws)


__all__ = ["Baseline", "Health", "Modes", "Scatter", "assurance", "frame", "learn", "log_likelihood", "of_matrices"]
