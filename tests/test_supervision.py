"""Whatever a controller does costs its own case a status: a corpus of hostile FMUs, each run before a healthy case."""

import os
import shutil
import signal
import socket
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace

import psutil
import pytest
from hostile.commands import wait_for
from hostile.fmus import Fault
from hostile.runs import HANG_LIMIT, PLENTY, SPARED, STRUCK, bench, job, run, short_cases
from support.python_controllers import python_controller
from support.refusals import refusal

from orchestrator.codec import Malformed
from orchestrator.errors import EnvironmentFault
from orchestrator.execution import launch, supervision
from orchestrator.execution.job import Died, Done, Limits
from orchestrator.execution.launch import Child
from orchestrator.execution.messages import ErrorRecord, Failed, Finished, Loaded, SharedTrace, frame
from orchestrator.execution.process_tree import Use
from orchestrator.execution.time_limit import PROCESSOR_REACHED, WAITING_REACHED
from orchestrator.fmi.trace import CONTROLLER, NOBODY, PLANT, Place, Trace
from orchestrator.loop.trajectory import Status
from orchestrator.pairing.runs import CaseRun, case_run

pytestmark = [
    pytest.mark.needs("linux"),
    pytest.mark.usefixtures("no_slack"),
]

CRASHED, TIMEOUT, ERROR, DONE = Status.CRASHED, Status.TIMEOUT, Status.ERROR, Status.DONE
LOST = Status.LOST


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
    expected(CRASHED, "exit:0", "exit code 0"),
    expected(CRASHED, "_exit:3", "exit code 3"),
    expected(CRASHED, "thread-crash", "SIGABRT"),
    expected(CRASHED, "format", "SIGSEGV"),
    expected(LOST, "kill:9", "SIGKILL"),  # by whom?
    expected(LOST, "kill:15", "SIGTERM"),
    expected(CRASHED, "garbage", "a channel that is not its own"),
    expected(LOST, "kill-parent", "lost with the one that started it"),
    expected(CRASHED, "grow", "of memory; the limit is 400 MB", memory=400_000_000),
    expected(
        TIMEOUT, "log:1", PROCESSOR_REACHED, "messages, which takes time", "still here, and talking", output=1_000_000
    ),
    expected(CRASHED, "print", "printed or logged more than 1 MB", "no news", output=1_000_000),
    expected(CRASHED, "close-all", "it closed the channel of its results"),
    expected(
        TIMEOUT, "spin", "the limit of processor time was reached: 1.", "in the call 'fmi2DoStep' of the controller"
    ),
    *(expected(TIMEOUT, what, PROCESSOR_REACHED) for what in ("block-signals", "handlers", "log:0", "fork", "forks")),
    *(expected(TIMEOUT, what, WAITING_REACHED) for what in ("sleep", "lock", "socket")),
    expected(LOST, "stop", WAITING_REACHED),
    expected(ERROR, "status:2", "fmi2DoStep returned discard", "as you wish"),
    expected(ERROR, "status:5", "fmi2DoStep returned pending"),
    expected(ERROR, "status:-1", "illegal status -1"),
    expected(ERROR, "status:3", "fmi2SetReal returned error", where="set", time=0.02025),
    expected(ERROR, "status:3", "fmi2GetReal returned error", where="get"),
    expected(ERROR, "status:3", "enterInitializationMode failed", where="initialize", time=0.0),
    *(expected(ERROR, f"value:{value}", where="get") for value in ("nan", "-inf", "1e300")),
    *(expected(DONE, f"chat:{chat}", time=0.05, output=1000) for chat in ("0:2000:0", "0:2000:1", "3:5:0", "3:5:1")),
    expected(ERROR, "utf8", "caf�"),
    expected(ERROR, "percent", "100 %s of %n and %d%%"),
    expected(ERROR, "null-message"),
    expected(ERROR, "huge-message", "xxxxxxxx"),
    expected(ERROR, "round", "changed how this process computes: rounding upward"),
    *(expected(DONE, what, time=0.05) for what in ("trap", "chdir", "umask", "close-output", "thread")),
]


@pytest.fixture(scope="module")
def healthy(harmless) -> list[CaseRun]:
    """The runs of the two cases with a controller without a fault."""
    runs = run(harmless, short_cases((STRUCK, SPARED)))
    assert [run.result.status for run in runs] == [DONE, DONE]
    return runs


@pytest.mark.parametrize("expected", CORPUS, ids=str)
def test_a_hostile_controller_costs_its_own_case_only(expected, plant_file, faulty, healthy):
    limit = HANG_LIMIT if expected.status is TIMEOUT or expected.fault.what == "stop" else PLENTY
    own = bench(plant_file, faulty(expected.fault), limit, limits=expected.limits)
    struck, spared = run(own, short_cases((STRUCK, SPARED)))
    assert (struck.result.status, struck.result.time) == (expected.status, pytest.approx(expected.time, abs=1e-9))
    assert [word for word in (*expected.words, "") if word not in struck.result.message] == [], struck
    assert "Traceback" not in struck.result.message and "MB" not in struck.kind and "0.02" not in struck.kind
    assert spared.result == healthy[1].result  # bit for bit: no fault leaks into another case
    if expected.status is DONE:
        assert struck.result == healthy[0].result


