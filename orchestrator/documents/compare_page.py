"""What the page ``compare.html`` shows beside its tables: bars, difference maps, worst cases laid over each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, TypeVar

from ..benchmark.results import Rules
from ..benchmark.spread import Statistic
from ..views.plot import Axis, Bars, Colour, Level, Plot, Scatter, Symbol, Window, dash, hue, shape
from ..views.table import Choice, Commands, Note, Panel, Part
from ..views.units import number
from . import case_plots
from .case_plots import Curve
from .commands import recording_command
from .comparability import Entry, same_controller
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

Entries = Mapping[str, Sequence[Entry]]
"""What is compared, by kind."""

D = TypeVar("D", bound=Comparable)

SPAN = 0.6
"""Part of the room of a name that the controllers share."""


@dataclass(frozen=True)
class Shown(Generic[D]):
    """A document under the ``label`` of a chart; its controller looks the same wherever it has the same ``place``."""

    label: str
    document: D
    place: int


def panels(entries: Entries, everything: Sequence[tuple[str, Comparable]] = ()) -> tuple[Panel, ...]:
    """The tabs of charts that there are documents for; ``everything`` are those of all groups."""
    made: list[Panel] = []
    if rows := bounds(everything):
        made.append(Panel("bounds", "Bounds of V", (_bounds(rows),)))
    runs, spreads = ranked(entries, Evaluation), ranked(entries, Spread)
    if runs:
        searches = [entry.document for entry in entries.get(Robustness.KIND, ())]
        made.append(Panel("bars", "Criteria", (_ratios(runs), stack(runs, searches))))
        if len(runs) > 1:
            first = runs[0].document.results
            scores = {run.label: run.document.configurations for run in runs}
            made.append(Panel("difference", "Workspace", workspace(first.plant, first.rules, scores)))
        made.append(Panel("overlay", "Worst cases", (_overlay(runs),)))
    if spreads:
        made.append(Panel("seeds", "Seeds", (seeds(spreads),)))
    return tuple(made)


def ranked(entries: Entries, kind: type[D]) -> list[Shown[D]]:
    """Those of a kind, which stand in the order of their first leaderboard, with their rank there before the name: by
    it they are told apart where names are cut."""
    listed = [(entry, entry.document) for entry in entries.get(kind.KIND, ())]
    return [
        Shown(f"({rank}) {entry.name}" if document.rank.reason else f"{rank}. {entry.name}", document, entry.place)
        for rank, (entry, document) in enumerate(listed, start=1)
        if isinstance(document, kind)
    ]


# What V consists of.


def _ratios(runs: Sequence[Shown[Evaluation]]) -> Plot:
    rules = runs[0].document.results.rules
    bars = tuple(
        Bars(run.label, tuple(_ratio(run.document, name) for name in rules.criteria), hue(run.place)) for run in runs
    )
    told = (f"{one.name}: {', '.join(map(number, one.values))}" for one in bars)
    high = _reaching(1.0, (value for one in bars for value in one.values))
    return Plot(
        "bars-chart",
        "Criteria relative to their targets",
        Axis(names=tuple(rules.criteria)),
        Axis("Value / target", high=high),
        bars,
        (Level(1.0, "target"),),
        text=f"B1 to B7 relative to their targets. {'. '.join(told)}.",
    )


def _ratio(run: Evaluation, name: str) -> float | None:
    score = run.results.criteria[name]
    return None if score.value is None else score.value / score.target


def _reaching(least: float, values: Iterator[float | None]) -> float | None:
    """The end of an axis that shows ``least`` even where all values are smaller; None if some are not."""
    return 1.2 * least if max((value or 0.0 for value in values), default=0.0) < least else None


COLOURS: tuple[Colour, ...] = ("b1", "b2", "b3", "b4", "b5", "b6", "b7")
"""Those of the criteria, which are areas."""


def stack(runs: Sequence[Shown[Evaluation]], others: Sequence[Comparable]) -> Plot:
    """V of every run, made up of the shares of the criteria; beside it, what a search of the same controller found, if
    one is among ``others``."""
    rules = runs[0].document.results.rules
    searches = [_search(run.document, others) for run in runs]
    card = [{name: run.document.criteria[name].share for name in rules.criteria} for run in runs]
    searched = [{} if search is None else _shares(search, rules) for search in searches]
    told = (
        f"{run.label}: V {number(run.document.cost)}{f', found {number(search.cost)}' if search else ''}"
        for run, search in zip(runs, searches, strict=True)
    )
    costs = [run.document.cost for run in runs], [None if search is None else search.cost for search in searches]
    stacked = [_stacked("V", card, costs[0]), *([_stacked("found", searched, costs[1])] if any(searched) else [])]
    beside = " Hatched: V found by a search, which the true worst case may exceed." if any(searched) else ""
    return Plot(
        "stack-chart",
        "What V consists of",
        Axis("V", high=_reaching(rules.cost.target, (cost for row in costs for cost in row))),
        Axis(names=tuple(run.label for run in runs), inverse=True),
        tuple(bars for row in stacked for bars in row),
        (Level(rules.cost.target, "target", upright=True),),
        text=f"V of every run, made up of the shares of {', '.join(rules.criteria)}.{beside} {'. '.join(told)}.",
        height=36 * len(stacked),
    )


def _search(run: Evaluation, others: Sequence[Comparable]) -> Robustness | None:
    """The first search of the run's controller that found a V."""
    searches = (other for other in others if isinstance(other, Robustness) and other.cost is not None)
    return next((search for search in searches if same_controller(search.head, run.head)), None)


