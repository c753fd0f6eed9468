"""Where things are kept, and the name of what is made from sources: it changes with every change that can matter, and
with no other."""

import pytest
from hostile.commands import command, finished
from support.refusals import refusal

from orchestrator import cache
from orchestrator.cache import VARIABLE, cache_folder, compiled_code_folder, source_hash
from orchestrator.errors import EnvironmentFault


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


def test_the_cache_folder_is_where_the_variable_says(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "a" / "b"))
    assert cache_folder() == tmp_path / "a" / "b"
    assert cache_folder().is_dir()
    assert compiled_code_folder().is_relative_to(tmp_path / "a" / "b")
    assert not caplog.records


def test_a_temporary_folder_takes_the_place_of_one_that_is_not_writable(tmp_path, monkeypatch, caplog):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "cache"))
    folder = cache_folder()
    assert folder.is_dir() and tmp_path not in folder.parents
    assert cache_folder() == folder
    (record,) = caplog.records  # one, however often it is asked for
    assert record.levelname == "WARNING" and VARIABLE in record.getMessage()


def test_fmus_in_python_are_kept_from_folders_with_which_they_crash(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "Jörg"))
    folder = cache_folder()
    assert folder.is_dir() and str(folder).isascii() and tmp_path not in folder.parents
    assert "ASCII" in caplog.text and VARIABLE in caplog.text


def test_without_a_temporary_folder_either_the_machine_is_at_fault(tmp_path, monkeypatch):
    def unwritable(*_arguments, **_keywords):
        raise OSError("Read-only file system")

    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "other"))
    monkeypatch.setattr(cache.tempfile, "mkdtemp", unwritable)
    assert refusal(cache_folder, kind=EnvironmentFault).what == "no-cache"


@pytest.mark.slow
@pytest.mark.needs("linux")  # a folder that nobody can make: /proc/nonexistent
def test_a_command_runs_without_its_cache_folder_and_leaves_nothing(tmp_path):
    (tmp_path / "tmp").mkdir()
    environment = {VARIABLE: "/proc/nonexistent", "TMPDIR": str(tmp_path / "tmp")}
    done = finished(command(tmp_path / "out", "--only", "c00.compliant.noise"), environment=environment)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count(VARIABLE) == 1  # one line of one process, not one of each child
    assert list((tmp_path / "tmp").iterdir()) == []
