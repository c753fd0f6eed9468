"""Check a controller FMU before an evaluation: its kind, its connectors, its behaviour."""

from __future__ import annotations

from collections.abc import Sequence

from ..conformance.finding import Severity
from ..text import printable
from . import options, output
from .guard import EXIT_BAD_INPUT, EXIT_INCOMPLETE, EXIT_OK, remedy
from .values import Parser

EPILOG = """examples:
  python -m orchestrator.check my_controller.fmu
  python -m orchestrator.check my_controller.fmu --map q_m[1]=In1 --map q_m[2]=In2
  python -m orchestrator.check my_controller.fmu --json

exit codes: 0 nothing but notes, 1 a warning, 2 an error: the controller cannot be evaluated"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser("check", "Check a controller FMU before any evaluation.", EPILOG)
    options.add_controller(parser)
    output.add_dry_run(output.add_options(parser, "the findings"), "which FMUs would be checked")
    given = parser.parse_args(arguments)
    bench, controller = options.benchmark(given), options.controller(given)
    options.announce(bench, controller)
    if given.dry_run:
        print(printable(f"1 controller to check: {controller.file_name}"))
        return EXIT_OK
    findings = bench.check(controller)
    document = {"controller": findings.controller, "verdict": findings.worst, "findings": findings.found}
    advised = findings
    for finding in findings:
        # The library names no options: it does not know how it is called.
        if advice := remedy(finding):
            advised = advised.advised(finding, advice)
    output.put(advised, given, document)
    return {Severity.ERROR: EXIT_BAD_INPUT, Severity.WARNING: EXIT_INCOMPLETE}.get(findings.worst, EXIT_OK)
