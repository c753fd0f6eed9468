"""The one type of plots. Documents declare them; ``echarts.py`` and ``drawing.py`` show them, and know no document.

Values are in SI units; an axis says in which unit they are shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .units import NONE, Unit, heading, number

Colour = Literal[
    "one", "two", "three", "four", "five", "six",
    "ink", "soft", "muted", "accent", "good", "bad", "limit",
    "b1", "b2", "b3", "b4", "b5", "b6", "b7",
]  # fmt: skip
"""What a colour stands for: one thing after another, what is meant by it, or the criterion that an area belongs to."""

HUES: tuple[Colour, ...] = ("one", "two", "three", "four", "five", "six")
"""Colours of things that are told apart, one after the other."""

Dash = Literal["solid", "dashed", "dotted", "dashdot"]
DASHES: tuple[Dash, ...] = ("solid", "dashed", "dashdot", "dotted")

Symbol = Literal["", "circle", "square", "triangle", "diamond", "ring", "frame", "left", "right", "cross", "plus"]

SHAPES: tuple[Symbol, ...] = ("circle", "square", "triangle", "diamond", "ring", "frame")

Numbers = Sequence[float | None] | np.ndarray
"""Values, None where there is none. An array has single precision on a page, where it takes less room."""


def hue(number: int) -> Colour:
    """The colour of the ``number``-th thing."""
    return HUES[number % len(HUES)]


def dash(number: int) -> Dash:
    """Its kind of line: another one than its neighbours', for print without colours, and another one where colours
    repeat themselves."""
    return DASHES[(number + number // len(HUES)) % len(DASHES)]


def shape(number: int) -> Symbol:
    """Its symbol: the same of symbols."""
    return SHAPES[(number + number // len(SHAPES)) % len(SHAPES)]


@dataclass(frozen=True)
class Axis:
    """An axis from ``low`` to ``high``, or as far as the values go; ``names`` stand at its places 0, 1, 2, ... instead
    of numbers, from below upwards unless it is ``inverse``."""

    title: str = ""
    unit: Unit = NONE
    low: float | None = None
    high: float | None = None
    logarithmic: bool = False
    inverse: bool = False
    names: tuple[str, ...] = ()

    @property
    def heading(self) -> str:
        """Title and unit."""
        return heading(self.title, self.unit)

    def shown(self, value: float) -> float:
        """A value in the unit that is shown."""
        return value * self.unit.factor


# Arrays that are compared give arrays, not a truth value: what may hold some is equal to itself alone.


@dataclass(frozen=True, eq=False)
class Line:
    """Points joined by a line, or by steps that hold a value until the next one. Lines of one ``name`` share an entry
    of the legend. ``labels`` stand at the points, the last one before its
    point if there is room ``inside`` alone; what is ``faint`` is one of many, and is not read off. Of arrays,
    ``rows`` are the first row and the end of the part that is drawn."""

    name: str
    x: Numbers
    y: Numbers
    colour: Colour = "one"
    dash: Dash = "solid"
    width: float = 1.4
    step: bool = False
    symbol: Symbol = ""
    labels: tuple[str, ...] = ()
    faint: bool = False
    above: bool = False
    inside: bool = False
    rows: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class Scatter:
    """Points, each with ``words`` to read when it is pointed at, and a bar of ``deviation`` up and down;
    ``hollow`` ones are an outline."""

    name: str
    x: Numbers
    y: Numbers
    colour: Colour = "one"
    symbol: Symbol = "circle"
    size: float = 8.0
    words: tuple[str, ...] = ()
    deviation: tuple[float, ...] = ()
    faint: bool = False
    hollow: bool = False


@dataclass(frozen=True, eq=False)
class Bars:
    """A bar for each name of the axis that has names; those with one ``stack`` stand on each other. ``colours`` are
    those of single bars, ``labels`` stand at their ends; what is ``hatched`` is of another kind than the rest."""

    name: str
    values: tuple[float | None, ...]
    colour: Colour = "accent"
    stack: str = ""
    labels: tuple[str, ...] = ()
    colours: tuple[Colour, ...] = ()
    hatched: bool = False


Series = Line | Scatter | Bars


@dataclass(frozen=True)
class Level:
    """A named line across a plot, ``upright`` or not, or from ``start`` to ``stop`` of it: a target or a limit."""

    value: float
    name: str
    start: float | None = None
    stop: float | None = None
    upright: bool = False
    colour: Colour = "limit"
    dash: Dash = "dashed"


@dataclass(frozen=True)
class Band:
    """A shaded part of the x axis."""

    low: float
    high: float
    name: str
    shaded: bool = True


@dataclass(frozen=True)
class Window:
    """A part of a plot that is worth a look: from and to on x and y, as far as they are given."""

    name: str
    x: tuple[float, float] | None = None
    y: tuple[float | None, float | None] = (None, None)


@dataclass(frozen=True, eq=False)
class Plot:
    """Series over common axes, with levels and bands; ``text`` says what is seen, also to those who cannot see it, and
    the points alone do if it is empty.

    It is first shown in ``window``, and a page has a button for each of ``windows``. Plots of one ``group`` are zoomed
    together. ``square`` axes have one scale. ``height`` [pixel] is that on a page; with names upwards, of one row.
    """

    id: str
    title: str
    x: Axis
    y: Axis
    series: tuple[Series, ...]
    levels: tuple[Level, ...] = ()
    bands: tuple[Band, ...] = ()
    text: str = ""
    zoom: bool = False
    window: Window | None = None
    windows: tuple[Window, ...] = ()
    group: str = ""
    square: bool = False
    height: int = 420

    def __post_init__(self) -> None:
        for one in self.series:
            lengths = {len(one.values), len(self.names)} if isinstance(one, Bars) else {len(one.x), len(one.y)}
            assert len(lengths) == 1, f"{self.id}: {one.name}"

    @property
    def words(self) -> str:
        """The ``text``, or what the points are."""
        if self.text:
            return self.text
        told = (f"{one.name}: {', '.join(self._points(one))}" for one in self.series if not isinstance(one, Bars))
        return f"{self.title}. {'. '.join(told)}."

    def _points(self, one: Line | Scatter) -> list[str]:
        right, up = self.x.unit.factor, self.y.unit.factor
        return [f"{number(x, right)}: {number(y, up)}" for x, y in zip(one.x, one.y, strict=True)]

    @property
    def names(self) -> tuple[str, ...]:
        """The names on one of the axes, if there are any."""
        return self.y.names or self.x.names

    @property
    def flat(self) -> bool:
        """Whether its bars lie: the names stand beside each other upwards."""
        return bool(self.y.names)


@dataclass(frozen=True)
class Layer:
    """One quantity over the cells of a map, row by row: ``symbol`` is its short name, ``of`` whose it is, ``target`` a
    value to compare with. Those that are ``marked`` are wrong in some way."""

    name: str
    values: tuple[float | None, ...]
    symbol: str = ""
    of: str = ""
    target: float | None = None
    marked: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Heat:
    """A map of cells in colours, the first row at the top. ``layers`` are its quantities, of which one is chosen.

    The layers of several ``of`` are shown as differences of two that are chosen; ``smaller`` says what it means if the
    first one is smaller. ``cells`` name the cells, None where there is none. ``limits`` are the ends of the colours, if
    not those of the values; a map ``around_zero`` has its middle there.
    """

    id: str
    title: str
    x: Axis
    y: Axis
    layers: tuple[Layer, ...]
    cells: tuple[str | None, ...]
    text: str = ""
    smaller: str = ""
    limits: tuple[float, float] | None = None
    around_zero: bool = False

    def __post_init__(self) -> None:
        count = len(self.x.names) * len(self.y.names)
        assert all(len(values) == count for values in (self.cells, *(layer.values for layer in self.layers))), self.id


@dataclass(frozen=True)
class PosedArm:
    """The arm with links of these lengths [m], in the pose of the cell of ``heat`` that is pointed at: link angles
    [rad] by cell, None where there is none."""

    id: str
    links: tuple[float, float]
    heat: str
    poses: tuple[tuple[float, float] | None, ...]


@dataclass(frozen=True, eq=False)
class Moved:
    """A recorded motion of the arm about its link angles ``rest`` [rad].

    ``motion`` (shape (N, 5)) has time [s], offsets of the tool along x and z [m], changes of both link angles [rad];
    ``torque`` (shape (M, 3)) time [s] and both torques [N.m], or (shape (M, 5)) their bounds, the upper ones last. A
    ``force`` [N], if there is one, acts in the time ``window`` [s], and ``more`` forces in theirs; ``places`` are times
    [s] worth a look.
    """

    name: str
    rest: tuple[float, float]
    motion: np.ndarray
    torque: np.ndarray
    end: float
    force: tuple[float, float]
    window: tuple[float, float]
    places: tuple[tuple[str, float], ...]
    more: tuple[tuple[tuple[float, float], tuple[float, float]], ...] = ()


@dataclass(frozen=True, eq=False)
class MovingArm:
    """The arm with links of these lengths [m] in motion, its deviations magnified; one of ``moved`` is chosen, together
    with the ``choice`` of that id. ``circles`` around the tool have a colour and a radius [m]."""

    id: str
    choice: str
    links: tuple[float, float]
    circles: tuple[tuple[Colour, float], ...]
    moved: tuple[Moved, ...]
