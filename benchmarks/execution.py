"""What it costs to run every group of cases in a process of its own, and whether 10,000 simulations leave anything.

    python benchmarks/execution.py                     cost of a case beyond its simulation
    python benchmarks/execution.py --throughput        cases per second at 1 and 2 processes, and on Dask workers
    python benchmarks/execution.py --endurance 10000   memory, descriptors, files, processes over many simulations

The cost is processor time, which others' use of the machine does not change; throughput is not. The exit code is 1
where the target is missed: at most 5 % on top of the simulations for groups of the default size.
"""

from __future__ import annotations

import argparse
import functools
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import psutil  # noqa: E402

from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.benchmark.case import Case  # noqa: E402
from orchestrator.benchmark.metrics import case_result, judge  # noqa: E402
from orchestrator.benchmark.protocol import Protocol  # noqa: E402
from orchestrator.benchmark.results import Judgement  # noqa: E402
from orchestrator.codec import Struct, pack, unpack  # noqa: E402
from orchestrator.execution import cluster, pool, store  # noqa: E402
from orchestrator.execution.job import Done  # noqa: E402
from orchestrator.execution.supervision import run_isolated  # noqa: E402
from orchestrator.fmi.slaves import Slave  # noqa: E402
from orchestrator.loop.master import simulate  # noqa: E402
from orchestrator.pairing import work  # noqa: E402
from orchestrator.pairing.pairing import GROUP_SIZE, Pairing, judge_job  # noqa: E402
from orchestrator.pairing.runs import CaseRun  # noqa: E402
from orchestrator.study import batch  # noqa: E402
from orchestrator.study import stored as stored_runs  # noqa: E402
from orchestrator.study.rehearsal import rehearse  # noqa: E402
from orchestrator.study.requests import Batch, BatchEntry  # noqa: E402

TARGET = 0.05
SHORT = Fraction("0.01")
"""Simulated time [s] of the endurance test's cases."""


class Cost(NamedTuple):
    """Processor time of a group [s]: its simulations, the rest of its process, its parent; and the wall time [s] from
    the start of the group to the beginning of its first case."""

    simulations: float
    child: float
    parent: float
    waited: float


class Times(Struct, frozen=True):
    """Processor times of a worker [s]: of a simulation, and of all so far; ``started`` is the time of day."""

    judgement: Judgement
    simulation: float
    end: float
    started: float


prepare = work.prepare
"""What a fork server does first."""


def timed(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """A case as in an evaluation, with processor times of this process."""
    wanted = unpack(task, work.CaseTask)
    begin, started = time.process_time(), time.time()
    trajectory = simulate(plant, controller, wanted.case.scenario, wanted.setup)
    simulated = time.process_time()
    judgement = judge(wanted.protocol, wanted.case, trajectory)
    return pack(Times(judgement, simulated - begin, time.process_time(), started))


def cost(protocol: Protocol, bench: Pairing, cases: Sequence[Case], folder: Path) -> Cost:
    """Run one group, storing its results as an evaluation does."""
    with store.opened(folder) as results:
        keys = stored_runs.keys(protocol, cases, bench)
        begin, started = time.process_time(), time.time()
        tasks = [work.CaseTask(protocol, bench.setup, case) for case in cases]
        limits = tuple(60.0 for _ in cases)
        found = []
        job = bench.raw_job("benchmarks.execution:timed", tasks, limits, lambda _, value: unpack(value, Times))
        for outcome in run_isolated(job):
            assert isinstance(outcome, Done), outcome
            case = cases[outcome.index]
            result = case_result(case, outcome.value.judgement)
            stored_runs.keep(results, keys[outcome.index], CaseRun(case, result, outcome.wall_time), bench)
            found.append(outcome.value)
        parent = time.process_time() - begin
    simulations = sum(value.simulation for value in found)
    return Cost(simulations, found[-1].end - simulations, parent, found[0].started - started)


def show_cost(protocol: Protocol, all_cases: Sequence[Case], bench: Pairing, rounds: int) -> bool:
    """Print what a case costs beyond its simulation; whether the target is met."""
    with tempfile.TemporaryDirectory() as folder:
        groups = [all_cases[GROUP_SIZE * i : GROUP_SIZE * (i + 1)] for i in range(rounds)]
        cost(protocol, bench, groups[0][:1], Path(folder))  # starts the fork server
        costs = [cost(protocol, bench, group, Path(folder)) for group in groups]
    simulated = sum(float(case.scenario.duration) for group in groups for case in group) / rounds / GROUP_SIZE

    ratio = statistics.median((each.child + each.parent) / each.simulations for each in costs)
    median = Cost(*(statistics.median(column) * 1e3 / GROUP_SIZE for column in zip(*costs, strict=True)))
    print(f"{rounds} groups of {GROUP_SIZE} cases, {simulated:.1f} s of simulated time each; medians, ms per case")
    print(f"  simulation           {median.simulations:8.2f}")
    print(f"  rest of the process  {median.child:8.2f}   start, loading two FMUs, judging, sending")
    print(f"  parent               {median.parent:8.2f}   starting, watching, storing")
    print(f"  on top               {ratio:8.1%}   target {TARGET:.0%}")
    print(f"  from the start of a group to its first case: {median.waited * GROUP_SIZE:.0f} ms of wall time")
    return ratio <= TARGET


def show_throughput(protocol: Protocol, cases: Sequence[Case], bench: Pairing) -> None:
    """Print cases per second of wall time, here and on Dask."""

    def speed(execute: Callable[..., Any]) -> float:
        begin = time.perf_counter()
        with store.opened(None) as known:
            (found,) = batch.run(Batch((BatchEntry(protocol, bench, tuple(cases)),)), execute, known)
        assert all(run.result.simulated for run in found)
        return len(found) / (time.perf_counter() - begin)

    single = speed(functools.partial(pool.run, workers=1))
    double = speed(functools.partial(pool.run, workers=2))
    print(f"{len(cases)} cases, cases per second")
    print(f"  1 process            {single:8.2f}")
    print(f"  2 processes          {double:8.2f}   {double / single / 2:.0%} of twice the speed")
    for name, dask in on_dask(speed):
        print(f"  {name:20} {dask:8.2f}   {dask / double:.0%} of 2 local processes")


def on_dask(speed: Callable[..., float]) -> Iterator[tuple[str, float]]:
    """Speeds on two Dask workers, first with cold ones that must start their helpers."""
    try:
        from distributed import LocalCluster
    except ImportError:
        print("  Dask is not installed")
        return
    options: dict[str, Any] = {"dashboard_address": None, "host": "127.0.0.1"}
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, **options) as workers:
        execute = functools.partial(cluster.run, address=workers.scheduler_address)
        for name in ("2 Dask workers, cold", "2 Dask workers"):
            yield name, speed(execute)


