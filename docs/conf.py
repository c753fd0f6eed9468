"""The documentation site: ``sphinx-build -W -c docs . build/site``, then open ``build/site/index.html``.

The pages are the repository's own Markdown files, at their own paths: a link between two of them works on the site, on
a Git host and in the unpacked source distribution. The build fails if a link is dead. Neither the build nor the pages
need a network.
"""

import re
from importlib.util import find_spec
from pathlib import Path

from sphinx.application import Sphinx

import orchestrator
from orchestrator.cli.playground import built_page

project = "Flexible-manipulator benchmark"
author = "FlexibleManipulator benchmark contributors"
release = orchestrator.__version__

root_doc = "docs/index"
include_patterns = ["*.md", "docs/*.md", "examples/**.md", "controller_fmu/**.md"]
exclude_patterns = [".*", "build", "runs", "tests"]  # keeps the walk short

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_heading_anchors = 3
autodoc_member_order = "bysource"

html_theme = "furo"
html_title = f"{project} {release}"
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["sort.js"]
html_show_copyright = False

CONTENTS = {
    "Start": ["Installation <install>", "manipulator", "playground", "leaderboard", "study", "gallery", "commands"],
    "Tutorials": [
        "tutorial-evaluate",
        "tutorial-tune",
        "tutorial-service",
        "tutorial-windows",
        "tutorial-worst-case",
        "tutorial-compare",
        "design",
        "policies",
    ],
    "Use": [
        "evaluate",
        "robustness",
        "tuning",
        "check",
        "report",
        "publishing",
        "rules",
        "compare",
        "python",
        "running",
        "service",
        "teaching",
    ],
    "Write a controller": [
        "exporting",
        "/controller_fmu/starters/*/README",
        "/examples/**",
        "interface",
        "capabilities",
        "bug-reports",
    ],
    "Reference": ["protocol", "timing", "plant", "api", "results", "paper"],
    "Controllers": ["/controller_fmu/*/README"],
    "Project": ["release-notes", "stability", "/README", "/CONTRIBUTING", "/CHANGELOG"],
}
"""The site's navigation: pages by heading. The build fails if a page is missing here."""

PLAYGROUND, LIVE = "docs/playground", "playground-page.html"
"""The page that tells of the playground, and the playground itself beside it, which only the site has."""

CAN_BUILD = find_spec("ziglang") is not None
"""Whether the compiler for the playground is there; without it, the site leaves that out."""

REDIRECT = """<!DOCTYPE html>
<meta charset="utf-8">
<title>{title}</title>
<meta http-equiv="refresh" content="0; url={page}.html">
<a href="{page}.html">{title}</a>
"""


def add_contents(app: Sphinx, page: str, source: list[str]) -> None:
    """Append the navigation to the front page, which has none on a Git host."""
    if page == root_doc:
        for caption, pages in CONTENTS.items():
            entries = "\n".join(pages)
            source[0] += f"\n```{{toctree}}\n:hidden:\n:glob:\n:caption: {caption}\n\n{entries}\n```\n"


def add_index(app: Sphinx, error: Exception | None) -> None:
    """Lead from the file that a browser and a web server look for to the front page."""
    if error is None:
        text = REDIRECT.format(title=html_title, page=root_doc)
        (Path(app.outdir) / "index.html").write_text(text, encoding="utf-8")


def add_playground_link(app: Sphinx, page: str, source: list[str]) -> None:
    """Lead from its page to the playground, which a clone has to build."""
    if page == PLAYGROUND:
        heading, rest = source[0].split("\n", 1)
        source[0] = f'{heading}\n\n<p><a href="{LIVE}"><b>Open the playground</b></a></p>\n{rest}'


def add_playground(app: Sphinx, error: Exception | None) -> None:
    """Build the playground itself; it takes the package ``ziglang``."""
    if error is None and app.builder.format == "html":
        (Path(app.outdir) / PLAYGROUND).with_name(LIVE).write_text(built_page(), encoding="utf-8")


def shorten(app: Sphinx, what: str, name: str, of: object, options: object, signature: str, returns: str) -> tuple:
    """Leave out of signatures what a value is checked against, and defaults that cannot be written down."""
    if signature is not None:
        signature = re.sub(r"(?:~?typing\.)?Annotated\[(\w+), msgspec\.Meta\([^)]*\)\]", r"\1", signature)
        signature = signature.replace("<factory>", "...")
    return signature, returns


def setup(app: Sphinx) -> None:
    """Connect the functions above."""
    app.connect("autodoc-process-signature", shorten)
    app.connect("source-read", add_contents)
    app.connect("build-finished", add_index)
    if CAN_BUILD:
        app.connect("source-read", add_playground_link)
        app.connect("build-finished", add_playground)
