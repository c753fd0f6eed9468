"""FMUs from models in C, compiled on this machine; see ``controller_fmu/c_interface/model.h``."""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import fmpy

from controller_fmu.export.archive import BuildError, content_guid, pack, write_atomically
from controller_fmu.export.compiler import COMPILERS, NoCompilerError, find_compiler, run_compiler
from controller_fmu.export.description import complete, parse, to_bytes
from controller_fmu.export.dialects import Dialect, translate

C_INTERFACE = Path(__file__).resolve().parents[1] / "c_interface"
FMI_HEADERS = Path(fmpy.__file__).parent / "c-code"

# No fused multiply-add: torques shall be equal to the last bit to those of the same law in Python.
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-s")


def c_fmu(sources: Sequence[Path], description: Path, target: Path, dialect: Dialect | None = None) -> Path:
    """Build the FMU of a model in C and return ``target``, after whose stem the model is named.

    Args:
        sources: the model's .c and .h files; the glue to FMI and the standard's headers are added.
        description: its modelDescription.xml, FMI 2.0 co-simulation with units; it is completed.
        target: the FMU file to write; it is replaced in one go.
        dialect: which FMI to build for; FMI 2.0 co-simulation if None.

    Raises:
        NoCompilerError: there is no C compiler.
        BuildError: the sources do not compile, CC is no command, or the description lacks something.
    """
    try:
        compiler = find_compiler()
    except BuildError as problem:
        raise BuildError(f"{target.name}: {problem}") from None
    if compiler is None:
        raise NoCompilerError(f"{target.name}: no C compiler found ({', '.join(COMPILERS)}, or set CC); install one")
    if not target.stem.isidentifier():
        raise BuildError(f"{target.name}: the FMU's name must be a C identifier, as it becomes the model's name")
    dialect = dialect or Dialect()
    files = [
        *sources,
        *C_INTERFACE.glob("*.h"),
        C_INTERFACE / "component.c",
        C_INTERFACE / f"fmi{dialect.version}.c",
    ]
    texts = {file.name: file.read_bytes() for file in (*files, *FMI_HEADERS.glob(f"fmi{dialect.version}*.h"))}
    compiled = sorted(name for name in texts if name.endswith(".c"))
    root = _describe(description, target.stem, dialect, compiled)
    if dialect.version == 3:
        texts["buildDescription.xml"] = _build_description(target.stem, compiled)
    guid = content_guid({**texts, "modelDescription.xml": to_bytes(root)})
    root.set(dialect.guid_attribute, guid)
    texts["identity.h"] = _identity(target.stem, guid, dialect)
    platform = fmpy.platform_tuple if dialect.version == 3 else fmpy.platform
    library = f"binaries/{platform}/{target.stem}{fmpy.sharedLibraryExtension}"
    contents = {
        **{f"sources/{name}": text for name, text in texts.items()},
        "modelDescription.xml": to_bytes(root),
        library: _compile(compiler, texts, compiled, target.name),
    }
    return write_atomically(pack(contents), target)


def _describe(description: Path, name: str, dialect: Dialect, compiled: Sequence[str]) -> Element:
    root = complete(parse(description.read_bytes()), {})
    root.set("modelName", name)
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
    """Return what FMI 3 wants beside sources: how to compile them."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=name)
    listed = SubElement(configuration, "SourceFileSet", language="C99")
    for source in compiled:
        SubElement(listed, "SourceFile", name=source)
    return to_bytes(root)


def _identity(name: str, guid: str, dialect: Dialect) -> bytes:
    """Return the header that tells the glue whose binary it is."""
    lines = (
        f"#define MODEL_IDENTIFIER {name}",
        f'#define MODEL_GUID "{guid}"',
        f"#define MODEL_HAS_ARRAYS {int(dialect.arrays)}",
        f"#define MODEL_FLOAT_BITS {dialect.float_bits}",
    )
    return "".join(f"{line}\n" for line in lines).encode()


def _compile(compiler: list[str], texts: Mapping[str, bytes], compiled: Sequence[str], fmu: str) -> bytes:
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as folder:
        for name, text in texts.items():
            Path(folder, name).write_bytes(text)
        # Relative names inside the folder: no path of this machine gets into the binary.
        command, library = [*compiler, *FLAGS, "-o", "library", *compiled, "-lm"], Path(folder, "library")
        try:
            run_compiler(command, library, Path(folder))
        except BuildError as problem:
            raise BuildError(f"{fmu}: '{shlex.join(command)}' failed\n{problem}") from None
        return library.read_bytes()
