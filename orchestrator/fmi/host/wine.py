"""FMUs for Windows under Wine: a library in a process of its own, with the face of one that ctypes has loaded.

FMPy calls it as any other. Every process has an installation of Wine of its own ("prefix"), so that none can disturb
another, and nothing has to be locked, kept or mended. An installation is usually some hundred megabytes that
``wineboot`` makes in ten seconds, with services that stay. An FMU needs none of that: here it is two links and an empty
folder, Wine's libraries are found in Wine's own folders, and there is no process beside the FMU's but Wine's server,
which ends with it.
"""

from __future__ import annotations

import ctypes
import functools
import os
import platform
import shutil
import struct
import subprocess
import tempfile
import weakref
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from ...cache import cache_folder
from ...errors import Crash, FmuError, InputError

PROGRAMS = ("wine64", "wine")

INSTALL = "Install Wine (on Debian and Ubuntu: apt-get install wine64 wine)"

SETTINGS = {
    "WINEDEBUG": "-all",
    # No Mono and no Gecko, for which Wine would ask on a screen; and nothing that prepares a whole Windows.
    "WINEDLLOVERRIDES": "mscoree,mshtml=;wineboot.exe=d",
    "WINEBOOTSTRAPMODE": "1",  # libraries are found without their stand-ins in the installation
    "WINEARCH": "win64",
    "LC_ALL": "C.UTF-8",  # file names
}
"""Of the environment of programs under Wine."""

SHUTDOWN_TIMEOUT = 5.0
"""Seconds that Wine's server may take to end."""


@functools.cache
def _program(path: str) -> str | None:
    return next(filter(None, (shutil.which(name, path=path) for name in PROGRAMS)), None)


def program() -> str | None:
    """Wine's loader of programs of 64 bits, None if it is not installed."""
    # The path is part of the question, so that a test that changes it gets another answer in spite of the cache.
    return _program(os.environ.get("PATH", os.defpath)) if platform.machine() == "x86_64" else None


def version() -> str:
    """Such as ``"8.0"``; empty if it is not installed, or does not say."""
    loader = program()
    return _version(loader) if loader is not None else ""


@functools.cache
def _version(loader: str) -> str:
    with suppress(OSError, subprocess.TimeoutExpired):
        options = {"capture_output": True, "text": True, "stdin": subprocess.DEVNULL, "check": False, "timeout": 60}
        said = subprocess.run([loader, "--version"], env={**os.environ, **SETTINGS}, **options).stdout.split()  # type: ignore[call-overload]
        return said[0].removeprefix("wine-") if said else ""
    return ""


def needed(name: str) -> str:
    """The program for the FMU ``name``; raises :class:`InputError` where there is none."""
    loader = program()
    if loader is None:
        message = f"{name} has a library for Windows only, which runs under Wine, and Wine is not installed here. "
        message += f"{INSTALL}, or export the FMU for Linux."
        raise InputError(message, "no-wine", name)
    return loader


class Installation:
    """An installation in the cache, for programs that this process starts. Those of processes that are gone, of whose
    end nobody told, are removed."""

    def __init__(self) -> None:
        around = cache_folder() / "wine"
        around.mkdir(exist_ok=True)
        _remove_lost(around)
        self._folder = Path(tempfile.mkdtemp(prefix=f"{platform.node()}-{os.getpid()}-", dir=around))
        (self._folder / "drive_c" / "windows" / "system32").mkdir(parents=True)
        (self._folder / "dosdevices").mkdir()
        for drive, target in (("c:", "../drive_c"), ("z:", "/")):
            (self._folder / "dosdevices" / drive).symlink_to(target)

    def environment(self) -> dict[str, str]:
        """Of a program that runs in it."""
        # Without a screen, Wine shows no dialog that nobody would answer.
        kept = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
        # TMPDIR is where Debian's Wine has the socket of its server.
        return {**kept, **SETTINGS, "WINEPREFIX": str(self._folder), "TMPDIR": str(self._folder)}

    def remove(self) -> None:
        """End what runs in it, and remove it."""
        with suppress(OSError, subprocess.TimeoutExpired):
            none = subprocess.DEVNULL
            command = ["wineserver", "-k"]
            subprocess.run(
                command, env=self.environment(), stdin=none, stderr=none, check=False, timeout=SHUTDOWN_TIMEOUT
            )
        _remove(self._folder)


def _remove_lost(around: Path) -> None:
    for folder in around.glob(f"{platform.node()}-*"):
        with suppress(ProcessLookupError, ValueError, PermissionError):
            # Signal 0 only asks whether the process exists. The name of the
            # machine is in the folder's, as caches are shared over networks.
            os.kill(int(folder.name.split("-")[-2]), 0)
            continue
        _remove(folder)


