"""Trajectories and case results for tests, made by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from closed_loops import case

from orchestrator.benchmark.metrics import CaseResult, Measurement
from orchestrator.cosim.trajectory import Ending, Status, Trajectory


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
    cycle: tuple[float, float] | None = (0.0, 0.0),
    status: Status = Status.DONE,
) -> CaseResult:
    """A case that came to an end: with ``criteria`` and limit ``cycle`` [m], or unmeasured where both are None."""
    if criteria is None and cycle is None:
        return CaseResult(case(index, system, test), status, 1.0, "it failed")
    return CaseResult(case(index, system, test), status, 26.0, measurement=Measurement(dict(criteria or {}), cycle))


def everything(values: Mapping[str, float], configurations=range(18)) -> list[CaseResult]:
    """Results of all cases of the protocol ``paper``, each with the same ``values`` of B1..B7 and no limit cycle."""
    results = []
    for index in configurations:
        for system in ("compliant", "random_1", "random_2"):
            results.append(result(index, system, "noise", {name: values[name] for name in ("B1", "B2")}))
            disturbed = {name: values[name] for name in ("B3", "B4", "B5", "B6", "B7")}
            results.append(result(index, system, "disturbance", disturbed))
        for system in ("compliant", "slippery", "sticky"):
            results += [result(index, system, test) for test in ("gain_1", "gain_2", "delay_1", "delay_2")]
    return results
