"""In the sandbox a controller reaches neither the network nor the user's files, and gives the same numbers."""

import errno
import os
import shutil
import socket
import stat
import sys
import tempfile
import zipfile
from ast import literal_eval
from contextlib import suppress

import psutil
import pytest
from hostile.commands import ROOT, command, finished, kill, started, wait_for
from hostile.runs import STRUCK, bench, copied_packages, job, run, short_cases
from support.python_controllers import python_controller
from support.refusals import refusal

from orchestrator import Benchmark
from orchestrator.cache import DEVICES
from orchestrator.execution import sandbox, sandbox_probe
from orchestrator.execution.interpreter import program
from orchestrator.execution.job import Done
from orchestrator.execution.seccomp import TALK
from orchestrator.execution.supervision import run_isolated
from orchestrator.loop.trajectory import Status
from orchestrator.pairing import pairing
from orchestrator.study import engine

sandboxed = pytest.mark.needs("bubblewrap")


@pytest.fixture
def own(plant_file, pid_file):
    """The plant with the default controller."""
    return bench(plant_file, pid_file, limit=120.0, sandbox=True)


def inside(own, function: str, task: str = "") -> str:
    """What a function of ``hostile.works`` returns in a sandbox."""
    (outcome,) = run_isolated(job(own, function, task.encode(), limit=120.0))
    assert isinstance(outcome, Done), outcome
    return outcome.value.decode()


@sandboxed
def test_the_sandbox_stops_what_is_allowed_without_it(plant_file, tmp_path, monkeypatch):
    """The controller connects to a server on this machine, reads where it may, and writes into the user's home."""
    monkeypatch.setenv("HOME", str(tmp_path))
    modules = {"report": (ROOT / "tests" / "hostile" / "report.py").read_text()}
    body = "raise RuntimeError('; '.join(report.report()))"
    file, reports = python_controller(tmp_path, imports="import report", step_body=body, modules=modules), {}
    for boxed in (False, True):
        (found,) = run(bench(plant_file, file, limit=120.0, sandbox=boxed), short_cases((STRUCK,)))
        assert found.result.status is Status.ERROR
        reports[boxed] = found.result.message
    for word in ("home: written", "own folder: written"):
        assert word in reports[False]
    for word in ("home: refused", "network: refused", "processes: 3 or fewer", "temporary files: written"):
        assert word in reports[True]


@sandboxed
def test_as_a_command_with_the_same_numbers(tmp_path):
    tables = set()
    for option in ((), ("--sandbox",)):
        folder = tmp_path / "-".join(("out", *option))
        done = finished(command(folder, "--only", "c00.compliant.noise", *option))
        assert done.returncode == 0, done.stderr
        tables.add((folder / "cases.csv").read_bytes())
    assert len(tables) == 1


@sandboxed
def test_nothing_is_mounted_writable_again(own):
    """Not by root either, who needs no capability to write what concerns the whole machine."""
    assert inside(own, "remount") == "-1 -1 -1 refused refused"


@sandboxed
@pytest.mark.parametrize("folder", [*(each for each in ("/tmp", "/var/tmp", "/run") if os.access(each, os.W_OK)), ""])
def test_sockets_of_other_programs_are_out_of_reach(own, folder, tmp_path, monkeypatch):
    if not folder:  # where this machine's temporary files are
        folder = str(tmp_path)
        monkeypatch.setattr(tempfile, "tempdir", folder)
    with tempfile.TemporaryDirectory(dir=folder) as own_folder, socket.socket(socket.AF_UNIX) as listening:
        path = os.path.join(own_folder, "s")
        listening.bind(path)
        listening.listen()
        with socket.socket(socket.AF_UNIX) as caller:
            assert caller.connect_ex(path) == 0
        assert inside(own, "connect", path) == str(errno.ENOENT)


@sandboxed
def test_the_environment_is_not_handed_on(own, monkeypatch):
    monkeypatch.setenv("A_TOKEN", "secret")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    values, leaked = literal_eval(inside(own, "environment_of", "A_TOKEN OMP_NUM_THREADS PATH"))
    assert values == [None, "1", os.environ["PATH"]]
    assert not leaked


@sandboxed
def test_a_worker_works_in_an_empty_folder(own):
    folder, files, sockets, main = literal_eval(inside(own, "surroundings"))
    assert (folder, files, sockets, main) == (sandbox.WORK, [], 1, None)


@sandboxed
def test_a_controller_alone_sees_none_of_the_users_files(tmp_path):
    """One of them may be the certificate that is repeated, from which its draws follow."""
    own = tmp_path / "verification.json"
    own.write_text("{}")
    files = [str(own), str(ROOT / "README.md"), str(ROOT / "tests" / "conftest.py"), str(sandbox.PACKAGE / "cache.py")]
    code = (
        f"import os; print([os.path.exists(name) for name in {files!r}]); import orchestrator.execution.controller_host"
    )
    seen = {}
    for alone in (False, True):
        words = [*sandbox.command((), alone=alone), *program(code)]
        done = finished(words, folder=tmp_path, environment=sandbox.environment(os.environ))
        assert done.returncode == 0, done.stderr
        seen[alone] = literal_eval(done.stdout)
    assert seen == {False: [False, True, True, True], True: [False, False, "tests" in str(sys.path), True]}


