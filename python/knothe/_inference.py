"""One-shot inference."""
from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from knothe import _knothe
from knothe._errors import UsageError, warned
from knothe._posterior import Posterior
from knothe._records import InferenceRecord
from knothe._values import Array, Prior, Seed, count_of, counted, noise_values, numbers, prior_values, require_progress, seconds_of, seed_of

if TYPE_CHECKING:
    import xarray


class InferenceResult(Posterior):
    """The result of `infer`: a `Posterior` with further attributes.

    Attributes
    ----------
    record : dict
        The line of ``knothe infer --json``.
    remark : str
        Trusted or not, and why: one sentence.

    Examples
    --------
    >>> found = knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0,
    ...                      method="transport")
    >>> found.mean.round(3), found.chains.shape
    (array([0.5]), (1, 10000, 1))
    """

    record: InferenceRecord

    def __init__(self, found: dict[str, Any]) -> None:
        record = json.loads(found["json"])
        super().__init__(record, record["parameters"], found["points"], found["weights"], found["densities"],
                         found["labels"])
        self._prior_values: dict[str, Any] | None = found.get("prior")
        self._chains: Array | None = None  # of weighted points when they are asked for
        count = len(found["draws"]) // found["chains"]
        if count > 0:
            self._chains = found["draws"][:count * found["chains"]].reshape(found["chains"], count, -1)

    def _prior(self) -> dict[str, Any] | None:
        return self._prior_values

    @property
    def chains(self) -> Array:
        """Equally weighted draws, shape (chains, draws, d).

        Examples
        --------
        >>> found = knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0, samples=2000)
        >>> found.chains.shape
        (1, 2000, 1)
        """
        if self._chains is None:
            self._chains = self.draws(self.record["distinct_draws"])[None]
        return self._chains

    @property
    def skewness(self) -> Array:
        """Skewness of the marginals, E (p - mean)³ / std³, shape (d,).

        Examples
        --------
        >>> found = knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0,
        ...                      method="transport")
        >>> bool(abs(found.skewness[0]) < 0.01)
        True
        """
        return np.array(self.record["skewness"])

    @property
    def kurtosis(self) -> Array:
        """Kurtosis of the marginals, E (p - mean)⁴ / std⁴, shape (d,); 3 for a Gaussian.

        Examples
        --------
        >>> found = knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0,
        ...                      method="transport")
        >>> found.kurtosis.round(1)
        array([3.])
        """
        return np.array(self.record["kurtosis"])

    @property
    def remark(self) -> str:
        """Trusted or not, and why: one sentence.

        Examples
        --------
        >>> found = knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0)
        >>> found.remark.startswith("Trusted")
        True
        """
        return str(self.record["verdict"])

    def compare(self, other: "InferenceResult") -> dict[str, Any]:
        """Whether another answer to the same question agrees with this one, within what both state as their errors.

        Parameters
        ----------
        other : InferenceResult
            By another method, say.

        Returns
        -------
        dict
            What ``knothe infer --compare`` prints of the two, `other` minus this one: ``agreement`` is "agree" or "contradict",
            ``words`` says it in a sentence.

        Raises
        ------
        UsageError
            The two have other parameters.

        Examples
        --------
        >>> a, b = (knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0, method=method)
        ...         for method in ("smc", "grid"))
        >>> a.compare(b)["agreement"]
        'agree'
        """
        if self.parameters != other.parameters:
            raise UsageError(f"compare: parameters {', '.join(self.parameters)} and {', '.join(other.parameters)}: give two answers to "
                             "the same question")
        line, words = _knothe.compare_inferences(dict(self.record), dict(other.record))
        return {**json.loads(line)["comparison"], "words": words}

    def to_xarray(self, draws: int = 1000) -> "dict[str, xarray.Dataset]":
        """One Dataset for each of ArviZ's groups; the draws of ``posterior`` are all of `chains`, where these are
        independent draws in four parts.

        Parameters
        ----------
        draws : int
            Not used.

        Returns
        -------
        dict of str to xarray.Dataset
            The groups of `Posterior.to_xarray`.

        Examples
        --------
        >>> found = knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0)
        >>> dict(found.to_xarray()["posterior"].sizes)
        {'chain': 4, 'draw': 2500}
        """
        chains = self.chains
        if len(chains) == 1:
            count = chains.shape[1] // 4 * 4
            chains = chains[:, :count].reshape(4, count // 4, -1)
        return self._groups(chains)


def _vectorized(function: Callable[[Array], ArrayLike]) -> Callable[[Array], Array]:
    return lambda points: numbers(function(points), "the model's values")


def _over_points(function: Callable[[Array], ArrayLike]) -> Callable[[Array], Array]:
    """A function of one point as a function of many."""
    def at(points: Array) -> Array:
        answers = [function(point) for point in points]
        if all(isinstance(answer, float) for answer in answers):  # of a density: a microsecond a point less
            return np.array(answers)
        return np.array([numbers(answer, "the model's values").ravel() for answer in answers])

    return at


def infer(model: "str | os.PathLike[str] | Callable[[Array], ArrayLike]", parameters: Mapping[str, Prior] | None = None, *,
          observed: ArrayLike | None = None, std: ArrayLike | None = None, covariance: ArrayLike | None = None,
          jacobian: Callable[[Array], ArrayLike] | None = None, vectorized: bool = False, method: str | None = None,
          tolerance: float = 1e-3, max_order: int = 8, samples: int = 10000, evaluations: int = 0, seconds: float = 0.0, seed: Seed = 1,
          results: "str | os.PathLike[str] | None" = None,
          progress: Callable[[int, int | None], object] | None = None) -> InferenceResult:
    """Bayesian inference for any model.

    Parameters
    ----------
    model : path or callable
        A project file, as for ``knothe infer``, with which only `method` and `results` may be given; its progress is on stderr.
        Or the model itself: its m outputs at parameters of shape (d,). Without `observed` it is the complete log posterior
        density, one number.
    parameters : mapping of name to Normal, Uniform or Lognormal
        Priors; their order is that of the parameters. For a density they only give the region and scale of the parameters.
    observed : array_like, shape (m,), optional
    std : float or array_like, shape (m,)
        Standard deviations of the observations' noise; or
    covariance : array_like, shape (m, m)
        its covariance.
    jacobian : callable, optional
        Derivatives of the outputs with respect to the parameters, shape (m, d); finite differences without it.
    vectorized : bool
        `model` and `jacobian` are called with n points at once: (n, d) to (n, m) and (n, m, d).
    method : {"auto", "transport", "mcmc", "smc", "grid"}, optional
        `auto`, the default: weighted draws (`smc`), with the fewest calls of a function; for a project with a
        reduced model of up to three parameters the map.
    tolerance, max_order : float, int
        Of maps.
    samples : int
        Number of draws.
    evaluations : int
        Budget: points at which `model` and, each counting once per parameter (of a density four times), `jacobian` are asked.
        0: 20,000, or twice `samples` if that is more; 100,000 for ``transport``; no limit for ``grid`` and ``mcmc``.
    seconds : float
        Time limit, kept like `evaluations`; 0: none.
    seed : int or numpy.random.Generator
        Of the random numbers.
    results : path, optional
        Folder for a project's results, in place of the project's own.
    progress : callable, optional
        ``progress(done, total)`` after each batch of points: evaluations made, and an estimate of all (of weighted draws the most
        there may be), or None where there is none (yet). In the last call both are equal. An exception ends the inference.

    Returns
    -------
    InferenceResult
        `trusted` and `remark` say whether its computation is accurate.

    Raises
    ------
    UsageError
        Inconsistent arguments, or the model returns another number of outputs than `observed` has.
    DataError
        The model returns a value that is not finite.
    NumericalError
        The budget or the time was too small for any answer, or the density is zero wherever it was tried, or has no finite
        integral.
    ProjectError
        The project file is missing or invalid.

    Examples
    --------
    >>> found = knothe.infer(lambda p: [p[0] + p[1], p[0] * p[1]], {"a": knothe.Normal(0, 1), "b": knothe.Uniform(0, 2)},
    ...                      observed=[1.5, 0.5], std=0.1)
    >>> found.parameters, found.trusted
    (['a', 'b'], True)

    Counting the evaluations while they are made:

    >>> made = []
    >>> found = knothe.infer(lambda p: p, {"a": knothe.Normal(0, 1)}, observed=[1.0], std=1.0,
    ...                      progress=lambda done, total: made.append(done))
    >>> made[-1] == found.record["model_evaluations"]
    True
    """
    require_progress(progress)
    if not callable(model):
        if any(value is not None for value in (parameters, observed, std, covariance, jacobian, progress)):
            raise UsageError("infer: a project file says everything; leave out parameters, observations, jacobian and progress")
        return warned(InferenceResult(_knothe.infer_project(os.fspath(model), method or "", os.fspath(results or ""))))
    if not parameters:
        raise UsageError("infer: give a prior for each parameter")
    values = np.zeros(0) if observed is None else numbers(observed, "observations").ravel()
    if len(values) and (std is None) == (covariance is None):
        raise UsageError("infer: give std or covariance of the observations, one of them")
    deviations, _ = noise_values(std, None, len(values))
    matrix = np.zeros((0, 0)) if covariance is None else numbers(covariance, "covariance")
    if len(values) and std is not None and len(deviations) != len(values):
        raise UsageError(f"infer: {counted(len(deviations), 'standard deviation')} for {counted(len(values), 'observation')}")
    if covariance is not None and matrix.shape != (len(values), len(values)):
        raise UsageError(f"infer: a covariance of shape {matrix.shape} for {counted(len(values), 'observation')}")
    over_points = _vectorized if vectorized else _over_points
    return warned(InferenceResult(_knothe.infer_callable(
        over_points(model), None if jacobian is None else over_points(jacobian), prior_values(parameters), values, deviations,
        matrix, method or "auto", tolerance, max_order, count_of(samples, "samples"),
        count_of(evaluations, "evaluations as budget"), seconds_of(seconds), seed_of(seed), progress)))
