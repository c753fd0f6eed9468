"""Whether the end of a case leaves a doubt about its verdict, and the longer simulation that settles it.

The stop time that FMUs get is the latest possible end, in all simulations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

from ..loop.scenario import Scenario
from .case import Case
from .motion import at_rest, lasts
from .protocol import Protocol


def doubtful(protocol: Protocol, case: Case, windows: Sequence[Sequence[float]], rest_error: float | None) -> bool:
    """Whether a case that was simulated to its own end has to be simulated further.

    ``windows`` are the amplitudes [m] of x and of z in the last windows. There is a doubt if neither coordinate has a
    limit cycle for sure, one of them does not come to rest for sure, or the TCP creeps to where its ``rest_error`` [m]
    is none; and the longer simulation has not reached its end.
    """
    limits, left = protocol.stability, _left(protocol, case)
    if left <= 0 or not windows[0]:
        return False
    if any(lasts(limits, each, left) for each in windows):
        return False
    creep = 2.0 * left * max(each[-1] for each in windows)
    creeps = rest_error is not None and 0.0 < rest_error - limits.rest_error <= creep
    return creeps or not all(at_rest(limits, each, left) for each in windows)


def _left(protocol: Protocol, case: Case) -> int:
    """Windows between the end of ``case`` and the latest one; none if it is not simulated further in any case."""
    limits, scenario, end = protocol.stability, case.scenario, case.end
    cut = scenario.duration < case.test.duration  # its user wants no more of it
    if cut or not case.test.requirements or scenario.chirp.stop > end or scenario.pulse.stop > end:
        return 0
    return max(int((limits.longest - end) / limits.limit_cycle_window), 0)


def with_latest_end(protocol: Protocol, case: Case) -> Scenario:
    """The scenario of ``case`` with the latest end that it may be simulated to."""
    if _left(protocol, case) == 0:
        return case.scenario
    return replace(case.scenario, duration=Fraction(protocol.stability.longest))
