"""Plots of a search for the worst case: its path, what matters, and how far the controller holds."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..benchmark.results import Rules
from ..search.findings import ConfigurationFound, CriterionSearched, Effect, Margin, PeakFound, Radius, Step
from ..views.plot import Axis, Band, Bars, Colour, Heat, Layer, Level, Line, Plot, hue
from ..views.units import MILLISECOND, NONE, SHOWN, Unit, heading, number
from .case_plots import degrees, pose_words
from .wording import parameter_words

SIGNS = {1.0: "+", -1.0: "−", 0.0: "nominal"}
"""Ends of a parameter's range."""

CROWDED = 0.15
"""Part of an axis that the words at the end of a bar take."""

ROW = 40
"""Height of the row of a margin [pixel]."""


def searched(criteria: Mapping[str, CriterionSearched], path: Iterable[Step]) -> list[str]:
    """The criteria that were searched for."""
    steps = list(path)
    return [name for name in criteria if any(name in step.worst for step in steps)]


def path_of_search(rules: Rules, criteria: Mapping[str, CriterionSearched], path: Sequence[Step]) -> Plot:
    """V of what was found so far and the largest value of each criterion, by their targets, over the budget spent."""
    names, target = searched(criteria, path), rules.cost.target
    spent = [step.spent for step in path]
    costs = [None if step.cost is None else step.cost / target for step in path]
    values = {name: [_ratio(step, name, rules) for step in path] for name in names}
    largest = max(1.0, *(value or 0.0 for column in (costs, *values.values()) for value in column), 1.0)
    stages = _stages(path)
    last = (f"{name} {_shown(criteria[name].worst_case.value, criteria[name].unit)}" for name in names)
    parts = (f"{place} {name} ({number(end - begin)})" for place, (name, begin, end) in enumerate(stages, start=1))
    text = (
        "V of what was found so far, and the largest value of each criterion at any pose, by their targets: lower "
        f"bounds, which a longer search may exceed. Stages: {', '.join(parts)}; in brackets, whole cases. Found at "
        f"last: V {number(path[-1].cost if path else None)}, {', '.join(last)}."
    )
    lines = (Line(name, spent, values[name], hue(place % 3), step=True, symbol="circle")
             for place, name in enumerate(names))  # fmt: skip
    return Plot(
        "path-of-search",
        "The path of the search",
        Axis("Budget spent [whole cases]", low=0.0, high=spent[-1] if spent else 1.0),
        Axis("Found / target", low=0.0, high=1.2 * largest),
        (Line("V", spent, costs, "ink", width=3.0, symbol="circle"), *lines),
        (Level(1.0, "target"),),
        tuple(Band(begin, end, str(place + 1), place % 2 == 0) for place, (_, begin, end) in enumerate(stages)),
        text,
    )


def _ratio(step: Step, name: str, rules: Rules) -> float | None:
    value = step.worst.get(name)
    return None if value is None else value / rules.criteria[name].target


def _shown(value: float | None, unit: str) -> str:
    return f"{number(value, SHOWN[unit].factor)} {SHOWN[unit].shown}"


def _stages(path: Iterable[Step]) -> list[tuple[str, float, float]]:
    """The stages in order, with the whole cases that they began and ended at; what has parts is one stage."""
    stages: list[tuple[str, float, float]] = []
    begin = 0.0
    for step in path:
        name = re.split(r", \d| of ", step.stage)[0]
        if stages and stages[-1][0] == name:
            stages[-1] = (name, stages[-1][1], step.spent)
        else:
            stages.append((name, begin, step.spent))
        begin = step.spent
    return stages


def effects(rules: Rules, name: str, listed: Sequence[Effect]) -> Plot:
    """What each end of a parameter adds to the worst value of a criterion."""
    unit = SHOWN[rules.criteria[name].unit]
    chosen = [effect for effect in listed if effect.criterion == name]
    changed = sorted(
        ((-effect.change, effect) for effect in chosen if effect.change is not None), key=lambda row: -row[0]
    )
    changes = tuple(change for change, _ in changed)
    bars = Bars(
        f"{name} falls by",
        changes,
        labels=tuple(number(change, unit.factor) for change in changes),
        colours=tuple("soft" if change < 0.0 else "accent" for change in changes),
    )
    text = (
        f"By how much the worst {name} falls if one parameter alone goes to its other end: + and − are the ends at "
        "which it stands in the worst arm. Where the bar points to the left, the other end is worse."
    )
    if lost := len(chosen) - len(changed):
        text += f" For {lost} parameters there is no value."
    return Plot(
        f"effects-{name}",
        "Which parameters matter",
        Axis(f"What this end adds to {name}", unit),
        Axis(names=tuple(_end_words(effect) for _, effect in changed), inverse=True),
        (bars,),
        text=text,
        height=26,
    )


