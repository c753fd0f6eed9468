"""Recorded cases as plots: TCP error and torques over time, the path of the TCP, and the arm in motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..benchmark.results import Rules
from ..views.plot import Axis, Band, Colour, Dash, Level, Line, Moved, MovingArm, Plot, Window, hue
from ..views.table import Beside, Choice, Commands, Note, Part
from ..views.units import MILLIMETRE, SECOND, TORQUE, number
from .recording import BOUNDED, Recording, largest_error, peak

SIMULATION = "simulation "
"""Begins the role of a recording that is shown under a name of its own."""

TIME = Axis("Time", SECOND)
ERROR = Axis("TCP error", MILLIMETRE, low=0.0)
TORQUE_AXIS = Axis("Motor torque", TORQUE)

HEADROOM = 1.08
"""End of the axis of torques, relative to their limit."""


class Curve(NamedTuple):
    """A recording under a name, and how it is drawn."""

    name: str
    recording: Recording
    colour: Colour = "one"
    width: float = 1.4
    faint: bool = False
    above: bool = False
    dash: Dash = "solid"


def degrees(angle: float) -> str:
    """An angle [rad] in whole degrees, halves up."""
    # The pages' scripts round halves up, Python to even numbers; 9 digits hide what the conversion from radians adds.
    return f"{math.floor(round(math.degrees(angle), 9) + 0.5)}°"


def pose_words(q_a: Sequence[float]) -> str:
    """Link angles [rad] in degrees."""
    return " / ".join(map(degrees, q_a))


def pulsed(entry: Recording) -> bool:
    """Whether a force acts, and not the noise alone."""
    return math.hypot(*entry.about.force) > 0.0


def targets(entry: Recording, rules: Rules) -> tuple[Level, ...]:
    """What the TCP error is to stay below in a case, and when: chirp, force, and when it is to have settled.
    Where the disturbances come again, the first time."""
    about, first = entry.about, entry.about.pushes[0]
    (begin, end), until = first.window, min(first.until, entry.about.time)
    due = end + rules.criteria["B6"].target
    limits = (
        ("B7 target", rules.criteria["B7"].target, about.chirp[0], min(begin, until)),
        ("B5 target", rules.criteria["B5"].target, begin, min(due, until)),
        ("settled", rules.settling_error, due, until),
    )
    return tuple(
        Level(value, f"{name} {number(value, 1e3)} mm", first, last)
        for name, value, first, last in limits
        if first < last
    )


def error_line(curve: Curve) -> Line:
    """TCP error over time."""
    name, entry, colour, width, faint, above, dash = curve
    return Line(name, entry.motion[:, 0], entry.error, colour, dash, width, faint=faint, above=above)


def torque_lines(curve: Curve, axis: int) -> Iterator[Line]:
    """Torque of motor 1 or 2 over time, or its bounds."""
    table, highest = curve.recording.torque, curve.recording.highest
    for values in (table[:, axis], *(() if highest is None else (highest[:, axis - 1],))):
        yield Line(curve.name, table[:, 0], values, curve.colour, curve.dash, curve.width)


def bounds_words(entries: Iterable[Recording]) -> str:
    """What two curves of one torque are; empty if each has one."""
    bounded = [entry for entry in entries if entry.highest is not None]
    if not bounded:
        return ""
    length = max(entry.about.time for entry in bounded) / BOUNDED
    return (
        f" Where a torque has two lines, it is too lively for a page: they are its smallest and largest value in "
        f"{number(length, 1e3)} ms."
    )


def settling_top(largest: float | None, rules: Rules) -> float:
    """The largest error [m] to show of one that settles to ``largest``: the band of the settled TCP is to be seen."""
    return max(5.0 * rules.settling_error, 1.2 * (largest or 0.0))


# A case by itself: it is chosen, and its plots are zoomed together.


def cases(entries: Sequence[Recording], rules: Rules, commands: Sequence[str], nominal: Sequence[Recording | None] = ()
          ) -> Choice:  # fmt: skip
    """The plots of each case, with the command that repeats it, and the error of a ``nominal`` arm beside its own."""
    others = nominal or [None] * len(entries)
    options = tuple(
        (f"{_roles(entry, rules)} ({entry.about.id})", _case(f"case-{place}", entry, rules, command, other))
        for place, (entry, command, other) in enumerate(zip(entries, commands, others, strict=True))
    )
    return Choice("case", "Case", options, _first(entries))


def _case(id: str, entry: Recording, rules: Rules, command: str, other: Recording | None) -> tuple[Part, ...]:
    about = entry.about
    ended = f" Ended {about.status.value} at {number(about.time)} s: {about.message}" if about.status != "done" else ""
    return (
        Note(f"{about.id}: {_roles(entry, rules)}.{ended}", warning=False),
        error_of_case(id, entry, rules, other),
        Beside(((torques_of_case(id, entry, rules),), (path(f"{id}-path", entry, rules),)), equal=True),
        *_again(command),
    )


def _roles(entry: Recording, rules: Rules) -> str:
    return "; ".join(role_words(role, rules) for role in entry.about.roles)


def role_words(role: str, rules: Rules) -> str:
    """What a recording is shown for."""
    if role.startswith(SIMULATION):
        return role.removeprefix(SIMULATION)
    if role == "example":
        return "example, nominal system (Figures 9 and 10)"
    name, _, which = role.partition(" ")
    if which:
        return f"worst of {name}, {f'axis {which}' if which.isdigit() else which}"
    return f"worst {name}: {rules.criteria[name].title}" if name in rules.criteria else f"worst of {name}"


def windows(entry: Recording, rules: Rules) -> dict[str, Window]:
    """Parts of a case that are worth a look, by the criterion that they show."""
    about, (begin, end) = entry.about, entry.about.window
    whole = {"": Window("Whole", (0.0, about.time))}
    if not pulsed(entry):
        return whole
    settled = end + rules.criteria["B6"].target
    top = settling_top(largest_error(entry, settled, about.pushes[0].until), rules)
    parts = {
        "B7": Window("Chirp (Fig. 10)", (about.chirp[0], about.chirp[1] + 0.5)),
        "B5": Window("Force (Fig. 9)", (begin - 0.2, end + 1.5)),
        "B6": Window("Settling", (end, settled + 1.0), (0.0, top)),
        "end": Window("Last 3 s", (about.duration - 3.0, about.duration)),
    }
    return whole | {name: part for name, part in parts.items() if part.x and part.x[1] <= about.time + 1e-6}


def _first_window(entry: Recording, rules: Rules) -> Window:
    parts = windows(entry, rules)
    role = next((name for name in ("B7", "B5", "B6") if name in entry.about.roles), "")
    return parts.get(role, parts[""])


def error_of_case(id: str, entry: Recording, rules: Rules, other: Recording | None = None) -> Plot:
    """TCP error of a case over time, and that of another arm in the same pose and test."""
    about, force = entry.about, pulsed(entry)
    bands = disturbances(entry) if force else ()
    curve = Curve("TCP error" if other is None else about.system, entry, above=True)
    beside = () if other is None else (Curve("nominal arm", other, "two"),)
    return Plot(
        f"{id}-error",
        "TCP error",
        TIME,
        ERROR,
        tuple(map(error_line, (curve, *beside))),
        targets(entry, rules) if force else (),
        bands,
        _error_words(entry, other),
        zoom=True,
        window=_first_window(entry, rules),
        windows=tuple(windows(entry, rules).values()),
        group=id,
        height=340,
    )


def disturbances(entry: Recording) -> tuple[Band, ...]:
    """When chirp and force act, each time; the first of each has its name."""
    about = entry.about
    length = about.chirp[1] - about.chirp[0]
    chirps = (Band(push.chirp, push.chirp + length, "" if n else "chirp") for n, push in enumerate(about.pushes))
    return *chirps, *forces(entry)


def forces(entry: Recording) -> tuple[Band, ...]:
    """When the force acts, each time."""
    return tuple(Band(*push.window, "" if n else "force") for n, push in enumerate(entry.about.pushes))


def _error_words(entry: Recording, other: Recording | None) -> str:
    about = entry.about
    largest, at = peak(entry) or (None, None)
    causes = {"measurement noise alone": largest}
    if pulsed(entry):
        force = f"the force of {number(math.hypot(*about.force))} N"
        several = f" (each of {len(about.pushes)} times)" if len(about.pushes) > 1 else ""
        spans = {
            "the chirp": [(push.chirp, push.window[0]) for push in about.pushes],
            force + several: [(push.window[0], push.until) for push in about.pushes],
        }
        causes = {cause: _largest_within(entry, parts) for cause, parts in spans.items()}
    parts = [f"{number(most, 1e3)} mm due to {cause}" for cause, most in causes.items() if most is not None]
    missed = [cause for cause, most in causes.items() if most is None]
    words = f"TCP error of {pose_words(about.q_a)}, {about.system}, {about.test}: at most "
    words += f"{', '.join(parts) or f'{number(largest, 1e3)} mm'}; the largest at {number(at)} s."
    if missed:
        words += f" The case ended at {number(about.time)} s, before {' and '.join(missed)}."
    if other is not None:
        words += f" The nominal arm in the same pose and test: at most {number(largest_error(other, 0.0), 1e3)} mm."
    return words + " Wheel with Ctrl, slider or buttons zoom."


def _largest_within(entry: Recording, parts: Iterable[tuple[float, float]]) -> float | None:
    """The largest TCP error [m] in the ``parts`` [s]; None if nothing was recorded there."""
    found = (largest_error(entry, *part) for part in parts)
    return max((value for value in found if value is not None), default=None)


def torques_of_case(id: str, entry: Recording, rules: Rules) -> Plot:
    """Both torques of a case over time, between their limits."""
    limits = rules.torque_limit
    most = [entry.largest_torque(axis) for axis in (1, 2)]
    levels = tuple(
        Level(sign * limit, f"limit {axis + 1}", colour=hue(axis))
        for axis, limit in enumerate(limits)
        for sign in (1, -1)
    )
    reached = (f"{number(float(top))} Nm of {limit:g} Nm on axis {axis}"
               for axis, (top, limit) in enumerate(zip(most, limits, strict=True), start=1))  # fmt: skip
    end = HEADROOM * max(limits)
    return Plot(
        f"{id}-torque",
        "Motor torques",
        TIME,
        replace(TORQUE_AXIS, low=-end, high=end),
        tuple(line for axis in (1, 2) for line in torque_lines(Curve(f"u_m{axis}", entry, hue(axis - 1), 1.0), axis)),
        levels,
        text=f"Torques sent to the drives: at most {' and '.join(reached)}, gravity included.{bounds_words([entry])}",
        zoom=True,
        window=Window("", _first_window(entry, rules).x),
        group=id,
        height=480,
    )


# The path.


def path(id: str, entry: Recording, rules: Rules) -> Plot:
    """The path of the TCP from the force on, in the circles of B5 and of the settled TCP; of the first force, where it
    comes again."""
    large, small = rules.criteria["B5"].target, rules.settling_error
    begin, due = entry.about.window[0], entry.about.window[1] + rules.criteria["B6"].target
    x, z, until = entry.motion[:, 1], entry.motion[:, 2], entry.about.pushes[0].until
    first, late, end = (int(np.searchsorted(entry.motion[:, 0], t)) for t in (begin, due, until))
    parts = [("TCP", (0, end), hue(0))]
    if pulsed(entry):
        after = f"after {number(rules.criteria['B6'].target)} s of settling"
        parts = [("force and settling", (first, late), hue(0)), (after, (late, end), hue(1))]
    lines = tuple(Line(name, x, z, colour, width=1.2, rows=rows) for name, rows, colour in parts if rows[0] < rows[1])
    reach = 1.1 * max(largest_error(entry, begin if pulsed(entry) else 0.0, until) or 0.0, large)
    whole, close = (Window(name, (-r, r), (-r, r))
                    for name, r in (("Largest error", reach), ("Settled TCP", 2.5 * small)))  # fmt: skip
    return Plot(
        id,
        "TCP path",
        Axis("x offset", MILLIMETRE),
        Axis("z offset", MILLIMETRE),
        (*lines, _circle("B5 target", large, "limit"), _circle("settled", small, "three")),
        text=_path_words(entry, rules),
        zoom=True,
        window=whole,
        windows=(whole, close),
        square=True,
        height=480,
    )


def _circle(name: str, radius: float, colour: Colour) -> Line:
    angle = np.linspace(0.0, 2.0 * math.pi, 121)
    x, z = radius * np.cos(angle), radius * np.sin(angle)
    words = f"{name} {number(radius, 1e3)} mm"
    return Line(words, x.tolist(), z.tolist(), colour, "dashed", width=1.2)


def _path_words(entry: Recording, rules: Rules) -> str:
    """What is asked of the path, and what became of it."""
    if not pulsed(entry):
        return "Path of the TCP."
    about, due = entry.about, entry.about.window[1] + rules.criteria["B6"].target
    until = about.pushes[0].until
    forced, settled = largest_error(entry, about.window[0], until), largest_error(entry, due, until)
    ended = f"ended at {number(about.time)} s, before"
    target = rules.criteria["B5"].target
    stays = "it stays inside the large one" if (forced or 0.0) <= target else "it leaves the large one"
    if forced is None:
        verdict = f"the case {ended} the force."
    elif settled is None:
        verdict = f"{stays} and {ended} it was to be inside the small one."
    else:
        verdict = f"{stays} and {'is' if settled < rules.settling_error else 'is not'} inside the small one in time."
    return (
        f"Path of the TCP from the beginning of the {'first ' if about.again else ''}force (Figure 8): "
        "wanted always inside the large circle, and "
        f"{number(rules.criteria['B6'].target)} s after the force inside the small one; {verdict}"
    )


# Several cases over each other.


def errors(
    id: str,
    title: str,
    curves: Sequence[Curve],
    rules: Rules,
    window: Window,
    *,
    text: str,
    bands: tuple[Band, ...] = (),
    of: Recording | None = None,
    group: str = "",
    height: int = 340,
) -> Plot:
    """TCP errors of several recordings, with the targets of one ``of`` them, first shown in ``window``."""
    lines = tuple(map(error_line, curves))
    levels = () if of is None else targets(of, rules)
    return Plot(
        id, title, TIME, ERROR, lines, levels, bands, text, zoom=True, window=window, group=group, height=height
    )  # fmt: skip


def torques(
    id: str, title: str, curves: Sequence[Curve], axis: int, limit: float, window: Window, *, text: str, group: str = ""
) -> Plot:
    """The torque of one motor in several recordings, between its limits."""
    levels = tuple(Level(sign * limit, "limit") for sign in (1, -1))
    y = replace(TORQUE_AXIS, low=-HEADROOM * limit, high=HEADROOM * limit)
    lines = tuple(line for curve in curves for line in torque_lines(curve, axis))
    text += bounds_words(curve.recording for curve in curves)
    shown = Window(window.name, window.x)
    return Plot(id, title, TIME, y, lines, levels, (), text, zoom=True, window=shown, group=group, height=340)


def spread_curves(entries: Sequence[Recording], of: Callable[[Recording], float | None]) -> list[Curve]:
    """Curves of many uncertain systems: those assumed and the worst of all stand out, the others share a name."""
    worst = max(entries, key=lambda entry: of(entry) or 0.0)
    others = [entry for entry in entries if _random(entry) and entry is not worst]
    out = [
        Curve(
            entry.about.system + (" (worst)" if entry is worst else ""),
            entry,
            *(("two", 1.6) if _random(entry) else ("one", 2.2)),
            above=True,
        )
        for entry in entries
        if not _random(entry) or entry is worst
    ]
    return [*out, *(Curve(f"{len(others)} others", entry, "muted", 1.0, faint=True) for entry in others)]


def _random(entry: Recording) -> bool:
    return entry.about.system.startswith("random")


def dispersion(entries: Sequence[Recording], rules: Rules, name: str, part: tuple[float, float], cause: str) -> str:
    """The largest errors of many cases in the ``part`` [s] of a criterion, and how many are above its target."""
    sizes = [largest_error(entry, *part) for entry in entries]
    values = [value for value in sizes if value is not None]
    target = rules.criteria[name].target
    words = []
    if values:
        above = sum(value > target for value in values)
        words.append(
            f"largest errors from {number(min(values), 1e3)} to {number(max(values), 1e3)} mm, {above} of "
            f"{len(values)} above the target of {number(target, 1e3)} mm"
        )
    if len(values) < len(sizes):
        words.append(f"{len(sizes) - len(values)} ended before {cause}")
    return "; ".join(words)


# The arm.


def motion(
    entries: Sequence[Recording], rules: Rules, links: tuple[float, float], commands: Sequence[str]
) -> tuple[Part, ...]:
    """The arm in the motion of each recording; the one of the same number is chosen in :func:`cases`."""
    circles: tuple[tuple[Colour, float], ...] = (
        ("limit", rules.criteria["B5"].target), ("three", rules.settling_error)
    )  # fmt: skip
    moved = tuple(_moved(entry, rules) for entry in entries)
    options = tuple(("", _again(command)) for command in commands)
    return MovingArm("motion-of-case", "case", links, circles, moved), Choice("case", "", options, _first(entries))


def _again(command: str) -> tuple[Part, ...]:
    """The command that repeats a case, if there is one."""
    return (Commands("repeat this case", (("", command),)),) if command else ()


def _first(entries: Sequence[Recording]) -> int:
    """The case that is shown first: the worst of B5."""
    return next((place for place, entry in enumerate(entries) if "B5" in entry.about.roles), 0)


def _moved(entry: Recording, rules: Rules) -> Moved:
    about = entry.about
    names = {"": "Start", "B7": "Chirp", "B5": "Force", "B6": "Settling", "end": "Last 3 s"}
    places = tuple((names[name], part.x[0]) for name, part in windows(entry, rules).items() if part.x)
    name = f"{_roles(entry, rules)} ({about.id})"
    torque = entry.torque if entry.highest is None else np.column_stack([entry.torque, entry.highest])
    return Moved(name, about.q_a, entry.motion, torque, about.time, about.force, about.window, places,
                 tuple((push.force, push.window) for push in about.pushes[1:]))  # fmt: skip
