"""Opening an FMU file: checking the archive, reading its description, extracting it once by content.

The file comes from a stranger. None of it is executed here (sources are compiled if there is no binary), and nothing
is written outside the cache folder.
"""

from __future__ import annotations

import functools
import hashlib
import io
import logging
import os
import re
import shutil
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import fmpy
from fmpy.model_description import CoSimulation, ModelDescription, ModelExchange

from ..cache import cache_folder, incomplete
from ..errors import EnvironmentFault, InputError
from .description import read_description
from .entries import (
    COMPILED,
    MAX_BYTES,
    SMALL_ARCHIVE,
    Damaged,
    added_files,
    check_entries,
    digest,
    extract,
    file_digest,
    files_of,
    is_intact,
    pieces,
    refused,
)
from .library import FLAGS, SOURCE, WINE, LibraryKind, choose, digest_file, has_sources
from .variables import variables

logger = logging.getLogger(__name__)

FILE_NAME = re.compile(r"\w[\w .+-]*")
"""What a modelIdentifier may be. It names the shared library; not all exporters keep to C identifiers."""

MAX_IDENTIFIER_BYTES = 200
"""Largest length of a modelIdentifier [bytes]."""

FLAGS_HASH = hashlib.sha256(repr(FLAGS).encode()).hexdigest()[:16]

LIBRARY_SUFFIXES = (".so", ".dll", ".dylib")


@dataclass(frozen=True)
class Archive:
    """An FMU on disk: its file, the SHA-256 of its bytes, the folder it is extracted to, its description.

    ``kind`` is "CoSimulation" or "ModelExchange": what the benchmark uses of it. ``library`` says which library.
    """

    file: Path
    sha256: str
    folder: Path
    description: ModelDescription
    kind: str
    content: bytes | None = field(default=None, repr=False)
    """The file's bytes, unless it is large: what is needed to extract it again when the cache has been deleted."""
    library: LibraryKind = "native"

    @functools.cached_property
    def digests(self) -> dict[str, str]:
        """SHA-256 by name of all files in it."""
        with self.opened() as archive:
            files = files_of(archive)
            return {name: digest(pieces(archive, member)) for name, member in files.items()}

    def opened(self) -> zipfile.ZipFile:
        """Its contents, to be closed."""
        return zipfile.ZipFile(io.BytesIO(self.content) if self.content is not None else self.file)

    def added(self) -> list[Path]:
        """Files that it has left in its own folder."""
        with self.opened() as archive:
            return [file.relative_to(self.folder) for file in added_files(self.folder, archive)]

    @property
    def name(self) -> str:
        """File name, for messages."""
        return self.file.name

    @property
    def major_version(self) -> str:
        """ "1", "2" or "3"."""
        return str(self.description.fmiVersion)[0]

    @property
    def interface(self) -> CoSimulation | ModelExchange:
        """What the description says of the kind that is used."""
        return self.description.coSimulation if self.kind == "CoSimulation" else self.description.modelExchange

    @property
    def once_per_process(self) -> bool:
        """Whether it declares that a process can instantiate it only once."""
        return str(self.interface.canBeInstantiatedOnlyOncePerProcess).lower() in ("true", "1")

    @functools.cached_property
    def platforms(self) -> tuple[str, ...]:
        """Names of the platforms that the file has libraries for. A folder without one does not count."""
        with self.opened() as archive:
            parts = [name.split("/") for name in files_of(archive) if name.lower().endswith(LIBRARY_SUFFIXES)]
        return tuple(sorted({path[1] for path in parts if path[0] == "binaries" and len(path) > 2}))

    @property
    def library_file(self) -> Path:
        """The shared library that is loaded, which may be missing."""
        if self.library == WINE:
            folder = self.folder / "binaries" / ("x86_64-windows" if self.major_version == "3" else "win64")
            dll = folder / f"{self.interface.modelIdentifier}.dll"
            # Windows takes small letters for capitals.
            return next((path for path in sorted(folder.glob("*")) if path.name.lower() == dll.name.lower()), dll)
        platform = fmpy.platform_tuple if self.major_version == "3" else fmpy.platform
        name = f"{self.interface.modelIdentifier}{fmpy.sharedLibraryExtension}"
        # Named by the flags as well: what an earlier version has compiled with others lies in the same cache.
        place = f"{COMPILED}/{FLAGS_HASH}" if self.library == SOURCE else "."
        return Path(self.folder, place, "binaries", platform, name)

    @property
    def has_library(self) -> bool:
        """Whether it is there, and what was compiled: one that a power cut or the disk had left empty was held against
        its controller, for good."""
        file = self.library_file
        try:
            return file.is_file() and (self.library != SOURCE or digest_file(file).read_text() == file_digest(file))
        except (OSError, ValueError):
            return False

    @property
    def is_python(self) -> bool:
        """Whether it brings modules of Python, which use this machine's Python and the packages that are installed."""
        return any((self.folder / "resources").rglob("*.py"))


