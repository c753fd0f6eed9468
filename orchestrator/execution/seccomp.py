"""System calls that are refused to an isolated controller: those by which one case could pass information to another.

A case can leave a mark where a later one, or one at the same time, finds it: in what belongs to the whole machine or to
the user, and to no namespace of the sandbox. These are devices, whose modes and times can be changed; files that all
sandboxes show, which can be locked and watched, and of whose pages it can be chosen and asked which lie in memory;
keyrings; and above all counters: of pipes, sockets, open files, watches, memory, processes. Some calls move such a
counter, others read it: the number of a new pipe counts those of the whole machine, and the limit for its size those
of the user. The kernel's filter (seccomp(2)) refuses both, for good and for all that the process starts.

Calls that are newer than this list fail as on a kernel that does not have them, all but a few.
"""

from __future__ import annotations

import ctypes
import platform
import struct
import sys
from typing import NamedTuple

REFUSED: dict[str, tuple[int | None, int | None]] = {
    # marks on files and devices
    "chmod": (90, None),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "chown": (92, None),
    "fchown": (93, 55),
    "lchown": (94, None),
    "fchownat": (260, 54),
    "utime": (132, None),
    "utimes": (235, None),
    "futimesat": (261, None),
    "utimensat": (280, 88),
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "name_to_handle_at": (303, 264),
    "open_by_handle_at": (304, 265),
    # locks and watches
    "flock": (73, 32),
    "inotify_init": (253, None),
    "inotify_init1": (294, 26),
    "fanotify_init": (300, 262),
    "lookup_dcookie": (212, 18),
    # which pages of a file lie in memory, and where; page faults and blocks that were read say so, too
    "mincore": (27, 232),
    "readahead": (187, 213),
    "fadvise64": (221, 223),
    "getrusage": (98, 165),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "get_mempolicy": (239, 236),
    "move_pages": (279, 239),
    "migrate_pages": (256, 238),
    "splice": (275, 76),
    "tee": (276, 77),
    "vmsplice": (278, 75),
    # keyrings, programs and objects of the kernel
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
    "bpf": (321, 280),
    "kcmp": (312, 272),
    "syslog": (103, 116),
    # counters of the machine
    "sysinfo": (99, 179),
    "statfs": (137, 43),
    "fstatfs": (138, 44),
    "ustat": (136, None),
    "sysfs": (139, None),
    "quotactl": (179, 60),
    "io_setup": (206, 0),
    # counters of the user, and what has such a counter as its number
    "eventfd": (284, None),
    "eventfd2": (290, 19),
    "epoll_create": (213, None),
    "epoll_create1": (291, 20),
    "mq_open": (240, 180),
    "shmget": (29, 194),
    "semget": (64, 190),
    "msgget": (68, 186),
}
"""Calls by name, with their numbers on x86_64 and aarch64, None where there is no such call."""

TALK: dict[str, tuple[int | None, int | None]] = {
    "pipe": (22, None),
    "pipe2": (293, 59),
    "socket": (41, 198),
    "socketpair": (53, 199),
    "memfd_create": (319, 279),
}
"""The same: by these, several processes of a controller talk to each other. Wine cannot do without."""

FIRST_NEW, NEW_ALLOWED = 424, (436, 439, 453, 462)
"""From this number on, calls have one number on all machines; of those, close_range, faccessat2, map_shadow_stack and
mseal are allowed. io_uring does others without a call, openat2 tells what names the kernel remembers, and a clone3 or
pidfd_open gives a number that counts the processes of the machine."""


LOAD, EQUAL, AT_LEAST, ANY_OF, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
"""BPF_LD | BPF_W | BPF_ABS; BPF_JMP | BPF_JEQ, BPF_JGE and BPF_JSET; BPF_RET; with a constant."""