def test_nine_tenths_of_the_limit_are_no_timeout(plant_file, faulty, healthy):
    limit = 3.0
    own = bench(plant_file, faulty(Fault(f"compute:{0.9 * limit:g}")), limit)
    assert [run.result for run in run(own, short_cases((STRUCK,)))] == [healthy[0].result]


def test_a_warning_is_counted(plant_file, faulty):
    (found,) = run(bench(plant_file, faulty(Fault("status:1", "step", 0.02))), short_cases((STRUCK,)))
    assert (found.result.status, found.result.warnings) == (DONE, 120)


@pytest.mark.parametrize(("what", "status"), [("segfault", CRASHED), ("status:3", ERROR)])
def test_a_controller_that_cannot_be_instantiated(what, status, plant_file, faulty):
    (found,) = run(bench(plant_file, faulty(Fault(what, "instantiate", 0.0))), short_cases((STRUCK,)))
    assert (found.result.status, found.result.time) == (status, 0.0)
    assert "instantiation" in found.result.message


def test_a_crash_in_the_second_instance_goes_away_in_a_process_of_its_own(plant_file, faulty, healthy):
    """Some FMUs can be instantiated once per process. The result of a case must not depend on those before it."""
    own = bench(plant_file, faulty(Fault("segfault", "initialize", 0.0, which=2)))
    assert [run.result for run in run(own, short_cases((STRUCK, SPARED)))] == [run.result for run in healthy]


@pytest.mark.parametrize(
    ("where", "status", "words"),
    [
        ("step", ERROR, "fmi2DoStep returned fatal\n  hostile: as you wish"),
        ("initialize", ERROR, "as you wish"),
        ("terminate", Status.DONE, "fmi2Terminate failed with status 4 (fatal)"),
    ],
)
def test_after_fatal_no_function_is_called(where, status, words, plant_file, faulty):
    own = bench(plant_file, faulty(Fault("status:4", where, 0.02 if where == "step" else 0.0)))
    for found in run(own, short_cases((STRUCK, SPARED))):
        assert found.result.status == status and words in found.result.message, found.result.message


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
    ("body", "status", "words"),
    [
        ("raise RuntimeError('lost its mind')", ERROR, "lost its mind"),
        ("os._exit(7)", CRASHED, "exit code 7"),
        ("sys.exit('leaving')", ERROR, "fmi2DoStep"),
        ("self.do_step(current_time, step_size)", ERROR, "recursion"),
    ],
)
def test_a_hostile_python_controller(body, status, words, plant_file, tmp_path):
    body = f"if current_time > 0.0199: {body}\n        self.law(); return True"
    own = bench(plant_file, python_controller(tmp_path, imports="import os, sys", step_body=body))
    for found in run(own, short_cases((STRUCK, STRUCK))):
        assert (found.result.status, found.result.time) == (status, 0.02), found.result.message
        assert words in found.result.message


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


def test_a_worker_that_does_not_end_in_time_may_be_killed_again(monkeypatch):
    """As on a machine that stood still: its exit code was not there when its channel was closed."""
    monkeypatch.setattr(launch, "EXIT_TIMEOUT", 0.0)
    near, far = socket.socketpair()
    process = launch._ForkedProcess.__new__(launch._ForkedProcess)
    process._code, process._status, process.tree = None, near, SimpleNamespace(kill=lambda: None)
    with far:
        process.kill()
        process.kill()
    assert process.exit_code(0.0) is None


def test_a_worker_that_is_killed_is_replaced(harmless, healthy, monkeypatch):
    with disturbed(monkeypatch, lambda child: child.process.kill()) as started:
        (found,) = run(harmless, short_cases((STRUCK,)))
    assert len(started) == 2
    assert found.result == healthy[0].result


def test_workers_that_never_load_are_an_environment_fault(harmless, monkeypatch):
    with disturbed(monkeypatch, lambda child: child.process.kill(), 99) as started:
        error = refusal(run, harmless, short_cases((STRUCK, SPARED)), kind=EnvironmentFault)
    assert (error.what, len(started)) == ("worker-lost", supervision.ATTEMPTS)
    monkeypatch.undo()
    refusal(list, supervision.run_isolated(job(harmless, "nothing", b"")), kind=EnvironmentFault)  # no such work


