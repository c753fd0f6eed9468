"""The standard conditions of a verification: only what was found under these is compared with one another."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark import protocol as protocols
from ..benchmark.cases import cases as listed
from ..benchmark.certificate import CaseEnding, Score
from ..benchmark.protocol import Protocol
from ..benchmark.results import rules
from .head import Head

PROTOCOL, STRICT, COUNT = "verification", "strict-verification", 3
"""The protocol of the draws, that of the worst poses, and the number of draws."""

USUAL = ("DiagonalPID", "TunedPID")
"""The references, which take the least time."""


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
    return [case.id for case in listed(protocol, NOMINAL, 0)]
