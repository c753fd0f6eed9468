"""A search for the worst case on disk and back: its answer, the recordings of what it found, and its words."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..codec import Malformed, from_json, to_json
from ..errors import InputError
from ..search.findings import SCHEMA, RequirementFound, Robustness
from . import recording
from .files import REPORT, ROBUSTNESS, TRAJECTORIES, prepare_folder, remove, write_text
from .recording import Recording
from .wording import number


@dataclass(frozen=True)
class Search:
    """The answer of a search, and the recordings of its worst cases, which may be empty."""

    found: Robustness
    recordings: tuple[Recording, ...] = ()


def save_search(found: Robustness, folder: Path) -> None:
    """Write ``robustness.json`` into ``folder``; what was made of another search there is removed first."""
    prepare_folder(folder)
    for name in (ROBUSTNESS, TRAJECTORIES, REPORT):
        remove(folder / name)
    write_text(folder / ROBUSTNESS, to_json(found) + "\n")


def load_search(folder: Path) -> Search:
    """The search in ``folder``; raises :class:`InputError` if there is none, or a file is damaged."""
    file = folder / ROBUSTNESS
    try:
        found = from_json(file.read_bytes(), Robustness)
    except OSError as problem:
        raise InputError(f"{file} cannot be read: {problem.strerror}.", "no-run", file) from problem
    except Malformed as problem:
        raise InputError(f"{file} does not hold a search: {problem}.", "damaged", file) from None
    if found.schema != SCHEMA:
        message = f"{file} holds a search of the form {found.schema!r}, not {SCHEMA}."
        raise InputError(message, "other-schema", file, found.schema)
    return Search(found, recording.load(folder))


def verdict_words(found: RequirementFound) -> str:
    """What a requirement came to."""
    if found.passed:
        return f"no failure found; nearest: {found.kind}, {number(found.limit_cycle, 1e6)} µm"
    cycle = f", {number(found.limit_cycle, 1e6)} µm at {number(found.frequency)} Hz" if found.limit_cycle else ""
    return f"fails: {found.kind}{cycle}, with {found.seeds_failed} of {found.seeds_tried} seeds"
