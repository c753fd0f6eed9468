"""Time limits count processor time and waiting, whatever else the machine does."""

import subprocess
import sys
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.execution.process_tree import ProcessTree, Use, exit_code
from orchestrator.execution.time_limit import (
    IDLE_SHARE,
    MAX_INTERVAL,
    PROCESSOR_REACHED,
    WAITING_FACTOR,
    WAITING_REACHED,
    Reading,
    Stopwatch,
    TimeSpent,
)

durations = st.floats(1e-3, 1e4)
shares = st.floats(0.0, 1.0)


def spent(*steps: tuple[float, float, bool]) -> TimeSpent:
    """After looks at these intervals [s], at processor time per second, and at whether the process was ready."""
    looks = [Reading(0.0, Use(0.0, 0.0, 0, False, False))]
    for interval, share, ready in steps:
        last = looks[-1]
        looks.append(Reading(last.time + interval, Use(last.use.processor + share * interval, 0.0, 0, ready, False)))
    total = TimeSpent()
    for one, next in pairwise(looks):
        total = total.after(one, next)
    return total


@given(st.lists(st.tuples(durations, shares, st.just(True)), max_size=20))
def test_who_is_ready_to_compute_does_not_wait(steps):
    """A process that gets no processor, as on a busy machine, spends neither time."""
    total = spent(*steps)
    assert total.waited == 0.0
    assert total.processor == pytest.approx(sum(interval * share for interval, share, _ in steps), rel=1e-6, abs=1e-9)


@given(durations, st.floats(1.0, 100.0), st.floats(2 * IDLE_SHARE, 1.0))
def test_who_computes_now_and_then_does_not_wait_because_others_slow_it_down(period, slower, share):
    """Of each period a share is computed; on a busy machine that takes longer, in which it stands in the queue."""
    computed = share * period
    queued = (slower - 1.0) * computed
    one = Reading(0.0, Use(0.0, 0.0, 0, False, False))
    assert TimeSpent().after(one, Reading(period + queued, Use(computed, queued, 0, False, False))).waited == 0.0


@given(st.lists(st.tuples(durations, st.just(0.0), st.just(False)), max_size=20))
def test_who_sleeps_waits(steps):
    total = spent(*steps)
    assert total.processor == 0.0
    assert total.waited == pytest.approx(sum(min(interval, MAX_INTERVAL) for interval, _, _ in steps))


@given(st.lists(st.tuples(durations, shares, st.booleans()), max_size=20))
def test_time_is_never_counted_twice(steps):
    total = spent(*steps)
    assert total.processor + total.waited <= sum(interval for interval, _, _ in steps) * (1.0 + IDLE_SHARE) + 1e-9


@given(durations, durations)
def test_a_limit_is_reached_when_it_is_exceeded(limit, used):
    assert bool(TimeSpent(processor=used).excess(limit)[0]) == (used > limit)
    assert bool(TimeSpent(waited=used).excess(limit)[0]) == (used > WAITING_FACTOR * limit)


def test_what_was_reached_is_told_with_figures():
    told, kind = TimeSpent(processor=65.24, waited=3.0).excess(65.0)
    assert (told, kind) == (f"{PROCESSOR_REACHED}: 65.2 s of 65 s", PROCESSOR_REACHED)
    told, _ = TimeSpent(waited=11.8).excess(5.76923)
    assert "for 11.8 s of 11.5 s" in told
    told, kind = TimeSpent(processor=1.0, waited=130.1).excess(65.0)
    assert (told, kind) == (
        f"{WAITING_REACHED}: for 130.1 s of 130 s it was not seen to compute, and it computed for 1.0 s",
        WAITING_REACHED,
    )


COMPUTES = "import time\nwhile time.process_time() < 1.0: pass\n"
KINDS = {
    "computes": COMPUTES,
    "computes in a thread": f"import threading\nthreading.Thread(target=lambda: exec({COMPUTES!r})).start()",
    "computes in a child": f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {COMPUTES!r}])",
}


def test_threads_of_all_processes_are_counted():
    """A controller with 6,000 threads, which are one process, left none to others of its user."""
    start = "threading.Thread(target=threading.Event().wait, daemon=True).start()"
    threads = f"import sys, threading\nfor _ in range(7): {start}\n"
    child = f"{threads}print(flush=True); input()"
    code = f"{threads}import subprocess\nsubprocess.run([sys.executable, '-c', {child!r}])"
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", code], stdin=pipe, stdout=pipe) as process:
        process.stdout.readline()
        use = ProcessTree(process.pid).use()
        assert (use.processes, use.threads) == (2, 16)
        process.communicate(b"\n")


@pytest.mark.parametrize("kind", KINDS)
def test_the_processor_time_of_a_real_process(kind):
    with subprocess.Popen([sys.executable, "-c", KINDS[kind] + "\ninput()"], stdin=subprocess.PIPE) as process:
        watch, ready = Stopwatch(ProcessTree(process.pid)), set()
        while watch.spent.processor < 0.9:  # as much as it uses itself is in its time, with all that it has started
            ready.add(watch.look().ready)
        assert True in ready and watch.spent.waited < 0.9
        while watch.spent.waited < 0.5:  # for its input
            exit_code(process, 0.05)
            watch.look()
        assert 0.9 < watch.spent.processor < 10.0
        process.communicate(b"\n")
