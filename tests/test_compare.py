"""Documents of any kind side by side: ranks, groups that must not be ranked together, and why."""

import json

import numpy as np
import pytest
from msgspec.structs import replace
from support.reports import (
    RECORDINGS,
    hunted,
    recording,
    results_of,
    sampled,
    scaled,
    searched,
    seeded,
    swept,
    tuned,
    verified,
)
from support.results import RULES, TABLE_2, everything, result

import orchestrator
from orchestrator.benchmark.results import CaseResult
from orchestrator.codec import plain
from orchestrator.documents import compare_page
from orchestrator.documents.comparison import Comparison, Group, grouped
from orchestrator.documents.evaluation import Evaluation
from orchestrator.documents.head import SampleTimeRecord
from orchestrator.documents.results import Results
from orchestrator.documents.spread import spread_of
from orchestrator.loop.trajectory import Status
from orchestrator.views.page import page_html
from orchestrator.views.table import Value, VerdictCell
from orchestrator.views.units import NONE

CYCLING = result(0, "slippery", "delay_2", {}, 1e-3)
LOST = result(0, "compliant", "disturbance", status=Status.UNSTABLE)


def results_with(other: CaseResult, factor: float = 1.0, **changes) -> Results:
    """Results in which one case is another."""
    return results_of([other if case.id == other.id else case for case in scaled(factor).cases], **changes)


def compared(*listed) -> Comparison:
    """Results, or documents of other kinds, side by side."""
    return grouped([(Evaluation(each) if isinstance(each, Results) else each, None) for each in listed])


def costs(group: Group) -> list[float]:
    """V of the ranked documents, relative to that of Table 2."""
    return [round(entry.cost / 140.7324, 2) for entry in group.ranked]


def shown(group: Group, column: str) -> list:
    """The cells of a column of a group's table."""
    place = [each.name for each in group.table().columns].index(column)
    return [row[place] for row in group.table().rows]


def test_the_lowest_cost_is_first_and_those_that_fail_a_requirement_come_last():
    (group,) = compared(scaled(1.2), scaled(0.8), results_with(CYCLING, 0.5), scaled(1.0))
    assert costs(group) == [0.8, 1.0, 1.2, 0.5]
    assert group.unranked == () and group.difference == ""
    assert shown(group, "rank") == ["1", "2", "3", "4"]
    assert [cell.passed for cell in shown(group, "A2 axis 2")] == [True, True, True, False]
    assert [row[1:3] for row in group.table().footer] == [("target", 100.0), ("paper's PID", 141.0)]
    parameters = {"m[1]": 50.0, "m[2]": 140.0}
    swapped = dict(reversed(parameters.items()))
    (group,) = compared(*(scaled(1, plant={"parameters": given}) for given in (parameters, swapped)))
    assert len(group.ranked) == 2, "whatever their order"


def test_bold_is_explained_only_where_something_is_bold():
    (group,) = compared(results_with(CYCLING, 0.5), results_with(CYCLING, 0.7))
    assert group.table().caption == "", "both fail a requirement"
    (group,) = compared(scaled(1.2), scaled(0.8))
    assert group.table().caption.startswith("Bold")


OTHER_LIMIT = replace(RULES, stability=replace(RULES.stability, limit_cycle=2e-5))
UNLIKE = [
    ({"benchmark": "Other-v2"}, "benchmark", "benchmark Other-v2, not benchmark FlexibleManipulator-v4"),
    ({"protocol": "quick"}, "protocol", "protocol quick, not protocol paper"),
    ({"seed": 3}, "seed", "seed 3, not seed 0"),
    ({"sample_time": SampleTimeRecord(1e-3, False)}, "sample_time", "sample time 1 ms, not sample time 0.25 ms"),
    ({"plant": {"model": "b2" * 32}}, "plant", "plant of contents b2b2b2b2b2b2..., not plant of contents a1a1"),
    ({"plant": {"parameters": {"m[1]": 60.0}}}, "plant_parameters", "plant parameters m[1]=60, not plant"),
    ({"rules": OTHER_LIMIT}, "rules", "other rules (stability)"),
]


