"""The pages in a real browser: every view, no console error, no request, on a desk and on a phone."""

import pytest
from support.reports import documents

from browser import pages
from browser.pages import (
    DESKTOP,
    PHONE,
    RESULTS,
    chart,
    comparison,
    empty_report,
    legend,
    option,
    report,
    show,
    shown,
    simulations,
    sweep,
    text,
    tuning,
    worst_case,
    zoom,
)
from orchestrator.documents.commands import simulate_command
from orchestrator.views.page import page_html

pytestmark = pytest.mark.slow

VIEWS = {
    report: ("summary", "workspace", "case", "spread", "stability", "motion", "failures"),
    comparison: ("leaderboard", "bars", "difference", "overlay", "seeds"),
    worst_case: ("summary", "search", "effects", "case", "motion", "configurations", "margins", "commands"),
    tuning: ("summary", "history", "parameters", "trade", "judged"),
    sweep: ("summary",),
    simulations: ("overlay", "case", "motion", "summary"),
}
PAPER = (703, 1032)
"""A page of A4 without its margins [CSS pixels]."""
LOOKS = [(DESKTOP, "light"), (PHONE, "dark")]


@pytest.mark.needs("axe_playwright_python")
@pytest.mark.parametrize(("size", "scheme"), LOOKS)
@pytest.mark.parametrize("html", VIEWS)
def test_every_view_is_drawn_fits_the_screen_and_is_accessible(html, size, scheme, open_page):
    from axe_playwright_python.sync_playwright import Axe

    page = open_page(html(), size, scheme)
    assert pages.EVIL in page.locator("#leaderboard" if html is comparison else "h1").inner_text()
    for name in VIEWS[html]:
        show(page, name)
        for each in page.locator(".chart:visible").all():
            assert each.locator("canvas").count() == 1 and len(each.get_attribute("aria-label")) > 20
        for caption in page.locator("figcaption:visible").all_inner_texts():
            assert caption.strip() and "NaN" not in caption and "undefined" not in caption
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), name
        if name == "stability":  # some rows of a long table are enough
            page.locator("#stability .filter").fill("gain_2")
        found = Axe().run(page).response["violations"]
        assert [(entry["id"], [node["html"][:200] for node in entry["nodes"]]) for entry in found] == []


def test_a_report_without_trajectories_opens(open_page):
    page = open_page(empty_report())
    for name in VIEWS[report]:
        show(page, name)


def test_runs_are_told_apart_in_the_figures_of_the_comparison(open_page):
    """By their labels where names are cut, and by colour and dashes."""
    page = open_page(comparison())
    show(page, "overlay")
    page.locator("#pick-which").select_option("0")
    assert [name.split(" ")[0] for name in legend(page, "overlay-B5-error")] == [f"{rank}." for rank in range(1, 8)]
    lines = option(page, "overlay-B5-error")["series"][:7]
    assert len({(line["itemStyle"]["color"], str(line["lineStyle"]["type"])) for line in lines}) == 7
    peaks = [max(error for _, error in line["data"]) for line in lines]
    assert peaks == sorted(set(peaks))


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


def dashes(page, name: str, level: float) -> int:
    """How many dashes of a target line at ``level`` are painted in a chart; letters on the line would count too."""
    return page.evaluate(DASHES, [name, level])


@pytest.mark.parametrize(("size", "scheme"), LOOKS)
def test_targets_are_in_sight_wherever_one_looks(open_page, size, scheme):
    page = open_page(report(), size, scheme)
    show(page, "case")
    page.locator("#pick-case").select_option("0")
    error, path = shown(page, "error"), shown(page, "path")
    assert dashes(page, error, 7) > 5, "the worst B5 as it is shown first"
    assert dashes(page, error, 6.3) < 5, "what is counted are no lines of the chart"
    for section, target in {"Chirp": 0.5, "Force": 7, "Settling": 0.1, "Last": 0.1, "Whole": 7}.items():
        page.locator("#case button:visible", has_text=section).click()
        # Beside a line there are none; on a phone, the one of B5 has five, of which the peak may hide one.
        assert dashes(page, error, target) > 3, section
    zoom(page, error, [11, 12])
    assert dashes(page, error, 7) > 5, "both ends outside"
    grid, place = option(page, path)["grid"][0], page.locator(f"#{path}")
    height = place.evaluate("(place) => place.clientHeight")
    assert grid["width"] == grid["height"] > height - grid["top"] - 70, "the path fills its card"
    show(page, "spread")
    assert dashes(page, "spread-force", 7) > 5
    assert dashes(page, "spread-chirp", 0.5) > 5
    zoom(page, "spread-force", [13, 14.5], 0.5)
    assert dashes(page, "spread-force", 0.1) > 4, "a second of the settled band"
    page = open_page(comparison(), size, scheme)
    show(page, "overlay")
    for index, (criterion, target) in enumerate((("B5", 7), ("B6", 0.1), ("B7", 0.5))):
        page.locator("#pick-which").select_option(str(index))
        assert f"worst case of {criterion}" in text(page, f"#overlay-{criterion}-error-text")
        assert dashes(page, f"overlay-{criterion}-error", target) > 5, criterion


