"""The family of errors a user may meet.

::

    BenchmarkError
    ├── InputError          what the user gave cannot be used
    ├── EnvironmentFault    this machine, or another one, failed; never the controller's fault
    ├── FmuError            an FMU failed in an FMI call
    └── Crash               the process of a single simulation ended before the simulation did

A message says what happened and where. What to do about it depends on how the library is used, so remedies that name
options are added by the commands, by ``what``.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class BenchmarkError(Exception):
    """Base of all errors raised on purpose."""


class InputError(BenchmarkError):
    """A file, a name or a value cannot be used.

    Attributes
    ----------
    what : str
        Stable code of the problem, such as ``"connector-missing"``.
    where : str
        The file, FMU or variable concerned; empty if there is none.
    value : str
        The offending value.
    nearest : tuple of str
        Names that exist and resemble the value.
    """

    def __init__(
        self, message: str, what: str = "", where: object = "", value: object = "", nearest: Iterable[str] = ()
    ) -> None:
        super().__init__(message)
        self.what, self.where, self.value, self.nearest = what, str(where), str(value), tuple(nearest)


class EnvironmentFault(BenchmarkError):
    """The machine, its file system or a cluster failed. What is finished is kept; nothing is held against an FMU.

    ``what`` is a stable code as in :class:`InputError`.
    """

    def __init__(self, message: str, what: str = "") -> None:
        super().__init__(message)
        self.what = what


class Crash(BenchmarkError):
    """The process of a simulation ended before the simulation did. ``what`` is ``"killed"`` if somebody else may have
    ended it."""

    def __init__(self, message: str, what: str = "") -> None:
        super().__init__(message)
        self.what = what


class FmuError(BenchmarkError):
    """An FMU failed in an FMI call. ``call`` names the function, ``log`` holds the FMU's own last messages."""

    def __init__(self, message: str, call: str = "", log: Iterable[str] = ()) -> None:
        super().__init__(message + "".join(f"\n  {line}" for line in log))
        self.call, self.log = call, tuple(log)


def unknown(message: str, what: str, where: str, name: str, names: Iterable[str]) -> InputError:
    """An error about ``name``, with the up to four ``names`` that look most like it, else the first eight."""
    pool = list(names)
    # A low bound for likeness: exporters' names share little with a connector's, and a bad hint costs nothing.
    nearest = difflib.get_close_matches(name, pool, 4, 0.3)
    # Among equals in the order of the pool: the variable of axis 1 before that of axis 2.
    likeness = {other: difflib.SequenceMatcher(None, other, name).ratio() for other in nearest}
    nearest = sorted(nearest, key=lambda other: (-likeness[other], pool.index(other))) or pool[:8]
    return InputError(f"{message} Nearest: {', '.join(nearest) or 'none'}.", what, where, name, nearest)
