"""From case results to V and the verdicts."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.results import PAPER, RULES, TABLE_2, everything, result

from orchestrator.benchmark.scorecard import score
from orchestrator.loop.trajectory import Status

ON_TARGET = {name: criterion.target for name, criterion in PAPER.criteria.items()}

ON_TARGET_EVERYWHERE = everything(ON_TARGET)


def scored(results):
    return score(RULES, results)


def changed(results, index, system, test, **changes):
    """``results`` with one case's result replaced by one with ``changes``."""
    other = result(index, system, test, **changes)
    return [other if entry.id == other.id else entry for entry in results]


def verdicts(card):
    return {name: requirement.passed for name, requirement in card.stability.items()}


def test_a_controller_on_target_costs_100_and_holds_all_requirements():
    card = scored(ON_TARGET_EVERYWHERE)
    assert card.cost == pytest.approx(100.0, rel=1e-14)
    assert [entry.cost for entry in card.configurations] == pytest.approx([100.0] * 18, rel=1e-14)
    assert card.complete and verdicts(card) == {"A1": True, "A2": True, "A3": True}
    part = scored([entry for entry in ON_TARGET_EVERYWHERE if entry.configuration.index in (3, 8)])
    assert [entry.index for entry in part.configurations] == [3, 8]
    assert part.cost == pytest.approx(100.0) and not part.complete


def test_table_2_costs_what_the_paper_says():
    card = scored(everything(TABLE_2))
    assert card.cost == pytest.approx(140.7, abs=0.05), "printed there as 141"
    assert round(card.cost) == PAPER.reference["V"]
    assert {name: entry.value for name, entry in card.criteria.items()} == pytest.approx(TABLE_2)
    shares = [entry.share for entry in card.criteria.values()]
    assert shares == pytest.approx([0.73, 0.45, 0.55, 0.91, 36.4, 46.7, 55.0], abs=0.05)


@settings(max_examples=30)
@given(values=st.lists(st.floats(1e-3, 1e3), min_size=7, max_size=7), factor=st.floats(0.1, 10.0), chance=st.randoms())
def test_cost_is_linear_in_every_criterion_and_blind_to_the_order(values, factor, chance):
    given_values = dict(zip(ON_TARGET, values, strict=True))
    one = everything(given_values, range(2))
    other = scored(everything({name: factor * value for name, value in given_values.items()}, range(2)))
    assert other.cost == pytest.approx(factor * scored(one).cost, rel=1e-12)
    assert scored(chance.sample(one, len(one))).cost == scored(one).cost


def test_cost_is_the_mean_over_configurations_of_the_worst_over_systems():
    """Two systems of configuration 4 are worse than the rest, in one criterion each."""
    B5 = {name: ON_TARGET[name] for name in ("B3", "B4", "B5", "B6", "B7")}
    results = changed(ON_TARGET_EVERYWHERE, 4, "random_2", "disturbance", criteria={**B5, "B5": 2 * B5["B5"]})
    results = changed(results, 4, "random_1", "disturbance", criteria={**B5, "B5": 1.5 * B5["B5"], "B6": 6.0})
    card = scored(results)
    assert card.cost == pytest.approx(100 + (25 + 40) / 18)
    assert card.configurations[4].cost == pytest.approx(165.0)
    assert card.configurations[4].relative["B5"] == pytest.approx(2.0)
    B5, B6 = card.criteria["B5"], card.criteria["B6"]
    assert (B5.worst_case.id, B6.worst_case.id) == ("c04.random_2.disturbance", "c04.random_1.disturbance")
    assert (B5.value, B5.worst_case.value) == pytest.approx((7e-3 * (1 + 1 / 18), 14e-3))


@pytest.mark.parametrize(
    ("test", "failing", "axis"),
    [("gain_1", "A1", "1"), ("gain_2", "A1", "2"), ("delay_1", "A2", "1"), ("delay_2", "A2", "2")],
)
def test_a_limit_cycle_fails_its_axis_and_A3(test, failing, axis):
    card = scored(changed(ON_TARGET_EVERYWHERE, 6, "slippery", test, cycle=18e-6))
    assert verdicts(card) == {"A1": failing != "A1", "A2": failing != "A2", "A3": False}
    failed = card.stability[failing]
    assert {name: verdict.passed for name, verdict in failed.axes.items()} == {"1": axis != "1", "2": axis != "2"}
    assert (failed.limit_cycle, failed.worst_case) == (18e-6, f"c06.slippery.{test}")
    assert not card.stability["A3"].axes
    assert card.cost == pytest.approx(100.0), "a requirement is never averaged into V"


