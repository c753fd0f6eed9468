"""Several runs side by side: ranks, groups that must not be ranked together, and why."""

import csv
import io
import json
import re
from pathlib import Path

import pytest
from msgspec.structs import replace
from rich.console import Console
from support.reports import RECORDINGS, recording, results_of, scaled, searched, seeded
from support.results import RULES, result

from orchestrator.benchmark.results import CaseResult, Results, SampleTimeRecord
from orchestrator.cli.comparison_tables import show_comparison
from orchestrator.documents.beside import beside, compare_spreads
from orchestrator.documents.compare_page import compare_html
from orchestrator.documents.comparison import Group, compare, comparison_document
from orchestrator.documents.paper_tables import FORMATS, tables
from orchestrator.documents.run import Run
from orchestrator.loop.trajectory import Status

CYCLING = result(0, "slippery", "delay_2", {}, (1e-3, 0.0))


def results_with(other: CaseResult, factor: float = 1.0) -> Results:
    """Results in which one case is another."""
    return results_of([other if case.id == other.id else case for case in scaled(factor).cases])


def compared(*results: Results, folders: bool = True) -> tuple[Group, ...]:
    return compare([Run(of, (), Path(f"runs/{i}") if folders else None) for i, of in enumerate(results)])


def costs(group: Group) -> list[float]:
    """V of the ranked runs, relative to that of Table 2."""
    return [round(entry.run.results.cost / 140.7324, 2) for entry in group.ranked]


def test_the_lowest_cost_is_first_and_those_that_fail_a_requirement_come_last():
    (group,) = compared(scaled(1.2), scaled(0.8), results_with(CYCLING, 0.5), scaled(1.0))
    assert costs(group) == [0.8, 1.0, 1.2, 0.5]
    assert group.unranked == () and group.difference == ""
    parameters = {"m[1]": 50.0, "m[2]": 140.0}
    swapped = dict(reversed(parameters.items()))
    (group,) = compared(*(scaled(1, plant={"parameters": given}) for given in (parameters, swapped)))
    assert len(group.ranked) == 2, "whatever their order"


OTHER_LIMIT = replace(RULES, stability=replace(RULES.stability, limit_cycle=2e-5))


@pytest.mark.parametrize(
    ("change", "field", "reason"),
    [
        ({"benchmark": "Other-v2"}, "benchmark", "benchmark Other-v2, not benchmark FlexibleManipulator-v2"),
        ({"protocol": "quick"}, "protocol", "protocol quick, not protocol paper"),
        ({"seed": 3}, "seed", "seed 3, not seed 0"),
        ({"sample_time": SampleTimeRecord(1e-3, False)}, "sample_time", "sample time 1 ms, not sample time 0.25 ms"),
        ({"plant": {"model": "b2" * 32}}, "plant", "plant of contents b2b2b2b2b2b2..., not plant of contents a1a1"),
        ({"plant": {"parameters": {"m[1]": 60.0}}}, "plant_parameters", "plant parameters m[1]=60, not plant"),
        ({"rules": OTHER_LIMIT}, "rules", "other rules (stability)"),
    ],
)
def test_unequal_conditions_are_not_ranked_together(change, field, reason):
    first, second = compared(scaled(0.1, **change), scaled(1.2), scaled(0.8))
    assert (len(first.ranked), len(second.ranked)) == (2, 1)
    assert second.difference.startswith(reason)
    assert getattr(second.conditions, field) != getattr(first.conditions, field)


def test_an_incomplete_run_has_no_rank_and_values_are_in_si_units():
    crashed = replace(CYCLING, status=Status.CRASHED)
    groups = compared(scaled(0.5, configurations=range(3)), scaled(1), results_with(crashed))
    assert [entry.name for entry in groups[0].ranked] == ["PID [K=1]"]
    assert [why.removeprefix("incomplete: ") for _, why in groups[0].unranked] == [
        *("not all cases of the protocol were run", "1 crashed")
    ]
    (told,) = comparison_document(groups)["groups"]
    assert told["conditions"]["sample_time"] == 0.25e-3
    assert told["ranked"][0]["criteria"]["B5"] == pytest.approx(10.2e-3)
    assert told["ranked"][0]["requirements"] == dict.fromkeys(["A1 1", "A1 2", "A2 1", "A2 2", "A3"], True)
    assert json.dumps(told, allow_nan=False)


