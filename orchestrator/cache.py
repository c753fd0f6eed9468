"""Where extracted FMUs and compiled code are kept between runs, and how things made from sources are named."""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import itertools
import json
import logging
import os
import platform
import re
import shutil
import sys
import tempfile
import zlib
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path

import platformdirs

from .errors import EnvironmentFault

VARIABLE = "FLEXIBLE_MANIPULATOR_CACHE"
"""Environment variable that moves the cache elsewhere."""

PRIVATE = "FLEXIBLE_MANIPULATOR_PRIVATE"
"""Environment variable that names a folder of which no sandbox shows more than it needs: that of a service, where other
people's FMUs and results lie. What an FMU reads, it can tell in its messages and numbers. Where it is set, nothing of a
stranger runs or is compiled without a sandbox."""

INCOMPLETE = "incomplete-"
"""What the name of a folder of the cache begins with in which an FMU is being extracted."""

PACKAGE = Path(__file__).resolve().parent
ROOT = PACKAGE.parent
"""The folder of the project's packages."""

PACKAGES = (PACKAGE.name, "controller_fmu", "plant_fmu", "build_fmus")
"""The project's top packages and module."""

OWN = (ROOT / "plant_fmu" / "flexible_manipulator", ROOT / "controller_fmu" / "pid")
"""Sources that become part of FMUs, and of which functions are compiled; no module of this package imports them all."""

BY_NAME = ("orchestrator.fmi.slaves.numba_plant", "orchestrator.fmi.slaves.numba_pid")
"""Modules that are loaded by their names, so that no import statement leads to them."""

COMPILED = ("orchestrator.loop.closed_loop", "orchestrator.benchmark.one_pass", *BY_NAME)
"""Modules that compile; with what they import, the sources of the compiled code."""

STARTED = tuple(f"orchestrator.execution.{name}" for name in ("controller_host", "fork_server", "sandboxed"))
"""Modules that begin a process: they are named in its command line, and in no import statement."""

COMPUTING = ("orchestrator.execution.worker", "orchestrator.pairing.work", *BY_NAME, *STARTED)
"""What runs in a worker, and in the processes around it; with what they import, the sources that numbers may change
with."""

LIBRARIES = ("numpy", "numba", "fmpy")
"""Libraries that numbers may change with; FMPy brings the solver of Model Exchange."""

CERTIFYING = ("orchestrator.study.verify", "orchestrator.study.engine", *COMPUTING)
"""Modules that, with what they import, a certificate goes through."""

NATIVE = (".c", ".h", ".exe", ".json", ".toml", ".xml")
"""Files beside Python modules that numbers may change with."""

IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(?P<dots>\.*)(?P<base>[\w.]*)[ \t]+import[ \t]+(?P<names>\([^)]*\)|[^\n]*)"
    r"|import[ \t]+(?P<modules>[^\n]*))",
    re.MULTILINE,
)
"""An import statement anywhere in a module, in functions as well. Parsing the modules would take ten times as long, at
the start of each command; a line of a docstring that looks like one adds at most a file too many."""

FOR_TYPES = re.compile(r"^if TYPE_CHECKING:.*\n(?:[ \t]+[^\n]*\n|\n)+", re.MULTILINE)
"""Imports that never happen while something is computed."""

SYSTEM = ("/bin", "/dev", "/etc", "/gnu", "/lib", "/lib32", "/lib64", "/libx32", "/nix", "/proc", "/sbin", "/usr")
"""The system's own folders, on Linux."""

logger = logging.getLogger(__name__)


def cache_folder() -> Path:
    """The user's cache folder for this program, created if missing.

    If it is not writable, a temporary folder takes its place for this process, as for one whose name is not in ASCII:
    FMUs made by pythonfmu crash where their resources are in such a folder. Raises
    :class:`~orchestrator.errors.EnvironmentFault` if there is no place for that either.
    """
    place = os.environ.get(VARIABLE) or platformdirs.user_cache_dir("flexible-manipulator", appauthor=False)
    folder = _writable(Path(place).absolute())  # children may have another current folder
    folder.mkdir(parents=True, exist_ok=True)  # somebody may have deleted it meanwhile
    return folder


def incomplete(sha256: str) -> str:
    """The same for the FMU with this hash: a process that is killed leaves its folder, which is to go with the FMU."""
    return f"{INCOMPLETE}{sha256[:16]}-"


@functools.cache
def _writable(place: Path) -> Path:
    reason = f"The cache folder {place} has letters outside of ASCII, with which FMUs in Python crash"
    if str(place).isascii():
        try:
            place.mkdir(parents=True, exist_ok=True)
            # By trying: permissions say nothing of a file system that is mounted read-only.
            tempfile.TemporaryFile(dir=place).close()
            return place
        except OSError as problem:
            reason = f"The cache folder {place} is not writable ({problem.strerror or problem})"
    remedy = f"Set {VARIABLE} to a writable folder with a name in ASCII."
    try:
        folder = tempfile.mkdtemp(prefix="flexible-manipulator-")
    except OSError:
        raise EnvironmentFault(f"{reason}, and there is no temporary folder either. {remedy}", "no-cache") from None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    logger.warning("%s: everything is compiled anew, in %s. %s", reason, folder, remedy)
    return Path(folder)


