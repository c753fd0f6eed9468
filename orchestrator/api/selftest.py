"""Whether this machine gives the published bits."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from build_fmus import find_compiler

from ..benchmark.bits import CASES, PAIRS, BitComparison, Pair, hash_of, published, short_case
from ..pairing.built_in import built_in
from ..pairing.controller import Controller
from ..pairing.pairing import simulate
from ..pairing.testbed import Testbed, available_cores


def selftest() -> BitComparison:
    """Simulate the loops of :mod:`~orchestrator.benchmark.bits` and compare their hashes with the published ones.

    What needs a C compiler is skipped where there is none.
    """
    compiler = find_compiler() is not None
    here = [pair for pair in PAIRS if compiler or not pair.compiler]
    skipped = tuple(pair.name for pair in PAIRS if pair not in here)
    tasks = [(pair, id) for pair in here for id in CASES]
    for pair in here:  # built before threads ask for it
        built_in(pair.plant)
        built_in(pair.controller)
    # Threads: each waits for a process of its own, which does the work.
    with ThreadPoolExecutor(available_cores()) as pool:
        hashes = list(pool.map(lambda task: _hash(*task), tasks))
    return BitComparison(
        {f"{pair.name}/{id}": value for (pair, id), value in zip(tasks, hashes, strict=True)}, published(), skipped
    )


def _hash(pair: Pair, id: str) -> str:
    testbed = Testbed(plant=built_in(pair.plant))
    pairing, case = testbed.sampled(Controller.built_in(pair.controller), short_case(id))
    return hash_of(simulate(pairing, case.scenario))
