"""Figures of a linear plant and of its loop with a controller: Bode, Nichols, sensitivity, steps and poles."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..benchmark import loop_analysis as analysis
from ..benchmark.loop_analysis import StateSpace
from ..errors import InputError
from .picture import Picture
from .style import COLOURS, DASHED, HUES, MUTED, SIZE, STYLE, legend_above

AXES = (0, 1)
WIDE, HIGH = 2.0, 1.7
"""Figures of two columns, and those of two diagrams, relative to :data:`.style.SIZE`."""

STEP_TIME = 0.5
"""Length of a step response [s]."""

HIGHEST = 0.45
"""Highest frequency shown, in samples: close to half of it, the sampling alone shapes the curves."""


def drawings(plant: StateSpace, controller: StateSpace | None) -> Mapping[str, Callable[[], Figure]]:
    """The figures by name: those of the plant, and those of the loop if there is a ``controller``."""
    found: dict[str, Callable[[], Figure]] = {
        "plant_bode": partial(plant_bode, plant),
        "poles": partial(poles, plant, controller),
    }
    if plant.T_s is not None:
        found["plant_step"] = partial(plant_step, plant)
    if controller is not None:
        found["loop_bode"] = partial(loop_bode, plant, controller)
        found["loop_nichols"] = partial(nichols, plant, controller)
        found["loop_sensitivity"] = partial(sensitivity, plant, controller)
        found["loop_step"] = partial(loop_step, plant, controller)
    return found


def drawn(plant: StateSpace, controller: StateSpace | None, name: str) -> Figure:
    """The figure called ``name``, in the common style; raises :class:`InputError` if there is none."""
    known = drawings(plant, controller)
    if name not in known:
        raise InputError(f"There is no figure {name}. Figures: {', '.join(known)}.", "no-figure", "", name, known)
    with rc_context(STYLE):
        return known[name]()


def plant_bode(plant: StateSpace) -> Figure:
    """From the torques u_m to the motor angles q_m: magnitude [dB of rad/(N.m)] and phase [°] over frequency [Hz]."""
    f = _frequencies(plant)
    values = analysis.response(plant, f)
    figure, (size, phase) = _two("Frequency [Hz]")
    for out, into in ((0, 0), (1, 1), (0, 1)):
        own = values[:, out, into]
        look = {"color": COLOURS[out] if out == into else MUTED}
        _decibels(size, f, own, label=f"$u_{{m{into + 1}}}$ to $q_{{m{out + 1}}}$", **look)
        phase.semilogx(f, _phase(own), **look)
    size.set_ylabel("Magnitude [dB]")
    phase.set_ylabel("Phase [°]")
    legend_above(size)
    return figure


def loop_bode(plant: StateSpace, controller: StateSpace) -> Figure:
    """The loop of each axis, broken at its torque while the other one is closed."""
    f, loops = _loops(plant, controller)
    figure, (size, phase) = _two("Frequency [Hz]")
    for axis, own in zip(AXES, loops, strict=True):
        _decibels(size, f, own, color=COLOURS[axis], label=f"axis {axis + 1}, the other closed")
        phase.semilogx(f, _phase(own), color=COLOURS[axis])
    size.axhline(0.0, **DASHED)
    phase.axhline(-180.0, **DASHED)
    size.set(ylabel="Magnitude [dB]", ylim=(-60, None))
    phase.set_ylabel("Phase [°]")
    legend_above(size)
    return figure


def nichols(plant: StateSpace, controller: StateSpace) -> Figure:
    """The same as magnitude over phase, with the region in which S exceeds 6 dB around -180° and 0 dB."""
    f, loops = _loops(plant, controller)
    figure = Picture(figsize=(1.3 * SIZE[0], 1.3 * SIZE[0]), layout="constrained")
    axes = figure.subplots()
    around = -1.0 + 0.5 * np.exp(1j * np.linspace(0.0, 2.0 * math.pi, 361))
    for turn in (-360.0, 0.0):
        angle = np.degrees(np.angle(-around)) - 180.0 + turn
        axes.plot(angle, 20 * np.log10(np.abs(around)), **DASHED, label="|S| = 6 dB" if turn else None)
        axes.plot([turn - 180.0], [0.0], "k+")
    for axis, own in zip(AXES, loops, strict=True):
        axes.plot(_phase(own), 20 * np.log10(np.abs(own)), color=COLOURS[axis], label=f"axis {axis + 1}")
    axes.set(xlabel="Phase [°]", ylabel="Magnitude [dB]", ylim=(-40, 40), xlim=(-600, 60))
    axes.set_xticks(range(-540, 1, 90))
    legend_above(axes)
    return figure


def sensitivity(plant: StateSpace, controller: StateSpace) -> Figure:
    """S and T: of each axis with the other one closed, and the largest singular values of both together."""
    f, loops = _loops(plant, controller)
    both = analysis.singular_values(analysis.loop_gain(plant, controller, f))
    figure = Picture(figsize=(WIDE * SIZE[0], SIZE[1]), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, name, values in zip(panels, "ST", both, strict=True):
        _decibels(axes, f, values, color=MUTED, label=f"largest singular value of {name}")
        for axis, own in zip(AXES, loops, strict=True):
            shown = 1.0 / (1.0 + own) if name == "S" else own / (1.0 + own)
            _decibels(axes, f, shown, color=COLOURS[axis], label=f"${name}_{axis + 1}$, the other axis closed")
        axes.axhline(0.0, **DASHED)
        axes.set(xlabel="Frequency [Hz]", ylim=(-40, None))
        legend_above(axes)
    panels[0].set_ylabel("Magnitude [dB]")
    return figure


def plant_step(plant: StateSpace) -> Figure:
    """Motor angles [rad] of the plant alone after a step of 1 N.m of each torque."""
    figure, axes = _one()
    for into in AXES:
        t, found = _step(plant, into)
        for out in AXES:
            look: Any = {"color": COLOURS[out], "linestyle": "solid" if out == into else "dotted"}
            axes.plot(t, found[:, out], **look, label=f"$q_{{m{out + 1}}}$ after $u_{{m{into + 1}}}$")
    axes.set(xlabel="Time [s]", ylabel="Motor angle [rad]")
    legend_above(axes)
    return figure


def loop_step(plant: StateSpace, controller: StateSpace) -> Figure:
    """Motor angles after a step of their reference, and the tool after steps of a motor's torque and of the force."""
    loop = analysis.closed(plant, controller)
    figure = Picture(figsize=(WIDE * SIZE[0], SIZE[1]), layout="constrained")
    follow, tool = figure.subplots(1, 2)
    for axis in AXES:
        t, found = _step(loop, axis)
        for out in AXES:
            look = {"color": COLOURS[out], "linestyle": "solid" if out == axis else "dotted"}
            name = f"$q_{{m{out + 1}}}$ after the reference of axis {axis + 1}"
            follow.plot(t, found[:, out], **look, label=name)
        for number, (first, words, size) in enumerate(((2, "$u_{d%d}$ of 1 Nm", 1.0), (4, "$F_%d$ of 100 N", 100.0))):
            t, found = _step(loop, first + axis)
            hue = HUES[2 * number + axis]
            tool.plot(t, 1e3 * size * np.hypot(found[:, 2], found[:, 3]), color=hue, label=words % (axis + 1))
    follow.set(xlabel="Time [s]", ylabel="Motor angle / step")
    tool.set(xlabel="Time [s]", ylabel="TCP displacement [mm]")
    legend_above(follow)
    legend_above(tool)
    return figure


