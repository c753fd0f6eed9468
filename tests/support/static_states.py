"""The PID as FMUs in C that keep what they remember in different places: the instance, or static memory."""

import subprocess
import tempfile
from functools import cache
from pathlib import Path

import fmpy

import build_fmus
from controller_fmu.export.archive import pack
from controller_fmu.export.c_fmu import FMI_HEADERS
from controller_fmu.export.compiler import require_compiler
from controller_fmu.export.description import complete, parse, to_bytes
from support.stub_fmus import CONTROLLER, SOURCES, description
from support.tools import require

PID = Path(build_fmus.__file__).parent / "controller_fmu" / "pid_c"
NAME = "StaticState"

KEPT = (
    "IN_THE_INSTANCE",
    "SINCE_LOADING",
    "SINCE_INSTANTIATION",
    "UNTIL_TERMINATION",
    "FOR_ALL_INSTANCES",
    "AFTER_A_FORCE",
    "NOWHERE",
)
"""Where the state is kept, see ``tests/stubs/static_state.c``."""


def static_state_fmu(folder: Path, kept: str, **abilities: str) -> Path:
    """The FMU that keeps its state where ``kept`` says; the test is skipped where there is no C compiler."""
    root = parse(description(CONTROLLER, 0.25e-3, canHandleVariableCommunicationStepSize="true"))
    root.attrib.update(modelName=NAME, guid="{static}")
    for interface in root.iterfind("CoSimulation"):
        interface.attrib.update({"modelIdentifier": NAME, **abilities})
    library = f"binaries/{fmpy.platform}/{NAME}{fmpy.sharedLibraryExtension}"
    file = folder / f"{kept.lower()}{len(abilities)}.fmu"
    file.write_bytes(pack({"modelDescription.xml": to_bytes(complete(root, {})), library: _library(kept)}))
    return file


@cache
def _library(kept: str) -> bytes:
    require("compiler")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder, "library")
        flags = ["-std=gnu99", "-O1", "-fPIC", "-shared", "-w", "-ffp-contract=off"]
        places = [f"-I{FMI_HEADERS}", f"-I{PID}", f"-DKEPT={kept}", str(SOURCES / "static_state.c"), str(PID / "pid.c")]
        subprocess.run([*require_compiler(), *flags, *places, "-o", str(target), "-lm"], check=True)
        return target.read_bytes()
