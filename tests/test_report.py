"""The report of a run: the static part of its page, its remarks, and the scorecard in a terminal."""

import base64
import hashlib
import io
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml.html import fromstring
from msgspec.structs import replace as changed
from rich.console import Console
from support.reports import CONTROLLER, RECORDINGS, recording, results_of
from support.results import TABLE_2, everything, result

from orchestrator.benchmark.results import BoundRecord, LoopDelay, Measurements, SampleTimeRecord
from orchestrator.cli.tables import show_results, terminal
from orchestrator.documents import pages
from orchestrator.documents.fragments import results_fragment, simulation_fragment
from orchestrator.documents.payload import ROWS, report_payload, script_json
from orchestrator.documents.recording import MOTION_INTERVALS, TORQUE_INTERVALS
from orchestrator.documents.repeat import simulate_command
from orchestrator.documents.report_page import facts, report_html
from orchestrator.documents.run import Run, contradictions
from orchestrator.documents.wording import collapsed, remarks, requirement_rows
from orchestrator.loop.trajectory import Ending, Status

DOCS = Path(__file__).parents[1] / "docs" / "report.md"
EVIL = "</script><script>alert(1)</script><!--<script>"
RUN = Run(results_of(), RECORDINGS)
ERROR, GOOD = Status.ERROR, everything(TABLE_2)
CYCLING = result(4, "slippery", "delay_2", {}, (2e-5, 1e-6))


class Page:
    """Elements of a page, its text, and its attributes that a browser would run or load."""

    def __init__(self, html: str):
        root = fromstring(html)
        self.elements = [element.tag for element in root.iter()]
        self.text = " ".join(" ".join(root.itertext()).split())
        attributes = [pair for element in root.iter() for pair in element.attrib.items()]
        self.active = [pair for pair in attributes if pair[0].startswith("on") or pair[0] in ("src", "href")]
        self.copied = [value for name, value in attributes if name == "data-copy"]


def with_case(other):
    """Results of all cases, one of them replaced."""
    return results_of([other if case.id == other.id else case for case in GOOD])


def printed(results, **options) -> str:
    """What a terminal shows of results."""
    console = Console(file=io.StringIO(), emoji=False, **options)
    show_results(results, console)
    return console.file.getvalue()


def test_headline_and_verdicts():
    text = Page(report_html(RUN)).text
    assert "140.7" in text and "target 100" in text and "paper's PID 141" in text
    assert text.count("✓ met") == 5
    assert "10.2" in text and CONTROLLER.sha256 in text
    told = dict(facts(RUN.results))
    assert told["Run"].endswith("100 s on 2 processes")
    assert told["Loop delay"] == (
        "0.500 ms = 2 samples (1 of them in the controller); the controller samples twice in the first step"
    )
    assert told["Computing time"] == "0.3 µs median, 0.4 µs 99 %, 12 µs largest of 250 µs, per sample"
    unknown = facts(results_of(loop_delay=LoopDelay(None, None, 2.5e-4, None, None)))
    assert dict(unknown)["Loop delay"] == "not measured: the controller could not be probed"


def test_everything_from_outside_is_escaped():
    bad = {"file": EVIL, "generation_tool": EVIL, "sha256": EVIL, "path": EVIL}
    results = results_of(
        [result(0, "sticky", "gain_1", None, None, ERROR, EVIL), *everything(TABLE_2, [1])],
        controller={**bad, "parameters": {EVIL: 1.0}},
        plant={"file": EVIL, "parameters": {EVIL: 2.0}},
        environment={"platform": EVIL},
    )
    recordings = (recording(("B5",), EVIL, message=EVIL, system=EVIL), *RECORDINGS)
    clean, page = Page(report_html(RUN)), Page(report_html(Run(results, recordings)))
    assert page.elements.count("script") == clean.elements.count("script") == 3
    assert page.active == [("href", "#content")]
    assert page.text.count(EVIL) >= 7
    fragment = Page(results_fragment(results))
    assert "script" not in fragment.elements and EVIL in fragment.text


def test_no_text_ends_a_script_and_the_library_is_a_known_release():
    values = {"a": EVIL, "b": ["\u2028\u2029&<>", None, 1.5]}
    text = script_json(values)
    assert not set("<>&\u2028\u2029") & set(text)
    assert json.loads(text) == values
    library = (pages.FILES / pages.LIBRARY).read_bytes()
    assert hashlib.sha256(library).hexdigest() in DOCS.read_text(encoding="utf-8"), "the release named in the docs"
    for name in (pages.LIBRARY, *pages.REPORT, *pages.COMPARE):
        assert "</script" not in (pages.FILES / name).read_text(encoding="utf-8").lower()


