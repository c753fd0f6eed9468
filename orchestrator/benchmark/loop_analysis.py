"""A linear closed loop: frequency responses, poles, steps, and stability margins of one axis at a time.

The loop is broken at the torque u_m, where the gain and the delay of A1 and A2 act. The loop of one axis is broken
while the other one stays closed; singular values look at both at once.

A controller in a file has no matrices: its system follows from its impulse response, by the realization of Ho and
Kalman (1966), as of Juang and Pappa (1985). The Hankel matrix of a response h has the blocks h[i + j] of chosen rows i
and columns j. These need not be consecutive: dense ones see fast modes, sparse ones slow modes and integrators, both
with a small matrix.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

# Imports inside functions: SciPy takes longer to load than all else here.

LOWEST_FREQUENCY = 0.01
"""Lowest frequency of a grid [Hz]: slower than any motion of the arm under control."""

LOWEST_CROSSING, BELOW = 1e-6, 400
"""Lowest frequency [Hz] at which a margin is looked for, and frequencies from there to a grid: with a small gain, an
integrator or gravity makes the loop drift slower than any motion under control."""

SLOWEST = 1e-9
"""A pole nearer to z = 1 than this is an integrator: at rest the loop's gain is infinite."""

POINTS, AROUND_RESONANCE = 3000, 41
"""Frequencies of a grid, and those around each resonance, which may be narrower than the grid's steps."""

GROWTH = 1e-9
"""A pole is outside the unit circle if it is farther out than this; rounding moves an integrator by less."""


SPARSE, DENSE = 25, 25
"""Rows and columns of blocks: one after the other, then at equal ratios."""

SINGULAR_VALUE_NOISE = 1e-12
"""Singular values below this, relative to the largest, are rounding."""

MAX_STATES = 40
"""States that a realization has at most."""


class StateSpace(NamedTuple):
    """``x+ = A x + B u``, ``y = C x + D u``, sampled every ``T_s`` [s]; continuous if that is None."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    T_s: float | None


class LoopMargins(NamedTuple):
    """Margins of the loop of one axis, the other one closed.

    ``gain`` and ``gain_down`` are the factors of the loop gain at which it becomes unstable (None: at none), ``phase``
    [rad] the phase margin, ``delay`` [s] the smallest additional delay that makes it unstable (None: none does),
    ``sensitivity`` the largest absolute value of S, at ``frequency`` [Hz]: its inverse is the distance of the Nyquist
    curve from -1.
    """

    gain: float | None
    gain_down: float | None
    phase: float | None
    delay: float | None
    sensitivity: float
    frequency: float


def grid(system: StateSpace, highest: float | None = None) -> np.ndarray:
    """Frequencies [Hz], increasing, up to half the sampling frequency or ``highest``, denser at the resonances."""
    end = highest if highest is not None else 0.5 / system.T_s if system.T_s else 1e3
    frequencies = [np.geomspace(LOWEST_FREQUENCY, end, POINTS)]
    for pole in continuous(np.linalg.eigvals(system.A), system.T_s):
        size = abs(pole)
        if pole.imag > 0.0:
            # A resonance is as wide as its damping ratio; at 1e-4, three widths to both sides still hold the peak.
            width = max(-pole.real / size, 1e-4)
            frequencies.append(size / (2 * math.pi) * (1.0 + width * np.linspace(-3.0, 3.0, AROUND_RESONANCE)))
    merged = np.unique(np.concatenate(frequencies))
    return merged[(merged >= LOWEST_FREQUENCY) & (merged <= end)]


def continuous(poles: np.ndarray, T_s: float | None) -> np.ndarray:
    """Poles in the s-plane [rad/s]: those of a sampled system are log(z) / T_s, without those at the origin."""
    numbers = np.asarray(poles, dtype=complex)
    return numbers if T_s is None else np.log(numbers[np.abs(numbers) > 1e-6]) / T_s


def response(system: StateSpace, frequencies: np.ndarray) -> np.ndarray:
    """Frequency response at ``frequencies`` [Hz]; shape (frequencies, outputs, inputs)."""
    turn = 2j * math.pi * frequencies
    at = turn if system.T_s is None else np.exp(turn * system.T_s)
    resolvent = at[:, None, None] * np.eye(len(system.A)) - system.A
    answer: np.ndarray = system.C @ np.linalg.solve(resolvent, system.B[None].astype(complex)) + system.D
    return answer


def closed(plant: StateSpace, controller: StateSpace) -> StateSpace:
    """The loop of a plant and a controller with the input ``e = q_m_ref - q_m`` and the output u_m.

    The plant's first two inputs are u_m and its first two outputs q_m, and it has no feedthrough. Inputs of the loop
    are ``q_m_ref`` and the plant's other inputs; outputs are those of the plant, then ``u_m``.
    """
    A, B, C, _, T_s = plant
    act, push, seen = B[:, :2], B[:, 2:], C[:2]
    K = controller
    states = np.block([[A - act @ K.D @ seen, act @ K.C], [-K.B @ seen, K.A]])
    inputs = np.block([[act @ K.D, push], [K.B, np.zeros((len(K.A), push.shape[1]))]])
    outputs = np.block([[C, np.zeros((len(C), len(K.A)))], [-K.D @ seen, K.C]])
    through = np.zeros((len(outputs), inputs.shape[1]))
    through[len(C) :, :2] = K.D
    return StateSpace(states, inputs, outputs, through, T_s)


def is_stable(system: StateSpace) -> bool:
    """Whether no pole of a sampled system is outside the unit circle."""
    return bool(np.abs(np.linalg.eigvals(system.A)).max(initial=0.0) <= 1.0 + GROWTH)


def loop_gain(plant: StateSpace, controller: StateSpace, frequencies: np.ndarray) -> np.ndarray:
    """``K G`` at the torque, shape (frequencies, 2, 2): the controller's answer to the plant's answer to u_m."""
    inner = StateSpace(plant.A, plant.B[:, :2], plant.C[:2], np.zeros((2, 2)), plant.T_s)
    gain: np.ndarray = response(controller, frequencies) @ response(inner, frequencies)
    return gain


def at_a_time(gain: np.ndarray, axis: int) -> np.ndarray:
    """The scalar loop of ``axis`` (0 or 1) with the other one closed, of a :func:`loop_gain`; shape (frequencies,)."""
    other = 1 - axis
    scalar: np.ndarray = gain[:, axis, axis] - gain[:, axis, other] * gain[:, other, axis] / (
        1.0 + gain[:, other, other]
    )
    return scalar


def singular_values(gain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest singular values of ``S = (I + L)^-1`` and ``T = L S`` of a :func:`loop_gain`, in one scaling of both
    torques; each of shape (frequencies,)."""
    S = np.linalg.inv(np.eye(2) + gain)
    return np.linalg.norm(S, 2, axis=(1, 2)), np.linalg.norm(np.eye(2) - S, 2, axis=(1, 2))


