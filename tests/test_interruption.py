"""Interrupted at any point and started again, an evaluation ends with the numbers of an uninterrupted one."""

from __future__ import annotations

import argparse
import ctypes
import os
import random
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path

import psutil
import pytest
from conftest import build_or_skip
from hostile.commands import CASES, NOISE, command, finished, kill, session_members, simulations, started, wait_for
from hostile.fmus import Fault, hostile_fmu
from hostile.runs import PROTOCOL
from hypothesis import given, settings
from hypothesis import strategies as st

from orchestrator import evaluate
from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.metrics import CaseResult, Measurement
from orchestrator.commands import nominal_parameters
from orchestrator.cosim.archive import open_archive
from orchestrator.cosim.trace import CONTROLLER, Place
from orchestrator.cosim.trajectory import Status
from orchestrator.errors import FmuError
from orchestrator.execution import store
from orchestrator.execution.evaluation import Bench
from orchestrator.execution.job import Died, Failed, Finished, Job, Outcome
from orchestrator.folders import VARIABLE

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


# ---- Any point: with outcomes out of thin air ----


class World:
    """A bench and the cases of the quick protocol; nothing is simulated with them."""

    def __init__(self, plant: Path, controller: Path) -> None:
        self.bench = Bench(open_archive(plant), open_archive(controller))
        self.cases = protocols.cases(PROTOCOL, nominal_parameters(self.bench.plant, {}), 0)
        self.keys = store.keys(PROTOCOL, self.cases, self.bench)


@pytest.fixture(scope="module")
def world(plant_file, pid_file) -> World:
    """The plant and the default controller."""
    return World(plant_file, pid_file)


KINDS = ("done", "done", "unstable", "crashed", "timeout", "error")


def outcome(index: int, number: int, kinds: Sequence[str], lost: set[int]) -> Outcome:
    """What comes of case ``number``, always the same but for cases that are ``lost`` to something from outside."""
    kind = kinds[number % len(kinds)]
    if number in lost:
        lost.remove(number)
        told = "the process was ended by SIGKILL"
        return Died(index, False, told, told, 1.0, Place(7, CONTROLLER, "step"), outside=True)
    if kind == "crashed":
        told = "the process was ended by SIGSEGV"
        return Died(index, False, f"{told} no. {number}", told, 1.0, Place(number, CONTROLLER, "step"))
    if kind == "timeout":
        told = "the time limit was reached"
        return Died(index, True, told, told, 1.0, Place(number, CONTROLLER, "step"))
    if kind == "error":
        return Failed(index, FmuError(f"no. {number}"), 1.0)
    figures = Measurement({"B1": number / 3.0}, (number / 7.0, 1e-300), 0.1 + number, None)
    return Finished(index, {"status": Status(kind), "time": 26.0, "message": "", "measurement": figures}, 1.0)


@settings(max_examples=25)
@given(
    stops=st.lists(st.integers(0, 24), max_size=4),
    seed=st.integers(0, 2**32 - 1),
    kinds=st.lists(st.sampled_from(KINDS), min_size=1, max_size=7),
    keep_going=st.booleans(),
    lost=st.sets(st.integers(0, 23), max_size=2),
)
def test_interruption_at_any_point_plus_resume_is_an_uninterrupted_run(world, stops, seed, kinds, keep_going, lost):
    options = argparse.Namespace(force=False, scheduler=None, jobs=1, keep_going=keep_going)
    cases, keys, own = world.cases, world.keys, world.bench
    number_of = {case: number for number, case in enumerate(cases)}
    chance = random.Random(seed)
    lost = lost if keep_going else set()  # else three strikes may come before a lost case is tried again

    def evaluated(folder: Path, stop_after: int, lost: set[int]) -> list[CaseResult] | None:
        """The results, or None where the run ended after ``stop_after`` outcomes."""

        def execute(jobs: Sequence[Job], workers: int) -> Generator[tuple[int, Outcome], None, None]:
            left = stop_after
            order = [(job, index) for job in range(len(jobs)) for index in range(len(jobs[job].tasks))]
            if keep_going:  # else results depend on which failures come first, as they do without interruption
                chance.shuffle(order)
            for job, index in order:
                if left == 0:
                    raise KeyboardInterrupt
                left -= 1
                yield job, outcome(index, number_of[jobs[job].tasks[index]], kinds, lost)

        with pytest.MonkeyPatch.context() as patch, store.opened(folder) as results:
            patch.setattr(evaluate.pool, "run", execute)
            patch.setattr(evaluate, "progress", lambda *_: nullcontext(lambda found: None))
            with suppress(KeyboardInterrupt):
                return evaluate._run(PROTOCOL, cases, own, results, options)
        return None

    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        whole = evaluated(Path(one), -1, set())
        assert whole is not None
        lost = set(lost)
        for stop_after in stops:
            evaluated(Path(two), stop_after, lost)
        found = evaluated(Path(two), -1, lost)
        if lost or any(not result.final for result in found or ()):
            found = evaluated(Path(two), -1, set())
        assert found == whole
        with store.opened(Path(two)) as results:
            stored = {result.case for result in results.load(keys, store.conditions(own))}
        assert stored == {result.case for result in whole if result.status is not Status.SKIPPED}


