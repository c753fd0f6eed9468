"""The figures of docs/manipulator.md: the arm and the loop, as SVG for light and dark pages.

    python benchmarks/diagrams.py           docs/pictures/arm.svg and docs/pictures/loop.svg

Labels are the names of the variables in the code and in the plant FMU. Angles are drawn as the plant's equations have
them (eq. (9) and (10) of the paper); tests/test_diagrams.py compares the drawing with the plant's kinematics.
"""

from __future__ import annotations

import math
from pathlib import Path

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "pictures"
POSE = math.radians(15.0), math.radians(30.0)
LENGTHS = 1.0, 1.5
PHI_F = math.radians(50.0)
SCALE, BASE = 210.0, (150.0, 330.0)
"""Pixels per metre, and where the first joint is drawn."""

STYLE = """
.paper{fill:#ffffff} .line{stroke:#1d2733;fill:none;stroke-width:1.6} .thin{stroke:#6b7785;fill:none;stroke-width:1;
stroke-dasharray:4 3} .link{stroke:#7f9fc4;stroke-width:18;stroke-linecap:round} .box{fill:#eef3f9;stroke:#1d2733;
stroke-width:1.4} .force{stroke:#b3541e;fill:none;stroke-width:2.4} .head{fill:#1d2733} .hot{fill:#b3541e}
text{fill:#1d2733;font:15px system-ui,sans-serif} .name{font-family:ui-monospace,monospace;font-size:14px}
.small{font-size:13px} .warm{fill:#a0440f}
@media (prefers-color-scheme: dark){.paper{fill:#131820} .line,.box{stroke:#dbe4ee} .thin{stroke:#8d99a8}
.link{stroke:#4a6d98} .box{fill:#1f2a37} .force{stroke:#f09a63} .head{fill:#dbe4ee} .hot{fill:#f09a63}
text{fill:#e6edf5} .warm{fill:#f7b088}}
"""

Point = tuple[float, float]


def joints(q_a1: float, q_a2: float) -> tuple[Point, Point]:
    """Elbow and TCP (x, z) [m] at link angles [rad], eq. (9)."""
    l_1, l_2 = LENGTHS
    elbow = l_1 * math.sin(q_a1), l_1 * math.cos(q_a1)
    return elbow, (elbow[0] + l_2 * math.cos(q_a1 + q_a2), elbow[1] - l_2 * math.sin(q_a1 + q_a2))


def at(point: Point, base: Point = BASE, scale: float = SCALE) -> Point:
    """Where a point (x, z) [m] is on the page, whose second coordinate points downwards."""
    return base[0] + scale * point[0], base[1] - scale * point[1]