def test_the_path_of_the_tcp_is_a_circle_that_buttons_enlarge(open_page):
    page = open_page(report())
    show(page, "case")
    page.locator("#pick-case").select_option("0")
    path, ends = shown(page, "path"), {}
    for name in ("Settled TCP", "Largest error"):
        page.locator("#case button:visible", has_text=name).click()
        corners = page.evaluate(f"[[-1, -1], [1, 1]].map((end) => {chart(path)}.convertToPixel('grid', end))")
        (left, bottom), (right, top) = corners
        assert right - left == pytest.approx(bottom - top, rel=0.01)
        ends[name] = right - left
    assert ends["Settled TCP"] > 10 * ends["Largest error"]


def test_lines_are_not_broken_where_they_leave_the_chart(open_page):
    """A view that ends below the peak still holds every sample in its times."""
    page = open_page(report())
    show(page, "case")
    error, counts = shown(page, "error"), []
    for top in (None, 0.5):
        zoom(page, error, [10, 11], top)
        counts.append(page.evaluate(f"{chart(error)}.getModel().getSeriesByIndex(0).getData().count()"))
    assert counts[0] == counts[1] > 50


def test_a_click_on_a_criterion_shows_its_worst_case(open_page):
    page = open_page(report())
    for criterion in ("B5", "B7"):
        show(page, "summary")
        page.locator("#summary tr", has=page.locator(f"th:text-is('{criterion}')")).locator("button.link").click()
        assert page.locator("#case").is_visible()
        assert f"worst {criterion}" in text(page, "#case .reason:visible")


def test_both_charts_of_a_case_show_the_section_chosen(open_page):
    page = open_page(report())
    show(page, "case")
    for section, times in {"Chirp": (0.5, 8.5), "Force": (9.8, 12.0), "Whole": (0.0, 26.0)}.items():
        page.locator("#case button:visible", has_text=section).click()
        for name in ("error", "torque"):
            part = option(page, shown(page, name))["dataZoom"][0]
            assert (part["startValue"], part["endValue"]) == pytest.approx(times, abs=0.02), (section, name)


def test_the_map_is_walked_by_keyboard_and_poses_the_arm(open_page):
    page = open_page(report())
    show(page, "workspace")
    page.locator("#heat-layer").select_option(index=7)
    page.locator("#heat button[tabindex='0']").focus()
    told = set()
    for key in ("ArrowRight", "ArrowDown", "ArrowLeft", "ArrowUp"):
        page.keyboard.press(key)
        told.add((text(page, "#heat-cell"), page.locator("#arm path").last.get_attribute("d")))
    assert len({pose for _, pose in told}) == len(told) >= 2


def test_tabs_are_walked_by_keyboard(open_page):
    page = open_page(report())
    page.locator("#tab-summary").click()
    for key, name in (("ArrowRight", "workspace"), ("End", "failures"), ("ArrowRight", "summary")):
        page.keyboard.press(key)
        assert page.locator(f"#{name}").is_visible()


def test_the_arm_plays_pauses_and_is_scrubbed(open_page):
    page = open_page(report())
    show(page, "motion")
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
    page.locator("#scrub").fill("10.1")
    assert "t = 10.100 s" in text(page, "#motion-text") and "force on" in text(page, "#motion-text")


def test_light_and_dark_by_button(open_page):
    page = open_page(report())
    grounds = []
    for _ in range(3):
        grounds.append(page.evaluate("getComputedStyle(document.body).backgroundColor"))
        page.locator("#theme").click()
    page.locator("#theme").click()
    assert grounds[0] == grounds[2] != grounds[1]


def test_stability_tests_are_filtered(open_page):
    page = open_page(report())
    show(page, "stability")
    page.locator("#stability .filter").fill("gain_2")
    tests = page.locator("#stability tbody tr:visible td:nth-child(4)").all_inner_texts()
    assert set(tests) == {"gain_2"} and len(tests) == 54


def test_commands_are_copied_and_told(open_page):
    page = open_page(report())
    show(page, "case")
    for index, id in enumerate((pages.CHIRPED, pages.WORST)):
        page.locator("#pick-case").select_option(str(1 - index))
        assert text(page, "#case .command:visible code") == simulate_command(RESULTS.head, id)
    page.locator("#case .copy:visible").click()
    assert text(page, "#case .copy:visible") == "copied"
    page.evaluate("document.body.append(Object.assign(document.createElement('textarea'), { id: 'pasted' }))")
    page.locator("#pasted").focus()
    page.keyboard.press("Control+V")
    assert page.locator("#pasted").input_value() == simulate_command(RESULTS.head, pages.WORST)
    page.evaluate("document.getElementById('pasted').remove()")


