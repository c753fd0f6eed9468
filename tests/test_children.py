"""Worker processes: whoever starts them, how they start, and that nothing of them stays behind."""

import csv
import multiprocessing
import os
import pickle
import resource
import signal
import subprocess
import sys
import threading
from ast import literal_eval
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import psutil
import pytest
from hostile import fmus
from hostile.commands import GUARD, wait_for
from hostile.fmus import Fault
from hostile.runs import STRUCK, bench, job, noise_cases, run, short_cases
from support.refusals import refusal

from orchestrator import Benchmark, Controller
from orchestrator.cache import VARIABLE, compiled_code_folder
from orchestrator.errors import EnvironmentFault
from orchestrator.execution import launch, pool
from orchestrator.execution.supervision import run_isolated
from orchestrator.pairing import work

pytestmark = pytest.mark.needs("linux")

CASE = "c00.compliant.noise"
GOLDEN = Path(__file__).parent / "golden" / "DiagonalPID.quick.csv"


def golden() -> list[str]:
    """B1 and B2 of the case, as published."""
    with GOLDEN.open(encoding="utf-8") as table:
        (row,) = (row for row in csv.DictReader(table) if row["id"] == CASE)
    return [row[name] for name in row if name.startswith(("B1", "B2"))]


def evaluated(file: str) -> list[str]:
    """B1 and B2 of the case."""
    (case,) = Benchmark("quick", workers=1).evaluate(Controller(file), only=CASE, recordings=False).cases
    return [repr(case.measurements.B1), repr(case.measurements.B2)]


SCRIPT = """
from orchestrator import Benchmark, Controller
(case,) = Benchmark("quick", workers=1).evaluate(Controller({file!r}), only={case!r}, recordings=False).cases
print([repr(case.measurements.B1), repr(case.measurements.B2)])
"""
THREADED = "import threading\ndef work():\n{}\nthreading.Thread(target=work).start()\n"


