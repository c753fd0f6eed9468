"""Many simulations in one go leave nothing behind: no memory, no descriptors, no files, no processes."""

from __future__ import annotations

import sys
import tempfile

import pytest

from benchmarks.execution import endure
from orchestrator.api.campaign import Bench
from orchestrator.fmi.archive import open_archive


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="counts descriptors")
def test_many_simulations_leave_nothing_behind(plant_file, pid_file, tmp_path, monkeypatch):
    """Scaled down; 10,000 are run by ``benchmarks/execution.py --endurance 10000``, with figures in docs/running.md."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))  # others use the usual one, too
    bench = Bench(open_archive(plant_file), open_archive(pid_file), timeout=6000.0)
    found = endure(bench, 300, workers=2)
    first, last = found[1], found[-1]
    assert last.simulations == 300
    assert last.parent < first.parent + 10.0  # MB
    assert last.workers < first.workers + 20.0
    assert last.descriptors <= first.descriptors + 8  # as many workers may be alive in the one moment as in the other
    assert last.files <= first.files
    assert last.processes <= first.processes + 2
