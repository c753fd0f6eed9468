"""Several runs side by side: which may be ranked together, in which order, and why the others may not."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .run import Run
from .tables import Document
from .wording import requirement_rows, without_cost

CONDITIONS = {
    "benchmark": "benchmark {}",
    "protocol": "protocol {}",
    "sample_time": "sample time {} ms",
    "seed": "seed {}",
    "plant_parameters": "plant parameters {}",
}
"""What must be equal for two costs to be comparable, and how it is said."""


@dataclass(frozen=True)
class Entry:
    """A run with the name it is listed under."""

    name: str
    run: Run

    @property
    def cost(self) -> float | None:
        """V, where the run has one that counts: every case of the protocol has a verdict."""
        return self.run.document["cost"] if self.run.document["complete"] else None


@dataclass(frozen=True)
class Group:
    """Runs under equal conditions, best first (see :func:`standing`).

    ``unranked`` pairs the runs that have no rank with the reason.
    ``difference`` says what sets the group apart from the first one; empty for the first.
    """

    conditions: dict[str, Any]
    ranked: tuple[Entry, ...]
    unranked: tuple[tuple[Entry, str], ...]
    difference: str

    @property
    def title(self) -> str:
        """The conditions in words."""
        return ", ".join(_said(name, value) for name, value in self.conditions.items() if value != {})


def compare(runs: Sequence[Run]) -> tuple[Group, ...]:
    """The runs in groups that may be ranked, the largest group first."""
    groups: dict[str, list[Entry]] = {}
    for name, run in zip(names(runs), runs, strict=True):
        groups.setdefault(repr(conditions(run)), []).append(Entry(name, run))
    ordered = sorted(groups.values(), key=len, reverse=True)
    first = conditions(ordered[0][0].run)
    return tuple(_group(entries, first) for entries in ordered)


def conditions(run: Run) -> dict[str, Any]:
    """What the run's figures depend on besides the controller."""
    document = run.document
    return {
        "benchmark": document["benchmark"],
        "protocol": document["protocol"],
        "sample_time": document["sample_time"]["seconds"] * 1e3,
        "seed": document["seed"],
        "plant_parameters": dict(sorted(document["plant"]["parameters"].items())),
    }


def names(runs: Sequence[Run]) -> list[str]:
    """A name for each run: the controller's with its parameters, and the folder where that is not enough."""
    plain = [_controller(run) for run in runs]
    repeated = {name for name, count in Counter(plain).items() if count > 1}
    folders = [os.path.normpath(run.folder) for run in runs]
    return [f"{name} ({folder})" if name in repeated else name for name, folder in zip(plain, folders, strict=True)]


def comparison_document(groups: Sequence[Group]) -> dict[str, Any]:
    """The comparison as plain values, SI units, for ``--json``."""
    return {
        "groups": [
            {
                "conditions": group.conditions,
                "difference": group.difference,
                "ranked": [{"rank": rank, **_summary(entry)} for rank, entry in enumerate(group.ranked, start=1)],
                "unranked": [{"reason": reason, **_summary(entry)} for entry, reason in group.unranked],
            }
            for group in groups
        ]
    }


def _group(entries: Sequence[Entry], first: dict[str, Any]) -> Group:
    own = conditions(entries[0].run)
    different = [_said(name, own[name]) + ", not " + _value(first[name]) for name in own if own[name] != first[name]]
    ranked = [entry for entry in entries if entry.cost is not None]
    return Group(
        own,
        tuple(sorted(ranked, key=lambda entry: standing(entry.run.document))),
        tuple((entry, _reason(entry.run)) for entry in entries if entry.cost is None),
        "; ".join(different),
    )


def standing(document: Document) -> tuple[bool, float]:
    """What the order goes by: those that hold all requirements first, then V."""
    holds = all(entry["passed"] for entry in document["stability"].values())
    return not holds, document["cost"]


def _reason(run: Run) -> str:
    failed = Counter(case["status"] for case in run.document["cases"] if case["status"] not in ("done", "unstable"))
    if failed:
        return "incomplete: " + ", ".join(f"{count} {status}" for status, count in failed.items())
    return without_cost(run.document) or "incomplete: not all cases of the protocol were run"


def _controller(run: Run) -> str:
    controller = run.document["controller"]
    parameters = ", ".join(f"{name}={value:g}" for name, value in controller["parameters"].items())
    return controller["file"].removesuffix(".fmu") + (f" [{parameters}]" if parameters else "")


def _said(name: str, value: Any) -> str:
    return CONDITIONS[name].format(_value(value))


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name}={number:g}" for name, number in value.items()) or "as nominal"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _summary(entry: Entry) -> dict[str, Any]:
    document = entry.run.document
    return {
        "name": entry.name,
        "folder": str(entry.run.folder),
        "sha256": document["controller"]["sha256"],
        "cost": document["cost"],
        "complete": document["complete"],
        "criteria": {name: criterion["value"] for name, criterion in document["criteria"].items()},
        "requirements": {
            " ".join((row["name"], row["axis"])).strip(): row["passed"] for row in requirement_rows(document)
        },
    }
