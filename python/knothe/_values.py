"""Plain values that go in: priors, sensors, noise."""
from __future__ import annotations

import copy
import os
from dataclasses import astuple, dataclass, fields
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, TypeVar, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knothe._errors import UsageError

Array = NDArray[np.float64]
Seed = Union[int, np.random.Generator]
_COMPONENTS = {"x": 0, "y": 1, "z": 2}


def _require(holds: bool, prior: object, rule: str) -> None:
    if not holds:
        raise UsageError(f"{prior!r}: {rule}")


class ByValue:
    """Equality of a dataclass that holds arrays: of the type and of every field; a missing value (NaN) equals another."""

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        names = [field.name for field in fields(self)]  # type: ignore[arg-type]
        return all(_same(getattr(self, name), getattr(other, name)) for name in names)


_Copied = TypeVar("_Copied", bound="OfNative")


class OfNative:
    """What stands on an object of the module that never changes, `_native`: copies share it, and each class says how it is pickled."""

    _native: Any

    def __copy__(self: _Copied) -> _Copied:
        return self.__deepcopy__({})

    def __deepcopy__(self: _Copied, memo: dict[int, Any]) -> _Copied:
        made = type(self).__new__(type(self))
        made.__dict__ = {name: value if name == "_native" else copy.deepcopy(value, memo) for name, value in self.__dict__.items()}
        return made


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.shape(one) == np.shape(other) and bool(np.all((one == other) | ((one != one) & (other != other))))
    return bool(one == other)


class Prior:
    """What is known of a parameter before the data: the type of `Normal`, `Uniform`, `Lognormal` and `PosteriorOf`.

    Examples
    --------
    >>> priors: dict[str, knothe.Prior] = {"E": knothe.Normal(1, 0.3), "F": knothe.Uniform(0.5, 1.5)}
    """

    _family: ClassVar[str]


@dataclass(frozen=True)
class Normal(Prior):
    """Normal prior N(mean, std²). For a reduced model it is truncated to the model's box and renormalised.

    Parameters
    ----------
    mean, std : float
        In the parameter's unit.

    Examples
    --------
    >>> knothe.Normal(0.9, 0.45)
    Normal(mean=0.9, std=0.45)
    """

    _family = "normal"
    mean: float
    std: float

    def __post_init__(self) -> None:
        _require(np.isfinite(self.mean) and 0 < self.std < np.inf, self, "the mean must be finite, the std > 0")


@dataclass(frozen=True)
class Uniform(Prior):
    """Uniform prior between two bounds.

    Parameters
    ----------
    lower, upper : float
        In the parameter's unit.

    Examples
    --------
    >>> knothe.Uniform(0.5, 1.5)
    Uniform(lower=0.5, upper=1.5)
    """

    _family = "uniform"
    lower: float
    upper: float

    def __post_init__(self) -> None:
        _require(-np.inf < self.lower < self.upper < np.inf, self, "the bounds are finite, the lower one below the upper one")


@dataclass(frozen=True)
class Lognormal(Prior):
    """Prior of a positive parameter whose logarithm is N(mu, sigma²).

    Parameters
    ----------
    mu, sigma : float
        Mean and standard deviation of the natural logarithm.

    Examples
    --------
    >>> knothe.Lognormal(0.0, 0.25)
    Lognormal(mu=0.0, sigma=0.25)
    """

    _family = "lognormal"
    mu: float
    sigma: float

    def __post_init__(self) -> None:
        _require(np.isfinite(self.mu) and 0 < self.sigma < np.inf, self, "mu must be finite, sigma > 0")


@dataclass(frozen=True)
class PosteriorOf(Prior):
    """The posterior of an earlier test, or the next specimen of a `population`, as a prior. Parameters of one folder keep their
    correlations and the shape of their posterior.

    Parameters
    ----------
    results : path
        Folder of results.
    name : str, optional
        Of the parameter in these results; without it, the same.

    Examples
    --------
    >>> knothe.PosteriorOf("results", name="E")
    PosteriorOf(results='results', name='E')
    """

    _family = "posterior"
    results: "str | os.PathLike[str]"
    name: str = ""


