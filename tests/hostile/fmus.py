"""Builds hostile controllers: one compiled library, and a fault in the resources of each FMU."""

import subprocess
import zlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
import pythonfmu
from support.stub_fmus import CONTROLLER, description
from support.tools import require

from controller_fmu.export.archive import pack
from controller_fmu.export.c_fmu import FMI_HEADERS
from controller_fmu.export.compiler import require_compiler
from controller_fmu.export.description import complete, parse, to_bytes

SOURCES = Path(__file__).parent
NAME = "Hostile"
LIBRARY = f"binaries/{fmpy.platform}/{NAME}{fmpy.sharedLibraryExtension}"


@dataclass(frozen=True)
class Fault:
    """``what`` goes wrong in the call ``where`` from the time ``at`` [s] on.

    ``which`` says in which simulations: 0 in all, n > 0 in the n-th instance of a process, below 0 in those that end
    at this many milliseconds.
    """

    what: str
    where: str = "step"
    at: float = 0.02
    which: float = 0

    def __str__(self) -> str:
        return f"{self.what}-{self.where}"

    def text(self) -> str:
        """What the controller reads."""
        return f"{self.what} {self.where} {self.at!r} {self.which!r}\n"


NONE = Fault("none", "never")


def hostile_fmu(folder: Path, fault: Fault = NONE) -> Path:
    """The FMU with ``fault`` in ``folder``; the test is skipped where there is no C compiler."""
    text = fault.text().encode()
    file = folder / f"{NAME}-{fault.what.replace(':', '_')}-{fault.where}-{zlib.crc32(text)}.fmu"
    file.write_bytes(pack({**contents(), "resources/fault.txt": text}))
    return file


@cache
def contents() -> dict[str, bytes]:
    """The files of a hostile FMU, but for its fault."""
    return {"modelDescription.xml": edited(), LIBRARY: _library()}


@cache
def sound() -> dict[str, bytes]:
    """The files of an FMU with nothing wrong, as long as nobody loads it: its library, which takes no compiler, is that
    of the FMUs in Python."""
    library = Path(pythonfmu.__file__).parent / "resources" / "binaries" / fmpy.platform
    (file,) = library.glob(f"*{fmpy.sharedLibraryExtension}")
    return {"modelDescription.xml": edited(), LIBRARY: file.read_bytes(), "resources/none.txt": b""}


def edited(**attributes: str) -> bytes:
    """Description of ``controller.c``, with other attributes of its CoSimulation element."""
    root = parse(description(CONTROLLER, canHandleVariableCommunicationStepSize="true"))
    root.attrib.update(modelName=NAME, guid="{hostile}")
    for interface in root.iterfind("CoSimulation"):
        interface.attrib.update({"modelIdentifier": NAME, **attributes})
    return to_bytes(complete(root, {}))


def _library() -> bytes:
    require("compiler")
    with TemporaryDirectory() as folder:
        target = Path(folder, "library")
        command = [*require_compiler(), "-std=gnu99", "-O1", "-fPIC", "-shared", "-w", f"-I{FMI_HEADERS}"]
        subprocess.run([*command, str(SOURCES / "controller.c"), "-o", str(target), "-lm", "-lpthread"], check=True)
        return target.read_bytes()
