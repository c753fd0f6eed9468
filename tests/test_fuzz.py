"""A smaller run of ``benchmarks/fuzz.py``: nothing that is mutated ends in a traceback or is taken for sense."""

from __future__ import annotations

from benchmarks.fuzz import fuzz


def test_mutations_are_refused_or_make_sense():
    outcomes, problems = fuzz(seed=1, messages=1000, results=40, recordings=40)
    assert problems == []
    for counted in outcomes.values():
        assert counted["refused"] > 0 and counted["accepted"] > 0
