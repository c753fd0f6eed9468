"""V and the requirements with a worse loop than the benchmark's: one more sample of delay, dropped samples, jitter.

    python benchmarks/sensitivity.py                all controllers of the leaderboard: 11,340 cases, some ten minutes
                                                    on two cores
    python benchmarks/sensitivity.py RobustLQG      one: 1,620 cases, 1 min 10 s; the figures of the others stay
    python benchmarks/sensitivity.py --table        only write the table from the figures that are kept

The cases are those of the protocol ``paper``, unchanged and with each of CONDITIONS; docs/timing.md tells what these
are. Of a controller in Python its twin in C is simulated, as in benchmarks/leaderboard.py. A command that is
interrupted goes on when it is repeated. The figures are kept in docs/sensitivity.json, by controller and condition; the
table is in docs/robustness.md.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.lanes import InLanes  # noqa: E402
from benchmarks.leaderboard import searched_as  # noqa: E402
from benchmarks.leaderboard_tables import PAGES  # noqa: E402
from benchmarks.marked_tables import with_table  # noqa: E402
from orchestrator.benchmark.case import Case  # noqa: E402
from orchestrator.benchmark.results import rules  # noqa: E402
from orchestrator.benchmark.scorecard import score  # noqa: E402
from orchestrator.benchmark.variation import Variation  # noqa: E402
from orchestrator.loop.trajectory import Status  # noqa: E402
from orchestrator.study.requests import Batch, BatchEntry, Requests  # noqa: E402

FIGURES, PAGE = (ROOT / "docs" / name for name in ("sensitivity.json", "robustness.md"))
WORK = ROOT / "runs" / "sensitivity"
MAKER = "benchmarks/sensitivity.py"

BENCH = InLanes("paper")
T_S = BENCH.rules.sample_time

Figures = Mapping[str, Mapping[str, Any]]
"""By controller: benchmark and protocol, the SHA-256 of the FMU, and V and the verdicts by condition."""


def later(case: Case) -> Case:
    """The case with torques that arrive a sample later on both axes."""
    first, second = case.scenario.drive.delay
    return BENCH.varied(case, Variation(delay=(first + T_S, second + T_S)))


def varied(**changes: Any) -> Callable[[Case], Case]:
    """What makes a case one with these fields of a variation."""
    return lambda case: BENCH.varied(case, Variation(**changes))


CONDITIONS: dict[str, Callable[[Case], Case]] = {
    "unchanged": lambda case: case,
    "delay + 0.25 ms": later,
    "dropout 1 %": varied(dropout=0.01),
    "dropout 10 %": varied(dropout=0.1),
    "jitter 0.125 ms": varied(jitter=T_S / 2),
}


def studied(name: str) -> Requests[dict[str, Any]]:
    """The figures of one controller."""
    controller, pairing, _, cases = BENCH.prepared(searched_as(name))
    entries = [
        BatchEntry(BENCH.rules, pairing, tuple(map(change, cases)), patience=None) for change in CONDITIONS.values()
    ]
    found = yield Batch(tuple(entries))
    figures: dict[str, Any] = {
        "benchmark": BENCH.rules.benchmark,
        "protocol": BENCH.rules.name,
        "sha256": controller.archive.sha256,
    }
    for condition, runs in zip(CONDITIONS, found, strict=True):
        if {Status.TIMEOUT, Status.LOST} & {run.result.status for run in runs}:
            raise SystemExit(f"{name}, {condition}: this machine was too busy for a case; repeat the command")
        card = score(rules(BENCH.rules), [run.result for run in runs])
        verdicts = {requirement: entry.passed for requirement, entry in card.stability.items()}
        figures[condition] = {"cost": card.cost, **verdicts}
    return figures


def table(kept: Figures) -> str:
    """V by controller and condition, with the requirements that fail, and the benchmark's version that they are of."""
    head = f"| controller | version | {' | '.join(f'V, {condition}' for condition in CONDITIONS)} |\n"
    lines = (
        f"| `{name}` | {kept[name]['benchmark'].rpartition('-')[2]} "
        f"| {' | '.join(_cell(kept[name][c]) for c in CONDITIONS)} |\n"
        for name in PAGES
        if name in kept
    )
    return head + "|---" * (2 + len(CONDITIONS)) + "|\n" + "".join(lines)


def _cell(figures: Mapping[str, Any]) -> str:
    words = {False: "fails", None: "is not judged"}
    shown = "none" if figures["cost"] is None else f"{figures['cost']:.1f}"
    others = [f"{name} {words[figures[name]]}" for name in ("A1", "A2", "A3") if not figures[name]]
    return ", ".join((shown, *others))


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"controllers: {', '.join(PAGES)}")
    parser.add_argument("--table", action="store_true", help="only write the table from the figures that are kept")
    given = parser.parse_args()
    os.chdir(ROOT)
    kept = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.is_file() else {}
    for name in () if given.table else given.names or PAGES:
        kept[name] = BENCH.engine(WORK / name).run(studied(name))
        FIGURES.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
        print(name, *(f"{condition}: {_cell(kept[name][condition])};" for condition in CONDITIONS), flush=True)
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8"), table(kept), MAKER), encoding="utf-8")


if __name__ == "__main__":
    main()
