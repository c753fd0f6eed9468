"""The study says what was measured, and the order of the leaderboard holds on draws that no tuning has seen."""

import json

import pytest

from benchmarks import study
from benchmarks.claims import name_of
from benchmarks.leaderboard_tables import PAGES, standing

KEPT = json.loads(study.DATA.read_text(encoding="utf-8"))


def test_the_tables_show_the_figures_that_are_kept():
    text = study.PAGE.read_text(encoding="utf-8")
    assert study.page(text, KEPT) == text, "python benchmarks/study.py --table mends it"


def test_every_controller_of_the_leaderboard_has_the_same_draws():
    assert KEPT["draws"].keys() == PAGES.keys()
    assert {own["draws"] for own in (*KEPT["draws"].values(), *KEPT["corners"].values())} == {study.DRAWS}


def test_the_samples_are_of_the_controllers_on_the_leaderboard():
    """Else ``python benchmarks/study.py NAME`` measures one anew."""
    cases = {name_of(each): each["cases"] for each in study.leaderboard()}
    assert {name: own["cases"] for name, own in KEPT["draws"].items()} == cases
    assert {name: own["cases"] for name, own in KEPT["corners"].items()}.items() <= cases.items()


def test_what_was_not_measured_is_shown_as_missing():
    (row,) = (line for line in study.table({**KEPT, "corners": {}}).splitlines() if line.startswith("| TunedPID"))
    assert row.count(f" {study.MISSING} ") == 4
    part = {"draws": 12_000, "requirements": {"A2": {"failures": 3, "bound": 0.00085}}}
    last = study.table({**KEPT, "many_corners": dict.fromkeys(KEPT["many"], part)}).splitlines()[-1]
    assert "| 12000 | — 3 — | 0.085 % |" in last and last.endswith("| — |")


def test_a_sample_of_another_version_of_the_benchmark_says_so():
    older = {**KEPT["draws"]["TunedPID"], "benchmark": "FlexibleManipulator-v3"}
    assert study.dated("TunedPID", older) == "TunedPID, v3"
    assert study.dated("TunedPID", {**older, "benchmark": study.searched()[0]["benchmark"]}) == "TunedPID"
    for name, own in KEPT["draws"].items():
        assert f"| {study.dated(name, own)} | 300 |" in study.table(KEPT)
    for name, own in KEPT["many"].items():
        assert f"| {study.dated(name, own)} | {own['draws']} |" in study.tail_table(KEPT)


def test_the_order_of_the_leaderboard_holds_for_draws_that_no_tuning_has_seen():
    """In each of the two groups: those that a search broke stand behind the others."""
    medians = [KEPT["draws"][name]["median"]["V"] for name in study.ordered()]
    holding = sum(not standing(each)[0] for each in study.leaderboard())
    for group in (medians[:holding], medians[holding:]):
        assert len(group) > 1 and group == sorted(group)


@pytest.mark.parametrize("name", KEPT["many"])
def test_no_draw_of_a_larger_sample_fails_and_it_bounds_the_probability_that_the_study_states(name):
    """0.1 % at 99 % confidence; else ``python benchmarks/study.py NAME --probability`` measures it anew."""
    many = KEPT["many"][name]
    assert many["cases"] == KEPT["draws"][name]["cases"] and len(many["V"]) == many["draws"]
    assert [entry["failures"] for entry in many["requirements"].values()] == [0, 0, 0]
    assert max(entry["bound"] for entry in many["requirements"].values()) <= study.PROBABILITY
