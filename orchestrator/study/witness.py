"""The worst cases of a verification, kept as they come, for the second checker."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from ..benchmark.case import Case
from ..benchmark.cases import seed_of
from ..benchmark.certificate import CheckedCase, Difference
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult
from ..documents import case_file
from ..errors import EnvironmentFault
from ..loop.trajectory import Trajectory
from ..recheck import Unreadable, recheck
from .requests import CaseChecked, Requests, Tell

logger = logging.getLogger(__name__)

WITNESSED = ("B5", "B6", "B7")
"""The criteria that V mainly consists of; the worst case of each is kept."""

CYCLE, FIRST = "limit cycle", "first"
"""What else is kept: the case with the largest motion at its end, and the first one with a disturbance."""


@dataclass(frozen=True)
class Kept:
    """A simulated case and what it came to."""

    case: Case
    result: CaseResult
    trajectory: Trajectory


@dataclass
class Witness:
    """Is given each simulated case of the controller called ``name``, and keeps the worst."""

    protocol: Protocol
    name: str
    nominal: Mapping[str, float]
    kept: dict[str, tuple[float, Kept]] = field(default_factory=dict)

    def __call__(self, case: Case, result: CaseResult, trajectory: Trajectory) -> None:
        """Keep the case where it is the worst so far."""
        kept = Kept(case, result, trajectory)
        for reason, value in _severities(result).items():
            if reason not in self.kept or value > self.kept[reason][0]:
                self.kept[reason] = value, kept

    def files(self) -> list[tuple[Case, bytes]]:
        """The kept cases as files, each once."""
        # By identity: one case may be the worst in several ways, and trajectories are large.
        cases = {id(kept): kept for _, kept in self.kept.values()}.values()
        return [
            (
                kept.case,
                case_file.packed(self.protocol, kept.case, self.name, self.nominal, kept.trajectory, kept.result),
            )
            for kept in cases
        ]


def _severities(result: CaseResult) -> dict[str, float]:
    severities = {name: getattr(result.measurements, name) for name in WITNESSED}
    severities[CYCLE] = result.measurements.limit_cycle_at_end
    if severities["B5"] is not None:
        # Never larger than another one, so the first case with a force stays.
        severities[FIRST] = -math.inf
    return {reason: value for reason, value in severities.items() if value is not None}


def check(witness: Witness) -> Requests[tuple[CheckedCase, ...]]:
    """The kept cases, computed anew by the second checker; each is told with its file.

    Raises :class:`EnvironmentFault` where it does not agree: then one of the two programs is wrong, and nothing is
    certified. A case that it cannot compute, as at another sample time, is left out.
    """
    checked = []
    for case, content in witness.files():
        seed = seed_of(case)
        yield Tell(CaseChecked(f"case-{seed}.{case.id}.npz", content))
        try:
            told = recheck(content)
        except Unreadable as problem:
            logger.warning("The second checker cannot compute %s: %s.", case.id, problem)
            continue
        wrong = [
            f"{row.name}: {row.difference:.2g} {row.unit}, not within {row.bound:.2g}"
            for row in told.rows
            if not row.ok
        ]
        if wrong:
            message = f"The second checker does not agree with the simulation of {case.id} in the draw {seed}: "
            raise EnvironmentFault(f"{message}{'; '.join(wrong)}. Nothing is certified.", "recheck")
        rows = tuple(Difference(row.name, row.unit, row.difference, row.bound) for row in told.rows)
        checked.append(CheckedCase(case.id, seed, rows))
    return tuple(checked)
