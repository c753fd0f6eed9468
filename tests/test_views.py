"""The views: a table of every feature in each of them, text of strangers, and the documents of all kinds.

After a change of looks, look at the difference that ``REFRESH=1 python -m pytest tests/test_views.py`` makes to
``snapshots/views.txt``.
"""

import base64
import csv as reader
import hashlib
import io
import itertools
import json
import re
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml.html import fromstring
from msgspec.structs import replace
from rich.cells import cell_len
from rich.console import Console
from support.reports import documents, results_of, searched
from support.results import TABLE_2, everything
from support.snapshots import snapshot

import orchestrator
from orchestrator.documents.document import Displayable
from orchestrator.documents.evaluation import Evaluation
from orchestrator.text import printable
from orchestrator.views import drawing
from orchestrator.views import page as pages
from orchestrator.views.export import CHARACTER, FORMS, FORMULA, GAP, TEXT_WIDTH, csv, inert, latex, markdown
from orchestrator.views.page import fragment, page_html, script_json
from orchestrator.views.plot import (
    Axis,
    Band,
    Bars,
    Heat,
    Layer,
    Level,
    Line,
    Moved,
    MovingArm,
    Plot,
    PosedArm,
    Scatter,
    Window,
)
from orchestrator.views.table import (
    Beside,
    Choice,
    Column,
    Commands,
    Facts,
    Headline,
    Link,
    Note,
    Page,
    Panel,
    Quantity,
    Summary,
    Table,
    Value,
    VerdictCell,
    plain,
    shown,
)
from orchestrator.views.terminal import NARROW, show, terminal
from orchestrator.views.units import MILLIMETRE, MILLISECOND, TORQUE, amplitude

DOCS = Path(__file__).parents[1] / "docs" / "report.md"
EVIL = "=[red]1[/red]</script><script>alert(1)</script><img src=x onerror=alert(2)>\x1b[31m\u202e|$x_1$ & {50%}~^\\"
SPECIAL = "[]<>&|\\$%_#{}~^*`=+-@/'\"\t\r\n\x1b\u202e"

EVERY = Table(
    "Every feature",
    (
        Column("name"),
        Column("error", MILLIMETRE, best="smallest"),
        Column("count", minor=True, best="largest"),
        Column("margin", MILLISECOND),
        Column("verdict"),
        Column("case", minor=True),
    ),
    (
        (
            "=1+1",
            Value(0.0123456789, 0.000987654321),
            12,
            Value(0.01, beyond=">"),
            VerdictCell(True),
            Link("c00", "again"),
        ),
        (Quantity("[red]u", TORQUE), Value(2.0, unit=TORQUE, good=False), 3, None, VerdictCell(False, "fails"), "*x*"),
        ("a|b_c & {d}~^\\$5%", 0.00234567891, 12, Value(0.00125, good=True), VerdictCell(None), "-"),
        ("</script>\x1b[2J", Value(None), None, Value(0.123456789, given=True), None, Link("é" * 50)),
    ),
    (("target", 7e-3, None, None, None, None),),
    caption="A caption.",
)
SUMMARY = Summary(
    "A title [bold]",
    "and a kicker",
    (
        Facts("Facts", (("Seed", "1"), ("Other", "left out")), ("Seed",)),
        EVERY,
        Note("A warning that is longer than the narrow terminal, so that it becomes two lines."),
        Note("A note that is as long, and is not wrapped, since it may hold a command.", warning=False),
        Commands("to repeat", (("this", "a command that is longer than the narrow terminal, and stays one line"),)),
    ),
)


def printed(summary: Summary, **options) -> str:
    console = Console(file=io.StringIO(), emoji=False, **options)
    show(summary, console)
    return console.file.getvalue()


def cells_of(text: str) -> list[list[str]]:
    """The cells of CSV."""
    return list(reader.reader(io.StringIO(text, newline=""), strict=True))


