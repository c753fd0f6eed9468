"""The closed loop as one program: the sources of several FMUs in C, each compiled as a unit with names of its own.

The loop and its judging are in ``controller_fmu/closed_loop``. A program reads a case from a flat block of numbers,
which :func:`block` makes; :func:`web_module` compiles it for WebAssembly, the tests for whatever else there is.
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from controller_fmu.errors import NoCompilerError
from controller_fmu.export.archive import unpack, write_atomically
from controller_fmu.export.c_fmu import CROSS_TIME_LIMIT, FMI_HEADERS
from controller_fmu.export.compiler import run_compiler
from controller_fmu.export.description import parse
from controller_fmu.export.platforms import REMEDY

LOOP = Path(__file__).resolve().parents[1] / "closed_loop"
LOOP_SOURCES = ("closed_loop.c", "judging.c", "case.c")

PLANT, IMPERFECTIONS = "FlexibleManipulatorNative", "Imperfections"
CONTROLLERS = ("DiagonalPID_C", "DitheredLQG_C", "RobustLQG")
PARTS = (PLANT, IMPERFECTIONS, *CONTROLLERS)
"""The FMUs of the program. ``RobustLinearLQG`` is ``DitheredLQG_C`` with other start values."""

SIZES = (8, 20, 40)
"""The most states of a linear controller: in a program there is a unit of it for each."""

SIGNALS = ("q_m", "X", "u_m", "u_d", "F", "q_m_ref", "u_m0", "q_a", "q_a_ref", "y", "u_c")
"""Of ``closed_loop.h``."""

RULES = (
    *("samples", "latest", "numerator", "denominator", "ticks", "abort_distance"),
    *("chirp_start", "force_start", "force_stop"),
    *("settling_error", "recovery_error", "rest_error", "rest_window"),
    *("limit_cycle", "limit_cycle_window", "limit_cycle_windows", "ring_down", "doubtful", "dying", "left", "asked"),
)
"""What a block begins with, as ``Rules`` of ``judging.h``."""

FIGURES = (
    *("B1", "B2", "B3", "B4", "B5", "B6", "B7", "settled"),
    *("limit_cycle", "limit_cycle_ratio", "limit_cycle_frequency", "limit_cycle_decay", "limit_cycle_at_end"),
    *("rest_error", "recovery", "residual_vibration"),
)
"""Of ``judging.h``; the same names as those of ``orchestrator.benchmark.results.Measurements``."""

REASONS = ("finished", "diverged", "absurd torque", "plant failed", "controller failed", "not started")
VERDICTS = ("quiet", "ring-down", "limit cycle", "left the workspace", "no rest", "no verdict")
"""Why a loop ended, and what its case came to, by the numbers of the program."""

_GLOBAL = re.compile(rb"\b(?:component|model|pid)_\w+|\bdesign\b(?=\()")
"""Names in the sources that several FMUs have, and that are not static."""

_NAMING = "fmi2Functions.h"
"""The standard's header that says how functions are named. FMPy's has no prefix."""

_GAINS = "gains.h"
"""What the sources of a linear controller have its matrices in."""

WEB_TARGET = "wasm32-wasi"
_WEB_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-mexec-model=reactor", "-s", "-Wl,--gc-sections")
_EXPORTS = ("block", "outcome", "record", "simulate_case", "force", "force_of")


class Unit(NamedTuple):
    """One FMU of a program: its name there, and the value references of its parameters by name."""

    name: str
    references: Mapping[str, int]


def write_sources(files: Mapping[str, Path], linear: Path, folder: Path) -> tuple[list[str], list[Unit]]:
    """Write the program's sources into ``folder``, for the FMUs ``files`` by the names PARTS and any ``linear`` one,
    whose matrices are read with a case; returns the names of the files to compile, and the units in their order."""
    chosen = [(name, files[name], 0) for name in PARTS] + [(f"Linear_{size}", linear, size) for size in SIZES]
    units = [_write_unit(name, file, states, folder) for name, file, states in chosen]
    known = "\n".join(f"extern const Slave {unit.name};" for unit in units)
    addresses = ", ".join(f"&{unit.name}" for unit in units)
    (folder / "slaves.h").write_text(f"{known}\n#define SLAVES {addresses}\n", encoding="utf-8")
    for header in (*FMI_HEADERS.glob("fmi2*.h"), *LOOP.glob("*.[ch]")):
        shutil.copy(header, folder)
    shutil.copy(LOOP.parent / "c_interface" / "elementary.h", folder)
    return [*LOOP_SOURCES, *(f"{unit.name}.c" for unit in units)], units


def _write_unit(name: str, file: Path, states: int, folder: Path) -> Unit:
    """The unit of an FMU, whose matrices are read with a case if it has up to so many ``states``."""
    contents = unpack(file)
    variables = list(parse(contents["modelDescription.xml"]).iter("ScalarVariable"))
    references = {variable.attrib["name"]: int(variable.attrib["valueReference"]) for variable in variables}
    # A link to the playground sets what is listed here: of an input it would say nothing.
    parameters = {variable.attrib["name"] for variable in variables if variable.attrib.get("causality") == "parameter"}
    sources = {path.removeprefix("sources/"): text for path, text in contents.items() if path.startswith("sources/")}
    sources[_NAMING] = sources[_NAMING].replace(
        b"fmi2FullName(name) name", b"fmi2FullName(name) %b_##name" % name.encode()
    )
    if states:
        sources[_GAINS] = (LOOP / _GAINS).read_bytes()
    (folder / name).mkdir()
    for source, text in sources.items():
        (folder / name / source).write_bytes(text)
    own = sorted({found.decode() for text in sources.values() for found in _GLOBAL.findall(text)})
    lines = [f"#define MOST_STATES {states}"] if states else []
    lines += [f"#define {word} {name}_{word}" for word in own]
    lines += [f'#include "{name}/{source}"' for source in sorted(sources) if source.endswith(".c")]
    lines += ['#include "torque.h"' if name == IMPERFECTIONS else '#include "closed_loop.h"']
    signals = ", ".join(_signals(references))
    matrices = "read_matrices" if states else "NULL"
    lines += [f"extern const Slave {name};", f"const Slave {name} = {{FUNCTIONS, {{{signals}}}, {matrices}}};", ""]
    (folder / f"{name}.c").write_text("\n".join(lines), encoding="utf-8")
    return Unit(name, {each: place for each, place in references.items() if each in parameters})


def _signals(references: Mapping[str, int]) -> Iterable[str]:
    for name in SIGNALS:
        if f"{name}[1]" in references:
            yield f"[SIGNAL_{name}] = {{2, {{{references[f'{name}[1]']}, {references[f'{name}[2]']}}}}}"


def block(
    units: Sequence[Unit],
    rules: Mapping[str, float],
    parts: Sequence[tuple[str, Mapping[str, float]]],
    matrices: Sequence[float] = (),
) -> list[float]:
    """A case as the program reads it: the RULES, then plant, imperfections and controller, each by the name of its unit
    with values by variable, then the :func:`matrices` of a linear controller."""
    numbers = {unit.name: number for number, unit in enumerate(units)}
    made = [float(rules[name]) for name in RULES]
    for name, values in parts:
        number = numbers[name]
        made += [number, len(values)]
        for variable, value in values.items():
            made += [units[number].references[variable], value]
    return [*made, *matrices]


def linear_unit(states: int) -> str:
    """The name of the smallest unit for a linear controller with so many states."""
    return f"Linear_{next(size for size in SIZES if size >= states)}"


def interface_of(units: Sequence[Unit]) -> dict[str, Any]:
    """What the numbers of a program with these units mean, for other languages."""
    return {
        "units": [unit._asdict() for unit in units],
        "rules": RULES,
        "figures": FIGURES,
        "reasons": REASONS,
        "verdicts": VERDICTS,
        "sizes": SIZES,
    }


def controller_files(files: Mapping[str, Path], linear: Path) -> dict[str, dict[str, str]]:
    """Description and C sources of the controllers' FMUs, and of the ``linear`` one as ``Linear``: texts by path."""
    chosen = {**{name: files[name] for name in CONTROLLERS}, "Linear": linear}
    return {
        name: {
            path: text.decode()
            for path, text in sorted(unpack(file).items())
            if path == "modelDescription.xml" or path.startswith("sources/")
        }
        for name, file in chosen.items()
    }


def web_module(files: Mapping[str, Path], linear: Path, target: Path) -> list[Unit]:
    """Compile the program for WebAssembly to ``target``; returns the program's units.

    Raises :class:`~controller_fmu.errors.NoCompilerError` without the package ``ziglang``,
    :class:`~controller_fmu.errors.CompilerError` if it fails.
    """
    if find_spec("ziglang") is None:
        raise NoCompilerError("WebAssembly needs the package ziglang", value="ziglang", remedy=REMEDY)
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as name:
        folder = Path(name)
        sources, units = write_sources(files, linear, folder)
        product = folder / "closed_loop.wasm"
        exports = [f"-Wl,--export={name}" for name in _EXPORTS]
        command = [sys.executable, "-m", "ziglang", "cc", "-target", WEB_TARGET, *_WEB_FLAGS, *exports]
        run_compiler([*command, "-o", str(product), *sources], product, folder, CROSS_TIME_LIMIT)
        write_atomically(product.read_bytes(), target)
    return units