@pytest.mark.parametrize(("amplitude", "holds"), [(9.999e-6, True), (10e-6, False)])
def test_the_limit_is_ten_micrometres(amplitude, holds):
    card = scored(changed(ON_TARGET_EVERYWHERE, 0, "sticky", "gain_1", cycle=amplitude))
    assert verdicts(card)["A1"] is holds
    B = {name: ON_TARGET[name] for name in ("B3", "B4", "B5", "B6", "B7")}
    nominal = changed(ON_TARGET_EVERYWHERE, 0, "random_1", "disturbance", criteria=B, cycle=amplitude)
    assert verdicts(scored(nominal)) == {"A1": True, "A2": True, "A3": holds}, "the nominal loop"


@pytest.mark.parametrize("status", [Status.UNSTABLE, Status.CRASHED, Status.TIMEOUT, Status.ERROR])
def test_a_performance_case_without_measurement_leaves_no_cost(status):
    lost = {"criteria": None, "cycle": None, "status": status}
    card = scored(changed(ON_TARGET_EVERYWHERE, 2, "compliant", "disturbance", **lost))
    assert card.cost is None
    assert card.configurations[2].cost is None and card.configurations[3].cost == pytest.approx(100.0)
    assert {name for name, entry in card.criteria.items() if entry.value is not None} == {"B1", "B2"}
    unknown = [entry for name, entry in card.criteria.items() if name not in ("B1", "B2")]
    assert {(entry.share, entry.worst_case.id) for entry in unknown} == {(None, "c02.compliant.disturbance")}
    assert verdicts(card) == {"A1": True, "A2": True, "A3": False}
    assert card.complete is (status is Status.UNSTABLE), "an unstable loop is a verdict, a crash is none"


@pytest.mark.parametrize("status", [Status.UNSTABLE, Status.CRASHED])
def test_a_stability_case_without_measurement_fails_its_requirement(status):
    card = scored(changed(ON_TARGET_EVERYWHERE, 2, "sticky", "delay_2", cycle=None, status=status))
    assert verdicts(card) == {"A1": True, "A2": False, "A3": False}
    assert card.cost == pytest.approx(100.0)
    A2 = card.stability["A2"]
    assert (A2.limit_cycle, A2.worst_case) == (None, "c02.sticky.delay_2")


def test_a_loop_that_does_not_rest_fails_whatever_its_limit_cycle():
    results = changed(ON_TARGET_EVERYWHERE, 2, "sticky", "gain_2", cycle=0.0, status=Status.UNSTABLE)
    assert verdicts(scored(results)) == {"A1": False, "A2": True, "A3": False}


def test_nothing_tried_is_nothing_passed():
    for results in ([], [entry for entry in ON_TARGET_EVERYWHERE if entry.test == "noise"]):
        card = scored(results)
        assert card.cost is None and not card.complete
        assert verdicts(card) == {"A1": None, "A2": None, "A3": None}


def drifted(index, system, test, rest_error, cycle):
    """A case that ends off its place [m], with a limit cycle of ``cycle`` [m]."""
    measured = result(index, system, test, cycle=cycle, status=Status.UNSTABLE)
    return replace(measured, measurements=replace(measured.measurements, rest_error=rest_error))


@pytest.mark.parametrize(
    ("cycle", "worst", "told", "rest_error"),
    [(5e-6, "c00.slippery.gain_1", 0.1e-6, 5e-3), (50e-6, "c02.slippery.gain_1", 50e-6, None)],
    ids=["a case that fails before a larger limit cycle that is allowed", "the largest of those that fail"],
)
def test_the_worst_case_of_a_verdict(cycle, worst, told, rest_error):
    results = changed(ON_TARGET_EVERYWHERE, 2, "slippery", "gain_1", cycle=cycle)
    off = drifted(0, "slippery", "gain_1", 5e-3, 0.1e-6)
    A1 = scored([off if entry.id == off.id else entry for entry in results]).stability["A1"]
    verdict = A1.axes["1"]
    assert (verdict.passed, verdict.worst_case) == (False, worst)
    assert (verdict.limit_cycle, verdict.rest_error) == (told, rest_error)
    assert A1.axes["2"].passed and A1.axes["2"].rest_error is None
