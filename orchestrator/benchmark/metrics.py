"""What is read off a trajectory: the criteria B1..B7, the limit cycle of A3, and whether the loop came to rest."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from ..loop.trajectory import Status, Trajectory
from .case import Case, Test
from .protocol import Protocol
from .results import CaseResult, Judgement, Measurements


def judge(protocol: Protocol, case: Case, trajectory: Trajectory) -> Judgement:
    """Status and figures of a simulated case."""
    ending = trajectory.ending
    judgement = Judgement(status=ending.status, time=ending.time, message=ending.message, warnings=ending.warnings)
    if ending.status is not Status.DONE:
        return judgement
    measurements = measure(protocol, case, trajectory)
    limits = protocol.stability
    if measurements.rest_error is not None and measurements.rest_error > limits.rest_error:
        reason = f"the TCP error was {measurements.rest_error * 1e3:.3g} mm in the last {limits.rest_window:g} s"
        judgement = msgspec.structs.replace(judgement, status=Status.UNSTABLE, message=reason)
    return msgspec.structs.replace(judgement, measurements=measurements)


def named(case: Case, judgement: Judgement) -> CaseResult:
    """A judgement with the names of its case."""
    return CaseResult(
        status=judgement.status,
        time=judgement.time,
        message=judgement.message,
        measurements=judgement.measurements,
        warnings=judgement.warnings,
        id=case.id,
        configuration=case.configuration,
        system=case.system.name,
        test=case.test.name,
    )


def expected(test: Test) -> frozenset[str]:
    """Names of the figures that a simulation of ``test`` has when it reaches its end."""
    settled = {"settled"} if "B6" in test.criteria else set()
    stability = {"limit_cycle_x", "limit_cycle_z", "rest_error"} if test.requirements else set()
    return frozenset({*test.criteria, *settled, *stability})


def measure(protocol: Protocol, case: Case, trajectory: Trajectory) -> Measurements:
    """The figures of a simulation that ran to its end."""
    found: dict[str, Any] = {}
    for name in case.test.criteria:
        if name == "B6":
            found["B6"], found["settled"] = settling_time(trajectory, case.scenario.pulse.stop, protocol.settling.error)
        else:
            found[name] = CRITERIA[name](trajectory, case)
    if case.test.requirements:
        limits = protocol.stability
        x, z = limit_cycle(trajectory, limits.limit_cycle_window)
        rest = float(np.max(trajectory.tcp_error[_last(trajectory, limits.rest_window)]))
        found.update(limit_cycle_x=x, limit_cycle_z=z, rest_error=rest)
    return Measurements(**found)


def noise_torque(trajectory: Trajectory, axis: int) -> float:
    """B1, B2: max |u_m - u_m0| of ``axis`` (1 or 2) [N.m]."""
    return float(np.max(np.abs(trajectory.torque[:, axis - 1] - trajectory.u_m0[axis - 1])))


def torque(trajectory: Trajectory, axis: int) -> float:
    """B3, B4: max |u_m| of ``axis`` (1 or 2) as sent to the drive, gravity included [N.m]."""
    return float(np.max(np.abs(trajectory.torque[:, axis - 1])))


def force_error(trajectory: Trajectory, case: Case) -> float:
    """B5: largest TCP error from the beginning of the force, t_1, on [m]."""
    return float(np.max(trajectory.tcp_error[trajectory.time >= case.scenario.pulse.start]))


def chirp_error(trajectory: Trajectory, case: Case) -> float:
    """B7: largest TCP error from the beginning of the chirp, t_3, to that of the force, t_1 [m]."""
    time, scenario = trajectory.time, case.scenario
    return float(np.max(trajectory.tcp_error[(time >= scenario.chirp.start) & (time < scenario.pulse.start)]))


def settling_time(trajectory: Trajectory, release: float, error: float) -> tuple[float, bool]:
    """B6: time [s] from ``release`` (t_2) to the last sample with a TCP error of ``error`` [m] or more.

    The second value is False if the last sample of all is such a one: then the whole remainder counts.
    """
    late = np.flatnonzero((trajectory.time > release) & (trajectory.tcp_error >= error))
    if late.size == 0:
        return 0.0, True
    return float(trajectory.time[late[-1]]) - release, bool(late[-1] < trajectory.time.size - 1)


def limit_cycle(trajectory: Trajectory, window: float) -> tuple[float, float]:
    """Half the peak-to-peak of the TCP's x and z [m] over the last ``window`` [s]; no detrending."""
    x, z = (0.5 * np.ptp(trajectory.X[_last(trajectory, window)], axis=0)).tolist()
    return x, z


def _last(trajectory: Trajectory, window: float) -> np.ndarray:
    late: np.ndarray = trajectory.time >= trajectory.time[-1] - window
    return late


CRITERIA = {
    "B1": lambda trajectory, case: noise_torque(trajectory, 1),
    "B2": lambda trajectory, case: noise_torque(trajectory, 2),
    "B3": lambda trajectory, case: torque(trajectory, 1),
    "B4": lambda trajectory, case: torque(trajectory, 2),
    "B5": force_error,
    "B7": chirp_error,
}
