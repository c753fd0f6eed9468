"""Closed loops of the benchmark as one program in C, made of the sources of the FMUs, and what its master loop gives.

``tests/stubs/closed_loop.c`` is the program; :mod:`.targets` says what it is compiled for and how it is run.
"""

from __future__ import annotations

import re
import shutil
import struct
import tempfile
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import fmpy
import numba
import numpy as np
from lxml import etree

from controller_fmu.export import FMI_HEADERS, unpack
from orchestrator import Benchmark, Controller
from orchestrator.benchmark.case import Case
from orchestrator.loop.scenario import Scenario, chirp, chirp_signal
from orchestrator.loop.trajectory import Trajectory

STUBS = Path(__file__).parents[1] / "stubs"
PLANT, IMPERFECTIONS = "FlexibleManipulatorNative", "Imperfections"
CONTROLLERS = ("DiagonalPID_C", "DitheredLQG_C", "RobustLQG")
PARTS = (PLANT, IMPERFECTIONS, *CONTROLLERS)

GLOBAL = re.compile(rb"\b(?:component|model|pid)_\w+|\bdesign\b(?=\()")
"""Names in the sources that several FMUs have, and that are not static."""

NAMING = "fmi2Functions.h"
"""The standard's header that says how functions are named. FMPy's has no prefix."""

LINES = (
    ("plant", "q_m", "imperfections", "q_m"),
    ("imperfections", "y", "controller", "q_m"),
    ("controller", "u_m", "imperfections", "u_c"),
    *(("imperfections", name, "plant", name) for name in ("u_m", "u_d", "F")),
)
"""What is exchanged, in an order in which each output is read after what it depends on (docs/plant.md)."""

PLACES = ("plant", "imperfections", "controller")


@dataclass(frozen=True)
class Loop:
    """A closed loop as the program simulates it."""

    controller: str
    samples: int
    ticks: int
    """Steps of the plant in a sample."""
    sample_time: float
    parameters: Mapping[str, Mapping[str, float]]
    """By PLACES, then by variable."""


def write_sources(files: Mapping[str, Path], folder: Path) -> list[str]:
    """Write the program's sources for the FMUs ``files`` into ``folder``; returns the names of those to compile."""
    units = []
    for name in PARTS:
        (folder / name).mkdir()
        sources = {
            path.removeprefix("sources/"): text
            for path, text in unpack(files[name]).items()
            if path.startswith("sources/")
        }
        sources[NAMING] = sources[NAMING].replace(
            b"fmi2FullName(name) name", b"fmi2FullName(name) %b_##name" % name.encode()
        )
        for source, text in sources.items():
            (folder / name / source).write_bytes(text)
        own = sorted({found.decode() for text in sources.values() for found in GLOBAL.findall(text)})
        lines = [f"#define {word} {name}_{word}" for word in own]
        lines += [f'#include "{name}/{source}"' for source in sorted(sources) if source.endswith(".c")]
        lines += ['#include "closed_loop.h"', f"extern const Slave {name};", f"const Slave {name} = SLAVE;", ""]
        (folder / f"{name}.c").write_text("\n".join(lines))
        units.append(f"{name}.c")
    known = "\n".join(f"extern const Slave {name};" for name in PARTS)
    addresses = ", ".join(f"&{name}" for name in PARTS)
    (folder / "slaves.h").write_text(f"{known}\n#define SLAVES {addresses}\n")
    for header in FMI_HEADERS.glob("fmi2*.h"):
        shutil.copy(header, folder)
    for stub in ("closed_loop.c", "closed_loop.h"):
        shutil.copy(STUBS / stub, folder)
    return ["closed_loop.c", *units]


def loop_of(benchmark: Benchmark, name: str, controller: Controller, case: Case, samples: int) -> Loop:
    """The first ``samples`` of a case with the controller ``name``, as the package of SSP has it."""
    with tempfile.TemporaryDirectory() as folder:
        package = benchmark.export_ssp(controller, case, Path(folder, "case.ssp"))
        with zipfile.ZipFile(package) as opened:
            values = {place: _values(opened.read(f"resources/{place}.ssv")) for place in PLACES}
    sample_time = float(case.scenario.sample_time)
    return Loop(name, samples, round(values["imperfections"]["ticks_per_sample"]), sample_time, values)


def _values(text: bytes) -> dict[str, float]:
    parameters = etree.fromstring(text).iterfind(".//{*}Parameter")
    return {parameter.get("name"): float(parameter[0].get("value")) for parameter in parameters}


def program_input(loops: Sequence[Loop], files: Mapping[str, Path]) -> str:
    """The text of the file that the program reads."""
    references = {name: _references(files[name]) for name in PARTS}
    return "\n".join([f"{len(loops):x}", *(" ".join(_words(loop, references)) for loop in loops), ""])


def _references(file: Path) -> dict[str, int]:
    return {v.name: v.valueReference for v in fmpy.read_model_description(str(file)).modelVariables}


def _words(loop: Loop, references: Mapping[str, Mapping[str, int]]) -> Iterable[str]:
    kinds = dict(zip(PLACES, (PLANT, IMPERFECTIONS, loop.controller), strict=True))

    def pair(place: str, name: str) -> list[str]:
        return [f"{references[kinds[place]][f'{name}[{i}]']:x}" for i in (1, 2)]

    yield from (f"{loop.samples:x}", f"{loop.ticks:x}", _bits(loop.sample_time))
    for place in PLACES:
        values = loop.parameters[place]
        yield from (f"{PARTS.index(kinds[place]):x}", f"{len(values):x}")
        for name, value in values.items():
            yield from (f"{references[kinds[place]][name]:x}", _bits(value))
    yield f"{len(LINES):x}"
    for start, output, end, read in LINES:
        yield from (f"{PLACES.index(start)}", *pair(start, output), f"{PLACES.index(end)}", *pair(end, read))
    yield from (*pair("plant", "q_m"), *pair("plant", "X"), *pair("controller", "u_m"), *pair("imperfections", "u_d"))


def _bits(value: float) -> str:
    (word,) = struct.unpack("<Q", struct.pack("<d", value))
    return f"{word:x}"


def hash_of(trajectory: Trajectory, scenario: Scenario) -> str:
    """What the program prints for the trajectory of the master loop."""
    signal, rate = chirp_signal(scenario.chirp), 1 / scenario.sample_time
    u_d = [chirp(signal, float(k / rate)) for k in range(len(trajectory.command))]
    rows = np.hstack([np.array(u_d), trajectory.q_m[1:], trajectory.X[1:], trajectory.command])
    return f"{int(_fnv(np.ascontiguousarray(rows).view(np.uint64).ravel())):016x}"


@numba.njit
def _fnv(words: np.ndarray) -> np.uint64:
    found = np.uint64(0xCBF29CE484222325)
    for word in words:
        found = (found ^ word) * np.uint64(0x100000001B3)
    return found
