"""The scorecard of an evaluation: what every output shows of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from ..benchmark.scorecard import outcome
from ..benchmark.tally import VERBS
from ..loop.trajectory import Status
from ..views.table import (
    Cell,
    Column,
    Commands,
    Conclusion,
    Facts,
    Link,
    Note,
    Part,
    Quantity,
    Summary,
    Table,
    Value,
    VerdictCell,
)
from ..views.units import MILLIMETRE, SHOWN, amplitude, number
from . import conclusions
from .commands import again, compare_command, simulate_command, study_command, tune_command
from .conclusions import cost_words, costliest, decisive, overall, share_words, verdict_words
from .document import Row
from .files import CASES
from .results import Results
from .wording import (
    SHOWN_FAILURES,
    Reason,
    computing_time,
    failure_notes,
    head_facts,
    incomplete,
    loop_delay,
    reason_notes,
    reason_text,
    remarks,
    requirement_rows,
    without_cost,
)

BRIEF = ("Seed", "Loop delay", "Computing time", "Connectors")
"""Facts that a terminal shows."""

CAPTION = (
    "Value: worst case over the systems of a configuration, averaged over the workspace, as in Table 2 of the paper. "
    "Paper: its PID. The paper's systems and directions of the force are not known: its figures compare approximately."
)


def summary(results: Results) -> Summary:
    """Criteria, requirements, what failed with the commands that repeat it, and what a reader must know."""
    parts: list[Part] = [Facts("This run", tuple(facts(results)), BRIEF), criteria(results), requirements(results)]
    failed = [(case.id, case.status, case.message) for case in results.cases if case.status is not Status.DONE]
    parts += failure_notes(failed, CASES)
    parts += [*reason_notes(reasons(results)), Commands("to repeat the other cases above", tuple(_others(results)))]
    parts += [Note(remark) for remark in remarks(results)]
    return Summary(results.controller.file, conditions(results), tuple(parts))


def conclusion(results: Results, shown: Mapping[str, int], folder: Path | None) -> Conclusion:
    """The verdict, the worst case that decides it, V, and what costs most of it; cases that are ``shown`` have a
    recording of that number, and ``folder`` is where the run is stored, if it is."""
    passed = {name: entry.passed for name, entry in results.stability.items()}
    verdict, cost = overall(passed), results.rules.cost
    values = {name: score.value for name, score in results.criteria.items()}
    costly = costliest(results.rules, values)
    if results.cost is None:
        total = f"no V: {without_cost(results) or incomplete(results)}"
    else:
        total = cost_words(f"V {number(results.cost)}", {"target": cost.target, "paper's PID": cost.paper})
        total = ", ".join(filter(None, (total, share_words(results.rules, values))))
    worst = results.criteria[costly[0]].worst_case if costly else None
    if worst is not None:
        total += f", at {poses(results)[worst.configuration]}, system {worst.system}"
    steps = [*_worst_step(results, passed, worst.id if worst else None, shown)]
    steps.append(Link("search for the worst case", study_command(results.head, "robustness")))
    steps.append(Link("tune the parameters", tune_command(results.head)))
    if folder is not None:
        steps.append(Link("compare with another run", compare_command(folder)))
    return conclusions.conclusion(verdict, (verdict_words(passed) + _why(results, passed), total), steps)


def _why(results: Results, passed: Mapping[str, bool | None]) -> str:
    """What the worst case of the first requirement did that is not met, or why it is not judged; empty if all are."""
    verdict = overall(passed)
    if verdict or not passed:
        return ""
    entry = results.stability[decisive(passed)[0]]
    if verdict is None or entry.worst_case is None:
        return f": {entry.reason}"
    case = results.case(entry.worst_case)
    figures, ended = case.measurements, outcome(case, results.rules.stability)
    size = {
        "limit cycle": f" of {amplitude(figures.limit_cycle)}",
        "no rest": f", {number(figures.rest_error, MILLIMETRE.factor)} mm away",
    }.get(ended, "")
    return f": {case.id} ({poses(results)[case.configuration.index]}) {VERBS[ended].replace('`', '')}{size}"


def _worst_step(
    results: Results, passed: Mapping[str, bool | None], costly: str | None, shown: Mapping[str, int]
) -> Iterator[Link]:
    """The worst case: that of the first requirement that is not met, else that of the criterion that costs most."""
    failing = results.stability[decisive(passed)[0]].worst_case if overall(passed) is False else None
    if (id := failing or costly) is not None:
        yield Link(f"{'see' if id in shown else 'simulate'} {id}", simulate_command(results.head, id), shown.get(id))


def conditions(results: Results) -> str:
    """Benchmark and protocol."""
    return f"{results.benchmark}, protocol {results.protocol}, seed {results.seed}"


def criteria(results: Results, shown: Mapping[str, int] | None = None) -> Table:
    """B1 to B7 and V; cases that are ``shown`` have a recording of that number."""
    recorded, places = shown or {}, poses(results)
    columns = (
        Column(""),
        Column("criterion"),
        Column("value"),
        Column("target"),
        Column("paper", minor=True),
        Column("of V", minor=True),
        Column("worst", minor=True),
        Column("where"),
    )
    rows: list[tuple[Cell, ...]] = []
    for name, criterion in results.criteria.items():
        unit, worst = SHOWN[criterion.unit], criterion.worst_case
        where = "-"
        if worst is not None:
            where = f"c{worst.configuration:02d}.{worst.system}"
            if recorded:
                where = f"{places[worst.configuration]}, {worst.system}"
        rows.append(
            (
                name,
                Quantity(criterion.title, unit),
                Value(
                    criterion.value,
                    unit=unit,
                    good=None if criterion.value is None else criterion.value <= criterion.target,
                ),
                Value(criterion.target, unit=unit),
                Value(criterion.paper, unit=unit),
                criterion.share,
                Value(worst.value if worst else None, unit=unit),
                Link(where, simulate_command(results.head, worst.id), recorded.get(worst.id)) if worst else where,
            )
        )
    cost, rest = results.rules.cost, (None,) * 3
    total = ("V", "Cost, eq. (15)", Value(results.cost), cost.target, cost.paper, *rest)
    return Table("Worst case, averaged over the workspace", columns, tuple(rows), (total,), CAPTION)


def row(results: Results) -> Row:
    """What a comparison shows: V, the criteria, and the verdicts."""
    figures = (
        (criterion_column(name, criterion.unit), criterion.value) for name, criterion in results.criteria.items()
    )
    verdicts = (
        (Column(requirement.label), VerdictCell(requirement.judged.passed)) for requirement in requirement_rows(results)
    )
    return (Column("V", best="smallest"), results.cost), *figures, *verdicts


def criterion_column(name: str, unit: str) -> Column:
    """The column of a criterion in a comparison."""
    return Column(name, SHOWN[unit], minor=True, best="smallest")


def requirements(results: Results, shown: Mapping[str, int] | None = None) -> Table:
    """A1 to A3, A1 and A2 per axis."""
    recorded = shown or {}
    columns = (Column(""), Column("requirement"), Column("verdict"), Column("limit cycle"), Column("where"))
    rows: list[tuple[Cell, ...]] = []
    for row in requirement_rows(results):
        worst = row.judged.worst_case
        link = Link(worst, simulate_command(results.head, worst), recorded.get(worst)) if worst else "-"
        rows.append((row.name, row.title, VerdictCell(row.judged.passed), row.amplitude, link))
    limit = results.rules.stability.limit_cycle * 1e6
    return Table(f"Stability: limit cycle below {limit:g} µm", columns, tuple(rows))


def reasons(results: Results) -> Iterator[Reason]:
    """Why requirements are not met or not judged."""
    for name, entry in results.stability.items():
        if not entry.passed:
            text = reason_text(name, entry.passed, "", entry.reason)
            command = simulate_command(results.head, entry.tally.first) if entry.tally.failed else ""
            yield Reason(text, command, "" if command else again(entry.tally))


def facts(results: Results) -> Iterator[tuple[str, str]]:
    """How the results were obtained, as pairs of a name and a text."""
    yield from head_facts(results.head)
    yield "Loop delay", loop_delay(results.loop_delay)
    yield "Computing time", f"{computing_time(results)}, per sample"


def poses(results: Results) -> dict[int, str]:
    """The configurations' link angles in words."""
    return {
        entry.index: f"{math.degrees(entry.q_a1):.0f}° / {math.degrees(entry.q_a2):.0f}°"
        for entry in results.configurations
    }


def _others(results: Results) -> Iterator[tuple[str, str]]:
    """The commands that repeat the first cases that failed and the worst of the requirements, but for those that stand
    with a reason."""
    failed = [case for case in results.cases if case.status is not Status.DONE][:SHOWN_FAILURES]
    shown = {entry.tally.first for entry in results.stability.values() if entry.passed is False}
    worst = [row.judged.worst_case for row in requirement_rows(results) if row.judged.passed is False]
    named = [*(case.id for case in failed if case.status is not Status.SKIPPED), *worst]
    for id in dict.fromkeys(named):
        if id and id not in shown:
            yield "", simulate_command(results.head, id)
