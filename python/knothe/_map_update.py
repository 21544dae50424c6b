"""The analysis of the stochastic map filter, for one datum with noise N(0, 1).

Spantini, Baptista and Marzouk 2022, Algorithm 6.1 and Section 6.4: the joint ensemble of the datum y, what it measures without noise, h, and the
state gives a lower-triangular map S, and members go to x with S(y*, x) = S(y_i, x_i). As y depends on the state through h alone, only
the component of h contains y: a monotone function of h and a function of y. Those of the states are regressions on h and on the states
before them in the order of their correlation with it: order 1 linear, order p with p radial functions of each variable besides. With a
localisation they are regressions on h alone, tapered: the states before would be coefficients by the dozen, more than a hundred members bear.

The components are separable, so that their fit is linear least squares, and have linear tails. Those of knothe.fit_samples are polynomials with
products of the variables: on Lorenz's model of 1963 they need 500 members where these do with 200, and carry single members so far out
that the model overflows.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from knothe._errors import UsageError
from knothe._values import Array, counted, numbers


class Localisation:
    """How far apart states are, for ensembles that are small against their number: what is far has no influence.

    Parameters
    ----------
    distances : array_like, shape (d, d)
        Between states.
    radius : float
        What a datum does to a state is multiplied by 0.2 at this distance, by 0 from twice it on (Gaspari and Cohn 1999, their c).
    observed : sequence of m int
        For each datum the state that it is at.

    Raises
    ------
    UsageError
        No such states, or no distances.

    Examples
    --------
    >>> near = knothe.states.Localisation.ring(40, 4.0, range(0, 40, 2))
    >>> float(near.distances[0, 38])
    2.0
    """

    def __init__(self, distances: ArrayLike, radius: float, observed: ArrayLike) -> None:
        self.distances = numbers(distances, "distances")
        self.radius = float(radius)
        self.observed = np.asarray(list(observed) if isinstance(observed, range) else observed, np.int64).ravel()
        d = len(self.distances)
        if self.distances.shape != (d, d) or not np.all(self.distances >= 0):
            raise UsageError(f"Localisation: distances of shape {self.distances.shape}: give d x d numbers, none negative")
        if not self.radius > 0:
            raise UsageError(f"Localisation: a radius of {radius!r}: it must be > 0")
        if len(self.observed) and not (0 <= self.observed.min() and self.observed.max() < d):
            raise UsageError(f"Localisation: a datum at state {self.observed.max()}: there are states 0 to {d - 1}")

    @classmethod
    def ring(cls, states: int, radius: float, observed: ArrayLike) -> "Localisation":
        """States around a circle, one apart.

        Parameters
        ----------
        states : int
        radius : float
        observed : sequence of int

        Returns
        -------
        Localisation

        Examples
        --------
        >>> knothe.states.Localisation.ring(4, 1.0, [0]).distances[0]
        array([0., 1., 2., 1.])
        """
        apart = np.abs(np.subtract.outer(np.arange(states), np.arange(states)))
        return cls(np.minimum(apart, states - apart), radius, observed)

    def _taper(self) -> Array:
        """Gaspari and Cohn 1999, Eq. 4.10, between each datum and the states: shape (m, d)."""
        def function(distances: Array) -> Array:
            r = distances / self.radius
            near = 1 - 5 / 3 * r**2 + 5 / 8 * r**3 + r**4 / 2 - r**5 / 4
            with np.errstate(divide="ignore", invalid="ignore"):
                far = 4 - 5 * r + 5 / 3 * r**2 + 5 / 8 * r**3 - r**4 / 2 + r**5 / 12 - 2 / (3 * r)
            return np.asarray(np.where(r <= 1, near, np.where(r < 2, far, 0.0)))

        return function(self.distances[self.observed])

    def __repr__(self) -> str:
        return f"<Localisation: {counted(len(self.distances), 'state')}, radius {self.radius:g}>"


@dataclass
class _Bases:
    """Functions of variables (columns): each itself, standardised, and `order` radial functions between its quantiles."""

    centre: Array
    scale: Array
    nodes: Array  # radial functions x variables
    widths: Array

    @classmethod
    def of(cls, values: Array, order: int) -> "_Bases":
        centre, scale = values.mean(0), values.std(0)
        scale = np.where(scale > 0, scale, 1.0)
        if order < 2:
            return cls(centre, scale, np.zeros((0, values.shape[1])), np.zeros((0, values.shape[1])))
        nodes = np.quantile((values - centre) / scale, (np.arange(order) + 1.0) / (order + 1), axis=0)
        gaps = np.diff(nodes, axis=0)
        widths = np.concatenate([gaps[:1], 0.5 * (gaps[1:] + gaps[:-1]), gaps[-1:]])
        return cls(centre, scale, nodes, np.maximum(2 * widths, 1e-3))

    def __call__(self, values: Array) -> Array:
        """(n, variables, 1 + order)"""
        return np.stack([self.of_one(values[:, k], k) for k in range(values.shape[1])], 1)

    def of_one(self, values: Array, k: int) -> Array:
        """Of variable k: (n, 1 + order)"""
        z = ((values - self.centre[k]) / self.scale[k])[:, None]
        return np.hstack([z, np.exp(-0.5 * ((z - self.nodes[:, k]) / self.widths[:, k])**2)])


class MapUpdate:
    """The analysis, at an order; with a taper for each datum, or none."""

    def __init__(self, order: int, taper: "Array | None", members: int, dimension: int) -> None:
        self.order, self.taper = order, taper
        needed = 2 * (1 + (1 if order < 2 else 1 + order) * (1 if taper is not None else dimension))
        if members < needed:
            raise UsageError(f"map: {counted(members, 'member')} for maps of order {order} and {counted(dimension, 'state')}: give {needed} members, a "
                             "lower order, or a localisation")

    def __call__(self, members: Array, seen: Array, datum: float, place: int, inflation: float, generator: np.random.Generator) -> Array:
        """Members after the datum; `seen` is what it measures of each, `place` its number among the data. The maps are fitted to members that are
        inflated."""
        fitted, fitted_seen = (values.mean(0) + inflation * (values - values.mean(0)) for values in (members, seen))
        seen_after = self._scalar(fitted_seen, seen, datum, generator)
        if self.taper is not None:
            bases = _Bases.of(fitted_seen[:, None], self.order)
            training = bases.of_one(fitted_seen, 0)
            coefficients = least_squares(training - training.mean(0), fitted - fitted.mean(0))
            return np.asarray(members + (bases.of_one(seen_after, 0) - bases.of_one(seen, 0)) @ coefficients * self.taper[place])
        order = self._order(fitted, fitted_seen)
        # h and the states, or these alone where h is one of them (but for its unit)
        variables, before, known = np.c_[fitted_seen, fitted[:, order]], np.c_[seen, members[:, order]], seen_after
        slope = float(np.cov(before[:, :2].T)[0, 1] / max(seen.var(ddof=1), 1e-300))
        if np.allclose(before[:, 1] - before[:, 1].mean(), slope * (seen - seen.mean()), rtol=0, atol=1e-10 * before[:, 1].std()):
            variables, before, known = variables[:, 1:], before[:, 1:], before[:, 1] + slope * (seen_after - seen)
        bases, n = _Bases.of(variables, self.order), len(members)
        training, functions = bases(variables), bases(before)
        moved, after = functions.copy(), before.copy()
        after[:, 0], moved[:, 0] = known, bases.of_one(known, 0)
        for k in range(1, variables.shape[1]):
            columns = training[:, :k].reshape(n, -1)
            coefficients = least_squares(columns - columns.mean(0), variables[:, k] - variables[:, k].mean())
            after[:, k] += (moved[:, :k] - functions[:, :k]).reshape(n, -1) @ coefficients
            moved[:, k] = bases.of_one(after[:, k], k)
        result = members.copy()
        result[:, order] = after[:, variables.shape[1] - len(order):]
        return result

    @staticmethod
    def _order(members: Array, seen: Array) -> Array:
        """States from the one that varies most with the datum to the one that varies least."""
        apart, seen_apart = members - members.mean(0), seen - seen.mean()
        norms = np.sqrt((apart**2).sum(0))
        return np.asarray(np.argsort(-np.abs(seen_apart @ apart) / np.where(norms > 0, norms, 1.0), kind="stable"))

    def _scalar(self, fitted: Array, seen: Array, datum: float, generator: np.random.Generator) -> Array:
        """h after the datum: S(y*, h') = S(y_i, h_i)."""
        noise = generator.standard_normal(len(seen))
        data = (fitted + noise - noise.mean())[:, None]
        own = (seen + (data[:, 0] - fitted if self.taper is not None else generator.standard_normal(len(seen))))[:, None]
        if self.order < 2:
            variance = fitted.var(ddof=1)
            return np.asarray(seen + variance / (variance + 1) * (datum - own[:, 0]))
        bases, monotone = _Bases.of(data, self.order), _Monotone.of(fitted, self.order)
        columns = bases.of_one(data[:, 0], 0)
        columns = columns - columns.mean(0)
        values, slopes = monotone(fitted)
        values = values - values.mean(0)
        # S = f(h) - u(y), u the regression of f on the functions of y whatever f is
        by_data = least_squares(columns, values)
        rest = values - columns @ by_data
        weights = most_likely(rest.T @ rest / len(rest), slopes)
        shift = (bases.of_one(np.array([datum]), 0) - bases.of_one(own[:, 0], 0)) @ (by_data @ weights)
        return monotone.inverse(weights, monotone(seen)[0] @ weights + shift, seen)


@dataclass
class _Monotone:
    """Rising functions of one variable: a linear tail to either side, and sigmoids between. With tails that are linear a member far out stays as far
    out as it was; the polynomials of knothe.fit_samples carry it away, and a model that steps may not survive that."""

    centre: float
    scale: float
    nodes: Array
    widths: Array

    @classmethod
    def of(cls, values: Array, order: int) -> "_Monotone":
        centre, scale = float(values.mean()), float(values.std()) or 1.0
        nodes = np.quantile((values - centre) / scale, (np.arange(order + 1) + 0.5) / (order + 1))
        gaps = np.diff(nodes)
        widths = np.r_[gaps[:1], 0.5 * (gaps[1:] + gaps[:-1]), gaps[-1:]]
        return cls(centre, scale, nodes, np.maximum(0.6 * widths, 1e-3))

    def __call__(self, values: Array) -> tuple[Array, Array]:
        """Functions and their derivatives, shape (n, order + 1) each."""
        t = ((values - self.centre) / self.scale)[:, None] / self.widths - self.nodes / self.widths
        rising = 0.5 + 0.5 * np.tanh(0.5 * t)
        functions, slopes = rising.copy(), rising * (1 - rising) / self.widths
        functions[:, 0], slopes[:, 0] = -self.widths[0] * np.logaddexp(0.0, -t[:, 0]), 1 - rising[:, 0]
        functions[:, -1], slopes[:, -1] = self.widths[-1] * np.logaddexp(0.0, t[:, -1]), rising[:, -1]
        return functions, slopes / self.scale

    def inverse(self, weights: Array, targets: Array, near: Array) -> Array:
        """Where the weighted sum has these values: from a table between bounds, then Newton's method."""
        spread = float(near.std()) or 1.0
        low, high = float(near.min()) - 3 * spread, float(near.max()) + 3 * spread
        for _ in range(60):
            ends = self(np.array([low, high]))[0] @ weights
            if ends[0] <= targets.min() and targets.max() <= ends[1]:
                break
            low, high = low - 2 * (high - low), high + 2 * (high - low)
        table = np.linspace(low, high, 400)
        found: Array = np.interp(targets, self(table)[0] @ weights, table)
        for _ in range(3):
            functions, slopes = self(found)
            found = found - np.clip((functions @ weights - targets) / (slopes @ weights), -spread, spread)
        return found


def most_likely(gram: Array, slopes: Array) -> Array:
    """Weights w >= 0 that minimise w gram w / 2 - mean log(slopes w), a convex problem (Spantini et al. 2022, Eq. SM1): projected Newton."""
    least = 1e-8
    weights = np.ones(len(gram))
    weights /= np.sqrt(weights @ gram @ weights)

    def objective(w: Array) -> float:
        return float(0.5 * w @ gram @ w - np.log(slopes @ w).mean())

    value = objective(weights)
    for _ in range(50):
        ratios = slopes / (slopes @ weights)[:, None]
        gradient = gram @ weights - ratios.mean(0)
        free = (weights > least) | (gradient < 0)
        step = np.zeros_like(weights)
        hessian = gram + ratios.T @ ratios / len(ratios)
        step[free] = np.linalg.solve(hessian[np.ix_(free, free)], -gradient[free])
        if -(gradient @ step) < 1e-10:
            break
        length = 1.0
        while length > 1e-8:
            tried = np.maximum(weights + length * step, least)
            if objective(tried) <= value + 1e-4 * float(gradient @ (tried - weights)):
                break
            length *= 0.5
        weights, value = tried, objective(tried)
    return weights


def least_squares(columns: Array, target: Array) -> Array:
    """By normal equations, slightly regularised: columns may follow from each other."""
    gram = columns.T @ columns
    shift = 1e-10 * np.trace(gram) / max(len(gram), 1) + 1e-300
    return np.asarray(np.linalg.solve(gram + shift * np.eye(len(gram)), columns.T @ target))
