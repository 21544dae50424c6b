"""Transport maps."""
from __future__ import annotations

import ctypes
import os
import pathlib
import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from knothe import _knothe
from knothe._errors import UsageError, warned
from knothe._posterior import Posterior
from knothe._values import Array, OfNative, Seed, count_of, numbers, points_of, seconds_of, seed_of

_COMPILED: Any = ctypes.CFUNCTYPE(None).__base__  # the class of all functions of ctypes


class TransportMap(OfNative):
    """A distribution as an invertible function T of a standard normal variable: T(x), x ~ N(0, I).

    From `fit`, `fit_samples` or `TransportMap.load`.

    Attributes
    ----------
    dimension : int
    trusted : bool
        Its computation ended as it should: from samples, every fit converged; of a density, as of its `Fit`. `save`
        keeps it; true for a file of ``knothe infer``, whose results say it.
    remark : str
        Why it is not trusted, or the tolerance not reached; else empty.

    Examples
    --------
    >>> transport = knothe.fit(lambda p: -0.5 * p @ p, dimension=2).map
    >>> x = np.array([[0.3, -1.2], [1.5, 0.4]])
    >>> bool(np.allclose(transport.inverse(transport(x)), x))
    True
    """

    def __init__(self, native: _knothe.TransportMap) -> None:
        self._native = native
        self.dimension: int = native.dimension
        self.trusted: bool = native.trusted
        self.remark: str = native.remark

    def __reduce__(self) -> tuple[Any, ...]:
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "map.h5"
            self.save(file)
            return _map_of_bytes, (file.read_bytes(),)

    def __call__(self, reference: ArrayLike) -> Array:
        """T(x) at points of the reference.

        Parameters
        ----------
        reference : array_like, shape (n, d) or (d,)
            x, dimensionless.

        Returns
        -------
        ndarray, shape (n, d)
            T(x), in the units of the mapped variables.

        Raises
        ------
        UsageError
            The points do not have d coordinates.

        Examples
        --------
        >>> transport = knothe.fit(lambda p: -0.5 * ((p[0] - 3) / 2) ** 2, dimension=1).map
        >>> transport([[0.0], [1.0]]).round(3)
        array([[3.],
               [5.]])
        """
        return self._native.evaluate(points_of(reference, self.dimension, "points of the reference"))

    def inverse(self, points: ArrayLike) -> Array:
        """Points of the reference for points z of the distribution.

        Parameters
        ----------
        points : array_like, shape (n, d) or (d,)
            z, in the units of the mapped variables.

        Returns
        -------
        ndarray, shape (n, d)
            T⁻¹(z), dimensionless.

        Examples
        --------
        >>> transport = knothe.fit(lambda p: -0.125 * p @ p, dimension=2).map  # N(0, 2²)
        >>> transport.inverse([[2.0, 4.0]]).round(6)
        array([[1., 2.]])
        """
        return self._native.inverse(points_of(points, self.dimension, "points"))

    def log_density(self, points: ArrayLike) -> Array:
        """Logarithm of the density of T(x).

        Parameters
        ----------
        points : array_like, shape (n, d) or (d,)
            z.

        Returns
        -------
        ndarray, shape (n,)
            Natural logarithm of the density at z, which is normalised to 1.

        Examples
        --------
        >>> transport = knothe.fit(lambda p: -0.5 * p @ p, dimension=2).map
        >>> transport.log_density([[0.0, 0.0]]).round(6)
        array([-1.837877])
        """
        return self._native.log_density(points_of(points, self.dimension, "points"))

    def sample(self, count: int, seed: Seed = 1) -> Array:
        """Independent draws of the distribution.

        Parameters
        ----------
        count : int
            Number of draws.
        seed : int or numpy.random.Generator
            Of the random numbers.

        Returns
        -------
        ndarray, shape (count, d)

        Examples
        --------
        >>> knothe.fit(lambda p: -0.5 * p @ p, dimension=2).map.sample(100).shape
        (100, 2)
        """
        return self._native.sample(count_of(count, "draws"), seed_of(seed))

    def condition(self, given: ArrayLike, count: int, seed: Seed = 1) -> Array:
        """Draws of all coordinates with the first ones equal to `given`.

        For a map of samples of (data, parameters) these are samples of the posterior of the parameters, without a likelihood.

        Parameters
        ----------
        given : array_like, shape (m,)
            Values of the first m coordinates.
        count : int
            Number of draws.
        seed : int or numpy.random.Generator
            Of the random numbers.

        Returns
        -------
        ndarray, shape (count, d)
            The first m columns are `given`.

        Raises
        ------
        UsageError
            The map is not triangular (`fit` with ``triangular=True``), or `given` has more than d values.

        Examples
        --------
        >>> draws = np.random.default_rng(1).standard_normal((2000, 2))
        >>> draws[:, 1] += draws[:, 0]
        >>> posterior = knothe.fit_samples(draws).condition([1.0], 4000)
        >>> bool(abs(posterior[:, 1].mean() - 1.0) < 0.1)
        True
        """
        return self._native.conditional_sample(numbers(given, "given").ravel(), count_of(count, "draws"),
                                               seed_of(seed))

    def save(self, path: "str | os.PathLike[str]") -> None:
        """Writes the map to a file (HDF5), whole or not at all; folders that are missing are made.

        Parameters
        ----------
        path : path

        Raises
        ------
        IoError
            The file cannot be written.

        Examples
        --------
        >>> knothe.fit(lambda p: -0.5 * p @ p, dimension=2).map.save("gaussian.h5")
        >>> knothe.TransportMap.load("gaussian.h5").dimension
        2
        """
        self._native.save(os.fspath(path))

    @classmethod
    def load(cls, path: "str | os.PathLike[str]") -> "TransportMap":
        """Reads a map from a file of `save`, bit-identical.

        Parameters
        ----------
        path : path

        Returns
        -------
        TransportMap

        Raises
        ------
        DataError
            The file is missing, damaged, or of another kind.

        Examples
        --------
        >>> transport = knothe.fit(lambda p: -0.5 * p @ p, dimension=1).map
        >>> transport.save("map.h5")
        >>> bool(np.all(knothe.TransportMap.load("map.h5").sample(5) == transport.sample(5)))
        True
        """
        return warned(cls(_knothe.TransportMap.load(os.fspath(path))))

    def __repr__(self) -> str:
        return f"<TransportMap of dimension {self.dimension}: {self._native.describe()}>"


