"""The arms that others found against RobustLQG have the values that the documentation states."""

import json

import pytest

from benchmarks import counterexamples
from orchestrator import Benchmark, Controller

STRICT = Benchmark("strict")
LISTS = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in counterexamples.LISTS.glob("*.json")}


@pytest.mark.parametrize("name", LISTS)
def test_a_list_has_an_arm_within_the_tolerances_for_each_criterion_at_each_pose(name):
    assert set(LISTS[name]) == {"B5", "B6", "B7"}
    for found in LISTS[name].values():
        assert len({tuple(arm["q_a"]) for arm in found}) == len(found) == 22
        assert all(abs(deviation) <= 1.0 for arm in found for deviation in arm["deviations"])


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("criterion", ["B5", "B6", "B7"])
def test_the_worst_arm_of_the_attack_on_this_release_has_the_value_of_its_list(criterion):
    arm = max(LISTS["continued"][criterion], key=lambda each: each["value"])
    controller = Controller.built_in("RobustLQG")
    _, (result,) = counterexamples.simulated(STRICT, controller, [arm], listed=False)
    assert getattr(result.measurements, criterion) == arm["value"]
