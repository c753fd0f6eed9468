"""Smaller runs of scripts in ``benchmarks``: simulations leave nothing behind, mutations end in no traceback."""

import tempfile

import pytest

from benchmarks import wrong_inputs
from benchmarks.execution import endure
from benchmarks.fuzz import fuzz
from orchestrator.fmi.archive import open_archive
from orchestrator.pairing.pairing import Pairing


@pytest.mark.slow
@pytest.mark.needs("posix")  # counts descriptors
def test_many_simulations_leave_nothing_behind(plant_file, pid_file, tmp_path, monkeypatch):
    """Scaled down; 10,000 are run by ``benchmarks/execution.py --endurance 10000``, with figures in docs/running.md."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))  # others use the usual one, too
    bench = Pairing(open_archive(plant_file), open_archive(pid_file), timeout=6000.0)
    found = endure(bench, 200, workers=2)
    first, last = found[1], found[-1]
    assert last.simulations == 200
    assert last.parent < first.parent + 10.0  # MB
    assert last.workers < first.workers + 20.0
    assert last.descriptors <= first.descriptors + 8  # as many workers may be alive in the one moment as in the other
    assert last.files <= first.files
    assert last.processes <= first.processes + 2


@pytest.mark.slow
def test_mutations_are_refused_or_make_sense():
    outcomes, problems = fuzz(seed=1, messages=1000, answers=1000, results=40, recordings=40, certificates=150)
    assert problems == []
    for counted in outcomes.values():
        assert counted["refused"] > 0 and counted["accepted"] > 0


def test_wrong_inputs_end_without_a_traceback():
    """A few of each kind; `python benchmarks/wrong_inputs.py` tries 1,000."""
    outcomes, problems = wrong_inputs.count(seed=2, each=15)
    assert problems == [] and all(counted.total() == 15 for counted in outcomes.values())
    assert all(counted["exit code 2"] >= 5 for counted in outcomes.values())
