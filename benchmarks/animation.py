"""Animations of the arm under the force: docs/pictures/disturbance.gif, the README's, shows two controllers, and each
docs/pictures/disturbance-NAME.gif one of the leaderboard.

    python benchmarks/animation.py          two simulations and the README's picture, a minute; needs a C compiler
    python benchmarks/animation.py --each   seven simulations and the pictures of the leaderboard

Each arm is the trajectory of one simulation on the system ``compliant`` with the test ``disturbance``. The deviation of
the link angles from rest is drawn MAGNIFIED times as large. The picture has SPEED seconds of the simulation per second.
"""

from __future__ import annotations

import argparse
import io
import math
import sys
from collections.abc import Mapping
from pathlib import Path

import matplotlib
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from PIL import Image  # noqa: E402

from benchmarks.leaderboard_tables import PAGES, animation  # noqa: E402
from orchestrator import Benchmark, Controller, Simulation  # noqa: E402

PICTURE = ROOT / "docs" / "pictures" / "disturbance.gif"
CONTROLLERS = {"DiagonalPID_C": "#b3541e", "RobustLQG": "#1f6fb4"}
"""The controllers of the README's picture, each with its colour."""

OWN = "#1f6fb4"
"""The colour of a controller that is alone in a picture."""

POSE = math.radians(45.0), math.radians(-60.0)
FROM, UNTIL = 9.8, 14.2
"""Part of the simulation that is shown [s]."""

FRAMES_PER_SECOND, SPEED, MAGNIFIED, COLOURS = 20, 0.5, 40.0, 32
SETTLED = 0.1
"""TCP error [mm] below which B6 takes the arm as settled."""

GREY = "0.45"


def simulated(name: str) -> Simulation:
    """The simulation of a controller, of the same case for all."""
    bench = Benchmark()
    return bench.simulate(Controller.built_in(name), bench.case_at(POSE, system="compliant", test="disturbance"))


def arm(q_a: np.ndarray, lengths: tuple[float, float]) -> np.ndarray:
    """Base, elbow and TCP [m] at link angles [rad], shape (3, 2); eq. (9)."""
    l_1, l_2 = lengths
    elbow = np.array([l_1 * math.sin(q_a[0]), l_1 * math.cos(q_a[0])])
    return np.array([np.zeros(2), elbow, elbow + l_2 * np.array([math.cos(q_a.sum()), -math.sin(q_a.sum())])])


def shown_arm(simulation: Simulation, k: int, lengths: tuple[float, float]) -> np.ndarray:
    """The arm at sample k with its deviation from the first sample magnified, shape (3, 2) [m]."""
    q_a = simulation.q_a
    return arm(q_a[0] + MAGNIFIED * (q_a[k] - q_a[0]), lengths)


def draw_arm(panel: Axes, simulation: Simulation, k: int, name: str, colour: str) -> None:
    """One panel: the arm at rest in grey, the arm now, and the force while it acts."""
    lengths = lengths_of(simulation)
    rest, now, pulse = (
        arm(simulation.q_a[0], lengths),
        shown_arm(simulation, k, lengths),
        simulation.case.scenario.pulse,
    )
    panel.plot(*rest.T, "-", color="0.85", lw=7, solid_capstyle="round")
    panel.plot(*now.T, "-", color=colour, lw=4, solid_capstyle="round", marker="o", mfc="white", ms=6)
    if pulse.start <= simulation.time[k] < pulse.stop:
        size = math.hypot(*pulse.force)
        tail = now[2] - 0.45 / size * np.array(pulse.force)
        panel.annotate("", now[2], tail, arrowprops={"arrowstyle": "-|>", "lw": 2, "color": "black"})
        panel.text(*tail, f" {size:.0f} N", fontsize=8)
    panel.set(xlim=(-0.35, 2.75), ylim=(-0.25, 1.4), aspect="equal", xticks=[], yticks=[])
    for side in panel.spines.values():
        side.set_visible(False)
    panel.set_title(name, fontsize=10, color=colour, pad=2)
    text = f"TCP error {1e3 * simulation.tcp_error[k]:5.2f} mm"
    panel.text(0.02, 0.02, text, transform=panel.transAxes, fontsize=8, family="monospace", color=GREY)


