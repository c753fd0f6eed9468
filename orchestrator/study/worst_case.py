"""The worst case of a controller, as far as a search finds it."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..benchmark.case import Case
from ..benchmark.protocol import Protocol
from ..benchmark.results import rules
from ..documents.commands import Setting, member_command
from ..documents.recording import BESIDE, FOUND
from ..documents.robustness import Robustness
from ..errors import InputError
from ..pairing.controller import Controller
from ..pairing.testbed import Testbed
from ..search import answers
from ..search.findings import BUDGET, Step
from ..search.history import Ask, Asking, History
from ..search.hunt import Hunt, least
from ..search.margins import lowered
from ..search.margins import margins as margins_of
from ..search.member import NOMINAL, Member, case_of, of_case, parameters
from ..search.radius import radius as radius_of
from ..search.stages import search
from ..search.target import Target, targets
from .declaration import Study, described, option
from .heads import controller_record, head, plant_record
from .requests import (
    Batch,
    BatchEntry,
    CaseToShow,
    Now,
    Record,
    Request,
    Requests,
    Save,
    StageDone,
    Tell,
    rehearsed,
    translated,
)


def sought(protocol: Protocol, listed: Sequence[Case], budget: int, only: Sequence[str]) -> list[Target]:
    """What ``only`` names, or everything, to be searched for from the cases ``listed``.

    Raises :class:`InputError` for a protocol whose tests draw or have disturbances that come again, if there is no such
    thing to search for, or if the budget does not last for what a search begins with.
    """
    if any(test.draws for test in protocol.tests):
        raise InputError(
            f"The protocol {protocol.name} draws disturbances: a search lists them.", "draws", protocol.name
        )
    if again := [test.name for test in protocol.tests if test.again]:
        # Its short simulations and starting times are those of one force.
        message = f"The disturbances of the test {again[0]} come again: a search is made for those that come once."
        raise InputError(message, "again", protocol.name, again[0])
    all_targets = targets(protocol)
    for name in only:
        if name not in {target.name for target in all_targets}:
            names = [target.name for target in all_targets]
            message = f"The search has no criterion or test {name}. Choose from {', '.join(names)}."
            raise InputError(message, "no-target", protocol.name, name, names)
    chosen = [target for target in all_targets if not only or target.name in only]
    first = math.ceil(least(protocol, list(map(of_case, listed)), chosen))
    if budget < first:
        message = f"The search begins with {first} whole cases: more than its budget of {budget}."
        raise InputError(message, "small-budget", "", budget)
    return chosen


@described
@dataclass(frozen=True)
class RobustnessStudy(Study[Robustness]):
    """Search for the worst case: is there an arm within the tolerances for which the controller fails, and which?

    Each failure comes with a command that reproduces it. If the search finds no failure, the controller may still have
    one.
    """

    command = "robustness"
    suffix = "-robustness"
    protocol_option = "protocol"

    budget: int = option(BUDGET, "simulated time, in whole cases", least=1, metavar="N")
    minutes: float = option(
        math.inf, "time after which nothing new is searched, and margins and radius are left out", above=0, metavar="M"
    )
    protocol: str | Path = option(
        "strict", "a protocol that draws nothing; its cases are the list that the search begins with", asked=False
    )
    only: Sequence[str] = option(
        (), "what to search for: B5, B6, B7, or a test such as delay_2; by default everything", metavar="NAME"
    )
    restarts: int = option(1, "independent starts of the search for V, which share its budget", least=1, metavar="N")
    from_list: bool = option(
        True,
        "whether to begin with the list, or with the nominal system alone",
        word="list",
        off="begin with the nominal system, not with the list",
    )
    known: bool = option(
        True,
        "whether to try the worst arms that anybody has found for the project's controllers, too, if there is a list",
        word="known-arms",
        off="do without the worst arms that are known of the project's controllers",
    )
    recordings: bool = option(
        True, "whether the worst cases, and the nominal arm beside them, are recorded for the report", asked=False
    )

    def ask(self, testbed: Testbed, controller: Controller, folder: Path | None = None) -> Requests[Robustness]:
        """The requests of a search."""
        study = replace(self, recordings=self.recordings and folder is not None)
        answer, _ = yield from worst_case(testbed, controller, study)
        return answer


def worst_case(
    testbed: Testbed, controller: Controller, study: RobustnessStudy
) -> Requests[tuple[Robustness, list[CaseToShow]]]:
    """The document of a ``study``; and the worst cases, each followed by that of the nominal arm."""
    search_testbed = replace(testbed, protocol=study.protocol)
    controller, pairing, T_s, cases = search_testbed.prepared(controller)
    rules_of, listed = search_testbed.rules, cases if study.from_list else ()
    chosen = sought(rules_of, listed, study.budget, study.only)
    setting = Setting(
        controller_record(pairing, controller),
        plant_record(testbed.manipulator, testbed.plant_parameters),
        str(study.protocol),
        testbed.seed,
        None if T_s == rules_of.sample_time else float(T_s),
    )

    def case(member: Member) -> Case:
        built = case_of(member, rules_of, search_testbed.nominal)
        return replace(built, scenario=replace(built.scenario, sample_time=T_s))

    def command(member: Member) -> str:
        return member_command(setting, member, parameters(member, rules_of, search_testbed.nominal))

    begin = yield Now()
    yield from rehearsed(pairing, cases[0])

    def answer(request: Ask | Step) -> Generator[Request, Any, Any]:
        if isinstance(request, Ask):
            (runs,) = yield Batch((BatchEntry(rules_of, pairing, tuple(map(case, request.members))),))
            return [run.result for run in runs]
        yield Tell(StageDone(request.stage, request.simulations, request.spent, request.cost, request.worst))
        now = yield Now()
        return now.seconds - begin.seconds < 60.0 * study.minutes

    poses = tuple(dict.fromkeys(of_case(listed_case).q_a for listed_case in cases))
    members = [of_case(listed_case) for listed_case in listed]
    searched = History(rules_of), rules(rules_of), members, poses, chosen
    hunt = Hunt(*searched, command, study.budget, study.restarts, study.known and study.from_list)
    found_by_stage = yield from translated(_stages(hunt, setting.seed), answer)
    results, end = hunt.history.result_of.values(), (yield Now())
    document = Robustness(
        schema=Robustness.SCHEMA,
        head=head(search_testbed, controller, pairing, T_s, begin, end, own_rules=hunt.rules),
        budget=study.budget,
        simulations=len(results),
        spent=hunt.history.spent,
        starts=tuple(hunt.starts),
        failures=sum(result.judged and not result.simulated for result in results),
        complete=hunt.complete,
        cut_short=tuple(hunt.cut_short),
        **found_by_stage,
        path=tuple(hunt.path),
    )
    shown = [to_show for member, roles in hunt.shown.items() for to_show in _beside_nominal(member, roles, case)]
    yield Save(document)  # before the recordings: whatever happens now, the answer is there
    if study.recordings:
        yield Save(document, recordings=(yield Record(pairing, tuple(shown))))
    return document, shown


def _stages(hunt: Hunt, seed: int) -> Asking[dict[str, Any]]:
    """The fields of the answer that the stages fill. Criteria and costs are read off before margins and radius, whose
    members are not searched for them; the requirements after the margins, which they follow from."""
    yield from search(hunt, seed)
    if hunt.complete:  # else time is over
        yield from answers.heard(hunt)
    if hunt.complete:
        yield from answers.disturbed(hunt, seed)
    fields: dict[str, Any] = {"effects": (yield from answers.effects(hunt))}
    fields["criteria"], fields["configurations"] = answers.criteria(hunt), answers.configurations(hunt)
    fields["peaks"] = answers.peaks(hunt)
    fields["cost"], fields["protocol_cost"] = answers.costs(hunt)
    fields["margins"] = (yield from margins_of(hunt, seed)) if hunt.complete else {}
    fields["requirements"] = yield from answers.requirements(hunt)
    fields["radius"] = (yield from radius_of(hunt)) if hunt.complete else None
    # What the radius has met counts for all of it, too.
    fields["margins"] = yield from lowered(hunt, fields["margins"])
    fields["requirements"] = yield from answers.broken_since(hunt, fields["requirements"])
    return fields


def _beside_nominal(member: Member, roles: Sequence[str], case: Any) -> Iterator[CaseToShow]:
    worst = case(member)
    if member.deviations:
        worst = replace(worst, system=replace(worst.system, name=FOUND))
    yield CaseToShow(worst, tuple(roles))
    nominal = replace(member, system=NOMINAL, deviations=())
    yield CaseToShow(case(nominal), tuple(f"{BESIDE} {role}" for role in roles))
