"""The search of the tuning scripts: CMA-ES over the logarithms of positive numbers.

The objective is the benchmark's cost V on a subset of poses and systems drawn for the tuning, with penalties that
keep A1-A3: first the linear stability set (a candidate that misses it is not simulated at all), then limit cycles in
a few simulated tests. Of the candidates, the best one is kept that holds A1-A3 in the whole protocol.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from controller_fmu.tuning import problem, stability
from orchestrator.benchmark.results import CaseResult, Scorecard
from orchestrator.cache import PACKAGE, source_hash
from orchestrator.errors import BenchmarkError

HERE = Path(__file__).resolve().parent
POSES = 10
STABILITY_POSES = 16
SEED = 1234
"""Of the poses, systems and noise of the objective; the whole protocol has seed 0, the held-out comparison another."""
POPULATION = 14
THREADS = 2
FINALISTS = 20
"""Candidates that are tried on the whole protocol's stability tests, best first."""
LIMIT_CYCLE = 7e-6
"""Amplitude [m] from which on a limit cycle is penalized, with a reserve to the 10e-6 of A3."""

Values = Mapping[str, float]


@dataclass(frozen=True)
class Task:
    """What is tuned: ``start`` holds a positive number for every name, ``law_of`` makes the controller of values."""

    start: Values
    law_of: Callable[[Values], problem.LawOf]
    upper: Values = field(default_factory=dict)


def objective(task: Task) -> Callable[[np.ndarray], float]:
    """Cost of the logarithms of the values relative to the start."""
    poses = problem.scattered_poses(POSES, SEED)
    drawn: problem.Systems = {"performance": ("compliant", "random_1"), "stability": ("sticky",)}
    light: problem.Systems = {"performance": ("compliant",), "stability": ("slippery",)}
    folded, *_, unfolded = sorted(poses, key=lambda pose: pose.q_a2)
    experiments = [
        *problem.experiments(poses, ["disturbance"], drawn, SEED, shortened=True),
        *problem.experiments(poses[::3], ["noise"], light, SEED),
        *problem.experiments([poses[0]], ["gain_1", "delay_2"], drawn, SEED),
        *problem.experiments([folded, unfolded], ["gain_1", "gain_2"], light, SEED),
    ]
    plants = stability.linear_plants(problem.scattered_poses(STABILITY_POSES, SEED))
    limits = np.log([task.upper.get(name, math.inf) / value for name, value in task.start.items()])

    def cost(logarithms: np.ndarray) -> float:
        beyond = float(np.sum(np.maximum(logarithms - limits, 0.0)))
        if beyond > 0.0:
            return 1e3 + beyond
        law_of = task.law_of(values(task, logarithms))
        try:
            missing = stability.shortfall(stability.decay_rates(plants, law_of))
        except (ValueError, np.linalg.LinAlgError):  # the design has no solution there
            return 1e3
        if missing > 2.0:
            return 150.0 + 10.0 * math.log(missing)
        results = problem.evaluate(experiments, law_of)
        V = problem.scorecard(results).cost
        return 1e3 if V is None else V + 5.0 * missing + _hunting(results)

    return cost


def values(task: Task, logarithms: Sequence[float] | np.ndarray) -> dict[str, float]:
    """The values that belong to ``logarithms``."""
    return {name: start * math.exp(z) for (name, start), z in zip(task.start.items(), logarithms, strict=True)}


