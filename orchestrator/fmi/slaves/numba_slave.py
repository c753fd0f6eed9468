"""The benchmark's own FMUs in Python, stepped as machine code, which needs no compiler and takes a sixth of the time.

Such an FMU is loaded, initialized and terminated like any other. Between, the loop steps a copy of its state with C
functions that Numba makes of the FMU's source, without a call of the Python interpreter. An FMU is one of these if it
has the source of this package, file by file.
"""

from __future__ import annotations

import ctypes
import importlib
import json
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

import build_fmus

from ..archive import Archive
from ..port import Port
from ..trace import NOBODY
from ..variables import Variable
from .co_simulation import Fmi2CoSimulation

ROOT = Path(build_fmus.__file__).resolve().parent

SOURCES = {
    "numba_plant": (ROOT / "plant_fmu", ("manipulator_fmu.py", "flexible_manipulator/*.py")),
    "numba_pid": (ROOT / "controller_fmu" / "pid", ("*.py",)),
}
"""By module of this package with the C functions: the folder and the patterns of the FMU's source."""


def compiled_twin_of(archive: Archive) -> str | None:
    """The module with the C functions of an FMU, None if it is not one of the benchmark's in Python."""
    resources = archive.folder / "resources"
    script = resources / "slavemodule.txt"
    if not script.is_file():
        return None
    contents = _contents(resources, ["*.py", "*/*.py"])
    # File by file, not by name or version: a changed FMU is another law, and is stepped as it is.
    return next((twin for twin, (folder, patterns) in SOURCES.items() if contents == _contents(folder, patterns)), None)


def _contents(folder: Path, patterns: Sequence[str]) -> dict[str, bytes]:
    """Contents by relative path, without pythonfmu's own, which comes with every such FMU."""
    files = (file for pattern in patterns for file in folder.glob(pattern))
    contents = {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}
    return {name: content for name, content in contents.items() if not name.startswith("pythonfmu/")}


class NumbaSlave(Fmi2CoSimulation):
    """One of the benchmark's own FMUs in Python."""

    def __init__(self, archive: Archive, side: int = NOBODY, twin: str = "") -> None:
        # Before the FMU is loaded, which brings modules of the same names.
        self._twin: ModuleType = importlib.import_module(f".{twin}", __package__)
        super().__init__(archive, side)

    def port(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Port:
        """A port to a copy of the instance's state, as it is now: the instance itself is not stepped."""
        # Kept by this object: the loop has the address alone.
        self._memory = np.array(self._twin.memory(json.loads(self._state())), dtype=np.float64)
        return (
            super()
            .port(inputs, outputs)
            ._replace(
                instance=self._memory.ctypes.data,
                set_values=self._twin.write.address,
                do_step=self._twin.step.address,
                get_values=self._twin.read.address,
            )
        )

    def _state(self) -> bytes:
        with self._reported("fmi2SerializeFMUstate"):
            state = ctypes.c_void_p()
            self._fmu.fmi2GetFMUstate(self._fmu.component, ctypes.byref(state))
            try:
                data: bytes = self._fmu.serializeFMUstate(state)
            finally:
                self._fmu.fmi2FreeFMUstate(self._fmu.component, ctypes.byref(state))
            return data
