"""Filters: each is a belief about the state that is moved on in time and corrected by data.

`Gaussian` (Kalman, extended, unscented) holds one Gaussian for each of b points of the parameters, which have weights; `Ensemble` (and what
is derived from it) holds members. `estimate` (states.py) runs them, and asks for moments and quantiles.
"""
from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from knothe._errors import DataError, NumericalError
from knothe._map_update import MapUpdate
from knothe._step_models import LinearModel, Points, StepModel, require_finite, root_of
from knothe._values import Array

Indices = NDArray[np.int64]
_LOG_2_PI = math.log(2 * math.pi)
_STENCIL = ((1.0, 8 / 12), (-1.0, -8 / 12), (2.0, -1 / 12), (-2.0, 1 / 12))  # of a first derivative, fourth order


@dataclass
class Update:
    """What a datum did: innovation and its covariance (of the values that are not missing), and log p(datum | the data before)."""

    seen: Indices
    innovation: Array
    covariance: Array
    log_density: Array  # of each point of the parameters


_Copied = TypeVar("_Copied", bound="Ensemble")


class Filter(Protocol):
    """What `estimate` asks."""

    def forked(self) -> "Filter":
        """One that goes on by itself."""
        ...

    def predict(self, u: Array, t: float, dt: float) -> None: ...

    def update(self, data: Array, u: Array, t: float) -> Update: ...

    def moments(self) -> tuple[Array, Array]: ...

    def quantiles(self, levels: Array) -> Array: ...

    def data_moments(self, u: Array, t: float, count: int) -> tuple[Array, Array]: ...


@dataclass
class Step:
    """Of a Gaussian filter, for smoothing: means and covariances after the data of a time, those forecast for the next, and how both vary
    together."""

    mean: Array
    covariance: Array
    next_mean: Array
    next_covariance: Array
    cross: Array


def symmetric(matrices: Array) -> Array:
    return 0.5 * (matrices + matrices.swapaxes(-1, -2))


def of_mixture(weights: Array, means: Array, covariances: Array) -> tuple[Array, Array]:
    """Mean and covariance by the law of total variance."""
    if len(weights) == 1:
        return means[0], covariances[0]
    mean = weights @ means
    apart = means - mean
    return mean, np.tensordot(weights, covariances, 1) + (weights[:, None] * apart).T @ apart


def quantiles_of_mixture(weights: Array, means: Array, deviations: Array, levels: Array) -> Array:
    """Of normal densities in each of d coordinates, by bisection: levels x d."""
    normal = NormalDist()
    if len(weights) == 1:
        return means[0] + np.array([normal.inv_cdf(level) for level in levels])[:, None] * deviations[0]
    reach = 10 * deviations.max(0)
    low, high = (np.broadcast_to(edge, (len(levels), means.shape[1])).copy() for edge in (means.min(0) - reach, means.max(0) + reach))
    for _ in range(40):
        middle = 0.5 * (low + high)
        with np.errstate(divide="ignore", invalid="ignore"):
            scaled = np.nan_to_num((middle[:, None] - means) / deviations, nan=0.0)
        below = np.tensordot(weights, normal_cumulative(scaled), (0, 1)) < levels[:, None]
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def normal_cumulative(x: Array) -> Array:
    """Standard normal distribution function, to 8e-8 (Abramowitz and Stegun 26.2.17)."""
    t = 1 / (1 + 0.2316419 * np.abs(x))
    series = t * (0.319381530 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))))
    tail = np.exp(-0.5 * np.minimum(np.abs(x), 37)**2) / math.sqrt(2 * math.pi) * series
    return np.asarray(np.where(x > 0, 1 - tail, tail))


def log_normal_density(innovation: Array, covariance: Array) -> Array:
    """Of innovations (b, m) with covariances (b, m, m)."""
    if innovation.shape[1] == 1:
        variance = covariance[:, 0, 0]
        return np.asarray(-0.5 * (innovation[:, 0]**2 / variance + np.log(variance) + _LOG_2_PI))
    sign, log_determinant = np.linalg.slogdet(covariance)
    quadratic = (innovation * np.linalg.solve(covariance, innovation[..., None])[..., 0]).sum(1)
    return np.where(sign > 0, -0.5 * (quadratic + log_determinant + innovation.shape[1] * _LOG_2_PI), -np.inf)


