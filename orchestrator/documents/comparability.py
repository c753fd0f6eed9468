"""The one rule that decides what may be compared: what figures depend on besides the controller must be equal; and
what is compared."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from ..benchmark.results import Rules
from ..codec import Struct
from .document import Comparable, Row
from .head import ControllerRecord, Head

SETUP = ("benchmark", "sample_time", "plant_parameters", "plant")
"""What must be equal for a search and a scorecard of one controller to stand beside each other."""


class Conditions(Struct, frozen=True):
    """What must be equal for two costs to be comparable.

    ``sample_time`` in seconds; ``seed`` is None for several; ``plant`` is the SHA-256 of what the plant is made of.
    """

    benchmark: str
    protocol: str
    sample_time: float
    seed: int | None
    plant_parameters: dict[str, float]
    plant: str
    rules: Rules

    @property
    def words(self) -> dict[str, str]:
        """The conditions but the rules, by field, in words."""
        changes = ", ".join(f"{name}={value:.12g}" for name, value in self.plant_parameters.items())
        return {
            "benchmark": f"benchmark {self.benchmark}",
            "protocol": f"protocol {self.protocol}",
            "sample_time": f"sample time {self.sample_time * 1e3:.12g} ms",
            "seed": "several seeds" if self.seed is None else f"seed {self.seed}",
            "plant_parameters": f"plant parameters {changes or 'as nominal'}",
            "plant": f"plant of contents {self.plant[:12]}...",
        }

    @property
    def title(self) -> str:
        """The conditions in one line; of the plant, only what was changed."""
        left_out = {"plant"} | (set() if self.plant_parameters else {"plant_parameters"})
        return ", ".join(words for name, words in self.words.items() if name not in left_out)

    def difference(self, other: Conditions, fields: Collection[str] = ()) -> str:
        """What is not as in ``other``, of these ``fields`` or of all; empty if nothing is."""
        words = other.words
        differences = [
            f"{condition}, not {words[name]}"
            for name, condition in self.words.items()
            if (not fields or name in fields) and getattr(self, name) != getattr(other, name)
        ]
        parts = [name for name in Rules.__struct_fields__ if getattr(self.rules, name) != getattr(other.rules, name)]
        if parts and self.protocol == other.protocol and not fields:
            differences.append(f"other rules ({', '.join(parts)})")
        return "; ".join(differences)


def conditions(head: Head) -> Conditions:
    """The conditions of what was made with ``head``."""
    return Conditions(
        benchmark=head.benchmark,
        protocol=head.protocol,
        sample_time=head.sample_time.seconds,
        seed=head.seed,
        plant_parameters=dict(sorted(head.plant.parameters.items())),
        plant=head.plant.model,
        rules=head.rules,
    )


def same_controller(one: Head, other: Head) -> bool:
    """Whether both are of the same FMU with the same parameters, under the same conditions but protocol and seed."""
    return same_fmu(one.controller, other.controller) and not conditions(one).difference(conditions(other), SETUP)


def same_fmu(one: ControllerRecord, other: ControllerRecord) -> bool:
    """Whether both are the same FMU with the same parameters."""
    return (one.sha256, one.parameters, one.mapping) == (other.sha256, other.parameters, other.mapping)


@dataclass(frozen=True)
class Entry:
    """A document with the name it is listed under, and what is shown of it.

    ``place`` is that of its controller among those that are compared, in the order in which they were given: by it a
    controller looks the same on every page and in every figure. ``controller`` is the controller's name there.
    """

    name: str
    document: Comparable
    folder: Path | None
    row: Row
    place: int
    controller: str

    @property
    def cost(self) -> float | None:
        """V, if it counts, that is if every case of the protocol was simulated."""
        return None if self.document.rank.reason else self.document.V
