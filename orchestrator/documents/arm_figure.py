"""The arm as a figure of Matplotlib, its deviation from rest magnified."""

from __future__ import annotations

import math

from matplotlib.figure import Figure

from ..loop.scenario import Pair
from ..views import drawing
from ..views.plot import Axis, Colour, Line, Plot
from ..views.units import Unit

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
