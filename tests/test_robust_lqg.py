"""The robust LQG in C: without an event it is the LQG, and its switching law is the one that its page tells."""

import math
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from numpy.testing import assert_allclose, assert_array_equal
from support.pid_fmus import T_S, Signals, in_child, slave
from support.stub_fmus import strict_compiler

import build_fmus
from controller_fmu.lqg.flexible_manipulator_lqg import design as lqg
from controller_fmu.lqg.flexible_manipulator_lqg.interface import Weights, chosen
from orchestrator import Benchmark, Controller
from orchestrator.fmi.archive import open_archive
from orchestrator.loop.signals import quantize

pytestmark = [
    pytest.mark.slow,
    pytest.mark.needs("compiler"),
]
SWAYING = {"m[1]": 55.0, "m[2]": 165.0, "k_low[1]": 0.4e6, "k_low[2]": 0.16e6, "f_c[1]": 0.3, "f_c[2]": 1.8}
"""A heavy, compliant arm with little friction in the first axis and much in the second."""
TORQUE_LIMIT = np.array([35.0, 20.0])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmus")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", strict_compiler())
        return {name: build_fmus.build(name, folder) for name in ("RobustLQG", "DitheredLQG_C")}


@pytest.fixture(scope="module")
def measured(files):
    return signals_of(files["RobustLQG"])


def signals_of(file):
    """Angles and start values of a case with a chirp, which sways the arm, and a force."""
    bench = Benchmark("strict", plant_parameters=SWAYING)
    case = bench.simulate(Controller(file), "c18.nominal.disturbance_45")
    q_m = np.vectorize(partial(quantize, quantum=case.case.scenario.sensor.quantum))(case.trajectory.measured[:-1])
    reference = np.array(case.trajectory.q_m_ref)
    starts = {v.name: float(v.start) for v in open_archive(file).description.modelVariables if v.start}
    return Signals(np.tile(reference, (len(q_m), 1)), q_m, tuple(case.trajectory.u_m0)), starts


def torques(path, signals, parameters):
    with slave(path) as one:
        one.begin(signals.q_m_ref[0], signals.u_m0)
        one.set(list(parameters), list(parameters.values()))
        one.fmu.exitInitializationMode()
        return np.array(one.run(signals.rows))


class Reference(NamedTuple):
    """What the law gives in each sample: torques [N.m], what part of dither, event's and peak's feedback acts, whether
    the arm sways, and whether the slow feedback acts."""

    u_m: np.ndarray
    dither: np.ndarray
    event: np.ndarray
    peak: np.ndarray
    sways: np.ndarray
    slowly: np.ndarray


