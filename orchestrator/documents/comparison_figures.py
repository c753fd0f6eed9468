"""Figures over several controllers for a paper: PDF, SVG and PNG in the widths of its columns, and their captions."""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

from matplotlib.figure import Figure

from ..search.findings import Margin
from ..views import drawing
from ..views.export import latex_text
from ..views.plot import Axis, Bars, Level, Line, Plot, Scatter, Window, hue, shape
from ..views.units import MILLIMETRE, MILLISECOND, NONE, SECOND, TORQUE, number
from . import case_plots, compare_page
from .comparability import Entry, same_controller
from .compare_page import D, Entries, Shown
from .evaluation import Evaluation
from .figures import window, write_drawn
from .files import write_text
from .head import Head
from .recording import EXAMPLE, Recording, part_of
from .robustness import Robustness
from .spread import Spread
from .wording import seed_words

CAPTIONS = "figures.tex"
"""The figures as LaTeX, with captions."""

LONGEST, BESIDE = 34, 17
"""Characters of a name in a legend, and of a line of it beside an axis."""

ERROR, TORQUES = 1.35, 1.05
"""Heights of a row [inch]: of errors, and of a torque."""

EDGES, BAR, LINE = 0.6, 0.17, 0.16
"""Heights [inch]: of what stands above and below plots, of a bar, and of a line of a legend."""

END = 3.0
"""Time [s] at the end of a case that is judged by it."""

THIN = 1.0
"""Width of a curve [pixel]: many lie over each other."""

Columns = Literal[1, 2]

Recorded = Sequence[tuple[Entry, Recording]]
"""A case of several runs."""


@dataclass(frozen=True)
class Paper:
    """What figures are drawn for: the ``widths`` [inch] of one column of text and of two, by default the IEEE's, and
    how many ``columns`` all figures are to span, if not what suits each."""

    widths: tuple[float, float] = (3.5, 7.16)
    columns: Columns | None = None


@dataclass(frozen=True)
class Sheet:
    """A figure: the ``name`` of its files, its plots, the ``columns`` of text that it spans, its ``height`` without the
    legend [inch] and its ``caption``."""

    name: str
    rows: Sequence[Sequence[Plot]]
    columns: Columns
    height: float
    caption: str
    titles: bool = False
    common: bool = False


def write_comparison(
    entries: Entries, folder: Path, paper: Paper | None = None, cases: Mapping[str, Recorded] | None = None
) -> tuple[list[str], list[str]]:
    """Write all figures that there are data for, and those of the ``cases`` by their names, into ``folder``, which is
    created, with their captions as LaTeX.

    Returns the names of the files written, those of figures without endings, and of what there are no data for.
    """
    chosen = paper or Paper()
    listed = sheets(entries, chosen.columns, cases or {})
    made = [sheet for found in listed.values() for sheet in found]
    drawings: Mapping[str, Callable[[], Figure | None]] = {
        sheet.name: partial(drawn, sheet, chosen.widths) for sheet in made
    }
    written, _ = write_drawn(drawings, folder)
    write_text(folder / CAPTIONS, captions(made))
    return [*written, CAPTIONS], [name for name, found in listed.items() if not found]


def drawn(sheet: Sheet, widths: tuple[float, float]) -> Figure:
    """The figure."""
    width = widths[sheet.columns - 1]
    first = sheet.rows[0][0]
    names = list(dict.fromkeys(one.name for one in (*first.series, *first.levels) if one.name))
    lines = math.ceil(len(names) / drawing.legend_columns(names, width)) if names else 0
    size = width, sheet.height + LINE * lines
    return drawing.figure(sheet.rows, size, titles=sheet.titles, common=sheet.common)


def sheets(entries: Entries, columns: Columns | None, cases: Mapping[str, Recorded]) -> dict[str, list[Sheet]]:
    """The figures by what they show; those that there are no data for are empty."""
    runs, spreads = labelled(entries, Evaluation), labelled(entries, Spread)
    searches = labelled(entries, Robustness)
    examples = [
        (entry, recording)
        for entry in entries.get(Evaluation.KIND, ())
        if isinstance(entry.document, Evaluation)
        for recording in entry.document.recorded(EXAMPLE)[:1]
    ]
    return {
        "V_by_criteria": parts_of_cost(runs, searches, columns or 1),
        "time_example": over_time("time_example", examples, columns or 2),
        "V_and_tolerances": radii(searches, [*runs, *spreads], columns or 1),
        "V_and_criteria_over_seeds": seeds(spreads, columns or 1),
        "margins_of_gain_and_delay": margins(searches, columns or 2),
        # LaTeX takes what follows the first dot of a name for its ending.
        **{
            (name := f"time_{id.replace('.', '-')}"): over_time(name, recorded, columns or 2)
            for id, recorded in cases.items()
        },
    }


