"""The arms that others found have the values that the documentation states."""

import pytest

from benchmarks import counterexamples
from orchestrator import Benchmark, Controller
from orchestrator.search.arms import lists

STRICT = Benchmark("strict")
LISTS = {name: each for name, each in lists().items() if name != "failing"}

POSES = {"genetic": 22, "continued": 22}
"""Of the lists that are older than version 4 of the benchmark."""

ATTACKED = {"continued": "RobustLQG", "lasting": "SteadyLQG"}
"""The controllers of which a list was made, where they are still what they were in the cases of the list."""


@pytest.mark.parametrize("name", LISTS)
def test_a_list_has_an_arm_within_the_tolerances_for_each_criterion_at_each_pose(name):
    assert set(LISTS[name]) == {"B5", "B6", "B7"}
    for found in LISTS[name].values():
        assert len({tuple(arm["q_a"]) for arm in found}) == len(found) == POSES.get(name, 25)
        assert all(abs(deviation) <= 1.0 for arm in found for deviation in arm["deviations"])


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("criterion", ["B5", "B6", "B7"])
@pytest.mark.parametrize("name", ATTACKED)
def test_the_worst_arm_of_an_attack_has_the_value_of_its_list(name, criterion):
    arm = max(LISTS[name][criterion], key=lambda each: each["value"])
    _, (result,) = counterexamples.simulated(STRICT, Controller.built_in(ATTACKED[name]), [arm], listed=False)
    assert getattr(result.measurements, criterion) == arm["value"]
