"""Exceptions; each mirrors a class of the C++ library (knothe/base/error.hpp). And the warning of an untrusted result."""
import sys
import typing
import warnings


class Error(Exception):
    """A mistake of the caller or in a file; the message says what is wrong, where, and what to do.

    Attributes
    ----------
    status : int
        The exit status with which the program `knothe` ends for the same reason.

    Examples
    --------
    >>> import knothe
    >>> try:
    ...     knothe.Model.load("nowhere.h5")
    ... except knothe.Error as error:
    ...     print(type(error).__name__, error.status)
    DataError 4
    """

    status = 1


class UsageError(Error, ValueError):
    """Invalid or inconsistent arguments."""

    status = 2


class ProjectError(Error, ValueError, OSError):
    """A project file that is missing or invalid: ``file:line:column: error: ...``, all errors of the file at once."""

    status = 3


class DataError(Error, ValueError, OSError):
    """A model or data file that is missing or damaged, or a model that gives no usable answer.

    As a missing file is an `OSError` elsewhere, and an unusable value a `ValueError`, both catch it.
    """

    status = 4


class IoError(Error, OSError):
    """A file that cannot be written: disk full, no permission."""

    status = 5


class NumericalError(Error):
    """Numerical failure."""

    status = 6


class Interrupted(KeyboardInterrupt):
    """Ctrl-C; the message says what is kept. As `KeyboardInterrupt` it passes by ``except Exception``."""

    status = 130


class UntrustedWarning(UserWarning):
    """The computation of a result is not accurate: its `trusted` is false, and its `remark` says why.

    Given once a result, by the call that makes it.

    Examples
    --------
    >>> import warnings
    >>> warnings.simplefilter("error", knothe.UntrustedWarning)  # an exception in its place
    >>> warnings.simplefilter("ignore", knothe.UntrustedWarning)  # or nothing
    """


class _Judged(typing.Protocol):
    @property
    def trusted(self) -> bool: ...

    @property
    def remark(self) -> str: ...


_Result = typing.TypeVar("_Result", bound=_Judged)


def warned(result: _Result) -> _Result:
    """The result, after a warning if it is not trusted: at the line of the caller's that called the package."""
    if not result.trusted:
        level, frame = 1, sys._getframe()
        while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("knothe."):
            level, frame = level + 1, frame.f_back
        warnings.warn(untrusted(result.remark), UntrustedWarning, level)
    return result


def untrusted(remark: str) -> str:
    """Remarks of an inference say themselves that it is not trusted."""
    return remark if remark.startswith("Not trusted") else f"not trusted: {remark}"
