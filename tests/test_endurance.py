"""Many simulations in one go leave nothing behind: no memory, no descriptors, no files, no processes."""

from __future__ import annotations

import sys

import psutil
import pytest

from benchmarks.execution import endure
from orchestrator.cosim.archive import open_archive
from orchestrator.execution.evaluation import Bench

NUMBER = 300


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="counts descriptors")
def test_many_simulations_leave_nothing_behind(plant_file, pid_file):
    """Scaled down; 10,000 are run by ``benchmarks/execution.py --endurance 10000``, with figures in docs/running.md."""
    bench = Bench(open_archive(plant_file), open_archive(pid_file), timeout=6000.0)
    before = descendants()
    found = endure(bench, NUMBER, workers=2)
    first, last = found[1], found[-1]
    assert last.simulations == NUMBER
    assert last.parent < first.parent + 10.0  # MB
    assert last.children < first.children + 20.0
    assert last.descriptors <= first.descriptors + 8  # as many children may be alive in the one moment as in the other
    assert last.files <= first.files + 4
    assert len(descendants() - before) <= 2  # multiprocessing's fork server and resource tracker


def descendants() -> set[psutil.Process]:
    """All processes that come from this one; other tests may have left a browser or a fork server."""
    return set(psutil.Process().children(recursive=True))
