"""Plots as what a page's script is given: options of ECharts, and numbers packed once each.

The script knows no document. What it must still do is what only a browser can: colours of the scheme in use, which an
option names as ``@one``; sizes that depend on the room; and columns, which an option names by their number.
"""

from __future__ import annotations

import base64
import math
from typing import Any, Literal

import numpy as np

from .plot import (
    HUES,
    Axis,
    Bars,
    Colour,
    Dash,
    Level,
    Line,
    Plot,
    Scatter,
    Series,
    Symbol,
    Window,
)

SYMBOLS: dict[Symbol, str] = {
    "": "none",
    "circle": "circle",
    "square": "rect",
    "triangle": "triangle",
    "diamond": "diamond",
    "ring": "emptyCircle",
    "frame": "emptyRect",
    "left": "path://M10,0 L0,5 L10,10 Z",
    "right": "path://M0,0 L10,5 L0,10 Z",
    "cross": "path://M0,1 L1,0 L5,4 L9,0 L10,1 L6,5 L10,9 L9,10 L5,6 L1,10 L0,9 L4,5 Z",
    "plus": "path://M4,0 L6,0 L6,4 L10,4 L10,6 L6,6 L6,10 L4,10 L4,6 L0,6 L0,4 L4,4 Z",
}

FILLS: tuple[dict[str, Any], ...] = (
    {"symbol": "none"},
    {"dashArrayX": [1, 0], "dashArrayY": [3, 4], "rotation": math.pi / 4},
    {"symbol": "circle", "dashArrayX": [[6, 6], [0, 6, 6, 0]], "dashArrayY": [6, 0]},
)
"""Patterns of bars whose colours repeat themselves; those that are hatched have the second."""

DASHES: dict[Dash, Any] = {"solid": "solid", "dashed": "dashed", "dotted": "dotted", "dashdot": [8, 3, 2, 3]}

HALO = {"textBorderColor": "@card", "textBorderWidth": 4}
"""A rim around text that stands on lines or bars."""

FILLED: dict[Colour, str] = {"good": "@good-fill", "bad": "@bad-fill"}
"""Colours of areas and points that differ from those of words."""


def _colour(colour: Colour) -> str:
    return FILLED.get(colour, f"@{colour}")


SHORTER = 1e-6
"""By so much a band ends earlier: one that ends where the part in sight begins would show its name without an area."""


class Pool:
    """Columns and texts of a page, each kept once, however many plots show it."""

    def __init__(self) -> None:
        # Time plots, paths and the moving arm show the same columns of a recording.
        self.columns: dict[str, int] = {}
        self.texts: dict[str, int] = {}

    def column(self, values: np.ndarray) -> int:
        """The number of a column: base64 of little-endian single-precision numbers."""
        # Recordings have single precision: more bytes would hold no more digits.
        data = np.ascontiguousarray(values, dtype="<f4").tobytes()
        return self.columns.setdefault(base64.b64encode(data).decode("ascii"), len(self.columns))

    def text(self, words: str) -> int:
        """The number of a text."""
        return self.texts.setdefault(words, len(self.texts))


def plot_data(plot: Plot, pool: Pool) -> dict[str, Any]:
    """A plot: its option, the text below it, and what the script adds."""
    return {
        "option": option(plot, pool),
        "text": plot.words,
        "unit": plot.x.unit.shown if plot.flat else plot.y.unit.shown,
        "windows": [_window(plot, window) for window in plot.windows],
        "group": plot.group,
        "square": plot.square,
        "rows": [len(plot.y.names), plot.height] if plot.flat else None,
        "names": {"x": plot.x.names, "y": plot.y.names},
    }


def _window(plot: Plot, window: Window | None) -> dict[str, Any]:
    """From and to on both axes, as far as they are given."""
    shown = window or Window("")
    x = None if shown.x is None else [plot.x.shown(end) for end in shown.x]
    ends = (
        given if given is not None else whole for given, whole in zip(shown.y, (plot.y.low, plot.y.high), strict=True)
    )
    return {"x": x, "y": [None if end is None else plot.y.shown(end) for end in ends]}


