"""Results that are one JSON file each: read with every field checked, and written in one go."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import ClassVar, TypeVar

import msgspec

from ..benchmark.results import Rules
from ..codec import Malformed, Struct, from_json, to_json
from ..errors import InputError
from .files import prepare_folder, remove, write_text
from .wording import SHOWN

CRITERIA = {f"B{number}" for number in range(1, 8)}

T = TypeVar("T")
D = TypeVar("D", bound="Document")


class Document(Struct):
    """Base of results that are saved as ``FILE``; ``schema`` names their form, ``MISSING`` is the code of the
    error if there is no file, ``DERIVED`` are the files that are made of it, and of no other."""

    FILE: ClassVar[str]
    SCHEMA: ClassVar[str]
    MISSING: ClassVar[str] = "no-run"
    DERIVED: ClassVar[tuple[str, ...]] = ()

    schema: str

    def save(self, folder: str | Path) -> Path:
        """Write the file into ``folder``, which is created if missing; returns ``folder``. What was made of another
        one there is removed.

        Raises :class:`InputError` if it cannot be written to, :class:`EnvironmentFault` if the disk is full.
        """
        prepare_folder(Path(folder))
        for name in self.DERIVED:
            remove(Path(folder) / name)
        write_text(Path(folder) / self.FILE, to_json(self) + "\n")
        return Path(folder)

    @classmethod
    def load(cls: type[D], path: str | Path) -> D:
        """What was saved in the folder ``path``, or is that file.

        Raises :class:`InputError` if it is damaged, contradicts itself, or is not there.
        """
        file = file_of(Path(path), cls.FILE)
        found = read(file, cls, cls.SCHEMA, cls.MISSING)
        if problem := found._problem():
            raise InputError(f"{file} contradicts itself: {problem}.", "damaged", file)
        return found

    def _problem(self) -> str:
        """What is wrong with it, beyond the types of its fields; empty if nothing is."""
        return ""


def file_of(path: Path, name: str) -> Path:
    """The file called ``name`` in the folder ``path``, or ``path`` if it is no folder."""
    return path / name if path.is_dir() else path


def read(file: Path, kind: type[T], schema: str, missing: str = Document.MISSING, older: str = "") -> T:
    """The ``kind`` that ``file`` holds; raises :class:`InputError` for anything but that, of the form ``schema`` or
    ``older``."""
    try:
        text = file.read_bytes()
    except OSError as problem:
        raise InputError(f"{file} cannot be read: {problem.strerror}.", missing, file) from problem
    try:
        found = from_json(text, _Schema).schema
        if found not in (schema, older or schema):
            message = f"{file} holds results of the form {found!r}, not {schema}."
            raise InputError(message, "other-schema", file, found)
        return from_json(text, kind)
    except Malformed as problem:
        raise InputError(f"{file} does not hold results: {problem}.", "damaged", file) from None


class _Schema(msgspec.Struct):
    schema: str = ""


def rules_problem(rules: Rules) -> str:
    """Why figures that are judged by ``rules`` could not be shown; empty if they can."""
    specs, cost = rules.criteria.values(), rules.cost
    if not {*rules.criteria, *(name for test in rules.tests for name in test.criteria)} <= CRITERIA:
        return "it has criteria that no case is measured by"
    if unit_problem(spec.unit for spec in specs) or min(cost.target, cost.paper, *(spec.target for spec in specs)) <= 0:
        return "a target is not positive, or has no unit it could be shown in"
    return ""


def unit_problem(units: Iterable[str]) -> str:
    """Which of ``units`` no value could be shown in; empty if there is none."""
    return next((f"nothing is shown in {unit!r}" for unit in units if unit not in SHOWN), "")
