"""Opening an FMU file: checking the archive, reading its description, extracting it once by content.

The file comes from a stranger. Nothing of it is executed here (sources are compiled where there is no binary), and
nothing is written outside the cache folder.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import stat
import tempfile
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import fmpy
from fmpy.model_description import ModelDescription
from lxml import etree

from ..errors import InputError
from ..folders import cache_folder
from .compilation import compile_sources
from .variables import variables

MOST_FILES = 10_000
MOST_BYTES = 2 * 1024**3
"""Limits of an archive's contents; the largest FMUs of simulation tools have some hundred megabytes."""
MOST_RATIO = 200
"""Limit of the compression ratio of an archive larger than SMALL: beyond it is a zip bomb, not a model."""
SMALL = 64 * 1024**2
DESCRIPTIONS = ("modelDescription.xml", "sources/buildDescription.xml")
"""What is read into the memory of this process; elements of XML take some twenty times as much there."""
LARGEST_DESCRIPTION = 32 * 1024**2


@dataclass(frozen=True)
class Archive:
    """An FMU on disk: its file, the SHA-256 of its bytes, the folder it is extracted to, its description.

    ``kind`` is "CoSimulation" or "ModelExchange": what the benchmark uses of it.
    """

    file: Path
    sha256: str
    folder: Path
    description: ModelDescription
    kind: str

    @property
    def name(self) -> str:
        """File name, for messages."""
        return self.file.name

    @property
    def major_version(self) -> str:
        """ "1", "2" or "3"."""
        return str(self.description.fmiVersion)[0]


def open_archive(file: Path) -> Archive:
    """Check and extract the FMU ``file``; a second call with the same bytes finds the first one's folder.

    One folder per content also keeps compiled code that lies beside an FMU's sources. An FMU that has only sources is
    compiled. Raises :class:`InputError` where the file cannot be used, with the reason and the way out.
    """
    try:
        if not file.is_file():
            raise InputError(f"There is no file {file}. Give the path of an FMU (a .fmu file).")
        str(file).encode()
        if file.stat().st_size > MOST_BYTES:
            raise InputError(f"{file.name} is refused: it has more than {MOST_BYTES / 1e6:.0f} MB.")
        sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
    except UnicodeEncodeError:
        raise InputError(f"The file name {str(file)!a} is no UTF-8: results could not name it. Rename it.") from None
    except OSError as problem:
        raise InputError(f"{file} cannot be read: {problem.strerror}.") from problem
    _check_contents(file)
    description = read_description(file)
    kind = _kind(file, description)
    variables(description)  # raises where one makes no sense
    folder = _extract(file, sha256)
    _ensure_library(file, folder, description, kind)
    return Archive(file, sha256, folder, description, kind)


def read_description(file: Path) -> ModelDescription:
    """The model description of an FMU; raises :class:`InputError` where it is missing or makes no sense.

    The schema is not enforced: many exporters' descriptions have harmless flaws. ``orchestrator.check`` lists them.
    """
    try:
        return fmpy.read_model_description(str(file), validate=False)
    except KeyError as problem:
        if "modelDescription.xml" in str(problem):
            raise InputError(f"{file.name} is not an FMU: the archive has no modelDescription.xml.") from None
        raise _unusable(file, problem) from problem
    except etree.XMLSyntaxError as problem:
        raise InputError(
            f"The modelDescription.xml of {file.name} is not well-formed XML ({problem}). Export the FMU again."
        ) from None
    except Exception as problem:  # FMPy raises what it likes for everything a description can get wrong
        raise _unusable(file, problem) from problem


def _unusable(file: Path, problem: Exception) -> InputError:
    return InputError(
        f"The modelDescription.xml of {file.name} cannot be used: {problem or type(problem).__name__}. "
        "Check it with: python -m fmpy validate."
    )


def _kind(file: Path, description: ModelDescription) -> str:
    co_simulation, model_exchange = description.coSimulation, description.modelExchange
    version = str(description.fmiVersion)
    if co_simulation is not None:
        kind, identifier = "CoSimulation", co_simulation.modelIdentifier
    elif model_exchange is not None and not version.startswith("1"):
        kind, identifier = "ModelExchange", model_exchange.modelIdentifier
    else:
        raise InputError(
            f"{file.name} is FMI {version} for neither co-simulation nor (from FMI 2.0 on) Model Exchange. "
            "Export it as FMI 2.0 or 3.0 co-simulation."
        )
    if not identifier or not re.fullmatch(r"\w+", identifier):
        raise InputError(f"{file.name}: the modelIdentifier {identifier!r} is no C identifier. Export the FMU again.")
    return kind


