"""Which cases of an evaluation its report shows in full: the worst ones, an example, and many systems in one pose."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..benchmark import protocol as protocols
from ..benchmark.case import Case
from ..benchmark.metrics import CaseResult
from ..benchmark.protocol import Protocol
from ..benchmark.scorecard import Scorecard
from ..cosim.scenario import seconds
from ..cosim.trajectory import Status
from .recording import EXAMPLE, SPREAD

POSE = (math.radians(18.0), math.radians(-50.0))
"""Link angles [rad] of the example and the spread: an ordinary pose in the middle of the workspace."""

SPREAD_SYSTEMS = 20
"""Uncertain systems in Figures 11 and 12 of the paper."""

AFTERWARDS = 4.0
"""Seconds shown of the spread after the force has ended: the wanted settling time, and a second of what follows."""


@dataclass(frozen=True)
class Shown:
    """A case to simulate again, and what it is shown for."""

    case: Case
    roles: tuple[str, ...]


def shown(
    protocol: Protocol, nominal: Mapping[str, float], seed: int, results: Sequence[CaseResult], card: Scorecard
) -> list[Shown]:
    """What to simulate for the report of ``results``.

    A case that hung or ended its process would do so again: it is not tried. Where one hung, or none came to its end,
    nothing is tried that was not tried before. The spread is limited to as many systems as the evaluation ran, so
    that a short evaluation stays short.
    """
    known = {result.case.id: result for result in results}
    chosen = [
        Shown(known[id].case, tuple(roles))
        for id, roles in _worst(card).items()
        if known[id].status not in (Status.TIMEOUT, Status.CRASHED, Status.SKIPPED)
    ]
    statuses = {result.status for result in results}
    if Status.DONE not in statuses or Status.TIMEOUT in statuses:
        return chosen
    test = next(test for test in protocol.tests if "B5" in test.criteria)
    size = min(SPREAD_SYSTEMS, sum(result.case.test == test for result in results))
    sample_time = results[0].case.scenario.sample_time

    def in_pose(name: str, role: str, duration: float | None = None) -> Shown:
        pose = protocols.configuration(protocol, *POSE)
        system = protocols.system(protocol, nominal, seed, pose.index, name, test)
        case = protocols.case(protocol, pose, system, test, seed)
        scenario = replace(case.scenario, sample_time=sample_time)
        if duration is not None:
            scenario = replace(scenario, duration=min(scenario.duration, seconds(duration)))
        return Shown(replace(case, scenario=scenario), (role,))

    end = protocol.raw["disturbance"]["t_2"] + AFTERWARDS
    names = [*protocol.raw["performance"]["systems"], *(f"random_{number}" for number in range(1, SPREAD_SYSTEMS))]
    spread = [in_pose(name, SPREAD, end) for name in list(dict.fromkeys(names))[:size]]
    return [*chosen, in_pose("nominal", EXAMPLE), *spread]


def _worst(card: Scorecard) -> dict[str, list[str]]:
    """Cases to show with what for: worst of a criterion, and of a requirement on an axis where it fails."""
    roles: dict[str, list[str]] = {}
    for score in card.criteria:
        if score.worst_case:
            roles.setdefault(score.worst_case, []).append(score.criterion.name)
    for requirement in card.requirements:
        for axis, verdict in requirement.axes.items():
            if verdict.worst_case and not verdict.passed:
                roles.setdefault(verdict.worst_case, []).append(f"{requirement.name} {axis}")
    return roles