def option(plot: Plot, pool: Pool) -> dict[str, Any]:
    """The option of ECharts."""
    names = list(dict.fromkeys(one.name for one in plot.series if one.name))
    lines = {one.name for one in plot.series if not isinstance(one, Scatter)}
    legend = [{"name": name, **({"icon": "roundRect"} if name in lines else {})} for name in names]
    top = (66 if len(names) > 1 else 40) + (18 if any(level.upright for level in plot.levels) else 0)
    bars = any(isinstance(one, Bars) for one in plot.series)
    return {
        "animation": False,
        "aria": {"enabled": True, "label": {"description": plot.words}, **_decal(plot)},
        "legend": {**LEGEND, "data": legend, "show": len(names) > 1},
        "toolbox": _toolbox(plot),
        "tooltip": _tooltip(plot),
        "grid": {
            "left": 12 if plot.flat else 72 if plot.y.logarithmic else 64,
            "right": 56 if plot.names else 24,
            "top": top,
            "bottom": 84 if plot.zoom and not plot.square else 48 if plot.x.title else 30,
            "containLabel": plot.flat,
        },
        "xAxis": {**_axis(plot.x, bars), **(_windowed(plot) if plot.zoom else {})},
        "yAxis": {**_axis(plot.y, bars), "nameGap": 52 if plot.y.logarithmic else 44, **_room(plot)},
        "dataZoom": _zoom(plot),
        "series": [
            *(_series(plot, one, pool) for one in plot.series),
            *(_segment(plot, level) for level in plot.levels if level.start is not None),
            *_marks(plot),
        ],
    }


LEGEND: dict[str, Any] = {
    "type": "scroll",
    "top": 32,
    "left": 12,
    "right": 12,
    "itemWidth": 16,
    "itemHeight": 15,
    "textStyle": {"color": "@ink", "overflow": "truncate"},
    "inactiveColor": "@line",
    "pageTextStyle": {"color": "@soft"},
}
"""Symbols as high as the text, which is cut to them."""


