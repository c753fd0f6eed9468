"""Check a controller FMU before any evaluation: what it is, how it is bound, how it behaves."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from ..codec import to_json
from ..conformance.finding import Finding, Severity
from . import options
from .guard import EXIT_BAD_INPUT, EXIT_INCOMPLETE, EXIT_OK, remedy
from .tables import safe, terminal
from .values import Parser

COLOURS = {Severity.OK: "green", Severity.NOTE: "cyan", Severity.WARNING: "yellow", Severity.ERROR: "red"}

EPILOG = """examples:
  python -m orchestrator.check my_controller.fmu
  python -m orchestrator.check my_controller.fmu --map q_m[1]=In1 --map q_m[2]=In2
  python -m orchestrator.check my_controller.fmu --json

exit codes: 0 nothing but notes, 1 a warning, 2 an error: the controller cannot be evaluated"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser("check", "Check a controller FMU before any evaluation.", EPILOG)
    options.add_controller(parser)
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    given = parser.parse_args(arguments)
    bench, controller = options.benchmark(given), options.controller(given)
    options.announce(bench, controller)
    findings = bench.check(controller)
    worst = max((finding.severity for finding in findings), key=list(Severity).index)
    name = controller.file_name
    if given.json:
        print(to_json({"controller": name, "verdict": worst, "findings": findings}))
    else:
        _show(name, findings, terminal())
    return {Severity.ERROR: EXIT_BAD_INPUT, Severity.WARNING: EXIT_INCOMPLETE}.get(worst, EXIT_OK)


def _show(name: str, findings: Sequence[Finding], console: Console) -> None:
    table = Table(title=safe(name), title_justify="left", box=None, pad_edge=False)
    table.add_column("")
    table.add_column("subject", no_wrap=True)
    table.add_column("finding", overflow="fold")
    for finding in findings:
        colour = COLOURS[finding.severity]
        advice = " ".join(filter(None, (finding.remedy, remedy(finding))))
        text = safe(finding.text) + (f"\n[italic]{safe(advice)}[/italic]" if advice else "")
        table.add_row(f"[{colour}]{finding.severity.value}[/{colour}]", safe(finding.subject), text)
    console.print(table)
