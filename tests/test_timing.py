"""The timing contract of docs/timing.md, measured: no step of delay that is not written there.

The plant is a stub whose motor angles are given functions of time and which notes when a torque first acts on it;
the controller is a mere gain. What comes out between the two is the master's doing alone.
"""

from __future__ import annotations

import math
import random
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from closed_loops import T_S, quiet, simulate_all

from orchestrator.cosim import signals
from orchestrator.cosim.scenario import Chirp, Drive, Noise, Pulse, Sensor

ACTING = ("acting[1]", "acting[2]")
ARRIVAL = ("arrival[1]", "arrival[2]")


def jumping(times, jump=(1.0, 1.0), **others):
    """Parameters of a plant whose angles jump at ``times`` [s]."""
    return {
        **{f"jump_at[{i}]": float(time) for i, time in enumerate(times, start=1)},
        **{f"jump[{i}]": height for i, height in enumerate(jump, start=1)},
        **others,
    }


@pytest.fixture(scope="module")
def probe(probe_plant_file, feedthrough_file):
    """Simulates scenarios with plant stub and gain ``K`` [N.m/rad]."""

    def run(scenarios, K=-1.0, observe=(*ARRIVAL, *ACTING)):
        return simulate_all(probe_plant_file, feedthrough_file, scenarios, observe, {"K": K})

    return run


# ---- Delay ----


def expected_arrival(jump, sensor, drive):
    """When a jump of an angle is answered: the first sample that sees it, and the drive's delay on top."""
    first = math.ceil((jump + sensor) / T_S)
    return first * T_S + drive


def test_loop_delay_of_the_benchmark_is_one_sample(probe):
    """T_d = 0.25 ms, and 1.5 ms more on one channel: exactly that, from the measurement to the torque."""
    jump = 8 * T_S
    scenarios = [
        quiet("0.01", jumping((jump, jump)), drive=Drive(delay=delay))
        for delay in ((T_S, T_S), (T_S + Fraction("1.5e-3"), T_S), (T_S, T_S + Fraction("1.5e-3")), (0 * T_S, T_S))
    ]
    for scenario, trajectory in zip(scenarios, probe(scenarios), strict=True):
        measured = [trajectory.extra[name][-1] - float(jump) for name in ARRIVAL]
        assert measured == pytest.approx([float(delay) for delay in scenario.drive.delay], abs=1e-15)


def test_any_delay_is_kept_exactly(probe):
    """Random jumps and delays, fractions of a sample among them, per channel and on both sides of the controller."""
    draw = random.Random(20081)

    def some(upto):
        return Fraction(draw.randrange(upto * 24), 24) * T_S

    chosen = [[(some(40), some(6), some(9)) for _ in range(2)] for _ in range(60)]
    scenarios = [
        quiet(
            "0.02",
            jumping([jump for jump, _, _ in axes]),
            sensor=Sensor(delay=(axes[0][1], axes[1][1])),
            drive=Drive(delay=(axes[0][2], axes[1][2])),
        )
        for axes in chosen
    ]
    for axes, trajectory in zip(chosen, probe(scenarios), strict=True):
        expected = [float(expected_arrival(*delays)) for delays in axes]
        # An angle that has jumped at the very beginning is unseen by a delayed sensor, whose line holds q_m_ref.
        assert [trajectory.extra[name][-1] for name in ARRIVAL] == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("T_s", [Fraction(1, 3000), Fraction(1, 1000), Fraction(1, 8000)])
def test_delays_keep_their_length_at_other_sample_times(probe, T_s):
    delay = Fraction("0.7e-3")
    jump = 6 * T_s
    scenario = quiet("0.02", jumping((jump, jump)), sample_time=T_s, drive=Drive(delay=(delay, T_s)))
    (trajectory,) = probe([scenario])
    arrivals = [trajectory.extra[name][-1] - float(jump) for name in ARRIVAL]
    assert arrivals == pytest.approx([float(delay), float(T_s)], abs=1e-15)


