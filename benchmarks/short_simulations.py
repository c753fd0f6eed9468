"""What short simulations say beside whole cases, for members drawn at random from the corners of Table 1.

    python benchmarks/short_simulations.py                    the PID, 60 members
    python benchmarks/short_simulations.py FMU.fmu --members 200

For each criterion that a search looks for: simulated time and processor time of a short simulation relative to a whole
case, the rank correlation of the two values, and the largest relative difference.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.execution import store  # noqa: E402
from orchestrator.pairing.runs import CaseRun  # noqa: E402
from orchestrator.search.draws import members  # noqa: E402
from orchestrator.search.member import Member, case_of, cost  # noqa: E402
from orchestrator.search.short import short  # noqa: E402
from orchestrator.search.target import targets  # noqa: E402
from orchestrator.study import batch  # noqa: E402
from orchestrator.study.engine import local_executor  # noqa: E402
from orchestrator.study.requests import Batch, BatchEntry  # noqa: E402

SETTLING = 10.0
"""Time after the force [s] that a settling time is waited for."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("controller", nargs="?", type=Path, metavar="FMU.fmu")
    parser.add_argument("--members", type=int, default=60)
    given = parser.parse_args(arguments)
    bench = Benchmark("strict")
    controller, pairing, _, _ = bench.prepared(Controller(given.controller))
    rules, wanted = bench.rules, [target for target in targets(bench.rules) if target.criterion]
    drawn = [
        next(each for each in members(rules, "corners", 0, number) if each.test == wanted[0].test)
        for number in range(given.members)
    ]

    def run(some: Sequence[Member]) -> list[CaseRun]:
        entry = BatchEntry(rules, pairing, tuple(case_of(member, rules, bench.nominal) for member in some))
        with store.opened(None) as known:
            return batch.run(Batch((entry,)), local_executor(bench), known)[0]

    whole = run(drawn)
    print(f"{controller.archive.name}, {given.members} members")
    for target in wanted:
        view = short(rules, target, SETTLING)
        some = [replace(member, short=view) for member in drawn]
        runs = run(some)
        values = np.array(
            [[getattr(each.result.measurements, target.criterion) for each in kind] for kind in (whole, runs)], float
        )
        rank = spearmanr(*values).statistic
        times = [sum(each.wall_time for each in kind) for kind in (runs, whole)]
        print(
            f"  {target.criterion}: {cost(some[0], rules):.3f} of the simulated time, {times[0] / times[1]:.3f} of the "
            f"time; rank correlation {rank:.4f}, largest difference {np.nanmax(abs(values[1] / values[0] - 1)):.2g}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
