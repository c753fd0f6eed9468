"""A run's folder, read back: the results and the recordings."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from . import recording
from .files import RESULTS
from .recording import Recording
from .results import SCHEMA
from .tables import Document


@dataclass(frozen=True)
class Run:
    """``document`` is the contents of ``results.json``; ``recordings`` may be empty."""

    folder: Path
    document: Document
    recordings: tuple[Recording, ...]

    def recorded(self, role: str) -> list[Recording]:
        """The recordings with this role, such as ``B5``, ``A2 2`` or ``spread``."""
        return [entry for entry in self.recordings if role in entry.about.roles]


def load_run(path: Path) -> Run:
    """The run in the folder ``path`` (or of that results file); raises :class:`InputError` where there is none."""
    file = path / RESULTS if path.is_dir() else path
    try:
        document: Any = json.loads(file.read_text(encoding="utf-8"))
    except OSError as problem:
        raise InputError(
            f"{file} cannot be read: {problem.strerror}. Give the folder of a run, such as runs/DiagonalPID-paper."
        ) from problem
    except ValueError as problem:
        raise InputError(f"{file} is no JSON file: {problem}.") from problem
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise InputError(f"{file} does not hold results of the schema {SCHEMA}, but {schema!r}.")
    return Run(file.parent, document, recording.load(file.parent))
