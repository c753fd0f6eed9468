"""The page of simulations: their signals over each other, the time plots of each, and the arm moving."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import msgspec

from ..benchmark.case import Case
from ..benchmark.results import Rules
from ..codec import plain
from ..loop.trajectory import Trajectory
from ..views.table import Chart, Page, Panel, Part, Widget
from .payload import criteria, packed
from .recording import record

SCRIPTS = ("arm.js", "case.js", "motion.js", "overlay.js")

INTERVALS = 6000
"""Intervals that signals are thinned out to: enough to zoom into a second of 26."""

ROLE = "simulation "
"""Begins the role of a recording that is shown under a name of its own."""


class PlottedSimulation(NamedTuple):
    """A simulation under its name on the page, and the command that repeats it, if there is one."""

    name: str
    case: Case
    trajectory: Trajectory
    command: str


def page(title: str, kicker: str, rules: Rules, shown: Sequence[PlottedSimulation], summary: tuple[Part, ...]) -> Page:
    """The page; with a single simulation there is nothing to lay over it."""
    overlay = Panel(
        "overlay",
        "Overlay",
        (
            Chart("overlay-error", 360, "TCP position error"),
            Chart("overlay-torque-1", 300, "Torque of motor 1"),
            Chart("overlay-torque-2", 300, "Torque of motor 2"),
        ),
    )
    panels = (
        *((overlay,) if len(shown) > 1 else ()),
        Panel("case", "Time plots", (Widget("case.html"),)),
        Panel("motion", "Motion", (Widget("motion.html"),)),
        Panel("summary", "Summary", summary),
    )
    return Page(title, kicker, panels, SCRIPTS, partial(_payload, rules, tuple(shown)))


def _payload(rules: Rules, shown: Sequence[PlottedSimulation]) -> dict[str, Any]:
    parameters = dict(shown[0].case.scenario.parameters)
    recordings = []
    for each in shown:
        made = record(each.case, (ROLE + each.name,), each.trajectory, INTERVALS)
        # What a simulation came to is judged elsewhere; here is how it ended, and when.
        about = msgspec.structs.replace(made.about, duration=max(made.about.duration, made.about.time))
        recordings.append(packed(replace(made, about=about), each.command))
    return {
        "recordings": recordings,
        "criteria": criteria(rules.criteria),
        "rules": plain(rules),
        "links": [parameters["l[1]"], parameters["l[2]"]],
    }
