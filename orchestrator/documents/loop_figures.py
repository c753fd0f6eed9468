"""Figures of a linear plant and of its loop with a controller: Bode, Nichols, sensitivity, steps and poles."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from ..benchmark import loop_analysis as analysis
from ..benchmark.loop_analysis import Point, StateSpace
from ..errors import InputError
from ..views import drawing
from ..views.drawing import SIZE
from ..views.plot import Axis, Colour, Level, Line, Numbers, Plot, Scatter, Symbol, hue
from ..views.units import DEGREE, HERTZ, MILLIMETRE, RADIAN, SECOND, Unit

AXES = (0, 1)

SLOW = 1e-6
"""Real part [1/s] above which a pole is unstable, and not one at rest with a rounding error."""

ONE = (1.3 * SIZE[0], 1.2 * SIZE[1])
BESIDE = (2.0 * SIZE[0], SIZE[1])
ABOVE = (1.3 * SIZE[0], 1.7 * SIZE[1])
"""Sizes [inch] of figures of one plot, and of two beside or above each other."""

DECIBEL = Unit("dB", "dB")

ROOM = 6.0
"""Between the points where margins are read and the edges of a plot [dB]."""

FREQUENCY = Axis("Frequency", HERTZ, logarithmic=True)
PHASE = Axis("Phase", DEGREE)
TIME = Axis("Time", SECOND)

STEP_TIME = 0.5
"""Length of a step response [s]."""

HIGHEST = 0.45
"""Highest frequency shown, in samples: close to half of it, the sampling alone shapes the curves."""


def drawings(plant: StateSpace, controller: StateSpace | None) -> Mapping[str, Callable[[], Figure]]:
    """The figures by name: those of the plant, and those of the loop if there is a ``controller``."""
    figures: dict[str, Callable[[], Figure]] = {
        "plant_bode": partial(plant_bode, plant),
        "poles": partial(poles, plant, controller),
    }
    if plant.T_s is not None:
        figures["plant_step"] = partial(plant_step, plant)
    if controller is not None:
        figures["loop_bode"] = partial(loop_bode, plant, controller)
        figures["loop_nichols"] = partial(nichols, plant, controller)
        figures["loop_sensitivity"] = partial(sensitivity, plant, controller)
        figures["loop_step"] = partial(loop_step, plant, controller)
    return figures


def drawn(plant: StateSpace, controller: StateSpace | None, name: str) -> Figure:
    """The figure called ``name``; raises :class:`InputError` if there is none."""
    figures = drawings(plant, controller)
    if name not in figures:
        raise InputError(f"There is no figure {name}. Figures: {', '.join(figures)}.", "no-figure", "", name, figures)
    return figures[name]()


def plant_bode(plant: StateSpace) -> Figure:
    """From the torques u_m to the motor angles q_m: magnitude [dB of rad/(N.m)] and phase [°] over frequency [Hz]."""
    f = _frequencies(plant)
    values = analysis.response(plant, f)
    paths = {f"u_m{into + 1} to q_m{out + 1}": values[:, out, into] for out, into in ((0, 0), (1, 1), (0, 1))}
    looks: tuple[Colour, ...] = (hue(0), hue(1), "muted")
    return _bode(f, list(paths.items()), looks)


def loop_bode(plant: StateSpace, controller: StateSpace) -> Figure:
    """The loop of each axis, broken at its torque while the other one is closed; points are where margins are read."""
    f, loops = _loops(plant, controller)
    named = [(f"axis {axis + 1}, the other closed", loop) for axis, loop in zip(AXES, loops, strict=True)]
    levels = (Level(0.0, ""),), (Level(-math.pi, ""),)
    return _bode(f, named, (hue(0), hue(1)), _read(plant, controller), levels)


def _bode(
    f: np.ndarray,
    named: Sequence[tuple[str, np.ndarray]],
    colours: Sequence[Colour],
    read: Sequence[Sequence[Point]] = (),
    levels: tuple[tuple[Level, ...], tuple[Level, ...]] = ((), ()),
) -> Figure:
    """Magnitude above phase; of loops, of which points are ``read``, the phase is that of one turn."""
    looks = list(zip(named, colours, strict=True))
    sizes = [Line(name, f, _decibels(values), colour) for (name, values), colour in looks]
    phases = [Line("", *(_turned(f, values) if read else (f, _phase(values))), colour) for (_, values), colour in looks]
    marks: tuple[list[Scatter], list[Scatter]] = ([], [])
    for points, colour in zip(read, colours, strict=False):
        at, values = [point.frequency for point in points], np.array([point.value for point in points])
        for shown, heights in zip(marks, (_decibels(values), _turn(values)), strict=True):
            shown.append(Scatter("", at, heights, colour, size=4.0))
    low = min([-60.0, *(height - ROOM for points in marks[0] for height in _finite(points.y))]) if read else None
    x = replace(FREQUENCY, low=min([f[0], *(at for points in marks[0] for at in _finite(points.x))]))
    y = replace(PHASE, low=-2.0 * math.pi, high=0.0) if read else PHASE
    size = Plot("magnitude", "", x, Axis("Magnitude", DECIBEL, low), (*sizes, *marks[0]), levels[0], group="bode")
    phase = Plot("phase", "", x, y, (*phases, *marks[1]), levels[1], group="bode")
    return drawing.figure([[size], [phase]], ABOVE)


def nichols(plant: StateSpace, controller: StateSpace) -> Figure:
    """The same as magnitude over phase, with the region in which S exceeds 6 dB around -180° and 0 dB."""
    f, loops = _loops(plant, controller)
    around = -1.0 + 0.5 * np.exp(1j * np.linspace(0.0, 2.0 * math.pi, 361))
    limit = Line("|S| = 6 dB", np.angle(-around) - math.pi, _decibels(around), "limit", "dashed", 1.2)
    centre = Scatter("", [-math.pi], [0.0], "limit", "plus")
    lines, marks = [], []
    for axis, (loop, points) in enumerate(zip(loops, _read(plant, controller), strict=True)):
        sizes, phases = _turned(_decibels(loop), loop)
        lines.append(Line(f"axis {axis + 1}", phases, sizes, hue(axis)))
        values = np.array([point.value for point in points])
        marks.append(Scatter("", _turn(values), _decibels(values), hue(axis), size=4.0))
    heights = [height for points in marks for height in _finite(points.y)]
    x = replace(PHASE, low=-2.0 * math.pi, high=0.0)
    low, high = min([-40.0, *(at - ROOM for at in heights)]), max([40.0, *(at + ROOM for at in heights)])
    y = Axis("Magnitude", DECIBEL, low, high)
    plot = Plot("nichols", "", x, y, (limit, centre, *lines, *marks))
    return drawing.figure(plot, (1.3 * SIZE[0], 1.3 * SIZE[0]))


def _finite(numbers: Numbers) -> list[float]:
    return [float(value) for value in np.asarray(numbers, dtype=float)]


def _read(plant: StateSpace, controller: StateSpace) -> list[list[Point]]:
    """Of each axis, where its margins are read, at frequencies that an axis can have."""
    found = (analysis.crossings(plant, controller, axis) for axis in AXES)
    return [[point for point in points if point is not None and point.frequency > 0.0] for points in found]


def sensitivity(plant: StateSpace, controller: StateSpace) -> Figure:
    """S and T: of each axis with the other one closed, and the largest singular values of both together."""
    f, loops = _loops(plant, controller)
    both = analysis.singular_values(analysis.loop_gain(plant, controller, f))
    plots = []
    for name, values in zip("ST", both, strict=True):
        lines = [Line(f"largest singular value of {name}", f, _decibels(values), "muted")]
        for axis, loop in zip(AXES, loops, strict=True):
            shown = 1.0 / (1.0 + loop) if name == "S" else loop / (1.0 + loop)
            lines.append(Line(f"{name}_{axis + 1}, the other axis closed", f, _decibels(shown), hue(axis)))
        y = Axis("Magnitude", DECIBEL, -40.0)
        plots.append(Plot(name, "", FREQUENCY, y, tuple(lines), (Level(0.0, ""),)))
    return drawing.figure([plots], BESIDE)


def plant_step(plant: StateSpace) -> Figure:
    """Motor angles [rad] of the plant alone after a step of 1 N.m of each torque."""
    lines = []
    for into in AXES:
        t, response = _step(plant, into)
        lines += [_response(f"q_m{out + 1} after u_m{into + 1}", t, response[:, out], out, out == into) for out in AXES]
    return drawing.figure(Plot("step", "", TIME, Axis("Motor angle", RADIAN), tuple(lines)), ONE)


def _response(name: str, t: np.ndarray, values: np.ndarray, axis: int, same: bool) -> Line:
    return Line(name, t, values, hue(axis), "solid" if same else "dotted")


def loop_step(plant: StateSpace, controller: StateSpace) -> Figure:
    """Motor angles after a step of their reference, and the tool after steps of a motor's torque and of the force."""
    loop = analysis.closed(plant, controller)
    follow, tool = [], []
    for axis in AXES:
        t, response = _step(loop, axis)
        names = [f"q_m{out + 1} after the reference of axis {axis + 1}" for out in AXES]
        follow += [_response(names[out], t, response[:, out], out, out == axis) for out in AXES]
        for number, (first, words, size) in enumerate(((2, "u_d%d of 1 Nm", 1.0), (4, "F_%d of 100 N", 100.0))):
            t, response = _step(loop, first + axis)
            moved = size * np.hypot(response[:, 2], response[:, 3])
            tool.append(Line(words % (axis + 1), t, moved, hue(2 * number + axis)))
    plots = (
        Plot("follow", "", TIME, Axis("Motor angle / step"), tuple(follow)),
        Plot("tool", "", TIME, Axis("TCP displacement", MILLIMETRE), tuple(tool)),
    )
    return drawing.figure([plots], BESIDE)


