"""The tables of the documentation site that a click sorts."""

from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "docs" / "_static" / "sort.js"
HEAD = ("controller", "V", "found", "A1", "gain", "delay", "radius")
ROWS = (
    ("B", "116.0", "214.4", "holds", "13 and 5.2", "3.5", "0.15"),
    ("A", "70.4", "128.5", "fails", "3.5 and 7.6", "2.2", "0.9"),
    ("C", "96.6", "> 190", "holds", "3 and 5.3", "1.8", "0.25"),
)


def page(columns: int, rows: tuple[tuple[str, ...], ...] = ROWS) -> str:
    def row(cells: tuple[str, ...], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{cell}</{tag}>" for cell in cells[:columns]) + "</tr>"

    body = "".join(row(cells, "td") for cells in rows)
    script = SCRIPT.read_text(encoding="utf-8")
    return (
        f"<table><thead>{row(HEAD, 'th')}</thead>{body and f'<tbody>{body}</tbody>'}</table><script>{script}</script>"
    )


def test_a_click_on_a_head_sorts_by_the_first_number_of_its_cells(open_page) -> None:
    opened = open_page(page(len(HEAD)))

    def order(column: str) -> str:
        opened.get_by_role("button", name=column, exact=True).click()
        return "".join(opened.eval_on_selector_all("tbody td:first-child", "cells => cells.map(c => c.textContent)"))

    assert [order("V"), order("V"), order("found"), order("gain"), order("controller")] == [
        *("ACB", "BCA", "ACB", "CAB", "ABC"),
    ]


def test_tables_with_few_columns_or_without_rows_stay_as_they_are(open_page) -> None:
    assert open_page(page(4)).locator("button").count() == 0
    assert open_page(page(7, ())).locator("button").count() == 0