def prior_values(parameters: Mapping[str, Prior]) -> list[tuple[str, str, float, float, str, str]]:
    """In the form that the module needs; the order is that of the mapping."""
    values = []
    for name, prior in parameters.items():
        if isinstance(prior, PosteriorOf):
            values.append((name, prior._family, 0.0, 1.0, os.fspath(prior.results), prior.name))
            continue
        if not isinstance(prior, (Normal, Uniform, Lognormal)):
            raise UsageError(f"prior of {name}: {prior!r} is not knothe.Normal, knothe.Uniform, knothe.Lognormal or "
                             "knothe.PosteriorOf")
        first, second = astuple(prior)
        values.append((name, prior._family, float(first), float(second), "", ""))
    return values


def log_prior(priors: Mapping[str, Prior], points: Array) -> Array:
    """Of points (n, d), normalised."""
    total: Array = np.zeros(len(points))
    with np.errstate(divide="ignore", invalid="ignore"):
        for prior, x in zip(priors.values(), points.T):
            if isinstance(prior, Normal):
                total += -0.5 * ((x - prior.mean) / prior.std)**2 - np.log(prior.std * np.sqrt(2 * np.pi))
            elif isinstance(prior, Lognormal):
                inside = -0.5 * ((np.log(x) - prior.mu) / prior.sigma)**2 - np.log(x * prior.sigma * np.sqrt(2 * np.pi))
                total += np.where(x > 0, inside, -np.inf)
            elif isinstance(prior, Uniform):
                total += np.where((prior.lower <= x) & (x <= prior.upper), -np.log(prior.upper - prior.lower), -np.inf)
            else:
                raise UsageError(f"parameters: {prior!r}: give knothe.Normal, knothe.Uniform or knothe.Lognormal")
    return total


def _require_numbers(points: object) -> None:
    """No names where places are meant."""
    if points is not None and np.asarray(points).dtype.kind in "US":
        raise UsageError(f"Sensors: {points!r} are no points; names of outputs or quantities are given as series=[...]")


class Sensors:
    """What is measured: displacements at points, then series by name.

    Parameters
    ----------
    points : array_like, shape (n, 3), optional
        Places where displacements are measured, m.
    components : sequence of n
        Direction of each: ``"x"``, ``"y"``, ``"z"`` or 0, 1, 2; one alone stands for all.
    series : sequence of str
        Outputs or quantities of the model: a reaction force, a temperature.

    Examples
    --------
    >>> sensors = knothe.Sensors([[0.5, 0.0, 0.0], [1.0, 0.0, 0.0]], "y")
    >>> len(sensors), sensors.components
    (2, [1, 1])
    >>> len(knothe.Sensors(series=["reaction_force"]))
    1
    """

    def __init__(self, points: ArrayLike | None = None, components: str | int | Sequence[str | int] = "y", *,
                 series: Sequence[str] = ()) -> None:
        if isinstance(series, str):
            raise UsageError(f"Sensors: series={series!r}: give a list of names")
        self.series: list[str] = [str(name) for name in series or ()]
        if points is None and not self.series:
            raise UsageError("Sensors: give points, or series, names of outputs or quantities of the model")
        if len(set(self.series)) < len(self.series):
            raise UsageError(f"Sensors: a series is named twice in {self.series}")
        _require_numbers(points)
        self.points: Array = np.zeros((0, 3)) if points is None else points_of(points, 3, "sensors")
        given: list[str | int]
        if isinstance(components, (str, int, np.integer)) and components not in ("xy", "xyz"):
            given = [components] * len(self.points)
        else:
            given = list(components)  # type: ignore[arg-type]
        try:
            self.components: list[int] = [_COMPONENTS[c] if isinstance(c, str) else int(c) for c in given]
        except KeyError as error:
            raise UsageError(f"component {error}: give \"x\", \"y\", \"z\" or 0, 1, 2") from None
        if len(self.components) != len(self.points):
            raise UsageError(f"{counted(len(self.points), 'place')} of sensors with {counted(len(self.components), 'component')}: "
                             "give one for each")

    def __len__(self) -> int:
        return len(self.components) + len(self.series)

    def __repr__(self) -> str:
        series = f", series {', '.join(self.series)}" if self.series else ""
        return f"<Sensors: {counted(len(self.components), 'displacement')}{series}>"


