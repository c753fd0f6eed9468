"""What the tuning scripts have in common: a task, and a data file that says what made it."""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from orchestrator import Benchmark, BenchmarkError, Controller

Values = Mapping[str, float]
"""Parameters by FMI name."""


@dataclass(frozen=True)
class Task:
    """What is tuned: parameters of the FMU ``shipped``, whose start values are in the data file ``file``.

    The search begins at ``start``; values lie within a factor ``reach`` of that, and below ``upper``. Candidates are
    simulated with the FMU ``fast``, the same controller in C, whose other parameters are set to ``fixed``.
    """

    script: Path
    file: Path
    shipped: str
    fast: str
    start: Values
    reach: float
    upper: Values = field(default_factory=dict)
    fixed: Values = field(default_factory=dict)

    def vary(self) -> dict[str, tuple[float, float, str]]:
        """The ranges of the search."""
        return {
            name: (value / self.reach, min(value * self.reach, self.upper.get(name, float("inf"))), "log")
            for name, value in self.start.items()
        }


def origin(script: Path) -> dict[str, str]:
    """What made a data file: the name of the script, and the hash of all that is its own."""
    sources = (script, Path(__file__))
    return {"script": script.name, "sha256": hashlib.sha256(b"\0".join(map(Path.read_bytes, sources))).hexdigest()}


def write(task: Task, best: Values, how: Values) -> None:
    """Write the ``best`` values to the task's data file, with what made them; other parameters stay in it."""
    kept = json.loads(task.file.read_text(encoding="utf-8"))["parameters"]
    contents = {"tuned": {**origin(task.script), **how}, "parameters": {**kept, **best}}
    task.file.write_text(json.dumps(contents, indent=1) + "\n", encoding="utf-8")


def main(task: Task) -> None:
    """Search, try the best candidate as the shipped FMU, write."""
    parser = argparse.ArgumentParser(description=f"Find the parameters of {task.shipped}: {task.file.name}.")
    parser.add_argument("--trials", type=int, default=210, metavar="N", help="candidates (default: 210)")
    parser.add_argument("--robust", type=int, default=0, metavar="N", help="as of orchestrator.tune (default: 0)")
    given, benchmark = parser.parse_args(), Benchmark()
    found = benchmark.tune(
        Controller.built_in(task.fast).with_parameters({**task.fixed, **task.start}),
        task.vary(),
        trials=given.trials,
        robust=given.robust,
        folder=Path("runs") / f"{task.shipped}-tuning",
        on_trial=lambda trial, done, total: print(f"{done:5d} of {total}: {trial.objective:.2f}", file=sys.stderr),
    )
    print(found)
    if found.best is None:
        raise BenchmarkError("No candidate holds A1-A3 in the protocol paper: search longer.")
    shipped = benchmark.evaluate(Controller.built_in(task.shipped).with_parameters(found.parameters))
    if shipped.cost is None or not all(entry.passed for entry in shipped.requirements.values()):
        raise BenchmarkError(f"{task.fast} holds A1-A3, but {task.shipped}, equal up to rounding, does not.")
    write(task, found.parameters, {"trials": given.trials, "cost": float(f"{shipped.cost:.5g}")})
    print(f"written: {task.file.name}")
