"""The one type of tables, and the parts of a summary and of a page. Renderers show them; documents make them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from .plot import Heat, MovingArm, Plot, PosedArm
from .units import NONE, Unit, heading, number

VERDICTS: Mapping[bool | None, str] = {True: "met", False: "not met", None: "not judged"}
"""The verdict on a requirement as a word, everywhere."""


class Value(NamedTuple):
    """A number with what belongs to it: its standard deviation, a ``unit`` in place of the column's, ``beyond`` (``<``
    or ``>``) if it is the limit that nothing was found up to, or (``≤`` or ``≥``) if it was not refined, whether it is
    ``good``, and whether it was ``given``, as a parameter is: then it is shown with six figures."""

    value: float | None
    deviation: float | None = None
    unit: Unit | None = None
    beyond: Literal["", "<", ">", "≤", "≥"] = ""
    good: bool | None = None
    given: bool = False


class VerdictCell(NamedTuple):
    """Whether something is met (None: not judged), in words of its own if it has some."""

    passed: bool | None
    words: str = ""


class Link(NamedTuple):
    """A text with the ``command`` that repeats what it names, and where a page shows it: its number among the
    recordings, or the id of a ``panel``."""

    text: str
    command: str = ""
    recording: int | None = None
    panel: str = ""


class Quantity(NamedTuple):
    """The name of what stands in a row, with the unit of its values: the SI unit in a file, else the one shown."""

    name: str
    unit: Unit


Cell = str | int | float | Value | VerdictCell | Link | Quantity | None
"""Contents of a cell."""


@dataclass(frozen=True)
class Column:
    """A column of cells in ``unit``; ``minor`` ones are left out where there is no room, and the ``best`` value is
    marked, if it is the smallest or the largest."""

    name: str
    unit: Unit = NONE
    minor: bool = False
    best: Literal["", "smallest", "largest"] = ""


@dataclass(frozen=True)
class Table:
    """Rows of cells under columns, of which the first ``keys`` name the row; ``footer`` are rows to compare with, such
    as targets, and ``caption`` explains. No best value is chosen among the rows ``outside``."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    footer: tuple[tuple[Cell, ...], ...] = ()
    caption: str = ""
    keys: int = 1
    outside: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        assert all(len(row) == len(self.columns) for row in (*self.rows, *self.footer)), self.title

    @property
    def units(self) -> tuple[Unit, ...]:
        """The unit of each column."""
        return tuple(column.unit for column in self.columns)

    def is_text(self, column: int) -> bool:
        """Whether a column holds words: they begin at the left."""
        return any(isinstance(row[column], str | VerdictCell | Link | Quantity) for row in self.rows)

    def best(self, column: int) -> frozenset[int]:
        """The rows of the best value of a column, if it is one that has several, and not all of them are equal."""
        extreme = self.columns[column].best
        values = {place: plain(row[column]) for place, row in enumerate(self.rows) if place not in self.outside}
        numbers = {place: value for place, value in values.items() if value is not None}
        if not extreme or len(set(numbers.values())) < 2:
            return frozenset()
        best = (min if extreme == "smallest" else max)(numbers.values())
        return frozenset(place for place, value in numbers.items() if value == best)

    def without(self, columns: Sequence[int]) -> Table:
        """The table without these columns."""
        kept = [place for place in range(len(self.columns)) if place not in columns]

        def cut(rows: Sequence[tuple[Cell, ...]]) -> tuple[tuple[Cell, ...], ...]:
            return tuple(tuple(row[place] for place in kept) for row in rows)

        chosen = tuple(self.columns[place] for place in kept)
        keys = sum(place < self.keys for place in kept)
        return Table(self.title, chosen, cut(self.rows), cut(self.footer), self.caption, keys, self.outside)

    def fitting(self, widths: Sequence[float], room: float) -> Iterator[Table]:
        """The table in parts that fit into ``room``, if its columns have these ``widths``, each with the keys."""
        keys = list(range(self.keys))
        left = list(range(self.keys, len(self.columns)))
        while True:
            taken, used = [*keys], sum(widths[place] for place in keys)
            while left and (len(taken) == len(keys) or used + widths[left[0]] <= room):
                used += widths[left[0]]
                taken.append(left.pop(0))
            part = self.without([place for place in range(len(self.columns)) if place not in taken])
            yield replace(
                part, footer=tuple(row for row in part.footer if any(c is not None for c in row[self.keys :]))
            )
            if not left:
                return


