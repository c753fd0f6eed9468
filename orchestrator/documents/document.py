"""Documents: results that are one JSON file each, read with every field checked, written in one go, and shown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple, Protocol, TypeVar

import msgspec

from ..benchmark.case import CRITERIA
from ..benchmark.results import Rules
from ..benchmark.tally import Tally
from ..bounded import MAX_RESULT_BYTES, read
from ..codec import Malformed, Struct, from_json, to_json
from ..entry import entered
from ..errors import InputError
from ..loop.trajectory import Status
from ..views.table import Cell, Column, Conclusion, Page, Panel, Summary
from ..views.units import SHOWN
from .files import check_report, prepare_folder, remove, write_text
from .head import ControllerRecord, Head, PlantRecord, SampleTimeRecord, Timing

T = TypeVar("T")
D = TypeVar("D", bound="Document")


Completeness = Literal["complete", "incomplete", "not judged"]


class Ended(Protocol):
    """A case that has ended."""

    @property
    def status(self) -> Status:
        """How."""

    @property
    def simulated(self) -> bool:
        """Whether it was simulated to its end."""


def completeness(cases: Iterable[Ended], tallies: Iterable[Tally]) -> Completeness:
    """How far requirements with these tallies are judged by these cases."""
    listed = list(cases)
    if any(case.status is Status.LOST for case in listed) or any(tally.interrupted for tally in tallies):
        return "not judged"
    return "complete" if all(case.simulated for case in listed) else "incomplete"


class Displayable:
    """What shows itself: in a notebook, as a page, and as the tables of its summary."""

    __slots__ = ()

    def summary(self) -> Summary:
        """What every renderer shows."""
        raise NotImplementedError

    def conclusion(self) -> Conclusion | None:
        """What its page begins with: what it comes to, and what to do next; None if it comes to nothing."""
        return None

    def page(self) -> Page:
        """The page of a report; the summary alone unless there is more."""
        summary = self.summary()
        panels = (Panel("summary", "Summary", summary.parts),)
        return Page(summary.title, summary.kicker, panels, self.conclusion())

    @entered
    def report(self, file: str | Path, folder: str | Path | None = None) -> Path:
        """Write the report, one HTML page that needs no network; returns ``file``. ``folder`` is where recordings of a
        search are; the report of all else has what it shows.

        Raises :class:`InputError` for a file of another kind, and for one that is there and is no report.
        """
        from ..views.page import page_html  # the templates' package takes time to load, which simulations need not

        check_report(Path(file))
        write_text(Path(file), page_html(self.page()))
        return Path(file)

    def _repr_html_(self) -> str:
        from ..views.page import fragment  # as above

        return fragment(self.summary())


Row = tuple[tuple[Column, Cell], ...]
"""What a comparison shows of a document: its cells, each with its column."""


class Rank(NamedTuple):
    """How results stand in a comparison: by whether all requirements are met (``holds``), then by ``V``; and why they
    have no rank, if there is a ``reason``."""

    V: float | None = None
    holds: bool = True
    reason: str = ""

    @property
    def key(self) -> tuple[bool, float]:
        """The sort key."""
        return not self.holds, math.inf if self.V is None else self.V


class Comparable(Displayable):
    """What a comparison lists: results of one ``KIND``, with their head, their V, and how they stand."""

    __slots__ = ()

    KIND: ClassVar[str]

    @property
    def head(self) -> Head:
        """What it was made with."""
        raise NotImplementedError

    @property
    def completeness(self) -> Completeness:
        """See :attr:`.Document.completeness`."""
        raise NotImplementedError

    @property
    def rank(self) -> Rank:
        """How it stands."""
        return Rank()

    @property
    def V(self) -> float | None:
        """The cost it is ranked by; None if there is none."""
        return self.rank.V

    def row(self, first: Comparable | None, others: Sequence[tuple[str, Comparable]]) -> Row:
        """What is shown of it beside the ``first`` one of its group (None if that is itself) and all ``others`` that
        are compared, with their names."""
        raise NotImplementedError


class Document(Struct, kw_only=True):
    """Base of results that are saved as ``FILE``; ``schema`` names their form, ``MISSING`` is the code of the error if
    there is no file, ``DERIVED`` are the files that are made of it, and of no other."""

    FILE: ClassVar[str]
    SCHEMA: ClassVar[str]
    MISSING: ClassVar[str] = "no-run"
    DERIVED: ClassVar[tuple[str, ...]] = ()

    schema: str
    head: Head

    @property
    def benchmark(self) -> str:
        """Name and version of the benchmark."""
        return self.head.benchmark

    @property
    def protocol(self) -> str:
        """Name of the protocol."""
        return self.head.protocol

    @property
    def seed(self) -> int | None:
        """Base seed; None for several."""
        return self.head.seed

    @property
    def controller(self) -> ControllerRecord:
        """The controller as it was used."""
        return self.head.controller

    @property
    def plant(self) -> PlantRecord:
        """The plant as it was used."""
        return self.head.plant

    @property
    def sample_time(self) -> SampleTimeRecord:
        """The controller's sample time."""
        return self.head.sample_time

    @property
    def rules(self) -> Rules:
        """What the protocol asks for."""
        return self.head.rules

    @property
    def timing(self) -> Timing:
        """When it was made, and what it took."""
        return self.head.timing

    @property
    def completeness(self) -> Completeness:
        """How far it is judged: ``"complete"``, ``"incomplete"`` if simulations failed, or ``"not judged"`` if some
        were skipped or lost."""
        return "complete"

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
    @entered
    def load(cls: type[D], path: str | Path) -> D:
        """What was saved in the folder ``path``, or is that file.

        Raises :class:`InputError` if it is damaged, contradicts itself, or is not there.
        """
        file = file_of(Path(path), cls.FILE)
        document = _read(file, cls)
        if problem := rules_problem(document.rules) or document._problem():
            raise InputError(f"{file} contradicts itself: {problem}.", "damaged", file)
        return document

    @classmethod
    def _of_older(cls: type[D], form: str, text: bytes) -> D | None:
        """What ``text`` of an older ``form`` says in this one; None if that form is not read. Raises
        :class:`Malformed`."""
        return None

    def _problem(self) -> str:
        """What is wrong with it, beyond the types of its fields; empty if nothing is."""
        return ""


