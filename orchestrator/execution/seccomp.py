"""System calls that are refused to an isolated controller: those by which one case could pass information to another.

Inside the sandbox the devices of /dev are those of the machine. Where root verifies, root owns them inside, too, and a
controller could change their modes or times, which the process of a later case would find. Files that both see can be
locked and watched; which of their pages lie in memory can be chosen and asked for. The keyring of a login session and
sockets of virtual machines (AF_VSOCK) belong to no namespace. The kernel's filter (seccomp(2)) refuses all that with
EPERM, for good and for all that the process starts.
"""

from __future__ import annotations

import ctypes
import platform
import struct
import sys
from collections.abc import Sequence
from typing import NamedTuple

X86_64 = {
    "chmod": 90,
    "fchmod": 91,
    "chown": 92,
    "fchown": 93,
    "lchown": 94,
    "utime": 132,
    "setxattr": 188,
    "lsetxattr": 189,
    "fsetxattr": 190,
    "removexattr": 197,
    "lremovexattr": 198,
    "fremovexattr": 199,
    "utimes": 235,
    "fchownat": 260,
    "futimesat": 261,
    "fchmodat": 268,
    "utimensat": 280,
    "mincore": 27,
    "flock": 73,
    "readahead": 187,
    "fadvise64": 221,
    "add_key": 248,
    "request_key": 249,
    "keyctl": 250,
    "inotify_init": 253,
    "inotify_init1": 294,
    "perf_event_open": 298,
    "fanotify_init": 300,
    "bpf": 321,
}
AARCH64 = {
    "setxattr": 5,
    "lsetxattr": 6,
    "fsetxattr": 7,
    "removexattr": 14,
    "lremovexattr": 15,
    "fremovexattr": 16,
    "fchmod": 52,
    "fchmodat": 53,
    "fchownat": 54,
    "fchown": 55,
    "utimensat": 88,
    "inotify_init1": 26,
    "flock": 32,
    "readahead": 213,
    "add_key": 217,
    "request_key": 218,
    "keyctl": 219,
    "fadvise64": 223,
    "mincore": 232,
    "perf_event_open": 241,
    "fanotify_init": 262,
    "bpf": 280,
}
EVERYWHERE = {
    "io_uring_setup": 425,
    "process_madvise": 440,
    "cachestat": 451,
    "fchmodat2": 452,
    "setxattrat": 463,
    "removexattrat": 466,
}
"""New calls have one number on all machines. With io_uring the others could be had without a call."""


class Argument(NamedTuple):
    """An argument of a call, by the number of the call and its own, and values of it: these alone are refused, or, if
    ``only``, these alone allowed."""

    number: int
    place: int
    values: tuple[int, ...]
    only: bool = False


LOCKS = (6, 7, 37, 38, 1024, 1026)
"""F_SETLK, F_SETLKW, F_OFD_SETLK, F_OFD_SETLKW, F_SETLEASE, F_NOTIFY of fcntl(2)."""

FAMILIES = (1, 2, 10, 16)
"""AF_UNIX, AF_INET, AF_INET6, AF_NETLINK: the sandbox has a network of its own for these."""

PAGE_OUT = (20, 21)
"""MADV_COLD, MADV_PAGEOUT of madvise(2)."""

NO_FLAGS = (0,)
"""Of preadv2(2): one of its flags asks whether a page lies in memory."""

X86_64_ARGUMENTS = (
    Argument(28, 2, PAGE_OUT),
    Argument(41, 0, FAMILIES, only=True),
    Argument(72, 1, LOCKS),
    Argument(327, 5, NO_FLAGS, only=True),
)
AARCH64_ARGUMENTS = (
    Argument(25, 1, LOCKS),
    Argument(198, 0, FAMILIES, only=True),
    Argument(233, 2, PAGE_OUT),
    Argument(286, 5, NO_FLAGS, only=True),
)
"""Of madvise, socket, fcntl and preadv2."""

MACHINES = {
    "x86_64": (0xC000003E, X86_64, X86_64_ARGUMENTS),
    "aarch64": (0xC00000B7, AARCH64, AARCH64_ARGUMENTS),
}
"""AUDIT_ARCH of linux/audit.h, the numbers of the calls, and arguments of others."""

LOAD, EQUAL, AT_LEAST, RETURN = 0x20, 0x15, 0x35, 0x06
"""BPF_LD | BPF_W | BPF_ABS, BPF_JMP | BPF_JEQ, BPF_JMP | BPF_JGE, BPF_RET, with a constant."""

ALLOW, REFUSE, PRETEND = 0x7FFF0000, 0x00050000 | 1, 0x00050000
"""SECCOMP_RET_ALLOW; SECCOMP_RET_ERRNO with EPERM; the same with 0: the call does nothing, and says it was done."""

NUMBER, ARCHITECTURE, ARGUMENTS, OTHER_TABLE = 0, 4, 16, 0x40000000
"""Offsets in struct seccomp_data; the first number of the x32 interface, whose calls are the same by other numbers."""

NO_NEW_PRIVILEGES, SET_SECCOMP, FILTER = 38, 22, 2
"""PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, SECCOMP_MODE_FILTER."""


def refuse_marks(no_locks: bool = False) -> bool:
    """Refuse these calls to this process from now on; False where that cannot be done.

    With ``no_locks``, those that lock a file by fcntl say that it is locked, and do nothing: Wine's server does not
    start without.
    """
    known = MACHINES.get(platform.machine())
    if sys.platform != "linux" or known is None:
        return False
    code = program(*known, no_locks)
    memory = ctypes.create_string_buffer(code)

    class Program(ctypes.Structure):
        """struct sock_fprog."""

        _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_void_p))

    own = Program(len(code) // 8, ctypes.addressof(memory))
    prctl = ctypes.CDLL(None).prctl
    done = prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0) == 0 and prctl(SET_SECCOMP, FILTER, ctypes.byref(own), 0, 0) == 0
    return bool(done)


def program(architecture: int, numbers: dict[str, int], arguments: Sequence[Argument], no_locks: bool = False) -> bytes:
    """The filter: struct sock_filter one after the other. A jump leaves out as many lines as it says."""
    refused = sorted({*numbers.values(), *EVERYWHERE.values()})
    looks = [line for argument in arguments for line in _look(argument, no_locks)]
    last = len(refused) + len(looks) + 5  # the line that refuses
    lines = [
        (LOAD, 0, 0, ARCHITECTURE),
        (EQUAL, 0, last - 2, architecture),  # calls of another one, such as that of 32 bits, are all refused
        (LOAD, 0, 0, NUMBER),
        (AT_LEAST, last - 4, 0, OTHER_TABLE),
        *((EQUAL, last - 5 - place, 0, number) for place, number in enumerate(refused)),
        *looks,
        (RETURN, 0, 0, ALLOW),
        (RETURN, 0, 0, REFUSE),
    ]
    return b"".join(struct.pack("HBBI", *line) for line in lines)


def _look(argument: Argument, no_locks: bool) -> list[tuple[int, int, int, int]]:
    """Lines that decide about a call by the low half of its argument, which is all that the kernel reads of it."""
    values, refuse = argument.values, PRETEND if no_locks and argument.values == LOCKS else REFUSE
    listed, others = (ALLOW, refuse) if argument.only else (refuse, ALLOW)
    return [
        (EQUAL, 0, len(values) + 3, argument.number),
        (LOAD, 0, 0, ARGUMENTS + 8 * argument.place),
        *((EQUAL, len(values) - place, 0, value) for place, value in enumerate(values)),
        (RETURN, 0, 0, others),
        (RETURN, 0, 0, listed),
    ]
