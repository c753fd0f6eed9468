"""The entries of an FMU's archive: which are refused, under what names they are stored, and writing them to a folder.

Some exporters on Windows write ``\\`` between folders, as old zip tools do. Here the names have ``/``, as the zip
format asks for.
"""

from __future__ import annotations

import os
import stat
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath

from ..errors import InputError

MOST_FILES = 10_000
"""Largest number of files in an archive."""

MOST_BYTES = 2 * 1024**3
"""Largest size of an archive and of its contents; the largest FMUs of simulation tools are some hundred megabytes."""

SMALL = 64 * 1024**2
"""Archives up to this size may be compressed as much as they like, and are kept in memory."""

MOST_RATIO = 200
"""Largest compression ratio of an archive larger than SMALL: beyond it is a zip bomb, not a model."""

UNPACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
"""Methods of compression that Python unpacks."""

METHODS = {6: "Implode", 9: "Deflate64", 93: "Zstandard", 95: "xz", 96: "JPEG", 97: "WavPack", 98: "PPMd"}
"""Names of others."""

ENCRYPTED, PATCHED, AES = 1 << 0 | 1 << 6, 1 << 5, 99
"""Flags of an entry; and the method that stands for an encryption."""

LONGEST_NAME = 255
"""Largest length of the name of a file or folder [bytes], as common file systems have it."""

DESCRIPTION, BUILD_DESCRIPTION = "modelDescription.xml", "sources/buildDescription.xml"

DESCRIPTIONS = (DESCRIPTION, BUILD_DESCRIPTION)
"""Files that are parsed in this process; XML takes some twenty times its size in memory."""

LARGEST_DESCRIPTION = 32 * 1024**2
"""Largest size of each of these."""


def name_of(member: zipfile.ZipInfo) -> str:
    """The name of an entry with ``/`` between folders; that of a folder ends with it."""
    return member.filename.replace("\\", "/")


def files_of(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """The files of an archive by name. Of two with the same name, the last one counts."""
    named = {name_of(member): member for member in archive.infolist()}
    return {name: member for name, member in named.items() if not name.endswith("/")}


def refused(reason: str, what: str, file: Path, value: str = "") -> InputError:
    """The error that says why an archive is not opened."""
    return InputError(f"{file.name} is refused: {reason}.", what, file.name, value)


def check_entries(file: Path) -> None:
    """Raise :class:`InputError` for files that are not archives, are too large, or would write outside their folder."""
    try:
        with zipfile.ZipFile(file) as archive:
            members, names = archive.infolist(), list(files_of(archive))
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        message = f"{file.name} is not an FMU: it is not a zip archive. Export the controller again."
        raise InputError(message, "not-an-fmu", file.name) from None
    size = sum(member.file_size for member in members)
    packed = sum(member.compress_size for member in members)
    for member in members:
        if flaw := _flaw(member):
            raise refused(f"its entry {member.filename!r} {flaw}", "bad-entry", file, member.filename)
    if twofold := _file_and_folder(names):
        raise refused(f"its entry {twofold!r} is a file and a folder", "bad-entry", file, twofold)
    if sum(name_of(member) == DESCRIPTION for member in members) > 1:
        raise refused(f"it has more than one {DESCRIPTION}", "bad-description", file)
    if len(members) > MOST_FILES or size > MOST_BYTES or (size > SMALL and size > MOST_RATIO * max(packed, 1)):
        found = f"{len(members)} files of {size / 1e6:.0f} MB from {packed / 1e6:.1f} MB"
        limits = f"{MOST_FILES} files, {MOST_BYTES / 1e6:.0f} MB, and a ratio of {MOST_RATIO}"
        raise refused(f"{found}. The limits are {limits}", "archive-limit", file)


def _flaw(member: zipfile.ZipInfo) -> str:
    """Why an archive with this entry is refused; empty if it is not."""
    name = name_of(member)
    parts = name.split("/")
    if name.startswith("/") or ".." in parts or ":" in name:
        return "points outside the archive"
    if stat.S_ISLNK(member.external_attr >> 16):
        return "is a link"
    if member.flag_bits & ENCRYPTED or member.compress_type == AES:
        return "is encrypted: pack it without a password"
    if member.compress_type not in UNPACKED or member.flag_bits & PATCHED:
        method = METHODS.get(member.compress_type, f"method {member.compress_type}")
        return f"is compressed by {method}, which is not unpacked here: pack it with Deflate, which all tools read"
    if any(len(os.fsencode(part)) > LONGEST_NAME for part in parts):
        return f"has a name of more than {LONGEST_NAME} bytes, which file systems do not store"
    if name in DESCRIPTIONS and member.file_size > LARGEST_DESCRIPTION:
        size, limit = f"{member.file_size / 1e6:.0f} MB", f"{LARGEST_DESCRIPTION / 1e6:.0f} MB"
        return f"is {size}, more than the {limit} that are read: export it with fewer variables"
    return ""


def _file_and_folder(names: Iterable[str]) -> str:
    """The first file with others below it; empty if there is none."""
    paths = {PurePosixPath(name) for name in names}
    return next((str(parent) for path in sorted(paths) for parent in path.parents if parent in paths), "")


class Damaged(Exception):
    """An entry of an archive cannot be unpacked."""


def pieces(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Iterator[bytes]:
    """The contents of an entry, piece by piece; raises :class:`Damaged`."""
    try:
        with archive.open(member) as source:
            while piece := source.read(1 << 20):
                yield piece
    except Exception as problem:  # zipfile and its decompressors have many kinds, bz2's is an OSError
        if isinstance(problem, OSError) and problem.errno is not None:
            raise
        message = f"its entry {member.filename!r} is damaged ({problem or type(problem).__name__})"
        raise Damaged(message) from problem


def unpacked(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """The contents of an entry; raises :class:`Damaged`."""
    return b"".join(pieces(archive, member))


def extract(archive: zipfile.ZipFile, folder: Path) -> None:
    """Write the files of a checked archive below ``folder``; raises :class:`Damaged`, and what the system raises.

    There is a folder of resources even if the archive has none: an FMU is told its location, and may look for it.
    """
    folder.mkdir()
    (folder / "resources").mkdir()
    for name, member in files_of(archive).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as target:
            for piece in pieces(archive, member):
                target.write(piece)


COMPILED = "compiled"
"""Folder beside the files of an FMU for what is compiled of its sources."""


def added_files(folder: Path, archive: zipfile.ZipFile) -> list[Path]:
    """Files in ``folder`` that are not of the archive, nor compiled of what is."""
    known, added = {folder / name for name in files_of(archive)}, []
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name not in (COMPILED, "__pycache__")]
        added += [file for name in names if (file := Path(place, name)) not in known]
    return sorted(added)


def is_intact(folder: Path, archive: zipfile.ZipFile) -> bool:
    """Whether ``folder`` holds the archive's files as they are in it. An FMU may have written over its own, or a
    power cut may have left them empty. Files that came later, such as compiled code, do not count."""
    if not folder.is_dir():
        return False
    for name, member in files_of(archive).items():
        try:
            if (folder / name).read_bytes() != unpacked(archive, member):
                return False
        except (OSError, Damaged):
            return False
    return True