def labelled(entries: Entries, kind: type[D]) -> list[Shown[D]]:
    """Those of a kind with names that fit into a legend: the controller's, if there is no other of it."""
    listed = [(entry, entry.document) for entry in entries.get(kind.KIND, ())]
    names = _names([entry for entry, _ in listed])
    return [
        Shown(name, document, entry.place)
        for name, (entry, document) in zip(names, listed, strict=True)
        if isinstance(document, kind)
    ]


def _names(entries: Sequence[Entry]) -> list[str]:
    counts = Counter(entry.controller for entry in entries)
    names = [entry.controller if counts[entry.controller] == 1 else entry.name for entry in entries]
    short = [name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}…" for name in names]
    cut = Counter(short)
    return [name if cut[name] == 1 else f"{place}. {name}" for place, name in enumerate(short, start=1)]


# The figures.


def parts_of_cost(
    runs: Sequence[Shown[Evaluation]], searches: Sequence[Shown[Robustness]], columns: Columns
) -> list[Sheet]:
    """V by criteria, one bar for each controller, and V found beside it."""
    if not runs:
        return []
    narrow = [replace(run, label="\n".join(textwrap.wrap(run.label, BESIDE)) or run.label) for run in runs]
    plot = compare_page.stack(narrow, [search.document for search in searches])
    stacks = {bars.stack for bars in plot.series if isinstance(bars, Bars)}
    head, target = runs[0].document.head, runs[0].document.head.rules.cost.target
    caption = f"V of eq. (15), made up of the shares of {_span(list(head.rules.criteria))} ({_conditions(head)}). "
    caption += f"Dashed: V of a controller that meets all targets, {target:g}."
    if len(stacks) > 1:
        caption += " Hatched: V that a search for worst cases found, which the true worst case may exceed."
    lines = max(run.label.count("\n") + 1 for run in narrow)
    height = EDGES + len(runs) * BAR * max(1.5 * len(stacks), lines)
    return [Sheet("V_by_criteria", [[plot]], columns, height, caption)]


class Stretch(NamedTuple):
    """A part of a case that is shown: in words, the time [s], and the beginning of the names of its levels."""

    name: str
    words: str
    time: tuple[float, float]
    levels: str


def over_time(name: str, recorded: Recorded, columns: Columns) -> list[Sheet]:
    """TCP error and torques over time in a case of several runs, as in Figures 9 to 12; in one column, a figure for
    each part of the case."""
    stretches = _stretches(recorded) if recorded else []
    parts = [(stretch, plots) for stretch in stretches if (plots := _column(recorded, stretch))]
    if not parts:
        return []
    height = EDGES + ERROR + 2 * TORQUES
    if columns == 2:
        rows = list(zip(*(plots for _, plots in parts), strict=True))
        told = _time_caption(recorded, [stretch for stretch, _ in parts])
        return [Sheet(name, rows, columns, height, told, titles=True, common=True)]
    return [
        Sheet(
            f"{name}_{stretch.name}",
            [[plot] for plot in plots],
            columns,
            height,
            _time_caption(recorded, [stretch]),
            titles=True,
            common=True,
        )
        for stretch, plots in parts
    ]


def _stretches(recorded: Recorded) -> list[Stretch]:
    """What a case is to be seen in: chirp and force, or what follows the force in a test that is judged at its end."""
    entry, rules = recorded[0][1], recorded[0][0].document.head.rules
    about = entry.about
    if not case_plots.pulsed(entry):
        return [Stretch("whole", "whole case", (0.0, about.duration), "none")]
    force = Stretch("force", f"force of {math.hypot(*about.force):g} N", window(entry, "B5"), "B5")
    if any("B7" in test.criteria for test in rules.tests if test.name == about.test):
        return [Stretch("chirp", "chirp", window(entry, "B7"), "B7"), force]
    end = (about.duration - END, about.duration)
    return [force, Stretch("end", f"last {END:g} s", end, "none")]