def _remove(folder: Path) -> None:
    """Remove an installation, and the folder that its server had for its socket."""
    with suppress(OSError):
        place = folder.stat()
        server = f"/tmp/.wine-{os.getuid()}/server-{place.st_dev:x}-{place.st_ino:x}"
        shutil.rmtree(server, ignore_errors=True)
    shutil.rmtree(folder, ignore_errors=True)


PROGRAM = Path(__file__).with_name("host.exe")

EXCHANGE, LOAD, FIND, CALL, CONNECT = range(1, 6)
"""What the host does, see ``host.c``."""

REQUEST_HEAD, ANSWER_HEAD = struct.Struct("=5d"), struct.Struct("=Q")

Argument = tuple[bytes, int, bytes]
"""Kind, value or size, and contents of an argument, see ``host.c``."""

Ask = Callable[[str, list[Argument]], tuple[int, list[bytes]]]
"""Calls a function by its name: its result, and the contents of its buffers."""

MAX_ANSWER_BYTES = 64 * 1024**2
"""Bytes of an answer at most."""

EXIT_TIMEOUT = 1.0
"""Seconds for a host that gives no answer to end."""

NO_LIBRARY = "193"
"""Error of Windows for a file that is no library, or one of 32 bits."""

KILLED = -9
"""Exit code of a process that somebody has killed, such as a system that is out of memory."""


