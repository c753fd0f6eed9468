"""The benchmark's own FMUs in C in the place of those in Python, where this machine makes them with the same bits."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from build_fmus import find_compiler
from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark.cases import case_named
from ..benchmark.protocol import load
from ..errors import BenchmarkError, EnvironmentFault, InputError
from ..fmi.archive import Archive, open_archive
from .built_in import DEFAULT_CONTROLLER, built_in
from .pairing import Pairing, simulate

PLANT, PLANT_IN_C = "FlexibleManipulator", "FlexibleManipulatorNative"
DEFAULT_IN_C = "DiagonalPID_C"

PROOF = "c07.random_1.disturbance"
"""The case in which a twin proves equal."""

logger = logging.getLogger(__name__)


def fastest_plant() -> Archive:
    """The manipulator, in C if that gives the same bits."""
    return _fastest(
        "The manipulator", PLANT, PLANT_IN_C, lambda plant: Pairing(plant, open_archive(built_in(DEFAULT_CONTROLLER)))
    )


def fastest_default() -> Archive:
    """The paper's PID, in C if that gives the same bits."""
    return _fastest(
        "The paper's PID",
        DEFAULT_CONTROLLER,
        DEFAULT_IN_C,
        lambda controller: Pairing(open_archive(built_in(PLANT)), controller),
    )


def _fastest(what: str, name: str, twin: str, bench: Callable[[Archive], Pairing]) -> Archive:
    """The FMU ``twin`` if this machine can build it and its build gives, in the case PROOF on its ``bench``, the
    trajectory of the FMU ``name`` in Python to the last bit, which is tried once; else the latter.

    Why a twin is not used, although there is a compiler, is a warning in the log.
    """
    if find_compiler() is None:
        return open_archive(built_in(name))
    try:
        native = open_archive(built_in(twin))
    except (EnvironmentFault, InputError) as problem:
        logger.warning("%s runs in Python. %s", what, problem)
        return open_archive(built_in(name))
    proof = native.file.with_name("equal.txt")
    with suppress(OSError):
        if proof.read_text(encoding="utf-8") == native.sha256:
            return native
    python = open_archive(built_in(name))
    if not _are_equal(bench(python), bench(native)):
        logger.warning("%s runs in Python: what the compiler here makes of it gives other bits.", what)
        return python
    with suppress(OSError):  # whoever finds none tries again
        proof.write_text(native.sha256, encoding="utf-8")
    return native


def _are_equal(python: Pairing, native: Pairing) -> bool:
    case = case_named(load("paper"), NOMINAL, 0, PROOF)
    try:
        first, second = (simulate(bench, case.scenario) for bench in (python, native))
    except BenchmarkError:
        return False
    names = ("q_m", "X", "measured", "command", "torque")
    return all(np.array_equal(getattr(first, name), getattr(second, name)) for name in names)
