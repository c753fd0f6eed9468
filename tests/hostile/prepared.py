"""A module that leaves a line where compiled code is kept, each time that its workers are prepared; they cannot be
beside code that is spoiled."""

import os
from pathlib import Path


def prepare() -> None:
    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lines.txt").open("a") as lines:
        lines.write("prepared\n")
    if (folder / "spoiled.1.nbc").exists():
        raise SystemExit("it cannot be loaded")