class Gaussian:
    """Kalman filter of a linear model (`linear`), extended (derivatives by differences) or unscented, at b points of the parameters."""

    def __init__(self, model: StepModel, points: Points, kind: str, weights: "Array | None" = None, keep: bool = True) -> None:
        self.model, self.points, self.kind = model, points, kind
        self.weights = np.full(points.count, 1 / points.count) if weights is None else weights
        self.mean, self.covariance = model._first(points)
        self.steps: "list[Step] | None" = [] if keep else None
        self._strict = keep  # else a point where the model fails is only a bad one
        self._noise: "Array | None" = None
        d = model.dimension
        # Julier and Uhlmann 1997, kappa = 3 - d where no weight is negative: exact for third moments (d = 1: fifth)
        kappa = max(3 - d, 0)
        self._reach, self._outer, self._centre = math.sqrt(d + kappa), 0.5 / (d + kappa), kappa / (d + kappa)

    def _sigma_points(self) -> Array:
        """(b, 2 d + 1, d), the mean first."""
        apart = self._reach * root_of(self.covariance).swapaxes(1, 2)
        return np.concatenate([self.mean[:, None], self.mean[:, None] + apart, self.mean[:, None] - apart], 1)

    def _weighted(self, values: Array) -> tuple[Array, Array]:
        """Mean (b, m) of values at sigma points (b, 2 d + 1, m), and the deviations times the roots of the weights."""
        mean = self._centre * values[:, 0] + self._outer * values[:, 1:].sum(1)
        roots = np.sqrt(np.r_[self._centre, np.full(values.shape[1] - 1, self._outer)])
        return mean, roots[:, None] * (values - mean[:, None])

    def _stencil(self) -> tuple[Array, Array]:
        """States around the mean (b, 1 + 4 d, d), and how far apart (b, d)."""
        deviations = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        apart = np.where(deviations > 0, 1e-3 * deviations, 1e-4 * (1e-3 + np.abs(self.mean)))
        around = self.mean[:, None] + np.concatenate([apart[:, None] * offset * np.eye(self.model.dimension) for offset, _ in _STENCIL], 1)
        return np.concatenate([self.mean[:, None], around], 1), apart

    @staticmethod
    def _derivative(values: Array, apart: Array) -> Array:
        """Of values at the points of the stencil (b, 1 + 4 d, m): (b, m, d)."""
        d = apart.shape[1]
        total = sum(weight * values[:, 1 + k * d:1 + (k + 1) * d] for k, (_, weight) in enumerate(_STENCIL))
        return np.asarray((total / apart[..., None]).swapaxes(1, 2))

    def predict(self, u: Array, t: float, dt: float) -> None:
        before, model = (self.mean, self.covariance), self.model
        if self.kind == "unscented":
            states = self._sigma_points()
            self.mean, after = self._weighted(model._advance(states, self.points, u, t, dt))
            cross = self._weighted(states)[1].swapaxes(1, 2) @ after
            covariance = after.swapaxes(1, 2) @ after
        else:
            if self.kind == "extended":
                states, apart = self._stencil()
                values = model._advance(states, self.points, u, t, dt)
                self.mean, transition = values[:, 0], self._derivative(values, apart)
            else:
                assert isinstance(model, LinearModel)
                transition = model._matrices(self.points, dt)[0]
                self.mean = model._advance(self.mean[:, None], self.points, u, t, dt)[:, 0]
            cross = self.covariance @ transition.swapaxes(1, 2)
            covariance = transition @ cross
        if self._strict:
            require_finite(self.mean, t + dt, "step", model)
        added = model._added_noise(self.points, dt)
        self.covariance = symmetric(covariance if added is None else covariance + added)
        if self.steps is not None:
            self.steps.append(Step(*before, self.mean, self.covariance, cross))

    def _seen(self, u: Array, t: float) -> tuple[Array, Array, Array, "Array | None"]:
        """Mean of the data, covariance of it without noise, cross-covariance of state and data, and the derivative if there is one."""
        model = self.model
        if self.kind == "unscented":
            states = self._sigma_points()
            mean, apart = self._weighted(model._seen(states, self.points, u, t))
            return mean, apart.swapaxes(1, 2) @ apart, self._weighted(states)[1].swapaxes(1, 2) @ apart, None
        if self.kind == "extended":
            states, distance = self._stencil()
            values = model._seen(states, self.points, u, t)
            mean, slope = values[:, 0], self._derivative(values, distance)
        else:
            assert isinstance(model, LinearModel)
            mean, slope = model._seen(self.mean[:, None], self.points, u, t)[:, 0], model._observation_matrices(self.points)[0]
        cross = self.covariance @ slope.swapaxes(1, 2)
        return mean, slope @ cross, cross, slope

    def update(self, data: Array, u: Array, t: float) -> Update:
        seen = np.flatnonzero(np.isfinite(data))
        if not len(seen):
            return Update(seen, np.zeros(0), np.zeros((0, 0)), np.zeros(self.points.count))
        if self._noise is None:
            self._noise = self.model._data_noise(self.points, len(data))
        noise = self._noise[:, seen[:, None], seen]
        mean, spread, cross, slope = self._seen(u, t)
        require_width(mean, data)
        if self._strict:
            require_finite(mean, t, "observe", self.model)
        innovation, covariance = data[seen] - mean[:, seen], symmetric(spread[:, seen[:, None], seen] + noise)
        cross = cross[:, :, seen]
        gain = cross / covariance if len(seen) == 1 else np.linalg.solve(covariance, cross.swapaxes(1, 2)).swapaxes(1, 2)
        self.mean = self.mean + (gain @ innovation[..., None])[..., 0]
        if slope is None:
            self.covariance = symmetric(self.covariance - gain @ cross.swapaxes(1, 2))
        else:  # Joseph's form keeps it positive
            left = np.eye(self.model.dimension) - gain @ slope[:, seen]
            self.covariance = symmetric(left @ self.covariance @ left.swapaxes(1, 2) + gain @ noise @ gain.swapaxes(1, 2))
        log_density = log_normal_density(innovation, covariance)
        return Update(seen, *of_mixture(self.weights, innovation, covariance), log_density)

    def forked(self) -> "Gaussian":
        other = copy.copy(self)
        other.steps = None
        return other

    def moments(self) -> tuple[Array, Array]:
        return of_mixture(self.weights, self.mean, self.covariance)

    def quantiles(self, levels: Array) -> Array:
        return quantiles_of_mixture(self.weights, self.mean, np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2), 0)), levels)

    def data_moments(self, u: Array, t: float, count: int) -> tuple[Array, Array]:
        mean, spread, _, _ = self._seen(u, t)
        return of_mixture(self.weights, mean, symmetric(spread + self.model._data_noise(self.points, count)))