@pytest.mark.parametrize(("change", "field", "reason"), UNLIKE)
def test_unequal_conditions_are_not_ranked_together(change, field, reason):
    first, second = compared(scaled(0.1, **change), scaled(1.2), scaled(0.8))
    assert (len(first.ranked), len(second.ranked)) == (2, 1)
    assert second.difference.startswith(reason)
    assert second.notes[0].startswith(f"Not ranked with the above: {reason}")
    assert getattr(second.conditions, field) != getattr(first.conditions, field)
    own = replace(searched(), head=scaled(0.1, **change).head)
    assert [len(group.ranked) for group in compared(own, searched(), searched())] == [2, 1], "of any kind"


def test_an_incomplete_run_has_no_rank_and_values_are_in_si_units():
    crashed = replace(CYCLING, status=Status.CRASHED)
    groups = compared(scaled(0.5, configurations=range(3)), scaled(1), results_with(crashed), results_with(LOST))
    assert [entry.name for entry in groups[0].ranked] == ["PID [K=1]"]
    assert [why.removeprefix("incomplete: ") for _, why in groups[0].unranked] == [
        *("not all cases of the protocol were run", "1 crashed"),
        "1 of the cases that B1 to B7 are measured in are unstable",
    ]
    assert shown(groups[0], "rank") == ["1", "-", "-", "-"]
    (told,) = json.loads(json.dumps(groups.document(), allow_nan=False))["groups"]
    assert told["conditions"]["sample_time"] == 0.25e-3
    assert [entry["complete"] for entry in (*told["ranked"], *told["unranked"])] == [True, False, False, True]
    verdicts = dict.fromkeys(["A1 axis 1", "A1 axis 2", "A2 axis 1", "A2 axis 2", "A3"], True)
    assert {"B5": pytest.approx(10.2e-3), **verdicts}.items() <= told["ranked"][0]["figures"].items()


@pytest.mark.parametrize("folders", [True, False])
def test_equal_names_are_told_apart(folders):
    (group,) = grouped([(Evaluation(scaled(1)), f"runs/{number}" if folders else None) for number in range(2)])
    names = [entry.name for entry in group.ranked]
    assert len(set(names)) == 2 and all("PID [K=1]" in name for name in names)


def test_page_says_the_same():
    recordings = (*RECORDINGS, recording(("B7",), "c03.random_2.disturbance"))
    runs = Evaluation(results_with(CYCLING), recordings), scaled(0.8), scaled(1.0, protocol="quick")
    groups = compared(*runs)
    html = page_html(groups.page())
    assert "Not ranked with the above: protocol quick, not protocol paper." in html
    for text in (html, str(groups[1].notes)):
        assert "depends on the seed" in text and "depends on the seed" not in str(groups[0].notes)
    assert html.index("112.6") < html.index("140.7")
    assert html.count("paper&#39;s PID</th>") == 2
    assert "simulate &#39;my controllers/PID.fmu&#39; --case c03.random_2.disturbance" in html


def test_controllers_are_paired_by_seed_with_the_first():
    first, other = seeded(1.0, range(4)), seeded(0.9, range(2, 8))
    unlike = replace(seeded(1.0, [1]), head=replace(first.head, protocol="quick"))
    groups = compared(first, other, unlike)
    assert [len(group.entries) for group in groups] == [2, 1] and "protocol quick" in groups[1].difference
    V = [[score.cost for score in spread.seeds if score.seed in (2, 3)] for spread in (other, first)]
    differences = np.subtract(*V)
    words = f"{np.mean(differences):.3g} ± {np.std(differences, ddof=1):.3g}, better with 2 of 2 seeds"
    assert shown(groups[0], "V minus that of the first") == [words, "-"], "the best is first, the first the other one"
    assert shown(groups[0], "V")[1] == Value(first.cost.mean, first.cost.deviation)
    assert shown(groups[0], "A2") == [VerdictCell(True, "6/6"), VerdictCell(True, "4/4")]
    runs = scaled(1.5, seed=3), results_with(LOST, seed=7)
    lost = spread_of([3, 7], runs, seeded(1.5, []).head)
    (group,) = compared(seeded(1.0, [3, 7]), lost)
    assert shown(group, "V minus that of the first") == ["-", "- ± -, better with 0 of 2 seeds"], "worse than any V"
    assert "unstable" in group.notes[0]


