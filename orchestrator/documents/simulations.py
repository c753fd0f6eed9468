"""What is shown and written of simulations: files in CSV, NPZ and MAT, a plot in the paper's units, and the page:
signals over each other, the time plots of each, and the arm moving."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np

from ..benchmark.case import Case
from ..benchmark.results import Rules
from ..loop import scenario as scenarios
from ..loop.scenario import ChirpSignal, PulseSignal, Scenario
from ..loop.trajectory import Trajectory
from ..views.export import csv_text
from ..views.plot import Axis, Line, Plot, Window, dash, hue
from ..views.table import Link, Page, Panel, Part
from ..views.units import MILLIMETRE, SECOND, TORQUE, number
from . import case_plots, conclusions
from .case_plots import SIMULATION, Curve
from .files import streamed, write_bytes, write_text
from .recording import Recording, affordable, largest_error, record

# Imports inside functions: Matplotlib and SciPy are loaded by those who need them.

if TYPE_CHECKING:  # loaded by those who draw
    from matplotlib.figure import Figure

Table = Mapping[str, np.ndarray]
"""Signals by name with unit, such as ``q_m[1] [rad]``, each of shape (N + 1,)."""


def columns(trajectory: Trajectory, scenario: Scenario) -> Table:
    """All signals of a simulation. Torques at the last instant, which are not computed, are NaN."""
    t = trajectory.time
    u_d = _while_on(scenarios.chirp, scenarios.chirp_signal(scenario.chirp, scenario.again), t)
    F = _while_on(scenarios.pulse, scenarios.pulse_signal(scenario.pulse, scenario.again), t)
    pending = np.full((len(t) - len(trajectory.torque), 2), np.nan)
    pairs = {
        "q_m[{}] [rad]": trajectory.q_m,
        "u_c[{}] [N.m]": np.vstack([trajectory.command, pending]),
        "u_m[{}] [N.m]": np.vstack([trajectory.torque, pending]),
        "u_d[{}] [N.m]": u_d,
    }
    return {
        "time [s]": t,
        **{f"{name} [rad]": values for name, values in trajectory.extra.items()},
        **{name.format(i + 1): values[:, i] for name, values in pairs.items() for i in range(2)},
        "F_x [N]": F[:, 0],
        "F_z [N]": F[:, 1],
        "x [m]": trajectory.X[:, 0],
        "z [m]": trajectory.X[:, 1],
        "tcp_error [m]": trajectory.tcp_error,
    }


def _while_on(
    function: Callable[[Any, float], tuple[float, float]], signal: ChirpSignal | PulseSignal, t: np.ndarray
) -> np.ndarray:
    """A disturbance at the times ``t``, shape (len(t), 2); it is only computed where it is not zero."""
    ends = [
        [scenarios.later(end, n, signal.period) for n in range(signal.number)] for end in (signal.start, signal.stop)
    ]
    begun, ended = (np.searchsorted(times, t, side="right") for times in ends)
    values, on = np.zeros((len(t), 2)), begun > ended
    values[on] = np.array([function(signal, time) for time in t[on].tolist()]).reshape(-1, 2)
    return values


def interpreted(function: Callable[..., Any]) -> Callable[..., Any]:
    """The Python source of a compiled function: compiling it would take longer than the few calls made here."""
    python: Callable[..., Any] = getattr(function, "py_func", function)
    return python


def write_csv(table: Table, file: Path) -> None:
    """Write the columns with their names as header; each number with as few digits as determine it exactly."""
    write_text(file, csv_text(table, zip(*(column.tolist() for column in table.values()), strict=True)))


def write_npz(table: Table, file: Path) -> None:
    """Write the columns as arrays by their names: ``numpy.load(file)["u_m[1] [N.m]"]``.

    They are not compressed: that would take longer than the simulation, and halve their size only.
    """
    write_bytes(file, streamed(lambda stream: np.savez(stream, allow_pickle=False, **table)))


def write_mat(table: Table, file: Path) -> None:
    """Write the columns as MATLAB variables ``time``, ``q_m_1``, ..., ``tcp_error``, in the same SI units."""
    from scipy.io import savemat

    named = {re.sub(r"\W+", "_", name.split(" ")[0]).strip("_"): column for name, column in table.items()}
    write_bytes(file, streamed(lambda stream: savemat(stream, named, oned_as="column", do_compression=True)))


def plot(trajectory: Trajectory, scenario: Scenario, title: str = "", figure: Figure | None = None) -> Figure:
    """TCP error [mm] and motor torques [Nm] over time, drawn into ``figure`` or a new one."""
    from ..views import drawing  # Matplotlib takes as long to load as the rest of a command

    t = trajectory.time
    window = Window("", (float(t[0]), float(t[-1] if len(t) > 1 else scenario.duration)))
    error = Line("", t, trajectory.tcp_error)
    # A formula in a label would take longer to typeset than all else.
    torques = tuple(Line(f"axis {i + 1}", t[:-1], trajectory.torque[:, i], hue(i), step=True) for i in range(2))
    time = Axis("Time", SECOND)
    plots = (
        Plot("error", title, time, Axis("TCP error", MILLIMETRE), (error,), window=window, group="time"),
        Plot("torque", "", time, Axis("Motor torque", TORQUE), torques, window=window, group="time"),
    )
    return drawing.figure([[plot] for plot in plots], (8, 6), figure, titles=True, font=10.0)


def write_plot(figure: Figure, file: Path) -> None:
    """Write a figure in the format that the file's ending names."""
    ending = file.suffix.lstrip(".") or "png"
    write_bytes(file, streamed(lambda stream: figure.savefig(stream, format=ending, dpi=150)))