@pytest.mark.parametrize("side", ["plant", "controller"])
def test_a_cache_that_is_deleted_is_filled_again(side, harmless, healthy, monkeypatch):
    with disturbed(monkeypatch, lambda child: None) as started:
        shutil.rmtree(getattr(harmless, side).folder)
        (found,) = run(harmless, short_cases((STRUCK,)))
    assert found.result == healthy[0].result
    assert len(started) == 2


SEVENTH = Place(7, CONTROLLER, "")
DIES = SimpleNamespace(is_alive=lambda: True, use=lambda: Use(0.0, 0.0, 0, False, False))


def listened(*messages: bytes, tasks: int = 3, loaded: bool = True, place: Place = SEVENTH, code=-6, late=b""):
    """Outcomes of a worker that sends ``messages``, then ends with the exit ``code``; what is sent ``late`` comes while
    somebody looks whether it has ended."""
    near, far = socket.socketpair()
    output, output_end = os.pipe()
    trace = SharedTrace()
    Trace(trace.buffer).words[:3] = place.sample, place.side, 0
    waiting = [late] if late else []

    def exit_code(patience):
        if waiting:
            far.sendall(waiting.pop())
            far.shutdown(socket.SHUT_WR)
        return code

    process = SimpleNamespace(tree=DIES, exit_code=exit_code, kill=lambda: None)
    given = SimpleNamespace(
        largest=100,
        tasks=(b"",) * tasks,
        time_limits=(60.0,) * tasks,
        sandbox=False,
        limits=Limits(),
        decode=decode,
        longest_call=60.0,
        on_standstill=lambda *_: None,
    )
    with near, far:
        far.sendall((frame(Loaded()) if loaded else b"") + b"".join(messages))
        if not late:
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
    assert found == [Done(0, b"0", 0.5), Done(1, b"1", 0.5), Failed(2, record, 0.1)]


def test_a_failure_that_is_sent_between_two_looks_is_not_taken_for_a_crash():
    record = ErrorRecord("fmu", "it failed", call="fmi2DoStep", log=("why",))
    assert list(listened(late=frame(Failed(0, record, 0.1)))) == [Failed(0, record, 0.1)]
    assert list(listened(tasks=1, late=finished(0))) == [Done(0, b"0", 0.5)]


GARBAGE = {
    "text": b"\x00\x00\x00\x05hello",
    "a value beyond the limit": finished(0, b"0" * 200_000),
    "loaded twice": frame(Loaded()),
    "another index": finished(1),
    "the same index again": finished(0) + finished(0),
    "a value that is not the task's": finished(0, b"1"),
    "a message of the owner's": frame(ErrorRecord("fmu", "")),
}


@pytest.mark.parametrize("name", GARBAGE)
def test_garbage_ends_the_worker(name):
    *before, last = listened(GARBAGE[name])
    assert all(isinstance(outcome, Done) for outcome in before) and len(before) <= 1
    assert isinstance(last, Died) and not last.timeout and not last.outside
    assert last.kind == "it wrote into a channel that is not its own"


def test_a_message_too_early_or_cut_short():
    assert [type(outcome) for outcome in listened(finished(0), loaded=False)] == [Died]
    assert [outcome.kind for outcome in listened(finished(0)[:-1])] == ["the process was ended by SIGABRT"]


@pytest.mark.parametrize("side", [NOBODY, PLANT])
def test_a_process_that_ends_before_the_controller_comes_is_an_environment_fault(side):
    outcomes = listened(loaded=False, place=Place(0, side, ""))
    assert refusal(list, outcomes, kind=EnvironmentFault).what == "worker-lost"
    outcomes = listened(frame(Failed(0, ErrorRecord("environment", "no disk", "disk"), 0.1)), loaded=False)
    assert refusal(list, outcomes, kind=EnvironmentFault).what == "disk", "one of its own stays what it is"


@pytest.mark.parametrize(
    ("code", "outside"), [(-signal.SIGALRM, False), (-signal.SIGKILL, True), (256, True), (3, False)]
)
def test_who_has_ended_a_process(code, outside):
    (found,) = listened(code=code)
    assert (found.timeout, found.outside) == (False, outside)


def test_a_place_that_makes_no_sense_stays_within_the_simulation():
    (case,) = short_cases((STRUCK,))
    for sample, time in ((-5, 0.0), (2**62, float(STRUCK))):
        died = Died(0, False, "", "", 1.0, Place(sample, CONTROLLER, "x"))
        assert case_run(case, died).result.time == time


def test_work_that_removes_its_folder_or_forges_messages(harmless):
    found = list(supervision.run_isolated(job(harmless, "lose_folder", b"0", b"1")))
    assert [outcome.value for outcome in found] == [b"0", b"1"]
    (forged,) = supervision.run_isolated(job(harmless, "forge", finished(0, b"\xff" * 300_000)))
    assert isinstance(forged, Died) and forged.kind == "it wrote into a channel that is not its own"
