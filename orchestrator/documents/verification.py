"""The certificate of a verification, typed to the last field: what ``verification.json`` holds; and the standard
conditions: only what was found under these is compared with one another."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, ClassVar

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark import protocol as protocols
from ..benchmark.cases import cases as cases_of
from ..benchmark.certificate import (
    CaseEnding,
    CheckedCase,
    CriterionOverDraws,
    Draw,
    Figure,
    Reference,
    RequirementOverDraws,
    Score,
    figure,
    seeds,
)
from ..benchmark.draws import Entropy
from ..benchmark.protocol import Protocol
from ..benchmark.results import rules
from ..benchmark.spread import Statistic
from ..codec import Natural, plain
from ..loop.trajectory import Status
from ..views.plot import Axis, Level, Line, Plot, hue
from ..views.table import (
    VERDICTS,
    Cell,
    Column,
    Conclusion,
    Facts,
    Link,
    Part,
    Quantity,
    Summary,
    Table,
    Value,
    VerdictCell,
)
from ..views.units import SHOWN
from . import conclusions
from .commands import ROBUST, Setting, case_command, in_draw, study_command, tune_command
from .conclusions import cost_words, decisive, overall, share_words, verdict_words
from .document import Comparable, Completeness, Document, Rank, Row, completeness
from .files import REPORT, VERIFICATION
from .head import Head
from .scorecard import criterion_column
from .spread import mean_words
from .wording import REQUIREMENTS, Reason, failure_notes, head_facts, reason_notes, reason_text

PROTOCOL, STRICT, COUNT = "verification", "strict-verification", 3
"""The protocol of the draws, that of the worst poses, and the number of draws."""

USUAL = ("DiagonalPID", "TunedPID")
"""The references, which take the least time."""

VERIFY_AGAIN = "to run it again, verify again"

RESULTS = ("complete", "cost", "criteria", "requirements", "cases", "draws", "strict", "references")
"""Fields of a certificate that its repetition must find again to the last bit; the others say what it was made with."""

CHECKED = 3
"""Cases that the second checker has to have computed anew."""

OF_ROUND = "the draws are those of a round, which this certificate does not show its FMU to be older than"
"""A deviation of a certificate by itself; in the table of the round, all have it and it says nothing."""

WORDS = "message"
"""Field that may differ in a result: it says what was measured, such as memory, and what FMUs have printed."""

UNREPEATED = ("timing", "command", "environment", "sandbox", "clean", "checked")
"""Fields that may well differ."""


class Verification(Document, Comparable, kw_only=True):
    """What a controller came to where it could reach neither judge nor draws, and everything needed to repeat it; shows
    itself in a notebook.

    The first seven fields are those of :class:`.certificate.DrawnResults`; ``references`` are controllers of the
    benchmark by name, on the same draws. ``entropy`` is what the seeds follow from together with the FMU's bytes;
    ``repetitions`` counts those that were begun before, with other draws, and ended by something outside. ``code`` is
    the SHA-256 of the sources; ``sandbox`` tells whether there was one, ``clean`` whether the interpreter took no
    code but that. ``checked`` are the worst cases of the draws with the largest differences that the second checker
    has found, all within their bounds.
    """

    FILE: ClassVar[str] = VERIFICATION
    SCHEMA: ClassVar[str] = "flexible-manipulator-verification/6"
    KIND: ClassVar[str] = "Verifications, mean ± standard deviation over the draws"
    DERIVED: ClassVar[tuple[str, ...]] = (REPORT,)
    MISSING: ClassVar[str] = "no-file"

    complete: bool
    cost: Figure
    criteria: dict[str, CriterionOverDraws]
    requirements: dict[str, RequirementOverDraws]
    cases: tuple[CaseEnding, ...]
    draws: tuple[Draw, ...]
    strict: Score | None
    references: dict[str, Reference]
    entropy: Entropy
    repetitions: Natural
    code: str
    sandbox: bool
    clean: bool
    checked: tuple[CheckedCase, ...]

    @property
    def completeness(self) -> Completeness:
        """See :attr:`.Document.completeness`: by the controller's own cases, and by whether the references are
        judged."""
        scores = [score for score in (self, self.strict) if score is not None]
        beside = [
            score
            for reference in self.references.values()
            for score in (reference, reference.strict)
            if score is not None
        ]
        tallies = (entry.tally for score in (*scores, *beside) for entry in score.requirements.values())
        return completeness([case for score in scores for case in score.cases], tallies)

    @property
    def finished(self) -> bool:
        """Whether all cases of the controller were run to an end of their own: none was skipped or lost."""
        cases = (*self.cases, *(self.strict.cases if self.strict else ()))
        return not any(case.status in (Status.SKIPPED, Status.LOST) for case in cases)

    @property
    def deviations(self) -> tuple[str, ...]:
        """By what it was not made under the standard conditions, in words; nothing if it was."""
        unusual = list(deviations(self.head, len(self.draws), self.cases, self.strict, self.references))
        if not self.sandbox:
            unusual.append("the controller had no sandbox")
        if len(self.checked) < CHECKED:
            unusual.append(f"fewer than {CHECKED} cases were checked by the second checker")
        if not self.clean:
            unusual.append("the interpreter was not clean")
        if self.entropy.beacon is not None and not self.entropy.beacon.confirmed:
            unusual.append("the signature of the beacon was not checked")
        if self.entropy.source == "round":
            unusual.append(OF_ROUND)
        if self.repetitions:
            unusual.append(f"{self.repetitions} verifications were begun before, with other draws")
        return tuple(unusual)

    @property
    def rank(self) -> Rank:
        """See :class:`.Comparable`."""
        reason = "" if self.cost.mean is not None else "no mean of V: a draw has none"
        held = all(entry.passed for entry in self.requirements.values())
        return Rank(self.cost.mean, held, reason if self.complete else "incomplete")

    def row(self, first: Comparable | None, others: Sequence[tuple[str, Comparable]]) -> Row:
        """Mean and standard deviation of V and the criteria, and the verdicts."""
        cells: list[tuple[Column, Cell]] = [(Column("draws"), len(self.draws))]
        cells.append((Column("V", best="smallest"), Value(self.cost.mean, self.cost.sd)))
        for name, criterion in self.criteria.items():
            cells.append((criterion_column(name, criterion.unit), Value(criterion.mean, criterion.sd)))
        return *cells, *((Column(name), VerdictCell(held.passed)) for name, held in self.requirements.items())

    def summary(self) -> Summary:
        """The figures over the draws, and those on the list of worst cases, beside those of the references."""
        where = "in a sandbox" if self.sandbox else "WITHOUT A SANDBOX"
        kicker = (
            f"{self.benchmark}, verification, protocol {self.protocol}, {where}, {len(self.draws)} draws from "
            f"{self.entropy.source} entropy {self.entropy.value}"
        )
        unusual = self.deviations
        standard = ("Standard conditions", "; ".join((f"no: {unusual[0]}", *unusual[1:])) if unusual else "yes")
        again = ("Repetitions", f"{self.repetitions}, after faults from outside, with other draws")
        told = (*head_facts(self.head), standard, *((again,) if self.repetitions else ()))
        parts: list[Part] = [Facts("This verification", told, ("SHA-256",))]
        parts.append(_table("Mean ± standard deviation over the draws", self, self.references))
        if self.strict is not None:
            beside = {
                name: reference.strict for name, reference in self.references.items() if reference.strict is not None
            }
            parts.append(_table("The worst poses of strict, moved by the first draw", self.strict, beside))
        tried: dict[str, Verification | Reference] = {self.controller.file: self, **self.references}
        series = tuple(_over_draws(name, score.draws, order) for order, (name, score) in enumerate(tried.items()))
        levels = (Level(self.rules.cost.target, "target"),)
        parts.append(Plot("draws-plot", "V over the draws", Axis("draw"), Axis("V"), series, levels))
        listed = (*self.cases, *(self.strict.cases if self.strict else ()))
        failed = [
            (in_draw(case.id, case.seed), case.status, case.message)
            for case in listed
            if case.status is not Status.DONE
        ]
        parts += failure_notes(failed, self.FILE)
        parts += reason_notes(verification_reasons(self))
        return Summary(self.controller.file, kicker, tuple(parts))

    def conclusion(self) -> Conclusion:
        """The verdict over the draws and on the list of worst cases, V, what costs most, and whether it is standard."""
        scores = [score for score in (self, self.strict) if score is not None]
        passed = {name: overall(_of_each(scores, name)) for name in self.requirements}
        verdict, reasons = overall(passed), list(verification_reasons(self))
        why = ""
        if verdict is False:
            entry = self.requirements[decisive(passed)[0]]
            failed = f"{decisive(passed)[0]} in {entry.failed_draws} of {len(self.draws)} draws"
            why = f", {failed if entry.failed_draws else 'on the worst poses'}"
        elif verdict:
            why = f" in all {len(self.draws)} draws{' and on the worst poses' if self.strict else ''}"
        means = {name: criterion.mean for name, criterion in self.criteria.items()}
        spread = Statistic(self.cost.mean, self.cost.sd, None, None)
        total = cost_words(f"V {mean_words(spread)}", {"target": self.rules.cost.target})
        total = "no mean of V" if self.cost.mean is None else total
        words = (
            verdict_words(passed) + why,
            ", ".join(filter(None, (total, share_words(self.rules, means)))),
            f"not under the standard conditions: {self.deviations[0]}" if self.deviations else "",
        )
        steps = [Link("simulate the worst case", reason.command) for reason in reasons if reason.command][:1]
        steps.append(Link("search for the worst case", study_command(self.head, "robustness")))
        steps.append(Link("tune against the worst case", tune_command(self.head, *ROBUST)))
        return conclusions.conclusion(verdict, words, steps)

    def _problem(self) -> str:
        drawn = tuple(draw.seed for draw in self.draws)
        tried: tuple[Verification | Reference, ...] = (self, *self.references.values())
        if not drawn or any(tuple(draw.seed for draw in score.draws) != drawn for score in tried):
            return "its controllers have other draws than it"
        if self.entropy.problem:
            return self.entropy.problem
        # Who could choose the draws could try many and keep the best ones.
        if seeds(self.entropy, self.controller.sha256, len(drawn), self.repetitions) != drawn:
            return "its draws do not follow from its entropy and its FMU"
        if any(score.cost != figure((draw.seed, draw.cost) for draw in score.draws) for score in tried):
            return "a V is not that of its draws"
        scores: tuple[Verification | Score, ...] = (*tried, *(score.strict for score in tried if score.strict))
        # Who leaves a requirement out meets all that are left.
        if any(score.requirements.keys() != REQUIREMENTS.keys() for score in scores):
            return "a score lacks a requirement, or has one that there is not"
        targets = {name: (entry.unit, entry.target) for name, entry in self.rules.criteria.items()}
        if any({name: (c.unit, c.target) for name, c in score.criteria.items()} != targets for score in scores):
            return "its criteria are not those of its rules"
        weights = {name: entry.weight / entry.target for name, entry in self.rules.criteria.items()}
        if not all(_adds_up(score, weights) for score in scores):
            return "a V is not the sum of its criteria"
        if any({case.seed for case in score.cases} - {*drawn} for score in scores):
            return "a case is of no draw"
        if any(score.complete != all(case.simulated for case in score.cases) for score in scores):
            return "it is complete or not, other than its cases"
        if any(not quantity.difference <= quantity.bound for case in self.checked for quantity in case.differences):
            return "the second checker does not agree"
        if any(entry.passed != entry.tally.passed for score in scores for entry in score.requirements.values()):
            return "a verdict is not that of its tally"
        return ""


def deviations(
    head: Head, draws: int, cases: Sequence[CaseEnding], strict: Score | None, references: Collection[str]
) -> tuple[str, ...]:
    """By what a verification differs from the standard, in words; nothing if it does not."""
    standard, plant, controller = protocols.load(PROTOCOL), head.plant, head.controller
    worst = () if strict is None else strict.cases
    holds = {
        f"the benchmark is {head.benchmark}, not {standard.benchmark}": head.benchmark == standard.benchmark,
        f"the protocol is not {PROTOCOL} as it comes with the benchmark": (head.protocol, head.protocol_file)
        == (PROTOCOL, "")
        and head.rules == rules(standard)
        and _all_there(standard, cases, draws),
        f"there are {draws} draws, not {COUNT}": draws == COUNT,
        f"the cases of {STRICT} are not all there": _all_there(protocols.load(STRICT), worst, 1),
        f"the references are not {' and '.join(USUAL)}": set(references) >= set(USUAL),
        # The draws do not follow from these: they could be chosen after the draws are known.
        f"parameters of the controller are set: {', '.join(controller.parameters)}": not controller.parameters,
        f"connectors of the controller are mapped: {', '.join(controller.mapping)}": not controller.mapping,
        "the plant is not that of the benchmark": plant.build in ("python", "native")
        and not plant.parameters
        and plant.nominal == NOMINAL,
        "the controller samples at another rate than the benchmark": head.sample_time.as_in_benchmark
        and head.sample_time.seconds == float(standard.loop.sample_time),
    }
    return tuple(words for words, kept in holds.items() if not kept)


def _all_there(protocol: Protocol, cases: Sequence[CaseEnding], draws: int) -> bool:
    """Whether each of so many draws has every case of ``protocol`` once."""
    by_draw: dict[int, list[str]] = {}
    for case in cases:
        by_draw.setdefault(case.seed, []).append(case.id)
    return len(by_draw) == draws and all(sorted(ids) == sorted(_ids(protocol)) for ids in by_draw.values())


def _ids(protocol: Protocol) -> list[str]:
    return [case.id for case in cases_of(protocol, NOMINAL, 0)]


def _adds_up(score: Verification | Score, weights: Mapping[str, float]) -> bool:
    """Whether V is what its criteria give, up to rounding."""
    means = [criterion.mean for criterion in score.criteria.values()]
    if score.cost.mean is None or None in means:
        return score.cost.mean is None
    total = sum(weight * (score.criteria[name].mean or 0.0) for name, weight in weights.items())
    return math.isclose(score.cost.mean, total, rel_tol=1e-9, abs_tol=1e-12)


def differences(first: Verification, second: Verification) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """How the results of two certificates differ, and how what they were made with does: ``name: this, that``."""
    one, other = _flat(first), _flat(second)
    results = tuple(line for name in RESULTS for line in _unequal(name, one[name], other[name]))
    rest = (name for name in one if name not in (*RESULTS, *UNREPEATED))
    return results, tuple(line for name in rest for line in _unequal(name, one[name], other[name]))


def _flat(certificate: Verification) -> dict[str, Any]:
    """The fields, those of the head among them."""
    fields: dict[str, Any] = plain(certificate)
    return {**fields.pop("head"), **fields}


def _unequal(name: str, one: Any, other: Any) -> Iterator[str]:
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in (key for key in dict.fromkeys((*one, *other)) if key != WORDS):
            yield from _unequal(f"{name}.{key}", one.get(key), other.get(key))
    elif isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        for number, (this, that) in enumerate(zip(one, other, strict=True)):
            yield from _unequal(f"{name}.{number}", this, that)
    elif one != other:
        yield f"{name}: {one}, {other}"


def verification_reasons(certificate: Verification) -> Iterator[Reason]:
    """The requirements of the controller over the draws and on the list of worst cases, and those of a reference that
    are not judged."""
    yield from _score_reasons(
        certificate,
        certificate,
        certificate.head.protocol_file or certificate.protocol,
        f"in {{}} of {len(certificate.draws)} draws",
    )
    if certificate.strict is not None:
        yield from _score_reasons(certificate, certificate.strict, STRICT, "on the worst poses")
    for name, reference in certificate.references.items():
        for where, score in (("over the draws", reference), ("on the worst poses", reference.strict)):
            for requirement, entry in score.requirements.items() if score is not None else ():
                if entry.tally.interrupted:
                    text = reason_text(f"{name}: {requirement}", entry.passed, where, entry.reason)
                    yield Reason(text, advice=VERIFY_AGAIN)


def _score_reasons(
    certificate: Verification, score: Verification | Score, protocol: str, where: str
) -> Iterator[Reason]:
    for name, entry in score.requirements.items():
        if entry.passed is False and entry.worst_case is not None:
            sample_time = certificate.sample_time.seconds
            setting = Setting(certificate.controller, certificate.plant, protocol, entry.worst_case.seed, sample_time)
            text = reason_text(name, False, where.format(entry.failed_draws), entry.reason)
            yield Reason(text, case_command(setting, entry.worst_case.id))
        elif not entry.passed:
            place = "" if "{" in where else where
            advice = VERIFY_AGAIN if entry.tally.interrupted else ""
            yield Reason(reason_text(name, entry.passed, place, entry.reason), advice=advice)


def _of_each(scores: Sequence[Verification | Score], name: str) -> dict[str, bool | None]:
    """The verdicts on a requirement in several scores."""
    return {str(place): score.requirements[name].passed for place, score in enumerate(scores)}


def _over_draws(name: str, draws: Sequence[Draw], order: int) -> Line:
    """V in each draw."""
    x, y = [float(place) for place in range(1, len(draws) + 1)], [draw.cost for draw in draws]
    return Line(name, x, y, hue(order), symbol="circle")


def _table(title: str, own_score: Score | Verification, others: Mapping[str, Score]) -> Table:
    scores = {"controller": own_score, **others}
    columns = (Column(""), *map(Column, scores), Column("target"), Column("worst case"))
    rows: list[tuple[Cell, ...]] = []
    for name, entry in own_score.criteria.items():
        unit = SHOWN[entry.unit]
        values = (Value(score.criteria[name].mean, score.criteria[name].sd, unit) for score in scores.values())
        rows.append((Quantity(name, unit), *values, Value(entry.target, unit=unit), _worst(entry)))
    target = (
        sum(spec.weight for spec in own_score.rules.criteria.values()) if isinstance(own_score, Verification) else None
    )
    rows.append(("V", *(Value(score.cost.mean, score.cost.sd) for score in scores.values()), target, None))
    for name, held in own_score.requirements.items():
        rows.append((name, *(_verdict(score.requirements[name]) for score in scores.values()), None, _worst(held)))
    return Table(title, columns, tuple(rows))


def _worst(entry: CriterionOverDraws | RequirementOverDraws) -> str:
    worst = entry.worst_case
    return in_draw(worst.id, worst.seed) if worst else "-"


def _verdict(requirement: RequirementOverDraws) -> VerdictCell:
    draws = f" in {requirement.failed_draws}" if requirement.failed_draws else ""
    return VerdictCell(requirement.passed, VERDICTS[requirement.passed] + draws)
