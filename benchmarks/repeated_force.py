"""B6 after a second force: whether a controller has the same time to recover when the force comes again.

    python benchmarks/repeated_force.py                     RobustLQG and the paper's PID on ``paper``, a minute
    python benchmarks/repeated_force.py RobustLinearLQG     another one
    python benchmarks/repeated_force.py RobustLQG --set dither_time=1e6        without a limit on its dither

A test has one force, and a controller could save what it has for it. Here each case with a force goes on after its
first 20 s, and the same force comes again, 10 s after the first. B6 is the time from the end of each force until the
TCP error stays within 0.1 mm, eq. (14): the largest at each configuration, and the mean over the configurations. It
needs a C compiler.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

import build_fmus  # noqa: E402
from orchestrator import Benchmark  # noqa: E402
from orchestrator.benchmark.case import Case  # noqa: E402
from orchestrator.fmi.archive import open_archive  # noqa: E402
from orchestrator.fmi.slaves import Slave, load  # noqa: E402
from orchestrator.loop.master import simulate  # noqa: E402
from orchestrator.loop.setup import Setup  # noqa: E402
from orchestrator.loop.trajectory import Status, Trajectory  # noqa: E402

PERIOD = 10
"""From one force to the next [s]."""


def recoveries(plant: Slave, controller: Slave, setup: Setup, case: Case, error: float) -> tuple[float, float]:
    """The time [s] from the end of the first force, and from that of the second, until the TCP error stays below
    ``error`` [m], each until the next force would begin."""
    pulse = case.scenario.pulse
    later = replace(pulse, start=pulse.start + PERIOD, stop=pulse.stop + PERIOD)
    once = replace(case.scenario, duration=Fraction(PERIOD + 10))
    again = replace(once, duration=Fraction(2 * PERIOD + 10), pulse=later)
    found = simulate(plant, controller, once, setup, further=lambda _: again)
    assert found.ending.status is Status.DONE, found.ending.message
    return _recovery(found, pulse.start, pulse.stop, error), _recovery(found, later.start, later.stop, error)


def _recovery(found: Trajectory, start: float, stop: float, error: float) -> float:
    within = (found.time >= stop) & (found.time < start + PERIOD)
    outside = found.time[within & (found.tcp_error > error)]
    return float(outside[-1]) - stop if len(outside) else 0.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", default=["RobustLQG", "DiagonalPID_C"])
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter of the controllers"
    )
    parser.add_argument("--protocol", default="paper", help="whose cases (default: paper)")
    given = parser.parse_args(arguments)
    setup = Setup({name: float(value) for name, _, value in (words.partition("=") for words in given.set)})
    bench, folder = Benchmark(given.protocol), ROOT / "build" / "fmus"
    chosen = [case for case in bench.cases if "B6" in case.test.criteria]
    poses = np.array([case.configuration.index for case in chosen])
    plant = load(open_archive(build_fmus.build("FlexibleManipulatorNative", folder)))
    for name in given.names:
        controller = load(open_archive(build_fmus.build(name, folder)))
        rows = np.array([recoveries(plant, controller, setup, case, bench.rules.settling.error) for case in chosen])
        first, second = np.mean([rows[poses == pose].max(axis=0) for pose in np.unique(poses)], axis=0)
        print(
            f"{name}: {len(chosen)} cases of {given.protocol}: B6 {first:.3f} s after the first force, {second:.3f} s "
            f"after the second; by case, {np.diff(rows).min():+.2f} to {np.diff(rows).max():+.2f} s",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
