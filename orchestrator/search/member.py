"""A member of the uncertainty description with its disturbance: what a search for the worst case moves in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import NamedTuple

from ..benchmark import cases
from ..benchmark.case import Case, Test
from ..benchmark.protocol import Protocol
from ..benchmark.variation import Variation, vary

Pair = tuple[float, float]

NOMINAL = "nominal"
"""The system that parameters are changed of."""


class Change(NamedTuple):
    """What is changed of an axis: the factor of the loop gain, and the delay [s] beside the benchmark's."""

    gain: float
    delay: Fraction


UNCHANGED = Change(1.0, Fraction(0))


@dataclass(frozen=True)
class Member:
    """One point of the search; everything that its simulation depends on beside the controller.

    Parameters
    ----------
    q_a : tuple of float
        Link angles [degrees], so that a command says them exactly.
    test : str
        A test of the protocol.
    deviations : tuple of (str, float)
        By FMI name, the deviation in half-widths of Table 1: -1 and 1 are the ends of a parameter's range.
    system : str
        The system of the protocol that the deviations start from; it also names the noise.
    phi_F : float, optional
        Direction of the force [rad]; by default the test's.
    sweep : tuple of float, optional
        Frequencies [Hz] at which the chirp begins and ends; by default the test's.
    t_3 : float, optional
        Time [s] at which the chirp begins; by default the test's.
    gain, delay : optional
        Loop gain, and delay from controller to motor [s], of both axes, instead of the test's.
    seed : int
        Base seed of the measurement noise.
    short : Variation, optional
        What of the case is simulated; the whole by default.
    """

    q_a: Pair
    test: str
    deviations: tuple[tuple[str, float], ...] = ()
    system: str = NOMINAL
    phi_F: float | None = None
    sweep: Pair | None = None
    t_3: float | None = None
    gain: Pair | None = None
    delay: tuple[Fraction, Fraction] | None = None
    seed: int = 0
    short: Variation | None = None

    @property
    def variation(self) -> Variation:
        """What it changes in its test."""
        short = self.short or Variation()
        return replace(
            short,
            phi_F=self.phi_F,
            chirp_frequencies=self.sweep,
            t_3=self.t_3 if short.t_3 is None else short.t_3,
            gain=self.gain,
            delay=self.delay,
        )


def changes(member: Member, protocol: Protocol) -> tuple[Change, Change]:
    """The change of each axis: the test's own, unless the member has others."""
    asked, T_d = (asked_of(protocol.test(member.test), axis) for axis in (1, 2)), protocol.loop.delay
    first, second = (
        Change(
            own.gain if member.gain is None else member.gain[place],
            own.delay if member.delay is None else member.delay[place] - T_d,
        )
        for place, own in enumerate(asked)
    )
    return first, second


def asked_of(test: Test, axis: int) -> Change:
    """The change of an axis that a test asks for."""
    return Change(test.gain, test.delay) if test.axis == axis else UNCHANGED


def within(member: Member) -> bool:
    """Whether it lies within Table 1 and is simulated as a whole case."""
    return member.short is None and all(abs(value) <= 1.0 for _, value in member.deviations)


def possible(member: Member, protocol: Protocol) -> bool:
    """Whether it is within Table 1, as a whole case, in a loop that its test asks for: A1 asks for all gains from 1 to
    the test's, A2 for all delays from that of the loop on."""
    if not within(member):
        return False
    for axis, (gain, delay) in enumerate(changes(member, protocol), start=1):
        asked = asked_of(protocol.test(member.test), axis)
        if not min(1.0, asked.gain) <= gain <= max(1.0, asked.gain) or not 0 <= delay <= asked.delay:
            return False
    return True


def names(protocol: Protocol) -> tuple[str, ...]:
    """FMI names of the uncertain parameters, one for each axis."""
    return tuple(f"{symbol}[{axis}]" for symbol in protocol.uncertainty for axis in (1, 2))


def of_case(case: Case) -> Member:
    """The member that a case of a protocol is."""
    pose = case.configuration
    first, second = (round(math.degrees(angle), 9) for angle in (pose.q_a1, pose.q_a2))
    return Member((first, second), case.test.name, system=case.system.name)


def loose(member: Member, protocol: Protocol) -> Member:
    """The same parameters as deviations of the nominal system, one by one, so that each can be changed.

    Its noise is another, and that of the test that its own test repeats.
    """
    signs = protocol.systems[member.system]
    changed = dict(member.deviations)
    deviations = tuple((name, changed.get(name, float(signs.get(symbol_of(name), 0)))) for name in names(protocol))
    test = protocol.test(member.test)
    return replace(member, system=NOMINAL, deviations=deviations, test=test.repeats or test.name)


def spelled(member: Member, protocol: Protocol, test: str) -> Member:
    """The same in ``test``, with parameters as in :func:`loose` and its own disturbance in numbers, so that each can be
    changed."""
    own_test, fixed = protocol.test(member.test), protocol.fixed_disturbance
    low, high = protocol.disturbance.chirp_frequencies
    phi_F = fixed.phi_F if own_test.direction_deg is None else math.radians(own_test.direction_deg)
    sweep = {"up": (low, high), "down": (high, low)}.get(own_test.sweep, (fixed.f_start, fixed.f_stop))
    return replace(
        loose(member, protocol),
        test=test,
        phi_F=phi_F if member.phi_F is None else member.phi_F,
        sweep=sweep if member.sweep is None else member.sweep,
    )


def symbol_of(name: str) -> str:
    """The symbol of Table 1 in an FMI name."""
    return name.partition("[")[0]


def cost(member: Member, protocol: Protocol) -> float:
    """What a member's simulation costs, in whole cases: its simulated time by that of the longest test."""
    longest = max(test.duration for test in protocol.tests)
    duration = protocol.test(member.test).duration
    if member.short is not None and member.short.duration is not None:
        duration = member.short.duration
    return float(duration / longest)


def parameters(member: Member, protocol: Protocol, nominal: Mapping[str, float]) -> dict[str, float]:
    """The plant's parameters that differ from the nominal ones, by FMI name [SI]."""
    return {
        name: nominal[name] * (1.0 + protocol.uncertainty[symbol_of(name)] * deviation)
        for name, deviation in member.deviations
        if deviation
    }


def case_of(member: Member, protocol: Protocol, nominal: Mapping[str, float]) -> Case:
    """The case of a member, equal to the last bit to what ``simulate`` makes of the same values."""
    test = protocol.test(member.test)
    pose = cases.configuration(protocol, math.radians(member.q_a[0]), math.radians(member.q_a[1]))
    values = {**nominal, **parameters(member, protocol, nominal)}
    system = cases.system(protocol, values, member.seed, pose.index, member.system, test)
    unvaried = cases.case(protocol, pose, system, test, member.seed)
    return replace(unvaried, scenario=vary(unvaried.scenario, protocol, member.variation))
