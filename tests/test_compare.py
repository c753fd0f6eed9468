"""Several runs side by side: ranks, groups that must not be ranked together, and why."""

from __future__ import annotations

import json

import pytest
from reports import TABLE_2, evaluation, stored
from results import everything
from rich.console import Console

from orchestrator.compare import main
from orchestrator.cosim.controller import Setup
from orchestrator.report.comparison import compare, comparison_document
from orchestrator.report.leaderboard import show_comparison
from orchestrator.report.run import load_run


@pytest.fixture
def make(tmp_path, plant_file, pid_file):
    """Makes a run named ``name`` with B1..B7 of ``factor`` times the paper's."""

    def made(name, factor=1.0, document=None, configurations=range(18), **changes):
        results = everything({key: factor * value for key, value in TABLE_2.items()}, configurations)
        changes.setdefault("setup", Setup({"K": factor}))
        run = stored(tmp_path / name, evaluation(plant_file, pid_file, results, **changes))
        if document:
            contents = {**run.document, **document}
            (run.folder / "results.json").write_text(json.dumps(contents))
        return run.folder

    return made


def compared(folders, capsys, *options):
    """The comparison of the runs in ``folders`` as plain values."""
    assert main([*map(str, folders), "--json", "--output-dir", str(folders[0].parent / "out"), *options]) == 0
    return json.loads(capsys.readouterr().out)["groups"]


def test_the_lowest_cost_is_first(make, capsys):
    (group,) = compared([make("a", 1.2), make("b", 0.8), make("c", 1.0)], capsys)
    assert [entry["rank"] for entry in group["ranked"]] == [1, 2, 3]
    assert [round(entry["cost"] / 140.71, 2) for entry in group["ranked"]] == [0.8, 1.0, 1.2]
    assert group["unranked"] == [] and group["difference"] == ""


def test_those_that_fail_a_requirement_come_after_those_that_hold_all(make, capsys):
    fails = {"passed": False, "limit_cycle": 1e-3, "rest_error": None, "worst_case": "c00.slippery.delay_2", "axes": {}}
    stability = {name: {**fails, "axes": dict.fromkeys(("1", "2"), fails)} for name in ("A1", "A2", "A3")}
    (group,) = compared([make("cheap", 0.5, {"stability": stability}), make("a", 1.2), make("b", 0.8)], capsys)
    assert [round(entry["cost"] / 140.71, 2) for entry in group["ranked"]] == [0.8, 1.2, 0.5]


def test_the_order_of_plant_parameters_does_not_matter(make, capsys):
    first, second = {"m[1]": 50.0, "m[2]": 140.0}, {"m[2]": 140.0, "m[1]": 50.0}
    groups = compared([make("a", plant_parameters=first), make("b", 0.8, plant_parameters=second)], capsys)
    assert [len(group["ranked"]) for group in groups] == [2]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"benchmark": "FlexibleManipulator-v2"}, "benchmark FlexibleManipulator-v2, not FlexibleManipulator-v1"),
        ({"protocol": "quick"}, "protocol quick, not paper"),
        ({"seed": 3}, "seed 3, not 0"),
        ({"sample_time": {"seconds": 1e-3, "as_in_benchmark": False}}, "sample time 1 ms, not 0.25"),
    ],
)
def test_unequal_conditions_are_not_ranked_together(make, capsys, change, reason):
    groups = compared([make("other", 0.1, change), make("a", 1.2), make("b", 0.8)], capsys)
    assert [len(group["ranked"]) for group in groups] == [2, 1]
    assert groups[1]["difference"] == reason
    assert groups[1]["ranked"][0]["rank"] == 1


def test_a_changed_plant_is_a_condition_too(make, capsys):
    other = make("other", plant_parameters={"m[1]": 60.0})
    groups = compared([make("a"), make("b", 0.8), other], capsys)
    assert groups[1]["difference"] == "plant parameters m[1]=60, not as nominal"


def test_an_incomplete_run_has_no_rank(make, capsys):
    (group,) = compared([make("part", 0.5, configurations=range(3)), make("whole")], capsys)
    assert [entry["name"] for entry in group["ranked"]] == ["DiagonalPID [K=1]"]
    assert group["unranked"][0]["reason"] == "incomplete: not all cases of the protocol were run"


def test_equal_names_are_told_apart_by_their_folders(make, capsys):
    (group,) = compared([make("a"), make("b")], capsys)
    names = [entry["name"] for entry in group["ranked"]]
    assert len(set(names)) == 2 and all("DiagonalPID" in name for name in names)


@pytest.mark.parametrize("width", [50, 80, 200])
def test_terminal_table(make, width):
    groups = compare([load_run(make("a", 1.2)), load_run(make("b", 0.8)), load_run(make("c", 1.0, {"seed": 4}))])
    console = Console(width=width)
    with console.capture() as capture:
        show_comparison(groups, console)
    text = capture.get()
    assert text.index("112.6") < text.index("168.9")
    assert "Not ranked with the above: seed 4, not 0" in " ".join(text.split())
    assert max(map(len, text.splitlines())) <= width
    assert "controller" in text and "1  DiagonalPID" in text
    assert comparison_document(groups)["groups"][1]["conditions"]["seed"] == 4


def test_page_says_the_same(make, capsys):
    folders = [make("a", 1.2), make("b", 0.8), make("c", 1.0, {"protocol": "quick"})]
    compared(folders, capsys)
    html = (folders[0].parent / "out" / "compare.html").read_text(encoding="utf-8")
    assert "Not ranked with the above: protocol quick, not paper." in html
    assert html.index("112.6") < html.index("168.9")
