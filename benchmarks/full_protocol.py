"""The whole command: full protocol, report included, with the Python PID and with the C PID.

    python benchmarks/full_protocol.py
    python benchmarks/full_protocol.py DiagonalPID_C

The first evaluation of all is a quick one, so that the cache of compiled code is warm. Wall time counts from the start
of the command to its end; the load of the machine by others, printed before, tells what it is worth. Processor time is
that of all processes, also as a ratio to what the plant's equations alone would take for as many steps, measured
before and after.

The exit code is 1 where a command takes longer than its target on two cores.
"""

from __future__ import annotations

import math
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

import psutil  # noqa: E402

import build_fmus  # noqa: E402
from benchmarks import loop_speed  # noqa: E402
from orchestrator import Benchmark  # noqa: E402
from orchestrator.loop.master import simulate  # noqa: E402

TARGETS = {"DiagonalPID": 120.0, "DiagonalPID_C": 90.0}
"""Largest wall time [s]."""

SHARES = {"DiagonalPID_C": 1.8}
"""Largest processor time, in times of the kernel's."""


def evaluate(controller: Path, folder: Path, *options: str) -> tuple[float, float]:
    """Wall time and processor time [s] of an evaluation."""
    words = [sys.executable, "-m", "orchestrator.evaluate", str(controller), "--output-dir", str(folder), *options]
    begin, used = time.perf_counter(), _used()
    subprocess.run(words, cwd=ROOT, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - begin, _used() - used


def _used() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; 1 where a target is missed."""
    names = list(sys.argv[1:] if arguments is None else arguments) or list(TARGETS)
    good = True
    print(f"{psutil.cpu_percent(1.0):.0f} % of the processors are at work for others", flush=True)
    with tempfile.TemporaryDirectory(prefix="full_protocol_") as folder:
        bench = loop_speed.set_up(Path(folder), 26.0)
        kernel, rest = loop_speed.kernel(bench.plant, bench.scenario)
        inputs = loop_speed.plant_inputs(bench.scenario, simulate(bench.plant, bench.controller, bench.scenario))
        loop_speed.bare_kernel(kernel, rest, inputs)  # compiles
        steps = sum(case.scenario.samples for case in Benchmark().cases)
        for name in names:
            controller = build_fmus.build(name, Path(folder))
            evaluate(controller, Path(folder, f"{name}-quick"), "--quick")
            before = [loop_speed.bare_kernel(kernel, rest, inputs) for _ in range(5)]
            wall, used = evaluate(controller, Path(folder, name))
            after = [loop_speed.bare_kernel(kernel, rest, inputs) for _ in range(5)]
            ratio = used / (statistics.median(before + after) * 1e-6 * steps)
            good &= wall <= TARGETS[name] and ratio <= SHARES.get(name, math.inf)
            print(f"{name:14s} {wall:6.1f} s (at most {TARGETS[name]:g}); {used:.1f} s of the processors, ", end="")
            wanted = f" (at most {SHARES[name]:g})" if name in SHARES else ""
            print(f"{ratio:.2f} times the kernel's for {steps} steps{wanted}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
