"""The pages in a real browser: every view of a real run, no console error, no request, on a desk and on a phone."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace

import pytest
from reports import TABLE_2, evaluation, recording, stored
from results import everything

from browser.conftest import DESKTOP, PHONE
from orchestrator import compare, evaluate
from orchestrator.cosim.controller import Setup
from orchestrator.report.compare_page import FILE as COMPARE_PAGE
from orchestrator.report.files import REPORT as REPORT_PAGE
from orchestrator.report.report_page import report_html

pytestmark = pytest.mark.slow

VIEWS = ("summary", "workspace", "case", "spread", "stability", "motion", "failures")
COMPARE_VIEWS = ("leaderboard", "bars", "difference", "overlay")
NAME = "<img src=x onerror=alert(1)>.fmu" if os.name == "posix" else "odd & name.fmu"


@pytest.fixture(scope="module")
def report(chromium, tmp_path_factory, pid_c_file):
    """The report of a quick evaluation of a controller with a hostile name."""
    folder = tmp_path_factory.mktemp("report")
    controller = shutil.copy(pid_c_file, folder / NAME)
    assert evaluate.main([str(controller), "--quick", "--output-dir", str(folder / "run")]) == 0
    return folder / "run" / REPORT_PAGE


@pytest.fixture(scope="module")
def comparison(tmp_path_factory, plant_file, pid_file):
    """The comparison of eight runs made by hand, with a hostile name; one must not be ranked with the others."""
    folder = tmp_path_factory.mktemp("comparison")
    controller = shutil.copy(pid_file, folder / NAME)
    folders = []
    for number in range(8):
        gain = 0.6 + 0.2 * number
        setup = Setup({"proportional_gain_of_axis_1": gain})
        made = evaluation(plant_file, controller, everything({k: gain * v for k, v in TABLE_2.items()}), setup=setup)
        recordings = tuple(recording((name,), size=gain * 8e-3) for name in ("B5", "B6", "B7"))
        run = stored(folder / f"run_{number}", replace(made, seed=int(number == 7)), recordings)
        folders.append(str(run.folder))
    assert compare.main([*folders, "--output-dir", str(folder)]) == 0
    return folder / COMPARE_PAGE


def view(page, name):
    """Show a view by its tab."""
    page.locator(f"#tab-{name}").click()
    assert page.locator(f"#{name}").is_visible()
    assert page.locator('[role="tabpanel"]:visible').count() == 1


def check_charts(page):
    """Every figure in sight is drawn and has a text."""
    for chart in page.locator(".chart:visible").all():
        assert chart.locator("canvas").count() == 1
        assert len(chart.get_attribute("aria-label")) > 20
    for caption in page.locator("figcaption:visible").all():
        assert caption.inner_text().strip()
        assert "NaN" not in caption.inner_text() and "undefined" not in caption.inner_text()


@pytest.mark.parametrize(("size", "device"), [(DESKTOP, "desk"), (PHONE, "phone")])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_view_of_the_report(report, open_page, screenshot, size, device, scheme):
    page = open_page(report, size, scheme)
    assert page.locator("h1").inner_text() == NAME
    for name in VIEWS:
        view(page, name)
        check_charts(page)
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), name
        screenshot(page, f"report-{name}-{device}-{scheme}")


@pytest.mark.parametrize(("size", "device"), [(DESKTOP, "desk"), (PHONE, "phone")])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_view_of_the_comparison(comparison, open_page, screenshot, size, device, scheme):
    page = open_page(comparison, size, scheme)
    for name in COMPARE_VIEWS:
        view(page, name)
        check_charts(page)
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), name
        screenshot(page, f"compare-{name}-{device}-{scheme}")
    view(page, "overlay")
    for criterion, target in (("B5", 7), ("B6", 0.1), ("B7", 0.5)):
        page.locator("#which").select_option(criterion)
        assert f"worst case of {criterion}" in page.locator("#overlay-chart-text").inner_text()
        assert dashes(page, "overlay-chart", target) > 5, criterion
        screenshot(page, f"compare-overlay-{criterion}-{device}-{scheme}")


def test_runs_are_told_apart_in_the_figures_of_the_comparison(comparison, open_page):
    """By their labels where names are cut, and by colour and dashes."""
    page = open_page(comparison)
    view(page, "bars")
    names = page.evaluate("runs.map((run) => run.label)")
    assert [name.split(" ")[0] for name in names] == [f"{rank}." for rank in range(1, 8)]
    view(page, "overlay")
    option = "echarts.getInstanceByDom($('#overlay-chart')).getOption()"
    lines = page.evaluate(f"{option}.series.slice(0, 7).map((line) => [line.itemStyle.color, line.lineStyle.type])")
    assert len({tuple(line) for line in lines}) == len(lines) == 7
    peaks = page.evaluate(f"{option}.series.slice(0, 7).map((line) => Math.max(...line.data.map((point) => point[1])))")
    assert peaks == sorted(set(peaks)) and len(peaks) == 7


def check_accessibility(page):
    """Axe finds nothing."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    found = axe.Axe().run(page).response["violations"]
    assert [(entry["id"], [node["html"][:200] for node in entry["nodes"]]) for entry in found] == []


