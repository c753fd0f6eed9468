"""``python -m orchestrator.recheck``: recorded cases computed anew by a second program."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from .compare import Recheck, recheck
from .reading import Unreadable

EPILOG = """examples:
  flexible-manipulator simulate my_controller.fmu --case c07.compliant.disturbance --record --output-dir case
  python -m orchestrator.recheck case/case.npz

exit codes: 0 all differences are within their bounds, 1 some are not, 2 a file cannot be read
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m orchestrator.recheck",
        description="Compute recorded cases anew with equations, integrator and judge of their own, and compare.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="CASE.npz", help="what simulate or verify has recorded")
    parser.add_argument("--json", action="store_true", help="print JSON")
    given = parser.parse_args(arguments)
    rechecks = []
    for file in given.files:
        try:
            rechecks.append(recheck(file))
        except Unreadable as problem:
            print(f"error: {file} cannot be read: {problem}.", file=sys.stderr)
            return 2
        if not given.json:
            _print(rechecks[-1])
    if given.json:
        print(json.dumps([case.to_dict() for case in rechecks], indent=1))
    return 0 if all(case.ok for case in rechecks) else 1


def _print(result: Recheck) -> None:
    print(f"{result.id}, {result.controller}")
    for row in result.rows:
        at = "" if row.time is None else f"at {row.time:.4f} s"
        words = "" if row.ok else "  ABOVE ITS BOUND"
        print(f"  {row.name:40} {row.difference:10.2e} {row.unit:9} bound {row.bound:.0e}  {at:14}{words}")


if __name__ == "__main__":
    raise SystemExit(main())
