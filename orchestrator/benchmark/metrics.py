"""What is read off a trajectory: the criteria B1..B7, the limit cycle of A3, and whether the loop came to rest."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from ..loop.trajectory import Status, Trajectory
from .case import Case
from .protocol import Protocol
from .results import CaseResult, Judgement, Measurements

OSCILLATION = ("limit_cycle_x", "limit_cycle_z", "limit_cycle_ratio", "limit_cycle_frequency")
"""The figures of :func:`oscillation`."""

LARGEST_RATIO = 1e6
"""Of a motion that was none a window before."""


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


def expected(protocol: Protocol, case: Case) -> frozenset[str]:
    """Names of the figures that a simulation of ``case`` has when it reaches its end: those that its test asks for, as
    far as the scenario, which may have been varied, has what they are measured by."""
    scenario, limits = case.scenario, protocol.stability
    end = float(scenario.samples * scenario.sample_time)
    pushed = 0.0 < scenario.pulse.stop < end
    shaken = scenario.chirp.start < min(scenario.chirp.stop, scenario.pulse.start) and scenario.pulse.start < end
    lacking = set() if pushed else {"B5", "B6"}
    names = {name for name in case.test.criteria if name not in lacking and (name != "B7" or shaken)}
    if "B6" in names:
        names.add("settled")
    if case.test.requirements:
        names.add("rest_error")
        names |= {"recovery"} if pushed else set()
        names |= set(OSCILLATION) if 2.0 * limits.limit_cycle_window <= end else set()
    return frozenset(names)


def measure(protocol: Protocol, case: Case, trajectory: Trajectory) -> Measurements:
    """The figures of a simulation that ran to its end."""
    wanted, limits, release = expected(protocol, case), protocol.stability, case.scenario.pulse.stop
    found: dict[str, Any] = {name: CRITERIA[name](trajectory, case) for name in CRITERIA if name in wanted}
    if "B6" in wanted:
        found["B6"], found["settled"] = settling_time(trajectory, release, protocol.settling.error)
    if "rest_error" in wanted:
        found["rest_error"] = float(np.max(trajectory.tcp_error[_last(trajectory, limits.rest_window)]))
    if "recovery" in wanted:
        found["recovery"], _ = settling_time(trajectory, release, limits.recovery_error)
    if OSCILLATION[0] in wanted:
        found.update(zip(OSCILLATION, oscillation(trajectory, limits.limit_cycle_window), strict=True))
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


def oscillation(trajectory: Trajectory, window: float) -> tuple[float, float, float, float]:
    """Half the peak-to-peak of the TCP's x and z [m] over the last ``window`` [s], without detrending; and of the
    larger of the two its ratio to that of the window before, and its strongest frequency [Hz]."""
    last = _last(trajectory, window)
    before = _last(trajectory, 2.0 * window) & ~last
    amplitudes = 0.5 * np.ptp(trajectory.X[last], axis=0)
    larger = int(np.argmax(amplitudes))
    amplitude, earlier = float(amplitudes[larger]), 0.5 * float(np.ptp(trajectory.X[before, larger]))
    ratio = amplitude / max(earlier, amplitude / LARGEST_RATIO) if amplitude > 0.0 else 0.0
    curve = trajectory.X[last, larger]
    strongest = int(np.argmax(np.abs(np.fft.rfft(curve - curve.mean()))))
    frequency = strongest / (curve.size * float(trajectory.time[1] - trajectory.time[0]))
    return float(amplitudes[0]), float(amplitudes[1]), ratio, frequency


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
