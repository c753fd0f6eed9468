"""In the sandbox a controller reaches neither the network nor the user's files, and gives the same numbers."""

from __future__ import annotations

import errno
import os
import shutil
import socket
import stat
import subprocess
import sys
import tempfile
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import psutil
import pytest
from hostile import fmus
from hostile.commands import ROOT, command, finished, kill, started, wait_for
from hostile.runs import STRUCK, bench, run, short_cases

from orchestrator.cosim.trajectory import Status
from orchestrator.errors import InputError
from orchestrator.execution import evaluation, sandbox
from orchestrator.execution.evaluation import simulate_isolated
from orchestrator.execution.isolation import run_isolated
from orchestrator.execution.job import Finished, Job


def problem() -> str:
    """Why there is no sandbox here; empty where there is one."""
    program = shutil.which("bwrap")
    if program is None:
        return "bubblewrap is not installed"
    tried = subprocess.run([program, *sandbox.OPTIONS, "--", "true"], capture_output=True, text=True, check=False)
    return "" if tried.returncode == 0 else f"bubblewrap may not work here: {tried.stderr.strip()}"


REPORT = 6
PROBLEM = problem()
sandboxed = pytest.mark.skipif(bool(PROBLEM), reason=PROBLEM or "-")


@pytest.fixture(scope="module")
def slave(fmu_folder) -> Path:
    """The FMU of ``tests/hostile/slave.py``."""
    return fmus.python_fmu(fmu_folder)


@pytest.fixture
def own(plant_file, pid_file):
    """The plant with the default controller."""
    return bench(plant_file, pid_file, limit=120.0)


@pytest.fixture
def work_from(tmp_path_factory, monkeypatch):
    """A function that makes a module of a text, in a hidden folder, and returns its function ``work``."""

    def make(text: str):
        folder = tmp_path_factory.mktemp("module")
        name = f"lies_in_tmp_{folder.name}"
        (folder / f"{name}.py").write_text(text)
        monkeypatch.syspath_prepend(str(folder))
        return import_module(name).work

    return make


def inside(own, work, task):
    """What ``work`` returns for ``task`` in a sandbox."""
    (outcome,) = run_isolated(Job(own.plant, own.controller, (task,), work, (120.0,), sandbox=True))
    assert isinstance(outcome, Finished), outcome
    return outcome.value


def with_fault(own, fault: int, **changes):
    """The bench whose controller has this fault."""
    return replace(own, setup=replace(own.setup, parameters={"fault": float(fault)}), **changes)


@sandboxed
def test_the_sandbox_stops_what_is_allowed_without_it(plant_file, slave, tmp_path, monkeypatch):
    """The controller connects to a server on this machine, reads where it may, and writes into the user's home."""
    monkeypatch.setenv("HOME", str(tmp_path))
    own = bench(plant_file, slave, limit=120.0)
    (case,) = short_cases(own.plant, (STRUCK,))
    reports = {}
    for boxed in (False, True):
        (result,) = run(with_fault(own, REPORT, sandbox=boxed), [case])
        assert result.status is Status.ERROR
        reports[boxed] = result.message
    assert "home: written" in reports[False]
    assert "own folder: written" in reports[False]
    assert "home: refused" in reports[True]
    assert "network: refused" in reports[True]
    assert "processes: 3 or fewer" in reports[True]
    assert "temporary files: written" in reports[True]


@sandboxed
def test_the_numbers_are_the_same(plant_file, pid_file):
    own = bench(plant_file, pid_file, limit=120.0)
    scenario = short_cases(own.plant, (STRUCK,))[0].scenario
    free, boxed = (simulate_isolated(scenario, replace(own, sandbox=option)) for option in (False, True))
    assert free.torque.tobytes() == boxed.torque.tobytes()
    assert free.X.tobytes() == boxed.X.tobytes()


@sandboxed
def test_what_python_needs_of_the_hidden_folder_is_there(own, work_from):
    """The sandbox has a /tmp of its own; a package that lies in the outer one is found all the same."""
    work = work_from("def work(plant, controller, task):\n    return task + 1\n")
    assert str(Path(work.__code__.co_filename)).startswith("/tmp/") or sys.platform != "linux"
    assert inside(own, work, 41) == 42


@sandboxed
def test_nothing_is_mounted_writable_again(own, work_from):
    """Not by root either, who needs no capability to write what concerns the whole machine."""
    work = work_from(
        """
import ctypes, os

REMOUNT, BIND = 32, 4096

def work(plant, controller, task):
    folder, libc = os.path.dirname(__file__), ctypes.CDLL(None)
    found = [libc.mount(None, name.encode(), None, REMOUNT | BIND, None) for name in ("/", "/proc", folder)]
    for name in (folder + "/new", "/proc/sys/kernel/core_pattern"):
        try:
            os.close(os.open(name, os.O_WRONLY | os.O_CREAT))
            found.append("open")
        except OSError as problem:
            found.append(type(problem).__name__)
    return found
"""
    )
    assert inside(own, work, None)[:3] == [-1, -1, -1]
    assert "open" not in inside(own, work, None)


@sandboxed
@pytest.mark.parametrize("folder", ["/tmp", "/var/tmp", "/run", "elsewhere"])
def test_sockets_of_other_programs_are_out_of_reach(own, work_from, folder, tmp_path, monkeypatch):
    if folder == "elsewhere":  # where this machine's temporary files are
        folder = str(tmp_path)
        monkeypatch.setattr(tempfile, "tempdir", folder)
    if not os.access(folder, os.W_OK):
        pytest.skip(f"{folder} cannot be written")
    work = work_from(
        """
import socket

def work(plant, controller, path):
    with socket.socket(socket.AF_UNIX) as caller:
        return caller.connect_ex(path)
"""
    )
    with tempfile.TemporaryDirectory(dir=folder) as own_folder, socket.socket(socket.AF_UNIX) as listening:
        path = os.path.join(own_folder, "s")
        listening.bind(path)
        listening.listen()
        assert work(None, None, path) == 0
        assert inside(own, work, path) == errno.ENOENT