def plain(cell: Cell) -> float | None:
    """The number in a cell, in its SI unit; None if there is none, or only a limit of it."""
    if isinstance(cell, Value):
        return None if cell.beyond else cell.value
    return float(cell) if isinstance(cell, int | float) else None


def shown(cell: Cell, unit: Unit) -> str:
    """A cell in words, its numbers in the unit they are shown in."""
    match cell:
        case Value():
            unit = cell.unit or unit
            deviation = "" if cell.deviation is None else f" ± {number(cell.deviation, unit.factor)}"
            value = number(cell.value, unit.factor, exact=cell.given)
            return (f"{cell.beyond} " if cell.beyond else "") + value + deviation
        case VerdictCell():
            return cell.words or VERDICTS[cell.passed]
        case Link():
            return cell.text
        case Quantity():
            return heading(cell.name, cell.unit)
        case str():
            return cell
        case int():
            return str(cell)
        case _:
            return number(cell, unit.factor)


@dataclass(frozen=True)
class Note:
    """A sentence that a reader must know, or, if it is no ``warning``, may want to know."""

    text: str
    warning: bool = True


@dataclass(frozen=True)
class Commands:
    """Commands that repeat what was found, each with its name."""

    title: str
    pairs: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Facts:
    """How something was obtained, as pairs of a name and a text; a terminal shows those of ``brief`` alone."""

    title: str
    pairs: tuple[tuple[str, str], ...]
    brief: tuple[str, ...] = ()


@dataclass(frozen=True)
class Headline:
    """The one number, on a scale with named marks, and what it comes to. Only pages show it."""

    title: str
    value: float | None
    marks: tuple[tuple[str, float], ...]
    sentence: str


@dataclass(frozen=True)
class Beside:
    """Parts of a page in columns beside each other, where there is room: the first one narrower, or all ``equal``."""

    columns: tuple[tuple[Part, ...], ...]
    equal: bool = False


@dataclass(frozen=True)
class Choice:
    """Parts of a page of which those of one option are shown: the ``chosen`` one at first. Choices of the same ``id``
    are made together, and one without a ``label`` follows the others."""

    id: str
    label: str
    options: tuple[tuple[str, tuple[Part, ...]], ...]
    chosen: int = 0


Part = Table | Note | Commands | Facts | Headline | Plot | Heat | PosedArm | MovingArm | Beside | Choice


def flat(parts: Iterable[Part]) -> Iterator[Part]:
    """Parts, those within others one by one."""
    for part in parts:
        match part:
            case Beside():
                yield from flat(inner for column in part.columns for inner in column)
            case Choice():
                yield from flat(inner for _, option in part.options for inner in option)
            case _:
                yield part


@dataclass(frozen=True)
class Summary:
    """What every renderer shows of a document, in this order, under its title; the ``kicker`` says of what kind it is
    and under which conditions it was made."""

    title: str
    kicker: str
    parts: tuple[Part, ...]

    @property
    def tables(self) -> tuple[Table, ...]:
        """The tables alone."""
        return tuple(part for part in self.parts if isinstance(part, Table))


@dataclass(frozen=True)
class Panel:
    """A tab of a page."""

    id: str
    title: str
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Conclusion:
    """What a page comes to, in one ``sentence``, and what to do ``next``; whether the requirements are met (``passed``;
    None if they are not judged, or nothing is). Only pages show it, before all else."""

    sentence: str
    passed: bool | None = None
    next: tuple[Link, ...] = ()


@dataclass(frozen=True)
class Page:
    """A page of tabs, which begins with a ``conclusion`` if there is one."""

    title: str
    kicker: str
    panels: tuple[Panel, ...]
    conclusion: Conclusion | None = None

    def __post_init__(self) -> None:
        steps = self.conclusion.next if self.conclusion else ()
        assert {step.panel for step in steps} <= {"", *(panel.id for panel in self.panels)}, self.title

    @property
    def parts(self) -> tuple[Part, ...]:
        """All parts, those within others one by one."""
        return tuple(part for panel in self.panels for part in flat(panel.parts))