@dataclass(frozen=True, eq=False)
class Axis(ByValue):
    """A parameter of `offline`: the nodes of its grid, and what they mean.

    Parameters
    ----------
    nodes : array_like
        Strictly increasing; the function is called with them.
    units : str
        Of the parameter, or of its reference.
    reference : float
        The physical value of 1, in `units`; then the nodes are multiples of it.

    Examples
    --------
    >>> stiffness = knothe.Axis(np.linspace(0.8, 1.2, 5), units="N/m", reference=2e4)
    """

    nodes: ArrayLike
    units: str = "1"
    reference: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", numbers(self.nodes, "nodes of an axis"))
        _require(np.isfinite(self.reference) and self.reference != 0, self, "the reference must be finite and not 0")

    def _labels(self, name: str) -> tuple[str, list[float], str, str, float]:
        """In the form that the module needs."""
        nodes = [float(node) for node in np.asarray(self.nodes)]
        if self.reference == 1:
            return name, nodes, self.units, name, 1.0
        return name, nodes, "1", f"{name}, multiple of its reference [{self.units}]", float(self.reference)


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Precision(ByValue):
    """Inverse covariance of correlated noise, n x n, both triangles: compressed sparse rows, as in `scipy.sparse.csr_matrix`.

    Parameters
    ----------
    data : array_like or matrix
        Entries, 1/m² for displacements in m. Or the whole matrix, n x n: a sparse one of scipy, or an array; then
    indices, indptr : array_like, optional
        are left out: the columns of the entries, and where each row begins (n + 1).

    Raises
    ------
    UsageError
        The matrix is not square, or one of the three arrays is missing or masked.

    Examples
    --------
    >>> knothe.Precision([4.0, 4.0], [0, 1], [0, 1, 2]).toarray()
    array([[4., 0.],
           [0., 4.]])
    >>> knothe.Precision(np.diag([4.0, 4.0])) == knothe.Precision([4.0, 4.0], [0, 1], [0, 1, 2])
    True
    """

    data: Array
    indices: NDArray[np.int64]
    indptr: NDArray[np.int64]

    def __init__(self, data: Any, indices: ArrayLike | None = None, indptr: ArrayLike | None = None) -> None:
        if indices is None and indptr is None:
            data, indices, indptr = _rows_of(data)
        if indices is None or indptr is None:
            raise UsageError("Precision: give data, indices and indptr, or a matrix alone")
        object.__setattr__(self, "data", numbers(data, "precision"))
        object.__setattr__(self, "indices", np.asarray(indices, np.int64))
        object.__setattr__(self, "indptr", np.asarray(indptr, np.int64))

    def rows(self) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
        """`data`, `indices` and `indptr`.

        Returns
        -------
        data : ndarray, shape (entries,)
        indices : ndarray of int64, shape (entries,)
        indptr : ndarray of int64, shape (n + 1,)

        Examples
        --------
        >>> knothe.Precision([4.0, 4.0], [0, 1], [0, 1, 2]).rows()[2]
        array([0, 1, 2])
        """
        return self.data, self.indices, self.indptr

    def __repr__(self) -> str:
        entries = len(self.data)
        plural = "entry" if entries == 1 else "entries"
        return f"<Precision: {counted(len(self.indptr) - 1, 'value')}, {entries} {plural}>"

    def toarray(self) -> Array:
        """The dense matrix; for few sensors.

        Returns
        -------
        ndarray, shape (n, n)
            In the unit of `data`.

        Examples
        --------
        >>> knothe.Precision([4.0, 1.0], [0, 1], [0, 1, 2]).toarray()
        array([[4., 0.],
               [0., 1.]])
        """
        n = len(self.indptr) - 1
        dense = np.zeros((n, n))
        np.add.at(dense, (np.repeat(np.arange(n), np.diff(self.indptr)), self.indices), self.data)
        return dense

    def scaled(self, factor: float) -> "Precision":
        """The precision of values in another unit.

        Parameters
        ----------
        factor : float
            Square of the number of old units in a new one: (px/m)² from pixels to metres.

        Returns
        -------
        Precision
            With `data` times the factor.

        Examples
        --------
        >>> knothe.Precision([4.0], [0], [0, 1]).scaled(1e4**2).data
        array([4.e+08])
        """
        return Precision(self.data * factor, self.indices, self.indptr)