def lengths_of(simulation: Simulation) -> tuple[float, float]:
    """The lengths of the links [m]."""
    parameters = dict(simulation.case.scenario.parameters)
    return parameters.get("l[1]", 1.0), parameters.get("l[2]", 1.5)


def draw_errors(panel: Axes, found: Mapping[str, Simulation], colours: Mapping[str, str], k: int) -> None:
    """The TCP errors until sample k, with a logarithmic scale."""
    panel.axhline(SETTLED, color=GREY, lw=0.8, ls="--")
    label = f"settled: below {SETTLED:g} mm" + (" (target: within 3 s after the force)" if len(found) > 1 else "")
    panel.text(UNTIL - 0.03, 0.75 * SETTLED, label, fontsize=7, color=GREY, ha="right", va="top")
    for name, simulation in found.items():
        part = (simulation.time >= FROM) & (np.arange(len(simulation.time)) <= k)
        panel.plot(simulation.time[part][::20], 1e3 * simulation.tcp_error[part][::20], color=colours[name], lw=1.2)
    pulse = next(iter(found.values())).case.scenario.pulse
    panel.axvspan(pulse.start, pulse.stop, color="0.92", lw=0)
    panel.set(xlim=(FROM, UNTIL), ylim=(0.01, 30.0), yscale="log")
    panel.set_yticks([0.01, 0.1, 1.0, 10.0], ["0.01", "0.1", "1", "10"])
    panel.set_xlabel("time [s] (grey: the force acts)", fontsize=8)
    panel.set_ylabel("TCP error [mm]", fontsize=8)
    panel.tick_params(labelsize=7)


def frame(found: Mapping[str, Simulation], colours: Mapping[str, str], k: int) -> Image.Image:
    """The picture at sample k."""
    figure = plt.figure(figsize=(3.2 * len(found), 4.2), layout="constrained")
    scales = f"deflection {MAGNIFIED:g} times as large, {SPEED:g} times as fast"
    title = f"The same arm under the same force: {scales}" if len(found) > 1 else scales
    figure.suptitle(title, fontsize=9 if len(found) > 1 else 7)
    panels = figure.subplot_mosaic([[*found], ["errors"] * len(found)], height_ratios=[1.25, 1.0])
    for name, simulation in found.items():
        draw_arm(panels[name], simulation, k, name, colours[name])
    draw_errors(panels["errors"], found, colours, k)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=100)
    plt.close(figure)
    return Image.open(stream).convert("RGB")


def write(found: Mapping[str, Simulation], colours: Mapping[str, str], file: Path) -> None:
    """Draw the simulations of controllers by name beside each other, and write the animation."""
    sampled = next(iter(found.values())).time
    times = np.arange(FROM, UNTIL, SPEED / FRAMES_PER_SECOND)
    frames = [frame(found, colours, int(np.searchsorted(sampled, time))) for time in times]
    palette = frames[len(frames) // 6].quantize(COLOURS)
    first, *others = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in frames]
    duration = 1000 // FRAMES_PER_SECOND
    first.save(file, save_all=True, append_images=others, duration=duration, loop=0, optimize=True)
    print(f"{file.relative_to(ROOT)}: {len(frames)} frames, {file.stat().st_size / 1024:.0f} KiB")
    for name, simulation in found.items():
        print(f"{name}: settled {simulation.result.measurements.B6:.2f} s after the force")


def main() -> None:
    """Write the picture of the README, or those of the leaderboard."""
    parser = argparse.ArgumentParser(description="Write animations of the arm under the force.")
    parser.add_argument("--each", action="store_true", help="one for each controller of the leaderboard")
    if not parser.parse_args().each:
        write({name: simulated(name) for name in CONTROLLERS}, CONTROLLERS, PICTURE)
        return
    for name in PAGES:
        write({name: simulated(name)}, {name: OWN}, animation(name))


if __name__ == "__main__":
    main()
