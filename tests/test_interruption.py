"""Interrupted at any point and started again, an evaluation ends with the numbers of an uninterrupted one."""

import os
import random
import resource
import signal
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from hostile.commands import (
    CASES,
    NOISE,
    command,
    finished,
    fork_servers,
    kill,
    session_members,
    simulations,
    started,
    stored,
    wait_for,
)
from hostile.fmus import Fault, hostile_fmu
from hypothesis import given, settings
from hypothesis import strategies as st

from orchestrator import Benchmark
from orchestrator.benchmark.metrics import expected
from orchestrator.benchmark.results import Judgement, Measurements
from orchestrator.cache import VARIABLE
from orchestrator.codec import unpack
from orchestrator.execution import store
from orchestrator.execution.job import Died, Done, Outcome
from orchestrator.execution.messages import ErrorRecord, Failed
from orchestrator.fmi.trace import CONTROLLER, Place
from orchestrator.loop.trajectory import Status
from orchestrator.pairing.runs import CaseRun
from orchestrator.pairing.work import CaseTask
from orchestrator.study import batch
from orchestrator.study import stored as stored_runs
from orchestrator.study.requests import STRIKES, Batch, BatchEntry

pytestmark = pytest.mark.needs("posix")


QUICK = Benchmark("quick", workers=1)
KINDS = ("done", "done", "unstable", "crashed", "timeout", "error")


def outcome(index: int, number: int, kinds: Sequence[str], lost: set[int]) -> Outcome:
    """What comes of case ``number``, always the same but for cases that are ``lost`` to something from outside."""
    kind, place = kinds[number % len(kinds)], Place(number, CONTROLLER, "step")
    if number in lost:
        lost.remove(number)
        return Died(index, False, "SIGKILL", "SIGKILL", 1.0, place, outside=True)
    if kind in ("crashed", "timeout"):
        return Died(index, kind == "timeout", f"{kind} no. {number}", kind, 1.0, place)
    if kind == "error":
        return Failed(index, ErrorRecord("fmu", f"no. {number}"), 1.0)
    case = QUICK.cases[number]
    names = sorted(expected(QUICK.rules, case)) if kind == "done" else ()
    figures = {name: name == "settled" or number / 7.0 for name in names}
    judgement = Judgement(status=Status(kind), time=1.0, measurements=Measurements(**figures))
    return Done(index, judgement, 1.0)


@settings(max_examples=25)
@given(
    stops=st.lists(st.integers(0, 24), max_size=4),
    seed=st.integers(0, 2**32 - 1),
    kinds=st.lists(st.sampled_from(KINDS), min_size=1, max_size=7),
    keep_going=st.booleans(),
    lost=st.sets(st.integers(0, 23), max_size=2),
)
def test_interruption_at_any_point_plus_resume_is_an_uninterrupted_run(own, stops, seed, kinds, keep_going, lost):
    chance = random.Random(seed)
    lost = set(lost) if keep_going else set()  # else three strikes may come before a lost case is tried again

    def evaluated(results: store.Store, stop_after: int, lost: set[int]) -> list[CaseRun] | None:
        """The runs, or None where the evaluation ended after ``stop_after`` outcomes."""

        def execute(jobs):
            left, names = stop_after, [case.id for case in QUICK.cases]
            order = [
                (number_of_job, index, names.index(unpack(task, CaseTask).case.id))
                for number_of_job, job in enumerate(jobs)
                for index, task in enumerate(job.tasks)
            ]
            if keep_going:  # else results depend on which failures come first, as they do without interruption
                chance.shuffle(order)
            for job, index, number in order:
                if left == 0:
                    raise KeyboardInterrupt
                left -= 1
                yield job, outcome(index, number, kinds, lost)

        with suppress(KeyboardInterrupt):
            entry = BatchEntry(QUICK.rules, own, QUICK.cases, None if keep_going else STRIKES)
            return batch.run(Batch((entry,)), execute, results)[0]
        return None

    with store.opened(None) as one, store.opened(None) as two:
        whole = evaluated(one, -1, set())
        for stop_after in stops:
            evaluated(two, stop_after, lost)
        found = evaluated(two, -1, lost)
        if found is None or not all(run.result.status is not Status.LOST for run in found):
            found = evaluated(two, -1, set())
        assert found == whole
        keys = stored_runs.keys(QUICK.rules, QUICK.cases, own)
        kept = {run.case for run in stored_runs.load(two, keys, QUICK.rules, QUICK.cases, own, True).values()}
        assert kept == {run.case for run in whole if run.result.status is not Status.SKIPPED}