def _end_words(effect: Effect) -> str:
    """A parameter and its end, without a break before the number of the axis."""
    words = parameter_words(effect.parameter).replace(" axis ", " axis\u00a0")
    return f"{effect.parameter} {words}\u00a0{SIGNS.get(effect.sign, number(effect.sign))}"


def ends(
    rules: Rules, name: str, peaks: Sequence[PeakFound], configurations: Sequence[ConfigurationFound]
) -> tuple[Heat, ...]:
    """At which end of its range each parameter stands in the worst arm of a criterion, by configuration."""
    poses = {entry.index: (entry.q_a2, entry.q_a1) for entry in configurations}
    shown = [peak for peak in peaks if peak.criterion == name and peak.configuration in poses]
    shown.sort(key=lambda peak: poses[peak.configuration])
    if not shown:
        return ()
    unit, parameters = SHOWN[rules.criteria[name].unit], list(shown[0].deviations)
    angles = [(degrees(q_a1), degrees(q_a2)) for q_a2, q_a1 in (poses[peak.configuration] for peak in shown)]
    columns = (
        f"{first}\n{second}\n{number(peak.value, unit.factor)}"
        for (first, second), peak in zip(angles, shown, strict=True)
    )
    cells = (f"{one}, q_a1 {first}, q_a2 {second}" for one in parameters for first, second in angles)
    values = tuple(peak.deviations[one] for one in parameters for peak in shown)
    text = (
        f"at which end of its range each parameter stands in the worst arm found for {name} at each configuration: 1 "
        "the upper end (orange), -1 the lower one (purple), 0 nominal." + _noise_words(name, shown)
    )
    heat = Heat(
        f"ends-{name}",
        "The worst arm by pose",
        Axis(f"q_a1, q_a2, {heading(name, unit)}", names=tuple(columns)),
        Axis("parameter", names=tuple(parameters)),
        (Layer("Half-widths", values),),
        tuple(cells),
        text,
        limits=(-1.0, 1.0),
        around_zero=True,
    )
    return (heat,)


def _noise_words(name: str, peaks: Sequence[PeakFound]) -> str:
    """How far a criterion is up to the noise; empty where nothing is known of it."""
    shares = [
        min(value for value in peak.other_noise if value is not None) / peak.value
        for peak in peaks
        if peak.value and any(value is not None for value in peak.other_noise)
    ]
    if not shares:
        return ""
    return (
        f" With other realizations of the noise, {name} of the same arm is at least {number(min(shares))} of the value "
        f"shown ({len(shares)} configurations)."
    )


def by_configuration(rules: Rules, configurations: Sequence[ConfigurationFound]) -> Plot:
    """V_k of each configuration: of the list, and with all that was found there."""
    ranked = [(entry.found, entry) for entry in configurations if entry.found is not None]
    more = sum(entry.protocol is not None and value > entry.protocol for value, entry in ranked)
    text = "No configuration has a value."
    if ranked:
        largest, worst = max(ranked, key=lambda row: row[0])
        text = (
            "V_k of eq. (14) by configuration (q_a1 / q_a2): of the list, and with all that was found there. The "
            f"largest is {number(largest)} at {pose_words((worst.q_a1, worst.q_a2))}; the search found more than the "
            f"list at {more} of {len(configurations)}."
        )
    values = tuple(entry.found for entry in configurations)
    return Plot(
        "configurations-chart",
        "V_k over the workspace",
        Axis("V_k"),
        Axis(names=tuple(pose_words((entry.q_a1, entry.q_a2)) for entry in configurations), inverse=True),
        (
            Bars("found", values, labels=tuple(map(number, values))),
            Bars("of the list", tuple(entry.protocol for entry in configurations), "soft"),
        ),
        (Level(rules.cost.target, "target", upright=True),),
        text=text,
        height=34,
    )