DEVICES = tuple(f"/dev/{name}" for name in ("null", "zero", "full", "random", "urandom"))
"""Those that say nothing of this machine, and end: a source that included /dev/ptmx had its compiler wait for ever."""


def user_folders() -> set[str]:
    """The folders at the top of the file system that may hold files of users: all but the system's."""
    return {entry.path for entry in os.scandir("/") if entry.is_dir(follow_symlinks=False)} - {*SYSTEM}


def compiled_code_folder() -> Path:
    """Folder of Numba's cache, named by the hash of the sources compiled, and of all by which Numba finds code there.

    Numba itself looks only at the file of the function it compiles, and would run stale machine code after a change in
    a helper from another module. Code of another Python, place or processor it does not take, and :func:`is_compiled`
    said that it was there: after an upgrade of Python, each worker in a sandbox, which can keep nothing, compiled on
    the time of its controller, and honest ones had timeouts.
    """
    return cache_folder() / "numba" / _compiled_code()[:16]


PROCESSOR = ("vendor_id", "cpu family", "model", "flags", "CPU ", "Features", "isa")
"""What the lines of /proc/cpuinfo begin with that say what a processor can do."""

COMPILED_MARK = ".compiled"


def drop_damaged_code(folder: Path) -> None:
    """Remove the files of a :func:`compiled_code_folder` that are not what was written, and what :func:`note_compiled`
    wrote.

    Numba takes for whole what a power cut or the disk leaves of them: each start of each command failed, for good, and
    in a sandbox the controller was told to have crashed. What is missing is compiled anew. Others may be at work there:
    Numba writes a file beside, and renames it.
    """
    noted = dict(item for mark in folder.glob(f"*{COMPILED_MARK}") for item in (_noted(mark) or {}).items())
    damaged = [file for file in _code(folder) if not _is_whole(file, noted.get(str(file.relative_to(folder))))]
    if damaged:
        logger.warning("%s files of compiled code are damaged: they are compiled anew", len(damaged))
    for file in (*damaged, *(folder.glob(f"*{COMPILED_MARK}") if damaged else ())):
        file.unlink(missing_ok=True)


def drop_code(folder: Path) -> None:
    """Remove all compiled code: with what there is, nothing can be started."""
    for file in (*_code(folder), *folder.glob(f"*{COMPILED_MARK}")):
        file.unlink(missing_ok=True)


def _code(folder: Path) -> list[Path]:
    return [*folder.rglob("*.nb[ci]")]


def _is_whole(file: Path, noted: list[int] | None) -> bool:
    """Whether a file begins and ends as one of pickles does, and is what was ``noted`` of it, if it was not written
    since; or is gone meanwhile."""
    try:
        content, written = file.read_bytes(), file.stat().st_mtime_ns
    except OSError:
        return True
    same = noted is None or noted[0] != written or noted[1] == zlib.crc32(content)
    return same and content[:1] == b"\x80" and content[-1:] == b"."


def note_compiled(folder: Path, module: str) -> None:
    """Write that all is compiled that workers of ``module`` need, with the time and a checksum of each file."""
    mark = folder / f"{module}{COMPILED_MARK}"
    with contextlib.suppress(OSError):
        noted = {str(file.relative_to(folder)): [file.stat().st_mtime_ns, _stored(file)] for file in _code(folder)}
        part = folder / f"{module}.{os.getpid()}.part"
        try:
            part.write_text(json.dumps(noted))
            part.replace(mark)
        finally:
            part.unlink(missing_ok=True)


def _stored(file: Path) -> int:
    """The checksum of a file, which is on the disk from now on."""
    with file.open("rb") as stream:
        os.fsync(stream.fileno())
        return zlib.crc32(stream.read())


def is_compiled(folder: Path, module: str) -> bool:
    """Whether that was written, and all files are there."""
    noted = _noted(folder / f"{module}{COMPILED_MARK}")
    return noted is not None and all((folder / name).exists() for name in noted)


def _noted(mark: Path) -> dict[str, list[int]] | None:
    try:
        return dict(json.loads(mark.read_bytes()))
    except (OSError, ValueError):  # there is none, or not a whole one
        return None


