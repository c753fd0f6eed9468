"""Several seeds: sample statistics, and what does not count; documents that are saved, loaded and refused."""

import json

import numpy as np
import pytest
from hostile.fmus import Fault
from msgspec.structs import replace
from support.command_lines import call
from support.refusals import refusal
from support.reports import documents, head_of, results_of, scaled, searched, seeded
from support.results import result

from orchestrator import Benchmark, Controller, Crash, Evaluation, Robustness, Spread
from orchestrator.documents.document import Document
from orchestrator.documents.spread import spread_of, spread_remarks
from orchestrator.loop.trajectory import Status

LOST = result(0, "compliant", "disturbance", status=Status.UNSTABLE)
UNSTABLE = results_of([LOST if case.id == LOST.id else case for case in scaled(1.0).cases], seed=7)
HEAD = head_of(seed=None)


def test_sample_statistics_over_finished_seeds():
    runs = [scaled(factor, seed=seed) for seed, factor in enumerate((1.0, 1.3, 0.9))]
    spread = spread_of([0, 1, 2, 5], [*runs, scaled(1.0, seed=5, configurations=range(3))], HEAD)
    V = [run.cost for run in runs]
    told = (spread.cost.mean, spread.cost.deviation, spread.cost.smallest, spread.cost.largest)
    assert told == pytest.approx((np.mean(V), np.std(V, ddof=1), min(V), max(V)))
    B5 = [run.criteria["B5"].value for run in runs]
    assert spread.criteria["B5"].deviation == pytest.approx(np.std(B5, ddof=1))
    assert spread.unfinished == (5,) and [score.seed for score in spread.seeds] == [0, 1, 2]
    assert {(held.seeds, held.of) for held in spread.requirements.values()} == {(3, 3)}
    assert spread_of([0], runs[:1], HEAD).cost.deviation is None
    assert "not every case was simulated: the seeds 5." in spread._repr_html_()


def test_a_seed_without_V_leaves_no_mean_and_is_told():
    spread = spread_of([0, 7], [scaled(1.2), UNSTABLE], HEAD)
    assert (spread.cost.mean, spread.cost.deviation, spread.cost.largest) == (None,) * 3
    assert spread.cost.without == (7,) and spread.cost.smallest == scaled(1.2).cost
    assert spread.requirements["A3"].seeds == 1 and spread.criteria["B1"].mean is not None
    assert "No V with the seeds 7" in str(spread_remarks(spread)) and "No V with the seeds 7" in spread._repr_html_()
    assert "V = - ± -" in repr(spread) and spread.rank.reason


SAVED = {name: document for name, document in documents().items() if isinstance(document, Document)}


@pytest.mark.parametrize("name", SAVED)
def test_a_document_is_read_as_it_was_saved_or_refused(name, tmp_path):
    document = SAVED[name]
    kind = type(document)
    assert refusal(kind.load, tmp_path / "nowhere").what == kind.MISSING
    (tmp_path / "report.html").write_text("of another one")
    assert kind.load(document.save(tmp_path)) == document == kind.load(tmp_path / kind.FILE)
    assert not (tmp_path / "report.html").exists()
    text = (tmp_path / kind.FILE).read_text()
    changes = [(f'"{kind.SCHEMA}"', '"other/1"', "other-schema"), ('"controller"', '"driver"', "damaged")]
    changes += [('"head"', '"tail"', "damaged"), ('"N.m"', '"parsec"', "damaged"), ("{", "[", "damaged")]
    name, _, form = kind.SCHEMA.rpartition("/")
    older = f"{name}/{int(form) - 1}"
    for old, new, what in (*changes, (kind.SCHEMA, older, "other-schema")):
        assert old in text
        (tmp_path / kind.FILE).write_text(text.replace(old, new))
        assert refusal(kind.load, tmp_path).what == what, old
    assert "Make it again" in str(refusal(kind.load, tmp_path)), "what to do about the older form"


def test_a_spread_whose_statistics_are_not_those_of_its_seeds_is_refused(tmp_path):
    replace(seeded(1.0, range(3)), cost=seeded(2.0, range(3)).cost).save(tmp_path)
    assert "statistics" in str(refusal(Spread.load, tmp_path))


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
    assert (
        first.code == 0
        and first.err.count("V = ") == 2
        and "A1           met             2                2" in first.out
    )
    again = call(*words, "--json", folder=tmp_path)
    assert again.err.count("6 of 6 cases are there from an earlier run") == 1
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
    assert compared.code == 0 and len({group["kind"] for group in told["groups"]}) == len(told["groups"]) == 3


def test_what_is_no_list_of_seeds_is_refused(tmp_path):
    for words in ("--seed 0 --seeds 1-2", "--seeds 3-1", "--seeds 1,,2", "--seeds -1", "--seeds 0-99999"):
        finished = call("evaluate", *words.split(), folder=tmp_path)
        assert finished.code == 2 and finished.err.startswith("error: "), words
    assert refusal(Benchmark().spread, seeds=[]).what == refusal(Benchmark().spread, seeds=[-1]).what == "bad-number"


def test_a_controller_that_crashes_in_its_first_sample_is_told_once(faulty, tmp_path):
    with pytest.raises(Crash, match="in the call"):
        Benchmark().robustness(Controller(faulty(Fault("abort", at=0.0))), folder=tmp_path)
    assert not (tmp_path / Robustness.FILE).exists()
