"""Where things are kept, and the name of what is made from sources: it changes with every change that can matter, and
with no other."""

import ast
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from hostile.commands import command, finished
from support.refusals import refusal
from test_rooms import imported, modules

from orchestrator import cache
from orchestrator.cache import (
    VARIABLE,
    cache_folder,
    closure,
    compiled_code_folder,
    drop_damaged_code,
    is_compiled,
    note_compiled,
    source_hash,
)
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


def without_types(file: Path) -> str:
    """The source of a module without the imports that are for type checkers alone."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = [ast.Pass()]
    return ast.unparse(tree)


def test_the_closure_has_all_that_import_statements_name():
    """Against the parser: the closure looks for lines that begin like an import."""
    files = {module.removesuffix(".__init__"): file for module, file in modules()}
    for name, file in files.items():
        names = imported(f"{name}.__init__" if file.stem == "__init__" else name, without_types(file))
        named = {name if name in files else name.rpartition(".")[0] for name in names}
        assert named & {*files} <= {*cache._imports(name, file)}, name


CASE = """
import sys
from pathlib import Path
from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.cases import cases
from orchestrator.codec import pack
from orchestrator.execution import worker
from orchestrator.fmi.archive import open_archive
from orchestrator.fmi.slaves import load
from orchestrator.loop.setup import Setup
from orchestrator.pairing import work
from plant_fmu.flexible_manipulator.parameters import NOMINAL

before = {*sys.modules}
work.prepare()
quick = protocols.load("quick")
case = cases(quick, NOMINAL, 0)[0]
plant, controller = (load(open_archive(Path(file))) for file in sys.argv[1:])
work.judge_case(plant, controller, pack(work.CaseTask(quick, Setup(), case)))
for name, module in list(sys.modules.items()):
    file = getattr(module, "__file__", None)
    if name.startswith(("orchestrator.", "plant_fmu.", "controller_fmu.", "build_fmus")) and file:
        print(file)
"""


ASKING = ("benchmark/cases.py", "benchmark/linearization.py", "version.py")
"""What the program above or the package itself needs, and no worker."""


@pytest.mark.parametrize("build", [("plant_file", "pid_file"), ("quick_plant_file", "quick_pid_file")])
def test_whatever_a_case_loads_is_in_the_closure(build, request):
    """Also what is loaded by its name, which no import statement shows."""
    files = [str(request.getfixturevalue(name)) for name in build]
    done = subprocess.run([sys.executable, "-c", CASE, *files], capture_output=True, text=True, check=True)
    loaded = {Path(line) for line in done.stdout.splitlines()} - {cache.PACKAGE / name for name in ASKING}
    assert len(loaded) > 50
    assert loaded <= {*closure(*cache.COMPUTING)}


def test_damaged_files_of_compiled_code_are_removed(tmp_path, caplog):
    """After a power cut 105 of 110 files had no byte, and each start of each command failed, for good."""
    whole = pickle.dumps("machine code")
    damaged = {"a.nbi": b"", "inner/b.1.nbc": whole[:-1], "c.1.nbc": bytes(len(whole)), "d.nbi": whole[1:]}
    kept = {"e.nbi": whole + whole, "inner/f.1.nbc": whole, "g.1.nbc.tmp.1": b"", "h.txt": b""}
    for name, content in {**damaged, **kept}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    note_compiled(tmp_path, "work")
    assert is_compiled(tmp_path, "work") and not is_compiled(tmp_path, "other")
    for count in (1, 1):
        drop_damaged_code(tmp_path)
        assert {file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*") if file.is_file()} == {*kept}
        assert len(caplog.records) == count and not is_compiled(tmp_path, "work")
    note_compiled(tmp_path, "work")
    drop_damaged_code(tmp_path)
    assert is_compiled(tmp_path, "work")


@pytest.mark.parametrize("same_time", [True, False])
def test_one_byte_of_compiled_code_that_is_another_is_told(tmp_path, same_time):
    """It begins and ends as before: in a sandbox the controller was told to have crashed. What Numba has written since
    is another file."""
    file, content = tmp_path / "a.1.nbc", pickle.dumps("machine code")
    file.write_bytes(content)
    note_compiled(tmp_path, "work")
    written = file.stat().st_mtime_ns
    file.write_bytes(content.replace(b"code", b"coda"))
    os.utime(file, ns=(written, written if same_time else written + 1))
    drop_damaged_code(tmp_path)
    assert (file.exists(), is_compiled(tmp_path, "work")) == (not same_time, not same_time)


def test_compiled_code_of_which_a_file_is_gone_is_compiled_again(tmp_path):
    (tmp_path / "a.1.nbc").write_bytes(pickle.dumps("machine code"))
    note_compiled(tmp_path, "work")
    mark = next(tmp_path.glob("*.compiled"))
    assert is_compiled(tmp_path, "work") and [file.name for file in tmp_path.iterdir() if file.suffix == ".part"] == []
    (tmp_path / "a.1.nbc").unlink()
    assert not is_compiled(tmp_path, "work")
    mark.write_bytes(b"")  # of a power cut
    assert not is_compiled(tmp_path, "work")
    drop_damaged_code(tmp_path)


@pytest.mark.parametrize(
    "other",
    [
        lambda patch, folder: patch.setenv("NUMBA_CPU_NAME", "generic"),
        lambda patch, folder: patch.setattr(cache, "_processor", lambda: ["flags: sse2"]),
        lambda patch, folder: patch.setattr(sys, "version", "3.99.0"),
        lambda patch, folder: patch.setattr(cache.metadata, "version", lambda name: "0.99"),
        lambda patch, folder: patch.setattr(cache, "__file__", str(folder / "cache.py")),
    ],
)
def test_compiled_code_that_numba_does_not_find_is_not_said_to_be_there(other, monkeypatch, tmp_path):
    """With another Python, place or processor, each worker in a sandbox compiled on the time of its controller: a PID
    had timeouts in all cases."""
    before = cache._compiled_code.__wrapped__()
    assert cache._compiled_code.__wrapped__() == before
    other(monkeypatch, tmp_path)
    assert cache._compiled_code.__wrapped__() != before


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
