"""The README's leaderboard and the controllers' pages say what the figures say that were measured."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import build_fmus
from benchmarks import leaderboard
from build_fmus import build
from orchestrator.cosim.archive import read_description

ROOT = Path(__file__).resolve().parents[1]
KEPT = json.loads(leaderboard.FIGURES.read_text(encoding="utf-8"))


def test_all_tables_show_the_figures_that_are_kept():
    for file, text in leaderboard.pages(KEPT).items():
        assert file.read_text(encoding="utf-8") == text, f"python benchmarks/leaderboard.py --table mends {file}"


def test_its_controllers_are_built_and_have_a_page():
    assert set(leaderboard.PAGES) <= set(build_fmus.NAMES)
    assert {leaderboard.name_of(figures) for figures in KEPT} == set(leaderboard.PAGES)


@pytest.mark.parametrize("figures", KEPT, ids=leaderboard.name_of)
def test_the_figures_were_measured_with_the_controllers_there_are(figures, tmp_path):
    """The GUID is a hash of an FMU's contents."""
    description = read_description(build(leaderboard.name_of(figures), tmp_path))
    if description.generationTool != figures["controller"]["generation_tool"]:
        pytest.skip(f"measured with an FMU by {figures['controller']['generation_tool']}")
    assert description.guid == figures["guid"], "run benchmarks/leaderboard.py"


@pytest.mark.parametrize(("name", "most"), [("ManipulatorLQG", 95.0), ("DitheredLQG", 80.0)])
def test_the_model_based_controllers_reach_what_was_wanted(name, most):
    (figures,) = (figures for figures in KEPT if leaderboard.name_of(figures) == name)
    assert figures["cost"] <= most
    assert all(requirement["passed"] for requirement in figures["stability"].values())


def test_those_that_fail_a_requirement_come_last():
    def figures(name, cost, passed=True):
        row = {key: {"passed": passed, "worst_case": None} for key in ("A1", "A2", "A3")}
        criteria = {f"B{i}": {"value": 1.0, "unit": "s", "share": 1.0} for i in range(1, 8)}
        return {"controller": {"file": f"{name}.fmu"}, "cost": cost, "stability": row, "criteria": criteria}

    kept = [figures("TunedPID", 110.0), figures("DiagonalPID", 50.0, False), figures("ManipulatorLQG", 90.0)]
    lines = leaderboard.leaderboard(kept).splitlines()[2:]
    assert [line.split("]")[0][3:] for line in lines] == ["ManipulatorLQG", "TunedPID", "DiagonalPID"]
