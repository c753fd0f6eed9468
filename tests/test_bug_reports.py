"""FMUs with the properties of public bug reports: each has the score of its law, or is refused in a sentence.

``docs/bug-reports.md`` lists them; ``REFRESH=reports python -m pytest tests/test_bug_reports.py`` writes its table.
"""

import os
from fractions import Fraction
from pathlib import Path

import pytest
from bug_reports.reports import REPORTS, Report, variable
from bug_reports.specimens import Specimen
from support.closed_loops import quiet, simulate_all
from support.pid_fmus import built
from support.refusals import refusal

from orchestrator import Benchmark, Controller, Evaluation
from orchestrator.cache import VARIABLE, cache_folder
from orchestrator.errors import InputError
from orchestrator.loop.controller import not_before_the_last_step

pytestmark = pytest.mark.needs("compiler")

PAGE = Path(__file__).parents[1] / "docs" / "bug-reports.md"
BEGIN, END = "<!-- table: made by tests/test_bug_reports.py -->\n", "<!-- end of table -->"

PROTOCOL = """
extends = "strict"
name = "short"
grid = { q_a1_points = 1, q_a2_points = 1 }
sets = { all = ["compliant"] }
[disturbance]
t_1 = 1.0
t_2 = 1.1
t_4 = 0.9
[stability]
limit_cycle_window = 0.5
rest_window = 0.5
rest_error = 0.01
[[tests]]
name = "noise"
systems = "all"
duration = 0.1
disturbed = false
criteria = ["B1", "B2"]
[[tests]]
name = "disturbance"
systems = "all"
duration = 2.5
criteria = ["B3", "B4", "B5", "B6", "B7"]
"""


@pytest.fixture(scope="module")
def benchmark(tmp_path_factory) -> Benchmark:
    """Two short cases, which have a V."""
    file = tmp_path_factory.mktemp("protocol") / "short.toml"
    file.write_text(PROTOCOL)
    return Benchmark(str(file), workers=1)


@pytest.fixture(scope="module")
def pid(benchmark, fmu_folder) -> Evaluation:
    """The project's PID under these conditions."""
    return benchmark.evaluate(Controller(built("DiagonalPID_C", fmu_folder)), recordings=False)


def measured(evaluation: Evaluation) -> list[object]:
    """What was measured in each case, and how it ended."""
    return [(case.id, case.status, case.time, case.measurements) for case in evaluation.results.cases]


def sentence(benchmark: Benchmark, file: Path) -> str:
    """With which ``evaluate`` refuses a controller, or why its first case that fails does so."""
    try:
        evaluation = benchmark.evaluate(Controller(file), recordings=False)
    except InputError as error:
        (finding,) = (found for found in benchmark.check(Controller(file)).found if found.severity == "error")
        assert str(finding.text) == str(error), "a check says the same"
        return str(error)
    except Exception as error:  # what an FMU says itself while it is tried; its type is another for each kind of end
        return str(error)
    assert evaluation.cost is None
    return next(case.message for case in evaluation.results.cases if case.status != "done")


def test_the_specimen_without_a_property_is_the_pid(benchmark, pid, tmp_path):
    evaluation = benchmark.evaluate(Controller(Specimen().write(tmp_path / "none.fmu")), recordings=False)
    assert pid.cost is not None and evaluation.cost == pid.cost
    assert measured(evaluation) == measured(pid)


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: report.where)
def test_a_report(report: Report, benchmark, pid, tmp_path, monkeypatch):
    if report.cache:
        move_cache(tmp_path / report.cache, monkeypatch)
    if report.before is not None:
        other = benchmark.evaluate(Controller(report.before.write(tmp_path / "before.fmu")), recordings=False)
        assert other.cost is not None and other.cost != pid.cost
    file = report.specimen.write(tmp_path / "Controller 1.fmu")
    if report.refused:
        said = sentence(benchmark, file)
        assert report.refused in said
        assert "Traceback" not in said
        return
    evaluation = benchmark.evaluate(Controller(file), recordings=False)
    if report.warned:
        assert measured(evaluation) != measured(pid)
        findings = benchmark.check(Controller(file)).found
        assert any(report.warned in found.text for found in findings if found.severity == "warning")
        return
    assert evaluation.cost == pid.cost
    assert measured(evaluation) == measured(pid)


