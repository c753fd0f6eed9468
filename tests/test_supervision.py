"""Whatever a controller does costs its own case a status: a corpus of hostile FMUs, each run before a healthy case."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import sys
import threading
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import SimpleNamespace

import psutil
import pytest
from hostile import fmus
from hostile.commands import wait_for
from hostile.fmus import Fault
from hostile.runs import SPARED, STRUCK, bench, job, run, short_cases

from orchestrator.api import campaign
from orchestrator.api.campaign import CaseRun
from orchestrator.codec import Malformed, pack
from orchestrator.errors import EnvironmentFault
from orchestrator.execution import supervision
from orchestrator.execution.job import Died, Done, Limits, Refused
from orchestrator.execution.launch import Child
from orchestrator.execution.messages import ErrorRecord, Failed, Finished, Loaded, frame
from orchestrator.execution.shared_trace import SharedTrace
from orchestrator.fmi.trace import CONTROLLER, NOBODY, PLANT, Place, Trace
from orchestrator.loop.trajectory import Status

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the corpus is written for Linux")

CRASHED, TIMEOUT, ERROR, DONE = Status.CRASHED, Status.TIMEOUT, Status.ERROR, Status.DONE
HANG_LIMIT = 1.2
"""Wall time [s] for a case that hangs; all others have plenty."""


@dataclass(frozen=True)
class Expected:
    """The result of the struck case: status, simulated time [s], and what must stand in its message."""

    fault: Fault
    status: Status
    time: float
    words: tuple[str, ...] = ()
    limits: Limits = Limits()

    def __str__(self) -> str:
        return str(self.fault)


def expected(
    status: Status, what: str, *words: str, where: str = "step", time: float = 0.02, **limits: int
) -> Expected:
    """A fault that strikes in the call ``where``, in the first case only; ``time`` is when that ends."""
    fault = Fault(what, where, min(time, 0.02), -float(STRUCK) * 1e3)
    return Expected(fault, status, time, words, Limits(**limits))


CORPUS = [
    expected(CRASHED, "segfault", "SIGSEGV, in the call 'fmi2DoStep' of the controller at t = 0.02 s", "a bad pointer"),
    expected(CRASHED, "segfault", "SIGSEGV, in the call 'enterInitializationMode'", where="initialize", time=0.0),
    expected(CRASHED, "segfault", "SIGSEGV, in the call 'fmi2GetReal'", where="get"),
    expected(CRASHED, "overflow", "SIGSEGV"),
    expected(CRASHED, "divide", "SIGFPE"),
    expected(CRASHED, "abort", "SIGABRT"),
    expected(CRASHED, "exit:0", "exit code 0"),
    expected(CRASHED, "_exit:3", "exit code 3"),
    expected(CRASHED, "thread-crash", "SIGABRT"),
    expected(CRASHED, "format", "SIGSEGV"),
    expected(CRASHED, "kill:9", "SIGKILL"),
    expected(CRASHED, "kill:15", "SIGTERM"),
    expected(CRASHED, "garbage", "a channel that is not its own"),
    expected(CRASHED, "daemon-crash", "SIGABRT"),
    expected(CRASHED, "kill-parent", "lost with the one that started it"),
    expected(CRASHED, "grow", "of memory; the limit is 400 MB", memory=400_000_000),
    expected(CRASHED, "log:1", "logged more than 1 MB", "still here, and talking", output=1_000_000),
    expected(CRASHED, "print", "printed or logged more than 1 MB", "no news", output=1_000_000),
    expected(TIMEOUT, "spin", "in the call 'fmi2DoStep' of the controller"),
    expected(TIMEOUT, "spin", "in the call 'enterInitializationMode'", where="initialize", time=0.0),
    *(expected(TIMEOUT, what) for what in ("pause", "ignore-alarm", "stop-timer", "block-signals", "handlers")),
    *(expected(TIMEOUT, what) for what in ("stop", "log:0", "close-all")),
    expected(ERROR, "status:2", "fmi2DoStep returned discard", "as you wish"),
    expected(ERROR, "status:4", "fmi2DoStep returned fatal"),
    expected(ERROR, "status:5", "fmi2DoStep returned pending"),
    expected(ERROR, "status:77", "illegal status 77"),
    expected(ERROR, "status:-1", "illegal status -1"),
    expected(ERROR, "status:3", "fmi2SetReal returned error", where="set", time=0.02025),
    expected(ERROR, "status:3", "fmi2GetReal returned error", where="get"),
    expected(ERROR, "status:3", "enterInitializationMode failed", where="initialize", time=0.0),
    *(expected(ERROR, f"value:{value}", where="get") for value in ("nan", "inf", "-inf", "1e300")),
    expected(ERROR, "utf8", "caf�"),
    expected(ERROR, "percent", "100 %s of %n and %d%%"),
    expected(ERROR, "null-message"),
    expected(ERROR, "huge-message", "xxxxxxxx"),
    *(
        expected(DONE, what, time=float(STRUCK))
        for what in ("round", "trap", "chdir", "umask", "close-output", "thread")
    ),
]


@pytest.fixture(autouse=True)
def no_slack(monkeypatch):
    """Time limits in proportion to the simulated time alone, and what comes on top of them short."""
    monkeypatch.setattr(campaign, "START_TIME", 0.0)
    monkeypatch.setattr(supervision, "GRACE", 0.3)


@pytest.fixture(scope="module")
def healthy(plant_file, faulty) -> list[CaseRun]:
    """The runs of the two cases with a controller without a fault."""
    runs = run(bench(plant_file, faulty(fmus.NONE), limit=120.0), short_cases((STRUCK, SPARED)))
    assert [run.result.status for run in runs] == [DONE, DONE]
    return runs


@pytest.mark.parametrize("expected", CORPUS, ids=str)
def test_a_hostile_controller_costs_its_own_case_only(expected, plant_file, faulty, healthy):
    limit = HANG_LIMIT if expected.status is TIMEOUT else 10.0
    own = bench(plant_file, faulty(expected.fault), limit, limits=expected.limits)
    struck, spared = run(own, short_cases((STRUCK, SPARED)))
    assert (struck.result.status, struck.result.time) == (expected.status, pytest.approx(expected.time, abs=1e-9))
    assert [word for word in (*expected.words, "") if word not in struck.result.message] == [], struck
    assert "Traceback" not in struck.result.message
    assert spared.result == healthy[1].result  # bit for bit: no fault leaks into another case
    if expected.status is DONE and expected.fault.what != "round":
        assert struck.result == healthy[0].result


def test_a_warning_is_counted(plant_file, faulty):
    (found,) = run(bench(plant_file, faulty(Fault("status:1", "step", 0.02))), short_cases((STRUCK,)))
    assert (found.result.status, found.result.warnings) == (DONE, 120)


@pytest.mark.parametrize(
    ("what", "status"), [("segfault", CRASHED), ("exit:0", CRASHED), ("spin", TIMEOUT), ("status:3", ERROR)]
)
def test_a_controller_that_cannot_be_instantiated(what, status, plant_file, faulty):
    own = bench(plant_file, faulty(Fault(what, "instantiate", 0.0)), HANG_LIMIT)
    (found,) = run(own, short_cases((STRUCK,)))
    assert (found.result.status, found.result.time) == (status, 0.0)
    assert "instantiation" in found.result.message


def test_a_crash_in_the_second_instance_goes_away_in_a_process_of_its_own(plant_file, faulty, healthy):
    """Some FMUs can be instantiated once per process. The result of a case must not depend on those before it."""
    own = bench(plant_file, faulty(Fault("segfault", "initialize", 0.0, which=2)))
    assert [run.result for run in run(own, short_cases((STRUCK, SPARED)))] == [run.result for run in healthy]


@pytest.mark.parametrize("what", ["daemon", "daemon-session", "daemon-crash"])
def test_no_process_stays_behind(what, plant_file, faulty):
    own = bench(plant_file, faulty(Fault(what, "terminate" if what != "daemon-crash" else "step", 0.0)))
    note = own.controller.folder / "resources" / "daemon.pid"
    note.unlink(missing_ok=True)
    run(own, short_cases((STRUCK,)))
    assert ends(int(note.read_text())), "the process that the FMU has started outlives it"


def ends(pid: int) -> bool:
    """Whether a process is gone, or about to be."""

    def gone() -> bool:
        try:
            return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return True

    return wait_for(gone)


def test_what_an_fmu_writes_over_itself_is_mended(plant_file, faulty, healthy):
    file = faulty(Fault("spoil", "terminate", 0.0))
    for _ in range(2):
        own = bench(plant_file, file)
        (found,) = run(own, short_cases((STRUCK,)))
        assert found.result == healthy[0].result
    assert (own.controller.folder / "resources" / "fault.txt").read_text().startswith("abort")


@pytest.mark.parametrize(
    ("fault", "status", "words"),
    [(1, ERROR, "lost its mind"), (2, CRASHED, "exit code 7"), (3, ERROR, "fmi2DoStep"), (5, ERROR, "recursion")],
    ids=["raise", "os._exit", "sys.exit", "recursion"],
)
def test_a_hostile_python_controller(fault, status, words, plant_file, fmu_folder):
    own = bench(plant_file, fmus.python_fmu(fmu_folder))
    own = replace(own, setup=replace(own.setup, parameters={"fault": float(fault), "at": 0.02}))
    for found in run(own, short_cases((STRUCK, STRUCK))):
        assert (found.result.status, found.result.time) == (status, 0.02)
        assert words in found.result.message


# ---- Faults of the environment: never a verdict ----


@contextmanager
def disturbed(monkeypatch, disturb, times=1):
    """Workers, the first ``times`` of which are disturbed as soon as they have started."""
    started, count = supervision.started, []

    @contextmanager
    def patched(given, stop):
        with started(given, stop) as child:
            count.append(1)
            if len(count) <= times:
                disturb(child)
            yield child

    monkeypatch.setattr(supervision, "started", patched)
    yield count


def test_a_worker_that_is_killed_is_replaced(plant_file, faulty, healthy, monkeypatch):
    with disturbed(monkeypatch, lambda child: child.process.kill()) as started:
        runs = run(bench(plant_file, faulty(fmus.NONE)), short_cases((STRUCK, SPARED)))
    assert len(started) == 2
    assert [run.result for run in runs] == [run.result for run in healthy]


def test_workers_that_never_load_are_an_environment_fault(plant_file, faulty, monkeypatch):
    with (
        disturbed(monkeypatch, lambda child: child.process.kill(), 99) as started,
        pytest.raises(EnvironmentFault) as told,
    ):
        run(bench(plant_file, faulty(fmus.NONE)), short_cases((STRUCK, SPARED)))
    assert (told.value.what, len(started)) == ("worker-lost", supervision.ATTEMPTS)


def test_work_that_cannot_be_imported_is_an_environment_fault(plant_file, faulty):
    own = bench(plant_file, faulty(fmus.NONE))
    with pytest.raises(EnvironmentFault):
        list(supervision.run_isolated(job(own, "nothing", b"")))


@pytest.mark.parametrize("side", ["plant", "controller"])
def test_a_cache_that_is_deleted_is_filled_again(side, plant_file, faulty, healthy, monkeypatch):
    own = bench(plant_file, faulty(fmus.NONE))
    with disturbed(monkeypatch, lambda child: None) as started:
        shutil.rmtree(getattr(own, side).folder)
        runs = run(own, short_cases((STRUCK, SPARED)))
    assert [run.result for run in runs] == [run.result for run in healthy]
    assert len(started) == 2


def test_a_timeout_of_a_worker_that_was_stopped_is_not_final(plant_file, faulty):
    """The hostile controller stops itself, which is the same to its owner."""
    own = bench(plant_file, faulty(Fault("stop")), HANG_LIMIT)
    (found,) = run(own, short_cases((STRUCK,)))
    assert (found.result.status, found.final) == (TIMEOUT, False)


# ---- Messages of a worker, without one ----

SEVENTH = Place(7, CONTROLLER, "")
DIES = SimpleNamespace(is_stopped=lambda: False, is_alive=lambda: True, memory=lambda: 0)


def listened(*messages: bytes, tasks: int = 3, loaded: bool = True, place: Place = SEVENTH, code=-6):
    """Outcomes of a worker that sends ``messages``, then ends with the exit ``code``."""
    near, far = socket.socketpair()
    output, output_end = os.pipe()
    trace = SharedTrace()
    Trace(trace.buffer).words[:3] = place.sample, place.side, 0
    process = SimpleNamespace(tree=DIES, exit_code=lambda patience: code, kill=lambda: None)
    given = SimpleNamespace(
        largest=100, tasks=(b"",) * tasks, time_limits=(60.0,) * tasks, sandbox=False, limits=Limits(), decode=decode
    )
    with near, far:
        far.sendall((frame(Loaded()) if loaded else b"") + b"".join(messages))
        far.shutdown(socket.SHUT_WR)
        os.close(output_end)
        try:
            yield from supervision._listen(Child(process, near.fileno(), output, trace), given, threading.Event())
        finally:
            os.close(output)
            trace.close()


def decode(index: int, value: bytes) -> bytes:
    """Values begin with the number of their task."""
    if value[:1] != str(index).encode():
        raise Malformed("a value of another task")
    return value


def finished(index: int, value: bytes | None = None, wall_time: float = 0.5) -> bytes:
    """The message of a task that is done."""
    return frame(Finished(index, str(index).encode() if value is None else value, wall_time))


def test_outcomes_come_in_order():
    record = ErrorRecord("fmu", "it failed", call="fmi2DoStep", log=("why",))
    found = list(listened(finished(0), finished(1), frame(Failed(2, record, 0.1))))
    assert found == [Done(0, b"0", 0.5), Done(1, b"1", 0.5), Refused(2, record, 0.1)]


GARBAGE = {
    "text": b"\x00\x00\x00\x05hello",
    "a length beyond all limits": b"\x7f\xff\xff\xff",
    "a value beyond the limit": finished(0, b"0" * 200_000),
    "loaded twice": frame(Loaded()),
    "another index": finished(1),
    "the same index again": finished(0) + finished(0),
    "a negative index": frame(Finished(0, b"0", 0.5)).replace(b"\x00\xa5value", b"\xff\xa5value"),
    "a negative time": finished(0, wall_time=-1.0),
    "no number": finished(0, wall_time=float("nan")),
    "a value that is not the task's": finished(0, b"1"),
    "a message of the owner's": frame(ErrorRecord("fmu", "")),
    "an unknown field": (lambda data: len(data).to_bytes(4, "big") + data)(pack({"type": "Loaded", "more": 1})),
    "nothing": b"\x00\x00\x00\x00",
}


@pytest.mark.parametrize("name", GARBAGE)
def test_garbage_ends_the_worker(name):
    *before, last = listened(GARBAGE[name])
    assert all(isinstance(outcome, Done) for outcome in before) and len(before) <= 1
    assert isinstance(last, Died) and not last.timeout and not last.outside
    assert last.kind == "it wrote into a channel that is not its own"


def test_an_outcome_before_the_fmus_are_loaded_is_garbage():
    (found,) = listened(finished(0), loaded=False)
    assert isinstance(found, Died)


def test_a_message_cut_short_is_the_end_of_the_process():
    assert [outcome.message for outcome in listened(finished(0)[:-1])] == ["the process was ended by SIGABRT"]


@pytest.mark.parametrize("side", [NOBODY, PLANT])
def test_a_process_that_ends_before_the_controller_comes_is_an_environment_fault(side):
    with pytest.raises(EnvironmentFault) as told:
        list(listened(loaded=False, place=Place(0, side, "")))
    assert told.value.what == "worker-lost"


def test_an_environment_fault_of_a_worker_is_one():
    with pytest.raises(EnvironmentFault) as told:
        list(listened(frame(Failed(0, ErrorRecord("environment", "no disk", "disk"), 0.1)), loaded=False))
    assert told.value.what == "disk"


@pytest.mark.parametrize(
    ("code", "timeout", "outside"),
    [(-signal.SIGALRM, True, False), (-signal.SIGKILL, False, True), (256, False, True), (3, False, False)],
)
def test_who_has_ended_a_process(code, timeout, outside):
    (found,) = listened(code=code)
    assert (found.timeout, found.outside) == (timeout, outside)


def test_a_timeout_while_the_owner_was_suspended_is_not_the_workers(monkeypatch):
    clock = iter(range(0, 10**6, 100))
    monkeypatch.setattr(supervision.time, "monotonic", lambda: float(next(clock)))
    (found,) = listened(code=-signal.SIGALRM)
    assert (found.timeout, found.outside) == (True, True)


def test_a_place_that_makes_no_sense_stays_within_the_simulation():
    (case,) = short_cases((STRUCK,))
    for sample, time in ((-5, 0.0), (2**62, float(STRUCK))):
        died = Died(0, False, "", "", 1.0, Place(sample, CONTROLLER, "x"))
        assert campaign.case_run(case, died).result.time == time


def test_a_folder_that_was_removed_is_made_again(plant_file, faulty):
    found = list(supervision.run_isolated(job(bench(plant_file, faulty(fmus.NONE)), "lose_folder", b"0", b"1")))
    assert [outcome.value for outcome in found] == [b"0", b"1"]


def test_garbage_from_a_real_worker(plant_file, faulty):
    own = bench(plant_file, faulty(fmus.NONE))
    (found,) = supervision.run_isolated(job(own, "forge", finished(0, b"\xff" * 300_000)))
    assert isinstance(found, Died) and "not its own" in found.message
