"""What the pages draw: numbers of hand-made runs, read back from the charts and drawings."""

import math
import re

import numpy as np
import pytest
from support.reports import tuned
from support.results import GRID, PAPER, TABLE_2

from browser.pages import (
    COMPARED,
    ENDS,
    GAINS,
    RECORDINGS,
    RESULTS,
    SPREAD,
    comparison,
    ended_report,
    legend,
    option,
    report,
    series,
    show,
    shown,
    text,
    tuning,
    worst_case,
)
from plant_fmu.flexible_manipulator import coefficients, kinematics
from plant_fmu.flexible_manipulator.parameters import NOMINAL

pytestmark = pytest.mark.slow

SHOWN = RECORDINGS[0]
ARM = coefficients.arm(NOMINAL)
POSES = [(entry.q_a1, entry.q_a2) for entry in GRID]


def button(q_a1: float, q_a2: float) -> str:
    """The button of a pose in a map."""
    return f'#heat button[aria-label$=": q_a1 {degrees(q_a1)}, q_a2 {degrees(q_a2)}"]'


def degrees(angle: float) -> str:
    """An angle [rad] as the pages' scripts round it: halves up."""
    return f"{math.floor(round(math.degrees(angle), 9) + 0.5)}°"


def points(page, selector: str) -> np.ndarray:
    """The corners of a polygon drawn as M..L..L.., shape (N, 2)."""
    path = page.locator(selector).get_attribute("d")
    return np.array([[float(number) for number in corner.split(",")] for corner in re.split("[ML]", path)[1:]])


def circles(page, selector: str) -> list[list[float]]:
    """Centre and radius of circles."""
    script = "(all) => all.map((c) => [c.cx, c.cy, c.r].map((length) => length.baseVal.value))"
    return page.locator(selector).evaluate_all(script)


def marks(page, name: str) -> list[dict]:
    """The levels across a chart."""
    return next(line["markLine"]["data"] for line in option(page, name)["series"] if line["name"] == "")


def told(page, points: list[dict]) -> list[tuple[float, float, str]]:
    """The points of a chart with the words that are read of them."""
    texts = page.evaluate("data.texts")
    return [(*point["value"], texts[point["words"]]) for point in points]


def test_the_assumed_and_the_worst_system_stand_out_in_the_spread(open_page):
    page = open_page(report())
    show(page, "spread")
    for name, factor, target, end, above in (("force", 1, 7, 26, 1), ("chirp", 0.1, 0.5, 10, 2)):
        names = legend(page, f"spread-{name}")
        assert names == ["compliant", "random_2 (worst)", "2 others"]
        lines = [line for line in option(page, f"spread-{name}")["series"] if line["name"] in names]
        assert [line["name"] for line in lines] == [*names, "2 others"]
        assert len({line["itemStyle"]["color"] for line in lines}) == 3
        tops = [max(error for t, error in line["data"] if t < end) for line in lines]
        sizes = [1e3 * factor * SPREAD[system] for system in ("compliant", "random_2", "random_1", "random_3")]
        assert tops == pytest.approx(sizes, rel=3e-2)
        assert any(f"target {target} mm" in name for name in series(page, f"spread-{name}"))
        assert f"{above} of 4 above the target of {target} mm" in text(page, f"#spread-{name}-text")


def test_what_a_case_did_not_live_to_see_is_not_judged(open_page):
    page = open_page(ended_report())
    show(page, "case")
    for index, (errors, path) in enumerate(
        (
            (["ended at 0.27 s, before the chirp and the force of 500.0 N"], "ended at 0.27 s, before the force"),
            (["0.8 mm due to the chirp; the largest at 0.75 s", "ended at 5 s, before the force of 500.0 N"],
             "the case ended at 5 s, before the force"),
            (["7.84 mm due to the force"], "leaves the large one and ended at 12 s, before it was to be inside the"),
            (["7.84 mm due to the force"], "leaves the large one and is inside the small one in time"),
        )
    ):  # fmt: skip
        page.locator("#pick-case").select_option(str(index))
        error, way = (text(page, f"#{shown(page, name)}-text") for name in ("error", "path"))
        assert all(words in error for words in errors) and path in way
        if ENDS[index] < 26:
            assert " 0 mm due" not in error and "in time" not in way
    show(page, "spread")
    force, chirp = (text(page, f"#spread-{name}-text") for name in ("force", "chirp"))
    assert "0 of 1 above the target of 7 mm; 1 ended before the force" in force
    assert "1 of 1 above the target of 0.5 mm; 1 ended before it" in chirp
    assert "from 0 " not in force + chirp


