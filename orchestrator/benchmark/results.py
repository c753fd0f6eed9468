"""What the cases of a protocol came to, one by one and over the workspace: the parts that results are made of.

All values are in SI units; None stands for a value that does not exist.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from ..codec import Finite, Natural, NonNegative, Struct
from ..loop.trajectory import Status
from .case import Configuration, Test
from .protocol import Protocol, Stability
from .tally import Tally, reason


class Measurements(Struct, omit_defaults=True):
    """The figures of one simulation: those of B1..B7 that the test asks for, and in tests with a requirement the rest.

    ``limit_cycle`` is the TCP's amplitude at the end, half the largest distance between two points of its path in a
    window [m], ``rest_error`` the largest TCP error in the last second [m]. Of the direction in which the cycle is
    largest, or of the one in which it does not die away, ``limit_cycle_ratio`` is that to the amplitude one window
    before, ``limit_cycle_decay`` the largest ratio of any two successive windows, and ``limit_cycle_frequency`` the
    strongest frequency [Hz]. Where the case was simulated beyond its own end to judge it, these are figures of the
    later end, and ``limit_cycle_at_end`` is the amplitude at the case's own [m]. ``recovery`` is the time from the end
    of the force until the TCP error stays small [s]. ``settled`` is False if B6 ran to the end of the case.

    Where the disturbances come again, B5, B6, B7 and ``recovery`` are the largest of all repetitions; B6 and
    ``recovery`` of each run until the next disturbance begins at most, and ``settled`` is False if one does. B6 of the
    first force is ``B6_first``, and the largest of the others ``B6_later`` [s].
    ``residual_vibration`` is the geometric mean of the TCP's amplitudes in successive windows after the last force [m].
    """

    B1: NonNegative | None = None
    B2: NonNegative | None = None
    B3: NonNegative | None = None
    B4: NonNegative | None = None
    B5: NonNegative | None = None
    B6: NonNegative | None = None
    B7: NonNegative | None = None
    settled: bool | None = None
    limit_cycle: NonNegative | None = None
    limit_cycle_ratio: NonNegative | None = None
    limit_cycle_frequency: NonNegative | None = None
    limit_cycle_decay: NonNegative | None = None
    limit_cycle_at_end: NonNegative | None = None
    rest_error: NonNegative | None = None
    recovery: NonNegative | None = None
    residual_vibration: NonNegative | None = None
    B6_first: NonNegative | None = None
    B6_later: NonNegative | None = None

    @property
    def names(self) -> frozenset[str]:
        """The figures there are."""
        return frozenset(name for name in self.__struct_fields__ if getattr(self, name) is not None)

    @property
    def slowest_decay(self) -> float | None:
        """The largest known ratio of two successive windows; documents of older forms have the last one alone."""
        return max((r for r in (self.limit_cycle_ratio, self.limit_cycle_decay) if r is not None), default=None)


class Judgement(Struct, kw_only=True):
    """What one simulation came to: its status with the simulated time [s] and the reason, and its figures.

    There are no figures if the simulation did not reach the case's end. ``warnings`` counts FMI calls that returned a
    warning. ``judged_until`` is the end [s] of the windows that the limit cycle was looked for in: the case's own, or a
    later one that it was simulated to in doubt.
    """

    status: Status
    time: NonNegative
    message: str = ""
    measurements: Measurements = msgspec.field(default_factory=Measurements)
    warnings: Natural = 0
    judged_until: NonNegative | None = None

    @property
    def simulated(self) -> bool:
        """Whether the loop was simulated until its end, or until it left the workspace."""
        return self.status in (Status.DONE, Status.UNSTABLE)

    @property
    def judged(self) -> bool:
        """Whether its end says anything about the controller: one that was skipped or lost does not."""
        return self.status not in (Status.SKIPPED, Status.LOST)


def fields_of(judgement: Judgement) -> dict[str, Any]:
    """The fields of a judgement, without those of a case that it may have."""
    return {name: getattr(judgement, name) for name in Judgement.__struct_fields__}


class CaseResult(Judgement, kw_only=True):
    """A finished case by the names of its configuration, system and test."""

    id: str
    configuration: Configuration
    system: str
    test: str

    @property
    def judgement(self) -> Judgement:
        """The same without these names."""
        return Judgement(**fields_of(self))


Kind = Literal["quiet", "ring-down", "limit cycle", "unstable", "no verdict"]
"""What a simulation came to at its end. A ring-down is a motion as large as a limit cycle that dies away; an unstable
one left the workspace, or did not come to rest."""


class WorstCase(Struct):
    """The case with the largest value of a criterion; no value is the worst there is."""

    id: str
    value: NonNegative | None
    configuration: int
    system: str


class CriterionSpec(Struct):
    """What the protocol says about a criterion; ``paper`` is the value of Table 2."""

    target: Finite
    weight: NonNegative
    unit: str
    title: str
    paper: Finite


class CriterionScore(CriterionSpec):
    """A criterion over the workspace.

    ``value`` is the mean over the configurations of the worst value over the systems, as in Table 2; None if a
    case that counts has no value. ``share`` is the criterion's part of V, w_i times the mean of b_i.
    """

    value: NonNegative | None
    share: NonNegative | None
    worst_case: WorstCase | None


class Verdict(Struct, kw_only=True):
    """Whether a requirement is met, and the worst case with the amplitude of its limit cycle [m].

    ``passed`` is False if a case fails, else None if a case that the protocol asks for was skipped, lost or not run
    (the requirement is not judged), else True; ``tally`` counts how the cases ended. The worst is, of those that fail,
    the first without an amplitude (it left the workspace, crashed, ...), else that with the largest limit cycle; if
    none fails, the largest of all that were judged; ``kind``, ``ratio`` and ``frequency`` [Hz] are that case's.
    ``rest_error`` is given if it fails by it alone: its TCP error at the end [m], which is too large for rest. With
    other noise the same test failed ``seeds_failed`` times of ``seeds_tried``.
    """

    passed: bool | None
    tally: Tally = Tally()
    limit_cycle: NonNegative | None = None
    rest_error: NonNegative | None = None
    worst_case: str | None = None
    kind: Kind = "no verdict"
    ratio: NonNegative | None = None
    frequency: NonNegative | None = None
    seeds_failed: Natural = 0
    seeds_tried: Natural = 0

    @property
    def reason(self) -> str:
        """Why it is not met or not judged, in words; empty if it is met."""
        return reason(self.tally)


class Requirement(Verdict, kw_only=True):
    """The verdict over all cases; A1 and A2 with one per axis as well."""

    axes: dict[str, Verdict]

    def by_role(self, name: str) -> list[tuple[str, Verdict]]:
        """The verdicts one by one, called such as ``A2 1``: those per axis, or else, as ``A3``, the one over all."""
        return [(f"{name} {axis}", verdict) for axis, verdict in self.axes.items()] or [(name, self)]


class ConfigurationScore(Struct):
    """V_k of eq. (14) and the worst b_i of one configuration; None if a case that counts has no value."""

    index: int
    q_a1: Finite
    q_a2: Finite
    cost: NonNegative | None
    relative: dict[str, NonNegative | None]


class TestRules(Struct):
    """What a test adds to the loop, and what is measured in it. ``cases`` is the number of its cases in the whole
    protocol; None if that is not known, as in files that are older than this field."""

    __test__ = False

    name: str
    axis: int
    gain: Finite
    delay: NonNegative
    criteria: tuple[str, ...]
    requirements: tuple[str, ...]
    repeats: str = ""
    draws: bool = False
    cases: Natural | None = None


class CostRules(Struct):
    """V of a controller that meets all targets, and of the paper's PID."""

    target: Finite
    paper: Finite


