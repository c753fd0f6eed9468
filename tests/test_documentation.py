"""The documentation says what is, and its code runs as it stands there, with a smaller protocol than ``quick``."""

import argparse
import contextlib
import io
import re
import shlex
import shutil
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from fmpy import read_model_description
from support.pages import PAGES, PROGRAMS, ROOT, command_lines, simple_commands, text

import build_fmus
import orchestrator
from controller_fmu.export.__main__ import main as export
from orchestrator.benchmark.protocol import load
from orchestrator.cli import verify
from orchestrator.cli.main import COMMANDS, main
from orchestrator.documents.case_file import SCHEMA
from orchestrator.documents.document import Document
from orchestrator.documents.results import Results
from orchestrator.recheck.__main__ import main as recheck

ONE_POSE = 'extends = "quick"\nname = "one pose"\n[grid]\nq_a1_points = 1\nq_a2_points = 1\n'


def run_code(text: str, name: str) -> dict[str, object]:
    """Run the blocks of code of a page; what they defined."""
    scope: dict[str, object] = {}
    for block in re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        exec(compile(block, name, "exec"), scope)
    return scope


@pytest.fixture
def folder(quick_pid_file: Path, quick_plant_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a controller, the plant, and the protocol."""
    (tmp_path / "build" / "fmus").mkdir(parents=True)
    shutil.copy(quick_plant_file, tmp_path / "build" / "fmus")
    shutil.copy(quick_pid_file, tmp_path / "my_controller.fmu")
    (tmp_path / "quick.toml").write_text(ONE_POSE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def smaller(code: str) -> str:
    return code.replace('"quick"', '"quick.toml"')


@pytest.mark.slow
def test_code_of_the_page_on_python(folder: Path) -> None:
    scope = run_code(smaller(text("docs/python.md")), "docs/python.md")
    assert (folder / "report.html").stat().st_size > 100_000
    assert (folder / "figures" / "figure_09_force.pdf").is_file() and (folder / "case.png").is_file()
    assert len(scope["table"]) == 6  # type: ignore[arg-type]


@pytest.mark.needs("compiler")
def test_code_of_the_page_on_the_plant(folder: Path) -> None:
    scope = run_code(text("docs/plant.md"), "docs/plant.md")
    assert 1e-5 < np.ptp(scope["pushed"]["X[1]"]) < 1.0  # type: ignore[index]


@pytest.mark.slow
def test_code_of_the_page_on_design(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its LQG meets the target and the requirements, with the numbers that the page gives."""
    monkeypatch.chdir(tmp_path)
    evaluation = run_code(text("docs/design.md"), "docs/design.md")["evaluation"]
    assert f"V = {evaluation.cost:.0f} " in text("docs/design.md")  # type: ignore[attr-defined]
    assert all(requirement.passed for requirement in evaluation.requirements.values())  # type: ignore[attr-defined]
    assert (tmp_path / "model.mat").is_file()


@pytest.mark.slow
@pytest.mark.needs("nbclient", "nbformat")
def test_notebook(folder: Path) -> None:
    import nbclient
    import nbformat

    (folder / "my_controller.fmu").unlink()  # it runs as it is shipped
    notebook = nbformat.read(ROOT / "examples" / "first_steps.ipynb", as_version=4)
    for cell in notebook.cells:
        cell.source = smaller(cell.source)
    nbclient.NotebookClient(notebook, kernel_name="python3").execute()
    shown = [output.get("data", {}) for cell in notebook.cells for output in cell.get("outputs", ())]
    assert any("<table" in data.get("text/html", "") and "V" in data["text/html"] for data in shown)
    assert any("image/png" in str(data) for data in shown)


def documented(heading: str) -> dict[str, tuple[str, str, str, tuple[float, ...]]]:
    """Causality, variability, unit and starts by variable, from the table below ``heading``."""
    rows = {}
    for line in text("docs/interface.md").split(f"## {heading}\n")[1].split("\n## ")[0].splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        for number, name in enumerate(re.findall(r"`([^`]+)`", cells[0])):
            starts = tuple(float(word) for word in cells[4].split(", ") if word)
            rows[name] = (*cells[1:4], starts[min(number, len(starts) - 1) :][:1])
    return rows


@pytest.mark.parametrize(
    ("heading", "file"), [("The plant FMU's variables", "plant_file"), ("The default PID's variables", "pid_file")]
)
def test_the_interface_page_lists_every_variable_as_it_is(heading, file, request):
    described = {
        v.name: (v.causality, v.variability, v.unit, (pytest.approx(float(v.start), rel=1e-5),) if v.start else ())
        for v in read_model_description(str(request.getfixturevalue(file))).modelVariables
    }
    assert documented(heading) == described


def test_the_package_page_has_no_link_or_picture_that_leads_nowhere_on_an_index():
    (page,) = re.findall(r'^readme = "(.+?)"', text("pyproject.toml"), re.MULTILINE)
    links = re.findall(r"\]\(([^)]*)\)", text(page))
    assert links and [link for link in links if not link.startswith("https://")] == []


def test_the_citation_has_this_version_and_the_paper_as_on_its_page():
    citation = yaml.safe_load(text("CITATION.cff"))
    assert citation["version"] == orchestrator.__version__
    paper = citation["preferred-citation"]
    *others, last = [f"{each['given-names'][0]}. {each['family-names']}" for each in paper["authors"]]
    where = f"{paper['conference']['name']} {paper['year']}, {paper['conference']['city']}"
    assert f'{", ".join(others)} and {last}, "{paper["title"]}", {where}' in " ".join(text("docs/paper.md").split())


def test_changelog_and_release_notes_begin_with_this_version():
    citation = yaml.safe_load(text("CITATION.cff"))
    version, date = citation["version"], citation["date-released"]
    assert f"\n## {version} ({date})\n" in text("CHANGELOG.md")
    assert f"\n## Version {version} ({date.day} {date:%B %Y})\n" in text("docs/release-notes.md")


def test_the_page_on_stability_lists_the_forms_that_are_written():
    documents = (Results, *(getattr(orchestrator, name) for name in orchestrator.__all__))
    kinds = {kind for kind in documents if isinstance(kind, type) and issubclass(kind, Document)}
    rows = re.findall(r"^\| .*?`([\w*.]+)` \| `(flexible-manipulator-.+?)` \|", text("docs/stability.md"), re.MULTILINE)
    assert dict(rows) == {"case*.npz": SCHEMA} | {kind.FILE: kind.SCHEMA for kind in kinds}


def test_the_readme_is_short_and_has_the_two_commands():
    lines = text("README.md").splitlines()
    assert len(lines) <= 110
    commands = {mark: lines[lines.index(f"<!-- {mark} -->") + 2] for mark in ("run", "test")}
    assert commands["run"].endswith("-m orchestrator.evaluate") and " -m pytest " in commands["test"]
    assert (ROOT / "docs" / "pictures" / "disturbance.gif").stat().st_size < 1.5e6


def test_the_examples_of_protocol_files_are_what_the_page_says(tmp_path: Path) -> None:
    examples = re.findall(r"^```toml\n(.*?)^```", text("docs/protocol.md"), re.DOTALL | re.MULTILINE)
    for number, example in enumerate(examples):
        (tmp_path / f"{number}.toml").write_text(example)
    own, same_force = (load(tmp_path / f"{number}.toml") for number in range(2))
    assert own.grid.size == 2 and own.disturbance.force == 800.0
    (test,) = same_force.tests
    assert (test.again.number, test.again.turn_deg) == (30, 0.0) and same_force.grid.size == 4


def test_commands_are_listed_on_their_page_and_in_the_readme() -> None:
    listed = {name for row in re.findall(r"^\| (`.+?) \|", text("README.md"), re.MULTILINE) for name in row.split(", ")}
    for command in COMMANDS:
        assert f"`{command}`" in listed and f"flexible-manipulator {command}" in text("docs/commands.md")


@pytest.mark.parametrize(
    "page", ["robustness", "publishing", "rules", "exporting", "design", "policies", "tuning", "python"]
)
def test_pages_with_symbols_link_to_their_explanation(page: str) -> None:
    assert "](manipulator.md#" in text(f"docs/{page}.md")


def test_the_ideas_are_few_and_where_they_are_said_to_be() -> None:
    """CONTRIBUTING's table is the map of the code: at most 25 lines, and each place exists."""
    root = Path(__file__).parents[1]
    text = (root / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \*\*.*$", text.partition("## Rooms")[0], re.MULTILINE)
    places = [place for row in rows for place in re.findall(r"`([\w/]+(?:\.py|/))`", row)]
    assert 0 < len(rows) <= 25 and len(places) >= len(rows)
    assert [
        place for place in places if not any((root / above / place).exists() for above in ("", "orchestrator"))
    ] == []


class Parsed(Exception):
    """A command line was understood; nothing was run."""

    def __init__(self, given: argparse.Namespace) -> None:
        self.given = given


Program = Callable[[list[str]], object]
Understood = Callable[[Program, list[str]], dict[str, Any]]


@pytest.fixture
def understood(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Understood:
    """What the words behind a program's name mean to its own parser."""
    parse = argparse.ArgumentParser.parse_args

    def stop(self: argparse.ArgumentParser, words: list[str]) -> None:
        raise Parsed(parse(self, words))

    def given(program: Program, words: list[str]) -> dict[str, Any]:
        with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(out):
            try:
                program(words)
            except Parsed as found:
                return vars(found.given)
            except SystemExit:
                pass
        assert out.getvalue().startswith("usage: "), (words, out.getvalue())  # or the help was asked for
        return {}

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", stop)
    monkeypatch.setattr(verify, "is_clean", lambda: True)  # else the words are parsed in another process
    return given


PYTHON = re.compile(r"(\.venv/bin/)?python3?")

MODULES: dict[str, Program] = {
    "orchestrator.evaluate": lambda words: main(["evaluate", *words]),
    "orchestrator.recheck": recheck,
    "controller_fmu.export": export,
}
"""Programs of this package that ``python -m`` starts."""

MADE = ("backup", "output_dir", "out", "output", "plots", "export_ssp", "data", "fmu")
"""Options that name a file or a folder which the command makes."""

FILE = re.compile(r"[^=:]+\.(fmu|toml|json|mat|npz|onnx|ssv|ssm|ssp|py)")

OWN = re.findall(r"`(.+?)`", text("docs/commands.md").split("## Names of your own")[1].split("\n## ")[0])
"""Names that stand for the reader's own."""

RUNS_OF = {"*", *build_fmus.KNOWN, *(Path(name).stem for name in OWN)}
"""Controllers of which the reader may have a run."""


def files_of(given: dict[str, Any]) -> Iterator[str]:
    """The files and folders that a command reads."""
    for name, value in given.items():
        for each in value if isinstance(value, list | tuple) else [value]:
            if name not in MADE and (isinstance(each, Path) or isinstance(each, str) and FILE.fullmatch(each)):
                yield str(each)


def files_and_made(words: list[str], understood: Understood) -> tuple[list[str], list[str]]:
    """The files that a command reads, and those, folders and first words of folders that it makes; its words are those
    that its program understands."""
    program, *rest = words
    if program == "flexible-manipulator":
        given = understood(main, rest)
        made = [str(given[name]) for name in MADE if given.get(name)]
        if rest[0] == "new":
            folder = str(given["folder"])
            return ([folder], made) if given["out"] else ([], [folder])
        if rest[0] == "build":
            return [word for word in given["what"] if word not in build_fmus.KNOWN], made
        besides = given["beside"] if rest[0] == "simulate" else []
        read = [
            *files_of(given),
            *(file for other in besides for file in files_of(understood(main, ["simulate", *shlex.split(other)]))),
        ]
        return read, [*made, *(f"runs/{Path(file).stem}" for file in read if file.endswith(".fmu"))]
    if program == "cp":
        return rest[:-1], []
    if not PYTHON.fullmatch(program) or rest[0] == "-c":
        return [], []
    if rest[0] == "build_fmus.py":
        given = understood(build_fmus.main, rest[1:])
        return [], [str(given["output_dir"])]
    if rest[:2] == ["-m", "pytest"]:
        return [word for word in rest if word.startswith("tests/")], []
    if rest[0] == "-m":
        given = understood(MODULES[rest[1]], rest[2:]) if rest[1] in MODULES else {}
        return [*files_of(given)], [str(given[name]) for name in MADE if given.get(name)]
    assert all(f'"{word}"' in text(rest[0]) for word in rest if word.startswith("--")), words
    return rest[:1], []


def is_there(file: str, made: list[str]) -> bool:
    """Whether a command finds a file: in the repository, made before, or the reader's own."""
    run = re.match(r"runs/([A-Za-z_*]+)(-|$)", file)
    built = re.fullmatch(r"build/fmus/(\w+)\.fmu", file)
    return (
        file in (*OWN, *made)
        or file.startswith(tuple(f"{each}/" for each in made))
        or (ROOT / file).exists()
        or (run is not None and (run[1] in RUNS_OF or f"runs/{run[1]}" in made))
        or (built is not None and built[1] in build_fmus.KNOWN)
    )


def check_lines(lines: Iterable[str], made: list[str], understood: Understood) -> None:
    """Check that the lines run when they are pasted one after the other, where there is already what is ``made``."""
    for line in lines:
        bare = re.sub(r"'[^']*'|\"[^\"]*\"", "''", line.partition(" #")[0])
        assert "[" not in bare, f"a pattern to some shells: {line}"
        assert not re.search(r"\S\s{2,}[^#\s]", bare), f"no comment: {line}"
        for words in simple_commands(line):
            assert words[0] in PROGRAMS or re.match("[A-Z_]+=", words[0]), line
            read, makes = files_and_made(words, understood)
            assert [file for file in read if not is_there(file, made)] == [], line
            made = [*made, *makes]


@pytest.mark.parametrize("page", PAGES)
def test_every_line_that_is_pasted_is_a_command_that_is_understood(page: str, understood: Understood) -> None:
    """By the parser of its program; its files were made by a line before it, are in the repository, or stand for the
    reader's own. What explains a line is a comment: "(or C)" ended 23 lines in a syntax error."""
    # What a page's Python writes, its commands find.
    code = re.findall(r"^```python\n(.*?)^```", text(page), re.DOTALL | re.MULTILINE)
    check_lines(command_lines(text(page)), re.findall(r'"([^"\s]+\.fmu)"', "".join(code)), understood)
    prose = re.sub(r"^```.*?^```", "", text(page), flags=re.DOTALL | re.MULTILINE)
    for words in re.findall(r"`flexible-manipulator ([a-z]+ [^`]+)`", prose):
        if "..." not in words:
            understood(main, shlex.split(words))


HELPS: dict[str, Program] = {
    **{name: partial(lambda name, words: main([name, *words]), name) for name in COMMANDS},
    **MODULES,
}


@pytest.mark.parametrize("name", HELPS)
def test_every_example_of_the_help_is_a_command_that_is_understood(name: str, understood: Understood) -> None:
    with contextlib.redirect_stdout(io.StringIO()) as told, pytest.raises(SystemExit):
        HELPS[name](["--help"])
    examples = re.findall(r"^  ((?:flex|python|eval).*)", told.getvalue().partition("examples:\n")[2], re.MULTILINE)
    assert examples
    check_lines(examples, ["my_controller", "results"], understood)


OWN_NAME = re.compile(rf"python3? -m orchestrator\.({'|'.join(COMMANDS)})\b")


def test_commands_have_one_name() -> None:
    """``flexible-manipulator``, with the exceptions that CONTRIBUTING gives the reason for."""
    entries = {f"orchestrator/{name}.py" for name in COMMANDS}
    exceptions = {"README.md", "docs/index.md", "CHANGELOG.md"} | entries
    folders = ("docs", "examples", "controller_fmu", "plant_fmu", "orchestrator", "benchmarks")
    files = [*ROOT.glob("*.md"), *(file for folder in folders for file in (ROOT / folder).rglob("*.*"))]
    found = {
        str(file.relative_to(ROOT))
        for file in files
        if file.suffix in (".md", ".py", ".js", ".html", ".json", ".ipynb", ".toml")
        and OWN_NAME.search(file.read_text(encoding="utf-8"))
    }
    assert entries <= found <= exceptions
    for page in ("README.md", "docs/index.md"):
        assert len(OWN_NAME.findall(text(page))) == 1