ALLOW, REFUSE, UNKNOWN, PRETEND = 0x7FFF0000, 0x00050000 | 1, 0x00050000 | 38, 0x00050000
"""SECCOMP_RET_ALLOW; SECCOMP_RET_ERRNO with EPERM, with ENOSYS, after which a library tries an older call, and with 0:
the call does nothing, and says it was done."""


class Argument(NamedTuple):
    """What becomes of a call by the value of its argument number ``place``: the action of the ``values`` that hold it,
    else the one ``otherwise``; refused if it has one of the ``bits``. The call has these ``numbers`` on x86_64 and
    aarch64."""

    numbers: tuple[int, int]
    place: int
    values: dict[int, int] = {}
    otherwise: int = ALLOW
    bits: int = 0


ANY = (1 << 64) - 1
"""All bits of an argument: it is refused unless it is zero."""

WAKE = (1, 3, 4, 5, 7, 10, 12)
"""FUTEX_WAKE, FUTEX_REQUEUE, FUTEX_CMP_REQUEUE, FUTEX_WAKE_OP, FUTEX_UNLOCK_PI, FUTEX_WAKE_BITSET and
FUTEX_CMP_REQUEUE_PI of futex(2), without FUTEX_PRIVATE_FLAG: at a page of a file, they say whether another sandbox
waits there."""

TERMINAL = (0x5401, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451)
"""TCGETS, TIOCGWINSZ, FIONREAD, FIONBIO, FIONCLEX, FIOCLEX of ioctl(2); some file systems tell by others what lies in
memory."""

ARGUMENTS_REFUSED = (
    Argument((28, 233), 2, dict.fromkeys((20, 21), REFUSE)),  # madvise: MADV_COLD, MADV_PAGEOUT
    Argument((327, 286), 5, {0: ALLOW}, REFUSE),  # preadv2: with a flag it asks whether a page lies in memory
    Argument((16, 29), 1, dict.fromkeys(TERMINAL, ALLOW), REFUSE),  # ioctl
    Argument((61, 260), 3, bits=ANY),  # wait4: page faults of a child
    Argument((247, 95), 4, bits=ANY),  # waitid: the same
    Argument((9, 222), 3, bits=0x40000),  # mmap: MAP_HUGETLB, of which the machine has a number
    Argument((56, 220), 0, bits=0x1000),  # clone: CLONE_PIDFD, whose number counts processes of the machine
    Argument((55, 209), 2, {57: REFUSE}),  # getsockopt: SO_COOKIE, which counts sockets of the machine
    Argument((202, 98), 1, dict.fromkeys(WAKE, REFUSE)),
)

DESCRIPTORS = (0, 1, 2, 3, 4, 5, 36, 1030, 1033, 1034)
"""Of fcntl(2): what it does with a descriptor alone, and asking for a lock, which nobody has. Others lock, watch or
mark the file, or size a pipe."""

LOCKS = (6, 7, 37, 38)
"""F_SETLK, F_SETLKW, F_OFD_SETLK, F_OFD_SETLKW."""


def _arguments(talking: bool) -> tuple[Argument, ...]:
    allowed = dict.fromkeys(DESCRIPTORS, ALLOW)
    if not talking:
        return *ARGUMENTS_REFUSED, Argument((72, 25), 1, allowed, REFUSE)
    # Of sockets AF_UNIX alone: memory of those of networks is counted for the machine, others have no namespace.
    socket, fcntl = Argument((41, 198), 0, {1: ALLOW}, REFUSE), {**allowed, **dict.fromkeys(LOCKS, PRETEND)}
    return *ARGUMENTS_REFUSED, socket, Argument((72, 25), 1, fcntl, REFUSE)


MACHINES = {"x86_64": (0xC000003E, 0), "aarch64": (0xC00000B7, 1)}
"""AUDIT_ARCH of linux/audit.h, and which of two numbers a call has."""

NUMBER, ARCHITECTURE, ARGUMENTS, OTHER_TABLE = 0, 4, 16, 0x40000000
"""Offsets in struct seccomp_data; the first number of the x32 interface, whose calls are the same by other numbers."""

