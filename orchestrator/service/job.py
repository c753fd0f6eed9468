"""One stage of a run, in a process of its own: the ordinary check, evaluation or verification, by the public face.

It is started in the run's folder, and reads its task from standard input. That stays open as long as the service lives:
when it ends, so does the job, and nothing of it is left over. Progress goes to standard output, one line each; the
outcome is a file, so that it is found even if nobody was there to hear of it.
"""

from __future__ import annotations

import hashlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import chain
from pathlib import Path
from shutil import rmtree
from typing import IO, TYPE_CHECKING

from filelock import FileLock

from ..cache import cache_folder
from ..codec import from_json, to_json
from ..errors import BenchmarkError, Crash, EnvironmentFault, InputError
from .files import DRAWN, EVALUATION, FINDINGS, INTERFACE, QUICK, SCORECARD
from .records import Outcome, Progress, Stage, Task

# Imports inside functions: what computes takes seconds to load, and a process that is to end must hear of it before.

if TYPE_CHECKING:
    from ..benchmark.results import CaseResult
    from ..conformance.finding import Finding
    from ..documents.evaluation import Evaluation
    from ..pairing.controller import Controller

OUTCOME = "{}.json"
"""The file of a stage's outcome."""

LOCK = "job.lock"
"""Held by a job: one whose service was killed may last a little longer than the next service needs to start another."""

GIVEN, SCRATCH = "task.json", "scratch"
"""The task and the cache of a clean interpreter, in the folder of a run: they go with the run if its job is killed."""

LOCK_TIME = 120.0
"""Seconds to wait for it."""

TELL_EVERY = 0.25
"""Seconds between two messages of progress."""

MAX_TEXT = 2000
"""Letters that are kept of a finding: one named 30 variables of 300,000 letters each, on a page of 45 MB."""

BLOCK = 4096
"""Bytes that a file or a folder takes of a disk at the least."""

GRACE = 10.0
"""Seconds that a job has to end by itself, once its service has."""

EXIT_ORPHANED = 75

FAULTS = (
    "no-sandbox",
    "no-compiler",
    "folder-in-use",
    "folder-not-writable",
    "no-dask",
    "no-scheduler",
    "other-version",
)
"""Codes of errors that are those of this machine."""

ADVICE = {
    "connector-missing": "Choose its variables in the form below.",
    "connector-half": "Choose both variables in the form below.",
    "connector-ambiguous": "Choose one in the form below.",
    "connector-parameter": "Leave {value} empty in the form below.",
    "bad-mapping": "Correct the form below.",
    "no-connector": "Correct the form below.",
    "no-variable": "Correct the form below.",
    "wrong-unit": "Choose another variable in the form below.",
    "undriven-input": "Give it a constant in the form for another binding.",
    "other-sample-time": "",
}
"""What to do about a problem on the page of a run, by its stable code."""


def outcome_of(folder: Path, stage: Stage) -> Outcome | None:
    """The outcome that a job has left in a run's ``folder``; None if there is none, or not a whole one."""
    file = folder / OUTCOME.format(stage)
    try:
        return from_json(file.read_bytes(), Outcome) if file.stat().st_size < 1 << 20 else None
    except (OSError, ValueError):
        return None


def main() -> int:
    """Do the task that comes in; returns the exit code, 0 if there is an outcome."""
    task = from_json(_line(0), Task)
    if task.stage != "verifying":
        return work(task)
    from ..execution.interpreter import run_clean

    # A certificate counts only if the interpreter took no code but this package's.
    rmtree(SCRATCH, ignore_errors=True)
    Path(SCRATCH).mkdir(mode=0o700)
    given = Path(SCRATCH, GIVEN).absolute()
    given.write_text(to_json(task, indent=None), encoding="utf-8")
    code = f"from {__package__}.job import run, task_given, work; raise SystemExit(run(lambda: work(task_given())))"
    return run_clean(code, [str(given)], Path(SCRATCH))


def task_given() -> Task:
    """The task in the file that the command line names. Everybody on this machine reads command lines, and a task has
    the bits of its round."""
    file = Path(sys.argv[1])
    task = from_json(file.read_bytes(), Task)
    file.unlink()
    return task


def run(act: Callable[[], int]) -> int:
    """The exit code of ``act``, which may be told to end."""
    try:
        return act()
    except KeyboardInterrupt:
        return EXIT_ORPHANED


def work(task: Task) -> int:
    """Do a task; returns the exit code, 0 if there is an outcome."""
    told = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    # What a library prints is no message.
    os.dup2(2, 1)
    # A service that was started in the background by a script ignores Ctrl-C, and so would its jobs their end.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_service, daemon=True).start()
    with FileLock(LOCK, timeout=LOCK_TIME):
        outcome = done(task, Path.cwd(), _Teller(told))
        from ..documents.files import write_text

        write_text(Path(OUTCOME.format(task.stage)), to_json(outcome))
    return 0


