"""The search of the tuning scripts: CMA-ES over the logarithms of positive parameters, a client of the library.

A candidate is an FMU in C with parameters; its objective is the cost V of the protocol tuning.toml, with penalties for
limit cycles. The candidate is kept that is best of those that hold A1-A3 in the whole protocol, as the shipped FMU.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from orchestrator import Benchmark, BenchmarkError, Controller, Evaluation, FmuError

PROTOCOL = Path(__file__).with_name("tuning.toml")
SEED = 1234
"""Of the objective's systems and noise; the whole protocol has seed 0, the held-out comparison another."""
POPULATION = 14
FINALISTS = 5
"""Candidates that are tried on the whole protocol, best first."""
REFUSED = 1e3
"""Objective of a candidate without a cost."""

Values = Mapping[str, float]
"""Parameters by FMI name."""
Logarithms = Sequence[float]
"""Of values relative to the start, in its order."""
Seen = list[tuple[float, tuple[float, ...]]]
"""Objectives and logarithms of candidates."""


@dataclass(frozen=True)
class Task:
    """What is tuned: parameters of the FMU ``shipped``, whose start values are in the data file ``file``.

    ``start`` holds a positive number for every name, ``upper`` limits of some. The candidates are simulated with the
    FMU ``fast``, whose other parameters are set to ``fixed``. ``spread`` is the first standard deviation of the
    logarithms.
    """

    script: Path
    file: Path
    shipped: str
    fast: str
    start: Values
    spread: float
    upper: Values = field(default_factory=dict)
    fixed: Values = field(default_factory=dict)

    def values(self, logarithms: Logarithms) -> dict[str, float]:
        """The values that belong to ``logarithms``."""
        return {name: start * math.exp(z) for (name, start), z in zip(self.start.items(), logarithms, strict=True)}


def objective(evaluation: Evaluation) -> float:
    """V, with 4 for each factor e by which a limit cycle exceeds what A3 allows, and 100 for a test without one."""
    rules, total = evaluation.results.rules, REFUSED if evaluation.cost is None else evaluation.cost
    for case in evaluation.cases:
        if rules.test(case.test).requirements:
            cycle, limit = case.measurements.limit_cycle, rules.stability.limit_cycle
            total += 100.0 if cycle is None else 4.0 * math.log(max(cycle, limit) / limit)
    return total


def objective_of(task: Task) -> Callable[[Logarithms], float]:
    """The objective as a function of the candidate."""
    # One process for each candidate, candidates side by side: no core waits for the last case of another candidate.
    benchmark, fast = Benchmark(PROTOCOL, seed=SEED, workers=1), Controller.built_in(task.fast)

    def value(logarithms: Logarithms) -> float:
        values = task.values(logarithms)
        beyond = sum(max(0.0, math.log(values[name] / limit)) for name, limit in task.upper.items())
        if beyond > 0.0:
            return REFUSED * (1.0 + beyond)
        try:
            return objective(benchmark.evaluate(with_parameters(fast, {**values, **task.fixed}), recordings=False))
        except FmuError:  # the design has no solution there
            return REFUSED

    return value


def search(task: Task, evaluations: int, seed: int = 1) -> Seen:
    """All candidates of a search."""
    import cma  # the search alone needs it: pip install cma

    value, begin = objective_of(task), time.perf_counter()
    options = {"seed": seed, "popsize": POPULATION, "maxfevals": evaluations, "verbose": -9}
    strategy = cma.CMAEvolutionStrategy([0.0] * len(task.start), task.spread, options)
    seen: Seen = []
    with ThreadPoolExecutor(os.cpu_count()) as side_by_side:
        while not strategy.stop():
            candidates = strategy.ask()
            values = list(side_by_side.map(value, candidates))
            strategy.tell(candidates, values)
            seen += zip(values, (tuple(map(float, candidate)) for candidate in candidates), strict=True)
            print(f"{time.perf_counter() - begin:6.0f} s {len(seen):6d} evaluations: {min(seen)[0]:.2f}", flush=True)
    return seen


def finalist(task: Task, seen: Seen, only: Sequence[str] = ()) -> tuple[float, dict[str, float]]:
    """Objective and values, rounded to four digits, of the best candidate that holds A1-A3 in the protocol ``paper``.

    ``only`` restricts the protocol's cases. Raises :class:`BenchmarkError` where none of the FINALISTS best does.
    """
    for lowest, logarithms in sorted(seen)[:FINALISTS]:
        best = {name: float(f"{value:.4g}") for name, value in task.values(logarithms).items()}
        controller = with_parameters(Controller.built_in(task.shipped), best)
        evaluation = Benchmark().evaluate(controller, only=only, recordings=False)
        print(f"{lowest:.2f}: {evaluation}", flush=True)
        if all(requirement.passed is not False for requirement in evaluation.requirements.values()):
            return lowest, best
    raise BenchmarkError(
        f"None of the {min(len(seen), FINALISTS)} best candidates of the search holds A1-A3 in the protocol paper. "
        f"Add what they fail to {PROTOCOL.name}, or search longer."
    )


def with_parameters(controller: Controller, values: Values) -> Controller:
    """The controller with parameters set."""
    return replace(controller, parameters=values)


def origin(script: Path) -> dict[str, str]:
    """What made a data file: the name of the script, and the hash of all that is its own."""
    sources = (script, Path(__file__), PROTOCOL)
    return {"script": script.name, "sha256": hashlib.sha256(b"\0".join(map(Path.read_bytes, sources))).hexdigest()}


def write(task: Task, best: Values, how: Values) -> None:
    """Write the ``best`` values to the task's data file, with what made them; other parameters stay in it."""
    kept = json.loads(task.file.read_text(encoding="utf-8"))["parameters"]
    contents = {"tuned": {**origin(task.script), **how}, "parameters": {**kept, **best}}
    task.file.write_text(json.dumps(contents, indent=1) + "\n", encoding="utf-8")


def main(task: Task) -> None:
    """Search, judge, write."""
    parser = argparse.ArgumentParser(description=f"Find the parameters of {task.shipped}: {task.file.name}.")
    parser.add_argument("--evaluations", type=int, default=210, metavar="N", help="of the objective (default: 210)")
    seen = search(task, parser.parse_args().evaluations)
    lowest, best = finalist(task, seen)
    write(task, best, {"evaluations": len(seen), "objective": round(lowest, 2)})
    print(f"written: {task.file.name}")
