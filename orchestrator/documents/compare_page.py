"""What the page ``compare.html`` shows beside its tables: bars, difference maps, worst cases laid over each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..codec import plain
from ..views.table import Chart, Panel, Part, Widget
from .comparability import same_controller
from .document import Comparable
from .evaluation import Evaluation
from .payload import criteria, packed_worst, workspace
from .reliability import Reliability
from .robustness import Robustness
from .spread import Spread

FILE = "compare.html"

SCRIPTS = ("heat.js", "arm.js", "compare.js")

CURVE_INTERVALS = 2500
"""Intervals that a worst case is thinned out to."""

Named = Mapping[str, Sequence[tuple[str, Comparable]]]
"""Documents with their names, by kind."""


def panels(named: Named, everything: Sequence[tuple[str, Comparable]] = ()) -> tuple[Panel, ...]:
    """The tabs of charts that there are documents for; ``everything`` are those of all groups."""
    found: list[Panel] = []
    if bounds(everything):
        found.append(Panel("bounds", "Bounds of V", (Chart("bounds-chart", 420, "V, found and sampled"),)))
    runs = len(named.get(Evaluation.KIND, ()))
    if runs:
        bars: tuple[Part, ...] = (
            Chart("bars-chart", 420, "Criteria relative to their targets"),
            Chart("stack-chart", 340, "What V consists of"),
        )
        found.append(Panel("bars", "Criteria", bars))
        choices = [("minuend", "Show"), ("subtrahend", "minus"), ("quantity", "of")]
        if runs > 1:
            found.append(Panel("difference", "Workspace", (Widget("workspace.html", {"choices": choices}),)))
        overlay: tuple[Part, ...] = (
            Widget("choice.html", {"id": "which", "text": "Worst case of"}),
            Chart("overlay-chart", 420, "TCP position error"),
            Chart("overlay-torque-1", 340, "Motor torque, axis 1"),
            Chart("overlay-torque-2", 340, "Motor torque, axis 2"),
            Widget("place.html", {"id": "overlay-cases"}),
        )
        found.append(Panel("overlay", "Worst cases", overlay))
    if Spread.KIND in named:
        found.append(Panel("seeds", "Seeds", (Chart("seeds-chart", 420, "Relative to the targets"),)))
    return tuple(found)


def payload(named: Named, everything: Sequence[tuple[str, Comparable]] = ()) -> dict[str, Any]:
    """What the charts show: the runs and the spreads, and the bounds of V of ``everything``."""
    runs = [(name, each) for name, each in named.get(Evaluation.KIND, ()) if isinstance(each, Evaluation)]
    spreads = [(name, each) for name, each in named.get(Spread.KIND, ()) if isinstance(each, Spread)]
    found: dict[str, Any] = {"runs": [_run(name, each) for name, each in runs], "bounds": bounds(everything)}
    if runs:
        first = runs[0][1].results
        found |= {**workspace(first), "criteria": criteria(first.criteria), "rules": plain(first.rules)}
    if spreads:
        found["spreads"] = [_spread(name, each) for name, each in spreads]
    return found


def bounds(everything: Sequence[tuple[str, Comparable]]) -> list[dict[str, Any]]:
    """By controller that was searched or sampled, what is known of its V: of scorecards, of a search's list, what a
    search found (at least), and the quantile that a sample bounds."""
    found: list[tuple[Comparable, dict[str, Any]]] = []
    for name, each in everything:
        own = next((row for first, row in found if same_controller(first.head, each.head)), None)
        if own is None:
            found.append((each, own := {"name": name, "target": each.head.rules.cost.target, "marks": []}))
        own["marks"] += [{"kind": kind, "words": words, "V": V} for kind, words, V in _marks(each) if V is not None]
    kinds = {"found", "sampled"}
    return [row for _, row in found if any(mark["kind"] in kinds for mark in row["marks"])]


def _marks(document: Comparable) -> Iterator[tuple[str, str, float | None]]:
    """What a document says of V: of which kind, in words, and the value."""
    match document:
        case Evaluation():
            yield "scorecard", f"on {document.head.protocol}", document.results.cost
        case Robustness():
            yield "scorecard", f"on {document.head.protocol}, the search's list", document.protocol_cost
            yield "found", f"found by a search of {document.spent:.0f} whole cases: at least", document.cost
        case Reliability():
            words = f"exceeded by at most {document.probability:g} of all draws, at {document.confidence:g} confidence"
            yield "sampled", words, document.cost.bound


def _spread(name: str, spread: Spread) -> dict[str, Any]:
    """Mean and standard deviation of V and the criteria, relative to their targets."""
    rules = spread.rules
    known = [("V", spread.cost, rules.cost.target)]
    known += [(criterion, spread.criteria[criterion], spec.target) for criterion, spec in rules.criteria.items()]
    return {
        "name": name,
        "points": [
            {"name": criterion, "mean": each.mean / target, "deviation": (each.deviation or 0.0) / target}
            for criterion, each, target in known
            if each.mean is not None
        ],
    }


def _run(name: str, run: Evaluation) -> dict[str, Any]:
    """Costs by configuration, and the worst case of every criterion of the TCP error."""
    worst = {
        criterion: packed_worst(recorded, CURVE_INTERVALS, run.results)
        for criterion in ("B5", "B6", "B7")
        for recorded in run.recorded(criterion)
    }
    return {
        "name": name,
        "criteria": plain(run.results.criteria),
        "configurations": plain(run.results.configurations),
        "worst": worst,
    }
