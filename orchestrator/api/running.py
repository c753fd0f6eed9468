"""Running cases: those in the store are found there, the others are simulated and stored as they come."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass

from ..benchmark.case import Case
from ..benchmark.protocol import Protocol
from ..execution.store import Store
from . import stored
from .campaign import Bench, CaseRun, Execute, run_cases

logger = logging.getLogger(__name__)

OnRun = Callable[[CaseRun, int, int], None]
"""Is told each run as it comes, how many there are, and how many there will be."""


@dataclass(frozen=True)
class Runner:
    """What runs cases of one bench: ``execute`` on this machine or a cluster, ``known`` keeps what is finished.

    Failures of an earlier run count unless ``keep_going``.
    """

    protocol: Protocol
    bench: Bench
    execute: Execute
    known: Store
    keep_going: bool = False

    def run(
        self, cases: Sequence[Case], at_once: CaseRun | None = None, force: bool = False, on_run: OnRun | None = None
    ) -> list[CaseRun]:
        """Runs of all ``cases`` in their order; see :func:`.campaign.run_cases` for failures ``at_once``."""
        keys = stored.keys(self.protocol, cases, self.bench)
        if force:
            self.known.forget(keys)
        found = stored.load(self.known, keys, self.protocol, cases, self.bench, not self.keep_going)
        if found and on_run is not None:
            logger.info(
                "%d of %d cases are there from an earlier run", len(found), len(cases), extra={"what": "stored"}
            )
            for done, run in enumerate(found.values(), start=1):
                on_run(run, done, len(cases))
        waiting = [number for number in range(len(cases)) if number not in found]
        stream = run_cases(
            self.protocol,
            [cases[number] for number in waiting],
            self.bench,
            self.execute,
            list(found.values()),
            self.keep_going,
            at_once,
        )
        with closing(stream):
            for place, run in stream:
                number = waiting[place]
                stored.keep(self.known, keys[number], run, self.bench)
                found[number] = run
                if on_run is not None:
                    on_run(run, len(found), len(cases))
        return [found[number] for number in range(len(cases))]