class Point(NamedTuple):
    """The loop at a frequency [Hz]."""

    frequency: float
    value: complex


class Crossings(NamedTuple):
    """Where margins are read: the loop where it passes -180° nearest to 0 dB from below and from above, and where it
    passes 0 dB nearest to -180° and with the least delay; None if it does not."""

    gain: Point | None
    gain_down: Point | None
    phase: Point | None
    delay: Point | None


def margins(plant: StateSpace, controller: StateSpace, axis: int) -> LoopMargins:
    """Classical margins of the loop of ``axis`` (0 or 1) with the other one closed, which must be stable."""
    frequencies, values, at = _crossed(plant, controller, axis)
    distance = np.abs(1.0 + values)
    worst = int(np.argmin(distance))
    return LoopMargins(
        gain=None if at.gain is None else -1.0 / at.gain.value.real,
        gain_down=None if at.gain_down is None else -1.0 / at.gain_down.value.real,
        phase=None if at.phase is None else abs(_angle(at.phase)),
        delay=None if at.delay is None else _late(at.delay),
        sensitivity=float(1.0 / distance[worst]),
        frequency=float(frequencies[worst]),
    )


def crossings(plant: StateSpace, controller: StateSpace, axis: int) -> Crossings:
    """Where the :func:`margins` of a loop are read."""
    return _crossed(plant, controller, axis)[2]


def _crossed(plant: StateSpace, controller: StateSpace, axis: int) -> tuple[np.ndarray, np.ndarray, Crossings]:
    """Frequencies [Hz], the loop at these, and where its margins are read."""
    above = grid(closed(plant, controller))
    below = np.geomspace(LOWEST_CROSSING, LOWEST_FREQUENCY, BELOW, endpoint=False)
    frequencies = np.concatenate([below, above])

    def loop(at: np.ndarray) -> np.ndarray:
        return at_a_time(loop_gain(plant, controller, at), axis)

    values = loop(frequencies)

    def point(f: float) -> Point:
        return Point(f, complex(loop(np.array([f]))[0]))

    real = [point(f) for f in _crossings(lambda f: loop(f).imag, frequencies, values.imag)]
    # At rest, and at half the sampling frequency, every response is real.
    if not (_integrates(plant) or _integrates(controller)):
        real.append(point(0.0))
    if plant.T_s is not None:
        real.append(Point(float(frequencies[-1]), complex(values[-1])))
    # The Nyquist curve crosses the negative real axis there: this factor of the gain puts the crossing at -1.
    negative = [at for at in real if at.value.real < 0.0]
    ones = list(map(point, _crossings(lambda f: np.log(np.abs(loop(f))), frequencies, np.log(np.abs(values)))))
    return (
        frequencies,
        values,
        Crossings(
            gain=max((at for at in negative if at.value.real > -1.0), key=lambda at: -at.value.real, default=None),
            gain_down=min((at for at in negative if at.value.real < -1.0), key=lambda at: -at.value.real, default=None),
            phase=min(ones, key=lambda at: abs(_angle(at)), default=None),
            delay=min(ones, key=_late, default=None),
        ),
    )