def _column(recorded: Recorded, stretch: Stretch) -> tuple[Plot, ...]:
    """Error and both torques of one part of a case, below each other; none if all ended before it."""
    rules = recorded[0][0].document.head.rules
    names = _names([entry for entry, _ in recorded])
    curves = [
        compare_page.curve(Shown(name, entry.document, entry.place), part_of(recording, *stretch.time))._replace(
            width=THIN
        )
        for name, (entry, recording) in zip(names, recorded, strict=True)
    ]
    if not any(len(curve.recording.motion) for curve in curves):
        return ()
    shown = Window("", stretch.time)
    whole = recorded[0][1]
    of = whole if case_plots.pulsed(whole) else None
    error = case_plots.errors(stretch.name, "", curves, rules, shown, text=stretch.words, of=of, group="time")
    levels = tuple(replace(level, name="") for level in error.levels if level.name.startswith(stretch.levels))
    torques = (
        replace(plot, title="", y=Axis(f"Torque u_m{axis}", plot.y.unit), levels=())
        for axis, limit in enumerate(rules.torque_limit, start=1)
        for plot in (case_plots.torques("torque", "", curves, axis, limit, shown, text="torque", group="time"),)
    )
    title = stretch.words[:1].upper() + stretch.words[1:]
    return replace(error, title=title, y=replace(error.y, title="TCP error"), levels=levels), *torques


def _time_caption(recorded: Recorded, stretches: Sequence[Stretch]) -> str:
    entry, recording = recorded[0]
    about, rules = recording.about, entry.document.head.rules
    system = "nominal system" if about.system == "nominal" else f"system {about.system}"
    words = f"TCP error [{MILLIMETRE.shown}] and motor torques [{TORQUE.shown}] over time [{SECOND.shown}]: "
    words += " and ".join(f"{stretch.words}{side}" for stretch, side in zip(stretches, _sides(stretches), strict=True))
    case = f"Case {about.id}" if about.configuration >= 0 else "Example"
    words += f". {case}: {system}, link angles {case_plots.pose_words(about.q_a)}"
    words += f" ({_conditions(entry.document.head)})."
    dashed = [
        f"{stretch.levels} ({number(rules.criteria[stretch.levels].target, MILLIMETRE.factor)} {MILLIMETRE.shown})"
        for stretch in stretches
        if stretch.levels in rules.criteria
    ]
    return words + (f" Dashed: the target of {' and of '.join(dashed)}." if dashed else "")


def _sides(stretches: Sequence[Stretch]) -> Sequence[str]:
    return (" (left)", " (right)") if len(stretches) == 2 else [""] * len(stretches)


def radii(
    searches: Sequence[Shown[Robustness]], cards: Sequence[Shown[Evaluation] | Shown[Spread]], columns: Columns
) -> list[Sheet]:
    """V over the factor on the tolerances of Table 1 at which A1 to A3 fail: right and low is better. A line leads from
    V of the scorecard to V that the search found."""
    series = [one for search in searches for one in _radius(search, cards)]
    if not series:
        return []
    target = searches[0].document.rules.cost.target
    plot = Plot(
        "radius",
        "",
        Axis("Tolerances at which A1-A3 fail / Table 1"),
        Axis("V"),
        tuple(series),
        (Level(target, ""), Level(1.0, "", upright=True)),
    )
    caption = "V of the scorecard (open) and V that a search for worst cases found (filled), over the factor on the "
    caption += "tolerances of Table 1 at which A1 to A3 fail. A symbol that points to the right: no failure was found "
    caption += f"up to there; to the left: there or below. Dashed: V of {target:g} and the tolerances of Table 1."
    return [Sheet("V_and_tolerances", [[plot]], columns, 2.4, caption)]


def _radius(shown: Shown[Robustness], cards: Sequence[Shown[Evaluation] | Shown[Spread]]) -> Iterator[Line | Scatter]:
    search, radius, look = shown.document, shown.document.radius, hue(shown.place)
    if radius is None:
        return
    card = next((other.document.V for other in cards if same_controller(other.document.head, search.head)), None)
    at = radius.limit if radius.stability is None else radius.stability
    symbol = shape(shown.place) if radius.stability_refined else "left"
    if radius.stability is None:
        symbol = "right"
    values = [value for value in (card, search.cost) if value is not None]
    yield Line("", [at] * len(values), values, look)
    if card is not None:
        name = shown.label if search.cost is None else ""
        yield Scatter(name, [at], [card], look, symbol, 10.0, hollow=True)
    if search.cost is not None:
        yield Scatter(shown.label, [at], [search.cost], look, symbol, 10.0)


