"""What several benchmarks share: the loop in which contenders take turns, and two FMUs at rest."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numba
import numpy as np

from orchestrator.cache import compiled_code_folder

# Before anything is compiled. Beside its sources, where Numba keeps it otherwise, code of a function stays when what it
# calls has changed: a benchmark measured the plant as it had been.
numba.config.CACHE_DIR = numba.config.CACHE_DIR or str(compiled_code_folder())

from orchestrator.fmi.connectors import PLANT, bind  # noqa: E402
from orchestrator.fmi.lookup import find_values  # noqa: E402
from orchestrator.fmi.port import Port, exchange  # noqa: E402
from orchestrator.fmi.slaves import Slave  # noqa: E402
from orchestrator.loop.controller import prepared  # noqa: E402
from orchestrator.loop.master import steady_state  # noqa: E402
from orchestrator.loop.scenario import Scenario  # noqa: E402
from orchestrator.loop.setup import Setup  # noqa: E402

Contender = Callable[[], float]
"""Runs once and returns what a sample took [us]."""


def measure(contenders: Mapping[str, Contender], rounds: int) -> list[dict[str, float]]:
    """Times [us] of every contender in every round; a first round that fills caches is not counted.

    In every round each runs once, one after the other in one process, so that a slow moment of the machine hits all
    alike; the first one of a round changes.
    """
    results = []
    names = list(contenders)
    for number in range(rounds + 1):
        turn = number % len(names)
        results.append({name: contenders[name]() for name in names[turn:] + names[:turn]})
        print(f"\rround {number} of {rounds}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return results[1:]


def median(results: list[dict[str, float]], of: Callable[[dict[str, float]], float]) -> float:
    """The median over the rounds of what ``of`` makes of the times of one."""
    return statistics.median(map(of, results))


@numba.njit
def drive(port: Port, inputs: np.ndarray, step: float) -> int:
    """Step a slave once for every row of ``inputs`` (values as it takes them); returns the worst status."""
    worst = 0
    for k in range(inputs.shape[0]):
        for i in range(inputs.shape[1]):
            port.input_values[i] = inputs[k, i]
        worst = max(worst, exchange(port, port.inputs.size, k * step, step, True)[1])
    return worst


@contextmanager
def at_rest(plant: Slave, scenario: Scenario, controller: Slave | None = None) -> Iterator[tuple[Port, Port | None]]:
    """The ports of both, instantiated and initialized as the master does it: (u_m, u_d, F) to (q_m, X), q_m to u_m."""
    binding = bind(plant.archive.description, PLANT, "The plant")
    stop_time = float(scenario.duration)
    with plant.instantiated(stop_time):
        plant.initialize(find_values(plant.archive.description, dict(scenario.parameters), "The plant"), {})
        driven, read = (
            [variable for name in names for variable in binding[name].variables]
            for names in (("u_m", "u_d", "F"), ("q_m", "X"))
        )
        port = plant.port(driven, read)
        if controller is None:
            yield port, None
        else:
            steady = steady_state(plant, binding)
            with prepared(controller, Setup(), steady, scenario.sample_time, stop_time) as other:
                yield port, other
                controller.terminate()
        plant.terminate()
