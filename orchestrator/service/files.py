"""The service's folder: FMUs by their content, a folder for each run and comparison by its id, and half an upload.

Nothing here opens an FMU. What a person calls a file becomes a path nowhere but as the last part of one in the run's
own folder, after :func:`plain_name`.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import os
import re
import secrets
import shlex
import shutil
import threading
import time
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from filelock import FileLock, Timeout

from ..cache import INCOMPLETE, VARIABLE, incomplete
from ..documents.files import prepare_folder
from ..errors import EnvironmentFault, InputError
from ..execution import store

BEGINNING = b"PK"
"""Of every zip file. It keeps a slip, such as a model that was not exported, from waiting for its turn."""

SHOWN = {
    "report.html": "text/html; charset=utf-8",
    "results.json": "application/json",
    "cases.csv": "text/csv; charset=utf-8",
    "trajectories.npz": "application/octet-stream",
}
"""Files of an evaluation that are given out, with their types."""

KINDS = ("fmus", "runs", "comparisons")
"""Folders of what is kept; a copy of these and of the database is a whole service."""

FULL = "no-room"
"""Code of an error of a disk that is full."""

LEFT_OUT = "LEFT_OUT.txt"
"""What an archive is without, if a file cannot be read."""

REMOVED = "removed"
"""Folder of the cache for what is being removed."""

QUICK, EVALUATION, DRAWN = "quick", "evaluation", "verification"
"""Folders of the two evaluations and of the certificate in that of a run."""

SCORECARD, FINDINGS, INTERFACE, BINDING, LOG = (
    "scorecard.html",
    "findings.html",
    "interface.json",
    "binding.toml",
    "log.txt",
)
"""What a job writes for the pages, the mapping file that it is given, and what it said."""

PART = "fmu.part"
"""An FMU in a run's folder as long as it is no whole copy."""

ID = re.compile(r"[0-9a-f]{24}")
"""An id, and the only form of one that becomes a path."""


SHA256 = re.compile(r"[0-9a-f]{64}")
"""The hash of an FMU, and the only form of one that becomes a path."""


def new_id() -> str:
    """An id that nobody guesses."""
    return secrets.token_hex(12)


def plain_name(name: str) -> str:
    """What an FMU is called in its run's folder: letters of ASCII, digits, dots and dashes, with the ending ``.fmu``.

    Reports and commands show this name, so that a command can be pasted where the file is.
    """
    stem = re.sub(r"\.fmu$", "", name.replace("\\", "/").rpartition("/")[2], flags=re.IGNORECASE)
    return (re.sub(r"[^A-Za-z0-9._-]+", "_", stem).strip("._-")[:60] or "controller") + ".fmu"


def is_empty(root: Path) -> bool:
    """Whether there is no FMU, run or comparison in a service's folder."""
    return not any((root / kind).is_dir() and any((root / kind).iterdir()) for kind in KINDS)


NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
"""What a full disk, and a full quota, are told by."""


def make_private(folder: Path) -> None:
    """Let nobody else read a folder: FMUs and results are other people's.

    Raises :class:`~orchestrator.errors.InputError` for a folder of somebody else, who could read it.
    """
    try:
        folder.chmod(0o700)
    except OSError as problem:
        raise _refused(f"The folder {folder} cannot be made private: {problem.strerror}.", folder, folder) from problem


def _refused(message: str, place: Path, whole: Path) -> InputError:
    """The error for a ``place`` in the ``whole`` folder that cannot be used. Where another user owns it, as after a
    command as root, it does not help to choose another folder."""
    with contextlib.suppress(OSError):
        if (owner := place.stat().st_uid) != os.geteuid():
            given = shlex.quote(str(whole if place.is_relative_to(whole) else place))
            back = f"if it is the service's, give it back: chown -R {_user(os.geteuid())} {given}"
            return InputError(f"{message} It belongs to {_user(owner)}; {back}", "foreign-folder", place)
    return InputError(message, "folder-not-writable", place)


def _user(number: int) -> str:
    import pwd  # not on Windows, where commands of the client run

    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)


