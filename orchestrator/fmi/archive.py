"""Opening an FMU file: checking the archive, reading its description, extracting it once by content.

The file comes from a stranger. None of it is executed here (sources are compiled if there is no binary), and nothing
is written outside the cache folder.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import stat
import tempfile
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import fmpy
from fmpy.model_description import ModelDescription
from lxml import etree

from ..cache import cache_folder
from ..errors import EnvironmentFault, InputError
from .compilation import compile_sources
from .variables import variables

MOST_FILES = 10_000
"""Largest number of files in an archive."""

MOST_BYTES = 2 * 1024**3
"""Largest size of an archive and of its contents; the largest FMUs of simulation tools are some hundred megabytes."""

SMALL = 64 * 1024**2
"""Archives up to this size may be compressed as much as they like, and are kept in memory."""

MOST_RATIO = 200
"""Largest compression ratio of an archive larger than SMALL: beyond it is a zip bomb, not a model."""

DESCRIPTIONS = ("modelDescription.xml", "sources/buildDescription.xml")
"""Files that are parsed in this process; XML takes some twenty times its size in memory."""

LARGEST_DESCRIPTION = 32 * 1024**2
"""Largest size of each of these."""


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
    content: bytes | None = field(default=None, repr=False)
    """The file's bytes, unless it is large: what is needed to extract it again when the cache has been deleted."""

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
    compiled. Raises :class:`InputError` if the file cannot be used, with the reason and what to do about it.
    """
    try:
        if file.is_dir():
            raise InputError(f"{file} is a folder. Give the path of an FMU (a .fmu file) in it.", "no-file", file)
        if not file.is_file():
            raise InputError(f"There is no file {file}. Give the path of an FMU (a .fmu file).", "no-file", file)
        str(file).encode()
        if file.stat().st_size > MOST_BYTES:
            raise InputError(
                f"{file.name} is refused: it is larger than {MOST_BYTES / 1e6:.0f} MB.", "archive-limit", file.name
            )
        sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
    except UnicodeEncodeError:
        raise InputError(
            f"The file name {str(file)!a} is not UTF-8, so results could not name it. Rename it.", "bad-file-name"
        ) from None
    except OSError as problem:
        raise InputError(f"{file} cannot be read: {problem.strerror}.", "no-file", file) from problem
    _check_contents(file)
    description = read_description(file)
    kind = _kind(file.name, description)
    variables(description)  # raises if one cannot be understood
    folder = _extract(file, sha256)
    _ensure_library(file.name, folder, description, kind)
    content = file.read_bytes() if file.stat().st_size <= SMALL else None
    return Archive(file, sha256, folder, description, kind, content)


def reopen(name: str, sha256: str, folder: str) -> Archive:
    """The FMU that :func:`open_archive` has extracted to ``folder``, in another process."""
    description = read_description(Path(folder))
    return Archive(Path(name), sha256, Path(folder), description, _kind(name, description))


def restore(archive: Archive) -> bool:
    """Extract ``archive`` again if its files are not as they were; returns whether that was so.

    Somebody may have deleted the cache, or an FMU may have overwritten its own files. Raises
    :class:`~orchestrator.errors.EnvironmentFault` if its file is gone, too.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(archive.content) if archive.content is not None else archive.file) as opened:
            if (
                _is_intact(archive.folder, opened)
                and _library(archive.folder, archive.description, archive.kind).is_file()
            ):
                return False
        with tempfile.TemporaryDirectory(prefix="flexible-manipulator-") as scratch:
            file = archive.file
            if archive.content is not None:
                file = Path(scratch) / archive.name
                file.write_bytes(archive.content)
            open_archive(file)
        return True
    except (OSError, InputError) as problem:
        raise EnvironmentFault(f"{archive.name} was removed from the cache, and: {problem}", "cache-lost") from problem


def read_description(file: Path) -> ModelDescription:
    """The model description of an FMU; raises :class:`InputError` if it is missing or cannot be understood.

    The schema is not enforced: many exporters' descriptions have harmless flaws. A check lists them.
    """
    try:
        return fmpy.read_model_description(str(file), validate=False)
    except KeyError as problem:
        if "modelDescription.xml" in str(problem):
            raise InputError(
                f"{file.name} is not an FMU: the archive has no modelDescription.xml.", "not-an-fmu", file.name
            ) from None
        raise _unusable(file, problem) from problem
    except etree.XMLSyntaxError as problem:
        raise InputError(
            f"The modelDescription.xml of {file.name} is not well-formed XML ({problem}). Export the FMU again.",
            "bad-description",
            file.name,
        ) from None
    except Exception as problem:  # FMPy raises what it likes for everything a description can get wrong
        raise _unusable(file, problem) from problem


def _unusable(file: Path, problem: Exception) -> InputError:
    return InputError(
        f"The modelDescription.xml of {file.name} cannot be used: {problem or type(problem).__name__}. "
        "Check it with: python -m fmpy validate.",
        "bad-description",
        file.name,
    )