def test_step_is_split_only_where_something_arrives(probe):
    """Parts of a sample interval: one where delays are whole samples, two where a torque arrives in between."""
    third = T_S / 3
    drives = [(T_S, 7 * T_S), (T_S + third, T_S), (third, 2 * third)]
    trajectories = probe([quiet("0.005", drive=Drive(delay=delays)) for delays in drives], observe=("steps",))
    assert [trajectory.extra["steps"][-1] for trajectory in trajectories] == [20, 40, 60]


def test_until_a_torque_arrives_u_m0_acts(probe):
    """The controller asks for another torque at once; the actuator's line is filled with what the plant published."""
    scenario = quiet(
        "0.005",
        {"hold[1]": 2.0, "hold[2]": -3.0, **jumping((0.0, 0.0))},
        drive=Drive(delay=(3 * T_S, 5 * T_S)),
    )
    (trajectory,) = probe([scenario])
    assert trajectory.command[0].tolist() == [3.0, -2.0]
    for name, torque, lag in zip(ACTING, (2.0, -3.0), (3, 5), strict=True):
        # Row k + 1 tells what acted from t_k until t_k+1.
        assert trajectory.extra[name][1:].tolist() == [torque] * lag + [torque + 1.0] * (20 - lag)


def test_until_a_measurement_arrives_q_m_ref_is_seen(probe):
    scenario = quiet(
        "0.005",
        {"rest[1]": 0.5, "rest[2]": -0.5, "rate[1]": 1.0, "rate[2]": 1.0},
        sensor=Sensor(delay=(3 * T_S, T_S / 2)),
    )
    (trajectory,) = probe([scenario])
    t = np.arange(20) * float(T_S)
    # The angles rise by 1 rad/s, and with K = -1 the command is the rise as it was seen.
    seen = np.column_stack([np.maximum(t - 3 * float(T_S), 0.0), np.maximum(t - 0.5 * float(T_S), 0.0)])
    np.testing.assert_allclose(trajectory.command, seen, rtol=0, atol=1e-15)


# ---- What happens in which order ----


def test_a_measurement_is_noisy_then_late_then_quantized(probe):
    """Each order of the three gives other numbers; with K = -1, q_m_ref = 0 and u_m0 = 0 the command shows them."""
    quantum, sigma, lag = 0.01, 0.02, 2
    noise = Noise(sigma, (4, 2))
    scenario = quiet(
        "0.025",
        {"rate[1]": 3.0, "rate[2]": -5.0},
        sensor=Sensor(noise=noise, delay=(lag * T_S, 0 * T_S), quantum=quantum),
    )
    (trajectory,) = probe([scenario])
    noisy = trajectory.q_m + signals.noise(noise, scenario.samples + 1)
    np.testing.assert_array_equal(trajectory.measured, noisy)
    late = np.column_stack([np.concatenate([np.zeros(lag), noisy[: 100 - lag, 0]]), noisy[:100, 1]])
    np.testing.assert_array_equal(trajectory.command, np.rint(late / quantum) * quantum)