def _decal(plot: Plot) -> dict[str, Any]:
    """Patterns of bars by their names; those that are hatched have one of their own, beside bars without any."""
    listed = [one for one in plot.series if isinstance(one, Bars)]
    bars = [one for one in listed if not one.stack]
    if len(bars) <= len(HUES) and not any(one.hatched for one in listed):
        return {}
    fills = (FILLS[place // len(HUES) % len(FILLS)] for place in range(max(1, len(bars))))
    return {"decal": {"show": True, "decals": [{"color": "@card", **fill} for fill in fills]}}


def _toolbox(plot: Plot) -> dict[str, Any]:
    """Tools. Filtering by the vertical axis would break lines where they leave the chart."""
    zoom = {"dataZoom": {"filterMode": "none", "title": {"zoom": "Zoom to a box", "back": "Back"}}}
    tools = {"restore": {"title": "As at first"}, "saveAsImage": {"title": "Save as PNG", "backgroundColor": "@card"}}
    feature = {**(zoom if not plot.names and not plot.square else {}), **tools}
    return {"right": 12, "top": 2, "iconStyle": {"borderColor": "@soft"}, "feature": feature}


def _tooltip(plot: Plot) -> dict[str, Any]:
    look = {
        "backgroundColor": "@card",
        "borderColor": "@line",
        "textStyle": {"color": "@ink"},
        "confine": True,
    }
    bars = any(isinstance(one, Bars) for one in plot.series)
    if plot.square or plot.names and not bars or any(isinstance(one, Scatter) for one in plot.series):
        return {**look, "trigger": "item"}
    kind = "shadow" if bars else "cross"
    return {**look, "trigger": "axis", "axisPointer": {"type": kind, "label": {"precision": 4}}}


def _axis(axis: Axis, bars: bool) -> dict[str, Any]:
    low, high = (None if end is None else axis.shown(end) for end in (axis.low, axis.high))
    label: dict[str, Any] = {"color": "@soft", "hideOverlap": True}
    made: dict[str, Any] = {
        "type": "log" if axis.logarithmic else "value",
        "name": axis.heading,
        "nameLocation": "middle",
        "nameGap": 30,
        "nameTextStyle": {"color": "@soft", "fontSize": 13},
        "axisLabel": label,
        # At zero it would cross plots whose values have both signs.
        "axisLine": {"show": True, "onZero": False, "lineStyle": {"color": "@soft"}},
        "splitLine": {"lineStyle": {"color": "@line"}},
        "inverse": axis.inverse,
        "min": low,
        "max": high,
    }
    if axis.names:
        label |= {"color": "@ink", "hideOverlap": False}
        made["splitLine"] = {"show": False}
        count = len(axis.names)
        if bars:
            # Else ECharts leaves out names where it finds too little room.
            label |= {"interval": 0}
            return made | {"type": "category", "data": list(axis.names)}
        # A name stands at 0, 1, 2, ...: steps of a half from -0.5 on have a tick at each of these.
        return made | {"min": -0.5, "max": count - 0.5, "interval": 0.5, "axisTick": {"show": False}}
    # The end of an axis is seldom round: a label there would stand unevenly beside the others.
    if not axis.logarithmic:  # one that is has few labels
        label |= {"showMinLabel": _round(low), "showMaxLabel": _round(high)}
    return made


def _round(end: float | None) -> bool:
    return end is None or end == 0.0 or (abs(end) >= 1.0 and math.isclose(float(f"{end:.1g}"), end))


UNEVEN = {"color": "@soft", "hideOverlap": True, "showMinLabel": False, "showMaxLabel": False}
"""Labels of an axis whose ends are seldom round."""


def _windowed(plot: Plot) -> dict[str, Any]:
    """The axis that is zoomed: from the first value to the last; that of a square from and to what is in sight."""
    ends: Any = ("dataMin", "dataMax")
    if plot.square:
        ends = _window(plot, plot.window)["x"] or (None, None)
    return {"min": ends[0], "max": ends[1], "axisLabel": UNEVEN, "axisPointer": {"label": {"precision": 4}}}


def _room(plot: Plot) -> dict[str, Any]:
    """How far the vertical axis goes: to what is in sight at first, or a little beyond the values."""
    low, high = _window(plot, plot.window)["y"]
    if not plot.zoom:
        return {}
    return {"min": low, "max": high, **({"axisLabel": UNEVEN} if plot.square else {"boundaryGap": [0, "12%"]})}


def _zoom(plot: Plot) -> list[dict[str, Any]]:
    # The wheel alone scrolls the page: a chart in its way would stop it.
    inside: dict[str, Any] = {"type": "inside", "zoomOnMouseWheel": "ctrl", "moveOnMouseWheel": False}
    if not plot.zoom:
        return []
    if plot.square:
        # As with the tools: filtering would break the path where it leaves the chart.
        return [{**inside, "filterMode": "none", f"{axis}AxisIndex": 0} for axis in "xy"]
    look = {"bottom": 10, "height": 22, "brushSelect": False, "labelPrecision": 2, "textStyle": {"color": "@soft"}}
    begin, end = _window(plot, plot.window)["x"] or (None, None)
    shown = {} if begin is None else {"startValue": begin, "endValue": end}
    return [{**inside, **shown}, {"type": "slider", **look, **shown}]


def _series(plot: Plot, one: Series, pool: Pool) -> dict[str, Any]:
    match one:
        case Line():
            return _line(plot, one, pool)
        case Scatter():
            return _scatter(plot, one, pool)
        case Bars():
            return _bars(plot, one)


def _line(plot: Plot, line: Line, pool: Pool) -> dict[str, Any]:
    x, y = line.x, line.y
    data: Any
    if isinstance(x, np.ndarray) and isinstance(y, np.ndarray):
        data = {"columns": [pool.column(plot.x.shown(1.0) * x), pool.column(plot.y.shown(1.0) * y)]}
        data |= {} if line.rows is None else {"rows": line.rows}
    elif line.labels:
        look = [{"show": bool(words), "formatter": words} for words in line.labels]
        sides = ["left", *["left" if line.inside else "right"] * (len(look) - 1)]
        data = [
            {"value": pair, "label": {**one, "position": side}}
            for pair, one, side in zip(_pairs(plot, line), look, sides, strict=True)
        ]
    else:
        data = _pairs(plot, line)
    return {
        "type": "line",
        "name": line.name,
        "data": data,
        "step": "end" if line.step else False,
        "showSymbol": bool(line.symbol) or bool(line.labels),
        "symbol": SYMBOLS[line.symbol] if line.symbol else "rect" if line.labels else "circle",
        "symbolSize": 7 if line.symbol else 1,
        "itemStyle": {"color": _colour(line.colour)},
        "lineStyle": {
            "width": line.width,
            "type": DASHES[line.dash],
            "opacity": 0.4 if line.faint else 1,
            "cap": "butt",
        },
        "label": {"color": "@ink", "distance": 8, **HALO},
        "emphasis": {"disabled": True},
        "z": 4 if line.above else 2 if line.faint else 3,
        **({"tooltip": {"show": False}} if line.faint else {}),
    }


def _pairs(plot: Plot, one: Line | Scatter) -> list[list[float | None]]:
    """Points in the units that are shown."""
    right, up = plot.x.unit.factor, plot.y.unit.factor
    return [
        [None if x is None else right * float(x), None if y is None else up * float(y)]
        for x, y in zip(one.x, one.y, strict=True)
    ]


def _scatter(plot: Plot, points: Scatter, pool: Pool) -> dict[str, Any]:
    data: list[Any] = _pairs(plot, points)
    if points.words:
        told = map(pool.text, points.words)
        data = [{"value": pair, "words": words} for pair, words in zip(data, told, strict=True)]
    return {
        "type": "scatter",
        "name": points.name,
        "data": data,
        "symbol": SYMBOLS[points.symbol],
        "symbolSize": points.size,
        "itemStyle": {
            "color": "transparent" if points.hollow else _colour(points.colour),
            "borderColor": _colour(points.colour),
            "borderWidth": 1.5 if points.hollow else 0,
            "opacity": 0.5 if points.faint else 1,
        },
        "z": 5 if points.size > 10 else 4,
        **_deviations(plot, points),
    }


def _deviations(plot: Plot, points: Scatter) -> dict[str, Any]:
    if not points.deviation:
        return {}
    bars = [
        [{"coord": [x, (y or 0.0) + sign * plot.y.shown(size)]} for sign in (-1, 1)]
        for (x, y), size in zip(_pairs(plot, points), points.deviation, strict=True)
    ]
    look = {"color": _colour(points.colour), "type": "solid", "width": 1.5}
    ends = {"symbol": ["rect", "rect"], "symbolSize": [9, 1.5], "label": {"show": False}}
    return {"markLine": {"silent": True, **ends, "lineStyle": look, "data": bars}}


def _bars(plot: Plot, bars: Bars) -> dict[str, Any]:
    axis = plot.x if plot.flat else plot.y
    data: list[Any] = [None if value is None else axis.shown(value) for value in bars.values]
    if bars.colours or bars.labels:
        colours = bars.colours or [bars.colour] * len(data)
        labels = bars.labels or [""] * len(data)
        data = [
            {"value": value, "itemStyle": {"color": _colour(colour)}, "label": {"formatter": words}}
            for value, colour, words in zip(data, colours, labels, strict=True)
        ]
    place = "right" if plot.flat else "top"
    return {
        "type": "bar",
        "name": bars.name,
        "data": data,
        "stack": bars.stack or None,
        "barGap": "10%",
        "barCategoryGap": "14%" if plot.flat else "20%",
        "label": {"show": bool(bars.labels), "position": place, "color": "@ink"},
        "itemStyle": {
            "color": _colour(bars.colour),
            "opacity": 0.5 if bars.colour == "soft" else 1,
            **({"borderColor": "@card", "borderWidth": 0.5} if bars.stack else {}),
            **({"decal": {"color": "@card", "symbol": "rect", **FILLS[1]}} if bars.hatched else {}),
        },
    }


def _segment(plot: Plot, level: Level) -> dict[str, Any]:
    """A level that ends somewhere, named at its end. It has many points, which the script puts in: what is outside the
    part in sight is left out by the point, a mark by both ends as soon as one is outside."""
    ends = [plot.x.shown(end) for end in (level.start, level.stop) if end is not None]
    look = {"show": True, "color": _colour(level.colour), "align": "right", "verticalAlign": "bottom", "distance": 0}
    return {
        "type": "line",
        "name": level.name,
        "data": {"segment": [*ends, plot.y.shown(level.value)]},
        "silent": True,
        "tooltip": {"show": False},
        "showSymbol": False,
        "lineStyle": {"color": _colour(level.colour), "type": DASHES[level.dash], "width": 1.5},
        "endLabel": {**look, **HALO, "padding": [0, 4, 3, 0]},
        "z": 6,
    }


def _marks(plot: Plot) -> list[dict[str, Any]]:
    """Levels and bands: a series of their own, so that no name of the legend hides them."""
    levels = [_mark(plot, level) for level in plot.levels if level.start is None]
    bands = [
        [
            {
                "xAxis": plot.x.shown(band.low),
                "name": band.name,
                "itemStyle": {"color": "@area" if band.shaded else "transparent"},
            },
            {"xAxis": plot.x.shown(band.high) - SHORTER},
        ]
        for band in plot.bands
    ]
    if not levels and not bands:
        return []
    area = {"silent": True, "label": {"color": "@soft", "position": "insideTop"}, "data": bands}
    line = {"silent": True, "symbol": "none", "data": levels}
    return [{"type": "line", "name": "", "data": [], "silent": True, "markLine": line, "markArea": area}]


def _mark(plot: Plot, level: Level) -> dict[str, Any]:
    axis = plot.x if level.upright else plot.y
    beside = level.upright or bool(plot.x.names)
    look: Literal["start", "end", "insideEndTop"] = "end" if beside else "insideEndTop"
    if level.upright and plot.y.inverse:
        look = "start"
    return {
        "xAxis" if level.upright else "yAxis": axis.shown(level.value),
        "name": level.name,
        "lineStyle": {"color": _colour(level.colour), "type": DASHES[level.dash], "width": 1.5},
        "label": {"formatter": level.name, "color": _colour(level.colour), "position": look, **HALO},
    }
