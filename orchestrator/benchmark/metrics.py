"""What is read off a trajectory: the criteria B1..B7, the limit cycle of A3, and whether the loop came to rest."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..cosim.trajectory import Status, Trajectory
from .case import Case
from .protocol import Protocol


@dataclass(frozen=True)
class Measurement:
    """The figures of one simulation, SI units.

    ``criteria`` holds those of B1..B7 that the test asks for. ``limit_cycle`` is half the peak-to-peak of the TCP's
    x and z at the end, ``rest_error`` the largest TCP error in the last second [m]; both None for tests without a
    requirement. ``settled`` is False where B6 ran to the end of the simulation.
    """

    criteria: dict[str, float] = field(default_factory=dict)
    limit_cycle: tuple[float, float] | None = None
    rest_error: float | None = None
    settled: bool | None = None


@dataclass(frozen=True)
class CaseResult:
    """One finished case: its status with the simulated time [s] and the reason, and its measurement.

    The measurement is None where the simulation did not reach its end. ``warnings`` counts FMI calls that returned
    a warning, ``wall_time`` [s] what the simulation took. ``final`` is False where something from outside ended it, so
    that it is worth another try. ``kind`` is what went wrong without figures, the same for equal failures; empty where
    nothing did.
    """

    case: Case
    status: Status
    time: float
    message: str = ""
    measurement: Measurement | None = None
    warnings: int = 0
    wall_time: float = 0.0
    final: bool = True
    kind: str = ""


def judge(protocol: Protocol, case: Case, trajectory: Trajectory) -> dict[str, Any]:
    """Status, time, message, measurement and warnings of a simulated case, as fields of :class:`CaseResult`."""
    ending = trajectory.ending
    result = {"status": ending.status, "time": ending.time, "message": ending.message, "warnings": ending.warnings}
    if ending.status is not Status.DONE:
        return result
    measurement = measure(protocol, case, trajectory)
    limits = protocol.raw["stability"]
    if measurement.rest_error is not None and measurement.rest_error > limits["rest_error"]:
        result["status"] = Status.UNSTABLE
        result["message"] = (
            f"the TCP error was {measurement.rest_error * 1e3:.3g} mm in the last {limits['rest_window']:g} s"
        )
    return {**result, "measurement": measurement}


def measure(protocol: Protocol, case: Case, trajectory: Trajectory) -> Measurement:
    """The figures of a simulation that ran to its end."""
    criteria: dict[str, float] = {}
    settled = None
    for name in case.test.criteria:
        if name == "B6":
            criteria[name], settled = settling_time(
                trajectory, case.scenario.pulse.stop, protocol.raw["settling"]["error"]
            )
        else:
            criteria[name] = CRITERIA[name](trajectory, case)
    if not case.test.requirements:
        return Measurement(criteria, settled=settled)
    limits = protocol.raw["stability"]
    return Measurement(
        criteria,
        limit_cycle=limit_cycle(trajectory, limits["limit_cycle_window"]),
        rest_error=float(np.max(trajectory.tcp_error[_last(trajectory, limits["rest_window"])])),
        settled=settled,
    )


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

    The second value is False where the last sample of all is such a one: then the whole remainder counts.
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
    return trajectory.time >= trajectory.time[-1] - window


CRITERIA = {
    "B1": lambda trajectory, case: noise_torque(trajectory, 1),
    "B2": lambda trajectory, case: noise_torque(trajectory, 2),
    "B3": lambda trajectory, case: torque(trajectory, 1),
    "B4": lambda trajectory, case: torque(trajectory, 2),
    "B5": force_error,
    "B7": chirp_error,
}