class Html:
    """What HTML consists of."""

    def __init__(self, html: str):
        root = fromstring(html)
        tags = (element.tag for element in root.iter() if isinstance(element.tag, str))
        self.elements = Counter("td" if tag == "th" else tag for tag in tags)  # an empty cell is no header
        self.attributes = Counter(name for element in root.iter() for name in element.attrib)
        pairs = [pair for element in root.iter() for pair in element.attrib.items()]
        self.active = [pair for pair in pairs if pair[0].startswith("on") or pair[0] in ("src", "href")]
        self.texts = [element.text_content() for element in root.iter("th", "td", "caption", "p")]
        self.text = " ".join(root.text_content().split())
        self.data = [element.text for element in root.iter("script") if element.get("id") == "data"]


def test_a_table_of_every_feature_in_every_view():
    views = {f"{width} characters": printed(SUMMARY, width=width) for width in (40, 110)}
    views |= {form: write(SUMMARY.tables) for form, (_, write) in FORMS.items()}
    views["fragment"] = fragment(SUMMARY)
    text = "".join(f"==== {name}\n{view.rstrip()}\n\n" for name, view in views.items())
    assert text == snapshot("views.txt", text)


def test_csv_has_si_units_and_all_digits():
    header, *rows = cells_of(csv((EVERY,)))
    assert header == ["name", "error [m]", "error [m] standard deviation", "count", "margin [s]", "verdict", "case"]
    assert [row[1:5] for row in rows] == [
        ["0.0123456789", "0.000987654321", "12", "> 0.01"],
        ["2.0", "", "3", ""],
        ["0.00234567891", "", "12", "0.00125"],
        ["", "", "", "0.123456789"],
        ["0.007", "", "", ""],
    ]
    assert [row[0] for row in rows[:2]] == ["'=1+1", "[red]u [N.m]"]


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("=1+1", "'=1+1"),
        ("a;=1+1", "a;'=1+1"),
        ('a; "=1+1', "a;' \"=1+1"),
        ("a\t@x\n+y", "a\t'@x\n'+y"),
        ("-", "-"),
        ("a - b; c = d", "a - b; c = d"),
    ],
)
def test_a_spreadsheet_runs_nothing_however_it_splits_rows(text, made):
    """One of a language with decimal commas splits at semicolons, and takes no notice of quotes within a cell."""
    assert inert(text) == made


def test_the_best_values_are_marked_and_the_minor_columns_left_out_where_there_is_no_room():
    assert [EVERY.best(place) for place in (1, 2, 3)] == [{2}, {0, 2}, frozenset()]
    text = printed(SUMMARY, width=110, force_terminal=True)
    assert re.search(r"\x1b\[1m *2\.35\x1b\[0m", text) and "\x1b[1m12.3" not in text
    assert "count" in text and "count" not in printed(SUMMARY, width=NARROW - 1)


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_a_terminal_of_any_encoding_shows_what_it_can_in_colour_if_it_has_any(monkeypatch, encoding):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict")
    monkeypatch.setattr(sys, "stdout", stream)
    show(Summary("Ω", "10 µm × 2", (EVERY,)), terminal())
    stream.flush()
    text = stream.buffer.getvalue().decode(encoding)
    assert "not judged" in text and ("Ω" in text) == (encoding == "utf-8")
    assert ("10 um x 2" if encoding == "ascii" else "10 µm × 2") in text and "\x1b" not in text
    monkeypatch.setenv("TERM", "xterm-256color")
    for name, colours in (("COLOURFUL", True), ("NO_COLOR", False)):
        monkeypatch.delenv("NO_COLOR", raising=False)
        monkeypatch.setenv(name, "1")
        shown_there = printed(SUMMARY, force_terminal=True, width=80)
        assert bool(re.search(r"\x1b\[[0-9;]*3[0-7]m", shown_there)) == colours


# Text of strangers.