def poles(plant: StateSpace, controller: StateSpace | None) -> Figure:
    """Poles as frequency [Hz] over damping ratio; real ones have the ratio 1, unstable ones a negative one. The axis
    says how many are too slow to be shown."""
    shown: list[tuple[str, StateSpace, Symbol]] = [("plant", plant, "cross")]
    if controller is not None:
        shown.append(("loop", analysis.closed(plant, controller), "ring"))
    series, left_out = [], ""
    for place, (name, system, symbol) in enumerate(shown):
        values = analysis.continuous(np.linalg.eigvals(system.A), system.T_s)
        values = values[values.imag >= 0.0]
        slow = np.abs(values) <= 2 * math.pi * analysis.LOWEST_FREQUENCY
        if slow.any():
            left_out += f"; {name}: {slow.sum()} below {analysis.LOWEST_FREQUENCY:g} Hz not shown"
            if unstable := int((values[slow].real > SLOW).sum()):
                left_out += f", {unstable} unstable"
        values = values[~slow]
        size = np.abs(values)
        series.append(Scatter(name, -values.real / size, size / (2 * math.pi), hue(place), symbol))
    x = Axis(f"Damping ratio (negative: unstable{left_out})", high=1.05)
    return drawing.figure(Plot("poles", "", x, FREQUENCY, tuple(series), (Level(0.0, "", upright=True),)), ONE)


