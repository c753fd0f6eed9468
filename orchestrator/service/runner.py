"""Runs what waits: a process for each stage, watched, ended with the service, and heard of by whoever looks on.

All of it happens in the one thread of the service; what takes long is in the jobs.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import sys
import time
from asyncio.subprocess import PIPE, Process
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..cache import PRIVATE, VARIABLE
from ..codec import from_json, to_json
from ..errors import BenchmarkError, EnvironmentFault
from ..text import printable
from . import queue, states
from .database import Changed, Database
from .files import BINDING, FULL, LOG, Files
from .job import OUTCOME, outcome_of
from .records import Conduct, Outcome, Progress, Stage, Submission, Task

JOB = ("-m", f"{__package__}.job")
"""What the interpreter is started with."""

LOOK_EVERY = 1.0
"""Seconds between two looks for what waits, beside those when something happens: a delay may have passed."""

HOLD_TIME = 10.0
"""Seconds that a run is passed over whose folder cannot be written."""

END_TIME = 15.0
"""Seconds that a job has to end when it is told to, or has an outcome."""

GONE = "the FMU is not there any more: upload it again"

MAX_LINE = 1 << 16
"""Longest message of a job [bytes]."""

MAX_LOG = 1 << 16
"""What is kept of a job's log [bytes] in the reason of a fault, and in a folder when it begins again."""

MAX_FINDINGS = 200

logger = logging.getLogger(__name__)


@dataclass
class Live:
    """What is known of a stage under way: its process, the latest progress, the findings of a check so far."""

    run: Submission
    process: Process | None = None
    progress: Progress = field(default_factory=Progress)
    findings: deque[tuple[str, str, str]] = field(default_factory=lambda: deque(maxlen=MAX_FINDINGS))
    unwanted: bool = False


