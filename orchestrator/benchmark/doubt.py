"""Whether the end of a case leaves a doubt about its verdict, and the longer simulation that settles it.

The longer simulation repeats the case to the last bit and goes on: FMUs are told of the same end in both.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

from ..loop.scenario import Scenario
from .case import Case
from .metrics import own_end
from .protocol import Protocol
from .results import Judgement


def doubtful(protocol: Protocol, case: Case, judgement: Judgement) -> bool:
    """Whether the case has to be simulated further: its last windows show a motion that is neither dying away for sure
    nor lasting for sure, or the arm is not at rest yet, and there is time left to look at it."""
    figures, limits, end = judgement.measurements, protocol.stability, own_end(case)
    amplitude, ratio, decay = figures.limit_cycle, figures.limit_cycle_ratio, figures.limit_cycle_decay
    if amplitude is None or ratio is None or decay is None or amplitude < limits.doubtful:
        return False
    rests = figures.rest_error is None or figures.rest_error <= limits.rest_error
    if decay < limits.dying and rests:
        return False
    lasting = amplitude >= limits.limit_cycle and limits.steady <= ratio <= 1.0 / limits.steady
    own = judgement.judged_until is not None and judgement.judged_until <= end
    return not lasting and own and end < limits.longest and _left_alone(case.scenario, end)


def _left_alone(scenario: Scenario, end: float) -> bool:
    return scenario.chirp.stop <= end and scenario.pulse.stop <= end


def longer(protocol: Protocol, case: Case) -> Scenario:
    """The scenario of ``case`` with its end moved to the latest."""
    latest = Fraction(protocol.stability.longest)
    return replace(case.scenario, duration=max(latest, case.scenario.duration))
