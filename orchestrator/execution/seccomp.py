"""System calls that a controller apart is refused: those that mark a file for a later process.

Inside the sandbox the devices of /dev are those of the machine. Where root verifies, root owns them inside, too, and a
controller could change their modes or times, which the process of a later case would find. The kernel's filter
(seccomp(2)) refuses that with EPERM, for good and for all that the process starts.
"""

from __future__ import annotations

import ctypes
import platform
import struct
import sys

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
}
EVERYWHERE = {"io_uring_setup": 425, "fchmodat2": 452, "setxattrat": 463, "removexattrat": 466}
"""New calls have one number on all machines. With io_uring the others could be had without a call."""

MACHINES = {"x86_64": (0xC000003E, X86_64), "aarch64": (0xC00000B7, AARCH64)}
"""AUDIT_ARCH of linux/audit.h, and the numbers of the calls."""

LOAD, EQUAL, AT_LEAST, RETURN = 0x20, 0x15, 0x35, 0x06
"""BPF_LD | BPF_W | BPF_ABS, BPF_JMP | BPF_JEQ, BPF_JMP | BPF_JGE, BPF_RET, with a constant."""

ALLOW, REFUSE = 0x7FFF0000, 0x00050000 | 1
"""SECCOMP_RET_ALLOW; SECCOMP_RET_ERRNO with EPERM."""

NUMBER, ARCHITECTURE, OTHER_TABLE = 0, 4, 0x40000000
"""Offsets in struct seccomp_data; the first number of the x32 interface, whose calls are the same by other numbers."""

NO_NEW_PRIVILEGES, SET_SECCOMP, FILTER = 38, 22, 2
"""PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, SECCOMP_MODE_FILTER."""


def refuse_marks() -> bool:
    """Refuse these calls to this process from now on; False where that cannot be done."""
    known = MACHINES.get(platform.machine())
    if sys.platform != "linux" or known is None:
        return False
    code = program(*known)
    memory = ctypes.create_string_buffer(code)

    class Program(ctypes.Structure):
        """struct sock_fprog."""

        _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_void_p))

    own = Program(len(code) // 8, ctypes.addressof(memory))
    prctl = ctypes.CDLL(None).prctl
    done = prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0) == 0 and prctl(SET_SECCOMP, FILTER, ctypes.byref(own), 0, 0) == 0
    return bool(done)


def program(architecture: int, numbers: dict[str, int]) -> bytes:
    """The filter: struct sock_filter one after the other. A jump leaves out as many lines as it says."""
    refused = sorted({*numbers.values(), *EVERYWHERE.values()})
    last = len(refused) + 5  # the line that refuses
    lines = [
        (LOAD, 0, 0, ARCHITECTURE),
        (EQUAL, 0, last - 2, architecture),  # calls of another one, such as that of 32 bits, are all refused
        (LOAD, 0, 0, NUMBER),
        (AT_LEAST, last - 4, 0, OTHER_TABLE),
        *((EQUAL, last - 5 - place, 0, number) for place, number in enumerate(refused)),
        (RETURN, 0, 0, ALLOW),
        (RETURN, 0, 0, REFUSE),
    ]
    return b"".join(struct.pack("HBBI", *line) for line in lines)