class Runner:
    """Gives the runs of a database their stages, one process each."""

    def __init__(
        self,
        database: Database,
        files: Files,
        conduct: Conduct,
        held: Mapping[Stage, str],
        job: tuple[str, ...] = JOB,
    ) -> None:
        self._database, self._files, self._conduct, self._held_by, self._job = database, files, conduct, held, job
        self.live: dict[str, Live] = {}
        self._held: dict[str, float] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._woken, self._news = asyncio.Event(), asyncio.Event()
        self._closing = False

    def recover(self) -> None:
        """After the end of an earlier service: what had ended is stored, what was under way is queued again, and
        nothing is left lying about."""
        for run in self._database.running():
            assert run.stage is not None
            # Before a round is closed whose date has passed: what had finished by then counts.
            outcome, now = outcome_of(self._files.run(run.id), run.stage), time.time()
            change = states.interrupted(run) if outcome is None else states.ended(run, outcome, now)
            self._database.change(run, *change, now)
        self._files.sweep(self._database.ids(), self._database.files(), self._database.counted())

    def wake(self) -> None:
        """There is something new: for the queue, and for those who look on."""
        self._woken.set()
        news, self._news = self._news, asyncio.Event()
        news.set()

    async def news(self, timeout: float) -> bool:
        """Wait until something has happened to any run; False if nothing has for so long [s]."""
        try:
            await asyncio.wait_for(self._news.wait(), timeout)
        except asyncio.TimeoutError:
            return False
        return True

    def is_storing(self, moment: float) -> bool:
        """Whether an outcome of before this ``moment`` is not stored yet, as while the database is locked."""
        # By the files: a service that was stopped, or at work, over a date has not heard of the end of a job. What
        # finished in time did not count then, and after a kill -9 it did.
        return any(not live.unwanted and self._had_outcome(live, moment) for live in self.live.values())

    def _had_outcome(self, live: Live, moment: float) -> bool:
        """Whether the stage of a run had an outcome at this ``moment``."""
        assert live.run.stage is not None
        try:
            return (self._files.run(live.run.id) / OUTCOME.format(live.run.stage)).stat().st_mtime <= moment
        except OSError:
            return False

    def place(self, run: Submission) -> int | None:
        """How many stages of the same length begin before that of a run; None if it does not wait."""
        return queue.places(self._database.waiting(), self._database.served()).get(run.id)

    async def work(self) -> None:
        """Start what may begin, until :meth:`close`."""
        # No cancellation: wait_for of Python 3.11 loses one that comes together with what it waits for.
        while not self._closing:
            self._woken.clear()
            try:
                self._drop_removed()
                self._end_done()
                while (run := self._next()) is not None:
                    self._start(run)
            except Changed:  # cancelled or removed since it was looked for
                continue
            except BenchmarkError as problem:
                # A full disk or a locked database: it is looked for again, and nothing is lost.
                logger.warning("%s", problem)
                await asyncio.sleep(LOOK_EVERY)
            except Exception:  # a mistake of ours, which costs a line in the log and not the queue of everybody
                logger.exception("The queue has failed, and goes on.")
                await asyncio.sleep(LOOK_EVERY)
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._woken.wait(), LOOK_EVERY)

    def stop(self) -> None:
        """Begin no stage any more, and hold the end of none against anybody."""
        self._closing = True

    async def close(self) -> None:
        """End all jobs. Their stages begin again with the next service."""
        self.stop()
        self.wake()
        tasks = list(self._tasks)
        for live in self.live.values():
            _let_go(live.process)
        if tasks:
            await asyncio.wait(tasks, timeout=END_TIME)
        for live in self.live.values():
            _kill(live.process)

    def cancel(self, run: Submission) -> Submission:
        """End a run; raises :class:`.Changed` if it is another by now."""
        after = self._database.change(run, *states.cancelled(run), time.time())
        self._drop(run.id)
        self.wake()
        return after

    def remove(self, run: Submission) -> None:
        """Remove a run and all that is its own. What a job may still write into its folder goes when it has ended."""
        comparisons = self._database.comparisons_with(run.id)
        try:
            self._database.remove_run(run.id)
        except EnvironmentFault as problem:
            # Of no other fault: where the file could not be changed at all, results were gone, and the run was not.
            if problem.what != FULL:
                raise
            # Its results make the room that the database needs for that. Else they go after the row, so
            # that a power cut between the two leaves no run without them.
            self._files.remove_run(run.id, at_once=True)
            self._database.remove_run(run.id)
        for id in comparisons:  # they show its results
            self._database.remove_comparison(id)
            self._files.remove_comparison(id)
        self._drop(run.id)
        self._clear(run)
        self.wake()

    def _clear(self, run: Submission) -> None:
        """Remove the folder of a run that is no more, and its FMU with what was extracted, if no other run has it."""
        self._files.remove_run(run.id)
        if not self._database.is_used(run.sha256):
            self._files.remove_fmu(run.sha256)
        elif run.sha256 not in self._database.counted():
            # Of another run with this FMU, which was cancelled before its check: it counts none of it.
            self._forget_extracted(run.sha256)

    def _forget_extracted(self, sha256: str) -> None:
        """Remove what was extracted of an FMU, which no row counts, and so nobody's quota; unless a job is at work with
        it, after which it is counted, or removed."""
        if not any(live.run.sha256 == sha256 for live in self.live.values()):
            self._files.forget_extracted(sha256)

    def _drop(self, id: str) -> None:
        if (live := self.live.get(id)) is not None and not live.unwanted:
            live.unwanted = True
            _let_go(live.process)
            # One that does not end, such as a process that was stopped, would keep its place.
            asyncio.get_running_loop().call_later(END_TIME, self._end, live)

    def _end(self, live: Live) -> None:
        if self.live.get(live.run.id) is live:
            _kill(live.process)

    def _drop_removed(self) -> None:
        """End the jobs of runs that are no more: whoever removes somebody is another process."""
        for id in [id for id in self.live if self._database.run(id) is None]:
            self._drop(id)

    def _end_done(self) -> None:
        """End the jobs that have had an outcome for a while, and have not ended: a round would wait for them."""
        for live in self.live.values():
            process = live.process
            if process is not None and process.returncode is None and self._had_outcome(live, time.time() - END_TIME):
                _kill(process)

    def begin_anew(self, run: Submission, binding: str) -> Submission:
        """Bind a refused run otherwise; raises :class:`.Changed` if it is another by now."""
        # The change first: who comes too late, with a form that was sent slowly, takes nobody's results away.
        after = self._database.change(run, *states.bound(run, len(binding.encode())), time.time(), binding)
        self._files.forget_results(run.id)
        self.wake()
        return after

    def retry(self, run: Submission) -> Submission:
        """Begin again with a run that failed or was cancelled; raises :class:`.Changed` if it is another by now."""
        after = self._database.change(run, *states.retried(run), time.time())
        self.wake()
        return after

    def _next(self) -> Submission | None:
        if self._closing:
            return None
        now = time.monotonic()
        # One that was cancelled and begun again waits until its former process has ended.
        waiting = [
            run for run in self._database.waiting() if run.id not in self.live and self._held.get(run.id, 0.0) <= now
        ]
        under_way = [live.run for live in self.live.values()]
        return queue.chosen(waiting, under_way, self._database.served(), self._conduct.evaluations, time.time())

    def _start(self, run: Submission) -> None:
        assert run.stage is not None
        fault = ""
        try:
            binding = self._database.binding(run.id)
            folder = self._files.begin(run.id, run.sha256, run.file_name, binding)
            # An outcome is taken over only if a service has ended during this very stage: one of a former attempt,
            # binding or round, or one that the FMU itself has written there, decides nothing.
            if not run.interruptions or outcome_of(folder, run.stage) is None:
                self._files.forget_outcome(run.id, OUTCOME.format(run.stage))
        except EnvironmentFault as problem:
            if problem.what == FULL:
                # All others go on, at once: a dozen runs that could not begin had stopped them.
                logger.warning("%s", problem)
                self._held[run.id] = time.monotonic() + HOLD_TIME
                return
            # A folder that nobody may read, as after a restore by another user, kept its round from being final.
            folder, fault = None, GONE if problem.what == "no-file" else str(problem)
        self._held.pop(run.id, None)
        # A clock that was set back must not have those wait for it who were served before.
        now = max([time.time(), *(last + 1e-3 for last in self._database.served().values())])
        run = self._database.change(run, *states.started(run, now), time.time())
        live = self.live[run.id] = Live(run)
        task = asyncio.create_task(self._watch(live, folder, fault))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        self.wake()

    async def _watch(self, live: Live, folder: Path | None, fault: str) -> None:
        """One stage from its start to its outcome; without a ``folder`` it cannot start, for the reason ``fault``."""
        stage = live.run.stage
        assert stage is not None
        try:
            if folder is None:
                outcome = Outcome(stage, "fault", fault)
            else:
                # An earlier service may have ended between the outcome and the change that tells of it.
                outcome = outcome_of(folder, stage) or await self._done(live, folder, stage)
        except OSError as problem:
            outcome = Outcome(stage, "fault", f"the job could not be started: {problem.strerror or problem}")
        except EnvironmentFault as problem:
            outcome = Outcome(stage, "fault", str(problem))
        except Exception as problem:  # such as a thread that cannot be started, which kept the place for ever
            logger.exception("A stage has failed.")
            outcome = Outcome(stage, "fault", f"the job could not be started: {problem}")
        finally:
            _kill(live.process)
        await self._settle(live, outcome)

    async def _settle(self, live: Live, outcome: Outcome) -> None:
        """Store the outcome, and have room for another run."""
        stored = False
        try:
            stored = await self._stored(live, outcome)
        except Exception:  # a mistake of ours: the stage begins again, a limited number of times
            logger.exception("The outcome of a run could not be stored.")
            with contextlib.suppress(Changed, BenchmarkError):
                self._database.change(live.run, *states.interrupted(live.run), time.time())
        finally:
            self.live.pop(live.run.id, None)
            self.wake()
        if self._database.run(live.run.id) is None:
            self._clear(live.run)
        elif not (stored and outcome.disk):
            # By a job that was ended, or had an outcome when its run was cancelled, and had not ended yet.
            self._forget_extracted(live.run.sha256)

    async def _stored(self, live: Live, outcome: Outcome) -> bool:
        """Store the outcome, which is tried until it is stored: a full disk may have room again. Returns whether it is;
        nobody wants that of a run that was cancelled or removed."""
        while not (live.unwanted or self._closing):
            try:
                self._database.change(live.run, *states.ended(live.run, outcome, time.time()), time.time())
                return True
            except Changed:  # cancelled or removed meanwhile
                return False
            except BenchmarkError as problem:
                logger.warning("%s", problem)
                await asyncio.sleep(LOOK_EVERY)
        return False

    async def _done(self, live: Live, folder: Path, stage: Stage) -> Outcome:
        log = folder / LOG
        with log.open("wb") as stream:
            live.process = process = await asyncio.create_subprocess_exec(
                *(sys.executable, *self._job),
                cwd=folder,
                stdin=PIPE,
                stdout=PIPE,
                stderr=stream,
                env=environment(self._files, self._conduct.sandbox),
                limit=MAX_LINE,
                # A Ctrl-C in the service's terminal is not for its jobs: it tells them itself.
                start_new_session=True,
            )
        assert process.stdin is not None and process.stdout is not None
        with contextlib.suppress(ConnectionError):
            process.stdin.write(to_json(self._task(live.run, stage), indent=None).encode() + b"\n")
            await process.stdin.drain()
        if live.unwanted or self._closing:
            _let_go(process)
        try:
            await asyncio.wait_for(self._listen(live, process), self._conduct.time(stage))
            code = await asyncio.wait_for(process.wait(), END_TIME)
        except asyncio.TimeoutError:
            _kill(process)
            await process.wait()
            # A service that was stopped itself for so long (SIGSTOP) finds here what was done in time.
            if (outcome := outcome_of(folder, stage)) is not None:
                return outcome
            limit = f"{states.WORDS[stage]} took longer than {self._conduct.time(stage):g} s"
            return Outcome(stage, "failed", limit)
        # It is written last of all: how the process ended after that does not matter.
        if (outcome := outcome_of(folder, stage)) is not None:
            return outcome
        how = f"was ended by signal {-code}" if code < 0 else f"ended with the exit code {code}"
        return Outcome(stage, "fault", f"the process of {states.WORDS[stage]} {how}{_last_line(log)}")

    async def _listen(self, live: Live, process: Process) -> None:
        """Take the messages of a job until it has no more."""
        assert process.stdout is not None
        while True:
            try:
                line = await process.stdout.readline()
            except ValueError:  # longer than any message
                continue
            if not line:
                return
            with contextlib.suppress(ValueError):
                progress = from_json(line, Progress)
                if progress.finding is not None:
                    live.findings.append(progress.finding)
                else:
                    cost = live.progress.cost if progress.cost is None else progress.cost
                    live.progress = Progress(progress.done, progress.total, cost)
                self.wake()

    def _task(self, run: Submission, stage: Stage) -> Task:
        conduct, round = self._conduct, self._database.round(run.round)
        return Task(
            stage=stage,
            file=run.file_name,
            binding=BINDING if run.bound else "",
            protocol=protocol_of(conduct, stage),
            processes=conduct.processes,
            sandbox=conduct.sandbox,
            scheduler=conduct.scheduler if stage == "evaluating" else "",
            sha256=run.sha256,
            bits=round.bits if round is not None else "",
            contents=self._held_by.get(stage, ""),
        )


