"""The project's controllers where no tuning has been: other poses, other draws of systems, noise and disturbances.

    python benchmarks/controllers.py                       all controllers, about 5 minutes on 2 idle cores
    python benchmarks/controllers.py --random-only         without the extreme system that the tuning knows
    python benchmarks/controllers.py DiagonalPID DitheredLQG --jobs 1
    python benchmarks/controllers.py --cost                only what a step costs
    python benchmarks/controllers.py RobustLQG --search 3000
                                                           and search for its worst case, some 4 minutes more

The protocol is ``paper`` with two changes: its grid is replaced by one whose poses lie between the grid's, and the
seed of systems, disturbances and noise is neither the evaluations' nor the tunings'. Its system ``compliant`` is an
extreme of the uncertainty that the tuning also looks at (at other poses, under other forces); with --random-only a
third random system stands in its place. The search for the worst case (docs/robustness.md), too, has a seed of its own.

What a step costs is measured with both kinds of controller in one process, turn by turn: the time of set, doStep and
get through the master loop's compiled calls, as a ratio to the PID of the same turn; the median over the turns.

The exit code is 1 where a controller misses its target.
"""

from __future__ import annotations

import argparse
import functools
import math
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402
from msgspec.structs import replace  # noqa: E402

import build_fmus  # noqa: E402
from benchmarks.common import drive, median  # noqa: E402
from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.benchmark import cases as case_list  # noqa: E402
from orchestrator.benchmark import protocol as protocols  # noqa: E402
from orchestrator.benchmark.case import Case, Configuration  # noqa: E402
from orchestrator.benchmark.protocol import Protocol  # noqa: E402
from orchestrator.benchmark.results import Scorecard, rules  # noqa: E402
from orchestrator.benchmark.scorecard import score  # noqa: E402
from orchestrator.execution import (
    pool,  # noqa: E402
    store,  # noqa: E402
)
from orchestrator.fmi.archive import open_archive  # noqa: E402
from orchestrator.fmi.slaves import load  # noqa: E402
from orchestrator.loop.controller import Steady, prepared  # noqa: E402
from orchestrator.loop.setup import Setup  # noqa: E402
from orchestrator.pairing.pairing import Pairing  # noqa: E402
from orchestrator.pairing.testbed import available_cores  # noqa: E402
from orchestrator.study import batch  # noqa: E402
from orchestrator.study.requests import Batch, BatchEntry  # noqa: E402
from plant_fmu.flexible_manipulator import coefficients, equilibrium  # noqa: E402
from plant_fmu.flexible_manipulator.parameters import NOMINAL  # noqa: E402

BASELINE = "DiagonalPID"
CONTROLLERS = (BASELINE, "TunedPID", "ManipulatorLQG", "DitheredLQG", "RobustLinearLQG", "RobustLQG")
SEED = 20260
Q_A1, Q_A2 = (-75.0, 0.0, 75.0, 150.0), (-140.0, -45.0, 40.0)
"""Link angles of the held-out poses [deg]."""
WANTED = {"ManipulatorLQG": 0.72, "DitheredLQG": 0.72, "RobustLQG": 0.72}
"""Largest V as a share of the PID's."""
HELD = {"RobustLQG", "RobustLinearLQG"}
"""Controllers that no search has broken."""
LARGEST_COST = 3.0
"""Of a step, in steps of the PID."""
TURNS, STEPS = 31, 2000
TIMEOUT = 300.0
"""Wall time of a simulation [s]."""


def held_out(random_only: bool) -> tuple[Protocol, list[Case]]:
    """The protocol ``paper`` with other systems, and its cases at other poses."""
    paper = protocols.load("paper")
    systems = ("random_3" if random_only else "compliant", "random_1", "random_2")
    protocol = replace(paper, sets={**paper.sets, "performance": systems})
    cases = []
    for k, pose in enumerate((q_a1, q_a2) for q_a1 in Q_A1 for q_a2 in Q_A2):
        at = Configuration(500 + k, *np.radians(pose).tolist())
        for test in protocol.tests:
            for name in protocol.sets[test.systems]:
                system = case_list.system(protocol, NOMINAL, SEED, at.index, name, test)
                cases.append(case_list.case(protocol, at, system, test, SEED))
    return protocol, cases


