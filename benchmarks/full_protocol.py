"""The whole command: full protocol, report included, with the Python PID and with the C PID.

    python benchmarks/full_protocol.py              four minutes on two idle cores
    python benchmarks/full_protocol.py DiagonalPID

The first evaluation of all is a quick one, so that the cache of compiled code is warm. Wall time counts from the start
of the command to its end; the load of the machine by others, printed before, tells what it is worth.

The exit code is 1 where a command takes longer than its target on two cores.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import psutil

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import build_fmus  # noqa: E402

TARGETS = {"DiagonalPID": 120.0, "DiagonalPID_C": 90.0}
"""Largest wall time [s]."""


def evaluate(controller: Path, folder: Path, *options: str) -> float:
    """Wall time [s] of an evaluation."""
    words = [sys.executable, "-m", "orchestrator.evaluate", str(controller), "--output-dir", str(folder), *options]
    begin = time.perf_counter()
    subprocess.run(words, cwd=ROOT, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - begin


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; 1 where a target is missed."""
    names = list(sys.argv[1:] if arguments is None else arguments) or list(TARGETS)
    good = True
    print(f"{psutil.cpu_percent(1.0):.0f} % of the processors are at work for others", flush=True)
    with tempfile.TemporaryDirectory(prefix="full_protocol_") as folder:
        for name in names:
            controller = build_fmus.build(name, Path(folder))
            evaluate(controller, Path(folder, f"{name}-quick"), "--quick")
            wall = evaluate(controller, Path(folder, name))
            good &= wall <= TARGETS[name]
            print(f"{name:14s} {wall:6.1f} s (at most {TARGETS[name]:g})", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