@functools.cache
def _compiled_code() -> str:
    sources = closure(*COMPILED)
    # Before they were hashed, Numba knew its sources by their times.
    times = [file.stat().st_mtime_ns for file in sources]
    place, settings = os.path.abspath(__file__), [*map(os.environ.get, ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"))]
    found_by = place, times, sys.version, metadata.version("numba"), settings, _processor()
    return hashlib.sha256(repr((source_hash([*sources, *OWN]), found_by)).encode()).hexdigest()


def _processor() -> list[str]:
    """What the machine code is for, of the first processor: the home folder or the virtual machine may move."""
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8", errors="replace") as lines:
        return [line for line in itertools.takewhile(str.strip, lines) if line.startswith(PROCESSOR)]
    return [platform.machine(), platform.processor()]


@functools.cache
def computing_code() -> tuple[str, ...]:
    """What numbers are computed by: the hash of the sources concerned, and the versions of libraries."""
    return source_hash([*closure(*COMPUTING), *OWN]), *map(metadata.version, LIBRARIES)


@functools.cache
def installed() -> tuple[str, ...]:
    """This Python, and the packages that it finds, with their versions."""
    # By the names of the folders, which say both: to read the metadata of some 200 packages takes 0.2 s.
    names = (place.name for entry in sys.path for place in Path(entry).glob("*.*-info"))
    return platform.python_version(), *sorted({*names})


@functools.cache
def code_hash() -> str:
    """SHA-256 of all sources that a certificate goes through, and of the versions of libraries."""
    return hashlib.sha256(repr((source_hash(closure(*CERTIFYING)), computing_code())).encode()).hexdigest()


def closure(*modules: str) -> list[Path]:
    """The files of ``modules`` and of all that they import of this project, directly or not, with the files of
    NATIVE kinds in the same packages.

    A list kept by hand had missed modules: results of changed code were then taken from the store as if nothing had
    changed.
    """
    waiting, reached = list(modules), dict[str, Path]()
    while waiting:
        name = waiting.pop()
        file = _file_of(name)
        if name not in reached and file is not None:
            reached[name] = file
            # A package's __init__ runs before its module, and may change what the module does.
            waiting += [*_imports(name, file), name.rpartition(".")[0]]
    packages = {file.parent for file in reached.values()} - {PACKAGE, ROOT}
    others = {file for package in packages for file in _natives(package)}
    return sorted({*reached.values(), *others})


@functools.cache
def _file_of(module: str) -> Path | None:
    """The file of a module of this project; None for another one, or for a name that is no module.

    ``orchestrator`` itself only lists the public names, so that every module would lead to all others.
    """
    if module == PACKAGE.name or module.partition(".")[0] not in PACKAGES:
        return None
    path = os.path.join(ROOT, *module.split("."))
    return next((Path(file) for file in (f"{path}.py", f"{path}/__init__.py") if os.path.isfile(file)), None)


@functools.cache
def _imports(module: str, file: Path) -> tuple[str, ...]:
    """What may be modules among the names that ``module`` imports."""
    package = module.split(".") if file.stem == "__init__" else module.split(".")[:-1]
    names: list[str] = []
    for line in IMPORT.finditer(FOR_TYPES.sub("", file.read_text(encoding="utf-8"))):
        if line["modules"] is not None:
            names += _names(line["modules"])
            continue
        above = package[: len(package) + 1 - len(line["dots"])] if line["dots"] else []
        base = ".".join([*above, *filter(None, [line["base"]])])
        if base.startswith(PACKAGES):
            names += [base, *(f"{base}.{name}" for name in _names(line["names"]))]
    return tuple(names)


def _names(text: str) -> Iterator[str]:
    """The names of ``a, b as c`` in one line or in brackets, without comments."""
    plain = re.sub(r"#[^\n]*", "", text).strip("() \t\n,")
    yield from (part.split()[0] for part in plain.split(",") if part.split())


def _natives(package: Path) -> Iterator[Path]:
    """The files of NATIVE kinds of a package, also in its folders that are no packages."""
    with os.scandir(package) as entries:
        for entry in entries:
            if entry.name.endswith(NATIVE):
                yield Path(entry.path)
            elif entry.is_dir() and entry.name != "__pycache__" and not os.path.isfile(f"{entry.path}/__init__.py"):
                yield from _natives(Path(entry.path))


@functools.cache
def plant_hash() -> str:
    """SHA-256 of the manipulator's sources."""
    return source_hash([ROOT / "plant_fmu"])


def source_hash(sources: Iterable[Path]) -> str:
    """SHA-256 of the names and contents of all files in ``sources`` (files or folders), compiled Python left out.

    What is made from sources is named by it, so that nothing stale is ever taken for new.
    """
    digest = hashlib.sha256()
    for source in sources:
        for file in sorted(path for path in source.rglob("*") if path.is_file()) if source.is_dir() else (source,):
            if "__pycache__" not in file.parts:
                # The name counts as well, ended by a zero byte: moving a byte
                # from one file to the next must change the hash.
                digest.update(f"{source.name}/{file.relative_to(source).as_posix()}\0".encode())
                digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()
