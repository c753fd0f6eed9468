"""The report of an evaluation: what its page and its scorecard say, and what a reader must know."""

import base64
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from lxml.html import fromstring
from msgspec.structs import replace as changed
from rich.console import Console
from support.reports import CONTROLLER, RECORDINGS, recording, results_of, unbroken
from support.results import TABLE_2, everything, result

from orchestrator.benchmark.results import Measurements
from orchestrator.documents.commands import simulate_command
from orchestrator.documents.evaluation import Evaluation
from orchestrator.documents.head import BoundRecord, SampleTimeRecord
from orchestrator.documents.recording import ROWS
from orchestrator.documents.results import LoopDelay, contradictions
from orchestrator.documents.scorecard import facts
from orchestrator.documents.wording import collapsed, remarks, requirement_rows
from orchestrator.documents.worst_page import margin_table
from orchestrator.documents.worst_plots import margins
from orchestrator.loop.trajectory import Status
from orchestrator.search.findings import Margin, Radius
from orchestrator.views.page import page_data, page_html
from orchestrator.views.table import VERDICTS, shown
from orchestrator.views.terminal import show
from orchestrator.views.units import NONE

RUN = Evaluation(results_of(), RECORDINGS)
ERROR, GOOD = Status.ERROR, everything(TABLE_2)
CYCLING = result(4, "slippery", "delay_2", {}, 2e-5)


class Page:
    """The text of an evaluation's page, and the commands that it lets copy."""

    def __init__(self, run: Evaluation):
        root = fromstring(unbroken(page_html(run.page())))
        self.text = " ".join(" ".join(root.itertext()).split())
        self.copied = [element.get("data-copy") for element in root.iter() if "data-copy" in element.attrib]


def with_case(other, **changes):
    """Results of all cases, one of them replaced."""
    return results_of([other if case.id == other.id else case for case in GOOD], **changes)


def printed(results, width: int) -> str:
    """What a terminal shows of results."""
    console = Console(file=io.StringIO(), emoji=False, width=width)
    show(Evaluation(results).summary(), console)
    return console.file.getvalue()


def test_headline_and_verdicts():
    narrow = printed(RUN.results, width=40)
    assert "140.7" in narrow and narrow.count(" met ") == 5
    for name in (*RUN.criteria, "A1", "A2", "A3"):
        assert re.search(rf"^ {name}  \w{{4}}", narrow, re.MULTILINE)
    text = Page(RUN).text
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


def test_a_page_stays_below_5_MB_and_keeps_every_peak_however_lively_its_signals():
    # The largest error is at neither coordinate's extremes.
    offsets = np.array([[1, 0], [0.9, 0.9], [0, 1], [-1, 0], [0, -1]], np.float32)
    noise = np.random.default_rng(0)
    motion = np.column_stack([np.arange(10_000), np.resize(offsets, (10_000, 2)), noise.standard_normal((10_000, 2))])
    torque = np.column_stack([np.arange(4000), noise.standard_normal((4000, 2))]).astype(np.float32)
    lively = replace(recording(("B5",)), motion=motion.astype(np.float32), torque=torque)
    run = replace(RUN, recordings=(lively,) * 30 + (replace(lively, about=recording(("spread",)).about),) * 20)
    assert len(page_html(run.page()).encode()) < 5e6
    data = page_data(run.page())
    (shown,) = (motion["moved"] for motion in data["motions"].values())
    for entry in shown[:1] + shown[-1:]:
        x, z = unpacked(data, entry["motion"])[:, 1:3].T
        assert np.hypot(x, z).max() == pytest.approx(1e3 * lively.error.max(), rel=1e-6)
        low, high = (unpacked(data, entry["torque"])[:, columns] for columns in ((1, 2), (-2, -1)))
        np.testing.assert_array_equal((low.min(0), high.max(0)), (torque.min(0)[1:], torque.max(0)[1:]))
    for table, whole in (("motion", motion), ("torque", torque)):
        assert len(shown) == 30 and sum(len(unpacked(data, entry[table])) for entry in shown) <= ROWS < 30 * len(whole)


def unpacked(data, numbers: list[int]) -> np.ndarray:
    """Columns of a page, shape (N, columns)."""
    return np.column_stack([np.frombuffer(base64.b64decode(data["columns"][number]), "<f4") for number in numbers])


