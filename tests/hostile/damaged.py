"""A module whose workers cannot be prepared as long as there is compiled code: it stands for one that is damaged."""

import os
from pathlib import Path


def prepare() -> None:
    if any(Path(os.environ["NUMBA_CACHE_DIR"]).rglob("*.nbc")):
        raise EOFError("Ran out of input")