def _shares(search: Robustness, rules: Rules) -> Mapping[str, float | None]:
    """The parts of V found, as those of a scorecard; of a search for some criteria, these alone."""
    values = {name: search.criteria[name].value for name in rules.criteria if name in search.criteria}
    return {
        name: None if value is None else rules.criteria[name].weight * value / rules.criteria[name].target
        for name, value in values.items()
    }


def _stacked(name: str, shares: Sequence[Mapping[str, float | None]], costs: Sequence[float | None]) -> list[Bars]:
    """A stack of the shares of each run, with its V at the end."""
    names = list(dict.fromkeys(criterion for share in shares for criterion in share))
    bars = [
        Bars(criterion, tuple(share.get(criterion) for share in shares), COLOURS[place % 7], name, hatched=name != "V")
        for place, criterion in enumerate(names)
    ]
    ends = tuple("" if cost is None else number(cost) for cost in costs)
    return [*bars[:-1], replace(bars[-1], labels=ends)]


# What is known of V.


class Mark(NamedTuple):
    """What a document says of V: of which kind, in words, and the value."""

    kind: str
    words: str
    V: float


LOOKS: Mapping[str, tuple[str, Symbol, Colour]] = {
    "scorecard": ("scorecard", "circle", "soft"),
    "sampled": ("sampled: at most, for nearly all draws", "left", "ink"),
    "found": ("found: at least, in the worst case", "right", "ink"),
}
"""By kind. No colour is that of a controller."""


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


def _overlay(runs: Sequence[Shown[Evaluation]]) -> Part:
    rules = runs[0].document.results.rules
    options = []
    for name in ("B5", "B6", "B7"):
        recorded = [(run, next(reversed(run.document.recorded(name)), None)) for run in runs]
        shown = [(run, entry) for run, entry in recorded if entry is not None]
        if shown:
            options.append((f"{name}, {rules.criteria[name].title.lower()}", _worst(name, rules, shown)))
    return Choice("which", "Worst case of", tuple(options)) if options else Note(
        "These runs were made without trajectories."
    )  # fmt: skip


def _worst(name: str, rules: Rules, shown: Sequence[tuple[Shown[Evaluation], Recording]]) -> tuple[Part, ...]:
    """The worst case of one criterion of all runs: errors, torques, and commands."""
    curves = [curve(run, shortened(entry, CURVE_ROWS)) for run, entry in shown]
    entries = [entry for _, entry in shown]
    longest = max(entries, key=lambda entry: entry.about.time)
    window = _window(name, rules, longest, entries)
    told = ", ".join(f"{run.label} in {entry.about.id}" for run, entry in shown)
    id = f"overlay-{name}"
    error = case_plots.errors(
        f"{id}-error",
        "TCP error",
        curves,
        rules,
        window,
        text=f"TCP error of each run's own worst case of {name}: {told}.",
        bands=case_plots.forces(longest),
        of=longest,
        group=id,
        height=420,
    )
    torques = (_torques(id, curves, axis, rules, window) for axis in (1, 2))
    commands = (
        (f"{run.label}: {entry.about.id}", recording_command(run.document.head, entry.about)) for run, entry in shown
    )
    return error, *torques, Commands("repeat these cases", tuple(commands))


def curve(of: Shown[D], entry: Recording) -> Curve:
    """A recording, as its controller looks."""
    return Curve(of.label, entry, hue(of.place), dash=dash(of.place))


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


def seeds(spreads: Sequence[Shown[Spread]]) -> Plot:
    """Mean and standard deviation of V and the criteria over the seeds, relative to their targets."""
    rules = spreads[0].document.rules
    targets = {"V": rules.cost.target} | {name: spec.target for name, spec in rules.criteria.items()}
    series = tuple(_seeds(shown, targets, offset(number, len(spreads))) for number, shown in enumerate(spreads))
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


def _seeds(of: Shown[Spread], targets: Mapping[str, float], shift: float) -> Scatter:
    """The points of one controller, beside those of the others."""
    values: Mapping[str, Statistic] = {"V": of.document.cost, **of.document.criteria}
    shown = [(at, name, values[name]) for at, name in enumerate(targets) if values[name].mean is not None]
    means = [(value.mean or 0.0) / targets[name] for _, name, value in shown]
    deviations = tuple((value.deviation or 0.0) / targets[name] for _, name, value in shown)
    words = (
        f"{name} {number(mean)} ± {number(deviation)}"
        for (_, name, _), mean, deviation in zip(shown, means, deviations, strict=True)
    )
    x = [at + shift for at, _, _ in shown]
    return Scatter(of.label, x, means, hue(of.place), shape(of.place), 7.0, tuple(words), deviations)


def offset(place: int, count: int) -> float:
    """Where a controller stands beside the others."""
    return SPAN * ((place + 0.5) / count - 0.5)
