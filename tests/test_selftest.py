"""The published bits, and the command that compares this machine's with them.

``REFRESH=bits python -m pytest tests/test_selftest.py`` writes them anew, where there is a C compiler.
"""

import json
import os
from dataclasses import replace

import numpy as np
import pytest
from support.closed_loops import simulate_all

from orchestrator.api import checking as api
from orchestrator.benchmark import bits
from orchestrator.benchmark.bits import CASES, PAIRS, BitComparison
from orchestrator.cli import main
from orchestrator.loop.scenario import Scenario


@pytest.fixture(scope="module")
def here():
    """What this machine finds."""
    found = api.selftest()
    if os.environ.get("REFRESH") == "bits" and not found.skipped:
        bits.publish(found.hashes)
        return replace(found, published=bits.published())
    return found


def test_this_machine_gives_the_published_bits(here):
    assert here.equal, here.differing


@pytest.mark.needs("compiler")
def test_every_pair_and_case_is_published(here):
    assert not here.skipped
    assert list(bits.published()) == list(here.hashes) == [f"{pair.name}/{case}" for pair in PAIRS for case in CASES]


def test_c_and_python_have_one_trajectory():
    published = bits.published()
    for case in CASES:
        assert published[f"{PAIRS[0].name}/{case}"] == published[f"{PAIRS[1].name}/{case}"]
    assert len(set(published.values())) == 3 * len(CASES)


def test_every_test_and_disturbance_is_there():
    cases = [bits.short_case(id) for id in CASES]
    assert {case.test.name for case in cases} == {test.name for test in bits.load("paper").tests}
    assert sum(case.scenario.chirp.stop > 0.0 for case in cases) == len(cases) - 1
    for case in cases:
        assert case.scenario.chirp.stop < case.scenario.duration and case.scenario.sensor.noise.sigma > 0.0


def test_a_last_bit_changes_the_hash(quick_plant_file, quick_pid_file):
    scenario: Scenario = replace(bits.short_case(CASES[1]).scenario, duration=bits.DURATION / 50)
    (trajectory,) = simulate_all(quick_plant_file, quick_pid_file, [scenario])
    hashes = {bits.hash_of(trajectory)}
    for signal in bits.SIGNALS:
        changed = np.array(getattr(trajectory, signal))
        changed[7, 1] = np.nextafter(changed[7, 1], np.inf)
        hashes.add(bits.hash_of(replace(trajectory, **{signal: changed})))
    assert len(hashes) == 1 + len(bits.SIGNALS)


def test_what_differs_is_told(monkeypatch, capsys):
    other = BitComparison({"a/x": "1", "a/y": "2"}, {"a/x": "1", "a/y": "3"}, ("b",))
    monkeypatch.setattr(api, "selftest", lambda: other)
    assert main.main(["selftest"]) == 1
    told = capsys.readouterr().out
    assert "skipped b: there is no C compiler" in told and "differs a/y" in told and "1 of 2" in told
    assert main.main(["selftest", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert (document["equal"], document["differing"], document["skipped"]) == (False, ["a/y"], ["b"])


def test_without_a_compiler_the_rest_is_skipped(monkeypatch):
    monkeypatch.setattr(api, "find_compiler", lambda: None)
    monkeypatch.setattr(api, "_hash", lambda pair, id: bits.published()[f"{pair.name}/{id}"])
    found = api.selftest()
    assert set(found.skipped) == {pair.name for pair in PAIRS[1:]} and len(found.hashes) == len(CASES)
    assert found.equal
