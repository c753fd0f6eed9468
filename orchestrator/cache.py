"""Where extracted FMUs and compiled code are kept between runs, and how things made from sources are named."""

from __future__ import annotations

import atexit
import functools
import hashlib
import logging
import os
import shutil
import tempfile
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

import platformdirs

from .errors import EnvironmentFault

VARIABLE = "FLEXIBLE_MANIPULATOR_CACHE"
"""Environment variable that moves the cache elsewhere."""

PACKAGE = Path(__file__).resolve().parent
OWN = (PACKAGE.parent / "plant_fmu" / "flexible_manipulator", PACKAGE.parent / "controller_fmu" / "pid")
COMPILED = (PACKAGE / "fmi", PACKAGE / "loop", PACKAGE / "benchmark" / "one_pass.py", PACKAGE / "jit.py", *OWN)
"""Sources of the compiled code."""

COMPUTING = ("fmi", "loop", "benchmark", "jit.py"), ("numpy", "numba", "fmpy")
"""Sources and libraries that numbers may change with; FMPy brings the solver of Model Exchange."""

SYSTEM = ("/bin", "/dev", "/etc", "/gnu", "/lib", "/lib32", "/lib64", "/libx32", "/nix", "/proc", "/sbin", "/usr")
"""The system's own folders, on Linux."""

logger = logging.getLogger(__name__)


def cache_folder() -> Path:
    """The user's cache folder for this program, created if missing.

    If it is not writable, a temporary folder takes its place for this process, as for one whose name is not in ASCII:
    FMUs made by pythonfmu crash where their resources are in such a folder. Raises
    :class:`~orchestrator.errors.EnvironmentFault` if there is no place for that either.
    """
    wanted = os.environ.get(VARIABLE) or platformdirs.user_cache_dir("flexible-manipulator", appauthor=False)
    folder = _writable(Path(wanted).absolute())  # children may have another current folder
    folder.mkdir(parents=True, exist_ok=True)  # somebody may have deleted it meanwhile
    return folder


@functools.cache
def _writable(wanted: Path) -> Path:
    reason = f"The cache folder {wanted} has letters outside of ASCII, with which FMUs in Python crash"
    if str(wanted).isascii():
        try:
            wanted.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=wanted).close()
            return wanted
        except OSError as problem:
            reason = f"The cache folder {wanted} is not writable ({problem.strerror or problem})"
    remedy = f"Set {VARIABLE} to a writable folder with a name in ASCII."
    try:
        folder = tempfile.mkdtemp(prefix="flexible-manipulator-")
    except OSError:
        raise EnvironmentFault(f"{reason}, and there is no temporary folder either. {remedy}", "no-cache") from None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    logger.warning("%s: everything is compiled anew, in %s. %s", reason, folder, remedy)
    return Path(folder)


def user_folders() -> set[str]:
    """The folders at the top of the file system that may hold files of users: all but the system's."""
    return {entry.path for entry in os.scandir("/") if entry.is_dir(follow_symlinks=False)} - {*SYSTEM}


def compiled_code_folder() -> Path:
    """Folder of Numba's cache, named by the hash of the sources compiled.

    Numba itself looks only at the file of the function it compiles, and would run stale machine code after a change in
    a helper from another module.
    """
    return cache_folder() / "numba" / source_hash(COMPILED)[:16]


@functools.cache
def computing_code() -> tuple[str, ...]:
    """What numbers are computed by: the hash of this package's sources concerned, and the versions of libraries."""
    sources, libraries = COMPUTING
    return source_hash(PACKAGE / name for name in sources), *map(metadata.version, libraries)


@functools.cache
def code_hash() -> str:
    """SHA-256 of all sources that a result goes through, and of the versions of libraries."""
    rooms = source_hash(PACKAGE / name for name in ("execution", "pairing", "study", "codec.py"))
    return hashlib.sha256(repr((rooms, computing_code())).encode()).hexdigest()


@functools.cache
def plant_hash() -> str:
    """SHA-256 of the manipulator's sources."""
    return source_hash([PACKAGE.parent / "plant_fmu"])


def source_hash(sources: Iterable[Path]) -> str:
    """SHA-256 of the names and contents of all files in ``sources`` (files or folders), compiled Python left out.

    What is made from sources is named by it, so that nothing stale is ever taken for new.
    """
    digest = hashlib.sha256()
    for source in sources:
        for file in sorted(path for path in source.rglob("*") if path.is_file()) if source.is_dir() else (source,):
            if "__pycache__" not in file.parts:
                digest.update(f"{source.name}/{file.relative_to(source).as_posix()}\0".encode())
                digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()
