"""Short simulations: as much of a case as one thing takes to be seen.

A search spends them, and repeats the worst over the whole case. ``benchmarks/short_simulations.py`` compares both.
"""

from __future__ import annotations

from fractions import Fraction

from ..benchmark.protocol import Protocol
from ..benchmark.variation import Variation
from .target import Target

LEAD = Fraction(1, 2)
"""Time [s] before the force, of which a whole case has ten: without a chirp the arm is at rest from the start."""

PEAK = Fraction(2, 5)
"""Time [s] after the force in which the error is largest, B5."""

REST = Fraction(8)
"""Time [s] after the force in which a limit cycle shows itself."""

MOMENT = Fraction(1, 100)
"""Time [s] by which a simulation goes on beyond the chirp's criterion, B7."""


def short(protocol: Protocol, target: Target, settling: float) -> Variation | None:
    """What of a case shows the ``target``; None for the whole.

    B5 takes the force alone, at once and without a chirp, as does a stability test; B7 what comes before the force; B6
    all until ``settling`` [s] after it: a controller with a memory settles otherwise after a chirp.
    """
    rules = protocol.disturbance
    t_1, t_2 = (Fraction(time).limit_denominator(1000) for time in (rules.t_1, rules.t_2))
    lead = min(LEAD, t_1)
    until = {
        "B5": lead + t_2 - t_1 + PEAK,
        "B6": t_2 + Fraction(round(10.0 * settling), 10),
        "B7": t_1 + MOMENT,
        "": lead + t_2 - t_1 + REST,
    }.get(target.criterion)
    if until is None or until >= protocol.test(target.test).duration:
        return None
    if target.criterion in ("B6", "B7"):
        return Variation(duration=until)
    return Variation(duration=until, t_1=float(lead), t_2=float(lead + t_2 - t_1), chirp_amplitude=(0.0, 0.0))