def test_a_torque_is_amplified_then_saturated_then_quantized_then_late(probe):
    """Commands run from -5 to 5 about u_m0; the limit is no multiple of the quantum, so that the order shows."""
    hold, gain, limit, quantum = (0.3, -0.2), (2.5, 1.0), (6.0, 4.0), (0.7, 0.3)
    scenario = quiet(
        "0.025",
        {
            "hold[1]": hold[0],
            "hold[2]": hold[1],
            "rest[1]": 5.0,
            "rest[2]": 5.0,
            "rate[1]": 400.0,
            "rate[2]": 400.0,
            **jumping((0, 0), (-5.0, -5.0)),
        },
        drive=Drive(gain=gain, limit=limit, quantum=quantum, delay=(T_S, 2 * T_S)),
    )
    (trajectory,) = probe([scenario], K=-1.0)
    asked = trajectory.command
    assert np.ptp(asked, axis=0).min() > 9.0
    amplified = np.array(hold) + np.array(gain) * (asked - np.array(hold))
    expected = np.rint(np.clip(amplified, -np.array(limit), limit) / quantum) * quantum
    # Rounding of the gain may not reach the quantizer's next step here: it would be off by a whole quantum.
    np.testing.assert_allclose(trajectory.torque, expected, rtol=0, atol=1e-12)
    assert np.abs(trajectory.torque).max(axis=0) == pytest.approx([np.rint(6.0 / 0.7) * 0.7, np.rint(4 / 0.3) * 0.3])
    for axis, (name, lag) in enumerate(zip(ACTING, (1, 2), strict=True)):
        late = np.concatenate([[hold[axis]] * lag, trajectory.torque[: 100 - lag, axis]])
        np.testing.assert_array_equal(trajectory.extra[name][1:], late)


def test_switched_off_imperfections_leave_the_signals_alone(probe):
    (trajectory,) = probe([quiet("0.01", {"rate[1]": 0.1, "rate[2]": 0.7, "hold[1]": 1.1})])
    np.testing.assert_array_equal(trajectory.measured, trajectory.q_m)
    np.testing.assert_array_equal(trajectory.torque, trajectory.command)
    np.testing.assert_array_equal(trajectory.command, trajectory.q_m[:-1] + (1.1, 0.0))
    for axis, name in enumerate(ACTING):
        np.testing.assert_array_equal(trajectory.extra[name][1:], trajectory.torque[:, axis])


# ---- Disturbances ----


def test_disturbances_are_taken_at_the_beginning_of_each_part(probe):
    chirp = Chirp((1.0, -2.0), 0.001, 0.008, 0.0, 600.0)
    pulse = Pulse((3.0, 4.0), 0.0035, 0.0065)
    scenario = quiet("0.01", {}, chirp=chirp, pulse=pulse)
    names = ("disturbing[1]", "disturbing[2]", "pushing[1]", "pushing[2]")
    whole, split = probe([scenario, replace(scenario, drive=Drive(delay=(T_S / 2, T_S)))], observe=names)
    signal = signals.chirp_signal(chirp)
    for trajectory, offset in ((whole, 0), (split, T_S / 2)):
        times = [float(k * T_S + offset) for k in range(40)]
        expected = [(*signals.chirp(signal, t), *((3.0, 4.0) if 0.0035 <= t < 0.0065 else (0.0, 0.0))) for t in times]
        seen = np.column_stack([trajectory.extra[name][1:] for name in names])
        np.testing.assert_array_equal(seen, expected)


def test_disturbances_are_held_no_longer_than_asked_at_slow_sampling(probe):
    scenario = quiet("0.1", {}, sample_time=Fraction(1, 100), longest_hold=T_S)
    (trajectory,) = probe([scenario], observe=("steps",))
    assert trajectory.extra["steps"][-1] == 400


# ---- Time itself ----


def test_time_is_computed_not_accumulated(probe):
    scenario = quiet("3", {"rate[1]": 1.0}, sample_time=Fraction(1, 3000))
    (trajectory,) = probe([scenario])
    exact = np.array([float(Fraction(k, 3000)) for k in range(9001)])
    np.testing.assert_array_equal(trajectory.time, exact)
    # The plant was told t and h: their sum is off by the rounding of one addition, not of 9000.
    assert np.abs(trajectory.q_m[:, 0] - exact).max() <= 2 * math.ulp(3.0)


def test_a_duration_that_is_no_multiple_of_the_sample_time_is_reached(probe):
    (trajectory,) = probe([quiet(Fraction(7, 2) * T_S, {})])
    assert trajectory.time.tolist() == [float(k * T_S) for k in range(5)]