def file_of(path: Path, name: str) -> Path:
    """The file called ``name`` in the folder ``path``, or ``path`` if it is no folder."""
    return path / name if path.is_dir() else path


def _read(file: Path, kind: type[D]) -> D:
    """The ``kind`` that ``file`` holds; raises :class:`InputError` for anything but that."""
    text = read(file, MAX_RESULT_BYTES, kind.MISSING)
    try:
        # The form first: a document of another one need not have a single field of this one.
        outline = from_json(text, _Schema)
        form = outline.schema
        if form == kind.SCHEMA:
            return from_json(text, kind)
        if (older := kind._of_older(form, text)) is not None:
            return older
    except Malformed as problem:
        raise InputError(f"{file} does not hold results: {problem}.", "damaged", file) from None
    name, _, number = kind.SCHEMA.rpartition("/")
    message = f"{file} has the form {form!r}, and {kind.SCHEMA} is read."
    form_number = form.removeprefix(f"{name}/")
    if form_number != form and form_number.isdecimal():
        later = int(form_number) > int(number)
        message += " A later version of this package made it." if later else " Make it again with this version"
        version = outline.head.environment.get("flexible_manipulator_benchmark", "")
        message += "" if later else f", or read it with version {version}, which made it." if version else "."
    raise InputError(message, "other-schema", file, form)


class _Made(msgspec.Struct, frozen=True):
    environment: dict[str, str] = {}


class _Schema(msgspec.Struct):
    schema: str = ""
    head: _Made = _Made()


def rules_problem(rules: Rules) -> str:
    """Why figures that are judged by ``rules`` could not be shown; empty if they can."""
    specs, cost = rules.criteria.values(), rules.cost
    if not {*rules.criteria, *(name for test in rules.tests for name in test.criteria)} <= set(CRITERIA):
        return "it has criteria that no case is measured by"
    if unit_problem(spec.unit for spec in specs) or min(cost.target, cost.paper, *(spec.target for spec in specs)) <= 0:
        return "a target is not positive, or has no unit it could be shown in"
    return ""


def unit_problem(units: Iterable[str]) -> str:
    """Which of ``units`` no value could be shown in; empty if there is none."""
    return next((f"nothing is shown in {unit!r}" for unit in units if unit not in SHOWN), "")