LATEX = {
    r"\textbackslash{}": "\\",
    r"\textasciitilde{}": "~",
    r"\textasciicircum{}": "^",
    r"\textbar{}": "|",
    "$<$": "<",
    "$>$": ">",
    r"$\mu$": "µ",
    r"$\times$": "×",
    r"$\pm$": "±",
    r"$^\circ$": "°",
    **{f"\\{char}": char for char in "&%$#_{}"},
}
TOKEN = re.compile("|".join(map(re.escape, LATEX)) + r"|[^\\&%$#_{}~^]")


def from_latex(cell: str) -> str:
    """The text that LaTeX prints; fails for whatever would be a command of the text itself."""
    cell = cell.strip().removeprefix("{}")
    tokens = TOKEN.findall(cell)
    assert "".join(tokens) == cell
    return "".join(LATEX.get(token, token) for token in tokens)


def rows_of_latex(text: str) -> list[list[str]]:
    """The cells of all tabulars; all lines of a table have as many."""
    lines = (line.strip() for line in text.splitlines())
    return [re.split(r"(?<!\\)&", line.removesuffix(r"\\")) for line in lines if line.endswith(r" \\")]


def rows_of_markdown(text: str) -> list[list[str]]:
    """The cells of all tables."""
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell for _, cell in re.findall(r"(^|\|)((?:[^|\\]|\\.)*)", line[1:-1])] for line in lines]


def words(text: str) -> str:
    return " ".join(printable(text).split())


@settings(max_examples=150)
@given(st.text(st.one_of(st.sampled_from(SPECIAL), st.characters()), max_size=24))
def test_text_of_strangers_stays_text(text):
    table = Table(text, (Column("first"), Column(text)), ((text, 1.0), (Link(text), VerdictCell(None, text or "-"))))
    summary, harmless = Summary(text, text, (table, Note(text))), Table("x", table.columns, (("x", 1.0), ("x", "y")))
    told = words(text)

    seen = printed(summary, width=150)
    assert all(char.isprintable() or char == "\n" for char in seen)
    assert Counter(told.split()) <= Counter(seen.split()) | Counter({word: seen.count(word) for word in told.split()})

    lines = rows_of_latex(latex((table,)))
    assert {len(line) for line in lines} == {2} and len(lines) == 3
    assert [from_latex(cell) for cell in (lines[0][1], lines[1][0])] == [told, "--" if told == "-" else told]

    lines = rows_of_markdown(markdown((table,)))
    assert {len(line) for line in lines} == {2} and len(lines) == 4
    assert words(re.sub(r"\\(.)", r"\1", lines[2][0])) == told
    assert not re.search(r"(?<!\\)(\\\\)*[<>*_`&$~\[\]]", lines[2][0])

    (header, first, _) = cells_of(csv((table,)))
    plain_text = printable(text.replace("\r\n", "\n").replace("\r", "\n"))
    assert header[1] == first[0] and first[0].replace("'", "") == plain_text.replace("'", "")
    assert not FORMULA.search(first[0])

    html, clean = Html(fragment(summary)), Html(fragment(Summary("x", "x", (harmless, Note("x")))))
    assert html.elements == clean.elements and html.attributes.keys() - {"class"} == clean.attributes.keys() - {"class"}
    assert [words(each) for each in html.texts].count(told) >= 4


def test_no_text_ends_a_script_and_the_library_is_a_known_release():
    values = {"a": EVIL + "<!--<script>", "b": ["\u2028\u2029&<>", None, 1.5]}
    text = script_json(values)
    assert not set("<>&\u2028\u2029") & set(text)
    assert json.loads(text) == values
    library = (pages.FILES / pages.LIBRARY).read_bytes()
    assert hashlib.sha256(library).hexdigest() in DOCS.read_text(encoding="utf-8"), "the release named in the docs"
    for script in (file for file in pages.FILES.iterdir() if file.name.endswith(".js")):
        assert "</script" not in script.read_text(encoding="utf-8").lower(), script.name


