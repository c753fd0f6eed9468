"""Plots and maps as figures of Matplotlib, for a paper, a notebook or a file."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from ..text import printable
from .plot import Axis, Bars, Colour, Heat, Layer, Level, Line, Numbers, Plot, Scatter, Series, Symbol
from .units import DEGREE, number

STYLE: Any = {
    "font.size": 8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.alpha": 0.3,
    # Some publishers refuse the fonts of type 3 that Matplotlib embeds otherwise.
    "pdf.fonttype": 42,
    # Text stays text, to be searched and edited; for what must look the same everywhere there is the PDF.
    "svg.fonttype": "none",
    "hatch.linewidth": 0.5,
    # Else the ids in a file are drawn at random, and equal figures have other bytes.
    "svg.hashsalt": "flexible-manipulator",
}

SIZE = (3.4, 2.4)
"""One column of a paper [inch]."""

PALETTE: Mapping[Colour, str] = {
    "one": "#0072b2", "two": "#d55e00", "three": "#009e73", "four": "#cc79a7", "five": "#e69f00", "six": "#56b4e9",
    "ink": "k", "soft": "0.45", "muted": "0.72", "accent": "#0072b2", "good": "#009e73", "bad": "#d55e00", "limit": "k",
    "b1": "#e69f00", "b2": "#56b4e9", "b3": "#009e73", "b4": "#f0e442", "b5": "#0072b2", "b6": "#d55e00",
    "b7": "#cc79a7",
}  # fmt: skip
"""After Okabe and Ito, distinguishable by colour-blind readers."""

MARKERS: Mapping[Symbol, str] = {
    "": "", "circle": "o", "square": "s", "triangle": "^", "diamond": "D", "ring": "o", "frame": "s", "left": "<",
    "right": ">", "cross": "x", "plus": "+",
}  # fmt: skip

HOLLOW: frozenset[Symbol] = frozenset({"ring", "frame"})

DASHES: Mapping[str, Any] = {"solid": "solid", "dashed": "--", "dotted": (0, (1, 1)), "dashdot": "-."}

POINTS = 0.57
"""Points on paper for a pixel of a page."""

DECADES = 100.0
"""Ratio of the ends of a logarithmic axis below which powers of ten are too few to label it."""

MOST_NUMBERS = 120
"""Cells of a map that have room for a number each."""

LETTER, HANDLE = 0.56, 4.0
"""Widths in a legend, in sizes of its font: of a letter, and of the symbol before a name with the gaps beside it."""

LABELLED = 0.18
"""Part of an axis beyond the longest bar, where its label stands."""

SPAN = 0.8
"""Part of the room of a name that its bars share."""


class Picture(Figure):
    """A figure of Matplotlib; a notebook shows it as a picture, without the state that Matplotlib's windows need."""

    def _repr_png_(self) -> bytes:
        return png(self)


FORMATS: Mapping[str, Mapping[str, Any]] = {
    "pdf": {"metadata": {"CreationDate": None}},
    "svg": {"metadata": {"Date": None}},
    "png": {"dpi": 200},
}
"""File endings, and what keeps a file free of the time it was written at."""


def encoded(figure: Figure, ending: str) -> bytes:
    """The figure as a file of one of the :data:`FORMATS`."""
    stream = io.BytesIO()
    with rc_context(STYLE):
        figure.savefig(stream, format=ending, **FORMATS[ending])
    return stream.getvalue()