# ---- Real processes ----


@pytest.fixture(scope="module")
def complete(tmp_path_factory) -> Path:
    """The folder of a run that nobody disturbed."""
    folder = tmp_path_factory.mktemp("uninterrupted")
    finished(command(folder, *NOISE))
    assert stored(folder) == CASES
    return folder


@pytest.fixture(scope="module")
def uninterrupted(complete) -> bytes:
    """Its table of cases."""
    return (complete / "cases.csv").read_bytes()


def stored(folder: Path) -> int:
    """Rows in the store of a folder."""
    with suppress(sqlite3.Error):
        connection = sqlite3.connect(f"file:{folder / 'cases.sqlite'}?mode=ro", uri=True)
        try:
            return int(connection.execute("SELECT count(*) FROM results").fetchone()[0])
        finally:
            connection.close()
    return 0


def resumed(folder: Path) -> tuple[subprocess.CompletedProcess[str], bytes]:
    """The same command again, to its end, and the table it writes."""
    done = finished(command(folder, *NOISE))
    return done, (folder / "cases.csv").read_bytes()


def test_children_are_killed_at_random_times(tmp_path, uninterrupted):
    kills = 0
    with started(command(tmp_path, *NOISE)) as process:
        while process.poll() is None:
            time.sleep(random.uniform(0.1, 0.4))
            victims = simulations(process.pid)
            if victims and process.poll() is None:
                kill(random.choice(victims))
                kills += 1
        assert "Traceback" not in process.communicate()[1]
    assert kills > 0
    if process.returncode != 0:  # a case was hit twice: it has no verdict yet
        resumed(tmp_path)
    assert (tmp_path / "cases.csv").read_bytes() == uninterrupted


def test_the_fork_server_is_killed(tmp_path, uninterrupted):
    with started(command(tmp_path, *NOISE)) as process:
        assert wait_for(lambda: stored(tmp_path) > 3 or process.poll() is not None)
        for member in session_members(process.pid):
            if member.pid != process.pid and "forkserver" in " ".join(member.cmdline()) and member.children():
                kill(member)
        errors = process.communicate(timeout=60)[1]
        assert "Traceback" not in errors
    assert (tmp_path / "cases.csv").read_bytes() == uninterrupted or resumed(tmp_path)[1] == uninterrupted


def test_the_parent_is_killed_at_random_times(tmp_path, uninterrupted):
    before = 0
    for rows in sorted(random.sample(range(1, 16), 2)):
        with started(command(tmp_path, *NOISE)) as process:
            wait_for(lambda: stored(tmp_path) >= rows or process.poll() is not None)  # noqa: B023
            time.sleep(random.uniform(0.0, 0.1))
            kill(process)
            process.wait()
            assert wait_for(lambda: not session_members(process.pid), 5.0), "a child outlives its parent"  # noqa: B023
        assert stored(tmp_path) >= max(rows, before)
        before = stored(tmp_path)
    done, table = resumed(tmp_path)
    assert f"{before} of {CASES} cases are there from an earlier run" in done.stderr
    assert table == uninterrupted


def test_a_killed_parent_leaves_no_hanging_child(tmp_path):
    """Not even one that blocks all signals: on Linux it goes with its parent, elsewhere with its time limit."""
    hanging = build_or_skip(lambda: hostile_fmu(tmp_path, Fault("block-signals", "step", 0.02)))
    with started(command(tmp_path / "out", str(hanging), *NOISE, "--timeout", "400")) as process:
        assert wait_for(lambda: any(child.cpu_times().user > 0.5 for child in simulations(process.pid)))
        kill(process)
        process.wait()
        assert wait_for(lambda: not session_members(process.pid), 10.0 if sys.platform == "linux" else 60.0)


def test_control_c_stops_keeps_and_leaves_nothing(tmp_path, uninterrupted):
    with started(command(tmp_path, *NOISE)) as process:
        assert wait_for(lambda: stored(tmp_path) > 3)
        os.killpg(process.pid, signal.SIGINT)
        begin = time.monotonic()
        errors = process.communicate(timeout=30)[1]
        assert time.monotonic() - begin < 6.0  # 2 s where nobody else keeps the machine busy
        assert process.returncode == 130
        assert "Traceback" not in errors
        assert errors.endswith("interrupted\n")
        assert wait_for(lambda: not session_members(process.pid), 2.0)
    kept = stored(tmp_path)
    assert kept > 3
    done, table = resumed(tmp_path)
    assert f"{kept} of {CASES} cases are there" in done.stderr
    assert table == uninterrupted


