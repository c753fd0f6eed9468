"""Where things are kept, and the name of what is made from sources: it changes with every change that can matter, and
with no other."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hostile.commands import command, finished

from orchestrator.folders import VARIABLE, cache_folder, source_hash


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


# ---- The cache folder ----


def test_the_cache_folder_is_where_the_variable_says(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "a" / "b"))
    assert cache_folder() == tmp_path / "a" / "b"
    assert cache_folder().is_dir()
    assert capsys.readouterr().err == ""


def test_a_temporary_folder_takes_the_place_of_one_that_cannot_be_written(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "cache"))
    folder = cache_folder()
    assert folder.is_dir() and tmp_path not in folder.parents
    told = capsys.readouterr().err
    assert told.startswith(
        f"warning: The cache folder {tmp_path / 'file' / 'cache'} cannot be written (Not a directory)"
    )
    assert VARIABLE in told and told.count("\n") == 1
    assert cache_folder() == folder == Path(os.environ[VARIABLE])  # children find it there
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(sys.platform != "linux", reason="a folder that nobody can make: /proc/nonexistent")
def test_a_command_runs_without_its_cache_folder_and_leaves_nothing(tmp_path):
    (tmp_path / "tmp").mkdir()
    environment = {VARIABLE: "/proc/nonexistent", "TMPDIR": str(tmp_path / "tmp")}
    done = finished(command(tmp_path / "out", "--only", "c00.compliant.noise"), environment=environment)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count(VARIABLE) == 1  # one line of one process, not one of each child
    assert list((tmp_path / "tmp").iterdir()) == []


@pytest.mark.skipif(shutil.which("bwrap") is None, reason="bubblewrap makes everything read-only")
def test_where_nothing_can_be_written(tmp_path):
    sandbox = ["bwrap", "--ro-bind", "/", "/", "--dev", "/dev", "--proc", "/proc", "--"]
    if subprocess.run([*sandbox, "true"], check=False, capture_output=True).returncode != 0:
        pytest.skip("bubblewrap may not work here")
    environment = {VARIABLE: str(tmp_path / "cache")}
    told = finished([*sandbox, sys.executable, "-m", "orchestrator.evaluate", "--help"], environment=environment)
    assert told.returncode == 0 and "--keep-going" in told.stdout
    refused = finished([*sandbox, *command(tmp_path / "out", "--quick")], environment=environment)
    assert refused.returncode == 2
    assert f"error: The cache folder {tmp_path / 'cache'} cannot be written (Read-only file system)" in refused.stderr
    assert f"Set {VARIABLE}" in refused.stderr
