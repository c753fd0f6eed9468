"""How much of B5 is the arm's: the force on the most compliant arm, with a controller and with motors that do not move.

    python benchmarks/held_motors.py                    the paper's PID and RobustLQG, about a minute;
                                                        needs a C compiler
    python benchmarks/held_motors.py RobustLinearLQG    another one

All poses and directions of the force in the protocol ``strict``, the system ``compliant``, without chirp; B5 as in
eq. (14), the largest at each pose, and the mean over the poses. Motors with 10,000 times the inertia stand for motors
that the stiffest of all position loops holds: they move by less than a hundredth of what they do otherwise. What
remains is the bending of gears and arm, which only motors that move against the force could lessen, within the tenth
of a second until the largest error.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402

from orchestrator import Benchmark, Controller, Variation  # noqa: E402
from orchestrator.benchmark.case import Case  # noqa: E402

SHORT = Variation(duration=Fraction(2), chirp_amplitude=(0.0, 0.0), t_3=0.1, t_4=0.2, t_1=0.5, t_2=1.0)
HELD = 1e4
"""Factor on the inertia of the motors."""


def held(case: Case) -> Case:
    """The case with motors that do not move."""
    scenario = case.scenario
    parameters = tuple((name, value * (HELD if "j_m" in name else 1.0)) for name, value in scenario.parameters)
    return replace(case, scenario=replace(scenario, parameters=parameters))


def force_errors(bench: Benchmark, controller: Controller, cases: Sequence[Case]) -> np.ndarray:
    """Of each case B5 [mm], when that is after the force begins [s], and how far the motors move until then [rad]."""
    rows = []
    for case in cases:
        found = bench.simulate(controller, case).trajectory
        begin = case.scenario.pulse.start
        error = np.where(found.time >= begin, found.tcp_error, 0.0)
        worst = int(error.argmax())
        moved = np.abs(found.q_m[: worst + 1] - found.q_m[0]).max()
        rows.append((1e3 * error[worst], found.time[worst] - begin, moved))
    return np.array(rows)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", default=["DiagonalPID_C", "RobustLQG"])
    names = parser.parse_args(arguments).names
    bench = Benchmark("strict")
    chosen = [case for case in bench.cases if case.system.name == "compliant" and "disturbance" in case.test.name]
    cases = [bench.varied(case, SHORT) for case in chosen]
    poses = np.array([case.configuration.index for case in cases])
    runs = {name: force_errors(bench, Controller.built_in(name), cases) for name in names}
    runs["motors held"] = force_errors(bench, Controller.built_in(names[0]), list(map(held, cases)))
    for name, rows in runs.items():
        worst = [rows[poses == pose][rows[poses == pose, 0].argmax()] for pose in np.unique(poses)]
        (B5, _, _), times, moved = np.mean(worst, axis=0), *np.transpose(worst)[1:]
        print(
            f"{name:16} B5 {B5:5.2f} mm, {times.min():.3f} to {times.max():.3f} s after the force begins; "
            f"motors move by up to {moved.max():.3f} rad"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