def reference(signals, p, steady=False):
    """``steady``: the law of SteadyLQG. A jump while the third law acts does not begin its time anew, the threshold
    of an event falls slowly after the dither, a motion that dies out is an event, the dither is as strong whatever the
    error is, and the second law's share rises evenly."""
    q_m_ref, u_0 = signals.q_m_ref[0], np.array(signals.u_m0)
    pose = lqg.pose(tuple(q_m_ref), tuple(u_0))
    prefixes = ("", "event_", "peak_")
    weights = [{name: p[prefix + name] for name in p if prefix + name in p} for prefix in prefixes]
    laws = np.stack([lqg.law(lqg.controller(chosen(Weights, own), pose, T_S)) for own in weights])
    amplitude = np.minimum([p["amplitude[1]"], p["amplitude[2]"]], (TORQUE_LIMIT - np.abs(u_0)) / p["headroom"])
    first, second = 1.0, 1.5
    reach = math.sqrt(first**2 + second**2 - 2 * first * second * math.sin(q_m_ref[1] / 200)) / (first + second)
    window, over = round(2 * p["period"] / T_S), p["hold"] + p["decay"]
    states, u, found = np.zeros((3, 12)), np.zeros(2), []
    errors, slow, unrest, level = [np.zeros(2)] * window, np.zeros(2), 0.0, 0.0
    fast, jumps, peaks = np.zeros(2), 0.0, 0.0
    event = first_event = sway = -math.inf
    peak, dither_left, peak_left = -math.inf, p["dither_time"], p["peak_time"]
    at_limit, angle, slowly, last_slowly = np.zeros(2), np.zeros(2), False, -math.inf
    lately, before, share = 0.0, 0.0, 0.0
    stiffness, damping = (np.array([p[f"slow_{name}[{axis}]"] for axis in (1, 2)]) for name in ("stiffness", "damping"))

    def fading(time):
        return math.exp(-T_S / time)

    def strength(k, since, hold, decay):
        return float(np.clip(1 - ((k - since) * T_S - hold) / decay, 0, 1))

    for k, q_m in enumerate(signals.q_m):
        now = np.stack([np.concatenate([state, u, q_m - q_m_ref]) for state in states])
        after = np.einsum("lij,lj->li", laws, now)
        states, feedback, error = after[:, :12], after[:, 12:14], after[1:, 14:]
        jump = np.linalg.norm(error[1] - fast)
        if jump > max(p["jump"] / reach, p["jump_contrast"] * jumps) and peak_left > 0 and not (steady and peaks):
            peak = k
        fast = error[1] + fading(p["jump_time"]) * (fast - error[1])
        jumps = jump + fading(p["average_time"]) * (jumps - jump)
        errors = [*errors[1:], error[0]]
        mean = np.mean(errors, axis=0)
        moved = np.linalg.norm(mean - slow)
        slow = mean + fading(p["average_time"]) * (slow - mean)

        passed = (k - 1 - max(event, sway)) * T_S - over
        still = math.exp(-max(passed, 0.0) / p["average_time"]) if steady else float(passed < 0)
        factor = p["spent"] if dither_left <= 0 else 1.0 + (p["dithered"] - 1.0) * still
        if steady and (k - 1 - event) * T_S < p["hold"]:
            factor = 1.0
        rings = steady and factor * p["ringing"] < lately < p["ringing_fall"] * before
        if steady:
            lately = moved + fading(p["ringing_time"]) * (lately - moved)
            before = moved + fading(p["ringing_rise" if moved > before else "ringing_memory"]) * (before - moved)
        if rings or moved > factor * p["threshold"] / reach and moved > p["contrast"] * unrest:
            if (k - 1 - event) * T_S >= over:
                first_event = k - 1
            event = k
        if moved > p["sway"] / reach and dither_left > 0:
            sway = k
        average_time = p["contrast_time" if steady and moved > unrest else "average_time"]
        unrest = moved + fading(average_time) * (unrest - moved)

        by_event, by_sway = (strength(k, since, p["hold"], p["decay"]) for since in (event, sway))
        if steady:
            dither = by_event
            share = min(by_event, share + T_S / p["event_rise"])
        else:
            level = max(np.linalg.norm(error[0]), fading(p["memory"]) * level)
            allowed = float(np.clip((level - p["off"]) / p["rise"], 0, 1))
            dither = min(allowed, max(by_event, p["sway_share"] * by_sway))
            share = min(allowed, by_event) * float(np.clip((k - first_event) * T_S / p["wait"] - 1, 0, 1))
        peaks = strength(k, peak, p["peak_hold"], p["peak_decay"])
        peak_left = min(p["peak_time"], peak_left + T_S * (p["peak_regain"] - (peaks > 0)))
        dither_left -= T_S * (dither > 0)

        sign = 1 if k % (p["period"] / T_S) < p["period"] / T_S / 2 else -1
        later = (1 - share) * feedback[0] + share * feedback[1]
        third = 0.0 if (k - 1 - last_slowly) * T_S < p["peak_pause"] else peaks
        wanted = u_0 + (1 - third) * later + third * feedback[2] + dither * sign * amplitude
        here = np.abs(wanted) >= TORQUE_LIMIT
        at_limit = here + fading(p["overload_time"]) * (at_limit - here)
        slowly = at_limit.max() > (p["recovered"] if slowly else p["overload"])
        e, most = q_m - q_m_ref, p["slow_share"] * TORQUE_LIMIT
        velocity = (e - angle) / p["velocity_time"]
        angle = e + fading(p["velocity_time"]) * (angle - e)
        if slowly:
            last_slowly = k
            wanted = u_0 - np.clip(stiffness * e, -most, most) - damping * velocity
        u_m = np.clip(wanted, -TORQUE_LIMIT, TORQUE_LIMIT)
        found.append((u_m, dither, share, peaks, by_sway > by_event, slowly))
        u = u_m - u_0
    return Reference(*(np.array(column) for column in zip(*found, strict=True)))


def test_torques_are_those_of_the_law(files, measured):
    signals, starts = measured
    # So low a threshold that a peak begins, and so little time that the dither is spent.
    changed = {"jump": 1e-4, "peak_hold": 0.1, "dither_time": 5.0}
    expected = reference(signals, {**starts, **changed})
    assert (expected.event == 0).mean() > 0.3 and (expected.event == 1).mean() > 0.02, (
        "at rest as well as after an event"
    )
    assert (expected.sways & (expected.dither > 0)).mean() > 0.02, "and swaying"
    assert (expected.peak == 1).any() and (expected.dither > 0).sum() * T_S > 4.9, (
        "in a peak, and until the time is spent"
    )
    drive = TORQUE_LIMIT / 2**11
    found = in_child(torques, files["RobustLQG"], signals, changed)
    # Rounding in the Riccati equations grows a little in an event's large signals; another law differs by whole steps.
    assert_allclose(found / drive, expected.u_m / drive, rtol=0.0, atol=0.05)


def test_without_an_event_it_is_the_lqg(files, measured):
    signals, starts = measured
    weights = {name: starts[name] for name in starts if f"event_{name}" in starts}
    plain = in_child(torques, files["DitheredLQG_C"], signals, {**weights, "amplitude[1]": 0.0, "amplitude[2]": 0.0})
    never = dict.fromkeys(("threshold", "sway", "jump"), 1.0)
    here = in_child(torques, files["RobustLQG"], signals, never)
    assert np.ptp(here) > 1.0
    assert_array_equal(here, plain)


@pytest.mark.parametrize("period", [1e-9, 0.5])
def test_a_period_without_samples_or_with_too_many_is_refused(files, measured, period):
    signals, _ = measured
    with pytest.raises(FMICallException, match="ExitInitializationMode"):
        torques(files["RobustLQG"], signals, {"period": period})
