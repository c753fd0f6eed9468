"""The closed loop of eight arms side by side, for searches with the project's own controllers in C: faster, same bits.

    python benchmarks/lanes.py SteadyLQG        all cases of ``strict``, as they are run for everybody and in lanes: all
                                                must be equal to the last bit; the time of both
    python benchmarks/lanes.py RobustLinearLQG --protocol paper

benchmarks/lanes_cpp/lanes.cpp includes the sources of the plant's FMU and of the controller's, with eight numbers in
place of one. It is a master loop of its own, so no user runs it: the scripts that make the published figures do.
:func:`executor` gives the outcomes of cases that are whole at their own end, and leaves all others to the processes
that run them for everybody. Needs g++.
"""

from __future__ import annotations

import argparse
import ctypes
import functools
import hashlib
import itertools
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from dataclasses import replace
from fractions import Fraction
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from msgspec import structs

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

import build_fmus  # noqa: E402
from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.benchmark.metrics import continuation_if_in_doubt, judge, measure  # noqa: E402
from orchestrator.cache import cache_folder  # noqa: E402
from orchestrator.codec import pack, unpack  # noqa: E402
from orchestrator.documents.flat_case import controller_values  # noqa: E402
from orchestrator.execution import pool, store  # noqa: E402
from orchestrator.execution.job import Done, Job, Outcome  # noqa: E402
from orchestrator.fmi.archive import Archive, open_archive  # noqa: E402
from orchestrator.loop import random_streams  # noqa: E402
from orchestrator.loop.scenario import (  # noqa: E402
    CELLS,
    ChirpSignal,
    Plan,
    PulseSignal,
    Scenario,
    chirp_signal,
    make_plan,
    pulse_signal,
)
from orchestrator.loop.setup import Setup  # noqa: E402
from orchestrator.loop.signals import chirp, pulse  # noqa: E402
from orchestrator.loop.trajectory import Ending, Status, Trajectory  # noqa: E402
from orchestrator.pairing import work  # noqa: E402
from orchestrator.study import batch  # noqa: E402
from orchestrator.study.batch import Execute  # noqa: E402
from orchestrator.study.engine import Engine  # noqa: E402
from orchestrator.study.requests import Batch, BatchEntry  # noqa: E402

LANES, WHOLE = 8, 0
"""Of benchmarks/lanes_cpp: arms side by side, and the reason of a simulation that has come to its end."""