NO_NEW_PRIVILEGES, SET_SECCOMP, FILTER = 38, 22, 2
"""PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, SECCOMP_MODE_FILTER."""


def deny_covert_channels(talking: bool = False) -> bool:
    """Refuse these calls to this process from now on; False where that cannot be done.

    A process that goes on ``talking`` with others that it starts, as Wine does with its server, keeps pipes, sockets
    of Unix and memory with a descriptor; its locks by fcntl say that a file is locked, and do nothing.
    """
    machine = MACHINES.get(platform.machine())
    if sys.platform != "linux" or machine is None:
        return False
    _warm_up()
    code = program(*machine, talking)
    memory = ctypes.create_string_buffer(code)

    class Program(ctypes.Structure):
        """struct sock_fprog."""

        _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_void_p))

    filter_program = Program(len(code) // 8, ctypes.addressof(memory))
    prctl = ctypes.CDLL(None).prctl
    done = (
        prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0) == 0
        and prctl(SET_SECCOMP, FILTER, ctypes.byref(filter_program), 0, 0) == 0
    )
    return bool(done)


def _warm_up() -> None:
    """Sort something: until its version 2.37, glibc's qsort asks once how much memory the machine has, and would sort
    in another way if it were not told."""
    libc = ctypes.CDLL(None)
    libc.qsort(ctypes.create_string_buffer(2048), ctypes.c_size_t(256), ctypes.c_size_t(8), libc.strcmp)


def program(architecture: int, machine: int, talking: bool = False) -> bytes:
    """The filter for calls with the numbers of a ``machine``: struct sock_filter one after the other."""
    calls = {**REFUSED, **({} if talking else TALK)}
    refused = {numbers[machine] for numbers in calls.values()} - {None}
    new = [*_decided(dict.fromkeys(NEW_ALLOWED, ALLOW)), (RETURN, 0, 0, UNKNOWN)]
    lines = [
        (LOAD, 0, 0, ARCHITECTURE),
        (EQUAL, 1, 0, architecture),
        (RETURN, 0, 0, REFUSE),  # calls of another one, such as that of 32 bits
        (LOAD, 0, 0, NUMBER),
        (AT_LEAST, 0, 1, OTHER_TABLE),
        (RETURN, 0, 0, REFUSE),
        (AT_LEAST, 0, len(new), FIRST_NEW),
        *new,
        *_decided(dict.fromkeys(sorted(number for number in refused if number is not None), REFUSE)),
        *(line for argument in _arguments(talking) for line in _look(argument, machine)),
        (RETURN, 0, 0, ALLOW),
    ]
    return b"".join(struct.pack("HBBI", *line) for line in lines)


Line = tuple[int, int, int, int]
"""Of the filter: what it does, how many lines it leaves out if a condition holds and if not, and a constant."""


def _decided(actions: dict[int, int]) -> list[Line]:
    """Lines that take the action of the value that was loaded, if it has one."""
    return [line for value, action in actions.items() for line in ((EQUAL, 0, 1, value), (RETURN, 0, 0, action))]


def _look(argument: Argument, machine: int) -> list[Line]:
    """Lines that decide about a call by an argument: its values by the low half, which is all that the kernel reads of
    those here."""
    place = ARGUMENTS + 8 * argument.place
    lines = [(LOAD, 0, 0, place), *_decided(argument.values)]
    for half in (0, 1) if argument.bits else ():
        lines += [(LOAD, 0, 0, place + 4 * half), (ANY_OF, 0, 1, argument.bits >> 32 * half & 0xFFFFFFFF)]
        lines += [(RETURN, 0, 0, REFUSE)]
    lines += [(RETURN, 0, 0, argument.otherwise)]
    return [(EQUAL, 0, len(lines), argument.numbers[machine]), *lines]
