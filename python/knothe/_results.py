"""What the commands have left in a folder."""
from __future__ import annotations

import json
import os
import pathlib
from typing import TYPE_CHECKING, Any

import numpy as np

from knothe import _notebook
from knothe._errors import DataError, warned
from knothe._posterior import Posterior, Verdict
from knothe._values import counted

if TYPE_CHECKING:
    import xarray

_GROUPS = ("posterior", "posterior_predictive", "log_likelihood", "sample_stats", "prior", "prior_predictive", "observed_data",
           "constant_data", "history", "weighted_posterior", "last_posterior", "forecast")


def groups_of(file: pathlib.Path) -> "dict[str, xarray.Dataset]":
    """The groups that a file of results has, read where they are needed."""
    import xarray

    groups = {}
    for group in _GROUPS:
        try:
            dataset = xarray.open_dataset(file, group=group, engine="h5netcdf")
        except (OSError, KeyError, ValueError) as error:
            if not file.exists():
                raise DataError(f"{file}: not there: the results are incomplete") from error
            continue
        groups[group] = dataset.assign_coords({name: dataset[name].astype(np.int64) for name in ("chain", "draw", "step")
                                               if name in dataset.coords})  # a file of 0.1 has floating point there
    return groups


class Results:
    """A folder of results of ``knothe assimilate`` or ``knothe infer``; from `open_results`.

    Attributes
    ----------
    folder : pathlib.Path
    steps : list of dict
        The lines of an assimilation, one for each step; of an inference its one line.
    summary : dict
        ``summary.json`` of an assimilation, ``inference.json`` of an inference.

    Examples
    --------
    >>> results = knothe.open_results("results")
    >>> len(results.steps), results.verdict.level
    (5, 'ok')
    >>> results.to_xarray()["posterior"]["E"].dims
    ('chain', 'draw')
    """

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder
        if (folder / "steps.jsonl").exists():
            self.summary: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
            lines = (folder / "steps.jsonl").read_text(encoding="utf-8").splitlines()
            self.steps: list[dict[str, Any]] = [json.loads(line) for line in lines]
            self._file = folder / "posterior.nc"
        elif (folder / "inference.json").exists():
            self.summary = json.loads((folder / "inference.json").read_text(encoding="utf-8"))
            self.steps = [self.summary]
            self._file = folder / "samples.nc"
        else:
            raise DataError(f"{folder}: neither steps.jsonl nor inference.json is there: give a folder of results of "
                            "`knothe assimilate` or `knothe infer`")

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters, in the order of the arrays in `steps`.

        Examples
        --------
        >>> knothe.open_results("results").parameters
        ['E', 'F']
        """
        found = self.summary["parameters"]
        return [entry["name"] if isinstance(entry, dict) else entry for entry in found]

    @property
    def verdict(self) -> Verdict:
        """Whether the answers of the run may be used. `DataError` for an inference, which has `trusted` alone.

        Examples
        --------
        >>> knothe.open_results("results").verdict.level
        'ok'
        """
        if not isinstance(self.summary.get("verdict"), dict):
            raise DataError(f"{self.folder}: the results of an inference have no verdict but `trusted`")
        return Verdict.of(self.summary["verdict"])

    @property
    def posterior(self) -> Posterior:
        """The posterior of the last step, or of the inference, with its weighted points.

        Examples
        --------
        >>> last = knothe.open_results("results").posterior
        >>> last.draws(100).shape
        (100, 2)
        """
        groups = self.to_xarray()
        weighted = groups["last_posterior" if "last_posterior" in groups else "weighted_posterior"]
        entries = self.summary["parameters"]
        supports = self.summary.get("supports", [entry.get("support", [None, None]) for entry in entries if isinstance(entry, dict)])
        nothing = np.zeros(0)
        densities = [(-np.inf if lower is None else lower, np.inf if upper is None else upper, nothing, nothing)
                     for lower, upper in supports]
        record = dict([step for step in self.steps if "mean" in step][-1])
        if isinstance(record.get("verdict"), str):  # of an inference
            record["remark"] = record["verdict"]
        if "forecast" in record:
            record["forecast"] = {name: {**each, "at": self._named(each["horizon"])} for name, each in record["forecast"].items()}
        labels = {name: dict(groups["posterior"][name].attrs) for name in self.parameters}
        return Posterior(record, self.parameters, weighted["points"].values, weighted["weights"].values, densities, labels)

    def _named(self, time: float) -> str:
        """A model time as the report names it: by what is imposed, where that is known and rises."""
        curve = self.summary.get("load_displacement", {})
        times, imposed = curve.get("time", []), curve.get("displacement", [])
        if len(times) and times[0] <= time <= times[-1] and np.all(np.diff(imposed) > 0):
            return _notebook.given(float(np.interp(time, times, imposed)), "m")
        return f"time {_notebook.given(time, self.summary.get('time_units', ''))}"

    def to_xarray(self) -> "dict[str, xarray.Dataset]":
        """One Dataset for each of ArviZ's groups, read from the file where it is needed.

        Returns
        -------
        dict of str to xarray.Dataset
            Those groups that the file has, by name.

        Raises
        ------
        DataError
            The file is not there.

        Examples
        --------
        >>> knothe.open_results("results").to_xarray()["observed_data"]["displacement"].dims
        ('step', 'observation')
        """
        return groups_of(self._file)

    def __repr__(self) -> str:
        return f"<Results {self.folder}: {counted(len(self.steps), 'step')}>"

    def _repr_html_(self) -> str:
        return _notebook.table(repr(self).strip("<>"), (), ()) + self.posterior._repr_html_()


def open_results(folder: "str | os.PathLike[str]") -> Results:
    """Open a results folder written by a command.

    Parameters
    ----------
    folder : path
        Of ``knothe assimilate -o`` or ``knothe infer -o``.

    Returns
    -------
    Results

    Raises
    ------
    DataError
        The folder has no results of a command.

    Examples
    --------
    >>> knothe.open_results("results").parameters
    ['E', 'F']
    """
    results = Results(pathlib.Path(folder))
    if not results.steps[-1].get("trusted", True):
        warned(results.posterior)
    return results