def open_archive(file: Path, library: LibraryKind | None = None) -> Archive:
    """Check and extract the FMU ``file``; a second call with the same bytes finds the first one's folder.

    One folder per content also keeps compiled code that lies beside an FMU's sources. Its library is the given
    ``library``, or the first that there is (:mod:`.library`).

    Raises :class:`InputError` if the file cannot be used, with the reason and what to do about it.
    """
    try:
        if file.is_dir():
            raise InputError(f"{file} is a folder. Give the path of an FMU (a .fmu file) in it.", "no-file", file)
        if not file.is_file():
            raise InputError(f"There is no file {file}. Give the path of an FMU (a .fmu file).", "no-file", file)
        # A file name of other bytes arrives with surrogates, which JSON cannot hold: better now than after the cases.
        str(file).encode()
        if file.stat().st_size > MAX_BYTES:
            raise refused(f"it is larger than {MAX_BYTES / 1e6:.0f} MB", "archive-limit", file)
        # Only after the size is known: a device or a huge file would fill the memory.
        sha256 = file_digest(file)
    except UnicodeEncodeError:
        message = f"The file name {str(file)!a} is not UTF-8, so results could not name it. Rename it."
        raise InputError(message, "bad-file-name") from None
    except OSError as problem:
        raise InputError(f"{file} cannot be read: {problem.strerror}.", "no-file", file) from problem
    check_entries(file)
    description = read_description(file)
    kind = _kind(file.name, description)
    variables(description)  # raises if one cannot be understood
    content = file.read_bytes() if file.stat().st_size <= SMALL_ARCHIVE else None
    archive = Archive(file, sha256, _extract(file, sha256), description, kind, content)
    if library != archive.library and (library is not None or not archive.has_library):
        windows = replace(archive, library=WINE).library_file.is_file()
        tool = description.generationTool or "the tool of its exporter"
        needed = tool if str(archive.interface.needsExecutionTool).lower() in ("true", "1") else ""
        archive = replace(archive, library=choose(archive.name, archive.folder, windows, needed, library))
    if not archive.has_library:
        _compile_library(archive)
    return archive


@functools.lru_cache(maxsize=4)
def reopen(name: str, sha256: str, folder: str, library: LibraryKind = "native") -> Archive:
    """The FMU that :func:`open_archive` has extracted to ``folder``, in another process.

    What has been read is kept, for the processes that are forked from this one: to read 100,000 variables takes 2.4 s.
    """
    # The folder was checked when it was extracted; here the cost counts, as each worker comes through it.
    description = read_description(Path(folder))
    variables(description)
    return Archive(Path(name), sha256, Path(folder), description, _kind(name, description), library=library)


def check_files(name: str, folder: Path, digests: Mapping[str, str]) -> None:
    """Raise :class:`~orchestrator.errors.EnvironmentFault` if a file in ``folder`` is not what ``digests`` say."""
    for file, expected in digests.items():
        if file_digest(folder / file) != expected:
            raise EnvironmentFault(f"{name} was changed after it was opened: {file} is another file.", "cache-lost")