class Traces(NamedTuple):
    """What many simulations may leave behind: memory [MB] of this process and of the fork server and its workers, open
    descriptors, folders of workers, processes."""

    simulations: int
    parent: float
    workers: float
    descriptors: int
    files: int
    processes: int


def endure(bench: Pairing, number: int, workers: int, looks: int = 10) -> list[Traces]:
    """Run ``number`` short simulations as one evaluation; returns what is there after each tenth of them."""
    cases: list[Case] = []
    while len(cases) < number:
        benchmark = Benchmark("paper", seed=len(cases))
        noisy = [case for case in benchmark.cases if case.test.name == "noise"]
        cases += [replace(case, scenario=replace(case.scenario, duration=SHORT)) for case in noisy]
    jobs = [judge_job(benchmark.rules, cases[n : n + GROUP_SIZE], bench) for n in range(0, number, GROUP_SIZE)]
    found, peak = [], 0.0
    for count, (_, outcome) in enumerate(pool.run(jobs, workers), start=1):
        assert isinstance(outcome, Done), outcome
        if count % 50 == 0:
            peak = max(peak, memory_of_children())
        if count % max(1, number // looks) == 0:
            found.append(look(count, max(peak, memory_of_children())))
            peak = 0.0
    return found


def look(count: int, peak: float) -> Traces:
    """What there is now."""
    own = psutil.Process()
    files = list(Path(tempfile.gettempdir()).glob("flexible-manipulator-*"))
    parent, children = own.memory_info().rss / 1e6, own.children(recursive=True)
    return Traces(count, parent, peak, own.num_fds(), len(files), len(children))


def memory_of_children() -> float:
    """Largest resident memory of a descendant [MB]."""
    sizes = [0.0]
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            sizes.append(child.memory_info().rss / 1e6)
    return max(sizes)


def show_endurance(bench: Pairing, number: int, workers: int) -> None:
    """Print what many simulations leave behind."""
    begin = time.perf_counter()
    found = endure(bench, number, workers)
    print("simulations  parent MB  largest worker MB  descriptors  temporary folders  processes")
    for entry in found:
        print("{:11}  {:9.1f}  {:17.1f}  {:11}  {:17}  {:9}".format(*entry))
    left = psutil.Process().children(recursive=True)
    print(f"after {time.perf_counter() - begin:.0f} s; still there: {len(left)} processes, the fork server's")


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("controller", nargs="?", type=Path, help="an FMU (default: the paper's PID)")
    parser.add_argument("--rounds", type=int, default=6, help="groups to measure the cost with (default: 6)")
    parser.add_argument("--throughput", nargs="?", type=int, const=36, metavar="CASES", help="default: 36")
    parser.add_argument("--endurance", type=int, metavar="SIMULATIONS")
    parser.add_argument("--jobs", type=int, default=2, help="processes of the endurance test (default: 2)")
    options = parser.parse_args()
    benchmark, controller = Benchmark("paper"), Controller(options.controller)
    bench = Pairing(benchmark.manipulator.archive, controller.archive, timeout=600.0)
    rehearse(benchmark.cases[0], bench)  # compiles
    if options.throughput:
        show_throughput(benchmark.rules, benchmark.cases[: options.throughput], bench)
    elif options.endurance:
        show_endurance(bench, options.endurance, options.jobs)
    elif not show_cost(benchmark.rules, benchmark.cases, bench, options.rounds):
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