@pytest.mark.parametrize("folders", [True, False])
def test_equal_names_are_told_apart(folders):
    (group,) = compared(scaled(1), scaled(1), folders=folders)
    names = [entry.name for entry in group.ranked]
    assert len(set(names)) == 2 and all("PID [K=1]" in name for name in names)


def shown(groups, width: int) -> str:
    console = Console(width=width, file=io.StringIO(), emoji=False)
    show_comparison(groups, console)
    return console.file.getvalue()


@pytest.mark.parametrize("width", [40, 80, 200])
def test_terminal_table(width):
    evil = {"file": "\x1b[31m\u202e=[bold]x.fmu"}
    text = shown(compared(scaled(1.2), scaled(0.8, controller=evil), scaled(1, seed=4)), width)
    assert text.index("112.6") < text.index("168.9")
    assert "Not ranked with the above: seed 4, not seed 0" in " ".join(text.split())
    assert max(map(len, text.splitlines())) <= width
    assert "paper's PID" in text and "141.0" in text
    assert "2  PID [K" in text and "\x1b" not in text and "\u202e" not in text
    assert len(re.findall(r"\bmet\b", text)) == 15


def test_page_says_the_same():
    recordings = (*RECORDINGS, recording(("B7",), "c03.random_2.disturbance"))
    runs = [Run(results_with(CYCLING), recordings), Run(scaled(0.8)), Run(scaled(1.0, protocol="quick"))]
    groups = compare(runs)
    html = compare_html(groups)
    assert "Not ranked with the above: protocol quick, not protocol paper." in html
    for text in (html, shown(groups, 80), str(groups[1].notes)):
        assert "depends on the seed" in text and "depends on the seed" not in str(groups[0].notes)
    assert html.index("112.6") < html.index("140.7")
    assert "1000.0 µm" in html, "a verdict with its number"
    assert html.count("paper&#39;s PID</th>") == 2
    assert "simulate 'my controllers/PID.fmu' --case c03.random_2.disturbance" in html


NAME = "[K] 50%_$x$ & {a}|~^\\b"


def test_tables_for_a_paper_say_the_same_in_all_forms():
    groups = compared(scaled(1.2), scaled(0.8, controller={"file": f"{NAME}.fmu"}), scaled(1.0, seed=4))
    spreads = compare_spreads([(seeded(1.0, range(3)), None)])
    found = tables(groups, spreads, beside([(searched(1.2), None)], groups, spreads))
    assert [table.rows[0][0] for table in found] == [f"{NAME} [K=0.8]", "PID [K=1]", "PID [K=1]", "PID [K=1.2]"]
    assert "seed 4, not seed 0" in found[1].title
    text = FORMATS["latex"](found)
    assert r"{}[K] 50\%\_\$x\$ \& \{a\}|\textasciitilde{}\textasciicircum{}\textbackslash{}b [K=0.8] & 112.6 & " in text
    assert "B5 [mm]" in text and r"$142.1 \pm 1.41$" in text and text.count("\\bottomrule") == 4
    assert "| \\[K\\] 50%\\_$x$ & {a}\\|~^\\\\b \\[K=0.8\\] | 112.6 | " in FORMATS["markdown"](found)
    blocks = [list(csv.DictReader(io.StringIO(block))) for block in FORMATS["csv"](found).split("\n\n")]
    assert float(blocks[0][0]["V"]) == groups[0].ranked[0].cost
    assert float(blocks[0][-1]["B5 [mm]"]) == pytest.approx(10.2) and blocks[0][-1]["A1"] == ""
    spread = spreads[0].entries[0].spread
    assert float(blocks[2][0]["B7 [mm] standard deviation"]) == pytest.approx(1e3 * spread.criteria["B7"].deviation)
    worst = {"V found": "200.0", "largest B6 [s]": "unstable", "delay 2 [ms]": "1.5", "gain 2 down": "< 0.05"}
    assert worst.items() <= blocks[3][0].items()