def protocol_of(conduct: Conduct, stage: Stage) -> str:
    """The name or the file of the protocol that a stage is done by."""
    return {"quick": conduct.quick_protocol, "verifying": conduct.drawn_protocol}.get(stage, conduct.protocol)


def environment(files: Files, sandbox: bool) -> Mapping[str, str]:
    """The environment of a job: that of the service, with a cache of its own, so that what is deleted is deleted; no
    module is looked for in the folder of a run. Where a ``sandbox`` is used, it shows nothing of the service's folder,
    and sources are compiled in none but one."""
    private = {PRIVATE: str(files.root)} if sandbox else {}
    return {**os.environ, VARIABLE: str(files.cache), **private, "PYTHONSAFEPATH": "1"}


def _let_go(process: Process | None) -> None:
    """Tell a job to end: it does when its standard input is closed."""
    if process is not None and process.stdin is not None:
        process.stdin.close()


def _kill(process: Process | None) -> None:
    """End what is left of a job, with all processes of its session."""
    if process is not None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)


def _last_line(log: Path) -> str:
    """What a job said last."""
    try:
        with log.open("rb") as stream:
            stream.seek(max(log.stat().st_size - MAX_LOG, 0))
            lines = printable(stream.read(MAX_LOG)).strip().splitlines()
    except OSError:
        return ""
    return f": {lines[-1][:300]}" if lines else ""
