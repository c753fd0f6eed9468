"""The commands ``check`` and ``selftest``: whether a controller can be evaluated, and whether this machine gives the
published bits.
"""

from __future__ import annotations

import platform
from collections.abc import Sequence

from ..api import checking
from ..benchmark.bits import CASES, PAIRS, BitComparison
from ..codec import to_json
from ..conformance.finding import Severity
from ..text import printable
from . import options, output
from .guard import EXIT_BAD_INPUT, EXIT_INCOMPLETE, EXIT_OK, remedy
from .values import Parser

CHECK_EXAMPLES = """examples:
  flexible-manipulator check my_controller.fmu
  flexible-manipulator check my_controller.fmu --map "q_m[1]=In1" --map "q_m[2]=In2"
  flexible-manipulator check my_controller.fmu --json

exit codes: 0 nothing but notes, 1 a warning, 2 an error: the controller cannot be evaluated"""


def check(arguments: Sequence[str] | None = None) -> int:
    """Check a controller FMU before an evaluation: its kind, its connectors, its behaviour."""
    parser = Parser("check", "Check a controller FMU before any evaluation.", CHECK_EXAMPLES)
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


SELFTEST_EXAMPLES = """examples:
  flexible-manipulator selftest
  flexible-manipulator selftest --json

exit codes: 0 all bits are the published ones, 1 some are not"""


def selftest(arguments: Sequence[str] | None = None) -> int:
    """Check whether this machine gives the published bits."""
    parser = Parser(
        "selftest",
        "Simulate short closed loops and compare them, bit by bit, with the published ones.",
        SELFTEST_EXAMPLES,
    )
    output.add_dry_run(output.add_options(parser, "the hashes", forms=False), "what would be simulated")
    given = parser.parse_args(arguments)
    if given.dry_run:
        print("\n".join(f"{pair.name}/{case}" for pair in PAIRS for case in CASES))
        return EXIT_OK
    comparison = checking.selftest()
    print(to_json(_document(comparison)) if given.json else _words(comparison))
    return EXIT_OK if comparison.equal else EXIT_INCOMPLETE


def _document(comparison: BitComparison) -> dict[str, object]:
    return {
        "equal": comparison.equal,
        "differing": comparison.differing,
        "skipped": comparison.skipped,
        "machine": platform.platform(),
        "found": dict(comparison.hashes),
    }


def _words(comparison: BitComparison) -> str:
    lines = [f"skipped {name}: there is no C compiler" for name in comparison.skipped]
    lines += [f"differs {name}" for name in comparison.differing]
    count, other = len(comparison.hashes), len(comparison.differing)
    if comparison.equal:
        lines.append(f"This machine gives the published bits: {count} trajectories are equal.")
    else:
        lines.append(f"This machine gives other bits: {other} of {count} trajectories differ.")
    return "\n".join(lines)