def scorecard(protocol: Protocol, cases: Sequence[Case], name: str, folder: Path, jobs: int) -> Scorecard:
    """The scorecard of the FMU ``name``."""
    compiled = build_fmus.find_compiler() is not None  # the same bits in a quarter of the time
    plant = open_archive(build_fmus.build("FlexibleManipulatorNative" if compiled else "FlexibleManipulator", folder))
    controller = open_archive(build_fmus.build(name, folder))
    pairing = Pairing(plant, controller, timeout=TIMEOUT)
    with store.opened(None) as known:
        entry = BatchEntry(protocol, pairing, tuple(cases))
        (runs,) = batch.run(Batch((entry,)), functools.partial(pool.run, workers=jobs), known)
    return score(rules(protocol), [run.result for run in runs], len(cases))


def worst_case(name: str, folder: Path, jobs: int, budget: int) -> bool:
    """Search for the worst case of the FMU ``name``, and print it; returns False if it breaks one of HELD."""
    found = Benchmark(seed=SEED, workers=jobs).robustness(Controller(build_fmus.build(name, folder)), budget=budget)
    cost = math.inf if found.cost is None else found.cost
    print(
        f"{name:16s} V found {cost:.1f}, {_verdicts(found.requirements)}, {found.simulations} simulations", flush=True
    )
    return all(entry.passed for entry in found.requirements.values()) or name not in HELD


def _verdicts(requirements: Mapping[str, Any]) -> str:
    return " ".join(f"{key} {'holds' if entry.passed else 'FAILS'}" for key, entry in requirements.items())


def step_costs(names: Sequence[str], folder: Path) -> dict[str, tuple[float, float]]:
    """Time of a step [us] and its ratio to the baseline's, by controller; medians over the turns."""
    T_s = protocols.load("paper").sample_time
    arm, joints = coefficients.arm(NOMINAL), (coefficients.joint(NOMINAL, 1), coefficients.joint(NOMINAL, 2))
    q_a = (0.4, -1.1)
    rest = equilibrium.solve(arm, joints, q_a)
    # Measurements that move about the reference.
    moving = np.array(rest.q_m) + 1e-4 * (np.outer(np.arange(STEPS), (7, 8)) % 11 - 5)
    costs = []
    for _ in range(TURNS):
        costs.append({})
        for name in names:
            slave = load(open_archive(build_fmus.build(name, folder)))
            with prepared(slave, Setup(), Steady(rest.q_m, rest.u_m, q_a), T_s, 10.0) as port:
                drive(port, moving[:10], float(T_s))
                begin = time.process_time()
                drive(port, moving, float(T_s))
                costs[-1][name] = (time.process_time() - begin) / STEPS * 1e6
    return {
        name: (median(costs, lambda t: t[name]), median(costs, lambda t: t[name] / t[names[0]]))  # noqa: B023
        for name in names
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"controllers (default: {' '.join(CONTROLLERS)})")
    parser.add_argument("--cost", action="store_true", help="only what a step costs")
    parser.add_argument("--random-only", action="store_true", help="a third random system in place of `compliant`")
    parser.add_argument("--jobs", type=int, default=available_cores(), metavar="N", help="processes (default: cores)")
    parser.add_argument("--search", type=int, default=0, metavar="N", help="search for worst cases, N whole cases each")
    options = parser.parse_args(arguments)
    names = (BASELINE, *(name for name in options.names or CONTROLLERS if name != BASELINE))
    good = True
    with tempfile.TemporaryDirectory(prefix="controllers_") as folder:
        for name, (microseconds, ratio) in step_costs(names, Path(folder)).items():
            good &= ratio <= LARGEST_COST
            print(f"{name:16s} {microseconds:6.2f} us per step, {ratio:.2f} of {BASELINE}'s", flush=True)
        protocol, cases = held_out(options.random_only)
        baseline = None
        for name in () if options.cost else names:
            card = scorecard(protocol, cases, name, Path(folder), options.jobs)
            assert card.cost is not None, "a performance case has no value"
            baseline = baseline or card.cost
            share = card.cost / baseline
            good &= share <= WANTED.get(name, 1.0)
            good &= name == BASELINE or all(bool(r.passed) for r in card.stability.values())
            criteria = " ".join(f"{key} {c.value:.4g}" for key, c in card.criteria.items())
            print(f"{name:16s} V {card.cost:6.1f} ({share:.1%}), {_verdicts(card.stability)}, {criteria}", flush=True)
            if options.search and name != BASELINE:
                good &= worst_case(name, Path(folder), options.jobs, options.search)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
