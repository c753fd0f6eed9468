"""A sample of independent draws: how likely a failure is, and what the criteria do not exceed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

from ..benchmark.protocol import Protocol
from ..benchmark.reliability import Distribution, Failing, Failure, draws_needed, failing, quantile
from ..benchmark.results import CaseResult
from ..benchmark.scorecard import outcome
from ..benchmark.tail import tail
from ..benchmark.tally import UNJUDGED
from ..documents.commands import member_command, setting
from ..documents.files import RELIABILITY
from ..documents.reliability import Reliability
from ..errors import InputError, unknown
from ..pairing.controller import Controller
from ..pairing.testbed import Testbed
from ..search.draws import members
from ..search.member import Member, case_of, parameters
from .declaration import Study, described, option
from .heads import head
from .requests import Batch, BatchEntry, Now, Requests, Save, rehearsed

DRAWS_PER_BATCH = 64
"""Draws in a batch."""


@described
@dataclass(frozen=True)
class ReliabilityStudy(Study[Reliability]):
    """How likely a failure is at most: independent draws of arm, pose, direction of the force, sweep and noise."""

    command = "reliability"
    suffix = "-reliability"

    probability: float = option(
        0.01,
        "of failure, and of a draw beyond the bounds of the criteria; with the confidence it says how many draws there "
        "are",
        above=0,
        below=1,
    )
    confidence: float = option(0.99, "of the bounds", above=0, below=1)
    distribution: Distribution = option(
        "box",
        "of the uncertain parameters: uniform within Table 1, or each at one of its ends",
        choices=get_args(Distribution),
    )
    draws: int | None = option(
        None,
        "so many draws instead; draw k depends on k, the seed and the distribution alone",
        least=1,
        metavar="N",
        exclude="size",
    )
    more: int | None = option(None, "so many draws more than the folder has", least=1, metavar="N", exclude="size")
    only: Sequence[str] = option(
        (),
        "what to simulate the tests of: A1, A2, A3, B1 to B7, or a test such as delay_2; by default everything",
        metavar="NAME",
    )

    def ask(self, testbed: Testbed, controller: Controller, folder: Path | None = None) -> Requests[Reliability]:
        """The requests of a sample, in batches of draws."""
        protocol, nominal = testbed.rules, testbed.nominal
        chosen = simulated(protocol, self.only)
        draws = self._count(folder)
        controller, pairing, T_s, listed = testbed.prepared(controller)
        begin = yield Now()
        yield from rehearsed(pairing, listed[0])
        # By number, not one after the other from one stream: more draws keep those
        # that are there, and a cluster may run them in any order.
        sample = [
            [member for member in members(protocol, self.distribution, testbed.seed, number) if member.test in chosen]
            for number in range(draws)
        ]
        by_draw: list[list[CaseResult]] = []
        total = sum(map(len, sample))
        while len(by_draw) < draws:
            chunk = sample[len(by_draw) : len(by_draw) + DRAWS_PER_BATCH]
            cases = [case_of(member, protocol, nominal) for drawn in chunk for member in drawn]
            at_rate = tuple(replace(case, scenario=replace(case.scenario, sample_time=T_s)) for case in cases)
            before = sum(map(len, by_draw))
            (runs,) = yield Batch((BatchEntry(protocol, pairing, at_rate, patience=None),), before, total)
            results = iter(run.result for run in runs)
            by_draw += [[next(results) for _ in drawn] for drawn in chunk]
        end = yield Now()
        made = head(testbed, controller, pairing, T_s, begin, end)

        def command(member: Member) -> str:
            return member_command(setting(made), member, parameters(member, protocol, nominal))

        judged = judged_by(protocol, chosen, self.only)
        measured = [name for name in protocol.criteria if tests_of(protocol, name) <= chosen]
        figures = {name: [_value(name, results) for results in by_draw] for name in measured}
        # V takes all criteria: a part of them would be a smaller V.
        costs = (
            [_cost(protocol, {name: figures[name][number] for name in figures}) for number in range(draws)]
            if len(measured) == len(protocol.criteria)
            else []
        )
        answer = Reliability(
            schema=Reliability.SCHEMA,
            head=made,
            distribution=self.distribution,
            draws=draws,
            probability=self.probability,
            confidence=self.confidence,
            only=tuple(self.only),
            requirements={
                name: _failing(protocol, tests, sample, by_draw, command, self.confidence)
                for name, tests in judged.items()
            },
            criteria={name: quantile(values, self.probability, self.confidence) for name, values in figures.items()},
            cost=quantile(costs, self.probability, self.confidence),
            tails={
                name: fitted
                for name, values, target in (
                    *((name, values, protocol.criteria[name].target) for name, values in figures.items()),
                    ("V", costs, made.rules.cost.target),
                )
                if (fitted := tail(values, target, self.probability, self.confidence)) is not None
            },
        )
        yield Save(answer)
        return answer

    def _count(self, folder: Path | None) -> int:
        """The number of draws; more than in an earlier sample, those of it are included."""
        if self.more is None:
            return draws_needed(self.probability, self.confidence) if self.draws is None else self.draws
        file = None if folder is None else folder / RELIABILITY
        if file is None or not file.is_file():
            raise InputError("There is no sample that draws could be added to.", "no-sample", folder or "")
        earlier = Reliability.load(file)
        if (earlier.distribution, earlier.only) != (self.distribution, tuple(self.only)):
            raise InputError(
                f"The sample in {folder} has another distribution, or other tests: draws cannot be added to it.",
                "no-sample",
                folder or "",
            )
        return earlier.draws + self.more


def tests_of(protocol: Protocol, name: str) -> set[str]:
    """The tests that a requirement or a criterion asks for, or the test of that ``name``. Repetitions with other noise
    are left out: each draw has its own noise."""
    tests = [test for test in protocol.tests if not test.repeats]
    return {test.name for test in tests if name in (test.name, *test.requirements, *test.criteria)}


def simulated(protocol: Protocol, only: Sequence[str]) -> set[str]:
    """The tests of what ``only`` names, or all.

    Raises :class:`InputError` for a name that is no requirement, criterion or test.
    """
    tests = [test for test in protocol.tests if not test.repeats]
    requirements = sorted({requirement for test in tests for requirement in test.requirements})
    names = [*requirements, *protocol.criteria, *(test.name for test in tests)]
    for name in only:
        if name not in names:
            message = f"The protocol {protocol.name} has no requirement, criterion or test {name}."
            raise unknown(message, "no-target", protocol.name, name, names)
    chosen = [tests_of(protocol, name) for name in only or names]
    return set().union(*chosen)


def judged_by(protocol: Protocol, chosen: AbstractSet[str], only: Sequence[str]) -> dict[str, set[str]]:
    """What is judged, with its tests: each requirement all of whose tests are ``chosen``, and each test that ``only``
    names. A requirement of which some test is left out may fail in that test, so it has no bound."""
    requirements = sorted({requirement for test in protocol.tests for requirement in test.requirements})
    whole = [name for name in requirements if tests_of(protocol, name) <= chosen]
    named = [test.name for test in protocol.tests if test.name in only and test.requirements]
    return {name: tests_of(protocol, name) for name in (*whole, *named)}


def _value(name: str, results: Sequence[CaseResult]) -> float | None:
    """The criterion in a draw: the largest of its tests; None if one has none."""
    values = [getattr(result.measurements, name) for result in results]
    numbers = [value for value in values if value is not None]
    return max(numbers, default=None)


def _cost(protocol: Protocol, values: dict[str, float | None]) -> float | None:
    """V of eq. (15) of one draw."""
    total = 0.0
    for name, spec in protocol.criteria.items():
        value = values[name]
        if value is None:
            return None
        total += spec.weight * value / spec.target
    return total


def _failing(
    protocol: Protocol,
    tests: AbstractSet[str],
    sample: Sequence[Sequence[Member]],
    by_draw: Sequence[Sequence[CaseResult]],
    command: Callable[[Member], str],
    confidence: float,
) -> Failing:
    """How often a draw fails in one of the ``tests``; one with a test that was lost is not judged, unless another
    fails."""
    limits, judged = protocol.stability, 0
    failures: list[Failure] = []
    for number, (drawn, results) in enumerate(zip(sample, by_draw, strict=True)):
        outcomes = [(m, outcome(result, limits)) for m, result in zip(drawn, results, strict=True) if m.test in tests]
        failed = [(member, end) for member, end in outcomes if end not in ("holds", *UNJUDGED)]
        # A draw that was lost must not count as one that holds.
        judged += bool(failed) or all(end == "holds" for _, end in outcomes)
        failures += [Failure(number, member.test, end, command(member)) for member, end in failed]
    return failing(failures, judged, confidence)
