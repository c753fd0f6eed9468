"""Results of any kind, from the folders they were written into."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from ..documents.evaluation import Evaluation
from ..documents.files import RESULTS
from ..documents.reliability import Reliability
from ..documents.robustness import Robustness
from ..documents.spread import Spread
from ..documents.sweep import Sweep
from ..documents.tuning import Tuning
from ..documents.verification import Verification
from ..errors import InputError
from ..text import printable

Loaded = Evaluation | Spread | Robustness | Reliability | Tuning | Sweep | Verification

KINDS: dict[str, type[Loaded]] = {
    RESULTS: Evaluation,
    **{kind.FILE: kind for kind in (Spread, Robustness, Reliability, Tuning, Sweep, Verification)},
}
"""What a folder may hold, by the name of the file."""


def kinds_in(path: Path) -> list[type[Loaded]]:
    """The kinds of results that a folder holds, or the kind of a file."""
    return [kind for name, kind in KINDS.items() if path.name == name or (path / name).is_file()]


def finished(paths: Sequence[Path]) -> list[tuple[Loaded, Path]]:
    """The finished results of every kind in these folders or files.

    A folder without results is left out, with a note on standard error. If no folder has results, the last reason is
    raised, an :class:`InputError`.
    """
    loaded: list[tuple[Loaded, Path]] = []
    last: InputError | None = None
    for path in paths:
        try:
            kinds = kinds_in(path)
            if not kinds and path.is_dir():
                names = ", ".join(KINDS)
                raise InputError(f"{path} holds no results of a known kind: {names}.", "no-run", path)
            loaded += [(kind.load(path), path) for kind in kinds or (Evaluation,)]
        except InputError as problem:
            last = problem
            # One folder alone is what was meant, so its error is raised; of several, a shell's pattern may name others.
            if len(paths) > 1:
                print(printable(f"left out: {problem}"), file=sys.stderr)
    if not loaded and last is not None:
        raise last
    return loaded