def test_the_policy_admits_the_scripts_embedded_and_nothing_else():
    html = report_html(RUN)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)[1].replace("&#39;", "'")
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == "'none'"
    scripts = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    hashes = {"'sha256-" + base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() + "'" for s in scripts}
    assert set(rules["script-src"].split()) == hashes and len(hashes) == 2


def test_a_page_stays_below_5_MB_and_keeps_every_peak_however_lively_its_signals():
    # The largest error is at neither coordinate's extremes.
    offsets = np.array([[1, 0], [0.9, 0.9], [0, 1], [-1, 0], [0, -1]], np.float32)
    noise = np.random.default_rng(0)
    rows = 6 * MOTION_INTERVALS
    motion = np.column_stack([np.arange(rows), np.resize(offsets, (rows, 2)), noise.standard_normal((rows, 2))])
    torque = noise.standard_normal((4 * TORQUE_INTERVALS, 3)).astype(np.float32)
    lively = replace(recording(("B5",)), motion=motion.astype(np.float32), torque=torque)
    run = replace(RUN, recordings=(lively,) * 30 + (replace(lively, about=recording(("spread",)).about),) * 20)
    assert len(report_html(run).encode()) < 5e6
    shown = report_payload(run)["recordings"]
    for entry in shown[:1] + shown[-1:]:
        x, z = unpacked(entry["motion"])[:, 1:3].T
        assert np.hypot(x, z).max() == lively.error.max()
        for extreme in (np.max, np.min):
            np.testing.assert_array_equal(extreme(unpacked(entry["torque"]), 0)[1:], extreme(torque, 0)[1:])
    for table, whole in (("motion", motion), ("torque", torque)):
        assert len(shown) == 30 and sum(len(unpacked(entry[table])) for entry in shown) <= ROWS < 30 * len(whole)


def unpacked(columns: list[str]) -> np.ndarray:
    """The columns of a recording in a page, shape (N, columns)."""
    return np.column_stack([np.frombuffer(base64.b64decode(column), "<f4") for column in columns])


def test_a_controller_that_fails_everywhere_has_a_report():
    failed = [result(case.configuration.index, case.system, case.test, None, None, ERROR) for case in GOOD]
    text = Page(report_html(Run(results_of(failed)))).text
    assert "No cost" in text and "made without trajectories" in text
    assert text.count("✗ not met") == 5 and text.count("✗ error") == 324


def test_every_case_in_sight_comes_with_the_command_that_repeats_it():
    results = changed(with_case(changed(CYCLING, status=Status.UNSTABLE)), seed=3, protocol="quick")
    page = Page(report_html(Run(results, RECORDINGS)))
    assert simulate_command(results, CYCLING.id).endswith("--case c04.slippery.delay_2 --protocol quick --seed 3")
    ids = set(re.findall(r"\bc\d\d\.\w+\.\w+", page.text))
    assert {simulate_command(results, id) for id in ids} <= set(page.copied) and len(ids) > 50
    assert page.text.count(simulate_command(results, CYCLING.id)) == 1, "in the table of failures, to be read"
    for entry in report_payload(Run(results, RECORDINGS))["recordings"]:
        assert entry["command"] == simulate_command(results, entry["id"])


REMARKS = {
    "Incomplete": {"complete": False},
    "V depends on the seed": {"protocol": "quick"},
    "1 ms": {"sample_time": SampleTimeRecord(1e-3, False)},
    "m[1] = 60": {"plant": {"parameters": {"m[1]": 60.0}}},
}


def test_remarks():
    assert remarks(results_of()) == []
    for words, changes in REMARKS.items():
        (remark,) = remarks(results_of(**changes))
        assert words in remark


def test_variables_without_a_unit_are_one_remark():
    def notes(*names: str, unit: str) -> tuple[str, ...]:
        return tuple(f"The controller x.fmu: {name} declares no unit; taken as {unit}" for name in names)

    angles, torques = notes("q_m[1]", "q_m[2]", unit="rad"), notes("u_m[1]", unit="N.m")
    told = "no unit declared: q_m[1], q_m[2] (taken as rad); u_m[1] (taken as N.m)"
    assert collapsed([*angles, "something else", *torques, *angles]) == ["something else", told]
    connectors = {name: BoundRecord(("a", "b"), "exact", found) for name, found in (("q_m", angles), ("u_m", torques))}
    assert remarks(results_of(controller={"connectors": connectors})) == [f"N{told[1:]}."]


