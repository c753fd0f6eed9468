"""What a program in C is compiled for in the tests of equal bits, and how it is run there."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

ZIG = (sys.executable, "-m", "ziglang", "cc")
FLAGS = ("-std=c99", "-ffp-contract=off")
"""Those of the builders, but for how much is optimized and what the product is."""


@dataclass(frozen=True)
class Target:
    """A compiler with its options, and what runs the program."""

    compiler: tuple[str, ...]
    needs: tuple[str, ...]
    """Names in :mod:`.tools`."""
    runner: tuple[str, ...] | None = ()
    """None where the program can only be compiled."""


def _zig(target: str, level: str, *needs: str, runner: tuple[str, ...] | None = ()) -> Target:
    return Target((*ZIG, "-target", target, level), ("ziglang", *needs), runner)


HERE = "x86_64-linux"
WASI = ("node", "--no-warnings", str(Path(__file__).parents[1] / "stubs" / "wasi.mjs"))

TARGETS: Mapping[str, Target] = {
    **{f"{name}{level}": Target((name, level), (name,)) for name in ("gcc", "clang") for level in ("-O0", "-O2")},
    "gcc-O3-native": Target(("gcc", "-O3", "-march=native"), ("gcc", HERE)),
    "clang-O3-native": Target(("clang", "-O3", "-march=native"), ("clang", HERE)),
    **{f"zig{level}": Target((*ZIG, level), ("ziglang",)) for level in ("-O0", "-O2")},
    "musl-gcc-O2": Target(("musl-gcc", "-static", "-O2"), ("musl-gcc",)),
    "x86_64-musl-O2": _zig("x86_64-linux-musl", "-O2", HERE),
    "x86_64-windows-O0": _zig("x86_64-windows-gnu", "-O0", "wine", HERE, runner=("wine",)),
    "x86_64-windows-O2": _zig("x86_64-windows-gnu", "-O2", "wine", HERE, runner=("wine",)),
    "aarch64-musl-O2": _zig("aarch64-linux-musl", "-O2", "qemu-aarch64", runner=("qemu-aarch64",)),
    "wasm32": _zig("wasm32-wasi", "-O2", "node", runner=WASI),
    "x86_64-macos-O2": _zig("x86_64-macos", "-O2", runner=None),
    "aarch64-macos-O2": _zig("aarch64-macos", "-O2", runner=None),
}
"""By name."""


def compile_program(target: Target, sources: Sequence[str], folder: Path, program: str) -> Path:
    """Compile ``sources`` in ``folder`` to the file ``program`` there."""
    libraries = () if "windows" in " ".join(target.compiler) else ("-lm",)
    command = [*target.compiler, *FLAGS, "-o", program, *sources, *libraries]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / program


def run_program(target: Target, program: Path, given: Path, environment: Mapping[str, str] | None = None) -> list[str]:
    """The lines that the program prints for the file ``given`` in its own folder."""
    command = [*(target.runner or ()), str(program), given.name]
    done = subprocess.run(command, cwd=given.parent, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (done.returncode, done.stderr[-2000:])
    return done.stdout.splitlines()


@contextmanager
def wine_prefix() -> Iterator[dict[str, str]]:
    """The environment of a new installation of Wine: 700 MB, which go with it, as does its server."""
    with TemporaryDirectory() as folder:
        # Without the two packages that Wine would ask for on a screen.
        wine = {"WINEPREFIX": folder, "WINEDEBUG": "-all", "WINEDLLOVERRIDES": "mscoree,mshtml="}
        environment = {**os.environ, **wine}
        try:
            yield environment
        finally:
            subprocess.run(["wineserver", "--kill"], env=environment, check=False)
            subprocess.run(["wineserver", "--wait"], env=environment, check=False)
