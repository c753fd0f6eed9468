"""The arm as a figure of Matplotlib, its deviation from rest magnified."""

from __future__ import annotations

import math

from matplotlib.figure import Figure

from ..loop.scenario import Pair
from .style import COLOURS, MUTED

MAGNIFIED = 100.0
"""Factor on the deviations of the link angles: the tool moves by millimetres, the arm is metres long."""


def draw(figure: Figure, links: Pair, rest: Pair, q_a: Pair, words: str) -> None:
    """Draw the arm with these lengths of its ``links`` [m] into ``figure``, which is cleared: grey at the link angles
    ``rest``, and at ``q_a`` [rad], magnified; ``words`` stand above it."""
    figure.clear()
    axes = figure.subplots()
    reach = 1.1 * sum(links)
    shown = (rest[0] + MAGNIFIED * (q_a[0] - rest[0]), rest[1] + MAGNIFIED * (q_a[1] - rest[1]))
    for angles, colour, width in ((rest, MUTED, 2.0), (shown, COLOURS[0], 4.0)):
        x, z = joints(links, angles)
        axes.plot(x, z, color=colour, linewidth=width, marker="o", markerfacecolor="w", solid_capstyle="round")
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="x [m]", ylabel="z [m]")
    axes.set_title(f"{words}, deviation x {MAGNIFIED:g}", fontsize=9)
    axes.grid(alpha=0.3)


def joints(links: Pair, q_a: Pair) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Coordinates x and z [m] of shoulder, elbow and tool at the link angles ``q_a`` [rad], eq. (9)."""
    x, z = links[0] * math.sin(q_a[0]), links[0] * math.cos(q_a[0])
    both = q_a[0] + q_a[1]
    return (0.0, x, x + links[1] * math.cos(both)), (0.0, z, z - links[1] * math.sin(both))
