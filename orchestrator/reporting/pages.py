"""HTML pages of one file each: style, scripts, plotting library and data inside, nothing is loaded from elsewhere.

Templates escape all values. The page's policy lets a browser run the scripts embedded here, by their hashes, and
nothing else: text of an FMU that slipped through would still not run.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping
from importlib import resources
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from ..text import printable
from .payload import script_json
from .wording import number

FILES = resources.files(__package__) / "templates"

LIBRARY = "echarts.common.min.js"
SHARED = ("page.js", "charts.js", "heat.js", "arm.js")
REPORT = (*SHARED, "shares.js", "workspace.js", "case.js", "spread.js", "stability.js", "motion.js", "report.js")
COMPARE = (*SHARED, "compare.js")
WORST = ("page.js", "charts.js", "case.js", "worst.js")
TUNE = ("page.js", "charts.js", "tune.js")


def render(template: str, scripts: tuple[str, ...], payload: Mapping[str, Any], **context: Any) -> str:
    """The page of ``template`` with ``scripts`` run on ``payload``; ``context`` is what the template shows."""
    program = "\n".join(_text(name) for name in scripts)
    library = _text(LIBRARY)
    return filled(
        template,
        style=Markup(_text("style.css")),
        library=Markup(library),
        program=Markup(program),
        data=Markup(script_json(payload)),
        policy=_policy(library, program),
        **context,
    )


def filled(template: str, **context: Any) -> str:
    """``template`` with ``context``, escaped and without control characters but for what is marked as safe."""
    environment = Environment(
        loader=FunctionLoader(_text),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: printable(value) if type(value) is str else value,
    )
    environment.filters["number"] = number
    return environment.get_template(template).render(context)


def _text(name: str) -> str:
    return (FILES / name).read_text(encoding="utf-8")


def _policy(*scripts: str) -> str:
    """A Content-Security-Policy that admits these scripts by their hashes, and no request of any kind."""
    hashes = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{value}'" for value in hashes)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
