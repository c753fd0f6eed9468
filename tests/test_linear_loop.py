"""Linear loops: margins against the poles of loops that are changed by them, and controllers by their own equations."""

import json
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.command_lines import call
from support.python_controllers import python_controller
from support.refusals import refusal
from support.reports import searched

from orchestrator import Benchmark, Controller, Variation
from orchestrator.benchmark import loop_analysis
from orchestrator.benchmark.loop_analysis import StateSpace, realizations, simulated
from orchestrator.documents.loop_figures import drawn

T_S = 0.25e-3
BENCH, POSE = Benchmark(), (0.3, -0.9)
GAINS = {"K_p": (45.0, 15.0), "K_i": (300.0, 80.0), "K_d": (1.5, 0.5), "z_p": (0.95, 0.9)}
"""Of a PID, eq. (13)."""


def pid_matrices():
    """The PID of eq. (13) with the states e, v, s of each axis."""
    blocks = []
    for K_p, K_i, K_d, z_p in zip(*GAINS.values(), strict=True):
        rate = (1 - z_p) / T_S
        A = np.array([[0.0, 0.0, 0.0], [-rate, z_p, 0.0], [0.0, 0.0, 1.0]])
        B = np.array([[1.0], [rate], [K_i * T_S]])
        C, D = np.array([[-K_d * rate, K_d * z_p, 1.0]]), np.array([[K_p + K_d * rate + K_i * T_S]])
        blocks.append((A, B, C, D))
    zero = np.zeros_like
    return [np.block([[one, zero(one)], [zero(two), two]]) for one, two in zip(*blocks, strict=True)]


@pytest.fixture(scope="module")
def gains_file(tmp_path_factory):
    file = tmp_path_factory.mktemp("gains") / "gains.json"
    contents = {name: matrix.tolist() for name, matrix in zip("ABCD", pid_matrices(), strict=True)}
    file.write_text(json.dumps(contents | {"T_s": T_S}))
    return file


@pytest.fixture(scope="module")
def loop(gains_file):
    return BENCH.linear_loop(gains_file, POSE, "random_1", friction="sliding")


def changed(loop, gain=(1.0, 1.0), delay=(0, 0)):
    """The loop with other gains of the torques, or with more samples of delay of them."""
    more = Variation(delay=tuple(Fraction("0.00025") * (1 + samples) for samples in delay))
    model = BENCH.linearize(POSE, "random_1", variation=more, friction="sliding")
    K = loop.controller
    own = StateSpace(K.A, K.B, np.diag(gain) @ K.C, np.diag(gain) @ K.D, T_S)
    return replace(loop, model=model, controller=own)


@pytest.mark.parametrize("axis", [0, 1])
def test_margins_are_where_the_poles_leave_the_unit_circle(loop, axis):
    found = loop.margins[axis]
    assert loop.stable and found.gain > 1.0 > found.gain_down > 0.0

    def only(value, others):
        return tuple(value if place == axis else others for place in (0, 1))

    for gain, inside in ((found.gain, 0.999), (found.gain_down, 1.001)):
        assert changed(loop, gain=only(gain * inside, 1.0)).stable
        assert not changed(loop, gain=only(gain / inside, 1.0)).stable
    samples = math.floor(found.delay / T_S)
    assert changed(loop, delay=only(samples, 0)).stable and not changed(loop, delay=only(samples + 1, 0)).stable


@pytest.mark.parametrize("friction", ["sticking", "sliding"])
@pytest.mark.parametrize("K_i", [0.0, 1e-3, 1.0])
def test_the_smallest_gain_is_found_at_which_a_slow_loop_holds(K_i, friction, monkeypatch, tmp_path):
    """Against gravity, at 0.01 Hz and below: with a slow integrator, and with none."""
    monkeypatch.setitem(GAINS, "K_i", (K_i, K_i))
    A, B, C, D = pid_matrices()
    kept = [place for place in range(len(A)) if K_i or place % 3 != 2]  # without the integrators' states
    matrices = (A[np.ix_(kept, kept)], B[kept], C[:, kept], D)
    file = tmp_path / "slow.json"
    file.write_text(json.dumps({name: own.tolist() for name, own in zip("ABCD", matrices, strict=True)} | {"T_s": T_S}))
    loop = BENCH.linear_loop(file, POSE, "random_1", friction=friction)
    model, K = loop.model, loop.controller
    for axis, found in enumerate(loop.margins):
        assert 0.0 < found.gain_down < 0.01

        def poles(inside, axis=axis, found=found):
            scale = np.diag([found.gain_down * inside if place == axis else 1.0 for place in (0, 1)])
            changed = replace(loop, model=model, controller=StateSpace(K.A, K.B, scale @ K.C, scale @ K.D, T_S))
            return np.abs(np.linalg.eigvals(changed.closed.A)).max()

        assert poles(1.1) <= 1.0 + 1e-11 < poles(0.9)


