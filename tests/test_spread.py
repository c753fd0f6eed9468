"""Several seeds: sample statistics, what does not count, and paired comparisons; searches beside the scorecards."""

import io
import json

import numpy as np
import pytest
from hostile.fmus import Fault
from msgspec.structs import replace
from rich.console import Console
from support.command_lines import call
from support.refusals import refusal
from support.reports import results_of, scaled, searched, seeded, tuned
from support.results import result

from orchestrator import Benchmark, Controller, Crash, Evaluation, Robustness, Spread
from orchestrator.cli.comparison_tables import show_spreads, show_worst
from orchestrator.cli.spread_tables import show_spread
from orchestrator.documents.beside import beside, beside_document, compare_spreads
from orchestrator.documents.compare_page import compare_html
from orchestrator.documents.comparison import compare
from orchestrator.documents.run import Run
from orchestrator.documents.spread import spread_of
from orchestrator.loop.trajectory import Status

LOST = result(0, "compliant", "disturbance", status=Status.UNSTABLE)
UNSTABLE = results_of([LOST if case.id == LOST.id else case for case in scaled(1.0).cases], seed=7)


def shown(show, *what, width=80):
    console = Console(width=width, file=io.StringIO(), emoji=False)
    show(*what, console)
    text = console.file.getvalue()
    assert max(len(line) for line in text.splitlines() if "repeat with" not in line) <= width
    return " ".join(text.split())


def test_sample_statistics_over_finished_seeds():
    runs = [scaled(factor, seed=seed) for seed, factor in enumerate((1.0, 1.3, 0.9))]
    spread = spread_of([0, 1, 2, 5], [*runs, scaled(1.0, seed=5, configurations=range(3))])
    V = [run.cost for run in runs]
    told = (spread.cost.mean, spread.cost.deviation, spread.cost.smallest, spread.cost.largest)
    assert told == pytest.approx((np.mean(V), np.std(V, ddof=1), min(V), max(V)))
    B5 = [run.criteria["B5"].value for run in runs]
    assert spread.criteria["B5"].deviation == pytest.approx(np.std(B5, ddof=1))
    assert spread.unfinished == (5,) and [score.seed for score in spread.seeds] == [0, 1, 2]
    assert {(held.seeds, held.of) for held in spread.requirements.values()} == {(3, 3)}
    assert spread_of([0], runs[:1]).cost.deviation is None
    assert "not every case was simulated: the seeds 5." in shown(show_spread, spread)


@pytest.mark.parametrize("width", [40, 80])
def test_a_seed_without_V_leaves_no_mean_and_is_told(width):
    spread = spread_of([0, 7], [scaled(1.2), UNSTABLE])
    assert (spread.cost.mean, spread.cost.deviation, spread.cost.largest) == (None,) * 3
    assert spread.cost.without == (7,) and spread.cost.smallest == scaled(1.2).cost
    assert spread.requirements["A3"].seeds == 1 and spread.criteria["B1"].mean is not None
    assert "No V with the seeds 7" in shown(show_spread, spread, width=width)
    assert "No V with the seeds 7" in spread._repr_html_() and "V = - ± -" in repr(spread)


def test_documents_are_read_as_they_were_saved_or_refused(tmp_path):
    for document in (seeded(1.0, range(3)), searched(), tuned()):
        kind = type(document)
        assert kind.load(document.save(tmp_path)) == document == kind.load(tmp_path / kind.FILE)
        text = (tmp_path / kind.FILE).read_text()
        for old, new, what in ((kind.SCHEMA, "other/1", "other-schema"), ('"controller"', '"driver"', "damaged")):
            (tmp_path / kind.FILE).write_text(text.replace(old, new))
            assert refusal(kind.load, tmp_path).what == what
        assert refusal(kind.load, tmp_path / "nowhere").what == "no-run"
    replace(seeded(1.0, range(3)), cost=seeded(2.0, range(3)).cost).save(tmp_path)
    assert "statistics" in str(refusal(Spread.load, tmp_path))
    html = searched()._repr_html_()
    assert "25 mm" in html and "unstable" in html and "&gt; 1.2 times" in html and "cut short: radius of V" in html
    html = tuned()._repr_html_()
    assert "T&lt;b&gt; = 0.84" in html and "150.0, A2 fails" in html and "Overfitted" in html


