"""The entries of an FMU's archive: which are refused, under what names they are stored, and writing them to a folder.

Some exporters on Windows write ``\\`` between folders, as old zip tools do. Here the names have ``/``, as the zip
format asks for.
"""

from __future__ import annotations

import errno
import hashlib
import io
import os
import stat
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from ..errors import InputError

MAX_FILES = 10_000
"""Largest number of files in an archive."""

MAX_FOLDERS = MAX_FILES
"""Largest number of folders that they lie in. Each takes a place of the file system, and none in the archive."""

MAX_DIRECTORY_BYTES = 4 * 1024**2
"""Largest size of the list of them in the archive, which takes some hundred times as much in memory."""

MAX_BYTES = 2 * 1024**3
"""Largest size of an archive and of its contents; the largest FMUs of simulation tools are some hundred megabytes."""

SMALL_ARCHIVE = 64 * 1024**2
"""Archives up to this size may be compressed as much as they like, and are kept in memory."""

MAX_RATIO = 200
"""Largest compression ratio of an archive larger than SMALL_ARCHIVE: beyond it is a zip bomb, not a model."""

UNPACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Methods of compression that are unpacked. Of bzip2 and LZMA zipfile unpacks all that it has read at once, whatever
the entry says it holds: 2 kB that said 1 kB took 6 GB of memory, in a process that has no limit."""

METHODS = {
    6: "Implode",
    9: "Deflate64",
    12: "bzip2",
    14: "LZMA",
    93: "Zstandard",
    95: "xz",
    96: "JPEG",
    97: "WavPack",
    98: "PPMd",
}
"""Names of others."""

ENCRYPTED, PATCHED, AES = 1 << 0 | 1 << 6, 1 << 5, 99
"""Flags of an entry; and the method that stands for an encryption."""

MAX_NAME_BYTES = 255
"""Largest length of the name of a file or folder [bytes], as common file systems have it."""

MAX_PATH_BYTES = 2000
"""The same of a name with its folders: systems take 4,096 with the cache's folder before it."""

MAX_DEPTH = 100
"""Largest number of parts of a path. Python's functions for folders call themselves for each, 1,000 times at most."""

DESCRIPTION, BUILD_DESCRIPTION = "modelDescription.xml", "sources/buildDescription.xml"

DESCRIPTIONS = (DESCRIPTION, BUILD_DESCRIPTION)
"""Files that are parsed in this process; XML takes some twenty times its size in memory."""

MAX_DESCRIPTION_BYTES = 32 * 1024**2
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
        with _Directory(file) as stream, zipfile.ZipFile(stream) as archive:
            members, names = archive.infolist(), list(files_of(archive))
    except _TooLarge:
        contents = f"its directory is larger than {MAX_DIRECTORY_BYTES / 1e6:.0f} MB"
        raise refused(f"{contents}. The limit of its files is {MAX_FILES}", "archive-limit", file) from None
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        message = f"{file.name} is not an FMU: it is not a zip archive. Export the controller again."
        raise InputError(message, "not-an-fmu", file.name) from None
    size = sum(member.file_size for member in members)
    packed = sum(member.compress_size for member in members)
    for member in members:
        if flaw := _flaw(member):
            raise refused(f"its entry {member.filename!r} {flaw}", "bad-entry", file, member.filename)
    # Extracted, one of the two would be lost or the writing would fail with the words of the system.
    folders = _folders(names)
    if twofold := min(folders.intersection(names), default=""):
        raise refused(f"its entry {twofold!r} is a file and a folder", "bad-entry", file, twofold)
    # Which of two counts depends on the reader, and what was checked must be what is simulated.
    if sum(name_of(member).lower() == DESCRIPTION.lower() for member in members) > 1:
        raise refused(f"it has more than one {DESCRIPTION}", "bad-description", file)
    if len(folders) > MAX_FOLDERS:
        raise refused(f"its files lie in more than {MAX_FOLDERS} folders", "archive-limit", file)
    # The sizes are what the archive says. An entry that says less than
    # it holds ends at that size as damaged: zipfile checks.
    if len(members) > MAX_FILES or size > MAX_BYTES or (size > SMALL_ARCHIVE and size > MAX_RATIO * max(packed, 1)):
        contents = f"{len(members)} files of {size / 1e6:.0f} MB from {packed / 1e6:.1f} MB"
        limits = f"{MAX_FILES} files, {MAX_BYTES / 1e6:.0f} MB, and a ratio of {MAX_RATIO}"
        raise refused(f"{contents}. The limits are {limits}", "archive-limit", file)


class _TooLarge(Exception):
    """The directory of an archive has more bytes than are read."""


class _Directory(io.FileIO):
    """A file of which no piece is read that is larger than a directory may be: zipfile reads that in one piece, and
    makes an object of each entry, whatever their number. 600,000 entries took 264 MB and 21 s."""

    def read(self, size: int | None = -1) -> bytes:
        """A piece of the file; the rest of it without a size, which is its end."""
        if size is not None and size > MAX_DIRECTORY_BYTES:
            raise _TooLarge
        return super().read(-1 if size is None else size)


