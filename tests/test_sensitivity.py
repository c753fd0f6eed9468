"""The table of docs/robustness.md says what was measured, and its conditions change what they say."""

import json
from dataclasses import replace
from fractions import Fraction

import pytest

from benchmarks import leaderboard, sensitivity
from benchmarks.claims import name_of
from benchmarks.leaderboard_tables import PAGES
from benchmarks.marked_tables import with_table

KEPT = json.loads(sensitivity.FIGURES.read_text(encoding="utf-8"))
RANKED = {name_of(each): each for each in json.loads(leaderboard.FIGURES.read_text(encoding="utf-8"))}


def test_the_table_shows_the_figures_that_are_kept():
    text = sensitivity.PAGE.read_text(encoding="utf-8")
    made = with_table(text, sensitivity.table(KEPT), sensitivity.MAKER)
    assert made == text, "python benchmarks/sensitivity.py --table mends it"


def test_all_controllers_of_the_leaderboard_are_there_in_the_same_cases():
    assert set(KEPT) == set(PAGES)
    assert {own["protocol"] for own in KEPT.values()} == {sensitivity.BENCH.rules.name}
    versions = {own["benchmark"] for own in KEPT.values()}
    assert versions <= {"FlexibleManipulator-v3", "FlexibleManipulator-v4"}, "``paper`` has the same bits in both"


@pytest.mark.parametrize("name", PAGES)
def test_without_a_change_all_is_as_on_the_leaderboard(name):
    """With the twins in C, too, whose torques are the same up to rounding."""
    own, remedy = KEPT[name]["unchanged"], f"python benchmarks/sensitivity.py {name}"
    assert own["cost"] == pytest.approx(RANKED[name]["cost"], rel=1e-9), remedy
    for requirement, entry in RANKED[name]["stability"].items():
        assert own[requirement] == entry["passed"], remedy


def test_a_condition_changes_one_thing():
    case, T_s = sensitivity.BENCH.case("c07.compliant.delay_2"), Fraction(1, 4000)
    assert case.scenario.drive.delay == (T_s, 7 * T_s)
    drive, sensor = case.scenario.drive, case.scenario.sensor
    wanted = {
        "unchanged": (drive, sensor),
        "delay + 0.25 ms": (replace(drive, delay=(2 * T_s, 8 * T_s)), sensor),
        "dropout 1 %": (replace(drive, dropout=0.01), sensor),
        "dropout 10 %": (replace(drive, dropout=0.1), sensor),
        "jitter 0.125 ms": (drive, replace(sensor, jitter=T_s / 2)),
    }
    assert wanted.keys() == sensitivity.CONDITIONS.keys()
    for name, (changed_drive, changed_sensor) in wanted.items():
        expected = replace(case.scenario, drive=changed_drive, sensor=changed_sensor)
        assert sensitivity.CONDITIONS[name](case) == replace(case, scenario=expected)


def test_a_cell_has_v_and_what_does_not_hold():
    figures = {"cost": 81.25, "A1": True, "A2": False, "A3": None}
    assert sensitivity._cell(figures) == "81.2, A2 fails, A3 is not judged"
    assert sensitivity._cell(dict.fromkeys(("A1", "A2", "A3"), True) | {"cost": None}) == "none"
