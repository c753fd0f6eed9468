"""The figures of a case, judged anew from its recorded motion and torques."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .signals import Scenario

Array = np.ndarray


def figures(
    own: Scenario, end: float, X: Array, torque: Array, u_m0: Array, definitions: Mapping[str, float]
) -> dict[str, float]:
    """B1 to B7 of the paper's Section 6, the largest TCP error at the end, half the peak-to-peak of a last window.

    ``X`` has shape (N + 1, 2) [m], ``torque`` (N, 2) [N.m]; ``end`` [s] is that of the case itself, which a simulation
    may go on beyond. Errors are distances from where the TCP began.
    """
    count = round(end / own.sample_time)
    t, error = np.arange(len(X)) * own.sample_time, np.hypot(*(X - X[0]).T)
    own_time = np.arange(len(X)) <= count
    pushed, released = own.force_times
    found = dict(zip(("B1", "B2"), np.abs(torque[:count] - u_m0).max(axis=0).tolist(), strict=True))
    found |= dict(zip(("B3", "B4"), np.abs(torque[:count]).max(axis=0).tolist(), strict=True))
    found["B5"] = _largest(error[own_time & (t >= pushed)])
    late = np.flatnonzero(own_time & (t > released) & (error >= definitions["settling_error"]))
    found["B6"] = float(t[late[-1]] - released) if late.size else 0.0
    found["B7"] = _largest(error[own_time & (t >= own.chirp_times[0]) & (t < pushed)])
    found["rest_error"] = _largest(error[t >= t[-1] - definitions["rest_window"] - 1e-9])
    last = min(count, len(t) - 1)
    window = X[: last + 1][t[: last + 1] >= t[last] - definitions["limit_cycle_window"] - 1e-9]
    found["limit_cycle_at_end"] = 0.5 * float(np.ptp(window, axis=0).max())
    return found


def _largest(values: Array) -> float:
    return float(values.max()) if values.size else 0.0