def _flaw(member: zipfile.ZipInfo) -> str:
    """Why an archive with this entry is refused; empty if it is not."""
    name = name_of(member)
    parts = name.split("/")
    # "Zip slip": an entry "../../.bashrc" would be written outside of
    # the folder. A colon is a drive, or a stream, on Windows.
    if name.startswith("/") or ".." in parts or ":" in name:
        return "points outside the archive"
    # Another spelling of a path is another file to whoever reads the archive, and the same one on the disk.
    if any(part in ("", ".") for part in parts[: len(parts) - name.endswith("/")]):
        return "has an empty part or a dot as a part of its path: pack it with plain names"
    # A library there was taken for what this machine had compiled of the sources, which were others.
    if parts[0].lower() == COMPILED:
        return f"lies in a folder {COMPILED!r}, where this program puts what it compiles: pack it with another name"
    # The next entry could be written through the link, wherever it points.
    if stat.S_ISLNK(member.external_attr >> 16):
        return "is a link"
    if member.flag_bits & ENCRYPTED or member.compress_type == AES:
        return "is encrypted: pack it without a password"
    if member.compress_type not in UNPACKED or member.flag_bits & PATCHED:
        method = METHODS.get(member.compress_type, f"method {member.compress_type}")
        return f"is compressed by {method}, which is not unpacked here: pack it with Deflate, which all tools read"
    if any(len(os.fsencode(part)) > MAX_NAME_BYTES for part in parts):
        return f"has a name of more than {MAX_NAME_BYTES} bytes, which file systems do not store"
    if len(os.fsencode(name)) > MAX_PATH_BYTES:
        return f"has a path of more than {MAX_PATH_BYTES} bytes, which file systems do not store in the cache's folder"
    if len(parts) > MAX_DEPTH:
        return f"lies in more than {MAX_DEPTH - 1} folders"
    # lxml builds the whole tree in this process, which has no limit of memory.
    if name in DESCRIPTIONS and member.file_size > MAX_DESCRIPTION_BYTES:
        size, limit = f"{member.file_size / 1e6:.0f} MB", f"{MAX_DESCRIPTION_BYTES / 1e6:.0f} MB"
        return f"is {size}, more than the {limit} that are read: export it with fewer variables"
    return ""


def _folders(names: Iterable[str]) -> set[str]:
    """The folders of files with these ``names``; not all of them if there are more than MAX_FOLDERS."""
    folders: set[str] = set()
    for name in names:
        folder = name.rpartition("/")[0]
        # Those around a known one are known: the parents of 4 MB of names are two million texts.
        while folder and folder not in folders:
            folders.add(folder)
            folder = folder.rpartition("/")[0]
        if len(folders) > MAX_FOLDERS:
            break
    return folders


PIECE_BYTES = 1 << 20
"""Of a file or an entry that are in memory at once."""


class Damaged(Exception):
    """An entry of an archive cannot be unpacked."""


def pieces(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Iterator[bytes]:
    """The contents of an entry, piece by piece; raises :class:`Damaged`."""
    try:
        with archive.open(member) as source:
            while piece := source.read(PIECE_BYTES):
                yield piece
    except Exception as problem:  # zipfile and its decompressor have many kinds
        # The disk's is not the file's fault; but no disk has the place where some entries are said to begin.
        if isinstance(problem, OSError) and problem.errno != errno.EINVAL:
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
    # modelica/fmi-standard#814: FMUs want the location to exist that fmi2Instantiate passes, with or without resources.
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
    archived, added = {folder / name for name in files_of(archive)}, []
    for place, folders, names in os.walk(folder):
        # Pruned in place, which is how os.walk is told; they hold what this program, or Python, has compiled, or is
        # compiling: of an FMU that was opened twice at a time, the library of one was removed while it was written.
        own = ("__pycache__", COMPILED) if Path(place) == folder else ("__pycache__",)
        folders[:] = [name for name in folders if not name.startswith(own)]
        added += [file for name in names if (file := Path(place, name)) not in archived]
    return sorted(added)


def is_intact(folder: Path, archive: zipfile.ZipFile) -> bool:
    """Whether ``folder`` holds the archive's files as they are in it. An FMU may have written over its own, or a
    power cut may have left them empty. Files that came later, such as compiled code, do not count."""
    if not folder.is_dir():
        return False
    for name, member in files_of(archive).items():
        try:
            if not _holds(folder / name, pieces(archive, member)):
                return False
        except (OSError, Damaged):
            return False
    return True


def _holds(file: Path, contents: Iterable[bytes]) -> bool:
    """Whether ``file`` has these ``contents``."""
    with file.open("rb") as opened:
        return all(opened.read(len(piece)) == piece for piece in contents) and not opened.read(1)


def digest(contents: Iterable[bytes]) -> str:
    """SHA-256 of ``contents``, of which one piece at a time is in memory: 15 MB may hold an entry of 2 GB."""
    hashed = hashlib.sha256()
    for piece in contents:
        hashed.update(piece)
    return hashed.hexdigest()


def file_digest(file: Path) -> str:
    """SHA-256 of a file."""
    with file.open("rb") as opened:
        return digest(iter(lambda: opened.read(PIECE_BYTES), b""))
