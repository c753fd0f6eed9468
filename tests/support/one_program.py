"""Cases of the benchmark in the program of ``controller_fmu/closed_loop``, and what the master loop and the judging in
Python give.

``tests/stubs/one_program.c`` is its command line; :mod:`.targets` says what it is compiled for and how it is run.
"""

from __future__ import annotations

import math
import shutil
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np

import build_fmus
from controller_fmu.export.one_program import (
    FIGURES,
    PARTS,
    REASONS,
    VERDICTS,
    Unit,
    linear_unit,
    write_sources,
)
from controller_fmu.export.state_space import controller_from_state_space
from orchestrator import Benchmark
from orchestrator.benchmark.case import Case
from orchestrator.benchmark.results import Judgement, Measurements
from orchestrator.benchmark.scorecard import kind
from orchestrator.documents.flat_case import controller_values, flat_case, flat_matrices
from orchestrator.fmi.archive import open_archive
from orchestrator.loop.scenario import Scenario, chirp, chirp_signal
from orchestrator.loop.setup import Setup
from orchestrator.loop.trajectory import Status, Trajectory

MAIN = Path(__file__).parents[1] / "stubs" / "one_program.c"

LINEAR = "TwoLeads"
A = [[0.95, 0.0, 0.0], [0.0, 0.95, 0.0], [0.0, 0.01, 0.9]]
B = [[1.0, 0.0], [0.0, 1.0], [0.2, -0.1]]
C = [[-260.0, 0.0, 3.0], [0.0, -90.0, -2.0]]
D = [[6000.0, 0.0], [0.0, 2000.0]]
BACK = [[1e-4, 0.0], [0.0, 1e-4], [0.0, 0.0]]
"""A linear controller of three states, each axis with a filtered lead, slightly coupled; and against windup."""


class Program(NamedTuple):
    """The FMUs by name, the folder of the program's sources, those to compile, and its units."""

    files: Mapping[str, Path]
    folder: Path
    sources: Sequence[str]
    units: Sequence[Unit]


def write_program(folder: Path) -> Program:
    """Build the FMUs and write the sources of the program with its command line."""
    (folder / "parts").mkdir(parents=True)
    (folder / "program").mkdir()
    files = {name: build_fmus.build(name, folder / "parts") for name in PARTS}
    linear = folder / "parts" / f"{LINEAR}.fmu"
    files[LINEAR] = controller_from_state_space(A, B, C, D, 0.25e-3, anti_windup=BACK, out=linear)
    return rewritten(Program(files, folder / "program", (), ()), folder / "program")


def rewritten(program: Program, folder: Path) -> Program:
    """The same with its sources in another folder."""
    sources, units = write_sources(program.files, program.files[LINEAR], folder)
    shutil.copy(MAIN, folder)
    return Program(program.files, folder, [MAIN.name, *sources], units)


def block_of(program: Program, name: str, benchmark: Benchmark, case: Case) -> list[float]:
    """The numbers of a case with one of the controllers."""
    flat = flat_case(benchmark.rules, case)
    if name == LINEAR:
        return flat.block(program.units, linear_unit(len(A)), {}, flat_matrices(A, B, C, D, anti_windup=BACK))
    values = controller_values(open_archive(program.files[name]), Setup(), case.scenario)
    return flat.block(program.units, name, values)


def program_input(blocks: Sequence[Sequence[float]]) -> str:
    """The text of the file that the program reads."""
    lines = [f"{len(block):x} " + " ".join(map(bits, block)) for block in blocks]
    return "\n".join([f"{len(blocks):x}", *lines, ""])


def bits(value: float) -> str:
    """The bits of a number, in hexadecimal."""
    (word,) = struct.unpack("<Q", struct.pack("<d", value))
    return f"{word:016x}"


class Answer(NamedTuple):
    """A line of the program: the hash of the trajectory, why the loop ended and when [s], the verdict, the end of the
    windows [s], and the figures."""

    hash: str
    reason: str
    verdict: str
    time: float
    judged_until: float | None
    measurements: Measurements


def answer(line: str) -> Answer:
    """What the program has printed for a case."""
    found, *words = line.split()
    reason, verdict, time, until, *figures = (struct.unpack("<d", bytes.fromhex(word)[::-1])[0] for word in words)
    values = {name: value for name, value in zip(FIGURES, figures, strict=True) if not math.isnan(value)}
    if "settled" in values:
        values["settled"] = bool(values["settled"])
    return Answer(
        found,
        REASONS[int(reason)],
        VERDICTS[int(verdict)],
        time,
        None if math.isnan(until) else until,
        Measurements(**values),
    )


def same(found: Answer, judgement: Judgement, benchmark: Benchmark) -> bool:
    """Whether the program has judged as Python has, to the last bit."""
    verdict = kind(judgement, benchmark.rules.stability)
    if verdict == "unstable":
        verdict = "no rest" if judgement.measurements.rest_error is not None else "left the workspace"
    finished = judgement.status is Status.DONE or verdict == "no rest"
    return (found.time, found.judged_until, found.measurements, found.verdict) == (
        judgement.time,
        judgement.judged_until,
        judgement.measurements,
        verdict,
    ) and (found.reason == "finished") == finished


def hash_of(trajectory: Trajectory, scenario: Scenario) -> str:
    """What the program prints for the trajectory of the master loop."""
    signal, rate = chirp_signal(scenario.chirp, scenario.again), 1 / scenario.sample_time
    u_d = [chirp(signal, float(k / rate)) for k in range(len(trajectory.command))]
    rows = np.hstack([np.array(u_d), trajectory.q_m[1:], trajectory.X[1:], trajectory.command])
    return f"{int(_fnv(np.ascontiguousarray(rows).view(np.uint64).ravel())):016x}"


@numba.njit
def _fnv(words: np.ndarray) -> np.uint64:
    found = np.uint64(0xCBF29CE484222325)
    for word in words:
        found = (found ^ word) * np.uint64(0x100000001B3)
    return found
