"""The analysis of the stochastic map filter, for one datum with noise N(0, 1).

Spantini, Baptista and Marzouk 2022, Algorithm 6.1 and Section 6.4: the joint ensemble of the datum y, what it measures without noise, h, and the
state gives a lower-triangular map S, and members go to x with S(y*, x) = S(y_i, x_i). As y depends on the state through h alone, only
the component of h contains y: it is a map of knothe. Those of the states are regressions on h and on the states before them in the order
of their distance from the datum: order 1 linear, order p with p radial functions of each variable besides. They are separable, so that
their fit is linear least squares (knothe.fit_samples, whose terms are products, needs more members and a hundred times the time).
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from knothe import _knothe
from knothe._errors import UsageError
from knothe._values import Array, counted, numbers


class Localisation:
    """How far apart states are, for ensembles that are small against their number: what is far has no influence.

    Parameters
    ----------
    distances : array_like, shape (d, d)
        Between states.
    radius : float
        The ensemble Kalman filter's gain is multiplied by 0.2 at this distance, by 0 at twice it (Gaspari and Cohn 1999, their c); the
        map filter moves the states up to it, each by means of those up to it.
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

    def taper(self) -> Array:
        """Gaspari and Cohn 1999, Eq. 4.10, shape (m, 2, d): between each datum and the states; in the second row the data, at their places."""
        def function(distances: Array) -> Array:
            r = distances / self.radius
            near = 1 - 5 / 3 * r**2 + 5 / 8 * r**3 + r**4 / 2 - r**5 / 4
            with np.errstate(divide="ignore", invalid="ignore"):
                far = 4 - 5 * r + 5 / 3 * r**2 + 5 / 8 * r**3 - r**4 / 2 + r**5 / 12 - 2 / (3 * r)
            return np.asarray(np.where(r <= 1, near, np.where(r < 2, far, 0.0)))

        d, m = len(self.distances), len(self.observed)
        taper = np.zeros((m, 2, max(d, m)))
        taper[:, 0, :d] = function(self.distances[self.observed])
        taper[:, 1, :m] = function(self.distances[np.ix_(self.observed, self.observed)])
        return taper

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
    """The analysis, at an order and with a localisation."""

    def __init__(self, order: int, localisation: "Localisation | None", members: int, dimension: int) -> None:
        self.order, self.localisation, self.size = order, localisation, dimension
        self._neighbours: "Array | None" = None if localisation is None else localisation.distances <= localisation.radius
        used = dimension if self._neighbours is None else int(self._neighbours.sum(1).max())
        needed = 1 + (used + 1) * self._functions
        if members < 2 * needed:
            raise UsageError(f"map: {counted(members, 'member')} for maps of {counted(needed, 'coefficient')}: give {2 * needed} members, a lower order"
                             + ("" if self._neighbours is None else ", or a smaller radius")
                             + (", or a localisation" if self._neighbours is None else ""))

    @property
    def _functions(self) -> int:
        """Of each variable."""
        return 1 if self.order < 2 else 1 + self.order

    def __call__(self, members: Array, seen: Array, datum: float, place: int, inflation: float, generator: np.random.Generator) -> Array:
        """Members after the datum; `seen` is what it measures of each, `place` its number among the data."""
        def inflated(values: Array) -> Array:
            return values.mean(0) + inflation * (values - values.mean(0))

        fitted, fitted_seen = inflated(members), inflated(seen)
        seen_after = self._scalar(fitted_seen, seen, datum, generator)
        order = self._order(fitted, fitted_seen, place)
        # h and the states, or these alone where h is one of them (but for its unit)
        variables, before, known = np.c_[fitted_seen, fitted[:, order]], np.c_[seen, members[:, order]], seen_after
        slope = float(np.cov(before[:, :2].T)[0, 1] / max(seen.var(ddof=1), 1e-300))
        if np.allclose(before[:, 1] - before[:, 1].mean(), slope * (seen - seen.mean()), rtol=0, atol=1e-10 * before[:, 1].std()):
            variables, before, known = variables[:, 1:], before[:, 1:], before[:, 1] + slope * (seen_after - seen)
        bases, n = _Bases.of(variables, self.order), len(members)
        training, functions = bases(variables), bases(before)
        moved, after = functions.copy(), before.copy()
        after[:, 0], moved[:, 0] = known, bases.of_one(known, 0)
        offset = variables.shape[1] - len(order)
        for k in range(1, variables.shape[1]):
            used = np.arange(k)
            if self._neighbours is not None:
                near = self._neighbours[order[k - offset], order[:k - offset]]
                used = np.r_[np.ones(offset, bool), near].nonzero()[0]
            columns = training[:, used].reshape(n, -1)
            coefficients = least_squares(columns - columns.mean(0), variables[:, k] - variables[:, k].mean())
            after[:, k] += (moved[:, used] - functions[:, used]).reshape(n, -1) @ coefficients
            moved[:, k] = bases.of_one(after[:, k], k)
        result = members.copy()
        result[:, order] = after[:, offset:]
        return result

    def _order(self, members: Array, seen: Array, place: int) -> Array:
        """States from the nearest to the datum; those beyond the radius stay as they are."""
        if self.localisation is not None:
            distances = self.localisation.distances[self.localisation.observed[place]]
            order = np.argsort(distances, kind="stable")
            return order[distances[order] <= self.localisation.radius]
        apart, seen_apart = members - members.mean(0), seen - seen.mean()
        norms = np.sqrt((apart**2).sum(0))
        return np.argsort(-np.abs(seen_apart @ apart) / np.where(norms > 0, norms, 1.0), kind="stable")

    def _scalar(self, fitted: Array, seen: Array, datum: float, generator: np.random.Generator) -> Array:
        """h after the datum: S(y*, h') = S(y_i, h_i)."""
        data, n = fitted + generator.standard_normal(len(fitted)), len(seen)
        own = seen + generator.standard_normal(n)
        if self.order < 2:
            variance = fitted.var(ddof=1)
            return np.asarray(seen + variance / (variance + 1) * (datum - own))
        transport = _knothe.map_from_samples(np.ascontiguousarray(np.c_[data, fitted]), 2, self.order, 0, 1)
        reference = transport.inverse(np.ascontiguousarray(np.r_[np.c_[own, seen], [[datum, seen.mean()]]]))
        reference[:-1, 0] = reference[-1, 0]
        return np.asarray(transport.evaluate(np.ascontiguousarray(reference[:-1]))[:, 1])


def least_squares(columns: Array, target: Array) -> Array:
    """By normal equations where these are well conditioned, as they mostly are: a tenth of the time."""
    gram = columns.T @ columns
    shift = 1e-10 * np.trace(gram) / max(len(gram), 1) + 1e-300
    return np.asarray(np.linalg.solve(gram + shift * np.eye(len(gram)), columns.T @ target))
