"""Results of any kind, from the folders they were written into."""

from __future__ import annotations

from pathlib import Path

from ..documents.evaluation import Evaluation
from ..documents.files import RESULTS
from ..documents.robustness import Robustness
from ..documents.spread import Spread
from ..documents.sweep import Sweep
from ..documents.tuning import Tuning
from ..documents.verification import Verification

Loaded = Evaluation | Spread | Robustness | Tuning | Sweep | Verification

KINDS: dict[str, type[Loaded]] = {
    RESULTS: Evaluation,
    **{kind.FILE: kind for kind in (Spread, Robustness, Tuning, Sweep, Verification)},
}
"""What a folder may hold, by the name of the file."""


def kinds_in(path: Path) -> list[type[Loaded]]:
    """What is in a folder, or is that file."""
    return [kind for name, kind in KINDS.items() if path.name == name or (path / name).is_file()]


def load(path: Path) -> Loaded:
    """The document in the folder ``path``, or that file; raises :class:`InputError` if there is none."""
    return (kinds_in(path) or [Evaluation])[0].load(path)
