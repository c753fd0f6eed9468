"""A sample of independent draws: how likely a failure is, and what the criteria do not exceed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

from ..benchmark.protocol import Protocol
from ..benchmark.reliability import Distribution, Failing, Failure, draws_needed, failing, quantile
from ..benchmark.results import CaseResult
from ..benchmark.scorecard import outcome
from ..benchmark.tally import UNJUDGED
from ..documents.commands import member_command, setting
from ..documents.files import RELIABILITY
from ..documents.reliability import Reliability
from ..errors import InputError
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

    def ask(self, testbed: Testbed, controller: Controller, folder: Path | None = None) -> Requests[Reliability]:
        """The requests of a sample, in batches of draws."""
        draws = self._count(folder)
        controller, pairing, T_s, listed = testbed.prepared(controller)
        protocol, nominal = testbed.rules, testbed.nominal
        begin = yield Now()
        yield from rehearsed(pairing, listed[0])
        # By number, not one after the other from one stream: more draws keep those
        # that are there, and a cluster may run them in any order.
        sample = [members(protocol, self.distribution, testbed.seed, number) for number in range(draws)]
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

        figures = {name: [_value(name, results) for results in by_draw] for name in protocol.criteria}
        costs = [_cost(protocol, {name: figures[name][number] for name in figures}) for number in range(draws)]
        answer = Reliability(
            schema=Reliability.SCHEMA,
            head=made,
            distribution=self.distribution,
            draws=draws,
            probability=self.probability,
            confidence=self.confidence,
            requirements={
                name: _failing(protocol, name, sample, by_draw, command, self.confidence)
                for name in sorted({requirement for test in protocol.tests for requirement in test.requirements})
            },
            criteria={name: quantile(values, self.probability, self.confidence) for name, values in figures.items()},
            cost=quantile(costs, self.probability, self.confidence),
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
        return Reliability.load(file).draws + self.more


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
    name: str,
    sample: Sequence[Sequence[Member]],
    by_draw: Sequence[Sequence[CaseResult]],
    command: Callable[[Member], str],
    confidence: float,
) -> Failing:
    """How often a requirement fails in a draw; one with a test that was lost is not judged, unless another fails."""
    tests = {test.name for test in protocol.tests if name in test.requirements}
    limits, judged = protocol.stability, 0
    failures: list[Failure] = []
    for number, (drawn, results) in enumerate(zip(sample, by_draw, strict=True)):
        outcomes = [(m, outcome(result, limits)) for m, result in zip(drawn, results, strict=True) if m.test in tests]
        failed = [(member, end) for member, end in outcomes if end not in ("holds", *UNJUDGED)]
        # A draw that was lost must not count as one that holds.
        judged += bool(failed) or all(end == "holds" for _, end in outcomes)
        failures += [Failure(number, member.test, end, command(member)) for member, end in failed]
    return failing(failures, judged, confidence)
