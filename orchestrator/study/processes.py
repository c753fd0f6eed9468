"""Which controllers need a process for each simulation, as a study finds out; what is stored remembers it."""

from __future__ import annotations

import hashlib
import logging
from contextlib import suppress
from dataclasses import dataclass, field, replace

from ..errors import InputError
from ..execution.store import Store
from ..fmi.archive import Archive
from ..loop.behaviour import WORDS, CarryOver
from ..pairing.pairing import Pairing
from .requests import Batch

REPEAT_EVERY = 100
"""Simulations of which one is repeated in a fresh process, beside one of the first batch."""

logger = logging.getLogger(__name__)


@dataclass
class Processes:
    """The controllers ``seen`` and the ``carry_over`` of each, by the SHA-256 of its bytes; and how many of its
    simulations shared processes: ``grouped`` in all, ``repeated`` when one was last repeated."""

    carry_over: dict[str, CarryOver] = field(default_factory=dict)
    seen: dict[str, Archive] = field(default_factory=dict)
    grouped: dict[str, int] = field(default_factory=dict)
    repeated: dict[str, int] = field(default_factory=dict)

    def of(self, pairing: Pairing, store: Store) -> Pairing:
        """The ``pairing`` as it has to be run; an earlier run, with results in the ``store``, may have shown that."""
        key = pairing.controller.sha256
        self.seen[key] = pairing.controller
        if key not in self.carry_over and (record := store.get([_key(pairing)])):
            with suppress(ValueError):  # a record that makes no sense is none
                self.carry_over[key] = CarryOver(record[_key(pairing)].decode())
        separate = self.carry_over.get(key, CarryOver.NOT_TESTED).separates and not pairing.isolated
        return replace(pairing, separate=True) if separate else pairing

    def batch(self, batch: Batch, store: Store) -> Batch:
        """The ``batch`` as it has to be run."""
        return replace(
            batch, entries=tuple(replace(entry, pairing=self.of(entry.pairing, store)) for entry in batch.entries)
        )

    def is_due(self, batch: Batch) -> bool:
        """Whether a case of ``batch`` is to be repeated."""
        keys = {entry.pairing.controller.sha256 for entry in batch.entries}
        return any(
            key not in self.repeated or self.grouped.get(key, 0) - self.repeated[key] >= REPEAT_EVERY for key in keys
        )

    def count(self, batch: Batch, repeated: bool) -> None:
        """A ``batch`` has been run."""
        for entry in batch.entries:
            key = entry.pairing.controller.sha256
            if repeated:
                self.repeated[key] = self.grouped.get(key, 0)
            if not entry.pairing.is_separate:
                self.grouped[key] = self.grouped.get(key, 0) + len(entry.cases)

    def take(self, pairing: Pairing, carry_over: CarryOver, store: Store) -> None:
        """What repeating has shown of a pairing's controller, also for a later run that finds the same results.

        Raises :class:`InputError` if results of it have been used already that may be wrong.
        """
        key = pairing.controller.sha256
        if carry_over is CarryOver.NOT_TESTED:
            return
        self.carry_over[key] = carry_over
        if not carry_over.separates:
            return
        store.put(_key(pairing), pairing.controller.name, carry_over.value.encode())
        what = f"{pairing.controller.name}: {WORDS[carry_over]}"
        # They may be in documents that were saved; nothing but beginning anew makes them right.
        if self.grouped.get(key):
            message = f"{what}. This was found after {self.grouped[key]} simulations, whose results may be wrong."
            raise InputError(message, "state-passes", pairing.controller.name)
        logger.warning("%s. Each simulation has a process of its own.", what)


def _key(pairing: Pairing) -> str:
    """The key of what is stored of a controller: not that of a case."""
    return hashlib.sha256(f"carry-over {pairing.controller.sha256} {pairing.controller.library}".encode()).hexdigest()