def test_controllers_are_paired_by_seed_with_the_first():
    first, other, unlike = seeded(1.0, range(4)), seeded(0.9, range(2, 8)), replace(seeded(1.0, [1]), protocol="quick")
    groups = compare_spreads([(first, None), (other, None), (unlike, None)])
    assert [len(group.entries) for group in groups] == [2, 1] and "protocol quick" in groups[1].difference
    pair = groups[0].entries[1].paired
    V = [[score.cost for score in spread.seeds if score.seed in (2, 3)] for spread in (other, first)]
    assert pair.seeds == (2, 3) and pair.better == 2
    differences = np.subtract(*V)
    assert (pair.difference.mean, pair.difference.deviation) == pytest.approx(
        (np.mean(differences), np.std(differences, ddof=1))
    )
    lost = spread_of([3, 7], [scaled(1.5, seed=3), UNSTABLE])
    ((_, entry),) = (group.entries for group in compare_spreads([(seeded(1.0, [3, 7]), None), (lost, None)]))
    assert entry.paired.difference.without == (7,) and entry.paired.difference.mean is None
    assert entry.paired.better == 0, "unstable is worse than any V"
    assert "better with 2 of 2 seeds" in shown(show_spreads, groups)


def test_a_search_stands_beside_the_scorecard_of_the_same_controller_and_parameters():
    groups = compare([Run(scaled(1.0)), Run(scaled(1.2))])
    spreads = compare_spreads([(seeded(1.2, range(3)), None)])
    worst = beside([(searched(1.2), None), (searched(1.2, sha256="d0" * 32), None)], groups, spreads)
    assert [entry.conditions for entry in worst] == ["paper, seed 0", "paper, 3 seeds", "-"]
    assert scaled(1.2).cost == worst[0].V and spreads[0].entries[0].spread.cost.mean == worst[1].V
    document = beside_document(spreads, worst)
    assert json.dumps(document, allow_nan=False) and document["robustness"][0]["largest"] == {"B5": 0.025, "B6": None}
    for html in (compare_html(groups, spreads, worst), compare_html((), (), worst)):
        assert "unstable" in html and "&lt; 0.05 times" in html and "1.5 ms" in html
    text = shown(show_worst, worst)
    assert "168.9" in text and "200.0" in text and "25 mm" in text and "A2" in text and "delay_2 1.5 ms" in text


ONE_POSE = 'extends = "quick"\nname = "one"\n[grid]\nq_a1_points = 1\nq_a2_points = 1\n'


@pytest.mark.slow
def test_seeds_of_the_command_are_found_again_and_are_those_of_the_library(quick_pid_file, tmp_path):
    (tmp_path / "one.toml").write_text(ONE_POSE)
    words = (
        "evaluate",
        quick_pid_file,
        "--protocol",
        "one.toml",
        "--seeds",
        "1,3",
        "--no-report",
        "--output-dir",
        "out",
    )
    first = call(*words, folder=tmp_path)
    assert first.code == 0 and first.err.count("V = ") == 2 and "A1 met with 2 of 2 seeds" in first.out
    again = call(*words, "--json", folder=tmp_path)
    assert again.err.count("6 of 6 cases are there from an earlier run") == 2
    assert json.loads(again.out) == json.loads((tmp_path / "out" / "spread.json").read_text())
    loaded = Spread.load(tmp_path / "out")
    alone = Evaluation.load(tmp_path / "out" / "seed-3")
    assert loaded.seeds[1].cost == alone.cost and alone.results.seed == 3 and loaded.cost.mean is not None
    partial = Benchmark(tmp_path / "one.toml").spread(
        Controller(quick_pid_file), [1, 1], only="*.noise", recordings=False
    )
    assert partial.unfinished == (1,) and partial.seeds == () and partial.cost.mean is None
    searched(sha256=loaded.controller.sha256, path="").save(tmp_path / "out")
    compared = call("compare", "out", "out/seed-1", "--json", folder=tmp_path)
    told = json.loads(compared.out)
    assert compared.code == 0 and [len(told[name]) for name in ("groups", "spreads", "robustness")] == [1, 1, 1]


def test_what_is_no_list_of_seeds_is_refused(tmp_path):
    for words in ("--seed 0 --seeds 1-2", "--seeds 3-1", "--seeds 1,,2", "--seeds -1", "--seeds 0-99999"):
        finished = call("evaluate", *words.split(), folder=tmp_path)
        assert finished.code == 2 and finished.err.startswith("error: "), words
    assert refusal(Benchmark().spread, seeds=[]).what == refusal(Benchmark().spread, seeds=[-1]).what == "bad-number"


def test_a_controller_that_crashes_in_its_first_sample_is_told_once(faulty, tmp_path):
    with pytest.raises(Crash, match="in the call"):
        Benchmark().robustness(Controller(faulty(Fault("abort", at=0.0))), folder=tmp_path)
    assert not (tmp_path / Robustness.FILE).exists()