def _map_of_bytes(content: bytes) -> TransportMap:
    """Of a file of `TransportMap.save`."""
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "map.h5"
        file.write_bytes(content)
        return TransportMap(_knothe.TransportMap.load(str(file)))


class Fit(Posterior):
    """The result of `fit`: a `Posterior` with further attributes.

    Attributes
    ----------
    map : TransportMap

    Examples
    --------
    >>> knothe.fit(lambda p: -0.5 * p @ p, dimension=1).trusted
    True
    """

    def __init__(self, native: _knothe.TransportMap, found: dict[str, Any]) -> None:
        points, weights = found.pop("points"), found.pop("weights")
        found["quantiles"] = {"levels": found.pop("levels"), "values": found.pop("quantiles")}
        super().__init__(found, [f"p{k}" for k in range(points.shape[1])], points, weights)
        self.map = TransportMap(native)


def _address(function: Any, what: str, result: Any, arguments: int) -> int:
    """Of a compiled function, whose declared types are those that `fit` calls it with."""
    if not isinstance(function, _COMPILED):
        raise UsageError(f"fit: {what} is a function of Python and log_density compiled: give two of a kind")
    declared = function.argtypes
    if function.restype is not result or declared is not None and len(declared) != arguments:
        said = "double f(const double *p, size_t d)" if arguments == 2 else "void f(const double *p, size_t d, double *gradient)"
        raise UsageError(f"fit: the compiled {what} has to be {said}: set its restype and argtypes so")
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def fit(log_density: Callable[[Array], float], dimension: int, *, gradient: Callable[[Array], ArrayLike] | None = None,
        tolerance: float = 1e-3, max_order: int = 8, seed: Seed = 1, standardised: bool = True, triangular: bool = False,
        evaluations: int = 0, seconds: float = 0.0) -> Fit:
    """A transport map of a density, and what follows from it.

    Finds the mode, then maps of rising order until one is good on points that it was not trained on, then weights.
    If no map is accurate enough and a gradient exists, the solver samples a few variables and treats the others as Gaussian
    given those (hierarchical models, tens of variables); `remark` then says so. Give a low `max_order` there, a larger
    budget, and compiled functions: it takes two gradients for each variable at some 60,000 points. Where the budget ends
    before a map is trusted, the answer is that of the best map so far, or of weighted draws.

    Parameters
    ----------
    log_density : callable
        The logarithm of the density at a point, shape (d,), up to a constant; ``-inf`` where the density is zero.
        Or a compiled function by `ctypes` (or `numba.cfunc(...).ctypes`), ``double f(const double *p, size_t d)``.
    dimension : int
        d.
    gradient : callable, optional
        Its gradient, shape (d,); without it the solver uses finite differences, two (d = 2) to ten times (d = 5) as many
        evaluations. Compiled: ``void f(const double *p, size_t d, double *gradient)``.
    tolerance : float
        On the variance diagnostic.
    max_order : int
        Of the polynomials, 1 to 23; along single variables that need it the map may be longer.
    seed : int or numpy.random.Generator
    standardised : bool
        The density is roughly that of N(0, I), or within some units of it; if false, nothing is assumed about its scale.
    triangular : bool
        The map is triangular in the given order of the variables, as `TransportMap.condition` needs it.
    evaluations : int
        Budget: points at which `log_density` and, each counting four times, `gradient` are asked. 0: 100,000. With a larger
        one, which `remark` then names, the same call goes on.
    seconds : float
        Time limit, kept like `evaluations`; 0: none.

    Returns
    -------
    Fit
        ``record["model_evaluations"]``: what was spent.

    Raises
    ------
    UsageError
        The gradient is not that of `log_density` (checked if `standardised`), or a compiled function has another signature.
    NumericalError
        The log-density is NaN or plus infinity somewhere, or the density is zero wherever it was tried, or the budget or the time
        was too small for any answer.

    Examples
    --------
    A bent ridge, x ~ N(0, 1) and y ~ N(x²/2, 0.5²) given x, not normalised:

    >>> def log_density(p):
    ...     return -0.5 * (p[0] ** 2 + ((p[1] - 0.5 * p[0] ** 2) / 0.5) ** 2)
    >>> def gradient(p):
    ...     r = (p[1] - 0.5 * p[0] ** 2) / 0.25
    ...     return [-p[0] + r * p[0], -r]
    >>> found = knothe.fit(log_density, 2, gradient=gradient)
    >>> found.trusted, bool(abs(found.log_evidence - np.log(np.pi)) < 2e-3)
    (True, True)
    """
    if isinstance(dimension, bool) or not isinstance(dimension, (int, np.integer)) or dimension < 1:
        raise UsageError(f"dimension {dimension!r}: a density has at least one variable")
    options = (tolerance, max_order, seed_of(seed), standardised, triangular, count_of(evaluations, "evaluations as budget"),
               seconds_of(seconds))
    if isinstance(log_density, _COMPILED):
        slope = 0 if gradient is None else _address(gradient, "gradient", None, 3)
        native, found = _knothe.solve_compiled(dimension, _address(log_density, "log_density", ctypes.c_double, 2), slope, *options)
    elif isinstance(gradient, _COMPILED):
        raise UsageError("fit: log_density is a function of Python and the gradient compiled: give two of a kind")
    else:
        native, found = _knothe.solve_map(dimension, log_density, gradient, *options)
    return warned(Fit(native, found))


def fit_samples(samples: ArrayLike, *, max_order: int = 5, folds: int = 5, seed: Seed = 1) -> TransportMap:
    """A transport map of samples, by maximum likelihood, component by component.

    Parameters
    ----------
    samples : array_like, shape (m, d)
        What will be given to `TransportMap.condition` comes first.
    max_order : int
        Of each component; cross-validation chooses below that.
    folds : int
        Of the cross-validation; 0: every component gets `max_order`.
    seed : int or numpy.random.Generator
        Shuffles samples into folds.

    Returns
    -------
    TransportMap

    Raises
    ------
    DataError
        A sample is not finite, a coordinate is the same in all samples, or there are too few of them.
    UsageError
        Fewer than two samples, or orders or folds that are not possible.

    Examples
    --------
    >>> draws = np.random.default_rng(1).standard_normal((1000, 2))
    >>> transport = knothe.fit_samples(draws)
    >>> transport.dimension, transport.trusted
    (2, True)
    """
    points = numbers(samples, "samples")
    if points.ndim != 2:
        raise UsageError(f"fit_samples: an array of shape {points.shape} is not m samples of d coordinates")
    return warned(TransportMap(_knothe.map_from_samples(points, points.shape[1], max_order, folds, seed_of(seed))))
