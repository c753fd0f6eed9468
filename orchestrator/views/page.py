"""HTML: pages of one file each, with style, scripts, plotting library and data inside; and fragments for notebooks.

Templates escape all values. A page's policy lets a browser run the scripts embedded here, by their hashes, and nothing
else: text of an FMU that slipped through would still not run.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from importlib import resources
from importlib.metadata import version
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemBytecodeCache, FunctionLoader, StrictUndefined
from jinja2.bccache import Bucket
from markupsafe import Markup, escape

from ..cache import cache_folder
from ..text import printable
from .echarts import Pool, plot_data
from .plot import Heat, MovingArm, Plot, PosedArm
from .table import Headline, Page, Part, Summary, Table, shown
from .units import MILLIMETRE, number

FILES = resources.files(__package__) / "templates"

LIBRARY = "echarts.common.min.js"

SCRIPTS: Mapping[str, tuple[type, ...]] = {
    "page.js": (object,),
    "plot.js": (object,),
    "heat.js": (Heat,),
    "arm.js": (PosedArm, MovingArm),
    "motion.js": (MovingArm,),
}
"""The scripts of a page, in their order: those of the parts that it has."""

MOST = 20
"""Rows of a table that a notebook shows; the others are counted."""

SCALE_END = 1.15
"""End of a scale, relative to the largest value on it."""


def page_html(page: Page) -> str:
    """The page as one HTML file, which needs no network."""
    parts = page.parts
    names = (name for name, kinds in SCRIPTS.items() if any(isinstance(part, kinds) for part in parts))
    program = "\n".join(map(template_text, names))
    library = template_text(LIBRARY)
    return _filled(
        "page.html",
        page=page,
        title=page.title,
        kicker=page.kicker,
        style=Markup(template_text("style.css")),
        library=Markup(library),
        program=Markup(program),
        data=Markup(script_json(page_data(page))),
        policy=_policy(library, program),
    )


PLAYGROUND = (
    *("page.js", "plot.js", "arm.js", "motion.js"),
    *("playground.js", "playground-lesson.js", "playground-pull.js", "playground-fmu.js"),
)
"""The scripts of the playground, in their order: its own are the last ones."""

WORKER = "playground-worker.js"
"""What its workers run."""


def playground_html(data: Mapping[str, Any], plots: Sequence[Plot]) -> str:
    """The page that simulates, as one HTML file, which needs no network: a program in WebAssembly is in its ``data``.
    The ``plots`` are those that its script fills."""
    program, library = "\n".join(map(template_text, PLAYGROUND)), template_text(LIBRARY)
    return _filled(
        "playground.html",
        title="Playground of the flexible manipulator",
        kicker="The benchmark in the browser, with the numbers of the command line",
        plots=plots,
        protocols=list(data["protocols"]),
        style=Markup(template_text("style.css")),
        library=Markup(library),
        program=Markup(program),
        worker=Markup(template_text(WORKER)),
        data=Markup(script_json({**data, "plots": {plot.id: plot_data(plot, Pool()) for plot in plots}})),
        policy=_policy(library, program, simulates=True),
    )


def page_data(page: Page) -> dict[str, Any]:
    """What the scripts of a page are given: what they draw, by its id, and the columns and texts that it is made of."""
    pool, parts = Pool(), page.parts
    return {
        "plots": {part.id: plot_data(part, pool) for part in parts if isinstance(part, Plot)},
        "heats": {part.id: _heat_data(part) for part in parts if isinstance(part, Heat)},
        "arms": {part.id: _arm_data(part) for part in parts if isinstance(part, PosedArm)},
        "motions": {part.id: _motion_data(part, pool) for part in parts if isinstance(part, MovingArm)},
        "columns": list(pool.columns),
        "texts": list(pool.texts),
    }


def _heat_data(heat: Heat) -> dict[str, Any]:
    """A map: its rows from above, and its layers."""
    return {
        "title": heat.title,
        "text": heat.text,
        "corner": f"{heat.y.title} \\ {heat.x.title}",
        "columns": heat.x.names,
        "rows": heat.y.names,
        "cells": heat.cells,
        "layers": [
            {
                "name": layer.name,
                "symbol": layer.symbol or layer.name,
                "of": layer.of,
                "target": layer.target,
                "values": layer.values,
                "marked": sorted(layer.marked),
            }
            for layer in heat.layers
        ],
        "smaller": heat.smaller,
        "limits": heat.limits,
        "aroundZero": heat.around_zero or bool(heat.smaller),
    }


def _arm_data(arm: PosedArm) -> dict[str, Any]:
    """The arm beside a map."""
    return {"links": arm.links, "heat": arm.heat, "poses": arm.poses}


def _motion_data(motion: MovingArm, pool: Pool) -> dict[str, Any]:
    """The arm in motion: offsets of the tool in millimetres."""
    return {
        "choice": motion.choice,
        "links": motion.links,
        "circles": [[colour, radius] for colour, radius in motion.circles],
        "circleWords": " and ".join(number(radius, 1e3) for _, radius in motion.circles) + " mm",
        "moved": [
            {
                "name": moved.name,
                "rest": moved.rest,
                "motion": _columns(moved.motion, (1.0, *[MILLIMETRE.factor] * 2, 1.0, 1.0), pool),
                "torque": _columns(moved.torque, (1.0,) * moved.torque.shape[1], pool),
                "end": moved.end,
                "force": moved.force if any(moved.force) else None,
                "window": moved.window,
                "places": moved.places,
                **({"more": moved.more} if moved.more else {}),
            }
            for moved in motion.moved
        ],
    }


def _columns(table: np.ndarray, factors: Iterable[float], pool: Pool) -> list[int]:
    return [pool.column(factor * column) for factor, column in zip(factors, table.T, strict=True)]


def fragment(summary: Summary, image: bytes = b"") -> str:
    """A summary as a piece of HTML for notebooks: escaped, without scripts, and in the notebook's own style. ``image``
    is a picture below it, as PNG."""
    data = "data:image/png;base64," + base64.b64encode(image).decode("ascii") if image else ""
    return _filled("fragment.html", summary=summary, image=data)


def script_json(value: Any) -> str:
    """JSON that may stand inside a <script> element: no character of it can end the element or begin a comment."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _filled(template: str, **context: Any) -> str:
    return _environment().get_template(template).render(context)


