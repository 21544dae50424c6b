"""Bayesian assimilation of measurements with transport maps and reduced models, for numpy and xarray.

The same engine as the program `knothe`: a result here is identical, to the bit, to what the command prints.

============================  ==============================================================================
`Twin`                        data in, one by one; posterior, forecasts and verdict out
`Model`, `offline`            reduced models: from files, and from snapshots of your own solver
`fit`, `fit_samples`          transport maps of a density or of samples: `TransportMap`
`infer`                       one-shot inference for any model
`population`                  several specimens, and what to expect of the next
`Correlation`                 displacements from pictures
`open_results`                the results folder of a command
`knothe.states`               filters for simulators that step: states as well as parameters
`knothe.modes`                loss of stiffness from natural frequencies and mode shapes
`knothe.calibration`          one's own cameras, with their covariance
`knothe.plot`                 figures (matplotlib)
============================  ==============================================================================

Points are n x d arrays in C order (double precision); such arrays are read where they are, without a copy. Long calls let other
threads of Python go on, and Ctrl-C ends them. The examples import knothe, and numpy as np; model.h5 is that of the example of
`offline`, and project.toml, `twin`, `result` and `moved` are what `Twin`, its `assimilate` and `Correlation.correlate` give.
All quantities are in SI units, as in the files.
"""
import importlib
import pathlib
import sys
from typing import Any

from knothe._version import __version__

try:
    import knothe._knothe as _knothe
except ModuleNotFoundError as _missing:
    raise ImportError(f"knothe was not built for Python {sys.version_info.major}.{sys.version_info.minor} ({sys.executable}): there is "
                      f"{', '.join(sorted(file.name for file in pathlib.Path(__file__).parent.glob('_knothe*.so'))) or 'no _knothe*.so'} "
                      "in its folder. Install it for this Python (`pip install knothe`), or use the Python that it was built for") from _missing

if _knothe.version != __version__:
    raise ImportError(f"the package knothe is of version {__version__}, but its library is of version "
                      f"{_knothe.version}: install both from the same build")

from knothe._errors import DataError, Error, Interrupted, IoError, NumericalError, ProjectError, UntrustedWarning, UsageError
from knothe._inference import InferenceResult, infer
from knothe._maps import Fit, TransportMap, fit, fit_samples
from knothe._models import Model, ObservedModel, offline
from knothe._pictures import Correlation, Displacements, read_picture
from knothe._population import Population, population
from knothe._posterior import Decision, Forecast, Posterior, Reason, Verdict
from knothe._results import Results, open_results
from knothe._twin import Datum, StepResult, Twin
from knothe._values import Axis, Lognormal, Normal, PosteriorOf, Precision, Prior, Sensors, Uniform


_LAZY = ("calibration", "modes", "plot", "states")


def __getattr__(name: str) -> Any:
    """`knothe.plot` and its like without an import of their own; matplotlib is loaded by the first figure."""
    if name in _LAZY:
        return importlib.import_module(f"knothe.{name}")
    raise AttributeError(f"module 'knothe' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *_LAZY])


__all__ = [
    "Axis", "Correlation", "DataError", "Datum", "Decision", "Displacements", "Error", "Fit", "Forecast", "InferenceResult", "Interrupted",
    "IoError", "Lognormal", "Model", "Normal", "NumericalError", "ObservedModel", "Population", "Posterior", "PosteriorOf",
    "Precision", "Prior",
    "ProjectError", "Reason", "Results", "Sensors", "StepResult", "TransportMap", "Twin", "Uniform", "UntrustedWarning", "UsageError",
    "Verdict", "__version__",
    "fit", "fit_samples", "infer", "offline", "open_results", "population", "read_picture",
]
