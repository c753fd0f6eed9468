"""FMUs from models in C, compiled on this machine; see ``controller_fmu/c_interface/model.h``."""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import fmpy

from controller_fmu.errors import CompilerError, SourceError, TargetError, located
from controller_fmu.export.archive import check_target, content_guid, pack, write_atomically
from controller_fmu.export.compiler import require_compiler, run_compiler
from controller_fmu.export.description import complete, parse, to_bytes
from controller_fmu.export.dialects import Dialect, translate
from controller_fmu.export.identity import identity
from controller_fmu.export.platforms import binaries, cross_compilers
from controller_fmu.export.terminals import terminals_and_icons
from controller_fmu.export.value_references import check_declared, check_model

C_INTERFACE = Path(__file__).resolve().parents[1] / "c_interface"
FMI_HEADERS = Path(fmpy.__file__).parent / "c-code"

GENERATION_TOOL = "controller_fmu.export"

# No fused multiply-add: torques are to equal those of the same law in Python to the last bit.
# -O3, because the manipulator takes a tenth less time than with -O2.
FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fPIC", "-shared", "-s")


CROSS_TIME_LIMIT = 1800.0
"""Seconds for a binary of another platform: the first one compiles that platform's C library as well."""


def c_fmu(
    sources: Sequence[Path],
    description: Path,
    target: Path,
    dialect: Dialect | None = None,
    platforms: Sequence[str] = (),
) -> Path:
    """Build the FMU of a model in C and return ``target``, after whose stem the model is named.

    Args:
        sources: the model's .c and .h files; the glue to FMI and the standard's headers are added.
        description: its modelDescription.xml, FMI 2.0 co-simulation with units; it is completed. Its value references
            are the places of the variables in the model's struct, each of them once.
        target: the FMU file to write, in a folder that exists; it is replaced in one go.
        dialect: which FMI to build for; FMI 2.0 co-simulation if None.
        platforms: names in PLATFORMS to build binaries for, which takes the package ``ziglang``; this machine's own,
            by its own compiler, if empty.

    Raises:
        TargetError: there is no folder for ``target``, or its stem is not a C identifier.
        PlatformError: there is no such platform.
        NoCompilerError: there is no C compiler.
        CompilerError: the sources do not compile, or the environment variable CC is not a command.
        SourceError: a source has the name of a file that is added.
        ValueReferenceError: the description and the built model disagree on the variables.
        UnitError, DescriptionError: the description lacks something.
    """
    check_target(target)
    if not (target.stem.isascii() and target.stem.isidentifier()):
        what = "the name of the FMU becomes the model's name, and is not a C identifier"
        raise TargetError(what, str(target), value=target.stem)
    with located(target):
        compilers = cross_compilers(platforms) or {fmpy.platform_tuple: require_compiler()}
    dialect = dialect or Dialect()
    texts = _texts(sources, dialect)
    compiled = sorted(name for name in texts if name.endswith(".c"))
    with located(description):
        scalars = complete(parse(description.read_bytes()))
        check_declared(scalars, dialect.arrays)
        root = _describe(scalars, target.stem, dialect, compiled)
    if dialect.version == 3:
        texts["buildDescription.xml"] = _build_description(target.stem, compiled)
    guid = content_guid({**texts, "modelDescription.xml": to_bytes(root)})
    root.set(dialect.guid_attribute, guid)
    evaluates = any(b"void model_evaluate(" in texts[source.name] for source in sources)
    texts["identity.h"] = identity(target.stem, guid, dialect, scalars, evaluates)
    libraries: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as folder, located(description):
        for name, compiler in compilers.items():
            library = _compile(compiler, texts, compiled, Path(folder), target)
            libraries[name] = library.read_bytes()
            if name == fmpy.platform_tuple:
                check_model(library, scalars)
    contents = {
        **{f"sources/{name}": text for name, text in texts.items()},
        "modelDescription.xml": to_bytes(root),
        **terminals_and_icons(root, dialect.version),
        **(binaries if platforms else _own_binary)(libraries, target.stem, dialect.version),
    }
    return write_atomically(pack(contents), target)


def _texts(sources: Sequence[Path], dialect: Dialect) -> dict[str, bytes]:
    """Return all that is compiled, by file name."""
    glue = [C_INTERFACE / "component.c", C_INTERFACE / f"fmi{dialect.version}.c", *C_INTERFACE.glob("*.h")]
    added = [*glue, *FMI_HEADERS.glob(f"fmi{dialect.version}*.h")]
    names = {file.name for file in added}
    for source in sources:
        if source.name in names:
            what = "the file has the name of one that the build adds"
            raise SourceError(what, str(source), value=source.name, remedy="give it another name")
    return {file.name: file.read_bytes() for file in (*sources, *added)}


def _describe(root: Element, name: str, dialect: Dialect, compiled: Sequence[str]) -> Element:
    root.set("modelName", name)
    root.set("generationTool", GENERATION_TOOL)
    for interface in root.iterfind("CoSimulation"):
        interface.set("modelIdentifier", name)
    translated = translate(root, dialect)
    if dialect.version == 2:
        for interface in translated.iterfind(dialect.interface):
            listed = SubElement(interface, "SourceFiles")
            for source in compiled:
                SubElement(listed, "File", name=source)
    return translated


def _build_description(name: str, compiled: Sequence[str]) -> bytes:
    """Return how to compile the sources, which FMI 3 asks for."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=name)
    listed = SubElement(configuration, "SourceFileSet", language="C99")
    for source in compiled:
        SubElement(listed, "SourceFile", name=source)
    return to_bytes(root)


def _own_binary(libraries: Mapping[str, bytes], name: str, version: int) -> dict[str, bytes]:
    """Return this machine's binary, in the folder where FMPy looks for it."""
    folder = fmpy.platform_tuple if version == 3 else fmpy.platform
    return {f"binaries/{folder}/{name}{fmpy.sharedLibraryExtension}": libraries[fmpy.platform_tuple]}


def _compile(
    compiler: Sequence[str], texts: Mapping[str, bytes], compiled: Sequence[str], folder: Path, target: Path
) -> Path:
    for name, text in texts.items():
        Path(folder, name).write_bytes(text)
    # Relative names inside the folder: no path of this machine gets into the binary.
    command = [*compiler, *FLAGS, "-o", "library", *compiled, "-lm"]
    try:
        run_compiler(command, folder / "library", folder, CROSS_TIME_LIMIT if "ziglang" in compiler else None)
    except CompilerError as problem:
        raise CompilerError(f"'{shlex.join(command)}' failed\n{problem}", str(target), value=problem.value) from None
    return folder / "library"