@sandboxed
def test_nothing_of_a_private_folder_is_seen(tmp_path, monkeypatch):
    """Such as that of a service, where other people's FMUs lie; the cache within it works all the same."""
    # Not below a folder for temporary files, which is hidden anyway.
    with tempfile.TemporaryDirectory(dir=os.path.expanduser("~")) as folder:
        secret = os.path.join(folder, "runs", "other.fmu")
        os.makedirs(os.path.dirname(secret))
        with open(secret, "w") as file:
            file.write("another's")
        monkeypatch.setenv("FLEXIBLE_MANIPULATOR_CACHE", os.path.join(folder, "cache"))
        code = f"import os; print([os.path.exists({secret!r}), os.access({folder!r}, os.W_OK), "
        code += f"os.access({os.path.join(folder, 'cache')!r}, os.W_OK)])"
        seen = []
        for private in ("", folder):
            monkeypatch.setenv(sandbox.PRIVATE, private)
            done = finished([*sandbox.command(()), *program(code)], environment=sandbox.environment(os.environ))
            assert done.returncode == 0, done.stderr
            seen.append(literal_eval(done.stdout))
    assert seen == [[True, False, True], [False, False, True]]


SCRIPT = """
import sys
from importlib.machinery import PathFinder
from pathlib import Path

class Hook:
    @staticmethod
    def find_spec(name, path=None, target=None):
        return PathFinder.find_spec(name, [{clone!r}]) if path is None else None

sys.meta_path.insert(0, Hook)
from hostile.runs import bench, job
from orchestrator.execution.supervision import run_isolated
own = bench(Path(sys.argv[1]), Path(sys.argv[2]), sandbox=True)
for function in ("package_file", "surroundings"):
    (outcome,) = run_isolated(job(own, function, b"", limit=120.0))
    print(outcome.value.decode())
"""


@sandboxed
def test_a_package_that_is_found_by_a_hook_alone(plant_file, pid_file, tmp_path):
    """As by that of an editable install, from another folder than its own, and the package lies in a hidden one: below
    that for temporary files, which is not empty inside, as the folder that a worker works in is."""
    clone = copied_packages(tmp_path / "clone")
    shutil.copytree(ROOT / "tests" / "hostile", tmp_path / "hostile")
    shutil.copy(ROOT / "build_fmus.py", tmp_path)
    (tmp_path / "script.py").write_text(SCRIPT.format(clone=str(clone)))
    words = [sys.executable, "script.py", str(plant_file), str(pid_file)]
    done = finished(words, folder=tmp_path, environment={"PYTHONPATH": ""})
    file, surroundings = done.stdout.splitlines()
    assert file == str(clone / "orchestrator" / "__init__.py"), done.stderr
    assert literal_eval(surroundings)[:2] == (sandbox.WORK, [])


@sandboxed
def test_a_run_that_is_killed_leaves_no_files(tmp_path):
    """Whatever a sandbox writes lies in its own memory."""
    outside = tmp_path / "temporary"
    outside.mkdir()
    arguments = command(tmp_path / "out", "--only", "c00.compliant.noise", "--sandbox")
    with started(arguments, environment={"TMPDIR": str(outside)}) as process:
        assert wait_for(lambda: any("sandboxed" in " ".join(words) for words in commands_below(process.pid)))
        kill(process)
        process.wait()
    assert wait_for(lambda: not list(outside.iterdir()))


def commands_below(pid: int) -> list[list[str]]:
    """The command lines of all that a process has started."""
    found = []
    with suppress(psutil.Error):
        for child in psutil.Process(pid).children(recursive=True):
            with suppress(psutil.Error):
                found.append(child.cmdline())
    return found


