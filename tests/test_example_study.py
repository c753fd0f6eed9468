"""The worked example of a new study: one file, and all that the others have."""

import functools
import importlib.util
import json
import sys
from fractions import Fraction
from pathlib import Path

import pytest
from support.command_lines import called

from orchestrator import Benchmark, Controller, compare
from orchestrator.cli import guard
from orchestrator.study.dry_run import on_target
from orchestrator.study.rehearsal import Rehearsal
from orchestrator.study.requests import Batch, Instant, Now, Rehearse, answered

FILE = Path(__file__).parents[1] / "examples" / "sample_time.py"
TIMES = "0.0005,0.001"


@pytest.fixture
def example(monkeypatch):
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("sample_time", FILE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)  # where a dataclass looks for its annotations
    spec.loader.exec_module(module)
    return module


def test_it_is_one_short_file_that_the_instructions_name():
    assert len(FILE.read_text(encoding="utf-8").splitlines()) <= 84
    assert "examples/sample_time.py" in (FILE.parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_it_can_be_played_without_simulating(example):
    def answer(request):
        match request:
            case Batch(entries):
                return [[on_target(each.protocol, case) for case in each.cases] for each in entries]
            case Rehearse():
                return Rehearsal()
            case Now():
                return Instant("2026-01-01", 0.0, 1)
        return None

    bench = Benchmark("quick")
    found = answered(example.SampleTimeStudy([Fraction(1, 2000), Fraction(1, 1000)]).ask(bench, Controller()), answer)
    assert found.times == (0.0005, 0.001)
    assert pytest.approx([bench.rules.criteria["B5"].target] * 2) == found.B5


def test_it_has_table_page_latex_comparison_resumption_and_json(example, tmp_path):
    main = functools.partial(guard.guarded, example.main)
    call = ("--protocol", "quick", "--times", TIMES, "--output-dir", "out")
    plan = called(main, *call, "--dry-run", folder=tmp_path)
    assert plan.code == 0 and "8 cases, 0 of them in the store" in plan.out and not (tmp_path / "out").exists()
    first = called(main, *call, folder=tmp_path)
    assert first.code == 0 and "Force error" in first.out and "sample-times.json, report.html" in first.err
    kept = json.loads((tmp_path / "out/sample-times.json").read_text(encoding="utf-8"))
    again = called(main, *call, "--json", folder=tmp_path)
    assert "4 of 4 cases are there from an earlier run" in again.err
    found = json.loads(again.out)
    assert found["B5"] == kept["B5"] and found["head"]["command"].startswith(
        "python examples/sample_time.py --protocol"
    )
    assert "\\begin{tabular}" in called(main, *call, "--latex", folder=tmp_path).out
    document = example.SampleTimes.load(tmp_path / "out")
    (group,) = compare([document, document])
    assert len(group.ranked) == 2 and "B5 over the sample time" in (tmp_path / "out/report.html").read_text(
        encoding="utf-8"
    )
    assert "<table>" in document._repr_html_()


def test_what_is_wrong_is_one_line_behind_the_announcement(example, tmp_path):
    main = functools.partial(guard.guarded, example.main)
    wrong = called(main, "nowhere.fmu", "--times", "0.001", "--dry-run", folder=tmp_path)
    assert wrong.code == 2 and wrong.err.count("\n") == 2 and "There is no file nowhere.fmu" in wrong.err
