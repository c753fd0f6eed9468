"""The standard conditions of a verification: only what was found under these is compared with one another."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark import protocol as protocols
from ..benchmark.certificate import CaseEnding, Score
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
    standard, plant = protocols.load(PROTOCOL), head.plant
    listed = () if strict is None else strict.cases
    holds = {
        f"the benchmark is {head.benchmark}, not {standard.benchmark}": head.benchmark == standard.benchmark,
        f"the protocol is not {PROTOCOL} as it comes with the benchmark": (head.protocol, head.protocol_file)
        == (PROTOCOL, "")
        and head.rules == rules(standard)
        and len(cases) == draws * standard.case_count,
        f"there are {draws} draws, not {COUNT}": draws == COUNT,
        f"the cases of {STRICT} are not all there": len(listed) == protocols.load(STRICT).case_count,
        f"the references are not {' and '.join(USUAL)}": set(references) >= set(USUAL),
        "the plant is not that of the benchmark": plant.build in ("python", "native")
        and not plant.parameters
        and plant.nominal == NOMINAL,
        "the controller samples at another rate than the benchmark": head.sample_time.as_in_benchmark
        and head.sample_time.seconds == float(standard.loop.sample_time),
    }
    return tuple(words for words, kept in holds.items() if not kept)
