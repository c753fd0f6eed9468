"""The certificate of a verification, typed to the last field, what ``verification.json`` holds; what follows from it.

All values are in SI units; None stands for what does not exist.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal

from ..codec import Malformed, Natural, NonNegative, Struct, plain, to_json
from .results import CaseResult, ControllerRecord, Kind, PlantRecord, Rules, Scorecard
from .scorecard import score

SCHEMA = "flexible-manipulator-verification/1"

FRESH: Literal["fresh"] = "fresh"
PUBLISHED: Literal["published"] = "published"

RESULTS = ("complete", "cost", "criteria", "requirements", "draws", "reference", "strict")
"""Fields of a certificate that its repetition must find again to the last bit; the others say what it was made with."""

UNREPEATED = ("start", "wall_time", "environment", "sandbox")
"""Fields that may well differ."""


class Spread(Struct):
    """A figure over the draws: mean and sample standard deviation, None if a draw has no value or there is only one."""

    mean: NonNegative | None
    sd: NonNegative | None


class WorstDraw(Struct):
    """The largest value over the draws; its case is repeated with the seed of the draw."""

    id: str
    seed: Natural
    value: NonNegative | None


class CriterionSpread(Spread):
    """A criterion over the draws, each as in Table 2, beside its target; and the worst case of all."""

    unit: str
    target: NonNegative
    worst_case: WorstDraw | None


class RequirementFound(Struct):
    """A requirement: whether it holds in all draws, in how many it does not, and the worst case."""

    passed: bool | None
    failed_draws: Natural
    kind: Kind
    worst_case: WorstDraw | None


class Score(Struct):
    """A controller over all draws. ``complete`` tells whether every case came to a verdict."""

    complete: bool
    cost: Spread
    criteria: dict[str, CriterionSpread]
    requirements: dict[str, RequirementFound]


class Draw(Struct):
    """One draw: its seed, V of the controller and of the reference, and the SHA-256 of all their cases."""

    seed: Natural
    cost: NonNegative | None
    reference_cost: NonNegative | None
    cases: str
    reference_cases: str


class Verification(Score, kw_only=True):
    """What a controller came to where it could reach neither judge nor draws, and everything needed to repeat it.

    ``entropy`` is what the seeds follow from together with the controller: ``source`` says whether it was fresh, or
    published after the controller was. ``reference`` is the built-in PID on the same draws, ``strict`` the controller
    on the list of worst cases. ``code`` is the SHA-256 of the sources; ``sandbox`` tells whether there was one.
    """

    schema: str
    benchmark: str
    protocol: str
    source: Literal["fresh", "published"]
    entropy: str
    draws: tuple[Draw, ...]
    reference: Score
    strict: Score | None
    controller: ControllerRecord
    sample_time: NonNegative
    plant: PlantRecord
    code: str
    sandbox: bool
    environment: dict[str, str]
    start: str
    wall_time: NonNegative


def identity(sha256: str, parameters: Mapping[str, float], mapping: Mapping[str, str], sample_time: float) -> str:
    """SHA-256 of a controller with all that makes it behave as it does."""
    used = [sha256, sorted(parameters.items()), sorted(mapping.items()), sample_time]
    return hashlib.sha256(to_json(used, indent=None).encode()).hexdigest()


def check(certificate: Verification) -> None:
    """Raise :class:`~orchestrator.codec.Malformed` if the parts of a certificate contradict each other."""
    record, draws = certificate.controller, certificate.draws
    own = identity(record.sha256, record.parameters, record.mapping, certificate.sample_time)
    if certificate.schema != SCHEMA:
        raise Malformed(f"its form is {certificate.schema!r} and not {SCHEMA}")
    if not draws or seeds(certificate.entropy, own, len(draws)) != tuple(draw.seed for draw in draws):
        raise Malformed("its draws do not follow from its entropy and its controller")
    for spread, costs in (
        (certificate.cost, [draw.cost for draw in draws]),
        (certificate.reference.cost, [draw.reference_cost for draw in draws]),
    ):
        if (spread.mean, spread.sd) != _spread(costs):
            raise Malformed("its V is not that of its draws")


def seeds(entropy: str, controller: str, count: int) -> tuple[int, ...]:
    """The seeds of ``count`` draws: whoever changes the controller, which a hash identifies, changes its draws."""
    words = (f"{entropy}\n{controller}\n{number}" for number in range(count))
    return tuple(int(hashlib.sha256(word.encode()).hexdigest()[:12], 16) for word in words)


def digest(results: Iterable[CaseResult]) -> str:
    """SHA-256 of what cases came to, to the last bit, without words."""
    told = [[each.id, each.status, each.time, each.measurements, each.warnings] for each in results]
    return hashlib.sha256(to_json(told, indent=None).encode()).hexdigest()


def overall(rules: Rules, draws: Sequence[tuple[int, Sequence[CaseResult]]]) -> Score:
    """The score of the cases of ``draws``, each with its seed."""
    cards = [(seed, score(rules, results)) for seed, results in draws]
    return Score(
        complete=all(card.complete for _, card in cards),
        cost=Spread(*_spread([card.cost for _, card in cards])),
        criteria={name: _criterion(name, cards) for name in rules.criteria},
        requirements={name: _requirement(name, cards) for name in cards[0][1].stability},
    )


def _spread(values: Sequence[float | None]) -> tuple[float | None, float | None]:
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return None, None
    mean = sum(known) / len(known)
    if len(known) == 1:
        return mean, None
    return mean, math.sqrt(sum((value - mean) ** 2 for value in known) / (len(known) - 1))


def _criterion(name: str, cards: Sequence[tuple[int, Scorecard]]) -> CriterionSpread:
    found = [(seed, card.criteria[name]) for seed, card in cards]
    worst = [WorstDraw(each.worst_case.id, seed, each.worst_case.value) for seed, each in found if each.worst_case]
    first = found[0][1]
    largest = max(worst, key=lambda each: math.inf if each.value is None else each.value, default=None)
    return CriterionSpread(*_spread([each.value for _, each in found]), first.unit, first.target, largest)


def _requirement(name: str, cards: Sequence[tuple[int, Scorecard]]) -> RequirementFound:
    found = [(seed, card.stability[name]) for seed, card in cards]
    seed, worst = max(
        found, key=lambda each: (each[1].passed is False, each[1].limit_cycle is None, each[1].limit_cycle or 0.0)
    )
    case = None if worst.worst_case is None else WorstDraw(worst.worst_case, seed, worst.limit_cycle)
    verdicts = [each.passed for _, each in found]
    passed = False if False in verdicts else None if None in verdicts else True
    return RequirementFound(passed, verdicts.count(False), worst.kind, case)


def differences(first: Verification, second: Verification) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """How the results of two certificates differ, and how what they were made with does: ``name: this, that``."""
    one, other = plain(first), plain(second)
    results = tuple(line for name in RESULTS for line in _unequal(name, one[name], other[name]))
    rest = (name for name in one if name not in (*RESULTS, *UNREPEATED))
    return results, tuple(line for name in rest for line in _unequal(name, one[name], other[name]))


def _unequal(name: str, one: Any, other: Any) -> Iterator[str]:
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys((*one, *other)):
            yield from _unequal(f"{name}.{key}", one.get(key), other.get(key))
    elif isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        for number, (own, its) in enumerate(zip(one, other, strict=True)):
            yield from _unequal(f"{name}.{number}", own, its)
    elif one != other:
        yield f"{name}: {one}, {other}"