@pytest.fixture(scope="module")
def uninterrupted(undisturbed) -> bytes:
    """The table of cases of a run that nobody disturbed."""
    assert stored(undisturbed) == CASES
    return (undisturbed / "cases.csv").read_bytes()


def resumed(folder: Path) -> bytes:
    """The table that the same command writes, run to its end; what was stored is found again."""
    kept = stored(folder)
    done = finished(command(folder, *NOISE))
    assert (f"{kept} of {CASES} cases are there from an earlier run" in done.stderr) == (kept > 0)
    return (folder / "cases.csv").read_bytes()


ATTEMPTS = 20
"""Runs until something is killed: on a busy machine a simulation may be over before this process sees it."""


@pytest.mark.slow
@pytest.mark.parametrize("look", [simulations, fork_servers])
def test_processes_are_killed_now_and_then(look, tmp_path, uninterrupted):
    chance, kills = random.Random(1), 0
    for attempt in range(ATTEMPTS):
        folder = tmp_path / str(attempt)
        with started(command(folder, *NOISE)) as process:
            for rows in range(1, CASES, 7):
                assert wait_for(lambda: stored(folder) >= rows or process.poll() is not None)  # noqa: B023
                found: list[psutil.Process] = []
                assert wait_for(lambda: found.extend(look(process.pid)) or found or process.poll() is not None)  # noqa: B023
                for victim in chance.sample(found, min(1, len(found))):
                    kill(victim)
                    kills += 1
            assert "Traceback" not in process.communicate()[1]
        # A case that was hit twice has no verdict yet.
        assert process.returncode == 0 or resumed(folder) == uninterrupted
        assert (folder / "cases.csv").read_bytes() == uninterrupted
        if kills:
            break
    assert kills > 0


def test_the_parent_is_killed(tmp_path, uninterrupted):
    with started(command(tmp_path, *NOISE)) as process:
        wait_for(lambda: stored(tmp_path) >= 4 or process.poll() is not None)
        kill(process)
        process.wait()
        assert wait_for(lambda: not session_members(process.pid)), "a child outlives its parent"
    assert 4 <= stored(tmp_path) < CASES
    assert resumed(tmp_path) == uninterrupted


def test_a_controller_that_hangs_ends_with_the_command_that_is_killed(tmp_path):
    """Not even one that blocks all signals stays behind."""
    hanging = hostile_fmu(tmp_path, Fault("block-signals", "step", 0.02))
    with started(command(tmp_path / "out", str(hanging), *NOISE, "--timeout", "400")) as process:
        assert wait_for(lambda: any(child.cpu_times().user > 0.3 for child in simulations(process.pid)))
        kill(process)
        process.communicate()
        assert wait_for(lambda: not session_members(process.pid))


def test_control_c_stops_keeps_and_leaves_nothing(tmp_path, uninterrupted):
    with started(command(tmp_path, *NOISE)) as process:
        assert wait_for(lambda: stored(tmp_path) > 3)
        assert interrupted(process) == "interrupted"
    assert stored(tmp_path) > 3
    assert resumed(tmp_path) == uninterrupted


def interrupted(process) -> str:
    """The last line of a command after Ctrl-C, which leaves nothing behind."""
    os.killpg(process.pid, signal.SIGINT)
    errors = process.communicate()[1]
    assert wait_for(lambda: not session_members(process.pid))
    assert process.returncode == 130 and "Traceback" not in errors
    return errors.splitlines()[-1]


def test_control_c_does_not_wait_for_the_compiler(tmp_path):
    """On the very first run the fork server compiles for some ten seconds before it answers."""
    cache = tmp_path / "cache"
    with started(command(tmp_path / "out", *NOISE), environment={VARIABLE: str(cache)}) as process:
        assert wait_for(lambda: any(server.cpu_times().user > 1.5 for server in fork_servers(process.pid)))
        assert interrupted(process) == "interrupted"
    assert not list(cache.rglob("closed_loop.run*.nbc")), "it waited until everything was compiled"


def test_a_file_that_may_not_grow(tmp_path, uninterrupted):
    """RLIMIT_FSIZE fails writes as a quota or a full disk does."""
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    limited = finished(
        command(tmp_path, *NOISE), preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, hard))
    )
    assert limited.returncode == 1
    assert 0 < stored(tmp_path) < CASES
    assert resumed(tmp_path) == uninterrupted
