"""Figures over several controllers, for a paper: PDF and SVG (and PNG) in the widths of a journal's columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from ..benchmark.spread import Statistic
from ..search.findings import Margin
from .comparability import same_controller
from .document import Comparable
from .evaluation import Evaluation
from .figures import window, within
from .recording import EXAMPLE, Recording
from .robustness import Robustness
from .spread import Spread
from .style import DASHED, HUES, label, legend_above, write_drawn

MM = 1 / 25.4
ONE_COLUMN, TWO_COLUMNS = 88 * MM, 180 * MM
"""Widths of a figure [inch]."""

DASHES = ("solid", (0, (4, 1.5)), (0, (1, 1)))
MARKERS = "osD^vP"
"""Controllers are told apart by colour (after Okabe and Ito), and by dashes or markers: in print as well."""

LONGEST = 34
"""Characters of a name in a legend."""

SPAN = 0.6
"""Part of the space between two rows or columns that the controllers share."""


@dataclass(frozen=True)
class Look:
    """How a controller is drawn, the same in all figures."""

    number: int
    name: str

    @property
    def hue(self) -> str:
        """Its colour."""
        return HUES[self.number % len(HUES)]

    @property
    def dash(self) -> Any:
        """Its kind of line: another one where colours repeat themselves."""
        return DASHES[self.number // len(HUES) % len(DASHES)]

    @property
    def marker(self) -> str:
        """Its marker."""
        return MARKERS[(self.number + self.number // len(HUES)) % len(MARKERS)]

    @property
    def label(self) -> str:
        """Its name in a legend."""
        return label(self.name if len(self.name) <= LONGEST else f"{self.name[: LONGEST - 1]}…")


def write_comparison(
    named: Mapping[str, Sequence[tuple[str, Comparable]]], folder: Path
) -> tuple[list[str], list[str]]:
    """Write all figures of the documents, with their names by kind, that there are data for into ``folder``, which is
    created.

    Returns the names of the figures written, without endings, and of the others.
    """
    listed = [entry for entries in named.values() for entry in entries]
    looks = {name: Look(number, name) for number, name in enumerate(dict.fromkeys(name for name, _ in listed))}
    runs = [(looks[name], each) for name, each in listed if isinstance(each, Evaluation)]
    spreads = [(looks[name], each) for name, each in listed if isinstance(each, Spread)]
    searches = [(looks[name], each) for name, each in listed if isinstance(each, Robustness)]
    cards: list[Evaluation | Spread] = [*(each for _, each in runs), *(each for _, each in spreads)]
    drawings: Mapping[str, Callable[[], Figure | None]] = {
        "comparison_time": partial(over_time, runs),
        "comparison_radius": partial(radii, searches, cards),
        "comparison_seeds": partial(seeds, spreads),
        "comparison_margins": partial(margins, searches),
    }
    return write_drawn(drawings, folder)


def over_time(runs: Sequence[tuple[Look, Evaluation]]) -> Figure | None:
    """Figures 10 and 9 side by side: TCP error [mm] and torques [Nm] over time [s], due to the chirp and the force."""
    recorded = ((look, next(iter(run.recorded(EXAMPLE)), None)) for look, run in runs)
    shown = [(look, example) for look, example in recorded if example is not None]
    if not shown:
        return None
    figure = Figure(figsize=(TWO_COLUMNS, 105 * MM), layout="constrained")
    grid = figure.subplots(3, 2, sharex="col")
    results = runs[0][1].results
    for column, (due_to_force, criterion) in enumerate(((False, "B7"), (True, "B5"))):
        for look, example in shown:
            begin, end = window(example, due_to_force)
            line = {"color": look.hue, "linestyle": look.dash}
            inside = within(example, begin, end)
            grid[0, column].plot(example.motion[inside, 0], 1e3 * example.error[inside], label=look.label, **line)
            t, *torques = _torques(example, begin, end)
            for row, torque in enumerate(torques, start=1):
                grid[row, column].plot(t, torque, **line)
        target = 1e3 * results.criteria[criterion].target
        grid[0, column].axhline(target, **DASHED)
        grid[0, column].set_title(
            f"{'Force' if due_to_force else 'Chirp'} (target {criterion}: {target:g} mm)", fontsize=8
        )
        grid[0, column].set(ylim=(0, None))
        grid[2, column].set(xlabel="Time [s]", xlim=(begin, end))
    for row, words in enumerate(("TCP error [mm]", "Torque $u_{m1}$ [Nm]", "Torque $u_{m2}$ [Nm]")):
        grid[row, 0].set_ylabel(words)
    _legend(figure, grid[0, 0])
    return figure


def radii(searches: Sequence[tuple[Look, Robustness]], cards: Sequence[Evaluation | Spread]) -> Figure | None:
    """V over the factor on the tolerances of Table 1 at which A1 to A3 fail: right and low is better. A line leads from
    V of the scorecard to V that the search found."""
    shown = [(look, found) for look, found in searches if found.radius is not None]
    if not shown:
        return None
    figure = Figure(figsize=(ONE_COLUMN, 70 * MM), layout="constrained")
    axes = figure.subplots()
    for look, found in shown:
        radius = found.radius
        assert radius is not None
        card = next((each for each in cards if same_controller(each.head, found.head)), None)
        values = {"none": None if card is None else card.V, "full": found.cost}
        known = {fill: value for fill, value in values.items() if value is not None}
        at = radius.limit if radius.stability is None else radius.stability
        marker = ">" if radius.stability is None else look.marker
        axes.plot([at] * len(known), list(known.values()), color=look.hue, linewidth=0.6)
        for fill, value in known.items():
            label = look.label if value is list(known.values())[-1] else None
            axes.plot([at], [value], marker, color=look.hue, markersize=5, fillstyle=fill, label=label)
    axes.axhline(shown[0][1].rules.cost.target, **DASHED)
    axes.axvline(1.0, **DASHED)
    axes.set(
        xlabel="Tolerances at which A1-A3 fail / Table 1 (▸: none found)", ylabel="V (open: scorecard, filled: found)"
    )
    legend_above(axes)
    return figure


def seeds(spreads: Sequence[tuple[Look, Spread]]) -> Figure | None:
    """V and the criteria relative to their targets: mean and standard deviation over the seeds."""
    if not spreads:
        return None
    rules = spreads[0][1].rules
    targets = {"V": rules.cost.target} | {name: spec.target for name, spec in rules.criteria.items()}
    figure = Figure(figsize=(ONE_COLUMN, 65 * MM), layout="constrained")
    axes = figure.subplots()
    for number, (look, spread) in enumerate(spreads):
        found: Mapping[str, Statistic] = {"V": spread.cost, **spread.criteria}
        known = [
            (place, each, targets[name]) for place, (name, each) in enumerate(found.items()) if each.mean is not None
        ]
        axes.errorbar(
            [place + _offset(number, len(spreads)) for place, _, _ in known],
            [(each.mean or 0.0) / target for _, each, target in known],
            [(each.deviation or 0.0) / target for _, each, target in known],
            fmt=look.marker,
            color=look.hue,
            markersize=3,
            capsize=1.5,
            linewidth=0.8,
            label=look.label,
        )
    axes.axhline(1.0, **DASHED)
    axes.set_xticks(range(len(targets)), list(targets))
    axes.set(ylabel="Mean ± standard deviation / target", ylim=(0, None))
    legend_above(axes)
    return figure


def margins(searches: Sequence[tuple[Look, Robustness]]) -> Figure | None:
    """The smallest gain factors and delays [ms] found to fail, of both axes, beside what A1 and A2 ask for."""
    entries = [(look, found) for look, found in searches if found.margins]
    if not entries:
        return None
    tests = entries[0][1].rules.tests
    figure = Figure(figsize=(TWO_COLUMNS, 60 * MM), layout="constrained")
    kinds = (
        ("gain", "Factor of the loop gain", 1.0, max(test.gain for test in tests)),
        ("delay", "Additional delay [ms]", 1e3, max(test.delay for test in tests) * 1e3),
    )
    for axes, (kind, words, factor, asked) in zip(figure.subplots(1, 2), kinds, strict=True):
        for number, (look, found) in enumerate(entries):
            points: dict[str, Any] = {"color": look.hue, "markersize": 4, "linestyle": "none"}
            for axis in (1, 2):
                margin = found.margins.get(f"{kind}_{axis}")
                if margin is not None:
                    height = axis + _offset(number, len(entries))
                    marker = ">" if margin.value is None else look.marker
                    axes.plot(_end(margin) * factor, height, marker, **points)
            axes.plot([], [], look.marker, **points, label=look.label)
        axes.axvline(asked, **DASHED)
        axes.set_yticks((1, 2), ("axis 1", "axis 2"))
        axes.set(xlabel=f"{words} (▸: none found up to there)", ylim=(2.5, 0.5))
        if kind == "gain":
            axes.set_xscale("log")
            axes.xaxis.set(major_locator=LogLocator(subs=(1, 2, 5)), minor_locator=NullLocator())
            axes.xaxis.set_major_formatter("{x:g}")
            _legend(figure, axes)
    return figure


def _torques(example: Recording, begin: float, end: float) -> tuple[np.ndarray, ...]:
    """Times [s] and torques [Nm] of both motors from ``begin`` to ``end``."""
    inside = (example.torque[:, 0] >= begin) & (example.torque[:, 0] <= end)
    t, first, second = example.torque[inside].T
    return t, first, second


def _end(margin: Margin) -> float:
    return margin.limit if margin.value is None else margin.value


def _offset(number: int, count: int) -> float:
    """Where a controller stands beside the others."""
    return SPAN * ((number + 0.5) / count - 0.5)


def _legend(figure: Figure, axes: Axes) -> None:
    """One legend above all diagrams."""
    handles, names = axes.get_legend_handles_labels()
    columns = min(3, len(names))
    figure.legend(handles, names, loc="outside upper center", ncols=columns, frameon=False, fontsize=7)