@sandboxed
def test_the_environment_is_not_handed_on(own, work_from, monkeypatch):
    monkeypatch.setenv("A_TOKEN", "secret")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    work = work_from(
        """
import os

def work(plant, controller, names):
    own, first = open("/proc/self/environ").read(), open("/proc/1/environ").read()
    return [os.environ.get(name) for name in names], "secret" in own + first
"""
    )
    values, leaked = inside(own, work, ["A_TOKEN", "OMP_NUM_THREADS", "PATH"])
    assert values == [None, "1", os.environ["PATH"]]
    assert not leaked


@sandboxed
def test_a_package_that_is_found_by_a_hook_alone(plant_file, pid_file, tmp_path):
    """As by that of an editable install, from another folder than its own, and the package lies in a hidden one."""
    clone, elsewhere = tmp_path / "clone", tmp_path / "elsewhere"
    elsewhere.mkdir()
    for package in ("orchestrator", "controller_fmu", "plant_fmu"):
        shutil.copytree(ROOT / package, clone / package, ignore=shutil.ignore_patterns("__pycache__"))
    (elsewhere / "task.py").write_text(
        """
def work(plant, controller, task):
    import orchestrator
    return orchestrator.__file__
"""
    )
    (elsewhere / "script.py").write_text(
        f"""
import sys
from importlib.machinery import PathFinder
from pathlib import Path

class Hook:
    @staticmethod
    def find_spec(name, path=None, target=None):
        return PathFinder.find_spec(name, [{str(clone)!r}]) if path is None else None

if __name__ == "__main__":
    sys.meta_path.insert(0, Hook)
    from orchestrator.cosim.archive import open_archive
    from orchestrator.execution.isolation import run_isolated
    from orchestrator.execution.job import Job
    from task import work
    plant, controller = (open_archive(Path(word)) for word in sys.argv[1:])
    (outcome,) = run_isolated(Job(plant, controller, (0,), work, (120.0,), sandbox=True))
    print(outcome.value)
"""
    )
    done = finished([sys.executable, "script.py", str(plant_file), str(pid_file)], folder=elsewhere)
    assert done.stdout.strip() == str(clone / "orchestrator" / "__init__.py"), done.stderr


@sandboxed
def test_a_run_that_is_killed_leaves_no_files(tmp_path):
    """Whatever a sandbox writes lies in its own memory."""
    outside = tmp_path / "temporary"
    outside.mkdir()
    arguments = command(tmp_path / "out", "--only", "c00.compliant.noise", "--sandbox")
    with started(arguments, environment={"TMPDIR": str(outside)}) as process:
        assert wait_for(lambda: any("fresh" in " ".join(child.cmdline()) for child in session_and_below(process)))
        kill(process)
        process.wait()
    assert [path.name for path in outside.iterdir() if not path.name.startswith("pymp-")] == []


def session_and_below(process) -> list[psutil.Process]:
    """All that a command has started and that still has a command line."""
    with suppress(psutil.Error):
        return [child for child in psutil.Process(process.pid).children(recursive=True) if child.is_running()]
    return []


@sandboxed
def test_crashes_hangs_and_processes_left_behind(plant_file, slave, monkeypatch):
    monkeypatch.setattr(evaluation, "START_TIME", 60.0)
    own = bench(plant_file, slave, sandbox=True)
    before = sleepers()
    cases = short_cases(own.plant, (STRUCK,))
    (crashed,) = run(with_fault(own, 2), cases)
    assert (crashed.status, crashed.time) == (Status.CRASHED, 0.0)
    assert "exit code 7" in crashed.message
    (left,) = run(with_fault(own, 4), cases)
    assert left.status is Status.DONE
    _, alive = psutil.wait_procs(sleepers() - before, timeout=5)  # the system ends a sandbox in its own time
    assert not alive


def sleepers() -> set[psutil.Process]:
    """What the hostile controller starts; it would sleep for minutes."""
    return {process for process in psutil.process_iter(["name"]) if process.info["name"] == "sleep"}


@sandboxed
def test_as_a_command(tmp_path):
    tables = {}
    for option in ((), ("--sandbox",)):
        folder = tmp_path / "-".join(("out", *option))
        done = finished(command(folder, "--only", "c00.compliant.noise", *option))
        assert done.returncode == 0, done.stderr
        tables[option] = (folder / "cases.csv").read_bytes()
    assert tables[()] == tables[("--sandbox",)]


def test_without_bubblewrap_the_option_is_refused(plant_file, slave, monkeypatch):
    monkeypatch.setenv("PATH", "/nonexistent")
    own = bench(plant_file, slave, sandbox=True)
    with pytest.raises(InputError, match="--sandbox needs bubblewrap"):
        run(own, short_cases(own.plant, (STRUCK,)))


@pytest.mark.skipif(sys.platform != "linux", reason="a shell script stands for bubblewrap")
def test_where_bubblewrap_may_not_work_the_option_is_refused(plant_file, slave, tmp_path, monkeypatch):
    program = tmp_path / "bwrap"
    program.write_text("#!/bin/sh\necho 'bwrap: No permissions to create new namespace' >&2\nexit 1\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    own = bench(plant_file, slave, sandbox=True)
    with pytest.raises(InputError, match="No permissions to create new namespace"):
        run(own, short_cases(own.plant, (STRUCK,)))