def test_control_c_does_not_wait_for_the_compiler(tmp_path):
    """On the very first run the fork server compiles for some ten seconds before it answers."""
    with started(command(tmp_path / "out", *NOISE), environment={VARIABLE: str(tmp_path / "cache")}) as process:
        assert wait_for(lambda: any(server.cpu_times().user > 2.0 for server in fork_servers(process.pid)))
        os.killpg(process.pid, signal.SIGINT)
        begin = time.monotonic()
        errors = process.communicate(timeout=60)[1]  # all that has a pipe of this session's has ended, too
        assert time.monotonic() - begin < 3.0
        assert (process.returncode, "Traceback" in errors) == (130, False), errors
        assert errors.endswith("interrupted\n")
        assert wait_for(lambda: not session_members(process.pid), 2.0)


def fork_servers(session: int) -> list[psutil.Process]:
    """The fork server of a command, once it is there."""
    with suppress(psutil.Error):
        return [member for member in session_members(session) if "forkserver" in " ".join(member.cmdline())]
    return []


def test_control_c_ends_a_controller_that_hangs(tmp_path):
    hanging = build_or_skip(lambda: hostile_fmu(tmp_path, Fault("block-signals", "step", 0.02)))
    with started(command(tmp_path / "out", str(hanging), *NOISE, "--timeout", "400")) as process:
        assert wait_for(lambda: any(child.cpu_times().user > 0.5 for child in simulations(process.pid)))
        os.killpg(process.pid, signal.SIGINT)
        errors = process.communicate(timeout=30)[1]
        assert (process.returncode, "Traceback" in errors) == (130, False)
        assert wait_for(lambda: not session_members(process.pid), 2.0)


def test_a_finished_evaluation_is_not_run_again_but_with_force(tmp_path, complete, uninterrupted):
    folder = Path(shutil.copytree(complete, tmp_path / "out"))
    done, table = resumed(folder)
    assert f"{CASES} of {CASES} cases are there" in done.stderr
    assert table == uninterrupted
    forced = finished(command(folder, *NOISE, "--force"))
    assert "are there from an earlier run" not in forced.stderr
    assert (folder / "cases.csv").read_bytes() == uninterrupted
    assert stored(folder) == CASES


def test_what_was_made_with_other_parameters_is_not_used(tmp_path, complete):
    folder = Path(shutil.copytree(complete, tmp_path / "out"))
    changed = finished(command(folder, "--only", "c00.compliant.noise", "--set", "K_p[1]=46"))
    assert "are there from an earlier run" not in changed.stderr
    assert stored(folder) == CASES + 1


def test_two_evaluations_into_one_folder(tmp_path, uninterrupted):
    with started(command(tmp_path, *NOISE)) as process:
        assert wait_for(lambda: stored(tmp_path) > 0)
        second = finished(command(tmp_path, *NOISE))
        assert second.returncode == 2
        assert f"error: Another evaluation is writing into {tmp_path}" in second.stderr
        process.communicate(timeout=60)
    assert (tmp_path / "cases.csv").read_bytes() == uninterrupted


# ---- Disks ----


def test_a_file_that_may_not_grow(tmp_path, uninterrupted):
    """RLIMIT_FSIZE fails writes as a quota or a full disk does."""
    limit = 40_000

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))

    stopped = finished(command(tmp_path, *NOISE), preexec_fn=limited)
    assert stopped.returncode == 1
    assert "What is committed is kept" in stopped.stderr
    kept = stored(tmp_path)
    assert 0 < kept < CASES
    done, table = resumed(tmp_path)
    assert f"{kept} of {CASES} cases are there" in done.stderr
    assert table == uninterrupted


def test_results_that_cannot_be_written(tmp_path, complete, uninterrupted):
    """All cases are in the store, but what is made of them finds no place."""
    folder = Path(shutil.copytree(complete, tmp_path / "out"))
    (folder / "results.json").unlink()
    (folder / "results.json" / "in" / "the way").mkdir(parents=True)
    stopped = finished(command(folder, *NOISE))
    assert stopped.returncode == 1
    assert f"error: {folder / 'results.json'} cannot be replaced" in stopped.stderr
    shutil.rmtree(folder / "results.json")
    assert resumed(folder)[1] == uninterrupted


def test_a_full_disk(tmp_path):
    mount = tmp_path / "small"
    mount.mkdir()
    size = ["-t", "tmpfs", "-o", "size=120k", "tmpfs", str(mount)]
    if subprocess.run(["mount", *size], capture_output=True, check=False).returncode != 0:
        pytest.skip("only root may mount a small file system")
    try:
        stopped = finished(command(mount / "out", *NOISE))
        assert stopped.returncode == 1
        assert "No space left" in stopped.stderr or "What is committed is kept" in stopped.stderr
    finally:
        subprocess.run(["umount", "-l", str(mount)], check=True)


def test_a_folder_that_cannot_be_written(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    folder.chmod(0o555)
    refused = finished(command(folder, "--only", "c00.*.noise"), preexec_fn=without_root_privileges)
    assert refused.returncode == 2
    assert f"error: The output folder {folder} cannot be written to" in refused.stderr


def without_root_privileges() -> None:
    """Root may write everywhere, unless it gives that up (Linux: PR_CAPBSET_DROP of CAP_DAC_OVERRIDE)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(24, 1)