def smooth(steps: "list[Step]", mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Rauch, Tung and Striebel 1965, from the last time back: means (T, b, d) and covariances (T, b, d, d)."""
    means, covariances = [mean], [covariance]
    for step in reversed(steps):
        # a pseudo-inverse, as what is known exactly has no variance
        gain = step.cross @ np.linalg.pinv(step.next_covariance, rcond=1e-13, hermitian=True)
        mean = step.mean + (gain @ (mean - step.next_mean)[..., None])[..., 0]
        covariance = symmetric(step.covariance + gain @ (covariance - step.next_covariance) @ gain.swapaxes(1, 2))
        means.append(mean)
        covariances.append(covariance)
    return np.array(means[::-1]), np.array(covariances[::-1])


def require_width(predicted: Array, data: Array) -> None:
    if predicted.shape[-1] != len(data):
        raise DataError(f"observe gives {predicted.shape[-1]} values, but a datum has {len(data)}")


class Ensemble:
    """Ensemble Kalman filter with perturbed data (Burgers, van Leeuwen and Evensen 1998), datum by datum, tapered in space where asked.

    A square root in its place is better for some ten members, but in nonlinear models worse with hundreds (Anderson 2010).
    `inflation` multiplies deviations from the mean before the data."""

    def __init__(self, model: StepModel, points: Points, members: int, generator: np.random.Generator, inflation: float = 1.0,
                 taper: "Array | None" = None) -> None:
        self.model, self.points, self.generator, self.inflation, self.taper = model, points, generator, inflation, taper
        mean, covariance = model._first(points)
        self.members = mean + self._drawn(members, covariance[0])
        self.weights = np.full(members, 1 / members)
        self._noise: "Array | None" = None

    def _drawn(self, count: int, covariance: Array) -> Array:
        return np.asarray(self.generator.standard_normal((count, len(covariance))) @ root_of(covariance).T)

    def predict(self, u: Array, t: float, dt: float) -> None:
        self.members = self.model._advance(self.members[None], self.points, u, t, dt)[0]
        self._require_states(t + dt)
        added = self.model._added_noise(self.points, dt)
        if added is not None and np.any(added):
            self.members = self.members + self._drawn(len(self.members), added[0])

    def _require_states(self, t: float) -> None:
        require_finite(self.members, t, "step", self.model)

    def noise(self, count: int) -> Array:
        if self._noise is None:
            self._noise = self.model._data_noise(self.points, count)[0]
        return self._noise

    def _observed(self, u: Array, t: float) -> Array:
        seen = self.model._seen(self.members[None], self.points, u, t)[0]
        require_finite(seen[self.weights > 0], t, "observe", self.model)
        return seen

    def update(self, data: Array, u: Array, t: float) -> Update:
        seen = np.flatnonzero(np.isfinite(data))
        predicted = self._observed(u, t)
        require_width(predicted, data)
        noise = self.noise(len(data))[seen[:, None], seen]
        predicted, data = predicted[:, seen], data[seen]
        if not len(seen):
            return Update(seen, np.zeros(0), np.zeros((0, 0)), np.zeros(1))
        mean, spread = self._moments_of(predicted)
        result = Update(seen, data - mean, spread + noise, self._log_density(predicted, data, noise))
        to_independent = np.linalg.inv(np.linalg.cholesky(noise))
        self._correct(predicted @ to_independent.T, to_independent @ data, seen, lambda: self._observed(u, t)[:, seen] @ to_independent.T)
        return result

    def _log_density(self, predicted: Array, data: Array, noise: Array) -> Array:
        """As if the ensemble were Gaussian."""
        mean, spread = self._moments_of(predicted)
        return log_normal_density((data - mean)[None], (spread + noise)[None])

    def _correct(self, predicted: Array, data: Array, places: Indices, predict_again: "Callable[[], Array]") -> None:
        """By data whose noise is N(0, I)."""
        mean, n = self.members.mean(0), len(self.members)
        apart = self.inflation * (self.members - mean)
        self.members = mean + apart
        data_mean = predicted.mean(0)
        predicted = data_mean + self.inflation * (predicted - data_mean)
        for j, value in enumerate(data):
            noise = self.generator.standard_normal(n)
            innovations = value + noise - noise.mean() - predicted[:, j]
            one = predicted[:, j] - predicted[:, j].mean()
            total = one @ one + n - 1
            gain = one @ self.members / total
            self.members = self.members + np.outer(innovations, gain if self.taper is None else gain * self.taper[places[j]])
            predicted = predicted + np.outer(innovations, one @ predicted / total) if self.taper is None else predict_again()

    def _moments_of(self, values: Array) -> tuple[Array, Array]:
        mean = self.weights @ values
        apart = values - mean
        return mean, (self.weights[:, None] * apart).T @ apart / (1 - float(self.weights @ self.weights))

    def forked(self: _Copied) -> _Copied:
        other = copy.copy(self)
        other.generator = copy.deepcopy(self.generator)
        return other

    def moments(self) -> tuple[Array, Array]:
        return self._moments_of(self.members)

    def quantiles(self, levels: Array) -> Array:
        order = np.argsort(self.members, axis=0)
        values = np.take_along_axis(self.members, order, 0)
        cumulative = np.cumsum(self.weights[order], 0) - 0.5 * self.weights[order]
        return np.array([np.interp(levels, cumulative[:, k], values[:, k]) for k in range(values.shape[1])]).T

    def data_moments(self, u: Array, t: float, count: int) -> tuple[Array, Array]:
        mean, spread = self._moments_of(self._observed(u, t))
        return mean, spread + self.noise(count)


class MapEnsemble(Ensemble):
    """Stochastic map filter (Spantini, Baptista and Marzouk 2022): members are moved by maps of the joint ensemble of datum and state."""

    def __init__(self, model: StepModel, points: Points, members: int, generator: np.random.Generator, inflation: float,
                 analysis: MapUpdate) -> None:
        super().__init__(model, points, members, generator, inflation)
        self.analysis = analysis

    def _correct(self, predicted: Array, data: Array, places: Indices, predict_again: "Callable[[], Array]") -> None:
        if self.analysis.taper is not None:
            mean = self.members.mean(0)
            self.members = mean + self.inflation * (self.members - mean)
        for j, value in enumerate(data):
            inflation = self.inflation if self.analysis.taper is None else 1.0
            self.members = self.analysis(self.members, predict_again()[:, j], float(value), int(places[j]), inflation, self.generator)


class Particles(Ensemble):
    """Particle filter with tempering: where a datum leaves too few effective particles its likelihood comes in powers, and after each the
    particles are resampled and moved (Del Moral, Doucet and Jasra 2006; the moves keep the process noise's density: Cotter et al. 2013).

    A member whose model failed has no weight."""

    SHARE = 0.5  # of effective particles that a power of the likelihood may leave
    MOVES = 6

    def __init__(self, model: StepModel, points: Points, members: int, generator: np.random.Generator, jitter: float) -> None:
        super().__init__(model, points, members, generator)
        self.jitter = jitter
        self.failed, self.fewest, self.unmoved = 0, 1.0, False
        mean, covariance = model._first(points)
        self._before, self._root = np.broadcast_to(mean, self.members.shape).copy(), root_of(covariance[0])
        self._chosen = np.zeros((members, self._root.shape[1]))
        self._chosen[:] = np.linalg.lstsq(self._root, (self.members - self._before).T, rcond=None)[0].T
        self._scales = [0.8, 0.5]

    def predict(self, u: Array, t: float, dt: float) -> None:
        x = self.model._advance(self.members[None], self.points, u, t, dt)[0]
        failed = ~np.isfinite(x).all(1) & (self.weights > 0)
        if failed.any():
            self.failed += int(failed.sum())
            self.weights = np.where(failed, 0.0, self.weights)
            if not self.weights.sum() > 0:
                raise NumericalError(f"particle: at time {t + dt:g} the model of every member has failed{self.model._failure()}")
            self.weights /= self.weights.sum()
        lost = ~np.isfinite(x).all(1)
        x[lost] = x[np.flatnonzero(~lost)[0]]  # a finite place without weight
        added = self.model._added_noise(self.points, dt)
        d = x.shape[1]
        self._before, self._root = x, np.zeros((d, d)) if added is None else root_of(added[0])
        self._chosen = self.generator.standard_normal((len(x), d))
        self.members = x + self._chosen @ self._root.T

    def update(self, data: Array, u: Array, t: float) -> Update:
        seen = np.flatnonzero(np.isfinite(data))
        predicted = self._observed(u, t)
        require_width(predicted, data)
        noise = self.noise(len(data))[seen[:, None], seen]
        if not len(seen):
            return Update(seen, np.zeros(0), np.zeros((0, 0)), np.zeros(1))
        mean, spread = self._moments_of(predicted[:, seen])
        precision = np.linalg.inv(noise)
        constant = -0.5 * (np.linalg.slogdet(noise)[1] + len(seen) * _LOG_2_PI)

        def log_likelihood(values: Array) -> Array:
            apart = data[seen] - values[:, seen]
            return np.asarray(constant - 0.5 * np.einsum("ni,ij,nj->n", apart, precision, apart))

        evidence = self._temper(log_likelihood(predicted), log_likelihood, u, t)
        return Update(seen, data[seen] - mean, spread + noise, np.array([evidence]))

    def _temper(self, likelihood: Array, log_likelihood: Callable[[Array], Array], u: Array, t: float) -> float:
        power, evidence = 0.0, 0.0
        while power < 1:
            share = self._share_of(likelihood, power)
            log_weights = np.where(self.weights > 0, np.log(np.where(self.weights > 0, self.weights, 1.0)) + (share - power) * likelihood, -np.inf)
            largest = log_weights.max()
            if not np.isfinite(largest):
                raise NumericalError(f"particle: at time {t:g} no member can explain the datum")
            weights = np.exp(log_weights - largest)
            evidence += largest + math.log(weights.sum())
            self.weights, power = weights / weights.sum(), share
            effective = 1 / (len(weights) * float(self.weights @ self.weights))
            self.fewest = min(self.fewest, effective)
            if power < 1 or effective < self.SHARE:
                self._resample()
                likelihood = self._move(power, log_likelihood, u, t)
        return evidence

    def _share_of(self, likelihood: Array, power: float) -> float:
        """The largest next power that leaves enough effective particles."""
        def effective(share: float) -> float:
            exponent = (share - power) * likelihood
            weights = self.weights * np.exp(exponent - exponent[self.weights > 0].max())
            return float(weights.sum()**2 / (weights @ weights) / len(weights))

        enough = 0.999 * self.SHARE
        if effective(1.0) >= enough or self._moves_nothing():
            return 1.0
        low, high = power, 1.0
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if effective(middle) >= enough else (low, middle)
        return max(low, power + 1e-6) if low < 1 else 1.0

    def _moves_nothing(self) -> bool:
        return self.jitter == 0 and not np.any(self._root)

    def _resample(self) -> None:
        """Systematic: each particle as often as its weight, to within one."""
        n = len(self.weights)
        at = (self.generator.random() + np.arange(n)) / n
        chosen = np.minimum(np.searchsorted(np.cumsum(self.weights), at), n - 1)
        self.members, self._before, self._chosen = self.members[chosen], self._before[chosen], self._chosen[chosen]
        self.weights = np.full(n, 1 / n)

    def _move(self, power: float, log_likelihood: Callable[[Array], Array], u: Array, t: float) -> Array:
        """Of resampled particles, which are many times the same; the likelihood where they are then."""
        likelihood = log_likelihood(self._observed(u, t))
        if self._moves_nothing():
            self.unmoved = True
            return likelihood
        if self.jitter > 0:  # Musso, Oudjane and Le Gland 2001, with the shrinkage that keeps the variance
            mean, covariance = self.moments()
            kept = math.sqrt(1 - min(self.jitter, 1.0)**2)
            self._before = self._before + (mean + kept * (self.members - mean) - self.members) + self.jitter * self._drawn(len(self.members), covariance)
            self.members = self._before + self._chosen @ self._root.T
            likelihood = log_likelihood(self._observed(u, t))
        if np.any(self._root):
            for move in range(self.MOVES):
                proposed, ratio = self._proposed(move % 2 == 0)
                kept_members = self.members
                self.members = self._before + proposed @ self._root.T
                other = log_likelihood(self._observed(u, t))
                accepted = np.log(self.generator.random(len(other))) < power * (other - likelihood) + ratio
                self.members = np.where(accepted[:, None], self.members, kept_members)
                self._chosen, likelihood = np.where(accepted[:, None], proposed, self._chosen), np.where(accepted, other, likelihood)
                scale = self._scales[move % 2] * math.exp(accepted.mean() - 0.3)
                self._scales[move % 2] = float(np.clip(scale, 0.01, 1.0))
        return likelihood

    def _proposed(self, adapted: bool) -> tuple[Array, Array]:
        """Random variables of the step in place of `_chosen`, N(0, I) before the datum, and the logarithm of what the proposal adds to the ratio:
        an autoregression around 0, which keeps N(0, I), or around their mean and with their covariance, which keeps that Gaussian."""
        scale, drawn = self._scales[0 if adapted else 1], self.generator.standard_normal(self._chosen.shape)
        if not adapted:
            return math.sqrt(1 - scale**2) * self._chosen + scale * drawn, np.zeros(len(drawn))
        mean, covariance = self._moments_of(self._chosen)
        root = root_of(covariance + 1e-6 * np.eye(len(mean)))
        scaled = np.linalg.solve(root, (self._chosen - mean).T).T
        moved = math.sqrt(1 - scale**2) * scaled + scale * drawn
        proposed = mean + moved @ root.T
        return proposed, 0.5 * ((moved**2).sum(1) - (scaled**2).sum(1) - (proposed**2).sum(1) + (self._chosen**2).sum(1))