def seeds(spreads: Sequence[Shown[Spread]], columns: Columns) -> list[Sheet]:
    """V and the criteria relative to their targets: mean and standard deviation over the seeds."""
    if not spreads:
        return []
    document = spreads[0].document
    names = _span(list(document.rules.criteria))
    caption = f"V and {names} relative to their targets, mean and standard deviation over seeds "
    caption += f"({_conditions(document.head)}). Dashed: the targets."
    return [Sheet("V_and_criteria_over_seeds", [[compare_page.seeds(spreads)]], columns, 2.3, caption)]


def margins(searches: Sequence[Shown[Robustness]], columns: Columns) -> list[Sheet]:
    """The smallest gain factors and delays [ms] found to fail, of both axes, beside what A1 and A2 ask for."""
    shown = [search for search in searches if search.document.margins]
    if not shown:
        return []
    tests = shown[0].document.rules.tests
    gain, delay = max(test.gain for test in tests), max(test.delay for test in tests)
    plots = [
        _margins("gain", Axis("Factor of the loop gain", NONE, logarithmic=True), gain, shown),
        _margins("delay", Axis("Additional delay", MILLISECOND), delay, shown),
    ]
    caption = f"Smallest factors of the loop gain and additional delays [{MILLISECOND.shown}] of an axis that a search "
    caption += "found to fail. A symbol that points to the right: no failure was found up to there; to the left: there "
    caption += f"or below. Dashed: what A1 and A2 ask for, {number(gain)} and {number(delay, MILLISECOND.factor)} ms."
    rows = [plots] if columns == 2 else [[plot] for plot in plots]
    return [Sheet("margins_of_gain_and_delay", rows, columns, 2.1 * len(rows), caption, common=True)]


def _margins(kind: str, x: Axis, asked: float, shown: Sequence[Shown[Robustness]]) -> Plot:
    series = tuple(
        _margin(
            one,
            one.document.margins.get(f"{kind}_{axis}", None),
            axis - 1 + compare_page.offset(number, len(shown)),
        )
        for number, one in enumerate(shown)
        for axis in (1, 2)
    )
    names = Axis(names=("axis 1", "axis 2"), inverse=True)
    return Plot(kind, "", x, names, series, (Level(asked, "asked for", upright=True),))


def _margin(of: Shown[Robustness], margin: Margin | None, at: float) -> Scatter:
    """One margin; none is an entry of the legend alone."""
    look, symbol = hue(of.place), shape(of.place)
    if margin is None:
        return Scatter(of.label, [], [], look, symbol)
    if margin.value is None:
        return Scatter(of.label, [margin.limit], [at], look, "right")
    return Scatter(of.label, [margin.value], [at], look, symbol if margin.refined else "left")


# Captions.


def captions(made: Sequence[Sheet]) -> str:
    r"""The figures as LaTeX: ``figure*`` spans both columns of a document that has two, and is ``figure`` elsewhere."""
    return "\n".join([HEADER, *(FIGURE % _fields(sheet) for sheet in made)])


HEADER = r"""% In the preamble: \usepackage{graphicx}, and \graphicspath{{FOLDER/}} with the folder of the figures.
% A figure has its own size, at which its text has 8 pt; where it is wider than the text, it is scaled down to that.
\providecommand{\fittedgraphics}[1]{%
  \setbox0\hbox{\includegraphics{#1}}%
  \ifdim\wd0>\linewidth\includegraphics[width=\linewidth]{#1}\else\box0\fi}
"""

FIGURE = r"""\begin{figure%(star)s}
  \centering
  \fittedgraphics{%(name)s.pdf}
  \caption{%(caption)s}
  \label{fig:%(label)s}
\end{figure%(star)s}
"""


def _fields(sheet: Sheet) -> Mapping[str, str]:
    star = "*" if sheet.columns == 2 else ""
    label = sheet.name.replace("_", "-")
    return {"star": star, "name": sheet.name, "caption": latex_text(sheet.caption), "label": label}


def _span(names: Sequence[str]) -> str:
    return f"{names[0]} to {names[-1]}" if len(names) > 1 else "".join(names)


def _conditions(head: Head) -> str:
    return f"protocol {head.protocol}, {seed_words(head)}"