LINE = Line(EVIL, (1e-3, 2e-3), (3.0, None))
POINTS = Scatter(EVIL, (1e-3,), (3.0,), words=(EVIL,), deviation=(1.0,), hollow=True)
BARS = Bars(EVIL, (1.0, None), labels=(EVIL, "-"), colours=("good", "bad"))
ARRAY = Line("packed", np.array([0.001, 0.002], np.float32), np.array([1, 3], np.float32), rows=(1, 2))
LEVELS = (Level(2.0, EVIL), Level(1e-3, EVIL, upright=True), Level(1.0, EVIL, 1e-3, 2e-3))
X = Axis(EVIL, MILLIMETRE, 1e-3, 2e-3, logarithmic=True)
PLOTS = (
    Plot("own-plot", EVIL, X, Axis("V"), (LINE, POINTS, ARRAY), LEVELS, (Band(1e-3, 2e-3, EVIL),)),
    Plot("square", EVIL, Axis("x"), Axis("z"), (LINE,), zoom=True, windows=(Window(EVIL, (0.0, 1.0)),), square=True),
    Plot("bars", EVIL, Axis(EVIL), Axis(names=(EVIL, "b"), inverse=True), (BARS, Bars("", (1.0, 2.0), stack="s"))),
    Plot("names", EVIL, Axis(names=(EVIL, "b")), Axis(EVIL), (POINTS, Line("", (0, 1), (1, 2), labels=(EVIL, "")))),
)
HEAT = Heat("map", EVIL, Axis(EVIL, names=(EVIL,)), Axis(names=("a", EVIL)), (Layer(EVIL, (1.0, None)),), (EVIL, None))
ARM = PosedArm("arm", (1.0, 1.0), "map", ((0.0, 1.0), None))
MOVED = Moved(EVIL, (0.1, 0.2), np.zeros((2, 5)), np.zeros((2, 3)), 1.0, (3.0, 4.0), (0.1, 0.2), ((EVIL, 0.0),))
MOTION = MovingArm("motion", "chosen", (1.0, 1.0), (("limit", 7e-3),), (MOVED,))
CHOICE = Choice("chosen", EVIL, ((EVIL, PLOTS[:1]), ("other", (Note(EVIL),))))
WHOLE = Page(
    EVIL,
    EVIL,
    (
        Panel("summary", EVIL, (Beside(((Headline(EVIL, 2.0, ((EVIL, 1.0),), EVIL),), (EVERY, Note(EVIL)))),)),
        Panel("more", EVIL, (Facts(EVIL, ((EVIL, EVIL),)), Commands(EVIL, ((EVIL, EVIL),)), CHOICE, *PLOTS[1:])),
        Panel("arms", EVIL, (Beside(((HEAT,), (ARM,)), equal=True), MOTION)),
    ),
)


def test_a_page_of_all_parts_escapes_them_and_admits_its_own_scripts_only():
    html = page_html(WHOLE)
    page = Html(html)
    assert page.elements["script"] == 3 and page.elements["img"] == 0 and page.active == [("href", "#content")]
    assert page.text.count(words(EVIL)) >= 14
    (data,) = map(json.loads, page.data)
    ids = set(re.findall(r' id="([^"]*)"', html))
    assert {*data["plots"], *data["heats"], *data["arms"], "stage", "pick-chosen"} <= ids, "every part has its place"
    assert [part.id for part in WHOLE.parts if isinstance(part, Plot)] == list(data["plots"])
    option = data["plots"]["own-plot"]["option"]
    assert option["series"][0]["data"] == [[1.0, 3.0], [2.0, None]], "in the unit shown"
    assert option["xAxis"]["name"] == f"{EVIL} [mm]" and data["texts"] == [EVIL]
    assert option["series"][2]["data"] == {"columns": [0, 1], "rows": [1, 2]}
    assert np.frombuffer(base64.b64decode(data["columns"][0]), "<f4").tolist() == [1.0, 2.0]
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)[1].replace("&#39;", "'")
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == "'none'"
    scripts = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    hashes = {"'sha256-" + base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() + "'" for s in scripts}
    assert set(rules["script-src"].split()) == hashes and len(hashes) == 2


