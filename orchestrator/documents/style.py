"""The common look of all figures, and how they are written for a paper."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .files import prepare_folder, streamed, write_bytes

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

HUES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours of lines, one after the other. After Okabe and Ito, distinguishable by colour-blind readers."""
COLOURS = HUES[:2]
"""Of axes 1 and 2."""
MUTED = "0.72"
COLOUR_MAP = "viridis_r"
"""Of values for which small is good."""
DASHED: Any = {"color": "k", "linestyle": "dashed", "linewidth": 0.7}


def write_drawn(drawings: Mapping[str, Callable[[], Figure | None]], folder: Path) -> tuple[list[str], list[str]]:
    """Write figures by name into ``folder``, which is created, in all :data:`FORMATS`.

    Returns the names of the figures written, without endings, and of those that there is nothing to draw for.
    """
    prepare_folder(folder)
    with rc_context(STYLE):
        made = {name: draw() for name, draw in drawings.items()}
        for name, figure in made.items():
            if figure is not None:
                for ending, options in FORMATS.items():
                    data = streamed(partial(figure.savefig, format=ending, **options))
                    write_bytes(folder / f"{name}.{ending}", data)
    return [name for name in made if made[name] is not None], [name for name in made if made[name] is None]


def label(name: str) -> str:
    """A name as Matplotlib shows it: Matplotlib leaves out what begins with an underscore, and ``$`` begins a
    formula."""
    return (" " if name.startswith("_") else "") + name.replace("$", r"\$")


def legend_above(axes: Axes) -> None:
    """A legend that covers nothing of what is drawn, wherever that is."""
    axes.legend(fontsize=6, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