def test_the_arm_stands_where_the_plants_kinematics_put_it(open_page):
    page = open_page(report())
    show(page, "workspace")
    dots = [(x, z) for x, z, _ in circles(page, "#arm g > circle[r='0.06']")]
    upwards = sorted(POSES, key=lambda pose: (-pose[1], pose[0]))
    np.testing.assert_allclose(dots, [kinematics.tcp(ARM, *pose) for pose in upwards], atol=1e-6)
    for pose in POSES:
        page.locator(button(*pose)).focus()
        joints = [(0, 0), kinematics.tcp(ARM._replace(l_2=0.0), *pose), kinematics.tcp(ARM, *pose)]
        np.testing.assert_allclose(points(page, "#arm g > g > path"), joints, atol=1e-6)


def test_the_arm_in_motion_is_bent_by_the_magnified_angles_and_so_are_the_circles(open_page):
    page = open_page(report())
    show(page, "motion")
    page.locator("#motion select[data-choice]").select_option("0")
    page.locator("#magnify").fill("2")
    page.locator("#scrub").fill("10.2")
    row = int(np.argmin(abs(SHOWN.motion[:, 0] - 10.2)))
    bent = [angle + 100 * change for angle, change in zip(SHOWN.about.q_a, SHOWN.motion[row, 3:], strict=True)]
    np.testing.assert_allclose(points(page, "#stage g[opacity='1'] path")[2], kinematics.tcp(ARM, *bent), atol=1e-4)
    resting = points(page, "#stage g[opacity='0.45'] path")[2]
    np.testing.assert_allclose(resting, kinematics.tcp(ARM, *SHOWN.about.q_a), atol=1e-6)
    drawn = circles(page, "#stage svg svg circle[stroke-dasharray]")
    np.testing.assert_allclose(drawn, [[*resting, 0.7], [*resting, 0.01]], atol=1e-6)
    error, torque = 1e3 * math.hypot(*SHOWN.motion[row, 1:3]), SHOWN.torque[row, 1]
    assert f"TCP error {error:.3f} mm, u_m1 {torque:.3g} Nm" in text(page, "#motion-text")


def test_a_case_is_drawn_in_mm_and_nm_with_its_targets_and_limits(open_page):
    page = open_page(report())
    show(page, "case")
    page.locator("#pick-case").select_option("0")
    t, x, z = SHOWN.motion[:, :3].T
    drawn = series(page, shown(page, "error"))
    np.testing.assert_allclose(drawn["TCP error"], np.column_stack([t, 1e3 * np.hypot(x, z)]), rtol=1e-5)
    for name, first, last, level in (
        ("B7 target 0.5 mm", 0.5, 10, 0.5),
        ("B5 target 7 mm", 10, 13.5, 7),
        ("settled 0.1 mm", 13.5, 26, 0.1),
    ):
        times, levels = np.transpose(drawn[name])
        assert (times[0], times[-1], set(levels)) == (first, last, {level})
    torques = series(page, shown(page, "torque"))
    for number in (1, 2):
        np.testing.assert_allclose(torques[f"u_m{number}"], SHOWN.torque[:, [0, number]], rtol=1e-6)
    assert sorted(mark["yAxis"] for mark in marks(page, shown(page, "torque"))) == [-35, -20, 20, 35]
    # The path has x to the right and z upwards, and the circles of B5 and B6.
    path = series(page, shown(page, "path"))
    for name, rows in {"force and settling": (t >= 10) & (t < 13.5), "after 3 s of settling": t >= 13.5}.items():
        np.testing.assert_allclose(path[name], 1e3 * SHOWN.motion[rows, 1:3], rtol=1e-5)
    for name, radius in (("B5 target 7 mm", 7), ("settled 0.1 mm", 0.1)):
        np.testing.assert_allclose(np.hypot(*np.transpose(path[name])), radius)
    axes = option(page, shown(page, "path"))
    assert (axes["xAxis"][0]["name"], axes["yAxis"][0]["name"]) == ("x offset [mm]", "z offset [mm]")


