"""The tables of docs/capabilities.md, from orchestrator/fmi/description.py.

python benchmarks/capability_page.py             writes them between their marks
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.marked_tables import with_table  # noqa: E402
from orchestrator.fmi.description import FLAGS, KINDS, VARIABLES, Capability  # noqa: E402

PAGE = ROOT / "docs" / "capabilities.md"
MAKER = "benchmarks/capability_page.py"

PARTS = (("Kinds of FMUs", KINDS), ("Flags", FLAGS), ("Variables", VARIABLES))


def table() -> str:
    """The three tables."""
    lines = []
    for title, rows in PARTS:
        lines += [f"## {title}", "", "| name | FMI | | how it shows |", "|---|---|---|---|", *map(_row, rows), ""]
    return "\n".join(lines)


def _row(row: Capability) -> str:
    versions = ", ".join(f"{version}.0" for version in row.versions)
    return f"| `{row.name}` | {versions} | {row.standing} | {row.text.format(names='NAME')} |"


def page(text: str) -> str:
    """The page with its tables made anew."""
    return with_table(text, table(), MAKER)


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