def printed(arguments: list[str], folder: Path, text: str = "") -> list[str]:
    """What a Python process prints."""
    done = subprocess.run([sys.executable, *arguments], cwd=folder, input=text, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return literal_eval(done.stdout)


@pytest.mark.parametrize("arguments", [["script.py"], ["-"]])
def test_a_script_without_a_guard_and_one_from_standard_input(arguments, pid_file, tmp_path):
    script = SCRIPT.format(file=str(pid_file), case=CASE)
    (tmp_path / "script.py").write_text(script)
    assert printed(arguments, tmp_path, script) == golden()


def test_a_thread_that_outlives_the_main_thread(pid_file, tmp_path):
    lines = SCRIPT.format(file=str(pid_file), case=CASE).replace("\n", "\n    ")
    (tmp_path / "script.py").write_text(THREADED.format(lines))
    assert printed(["script.py"], tmp_path) == golden()


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("method", ["spawn", "fork"])
def test_daemonic_processes(method, pid_file):
    """A fork inherits the fork server of this process, which stays this one's."""
    assert evaluated(str(pid_file)) == golden()
    with multiprocessing.get_context(method).Pool(1) as callers:
        assert callers.apply(evaluated, [str(pid_file)]) == golden()
    assert evaluated(str(pid_file)) == golden()


def test_a_fork_while_another_thread_starts_a_server(pid_file):
    with launch._servers_lock:
        pid = os.fork()
    if pid == 0:
        try:
            os._exit(0 if evaluated(str(pid_file)) == golden() else 1)
        finally:
            os._exit(2)
    assert os.waitpid(pid, 0)[1] == 0


def test_a_worker_has_nothing_of_its_owner(harmless):
    (outcome,) = run_isolated(job(harmless, "surroundings", b""))
    folder, files, sockets, main = literal_eval(outcome.value.decode())
    assert (files, sockets, main) == ([], 1, None)
    assert not Path(folder).exists()  # it goes with the worker


def test_a_run_draws_no_order_of_its_own(harmless):
    """All processes of a run are forked from one: an order of a set that is drawn for it shows in no repetition."""

    def of_a_new_server() -> bytes:
        for key, server in list(launch._servers.items()):
            if key[0] == "hostile.works":
                launch._discard(server)
        (outcome,) = run_isolated(job(harmless, "hash_of", b"q_m"))
        return outcome.value

    assert of_a_new_server() == of_a_new_server()


def test_the_owner_never_loads_an_fmu(pid_file, tmp_path):
    """In a process of its own: other tests load the plant where they run."""
    mapped = "print([line for line in open('/proc/self/maps') if '/binaries/' in line])"
    (tmp_path / "script.py").write_text(SCRIPT.format(file=str(pid_file), case=CASE).replace("print", "_ = ") + mapped)
    assert printed(["script.py"], tmp_path) == []


def test_an_owner_with_many_open_files(harmless):
    """select() refuses descriptors above 1023."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (4096, before[1]))
    opened = [os.open(os.devnull, os.O_RDONLY) for _ in range(1100)]
    try:
        assert [outcome.value for outcome in run_isolated(job(harmless, "echo", b"a"))] == [b"a"]
    finally:
        for descriptor in opened:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_jobs_of_different_modules_do_not_end_each_others_workers(harmless):
    """Each module has a fork server of its own."""
    first = run_isolated(job(harmless, "echo", b"a", b"b"))
    assert next(first).value == b"a"
    task = replace(job(harmless, "echo", b""), work=f"{work.__name__}:judge_case")
    list(run_isolated(task))  # it fails, since that is no task of its
    before = set(launch._servers.values())
    assert next(first).value == b"b"
    assert set(launch._servers.values()) == before and len(before) >= 2


@pytest.mark.parametrize("disturb", ["kill", "terminate"])
def test_a_fork_server_that_is_lost_costs_nothing(disturb, harmless):
    outcomes = run_isolated(job(harmless, "echo", b"a", b"b", b"c"))
    assert next(outcomes).value == b"a"
    (server,) = (server for key, server in launch._servers.items() if key[0] == "hostile.works")
    getattr(server._process, disturb)()
    server._process.wait()
    assert [outcome.value for outcome in outcomes] == [b"b", b"c"]
    assert [outcome.value for outcome in run_isolated(job(harmless, "echo", b"d"))] == [b"d"]
    assert not Path(server._scratch).exists()


def test_what_a_sandbox_needs_is_compiled_once_and_again_if_it_is_damaged(monkeypatch, tmp_path):
    """It keeps no compiled code, and compiled on the time of its controller, which was told to have a timeout."""
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    lines, stop = compiled_code_folder() / "lines.txt", threading.Event()
    for damage, count in ((False, 1), (False, 1), (True, 2), (False, 2)):
        if damage:
            (lines.parent / "a.1.nbc").touch()
        launch._compile("hostile.prepared", stop)
        assert lines.read_text().count("prepared") == count
    (lines.parent / "a.1.nbc").touch()
    stop.set()
    with pytest.raises(launch.Stopped):
        launch._compile("hostile.prepared", stop)


@pytest.mark.parametrize("sandbox", [True, False])
def test_compiled_code_with_which_nothing_starts_is_removed(sandbox, harmless, monkeypatch, tmp_path):
    """Nobody had noted what it was: no command went on until somebody removed the cache. In a sandbox the controller
    was told to have crashed."""
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    spoiled = compiled_code_folder() / "spoiled.1.nbc"
    spoiled.parent.mkdir(parents=True)
    spoiled.write_bytes(pickle.dumps("machine code"))
    if sandbox:
        launch._compile("hostile.prepared", threading.Event())
    else:
        made = replace(job(harmless, "echo", b"a"), prepared_by="hostile.prepared")
        assert [outcome.value for outcome in run_isolated(made)] == [b"a"]
    assert not spoiled.exists()


def test_what_cannot_be_compiled_is_a_fault_of_the_machine(monkeypatch, tmp_path):
    """A worker in a sandbox compiled itself then, on the time of its controller."""
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    error = refusal(launch._compile, "hostile.nothing", threading.Event(), kind=EnvironmentFault)
    assert error.what == "no-process" and "hostile.nothing" in str(error)


def test_a_start_that_fails_or_is_interrupted_leaves_nothing(harmless, monkeypatch):
    list(run_isolated(job(harmless, "echo", b"a")))
    before = left_behind()

    def interrupted(*_):
        raise KeyboardInterrupt

    for where in ("_received", "ProcessTree", "frame"):
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(launch, where, interrupted)
            list(run_isolated(job(harmless, "echo", b"a")))
        assert wait_for(lambda: left_behind() == before)
    monkeypatch.setattr(launch, "_received", lambda status: -11)
    assert refusal(list, run_isolated(job(harmless, "echo", b"a")), kind=EnvironmentFault).what == "no-process"


def test_time_limits_follow_the_simulated_time(harmless):
    scenarios = [replace(noise_cases()[0].scenario, duration=Fraction(duration)) for duration in (13, 26)]
    made = replace(harmless, timeout=52.0).job("judge_case", [], scenarios, lambda *_: None, 5.0)
    assert made.time_limits == (5.0 + 26.0, 5.0 + 52.0)


@pytest.mark.slow
def test_nothing_stays_after_many_jobs(plant_file, faulty, harmless):
    """As many descriptors, folders and processes as after the first few, through successes, errors and crashes."""
    bad = [bench(plant_file, faulty(Fault(what)), limit=20.0) for what in ("abort", "exit:0", "status:3")]

    def everything(count: int) -> None:
        for each in bad:
            run(each, short_cases((STRUCK,) * 3), workers=2)
        outcomes = list(pool.run([job(harmless, "echo", b"x")] * count, 2))
        assert [outcome.value for _, outcome in outcomes] == [b"x"] * count

    everything(1)
    before = left_behind()
    everything(50)
    assert wait_for(lambda: left_behind() == before)


def left_behind() -> tuple[int, int, int]:
    """Open descriptors, folders for workers, and living processes below this one's fork servers."""
    servers = list(launch._servers.values())
    below = [each for server in servers for each in psutil.Process(server._process.pid).children()]
    folders = [name for server in servers for name in os.listdir(server._scratch)]
    return len(os.listdir("/proc/self/fd")), len(folders), len(below)


def test_a_pool_that_is_closed_ends_its_workers(harmless):
    outcomes = pool.run([job(harmless, "echo", b"x")] * 50, 2)
    next(outcomes)
    outcomes.close()
    assert not [thread for thread in threading.enumerate() if "drive" in thread.name]


OWNER = """
import os, sys
from pathlib import Path
from hostile.runs import bench, job
from orchestrator.execution import launch, supervision
outcomes = supervision.run_isolated(job(bench(Path(sys.argv[1]), Path(sys.argv[2])), "echo", b"a", b"b"))
next(outcomes)
(server,) = launch._servers.values()
print(server._process.pid, server._scratch, flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_an_owner_that_is_killed_leaves_nothing(number, plant_file, faulty):
    owner = subprocess.Popen(
        [sys.executable, "-c", OWNER, str(plant_file), str(faulty(fmus.NONE))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    with owner:
        pid, scratch = owner.stdout.readline().split()
        members = [psutil.Process(int(pid)), *psutil.Process(int(pid)).children()]
        assert os.listdir(scratch)
        owner.send_signal(number)
    assert not psutil.wait_procs(members, timeout=GUARD)[1]
    assert not Path(scratch).exists()