def move_cache(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Extract FMUs to another folder, which has all else that is in the cache."""
    folder.mkdir()
    for kept in cache_folder().iterdir():
        if kept.name != "fmus":
            (folder / kept.name).symlink_to(kept)
    monkeypatch.setenv(VARIABLE, str(folder))


@pytest.mark.parametrize("samples", [9, 10, 400, 4800, 104_000, 120_000])
def test_no_step_ends_after_the_stop_time(samples):
    """The end of a step, t + h, is rounded; an FMU that compares it with the stop time sees it not beyond."""
    step = 0.25e-3
    told = not_before_the_last_step(samples / 4000, step)
    assert all(k * step + step <= told for k in range(samples))
    assert told - samples / 4000 < 1e-6 * step


@pytest.mark.parametrize("samples", [9, 10, 400])
def test_an_fmu_that_ends_at_its_stop_time_does_its_last_step(samples, quick_plant_file, tmp_path):
    file = Specimen("ends at the stop time").write(tmp_path / "controller.fmu")
    (trajectory,) = simulate_all(quick_plant_file, file, [quiet(Fraction(samples, 4000))])
    assert trajectory.ending.status == "done", trajectory.ending.message


def test_an_fmu_that_waits_for_event_mode_is_no_frozen_controller(quick_plant_file, tmp_path):
    """The master says that it does not use event mode; the flag in fmi3DoStep is then an error, not a silent wait."""
    file = Specimen("waits for event mode", version="3.0").write(tmp_path / "controller.fmu")
    (trajectory,) = simulate_all(quick_plant_file, file, [quiet(Fraction(10, 4000))])
    assert trajectory.ending.status == "error" and "waits for event mode" in trajectory.ending.message


def test_a_reset_follows_an_initialization_with_values(benchmark, tmp_path):
    """The check of it must not try the start values of inputs, which an FMU may refuse."""
    file = Specimen("divides by an input").write(tmp_path / "controller.fmu")
    (finding,) = (found for found in benchmark.check(Controller(file)).found if found.subject == "reset")
    assert finding.severity == "ok", finding.text


def test_a_check_names_what_other_libraries_have_too(benchmark, tmp_path):
    file = Specimen(options=("-DNAMES_OF_OTHERS",)).write(tmp_path / "controller.fmu")
    (finding,) = (found for found in benchmark.check(Controller(file)).found if found.subject == "symbols")
    assert finding.severity == "note" and "error, y0" in finding.text


def test_a_parameter_that_exists_twice_is_not_set(benchmark, tmp_path):
    twins = variable("K", causality="parameter", start="1.0", variability="fixed")
    file = Specimen(edits=(twins, twins)).write(tmp_path / "controller.fmu")
    error = refusal(benchmark.evaluate, Controller(file, parameters={"K": 2.0}))
    assert error.what == "not-settable" and "more than one variable K" in str(error)


def test_each_report_is_listed_once():
    assert len({report.where for report in REPORTS}) == len(REPORTS) >= 40
    assert len({(report.has, report.specimen) for report in REPORTS}) == len(REPORTS)


def test_the_page_lists_what_was_tried():
    text = PAGE.read_text(encoding="utf-8")
    head, rest = text.split(BEGIN)
    tail = rest.split(END)[1]
    expected = f"{head}{BEGIN}{table()}{END}{tail}"
    if os.environ.get("REFRESH") == "reports":
        PAGE.write_text(expected, encoding="utf-8")
    assert text == expected, "REFRESH=reports python -m pytest tests/test_bug_reports.py"


def table() -> str:
    """The reports as rows."""
    rows = [
        f"| [{report.where}]({report.link}): {cell(report.title)} | {cell(report.has)} | {result(report)} |\n"
        for report in REPORTS
    ]
    return "".join(["| report | the FMU | result |\n|---|---|---|\n", *rows])


def result(report: Report) -> str:
    """What became of it."""
    if report.refused:
        return f"refused: {cell(report.refused)}"
    return f"`check` warns: {cell(report.warned)}" if report.warned else "right score"


def cell(text: str) -> str:
    """Text in a cell of a table in Markdown."""
    for mark in "\\|*<>[]_`":
        text = text.replace(mark, f"\\{mark}")
    return text
