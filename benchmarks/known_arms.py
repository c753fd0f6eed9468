"""What a search gains by the arms that are known of other controllers: V found with them and without, same budget.

    python benchmarks/known_arms.py RobustLinearLQG DiagonalPID_C
    python benchmarks/known_arms.py RobustLQG --budget 20000

One of the project's controllers in C is searched, for B5, B6 and B7 alone, in lanes (lanes.py). No list of arms was
made for the PIDs or for RobustLinearLQG. Of the others some arms are their own: what they gain says nothing of a new
controller.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from benchmarks.lanes import InLanes  # noqa: E402
from orchestrator import Controller  # noqa: E402
from orchestrator.search.findings import BUDGET  # noqa: E402
from orchestrator.study.worst_case import RobustnessStudy  # noqa: E402


def main() -> None:
    """Search for each controller twice."""
    parser = argparse.ArgumentParser(description="What a search gains by the arms known of other controllers.")
    parser.add_argument("names", nargs="+", metavar="NAME", help="controllers in C")
    parser.add_argument("--budget", type=int, default=BUDGET, help="in whole cases, of each search")
    given = parser.parse_args()
    for name in given.names:
        for known in (False, True):
            begin = time.perf_counter()
            study = RobustnessStudy(given.budget, only=("B5", "B6", "B7"), known=known)
            found = InLanes("strict").run(study, Controller.built_in(name))
            values = ", ".join(f"{key} {found.criteria[key].value:.4g}" for key in ("B5", "B6", "B7"))
            arms = "with the arms known" if known else "without them"
            took = time.perf_counter() - begin
            print(
                f"{name}, {arms}: V {found.cost:.1f} ({values}), {found.simulations} simulations, {took:.0f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