def test_requirements_are_told_per_axis():
    rows = requirement_rows(with_case(CYCLING))
    verdicts = {"A1 axis 1": "met", "A1 axis 2": "met", "A2 axis 1": "met", "A2 axis 2": "not met", "A3": "not met"}
    assert {row.label: row.verdict for row in rows} == verdicts
    assert "2.5" in rows[0].title and "1.5 ms" in rows[2].title
    assert (rows[3].amplitude, rows[3].judged.worst_case) == ("20 µm", CYCLING.id)


@pytest.mark.parametrize("width", [40, 60, 140])
def test_terminal_respects_its_width_and_markup_of_others(width):
    text = printed(results_of(controller={"file": "[red]x[/red]\x1b[31m\u202e.fmu"}), width=width)
    assert max(map(len, text.splitlines())) <= width
    assert "\x1b" not in text and "\u202e" not in text
    assert "[red]x[/red]" in text and "140.7" in text
    for name in (*RUN.results.criteria, "A1", "A2", "A3"):
        assert re.search(rf"^ {name}  \w{{4}}", text, re.MULTILINE)
    assert ("c00.compliant" in text) == (width > 40) and text.count(" met ") == 5


def test_failures_and_the_worst_of_failing_requirements_come_with_their_commands():
    cycling = printed(with_case(CYCLING), width=60)
    command = simulate_command(RUN.results, CYCLING.id)
    assert cycling.splitlines()[-2:] == [
        f"{name} not met: 1 of {of} cases had a limit cycle, worst {CYCLING.id}; repeat with {command}"
        for name, of in (("A2", 108), ("A3", 270))
    ]
    gone = result(0, "sticky", "gain_1", None, None, ERROR, "gone")
    failed = printed(results_of([gone, *everything(TABLE_2, [1])]), width=60)
    assert "c00.sticky.gain_1: error: gone" in failed and simulate_command(RUN.results, gone.id) in failed
    lost = {"status": Status.UNSTABLE, "message": "gone", "measurements": Measurements()}
    text = printed(results_of([changed(case, **lost) for case in GOOD]), width=100)
    assert "c00.compliant.noise: unstable: gone" in text and "and 321 more" in text
    assert "No cost V: 108 of the cases that B1 to B7 are measured in are unstable." in text


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_a_terminal_of_any_encoding_shows_the_scorecard_in_colour_if_it_has_any(monkeypatch, encoding):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict")
    monkeypatch.setattr(sys, "stdout", stream)
    show_results(results_of(controller={"file": "Ω.fmu"}), terminal())
    stream.flush()
    text = stream.buffer.getvalue().decode(encoding)
    assert "140.7" in text and ("Ω" in text) == (encoding == "utf-8")
    assert ("10 um" if encoding == "ascii" else "10 µm") in text and "\x1b" not in text
    monkeypatch.setenv("TERM", "xterm-256color")
    for name, colours in (("COLOURFUL", True), ("NO_COLOR", False)):
        monkeypatch.delenv("NO_COLOR", raising=False)
        monkeypatch.setenv(name, "1")
        shown = printed(RUN.results, force_terminal=True, width=80)
        assert bool(re.search(r"\x1b\[[0-9;]*3[0-7]m", shown)) == colours


def test_fragments_say_what_the_tables_say():
    page = Page(results_fragment(with_case(CYCLING)))
    assert page.elements.count("table") == 2 and page.active == []
    assert "140.7" in page.text and CYCLING.id in page.text and page.text.count("not met") == 4
    measured = result(7, "compliant", "disturbance", {"B5": 7.5e-3, "B6": 2.0})
    svg = "<svg onload='alert(1)'></svg>"
    page = Page(simulation_fragment(EVIL, Ending(Status.DONE, 26.0, EVIL), measured, svg))
    assert "script" not in page.elements and page.text.count(EVIL) == 2
    assert "7.5 mm" in page.text and "2 s" in page.text
    ((name, source),) = page.active
    assert base64.b64decode(source.removeprefix("data:image/svg+xml;base64,")).decode() == svg


def test_recordings_that_do_not_belong_to_the_results_are_told_in_red(quick):
    run = quick._run()
    assert contradictions(run) == [] and "note wrong" not in report_html(run)
    changed_recordings = tuple(replace(entry, motion=0.5 * entry.motion) for entry in run.recordings)
    worst = run.results.criteria["B5"].worst_case.id
    told = contradictions(replace(run, recordings=changed_recordings))
    assert any(line.startswith(f"{worst}: B5 is ") for line in told)
    assert "note wrong" in report_html(replace(run, recordings=changed_recordings))