@pytest.mark.parametrize("width", [1100, 1400])
@pytest.mark.parametrize("html", [report, worst_case, tuning])
def test_no_table_of_a_summary_is_cut_on_a_desk(html, width, open_page):
    page = open_page(html(), (width, 900))
    show(page, "summary")
    for region in page.locator("#summary .scroll:visible").all():
        assert region.evaluate("(region) => region.scrollWidth <= region.clientWidth + 1"), region.inner_text()


def test_a_phone_shows_what_a_table_means_and_a_readable_table_of_failures(open_page):
    page = open_page(report(), *LOOKS[1])
    show(page, "summary")
    card = page.locator("#summary .card", has=page.get_by_role("heading", name="Worst case, averaged"))
    region = card.locator(".scroll")
    region.evaluate("(region) => region.scrollTo(10000, 0)")
    box = card.locator(".caption").bounding_box()
    assert region.evaluate("(region) => region.scrollLeft") > 0
    assert box["x"] >= 0 and box["x"] + box["width"] <= PHONE[0]
    show(page, "failures")
    (row,) = page.locator("#failures tbody tr").all()
    assert row.bounding_box()["height"] < 500
    assert row.locator(".copy").get_attribute("data-copy") == simulate_command(RESULTS.head, pages.UNSTABLE.id)


def test_the_name_of_a_case_is_broken_behind_a_point_only(open_page):
    """It was "c02.sli" and "ppery.g" on a phone."""
    page = open_page(report(), *LOOKS[1])
    show(page, "summary")
    for link in page.locator("#summary button.link").all():
        if "." in (name := link.inner_text()) and " " not in name:
            assert link.evaluate("(one) => one.querySelectorAll('wbr').length") == name.count(".")
            lines = link.evaluate("(one) => one.getClientRects().length")
            assert lines <= name.count(".") + 1


def test_a_page_begins_with_what_to_do_next(open_page):
    page = open_page(report())
    show(page, "summary")
    page.locator(".conclusion").wait_for()
    assert (
        page.locator("#summary").evaluate("(summary) => summary.firstElementChild.className").startswith("conclusion")
    )
    page = open_page(worst_case())
    show(page, "summary")
    page.locator(".conclusion button", has_text="margins").click()
    assert page.locator("#margins").is_visible()
    show(page, "summary")
    page.locator(".conclusion button", has_text="worst case of A2").click()
    assert "worst of A2" in text(page, "#case .reason:visible")


# The identifiers in sight that stand on more than one line; those behind a hostile name are of no interest.
BROKEN = """() => {
  const found = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = texts.nextNode()); ) {
    if (node.parentElement.closest("script, style, select") || !node.parentElement.getClientRects().length) continue;
    for (const { 0: name, index } of node.data.matchAll(/[\\w-]*[A-Za-z_][\\w-]*/g)) {
      const range = document.createRange();
      range.setStart(node, index);
      range.setEnd(node, index + name.length);
      const lines = new Set([...range.getClientRects()].filter((box) => box.width).map((box) => Math.round(box.top)));
      if (lines.size > 1 && name.length <= 40) found.push([name, node.data.slice(0, 80)]);
    }
  }
  return found;
}"""


@pytest.mark.parametrize("name", ["evaluation", "verification", "comparison", "search", "sample", "tuning"])
def test_no_identifier_is_broken_inside_on_a_phone_and_paper_shows_whole_tables(name, open_page):
    """It was "--" and "protocol", "c00.compliant.disturb" and "ance" on a phone; paper had 20 rows of a long table."""
    html = page_html(documents()[name].page())
    page = open_page(html, PHONE)
    tabs = page.locator('[role="tab"]').all()
    for tab in tabs:
        tab.click()
        assert page.evaluate(BROKEN) == [], tab.inner_text()
    page = open_page(html, PAPER)
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    tables = page.locator(".scroll")
    for wide, size in ((False, PAPER), (True, PAPER[::-1])):
        page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
        for table in tables.all():
            if (table.evaluate("(one) => one.matches('.many')")) == wide:
                ends = table.evaluate(
                    "(one) => [one.scrollWidth - one.clientWidth, one.scrollHeight - one.clientHeight]"
                )
                assert max(ends) <= 1, (table.get_attribute("aria-label"), ends)
    for requirement in ("A1", "A2", "A3"):
        shown = page.locator("th, td", has_text=requirement).locator("visible=true")
        assert shown.count() > 0 or name == "tuning"
    page.evaluate("dispatchEvent(new Event('afterprint'))")


@pytest.mark.parametrize("html", [report, comparison])
def test_every_tab_is_printed(html, open_page):
    page = open_page(html())
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    for name in VIEWS[html]:
        assert page.locator(f"#{name}").is_visible()
        for each in page.locator(f"#{name} .chart:visible").all():
            assert each.locator("canvas").count() == 1
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    page.emulate_media(media="screen")
    assert sum(page.locator(f"#{name}").is_visible() for name in VIEWS[html]) == 1