def test_limit_cycles_are_drawn_and_listed_in_micrometres_beside_their_limit(open_page):
    page = open_page(report())
    show(page, "stability")
    drawn = {
        name: [(round(x), y, words) for x, y, words in told(page, line) if not words.endswith(" 0 µm")]
        for name, line in series(page, "stability-chart").items()
        if name not in ("disturbance", "")
    }
    assert drawn == {
        "gain_1": [(7, pytest.approx(3), "c07.slippery.gain_1: 3 µm")],
        "gain_2": [(7, pytest.approx(25), "c07.slippery.gain_2: 25 µm")],
        "delay_1": [(7, pytest.approx(0.01), "c07.slippery.delay_1: 0.0001 µm")],  # drawn where the axis ends
        "delay_2": [],
    }
    (limit,) = marks(page, "stability-chart")
    assert (limit["yAxis"], limit["name"]) == (pytest.approx(10), "10 µm")
    page.locator("#stability .filter").fill("")
    cells = page.locator("#stability td.figure").all_inner_texts()
    listed = [row for row in zip(cells[::2], cells[1::2], strict=True) if row[0] not in ("0", "")]
    assert listed == [("25", "1"), ("3", "1"), ("0.0001", "1")]
    assert "2 failed: a lasting limit cycle of 10 µm or more, unstable" in text(page, "#stability-chart-text")


def test_the_worst_case_is_drawn_as_it_was_found(open_page):
    page = open_page(worst_case())
    page.reload()  # another test may have left it at another case
    show(page, "search")
    path = series(page, "path-of-search")["B6"]
    assert path[0] == [10, None] and np.array(path[1:]) == pytest.approx(
        np.array([[16, 3.2], [22, 4.4], [30, 6], [40, 8]]) / [1, 3]
    )
    assert "1 list (10), 2 V by pose (12), 3 requirements (8), 4 effects (10)" in text(page, "#path-of-search-text")
    show(page, "effects")
    page.locator("#pick-effect").select_option(label="B6, settling time")
    names, (bars,) = option(page, "effects-B6")["yAxis"][0]["data"], option(page, "effects-B6")["series"]
    cells = page.locator("#ends-B6 tbody button").all_inner_texts()
    assert cells[:18:9] == ["1", "-1"] and set(cells[18:36]) == {"0"} and set(cells[36:]) == {"0.25"}
    assert [bar["value"] for bar in bars["data"]] == [2.0, 0.1, -0.5]
    assert names[0] == "f_c[2] Coulomb motor friction, axis\u00a02\u00a0+"
    assert names[2] == "m[1] link mass, axis\u00a01\u00a0−"
    show(page, "case")
    peaks = {name: max(error for _, error in line) for name, line in series(page, shown(page, "error")).items() if line}
    assert (peaks["worst arm"], peaks["nominal arm"]) == pytest.approx((8.0, 3.0), rel=0.03)
    show(page, "configurations")
    assert series(page, "configurations-chart")["found"][17]["value"] == 150.0 + 4 * 17
    show(page, "margins")
    assert "axis 1 0.3 to > 20, axis 2 2.2 (A1 asks for 2.5)" in text(page, "#margins-gain-text")
    assert "axis 1 4, axis 2 1.25 (A2 asks for 1.5)" in text(page, "#margins-delay-text")
    assert "V 0.4, A1 to A3 > 1.2" in text(page, "#margins-radius-text")
    show(page, "summary")
    page.get_by_role("button", name="limit cycle, 421.0 µm").first.click()
    assert "worst of A2, axis 2; worst of A3, delay_2" in text(page, "#case .reason:visible")


