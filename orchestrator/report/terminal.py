"""The scorecard as tables for a terminal."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..benchmark.scorecard import CriterionScore, Scorecard, Verdict
from ..cosim.trajectory import Status
from .results import Evaluation, loop_delay

SHOWN = {"m": (1e3, "mm"), "N.m": (1.0, "Nm"), "s": (1.0, "s")}
"""Factor and name of the unit that a value is shown in: the paper's."""


def show(evaluation: Evaluation, console: Console) -> None:
    """Print the scorecard of an evaluation."""
    protocol, card = evaluation.protocol, evaluation.scorecard
    console.print(
        f"[bold]{protocol.benchmark}[/bold]  protocol {protocol.name}  "
        f"controller [bold]{escape(evaluation.controller.name)}[/bold]\n"
        f"seed {evaluation.seed}  {_delay(evaluation)}\n"
    )
    console.print(_criteria(evaluation))
    console.print(_requirements(card, protocol.raw["stability"]["limit_cycle"]))
    _remarks(evaluation, console)


def _delay(evaluation: Evaluation) -> str:
    delay = loop_delay(evaluation)
    if delay["seconds"] is None:
        return "loop delay not measurable: the controller does not answer its inputs"
    text = f"loop delay {delay['seconds'] * 1e3:.3f} ms = {delay['samples']:g} sample{'s' * (delay['samples'] != 1)}"
    return text + (f" ({delay['controller_samples']} of them in the controller)" if delay["controller_samples"] else "")


def _table(title: str) -> Table:
    """A table whose seven columns fit into 80 characters."""
    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)


def _criteria(evaluation: Evaluation) -> Table:
    card, reference = evaluation.scorecard, evaluation.protocol.reference
    table = _table("Worst case, averaged over the workspace")
    table.add_column("")
    table.add_column("criterion", no_wrap=True)
    for heading in ("value", "target", "paper", "of V", "worst"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("where", no_wrap=True)
    cases = {result.case.id: result.case for result in evaluation.results}
    for score in card.criteria:
        factor, unit = SHOWN[score.criterion.unit]
        worst = cases.get(score.worst_case or "")
        table.add_row(
            score.criterion.name,
            f"{score.criterion.title} \\[{unit}]",
            _coloured(score, factor),
            _number(score.criterion.target * factor),
            _number(reference[score.criterion.name] * factor),
            _number(score.share),
            _number(None if score.worst_value is None else score.worst_value * factor),
            f"c{worst.configuration.index:02d}.{worst.system.name}" if worst else "-",
        )
    table.add_section()
    target = sum(score.criterion.weight for score in card.criteria)
    table.add_row("V", "Cost, eq. (15)", f"[bold]{_number(card.cost)}[/bold]", _number(target), _number(reference["V"]))
    return table


def _requirements(card: Scorecard, limit: float) -> Table:
    table = _table(f"Stability: limit cycle below {limit * 1e6:g} µm")
    table.add_column("")
    table.add_column("requirement", no_wrap=True)
    table.add_column("verdict")
    table.add_column("largest", justify="right", no_wrap=True)
    table.add_column("where", no_wrap=True)
    titles = {"A1": "gain x 2.5, axis {}", "A2": "delay + 1.5 ms, axis {}", "A3": "limit cycle, all tests"}
    for requirement in card.requirements:
        rows = requirement.axes.items() if "{}" in titles[requirement.name] else [("", requirement.overall)]
        for axis, verdict in rows:
            table.add_row(
                requirement.name, titles[requirement.name].format(axis), _passed(verdict), *_amplitude(verdict)
            )
    return table


def _remarks(evaluation: Evaluation, console: Console) -> None:
    card, results = evaluation.scorecard, evaluation.results
    failed = [result for result in results if result.status not in (Status.DONE, Status.UNSTABLE)]
    unsettled = sum(1 for result in results if result.measurement and result.measurement.settled is False)
    if unsettled:
        console.print(f"In {unsettled} cases B6 is the time to the end of the simulation: the TCP did not settle.")
    for result in failed[:3]:
        console.print(f"{result.case.id}: [red]{result.status.value}[/red]: {escape(result.message)}")
    if len(failed) > 3:
        console.print(f"... and {len(failed) - 3} more; see cases.csv.")
    if not card.complete:
        console.print("[yellow]Incomplete:[/yellow] not every case of the protocol has a verdict.")
    if evaluation.sample_time != evaluation.protocol.sample_time:
        console.print(
            f"[yellow]Sample time {float(evaluation.sample_time) * 1e3:g} ms:[/yellow] not the benchmark's "
            f"{float(evaluation.protocol.sample_time) * 1e3:g} ms; not comparable."
        )
    if evaluation.protocol.name != "paper":
        console.print(
            f"[yellow]Protocol {evaluation.protocol.name}:[/yellow] not comparable to the paper nor to other protocols."
        )


def _coloured(score: CriterionScore, factor: float) -> str:
    if score.value is None:
        return "[red]-[/red]"
    colour = "green" if score.value <= score.criterion.target else "red"
    return f"[{colour}]{_number(score.value * factor)}[/{colour}]"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}" if value < 100 else f"{value:.1f}"


def _passed(verdict: Verdict) -> str:
    if verdict.passed is None:
        return "not tested"
    return "[green]holds[/green]" if verdict.passed else "[red]fails[/red]"


def _amplitude(verdict: Verdict) -> tuple[str, str]:
    if verdict.worst_case is None:
        return "-", "-"
    if verdict.amplitude is None:
        return "no value", verdict.worst_case
    return f"{verdict.amplitude * 1e6:.3g} µm", verdict.worst_case
