"""The certificate of a verification, typed to the last field: what ``verification.json`` holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal

from ..benchmark.certificate import (
    CaseEnding,
    CriterionFound,
    Draw,
    Figure,
    Reference,
    RequirementFound,
    Score,
    figure,
    identity,
    seeds,
)
from ..benchmark.results import ControllerRecord, PlantRecord
from ..codec import NonNegative, plain
from .documents import Document
from .files import VERIFICATION

FRESH: Literal["fresh"] = "fresh"
PUBLISHED: Literal["published"] = "published"

STRICT = "strict-verification"
"""The protocol of the list of worst cases."""

RESULTS = ("complete", "cost", "criteria", "requirements", "cases", "draws", "strict", "references")
"""Fields of a certificate that its repetition must find again to the last bit; the others say what it was made with."""

WORDS = "message"
"""Field that may differ in a result: it says what was measured, such as memory, and what FMUs have printed."""

UNREPEATED = ("start", "wall_time", "environment", "sandbox")
"""Fields that may well differ."""


class Verification(Document, kw_only=True):
    """What a controller came to where it could reach neither judge nor draws, and everything needed to repeat it.

    The first seven fields are those of :class:`.certificate.Tried`; ``references`` are controllers of the benchmark by
    name, on the same draws. ``entropy`` is what the seeds follow from together with the controller: ``source`` says
    whether it was fresh, or published after the controller was. ``code`` is the SHA-256 of the sources; ``sandbox``
    tells whether there was one.
    """

    FILE: ClassVar[str] = VERIFICATION
    SCHEMA: ClassVar[str] = "flexible-manipulator-verification/3"
    MISSING: ClassVar[str] = "no-file"

    complete: bool
    cost: Figure
    criteria: dict[str, CriterionFound]
    requirements: dict[str, RequirementFound]
    cases: tuple[CaseEnding, ...]
    draws: tuple[Draw, ...]
    strict: Score | None
    references: dict[str, Reference]
    benchmark: str
    protocol: str
    source: Literal["fresh", "published"]
    entropy: str
    controller: ControllerRecord
    sample_time: NonNegative
    plant: PlantRecord
    code: str
    sandbox: bool
    environment: dict[str, str]
    start: str
    wall_time: NonNegative

    def _problem(self) -> str:
        record, drawn = self.controller, tuple(draw.seed for draw in self.draws)
        own = identity(record.sha256, record.parameters, record.mapping, self.sample_time)
        tried: tuple[Verification | Reference, ...] = (self, *self.references.values())
        if not drawn or any(tuple(draw.seed for draw in each.draws) != drawn for each in tried):
            return "its controllers have other draws than it"
        if seeds(self.entropy, own, len(drawn)) != drawn:
            return "its draws do not follow from its entropy and its controller"
        if any(each.cost != figure((draw.seed, draw.cost) for draw in each.draws) for each in tried):
            return "a V is not that of its draws"
        scores: tuple[Verification | Score, ...] = (*tried, *(each.strict for each in tried if each.strict))
        if any(each.complete != all(case.simulated for case in each.cases) for each in scores):
            return "it is complete or not, other than its cases"
        if any(entry.passed != entry.tally.passed for each in scores for entry in each.requirements.values()):
            return "a verdict is not that of its tally"
        return ""


def differences(first: Verification, second: Verification) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """How the results of two certificates differ, and how what they were made with does: ``name: this, that``."""
    one, other = plain(first), plain(second)
    results = tuple(line for name in RESULTS for line in _unequal(name, one[name], other[name]))
    rest = (name for name in one if name not in (*RESULTS, *UNREPEATED))
    return results, tuple(line for name in rest for line in _unequal(name, one[name], other[name]))


def _unequal(name: str, one: Any, other: Any) -> Iterator[str]:
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in (key for key in dict.fromkeys((*one, *other)) if key != WORDS):
            yield from _unequal(f"{name}.{key}", one.get(key), other.get(key))
    elif isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        for number, (own, its) in enumerate(zip(one, other, strict=True)):
            yield from _unequal(f"{name}.{number}", own, its)
    elif one != other:
        yield f"{name}: {one}, {other}"