class Host:
    """The process. It ends with this object or this process; the installation of Wine is its own."""

    def __init__(self, name: str) -> None:
        """Start it for the FMU ``name``; raises :class:`~orchestrator.errors.InputError` where there is no Wine."""
        command = [needed(name), str(PROGRAM)]
        installation, pipe = Installation(), subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=installation.environment(), bufsize=0)
        self._crash: Crash | None = None
        assert self._process.stdin is not None and self._process.stdout is not None
        self.requests, self.answers = self._process.stdin.fileno(), self._process.stdout.fileno()
        self._finalizer = weakref.finalize(self, _end, self._process, installation)

    def ask(self, what: int, payload: bytes) -> bytes:
        """What it answers; raises :class:`~orchestrator.errors.Crash` if it does not."""
        try:
            view = memoryview(REQUEST_HEAD.pack(what, len(payload), 0.0, 0.0, 0.0) + payload)
            # os.write may write a part, as a signal may interrupt it; it says how much.
            while view:
                view = view[os.write(self.requests, view) :]
            (size,) = ANSWER_HEAD.unpack(self._read(ANSWER_HEAD.size))
            # A controller can write into the host's memory, and so into
            # what it answers: the size is not to be believed.
            if size <= MAX_ANSWER_BYTES:
                return self._read(size)
        except (OSError, EOFError):
            pass
        raise self.lost()

    def _read(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            piece = os.read(self.answers, size - len(data))
            if not piece:
                raise EOFError
            data += piece
        return data

    def lost(self) -> Crash:
        """What became of it, as it gives no answer."""
        if self._crash is None:
            self._crash = _end_of(self.exit_code())
        return self._crash

    def exit_code(self) -> int | None:
        """The exit code of one that gives no answer; None if it goes on."""
        try:
            # A closed pipe is seen before the process has ended; its exit code tells a crash from a kill.
            return self._process.wait(EXIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return None


def _end_of(code: int | None) -> Crash:
    if code is None:
        return Crash("the controller's process under Wine sent what is no answer")
    if code < 0:
        message = f"the controller's process under Wine was ended by signal {-code}"
        return Crash(message, "killed" if code == KILLED else "")
    return Crash(f"the controller's process under Wine ended by itself with exit code {code}")


def _end(process: subprocess.Popen[bytes], installation: Installation) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
    installation.remove()


class Library:
    """The library ``path`` of the FMU ``name``, loaded by a new host; ``keep`` is given what the FMU says.

    Raises :class:`~orchestrator.errors.FmuError` if it cannot be loaded.
    """

    def __init__(self, name: str, path: Path, keep: Callable[[bytes], None]) -> None:
        self.host = Host(name)
        self._name, self._keep = name, keep
        payload = f"{Path(name).stem}\0{windows_path(path)}".encode()
        refused = self.host.ask(LOAD, payload).decode(errors="replace")
        if refused:
            raise FmuError(_why_not_loaded(name, *refused.split(" ", 1)), "load")

    def __getattr__(self, name: str) -> Function:
        (address,) = ANSWER_HEAD.unpack(self.host.ask(FIND, name.encode()))
        if not address:
            raise AttributeError(f"function {name!r} not found")
        return Function(self, name, address)

    def call(self, name: str, address: int, arguments: list[Argument]) -> tuple[int, list[bytes]]:
        """The result of a function, and the contents of its buffers after the call; keeps what the FMU says."""
        words = [ANSWER_HEAD.pack(address), ANSWER_HEAD.pack(len(arguments))]
        for kind, value, content in arguments:
            words += [ANSWER_HEAD.pack(kind[0]), ANSWER_HEAD.pack(value), content]
        answer = self.host.ask(CALL, b"".join(words))
        called, result = struct.unpack_from("=QQ", answer)
        at, contents = 16, []
        for kind, value, _ in arguments:
            if kind == b"b":
                contents.append(answer[at : at + value])
                at += value
        for line in answer[at:].split(b"\0")[:-1]:
            self._keep(line)
        # The host passes at most 14 arguments; a function with more is not called, rather than called wrongly.
        if address and not called:
            raise FmuError(f"{self._name}: the host cannot call {name}", name)
        return result, contents


def windows_path(path: Path) -> str:
    """``path`` as programs of Windows name it."""
    return "Z:" + str(path).replace("/", "\\")


def _why_not_loaded(name: str, error: str, missing: str) -> str:
    if missing.lower().startswith("python3"):
        message = f"{name} needs Python for Windows ({missing}), which does not run here. Export it for Linux, such as"
        return f"{message} with pythonfmu on Linux."
    if missing:
        message = f"{name} needs the library {missing} of Windows, which is neither in the FMU nor in Wine. Put it into"
        return f"{message} the FMU beside its own, export it with static libraries, or for Linux."
    if error == NO_LIBRARY:
        return f"{name} has a file in the place of its library for Windows that is none of 64 bits. Export it again."
    return f"{name} cannot be loaded under Wine {version()} (error {error} of Windows). Export it for Linux."


class Function:
    """A function of the library. FMPy sets its types, as those of ctypes' functions."""

    argnames: Iterable[str] = ()
    argtypes: Iterable[Any] = ()
    restype: Any = None

    def __init__(self, library: Library, name: str, address: int) -> None:
        self._library, self._name, self.address = library, name, address

    def __call__(self, *arguments: Any) -> Any:
        encoded: list[Argument] = []
        outputs: list[Callable[[bytes], object]] = []
        for kind, value, following in zip(self.argtypes, arguments, [*arguments[1:], 0], strict=True):
            memory = _memory(value, following)
            if memory is not None:
                place, size = memory
                encoded.append((b"b", size, ctypes.string_at(place, size)))
                # Bound as a default: the loop's variable would be the last one's when the answer arrives.
                outputs.append(lambda data, place=place: ctypes.memmove(place, data, len(data)))  # type: ignore[misc]
            elif isinstance(value, bytes) and kind is not ctypes.c_char:
                content = _translated(value) + b"\0"
                encoded.append((b"b", len(content), content))
                outputs.append(lambda _: None)
            else:
                encoded.append((*_plain(kind, value), b""))
        result, contents = self._library.call(self._name, self.address, encoded)
        for write, data in zip(outputs, contents, strict=True):
            write(data)
        if self.restype is ctypes.c_int:
            # The host returns a register of 64 bits, whose upper half is
            # undefined for an int (Windows x64 calling convention).
            return ctypes.c_int(result & 0xFFFFFFFF).value
        return result or None


def _memory(value: Any, following: Any) -> tuple[int, int] | None:
    """Address and size [bytes] of what a pointer points to, None for what is none; of a bare pointer the argument that
    follows gives the number of elements."""
    target = getattr(value, "_obj", value)  # of byref()
    if isinstance(target, ctypes.Array) or (target is not value and not hasattr(target, "logger")):
        return ctypes.addressof(target), ctypes.sizeof(target)
    if isinstance(value, ctypes._Pointer):
        return ctypes.addressof(value.contents), ctypes.sizeof(value._type_) * int(following)
    return None


def _plain(kind: Any, value: Any) -> tuple[bytes, int]:
    """A number or a handle as its kind and its bits; callbacks are the host's own."""
    # FMPy's callbacks are of this process, and an address of it means nothing under Wine: the host puts in its own.
    if isinstance(value, ctypes.Structure) or hasattr(value, "_obj"):
        return b"l", 2
    if isinstance(value, ctypes._CFuncPtr):  # type: ignore[attr-defined]
        return (b"l", 3) if value else (b"i", 0)
    value = getattr(value, "value", value)
    if kind is ctypes.c_double:
        return b"d", int.from_bytes(struct.pack("=d", value), "little")
    if isinstance(value, bytes):
        return b"i", value[0]
    return b"i", int(value or 0) & 0xFFFFFFFFFFFFFFFF


def _translated(text: bytes) -> bytes:
    """A text as the FMU gets it: places of this machine's files are written as Windows does."""
    if text.startswith(b"file:///"):
        return b"file:///Z:" + text.removeprefix(b"file://")
    return windows_path(Path(text.decode())).encode() + b"\\" if text.startswith(b"/") and text.endswith(b"/") else text
