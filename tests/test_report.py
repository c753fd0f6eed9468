"""The report of a run: the static part of its page, and what is shown of a run in the first place."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from closed_loops import PAPER
from reports import RECORDINGS, evaluation, recording, stored
from results import everything, result
from rich.console import Console
from scipy.io import loadmat

from orchestrator.benchmark.scorecard import score
from orchestrator.cosim.trajectory import Status
from orchestrator.errors import BenchmarkError
from orchestrator.report import pages
from orchestrator.report.figures import write_figures
from orchestrator.report.mat import mat_bytes
from orchestrator.report.payload import ROWS, report_payload, script_json
from orchestrator.report.recording import MOTION_INTERVALS, TORQUE_INTERVALS
from orchestrator.report.report_page import facts, report_html
from orchestrator.report.selection import shown
from orchestrator.report.terminal import show_document
from orchestrator.report.wording import remarks, requirement_rows
from plant_fmu.flexible_manipulator.parameters import NOMINAL

DOCS = Path(__file__).parents[1] / "docs" / "report.md"
EVIL = "</script><script>alert(1)</script><!--<script>"
GOOD = {criterion.name: criterion.target for criterion in PAPER.criteria}


class Page(HTMLParser):
    """Elements of a page, its texts, and its attributes that a browser would run or load."""

    def __init__(self, text: str):
        super().__init__()
        self.elements: list[str] = []
        self.texts: list[str] = []
        self.active: list[tuple[str, str]] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append(tag)
        self.active += [(name, value) for name, value in attrs if name.startswith("on") or name in ("src", "href")]

    def handle_data(self, data):
        self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


@pytest.fixture
def run(tmp_path, plant_file, pid_file):
    return stored(tmp_path, evaluation(plant_file, pid_file))


def failing(status: Status):
    """Results of an evaluation in which every case fails."""
    return [replace(entry, status=status, measurement=None, message=EVIL) for entry in everything(GOOD)]


def test_headline_and_verdicts(run):
    text = Page(report_html(run)).text
    assert "140.7" in text and "target 100" in text and "paper's PID 141" in text
    assert text.count("✓ holds") == 5
    assert "10.2" in text and run.document["controller"]["sha256"] in text


@pytest.mark.parametrize(("workers", "words"), [(1, "100 s on 1 process"), (2, "100 s on 2 processes")])
def test_processes_are_counted(run, workers, words):
    document = {**run.document, "timing": {**run.document["timing"], "workers": workers}}
    assert facts(document)[-3][1].endswith(words)


def test_everything_from_outside_is_escaped(run):
    document = json.loads(json.dumps(run.document))
    document["controller"].update(file=EVIL, generation_tool=EVIL, sha256=EVIL, parameters={EVIL: 1.0})
    document["plant"].update(file=EVIL, parameters={EVIL: 2.0})
    document["environment"]["platform"] = EVIL
    document["cases"][0].update(status="error", message=EVIL)
    recordings = (recording(("B5",), EVIL, message=EVIL, system=EVIL), *RECORDINGS)
    clean, page = Page(report_html(run)), Page(report_html(replace(run, document=document, recordings=recordings)))
    assert page.elements.count("script") == clean.elements.count("script") == 3
    assert not [entry for entry in page.active if entry[0] != "href"]
    assert {value for name, value in page.active} == {"#content"}
    assert page.text.count(EVIL) >= 7


def test_no_text_ends_a_script():
    values = {"a": EVIL, "b": ["\u2028\u2029&<>", None, 1.5]}
    text = script_json(values)
    assert not set("<>&\u2028\u2029") & set(text)
    assert json.loads(text) == values


def test_the_policy_admits_the_scripts_embedded_and_nothing_else(run):
    html = report_html(run)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)[1].replace("&#39;", "'")
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == "'none'"
    scripts = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    hashes = {"'sha256-" + base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() + "'" for s in scripts}
    assert set(rules["script-src"].split()) == hashes and len(hashes) == 2


def test_a_page_stays_below_5_MB_however_lively_its_signals(run):
    noise = np.random.default_rng(0)
    lively = [
        replace(
            entry,
            motion=noise.standard_normal((6 * MOTION_INTERVALS, 5), np.float32),
            torque=noise.standard_normal((4 * TORQUE_INTERVALS, 3), np.float32),
        )
        for entry in [*[recording(("B5",))] * 14, *[recording(("spread",))] * 20]
    ]
    assert len(report_html(replace(run, recordings=tuple(lively))).encode()) < 5e6


def test_a_page_keeps_every_peak_however_lively_its_signals(run):
    # The largest error is at neither coordinate's extremes.
    offsets = np.array([[1, 0], [0.9, 0.9], [0, 1], [-1, 0], [0, -1]], np.float32)
    noise = np.random.default_rng(0)
    rows = 4 * MOTION_INTERVALS
    motion = np.column_stack([np.arange(rows), np.tile(offsets, (rows, 1))[:rows], np.zeros((rows, 2))])
    torque = noise.standard_normal((4 * TORQUE_INTERVALS, 3)).astype(np.float32)
    lively = replace(recording(("B5",)), motion=motion.astype(np.float32), torque=torque)
    shown = report_payload(replace(run, recordings=(lively,) * 30))["recordings"]
    for entry in shown:
        x, z = unpacked(entry["motion"])[:, 1:3].T
        assert np.hypot(x, z).max() == lively.error.max()
        np.testing.assert_array_equal(unpacked(entry["torque"])[:, 1:].max(axis=0), torque[:, 1:].max(axis=0))
        np.testing.assert_array_equal(unpacked(entry["torque"])[:, 1:].min(axis=0), torque[:, 1:].min(axis=0))
    assert sum(len(unpacked(entry["motion"])) for entry in shown) <= ROWS < 30 * rows
    assert sum(len(unpacked(entry["torque"])) for entry in shown) <= ROWS < 30 * len(torque)


def unpacked(columns: list[str]) -> np.ndarray:
    """The columns of a recording in a page, shape (N, columns)."""
    return np.column_stack([np.frombuffer(base64.b64decode(column), "<f4") for column in columns])


@pytest.mark.parametrize("count", [0, 1, 5])
def test_mat_holds_a_struct_array_of_one_row(run, count):
    recordings = loadmat(io.BytesIO(mat_bytes(replace(run, recordings=RECORDINGS[:count]))))["recordings"]
    assert recordings.shape == (1, count)
    assert {"id", "roles", "window", "t", "x", "u_m2"} <= set(recordings.dtype.names)
    for entry, original in zip(recordings[0], RECORDINGS, strict=False):
        assert entry["id"].tolist() == [original.about.id]
        assert entry["window"].ravel().tolist() == list(original.about.window)
        np.testing.assert_array_equal(entry["t_torque"], original.torque[:, :1])


def test_figures_that_cannot_be_written_are_told(run):
    (run.folder / "figures").write_text("in the way")
    with pytest.raises(BenchmarkError, match="figures cannot be written to"):
        write_figures(run)
    (run.folder / "figures").unlink()
    (run.folder / "figures" / "figure_03_stiffness.pdf").mkdir(parents=True)
    with pytest.raises(BenchmarkError, match="figure_03_stiffness.pdf cannot be written"):
        write_figures(run)


def test_embedded_scripts_do_not_end_early():
    for name in (pages.LIBRARY, *pages.REPORT, *pages.COMPARE):
        assert "</script" not in (pages.FILES / name).read_text(encoding="utf-8").lower()


def test_the_plotting_library_is_the_release_named_in_the_docs():
    source = (pages.FILES / pages.LIBRARY).read_bytes()
    assert hashlib.sha256(source).hexdigest() in DOCS.read_text(encoding="utf-8")


@pytest.mark.parametrize("status", [Status.ERROR, Status.TIMEOUT, Status.CRASHED, Status.SKIPPED])
def test_a_controller_that_fails_everywhere_has_a_report(tmp_path, plant_file, pid_file, status):
    run = stored(tmp_path, evaluation(plant_file, pid_file, failing(status)), ())
    text = Page(report_html(run)).text
    assert "No cost" in text
    assert text.count("✗ fails") == 5
    assert text.count(f"✗ {status.value}") == 324
    assert "made without trajectories" in text


def test_a_part_of_a_protocol_has_a_report(tmp_path, plant_file, pid_file):
    run = stored(tmp_path, evaluation(plant_file, pid_file, [result(7, "slippery", "gain_1")]))
    text = Page(report_html(run)).text
    assert "Incomplete" in text and "not tested" in text


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"complete": False}, "Incomplete"),
        ({"protocol": "quick"}, "Protocol quick"),
        ({"sample_time": {"seconds": 1e-3, "as_in_benchmark": False}}, "1 ms"),
        ({"plant": {"parameters": {"m[1]": 60.0}}}, "m[1] = 60"),
    ],
)
def test_remarks(run, changes, words):
    assert remarks(run.document) == []
    (remark,) = remarks({**run.document, **changes})
    assert words in remark


def test_requirements_are_told_per_axis(run):
    rows = requirement_rows(run.document)
    assert [(row["name"], row["axis"]) for row in rows] == [
        *(("A1", "1"), ("A1", "2"), ("A2", "1"), ("A2", "2"), ("A3", "")),
    ]
    assert "2.5" in rows[0]["title"] and "1.5 ms" in rows[2]["title"]


@pytest.mark.parametrize("width", [50, 60, 80, 140])
def test_terminal_respects_its_width_and_markup_of_others(run, width):
    document = {**run.document, "controller": {**run.document["controller"], "file": "[red]x[/red].fmu"}}
    console = Console(width=width)
    with console.capture() as capture:
        show_document(document, console)
    lines = capture.get().splitlines()
    assert max(map(len, lines)) <= width
    assert "\x1b" not in capture.get()
    assert "[red]x[/red].fmu" in capture.get()
    assert "140.7" in capture.get()
    for name in (*run.document["criteria"], "A1", "A2", "A3"):
        assert re.search(rf"^ {name}  \w{{4}}", capture.get(), re.MULTILINE)
    assert "c00.compliant" in capture.get()


def test_a_run_of_unstable_cases_says_so(run):
    cases = [{**case, "status": "unstable", "message": "gone"} for case in run.document["cases"]]
    document = {**run.document, "cases": cases, "cost": None}
    console = Console(width=100)
    with console.capture() as capture:
        show_document(document, console)
    assert "c00.compliant.noise: unstable: gone" in capture.get() and "and 321 more" in capture.get()
    assert "No cost V: 108 of the cases that B1 to B7 are measured in are unstable." in capture.get()


def test_the_timing_convention_is_stated(run):
    delay = {"seconds": 5e-4, "samples": 2.0, "controller_samples": 1, "convention": "samples twice in the first step"}
    text = "0.500 ms = 2 samples (1 of them in the controller); the controller samples twice in the first step"
    assert dict(facts({**run.document, "loop_delay": delay}))["Loop delay"] == text


def test_colour_on_a_terminal_only_and_never_against_the_users_will(run, monkeypatch):
    def printed():
        console = Console(force_terminal=True, width=80)
        with console.capture() as capture:
            show_document(run.document, console)
        return capture.get()

    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b[3" in printed()
    monkeypatch.setenv("NO_COLOR", "1")
    assert not re.search(r"\x1b\[[0-9;]*3[0-7]m", printed())


class TestSelection:
    """What an evaluation simulates again for its report."""

    def chosen(self, results):
        return shown(PAPER, NOMINAL, 0, results, score(PAPER, results, 324))

    def test_worst_cases_example_and_spread(self):
        found = self.chosen(everything(GOOD))
        roles = [role for entry in found for role in entry.roles]
        assert {f"B{i}" for i in range(1, 8)} <= set(roles)
        assert not {role for role in roles if role.startswith("A")}
        assert roles.count("example") == 1
        spread = [entry.case for entry in found if entry.roles == ("spread",)]
        assert len({case.system.name for case in spread}) == len(spread) == 20
        assert {case.configuration for case in spread} == {spread[0].configuration}
        settled = spread[0].scenario.pulse.stop + next(c.target for c in PAPER.criteria if c.name == "B6")
        assert {float(case.scenario.duration) - settled for case in spread} == {1.0}

    def test_a_requirement_that_fails_is_shown_on_its_axis(self):
        cycling = result(4, "slippery", "delay_2", {}, (2e-5, 1e-6))
        results = [cycling if entry.case.id == cycling.case.id else entry for entry in everything(GOOD)]
        (entry,) = (entry for entry in self.chosen(results) if "A2 2" in entry.roles)
        assert entry.case.id == cycling.case.id
        assert set(entry.roles) == {"A2 2", "A3 x"}

    def test_a_worst_case_is_the_very_case_evaluated(self):
        results = everything(GOOD)
        known = {entry.case.id: entry.case for entry in results}
        for entry in self.chosen(results):
            if not {"example", "spread"} & set(entry.roles):
                assert entry.case is known[entry.case.id]

    def test_a_short_evaluation_has_a_short_spread(self):
        found = self.chosen(everything(GOOD, [0]))
        assert sum("spread" in entry.roles for entry in found) == 3

    @pytest.mark.parametrize("status", [Status.TIMEOUT, Status.CRASHED, Status.SKIPPED])
    def test_what_would_hang_or_crash_again_is_left_out(self, status):
        failed = replace(everything(GOOD)[0], status=status, measurement=None)
        found = self.chosen([failed, *everything(GOOD)[1:]])
        assert failed.case.id not in {entry.case.id for entry in found}

    def test_nothing_unknown_is_tried_where_something_hung_or_nothing_ended(self):
        hung = replace(everything(GOOD)[0], status=Status.TIMEOUT, measurement=None)
        roles = {role for entry in self.chosen([hung, *everything(GOOD)[1:]]) for role in entry.roles}
        assert "B5" in roles and not {"example", "spread"} & roles
        assert self.chosen(failing(Status.CRASHED)) == []
        assert self.chosen([]) == []
