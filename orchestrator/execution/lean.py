"""Importing Numba with less: for processes of this package's own, before any FMU is loaded."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager

UNNEEDED = ("scipy", "coverage", "yaml")
"""What Numba would load and compiled code of this package does not need; SciPy takes half of the time to start."""


@contextmanager
def lean_imports() -> Iterator[None]:
    """Within, modules that are not needed cannot be imported, and no garbage is looked for: what importing makes stays,
    and is left out of later looks, too.

    Not for the user's process, whose other threads may import what they like.
    """
    hidden = [name for name in UNNEEDED if name not in sys.modules]
    # Numba looks for SciPy to support scipy.linalg in compiled code, and goes on without it.
    sys.modules.update(dict.fromkeys(hidden))  # type: ignore[arg-type]  # None forbids
    gc.disable()
    try:
        yield
    finally:
        # The collector writes into every object that it looks at, and a forked worker would copy all these pages.
        gc.freeze()
        gc.enable()
        for name in hidden:
            del sys.modules[name]  # an FMU may want it
