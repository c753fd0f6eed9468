"""From case results to the cost V, the criteria B1..B7 and the verdicts A1..A3 (Section 6, eq. (14)-(15)).

A scorecard is a function of the rules and the cases alone, so whoever reads results can compute it again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from msgspec.structs import asdict

from ..loop.trajectory import Status
from .protocol import Protocol, Stability
from .results import (
    CaseResult,
    ConfigurationScore,
    CriterionScore,
    CriterionSpec,
    Judgement,
    Kind,
    Requirement,
    Rules,
    Scorecard,
    Verdict,
    WorstCase,
    rules,
)
from .tally import UNJUDGED, Outcome, tally

HOLDING = ("quiet", "ring-down")
"""Kinds of a case in which a requirement holds."""

ENDED: dict[Status, Outcome] = {
    Status.CRASHED: "crashed",
    Status.TIMEOUT: "timeout",
    Status.ERROR: "error",
    Status.LOST: "lost",
    Status.SKIPPED: "skipped",
}
"""How a case counts that did not reach its end."""


def score(rules: Rules, results: Sequence[CaseResult], expected: int | None = None) -> Scorecard:
    """The scorecard of ``results``; it is complete if ``expected`` cases (default: all) were simulated."""
    criteria = {name: _criterion(rules, name, spec, results) for name, spec in rules.criteria.items()}
    simulated = sum(result.simulated for result in results)
    return Scorecard(
        complete=simulated == (rules.cases if expected is None else expected),
        cost=_sum(criterion.share for criterion in criteria.values()),
        criteria=criteria,
        stability={
            "A1": _per_axis("A1", rules, results),
            "A2": _per_axis("A2", rules, results),
            "A3": _overall("A3", rules, results, {}),
        },
        configurations=tuple(_configuration(rules, group) for group in _by_configuration(results)),
    )


def first_and_later(results: Sequence[CaseResult]) -> tuple[float, float] | None:
    """B6 [s] of the first force, and the largest of the later ones, each the mean over the configurations of the worst
    case as in eq. (14); None if it is not known of a case whose test has disturbances that come again, or of none."""
    tests = {result.test for result in results if result.measurements.B6_later is not None}
    groups = _by_configuration(result for result in results if result.test in tests)
    first, later = (_sum(_worst(group, name)[0] for group in groups) for name in ("B6_first", "B6_later"))
    return None if first is None or later is None or not groups else (first / len(groups), later / len(groups))


def cost_so_far(protocol: Protocol, results: Sequence[CaseResult]) -> float | None:
    """The mean of V_k over the configurations whose performance tests are all done; None before the first."""
    tests = {test.name: len(protocol.sets[test.systems]) for test in protocol.tests if test.criteria}
    counts: dict[int, int] = {}
    for result in results:
        if result.test in tests:
            counts[result.configuration.index] = counts.get(result.configuration.index, 0) + 1
    # V is a mean over configurations of the worst case: of one that is not complete, it would only grow.
    ready = [result for result in results if counts.get(result.configuration.index) == sum(tests.values())]
    return score(rules(protocol), ready).cost if ready else None


def _by_configuration(results: Iterable[CaseResult]) -> list[list[CaseResult]]:
    groups: dict[int, list[CaseResult]] = {}
    # By number, whatever order the cases ended in: sums of floats depend on the order.
    for result in sorted(results, key=lambda result: result.configuration.index):
        groups.setdefault(result.configuration.index, []).append(result)
    return list(groups.values())


def _sum(values: Iterable[float | None]) -> float | None:
    total = 0.0
    for value in values:
        if value is None:
            return None
        total += value
    return total


def _measured_in(rules: Rules, name: str, results: Iterable[CaseResult]) -> list[CaseResult]:
    """The cases that criterion ``name`` is measured in."""
    tests = {test.name for test in rules.tests if name in test.criteria}
    return [result for result in results if result.test in tests]


def _worst(results: Iterable[CaseResult], name: str) -> tuple[float | None, CaseResult | None]:
    """The largest value of criterion ``name`` and its case; a case without value is the worst there is."""
    worst: tuple[float | None, CaseResult | None] = (None, None)
    for result in results:
        value = getattr(result.measurements, name)
        if value is None:
            return None, result
        if worst[0] is None or value > worst[0]:
            worst = (value, result)
    return worst


def _criterion(rules: Rules, name: str, spec: CriterionSpec, results: Sequence[CaseResult]) -> CriterionScore:
    chosen = _measured_in(rules, name, results)
    groups = _by_configuration(chosen)
    total = _sum(_worst(group, name)[0] for group in groups)
    # Eq. (14): the mean over configurations of the worst case in each.
    value = None if total is None or not groups else total / len(groups)
    worst_value, worst = _worst(chosen, name)
    return CriterionScore(
        value=value,
        target=spec.target,
        weight=spec.weight,
        unit=spec.unit,
        title=spec.title,
        paper=spec.paper,
        share=None if value is None else spec.weight * value / spec.target,
        worst_case=None
        if worst is None
        else WorstCase(id=worst.id, value=worst_value, configuration=worst.configuration.index, system=worst.system),
    )


def _configuration(rules: Rules, results: Sequence[CaseResult]) -> ConfigurationScore:
    relative: dict[str, float | None] = {}
    for name, spec in rules.criteria.items():
        value, _ = _worst(_measured_in(rules, name, results), name)
        relative[name] = None if value is None else value / spec.target
    shares = (None if (b := relative[name]) is None else spec.weight * b for name, spec in rules.criteria.items())
    pose = results[0].configuration
    return ConfigurationScore(index=pose.index, q_a1=pose.q_a1, q_a2=pose.q_a2, cost=_sum(shares), relative=relative)


def kind(result: Judgement, limits: Stability) -> Kind:
    """What the simulation of ``result`` came to."""
    figures = result.measurements
    if result.status is Status.UNSTABLE:
        return "unstable"
    if result.status is not Status.DONE or figures.limit_cycle is None:
        return "no verdict"
    if figures.limit_cycle < limits.limit_cycle:
        return "ring-down" if (figures.limit_cycle_at_end or 0.0) >= limits.limit_cycle else "quiet"
    decay = figures.slowest_decay
    return "ring-down" if decay is not None and decay < limits.ring_down else "limit cycle"


def outcome(result: Judgement, limits: Stability) -> Outcome:
    """How ``result`` counts for a requirement."""
    if result.status is Status.UNSTABLE:
        return "left the workspace" if result.measurements.rest_error is None else "no rest"
    if result.status is not Status.DONE:
        return ENDED[result.status]
    ending = kind(result, limits)
    if ending == "limit cycle":
        return "limit cycle"
    return "holds" if ending in HOLDING else "lost"  # what has no figure says nothing


def _verdict(rules: Rules, results: Sequence[CaseResult], expected: int) -> Verdict:
    """Over cases of tests of a requirement, of which ``expected`` are asked for."""
    limits = rules.stability
    ended = {result.id: outcome(result, limits) for result in results}
    judged = [result for result in results if ended[result.id] not in UNJUDGED]
    if not judged:
        first = min(results, key=_place, default=None)
        return Verdict(passed=None, tally=tally(ended.values(), expected, first.id if first else ""))

    def badness(result: CaseResult) -> tuple[bool, bool, float, tuple[int, str]]:
        size = result.measurements.limit_cycle
        return ended[result.id] == "holds", size is not None, -(size or 0.0), _place(result)

    worst = min(judged, key=badness)
    fails = ended[worst.id] != "holds"
    left = min((result for result in results if ended[result.id] in UNJUDGED), key=_place, default=None)
    counted = tally(ended.values(), expected, worst.id if fails else left.id if left else "")
    # One realization of the noise may kick a loop into a cycle that others do not: it is told with how many it fails.
    alike = [result for result in judged if _experiment(rules, result) == _experiment(rules, worst)]
    figures = worst.measurements
    size = figures.limit_cycle
    alone = ended[worst.id] == "no rest" and size is not None and size < limits.limit_cycle
    return Verdict(
        passed=counted.passed,
        tally=counted,
        limit_cycle=size,
        rest_error=figures.rest_error if alone else None,
        worst_case=worst.id,
        kind=kind(worst, limits),
        ratio=figures.limit_cycle_ratio,
        frequency=figures.limit_cycle_frequency,
        seeds_failed=sum(ended[result.id] != "holds" for result in alike),
        seeds_tried=len(alike),
    )


def _place(result: CaseResult) -> tuple[int, str]:
    """What decides between equals, whatever order the cases are in."""
    return result.configuration.index, result.id


def _experiment(rules: Rules, result: CaseResult) -> tuple[int, str, str]:
    """What is the same where only the noise differs."""
    test = rules.test(result.test)
    return result.configuration.index, result.system, test.repeats or test.name


def _required(name: str, rules: Rules, results: Sequence[CaseResult]) -> dict[int, list[CaseResult]]:
    """The cases that requirement ``name`` is judged by, per axis of the test."""
    by_axis: dict[int, list[CaseResult]] = {}
    axes = {test.name: test.axis for test in rules.tests if name in test.requirements}
    for result in results:
        if result.test in axes:
            by_axis.setdefault(axes[result.test], []).append(result)
    return by_axis


def _expected(name: str, rules: Rules, results: Sequence[CaseResult], axis: int | None = None) -> int:
    """Number of cases that the protocol asks for to judge a requirement, in tests of ``axis`` or in all."""
    tests = {test.name: test.cases for test in rules.tests if name in test.requirements and axis in (None, test.axis)}
    counts = [count for count in tests.values() if count is not None]
    if len(counts) == len(tests):
        return sum(counts)
    # Results of the older form do not say whose cases those are that were not run.
    return sum(result.test in tests for result in results) + rules.cases - len(results)


def _overall(name: str, rules: Rules, results: Sequence[CaseResult], axes: dict[str, Verdict]) -> Requirement:
    ids = {result.id for group in _required(name, rules, results).values() for result in group}
    chosen = [result for result in results if result.id in ids]
    return Requirement(**asdict(_verdict(rules, chosen, _expected(name, rules, results))), axes=axes)


def _per_axis(name: str, rules: Rules, results: Sequence[CaseResult]) -> Requirement:
    chosen = _required(name, rules, results)
    axes = {str(axis): _verdict(rules, chosen.get(axis, []), _expected(name, rules, results, axis)) for axis in (1, 2)}
    return _overall(name, rules, results, axes)
