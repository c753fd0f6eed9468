"""Random sequences of FMI calls, legal and illegal, on the compiled FMUs, with sanitizers.

    python benchmarks/random_calls.py                     a million calls for each FMU
    python benchmarks/random_calls.py RobustLQG --seed 7 --calls 5000000

Needs a C compiler with AddressSanitizer and UndefinedBehaviorSanitizer. For each FMU, in each FMI version and kind,
it prints how many calls were made, how many of them were answered with an error, and the longest one (processor
time). The exit code is 1 if there was a crash, a call of more than 1 s, a report of a sanitizer, a leak, an error
without a message, or if after a sequence a reset or a new instance did not give the reference trajectory to the last
bit. The suite makes 100,000 calls each (tests/test_random_calls.py).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]

from random_calls.build import build, run, sanitizing_compiler  # noqa: E402
from random_calls.fmus import FMUS  # noqa: E402


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "names", nargs="*", choices=[*FMUS, []], metavar="NAME", help=f"of {', '.join(FMUS)} (default: all)"
    )
    parser.add_argument("--seed", type=int, default=0, help="default: %(default)s")
    parser.add_argument("--calls", type=int, default=1_000_000, help="for each FMU (default: %(default)s)")
    given = parser.parse_args(arguments)
    if sanitizing_compiler() is None:
        raise SystemExit("No C compiler with AddressSanitizer and UndefinedBehaviorSanitizer: install gcc or clang.")
    failed = 0
    for name in given.names or FMUS:
        with tempfile.TemporaryDirectory(prefix="random_calls_") as place:
            done = run(
                build(FMUS[name](Path(place)), Path(place)), "random", given.seed, given.calls, calls=given.calls
            )
        failed += done.returncode != 0
        print(f"{name}: {done.stdout.strip() or 'failed'}", flush=True)
        print(done.stderr, end="", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