def test_scripts_know_plots_and_no_document():
    """Whatever a document shows, it shows by the types of ``views/plot.py``: no script is one of a document."""
    there = {file.name for file in pages.FILES.iterdir() if file.name.endswith(".js")}
    assert there == {*pages.SCRIPTS, pages.LIBRARY, *pages.PLAYGROUND, pages.WORKER}
    assert not pages.SCRIPTS.keys() - {"page.js", "plot.js", "heat.js", "arm.js", "motion.js"}


def test_the_image_of_a_fragment_cannot_run_anything():
    data = b"\x89PNG <script>alert(1)</script>"
    ((name, source),) = Html(fragment(SUMMARY, data)).active
    assert name == "src"
    assert base64.b64decode(source.removeprefix("data:image/png;base64,")) == data


# The documents.

DOCUMENTS = documents(file=f"{EVIL}.fmu", path=EVIL, generation_tool=EVIL)
each_document = pytest.mark.parametrize("name", DOCUMENTS)


@each_document
def test_a_terminal_shows_every_number_whole_and_no_line_that_is_too_wide_but_commands(name):
    summary = DOCUMENTS[name].summary()
    notes = {part.text for part in summary.parts if isinstance(part, Note) and not part.warning}
    commands = {f"  {command}" for part in summary.parts if isinstance(part, Commands) for _, command in part.pairs}
    free = set(map(printable, notes | commands))
    for width in range(40, 201, 5):
        text = printed(summary, width=width)
        assert all(char.isprintable() or char == "\n" for char in text)
        assert [line for line in text.splitlines() if cell_len(line) > width and line not in free] == []
        for table in summary.tables:
            for place, column in enumerate(table.columns):
                if not table.is_text(place) and (width >= NARROW or not column.minor):
                    cells = (row[place] for row in (*table.rows, *table.footer) if row[place] is not None)
                    assert all(shown(cell, column.unit) in text for cell in cells), (width, column.name)


@each_document
def test_no_tabular_is_wider_than_the_text_and_none_loses_a_value(name):
    tables = DOCUMENTS[name].summary().tables
    text = latex(tables)
    for kinds, body in re.findall(r"\\begin\{tabular\}\{([^\n]*)\}\n(.*?)\\end\{tabular\}", text, re.DOTALL):
        columns = list(zip(*rows_of_latex(body), strict=True))
        widths = re.findall(r"[lr]|p\{\d+pt\}", kinds)
        assert len(widths) == len(columns)
        plain_cells = ([re.sub(r"\\textbf\{(.*)\}", r"\1", cell.strip()) for cell in column] for column in columns)
        longest = [max(len(from_latex(cell)) for cell in column) * CHARACTER for column in plain_cells]
        own = [float(kind[2:-3]) if kind[0] == "p" else most for kind, most in zip(widths, longest, strict=True)]
        assert sum(width + GAP for width in own) <= TEXT_WIDTH + 1
    cells = (re.sub(r"\\textbf\{(.*)\}", r"\1", cell.strip()) for row in rows_of_latex(text) for cell in row)
    values = Counter(map(from_latex, cells))
    expected = Counter(
        words(shown(cell, column.unit))
        for table in tables
        for row in (*table.rows, *table.footer)
        for column, cell in zip(table.columns, row, strict=True)
        if plain(cell) is not None
    )
    assert expected <= values


@each_document
def test_csv_and_markdown_of_every_document_have_whole_rows(name):
    tables = DOCUMENTS[name].summary().tables
    blocks = csv(tables).split("\n\n")
    assert len(blocks) == len(tables)
    for block, table in zip(blocks, tables, strict=True):
        rows = cells_of(block)
        assert len({len(row) for row in rows}) == 1 and len(rows) == 1 + len(table.rows) + len(table.footer)
        assert not any(FORMULA.search(cell) and not re.fullmatch(r"-[\d.e-]+", cell) for cell in itertools.chain(*rows))
        for line, row in zip(rows[1:], (*table.rows, *table.footer), strict=True):
            assert {repr(float(each)) for each in map(plain, row) if each is not None} <= {
                repr(float(cell)) for cell in line if re.fullmatch(r"-?[\d.e+-]*\d[\d.e+-]*", cell)
            }
    for part in markdown(tables).split("\n\n| ")[1:]:
        assert len({len(row) for row in rows_of_markdown(f"| {part}")}) == 1