def search(task: Task, evaluations: int, spread: float, seed: int) -> tuple[dict[str, float], dict[str, Any]]:
    """The best values that hold A1-A3, rounded to four digits, and how they were found.

    ``spread`` is the first standard deviation of the logarithms. Threads evaluate a generation, and the result does
    not depend on them. Raises :class:`BenchmarkError` as :func:`finalist` does.
    """
    import cma  # the search alone needs it: pip install cma

    cost, begin = objective(task), time.perf_counter()
    options = {"seed": seed, "popsize": POPULATION, "maxfevals": evaluations, "verbose": -9}
    strategy = cma.CMAEvolutionStrategy(np.zeros(len(task.start)), spread, options)
    seen: list[tuple[float, tuple[float, ...]]] = []
    with ThreadPoolExecutor(THREADS) as threads:
        while not strategy.stop():
            candidates = strategy.ask()
            costs = list(threads.map(cost, candidates))
            strategy.tell(candidates, costs)
            seen += zip(costs, map(tuple, candidates), strict=True)
            print(f"{time.perf_counter() - begin:6.0f} s {len(seen):6d} evaluations: {min(seen)[0]:.2f}", flush=True)
    stability_tests = [each for each in problem.whole_protocol() if each.case.test.requirements]
    lowest, best = finalist(task, seen, stability_tests)
    print(f"{len(seen)} evaluations, {time.perf_counter() - begin:.0f} s, seed {seed}, {lowest:.2f}")
    return best, {"seed": seed, "evaluations": len(seen), "objective": round(float(lowest), 2)}


def finalist(
    task: Task, seen: Sequence[tuple[float, tuple[float, ...]]], experiments: Sequence[problem.Experiment]
) -> tuple[float, dict[str, float]]:
    """Objective and values, rounded to four digits, of the best candidate that holds A1-A3 in the ``experiments``.

    ``seen`` holds objectives and logarithms. Raises :class:`BenchmarkError` where none of the ``FINALISTS`` best does.
    """
    for lowest, candidate in sorted(seen)[:FINALISTS]:
        best = {name: float(f"{value:.4g}") for name, value in values(task, candidate).items()}
        requirements = _judged(experiments, task.law_of(best)).stability
        broken = [
            (name, requirement.worst_case) for name, requirement in requirements.items() if not requirement.passed
        ]
        if not broken:
            return lowest, best
        print(f"{lowest:.2f} does not hold {broken[0][0]}: {broken[0][1]}", flush=True)
    raise BenchmarkError(
        f"None of the {min(len(seen), FINALISTS)} best candidates of the search holds A1-A3 in all stability tests. "
        "Add the tests that they fail, printed above, to the objective, or search longer."
    )


def verdict(law_of: problem.LawOf, seed: int = 0) -> None:
    """Simulate the whole protocol and print the scorecard's essence."""
    card = _judged(problem.whole_protocol(seed), law_of)
    criteria = ", ".join(f"{name} {each.value:.4g}" for name, each in card.criteria.items())
    print(f"protocol paper, seed {seed}: V = {card.cost:.1f}, {criteria}")
    for name, requirement in card.stability.items():
        amplitude = "none" if requirement.limit_cycle is None else f"{requirement.limit_cycle * 1e6:.2f} um"
        print(f"{name} {'holds' if requirement.passed else 'FAILS'}: {amplitude} in {requirement.worst_case}")


def write(file: Path, script: Path, entries: Mapping[str, Any], how: Mapping[str, Any]) -> None:
    """Write a data file with the hash of what made it: the script, and all that it computes with."""
    rooms = [PACKAGE / room for room in ("loop", "benchmark")]
    made_by = source_hash([script, HERE, HERE.parent / "lqg", *rooms, HERE.parents[1] / "plant_fmu"])
    tuned = {"script": script.name, "sha256": made_by, **how}
    file.write_text(json.dumps({"tuned": tuned, **entries}, indent=1) + "\n", encoding="utf-8")
    print(f"written: {file.name}")


def _judged(experiments: Sequence[problem.Experiment], law_of: problem.LawOf) -> Scorecard:
    with ThreadPoolExecutor(THREADS) as threads:
        return problem.scorecard(problem.evaluate(experiments, law_of, threads))


def _hunting(results: Sequence[CaseResult]) -> float:
    """Penalty for limit cycles in the stability tests."""
    total = 0.0
    for result in results:
        cycle, test = result.measurements.limit_cycle, problem.PAPER.test(result.test)
        if test.requirements and not test.criteria:
            total += 100.0 if cycle is None else 4.0 * max(0.0, math.log(cycle / LIMIT_CYCLE))
    return total