@sandboxed
def test_an_fmu_that_is_larger_than_the_memory_of_the_sandbox(plant_file, pid_file, tmp_path):
    """Its files were copied into that, which was told as a fault of the machine."""
    large = tmp_path / "large.fmu"
    shutil.copy(pid_file, large)
    piece = os.urandom(1 << 14).ljust(1 << 20, b"\0")
    with zipfile.ZipFile(large, "a", zipfile.ZIP_DEFLATED) as opened, opened.open("resources/table", "w") as table:
        for _ in range(sandbox.TMPFS_BYTES // len(piece) + 1):
            table.write(piece)
    (found,) = run(bench(plant_file, large, limit=120.0, sandbox=True), short_cases((STRUCK,)))
    assert found.result.status is Status.DONE, found.result.message


@sandboxed
def test_crashes_and_processes_left_behind(plant_file, tmp_path, monkeypatch):
    monkeypatch.setattr(pairing, "START_TIME", 60.0)
    before = sleepers()
    file = python_controller(tmp_path, "Exits", imports="import os", step_body="os._exit(7)")
    (crashed,) = run(bench(plant_file, file, sandbox=True), short_cases((STRUCK,)))
    assert (crashed.result.status, crashed.result.time) == (Status.CRASHED, 0.0)
    assert "exit code 7" in crashed.result.message
    spawn = "subprocess.Popen(['sleep', '1000'], start_new_session=True)"
    file = python_controller(tmp_path, "Spawns", imports="import subprocess", initialize=spawn)
    (left,) = run(bench(plant_file, file, sandbox=True), short_cases((STRUCK,)))
    assert left.result.status is Status.DONE
    assert wait_for(lambda: not sleepers() - before)  # the system ends a sandbox in its own time


def sleepers() -> set[psutil.Process]:
    """What the hostile controller starts; it would sleep for minutes."""
    return {process for process in psutil.process_iter(["cmdline"]) if process.info["cmdline"] == ["sleep", "1000"]}


@pytest.mark.needs("linux")  # a shell script stands for bubblewrap
@pytest.mark.parametrize("words", ["", "bwrap: No permissions to create new namespace"])
def test_where_bubblewrap_is_not_there_or_may_not_work_it_is_refused(words, own, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    if words:
        program = tmp_path / "bwrap"
        program.write_text(f"#!/bin/sh\necho '{words}' >&2\nexit 1\n")
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
    error = refusal(run, own, short_cases((STRUCK,)))
    assert error.what == "no-sandbox" and words in str(error)


@sandboxed
def test_a_probe_finds_what_a_sandbox_leaves_open(monkeypatch):
    """Nothing in ours; in one without a wall, what that keeps out."""
    assert sandbox_probe.leaks() == ()
    open_network = tuple(word for word in sandbox.OPTIONS if word != "--unshare-all")
    monkeypatch.setattr(sandbox, "OPTIONS", open_network)
    monkeypatch.setattr(sandbox, "NO_USER_NAMESPACES", ())
    monkeypatch.setattr(sandbox, "HIDDEN", ())
    monkeypatch.setattr(sandbox, "ALONE", ())
    monkeypatch.setattr(sandbox, "NO_PROC", sandbox.SYSTEM)
    found = sandbox_probe.leaks()
    assert {"the network", "the processes of others"} <= set(found)


@sandboxed
def test_a_probe_of_a_user_whose_home_is_missing(monkeypatch, tmp_path):
    """As is that of many users that services run as."""
    monkeypatch.setenv("HOME", str(tmp_path / "missing"))
    assert sandbox_probe.leaks() == ()


@sandboxed
def test_a_probe_finds_what_the_kernel_shows_and_counts(monkeypatch):
    monkeypatch.setattr(sandbox, "ALONE", ())
    monkeypatch.setattr(sandbox, "NO_PROC", sandbox.SYSTEM)
    assert set(sandbox_probe.leaks()) == {"what the kernel shows in /proc", "terminals, which the machine counts"}


@pytest.mark.needs("linux")
@pytest.mark.parametrize("name", TALK)
def test_a_probe_sees_that_a_call_is_not_refused(name):
    """Here, where there is no filter."""
    sandbox_probe._works(name)


LOOK = """
import os

def shown(path):
    # Of /proc, files of processes are those of the sandbox; what is hidden is a device without contents.
    words = path.split("/")
    return words[1] != "proc" or not (words[2].isdecimal() or os.path.islink(path) or os.stat(path).st_rdev == NULL)

NULL = os.stat("/dev/null").st_rdev
found = {folder: sorted(os.path.relpath(os.path.join(place, name), folder) for place, _, names in os.walk(folder)
    for name in names if shown(os.path.join(place, name))) for folder in ("/proc", "/sys", "/dev")}
print(found)
"""


@sandboxed
@pytest.mark.parametrize("talking", [False, True])
def test_a_controller_alone_sees_nothing_that_the_kernel_says_of_the_machine(talking, tmp_path):
    """Files of /proc and /sys show counters that another controller moves, in the same second or long before."""
    words = [*sandbox.command((), alone=True, talking=talking), *program(LOOK)]
    done = finished(words, folder=tmp_path, environment=sandbox.environment(os.environ))
    assert literal_eval(done.stdout) == {
        "/proc": [],
        "/sys": [],
        "/dev": sorted(name.rpartition("/")[2] for name in DEVICES),
    }, done.stderr


@sandboxed
def test_nothing_is_certified_in_a_sandbox_with_a_hole(monkeypatch):
    monkeypatch.setattr(engine, "leaks", lambda: ("the network",))
    problem = refusal(Benchmark().verify)
    assert problem.what == "leaky-sandbox" and "allows what it must not: the network" in str(problem)
