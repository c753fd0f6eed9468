"""What workers of tests do: functions of two loaded slaves and a task."""

import contextlib
import ctypes
import errno
import os
import signal
import socket
import sys
from pathlib import Path


def echo(plant, controller, task):
    """The task itself."""
    return task


def surroundings(plant, controller, task):
    """What a worker has of its surroundings: its folder, what is in it, how many sockets, the file of __main__."""
    main = getattr(sys.modules["__main__"], "__file__", None)
    return repr((os.getcwd(), os.listdir(), len(sockets()), main)).encode()


def hash_of(plant, controller, task):
    """The hash of a text, by which Python orders a set."""
    return repr(hash(task.decode())).encode()


def sockets():
    """Descriptors of sockets beyond standard output."""
    found = []
    for descriptor in map(int, os.listdir("/proc/self/fd")):
        with contextlib.suppress(OSError):
            if descriptor > 2 and os.readlink(f"/proc/self/fd/{descriptor}").startswith("socket"):
                found.append(descriptor)
    return found


def forge(plant, controller, task):
    """Write ``task`` into every socket, as an FMU may, and never return."""
    for descriptor in sockets():
        os.write(descriptor, task)
    signal.pause()


def lose_folder(plant, controller, task):
    """Remove the folder of this process, as somebody who cleans up."""
    os.rmdir(os.getcwd())
    return task


def environment_of(plant, controller, task):
    """The values of the variables named in ``task``, and whether "secret" is anywhere in the environment."""
    seen = "".join(Path(f"/proc/{who}/environ").read_text() for who in ("self", "1"))
    return repr(([os.environ.get(name) for name in task.decode().split()], "secret" in seen)).encode()


def connect(plant, controller, task):
    """The error number of connecting to the Unix socket at the path ``task``."""
    with socket.socket(socket.AF_UNIX) as caller:
        return str(caller.connect_ex(task.decode())).encode()


REMOUNT, BIND = 32, 4096


def remount(plant, controller, task):
    """How far an attempt comes to mount everything writable again, and to write what concerns the whole machine."""
    libc, here = ctypes.CDLL(None), os.path.dirname(__file__)
    found = [str(libc.mount(None, name.encode(), None, REMOUNT | BIND, None)) for name in ("/", "/proc", here)]
    for name in (f"{here}/new", "/proc/sys/kernel/core_pattern"):
        try:
            os.close(os.open(name, os.O_WRONLY | os.O_CREAT))
            found.append("open")
        except OSError:
            found.append("refused")
    return " ".join(found).encode()


def change_package(plant, controller, task):
    """What comes of attempts to change mounts, and to leave byte-code in the package and NumPy, and a module there."""
    import numpy

    import orchestrator

    libc, package, library = ctypes.CDLL(None), *(Path(each.__file__).parent for each in (orchestrator, numpy))
    found = [str(libc.mount(None, bytes(package), None, REMOUNT | BIND, None)), str(libc.umount(bytes(package)))]
    # Not in __pycache__, which need not be there.
    for name in (package / "x.pyc", library / "x.pyc", library.parent / "x.py"):
        try:
            name.write_bytes(b"")
            name.unlink()
            found.append("written")
        except OSError as problem:
            found.append(errno.errorcode[problem.errno])
    return " ".join(found).encode()


def package_file(plant, controller, task):
    """Where this package was found."""
    import orchestrator

    return str(orchestrator.__file__).encode()
