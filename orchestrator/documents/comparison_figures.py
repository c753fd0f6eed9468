"""Figures over several controllers, for a paper: PDF and SVG (and PNG) in the widths of a journal's columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from ..search.findings import Margin
from ..views import drawing
from ..views.plot import Axis, Level, Line, Plot, Scatter, Window, dash, hue
from ..views.units import MILLISECOND, NONE, number
from . import case_plots, compare_page
from .case_plots import Curve
from .comparability import same_controller
from .document import Comparable
from .evaluation import Evaluation
from .figures import window, write_drawn
from .recording import EXAMPLE, Recording, part_of
from .robustness import Robustness
from .spread import Spread

MM = 1 / 25.4
ONE_COLUMN, TWO_COLUMNS = 88 * MM, 180 * MM
"""Widths of a figure [inch]."""

LONGEST = 34
"""Characters of a name in a legend."""

Looks = Mapping[str, int]
"""The number of each controller, by which it looks the same in all figures."""


def write_comparison(
    named: Mapping[str, Sequence[tuple[str, Comparable]]], folder: Path
) -> tuple[list[str], list[str]]:
    """Write all figures of the documents, with their names by kind, that there are data for into ``folder``, which is
    created.

    Returns the names of the figures written, without endings, and of the others.
    """
    listed = [(_short(name), document) for entries in named.values() for name, document in entries]
    looks = {name: place for place, name in enumerate(dict.fromkeys(name for name, _ in listed))}
    runs = {name: document for name, document in listed if isinstance(document, Evaluation)}
    spreads = {name: document for name, document in listed if isinstance(document, Spread)}
    searches = {name: document for name, document in listed if isinstance(document, Robustness)}
    drawings: Mapping[str, Callable[[], Figure | None]] = {
        "comparison_time": partial(over_time, runs, looks),
        "comparison_radius": partial(radii, searches, [*runs.values(), *spreads.values()], looks),
        "comparison_seeds": partial(seeds, spreads, looks),
        "comparison_margins": partial(margins, searches, looks),
    }
    return write_drawn(drawings, folder)


def _short(name: str) -> str:
    return name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}…"


def over_time(runs: Mapping[str, Evaluation], looks: Looks) -> Figure | None:
    """Figures 10 and 9 side by side: TCP error [mm] and torques [Nm] over time [s], due to the chirp and the force."""
    shown = {name: next(iter(run.recorded(EXAMPLE)), None) for name, run in runs.items()}
    entries = {name: entry for name, entry in shown.items() if entry is not None}
    if not entries:
        return None
    columns = [_column(criterion, entries, runs, looks) for criterion in ("B7", "B5")]
    rows = list(zip(*columns, strict=True))
    return drawing.figure(rows, (TWO_COLUMNS, 105 * MM), titles=True, common=True)


def _column(
    criterion: str, entries: Mapping[str, Recording], runs: Mapping[str, Evaluation], looks: Looks
) -> tuple[Plot, ...]:
    """Error and torques in the part of a case that a criterion is measured in."""
    rules = next(iter(runs.values())).results.rules
    part = window(next(iter(entries.values())), criterion)
    curves = [
        Curve(name, part_of(entry, *part), hue(looks[name]), dash=dash(looks[name])) for name, entry in entries.items()
    ]
    shown = Window("", part)
    error = case_plots.errors(criterion, "", curves, rules, shown, text=criterion, of=curves[0].recording, group="time")
    levels = tuple(replace(level, name="") for level in error.levels if level.name.startswith(criterion))
    target = number(rules.criteria[criterion].target, 1e3)
    title = f"{'Force' if criterion == 'B5' else 'Chirp'} (target {criterion}: {target} mm)"
    torques = (
        replace(plot, y=Axis(f"Torque u_m{axis}", plot.y.unit), levels=())
        for axis, limit in enumerate(rules.torque_limit, start=1)
        for plot in (case_plots.torques("torque", "", curves, axis, limit, shown, text=criterion, group="time"),)
    )
    return replace(error, title=title, y=replace(error.y, title="TCP error"), levels=levels), *torques


def radii(searches: Mapping[str, Robustness], cards: Sequence[Evaluation | Spread], looks: Looks) -> Figure | None:
    """V over the factor on the tolerances of Table 1 at which A1 to A3 fail: right and low is better. A line leads from
    V of the scorecard to V that the search found."""
    series = [one for name, search in searches.items() for one in _radius(name, search, cards, looks[name])]
    if not series:
        return None
    target = next(iter(searches.values())).rules.cost.target
    x = Axis("Tolerances at which A1-A3 fail / Table 1 (▸: none found, ◂: or below)")
    y = Axis("V (open: scorecard, filled: found)")
    levels = Level(target, ""), Level(1.0, "", upright=True)
    return drawing.figure(Plot("radius", "", x, y, tuple(series), levels), (ONE_COLUMN, 70 * MM))


def _radius(name: str, search: Robustness, cards: Sequence[Evaluation | Spread], look: int) -> list[Line | Scatter]:
    radius = search.radius
    if radius is None:
        return []
    card = next((other.V for other in cards if same_controller(other.head, search.head)), None)
    at = radius.limit if radius.stability is None else radius.stability
    symbol = compare_page.shape(look) if radius.stability_refined else "left"
    if radius.stability is None:
        symbol = "right"
    values = [value for value in (card, search.cost) if value is not None]
    points: list[Line | Scatter] = [Line("", [at] * len(values), values, hue(look))]
    if card is not None:
        points.append(Scatter(name if search.cost is None else "", [at], [card], hue(look), symbol, 10.0, hollow=True))
    if search.cost is not None:
        points.append(Scatter(name, [at], [search.cost], hue(look), symbol, 10.0))
    return points


def seeds(spreads: Mapping[str, Spread], looks: Looks) -> Figure | None:
    """V and the criteria relative to their targets: mean and standard deviation over the seeds."""
    if not spreads:
        return None
    return drawing.figure(compare_page.seeds(spreads, looks), (ONE_COLUMN, 65 * MM))


def margins(searches: Mapping[str, Robustness], looks: Looks) -> Figure | None:
    """The smallest gain factors and delays [ms] found to fail, of both axes, beside what A1 and A2 ask for."""
    entries = {name: search for name, search in searches.items() if search.margins}
    if not entries:
        return None
    tests = next(iter(entries.values())).rules.tests
    gain, delay = max(test.gain for test in tests), max(test.delay for test in tests)
    none = " (▸: none found up to there, ◂: there or below)"
    plots = [
        _margins("gain", Axis(f"Factor of the loop gain{none}", NONE, logarithmic=True), gain, entries, looks),
        _margins("delay", Axis(f"Additional delay{none}", MILLISECOND), delay, entries, looks),
    ]
    return drawing.figure([plots], (TWO_COLUMNS, 60 * MM), common=True)


def _margins(kind: str, x: Axis, asked: float, entries: Mapping[str, Robustness], looks: Looks) -> Plot:
    series = []
    for place, (name, search) in enumerate(entries.items()):
        for axis in (1, 2):
            margin = search.margins.get(f"{kind}_{axis}", None)
            series.append(_margin(name, margin, axis - 1 + compare_page.offset(place, len(entries)), looks[name]))
    names = Axis(names=("axis 1", "axis 2"), inverse=True)
    level = Level(asked, "asked for", upright=True)
    return Plot(kind, "", x, names, tuple(series), (level,))


def _margin(name: str, margin: Margin | None, place: float, look: int) -> Scatter:
    """One margin; none is an entry of the legend alone."""
    symbol = compare_page.shape(look)
    if margin is None:
        return Scatter(name, [], [], hue(look), symbol)
    if margin.value is None:
        return Scatter(name, [margin.limit], [place], hue(look), "right")
    return Scatter(name, [margin.value], [place], hue(look), symbol if margin.refined else "left")