def _line(stream: int) -> bytes:
    """The first line of a stream, and no byte more."""
    line = b""
    while not line.endswith(b"\n") and (byte := os.read(stream, 1)):
        line += byte
    return line


def _end_with_service() -> None:
    """Wait for the end of the service, and end this process as a Ctrl-C does: its workers go with it."""
    import _thread

    # Not sys.stdin, whose lock this thread would hold when the interpreter ends, which then aborts.
    while os.read(0, 1):
        pass
    _thread.interrupt_main()
    time.sleep(GRACE)
    os._exit(EXIT_ORPHANED)


class _Teller:
    """Tells progress; not every case, as a line for each would be much for those who watch a hundred runs."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream, self._last = stream, 0.0

    def __call__(self, progress: Progress, at_once: bool = False) -> None:
        now = time.monotonic()
        if at_once or now - self._last >= TELL_EVERY:
            self._last = now
            print(to_json(progress, indent=None), file=self._stream, flush=True)


Tell = Callable[[Progress, bool], None]


def done(task: Task, folder: Path, tell: Tell) -> Outcome:
    """The outcome of ``task``, whose files are in ``folder``."""
    act = {"checking": _checked, "verifying": _verified}.get(task.stage, _evaluated)
    try:
        _check_file(task)
        _check_protocol(task)
        outcome = act(task, folder, tell)
    except EnvironmentFault as fault:
        outcome = Outcome(task.stage, "fault", str(fault))
    except Crash as crash:
        outcome = Outcome(task.stage, "fault" if crash.what == "killed" else "failed", str(crash))
    except BenchmarkError as error:
        # This machine lacks it, whatever the controller is.
        outcome = Outcome(task.stage, "fault" if getattr(error, "what", "") in FAULTS else "failed", str(error))
    except (OSError, MemoryError) as problem:
        outcome = Outcome(task.stage, "fault", str(problem) or type(problem).__name__)
    from msgspec.structs import replace

    # Extracted, an FMU may be a thousand times as large as the file that was uploaded.
    extracted = _size(cache_folder() / "fmus" / task.sha256) if task.sha256 else 0
    # The FMU as a file is counted by its row, as is no other one: archives had 400 MB in resources/x.fmu for nothing.
    own = sum(_taken(file) for file in (folder / task.file,) if file.is_file())
    disk = _size(folder) - _size(folder / SCRATCH) - own + extracted
    return replace(outcome, disk=disk, reason=outcome.reason[:2000])


def _check_file(task: Task) -> None:
    """Raise :class:`OSError` if the FMU cannot be read, and :class:`EnvironmentFault` if it is not what was uploaded:
    neither is a finding about it."""
    digest = hashlib.sha256()
    with Path(task.file).open("rb") as stream:
        while piece := stream.read(1 << 20):
            digest.update(piece)
    if task.sha256 not in ("", digest.hexdigest()):
        raise EnvironmentFault("The file of the FMU is damaged on this machine: upload it again.")


def _check_protocol(task: Task) -> None:
    """Raise :class:`EnvironmentFault` if the file of the protocol has changed since the service was started: its table
    would have results by both."""
    from ..benchmark import protocol

    with suppress(InputError):  # it is gone, or no protocol any more
        if task.contents in ("", protocol.contents(task.protocol)):
            return
    name = Path(task.protocol).stem
    message = f"The protocol {name} has changed since the service was started. Who runs the service has to put the "
    raise EnvironmentFault(f"{message}former file back, or start it again.")


def _size(folder: Path) -> int:
    """What all that is in a folder takes [bytes]."""
    # Not rglob, which fails where a folder goes meanwhile, as that of a compiler at another run of the same FMU does:
    # the job ended without its outcome.
    return sum(_taken(Path(place, name)) for place, *found in os.walk(folder) for name in chain(*found))


def _taken(path: Path) -> int:
    """What a file or a folder takes of the disk [bytes]: 0.9 MB of an archive held 20,000 of them, which took 80."""
    with suppress(FileNotFoundError):  # gone meanwhile
        return -(-path.lstat().st_size // BLOCK) * BLOCK or BLOCK
    return 0


def _controller(task: Task) -> Controller:
    from ..pairing.controller import Controller

    return Controller(task.file, mapping=task.binding or {})


def _checked(task: Task, folder: Path, tell: Tell) -> Outcome:
    """Check the controller; its findings become a piece of a page, and its variables the form for a binding."""
    from dataclasses import replace

    from ..api.benchmark import Benchmark
    from ..conformance.finding import Severity
    from ..documents.files import write_text
    from ..documents.findings import Findings
    from ..views.page import parts_html
    from .interface import interface_of

    controller = _controller(task)
    problems: list[Finding] = []
    for finding in Benchmark(sandbox=task.sandbox, workers=task.processes).iter_check(controller):
        finding = replace(finding, subject=finding.subject[:MAX_TEXT], text=finding.text[:MAX_TEXT])
        if not problems:  # the archive has been looked at: who waits may look at the form
            with suppress(InputError):  # which the finding tells
                write_text(folder / INTERFACE, to_json(interface_of(controller)))
        problems.append(finding)
        tell(Progress(finding=(finding.severity.value, finding.subject, finding.text[:500])), True)
    findings = Findings(controller.file_name, tuple(problems))
    for finding in problems:
        if advice := ADVICE.get(finding.what, "").format(value=finding.value):
            findings = findings.advised(finding, advice)
    write_text(folder / FINDINGS, parts_html(findings.summary().parts))
    errors = [finding for finding in problems if finding.severity is Severity.ERROR]
    if not errors:
        return Outcome(task.stage, "done", verdict=findings.worst.value)
    # The machine's own, such as a sandbox that is gone while it is upgraded, are held against no controller.
    if fault := next((finding for finding in errors if finding.what in FAULTS), None):
        return Outcome(task.stage, "fault", fault.text)
    return Outcome(task.stage, "refused", errors[0].text, verdict=findings.worst.value)


def _evaluated(task: Task, folder: Path, tell: Tell) -> Outcome:
    """Evaluate the controller; the store in the folder keeps what is finished."""
    from ..api.benchmark import Benchmark
    from ..benchmark.scorecard import cost_so_far
    from ..documents.commands import evaluate_command
    from ..documents.files import REPORT, write_text
    from ..execution import store
    from ..loop.trajectory import Status
    from ..views.page import parts_html
    from ..views.table import Facts

    place = folder / (QUICK if task.stage == "quick" else EVALUATION)
    bench = Benchmark(
        protocol=task.protocol,
        workers=task.processes,
        sandbox=task.sandbox,
        scheduler=task.scheduler or None,
        # The file's name alone: where it is here says nothing elsewhere.
        command=evaluate_command(task.file, task.binding, Path(task.protocol).name),
    )
    results: list[CaseResult] = []

    def on_result(result: CaseResult, done: int, total: int) -> None:
        results.append(result)
        tell(Progress(done, total, cost_so_far(bench.rules, results) if done % 4 == 0 else None), done == total)

    def evaluated() -> Evaluation:
        return bench.evaluate(_controller(task), folder=place, on_result=on_result)

    try:
        evaluation = evaluated()
    except EnvironmentFault as fault:
        if fault.what != store.DAMAGED:
            raise
        # By a power cut or a bad sector. Who owns the run cannot move the file away.
        store.forget(place)
        results.clear()
        evaluation = evaluated()
    evaluation.report(place / REPORT, place)
    # How it was obtained stands in the report below.
    shown = [part for part in evaluation.summary().parts if not isinstance(part, Facts)]
    write_text(place / SCORECARD, parts_html(shown))
    return _outcome(task, evaluation, any(case.status is Status.LOST for case in evaluation.cases))


def _verified(task: Task, folder: Path, tell: Tell) -> Outcome:
    """Verify the controller by the draws that follow from the round's bits. Nothing of it is stored before its end:
    one that was interrupted begins from its first case, and with the same draws."""
    from ..api.benchmark import Benchmark
    from ..benchmark.draws import Entropy
    from ..documents.verification import OF_ROUND, PROTOCOL, USUAL
    from ..loop.trajectory import Status

    usual = task.protocol == PROTOCOL
    certificate = Benchmark(workers=task.processes, sandbox=task.sandbox).verify(
        _controller(task),
        on_result=lambda result, done, total: tell(Progress(done, total), done == total),
        draws=Entropy(task.bits, "round"),
        protocol=task.protocol,
        # What the standard conditions ask for costs most of the time, and with another protocol it gives no standard.
        strict=usual,
        beside=USUAL if usual else (),
    )
    certificate.save(folder / DRAWN)
    cases = (*certificate.cases, *(certificate.strict.cases if certificate.strict else ()))
    return Outcome(
        task.stage,
        "done",
        lost=any(case.status is Status.LOST for case in cases),
        cost=certificate.rank.V,
        holds=certificate.rank.holds,
        remark=certificate.rank.reason,
        deviations="; ".join(words for words in certificate.deviations if words != OF_ROUND)[:2000],
    )


def _outcome(task: Task, evaluation: Evaluation, lost: bool) -> Outcome:
    rank = evaluation.rank
    return Outcome(task.stage, "done", lost=lost, cost=rank.V, holds=rank.holds, remark=rank.reason)


if __name__ == "__main__":
    raise SystemExit(run(main))
