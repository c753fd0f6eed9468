"""The timing contract of docs/timing.md, measured: no step of delay that is not written there.

The plant is a stub whose motor angles are given functions of time and which notes when a torque first acts on it;
the controller is a mere gain. What comes out between the two is the master's doing alone."""

import math
import random
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from exporters import RECIPES, built
from support.closed_loops import T_S, probed, quiet, simulate_all
from support.stub_fmus import axes

from orchestrator.loop import scenario as scenarios
from orchestrator.loop import signals
from orchestrator.loop.behaviour import Convention
from orchestrator.loop.random_streams import noise as noise_of
from orchestrator.loop.scenario import NO_DELAY, Chirp, Drive, Noise, Pulse, Sensor

ACTING = ("acting[1]", "acting[2]")
ARRIVAL = ("arrival[1]", "arrival[2]")


@pytest.fixture(scope="module")
def probe(probe_plant_file, feedthrough_file):
    """Simulates scenarios with plant stub and gain -1 N.m/rad."""

    def run(*scenarios, observe=(*ARRIVAL, *ACTING)):
        return simulate_all(probe_plant_file, feedthrough_file, scenarios, observe, {"K": -1.0})

    return run


def random_delays():
    """Random jumps and delays, fractions of a sample among them, per channel and on both sides of the controller."""
    draw = random.Random(20081)
    for _ in range(60):
        jump, sensor, drive = (tuple(Fraction(draw.randrange(n * 24), 24) * T_S for _ in "12") for n in (40, 6, 9))
        yield T_S, jump, sensor, drive


CHOSEN = [
    *((T_S, (8 * T_S,) * 2, NO_DELAY, drive) for drive in ((T_S, T_S), (7 * T_S, T_S), (T_S, 7 * T_S), (0 * T_S, T_S))),
    *((T, (6 * T,) * 2, NO_DELAY, (Fraction("0.7e-3"), T)) for T in map(Fraction, ("1/3000", "1/1000", "1/8000"))),
    *random_delays(),
]
"""Sample time, when the angles jump, delays of sensor and drive [s]. T_d = 0.25 ms is one sample, and the tests of
stability have 1.5 ms more on one channel."""


def test_any_delay_is_kept_exactly_from_the_measurement_to_the_torque(probe):
    """The first sample that sees a jump answers it, and the drive's delay comes on top."""
    scenarios = [
        quiet(
            "0.02",
            axes(jump_at=jump, jump=(1, 1)),
            sample_time=T,
            sensor=Sensor(delay=sensor),
            drive=Drive(delay=drive),
        )
        for T, jump, sensor, drive in CHOSEN
    ]
    for (T, *delays), trajectory in zip(CHOSEN, probe(*scenarios), strict=True):
        # An angle that has jumped at the very beginning is unseen by a delayed sensor, whose line holds q_m_ref.
        expected = [
            float(math.ceil((jump + sensor) / T) * T + drive) for jump, sensor, drive in zip(*delays, strict=True)
        ]
        assert [trajectory.extra[name][-1] for name in ARRIVAL] == pytest.approx(expected, abs=1e-15)


def test_until_a_torque_arrives_u_m0_acts(probe):
    """The controller asks for another torque at once; the actuator's line is filled with what the plant published."""
    parameters = axes(hold=(2, -3), jump_at=(0, 0), jump=(1, 1))
    (trajectory,) = probe(quiet("0.005", parameters, drive=Drive(delay=(3 * T_S, 5 * T_S))))
    assert trajectory.command[0].tolist() == [3.0, -2.0]
    np.testing.assert_array_equal(trajectory.torque, trajectory.command)
    np.testing.assert_array_equal(trajectory.measured, trajectory.q_m)
    for name, torque, lag in zip(ACTING, (2.0, -3.0), (3, 5), strict=True):
        # Row k + 1 tells what acted from t_k until t_k+1.
        assert trajectory.extra[name][1:].tolist() == [torque] * lag + [torque + 1.0] * (20 - lag)


def test_until_a_measurement_arrives_q_m_ref_is_seen(probe):
    parameters = axes(rest=(0.5, -0.5), rate=(1, 1))
    (trajectory,) = probe(quiet("0.005", parameters, sensor=Sensor(delay=(3 * T_S, T_S / 2))))
    t = np.arange(20) * float(T_S)
    # The angles rise by 1 rad/s, and with K = -1 the command is the rise as it was seen.
    seen = np.column_stack([np.maximum(t - 3 * float(T_S), 0.0), np.maximum(t - 0.5 * float(T_S), 0.0)])
    np.testing.assert_allclose(trajectory.command, seen, rtol=0, atol=1e-15)


def test_a_measurement_is_noisy_then_late_then_quantized(probe):
    """Each order of the three gives other numbers; with K = -1, q_m_ref = 0 and u_m0 = 0 the command shows them."""
    quantum, lag, noise = 0.01, 2, Noise(0.02, (4, 2))
    sensor = Sensor(noise=noise, delay=(lag * T_S, 0 * T_S), quantum=quantum)
    scenario = quiet("0.025", axes(rate=(3, -5)), sensor=sensor)
    (trajectory,) = probe(scenario)
    noisy = trajectory.q_m + noise_of(noise, scenario.samples + 1)
    np.testing.assert_array_equal(trajectory.measured, noisy)
    late = np.column_stack([np.concatenate([np.zeros(lag), noisy[: 100 - lag, 0]]), noisy[:100, 1]])
    np.testing.assert_array_equal(trajectory.command, np.rint(late / quantum) * quantum)


