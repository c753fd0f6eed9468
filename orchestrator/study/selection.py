"""Which cases of an evaluation its report shows in full: the worst ones, an example, and many systems in one pose."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..benchmark import cases
from ..benchmark.case import Case
from ..benchmark.protocol import Protocol
from ..benchmark.results import Scorecard
from ..documents.recording import EXAMPLE, SYSTEMS
from ..exact_time import seconds
from ..loop.trajectory import Status
from ..pairing.runs import CaseRun

POSE = (math.radians(18.0), math.radians(-50.0))
"""Link angles [rad] of the example and the spread: an ordinary pose in the middle of the workspace."""

SPREAD_SYSTEMS = 20
"""Uncertain systems in Figures 11 and 12 of the paper."""

TIME_AFTER_FORCE = 4.0
"""Seconds shown of the spread after the force has ended: the wanted settling time, and a second of what follows."""


@dataclass(frozen=True)
class CaseToShow:
    """A case to simulate again, and what it is shown for."""

    case: Case
    roles: tuple[str, ...]


def shown(
    protocol: Protocol, nominal: Mapping[str, float], seed: int, runs: Sequence[CaseRun], card: Scorecard
) -> list[CaseToShow]:
    """What to simulate for the report of ``runs``.

    A case that hung or ended its process would do so again, and one that was lost may: it is not tried. Where one hung,
    or none came to its end, nothing is tried that was not tried before. The spread is limited to as many systems as the
    evaluation ran, so that a short evaluation stays short.
    """
    by_id = {run.case.id: run for run in runs}
    chosen = [
        CaseToShow(by_id[id].case, tuple(roles))
        for id, roles in _worst(card).items()
        if by_id[id].result.status not in (Status.TIMEOUT, Status.CRASHED, Status.LOST, Status.SKIPPED)
    ]
    statuses = {run.result.status for run in runs}
    # Each recording of a controller that hangs would cost a time limit.
    if Status.DONE not in statuses or Status.TIMEOUT in statuses:
        return chosen
    test = next((test for test in protocol.tests if "B5" in test.criteria), None)
    if test is None:  # a protocol of one's own, without a force whose course could be compared
        return chosen
    size = min(SPREAD_SYSTEMS, sum(run.case.test == test for run in runs))
    sample_time = runs[0].case.scenario.sample_time

    def in_pose(name: str, role: str, duration: float | None = None) -> CaseToShow:
        pose = cases.configuration(protocol, *POSE, seed)
        system = cases.system(protocol, nominal, seed, pose.index, name, test)
        case = cases.case(protocol, pose, system, test, seed)
        scenario = replace(case.scenario, sample_time=sample_time)
        if duration is not None:
            scenario = replace(scenario, duration=min(scenario.duration, seconds(duration)))
        return CaseToShow(replace(case, scenario=scenario), (role,))

    end = protocol.disturbance.t_2 + TIME_AFTER_FORCE
    names = [*protocol.sets[test.systems], *(f"random_{number}" for number in range(1, SPREAD_SYSTEMS))]
    spread = [in_pose(name, SYSTEMS, end) for name in list(dict.fromkeys(names))[:size]]
    return [*chosen, in_pose("nominal", EXAMPLE), *spread]


def _worst(card: Scorecard) -> dict[str, list[str]]:
    """Cases to show with what for: worst of a criterion, and of a requirement on an axis where it fails."""
    roles: dict[str, list[str]] = {}
    for name, score in card.criteria.items():
        if score.worst_case:
            roles.setdefault(score.worst_case.id, []).append(name)
    for name, requirement in card.stability.items():
        for axis, verdict in requirement.axes.items():
            if verdict.worst_case and verdict.passed is False:
                roles.setdefault(verdict.worst_case, []).append(f"{name} {axis}")
    return roles