def svg(width: int, height: int, title: str, *parts: str) -> str:
    """A page with its own background, so that it can be read on any other."""
    markers = "".join(
        f'<marker id="{name}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" orient="auto">'
        f'<path class="{name}" d="M0 0 10 5 0 10z"/></marker>'
        for name in ("head", "hot")
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" aria-label="{title}">\n<style>{STYLE}</style>\n<defs>{markers}</defs>\n'
        f'<rect class="paper" width="{width}" height="{height}" rx="8"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


def line(*points: Point, kind: str = "line", arrow: bool = False) -> str:
    """A polyline, with a head at its end if it is an arrow."""
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    marker = f' marker-end="url(#{"hot" if kind == "force" else "head"})"' if arrow else ""
    return f'<polyline class="{kind}" points="{path}"{marker}/>'


def label(place: Point, text: str, kind: str = "name", anchor: str = "start") -> str:
    """Text on one line."""
    return f'<text class="{kind}" x="{place[0]:.1f}" y="{place[1]:.1f}" text-anchor="{anchor}">{text}</text>'


def box(left: float, top: float, width: float, height: float, *lines: str) -> str:
    """A box with centred lines of text."""
    middle, first = left + width / 2, top + height / 2 + 5 - 9 * (len(lines) - 1)
    texts = (label((middle, first + 18 * i), text, "small", "middle") for i, text in enumerate(lines))
    return f'<rect class="box" x="{left}" y="{top}" width="{width}" height="{height}" rx="5"/>' + "".join(texts)


def arc(centre: Point, radius: float, start: float, stop: float) -> str:
    """An arrow along a circle from one direction to another; angles from the x axis towards z [rad]."""
    (x_0, y_0), (x_1, y_1) = (
        (centre[0] + radius * math.cos(angle), centre[1] - radius * math.sin(angle)) for angle in (start, stop)
    )
    sweep = 0 if stop > start else 1
    path = f"M{x_0:.1f} {y_0:.1f}A{radius} {radius} 0 0 {sweep} {x_1:.1f} {y_1:.1f}"
    return f'<path class="line" d="{path}" marker-end="url(#head)"/>'


def towards(point: Point, angle: float, length: float) -> Point:
    """The point at a distance [px] in a direction [rad, from the x axis towards z]."""
    return point[0] + length * math.cos(angle), point[1] - length * math.sin(angle)


def spring(start: Point, stop: Point, turns: int = 4) -> str:
    """A zigzag between two points at the same height: the elastic gear."""
    step, height = (stop[0] - start[0]) / (2 * turns), 6.0
    inner = [(start[0] + step * (i + 0.5), start[1] + height * (1 if i % 2 else -1)) for i in range(2 * turns)]
    return line(start, *inner, stop)


def joint(place: Point, axis: int) -> str:
    """A joint with its elastic gear and its motor, to the left of it."""
    x, y = place
    return (
        box(x - 138, y - 17, 74, 34, f"motor {axis}")
        + spring((x - 64, y), (x - 10, y))
        + f'<circle class="box" cx="{x:.1f}" cy="{y:.1f}" r="10"/>'
    )


def arm() -> str:
    """The labelled arm."""
    elbow, tcp = joints(*POSE)
    base, middle, tool = BASE, at(elbow), at(tcp)
    first, second = math.pi / 2 - POSE[0], -POSE[0] - POSE[1]
    masses = [towards(base, first, 0.5 * SCALE), towards(middle, second, 0.8 * SCALE)]
    force = towards(tool, PHI_F, 75.0)
    return svg(
        640,
        500,
        "The arm with its link angles, motors, gears, tool centre point, force and gravity",
        line(base, middle, kind="link"),
        line(middle, tool, kind="link"),
        line(base, towards(base, math.pi / 2, 150.0), kind="thin"),
        arc(base, 125.0, math.pi / 2, first),
        label((base[0] - 12, base[1] - 135), "q_a[1]", anchor="end"),
        line(middle, towards(middle, -POSE[0], 190.0), kind="thin"),
        label(towards(middle, -POSE[0] + 0.05, 196.0), "at a right angle to link 1", "small"),
        arc(middle, 165.0, -POSE[0], second),
        label(towards(middle, -POSE[0] - 0.22, 176.0), "q_a[2]"),
        joint(base, 1),
        joint(middle, 2),
        label((base[0] - 138, base[1] + 38), "u_m[1], q_m[1]"),
        label((base[0] - 62, base[1] - 14), "gear", "small"),
        label((middle[0] - 138, middle[1] - 28), "u_m[2], q_m[2]"),
        label((middle[0] - 62, middle[1] + 26), "gear", "small"),
        label((base[0] + 34, base[1] - 40), "link 1: l[1], m[1]"),
        label((masses[1][0] + 32, masses[1][1] + 16), "link 2: l[2], m[2]"),
        *(f'<circle class="head" cx="{x:.1f}" cy="{y:.1f}" r="4"/>' for x, y in masses),
        label((masses[0][0] + 16, masses[0][1] - 2), "xi[1]"),
        label((masses[1][0] - 10, masses[1][1] + 20), "xi[2]", anchor="end"),
        f'<circle class="box" cx="{tool[0]:.1f}" cy="{tool[1]:.1f}" r="6"/>',
        label((tool[0] - 20, tool[1] + 28), "TCP, position X", anchor="middle"),
        line(tool, towards(tool, 0.0, 90.0), kind="thin"),
        line(tool, force, kind="force", arrow=True),
        label((force[0] + 6, force[1]), "F", "name warm"),
        arc(tool, 52.0, 0.0, PHI_F),
        label((tool[0] + 58, tool[1] - 16), "phi_F"),
        line((560.0, 60.0), (560.0, 120.0), arrow=True),
        label((572.0, 95.0), "g"),
        line((40.0, 460.0), (90.0, 460.0), arrow=True),
        label((96.0, 465.0), "x = X[1]"),
        line((40.0, 460.0), (40.0, 415.0), arrow=True),
        label((14.0, 405.0), "z = X[2]"),
        *(example for i, pose in enumerate(((0, 0), (0, -90), (90, -90))) for example in small_arm(i, pose)),
    )


def small_arm(number: int, pose_deg: tuple[int, int]) -> list[str]:
    """An arm without labels but its angles [degrees], at the lower edge."""
    elbow, tcp = joints(*map(math.radians, pose_deg))
    place, scale = ((250.0, 470.0), (385.0, 470.0), (525.0, 470.0))[number], 26.0
    points = [at(point, place, scale) for point in ((0.0, 0.0), elbow, tcp)]
    return [
        line(*points),
        f'<circle class="head" cx="{place[0]}" cy="{place[1]}" r="3"/>',
        label((place[0] + 14, place[1] + 20), f"q_a = ({pose_deg[0]}°, {pose_deg[1]}°)", "small", "middle"),
    ]


def loop() -> str:
    """The loop, in the order of docs/timing.md."""
    return svg(
        640,
        430,
        "The loop: controller, limits, quantization, delay, disturbances, manipulator, noise",
        box(90, 40, 110, 60, "controller", "FMU"),
        box(235, 40, 105, 60, "loop gain", "A1: 2.5"),
        box(370, 40, 105, 60, "saturation", "±u_max"),
        box(505, 40, 120, 60, "quantization", "12 bit"),
        line((20, 58), (90, 58), arrow=True),
        label((8, 50), "q_m_ref"),
        line((20, 88), (90, 88), arrow=True),
        label((8, 106), "u_m0"),
        line((200, 70), (235, 70), arrow=True),
        label((217, 32), "u_m", anchor="middle"),
        line((340, 70), (370, 70), arrow=True),
        line((475, 70), (505, 70), arrow=True),
        line((565, 100), (565, 130), arrow=True),
        box(505, 130, 120, 60, "hold, delay T_d", "A2: +1.5 ms"),
        line((565, 190), (565, 220), arrow=True),
        box(505, 220, 120, 50, "γ u_m + u_d"),
        line((420, 245), (505, 245), kind="force", arrow=True),
        label((414, 240), "u_d: chirp of the motor torque", "small warm", "end"),
        line((565, 270), (565, 300), arrow=True),
        box(470, 300, 155, 60, "manipulator", "(eq. 2)"),
        line((520, 405), (520, 360), kind="force", arrow=True),
        label((512, 412), "F: force on the tool", "small warm", "end"),
        line((600, 360), (600, 395), arrow=True),
        label((600, 412), "X", anchor="middle"),
        line((470, 330), (402, 330), arrow=True),
        label((436, 320), "q_m", anchor="middle"),
        '<circle class="box" cx="390" cy="330" r="12"/>' + label((390, 335), "+", "small", "middle"),
        line((390, 385), (390, 342), kind="force", arrow=True),
        label((384, 392), "n: noise", "small warm", "end"),
        line((378, 330), (325, 330), arrow=True),
        box(205, 300, 120, 60, "quantization", "16 bit"),
        line((205, 330), (145, 330), (145, 100), arrow=True),
        label((138, 290), "q_m", anchor="end"),
        label((160, 165), "one measurement and one torque", "small"),
        label((160, 183), "in each sample of T_s = 0.25 ms", "small"),
    )


FIGURES = {"arm.svg": arm, "loop.svg": loop}


def main() -> None:
    """Write the figures."""
    for name, figure in FIGURES.items():
        (PICTURES / name).write_text(figure(), encoding="utf-8")


if __name__ == "__main__":
    main()