HERE = Path(__file__).resolve().parent / "lanes_cpp"
FLAGS = ("-O3", "-march=native", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fPIC")
"""None of these changes a bit: without errno and traps, roots and roundings are instructions."""

everybody = pool.run
"""How the rest is run."""

Task = work.CaseTask | work.ScenarioTask

WORK = {f"{work.__name__}:{kind.__name__}": kind for kind in (work.judge_case, work.digest_case, work.begin_case)}
"""What jobs that can be run in lanes ask a worker to do."""

OWN = ("integrator.h", "feedback.h")
"""What the sources of a plant and of a controller have that can be compiled so."""

SIGNALS = {"outputs": 4, "measured": 2, "given": 2, "command": 2, "torque": 2}
"""The arrays that a simulation fills, with their columns."""

_two, _pointer = ctypes.c_double * 2, ctypes.c_void_p


class _Simulation(ctypes.Structure):
    """Simulation of lanes.cpp."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("samples", "rows", "parts")),
        *(
            (name, _pointer)
            for name in ("step", "drive_lag", "sample_part", "sensor_lag", "noise", "driven", "dropped")
        ),
        *((name, _two) for name in ("gain", "limit", "torque_quantum")),
        *((name, ctypes.c_double) for name in ("angle_quantum", "abort_distance")),
        ("taken_at_0", ctypes.c_int64 * 2),
        *((name, _pointer) for name in ("plant", "controller", *SIGNALS)),
        *((name, _two) for name in ("q_m_ref", "u_m0")),
        *((name, ctypes.c_int64) for name in ("reason", "ended")),
    )


class Values(NamedTuple):
    """The variables of an FMU: their places by name, their start values, and where the connectors stand."""

    places: dict[str, int]
    start: np.ndarray
    connectors: Any

    @staticmethod
    def of(fmu: Archive) -> Values:
        """Those of the scalar variables of ``fmu``."""
        scalars = {v.name: v for v in fmu.description.modelVariables}
        places = {name: v.valueReference for name, v in scalars.items()}
        start = np.zeros(len(places))
        for name, variable in scalars.items():
            start[places[name]] = float(variable.start or 0.0)
        names = ("q_a", "q_m", "X", "q_m_ref", "u_m0")
        return Values(places, start, (ctypes.c_int64 * 5)(*(places.get(f"{name}[1]", -1) for name in names)))

    def set(self, values: dict[str, float]) -> np.ndarray:
        """All values, with these in place of the start values."""
        made = self.start.copy()
        for name, value in values.items():
            made[self.places[name]] = value
        return made


class Program:
    """Plant and controller, compiled to one library, and the arrays of eight simulations, which the next eight use."""

    def __init__(self, plant: Archive, controller: Archive) -> None:
        self.plant, self.controller = Values.of(plant), Values.of(controller)
        self.archive = controller
        self.simulate = ctypes.CDLL(str(library(plant, controller))).simulate
        self.simulate.restype = None
        self.arrays: list[dict[str, np.ndarray]] = [{} for _ in range(LANES)]
        self.given: dict[tuple[bytes, Fraction], np.ndarray] = {}

    def trajectories(self, tasks: Sequence[Task]) -> list[Trajectory | None]:
        """The trajectories of at most eight tasks; None for one that is not whole."""
        scenarios = [task.case.scenario if isinstance(task, work.CaseTask) else task.scenario for task in tasks]
        kept = [self._entered(lane, scenarios[lane], task) for lane, task in enumerate(tasks)]
        simulations = (_Simulation * len(tasks))(*(simulation for simulation, _ in kept))
        self.simulate(
            simulations,
            len(tasks),
            ctypes.byref(self.plant.connectors),
            ctypes.byref(self.controller.connectors),
            ctypes.c_size_t(len(self.plant.start)),
            ctypes.c_size_t(len(self.controller.start)),
        )
        return [
            _trajectory(scenarios[lane], simulations[lane], self.arrays[lane])
            if simulations[lane].reason == WHOLE and not task.setup.mapping
            else None
            for lane, task in enumerate(tasks)
        ]

    def _entered(self, lane: int, scenario: Scenario, task: Task) -> tuple[_Simulation, list[np.ndarray]]:
        """A simulation, with the arrays to which it points and that nothing else keeps."""
        drive, sensor, samples = scenario.drive, scenario.sensor, scenario.samples
        cells = random_streams.jitter_cells(sensor.noise.seed, CELLS, samples + 1) if sensor.jitter else None
        plan = make_plan(scenario.sample_time, drive.delay, sensor.delay, scenario.longest_hold, sensor.jitter, cells)
        arrays = self.arrays[lane]
        for name, columns in SIGNALS.items():
            if name not in arrays or len(arrays[name]) <= samples:
                arrays[name] = np.zeros((samples + 1, columns))
        if len(arrays.get("driven", ())) < samples or arrays["driven"].shape[1] != plan.step.shape[1]:
            arrays["driven"] = np.zeros((samples, plan.step.shape[1], 4))
        fill_driven(
            arrays["driven"],
            samples,
            plan,
            chirp_signal(scenario.chirp, scenario.again),
            pulse_signal(scenario.pulse, scenario.again),
        )
        values = (self.plant.set(dict(scenario.parameters)), self._given(task.setup, scenario))
        kept = [plan.step, plan.drive_lag, plan.sample_part, plan.sensor_lag]
        kept += [_noise(sensor.noise, samples + 1), arrays["driven"]]
        kept += [random_streams.dropped(sensor.noise.seed, drive.dropout, samples), *values]
        pointers = [array.ctypes.data for array in kept]
        made = _Simulation(
            samples,
            *plan.step.shape,
            *pointers[:7],
            _two(*drive.gain),
            _two(*drive.limit),
            _two(*drive.quantum),
            sensor.quantum,
            scenario.abort_distance,
            (ctypes.c_int64 * 2)(*(delay % scenario.sample_time == 0 for delay in sensor.delay)),
            *pointers[7:],
            *(arrays[name].ctypes.data for name in SIGNALS),
        )
        return made, kept

    def _given(self, setup: Setup, scenario: Scenario) -> np.ndarray:
        """All values of the controller; a search has the same setup in all its cases."""
        key = pack(setup), scenario.sample_time
        if key not in self.given:
            self.given[key] = self.controller.set(controller_values(self.archive, setup, scenario))
        return self.given[key]

    def answers(self, tasks: Sequence[Task], kinds: Sequence[str]) -> list[bytes | None]:
        """What workers would send for at most eight tasks of these kinds; None for one that is left to them."""
        found = zip(tasks, kinds, self.trajectories(tasks), strict=True)
        return [None if trajectory is None else _answer(task, kind, trajectory) for task, kind, trajectory in found]


_noise = functools.lru_cache(maxsize=200)(random_streams.noise.__wrapped__)
"""The members of a search share some seeds at each pose: 200 arrays of at most 1.7 MB in place of the master's four."""


def _answer(task: Task, kind: str, trajectory: Trajectory) -> bytes | None:
    """What a worker would send for a trajectory that came to its end, as :mod:`orchestrator.pairing.work` makes it."""
    if isinstance(task, work.ScenarioTask):
        return pack(work.digest_of_beginning(trajectory, task.scenario))
    measured = measure(task.protocol, task.case, trajectory)
    if continuation_if_in_doubt(task.protocol, task.case, measured) is not None:
        return None
    judgement = judge(task.protocol, task.case, trajectory, measured)
    if WORK[kind] is work.judge_case:
        return pack(judgement)
    if WORK[kind] is work.digest_case:
        return pack(work.Digested(judgement, work.digest(trajectory)))
    return pack(work.Digested(judgement, work.digest_of_beginning(trajectory, task.case.scenario)))


@numba.njit
def fill_driven(driven: np.ndarray, samples: int, plan: Plan, sweep: ChirpSignal, force: PulseSignal) -> None:
    """u_d [N.m] and F [N] at the begin of each part, ``driven`` of shape (samples, parts, 4)."""
    rows, parts = plan.step.shape
    for k in range(samples):
        for part in range(parts):
            t = (k * plan.interval + plan.offset[k % rows, part]) / plan.denominator
            driven[k, part, 0], driven[k, part, 1] = chirp(sweep, t)
            driven[k, part, 2], driven[k, part, 3] = pulse(force, t)


def _trajectory(scenario: Scenario, simulation: _Simulation, arrays: dict[str, np.ndarray]) -> Trajectory:
    """As the master's of a simulation that came to its end; the arrays are those of the lane."""
    samples, interval = scenario.samples, scenario.sample_time
    outputs, measured = arrays["outputs"][: samples + 1], arrays["measured"][: samples + 1]
    return Trajectory(
        time=np.arange(samples + 1) * interval.numerator / interval.denominator,
        q_m=outputs[:, 0:2],
        X=outputs[:, 2:4],
        extra={},
        measured=measured,
        given=arrays["given"][:samples],
        command=arrays["command"][:samples],
        torque=arrays["torque"][:samples],
        q_m_ref=tuple(simulation.q_m_ref),
        u_m0=tuple(simulation.u_m0),
        ending=Ending(Status.DONE, float(samples * interval)),
    )


def library(plant: Archive, controller: Archive) -> Path:
    """The compiled library of both, kept by what it is made of and the processor."""
    processor = subprocess.run(["g++", *FLAGS, "-Q", "--help=target"], capture_output=True, text=True, check=True)
    digest = hashlib.sha256((plant.sha256 + controller.sha256 + processor.stdout).encode())
    for file in sorted(HERE.iterdir()):
        digest.update(file.read_bytes())
    target = cache_folder() / "lanes" / f"{digest.hexdigest()}.so"
    if target.exists():
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part, fmu in (("plant", plant), ("controller", controller)):
            shutil.copytree(fmu.folder / "sources", folder / part)
        for file in (*HERE.iterdir(), folder / "plant" / "elementary.h"):
            shutil.copy(file, folder)
        of_unit = ["gcc", "-std=c99", *FLAGS, "-c", "unit.c"]
        for command in (
            [*of_unit, "-DUNIT=plant", "-DOF_PLANT", "-o", "plant.o"],
            [*of_unit, "-DUNIT=controller", "-o", "controller.o"],
            ["g++", "-std=gnu++20", "-Wno-psabi", *FLAGS, "-c", "lanes.cpp"],
            ["g++", "-shared", "-o", "lanes.so", "lanes.o", "plant.o", "controller.o"],
        ):
            subprocess.run(command, cwd=folder, check=True)
        own = target.with_suffix(f".{os.getpid()}")
        shutil.copy(folder / "lanes.so", own)
        own.replace(target)
    return target


def is_laned(job: Job) -> bool:
    """Whether the cases of a job can be run in lanes."""
    has = all(
        (fmu.folder / "sources" / file).exists() for fmu, file in zip((job.plant, job.controller), OWN, strict=True)
    )
    return has and job.work in WORK and not job.isolated and not job.sandbox


class Place(NamedTuple):
    """A task: the number of its job, and its own."""

    job: int
    index: int


def executor(workers: int) -> Execute:
    """Runs cases of the project's controllers in lanes on so many processes, the rest (without g++: all) as usual."""
    return functools.partial(run if shutil.which("g++") else everybody, workers=workers)


class InLanes(Benchmark):
    """A benchmark whose studies run in lanes what can be run so, to the same results."""

    def engine(self, *arguments: Any, **options: Any) -> Engine:
        """As of a benchmark."""
        return replace(super().engine(*arguments, **options), execute=executor(self.processes))


def run(jobs: Sequence[Job], workers: int) -> Generator[tuple[int, Outcome], None, None]:
    """As :func:`orchestrator.execution.pool.run`."""
    rest = [(number, 0, job) for number, job in enumerate(jobs) if not is_laned(job)]
    waiting = {
        _processes(workers).submit(
            _answers,
            *((fmu.file, fmu.sha256) for fmu in (jobs[group[0].job].plant, jobs[group[0].job].controller)),
            [jobs[place.job].tasks[place.index] for place in group],
            [jobs[place.job].work for place in group],
        ): group
        for group in _groups(jobs)
    }
    try:
        for future in as_completed(waiting):
            values, took = future.result()
            for place, value in zip(waiting[future], values, strict=True):
                job = jobs[place.job]
                if value is None:
                    rest.append((*place, _alone(job, place.index)))
                else:
                    yield place.job, Done(place.index, job.decode(place.index, value), took / len(values))
    finally:
        for future in waiting:
            future.cancel()
    with closing(everybody([job for _, _, job in rest], workers)) as outcomes:
        for number, outcome in outcomes:
            yield rest[number][0], _moved(outcome, rest[number][1])


def _groups(jobs: Sequence[Job]) -> Iterator[list[Place]]:
    """At most eight tasks each, of the same two FMUs and, as far as there are, equally long."""
    places = [
        Place(number, index) for number, job in enumerate(jobs) if is_laned(job) for index in range(len(job.tasks))
    ]
    for _, same in itertools.groupby(sorted(places, key=lambda p: _fmus(jobs[p.job])), lambda p: _fmus(jobs[p.job])):
        by_length = sorted(same, key=lambda p: -jobs[p.job].time_limits[p.index])
        yield from (by_length[first : first + LANES] for first in range(0, len(by_length), LANES))


def _fmus(job: Job) -> tuple[str, str]:
    return job.plant.sha256, job.controller.sha256


def _alone(job: Job, index: int) -> Job:
    """The task of a job as a job of its own."""
    return replace(job.rest(index), tasks=job.tasks[index : index + 1], time_limits=job.time_limits[index : index + 1])


def _moved(outcome: Outcome, first: int) -> Outcome:
    index = outcome.index + first
    return structs.replace(outcome, index=index)


_started: dict[int, ProcessPoolExecutor] = {}
"""By their number. They stay for the next batch, of which a search has hundreds."""


def _processes(workers: int) -> ProcessPoolExecutor:
    if workers not in _started:
        _started[workers] = ProcessPoolExecutor(workers, get_context("forkserver"))
    return _started[workers]


def end() -> None:
    """End all processes."""
    while _started:
        _started.popitem()[1].shutdown()


Fmu = tuple[Path, str]
"""A file, and the SHA-256 of its bytes."""


def _answers(
    plant: Fmu, controller: Fmu, tasks: Sequence[bytes], kinds: Sequence[str]
) -> tuple[list[bytes | None], float]:
    """What :meth:`Program.answers` gives, and the time [s]; in a process of the executor."""
    begin = time.perf_counter()
    unpacked = [unpack(task, Task) for task in tasks]  # type: ignore[arg-type]  # a union of types
    return _program(plant, controller).answers(unpacked, kinds), time.perf_counter() - begin


@functools.cache
def _program(*fmus: Fmu) -> Program:
    archives = [open_archive(file) for file, _ in fmus]
    # A file that was built anew since the job was made would get the results of another controller.
    assert all(archive.sha256 == sha256 for archive, (_, sha256) in zip(archives, fmus, strict=True)), fmus
    return Program(*archives)


def compared(name: str, protocol: str, workers: int) -> tuple[int, int, float, float]:
    """How many cases are equal, of how many, and the time [s] that they take for everybody and in lanes."""
    bench = Benchmark(protocol)
    controller = Controller(build_fmus.DEFAULT_OUTPUT_DIR / f"{name}.fmu")
    entry = BatchEntry(bench.rules, bench.pairing(controller), tuple(bench.cases))
    found, times = [], []
    # The first time, processes start and code is compiled.
    for execute in (executor(workers), functools.partial(pool.run, workers=workers), executor(workers)):
        begin = time.perf_counter()
        with store.opened(None) as known:
            (runs,) = batch.run(Batch((entry,)), execute, known)
        times.append(time.perf_counter() - begin)
        found.append([run.result for run in runs])
    same = sum(one == other == again for one, other, again in zip(*found, strict=True))
    return same, len(bench.cases), times[1], times[2]


def main() -> int:
    """Compares both ways; the exit code is 1 if a case differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", nargs="?", default="SteadyLQG")
    parser.add_argument("--protocol", default="strict")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    same, all_of_them, alone, in_lanes = compared(options.name, options.protocol, options.workers)
    print(f"{options.name}, {options.protocol}: {same} of {all_of_them} cases are equal to the last bit")
    print(f"{alone:.1f} s for everybody, {in_lanes:.1f} s in lanes, {alone / in_lanes:.1f} times as fast")
    return 0 if same == all_of_them else 1


if __name__ == "__main__":
    sys.exit(main())