def poles(plant: StateSpace, controller: StateSpace | None) -> Figure:
    """Poles as frequency [Hz] over damping ratio; real ones have the ratio 1, unstable ones are red."""
    figure, axes = _one()
    shown = [("plant", plant, "x", COLOURS[0])]
    if controller is not None:
        shown.append(("loop", analysis.closed(plant, controller), "o", COLOURS[1]))
    for name, system, marker, hue in shown:
        found = analysis.continuous(np.linalg.eigvals(system.A), system.T_s)
        found = found[(found.imag >= 0.0) & (np.abs(found) > 2 * math.pi * analysis.LOWEST_FREQUENCY)]
        size = np.abs(found)
        fill: Any = {} if marker == "x" else {"fillstyle": "none"}
        axes.plot(-found.real / size, size / (2 * math.pi), marker, color=hue, markersize=4, label=name, **fill)
    axes.axvline(0.0, **DASHED)
    axes.set(xlabel="Damping ratio (negative: unstable)", ylabel="Frequency [Hz]", yscale="log", xlim=(None, 1.05))
    legend_above(axes)
    return figure


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


def _decibels(axes: Axes, f: np.ndarray, values: np.ndarray, **look: Any) -> None:
    axes.semilogx(f, 20 * np.log10(np.maximum(np.abs(values), 1e-12)), **look)


def _phase(values: np.ndarray) -> np.ndarray:
    """Phase [°] without jumps, which begins between -360° and 0°."""
    found = np.degrees(np.unwrap(np.angle(values)))
    shifted: np.ndarray = found - found[0] + found[0] % -360.0
    return shifted


def _one() -> tuple[Figure, Axes]:
    figure = Picture(figsize=(1.3 * SIZE[0], 1.2 * SIZE[1]), layout="constrained")
    return figure, figure.subplots()


def _two(xlabel: str) -> tuple[Figure, tuple[Axes, Axes]]:
    figure = Picture(figsize=(1.3 * SIZE[0], HIGH * SIZE[1]), layout="constrained")
    size, phase = figure.subplots(2, 1, sharex=True)
    phase.set_xlabel(xlabel)
    return figure, (size, phase)
