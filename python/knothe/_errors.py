"""Exceptions; each mirrors a class of the C++ library (knothe/base/error.hpp)."""


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


class ProjectError(Error):
    """A project file that is missing or invalid: ``file:line:column: error: ...``, all errors of the file at once."""

    status = 3


class DataError(Error):
    """A model or data file that is missing or damaged, or a model that gives no usable answer."""

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
