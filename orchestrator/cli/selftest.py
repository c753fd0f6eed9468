"""Check whether this machine gives the published bits."""

from __future__ import annotations

import platform
from collections.abc import Sequence

from ..api.selftest import selftest
from ..benchmark.bits import CASES, PAIRS, BitComparison
from ..codec import to_json
from . import output
from .guard import EXIT_INCOMPLETE, EXIT_OK
from .values import Parser

EPILOG = """examples:
  python -m orchestrator.selftest
  python -m orchestrator.selftest --json

exit codes: 0 all bits are the published ones, 1 some are not"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser(
        "selftest", "Simulate short closed loops and compare them, bit by bit, with the published ones.", EPILOG
    )
    output.add_dry_run(output.add_options(parser, "the hashes", forms=False), "what would be simulated")
    given = parser.parse_args(arguments)
    if given.dry_run:
        print("\n".join(f"{pair.name}/{case}" for pair in PAIRS for case in CASES))
        return EXIT_OK
    comparison = selftest()
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
