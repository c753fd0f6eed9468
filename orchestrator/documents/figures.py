"""Figures 3, 4 and 8 to 12 of the paper, of this run: PDF and SVG for a paper, PNG for a look."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from plant_fmu.flexible_manipulator import dynamics
from plant_fmu.flexible_manipulator.coefficients import Joint
from plant_fmu.flexible_manipulator.coefficients import joint as joint_of

from .recording import EXAMPLE, SYSTEMS, Recording
from .run import Run
from .style import COLOURS, DASHED, MUTED, SIZE, legend_above, write_drawn
from .trajectory_files import interpreted

ARC_MINUTE = math.pi / (180 * 60)


def write_figures(run: Run, folder: Path) -> tuple[list[str], list[str]]:
    """Write all figures that the run has data for into ``folder``, which is created.

    Returns the names of the figures written, without endings, and of the others.
    """
    return write_drawn({name: partial(draw, run) for name, draw in FIGURES.items()}, folder)


def stiffness(run: Run) -> Figure:
    """Figure 3: spring torque [Nm] over gear deflection [arc minutes], eq. (5), nominal parameters."""
    figure, axes = _axes("Deflection $\\Delta_q$ [arcmin]", "Spring torque $\\tau_s$ [Nm]")
    _draw_law(run, axes, dynamics.spring, lambda joint: np.linspace(-2 * joint.psi, 2 * joint.psi, 401), ARC_MINUTE)
    return figure


def friction(run: Run) -> Figure:
    """Figure 4: friction torque [Nm] over motor speed [rad/s], eq. (8), on the motor's side, nominal parameters."""
    figure, axes = _axes("Motor speed $\\dot q_m$ [rad/s]", "Friction torque $f / n$ [Nm]")
    _draw_law(run, axes, dynamics.friction, lambda _: np.linspace(-30, 30, 2001), 1.0)
    return figure


def _draw_law(
    run: Run, axes: Axes, law: Callable[..., float], points: Callable[[Joint], np.ndarray], unit: float
) -> None:
    """What ``law`` gives for both joints at their ``points``, which are shown in ``unit``."""
    for axis, colour in zip((1, 2), COLOURS, strict=True):
        joint = joint_of(run.results.plant.nominal, axis)
        x = points(joint)
        axes.plot(x / unit, [interpreted(law)(joint, value) for value in x], color=colour, label=f"axis {axis}")
    axes.legend()


def circles(run: Run) -> Figure | None:
    """Figure 8: path of the TCP [mm] from the force on, in the circle of B5, and enlarged in that of B6."""
    example = next(iter(run.recorded(EXAMPLE)), None)
    if example is None or not within(example, example.about.window[0], math.inf).any():
        return None
    start, due = example.about.window[0], example.about.window[1] + _target(run, "B6")
    large, small = 1e3 * _target(run, "B5"), 1e3 * run.results.rules.settling_error
    figure = Figure(figsize=(2 * SIZE[0], 1.15 * SIZE[0]), layout="constrained")
    x, z = 1e3 * example.motion[:, 1], 1e3 * example.motion[:, 2]
    late = within(example, due, math.inf)
    early = within(example, start, math.inf) & ~late
    shown = ((large, f"B5 target: {large:g} mm", None), (small, f"settled: {small:g} mm", 2 * small))
    for axes, (radius, name, reach) in zip(figure.subplots(1, 2), shown, strict=True):
        axes.plot(x[early], z[early], color=COLOURS[0], label="force and settling")
        axes.plot(x[late], z[late], color=COLOURS[1], label=f"after {_target(run, 'B6'):g} s of settling")
        angle = np.linspace(0, 2 * np.pi, 181)
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), **DASHED, label=name)
        axes.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal")
        if reach is not None:
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
        axes.locator_params(nbins=6)  # more would run into each other
        legend_above(axes)
    return figure


def example_error(run: Run, due_to_force: bool) -> Figure | None:
    """Figures 9 and 10: TCP position error [mm] of the example over time [s], due to the force or the chirp."""
    return _errors(run, due_to_force, [(entry, COLOURS[0], "nominal", 2) for entry in run.recorded(EXAMPLE)])


def spread_error(run: Run, due_to_force: bool) -> Figure | None:
    """Figures 11 and 12: the same for the uncertain systems; those assumed and the worst of all stand out."""
    shown = run.recorded(SYSTEMS)
    worst = max(shown, key=lambda entry: _peak(entry, due_to_force), default=None)
    others = [entry for entry in shown if _is_random(entry) and entry is not worst]
    looks = [(entry, MUTED, f"{len(others)} others", 2) for entry in others]
    for entry in (entry for entry in shown if not _is_random(entry) or entry is worst):
        name = entry.about.system + (" (worst)" if entry is worst else "")
        looks.append((entry, *((COLOURS[1], name, 3) if _is_random(entry) else (COLOURS[0], name, 4))))
    return _errors(run, due_to_force, looks)


def _errors(run: Run, due_to_force: bool, looks: Sequence[tuple[Recording, str, str, int]]) -> Figure | None:
    """TCP error [mm] over time [s] of recordings, each with colour, name and layer; equal names share an entry."""
    shown = [look for look in looks if within(look[0], *window(look[0], due_to_force)).any()]
    if not shown:
        return None
    begin, end = window(shown[0][0], due_to_force)
    figure, axes = _axes("Time [s]", "TCP position error [mm]")
    width = 0.8 if len(shown) == 1 else 0.5
    named: set[str] = set()
    for entry, colour, name, layer in shown:
        inside = within(entry, begin, end)
        label = "_" if name in named else name  # Matplotlib leaves labels with an underscore out
        t, error = entry.motion[inside, 0], 1e3 * entry.error[inside]
        axes.plot(t, error, color=colour, label=label, linewidth=width, zorder=layer)
        named.add(name)
    criterion = "B5" if due_to_force else "B7"
    target = 1e3 * _target(run, criterion)
    axes.axhline(target, **DASHED, label=f"{criterion} target: {target:g} mm", zorder=5)
    axes.set(xlim=(begin, end), ylim=(0, None))
    legend_above(axes)
    return figure


FIGURES: Mapping[str, Callable[[Run], Figure | None]] = {
    "figure_03_stiffness": stiffness,
    "figure_04_friction": friction,
    "figure_08_circles": circles,
    "figure_09_force": partial(example_error, due_to_force=True),
    "figure_10_chirp": partial(example_error, due_to_force=False),
    "figure_11_force_uncertain": partial(spread_error, due_to_force=True),
    "figure_12_chirp_uncertain": partial(spread_error, due_to_force=False),
}


def window(entry: Recording, due_to_force: bool) -> tuple[float, float]:
    """The time shown [s]: from shortly before the force to the settling time, or up to the force."""
    begin, end = entry.about.window
    return (begin - 0.2, end + 3.0) if due_to_force else (0.0, begin)


def within(entry: Recording, begin: float, end: float) -> np.ndarray:
    """Which samples of ``motion`` were taken from ``begin`` to ``end`` [s]."""
    t = entry.motion[:, 0]
    return (t >= begin) & (t <= end)


def _is_random(entry: Recording) -> bool:
    return entry.about.system.startswith("random")


def _peak(entry: Recording, due_to_force: bool) -> float:
    """The largest TCP error [m] in the time shown; a case that ended before has none."""
    return float(max(entry.error[within(entry, *window(entry, due_to_force))], default=0.0))


def _target(run: Run, name: str) -> float:
    return run.results.criteria[name].target


def _axes(xlabel: str, ylabel: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel=xlabel, ylabel=ylabel)
    return figure, axes