def _kind(name: str, description: ModelDescription) -> str:
    co_simulation, model_exchange = description.coSimulation, description.modelExchange
    version = str(description.fmiVersion)
    if co_simulation is not None:
        kind, identifier = "CoSimulation", co_simulation.modelIdentifier
    elif model_exchange is not None and not version.startswith("1"):
        kind, identifier = "ModelExchange", model_exchange.modelIdentifier
    else:
        raise InputError(
            f"{name} is FMI {version} for neither co-simulation nor (from FMI 2.0 on) Model Exchange. "
            "Export it as FMI 2.0 or 3.0 co-simulation.",
            "unsupported-fmi",
            name,
            version,
        )
    if not identifier or not re.fullmatch(r"\w+", identifier):
        raise InputError(
            f"{name}: the modelIdentifier {identifier!r} is not a C identifier. Export the FMU again.",
            "bad-description",
            name,
            identifier,
        )
    return kind


def _check_contents(file: Path) -> None:
    """Refuse files that are not archives, are too large, or would write outside their folder."""
    try:
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        raise InputError(
            f"{file.name} is not an FMU: it is not a zip archive. Export the controller again.", "not-an-fmu", file.name
        ) from None
    size = sum(member.file_size for member in members)
    packed = sum(member.compress_size for member in members)
    for member in members:
        flaw = _flaw(member)
        if flaw:
            raise InputError(
                f"{file.name} is refused: its entry {member.filename!r} {flaw}.",
                "bad-entry",
                file.name,
                member.filename,
            )
    if sum(member.filename == "modelDescription.xml" for member in members) > 1:
        raise InputError(
            f"{file.name} is refused: it has more than one modelDescription.xml.", "bad-description", file.name
        )
    if len(members) > MOST_FILES or size > MOST_BYTES or (size > SMALL and size > MOST_RATIO * max(packed, 1)):
        raise InputError(
            f"{file.name} is refused: {len(members)} files of {size / 1e6:.0f} MB from {packed / 1e6:.1f} MB. "
            f"The limits are {MOST_FILES} files, {MOST_BYTES / 1e6:.0f} MB, and a ratio of {MOST_RATIO}.",
            "archive-limit",
            file.name,
        )


def _flaw(member: zipfile.ZipInfo) -> str:
    """Why an archive with this entry is refused; empty if it is not."""
    name = member.filename
    if name.startswith("/") or ".." in name.split("/") or "\\" in name or ":" in name:
        return "points outside the archive"
    if stat.S_ISLNK(member.external_attr >> 16):
        return "is a link"
    if member.flag_bits & 1:
        return "is encrypted"
    if name in DESCRIPTIONS and member.file_size > LARGEST_DESCRIPTION:
        limit = f"{LARGEST_DESCRIPTION / 1e6:.0f} MB"
        return (
            f"is {member.file_size / 1e6:.0f} MB, more than the {limit} that are read: export it with fewer variables"
        )
    return ""


def _extract(file: Path, sha256: str) -> Path:
    """The folder with the archive's files. It appears under its final name complete or not at all."""
    folder = cache_folder() / "fmus" / sha256
    with zipfile.ZipFile(file) as opened:
        if _is_intact(folder, opened):
            return folder
    scratch: Path | None = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix="incomplete-", dir=folder.parent))
        fmpy.extract(str(file), str(scratch / "fmu"))
        with zipfile.ZipFile(file) as opened:
            if folder.is_dir() and not _is_intact(folder, opened):
                os.rename(folder, scratch / "spoiled")
        os.rename(scratch / "fmu", folder)
    except OSError as problem:
        if not folder.is_dir():  # else another process was first
            raise EnvironmentFault(
                f"{file.name} cannot be extracted into the cache {folder.parent}: {problem.strerror or problem}.",
                "no-cache",
            ) from problem
    except Exception as problem:  # FMPy and zipfile have bare ones for damaged archives
        raise InputError(
            f"{file.name} cannot be extracted: {problem}. Export the FMU again.", "cannot-extract", file.name
        ) from problem
    finally:
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)
    return folder


def _is_intact(folder: Path, archive: zipfile.ZipFile) -> bool:
    """Whether ``folder`` holds the archive's files as they are in it. An FMU may have written over its own, or a
    power cut may have left them empty. Files that came later, such as compiled code, do not count."""
    if not folder.is_dir():
        return False
    for member in archive.infolist():
        path = folder / member.filename
        try:
            if not member.is_dir() and zlib.crc32(path.read_bytes()) != member.CRC:
                return False
        except OSError:
            return False
    return True


def _ensure_library(name: str, folder: Path, description: ModelDescription, kind: str) -> None:
    """Make sure that there is a shared library for this platform; compile it if there are only sources."""
    library = _library(folder, description, kind)
    identifier, platform = library.stem, library.parent.name
    if library.is_file():
        return
    others = sorted(path.name for path in (folder / "binaries").glob("*") if path.is_dir())
    if platform in others:
        raise InputError(
            f"{name} has binaries for {platform}, but not {library.name}: the modelIdentifier does not fit. "
            "Export the FMU again.",
            "bad-description",
            name,
            identifier,
        )
    if (folder / "sources").is_dir():
        compile_sources(name, folder, identifier, description, library)
        return
    raise InputError(
        f"{name} has no binary for this platform, {platform}; it has {', '.join(others) or 'none'}, and no "
        f"sources. Export it for {platform}, or with source code included.",
        "no-binary",
        name,
        platform,
    )


def _library(folder: Path, description: ModelDescription, kind: str) -> Path:
    interface = description.coSimulation if kind == "CoSimulation" else description.modelExchange
    platform = fmpy.platform_tuple if str(description.fmiVersion).startswith("3") else fmpy.platform
    return Path(folder, "binaries", platform, f"{interface.modelIdentifier}{fmpy.sharedLibraryExtension}")