def test_the_largest_sensitivity_is_that_of_the_states(loop):
    """S of axis 1 as the transfer from a torque added to u_m[1] to the torque that reaches the motor."""
    plant, frequency = loop.plant, loop.margins[0].frequency
    added = StateSpace(plant.A, np.hstack([plant.B[:, :2], plant.B[:, :1]]), plant.C, np.zeros((4, 3)), T_S)
    closed = loop_analysis.closed(added, loop.controller)
    value = 1.0 + loop_analysis.response(closed, np.array([frequency]))[0, 4, 2]
    assert abs(value) == pytest.approx(loop.margins[0].sensitivity, rel=1e-9)


def test_singular_values_bound_both_axes(loop):
    f = np.array([1.0, 20.0, 60.0, 500.0])
    gain = loop_analysis.loop_gain(loop.plant, loop.controller, f)
    S, T = loop_analysis.singular_values(gain)
    for axis in (0, 1):
        own = loop_analysis.at_a_time(gain, axis)
        assert np.all(np.abs(1.0 / (1.0 + own)) <= S * (1 + 1e-12))
        assert np.all(np.abs(own / (1.0 + own)) <= T * (1 + 1e-12))


def test_a_system_is_found_from_its_impulse_response():
    random = np.random.default_rng(3)
    A = np.diag([1.0, 0.9999, 0.95, 0.95, 0.3])
    A[2, 3], A[3, 2] = 0.2, -0.2
    own = StateSpace(A, random.normal(size=(5, 2)), random.normal(size=(2, 5)), random.normal(size=(2, 2)), T_S)
    pulses = np.zeros((2, 4001, 2))
    pulses[(0, 1), 0, (0, 1)] = 1.0
    impulse = np.stack([simulated(own, pulse) for pulse in pulses], axis=2)
    found = next(system for system in realizations(impulse, T_S) if len(system.A) == 5)
    inputs = random.normal(size=(1000, 2))
    assert_allclose(simulated(found, inputs), simulated(own, inputs), rtol=0.0, atol=1e-9)
    assert_allclose(np.sort(np.abs(np.linalg.eigvals(found.A))), np.sort(np.abs(np.linalg.eigvals(A))), atol=1e-9)


def test_an_fmu_is_linearized_as_its_equations_say(quick_pid_file, loop):
    """The paper's PID, with the gains of eq. (13)."""
    values = {f"{name}[{axis}]": pair[axis - 1] for name, pair in GAINS.items() for axis in (1, 2)}
    found = BENCH.linear_loop(Controller(quick_pid_file, values), POSE, "random_1", friction="sliding")
    assert found.mismatch < 1e-6
    f = np.array([0.3, 3.0, 30.0, 300.0, 1500.0])
    expected = loop_analysis.response(loop.controller, f)
    assert_allclose(
        loop_analysis.response(found.controller, f), expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max()
    )
    assert_allclose(np.array(found.margins), np.array(loop.margins), rtol=1e-5)
    assert "linearized at rest" in found._repr_html_()


def test_what_is_no_linear_controller(tmp_path):
    law = (
        'self.law(); own = self.own; own["u_m[1]"] = own["u_m0[1]"] + abs(own["u_m[1]"] - own["u_m0[1]"]); return True'
    )
    file = python_controller(tmp_path, "Absolute", step_body=law)
    assert refusal(BENCH.linear_loop, file, POSE).what == "not-linear"
    assert refusal(BENCH.linear_loop, tmp_path / "none.mat", POSE).what == "bad-system"
    assert refusal(BENCH.linear_loop, StateSpace(*pid_matrices(), None), POSE).what == "bad-system"


def test_an_unstable_loop_has_no_margins(loop):
    unstable = changed(loop, gain=(1.01 * loop.margins[0].gain, 1.0))
    assert refusal(lambda: unstable.margins).what == "unstable-loop"
    assert "unstable" in unstable._repr_html_()


