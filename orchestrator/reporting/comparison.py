"""Several runs side by side: which may be ranked together, in which order, and why the others may not."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ..benchmark.results import ControllerRecord, Results, Rules
from ..codec import Struct, plain
from .run import Run
from .spread import Spread
from .wording import SEED_MATTERS, requirement_rows, without_cost

T = TypeVar("T")


class Conditions(Struct, frozen=True):
    """What the figures of a run depend on besides the controller: what must be equal for two costs to be comparable.

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

    def difference(self, other: Conditions) -> str:
        """What is not as in ``other``; empty if nothing is."""
        words = other.words
        found = [
            f"{own}, not {words[name]}"
            for name, own in self.words.items()
            if getattr(self, name) != getattr(other, name)
        ]
        parts = [name for name in Rules.__struct_fields__ if getattr(self.rules, name) != getattr(other.rules, name)]
        if parts and self.protocol == other.protocol:
            found.append(f"other rules ({', '.join(parts)})")
        return "; ".join(found)


@dataclass(frozen=True)
class Entry:
    """A run with the name it is listed under."""

    name: str
    run: Run

    @property
    def cost(self) -> float | None:
        """V, if it counts, that is if every case of the protocol was simulated."""
        return self.run.results.cost if self.run.results.complete else None


@dataclass(frozen=True)
class Group:
    """Runs under equal conditions, best first (see :func:`standing`).

    ``unranked`` pairs the runs that have no rank with the reason.
    ``difference`` says what sets the group apart from the first one; empty for the first.
    """

    conditions: Conditions
    ranked: tuple[Entry, ...]
    unranked: tuple[tuple[Entry, str], ...]
    difference: str

    @property
    def title(self) -> str:
        """The conditions in words."""
        return self.conditions.title

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All runs, those without a rank last."""
        return *self.ranked, *(entry for entry, _ in self.unranked)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader must know before trusting the ranks."""
        name = self.conditions.protocol
        return () if name == "paper" else (f"Protocol {name}: {SEED_MATTERS}. Compare with several seeds.",)


def compare(runs: Sequence[Run]) -> tuple[Group, ...]:
    """The runs in groups that may be ranked, the largest group first. There must be at least one run."""
    listed = names([(run.results.controller, run.folder) for run in runs])
    groups = grouped(
        (conditions(run.results, run.results.seed), Entry(name, run)) for name, run in zip(listed, runs, strict=True)
    )
    groups.sort(key=lambda group: len(group[1]), reverse=True)
    found = []
    for own, entries in groups:
        ranked = sorted((e for e in entries if e.cost is not None), key=lambda entry: standing(entry.run.results))
        unranked = tuple((entry, _reason(entry.run.results)) for entry in entries if entry.cost is None)
        found.append(Group(own, tuple(ranked), unranked, own.difference(groups[0][0])))
    return tuple(found)


def grouped(entries: Iterable[tuple[Conditions, T]]) -> list[tuple[Conditions, list[T]]]:
    """The entries under equal conditions, in their order."""
    groups: list[tuple[Conditions, list[T]]] = []
    for own, entry in entries:
        there = next((others for known, others in groups if known == own), None)
        if there is None:
            groups.append((own, there := []))
        there.append(entry)
    return groups


def conditions(results: Results | Spread, seed: int | None) -> Conditions:
    """The conditions of a run, or of several that differ in their seed."""
    return Conditions(
        benchmark=results.benchmark,
        protocol=results.protocol,
        sample_time=results.sample_time.seconds,
        seed=seed,
        plant_parameters=dict(sorted(results.plant.parameters.items())),
        plant=results.plant.model,
        rules=results.rules,
    )


def names(runs: Sequence[tuple[ControllerRecord, Path | None]]) -> list[str]:
    """A name for each run: the controller's with its parameters, and the folder or the place if that is not enough."""
    plain_names = [_controller(controller) for controller, _ in runs]
    counts = Counter(plain_names)
    folders = (folder for _, folder in runs)
    places = [f"run {i}" if folder is None else os.path.normpath(folder) for i, folder in enumerate(folders, start=1)]
    return [f"{name} ({place})" if counts[name] > 1 else name for name, place in zip(plain_names, places, strict=True)]


def comparison_document(groups: Sequence[Group]) -> dict[str, Any]:
    """The comparison as plain values in SI units."""
    return {
        "groups": [
            {
                "conditions": plain(group.conditions),
                "difference": group.difference,
                "notes": list(group.notes),
                "ranked": [{"rank": rank, **_summary(entry)} for rank, entry in enumerate(group.ranked, start=1)],
                "unranked": [{"reason": reason, **_summary(entry)} for entry, reason in group.unranked],
            }
            for group in groups
        ]
    }


def standing(results: Results) -> tuple[bool, float]:
    """The sort key of a run that has a cost: those that meet all requirements first, then V."""
    assert results.cost is not None
    return not all(entry.passed for entry in results.stability.values()), results.cost


def _reason(results: Results) -> str:
    failed = Counter(case.status.value for case in results.cases if not case.simulated)
    if failed:
        return "incomplete: " + ", ".join(f"{count} {status}" for status, count in failed.items())
    return without_cost(results) or "incomplete: not all cases of the protocol were run"


def _controller(controller: ControllerRecord) -> str:
    parameters = ", ".join(f"{name}={value:g}" for name, value in controller.parameters.items())
    return controller.file.removesuffix(".fmu") + (f" [{parameters}]" if parameters else "")


def _summary(entry: Entry) -> dict[str, Any]:
    results = entry.run.results
    return {
        "name": entry.name,
        "folder": None if entry.run.folder is None else str(entry.run.folder),
        "sha256": results.controller.sha256,
        "cost": results.cost,
        "complete": results.complete,
        "criteria": {name: criterion.value for name, criterion in results.criteria.items()},
        "requirements": {f"{row.name} {row.axis}".strip(): row.judged.passed for row in requirement_rows(results)},
    }
