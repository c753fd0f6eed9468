"""Robust control benchmark of a flexible manipulator: closed-loop co-simulation of a plant and a controller FMU."""

import sys
from types import TracebackType

__version__ = "0.1.0"

if sys.argv[:1] == ["-m"]:  # a command whose imports are about to begin, which take a second
    _excepthook = sys.excepthook

    def _told(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
        """Tell a Ctrl-C that comes before a command can do so itself."""
        if issubclass(kind, KeyboardInterrupt):
            print("interrupted", file=sys.stderr)
        else:
            _excepthook(kind, error, traceback)

    sys.excepthook = _told
