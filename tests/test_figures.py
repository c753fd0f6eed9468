"""What the paper's figures of a run show: their curves, units, targets and legends."""

import math

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from support.reports import recording, results_of, spread

from orchestrator.documents.evaluation import Evaluation
from orchestrator.documents.figures import FIGURES
from plant_fmu.flexible_manipulator import coefficients, dynamics
from plant_fmu.flexible_manipulator.parameters import NOMINAL

ERRORS = {  # which recordings, from when to when [s], and the target [mm]
    "figure_09_force": ("example", 9.8, 13.5, "B5 target 7 mm", 7.0),
    "figure_10_chirp": ("example", 0.0, 10.0, "B7 target 0.5 mm", 0.5),
    "figure_11_force_uncertain": ("spread", 9.8, 13.5, "B5 target 7 mm", 7.0),
    "figure_12_chirp_uncertain": ("spread", 0.0, 10.0, "B7 target 0.5 mm", 0.5),
}
NAMES = ["compliant", "random_2 (worst)", "2 others"]
RECORDINGS = (
    recording(("example",), size=9e-3, system="nominal"),
    spread(6e-3, "compliant"),
    spread(3e-3, "random_1"),
    spread(11e-3, "random_2"),
    spread(4e-3, "random_3"),
)


def figure(name: str):
    """A figure of the run, drawn."""
    made = FIGURES[name](Evaluation(results_of(), RECORDINGS))
    made.canvas.draw()
    return made


def curves(axes) -> dict[str, np.ndarray]:
    """The named lines of a diagram, shape (N, 2)."""
    return {line.get_label(): line.get_xydata() for line in axes.lines if not line.get_label().startswith("_")}


def joints():
    return {f"axis {axis}": coefficients.joint(NOMINAL, axis) for axis in (1, 2)}


def test_figure_3_is_the_springs_torque_over_minutes_of_arc():
    (axes,) = figure("figure_03_stiffness").axes
    assert "arcmin" in axes.get_xlabel() and "[Nm]" in axes.get_ylabel()
    assert set(drawn := curves(axes)) == set(joints())
    for name, joint in joints().items():
        deflection, torque = drawn[name].T
        assert deflection.max() == -deflection.min() == pytest.approx(2 * 60 * math.degrees(joint.psi))
        expected = [dynamics.spring(joint, math.radians(minutes / 60)) for minutes in deflection]
        np.testing.assert_allclose(torque, expected, rtol=1e-9, atol=1e-9)


def test_figure_4_is_the_torque_that_brakes_a_motor():
    (axes,) = figure("figure_04_friction").axes
    assert "[rad/s]" in axes.get_xlabel() and "[Nm]" in axes.get_ylabel()
    drawn = curves(axes)
    for name, joint in joints().items():
        speed, torque = drawn[name].T
        expected = [dynamics.friction(joint, v) for v in speed]
        np.testing.assert_allclose(torque, expected, rtol=1e-9, atol=1e-12)


def test_figure_8_is_the_path_from_the_force_on_in_both_circles_with_nothing_written_over_another():
    motion = RECORDINGS[0].motion
    plane = (("B5 target 7 mm", 7), ("settled 0.1 mm", 0.1))
    for axes, (circle, radius) in zip(figure("figure_08_circles").axes, plane, strict=True):
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("x offset [mm]", "z offset [mm]")
        drawn = curves(axes)
        np.testing.assert_allclose(np.hypot(*drawn[circle].T), radius)
        early = motion[(motion[:, 0] >= 10) & (motion[:, 0] < 13.5)]
        np.testing.assert_allclose(drawn["force and settling"], 1e3 * early[:, 1:3])
        np.testing.assert_allclose(drawn["after 3 s of settling"], 1e3 * motion[motion[:, 0] >= 13.5, 1:3])
        assert not axes.get_legend().get_window_extent().overlaps(axes.get_window_extent())
        low, high = axes.get_xlim()
        labels = [label for label in axes.get_xticklabels() if low <= label.get_position()[0] <= high]
        ticks = [label.get_window_extent() for label in labels]
        assert len(ticks) > 2 and all(right.x0 - left.x1 > 3 for left, right in zip(ticks, ticks[1:], strict=False))


@pytest.mark.parametrize("name", ERRORS)
def test_figures_9_to_12_are_errors_in_mm_with_the_target(name):
    role, begin, end, label, target = ERRORS[name]
    (axes,) = figure(name).axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("Time [s]", "TCP error [mm]")
    (dashed,) = (line for line in axes.lines if line.get_linestyle() == "--")
    assert dashed.get_label() == label
    assert list(dashed.get_ydata()) == [target, target]
    assert label in [text.get_text() for text in axes.get_legend().get_texts()]
    assert axes.get_xlim() == (begin, end) and axes.get_ylim()[1] > target
    drawn = [line.get_xydata() for line in axes.lines if line is not dashed]
    recordings = [entry for entry in RECORDINGS if role in entry.about.roles]
    assert len(drawn) == len(recordings)
    for entry in recordings:
        inside = entry.motion[(entry.motion[:, 0] >= begin) & (entry.motion[:, 0] <= end)]
        expected = np.column_stack([inside[:, 0], 1e3 * np.hypot(inside[:, 1], inside[:, 2])])
        assert any(np.allclose(line, expected, rtol=1e-6) for line in drawn), entry.about.id
    if role == "spread":  # the assumed and the worst system stand out
        assert [text.get_text() for text in axes.get_legend().get_texts()][:3] == NAMES
        hues = [line.get_color() for line in axes.lines if line is not dashed]
        *distinct, muted = dict.fromkeys(hues)
        assert hues.count(muted) == 2 and len(set(distinct)) == 2
        assert len(set(to_rgb(muted))) == 1, "muted is grey"
        tops = {line.get_label(): max(line.get_ydata()) for line in axes.lines}
        size = 1 if target == 7 else 0.1
        assert [tops[name] for name in NAMES[:2]] == pytest.approx([6 * size, 11 * size], rel=3e-2)


def test_a_case_that_ended_before_what_a_figure_shows_is_not_drawn():
    whole = recording(("example", "spread"), size=9e-3)
    short = type(whole)(whole.about, whole.motion[:28], whole.torque[:28])
    run = Evaluation(results_of(), (short,))
    drawn = {name.split("_")[1] for name, draw in FIGURES.items() if draw(run) is not None}
    assert drawn == {"03", "04", "10", "12"}