@pytest.mark.parametrize("name", [*VIEWS])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_report_is_accessible(report, open_page, name, scheme):
    page = open_page(report, scheme=scheme)
    view(page, name)
    check_accessibility(page)


@pytest.mark.parametrize("name", [*COMPARE_VIEWS])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_comparison_is_accessible(comparison, open_page, name, scheme):
    page = open_page(comparison, scheme=scheme)
    view(page, name)
    check_accessibility(page)


# How many separate dashes of the limits' colour a chart has within 2 pixels of `level`, from the left to the right.
DASHES = """([id, level]) => {
  const place = document.getElementById(id);
  const chart = echarts.getInstanceByDom(place);
  const canvas = place.querySelector("canvas");
  const scale = canvas.width / place.clientWidth;
  const row = Math.round(scale * chart.convertToPixel({ yAxisIndex: 0 }, level));
  const copy = document.createElement("canvas");  // to read the chart's own often slows it down, says Chromium
  [copy.width, copy.height] = [canvas.width, 5];
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 2 - row);
  const pixels = context.getImageData(0, 0, canvas.width, 5).data;
  const wanted = colour("limit").match(/[0-9]+/g).map(Number);
  const alike = (at) => wanted.every((value, channel) => Math.abs(pixels[at + channel] - value) < 60);
  const painted = (x) => [0, 1, 2, 3, 4].some((y) => alike(4 * (y * canvas.width + x)));
  return Array.from({ length: canvas.width - 1 }, (_, x) => painted(x + 1) && !painted(x)).filter(Boolean).length;
}"""


def dashes(page, chart: str, level: float) -> int:
    """How many dashes of a target line at ``level`` are painted in a chart; letters on the line would count too."""
    return page.evaluate(DASHES, [chart, level])


@pytest.mark.parametrize("size", [DESKTOP, PHONE])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_targets_are_in_sight_in_every_section_of_a_case(report, open_page, size, scheme):
    page = open_page(report, size, scheme)
    view(page, "case")
    assert dashes(page, "error-chart", 7) > 5, "the worst B5 as it is shown first"
    assert dashes(page, "error-chart", 6.3) < 5, "what is counted are no lines of the chart"
    for section, targets in {"Chirp": [0.5], "Force": [7], "Settling": [0.1], "Last": [0.1], "Whole": [7]}.items():
        page.locator("#windows").get_by_role("button", name=section).click()
        assert [dashes(page, "error-chart", target) > 4 for target in targets] == [True] * len(targets), section
    page.evaluate("zoomTo(echarts.getInstanceByDom($('#error-chart')), 11, 12)")
    assert dashes(page, "error-chart", 7) > 5, "both ends outside"


@pytest.mark.parametrize("size", [DESKTOP, PHONE])
def test_targets_are_in_sight_in_the_spread(report, open_page, size):
    page = open_page(report, size)
    view(page, "spread")
    assert dashes(page, "spread-force", 7) > 5
    assert dashes(page, "spread-chirp", 0.5) > 5
    page.evaluate("zoomTo(echarts.getInstanceByDom($('#spread-force')), 13, 14.5, 0.5)")
    assert dashes(page, "spread-force", 0.1) > 4, "a second of the settled band"


def test_lines_are_not_broken_where_they_leave_the_chart(report, open_page):
    """A view that ends below the peak still holds every sample in its times."""
    page = open_page(report)
    view(page, "case")
    count = "echarts.getInstanceByDom($('#error-chart')).getModel().getSeriesByIndex(0).getData().count()"
    page.evaluate("zoomTo(echarts.getInstanceByDom($('#error-chart')), 10, 11)")
    whole = page.evaluate(count)
    page.evaluate("zoomTo(echarts.getInstanceByDom($('#error-chart')), 10, 11, 0.5)")
    assert page.evaluate(count) == whole > 50