def test_the_maps_and_the_shares_show_the_numbers_of_the_results(open_page):
    page = open_page(report())
    show(page, "summary")
    shares = series(page, "share-chart")
    scores = RESULTS.criteria
    assert list(scores) == [f"B{number}" for number in range(1, 8)]
    assert shares["on target"] == [score.weight for score in scores.values()]
    assert [bar["value"] for bar in shares["this controller"]] == [score.share for score in scores.values()]
    show(page, "workspace")
    assert page.locator("#heat th[scope='row']").all_inner_texts() == ["80°", "-180°"], "upwards"
    assert page.locator("#heat th[scope='col']").all_inner_texts()[1::8] == ["-90°", "180°"], "to the right"
    page.locator("#heat-layer").select_option(index=5)
    values = [float(text(page, button(*pose))) for pose in POSES]
    assert values == pytest.approx([(index + 1) / 7 for index in range(18)], rel=5e-3)


def test_a_comparison_shows_ratios_differences_and_errors_of_the_right_runs(open_page):
    page = open_page(comparison())
    targets = {name: criterion.target for name, criterion in PAPER.criteria.items()}
    show(page, "bars")
    names = legend(page, "bars-chart")[:7]
    bars, stack = series(page, "bars-chart"), series(page, "stack-chart")
    for name, gain in zip(names, GAINS, strict=False):
        assert bars[name] == pytest.approx([gain * TABLE_2[key] / targets[key] for key in targets])
    costs = [run.results.configurations[0].cost for run in COMPARED[:7]]
    ends = [bar["value"] for bar in stack["B7"]]  # where V stands in words
    stacked = [sum(column) for column in zip(*(({**stack, "B7": ends}[key])[:7] for key in targets), strict=True)]
    assert stacked == pytest.approx(costs) and costs == sorted(costs)
    show(page, "difference")
    page.locator("#heat-minuend").select_option(index=0)
    page.locator("#heat-subtrahend").select_option(index=1)
    cells = page.locator("#heat button").all_inner_texts()
    assert [float(cell) for cell in cells] == pytest.approx([costs[0] - costs[1]] * 18, rel=5e-3)
    ends = page.locator("#heat .legend span").all_inner_texts()
    assert [f"{name} is better" in end for name, end in zip(names, ends, strict=False)] == [True, True]
    show(page, "overlay")
    page.locator("#pick-which").select_option("0")
    recorded = COMPARED[0].recordings[0]
    drawn = np.array(series(page, "overlay-B5-error")[names[0]])
    assert drawn[:, 1].max() == pytest.approx(1e3 * recorded.error.max(), rel=1e-5)
    for axis in (1, 2):
        torque = np.array(series(page, f"overlay-B5-torque-{axis}")[names[0]])
        np.testing.assert_array_equal(torque[:, 1], np.interp(torque[:, 0], *recorded.torque[:, [0, axis]].T))
    commands = page.locator("#overlay .option:visible code").all_inner_texts()
    assert [command.split("=")[-1] for command in commands] == [repr(gain) for gain in GAINS[:7]]


def test_a_tuning_shows_its_history_its_front_and_what_was_added(open_page):
    page = open_page(tuning())
    found = tuned()
    show(page, "history")
    drawn = option(page, "history-chart")["series"]
    line = drawn[0]
    assert [mark["xAxis"] for mark in marks(page, "history-chart") if "xAxis" in mark] == [14, 57]
    assert line["data"][-1] == [59, 91.0] and line["data"][0] == [0, found.trials[0].objective]
    assert all(before[1] >= after[1] for before, after in zip(line["data"], line["data"][1:], strict=False))
    numbers = {
        each["name"]: {int(words.split(":")[0].removeprefix("trial ")) for _, _, words in told(page, each["data"])}
        for each in drawn[1:-1]
    }
    assert numbers["cut short"] == {trial.number for trial in found.trials if trial.cut_short}
    assert numbers["best"] == {20} and 17 in numbers["A1–A3 fail"]
    show(page, "trade")
    front = series(page, "trade-chart")["Pareto front"]
    both = [(trial.cost, trial.cycle) for trial in found.trials if trial.cost and trial.cycle]
    assert front == sorted([V, c] for V, c in both if not any(v <= V and r <= c and (v, r) != (V, c) for v, r in both))
    show(page, "parameters")
    assert [bar["value"] for bar in series(page, "importance-chart")["importance"]] == [0.8, 0.2]
