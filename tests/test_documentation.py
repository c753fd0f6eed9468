"""The documentation says what is, and its code runs as it stands there, with a smaller protocol than ``quick``."""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from fmpy import read_model_description

import orchestrator
from orchestrator.benchmark.protocol import load
from orchestrator.cli.main import COMMANDS
from orchestrator.documents.case_file import SCHEMA
from orchestrator.documents.document import Document
from orchestrator.documents.results import Results

ROOT = Path(__file__).resolve().parents[1]
ONE_POSE = 'extends = "quick"\nname = "one pose"\n[grid]\nq_a1_points = 1\nq_a2_points = 1\n'


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


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


def test_the_example_of_a_protocol_file_has_the_two_configurations_that_the_page_says(tmp_path: Path) -> None:
    (example,) = re.findall(r"^```toml\n(.*?)^```", text("docs/protocol.md"), re.DOTALL | re.MULTILINE)
    (tmp_path / "mine.toml").write_text(example)
    protocol = load(tmp_path / "mine.toml")
    assert protocol.grid.size == 2 and protocol.disturbance.force == 800.0


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


COMMAND = re.compile(r"(\$ )?(python|flexible-manipulator|\.venv|pip|git|sh|bash|\. )")
"""Begins a line of a page that is pasted into a shell."""

SHELL = ("", "sh", "bash", "console")
"""Fences around these."""


def commands_of(page: str) -> list[str]:
    """The commands in the code of a page, fenced or indented, each with the lines that it goes on in."""
    found: list[str] = []
    fence, open_ = None, False
    for line in text(page).splitlines():
        if begin := re.match(r"\s*```(\w*)", line):
            fence, open_ = begin[1] if fence is None else None, False
        elif open_:
            found[-1] = f"{found[-1].removesuffix(chr(92)).rstrip()} {line.strip()}"
            open_ = unfinished(found[-1])
        elif COMMAND.match(line.strip()) and (fence in SHELL or fence is None and line.startswith("    ")):
            found.append(line.strip())
            open_ = unfinished(found[-1])
    return found


def unfinished(command: str) -> bool:
    """Whether a command goes on in the next line."""
    try:
        shlex.split(command, comments=True)
    except ValueError:
        return True
    return False


PAGES = sorted(
    str(page.relative_to(ROOT))
    for folder in ("docs", "examples", "controller_fmu", "plant_fmu", ".")
    for page in (ROOT.glob("*.md") if folder == "." else (ROOT / folder).rglob("*.md"))
    if page.name != "CHANGELOG.md"
)


@pytest.mark.parametrize("page", [page for page in PAGES if commands_of(page)])
def test_a_line_that_is_pasted_holds_a_command_and_nothing_else(page: str) -> None:
    """What explains it is a comment: "(or C)" ended 23 lines in a syntax error."""
    for line in commands_of(page):
        words = shlex.split(line, comments=True)  # no quote is left open
        assert not re.search(r"\S\s{2,}[^#\s]", line.split("#")[0].strip()), line
        prose = [word for word in words[3:] if re.fullmatch("[a-z]+", word)]
        assert not (len(prose) >= 2 and words[-2:] == prose[-2:]), line
