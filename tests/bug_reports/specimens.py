"""Builds the FMUs: ``specimen.c`` with one property, a description, and the files around them."""

import subprocess
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree.ElementTree import Element, SubElement

import fmpy
from exporters.description_edits import DESCRIPTION, Edit, edited
from support.pid_fmus import T_S
from support.stub_fmus import CONTROLLER, description
from support.tools import require

import build_fmus
from controller_fmu.export.c_fmu import FMI_HEADERS
from controller_fmu.export.compiler import require_compiler
from controller_fmu.export.description import complete, parse, to_bytes

NAME = "Specimen"
LAW = Path(build_fmus.__file__).parent / "controller_fmu" / "pid_c"
SOURCES = (Path(__file__).parent / "specimen.c", LAW / "pid.c")
SUFFIX = fmpy.sharedLibraryExtension
GAINS = b"45.0 30.0 1.5\n15.0 10.0 0.5\n"
"""``resources/gains.txt`` with the gains of the paper's PID: K_p, K_i, K_d of each axis."""

Contents = dict[str, bytes]
"""Files of an archive by name; a name with a slash at its end is a folder."""

Change = Callable[[Contents], Contents]


@dataclass(frozen=True)
class Specimen:
    """An FMU with one property."""

    has: str = "none"
    """The property that ``specimen.c`` has."""
    edits: tuple[Edit, ...] = ()
    """Changes of its description."""
    changes: tuple[Change, ...] = ()
    """Changes of its files."""
    options: tuple[str, ...] = ()
    """Options of the compiler."""
    version: str = "2.0"
    """Of FMI."""

    def write(self, file: Path) -> Path:
        """Write the FMU to ``file`` and return that; the test is skipped where there is no C compiler."""
        require("compiler")
        root = described(self.version, self.has)
        for edit in self.edits:
            edit(root)
        platform = fmpy.platform_tuple if self.version == "3.0" else fmpy.platform
        files = {DESCRIPTION: to_bytes(root), f"binaries/{platform}/{NAME}{SUFFIX}": library(self.options)}
        for change in self.changes:
            files = change(files)
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in files.items():
                archive.writestr(name, data)
        return file


@dataclass(frozen=True)
class OfTheProject:
    """An FMU of the project with another description."""

    name: str
    edits: tuple[Edit, ...] = ()

    def write(self, file: Path) -> Path:
        """Write the FMU to ``file`` and return that; the test is skipped where there is no C compiler."""
        require("compiler")
        with TemporaryDirectory() as folder:
            return edited(build_fmus.build(self.name, Path(folder)), file, *self.edits)


def described(version: str, token: str) -> Element:
    """The description of ``specimen.c``."""
    if version == "3.0":
        root = Element("fmiModelDescription", fmiVersion="3.0", modelName=NAME, instantiationToken=token)
        SubElement(root, "CoSimulation", modelIdentifier=NAME)
        SubElement(root, "DefaultExperiment", stepSize=repr(T_S))
        variables, structure = SubElement(root, "ModelVariables"), SubElement(root, "ModelStructure")
        for reference, (name, causality, _, start) in enumerate(CONTROLLER):
            variability = {"parameter": "fixed"}.get(causality, "continuous")
            values = {"name": name, "valueReference": str(reference), "causality": causality}
            start_value = {} if start is None else {"start": repr(start)}
            SubElement(variables, "Float64", values | start_value, variability=variability)
            if causality == "output":
                SubElement(structure, "Output", valueReference=str(reference))
        return root
    root = parse(description(CONTROLLER, T_S))
    root.attrib.update(modelName=NAME, guid=token)
    for interface in root.iterfind("CoSimulation"):
        interface.set("modelIdentifier", NAME)
    return complete(root)


@cache
def library(options: tuple[str, ...] = ()) -> bytes:
    """The shared library with these options of the compiler."""
    with TemporaryDirectory() as folder:
        return linked(SOURCES, Path(folder, "library"), *options)


def linked(sources: tuple[Path, ...], target: Path, *options: str) -> bytes:
    """The shared library of C sources, which is left at ``target``."""
    command = [*require_compiler(), "-std=gnu99", "-O1", "-fPIC", "-shared", "-w", "-ffp-contract=off"]
    headers = [f"-I{FMI_HEADERS}", f"-I{LAW}"]
    subprocess.run([*command, *headers, *map(str, sources), "-o", str(target), *options, "-lpthread"], check=True)
    return target.read_bytes()


@cache
def other_library(name: str) -> bytes:
    """The shared library ``name`` with the function that -DOTHER_LIBRARY calls."""
    with TemporaryDirectory() as folder:
        source = Path(folder, "other.c")
        source.write_text("double other_function(double x) { return x; }\n")
        return linked((source,), Path(folder, name), f"-Wl,-soname,{name}")


@cache
def needing(name: str, *options: str) -> bytes:
    """The library that needs another one, ``name``, to be loaded."""
    with TemporaryDirectory() as folder:
        Path(folder, name).write_bytes(other_library(name))
        return linked(SOURCES, Path(folder, "library"), "-DOTHER_LIBRARY", f"-L{folder}", f"-l:{name}", *options)
