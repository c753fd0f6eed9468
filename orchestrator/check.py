"""Check a controller FMU before any evaluation: what it is, how it is bound, how it behaves.

python -m orchestrator.check my_controller.fmu
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from fractions import Fraction

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from . import commands
from .benchmark import protocol as protocols
from .conformance.dynamic import CHECKS, run_check
from .conformance.finding import Finding, Severity
from .conformance.static import archive_findings, binding_findings, sampling_findings
from .cosim.controller import controller_binding
from .cosim.sampling import controller_sample_time
from .errors import InputError
from .execution.evaluation import Bench
from .execution.isolation import run_isolated
from .execution.job import Died, Failed, Job
from .fmus import DEFAULT_CONTROLLER
from .report.terminal import terminal

PROTOCOL = "paper"
"""Whose sample time a controller's is held against."""

COLOURS = {Severity.OK: "green", Severity.NOTE: "cyan", Severity.WARNING: "yellow", Severity.ERROR: "red"}

EPILOG = """examples:
  python -m orchestrator.check my_controller.fmu
  python -m orchestrator.check my_controller.fmu --map q_m[1]=In1 --map q_m[2]=In2
  python -m orchestrator.check my_controller.fmu --json

exit codes: 0 nothing but notes, 1 a warning, 2 an error: the controller cannot be evaluated"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = _parser().parse_args(arguments)
    benchmark = protocols.load(PROTOCOL).sample_time
    name = str(options.controller or f"{DEFAULT_CONTROLLER}.fmu")
    findings: list[Finding] = []
    try:
        bench = commands.bench(options)
        controller, setup = bench.controller, bench.setup
        name = controller.name
        findings.extend(archive_findings(controller))
        findings.extend(binding_findings(controller_binding(controller, setup), controller, setup))
        sample_time = controller_sample_time(controller, benchmark, options.sample_time)
        findings.extend(sampling_findings(sample_time, benchmark))
        findings.extend(_dynamic(bench, sample_time.value))
    except InputError as error:
        findings.append(Finding(Severity.ERROR, "import", str(error)))
    worst = max((finding.severity for finding in findings), key=list(Severity).index)
    if options.json:
        rows = [{**vars(finding), "severity": finding.severity.value} for finding in findings]
        json.dump({"controller": name, "verdict": worst.value, "findings": rows}, sys.stdout, indent=1)
        print()
    else:
        _show(name, findings, terminal())
    return {Severity.ERROR: 2, Severity.WARNING: 1}.get(worst, 0)


def _dynamic(bench: Bench, sample_time: Fraction) -> Iterator[Finding]:
    tasks = tuple((number, bench.setup, sample_time) for number in range(len(CHECKS)))
    limits = (bench.timeout,) * len(tasks)
    job = Job(bench.plant, bench.controller, tasks, run_check, limits, bench.limits, bench.sandbox)
    told = ""
    for outcome in run_isolated(job):
        check = CHECKS[outcome.index]
        if isinstance(outcome, Failed):
            if str(outcome.error) == told:  # it fails before any look begins: once is enough
                continue
            told = str(outcome.error)
            remedy = check.loss or "Mend what the FMU says itself, and export it again."
            yield Finding(check.failure, check.subject, str(outcome.error), remedy)
        elif isinstance(outcome, Died):
            text = "\n".join((outcome.message, *outcome.output))
            remedy = check.loss or "Run the FMU in a debugger: it ends or hangs its process."
            yield Finding(check.failure, check.subject, text, remedy)
        else:
            yield from outcome.value


def _show(name: str, findings: Sequence[Finding], console: Console) -> None:
    table = Table(title=escape(name), title_justify="left", box=None, pad_edge=False)
    table.add_column("")
    table.add_column("subject", no_wrap=True)
    table.add_column("finding")
    for finding in findings:
        colour = COLOURS[finding.severity]
        text = escape(finding.text) + (f"\n[italic]{escape(finding.remedy)}[/italic]" if finding.remedy else "")
        table.add_row(f"[{colour}]{finding.severity.value}[/{colour}]", escape(finding.subject), text)
    console.print(table)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m orchestrator.check",
        description="Check a controller FMU before any evaluation.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands.add_controller(parser)
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    return parser


if __name__ == "__main__":
    raise SystemExit(commands.guarded(main))