def _loops(plant: StateSpace, controller: StateSpace) -> tuple[np.ndarray, list[np.ndarray]]:
    """Frequencies [Hz], and the loop of each axis with the other one closed."""
    f = _frequencies(analysis.closed(plant, controller))
    gain = analysis.loop_gain(plant, controller, f)
    return f, [analysis.at_a_time(gain, axis) for axis in AXES]


def _frequencies(system: StateSpace) -> np.ndarray:
    """The frequencies [Hz] that are shown."""
    return analysis.grid(system, None if system.T_s is None else HIGHEST / system.T_s)


def _step(system: StateSpace, given: int) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and outputs after a unit step of an input."""
    assert system.T_s is not None, "steps are those of a sampled system"
    samples = round(STEP_TIME / system.T_s)
    return system.T_s * np.arange(samples), analysis.step(system, given, samples)


def _decibels(values: np.ndarray) -> np.ndarray:
    """Magnitude [dB]."""
    # Zeros have no logarithm.
    sizes: np.ndarray = 20 * np.log10(np.maximum(np.abs(values), 1e-12))
    return sizes


def _phase(values: np.ndarray) -> np.ndarray:
    """Phase [rad] without jumps, which begins between -2 pi and 0."""
    angles = np.unwrap(np.angle(values))
    shifted: np.ndarray = angles - angles[0] + angles[0] % (-2.0 * math.pi)
    return shifted


def _turn(values: np.ndarray) -> np.ndarray:
    """Phase [rad] between -2 pi and 0: margins are read at -pi."""
    turn: np.ndarray = np.angle(values) % (-2.0 * math.pi)
    return turn


def _turned(beside: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same along a curve, and what stands ``beside`` it, with a gap where it passes 0."""
    turn = _turn(values)
    gaps = np.flatnonzero(np.abs(np.diff(turn)) > math.pi) + 1
    return np.insert(beside, gaps, np.nan), np.insert(turn, gaps, np.nan)
