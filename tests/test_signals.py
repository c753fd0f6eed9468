"""The disturbances and imperfections of the loop, each alone."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.loop import signals
from orchestrator.loop.random_streams import noise as noise_of
from orchestrator.loop.scenario import ChirpSignal, Noise, PulseSignal

numbers = st.floats(-1e6, 1e6)
quanta = st.floats(1e-6, 10.0)


UP = ChirpSignal(amplitude_1=1.0, amplitude_2=-1.0, start=0.5, stop=8.0, f_start=0.0, f_stop=15.0)
DOWN = UP._replace(f_start=15.0, f_stop=0.0)


def times(signal, count):
    return np.linspace(signal.start, signal.stop, count, endpoint=False)


@pytest.mark.parametrize("signal", [UP, DOWN], ids=["up", "down"])
def test_chirp_has_a_frequency_linear_in_time(signal):
    """Its phase, unwrapped from the signal and its quadrature, is the integral of the frequency."""
    t = times(signal, 200_001)
    frequency = np.interp(t, [signal.start, signal.stop], [signal.f_start, signal.f_stop])
    # The trapezoidal rule is exact for a linear frequency.
    cycles = np.concatenate([[0.0], np.cumsum((frequency[1:] + frequency[:-1]) / 2 * np.diff(t))])
    wave = np.array([signals.chirp(signal, x) for x in t])
    # Phases reach 2 pi 56: rounding of the two sums, some 1e5 terms long.
    np.testing.assert_allclose(wave[:, 0], np.sin(2 * np.pi * cycles), rtol=0, atol=1e-9)
    np.testing.assert_array_equal(wave[:, 1], -wave[:, 0])


def test_chirp_begins_at_its_start_and_ends_before_its_stop():
    assert signals.chirp(DOWN, math.nextafter(0.5, 0.0)) == (0.0, 0.0)
    assert signals.chirp(DOWN, 0.5) == (0.0, 0.0), "a sine begins at zero"
    assert signals.chirp(DOWN, 0.51)[0] != 0.0
    assert signals.chirp(DOWN, math.nextafter(8.0, 0.0))[0] != 0.0
    assert signals.chirp(DOWN, 8.0) == (0.0, 0.0)
    assert signals.chirp(UP._replace(amplitude_1=0.0, amplitude_2=0.0), 3.0) == (0.0, 0.0)
    assert signals.chirp(ChirpSignal(1.0, 1.0, 0.0, 0.0, 0.0, 0.0), 0.0) == (0.0, 0.0), "from 0 until 0 is never"


def test_pulse_is_constant_between_its_times():
    pulse = PulseSignal(3.0, -4.0, 10.0, 10.5)
    shown = {t: signals.pulse(pulse, t) for t in (0.0, math.nextafter(10.0, 0.0), 10.0, 10.499, 10.5, 11.0)}
    assert [t for t, force in shown.items() if force == (3.0, -4.0)] == [10.0, 10.499]
    assert {force for t, force in shown.items() if t not in (10.0, 10.499)} == {(0.0, 0.0)}


@given(value=numbers, limit=st.floats(0.0, 1e3))
def test_saturation(value, limit):
    held = signals.saturate(value, limit)
    assert abs(held) <= limit
    assert held == value if abs(value) <= limit else held == math.copysign(limit, value)


@given(value=numbers, quantum=quanta)
def test_quantization_gives_the_nearest_multiple(value, quantum):
    rounded = signals.quantize(value, quantum)
    steps = rounded / quantum
    # Value and steps are known to some last places.
    slack = 4 * math.ulp(abs(value) + quantum)
    assert abs(rounded - value) <= quantum / 2 + slack
    assert abs(steps - round(steps)) <= 4 * math.ulp(abs(steps) + 1.0)
    assert signals.quantize(-value, quantum) == -rounded
    assert signals.quantize(value, 0.0) == value, "off"


def test_quantization_has_the_steps_of_the_converters():
    """16 bits of a revolution, 12 bits of a torque range: neighbouring steps are one LSB apart, ends are reached."""
    angle = 2 * math.pi / 2**16
    assert signals.quantize(0.49 * angle, angle) == 0.0
    assert signals.quantize(0.51 * angle, angle) == angle
    torque = 2 * 35.0 / 2**12
    levels = {signals.quantize(float(u), torque) for u in np.linspace(-35.0, 35.0, 100_001)}
    assert len(levels) == 2**12 + 1, "both ends included"
    assert max(levels) == 35.0 and min(levels) == -35.0


@given(value=numbers, centre=numbers, gain=st.floats(0.1, 10.0))
def test_gain_acts_about_its_centre(value, centre, gain):
    scale = abs(centre) + gain * (abs(value) + abs(centre))
    assert signals.amplify(centre, centre, gain) == centre
    assert signals.amplify(value, centre, gain) - centre == pytest.approx(
        gain * (value - centre), abs=4 * math.ulp(scale)
    )
    assert signals.amplify(value, centre, 1.0) == value, "to the last bit"


def test_noise_is_white_and_of_the_size_asked_for():
    n = 200_000
    noise = noise_of(Noise(1.095e-4, (7,)), n) / 1.095e-4
    # Four standard deviations of the estimates of mean, variance and correlation from n samples.
    assert np.abs(noise.mean(axis=0)).max() < 4 / math.sqrt(n)
    assert np.abs(noise.var(axis=0) - 1.0).max() < 4 * math.sqrt(2 / n)
    for lag in (1, 2, 10):
        assert np.abs((noise[lag:] * noise[:-lag]).mean(axis=0)).max() < 4 / math.sqrt(n - lag)
    assert abs((noise[:, 0] * noise[:, 1]).mean()) < 4 / math.sqrt(n), "axes are independent"


def test_noise_depends_on_every_word_of_its_seed():
    seeds = [(0, 1, 5), (1, 0, 5), (0, 5, 1), (5, 0, 1), (0, 1, 6), (0, 0, 5)]
    first = {tuple(noise_of(Noise(1.0, seed), 1)[0].tolist()) for seed in seeds}
    assert len(first) == len(seeds)


def test_noise_is_frozen():
    """Results of the benchmark hold these numbers: another library's version must not change them."""
    frozen = [
        [-0.3576950329493073, 0.647620087477443],
        [-0.5352345912227796, -0.9489091721227497],
        [-0.5979742871366136, -0.5931937598649935],
    ]
    for count in (3, 100):  # longer noise begins with the shorter
        assert noise_of(Noise(1.0, (0, 1, 2)), count)[:3].tolist() == frozen
