"""Whether state passes from one simulation to the next in the same process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from types import MappingProxyType


class CarryOver(str, Enum):
    """What repeating a simulation in a fresh process has shown of two FMUs; see :func:`carry_over`."""

    NOT_TESTED = "not tested"
    NONE = "none"
    DECLARED = "declared"
    FOUND = "found"
    RANDOM = "not deterministic"

    @property
    def separates(self) -> bool:
        """Whether simulations are right only in processes of their own."""
        return self in (CarryOver.FOUND, CarryOver.RANDOM)


WORDS: Mapping[CarryOver, str] = MappingProxyType(
    {
        CarryOver.DECLARED: "the FMU declares that a process can instantiate it only once",
        CarryOver.FOUND: "state passes from one simulation to the next in the same process",
        CarryOver.RANDOM: "the same simulation gives other numbers each time, also in a fresh process",
    }
)
"""What has been found, for those that need a process for each simulation."""


def carry_over(after: bytes, fresh: bytes, again: Callable[[], bytes | None]) -> CarryOver:
    """From the numbers of one simulation that ran ``after`` another one, ``fresh`` in a new process, and, if these two
    differ, ``again`` in a new process; None if it had no numbers there."""
    if after == fresh:
        return CarryOver.NONE
    # Two fresh processes that differ show a controller that is not deterministic,
    # whatever ran before; only a third simulation tells the two apart.
    return CarryOver.FOUND if again() == fresh else CarryOver.RANDOM