def test_a_controller_that_fails_everywhere_has_a_report():
    failed = [result(case.configuration.index, case.system, case.test, None, None, ERROR) for case in GOOD]
    text = Page(Evaluation(results_of(failed))).text
    assert "No cost" in text and "made without trajectories" in text
    assert text.count("✗ not met") == 5 and text.count("✗ error") == 324


def test_every_case_in_sight_comes_with_the_command_that_repeats_it():
    results = with_case(changed(CYCLING, status=Status.UNSTABLE), seed=3, protocol="quick")
    run = Evaluation(results, RECORDINGS)
    page = Page(run)
    assert simulate_command(results.head, CYCLING.id).endswith("--case c04.slippery.delay_2 --protocol quick --seed 3")
    ids = set(re.findall(r"\bc\d\d\.\w+\.\w+", page.text))
    assert {simulate_command(results.head, id) for id in ids} <= set(page.copied) and len(ids) > 50
    assert page.text.count(simulate_command(results.head, CYCLING.id)) == 3, (
        "with the conclusion and the requirements, to be read"
    )
    for entry in run.recordings:
        assert simulate_command(results.head, entry.about.id) in page.copied


REMARKS = {
    "Incomplete": {"complete": False},
    "its result depends on the seed": {"protocol": "quick"},
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
    assert {row.label: VERDICTS[row.judged.passed] for row in rows} == verdicts
    assert "2.5" in rows[0].title and "1.5 ms" in rows[2].title
    assert (rows[3].amplitude, rows[3].judged.worst_case) == ("20 µm", CYCLING.id)


def test_failures_and_the_worst_of_failing_requirements_come_with_their_commands():
    cycling = printed(with_case(CYCLING), width=60)
    command = simulate_command(RUN.head, CYCLING.id)
    assert cycling.splitlines()[-2:] == [
        f"{name} not met: 1 of {of} cases had a limit cycle, worst {CYCLING.id}; repeat with {command}"
        for name, of in (("A2", 108), ("A3", 270))
    ]
    gone = result(0, "sticky", "gain_1", None, None, ERROR, "gone")
    failed = printed(results_of([gone, *everything(TABLE_2, [1])]), width=60)
    assert "c00.sticky.gain_1: error: gone" in failed and simulate_command(RUN.head, gone.id) in failed
    lost = {"status": Status.UNSTABLE, "message": "gone", "measurements": Measurements()}
    text = printed(results_of([changed(case, **lost) for case in GOOD]), width=100)
    assert "c00.compliant.noise: unstable: gone" in text and "and 321 more" in text
    assert "No cost V: 108 of the cases that B1 to B7 are measured in are unstable." in text


def test_recordings_that_do_not_belong_to_the_results_are_told(quick):
    assert contradictions(quick) == [] and "recordings differ" not in page_html(quick.page())
    wrong = replace(quick, recordings=tuple(replace(entry, motion=0.5 * entry.motion) for entry in quick.recordings))
    worst = quick.criteria["B5"].worst_case.id
    assert any(line.startswith(f"{worst}: B5 is ") for line in contradictions(wrong))
    assert f"recordings differ. {worst}: B5 is " in unbroken(page_html(wrong.page()))


def test_a_margin_that_was_not_refined_does_not_look_measured():
    rules = results_of().rules
    found = {
        "gain_1": Margin(20.0, 20.0, refined=False),
        "gain_1_down": Margin(0.05, 0.05, refined=False),
        "gain_2": Margin(4.0, 20.0),
        "delay_1": Margin(1.5e-3, 1e-2, refined=False),
        "delay_2": Margin(None, 1e-2),
    }
    reach = Radius(1.2, 0.75, 1.2, cost_refined=False)
    cells = [shown(row[1], NONE) for row in margin_table(rules, found, reach).rows]
    assert cells == ["≤ 20", "≥ 0.05", "4", "≤ 1.5", "> 10", "≤ 1.2", "0.75"]
    bars = {plot.id: [(line.labels, line.colour) for line in plot.series] for plot in margins(rules, found, reach)}
    assert bars == {
        "margins-gain": [(("0.05 or more", "20 or less"), "soft"), (("", "4"), "good")],
        "margins-delay": [(("", "1.5 or less"), "bad"), (("", "> 10"), "good")],
        "margins-radius": [(("", "1.2 or less"), "soft"), (("", "0.75"), "bad")],
    }