def _rows_of(matrix: Any) -> tuple[Array, ArrayLike, ArrayLike]:
    """Compressed sparse rows of a square matrix, sparse (of scipy) or not."""
    is_sparse = hasattr(matrix, "tocsr")
    shape = matrix.shape if is_sparse else np.shape(matrix)
    if len(shape) != 2 or shape[0] != shape[1]:
        raise UsageError(f"Precision: a matrix of shape {shape}; give n x n, or data, indices and indptr")
    if is_sparse:
        rows = matrix.tocsr(copy=True)
        rows.sum_duplicates()
        return rows.data, rows.indices, rows.indptr
    dense = numbers(matrix, "precision")
    row, column = np.nonzero(dense)
    return dense[row, column], column, np.searchsorted(row, np.arange(len(dense) + 1))


def measured_values(values: ArrayLike) -> Array:
    """As doubles in C order; NaN, a missing value, where a masked array has none."""
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(float), np.nan)
    return np.ascontiguousarray(values, float)


def numbers(values: ArrayLike, what: str) -> Array:
    """As doubles in C order, where none may be missing."""
    if isinstance(values, np.ma.MaskedArray) and np.ma.count_masked(values) > 0:
        raise UsageError(f"{what}: {np.ma.count_masked(values)} of {np.ma.size(values)} values are masked; give them all")
    return np.ascontiguousarray(values, float)


def points_of(values: ArrayLike, dimension: int, what: str) -> Array:
    """As n x d in C order: the same memory where it is that already. One point may be given as d numbers."""
    points = numbers(values, what)
    if points.ndim == 1:
        points = points.reshape(1, -1)
    if points.ndim != 2 or points.shape[1] != dimension:
        raise UsageError(f"{what}: an array of shape {np.shape(values)} is not n points of {counted(dimension, 'coordinate')}")
    return points


def counted(count: int, noun: str) -> str:
    """As "1 value" or "2 values"; of a noun with a regular plural."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def steps_from_0(count: int) -> str:
    """In messages: which steps there are."""
    return "the only step is 0" if count == 1 else f"there are steps 0 to {count - 1}"


def require_progress(progress: Any) -> None:
    if progress is not None and not callable(progress):
        raise UsageError(f"progress: {progress!r} is not a function of (done, total)")


def seed_of(seed: Seed) -> int:
    """A generator gives another seed each time."""
    return int(seed.integers(2**63)) if isinstance(seed, np.random.Generator) else count_of(seed, "as seed")


def count_of(count: int, what: str) -> int:
    """A number of things: a whole one, not negative."""
    if not hasattr(count, "__index__") or count < 0:
        raise UsageError(f"{count!r} {what}: give an integer ≥ 0")
    return int(count)


def seconds_of(value: float) -> float:
    """A time limit; 0: none."""
    if not 0 <= value < np.inf:
        raise UsageError(f"{value!r} seconds: a time limit is a finite number, 0 for none")
    return float(value)


def step_of(step: int, count: int) -> int:
    """A step among `count`; negative ones count from the end."""
    if not hasattr(step, "__index__"):
        raise UsageError(f"step {step!r}: a step is an integer")
    if not -count <= step < count:
        raise UsageError(f"step {step}: {steps_from_0(count)}")
    return int(step) % count


def noise_values(std: ArrayLike | None, precision: Any, count: int
                 ) -> tuple[Array, tuple[Array, NDArray[np.int64], NDArray[np.int64]] | None]:
    """Standard deviations (one stands for all) or precision (or a matrix, of which it is made), as the module wants them."""
    if std is not None and precision is not None:
        raise UsageError("std and precision exclude each other")
    deviations = np.zeros(0) if std is None else numbers(std, "std")
    if std is not None and np.ndim(std) == 0:
        deviations = np.full(count, deviations[0])
    if precision is not None and not isinstance(precision, Precision):
        precision = Precision(precision)
    return deviations, None if precision is None else precision.rows()