def test_a_search_stands_beside_the_scorecards_of_the_same_controller_under_its_conditions():
    cards = scaled(1.0), scaled(1.2), seeded(1.2, range(3))
    others = searched(1.2, sha256="d0" * 32), searched(1.2, mapping={"u_m": "u"}), searched(1.3)
    *_, group = compared(*cards, searched(1.2), *others)
    assert group.kind == "Worst cases found, beside the scorecards"
    told = list(zip((entry.document for entry in group.entries), shown(group, "V of the scorecard"), strict=True))
    words = f"168.9 (paper, seed 0), {cards[2].cost.mean:.1f} (paper, several seeds)"
    assert told == [(searched(1.2), words), *((other, "-") for other in others)]
    assert shown(group, "largest B5")[0] == Value(0.025) and shown(group, "largest B6")[0] == "unstable"
    assert (shown(group, "gain_2_down")[0], shown(group, "fails")[0]) == (Value(0.05, unit=NONE, beyond="<"), "A2")
    for field in ("benchmark", "plant", "plant_parameters", "sample_time"):
        (change,) = (change for change, name, _ in UNLIKE if name == field)
        *_, alone = compared(scaled(1.2, **change), searched(1.2))
        assert shown(alone, "V of the scorecard") == ["-"], field


def test_documents_of_all_kinds_stand_in_one_comparison(tmp_path):
    """Evaluations and spreads first, whatever the order; each kind under its own name."""
    cases = everything(TABLE_2)
    listed = [tuned(), swept(4), verified([cases, cases], cases, cases), hunted()[0], seeded(1.0, [0, 1])]
    found = orchestrator.compare([*listed, Evaluation.load(Evaluation(scaled(1.0)).save(tmp_path))])
    assert [group.kind.split(",")[0] for group in found] == [
        *("Evaluations", "Several seeds", "Tunings", "Sweeps", "Verifications", "Worst cases found"),
    ]
    assert found[0].entries[0].folder == tmp_path
    assert [group.ranked[0].cost for group in found[2:4]] == [99.0, 90.0]
    assert found.document() == plain(found.document()) and "Evaluations" in repr(found)
    assert grouped([]).summary().tables == () and len(page_html(grouped([]).page())) > 0
    assert [tab.id for tab in found.page().panels] == ["leaderboard", "bounds", "bars", "overlay", "seeds"]


def test_what_is_known_of_v_of_a_controller_stands_on_one_axis():
    """Scorecards, lists, what searches found and samples of the same controller, and none of others."""
    listed = [Evaluation(scaled(1.0)), Evaluation(scaled(1.2)), searched(1.0), sampled(parameters={"K": 1.0})]
    ((name, first, known),) = compare_page.bounds([(f"no. {number}", each) for number, each in enumerate(listed)])
    assert (name, first) == ("no. 0", listed[0])
    marks = [(mark.kind, mark.V) for mark in known]
    expected = [("scorecard", listed[0].results.cost), ("scorecard", 180.0), ("found", 200.0)]
    assert marks == [*expected, ("sampled", listed[3].cost.bound)]
    assert not compare_page.bounds([("a", listed[0]), ("b", listed[1])])
    page = page_html(grouped([(each, None) for each in listed]).page())
    assert "V, found and sampled" in page and "found by a search of 1200 whole cases" in page