def png(figure: Figure) -> bytes:
    """The figure as a PNG file for a screen."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=100)
    return stream.getvalue()


def figure(
    plots: Sequence[Sequence[Plot | Heat]] | Plot | Heat,
    size: tuple[float, float] = SIZE,
    into: Figure | None = None,
    *,
    titles: bool = False,
    common: bool = False,
    font: float = 8.0,
) -> Figure:
    """Plots in rows, drawn into a figure of this ``size`` [inch] or ``into`` another; those above each other have one x
    axis if they are zoomed together. ``titles`` stand above the plots, and one legend above all if it is ``common``;
    ``font`` is the size of all letters [pt], as publishers ask for it at the final size."""
    rows = [[plots]] if isinstance(plots, Plot | Heat) else plots
    with rc_context({**STYLE, "font.size": font}):
        made = into or Picture(figsize=size, layout="constrained")
        together = len(rows) > 1 and all(isinstance(one, Plot) and one.group for row in rows for one in row)
        grid = made.subplots(len(rows), len(rows[0]), squeeze=False, sharex="col" if together else False)
        for axes, one in zip(grid.flat, (one for row in rows for one in row), strict=True):
            draw(axes, one)
            if titles:
                # A title may be the name of a file, in which a dollar begins no formula.
                axes.set_title(printable(one.title), fontsize=font, parse_math=False)
            if not common and not titles:
                _legend_above(axes, one, size[0] / len(rows[0]), font)
            elif not common:
                # To look for the best place among all samples of a simulation takes longer than to draw them.
                axes.legend(loc="upper right") if axes.get_legend_handles_labels()[0] else None
        if together:
            for axes in grid[:-1].flat:
                axes.set_xlabel("")
        if common:
            handles, names = _legend(grid[0, 0], rows[0][0])
            columns = legend_columns(names, size[0], font)
            made.legend(handles, names, loc="outside upper center", ncols=columns, frameon=False)
    return made


def draw(axes: Axes, one: Plot | Heat) -> None:
    """Draw a plot, or the first layer of a map."""
    if isinstance(one, Heat):
        _draw_heat(axes, one, one.layers[0])
        return
    for band in one.bands:
        low, high = one.x.shown(band.low), one.x.shown(band.high)
        axes.axvspan(low, high, color=PALETTE["ink"], alpha=0.05 if band.shaded else 0.0, linewidth=0)
    named: set[str] = set()
    bars = [series for series in one.series if isinstance(series, Bars)]
    for series in one.series:
        label = "_" if series.name in named or not series.name else symbols(series.name)  # Matplotlib leaves out "_"
        _draw_series(axes, one, series, label, bars)
        named.add(series.name)
    for level in one.levels:
        label = symbols(level.name) if level.name and level.name not in named else "_"
        _draw_level(axes, one, level, label)
        named.add(level.name)
    _scale(axes, one)


def _draw_series(axes: Axes, plot: Plot, series: Series, label: str, bars: Sequence[Bars]) -> None:
    match series:
        case Line():
            part = slice(*(series.rows or (None,)))
            axes.plot(
                _shown(series.x[part], plot.x),
                _shown(series.y[part], plot.y),
                color=PALETTE[series.colour],
                linestyle=DASHES[series.dash],
                linewidth=POINTS * series.width,
                drawstyle="steps-post" if series.step else "default",
                **_marker(series.symbol, max(3.0, 0.9 * series.width), "w"),
                label=label,
                zorder=4 if series.above else 2 if series.faint else 3,
                solid_capstyle="butt" if series.labels else "round",  # a bar must not reach beyond its value
            )
            _draw_labels(axes, plot, series)
        case Scatter():
            look = {"color": PALETTE[series.colour], "linestyle": "none", **_marker(series.symbol, series.size / 2)}
            if series.hollow:
                look["markerfacecolor"] = "none"
            x, y = _shown(series.x, plot.x), _shown(series.y, plot.y)
            if series.deviation:
                sizes = _shown(series.deviation, plot.y)
                axes.errorbar(x, y, sizes, capsize=1.5, elinewidth=0.8, label=label, zorder=4, **look)
            else:
                axes.plot(x, y, alpha=0.5 if series.faint else 1.0, label=label, zorder=4, **look)
        case Bars():
            _draw_bars(axes, plot, series, label, bars)


def _shown(values: Numbers, axis: Axis) -> np.ndarray:
    if isinstance(values, np.ndarray):
        return axis.unit.factor * values
    return axis.unit.factor * np.array([math.nan if value is None else value for value in values], dtype=float)


def _marker(symbol: Symbol, size: float, inside: str = "none") -> dict[str, Any]:
    look = {"marker": MARKERS[symbol] or "none", "markersize": size}
    return {**look, "markerfacecolor": inside} if symbol in HOLLOW else look


def _draw_labels(axes: Axes, plot: Plot, line: Line) -> None:
    x, y = _shown(line.x, plot.x), _shown(line.y, plot.y)
    sides = [-1, *[-1 if line.inside else 1] * (len(line.labels) - 1)]
    for right, up, words, side in zip(x, y, line.labels, sides, strict=False):
        align: Any = {"ha": "left" if side > 0 else "right", "va": "center"}
        axes.annotate(symbols(words), (right, up), (5 * side, 0), textcoords="offset points", **align)


def _draw_bars(axes: Axes, plot: Plot, series: Bars, label: str, bars: Sequence[Bars]) -> None:
    """Bars beside those of other names, or on those of one stack."""
    axis = plot.x if plot.flat else plot.y
    # As NaN, a bar without a value would take those that stand on it along.
    values = np.nan_to_num(_shown(series.values, axis))
    stacks = list(dict.fromkeys(one.stack or one.name for one in bars))
    thick = SPAN / len(stacks)
    place = np.arange(len(values)) + thick * (stacks.index(series.stack or series.name) - (len(stacks) - 1) / 2)
    before = [one for one in bars[: list(bars).index(series)] if series.stack and one.stack == series.stack]
    base = sum((np.nan_to_num(_shown(one.values, axis)) for one in before), np.zeros(len(values)))
    colours = [PALETTE[one] for one in series.colours] or PALETTE[series.colour]
    look: Any = {"color": colours, "label": label, "zorder": 2, "alpha": 0.5 if series.colour == "soft" else 1.0}
    look |= {"edgecolor": "w", "linewidth": 0.5} if series.stack else {}  # neighbours in a stack are told apart in grey
    look |= {"hatch": "/////"} if series.hatched else {}
    if plot.flat:
        drawn = axes.barh(place, values, thick, left=base, **look)
    else:
        drawn = axes.bar(place, values, thick, bottom=base, **look)
    if series.labels:
        axes.set_xmargin(LABELLED) if plot.flat else axes.set_ymargin(LABELLED)
        axes.bar_label(drawn, [symbols(words) for words in series.labels], padding=2)


def _draw_level(axes: Axes, plot: Plot, level: Level, label: str) -> None:
    look: Any = {"color": PALETTE[level.colour], "linestyle": DASHES[level.dash], "linewidth": 0.7, "zorder": 5}
    if level.start is not None and level.stop is not None:
        ends, height = [plot.x.shown(level.start), plot.x.shown(level.stop)], plot.y.shown(level.value)
        axes.plot(ends, [height, height], label=label, **look)
    elif level.upright:
        axes.axvline(plot.x.shown(level.value), label=label, **look)
    else:
        axes.axhline(plot.y.shown(level.value), label=label, **look)


def _scale(axes: Axes, plot: Plot) -> None:
    """Labels, limits and ticks of both axes, and the part that is shown."""
    window = plot.window
    x_ends = (plot.x.low, plot.x.high) if window is None or window.x is None else window.x
    y_ends = window.y if window is not None and any(end is not None for end in window.y) else (plot.y.low, plot.y.high)
    for name, scale, axis, ends in (("x", axes.xaxis, plot.x, x_ends), ("y", axes.yaxis, plot.y, y_ends)):
        scale.set_label_text(symbols(axis.heading))
        if axis.logarithmic:
            axes.set(**{f"{name}scale": "log"})
        low, high = (None if end is None else axis.shown(end) for end in ends)
        if axis.names:
            scale.set_ticks(range(len(axis.names)), [symbols(words) for words in axis.names])
            low, high = -0.5, len(axis.names) - 0.5
        axes.set(**{f"{name}lim": (high, low) if axis.inverse else (low, high)})
        if axis.unit == DEGREE:
            # Steps of 15, 30, 45 or 90 degrees where they fit: 20 or 25 would miss -90.
            scale.set_major_locator(MaxNLocator(steps=[1, 1.5, 3, 4.5, 9, 10]))
        if axis.logarithmic and max(scale.get_view_interval()) < DECADES * min(scale.get_view_interval()):
            scale.set(major_locator=LogLocator(subs=(1, 2, 5)), minor_locator=NullLocator())
            scale.set_major_formatter("{x:g}")
    if plot.square:
        axes.set_aspect("equal")
        axes.locator_params(nbins=6)  # more would run into each other


def _draw_heat(axes: Axes, heat: Heat, layer: Layer) -> None:
    shape = len(heat.y.names), len(heat.x.names)
    values = np.array([math.nan if value is None else value for value in layer.values], dtype=float).reshape(shape)
    low, high = heat.limits or (np.nanmin(values, initial=math.inf), np.nanmax(values, initial=-math.inf))
    if heat.around_zero:
        low, high = -max(abs(low), abs(high)), max(abs(low), abs(high))
    # Where no cell has a value, the ends are infinite, the lower one above the upper.
    ends: Any = {} if low > high else {"vmin": low, "vmax": high}
    image = axes.imshow(values, aspect="auto", cmap="PuOr_r" if heat.around_zero else "viridis_r", **ends)
    axes.grid(False)
    axes.set_xticks(range(shape[1]), [symbols(name) for name in heat.x.names])
    axes.set_yticks(range(shape[0]), [symbols(name) for name in heat.y.names])
    axes.set(xlabel=symbols(heat.x.heading), ylabel=symbols(heat.y.heading))
    middle = 0.6 * low + 0.4 * high
    for cell, (value, place) in enumerate(zip(layer.values, np.ndindex(*shape), strict=True)):
        if heat.cells[cell] is None:
            continue
        words = number(value) if values.size <= MOST_NUMBERS else ""
        if cell in layer.marked:
            words += "\n×" if words else "×"
        dark = value is not None and value > middle and not heat.around_zero
        axes.text(place[1], place[0], words, ha="center", va="center", fontsize=6, color="w" if dark else "k")
    bar = axes.figure.colorbar(image, ax=axes)
    bar.set_label(symbols(layer.name))


SYMBOL = re.compile(r"\b(u|q̇|q|F|S|T|τ|Δ)_([a-z]+\d?|\d)\b(?![\[.(_])")
"""Symbols of the paper, as they are written in plain text."""


def symbols(words: str) -> str:
    """Words as Matplotlib shows them, with the symbols of the paper. Of others it leaves out what begins with an
    underscore, and takes ``$`` for the beginning of a formula."""
    lines = (printable(line) for line in words.split("\n"))
    plain = (" " if words.startswith("_") else "") + "\n".join(lines).replace("$", r"\$")
    return SYMBOL.sub(lambda symbol: "$" + symbol[1].replace("q̇", r"\dot{q}") + "_{" + symbol[2] + "}$", plain)


def _legend_above(axes: Axes, one: Plot | Heat, width: float, font: float) -> None:
    """A legend that covers nothing of what is drawn, wherever that is; of one entry there is none."""
    handles, names = _legend(axes, one)
    if len(names) > 1:
        look: Any = {"ncols": legend_columns(names, width, font), "frameon": False, "columnspacing": 1.0}
        axes.legend(handles, names, loc="lower center", bbox_to_anchor=(0.5, 1.0), **look)


def _legend(axes: Axes, one: Plot | Heat) -> tuple[list[Any], list[str]]:
    """Handles and names in the order of the plot's series and levels. Matplotlib has lines before bars."""
    handles, names = axes.get_legend_handles_labels()
    if isinstance(one, Heat):
        return handles, names
    order = [symbols(named.name) for named in (*one.series, *one.levels)]
    places = sorted(range(len(names)), key=lambda place: order.index(names[place]))
    return [handles[place] for place in places], [names[place] for place in places]


def legend_columns(names: Sequence[str], width: float, font: float = 8.0) -> int:
    """How many ``names`` of a legend stand beside each other in a ``width`` [inch]; if they were too many, the layout
    would make room for them beside the axes."""
    longest = max(len(re.sub(r"[${}\\]", "", name)) for name in names)
    room = 72.0 * width / font / (LETTER * longest + HANDLE)
    return max(1, min(len(names), int(room)))
