"""From case results to the cost V, the criteria B1..B7 and the verdicts A1..A3 (Section 6, eq. (14)-(15))."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ..cosim.trajectory import Status
from .case import Configuration
from .metrics import CaseResult
from .protocol import Criterion, Protocol


@dataclass(frozen=True)
class CriterionScore:
    """A criterion over the workspace.

    ``value`` is the mean over the configurations of the worst value over the systems, as in Table 2; None where a
    case that counts has no value. ``worst_case`` is the case with the largest value of all, ``worst_value``.
    """

    criterion: Criterion
    value: float | None
    worst_value: float | None
    worst_case: str | None

    @property
    def share(self) -> float | None:
        """The criterion's part of V, w_i times the mean of b_i."""
        return None if self.value is None else self.criterion.weight * self.value / self.criterion.target


@dataclass(frozen=True)
class Verdict:
    """Whether a requirement holds, and the ``worst_case`` with the ``amplitude`` [m] of its limit cycle.

    ``passed`` is None where no case has been tried. The worst is a case without an amplitude (left, crashed), else the
    largest limit cycle of those that fail, else of all. ``rest_error`` is given where that case fails by it alone: its
    TCP error at the end [m], which is too large for rest.
    """

    passed: bool | None
    amplitude: float | None
    worst_case: str | None
    rest_error: float | None = None


@dataclass(frozen=True)
class Requirement:
    """A1, A2 with a verdict per axis, A3 with one per TCP coordinate, and the verdict over all."""

    name: str
    overall: Verdict
    axes: dict[str, Verdict]


@dataclass(frozen=True)
class ConfigurationScore:
    """V_k of eq. (14) and the worst b_i of one configuration; None where a case that counts has no value."""

    configuration: Configuration
    cost: float | None
    relative: dict[str, float | None]


@dataclass(frozen=True)
class Scorecard:
    """The result of an evaluation. ``cost`` is V of eq. (15), None where a criterion has no value.

    ``complete`` tells whether every case of the protocol ran to a verdict (done or unstable).
    """

    cost: float | None
    complete: bool
    criteria: tuple[CriterionScore, ...]
    requirements: tuple[Requirement, ...]
    configurations: tuple[ConfigurationScore, ...]


def score(protocol: Protocol, results: Sequence[CaseResult], expected: int) -> Scorecard:
    """The scorecard of ``results``, where the protocol has ``expected`` cases."""
    criteria = tuple(_criterion(criterion, results) for criterion in protocol.criteria)
    shares = [criterion.share for criterion in criteria]
    judged = sum(result.status in (Status.DONE, Status.UNSTABLE) for result in results)
    limit = protocol.raw["stability"]["limit_cycle"]
    return Scorecard(
        cost=_sum(shares),
        complete=judged == expected,
        criteria=criteria,
        requirements=(
            _per_axis("A1", results, limit),
            _per_axis("A2", results, limit),
            _limit_cycles("A3", results, limit),
        ),
        configurations=tuple(
            _configuration(configuration, protocol.criteria, chosen)
            for configuration, chosen in _by_configuration(results).items()
        ),
    )


def _by_configuration(results: Iterable[CaseResult]) -> dict[Configuration, list[CaseResult]]:
    groups: dict[Configuration, list[CaseResult]] = {}
    for result in sorted(results, key=lambda result: result.case.configuration.index):
        groups.setdefault(result.case.configuration, []).append(result)
    return groups


def _sum(values: Iterable[float | None]) -> float | None:
    total = 0.0
    for value in values:
        if value is None:
            return None
        total += value
    return total


def _value(result: CaseResult, name: str) -> float | None:
    return None if result.measurement is None else result.measurement.criteria[name]


def _worst(results: Iterable[CaseResult], name: str) -> tuple[float | None, CaseResult | None]:
    """The largest value of criterion ``name`` and its case; a case without value is the worst there is."""
    worst: tuple[float | None, CaseResult | None] = (None, None)
    for result in results:
        if name not in result.case.test.criteria:
            continue
        value = _value(result, name)
        if value is None:
            return None, result
        if worst[0] is None or value > worst[0]:
            worst = (value, result)
    return worst


def _criterion(criterion: Criterion, results: Sequence[CaseResult]) -> CriterionScore:
    chosen = [result for result in results if criterion.name in result.case.test.criteria]
    groups = _by_configuration(chosen)
    total = _sum(_worst(group, criterion.name)[0] for group in groups.values())
    worst_value, worst = _worst(chosen, criterion.name)
    return CriterionScore(
        criterion=criterion,
        value=None if total is None or not groups else total / len(groups),
        worst_value=worst_value,
        worst_case=worst.case.id if worst else None,
    )


def _configuration(
    configuration: Configuration, criteria: Sequence[Criterion], results: Sequence[CaseResult]
) -> ConfigurationScore:
    relative: dict[str, float | None] = {}
    for criterion in criteria:
        value, _ = _worst(results, criterion.name)
        relative[criterion.name] = None if value is None else value / criterion.target
    shares = (None if (b := relative[criterion.name]) is None else criterion.weight * b for criterion in criteria)
    return ConfigurationScore(configuration, _sum(shares), relative)


def _verdict(candidates: Iterable[tuple[CaseResult, float | None]], limit: float) -> Verdict:
    """Over pairs of a case and its limit-cycle amplitude [m], None where there is no such amplitude to speak of."""
    tried = [(value is None, not _holds(result, value, limit), value or 0.0, result) for result, value in candidates]
    if not tried:
        return Verdict(None, None, None)
    without, fails, amplitude, worst = max(tried, key=lambda candidate: candidate[:3])
    if without:
        return Verdict(False, None, worst.case.id)
    unrest = worst.measurement.rest_error if worst.measurement and fails and amplitude < limit else None
    return Verdict(not fails, amplitude, worst.case.id, unrest)


def _holds(result: CaseResult, amplitude: float | None, limit: float) -> bool:
    return result.status is Status.DONE and amplitude is not None and amplitude < limit


def _amplitudes(result: CaseResult) -> tuple[float | None, float | None]:
    cycle = result.measurement.limit_cycle if result.measurement else None
    return cycle if cycle is not None else (None, None)


def _largest(result: CaseResult) -> float | None:
    x, z = _amplitudes(result)
    return None if x is None or z is None else max(x, z)


def _per_axis(name: str, results: Sequence[CaseResult], limit: float) -> Requirement:
    chosen = [result for result in results if name in result.case.test.requirements]
    axes = {
        str(axis): _verdict(((r, _largest(r)) for r in chosen if r.case.test.axis == axis), limit) for axis in (1, 2)
    }
    return Requirement(name, _verdict(((r, _largest(r)) for r in chosen), limit), axes)


def _limit_cycles(name: str, results: Sequence[CaseResult], limit: float) -> Requirement:
    chosen = [result for result in results if name in result.case.test.requirements]
    axes = {
        coordinate: _verdict(((r, _amplitudes(r)[column]) for r in chosen), limit)
        for column, coordinate in enumerate(("x", "z"))
    }
    return Requirement(name, _verdict(((r, _largest(r)) for r in chosen), limit), axes)
