"""The picture of a sweep: V over one parameter, or over two as a map."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..search.candidates import Trial
from ..views.units import number
from .picture import Picture
from .style import COLOUR_MAP, COLOURS, DASHED, SIZE, STYLE, label

MOST_NUMBERS = 120
"""Fields of a map that have room for a number each."""


DECADE = 10.0
"""Ratio of the last to the first value from which on a scale is logarithmic."""


def draw(
    varied: Sequence[str],
    values: Mapping[str, Sequence[float]],
    trials: Sequence[Trial],
    target: float,
    figure: Figure | None,
) -> Figure:
    """V of the ``trials`` over the ``values`` of one or two parameters, those that are ``varied``."""
    with rc_context(STYLE):
        shown = figure or Picture(figsize=SIZE, layout="constrained")
        if len(varied) == 1:
            _line(varied[0], trials, target, shown.subplots())
        else:
            _map((varied[0], varied[1]), values, trials, shown, shown.subplots())
    return shown


def _line(name: str, tried: Sequence[Trial], target: float, axes: Axes) -> None:
    trials = sorted(tried, key=lambda trial: trial.values[name])
    x = np.array([trial.values[name] for trial in trials])
    V = np.array([math.nan if trial.cost is None else trial.cost for trial in trials])
    fails = np.array([not trial.holds for trial in trials])
    axes.plot(x, V, color=COLOURS[0], marker="o", markersize=3)
    if fails.any():
        axes.plot(x[fails], V[fails], "x", color=COLOURS[1], label="A1-A3 fail")
    for without in x[np.isnan(V)]:
        axes.axvline(without, color=COLOURS[1], linestyle="dotted", label="no V")
    axes.axhline(target, **DASHED, label=f"target: {target:g}")
    axes.set(xlabel=label(name), ylabel="V", xscale="log" if 0.0 < x[0] * DECADE <= x[-1] else "linear")
    entries = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(entries.values(), entries.keys())


def _map(
    names: tuple[str, str], values: Mapping[str, Sequence[float]], trials: Sequence[Trial], figure: Figure, axes: Axes
) -> None:
    first, across = names
    up, right = values[first], values[across]
    V = np.array([math.nan if trial.cost is None else trial.cost for trial in trials]).reshape(len(up), -1)
    holds = np.array([trial.holds for trial in trials]).reshape(V.shape)
    image = axes.imshow(V, origin="lower", aspect="auto", cmap=COLOUR_MAP)
    middle = np.nanmax(V, initial=0.0) * 0.4 + np.nanmin(V, initial=math.inf) * 0.6
    axes.grid(False)
    axes.set_xticks(range(len(right)), [f"{value:g}" for value in right])
    axes.set_yticks(range(len(up)), [f"{value:g}" for value in up])
    axes.set(xlabel=label(across), ylabel=label(first))
    for row, column in np.ndindex(V.shape):
        value = V[row, column]
        words = number(None if math.isnan(value) else float(value)) if V.size <= MOST_NUMBERS else ""
        words += "" if holds[row, column] else "\n×" if words else "×"
        axes.text(column, row, words, ha="center", va="center", fontsize=6, color="w" if value > middle else "k")
    figure.colorbar(image, label="V (× where A1-A3 fail)")