def test_a_torque_is_amplified_then_saturated_then_quantized_then_late(probe):
    """Commands run from -5 to 5 about u_m0; the limit is no multiple of the quantum, so that the order shows."""
    drive = Drive(gain=(2.5, 1.0), limit=(6.0, 4.0), quantum=(0.7, 0.3), delay=(T_S, 2 * T_S))
    hold, gain, limit, quantum = np.array([(0.3, -0.2), drive.gain, drive.limit, drive.quantum])
    parameters = axes(hold=hold, rest=(5, 5), rate=(400, 400), jump_at=(0, 0), jump=(-5, -5))
    (trajectory,) = probe(quiet("0.025", parameters, drive=drive))
    assert np.ptp(trajectory.command, axis=0).min() > 9.0
    amplified = hold + gain * (trajectory.command - hold)
    expected = np.rint(np.clip(amplified, -limit, limit) / quantum) * quantum
    # Rounding of the gain may not reach the quantizer's next step here: it would be off by a whole quantum.
    np.testing.assert_allclose(trajectory.torque, expected, rtol=0, atol=1e-12)
    assert np.abs(trajectory.torque).max(axis=0) == pytest.approx(np.rint(limit / quantum) * quantum)
    for axis, (name, lag) in enumerate(zip(ACTING, (1, 2), strict=True)):
        late = np.concatenate([[hold[axis]] * lag, trajectory.torque[: 100 - lag, axis]])
        np.testing.assert_array_equal(trajectory.extra[name][1:], late)


def test_disturbances_are_taken_at_the_beginning_of_each_part(probe):
    chirp = Chirp((1.0, -2.0), 0.001, 0.008, 0.0, 600.0)
    pulse = Pulse((3.0, 4.0), 0.0035, 0.0065)
    scenario = quiet("0.01", {}, chirp=chirp, pulse=pulse)
    names = ("disturbing[1]", "disturbing[2]", "pushing[1]", "pushing[2]")
    whole, split = probe(scenario, replace(scenario, drive=Drive(delay=(T_S / 2, T_S))), observe=names)
    signal = scenarios.chirp_signal(chirp, scenario.again)
    for trajectory, offset in ((whole, 0), (split, T_S / 2)):
        times = [float(k * T_S + offset) for k in range(40)]
        expected = [(*signals.chirp(signal, t), *((3.0, 4.0) if 0.0035 <= t < 0.0065 else (0.0, 0.0))) for t in times]
        seen = np.column_stack([trajectory.extra[name][1:] for name in names])
        np.testing.assert_array_equal(seen, expected)


def test_disturbances_are_held_no_longer_than_asked_at_slow_sampling(probe):
    scenario = quiet("0.1", {}, sample_time=Fraction(1, 100), longest_hold=T_S)
    (trajectory,) = probe(scenario, observe=("steps",))
    assert trajectory.extra["steps"][-1] == 400


def test_time_is_computed_not_accumulated(probe):
    scenario = quiet("3", {"rate[1]": 1.0}, sample_time=Fraction(1, 3000))
    (trajectory,) = probe(scenario)
    exact = np.array([float(Fraction(k, 3000)) for k in range(9001)])
    np.testing.assert_array_equal(trajectory.time, exact)
    # The plant was told t and h: their sum is off by the rounding of one addition, not of 9000.
    assert np.abs(trajectory.q_m[:, 0] - exact).max() <= 2 * math.ulp(3.0)


def test_a_duration_that_is_no_multiple_of_the_sample_time_is_reached(probe):
    (trajectory,) = probe(quiet(Fraction(7, 2) * T_S, {}))
    assert trajectory.time.tolist() == [float(k * T_S) for k in range(5)]


STEADY = {"rest[1]": 0.4, "rest[2]": -1.1, "hold[1]": 9.0, "hold[2]": -6.0, "q_a_start[1]": 0.3, "q_a_start[2]": -0.9}


def timing(plant, controller, parameters=None, sample_time=T_S):
    """Latency and convention of a controller."""
    found = probed(plant, controller, quiet(sample_time, STEADY, sample_time=sample_time), parameters)
    return found.latency, Convention(found.convention)


@pytest.mark.parametrize("name", ["timing_initialization", "timing_twice_first", "position_error", "casadi"])
def test_conventions_of_exporters(name, probe_plant_file, exporter_folder):
    file = built(RECIPES[name], exporter_folder)
    assert timing(probe_plant_file, file) == (0, RECIPES[name].convention)


@pytest.mark.parametrize(
    ("parameters", "sample_time", "latency", "convention"),
    [
        ({}, T_S, 0, Convention.STEP_START),
        ({"lag": 1.0}, T_S, 1, Convention.STEP_START),
        ({"lag": 7.0}, T_S, 7, Convention.STEP_START),
        ({"lag": 1.0}, Fraction(1, 1000), 1, Convention.STEP_START),
        ({"lag": 8.0}, T_S, None, Convention.SILENT),
        ({"K": 0.0}, T_S, None, Convention.SILENT),
        ({"forgetful": 1.0}, T_S, 0, Convention.UNKNOWN),
    ],
    ids=["none", "one", "most", "in its own samples", "too late", "no response", "a gain that fades with time"],
)
def test_every_sample_of_latency_is_seen(
    parameters, sample_time, latency, convention, probe_plant_file, feedthrough_file
):
    found = timing(probe_plant_file, feedthrough_file, {"K": 45.0, **parameters}, sample_time)
    assert found == (latency, convention)
