"""What the page ``compare.html`` shows beside its tables: bars, difference maps, worst cases laid over each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..codec import plain
from ..views.table import Chart, Panel, Part, Widget
from .document import Comparable
from .evaluation import Evaluation
from .payload import criteria, packed_worst, workspace
from .spread import Spread

FILE = "compare.html"

SCRIPTS = ("heat.js", "arm.js", "compare.js")

CURVE_INTERVALS = 2500
"""Intervals that a worst case is thinned out to."""

Named = Mapping[str, Sequence[tuple[str, Comparable]]]
"""Documents with their names, by kind."""


def panels(named: Named) -> tuple[Panel, ...]:
    """The tabs of charts that there are documents for."""
    found: list[Panel] = []
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


def payload(named: Named) -> dict[str, Any]:
    """What the charts show: the runs and the spreads."""
    runs = [(name, each) for name, each in named.get(Evaluation.KIND, ()) if isinstance(each, Evaluation)]
    spreads = [(name, each) for name, each in named.get(Spread.KIND, ()) if isinstance(each, Spread)]
    found: dict[str, Any] = {"runs": [_run(name, each) for name, each in runs]}
    if runs:
        first = runs[0][1].results
        found |= {**workspace(first), "criteria": criteria(first.criteria), "rules": plain(first.rules)}
    if spreads:
        found["spreads"] = [_spread(name, each) for name, each in spreads]
    return found


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
