"""The README's leaderboard and the controllers' pages say what the figures say that were measured."""

from __future__ import annotations

import hashlib
import json
import re

import pytest
from support.pid_fmus import built
from support.tools import require

import build_fmus
from benchmarks import leaderboard
from benchmarks import leaderboard_tables as tables
from benchmarks.claims import best_known, known, name_of
from orchestrator.fmi.archive import read_description

KEPT = json.loads(leaderboard.FIGURES.read_text(encoding="utf-8"))


def test_all_tables_show_the_figures_that_are_kept():
    for file, text in tables.pages(KEPT).items():
        assert file.read_text(encoding="utf-8") == text, f"python benchmarks/leaderboard.py --table mends {file}"


def test_its_controllers_are_built_and_have_a_page():
    assert set(tables.PAGES) <= set(build_fmus.NAMES)
    assert {name_of(figures) for figures in KEPT} == set(tables.PAGES)


@pytest.mark.parametrize("name", tables.PAGES)
def test_each_row_links_its_page_its_animation_and_its_commands(name):
    (row,) = (line for line in tables.leaderboard(best_known(KEPT)).splitlines() if line.startswith(f"| [{name}]"))
    links = [tables.BOARD.parent / link.split("#")[0] for link in re.findall(r"\]\(([^)]*)\)", row)]
    assert len(links) == 3 and all(link.is_file() for link in links)
    assert tables.animation(name) in links and tables.animation(name).stat().st_size < 2e5


@pytest.mark.parametrize("figures", KEPT, ids=name_of)
def test_the_figures_were_measured_with_the_fmus_there_are(figures, plant_file, fmu_folder):
    """The GUID is a hash of an FMU's contents, sources in the place of binaries."""
    name = name_of(figures)
    if name.startswith("Robust"):
        require("compiler")
    description = read_description(built(name, fmu_folder))
    assert description.guid == figures["guid"], "run benchmarks/leaderboard.py"
    assert hashlib.sha256(plant_file.read_bytes()).hexdigest() == figures["plant"], "run benchmarks/leaderboard.py"


@pytest.mark.parametrize("name", ["ManipulatorLQG", "DitheredLQG", "RobustLQG"])
def test_the_model_based_controllers_meet_the_papers_target_in_its_sample(name):
    (figures,) = (figures for figures in KEPT if name_of(figures) == name)
    assert figures["cost"] < 100.0
    assert all(requirement["passed"] for requirement in figures["stability"].values())


def test_what_meets_the_target_was_searched_with_the_larger_budget():
    """Else what the own search says of all systems would rest on the shorter of the searches."""
    found = {name_of(each): each["robustness"] for each in KEPT}
    meeting = {name for name, each in found.items() if leaderboard.meets(each)}
    budgets = {each["budget"] for each in found.values()}
    assert len(budgets) == len(leaderboard.BUDGETS)
    assert meeting == {"RobustLQG"} == {name for name, each in found.items() if each["budget"] == max(budgets)}
    own = found["RobustLQG"]
    assert not leaderboard.meets({**own, "radius": {**own["radius"], "cost": 0.0}})
    assert not leaderboard.meets({**own, "requirements": {"A1": {"passed": False}}})
    assert leaderboard.meets({**own, "radius": {**own["radius"], "cost": None}})


@pytest.mark.parametrize("figures", KEPT, ids=name_of)
def test_three_starts_of_the_search_agree(figures):
    starts = figures["robustness"]["starts"]
    assert len(starts) == leaderboard.STARTS and max(starts) <= figures["robustness"]["cost"]
    assert leaderboard.agree(starts)


@pytest.mark.parametrize("figures", KEPT, ids=name_of)
def test_what_fails_within_the_tolerances_has_a_radius_of_at_most_one(figures):
    found = figures["robustness"]
    if not all(entry["passed"] for entry in found["requirements"].values()):
        assert found["radius"]["stability"] <= 1.0


def test_those_that_were_found_to_fail_come_last():
    (tuned,) = (figures for figures in KEPT if name_of(figures) == "TunedPID")

    def figures(name, cost, passed=True):
        found = {**tuned["robustness"], "cost": cost, "requirements": {"A1": {"passed": passed}}}
        return known({**tuned, "controller": {"file": f"{name}.fmu"}, "robustness": found}, ())

    kept = [figures("TunedPID", 110.0), figures("DiagonalPID", 50.0, False), figures("ManipulatorLQG", 90.0)]
    lines = tables.leaderboard(kept).splitlines()[2:]
    assert [line.split("]")[0][3:] for line in lines] == ["ManipulatorLQG", "TunedPID", "DiagonalPID"]
