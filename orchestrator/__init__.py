"""Robust control benchmark of a flexible manipulator: closed-loop co-simulation of a plant and a controller FMU."""

__version__ = "0.1.0"

import sys

if sys.argv[:1] == ["-m"]:  # a command whose imports have just begun, which takes a second
    _hook = sys.excepthook

    def _interrupted(kind, error, traceback):
        """Ctrl-C before a command can say "interrupted" itself."""
        if issubclass(kind, KeyboardInterrupt):
            print("interrupted", file=sys.stderr)
        else:
            _hook(kind, error, traceback)

    sys.excepthook = _interrupted
