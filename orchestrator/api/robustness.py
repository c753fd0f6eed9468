"""The worst case of a controller, as far as a search finds it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from ..benchmark.case import Case
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, rules
from ..errors import Crash, InputError
from ..reporting.files import REPORT, TRAJECTORIES, remove
from ..reporting.recording import BESIDE, FOUND
from ..reporting.recording import save as save_recordings
from ..reporting.repeat import Setting, member_command
from ..reporting.robustness import Robustness
from ..search import hunt as stages
from ..search.archive import Archive
from ..search.hunt import Hunt
from ..search.margins import margins as margins_of
from ..search.margins import radius as radius_of
from ..search.member import NOMINAL, Member, case_of, of_case, parameters
from ..search.target import Target, targets
from . import campaign, document
from .conditions import Conditions
from .controller import Controller
from .recorder import record_shown
from .running import Runner
from .selection import Shown

OnProgress = Callable[[str, int, Mapping[str, float | None]], None]
"""Is told the stage of a search, the simulations so far, and the worst value of each target."""


def sought(protocol: Protocol, listed: Sequence[Case], budget: int, only: Sequence[str]) -> list[Target]:
    """What ``only`` names, or everything, to be searched for from the cases ``listed``.

    Raises :class:`InputError` for a protocol whose tests draw, if there is no such thing to search for, or if the
    budget does not last for what a search begins with.
    """
    if any(test.draws for test in protocol.tests):
        raise InputError(
            f"The protocol {protocol.name} draws disturbances: a search lists them.", "draws", protocol.name
        )
    known = targets(protocol)
    for name in only:
        if name not in {target.name for target in known}:
            names = [target.name for target in known]
            message = f"There is nothing called {name} to search for. Choose from {', '.join(names)}."
            raise InputError(message, "no-target", protocol.name, name, names)
    wanted = [target for target in known if not only or target.name in only]
    least = stages.least(protocol, listed, wanted)
    if budget < least:
        raise InputError(
            f"The search begins with {least} simulations: more than its budget of {budget}.", "small-budget", "", budget
        )
    return wanted


def search(
    conditions: Conditions,
    controller: Controller | None,
    budget: int,
    minutes: float = math.inf,
    protocol: str | Path = "strict",
    only: Sequence[str] = (),
    from_list: bool = True,
    folder: str | Path | None = None,
    recordings: bool = False,
    on_progress: OnProgress | None = None,
) -> tuple[Robustness, list[Shown]]:
    """See :meth:`.Benchmark.robustness`; and the worst cases, each followed by that of the nominal arm."""
    own = replace(conditions, protocol=protocol)
    controller, bench, T_s, cases = own.prepared(controller)
    listed = cases if from_list else ()
    wanted = sought(own.rules, listed, budget, only)
    setting = Setting(
        document.controller_record(bench, controller),
        document.plant_record(conditions.manipulator, conditions.plant_parameters),
        str(protocol),
        conditions.seed,
        None if T_s == own.rules.sample_time else float(T_s),
    )
    target = None if folder is None else Path(folder)
    with own.runner(bench, target) as runner:
        if (failure := campaign.rehearse(cases[0], bench).failure) is not None:
            raise Crash(failure.result.message)
        found, worst = find_worst_case(runner, listed, wanted, own.nominal, setting, T_s, budget, minutes, on_progress)
        if target is not None:
            for name in (TRAJECTORIES, REPORT):  # of another search
                remove(target / name)
            found.save(target)  # before the recordings: whatever happens now, the answer is there
            if recordings:
                save_recordings(record_shown(worst, bench, conditions.processes), target)
    return found, worst


def find_worst_case(
    runner: Runner,
    listed: Sequence[Case],
    wanted: Sequence[Target],
    nominal: Mapping[str, float],
    setting: Setting,
    sample_time: Fraction,
    budget: int,
    minutes: float,
    on_progress: OnProgress | None,
) -> tuple[Robustness, list[Shown]]:
    """Search with ``runner`` for all ``wanted`` from the cases ``listed`` or, if there are none, from the nominal
    system; and what a report shows of it: the worst cases, each followed by that of the nominal arm."""
    begin, protocol = time.perf_counter(), runner.protocol

    def case(member: Member) -> Case:
        found = case_of(member, protocol, nominal)
        return replace(found, scenario=replace(found.scenario, sample_time=sample_time))

    def ask(members: Sequence[Member]) -> list[CaseResult]:
        return [run.result for run in runner.run([case(member) for member in members])]

    def told(stage: str, simulations: int, worst: Mapping[str, float | None]) -> bool:
        if on_progress is not None:
            on_progress(stage, simulations, worst)
        return time.perf_counter() - begin < 60.0 * minutes

    def command(member: Member) -> str:
        return member_command(setting, member, parameters(member, protocol, nominal))

    archive, members = Archive(protocol, ask), [of_case(each) for each in listed]
    hunt = Hunt(archive, rules(protocol), members, wanted, command, told, budget)
    stages.search(hunt, setting.seed)
    stages.spread(hunt)
    requirements = stages.requirements(hunt)
    effects = stages.effects(hunt)
    criteria, configurations = stages.criteria(hunt), stages.configurations(hunt)
    found, own = stages.costs(hunt)
    margins = margins_of(hunt) if hunt.complete else {}
    radius = radius_of(hunt) if hunt.complete else None
    results = hunt.archive.found.values()
    answer = Robustness(
        schema=Robustness.SCHEMA,
        benchmark=protocol.benchmark,
        protocol=protocol.name,
        seed=setting.seed,
        budget=budget,
        simulations=len(results),
        failures=sum(result.judged and not result.simulated for result in results),
        complete=hunt.complete,
        cut_short=tuple(hunt.cut_short),
        cost=found,
        protocol_cost=own,
        criteria=criteria,
        requirements=requirements,
        margins=margins,
        radius=radius,
        configurations=configurations,
        effects=effects,
        path=tuple(hunt.path),
        rules=hunt.rules,
        controller=setting.controller,
        plant=setting.plant,
        wall_time=time.perf_counter() - begin,
    )
    return answer, [each for member, roles in hunt.shown.items() for each in _beside_nominal(member, roles, case)]


def _beside_nominal(member: Member, roles: Sequence[str], case: Callable[[Member], Case]) -> Iterator[Shown]:
    worst = case(member)
    if member.deviations:
        worst = replace(worst, system=replace(worst.system, name=FOUND))
    yield Shown(worst, tuple(roles))
    nominal = replace(member, system=NOMINAL, deviations=())
    yield Shown(case(nominal), tuple(f"{BESIDE} {role}" for role in roles))