def _angle(at: Point) -> float:
    """The way from -1 [rad] against the sense in which a delay turns."""
    return float(np.angle(-at.value))


def _late(at: Point) -> float:
    """The delay [s] that turns a point of magnitude 1 to -1: that angle is its frequency times the delay."""
    return (_angle(at) % (2.0 * math.pi)) / (2.0 * math.pi * at.frequency)


def _integrates(system: StateSpace) -> bool:
    """Whether it has a pole at rest."""
    rest = 0.0 if system.T_s is None else 1.0
    return bool(np.abs(np.linalg.eigvals(system.A) - rest).min(initial=np.inf) < SLOWEST)


def _crossings(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, values: np.ndarray) -> list[float]:
    """Where ``function`` changes its sign between two points of the grid ``at``, on which it has these ``values``."""
    from scipy.optimize import brentq

    places = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
    return [float(brentq(lambda f: function(np.array([f]))[0], at[k], at[k + 1], xtol=1e-12)) for k in places]


def step(system: StateSpace, given: int, samples: int) -> np.ndarray:
    """Outputs of a sampled ``system`` after a unit step of its input number ``given``; shape (samples, outputs)."""
    x, u = np.zeros(len(system.A)), system.B[:, given]
    outputs = np.empty((samples, len(system.C)))
    for k in range(samples):
        outputs[k] = system.C @ x + system.D[:, given]
        x = system.A @ x + u
    return outputs


def realizations(impulse: np.ndarray, T_s: float) -> Iterator[StateSpace]:
    """Systems with the impulse response ``impulse`` (shape (N, outputs, inputs), first the feedthrough), sampled every
    ``T_s`` [s]: with one state, two states, and so on, as far as the response tells them from rounding."""
    from scipy.linalg import svd

    D, h = impulse[0], impulse[1:]
    length, outputs, inputs = h.shape
    chosen = _places((length - 1) // 2)
    now = _hankel(h, chosen, 0)
    later = _hankel(h, chosen, 1)
    left, sizes, right = svd(now)
    most = int(np.sum(sizes > SINGULAR_VALUE_NOISE * sizes[0])) if sizes[0] > 0.0 else 0
    yield StateSpace(np.zeros((0, 0)), np.zeros((0, inputs)), np.zeros((outputs, 0)), D, T_s)
    for order in range(1, min(most, MAX_STATES) + 1):
        # Balanced: observability and controllability get the same share of the singular values.
        root = np.sqrt(sizes[:order])
        out, back = left[:, :order] / root, right[:order].T / root
        A = out.T @ later @ back
        # The first block row and column are those of the place 0.
        yield StateSpace(A, root[:, None] * right[:order, :inputs], left[:outputs, :order] * root, D, T_s)


def simulated(system: StateSpace, inputs: np.ndarray) -> np.ndarray:
    """Outputs of a sampled system from rest; ``inputs`` has the shape (N, inputs)."""
    x, outputs = np.zeros(len(system.A)), np.empty((len(inputs), len(system.D)))
    for k, u in enumerate(inputs):
        outputs[k] = system.C @ x + system.D @ u
        x = system.A @ x + system.B @ u
    return outputs


def _places(end: int) -> np.ndarray:
    """Rows or columns of the Hankel matrix, up to ``end``."""
    return np.unique(np.concatenate([np.arange(DENSE), np.geomspace(DENSE, end, SPARSE).astype(int)]))


def _hankel(h: np.ndarray, places: np.ndarray, shift: int) -> np.ndarray:
    """The Hankel matrix of blocks of ``h`` at these places, ``shift`` samples on."""
    blocks: np.ndarray = h[places[:, None] + places[None, :] + shift]
    rows, columns, outputs, inputs = blocks.shape
    stacked: np.ndarray = blocks.transpose(0, 2, 1, 3).reshape(rows * outputs, columns * inputs)
    return stacked
