"""Several specimens as one population."""
from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any, Union

import numpy as np

from knothe import _knothe, _notebook
from knothe._errors import UsageError, warned
from knothe._posterior import Posterior
from knothe._results import Results
from knothe._values import Array, Seed, seed_of

Result = Union[str, "os.PathLike[str]", Results, Posterior]


class Population:
    """The result of `population`. Means and standard deviations are those of the logarithm for a parameter whose coordinate is
    ``logarithm``; quantiles and draws are of the parameters themselves.

    Attributes
    ----------
    record : dict
        The line of ``knothe population --json``.
    parameters, coordinates : list of str
        The parameters that all specimens have; in which each is normal over the population, ``own`` or ``logarithm``.
    mean, spread : ndarray, shape (d,)
        Posterior means of the population's mean and standard deviation; their own uncertainty is in `record`.
    new_specimen : ndarray, shape (n, d)
        Draws of a new specimen's parameters.
    points, weights : ndarray, shapes (m, k) and (m,)
        Posterior of means, spreads and correlations.
    specimens : dict of str to dict
        Of each specimen: ``own`` and updated ``mean`` and ``std``, ``quantiles``, and whether it ``belongs`` to the others, with
        the ``probability`` of one as far from them.
    log_bayes_factor : float
        One population against unrelated specimens.
    trusted : bool
        Whether the computation is accurate; `remark` says why not.

    Examples
    --------
    >>> specimens = [knothe.infer(lambda p: p, {"a": knothe.Normal(0, 2)}, observed=[y], std=0.1) for y in (0.9, 1.2, 1.0)]
    >>> found = knothe.population(specimens)
    >>> found.parameters, found.coordinates, found.new_specimen.shape
    (['a'], ['own'], (8192, 1))
    """

    def __init__(self, found: dict[str, Any]) -> None:
        self.record: dict[str, Any] = json.loads(found["json"])
        self.parameters: list[str] = self.record["parameters"]
        self.coordinates: list[str] = self.record["coordinates"]
        self.mean: Array = np.array(self.record["mean"]["mean"])
        self.spread: Array = np.array(self.record["spread"]["mean"])
        self.new_specimen: Array = found["predictive"]
        self.points: Array = found["points"]
        self.weights: Array = found["weights"]
        self.specimens: dict[str, dict[str, Any]] = {entry["name"]: entry for entry in self.record["specimens"]}
        self.log_bayes_factor: float = self.record["log_bayes_factor"]
        self.trusted: bool = self.record["trusted"]
        self.remark: str = self.record["verdict"]

    def __repr__(self) -> str:
        return f"<Population of {len(self.specimens)} specimens: {', '.join(self.parameters)}>"

    def _repr_html_(self) -> str:
        names = [name if coordinate == "own" else f"log {name}" for name, coordinate in zip(self.parameters, self.coordinates)]
        estimates = {"population: mean": self.record["mean"], "population: spread": self.record["spread"], **self.specimens}
        rows = [(name, *map(_notebook.quantity, each["mean"], each["std"]), "" if each.get("belongs", True) else "does not belong")
                for name, each in estimates.items()]
        return _notebook.table(repr(self).strip("<>"), ("", *names, ""), rows, self.remark)


def _plain(results: "Sequence[Result] | Mapping[str, Result]") -> list[str | dict[str, Any]]:
    """In the form that the module needs: folders, or the values of results."""
    names = list(results) if isinstance(results, Mapping) else [f"specimen {i + 1}" for i in range(len(results))]
    plain: list[str | dict[str, Any]] = []
    for name, result in zip(names, results.values() if isinstance(results, Mapping) else results):
        if isinstance(result, Posterior):
            prior = result._prior()
            if prior is None:
                raise UsageError(f"population: {name}: its prior is not known (a density given by its logarithm has none; of a folder, give the "
                                 "folder)")
            plain.append({"name": name, "parameters": result.parameters, "points": result.points, "weights": result.weights,
                          "prior": prior})
        else:
            plain.append(os.fspath(result.folder if isinstance(result, Results) else result))
    return plain


def population(results: "Sequence[Result] | Mapping[str, Result]", *, mean: Mapping[str, tuple[float, float]] | None = None,
               spread: Mapping[str, float] | None = None, seed: Seed = 1,
               output: "str | os.PathLike[str] | None" = None) -> Population:
    """Several specimens as draws from one population, whose parameters are normal (lognormal where the priors are) with unknown
    mean, spread and correlations. Each specimen's own prior is divided out.

    Parameters
    ----------
    results : sequence of path, Results, InferenceResult or StepResult
        One for each specimen; or a mapping, whose keys name the results that are in no folder.
    mean : mapping of name to (mean, std), optional
        Normal prior of the population's mean, of the logarithm where the coordinate is that. Else the widest of the specimens'
        priors.
    spread : mapping of name to float, optional
        Scale of the half-normal prior of the standard deviation. Else the standard deviation of that prior.
    seed : int or numpy.random.Generator
        Of the draws.
    output : path, optional
        Folder for the results, from which `PosteriorOf` takes the prior of the next specimen.

    Returns
    -------
    Population

    Raises
    ------
    UsageError
        Fewer than two results, or no parameter that all of them have.
    DataError
        A result without its prior, or whose prior cannot be divided out.

    Examples
    --------
    >>> specimens = [knothe.infer(lambda p: p, {"a": knothe.Normal(0, 2)}, observed=[y], std=0.1) for y in (0.9, 1.2, 1.0)]
    >>> found = knothe.population(specimens, output="population")
    >>> next_one = knothe.infer(lambda p: p, {"a": knothe.PosteriorOf("population")}, observed=[1.4], std=0.5)
    >>> bool(next_one.mean[0] < 1.3)
    True
    """
    means = {name: (float(value), float(std)) for name, (value, std) in (mean or {}).items()}
    spreads = {name: float(scale) for name, scale in (spread or {}).items()}
    return warned(Population(_knothe.population(_plain(results), means, spreads, seed_of(seed), os.fspath(output or ""))))
