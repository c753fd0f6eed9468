"""Figures 3, 4 and 8 to 12 of the paper, of this run: PDF and SVG for a paper, PNG for a look."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .files import FIGURES as FOLDER
from .files import prepare_folder, write_bytes
from .recording import EXAMPLE, SPREAD, Recording
from .run import Run

FORMATS: Mapping[str, Mapping[str, Any]] = {
    "pdf": {"metadata": {"CreationDate": None}},
    "svg": {"metadata": {"Date": None}},
    "png": {"dpi": 200},
}
"""File endings, and what keeps a file free of the time it was written at."""

STYLE: Any = {
    "font.size": 8,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 0.8,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "flexible-manipulator",
}
SIZE = (3.4, 2.4)
"""One column of a paper [inch]."""

ARC_MINUTE = math.pi / (180 * 60)
COLOURS = ("#0072b2", "#d55e00")


def write_figures(run: Run) -> list[str]:
    """Write all figures there is data for into the run's folder; returns their names, without endings."""
    folder = run.folder / FOLDER
    prepare_folder(folder)
    with rc_context(STYLE):
        made = {name: draw(run) for name, draw in FIGURES.items()}
        for name, figure in made.items():
            if figure is not None:
                _save(figure, folder / name)
    return [f"{FOLDER}/{name}" for name, figure in made.items() if figure is not None]


def stiffness(run: Run) -> Figure:
    """Figure 3: spring torque [Nm] over gear deflection [arc minutes], eq. (5), nominal parameters."""
    p = run.document["plant"]["nominal"]
    figure, axes = _axes("Deflection $\\Delta_q$ [arcmin]", "Spring torque $\\tau_s$ [Nm]")
    for i, colour in zip((1, 2), COLOURS, strict=True):
        psi, low, high = (p[f"{name}[{i}]"] for name in ("psi", "k_low", "k_high"))
        delta = np.linspace(-2 * psi, 2 * psi, 401)
        within = np.clip(delta, -psi, psi)
        torque = low * within + (high - low) / (3 * psi**2) * within**3 + high * (delta - within)
        axes.plot(delta / ARC_MINUTE, torque, color=colour, label=f"axis {i}")
    axes.legend()
    return figure


def friction(run: Run) -> Figure:
    """Figure 4: friction torque [Nm] over motor speed [rad/s], eq. (8), on the motor's side, nominal parameters."""
    p = run.document["plant"]["nominal"]
    figure, axes = _axes("Motor speed $\\dot q_m$ [rad/s]", "Friction torque $f / n$ [Nm]")
    v = np.linspace(-30, 30, 2001)
    for i, colour in zip((1, 2), COLOURS, strict=True):
        f_d, f_c, mu_k, alpha, beta = (p[f"{name}[{i}]"] for name in ("f_d", "f_c", "mu_k", "alpha", "beta"))
        torque = f_d * v + f_c * (mu_k + (1 - mu_k) / np.cosh(beta * v)) * np.tanh(alpha * v)
        axes.plot(v, torque, color=colour, label=f"axis {i}")
    axes.legend()
    return figure


def circles(run: Run) -> Figure | None:
    """Figure 8: path of the TCP [mm] from the force on, in the circle of B5, and enlarged in that of B6."""
    example = next(iter(run.recorded(EXAMPLE)), None)
    if example is None:
        return None
    due = example.about.window[1] + _target(run, "B6")
    large, small = 1e3 * _target(run, "B5"), 1e3 * run.document["rules"]["settling_error"]
    figure = Figure(figsize=(2 * SIZE[0], SIZE[0]), layout="constrained")
    t, x, z = example.motion[:, 0], 1e3 * example.motion[:, 1], 1e3 * example.motion[:, 2]
    forced, late = t >= example.about.window[0], t >= due
    for axes, radius, reach in zip(figure.subplots(1, 2), (large, small), (None, 2 * small), strict=True):
        axes.plot(x[forced & ~late], z[forced & ~late], color=COLOURS[0], label="force and settling")
        axes.plot(x[late], z[late], color=COLOURS[1], label=f"after {_target(run, 'B6'):g} s of settling")
        angle = np.linspace(0, 2 * np.pi, 181)
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), "k--", label=f"{radius:g} mm")
        axes.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal")
        if reach is not None:
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
        axes.legend(fontsize=6, loc="upper right")
    return figure


def error(role: str, due_to_force: bool) -> Callable[[Run], Figure | None]:
    """Figures 9 to 12: TCP position error [mm] of the recordings with ``role`` over time [s], due to force or chirp."""

    def draw(run: Run) -> Figure | None:
        shown = run.recorded(role)
        if not shown:
            return None
        begin, end = _window(shown, due_to_force)
        figure, axes = _axes("Time [s]", "TCP position error [mm]")
        for entry in shown:
            t = entry.motion[:, 0]
            inside = (t >= begin) & (t <= end)
            axes.plot(t[inside], 1e3 * entry.error[inside], linewidth=0.8 if role == EXAMPLE else 0.5)
        axes.axhline(1e3 * _target(run, "B5" if due_to_force else "B7"), color="k", linestyle="--", linewidth=0.7)
        axes.set(xlim=(begin, end), ylim=(0, None))
        return figure

    return draw


FIGURES: Mapping[str, Callable[[Run], Figure | None]] = {
    "figure_03_stiffness": stiffness,
    "figure_04_friction": friction,
    "figure_08_circles": circles,
    "figure_09_force": error(EXAMPLE, due_to_force=True),
    "figure_10_chirp": error(EXAMPLE, due_to_force=False),
    "figure_11_force_uncertain": error(SPREAD, due_to_force=True),
    "figure_12_chirp_uncertain": error(SPREAD, due_to_force=False),
}


def _window(shown: Sequence[Recording], due_to_force: bool) -> tuple[float, float]:
    """The time shown [s]: from shortly before the force to the settling time, or up to the force."""
    begin, end = shown[0].about.window
    return (begin - 0.2, end + 3.0) if due_to_force else (0.0, begin)


def _target(run: Run, name: str) -> float:
    return run.document["criteria"][name]["target"]


def _axes(xlabel: str, ylabel: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel=xlabel, ylabel=ylabel)
    return figure, axes


def _save(figure: Figure, file: Path) -> None:
    for ending, options in FORMATS.items():
        stream = io.BytesIO()
        figure.savefig(stream, format=ending, **options)
        write_bytes(file.with_suffix(f".{ending}"), stream.getvalue())