class Rules(Struct):
    """What the protocol asks for, as far as scoring and reading the results needs it. ``cases`` is the number of cases
    of the whole protocol."""

    cases: Natural
    cost: CostRules
    criteria: dict[str, CriterionSpec]
    stability: Stability
    settling_error: NonNegative
    torque_limit: tuple[NonNegative, NonNegative]
    tests: tuple[TestRules, ...]

    def test(self, name: str) -> TestRules:
        """The test called ``name``."""
        return next(test for test in self.tests if test.name == name)


class Scorecard(Struct):
    """``cost`` is V of eq. (15), None if a criterion has no value. ``complete`` tells whether every case of the
    protocol ended with ``done`` or ``unstable``."""

    complete: bool
    cost: NonNegative | None
    criteria: dict[str, CriterionScore]
    stability: dict[str, Requirement]
    configurations: tuple[ConfigurationScore, ...]


def rules(protocol: Protocol) -> Rules:
    """The rules of a protocol."""
    return Rules(
        cases=protocol.case_count,
        cost=CostRules(target=sum(c.weight for c in protocol.criteria.values()), paper=protocol.reference["V"]),
        criteria={
            name: CriterionSpec(
                target=c.target, weight=c.weight, unit=c.unit, title=c.title, paper=protocol.reference[name]
            )
            for name, c in protocol.criteria.items()
        },
        stability=protocol.stability,
        settling_error=protocol.settling.error,
        torque_limit=protocol.loop.torque_limit,
        tests=tuple(test_rules(test, protocol.count(test)) for test in protocol.tests),
    )


def test_rules(test: Test, cases: int | None = None) -> TestRules:
    """The rules of a test, which has so many ``cases``; None if that is not known."""
    return TestRules(
        name=test.name,
        axis=test.axis,
        gain=test.gain,
        delay=float(test.delay),
        criteria=test.criteria,
        requirements=test.requirements,
        repeats=test.repeats,
        draws=test.draws,
        cases=cases,
    )
