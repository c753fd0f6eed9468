"""FMU archives whose bytes depend on nothing but their contents."""

from __future__ import annotations

import hashlib
import io
import os
import uuid
import zipfile
from collections.abc import Mapping
from pathlib import Path

from controller_fmu.errors import BuildError, TargetError

LIBRARY_SUFFIXES = (".so", ".dylib", ".dll")
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest date a zip archive can hold


def target_of(out: object) -> Path:
    """The file to write; raises :class:`TargetError` for what is no path."""
    if not isinstance(out, str | os.PathLike):
        raise TargetError(f"the FMU to write is a path, not {out!r}", value=str(out))
    return Path(out)


def check_target(target: Path) -> None:
    """Raise :class:`TargetError` unless a file ``target`` could be written; no folder is ever created for it."""
    if not target.parent.is_dir():
        raise TargetError("the folder to write to does not exist", str(target), value=str(target.parent))
    if target.is_dir():
        raise TargetError("a folder has the name of the FMU to write", str(target), value=str(target))


def content_guid(contents: Mapping[str, bytes]) -> str:
    """Return a GUID that is a function of the names and bytes in ``contents``, ``{...}`` with the braces."""
    digest = hashlib.sha256()
    for name in sorted(contents):
        # Lengths keep neighbouring names and contents apart: "ab" + "c" is not "a" + "bc".
        digest.update(f"{len(name)}:{name}:{len(contents[name])}:".encode())
        digest.update(contents[name])
    return f"{{{uuid.uuid5(uuid.NAMESPACE_OID, digest.hexdigest())}}}"


def pack(contents: Mapping[str, bytes]) -> bytes:
    """Return a zip archive of ``contents`` (archive path to bytes): sorted, undated, fixed permissions."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(contents):
            entry = zipfile.ZipInfo(name, date_time=_EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, whatever builds: the permissions below are Unix ones
            entry.external_attr = (0o100755 if name.endswith(LIBRARY_SUFFIXES) else 0o100644) << 16
            archive.writestr(entry, contents[name])
    return buffer.getvalue()


def unpack(archive: Path) -> dict[str, bytes]:
    """Return all files of ``archive`` but compiled Python; raises :class:`BuildError` if it is not a zip archive."""
    try:
        with zipfile.ZipFile(archive) as opened:
            names = [name for name in opened.namelist() if not name.endswith("/")]
            return {name: opened.read(name) for name in names if "__pycache__" not in name}
    except zipfile.BadZipFile as problem:
        raise BuildError(f"not a zip archive: {problem}", str(archive)) from None


def write_atomically(data: bytes, target: Path) -> Path:
    """Write ``data`` to ``target``, of which others see the old state or the whole new one; return it.

    Raises :class:`TargetError` if that cannot be done.
    """
    draft = target.with_name(f".{target.name}.{uuid.uuid4().hex}")
    try:
        try:
            draft.write_bytes(data)
            os.replace(draft, target)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as problem:
        raise TargetError(f"cannot be written: {problem.strerror or problem}", str(target), value=str(target)) from None
    return target
