"""The optional tools that tests need, and the one way to skip a test: for a tool of this list that is not there.

``@pytest.mark.needs("compiler", "bubblewrap")`` marks a test; ``require("compiler")`` does the same in a fixture, in a
helper, or at the head of a module, and ``PRESENT["compiler"]`` is for tests that run either way. This module is also a
pytest plugin: it turns a skip with any other reason into a failure. As a program it prints what is there.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from typing import Any

import fmpy
import pytest
from random_calls.build import sanitizing_compiler

import build_fmus
from orchestrator.execution import sandbox

MINGW = "x86_64-w64-mingw32-gcc"

BROWSERS = ("chromium", "chromium-browser", "google-chrome")

LATEX = ("pdflatex", "tectonic")


def bubblewrap_works() -> bool:
    """Whether it is installed and may make namespaces, which a container may forbid."""
    program = shutil.which("bwrap")
    return program is not None and _runs([program, *sandbox.OPTIONS, "--", "true"])


def namespaces_work() -> bool:
    """Whether a process may have user and mount namespaces of its own."""
    return _runs([sys.executable, "-c", "from orchestrator.execution.interpreter import protect as p; exit(not p())"])


def musl_gcc_works() -> bool:
    """Whether it is installed, and the gcc that it calls."""
    program = shutil.which("musl-gcc")
    return program is not None and _runs([program, "--version"])


def _runs(command: list[str]) -> bool:
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@dataclass(frozen=True)
class Tool:
    """What a test may need."""

    reason: str
    """Why a test is skipped where the tool is missing."""
    found: Callable[[], bool]


def _program(name: str, reason: str) -> Tool:
    return Tool(reason, lambda: shutil.which(name) is not None)


def _package(name: str, extra: str) -> Tool:
    return Tool(f"needs the Python package {name} (extra {extra})", lambda: _installed(name))


def _installed(package: str) -> bool:
    try:
        distribution(package)
    except PackageNotFoundError:
        return False
    return True


PACKAGES = {
    "exporters": (
        *("pythonfmu3", "fmu_manipulation_toolbox", "component_model", "casadi", "rumoca"),
        *("libcosimpy", "ecospy", "tbb", "fmuloader", "pathsim_fmi"),
    ),
    "cluster": ("distributed",),
    "parquet": ("pyarrow",),
    "design": ("control", "slycot"),
    "tuning": ("optuna", "cmaes"),
    "beacon": ("py_ecc",),
    "gymnasium": ("gymnasium", "greenlet"),
    "onnx": ("onnxruntime",),
    "service": ("starlette", "uvicorn"),
    "test": ("onnx", "playwright", "axe_playwright_python", "nbclient", "nbformat", "jsonschema", "httpx2"),
}
"""Optional Python packages by the extra that installs them."""

TOOLS: Mapping[str, Tool] = {
    "compiler": Tool("needs a C compiler (cc, gcc, clang, or extra native)", lambda: bool(build_fmus.find_compiler())),
    "ziglang": _package("ziglang", "native"),
    "sanitizers": Tool("needs AddressSanitizer (gcc or clang with its runtime)", lambda: bool(sanitizing_compiler())),
    "gcc": _program("gcc", "needs gcc"),
    "g++": _program("g++", "needs g++"),
    "bash": _program("bash", "needs bash"),
    "curl": _program("curl", "needs curl"),
    "clang": _program("clang", "needs clang"),
    "bubblewrap": Tool("needs bubblewrap (bwrap) that may make namespaces", bubblewrap_works),
    "namespaces": Tool("needs Linux that allows user namespaces", namespaces_work),
    # A script that calls gcc, which may be missing beside it.
    "musl-gcc": Tool("needs musl (musl-gcc, with gcc)", musl_gcc_works),
    "qemu-aarch64": _program("qemu-aarch64", "needs QEMU for programs of Linux on arm64 (qemu-aarch64)"),
    "octave": _program("octave-cli", "needs Octave (octave-cli)"),
    "node": _program("node", "needs Node.js (node)"),
    "wine": _program("wine", "needs Wine (wine)"),
    "mingw": _program(MINGW, f"needs a C compiler for Windows (package mingw-w64, {MINGW})"),
    "chromium": Tool(f"needs a browser ({', '.join(BROWSERS)})", lambda: any(map(shutil.which, BROWSERS))),
    "latex": Tool(f"needs LaTeX ({' or '.join(LATEX)})", lambda: any(map(shutil.which, LATEX))),
    "readelf": _program("readelf", "needs readelf (binutils)"),
    "openssl": _program("openssl", "needs OpenSSL (openssl)"),
    "OMSimulator": _program("OMSimulator", "needs OMSimulator on the path (OMSimulator)"),
    # Its requirements exclude the gymnasium of the extra of that name, with which it works.
    "fmugym": Tool("needs the Python package fmugym (pip install --no-deps fmugym)", lambda: _installed("fmugym")),
    "posix": Tool("needs a POSIX system", lambda: os.name == "posix"),
    "linux": Tool("needs Linux", lambda: sys.platform == "linux"),
    "x86_64-linux": Tool("needs Linux on x86-64", lambda: fmpy.platform_tuple == "x86_64-linux"),
    **{name: _package(name, extra) for extra, names in PACKAGES.items() for name in names},
}
"""The closed list, by the names that tests use."""

PRESENT: Mapping[str, bool] = {name: tool.found() for name, tool in TOOLS.items()}
"""Which of them this machine has; found out at the start, since tests change PATH and CC."""

REASONS = frozenset(tool.reason for name, tool in TOOLS.items() if not PRESENT[name])
"""The reasons for which a test may be skipped on this machine."""


def require(*names: str) -> None:
    """Skip the test, or the module that calls it at its head, unless this machine has the tools ``names``."""
    for name in names:
        if not PRESENT[name]:
            pytest.skip(TOOLS[name].reason, allow_module_level=True)


def in_c(name: str) -> bool:
    """Whether the project's FMU ``name`` is in C."""
    return "_C" in name or "Native" in name or name.startswith(("Imperfections", "Robust", "Steady"))


def require_for(name: str) -> None:
    """Skip the test unless this machine can build the project's FMU ``name``: one in C takes a compiler."""
    if in_c(name):
        require("compiler")


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker."""
    config.addinivalue_line("markers", "needs(*tools): is skipped where a tool of tests/support/tools.py is missing")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a marked test before its fixtures are made."""
    for marker in item.iter_markers("needs"):
        require(*marker.args)


@pytest.hookimpl(hookwrapper=True, tryfirst=True)  # the outermost, which sees what the others made of it
def pytest_runtest_makereport() -> Generator[None, Any, None]:
    """Let a test fail that was skipped for a reason outside the list."""
    _check((yield).get_result())


@pytest.hookimpl(hookwrapper=True)
def pytest_make_collect_report() -> Generator[None, Any, None]:
    """The same for a module."""
    _check((yield).get_result())


def _check(report: pytest.TestReport | pytest.CollectReport) -> None:
    if not report.skipped:
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else "an expected failure"
    reason = reason.removeprefix("Skipped: ")
    if reason not in REASONS:
        vars(report).pop("wasxfail", None)
        report.outcome = "failed"
        report.longrepr = f"skipped for a reason that tests/support/tools.py does not list here: {reason}"


if __name__ == "__main__":
    for name, there in PRESENT.items():
        print(f"{name}: {'there' if there else TOOLS[name].reason}")
