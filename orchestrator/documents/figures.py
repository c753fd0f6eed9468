"""Figures 3, 4 and 8 to 12 of the paper, of this run: PDF and SVG for a paper, PNG for a look; and the arm."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from plant_fmu.flexible_manipulator import dynamics
from plant_fmu.flexible_manipulator.coefficients import Joint
from plant_fmu.flexible_manipulator.coefficients import joint as joint_of

from ..loop.scenario import Pair
from ..views import drawing
from ..views.drawing import SIZE
from ..views.plot import Axis, Colour, Line, Plot, Window, hue
from ..views.units import TORQUE, Unit
from . import case_plots
from .case_plots import Curve
from .files import prepare_folder, write_bytes
from .recording import EXAMPLE, SYSTEMS, Recording, largest_error, part_of
from .results import Run
from .simulations import interpreted

ARC_MINUTE = Unit("rad", "arcmin", 180.0 * 60.0 / math.pi)
SPEED = Unit("rad/s", "rad/s")


def write_figures(run: Run, folder: Path) -> tuple[list[str], list[str]]:
    """Write all figures that the run has data for into ``folder``, which is created.

    Returns the names of the figures written, without endings, and of the others.
    """
    return write_drawn({name: partial(make, run) for name, make in FIGURES.items()}, folder)


def write_drawn(drawings: Mapping[str, Callable[[], Figure | None]], folder: Path) -> tuple[list[str], list[str]]:
    """Write figures by name into ``folder``, which is created, in all :data:`.drawing.FORMATS`.

    Returns the names of the figures written, without endings, and of those that there is nothing to draw for.
    """
    prepare_folder(folder)
    made = {name: make() for name, make in drawings.items()}
    for name, figure in made.items():
        for ending in drawing.FORMATS if figure is not None else ():
            assert figure is not None
            write_bytes(folder / f"{name}.{ending}", drawing.encoded(figure, ending))
    return [name for name in made if made[name] is not None], [name for name in made if made[name] is None]


def stiffness(run: Run) -> Figure:
    """Figure 3: spring torque over gear deflection, eq. (5), nominal parameters."""
    x, y = Axis("Deflection Δ_q", ARC_MINUTE), Axis("Spring torque τ_s", TORQUE)
    return _law(run, x, y, dynamics.spring, lambda joint: np.linspace(-2 * joint.psi, 2 * joint.psi, 401))


def friction(run: Run) -> Figure:
    """Figure 4: friction torque over motor speed, eq. (8), on the motor's side, nominal parameters."""
    x, y = Axis("Motor speed q̇_m", SPEED), Axis("Friction torque f / n", TORQUE)
    return _law(run, x, y, dynamics.friction, lambda _: np.linspace(-30, 30, 2001))


def _law(run: Run, x: Axis, y: Axis, law: Callable[..., float], points: Callable[[Joint], np.ndarray]) -> Figure:
    """What ``law`` gives for both joints at their ``points``."""
    joints = [joint_of(run.results.plant.nominal, axis) for axis in (1, 2)]
    lines = (
        Line(f"axis {axis}", points(joint), [interpreted(law)(joint, value) for value in points(joint)], hue(axis - 1))
        for axis, joint in enumerate(joints, start=1)
    )
    return drawing.figure(Plot("law", "", x, y, tuple(lines)))


def circles(run: Run) -> Figure | None:
    """Figure 8: path of the TCP [mm] from the force on, in the circle of B5, and enlarged in that of B6."""
    example = next(iter(run.recorded(EXAMPLE)), None)
    if example is None or largest_error(example, example.about.window[0]) is None:
        return None
    path, reach = case_plots.path("path", example, run.results.rules), 2.0 * run.results.rules.settling_error
    close = replace(path, window=Window("", (-reach, reach), (-reach, reach)))
    return drawing.figure([[path, close]], (2 * SIZE[0], 1.15 * SIZE[0]))


def example_error(run: Run, name: str) -> Figure | None:
    """Figures 9 and 10: TCP error [mm] of the example over time [s], due to the force or the chirp."""
    entries = [part_of(entry, *window(entry, name)) for entry in run.recorded(EXAMPLE)]
    return _errors(run, name, [Curve("nominal", entry) for entry in entries if len(entry.motion)])


def spread_error(run: Run, name: str) -> Figure | None:
    """Figures 11 and 12: the same for the uncertain systems; those assumed and the worst of all stand out."""
    parts = (part_of(entry, *window(entry, name)) for entry in run.recorded(SYSTEMS))
    entries = [entry for entry in parts if len(entry.motion)]
    curves = case_plots.spread_curves(entries, lambda entry: largest_error(entry, 0.0)) if entries else []
    return _errors(run, name, [curve._replace(width=0.9) for curve in curves])


def _errors(run: Run, name: str, curves: list[Curve]) -> Figure | None:
    """TCP errors of recordings in the part that a criterion is measured in, with its target."""
    if not curves:
        return None
    first, rules = curves[0].recording, run.results.rules
    plot = case_plots.errors("errors", "", curves, rules, Window("", window(first, name)), text="errors", of=first)
    levels = tuple(level for level in plot.levels if level.name.startswith(name))
    return drawing.figure(replace(plot, levels=levels))


FIGURES: Mapping[str, Callable[[Run], Figure | None]] = {
    "figure_03_stiffness": stiffness,
    "figure_04_friction": friction,
    "figure_08_circles": circles,
    "figure_09_force": partial(example_error, name="B5"),
    "figure_10_chirp": partial(example_error, name="B7"),
    "figure_11_force_uncertain": partial(spread_error, name="B5"),
    "figure_12_chirp_uncertain": partial(spread_error, name="B7"),
}


def window(entry: Recording, name: str) -> tuple[float, float]:
    """The time shown [s] of a criterion: from shortly before the force to the settling time, or up to the force."""
    begin, end = entry.about.window
    return (begin - 0.2, end + 3.0) if name == "B5" else (0.0, begin)


MAGNIFIED = 100.0
"""Factor on the deviations of the link angles: the tool moves by millimetres, the arm is metres long."""

METRE = Unit("m", "m")


def draw(figure: Figure, links: Pair, rest: Pair, q_a: Pair, words: str) -> None:
    """Draw the arm with these lengths of its ``links`` [m] into ``figure``, which is cleared: grey at the link angles
    ``rest``, and at ``q_a`` [rad], magnified; ``words`` stand above it."""
    figure.clear()
    reach = 1.1 * sum(links)
    shown = (rest[0] + MAGNIFIED * (q_a[0] - rest[0]), rest[1] + MAGNIFIED * (q_a[1] - rest[1]))
    looks: tuple[tuple[Pair, Colour, float], ...] = ((rest, "muted", 3.5), (shown, "one", 7.0))
    lines = tuple(Line("", *joints(links, angles), hue, width=width, symbol="ring") for angles, hue, width in looks)
    x, z = (Axis(name, METRE, -reach, reach) for name in "xz")
    plot = Plot("arm", f"{words}, deviation x {MAGNIFIED:g}", x, z, lines, square=True)
    drawing.figure(plot, into=figure, titles=True, font=9.0)


def joints(links: Pair, q_a: Pair) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Coordinates x and z [m] of shoulder, elbow and tool at the link angles ``q_a`` [rad], eq. (9)."""
    x, z = links[0] * math.sin(q_a[0]), links[0] * math.cos(q_a[0])
    both = q_a[0] + q_a[1]
    return (0.0, x, x + links[1] * math.cos(both)), (0.0, z, z - links[1] * math.sin(both))
