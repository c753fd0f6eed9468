"""Runs of cases in a store: the key that says what a result depends on, and what is kept under it."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Sequence
from typing import Any

from ..benchmark.case import Case, JudgedTest
from ..benchmark.metrics import case_result
from ..benchmark.protocol import JudgingTables, Protocol
from ..benchmark.results import Judgement
from ..cache import computing_code, installed
from ..codec import Malformed, NonNegative, Struct, from_json, to_json
from ..execution.store import Store
from ..fmi.archive import Archive
from ..fmi.host import wine
from ..fmi.library import SOURCE, WINE
from ..loop.trajectory import Status
from ..pairing.pairing import Pairing
from ..pairing.runs import CaseRun
from ..pairing.work import check_judgement

LASTING_STATUSES = (Status.DONE, Status.UNSTABLE)
"""What depends on the key alone; a failure may depend on the restrictions, too: a timeout on the time limit."""


class StoredRun(Struct, frozen=True):
    """A :class:`CaseRun` as it is stored, without its case."""

    judgement: Judgement
    wall_time: NonNegative
    kind: str
    restrictions: str


def keys(protocol: Protocol, cases: Sequence[Case], pairing: Pairing) -> list[str]:
    """For each case, the key of its result: a hash of the FMUs' bytes, their parameters, the scenario, how it is
    judged, and the code that simulates and judges it. It does not depend on which other cases the protocol has."""
    common = [
        protocol.benchmark,
        computing_code(),
        pairing.plant.sha256,
        pairing.controller.sha256,
        sorted(pairing.setup.parameters.items()),
        sorted(pairing.setup.mapping.items()),
        to_json(_seen(protocol, JudgingTables)),
        *_around(pairing.controller),
        *(("sandbox",) if pairing.sandbox else ()),  # what read files outside of one would not do so inside
        *(("separate",) if pairing.separate else ()),  # what came before the state was seen to pass is not used
    ]
    # Everything that a number depends on. A folder list kept by hand once missed the
    # loop's own formulas, and results of older code were taken as new.
    begin = hashlib.sha256(json.dumps(common).encode())

    def key(case: Case) -> str:
        digest = begin.copy()
        # repr of floats is exact, and changes with any field that is added to a scenario.
        digest.update(repr((case.scenario, *_seen(case.test, JudgedTest))).encode())
        return digest.hexdigest()

    return [key(case) for case in cases]


def _around(controller: Archive) -> tuple[str, ...]:
    """What of this machine the numbers of a ``controller`` depend on, by which of its libraries is loaded."""
    if controller.library == WINE:
        return (wine.version(),)
    if controller.library == SOURCE:
        # Binary and sources of one FMU need not be of one law, nor need two compilers give the same numbers.
        return (SOURCE, hashlib.sha256(controller.library_file.read_bytes()).hexdigest())
    # A law in Python may import whatever is installed: one that took a solution from SciPy
    # got the cases of the SciPy before.
    return installed() if controller.is_python else ()


def _seen(of: object, interface: type) -> list[Any]:
    """What of an object those see that are given no more of it than an ``interface``."""
    # Two tables named here by hand would not be all when a measurement read a third.
    return [getattr(of, name) for name, seen in vars(interface).items() if isinstance(seen, property)]


def load(
    store: Store, keys: Sequence[str], protocol: Protocol, cases: Sequence[Case], pairing: Pairing, failures: bool
) -> dict[int, CaseRun]:
    """The stored runs of ``cases`` by number: those that last, and ``failures`` under the same restrictions."""
    records = store.get(keys)
    runs = {}
    for number, (key, case) in enumerate(zip(keys, cases, strict=True)):
        with contextlib.suppress(KeyError, Malformed):  # a record that makes no sense is none
            stored = from_json(records[key], StoredRun)
            # The file lies in the user's folder, and controllers without a sandbox run with the user's rights.
            check_judgement(protocol, case, stored.judgement)
            if stored.judgement.status in LASTING_STATUSES or (
                failures and stored.restrictions == pairing.restrictions
            ):
                runs[number] = CaseRun(case, case_result(case, stored.judgement), stored.wall_time, stored.kind)
    return runs


def keep(store: Store, key: str, run: CaseRun, pairing: Pairing) -> None:
    """Store a run that says something about the controller."""
    if run.result.judged:
        stored = StoredRun(run.result.judgement, run.wall_time, run.kind, pairing.restrictions)
        store.put(key, run.case.id, to_json(stored, indent=None).encode())
