"""The kernel's filter of an isolated controller: each call of the list is refused, and what computing needs is not."""

import errno
import platform
import sys
from ast import literal_eval

import pytest
from hostile.commands import finished

from orchestrator.execution import seccomp
from orchestrator.execution.interpreter import program

pytestmark = pytest.mark.needs("linux")

EACH = """
import ctypes, sys
from orchestrator.execution.seccomp import deny_covert_channels
libc = ctypes.CDLL(None, use_errno=True)
libc.syscall.restype = ctypes.c_long
assert deny_covert_channels(talking={talking})
found = {{}}
for number in {numbers}:
    ctypes.set_errno(0)
    result = libc.syscall(ctypes.c_long(number), *[ctypes.c_long(-1)] * 6)
    found[number] = ctypes.get_errno() if result == -1 else 0
print(found)
"""

CALLS = """
import ctypes, fcntl, mmap, os, platform, socket, sys, threading
from orchestrator.execution.seccomp import MACHINES, ARGUMENTS_REFUSED, deny_covert_channels
machine = MACHINES[platform.machine()][1]
libc = ctypes.CDLL(None, use_errno=True)
file = open(sys.executable, "rb")
word = ctypes.create_string_buffer(8)
child = os.fork()
if child == 0:
    os._exit(0)

def call(name, *words):
    numbers = dict(wait4=(61, 260), waitid=(247, 95), clone=(56, 220), getsockopt=(55, 209), futex=(202, 98))
    ctypes.set_errno(0)
    if libc.syscall(numbers[name][machine], *words) == -1 and ctypes.get_errno() == 1:
        raise PermissionError

refused = dict(
    lock=lambda: fcntl.lockf(file, fcntl.LOCK_SH | fcntl.LOCK_NB),
    lease=lambda: fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_RDLCK),
    notify=lambda: fcntl.fcntl(file, fcntl.F_NOTIFY, fcntl.DN_ACCESS),
    hint=lambda: fcntl.fcntl(file, 1035, bytes(8)),
    pipe_size=lambda: fcntl.fcntl(file, 1032),
    nowait=lambda: os.preadv(file.fileno(), [bytearray(1)], 0, getattr(os, "RWF_NOWAIT", 8)),
    page_out=lambda: mmap.mmap(-1, 4096).madvise(21),
    huge=lambda: mmap.mmap(-1, 1 << 21, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | 0x40000),
    ioctl=lambda: fcntl.ioctl(file, 0xC020660B, bytes(32)),  # FS_IOC_FIEMAP
    wait4=lambda: os.wait4(child, 0),
    waitid=lambda: call("waitid", 0, 0, None, 4, word),
    pidfd=lambda: call("clone", 0x1000 | 17, None, word, None, None),
    cookie=lambda: call("getsockopt", 0, 1, 57, word, word),
    wake=lambda: call("futex", word, 1, 1, None, None, 0),
    locked_by_clock=lambda: call("futex", word, 10, 1, None, None, 1),
)
allowed = dict(
    flags=lambda: fcntl.fcntl(file, fcntl.F_GETFL),
    read=lambda: os.preadv(file.fileno(), [bytearray(1)], 0),
    memory=lambda: mmap.mmap(-1, 4096).madvise(mmap.MADV_DONTNEED),
    terminal=lambda: os.isatty(file.fileno()),
    private_wake=lambda: call("futex", word, 129, 1, None, None, 0),
    thread=lambda: threading.Thread(target=int).start(),
    child=lambda: os.waitpid(child, 0),
)

def works(call):
    try:
        call()
    except OSError as problem:
        return problem.errno not in (1, None)
    return True

assert deny_covert_channels()
print([name for name in refused if works(refused[name])], [name for name in allowed if not works(allowed[name])])
"""


def answers(folder, numbers, talking=False) -> dict[int, int]:
    """The error number of each call with impossible arguments, behind the filter."""
    done = finished([*program(EACH.format(numbers=list(numbers), talking=talking))], folder=folder)
    return literal_eval(done.stdout or done.stderr)


def own(calls) -> dict[str, int]:
    """The numbers of these calls on this machine."""
    machine = seccomp.MACHINES[platform.machine()][1]
    return {name: numbers[machine] for name, numbers in calls.items() if numbers[machine] is not None}


def test_each_call_of_the_list_is_refused(tmp_path):
    listed = own({**seccomp.REFUSED, **seccomp.TALK})
    assert set(answers(tmp_path, listed.values()).values()) == {errno.EPERM}


def test_calls_that_are_newer_than_the_list_are_unknown(tmp_path):
    new = set(range(seccomp.FIRST_NEW, 600)) - {*seccomp.NEW_ALLOWED}
    assert set(answers(tmp_path, sorted(new)).values()) == {errno.ENOSYS}
    close_range = min(seccomp.NEW_ALLOWED)
    assert answers(tmp_path, [close_range]) == {close_range: errno.EINVAL}


def test_processes_that_talk_keep_what_they_talk_by(tmp_path):
    talk = own(seccomp.TALK)
    found = answers(tmp_path, talk.values(), talking=True)
    assert {name for name, number in talk.items() if found[number] == errno.EPERM} == {"socket"}  # no such family
    refused = answers(tmp_path, own(seccomp.REFUSED).values(), talking=True)
    assert set(refused.values()) == {errno.EPERM}


def test_arguments_by_which_something_is_marked_or_asked_are_refused(tmp_path):
    done = finished([*program(CALLS)], folder=tmp_path)
    assert done.stdout == "[] []\n", done.stdout + done.stderr


def test_no_jump_of_the_filter_is_too_far():
    """One leaves out at most 255 lines, and none leaves the filter."""
    for architecture, machine in seccomp.MACHINES.values():
        for talking in (False, True):
            code = seccomp.program(architecture, machine, talking)
            lines = [code[at : at + 8] for at in range(0, len(code), 8)]
            assert all(place + 1 + max(line[2], line[3]) < len(lines) for place, line in enumerate(lines[:-1]))
            assert lines[-1][0] == seccomp.RETURN and sys.byteorder == "little"
