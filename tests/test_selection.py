"""What an evaluation simulates again for its report."""

import pytest
from msgspec.structs import replace
from support.results import PAPER, RULES, TABLE_2, everything, result

from orchestrator.benchmark.cases import cases
from orchestrator.benchmark.results import Measurements
from orchestrator.benchmark.scorecard import score
from orchestrator.loop.trajectory import Status
from orchestrator.pairing.runs import CaseRun
from orchestrator.study.evaluate import shown
from plant_fmu.flexible_manipulator.parameters import NOMINAL

CASES = {case.id: case for case in cases(PAPER, NOMINAL, 0)}
GOOD = everything(TABLE_2)


def chosen(results):
    runs = [CaseRun(CASES[entry.id], entry) for entry in results]
    return shown(PAPER, NOMINAL, 0, runs, score(RULES, results))


def failed(entry, status):
    return replace(entry, status=status, measurements=Measurements())


def test_worst_cases_example_and_spread():
    found = chosen(GOOD)
    roles = [role for entry in found for role in entry.roles]
    assert {f"B{i}" for i in range(1, 8)} <= set(roles)
    assert not {role for role in roles if role.startswith("A")}
    assert roles.count("example") == 1
    assert all(entry.case is CASES[entry.case.id] for entry in found if not {"example", "spread"} & set(entry.roles))
    spread = [entry.case for entry in found if entry.roles == ("spread",)]
    assert len({case.system.name for case in spread}) == len(spread) == 20
    assert {case.configuration for case in spread} == {spread[0].configuration}
    settled = spread[0].scenario.pulse.stop + PAPER.criteria["B6"].target
    assert {float(case.scenario.duration) - settled for case in spread} == {1.0}


def test_a_requirement_that_fails_is_shown_on_its_axis():
    cycling = result(4, "slippery", "delay_2", {}, 2e-5)
    found = chosen([cycling if entry.id == cycling.id else entry for entry in GOOD])
    (entry,) = (entry for entry in found if "A2 2" in entry.roles)
    assert entry.case.id == cycling.id
    assert set(entry.roles) == {"A2 2", "A3"}


def test_a_short_evaluation_has_a_short_spread():
    assert sum("spread" in entry.roles for entry in chosen(everything(TABLE_2, [0]))) == 3


@pytest.mark.parametrize("status", [Status.TIMEOUT, Status.CRASHED, Status.SKIPPED])
def test_what_would_hang_or_crash_again_is_left_out(status):
    assert GOOD[0].id not in {entry.case.id for entry in chosen([failed(GOOD[0], status), *GOOD[1:]])}


def test_nothing_unknown_is_tried_where_something_hung_or_nothing_ended():
    roles = {role for entry in chosen([failed(GOOD[0], Status.TIMEOUT), *GOOD[1:]]) for role in entry.roles}
    assert "B5" in roles and not {"example", "spread"} & roles
    assert chosen([failed(entry, Status.CRASHED) for entry in GOOD]) == []
    assert chosen([]) == []
