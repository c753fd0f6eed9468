"""What the pages draw: numbers of hand-made runs, read back from the charts and drawings."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from closed_loops import PAPER
from reports import TABLE_2, evaluation, recording, stored
from results import everything, result

from browser.conftest import DESKTOP, PHONE
from orchestrator.cosim.controller import Setup
from orchestrator.report.compare_page import FILE as COMPARISON
from orchestrator.report.compare_page import compare_html
from orchestrator.report.comparison import compare
from orchestrator.report.files import REPORT
from orchestrator.report.report_page import report_html
from plant_fmu.flexible_manipulator import coefficients, kinematics
from plant_fmu.flexible_manipulator.parameters import NOMINAL

pytestmark = pytest.mark.slow


@pytest.fixture
def page_of(tmp_path, plant_file, pid_file, open_page):
    """Opens the report of a run with these recordings and results."""

    def opened(recordings=(), results=None, size=DESKTOP, **changes):
        run = stored(tmp_path, evaluation(plant_file, pid_file, results, **changes), tuple(recordings))
        file = tmp_path / REPORT
        file.write_text(report_html(run), encoding="utf-8")
        return open_page(file, size)

    return opened


@pytest.fixture
def comparison_of(tmp_path, plant_file, pid_file, open_page):
    """Opens the comparison of runs given by their results and recordings, which are named A, B, ..."""

    def opened(*runs, size=DESKTOP, **changes):
        made = []
        for name, (results, recordings) in zip("ABC", runs, strict=False):
            of = evaluation(plant_file, pid_file, results, setup=Setup({name: 1.0}), **changes)
            made.append(stored(tmp_path / name, of, tuple(recordings)))
        file = tmp_path / COMPARISON
        file.write_text(compare_html(compare(made)), encoding="utf-8")
        return open_page(file, size)

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


def lively(roles=("B5",), **changes):
    """A recording whose TCP moves differently along x and z, and whose links and torques differ."""
    made = recording(roles, **changes)
    t = made.motion[:, 0]
    decay = np.exp(-np.clip(t - 10, 0, None)) * (t > 9.99)
    motion = np.column_stack([t, 6e-3 * decay, -2e-3 * decay * np.cos(t), 3e-3 * decay, -5e-3 * decay])
    torque = np.column_stack([t, 3 * np.sin(t), 7 * np.cos(t)])
    return replace(made, motion=motion.astype(np.float32), torque=torque.astype(np.float32))


def poses() -> list[tuple[float, float]]:
    """The link angles of the configurations [rad]."""
    return [(entry.q_a1, entry.q_a2) for entry in PAPER.grid]


def points(page, selector: str) -> np.ndarray:
    """The corners of a polygon drawn as M..L..L.., shape (N, 2)."""
    path = page.locator(selector).get_attribute("d")
    return np.array([[float(number) for number in corner.split(",")] for corner in re.split("[ML]", path)[1:]])


def test_the_arm_stands_where_the_plants_kinematics_put_it(page_of):
    page = page_of()
    show(page, "workspace")
    arm = coefficients.arm(NOMINAL)
    dots = page.locator("#arm g > circle[r='0.06']").evaluate_all(
        "(all) => all.map((c) => [c.cx.baseVal.value, c.cy.baseVal.value])"
    )
    np.testing.assert_allclose(dots, [kinematics.tcp(arm, *pose) for pose in poses()], atol=1e-6)
    assert len(dots) == 18
    for q_a1, q_a2 in poses():
        name = f"at q_a1 {math.degrees(q_a1):.0f}°, q_a2 {math.degrees(q_a2):.0f}°"
        page.locator(f'#heat button[aria-label$="{name}"]').focus()
        elbow = kinematics.tcp(arm._replace(l_2=0.0), q_a1, q_a2)
        drawn = points(page, "#arm g > g > path")
        np.testing.assert_allclose(drawn, [(0, 0), elbow, kinematics.tcp(arm, q_a1, q_a2)], atol=1e-6)


def test_the_arm_in_motion_is_bent_by_the_magnified_angles_and_so_are_the_circles(page_of):
    shown = lively()
    page = page_of([shown])
    show(page, "motion")
    page.locator("#magnify").fill("2")
    page.locator("#scrub").fill("10.2")
    arm, row = coefficients.arm(NOMINAL), int(np.argmin(abs(shown.motion[:, 0] - 10.2)))
    bent = [angle + 100 * change for angle, change in zip(shown.about.q_a, shown.motion[row, 3:], strict=True)]
    np.testing.assert_allclose(points(page, "#stage g[opacity='1'] path")[2], kinematics.tcp(arm, *bent), atol=1e-4)
    resting = points(page, "#stage g[opacity='0.45'] path")[2]
    np.testing.assert_allclose(resting, kinematics.tcp(arm, *shown.about.q_a), atol=1e-6)
    circles = page.locator("#stage g > circle[stroke-dasharray]")
    drawn = circles.evaluate_all("(all) => all.map((c) => [c.cx, c.cy, c.r].map((length) => length.baseVal.value))")
    np.testing.assert_allclose(drawn, [[*resting, 0.7], [*resting, 0.01]], atol=1e-6)
    _, x, z = shown.motion[row, :3]
    assert (
        f"TCP error {1e3 * math.hypot(x, z):.3f} mm, u_m1 {shown.torque[row, 1]:.3g} Nm"
        in page.locator("#motion-text").inner_text()
    )


def test_a_case_is_drawn_in_mm_and_nm_with_its_targets_and_limits(page_of):
    shown = lively()
    page = page_of([shown])
    show(page, "case")
    t, x, z = shown.motion[:, :3].T
    drawn = series(page, "error-chart")
    np.testing.assert_allclose(drawn["TCP error"], np.column_stack([t, 1e3 * np.hypot(x, z)]), rtol=1e-5)
    for name, first, last, level in (
        ("B7 target 0.5 mm", 0.5, 10, 0.5),
        ("B5 target 7 mm", 10, 13.5, 7),
        ("settled 0.1 mm", 13.5, 26, 0.1),
    ):
        times, levels = np.transpose(drawn[name])
        assert (times[0], times[-1], set(levels)) == (first, last, {level})
    torques = series(page, "torque-chart")
    for number in (1, 2):
        np.testing.assert_allclose(torques[f"u_m{number}"], shown.torque[:, [0, number]], rtol=1e-6)
    (first, *_) = option(page, "torque-chart")["series"]
    assert sorted(line["yAxis"] for line in first["markLine"]["data"]) == [-35, -20, 20, 35]


def test_the_path_has_x_to_the_right_z_upwards_and_the_circles_of_b5_and_b6(page_of):
    shown = lively()
    page = page_of([shown])
    show(page, "case")
    drawn, t = series(page, "path-chart"), shown.motion[:, 0]
    paths = {"force and settling": (t >= 10) & (t < 13.5), "after 3 s of settling": t >= 13.5}
    for name, rows in paths.items():
        np.testing.assert_allclose(drawn[name], 1e3 * shown.motion[rows, 1:3], rtol=1e-5)
    for name, radius in (("7 mm", 7), ("0.1 mm", 0.1)):
        np.testing.assert_allclose(np.hypot(*np.transpose(drawn[name])), radius)
    given = option(page, "path-chart")
    assert given["xAxis"][0]["name"] == "x offset [mm]" and given["yAxis"][0]["name"] == "z offset [mm]"


def test_limit_cycles_are_drawn_and_listed_in_micrometres_beside_their_limit(page_of):
    cycles = {"gain_1": (3e-6, 1e-6), "gain_2": (1e-6, 25e-6), "delay_1": (1e-10, 0.0)}
    page = page_of([recording(("B5",))], [result(7, "slippery", test, {}, cycle) for test, cycle in cycles.items()])
    show(page, "stability")
    drawn = series(page, "stability-chart")
    assert {name: [point["value"][1] for point in of] for name, of in drawn.items()} == {
        "gain_1": [pytest.approx(3)],
        "gain_2": [pytest.approx(25)],
        "delay_1": [0.01],  # the smallest that is drawn
    }
    assert drawn["delay_1"][0]["micro"] == pytest.approx(1e-4)
    assert {round(point["value"][0]) for of in drawn.values() for point in of} == {7}
    (limit,) = option(page, "stability-chart")["series"][0]["markLine"]["data"]
    assert (limit["yAxis"], limit["name"]) == (10, "10 µm")
    assert page.locator("#stability-table .figure").all_inner_texts() == ["25", "3", "0.0001"]
    assert "1 with a limit cycle of 10 µm or more" in page.locator("#stability-chart-text").inner_text()


def test_the_maps_and_the_shares_show_the_numbers_of_the_results(page_of):
    results = [entry for index in range(18) for entry in everything({**TABLE_2, "B5": 1e-3 * (index + 1)}, [index])]
    page = page_of([recording(("B5",))], results)
    shares = series(page, "share-chart")
    rows = page.evaluate("data.criteria.map((row) => [row.name, row.weight, row.share])")
    assert [row[0] for row in rows] == [f"B{number}" for number in range(1, 8)]
    assert shares["on target"] == [row[1] for row in reversed(rows)]
    assert shares["this controller"] == [row[2] for row in reversed(rows)]
    show(page, "workspace")
    assert page.locator("#heat th[scope='row']").all_inner_texts() == ["80°", "-50°", "-180°"], "upwards"
    assert page.locator("#heat th[scope='col']").all_inner_texts()[1::5] == ["-90°", "180°"], "to the right"
    page.locator("#quantity").select_option("B5")
    for index, (q_a1, q_a2) in enumerate(poses()):
        name = f"at q_a1 {math.degrees(q_a1):.0f}°, q_a2 {math.degrees(q_a2):.0f}°"
        assert float(page.locator(f'#heat button[aria-label$="{name}"]').inner_text()) == pytest.approx(
            (index + 1) / 7, rel=5e-3
        )


def test_a_comparison_shows_ratios_differences_and_errors_of_the_right_runs(comparison_of):
    factors = {"A": 0.5, "B": 0.8}
    runs = [
        (everything({name: factor * value for name, value in TABLE_2.items()}), [lively(size=factor * 8e-3)])
        for factor in factors.values()
    ]
    page = comparison_of(*runs)
    targets = {criterion.name: criterion.target for criterion in PAPER.criteria}
    names = page.evaluate("runs.map((run) => run.label)")
    show(page, "bars")
    bars, stack = series(page, "bars-chart"), series(page, "stack-chart")
    for name, factor in zip(names, factors.values(), strict=True):
        assert bars[name] == pytest.approx([factor * TABLE_2[key] / targets[key] for key in targets])
    costs = page.evaluate("data.runs.map((run) => run.configurations[0].cost)")
    assert [sum(column) for column in zip(*(stack[key] for key in targets), strict=True)] == pytest.approx(costs[::-1])
    show(page, "difference")
    page.locator("#minuend").select_option(index=0)
    page.locator("#subtrahend").select_option(index=1)
    shown = page.locator("#heat button").all_inner_texts()
    assert [float(text) for text in shown] == pytest.approx([costs[0] - costs[1]] * 18, rel=5e-3)
    assert costs[0] < costs[1]
    assert f"{names[0]} is better" in page.locator("#heat .legend span").first.inner_text()
    assert f"{names[1]} is better" in page.locator("#heat .legend span").last.inner_text()
    show(page, "overlay")
    motion = runs[0][1][0].motion
    drawn = np.array(series(page, "overlay-chart")[names[0]])
    assert drawn[:, 1].max() == pytest.approx(1e3 * np.hypot(motion[:, 1], motion[:, 2]).max(), rel=1e-5)


def test_maps_without_values_or_differences_have_no_colour_bar(comparison_of, page_of):
    whole = everything(TABLE_2)
    page = comparison_of((whole, [lively()]), (whole, [lively()]), (whole[:1], []))
    show(page, "difference")
    assert page.locator("#heat .legend").inner_text() == "no difference"
    page.locator("#minuend").select_option(index=2)
    assert page.locator("#heat .legend").inner_text() == "no values"
    assert page.locator("#heat .legend i").count() == 0
    assert set(page.locator("#heat button").all_inner_texts()) == {"-"}
    page = page_of([], whole[:1])
    show(page, "workspace")
    assert page.locator("#heat .legend").inner_text() == "no values"
    assert page.locator("#heat .legend i").count() == 0


def test_what_a_table_means_stays_in_sight_on_a_phone(page_of):
    page = page_of([lively()], size=PHONE)
    text = page.locator("#criteria-text")
    page.locator("#summary .scroll").evaluate("(region) => region.scrollTo(10000, 0)")
    box = text.bounding_box()
    assert page.locator("#summary .scroll").evaluate("(region) => region.scrollLeft") > 0
    assert box["x"] >= 0 and box["x"] + box["width"] <= PHONE["width"]


@pytest.mark.parametrize("size", [DESKTOP, PHONE])
def test_the_path_fills_its_card(page_of, size):
    page = page_of([lively()], size=size)
    show(page, "case")
    grid = option(page, "path-chart")["grid"][0]
    height = page.locator("#path-chart").evaluate("(place) => place.clientHeight")
    assert grid["width"] == grid["height"] and height - grid["top"] - grid["height"] < 70


def test_labels_of_time_are_evenly_spaced(comparison_of):
    page = comparison_of((everything(TABLE_2), [lively()]))
    show(page, "overlay")
    chart = "echarts.getInstanceByDom(document.getElementById('overlay-chart'))"
    axis = f"{chart}.getModel().getComponent('xAxis').axis"
    times = page.evaluate(f"{axis}.scale.getTicks().map((tick) => tick.value)")
    shown = times[1:-1]  # the ends are not labelled
    assert np.ptp(np.diff(shown)) < 1e-9 and len(shown) > 3
    label = option(page, "overlay-chart")["xAxis"][0]["axisLabel"]
    assert (label["showMinLabel"], label["showMaxLabel"]) == (False, False)
