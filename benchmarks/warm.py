"""What a warm command costs: the processor time of `simulate` with everything cached, children included, as a ratio.

    python benchmarks/warm.py                       beside a reference that loads what any such command has to
    python benchmarks/warm.py --old ../old-clone    beside the same command of an older clone: new / old
    python benchmarks/warm.py --command check       another command: simulate, check, evaluate (with --quick)

In every round each contender runs once, so that a slow moment of the machine hits all alike; what is printed are
medians over the rounds, of the ratios within a round too. Time is user and system time of the whole process tree, which
is waited for: nothing is left out that runs in a worker, nor in a server that ends with the command.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent)]

from benchmarks.common import measure, median  # noqa: E402

REFERENCE = "import numpy, numba, matplotlib.figure, matplotlib.backends.backend_agg"
"""What takes most of a start, whatever this package does: a machine's own unit of time."""

COMMANDS = {"simulate": [], "check": [], "evaluate": ["--quick", "--force"]}


def cost(code: str, clone: Path, cache: Path) -> float:
    """Processor time [us] of a Python process that runs ``code`` with the package of ``clone``, and of its children."""
    variables = {**os.environ, "PYTHONPATH": str(clone), "FLEXIBLE_MANIPULATOR_CACHE": str(cache)}
    before = _used()
    with tempfile.TemporaryDirectory(prefix="warm_") as folder:  # results are written to the current one
        options = {"cwd": folder, "env": variables, "capture_output": True, "text": True}
        ended = subprocess.run([sys.executable, "-c", code], check=False, **options)  # type: ignore[call-overload]
    if ended.returncode not in (0, 1):  # 1: a finding, or a case without a verdict
        raise SystemExit(f"{clone}: {ended.stderr}")
    return 1e6 * (_used() - before)


def _used() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def command(name: str, arguments: Sequence[str], options: Sequence[str]) -> str:
    """Code that runs a command as ``python -m`` does."""
    return f"from orchestrator.cli.guard import run; raise SystemExit(run({name!r}, {[*arguments, *options]!r}))"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", type=Path, metavar="CLONE", help="an older clone to compare with")
    parser.add_argument("--command", choices=COMMANDS, default="simulate")
    parser.add_argument("--rounds", type=int, default=7, help="how often each runs (default: 7)")
    parser.add_argument("options", nargs="*", help="options of the command, after --")
    given = parser.parse_args(arguments)
    code = command(given.command, COMMANDS[given.command], given.options)
    with tempfile.TemporaryDirectory(prefix="warm_") as cache:
        run = {"new": partial(cost, code, HERE.parent, Path(cache, "new"))}
        if given.old is not None:
            run["old"] = partial(cost, code, given.old.resolve(), Path(cache, "old"))
        run["reference"] = partial(cost, REFERENCE, HERE.parent, Path(cache, "new"))
        for each in run.values():
            each()  # builds and compiles
        results = measure(run, given.rounds)
    for name in run:
        print(f"{median(results, lambda times: times[name]) / 1e6:8.3f} s  {name}")  # noqa: B023
    for name in list(run)[1:]:
        print(f"{median(results, lambda times: times['new'] / times[name]):8.3f}    new / {name}")  # noqa: B023
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