def restore(archive: Archive) -> bool:
    """Extract ``archive`` again if its files are not as they were; returns whether that was so.

    Somebody may have deleted the cache, or an FMU may have overwritten its own files. Raises
    :class:`~orchestrator.errors.EnvironmentFault` if its file is gone, too.
    """
    try:
        with archive.opened() as opened:
            if is_intact(archive.folder, opened) and archive.has_library:
                return False
        with tempfile.TemporaryDirectory(prefix="flexible-manipulator-") as scratch:
            file = archive.file
            if archive.content is not None:
                file = Path(scratch) / archive.name
                file.write_bytes(archive.content)
            open_archive(file, archive.library)
        return True
    except (OSError, InputError) as problem:
        raise EnvironmentFault(f"{archive.name} was removed from the cache, and: {problem}", "cache-lost") from problem


def _kind(name: str, description: ModelDescription) -> str:
    co_simulation, model_exchange = description.coSimulation, description.modelExchange
    version = str(description.fmiVersion)
    if co_simulation is not None:
        kind, identifier = "CoSimulation", co_simulation.modelIdentifier
    # FMI 1.0 has Model Exchange in a standard of its own, with other functions, which no slave here calls.
    elif model_exchange is not None and not version.startswith("1"):
        kind, identifier = "ModelExchange", model_exchange.modelIdentifier
    else:
        message = f"{name} is FMI {version} for neither co-simulation nor (from FMI 2.0 on) Model Exchange."
        raise InputError(f"{message} Export it as FMI 2.0 or 3.0 co-simulation.", "unsupported-fmi", name, version)
    # The identifier becomes a path: "../x" in the description of a stranger must not load a library from elsewhere.
    if not FILE_NAME.fullmatch(identifier or "") or len(identifier.encode()) > MAX_IDENTIFIER_BYTES:
        message = f"{name}: the modelIdentifier {identifier!r} cannot be the name of a file. Export the FMU again."
        raise InputError(message, "bad-description", name, identifier)
    return kind


def _extract(file: Path, sha256: str) -> Path:
    """The folder with the archive's files. It appears under its final name complete or not at all."""
    folder = cache_folder() / "fmus" / sha256
    with zipfile.ZipFile(file) as opened:
        if is_intact(folder, opened):
            for added in added_files(folder, opened):  # of an earlier run, which must not tell this one anything
                logger.warning("%s had left %s in its own folder: removed.", file.name, added.relative_to(folder))
                added.unlink(missing_ok=True)
            return folder
    scratch: Path | None = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        # On the same file system as its final place, since only there a rename happens at once or not at all.
        scratch = Path(tempfile.mkdtemp(prefix=incomplete(sha256), dir=folder.parent))
        with zipfile.ZipFile(file) as opened:
            extract(opened, scratch / "fmu")
            if folder.is_dir() and not is_intact(folder, opened):
                logger.warning("%s in the cache is not what the file holds: it is extracted anew.", file.name)
                # A folder that is not empty cannot be renamed over; and a
                # process that still uses the old files keeps them.
                os.rename(folder, scratch / "spoiled")
        os.rename(scratch / "fmu", folder)
    except OSError as problem:
        if not folder.is_dir():  # else another process was first
            message = f"{file.name} cannot be extracted into the cache {folder.parent}: {problem.strerror or problem}."
            raise EnvironmentFault(message, "no-cache") from problem
    except Damaged as problem:
        message = f"{file.name} cannot be extracted: {problem}. Export the FMU again."
        raise InputError(message, "cannot-extract", file.name) from problem
    finally:
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)
    return folder


def _compile_library(archive: Archive) -> None:
    """Compile the shared library for this platform from the FMU's sources."""
    name, library = archive.name, archive.library_file
    platform = library.parent.name
    if platform in archive.platforms and archive.library != SOURCE:
        message = f"{name} has binaries for {platform}, but not {library.name}: the modelIdentifier does not fit."
        raise InputError(f"{message} Export the FMU again.", "bad-description", name, library.stem)
    if not has_sources(archive.folder):
        message = f"{name} has no binary for this platform, {platform}; it has "
        message += f"{', '.join(archive.platforms) or 'none'}, and no "
        message += f"sources. Export it for {platform}, or with source code included."
        raise InputError(message, "no-binary", name, platform)
    from .compilation import compile_sources  # loads the builders, which only few FMUs need

    compile_sources(name, archive.folder, library.stem, archive.description, library)
