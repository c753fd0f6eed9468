"""Trajectories and case results for tests, made by hand."""

from collections.abc import Iterable, Mapping

import numpy as np

from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.cases import grid
from orchestrator.benchmark.results import CaseResult, Measurements, rules
from orchestrator.loop.trajectory import Ending, Status, Trajectory

PAPER = protocols.load("paper")
RULES = rules(PAPER)
GRID = grid(PAPER)

TABLE_2 = {"B1": 0.17, "B2": 0.06, "B3": 9.6, "B4": 9.1, "B5": 10.2e-3, "B6": 3.5, "B7": 1.1e-3}
"""The paper's figures of its PID, which give V = 140.7."""


def trajectory(error_x=0.0, error_z=0.0, torque=(0.0, 0.0), u_m0=(0.0, 0.0), duration=26.0, sample_time=0.25e-3):
    """A trajectory whose TCP error and torques are given as functions of time or numbers [m, N.m]."""
    time = np.arange(round(duration / sample_time) + 1) * sample_time

    def over(t, signal):
        return np.broadcast_to(signal(t) if callable(signal) else signal, t.shape)

    X = np.column_stack([over(time, error_x), over(time, error_z)])
    # The first sample defines where the tool began: errors count from (1.2, -0.7).
    X[0] = 0.0
    torques = np.column_stack([over(time[:-1], signal) for signal in torque])
    empty = np.zeros((len(time), 2))
    return Trajectory(
        time=time,
        q_m=empty,
        X=X + (1.2, -0.7),
        extra={},
        measured=empty,
        given=torques * 0.0,
        command=torques,
        torque=torques,
        q_m_ref=(0.0, 0.0),
        u_m0=u_m0,
        ending=Ending(Status.DONE, duration),
    )


def result(
    index: int,
    system: str,
    test: str,
    criteria: Mapping[str, float] | None = None,
    cycle: float | None = 0.0,
    status: Status = Status.DONE,
    message: str = "",
) -> CaseResult:
    """A case of the protocol ``paper``: with ``criteria`` and limit ``cycle`` [m], or unmeasured if both are None."""
    measured = Measurements(**(criteria or {}))
    if cycle is not None:
        lasting = {"limit_cycle_ratio": 1.0, "limit_cycle_frequency": 3.0, "recovery": 1.0}
        measured = Measurements(**(criteria or {}), **lasting, limit_cycle=cycle, rest_error=0.0)
    ended = criteria is None and cycle is None
    return CaseResult(
        id=f"c{index:02d}.{system}.{test}",
        configuration=GRID[index],
        system=system,
        test=test,
        status=status,
        time=1.0 if ended else 26.0,
        message="it failed" if ended and not message else message,
        measurements=measured,
    )


def everything(values: Mapping[str, float], configurations: Iterable[int] = range(18)) -> list[CaseResult]:
    """Results of all cases of the protocol ``paper``, each with the same ``values`` of B1..B7 and no limit cycle."""
    results = []
    for index in configurations:
        for system in ("compliant", "random_1", "random_2"):
            results.append(result(index, system, "noise", {name: values[name] for name in ("B1", "B2")}, None))
            disturbed = {name: values[name] for name in ("B3", "B4", "B5", "B6", "B7")}
            results.append(result(index, system, "disturbance", disturbed))
        for system in ("compliant", "slippery", "sticky"):
            results += [result(index, system, test) for test in ("gain_1", "gain_2", "delay_1", "delay_2")]
    return results
