"""Compiles the harness together with the sources of an FMU, and runs it."""

from __future__ import annotations

import os
import resource
import shlex
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from fmpy import read_model_description

from controller_fmu.export import unpack

HERE = Path(__file__).parent
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
FLAGS = ("-std=gnu11", "-g", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror")
FLAGS += ("-Wno-unused-function",)  # no version of FMI uses all of the harness
COMPILERS = ("gcc", "clang")

SECONDS_PER_CALL = 1e-3
"""Processor time that a run may take for each call, and much more than it takes: a harness that hangs is ended."""


@cache
def sanitizing_compiler() -> list[str] | None:
    """The command of a C compiler that has both sanitizers and can run what it compiles; None if there is none.

    That of the package ziglang is not tried: it takes the option, and has no AddressSanitizer.
    """
    with TemporaryDirectory() as folder:
        source, program = Path(folder, "empty.c"), Path(folder, "empty")
        source.write_text("int main(void) { return 0; }\n")
        for command in ([name] for name in COMPILERS):
            try:
                subprocess.run(
                    [*command, *SANITIZERS, str(source), "-o", str(program)], check=True, capture_output=True
                )
                subprocess.run([str(program)], check=True, capture_output=True, env=_environment())
            except (OSError, subprocess.CalledProcessError):
                continue
            return command
    return None


def _environment() -> dict[str, str]:
    sanitizers = {"ASAN_OPTIONS": "detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    return {**os.environ, **sanitizers}


def _header(fmu: Path) -> str:
    """What the harness has to know of an FMU, from its model description."""
    description = read_model_description(str(fmu))
    major = description.fmiVersion[0]
    sizes: dict[int, int] = {}
    for variable in description.modelVariables:
        count = 1
        for dimension in variable.dimensions:
            count *= int(dimension.start)
        sizes[variable.valueReference] = count
    chosen = {
        kind: [v.valueReference for v in description.modelVariables if _kind(v) == kind]
        for kind in ("input", "output", "parameter")
    }
    extents = [sizes.get(reference, 0) for reference in range(max(sizes) + 1)]
    step = description.defaultExperiment.stepSize or 0.25e-3
    token = description.guid
    lines = [
        f"#define FMI_VERSION {major}",
        f'#define GLUE "fmi{major}.c"',
        f'#define CALLS "calls{major}.h"',
        f'#define FMU_GUID "{token}"',
        f"#define STEP_SIZE {step}",
        f"enum {{ REFERENCES = {len(extents)}, INPUT_SIZE = {sum(sizes[r] for r in chosen['input'])}, "
        f"OUTPUT_SIZE = {sum(sizes[r] for r in chosen['output'])} }};",
        f"static const unsigned EXTENTS[] = {{{', '.join(map(str, extents))}}};",
        *(
            f"static const unsigned {kind.upper()}S[] = {{{', '.join(map(str, references))}}};"
            for kind, references in chosen.items()
        ),
    ]
    return "\n".join(("#ifndef FMU_H", "#define FMU_H", *lines, "#endif", ""))


def _kind(variable: object) -> str:
    """Input, output or parameter, for which FMI 1.0 has no causality."""
    if (
        getattr(variable, "variability", None) in ("parameter", "fixed")
        and getattr(variable, "start", None) is not None
    ):
        return "parameter"
    return str(getattr(variable, "causality", ""))


def build(fmu: Path, folder: Path) -> Path:
    """The harness for an FMU with its sources, compiled in ``folder``, which exists."""
    compiler = sanitizing_compiler()
    assert compiler is not None
    for name, data in unpack(fmu).items():
        if name.startswith("sources/"):
            folder.joinpath(Path(name).name).write_bytes(data)
    folder.joinpath("fmu.h").write_text(_header(fmu))
    glue = folder / f"fmi{read_model_description(str(fmu)).fmiVersion[0]}.c"
    sources = [str(file) for file in sorted(folder.glob("*.c")) if file != glue]
    program = folder / "random_calls"
    includes = (f"-I{folder}", f"-I{HERE}")
    command = [*compiler, *FLAGS, *SANITIZERS, *includes, str(HERE / "random_calls.c"), *sources, "-o", str(program)]
    done = subprocess.run([*command, "-lm"], capture_output=True, text=True)
    assert done.returncode == 0, f"{shlex.join(command)}\n{done.stderr}"
    return program


def run(program: Path, *arguments: object, calls: int = 100_000) -> subprocess.CompletedProcess[str]:
    """Run the harness, with a limit of its processor time."""
    limit = 60 + int(calls * SECONDS_PER_CALL)
    return subprocess.run(
        [str(program), *map(str, arguments)],
        capture_output=True,
        text=True,
        env=_environment(),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (limit, limit)),
    )
