"""What a comparison shows beside the leaderboards: spreads over seeds with their paired differences, and searches for
the worst case, each beside the scorecard of the same controller."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..benchmark.results import ControllerRecord
from ..benchmark.spread import Paired, paired
from ..codec import plain
from .comparison import Conditions, Entry, Group, conditions, grouped, names
from .robustness import Robustness, largest_words, margin_words, radius_rows
from .spread import Spread, mean_words
from .wording import VERDICTS


@dataclass(frozen=True)
class SpreadEntry:
    """A spread with the name it is listed under, and V minus that of the first of its group, seed by seed; None for the
    first, or without a seed in common."""

    name: str
    spread: Spread
    folder: Path | None
    paired: Paired | None = None

    @property
    def better(self) -> str:
        """The paired difference in words."""
        if self.paired is None:
            return "-"
        better, of = self.paired.better, len(self.paired.seeds)
        return f"{mean_words(self.paired.difference)}, better with {better} of {of} seeds"


@dataclass(frozen=True)
class SpreadGroup:
    """Spreads under equal conditions, in the order given; ``difference`` as in :class:`.comparison.Group`."""

    conditions: Conditions
    entries: tuple[SpreadEntry, ...]
    difference: str


def compare_spreads(spreads: Sequence[tuple[Spread, Path | None]]) -> tuple[SpreadGroup, ...]:
    """The spreads in groups that may be compared, each pairing its spreads with its first one."""
    listed = names([(spread.controller, folder) for spread, folder in spreads])
    entries = (
        (conditions(spread, None), SpreadEntry(name, spread, folder))
        for name, (spread, folder) in zip(listed, spreads, strict=True)
    )
    groups = grouped(entries)
    return tuple(SpreadGroup(own, tuple(_paired(entries)), own.difference(groups[0][0])) for own, entries in groups)


def _paired(entries: Sequence[SpreadEntry]) -> Iterator[SpreadEntry]:
    first = entries[0]
    yield first
    for each in entries[1:]:
        difference = paired(each.spread.seeds, first.spread.seeds)
        yield SpreadEntry(each.name, each.spread, each.folder, difference)


@dataclass(frozen=True)
class WorstEntry:
    """A search for the worst case, and the scorecard of the same controller with the same parameters, if there is one:
    that of a run, or of a spread."""

    name: str
    found: Robustness
    folder: Path | None
    scorecard: Entry | SpreadEntry | None

    @property
    def conditions(self) -> str:
        """Protocol and seeds of the scorecard."""
        card = self.scorecard
        if isinstance(card, SpreadEntry):
            return f"{card.spread.protocol}, {len(card.spread.seeds)} seeds"
        return "-" if card is None else f"{card.run.results.protocol}, seed {card.run.results.seed}"

    @property
    def V(self) -> float | None:
        """V of the scorecard, over several seeds the mean."""
        card = self.scorecard
        if isinstance(card, SpreadEntry):
            return card.spread.cost.mean
        return None if card is None else card.run.results.cost

    @property
    def verdicts(self) -> str:
        """The requirements that the scorecard fails, with any seed, and those that are not judged."""
        card = self.scorecard
        if card is None:
            return "-"
        if isinstance(card, SpreadEntry):
            verdicts = {name: card.spread.passed(name) for name in card.spread.requirements}
        else:
            verdicts = {name: entry.passed for name, entry in card.run.results.stability.items()}
        failed = [name for name, passed in verdicts.items() if passed is False]
        unknown = [f"{name} {VERDICTS[None]}" for name, passed in verdicts.items() if passed is None]
        return ", ".join([*failed, *unknown]) or "none"

    @property
    def margins(self) -> dict[str, str]:
        """Margins and radii in words, by name."""
        short = {name: margin_words(name, margin, short=True) for name, margin in self.found.margins.items()}
        return short | dict(radius_rows(self.found.radius))

    @property
    def largest(self) -> dict[str, str]:
        """The largest B5 and B6 in words."""
        return {name: largest_words(entry) for name, entry in self.found.criteria.items() if name in ("B5", "B6")}

    @property
    def broken(self) -> str:
        """The requirements that a failure was found of."""
        return ", ".join(self.found.broken) or "none found"


def beside(
    found: Sequence[tuple[Robustness, Path | None]], groups: Sequence[Group], spreads: Sequence[SpreadGroup]
) -> tuple[WorstEntry, ...]:
    """The searches, one entry for each scorecard of the same controller, or one without."""
    cards: list[Entry | SpreadEntry] = [entry for group in groups for entry in group.entries]
    cards += [entry for group in spreads for entry in group.entries]
    listed = names([(each.controller, folder) for each, folder in found])
    entries = []
    for name, (each, folder) in zip(listed, found, strict=True):
        own = [card for card in cards if _same(_controller(card), each.controller)]
        entries += [WorstEntry(name, each, folder, card) for card in own or (None,)]
    return tuple(entries)


def _controller(card: Entry | SpreadEntry) -> ControllerRecord:
    return card.run.results.controller if isinstance(card, Entry) else card.spread.controller


def _same(one: ControllerRecord, other: ControllerRecord) -> bool:
    return (one.sha256, one.parameters, one.mapping) == (other.sha256, other.parameters, other.mapping)


def beside_document(spreads: Sequence[SpreadGroup], worst: Sequence[WorstEntry]) -> dict[str, Any]:
    """Spreads and searches as plain values in SI units."""
    return {
        "spreads": [
            {
                "conditions": plain(group.conditions),
                "difference": group.difference,
                "entries": [_spread(entry) for entry in group.entries],
            }
            for group in spreads
        ],
        "robustness": [_worst(entry) for entry in worst],
    }


def _spread(entry: SpreadEntry) -> dict[str, Any]:
    spread = entry.spread
    return {
        "name": entry.name,
        "folder": None if entry.folder is None else str(entry.folder),
        "sha256": spread.controller.sha256,
        "seeds": [score.seed for score in spread.seeds],
        **{name: plain(getattr(spread, name)) for name in ("cost", "criteria", "requirements", "unfinished")},
        "paired": plain(entry.paired),
    }


def _worst(entry: WorstEntry) -> dict[str, Any]:
    found, card = entry.found, entry.scorecard
    return {
        "name": entry.name,
        "folder": None if entry.folder is None else str(entry.folder),
        "sha256": found.controller.sha256,
        "scorecard": None if card is None else {"name": card.name, "conditions": entry.conditions, "cost": entry.V},
        "simulations": found.simulations,
        "cost": found.cost,
        "largest": {name: each.worst_case.value for name, each in found.criteria.items()},
        "broken": list(found.broken),
        "margins": {name: margin.value for name, margin in found.margins.items()},
        "radius": plain(found.radius),
    }