def test_a_schedule_gives_the_controller_of_the_nearest_point(tmp_path):
    near = BENCH.linearize(POSE).at.q_m
    matrices = [np.stack([0.5 * matrix, matrix]) if name in "CD" else np.stack([matrix] * 2)
                for name, matrix in zip("ABCD", pid_matrices(), strict=True)]  # fmt: skip
    contents = {name: matrix.tolist() for name, matrix in zip("ABCD", matrices, strict=True)}
    points = [[0.0, 0.0], [near[0] + 1.0, near[1]]]
    (tmp_path / "schedule.json").write_text(json.dumps(contents | {"T_s": T_S, "points": points}))
    found = BENCH.linear_loop(tmp_path / "schedule.json", POSE)
    np.testing.assert_array_equal(found.controller.D, pid_matrices()[3])


def test_the_command_draws_and_compares(gains_file, tmp_path):
    searched().save(tmp_path / "worst")
    finished = call("linearize", gains_file, "--plots", "plots", "--robustness", "worst", folder=tmp_path)
    assert finished.code == 0 and "Stability margins" in finished.out and "search" in finished.out
    names = {"plant_bode", "plant_step", "poles", "loop_bode", "loop_nichols", "loop_sensitivity", "loop_step"}
    written = {file.stem for file in (tmp_path / "plots").glob("*.png")}
    assert written == names == {file.stem for file in (tmp_path / "plots").glob("*.pdf")}
    finished = call("linearize", gains_file, "--json", folder=tmp_path)
    assert len(json.loads(finished.out)["margins"]) == 2
    for words in (["--robustness", "worst"], ["--set", "K=1"], [gains_file, "--output", "model.mat"]):
        refused = call("linearize", *words, folder=tmp_path)
        assert refused.code == 2 and refused.err.startswith("error: ")


def test_bode_and_nichols_show_where_margins_are_read(loop):
    """Axis 1 of RobustLQG left its frame at +60°, and its phase reached +600°: its margins were in no figure."""
    bode, chart = (drawn(loop.plant, loop.controller, name) for name in ("loop_bode", "loop_nichols"))
    for axis in (0, 1):
        found, at = loop.margins[axis], loop_analysis.crossings(loop.plant, loop.controller, axis)
        below = 20 * math.log10(abs(at.gain.value))
        assert below == pytest.approx(-20 * math.log10(found.gain), abs=1e-6)
        turn = math.degrees(np.angle(at.phase.value)) % -360.0
        assert abs(turn + 180.0) == pytest.approx(math.degrees(found.phase), abs=1e-6)
        for axes, expected in (
            (chart.axes[0], [(-180.0, below), (turn, 0.0)]),
            (bode.axes[0], [(at.gain.frequency, below), (at.phase.frequency, 0.0)]),
            (bode.axes[1], [(at.gain.frequency, -180.0), (at.phase.frequency, turn)]),
        ):
            marks = np.vstack([line.get_xydata() for line in axes.lines if line.get_marker() == "o"])
            curve = np.vstack([line.get_xydata() for line in axes.lines if len(line.get_xydata()) > 100])
            for x, y in expected:
                assert np.abs(marks - (x, y)).max(axis=1).min() < 1e-3
                assert axes.get_xlim()[0] <= x <= axes.get_xlim()[1] and axes.get_ylim()[0] < y < axes.get_ylim()[1]
            if axes is not bode.axes[0]:
                phases = curve[:, 0 if axes is chart.axes[0] else 1]
                assert np.nanmin(phases) >= -360.0 and np.nanmax(phases) <= 0.0


def test_poles_that_are_too_slow_to_be_shown_are_counted():
    slow = np.diag([0.01, -0.02, -1.0])
    plant = StateSpace(slow, np.zeros((3, 2)), np.zeros((2, 3)), np.zeros((2, 2)), None)
    (axes,) = drawn(plant, None, "poles").axes
    assert axes.get_xlabel() == "Damping ratio (negative: unstable; plant: 2 below 0.01 Hz not shown, 1 unstable)"
    assert [line.get_xydata().tolist() for line in axes.lines if line.get_marker() == "x"] == [
        [[1.0, pytest.approx(1.0 / (2.0 * math.pi))]]
    ]
