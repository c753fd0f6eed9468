"""What the pages draw: numbers of hand-made runs, read back from the charts and drawings."""

from __future__ import annotations

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
