"""Tables that scripts write into pages, between two marks."""

from __future__ import annotations

END = "<!-- end of table -->\n"


def folded(title: str, table: str) -> str:
    """A ``table`` that a reader unfolds by its ``title``."""
    return f"\n<details>\n<summary>{title}</summary>\n\n{table}\n</details>\n"


def with_table(text: str, table: str, maker: str) -> str:
    """``text`` with ``table`` between the marks of the script ``maker``, which the first of the marks names."""
    mark = f"<!-- table: made by {maker} -->\n"
    before, begin, rest = text.partition(mark)
    _, end, after = rest.partition(END)
    assert begin and end, "the marks are missing"
    return before + mark + table + END + after
