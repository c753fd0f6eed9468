"""What the pages draw: numbers of hand-made runs, read back from the charts and drawings."""

from __future__ import annotations

from dataclasses import replace

import pytest
from reports import evaluation, recording, stored

from orchestrator.report.files import REPORT
from orchestrator.report.report_page import report_html

pytestmark = pytest.mark.slow


@pytest.fixture
def page_of(tmp_path, plant_file, pid_file, open_page):
    """Opens the report of a run with these recordings and results."""

    def opened(recordings=(), results=None, size=None, **changes):
        run = stored(tmp_path, evaluation(plant_file, pid_file, results, **changes), tuple(recordings))
        file = tmp_path / REPORT
        file.write_text(report_html(run), encoding="utf-8")
        return open_page(file, size) if size else open_page(file)

    return opened


def show(page, view: str) -> None:
    page.locator(f"#tab-{view}").click()


def option(page, chart: str) -> dict:
    """What ECharts was given to draw."""
    script = "(id) => echarts.getInstanceByDom(document.getElementById(id)).getOption()"
    return page.evaluate(script, chart)


def series(page, chart: str) -> dict[str, list]:
    """The data of the named lines of a chart; of those that share a name, the first."""
    return {line["name"]: line["data"] for line in reversed(option(page, chart)["series"])}


def spread(size: float, system: str):
    return recording(("spread",), f"c07.{system}.disturbance", size, system=system)


def test_the_assumed_and_the_worst_system_stand_out_in_the_spread(page_of):
    sizes = {"compliant": 6e-3, "random_1": 3e-3, "random_2": 11e-3, "random_3": 4e-3}
    page = page_of([recording(("B5",)), *(spread(size, system) for system, size in sizes.items())])
    show(page, "spread")
    for chart, factor, target in (("spread-force", 1, 7), ("spread-chirp", 0.1, 0.5)):
        names = option(page, chart)["legend"][0]["data"]
        assert names == ["compliant", "random_2 (worst)", "2 others"]
        lines = [line for line in option(page, chart)["series"] if line["name"] in names]
        assert [line["name"] for line in lines] == [*names, "2 others"]
        assert len({line["itemStyle"]["color"] for line in lines}) == 3
        end = 10 if chart == "spread-chirp" else 26
        tops = [max(error for t, error in line["data"] if t < end) for line in lines]
        assert tops == pytest.approx([factor * size for size in (6, 11, 3, 4)], rel=3e-2)
        assert any(f"target {target} mm" in name for name in series(page, chart))
    assert "1 of 4 above the target of 7 mm" in page.locator("#spread-force-text").inner_text()
    assert "2 of 4 above the target of 0.5 mm" in page.locator("#spread-chirp-text").inner_text()


def ended(recording_, time: float):
    """The recording of a case that ended unstable."""
    motion, torque = (table[table[:, 0] <= time] for table in (recording_.motion, recording_.torque))
    return replace(
        recording_, about=replace(recording_.about, status="unstable", time=time), motion=motion, torque=torque
    )


@pytest.mark.parametrize(
    ("time", "error", "path"),
    [
        (
            0.27,
            "ended at 0.27 s, before the chirp and the force of 500.0 N",
            "the case ended at 0.27 s, before the force",
        ),
        (5.0, "0.8 mm due to the chirp; the largest at 0.75 s", "the case ended at 5 s, before the force"),
        (5.0, "ended at 5 s, before the force of 500.0 N", "the case ended at 5 s, before the force"),
        (
            12.0,
            "7.84 mm due to the force",
            "leaves the large one and ended at 12 s, before it was to be inside the small",
        ),
        (26.0, "7.84 mm due to the force", "leaves the large one and is inside the small one in time"),
    ],
)
def test_what_a_case_did_not_live_to_see_is_not_judged(page_of, time, error, path):
    page = page_of([ended(recording(("B5",)), time)])
    show(page, "case")
    assert error in page.locator("#error-chart-text").inner_text()
    assert path in page.locator("#path-chart-text").inner_text()
    if time < 26:
        for chart in ("error-chart", "path-chart"):
            text = page.locator(f"#{chart}-text").inner_text()
            assert " 0 mm due" not in text and "in time" not in text


def test_a_system_that_ended_early_has_no_error_of_zero_in_the_spread(page_of):
    page = page_of([recording(("B5",)), spread(6e-3, "compliant"), ended(spread(3e-3, "random_1"), 0.27)])
    show(page, "spread")
    force, chirp = (page.locator(f"#spread-{name}-text").inner_text() for name in ("force", "chirp"))
    assert "0 of 1 above the target of 7 mm; 1 ended before the force" in force
    assert "1 of 1 above the target of 0.5 mm; 1 ended before it" in chirp
    assert "from 0 " not in force + chirp