CONCLUSIONS = {
    "evaluation": "✗ A1 to A3 are not met: c00.sticky.gain_1 (-90° / -180°) ended with error; V 140.7 (target 100, "
    "paper's PID 141), of which B7 (chirp error) costs most, 39 %, at -90° / 80°, system compliant.",
    "spread": "✓ A1 to A3 are met with all of 3 seeds; V 142.1 ± 1.41 (target 100), of which B7 (chirp error) costs"
    " most, 39 %.",
    "search": "✗ A2 and A3 fail for an arm within the tolerances: limit cycle, 421.0 µm at 23.7 Hz, with 6 of 8 "
    "seeds; V found, at least 170.0 (target 100, on the list 140.7), of which B7 (chirp error) costs "
    "most, 39 %.",
    "tuning": "✗ The best of 60 trials, number 20, holds A1 to A3 in paper; V 99 (start 162.5, target 100); on the "
    "strict list A2 fails; overfitted to the draws it was tuned with.",
    "sweep": "✓ 1 of 4 combinations hold A1 to A3; the best has V 90 (target 100), with K_0 = 1.",
    "sample": "✗ A2 fails in 1 of 5 draws, so at most 58.4 % of all draws do (confidence 0.9); V is above 120.0 in "
    "at most 50 % of all draws (target 100), and B6 costs most in the median, 40 %.",
    "verification": "✗ A1 to A3 are not met, A1 in 1 of 2 draws; V 140.7 ± 0 (target 100), of which B7 (chirp error) "
    "costs most, 39 %; not under the standard conditions: the protocol is not verification as it comes "
    "with the benchmark.",
    "comparison": "✓ PID [K=0.9] is first of 1 ranked, with V 126.7, and meets all requirements.",
}
"""What the pages of the documents of ``support.reports`` begin with."""


@pytest.mark.parametrize("name", CONCLUSIONS)
def test_a_page_begins_with_one_sentence_of_verdict_reason_and_cost_and_with_what_to_do_next(name):
    document = documents()[name]
    first = fromstring(page_html(document.page())).xpath("//main/section[1]/*[1]")[0]
    sentence, (steps,) = first.xpath("p")[0], first.xpath("ul")
    assert " ".join(sentence.text_content().split()) == CONCLUSIONS[name]
    targets = [step.get("data-panel") for step in steps.iter("button") if step.get("data-panel")]
    commands = [step.text_content() for step in steps.iter("code")]
    assert {*targets} <= {panel.id for panel in document.page().panels} and len(targets) + len(commands) >= 2
    assert all(command in [each.get("data-copy") for each in steps.iter("button")] for command in commands)


def test_a_good_controller_is_told_what_costs_most_and_a_search_without_failure_how_long_it_was():
    words = Evaluation(results_of()).page().conclusion
    assert words.passed and words.sentence.startswith(
        "A1 to A3 are met; V 140.7 (target 100, paper's PID 141), of which B7"
    )
    quiet = {name: replace(entry, passed=True) for name, entry in searched().requirements.items()}
    found = replace(searched(), requirements=quiet).page().conclusion
    assert found.sentence.startswith(
        "No failure of A1 and A2 was found (in 1990 simulations, 1200 of a budget of 2000 whole cases); "
        "V found, at least 200.0"
    )
    without = Evaluation(results_of(everything(TABLE_2)[:1])).page().conclusion
    assert (
        without.passed is None
        and "not judged" in without.sentence
        and "no V: of the protocol's 324" in without.sentence
    )


