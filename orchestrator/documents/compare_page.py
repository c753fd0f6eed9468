"""What the page ``compare.html`` shows beside its tables: bars, difference maps, worst cases laid over each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from ..benchmark.results import Rules
from ..benchmark.spread import Statistic
from ..views.plot import Axis, Band, Bars, Colour, Level, Plot, Scatter, Symbol, Window, dash, hue
from ..views.table import Choice, Commands, Note, Panel, Part
from ..views.units import number
from . import case_plots
from .case_plots import Curve
from .commands import recording_command
from .comparability import same_controller
from .document import Comparable
from .evaluation import Evaluation
from .recording import Recording, largest_error, shortened
from .reliability import Reliability
from .report_page import workspace
from .robustness import Robustness
from .spread import Spread

FILE = "compare.html"

CURVE_ROWS = 10_000
"""Most rows of a worst case."""

Named = Mapping[str, Sequence[tuple[str, Comparable]]]
"""Documents with their names, by kind."""

SHAPES: tuple[Symbol, ...] = ("circle", "square", "triangle", "diamond", "ring", "frame")
"""Controllers are told apart by colour, and by dashes or symbols: in print as well."""

SPAN = 0.6
"""Part of the room of a name that the controllers share."""


def panels(named: Named, everything: Sequence[tuple[str, Comparable]] = ()) -> tuple[Panel, ...]:
    """The tabs of charts that there are documents for; ``everything`` are those of all groups."""
    made: list[Panel] = []
    if rows := bounds(everything):
        made.append(Panel("bounds", "Bounds of V", (_bounds(rows),)))
    runs = labelled(named)
    if runs:
        made.append(Panel("bars", "Criteria", (_ratios(runs), _stack(runs))))
        if len(runs) > 1:
            first = next(iter(runs.values())).results
            scores = {label: run.results.configurations for label, run in runs.items()}
            made.append(Panel("difference", "Workspace", workspace(first.plant, first.rules, scores)))
        made.append(Panel("overlay", "Worst cases", (_overlay(runs),)))
    spreads = {
        f"{place}. {name}": document
        for place, (name, document) in enumerate(named.get(Spread.KIND, ()), start=1)
        if isinstance(document, Spread)
    }
    if spreads:
        made.append(Panel("seeds", "Seeds", (seeds(spreads, {label: place for place, label in enumerate(spreads)}),)))
    return tuple(made)


def labelled(named: Named) -> dict[str, Evaluation]:
    """The evaluations, which stand in the order of the first leaderboard, with their rank there before the name: by it
    they are told apart where names are cut."""
    runs: dict[str, Evaluation] = {}
    for place, (name, document) in enumerate(named.get(Evaluation.KIND, ()), start=1):
        if isinstance(document, Evaluation):
            runs[f"({place}) {name}" if document.rank.reason else f"{place}. {name}"] = document
    return runs


# What V consists of.


def _ratios(runs: Mapping[str, Evaluation]) -> Plot:
    rules = next(iter(runs.values())).results.rules
    ratios = {label: tuple(_ratio(run, name) for name in rules.criteria) for label, run in runs.items()}
    told = (f"{label}: {', '.join(map(number, values))}" for label, values in ratios.items())
    high = _reaching(1.0, (value for values in ratios.values() for value in values))
    return Plot(
        "bars-chart",
        "Criteria relative to their targets",
        Axis(names=tuple(rules.criteria)),
        Axis("Value / target", high=high),
        tuple(Bars(label, values, hue(place)) for place, (label, values) in enumerate(ratios.items())),
        (Level(1.0, "target"),),
        text=f"B1 to B7 relative to their targets. {'. '.join(told)}.",
    )


def _ratio(run: Evaluation, name: str) -> float | None:
    score = run.results.criteria[name]
    return None if score.value is None else score.value / score.target


def _reaching(least: float, values: Iterator[float | None]) -> float | None:
    """The end of an axis that shows ``least`` even where all values are smaller; None if some are not."""
    return 1.2 * least if max((value or 0.0 for value in values), default=0.0) < least else None


def _stack(runs: Mapping[str, Evaluation]) -> Plot:
    rules = next(iter(runs.values())).results.rules
    colours: tuple[Colour, ...] = ("b1", "b2", "b3", "b4", "b5", "b6", "b7")
    series = tuple(
        Bars(name, tuple(run.results.criteria[name].share for run in runs.values()), colours[place % 7], "V")
        for place, name in enumerate(rules.criteria)
    )
    return Plot(
        "stack-chart",
        "What V consists of",
        Axis("V", high=_reaching(rules.cost.target, (run.cost for run in runs.values()))),
        Axis(names=tuple(runs), inverse=True),
        series,
        (Level(rules.cost.target, "target", upright=True),),
        text="V of every run, made up of the shares of B1 to B7.",
        height=36,
    )


# What is known of V.


class Mark(NamedTuple):
    """What a document says of V: of which kind, in words, and the value."""

    kind: str
    words: str
    V: float


LOOKS: Mapping[str, tuple[str, Symbol, Colour]] = {
    "scorecard": ("scorecard", "circle", "soft"),
    "sampled": ("sampled: at most, for nearly all draws", "left", "two"),
    "found": ("found: at least, in the worst case", "right", "one"),
}


def bounds(everything: Sequence[tuple[str, Comparable]]) -> list[tuple[str, Comparable, list[Mark]]]:
    """By controller that was searched or sampled, what is known of its V: of scorecards, of a search's list, what a
    search found (at least), and the quantile that a sample bounds."""
    rows: list[tuple[str, Comparable, list[Mark]]] = []
    for name, document in everything:
        row = next((row for row in rows if same_controller(row[1].head, document.head)), None)
        if row is None:
            rows.append(row := (name, document, []))
        row[2].extend(_marks(document))
    return [row for row in rows if any(mark.kind in ("found", "sampled") for mark in row[2])]


def _marks(document: Comparable) -> Iterator[Mark]:
    said: list[tuple[str, str, float | None]] = []
    match document:
        case Evaluation():
            said = [("scorecard", f"on {document.head.protocol}", document.results.cost)]
        case Robustness():
            words = f"found by a search of {document.spent:.0f} whole cases: at least"
            listed = f"on {document.head.protocol}, the search's list"
            said = [("scorecard", listed, document.protocol_cost), ("found", words, document.cost)]
        case Reliability():
            words = f"exceeded by at most {document.probability:g} of all draws, at {document.confidence:g} confidence"
            said = [("sampled", words, document.cost.bound)]
    yield from (Mark(kind, words, V) for kind, words, V in said if V is not None)


def _bounds(rows: Sequence[tuple[str, Comparable, list[Mark]]]) -> Plot:
    target = rows[0][1].head.rules.cost.target
    series = []
    for kind, (name, symbol, colour) in LOOKS.items():
        marks = [
            (mark, float(place)) for place, (_, _, listed) in enumerate(rows) for mark in listed if mark.kind == kind
        ]
        words = tuple(f"{mark.words}: V {number(mark.V)}" for mark, _ in marks)
        values, places = [mark.V for mark, _ in marks], [place for _, place in marks]
        series.append(Scatter(name, values, places, colour, symbol, 14.0, words))
    told = (f"{name}: {'; '.join(f'{number(mark.V)} {mark.words}' for mark in listed)}" for name, _, listed in rows)
    high = _reaching(target, (mark.V for _, _, listed in rows for mark in listed))
    return Plot(
        "bounds-chart",
        "V, found and sampled",
        Axis("V", low=0.0, high=high),
        Axis(names=tuple(name for name, _, _ in rows), inverse=True),
        tuple(series),
        (Level(target, "target", upright=True),),
        text="What is known of V. A scorecard is a sample or a list; what a search found bounds the worst case from "
        f"below; a sample bounds what nearly all draws stay below. {'. '.join(told)}.",
        height=48,
    )


# Worst cases laid over each other.


def _overlay(runs: Mapping[str, Evaluation]) -> Part:
    rules = next(iter(runs.values())).results.rules
    options = []
    for name in ("B5", "B6", "B7"):
        shown = {label: next(reversed(run.recorded(name)), None) for label, run in runs.items()}
        if any(shown.values()):
            options.append((f"{name}, {rules.criteria[name].title.lower()}", _worst(name, rules, runs, shown)))
    return Choice("which", "Worst case of", tuple(options)) if options else Note(
        "These runs were made without trajectories."
    )  # fmt: skip


def _worst(
    name: str, rules: Rules, runs: Mapping[str, Evaluation], shown: Mapping[str, Recording | None]
) -> tuple[Part, ...]:
    """The worst case of one criterion of all runs: errors, torques, and commands."""
    curves = [
        Curve(label, shortened(entry, CURVE_ROWS), hue(place), dash=dash(place))
        for place, (label, entry) in enumerate(shown.items())
        if entry is not None
    ]
    entries = {label: entry for label, entry in shown.items() if entry is not None}
    longest = max(entries.values(), key=lambda entry: entry.about.time)
    window = _window(name, rules, longest, list(entries.values()))
    told = ", ".join(f"{label} in {entry.about.id}" for label, entry in entries.items())
    id = f"overlay-{name}"
    error = case_plots.errors(
        f"{id}-error",
        "TCP position error",
        curves,
        rules,
        window,
        text=f"TCP error of each run's own worst case of {name}: {told}.",
        bands=(Band(*longest.about.window, "force"),),
        of=longest,
        group=id,
        height=420,
    )
    torques = (_torques(id, curves, axis, rules, window) for axis in (1, 2))
    commands = (
        (f"{label}: {entry.about.id}", recording_command(runs[label].results.head, entry.about))
        for label, entry in entries.items()
    )
    return error, *torques, Commands("repeat these cases", tuple(commands))


def _window(name: str, rules: Rules, longest: Recording, entries: Sequence[Recording]) -> Window:
    begin, end = longest.about.window
    settled = end + rules.criteria["B6"].target
    if name == "B5":
        return Window("", (begin - 0.2, end + 1.0))
    if name == "B7":
        return Window("", (0.0, longest.about.chirp[1] + 0.5))
    largest = max(largest_error(entry, settled) or 0.0 for entry in entries)
    return Window("", (end, end + 5.0), (0.0, case_plots.settling_top(largest, rules)))


def _torques(id: str, curves: Sequence[Curve], axis: int, rules: Rules, window: Window) -> Plot:
    limit = rules.torque_limit[axis - 1]
    most = (f"{curve.name} {number(curve.recording.largest_torque(axis))} Nm" for curve in curves)
    text = f"Torque of axis {axis} in the same cases, limited to {limit:g} Nm; the largest: {', '.join(most)}."
    title = f"Motor torque, axis {axis}"
    return case_plots.torques(f"{id}-torque-{axis}", title, curves, axis, limit, window, text=text, group=id)


# Several seeds.


def seeds(spreads: Mapping[str, Spread], looks: Mapping[str, int]) -> Plot:
    """Mean and standard deviation of V and the criteria over the seeds, relative to their targets, of controllers that
    ``looks`` numbers."""
    rules = next(iter(spreads.values())).rules
    targets = {"V": rules.cost.target} | {name: spec.target for name, spec in rules.criteria.items()}
    series = tuple(
        _seeds(label, spread, targets, looks[label], offset(place, len(spreads)))
        for place, (label, spread) in enumerate(spreads.items())
    )
    told = (f"{points.name}: {', '.join(points.words)}" for points in series)
    return Plot(
        "seeds-chart",
        "Relative to the targets",
        Axis(names=tuple(targets)),
        Axis("Mean ± standard deviation / target", low=0.0),
        series,
        (Level(1.0, "target"),),
        text=f"Mean ± standard deviation over the seeds, relative to the targets. {'. '.join(told)}.",
    )


def _seeds(label: str, spread: Spread, targets: Mapping[str, float], look: int, shift: float) -> Scatter:
    """The points of one controller, beside those of the others."""
    values: Mapping[str, Statistic] = {"V": spread.cost, **spread.criteria}
    shown = [(at, name, values[name]) for at, name in enumerate(targets) if values[name].mean is not None]
    means = [(value.mean or 0.0) / targets[name] for _, name, value in shown]
    deviations = tuple((value.deviation or 0.0) / targets[name] for _, name, value in shown)
    words = (
        f"{name} {number(mean)} ± {number(deviation)}"
        for (_, name, _), mean, deviation in zip(shown, means, deviations, strict=True)
    )
    x = [at + shift for at, _, _ in shown]
    return Scatter(label, x, means, hue(look), shape(look), 7.0, tuple(words), deviations)


def offset(place: int, count: int) -> float:
    """Where a controller stands beside the others."""
    return SPAN * ((place + 0.5) / count - 0.5)


def shape(place: int) -> Symbol:
    """The symbol of a controller: another one where colours repeat themselves."""
    return SHAPES[(place + place // len(SHAPES)) % len(SHAPES)]
