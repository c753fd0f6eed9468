"""The code of docs/python.md and of the notebook runs as it stands there, with a smaller protocol than ``quick``."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ONE_POSE = 'extends = "quick"\nname = "one pose"\n[grid]\nq_a1_points = 1\nq_a2_points = 1\n'


@pytest.fixture
def folder(pid_c_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a controller and the protocol."""
    shutil.copy(pid_c_file, tmp_path / "my_controller.fmu")
    (tmp_path / "quick.toml").write_text(ONE_POSE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def smaller(code: str) -> str:
    return code.replace('"quick"', '"quick.toml"')


@pytest.mark.slow
def test_code_of_the_page(folder: Path) -> None:
    text = smaller((ROOT / "docs" / "python.md").read_text(encoding="utf-8"))
    scope: dict[str, object] = {}
    for block in re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        exec(compile(block, "docs/python.md", "exec"), scope)
    assert (folder / "report.html").stat().st_size > 100_000
    assert (folder / "figures" / "figure_09_force.pdf").is_file() and (folder / "case.png").is_file()
    assert len(scope["table"]) == 6  # type: ignore[arg-type]


@pytest.mark.slow
def test_notebook(folder: Path) -> None:
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    notebook = nbformat.read(ROOT / "examples" / "first_steps.ipynb", as_version=4)
    for cell in notebook.cells:
        cell.source = smaller(cell.source)
    nbclient.NotebookClient(notebook, kernel_name="python3").execute()
    shown = [output.get("data", {}) for cell in notebook.cells for output in cell.get("outputs", ())]
    assert any("<table" in data.get("text/html", "") and "V" in data["text/html"] for data in shown)
    assert any("image/png" in data or "image/svg+xml" in str(data) for data in shown)