def _check_contents(file: Path) -> None:
    """Refuse archives that are none, are too large, or would write outside their folder."""
    try:
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        raise InputError(f"{file.name} is not an FMU: it is no zip archive. Export the controller again.") from None
    names = [member.filename for member in members]
    size = sum(member.file_size for member in members)
    packed = sum(member.compress_size for member in members)
    for member in members:
        parts = member.filename.split("/")
        if member.filename.startswith("/") or ".." in parts or "\\" in member.filename or ":" in member.filename:
            raise InputError(f"{file.name} is refused: its entry {member.filename!r} points outside the archive.")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise InputError(f"{file.name} is refused: its entry {member.filename!r} is a link.")
        if member.flag_bits & 1:
            raise InputError(f"{file.name} is refused: its entry {member.filename!r} is encrypted.")
        if member.filename in DESCRIPTIONS and member.file_size > LARGEST_DESCRIPTION:
            raise InputError(
                f"{file.name} is refused: its {member.filename} has {member.file_size / 1e6:.0f} MB, more than the "
                f"{LARGEST_DESCRIPTION / 1e6:.0f} MB that are read. Export it with fewer variables."
            )
    if names.count("modelDescription.xml") > 1:
        raise InputError(f"{file.name} is refused: it has more than one modelDescription.xml.")
    if len(members) > MOST_FILES or size > MOST_BYTES or (size > SMALL and size > MOST_RATIO * max(packed, 1)):
        raise InputError(
            f"{file.name} is refused: {len(members)} files of {size / 1e6:.0f} MB from {packed / 1e6:.1f} MB. "
            f"The limits are {MOST_FILES} files, {MOST_BYTES / 1e6:.0f} MB, and a ratio of {MOST_RATIO}."
        )


def _extract(file: Path, sha256: str) -> Path:
    """The folder with the archive's files. It appears under its final name complete or not at all."""
    folder = cache_folder() / "fmus" / sha256
    if _is_intact(folder, file):
        return folder
    scratch: Path | None = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix="incomplete-", dir=folder.parent))
        fmpy.extract(str(file), str(scratch / "fmu"))
        if folder.is_dir() and not _is_intact(folder, file):
            os.rename(folder, scratch / "spoiled")
        os.rename(scratch / "fmu", folder)
    except OSError as problem:
        if not folder.is_dir():  # else another process was first
            raise InputError(
                f"{file.name} cannot be extracted into the cache {folder.parent}: {problem.strerror or problem}."
            ) from problem
    except Exception as problem:  # FMPy and zipfile have bare ones for damaged archives
        raise InputError(f"{file.name} cannot be extracted: {problem}. Export the FMU again.") from problem
    finally:
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)
    return folder


def _is_intact(folder: Path, file: Path) -> bool:
    """Whether ``folder`` holds the archive's files as they are in ``file``. An FMU may have written over its own, or a
    power cut may have left them empty. Files that came later, such as compiled code, do not count."""
    if not folder.is_dir():
        return False
    with zipfile.ZipFile(file) as archive:
        for member in archive.infolist():
            path = folder / member.filename
            try:
                if not member.is_dir() and zlib.crc32(path.read_bytes()) != member.CRC:
                    return False
            except OSError:
                return False
    return True


def _ensure_library(file: Path, folder: Path, description: ModelDescription, kind: str) -> None:
    """Make sure that there is a shared library for this platform; compile it where there are only sources."""
    interface = description.coSimulation if kind == "CoSimulation" else description.modelExchange
    identifier = interface.modelIdentifier
    platform = fmpy.platform_tuple if str(description.fmiVersion).startswith("3") else fmpy.platform
    library = folder / "binaries" / platform / f"{identifier}{fmpy.sharedLibraryExtension}"
    if library.is_file():
        return
    others = sorted(path.name for path in (folder / "binaries").glob("*") if path.is_dir())
    if platform in others:
        raise InputError(
            f"{file.name} has binaries for {platform}, but not {library.name}: the modelIdentifier does not fit. "
            "Export the FMU again."
        )
    if (folder / "sources").is_dir():
        compile_sources(file.name, folder, identifier, description, library)
        return
    raise InputError(
        f"{file.name} has no binary for this platform, {platform}; it has {', '.join(others) or 'none'}, and no "
        f"sources. Export it for {platform}, or with source code included."
    )
