"""From case results to the cost V, the criteria B1..B7 and the verdicts A1..A3 (Section 6, eq. (14)-(15)).

A scorecard is a function of the rules and the cases alone, so whoever reads results can compute it again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from msgspec.structs import asdict

from ..loop.trajectory import Status
from .protocol import Stability
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
)

HOLDING = ("quiet", "ring-down")
"""Kinds of a case in which a requirement holds."""


def score(rules: Rules, results: Sequence[CaseResult], expected: int | None = None) -> Scorecard:
    """The scorecard of ``results``; it is complete if ``expected`` cases (default: all) came to a verdict."""
    criteria = {name: _criterion(rules, name, spec, results) for name, spec in rules.criteria.items()}
    judged = sum(result.judged for result in results)
    return Scorecard(
        complete=judged == (rules.cases if expected is None else expected),
        cost=_sum(criterion.share for criterion in criteria.values()),
        criteria=criteria,
        stability={
            "A1": _per_axis("A1", rules, results),
            "A2": _per_axis("A2", rules, results),
            "A3": _limit_cycles("A3", rules, results),
        },
        configurations=tuple(_configuration(rules, group) for group in _by_configuration(results)),
    )


def _by_configuration(results: Iterable[CaseResult]) -> list[list[CaseResult]]:
    groups: dict[int, list[CaseResult]] = {}
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


def kind(result: Judgement, limits: Stability, amplitude: float | None = None) -> Kind:
    """What the simulation of ``result`` came to, with the limit cycle's ``amplitude`` [m] in place of its own."""
    figures = result.measurements
    found = figures.limit_cycle if amplitude is None else amplitude
    if result.status is Status.UNSTABLE:
        return "unstable"
    if result.status is not Status.DONE or found is None:
        return "no verdict"
    if found < limits.limit_cycle:
        return "quiet"
    ratio = figures.limit_cycle_ratio
    return "ring-down" if ratio is not None and ratio < limits.ring_down else "limit cycle"


def _verdict(rules: Rules, candidates: Iterable[tuple[CaseResult, float | None]]) -> Verdict:
    """Over pairs of a case and its limit-cycle amplitude [m], None if it has no such amplitude."""
    limits, pairs = rules.stability, list(candidates)
    kinds = {result.id: kind(result, limits, value) for result, value in pairs}
    tried = [(value is None, kinds[result.id] not in HOLDING, value or 0.0, result) for result, value in pairs]
    if not tried:
        return Verdict(passed=None)
    without, fails, amplitude, worst = max(tried, key=lambda candidate: candidate[:3])
    alike = [result for result, _ in pairs if _experiment(rules, result) == _experiment(rules, worst)]
    figures = worst.measurements
    return Verdict(
        passed=not fails,
        limit_cycle=None if without else amplitude,
        rest_error=figures.rest_error if fails and not without and amplitude < limits.limit_cycle else None,
        worst_case=worst.id,
        kind=kinds[worst.id],
        ratio=figures.limit_cycle_ratio,
        frequency=figures.limit_cycle_frequency,
        seeds_failed=sum(kinds[result.id] not in HOLDING for result in alike),
        seeds_tried=len(alike),
    )


def _experiment(rules: Rules, result: CaseResult) -> tuple[int, str, str]:
    """What is the same where only the noise differs."""
    test = rules.test(result.test)
    return result.configuration.index, result.system, test.repeats or test.name


def _required(name: str, rules: Rules, results: Sequence[CaseResult]) -> dict[int, list[CaseResult]]:
    """The cases that requirement ``name`` is judged by, per axis of the test."""
    found: dict[int, list[CaseResult]] = {}
    axes = {test.name: test.axis for test in rules.tests if name in test.requirements}
    for result in results:
        if result.test in axes:
            found.setdefault(axes[result.test], []).append(result)
    return found


def _overall(rules: Rules, axes: dict[str, Verdict], candidates: Iterable[CaseResult]) -> Requirement:
    verdict = _verdict(rules, ((result, result.measurements.limit_cycle) for result in candidates))
    return Requirement(**asdict(verdict), axes=axes)


def _per_axis(name: str, rules: Rules, results: Sequence[CaseResult]) -> Requirement:
    chosen = _required(name, rules, results)
    axes = {
        str(axis): _verdict(rules, ((r, r.measurements.limit_cycle) for r in chosen.get(axis, ()))) for axis in (1, 2)
    }
    return _overall(rules, axes, _in_order(results, chosen))


def _limit_cycles(name: str, rules: Rules, results: Sequence[CaseResult]) -> Requirement:
    chosen = _in_order(results, _required(name, rules, results))
    axes = {
        "x": _verdict(rules, ((r, r.measurements.limit_cycle_x) for r in chosen)),
        "z": _verdict(rules, ((r, r.measurements.limit_cycle_z) for r in chosen)),
    }
    return _overall(rules, axes, chosen)


def _in_order(results: Sequence[CaseResult], chosen: dict[int, list[CaseResult]]) -> list[CaseResult]:
    wanted = {result.id for group in chosen.values() for result in group}
    return [result for result in results if result.id in wanted]