class Held(NamedTuple):
    """From where to where the controller holds; ``open`` if no failure was found up to there, and ``refined`` if less
    was tried. ``low_words`` are those of the lower end, empty if it is none."""

    name: str
    low: float
    high: float
    is_open: bool
    refined: bool
    low_words: str = ""


def margins(rules: Rules, smallest: Mapping[str, Margin], radius: Radius | None) -> tuple[Plot, ...]:
    """How far the controller holds: the loop gain, the delay, and the tolerances."""
    gain, delay = (max(getattr(test, name) for test in rules.tests) for name in ("gain", "delay"))
    gains, delays, radii = [], [], []
    for axis in (1, 2):
        if (margin := smallest.get(f"gain_{axis}")) is not None:
            down = smallest[f"gain_{axis}_down"] if f"gain_{axis}_down" in smallest else Margin(None, 1.0)
            low = "" if down.value is None else number(down.value) + ("" if down.refined else " or more")
            gains.append(Held(f"axis {axis}", _end(down), _end(margin), margin.value is None, margin.refined, low))
        if (margin := smallest.get(f"delay_{axis}")) is not None:
            delays.append(Held(f"axis {axis}", 0.0, _end(margin), margin.value is None, margin.refined))
    if radius is not None:
        for name, value, refined in (
            ("V", radius.cost, radius.cost_refined),
            ("A1 to A3", radius.stability, radius.stability_refined),
        ):
            radii.append(Held(name, 0.0, radius.limit if value is None else value, value is None, refined))
    drawn = (
        _held("gain", "Factor of the loop gain", NONE, gains, gain, "A1"),
        _held("delay", "Additional delay", MILLISECOND, delays, delay, "A2"),
        _held("radius", "Radius: factor on the tolerances of Table 1", NONE, radii, 1.0, "Table 1"),
    )
    plots = [plot for plot in drawn if plot.names]
    return tuple(replace(plot, title="" if place else "Margins and radius") for place, plot in enumerate(plots))


def _end(margin: Margin) -> float:
    return margin.limit if margin.value is None else margin.value


def _held(id: str, title: str, unit: Unit, rows: Sequence[Held], needed: float, words: str) -> Plot:
    """Bars that end where a member was found to fail, beside what is asked for."""
    high = 1.15 * max([needed, *(row.high for row in rows)])
    low = 0.4 * min([0.5, *(row.low for row in rows)]) if id == "gain" else 0.0
    x = Axis(title, unit, low, high, logarithmic=id == "gain")
    lines = tuple(_bar(x, unit, needed, place, row) for place, row in enumerate(rows))
    told = (f"{row.name} {f'{row.low_words} to ' if row.low_words else ''}{_high_words(row, unit)}" for row in rows)
    asked = number(needed, unit.factor)
    text = (
        f"{title}: {', '.join(told)} ({words} asks for {asked}). A bar ends where a member of the uncertainty "
        "description was found to fail; orange: not beyond what is asked for."
    )
    if not all(row.refined for row in rows):
        text += " Or less (grey): the budget did not last to try what fails there with less."
    level = Level(needed, f"{words}: {asked}", upright=True)
    names = Axis(names=tuple(row.name for row in rows), inverse=True)
    return Plot(f"margins-{id}", "", x, names, lines, (level,), text=text, height=ROW)


def _bar(axis: Axis, unit: Unit, needed: float, place: int, row: Held) -> Line:
    """A thick line from one end to the other, with its values beside it: the last one on it where it would stand on
    the line of what is needed."""
    crowded = _place(axis, row.high) < _place(axis, needed) < _place(axis, row.high) + CROWDED
    labels = (row.low_words, _high_words(row, unit))
    colour: Colour = "bad" if not row.is_open and row.high <= needed else "good" if row.refined else "soft"
    y = (float(place), float(place))
    return Line(axis.title, (row.low, row.high), y, colour, width=16.0, labels=labels, inside=crowded)


def _high_words(row: Held, unit: Unit) -> str:
    words = f"{'> ' if row.is_open else ''}{number(row.high, unit.factor)}"
    return words if row.refined else f"{words} or less"


def _place(axis: Axis, value: float) -> float:
    """Where a value stands on an axis that has both ends, from 0 to 1."""
    assert axis.low is not None and axis.high is not None
    low, high, at = (math.log(end) if axis.logarithmic else end for end in (axis.low, axis.high, value))
    return (at - low) / (high - low)