def test_a_click_on_a_criterion_shows_its_worst_case(report, open_page):
    page = open_page(report)
    for criterion in ("B5", "B7"):
        view(page, "summary")
        page.locator("#summary tr", has=page.locator(f"th:text-is('{criterion}')")).locator("button").click()
        assert page.locator("#case").is_visible()
        assert f"worst {criterion}" in page.locator("#case-text").inner_text()


def test_zoom_by_button_and_whole(report, open_page):
    page = open_page(report)
    view(page, "case")
    option = "echarts.getInstanceByDom(document.querySelector('#error-chart')).getOption().dataZoom[0]"
    seen = f"[{option}.startValue, {option}.endValue]"
    page.get_by_role("button", name="Chirp").click()
    assert page.evaluate(seen)[1] == pytest.approx(8.5, abs=0.01)
    page.get_by_role("button", name="Whole").click()
    assert page.evaluate(seen) == pytest.approx([0, 26], abs=0.01)
    torque = seen.replace("error-chart", "torque-chart")
    page.get_by_role("button", name="Force").click()
    assert page.evaluate(torque)[0] == pytest.approx(9.8, abs=0.01), "both charts show the same time"


def test_the_map_is_walked_by_keyboard_and_poses_the_arm(report, open_page):
    page = open_page(report)
    view(page, "workspace")
    page.locator("#quantity").select_option("B7")
    page.locator("#heat button[tabindex='0']").focus()
    told = set()
    for key in ("ArrowRight", "ArrowDown", "ArrowLeft", "ArrowUp"):
        page.keyboard.press(key)
        told.add((page.locator("#arm-text").inner_text(), page.locator("#arm path").last.get_attribute("d")))
    assert len({pose for _, pose in told}) == len(told) >= 2


def test_tabs_are_walked_by_keyboard(report, open_page):
    page = open_page(report)
    page.locator("#tab-summary").focus()
    page.keyboard.press("ArrowRight")
    assert page.locator("#workspace").is_visible()
    page.keyboard.press("End")
    assert page.locator("#failures").is_visible()
    page.keyboard.press("ArrowRight")
    assert page.locator("#summary").is_visible()


def test_the_arm_plays_pauses_and_is_scrubbed(report, open_page):
    page = open_page(report)
    view(page, "motion")
    now = "Number(document.querySelector('#scrub').value)"
    begin = page.evaluate(now)
    page.locator("#play").click()
    for _ in range(100):
        page.wait_for_timeout(100)
        if page.evaluate(now) > begin + 0.02:
            break
    assert page.evaluate(now) > begin + 0.02
    page.locator("#play").click()
    stopped = page.evaluate(now)
    page.wait_for_timeout(200)
    assert page.evaluate(now) == stopped
    before = page.locator("#stage path").all()[-3].get_attribute("d")
    page.locator("#scrub").fill("10.1")
    assert "t = 10.100 s" in page.locator("#motion-text").inner_text()
    assert "force on" in page.locator("#motion-text").inner_text()
    assert page.locator("#stage path").all()[-3].get_attribute("d") != before


def test_light_and_dark_by_button(report, open_page):
    page = open_page(report, scheme="light")
    ground = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(ground)
    page.locator("#theme").click()
    assert page.evaluate(ground) != light


def test_stability_tests_are_filtered(report, open_page):
    page = open_page(report)
    view(page, "stability")
    page.locator("#stability-test").select_option("gain_2")
    tests = page.locator("#stability-table tbody tr:visible td:nth-child(4)").all_inner_texts()
    assert set(tests) == {"gain_2"} and len(tests) == 4


def test_a_report_without_trajectories_opens(tmp_path, plant_file, pid_file, open_page):
    run = stored(tmp_path, evaluation(plant_file, pid_file, []), ())
    file = tmp_path / REPORT_PAGE
    file.write_text(report_html(run), encoding="utf-8")
    page = open_page(file)
    for name in VIEWS:
        view(page, name)


def test_scripts_in_names_and_messages_do_not_run(tmp_path, plant_file, pid_file, open_page):
    evil = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    run = stored(tmp_path, evaluation(plant_file, pid_file))
    run.document["controller"].update(file=evil, generation_tool=evil)
    run.document["cases"][0].update(id=evil, system=evil, status="error", message=evil)
    file = tmp_path / REPORT_PAGE
    file.write_text(report_html(run), encoding="utf-8")
    page = open_page(file)
    assert page.locator("h1").inner_text() == evil
    for name in VIEWS:
        view(page, name)
        check_charts(page)