def parts_html(parts: Sequence[Part]) -> str:
    """Parts of a page as a piece of HTML for a page of the same style: escaped, and without scripts."""
    return _filled("pieces.html", parts=parts)


@functools.cache
def _environment() -> Environment:
    """The templates of this folder."""
    return environment(template_text)


class _Compiled(FileSystemBytecodeCache):
    """Compiled templates in the cache folder, by their contents: to compile them takes a third of a page's time."""

    def __init__(self, folder: str) -> None:
        super().__init__(folder, f"page-{version('jinja2')}-%s")

    def load_bytecode(self, bucket: Bucket) -> None:
        """Whatever is wrong with a file, such as half of it: the template is compiled again."""
        with suppress(Exception):
            super().load_bytecode(bucket)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """On a full disk, as well."""
        with suppress(OSError):
            super().dump_bytecode(bucket)


def environment(read: Callable[[str], str | None]) -> Environment:
    """Templates that are escaped, without control characters but for what is marked as safe. ``read`` gives the text of
    one by its name, or None."""
    made = Environment(
        loader=FunctionLoader(read),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=_Compiled(str(cache_folder())),
        # What is marked as safe is of a subclass of str, and stays as it is.
        finalize=lambda value: printable(value) if type(value) is str else value,
    )
    made.filters["number"] = number
    made.filters["unbroken"] = unbroken
    made.globals |= {"kind": lambda part: type(part).__name__, "shown": shown, "marked": _marked, "placed": _placed}
    made.globals["MOST"] = MOST
    return made


PIECES = re.compile(r"(?<=[./=:])(?=[^\W\d])")
"""Where a word of a path, a case or a command may be broken: behind these, and not within a number."""

LONGEST = 40
"""Characters of a piece that has a line to itself on a phone; longer ones, such as hashes, are broken anywhere."""


def unbroken(text: str) -> Markup:
    """Text whose identifiers are not broken inside: not at a hyphen either, where browsers break by themselves."""
    return Markup("").join(
        Markup("<wbr>").join(_piece(piece) for piece in PIECES.split(word))
        for word in re.split(r"(\s+)", printable(text))
    )


def _piece(text: str) -> Markup:
    if "-" not in text[1:] or len(text) > LONGEST:
        return escape(text)
    return Markup('<span class="word">{}</span>').format(text)


def template_text(name: str) -> str:
    """The text of a template, style or script of this folder."""
    return (FILES / name).read_text(encoding="utf-8")


def _marked(table: Table, row: int) -> list[int]:
    """The columns whose best value stands in this row."""
    return [place for place in range(len(table.columns)) if row in table.best(place)]


def _placed(part: Headline) -> dict[str, Any]:
    """Places in percent of the value and of the marks on a common scale that begins at 0."""
    end = SCALE_END * max(*(mark for _, mark in part.marks), part.value or 0.0)
    return {
        "place": None if part.value is None else 100 * part.value / end,
        "marks": [{"name": name, "value": f"{mark:.4g}", "place": 100 * mark / end} for name, mark in part.marks],
    }


def _policy(*scripts: str, simulates: bool = False) -> str:
    """A Content-Security-Policy that admits these scripts by their hashes, and no request of any kind. A page that
    ``simulates`` may compile WebAssembly, and start workers of what it has itself."""
    hashes = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{value}'" for value in hashes)
    if simulates:
        allowed += " 'wasm-unsafe-eval'; worker-src blob:"
    return (
        # Templates set places and sizes by style attributes, whose values no hash can name beforehand.
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
