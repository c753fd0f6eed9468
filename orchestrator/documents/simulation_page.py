"""The page of simulations: their signals over each other, the time plots of each, and the arm moving."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from ..benchmark.case import Case
from ..benchmark.results import Rules
from ..loop.trajectory import Trajectory
from ..views.plot import Plot, Window, dash, hue
from ..views.table import Page, Panel, Part
from ..views.units import number
from . import case_plots
from .case_plots import SIMULATION, Curve
from .recording import Recording, largest_error, record

INTERVALS = 6000
"""Intervals that signals are thinned out to: enough to zoom into a second of 26."""


class PlottedSimulation(NamedTuple):
    """A simulation under its name on the page, and the command that repeats it, if there is one."""

    name: str
    case: Case
    trajectory: Trajectory
    command: str


def page(title: str, kicker: str, rules: Rules, shown: Sequence[PlottedSimulation], summary: tuple[Part, ...]) -> Page:
    """The page; with a single simulation there is nothing to lay over it."""
    parameters = dict(shown[0].case.scenario.parameters)
    recordings = list(map(_recorded, shown))
    commands = [one.command for one in shown]
    links = (parameters["l[1]"], parameters["l[2]"])
    panels = (
        *((Panel("overlay", "Overlay", _overlay(shown, recordings, rules)),) if len(shown) > 1 else ()),
        Panel("case", "Time plots", (case_plots.cases(recordings, rules, commands),)),
        Panel("motion", "Motion", case_plots.motion(recordings, rules, links, commands)),
        Panel("summary", "Summary", summary),
    )
    return Page(title, kicker, panels)


def _recorded(shown: PlottedSimulation) -> Recording:
    made = record(shown.case, (SIMULATION + shown.name,), shown.trajectory, INTERVALS)
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
        "overlay-error", "TCP position error", curves, rules, window, text=text, of=of, group="overlay", height=360
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
