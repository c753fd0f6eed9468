"""The page ``report.html`` of one run: its tabs. The charts are drawn by the page's scripts."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from functools import partial

from ..benchmark.scorecard import kind
from ..loop.trajectory import Status
from ..views.table import (
    Beside,
    Cell,
    Chart,
    Column,
    Commands,
    Facts,
    Headline,
    Link,
    Note,
    Page,
    Panel,
    Part,
    Table,
    VerdictCell,
    Widget,
)
from ..views.units import MICROMETRE, SECOND, number
from . import scorecard
from .commands import recording_command, simulate_command
from .payload import affordable, report_payload, stability
from .reasons import reason_notes
from .recording import SYSTEMS
from .results import Results
from .run import Run, contradictions
from .wording import remarks

SCRIPTS = ("heat.js", "arm.js", "shares.js", "workspace.js", "case.js", "spread.js", "stability.js", "motion.js")

WITHOUT = Note("This run was made without trajectories.")


def page(run: Run) -> Page:
    """The report of a run."""
    results, recordings = run.results, affordable(run)
    shown = {entry.about.id: index for index, entry in reversed(list(enumerate(recordings)))}
    failures = [case for case in results.cases if case.status is not Status.DONE]
    panels = (
        Panel("summary", "Summary", _summary(run, shown)),
        Panel("workspace", "Workspace", (Widget("workspace.html", {"choices": [("quantity", "Show")]}),)),
        Panel("case", "Time plots", (Widget("case.html") if recordings else WITHOUT,)),
        Panel("spread", "Uncertainty", _spread(run)),
        Panel("stability", "Stability", _stability(results, shown)),
        Panel("motion", "Motion", (Widget("motion.html") if recordings else WITHOUT,)),
        Panel("failures", f"Not done ({len(failures)})", _failures(results, shown)),
    )
    title = f"{results.controller.file}: V = {number(results.cost)}"
    return Page(title, scorecard.conditions(results), panels, (*SCRIPTS, "report.js"), partial(report_payload, run))


def headline(results: Results) -> Headline:
    """V beside the paper's PID and the target, and what it comes to."""
    cost, target, paper = results.cost, results.rules.cost.target, results.rules.cost.paper
    sentence = "No cost: a case that counts has no value."
    if cost is not None:
        side, direction = "At or below" if cost <= target else "Above", "less" if cost < paper else "more"
        change = f"{abs(100 * (cost - paper) / paper):.0f} % {direction}"
        sentence = f"{side} the target of {target:g}, {change} than the paper reports for its PID."
    return Headline("Cost V", cost, (("target", target), ("paper's PID", paper)), sentence)


def _summary(run: Run, shown: Mapping[str, int]) -> tuple[Part, ...]:
    results = run.results
    wrong = [Note(f"Results and recordings differ. {line}.") for line in contradictions(run)]
    left: tuple[Part, ...] = (headline(results), Chart("share-chart", 280, "What V consists of"))
    right: tuple[Part, ...] = (scorecard.requirements(results, shown), *reason_notes(scorecard.reasons(results)))
    return (
        *wrong,
        *(Note(remark) for remark in remarks(results)),
        Beside((left, right)),
        scorecard.criteria(results, shown),
        Facts("This run", tuple(scorecard.facts(results))),
    )


def _spread(run: Run) -> tuple[Part, ...]:
    """Figures 11 and 12."""
    recorded = run.recorded(SYSTEMS)
    if not recorded:
        return (WITHOUT,)
    commands = ((entry.about.id, recording_command(run.results.head, entry.about)) for entry in recorded)
    return (
        Chart("spread-force", 340, "TCP position error due to the force"),
        Chart("spread-chirp", 340, "TCP position error due to the motor torque disturbance"),
        Commands("repeat one of these cases", tuple(commands)),
    )


def _stability(results: Results, shown: Mapping[str, int]) -> tuple[Part, ...]:
    """Every test with a requirement, the largest limit cycle first."""
    limits, places = results.rules.stability, scorecard.poses(results)
    columns = (
        Column("case"),
        Column("q_a1 / q_a2"),
        Column("system"),
        Column("test"),
        Column("status"),
        Column("limit cycle", MICROMETRE),
        Column("ratio"),
        Column("verdict"),
    )
    rows: list[tuple[Cell, ...]] = []
    for case, passed in sorted(
        stability(results), key=lambda row: _size(row[0].measurements.limit_cycle), reverse=True
    ):
        link = Link(case.id, simulate_command(results.head, case.id), shown.get(case.id))
        words = kind(case, limits) if case.simulated else "failed"
        own = (case.measurements.limit_cycle, case.measurements.limit_cycle_ratio)
        place = places[case.configuration.index]
        rows.append(
            (
                link,
                place,
                case.system,
                case.test,
                case.status.value,
                *own,
                VerdictCell(passed, words if passed is not None else ""),
            )
        )
    caption = (
        f"Every test with a requirement, with its limit cycle (half the peak-to-peak of a TCP coordinate at the end) "
        f"against {number(limits.limit_cycle * 1e6)} µm. The ratio is that to the amplitude in the seconds before: a "
        "motion that dies away is a ring-down, not a limit cycle. A test also fails where the TCP does not come to "
        "rest."
    )
    return (Chart("stability-chart", 380), Table("Stability tests", columns, tuple(rows), caption=caption))


def _size(limit_cycle: float | None) -> float:
    return math.inf if limit_cycle is None else limit_cycle  # none at all is the worst


def _failures(results: Results, shown: Mapping[str, int]) -> tuple[Part, ...]:
    failures = [case for case in results.cases if case.status is not Status.DONE]
    if not failures:
        return (Note(f"None: all {len(results.cases)} cases ran to their end and came to rest.", warning=False),)
    counts = Counter(case.status.value for case in failures)
    words = ", ".join(f"{count} {status}" for status, count in counts.items())
    rows: list[tuple[Cell, ...]] = []
    for case in failures:
        link = Link(case.id, simulate_command(results.head, case.id), shown.get(case.id))
        rows.append((link, VerdictCell(False if case.judged else None, case.status.value), case.time, case.message))
    columns = (Column("case"), Column("status"), Column("time", SECOND), Column("message"))
    note = f"{words}, of {len(results.cases)} cases. A case that was skipped or lost says nothing about the controller."
    return (Note(note, warning=False), Table("Cases that did not end with done", columns, tuple(rows)))
