"""The name of what is made from sources: it changes with every change that can matter, and with no other."""

from __future__ import annotations

import pytest

from orchestrator.folders import source_hash


@pytest.fixture
def sources(tmp_path):
    """A folder of two modules, one in a subfolder, and compiled code."""
    folder = tmp_path / "package"
    (folder / "inner" / "__pycache__").mkdir(parents=True)
    (folder / "a.py").write_text("a = 1\n")
    (folder / "inner" / "b.py").write_text("b = 2\n")
    (folder / "inner" / "__pycache__" / "b.pyc").write_bytes(b"\0")
    return folder


@pytest.mark.parametrize(
    "change",
    [
        lambda folder: (folder / "a.py").write_text("a = 2\n"),
        lambda folder: (folder / "inner" / "b.py").write_text("b = 3\n"),
        lambda folder: (folder / "inner" / "b.py").rename(folder / "inner" / "c.py"),
        lambda folder: (folder / "inner" / "b.py").rename(folder / "b.py"),
        lambda folder: (folder / "a.py").unlink(),
        lambda folder: (folder / "new.py").write_text(""),
        # The same bytes in a row, cut elsewhere.
        lambda folder: ((folder / "a.py").write_text(""), (folder / "inner" / "b.py").write_text("a = 1\nb = 2\n")),
    ],
)
def test_every_change_of_a_source_changes_the_hash(change, sources):
    before = source_hash([sources])
    change(sources)
    assert source_hash([sources]) != before


def test_compiled_code_and_place_do_not_matter(sources, tmp_path):
    before = source_hash([sources])
    (sources / "inner" / "__pycache__" / "b.pyc").write_bytes(b"\1")
    (tmp_path / "elsewhere").mkdir()
    moved = sources.rename(tmp_path / "elsewhere" / "package")
    assert source_hash([moved]) == before