class PlottedSimulation(NamedTuple):
    """A simulation under its name on the page, the command that repeats it, if there is one, and what it came to."""

    name: str
    case: Case
    trajectory: Trajectory
    command: str
    outcome: str


def page(title: str, kicker: str, rules: Rules, shown: Sequence[PlottedSimulation], summary: tuple[Part, ...]) -> Page:
    """The page; with a single simulation there is nothing to lay over it."""
    parameters = dict(shown[0].case.scenario.parameters)
    recordings = affordable(list(map(_recorded, shown)))
    commands = [one.command for one in shown]
    links = (parameters["l[1]"], parameters["l[2]"])
    panels = (
        *((Panel("overlay", "Overlay", _overlay(shown, recordings, rules)),) if len(shown) > 1 else ()),
        Panel("case", "Time plots", (case_plots.cases(recordings, rules, commands),)),
        Panel("motion", "Motion", case_plots.motion(recordings, rules, links, commands)),
        Panel("summary", "Summary", summary),
    )
    several = len(shown) > 1
    words = [f"{one.name}: {one.outcome}" if several else one.outcome[:1].upper() + one.outcome[1:] for one in shown]
    steps = [Link("see what was measured", panel="summary"), Link("see the arm move", panel="motion")]
    return Page(title, kicker, panels, conclusions.conclusion(None, words, steps))


def _recorded(shown: PlottedSimulation) -> Recording:
    made = record(shown.case, (SIMULATION + shown.name,), shown.trajectory)
    # What a simulation came to is judged elsewhere; here is how it ended, and when.
    about = msgspec.structs.replace(made.about, duration=max(made.about.duration, made.about.time))
    return Recording(about, made.motion, made.torque)


def _overlay(shown: Sequence[PlottedSimulation], recordings: Sequence[Recording], rules: Rules) -> tuple[Plot, ...]:
    """TCP error and torques of all simulations, zoomed together."""
    curves = [
        Curve(simulation.name, entry, hue(place), dash=dash(place))
        for place, (simulation, entry) in enumerate(zip(shown, recordings, strict=True))
    ]
    window = Window("", (0.0, max(entry.about.time for entry in recordings)))
    most = (f"{curve.name}: at most {number(largest_error(curve.recording, 0.0), 1e3)} mm" for curve in curves)
    text = f"{'. '.join(most)}. Wheel with Ctrl, slider or a box zoom all charts; a click on a name hides its line."
    of = recordings[0] if all(map(case_plots.pulsed, recordings)) else None
    error = case_plots.errors(
        "overlay-error", "TCP error", curves, rules, window, text=text, of=of, group="overlay", height=360
    )
    torques = (
        case_plots.torques(
            f"overlay-torque-{axis}",
            f"Torque of motor {axis}",
            curves,
            axis,
            limit,
            window,
            text=f"Torque sent to the drive of axis {axis}, which is limited to {limit:g} Nm; gravity included.",
            group="overlay",
        )
        for axis, limit in enumerate(rules.torque_limit, start=1)
    )
    return error, *torques