@dataclass(frozen=True)
class Files:
    """The service's folder ``root``, which :meth:`prepare` makes."""

    root: Path

    @property
    def database(self) -> Path:
        """The file of all state."""
        return self.root / "service.sqlite"

    @property
    def cache(self) -> Path:
        """Where jobs extract FMUs and compile, so that what is deleted is deleted there, too: a folder of the service's
        own, unless the environment names one. It can be deleted while nothing runs."""
        return Path(os.environ.get(VARIABLE) or self.root / "cache")

    def prepare(self) -> None:
        """Make the folders, for nobody else to read.

        Raises :class:`~orchestrator.errors.InputError` if that fails.
        """
        for folder in (self.root, *(self.root / name for name in (*KINDS, "incoming")), self.cache):
            try:
                prepare_folder(folder)
            except InputError as problem:
                raise _refused(str(problem), folder, self.root) from problem
            if folder == self.root:
                make_private(folder)
        self.check_writable()

    def check_writable(self) -> None:
        """Raise :class:`~orchestrator.errors.InputError` for a database that is there and cannot be written."""
        for file in (self.database, *(self.root / f"{self.database.name}-{end}" for end in ("wal", "shm"))):
            if file.exists() and not os.access(file, os.R_OK | os.W_OK):
                raise _refused(f"{file} cannot be written.", file, self.root)

    def check_own(self) -> None:
        """Raise :class:`~orchestrator.errors.InputError` for a folder of somebody else's, for one that has lost its
        database, since a service removes what its rows do not name, and for a path that jobs cannot use."""
        # At the start, since the price shows at the end: with no cache there, every stage compiles anew, and no
        # certificate is standard.
        named = next((place for place in (self.root.resolve(), self.cache.resolve()) if not str(place).isascii()), None)
        if named is not None:
            message = f"{named} has letters outside of ASCII, with which FMUs made in Python crash."
            raise InputError(message, "not-ascii", self.root)
        own = (*KINDS, "incoming", "cache", self.database.name, "lost+found")
        try:
            if self.database.exists() and self.database.stat().st_size > 0:
                return
            names = (entry.name for entry in self.root.iterdir()) if self.root.is_dir() else ()
            there = {name for name in names if name[0] != "."}
            other = bool(there - {*own}) or not is_empty(self.root)
        except OSError as problem:
            message = f"The folder {self.root} cannot be read: {problem.strerror}."
            raise _refused(message, self.root, self.root) from problem
        if other:
            message = (
                f"{self.root} has files, but no {self.database.name} of a service. Choose an empty folder, or put a "
            )
            message += "whole copy of the service there."
            raise InputError(message, "no-service", self.root)

    def taken(self) -> FileLock:
        """The lock on the folder, taken; raises :class:`~orchestrator.errors.InputError` if another service has it."""
        lock = FileLock(self.root / ".lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            message = f"Another service works in {self.root}. One folder is for one service."
            raise InputError(message, "service-in-use", self.root) from None
        except OSError as problem:
            message = f"{self.root / '.lock'} cannot be written: {problem.strerror}. Remove it if no service runs."
            raise _refused(message, self.root / ".lock", self.root) from problem
        return lock

    def fmu(self, sha256: str) -> Path:
        """An FMU by the hash of its bytes."""
        assert SHA256.fullmatch(sha256)
        return self.root / "fmus" / f"{sha256}.fmu"

    def run(self, id: str) -> Path:
        """The folder of a run."""
        return self._by_id("runs", id)

    def comparison(self, id: str) -> Path:
        """The folder of a comparison."""
        return self._by_id("comparisons", id)

    def _by_id(self, kind: str, id: str) -> Path:
        assert ID.fullmatch(id), "ids are checked where they come in"
        return self.root / kind / id

    def incoming(self) -> Incoming:
        """Begin to take an upload."""
        return Incoming(self, self.root / "incoming" / new_id())

    def begin(self, id: str, sha256: str, file_name: str, binding: str) -> Path:
        """The folder of a run as a job finds it: with its FMU and its mapping file.

        Raises :class:`~orchestrator.errors.EnvironmentFault` if that fails, as on a disk that is full (FULL), or for an
        FMU that is gone (``"no-file"``).
        """
        folder, fmu = self.run(id), self.fmu(sha256)
        try:
            if not fmu.is_file():
                raise EnvironmentFault("The FMU is not there any more.", "no-file")
            folder.mkdir(parents=True, exist_ok=True)
            file, part = folder / file_name, folder / PART
            # Anew, unless it is the same: a damaged one is mended by another upload, which is another file.
            if not (file.exists() and fmu.samefile(file)):
                part.unlink(missing_ok=True)
                try:
                    os.link(fmu, part)
                    part.replace(file)
                except OSError:  # file systems without hard links
                    _copied(fmu, part, file)
            if binding:
                (folder / BINDING).write_text(binding, encoding="utf-8")
            else:
                (folder / BINDING).unlink(missing_ok=True)
        except OSError as problem:
            raise _unwritten(problem) from problem
        return folder

    def copy(self, folder: Path) -> None:
        """Copy FMUs, runs and comparisons to ``folder``; what is deleted meanwhile is left out.

        Raises :class:`~orchestrator.errors.EnvironmentFault` if that fails.
        """
        try:
            for file in (each for kind in KINDS for each in _files_below(self.root / kind)):
                target = folder / file.relative_to(self.root)
                with contextlib.suppress(FileNotFoundError):
                    if file.is_file() and not file.is_symlink() and file.name not in store.BESIDE:
                        target.parent.mkdir(parents=True, exist_ok=True)
                        (store.copy if file.name == store.FILE else shutil.copy2)(file, target)
        except OSError as problem:
            message = f"The copy in {folder} cannot be written: {problem.strerror}."
            raise EnvironmentFault(message, "not-written") from problem

    def forget_results(self, id: str) -> None:
        """Remove the results of a run, which another binding makes anew."""
        for folder in (QUICK, EVALUATION):
            shutil.rmtree(self.run(id) / folder, ignore_errors=True)

    def forget_outcome(self, id: str, name: str) -> None:
        """Remove an outcome that was left of a stage which begins; raises
        :class:`~orchestrator.errors.EnvironmentFault` if the disk does not let it."""
        try:
            (self.run(id) / name).unlink(missing_ok=True)
        except OSError as problem:
            raise _unwritten(problem) from problem

    def remove_run(self, id: str, at_once: bool = False) -> None:
        """Remove the folder of a run; ``at_once`` if what follows needs its room on the disk."""
        if at_once:
            shutil.rmtree(self.run(id), ignore_errors=True)
        else:
            _away(self.run(id), self.root / "incoming")

    def remove_comparison(self, id: str) -> None:
        """Remove the folder of a comparison."""
        _away(self.comparison(id), self.root / "incoming")

    def remove_fmu(self, sha256: str) -> None:
        """Remove an FMU, and what jobs have extracted of it."""
        with contextlib.suppress(OSError):  # as of folders: the next start tries it again
            self.fmu(sha256).unlink(missing_ok=True)
        self.forget_extracted(sha256)

    def forget_extracted(self, sha256: str) -> None:
        """Remove what jobs have extracted of an FMU; the next one does that again."""
        folder = self.cache / "fmus"
        for entry in (folder / sha256, *folder.glob(f"{incomplete(sha256)}*")):  # of a job that was killed meanwhile
            _away(entry, self.cache / REMOVED)

    def sweep(self, ids: set[str], fmus: set[str], counted: set[str]) -> None:
        """Remove what no run or comparison of ``ids``, and none of these ``fmus``, stands for: the end of a service
        may have come between a row and its folder. So may it before what was extracted was ``counted`` in a row."""
        for bin in (self.root / "incoming", self.cache / REMOVED):
            for entry in bin.iterdir() if bin.is_dir() else ():
                if entry.is_dir():
                    _away(entry, bin)
                else:
                    entry.unlink(missing_ok=True)
        for kind, remove in (("runs", self.remove_run), ("comparisons", self.remove_comparison)):
            for entry in (self.root / kind).iterdir():
                if entry.name not in ids and ID.fullmatch(entry.name):
                    remove(entry.name)
        for file in (self.root / "fmus").iterdir():
            if file.stem not in fmus and SHA256.fullmatch(file.stem):
                self.remove_fmu(file.stem)
        for sha256 in fmus - counted:
            self.forget_extracted(sha256)
        if self.cache == self.root / "cache":  # in another one, somebody else may be extracting
            for entry in (self.cache / "fmus").glob(f"{INCOMPLETE}*"):
                _away(entry, self.cache / REMOVED)


def is_file(path: Path) -> bool:
    """Whether there is a file that can be asked for. Of one in a folder that may not be read, as after a restore by
    another user, ``Path.is_file`` raises, and the page of its run answered 500."""
    return os.path.isfile(path)


def _unwritten(problem: OSError) -> EnvironmentFault:
    """Why a run's folder cannot be written."""
    code = FULL if problem.errno in NO_ROOM else "not-written"
    return EnvironmentFault(f"The run's folder cannot be written: {problem.strerror}.", code)


def _away(folder: Path, bin: Path) -> None:
    """Remove a folder from its place at once, and from the disk beside what else happens: an FMU of 0.4 MB with 15,000
    folders took 31 s, in which nobody had an answer. What an end of the service leaves in ``bin``, the start removes.
    """
    away = bin / new_id()
    try:
        bin.mkdir(exist_ok=True)
        folder.replace(away)
    except FileNotFoundError:
        return
    except OSError:  # a disk that is full for the name, too
        away = folder
    with contextlib.suppress(
        RuntimeError
    ):  # no thread can be started now: the next start of the service tries it again
        threading.Thread(target=shutil.rmtree, args=(away, True), daemon=True).start()


def _copied(source: Path, part: Path, target: Path) -> None:
    """Copy a file, first under the name ``part``: what a power cut leaves of it would else be taken for the whole."""
    with source.open("rb") as whole, part.open("wb") as copy:
        shutil.copyfileobj(whole, copy)
        copy.flush()
        os.fsync(copy.fileno())
    part.replace(target)


def _files_below(folder: Path) -> Iterator[Path]:
    """All files below a folder. What is deleted meanwhile is left out, where ``rglob`` of Python 3.11 ends with an
    error, and the copy with it."""

    def on_error(problem: OSError) -> None:
        if not isinstance(problem, FileNotFoundError):
            raise problem

    for place, _, names in os.walk(folder, onerror=on_error):
        yield from (Path(place, name) for name in names)


def packed(files: Mapping[str, Path]) -> bytes:
    """A zip archive of ``files`` by their names in it. What is deleted meanwhile is left out; what cannot be read, too,
    and named in LEFT_OUT: it kept the whole archive from everybody."""
    archive, unread = io.BytesIO(), list[str]()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as entries:
        for name, file in files.items():
            try:
                entries.writestr(_entry(name), file.read_bytes())
            except FileNotFoundError:
                continue
            except OSError as problem:
                unread.append(f"{name} cannot be read on the service's machine: {problem.strerror}.\n")
        if unread:
            entries.writestr(_entry(LEFT_OUT), "".join(unread))
    return archive.getvalue()


def _entry(name: str) -> zipfile.ZipInfo:
    """A file in an archive, of now. Of a time before 1980, as where the clock has no battery, a zip archive knows
    nothing, and there was none of the certificates."""
    entry = zipfile.ZipInfo(name, max(time.localtime()[:6], (1980, 1, 1, 0, 0, 0)))
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


class Incoming:
    """An upload, taken piece by piece; what is not :meth:`kept` is removed by :meth:`close`."""

    def __init__(self, files: Files, file: Path) -> None:
        self.size, self._files, self._file = 0, files, file
        self._digest, self._begin = hashlib.sha256(), b""
        try:
            file.parent.mkdir(exist_ok=True)  # somebody may have deleted what seems empty
            self._stream: IO[bytes] = file.open("wb")
        except OSError as problem:
            raise EnvironmentFault(f"An upload cannot be stored: {problem.strerror}.", "not-written") from problem

    def add(self, piece: bytes) -> None:
        """Store a piece; raises :class:`~orchestrator.errors.EnvironmentFault` if the disk is full."""
        try:
            self._stream.write(piece)
        except OSError as problem:
            raise EnvironmentFault(f"An upload cannot be stored: {problem.strerror}.", "not-written") from problem
        self._digest.update(piece)
        self._begin = (self._begin + piece[:2])[:2]
        self.size += len(piece)

    def settle(self) -> None:
        """Have the bytes on the disk, which may take a while; raises as :meth:`add`."""
        try:
            self._stream.flush()
            os.fsync(self._stream.fileno())
            self._stream.close()
        except OSError as problem:
            raise EnvironmentFault(f"An upload cannot be stored: {problem.strerror}.", "not-written") from problem

    def kept(self) -> str:
        """The SHA-256 of the whole, under which it is found from now on. Call :meth:`settle` before.

        Raises :class:`~orchestrator.errors.InputError` for what is no zip file,
        :class:`~orchestrator.errors.EnvironmentFault` if it cannot be renamed.
        """
        if self._begin != BEGINNING:
            raise InputError("This is no FMU: an FMU is a zip file.", "bad-archive")
        sha256 = self._digest.hexdigest()
        try:
            self._files.fmu(sha256).parent.mkdir(exist_ok=True)
            os.replace(self._file, self._files.fmu(sha256))
        except OSError as problem:
            raise EnvironmentFault(f"An upload cannot be stored: {problem.strerror}.", "not-written") from problem
        return sha256

    def close(self) -> None:
        """Remove what was not kept."""
        # Each for itself: on a full disk, closing fails, and what was sent would keep it full.
        with contextlib.suppress(OSError):
            self._stream.close()
        with contextlib.suppress(OSError):
            self._file.unlink(missing_ok=True)