@each_document
def test_html_of_every_document_is_escaped_and_small(name):
    document = DOCUMENTS[name]
    notebook = document._repr_html_()
    piece, page = Html(notebook), Html(html := page_html(document.page()))
    assert len(notebook) < (2_000 * len(document) if name == "comparison" else SCREEN), "a screen; a group is a table"
    assert len(html.encode()) < 5e6
    assert not piece.elements.keys() & {"script", "img"} and piece.active == []
    assert page.elements["script"] == 3 and page.elements["img"] == 0 and page.active == [("href", "#content")]
    assert words(EVIL) in piece.text and words(EVIL) in page.text
    assert piece.elements["table"] == len(document.summary().tables)


@pytest.mark.parametrize("name", [*DOCUMENTS, "own"])
def test_every_plot_of_a_page_is_a_figure_of_matplotlib_as_well(name):
    parts = WHOLE.parts if name == "own" else DOCUMENTS[name].page().parts
    for part in parts:
        if isinstance(part, Plot | Heat):
            made = drawing.figure(part, (16, 12), titles=name == "own")
            assert drawing.png(made).startswith(b"\x89PNG")
            labels = [axes.get_xlabel() for axes in made.axes] + [axes.get_ylabel() for axes in made.axes]
            assert {drawing.symbols(axis.heading) for axis in (part.x, part.y)} <= set(labels), part.id


def test_symbols_of_the_paper_are_typeset_and_the_text_of_strangers_is_not():
    shown = {
        "u_m1 to q_m2": "$u_{m1}$ to $q_{m2}$",
        "Motor speed q̇_m [rad/s]": r"Motor speed $\dot{q}_{m}$ [rad/s]",
        "S_1, the other axis closed": "$S_{1}$, the other axis closed",
        "_$x_1$": r" _\$x_1\$",
        "u_m[1] of K_p[1] in q_m.fmu": "u_m[1] of K_p[1] in q_m.fmu",
    }
    assert {words: drawing.symbols(words) for words in shown} == shown


def test_what_is_long_shows_itself_short_and_a_plot_as_a_picture():
    cases = Evaluation(results_of()).cases
    assert len(cases) == 324 and len(repr(cases)) < 100 and len(cases._repr_html_()) < 6000
    assert cases[0].id in cases._repr_html_() and cases == results_of().cases
    assert drawing.Picture()._repr_png_().startswith(b"\x89PNG")


SCREEN = 12_000
"""Characters of a piece of HTML that is one screen high."""

NO_TABLE = {"Variation"}
"""Public types that a notebook shows by their ``repr``, which is one line."""


def test_every_public_type_shows_itself_in_a_notebook():
    public = {name: getattr(orchestrator, name) for name in orchestrator.__all__}
    types = {name for name, own in public.items() if isinstance(own, type) and not issubclass(own, Exception)}
    shown = {name for name in types if issubclass(public[name], Displayable)}
    assert shown == types - NO_TABLE and {"Benchmark", "Controller", "Evaluation", "Tuning"} <= shown
    assert repr(orchestrator.Variation(force=500.0)) == "Variation(force=500.0)"


def test_conditions_and_a_controller_are_one_screen_each(pid_file, tmp_path):
    controller = orchestrator.Controller(pid_file, {"K_p[1]": 61.5}, {"q_m[1]": "q_m[1]"}, 0.0005)
    for each in (orchestrator.Benchmark(), controller, orchestrator.Controller(tmp_path / "<b>.fmu")):
        assert 100 < len(each._repr_html_()) < SCREEN and "<b>.fmu" not in each._repr_html_()
    html = controller._repr_html_()
    assert "61.5" in html and "FMI 2.0" in html and "0.0005 s" in html
    assert "There is no file" in orchestrator.Controller(tmp_path / "none.fmu")._repr_html_()


@pytest.mark.parametrize(
    ("metres", "shown"), [(None, "-"), (1.24e-6, "1.24 µm"), (0.42103e-3, "421.0 µm"), (0.0400538, "40.1 mm")]
)
def test_a_limit_cycle_is_shown_in_the_unit_of_its_size(metres, shown):
    assert amplitude(metres) == shown
