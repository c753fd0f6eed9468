"""What FMUs log: machine code writes it without Python's lock, and whoever reads it trusts none of it."""

import ctypes
import threading
from ctypes.util import find_library

import pytest
from fmpy.fmi1 import fmi1CallbackFunctions
from fmpy.fmi2 import fmi2CallbackFunctions
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.fmi import log
from orchestrator.fmi.log import HEAD, LINES, MAX_LINE_LENGTH, SIZE, SLOT, SLOTS, Log
from orchestrator.fmi.slaves import logger
from orchestrator.fmi.trace import CONTROLLER, PLANT

WORDS = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
ANY = ctypes.CFUNCTYPE(None, *WORDS)(logger.logger(logger.ANY))


@pytest.fixture
def own():
    """A log of the process for one test."""
    before, fresh = log.current, Log()
    log.use(fresh)
    yield fresh
    log.use(before)


def say(status: int, message: bytes | None, *rest: object, instance: bytes | None = b"pid") -> None:
    """Log as an FMU of FMI 2 does."""
    kinds = (ctypes.c_double if isinstance(value, float) else ctypes.c_char_p for value in rest)
    ctypes.CFUNCTYPE(None, *WORDS, *kinds)(logger.logger(logger.ANY))(None, instance, status, b"", message, *rest)


def test_variable_arguments_are_printed_as_in_c(own):
    say(1, b"%s is %.3f of %s, %g%%", b"u_m", 0.25, b"all", 1e-3)
    say(0, b"%s", b"not kept")
    say(4, b"")
    say(3, None, instance=None)
    assert own.lines() == ("pid: u_m is 0.250 of all, 0.001%", "pid")
    assert own.count == 4


def test_messages_of_fmi_3_are_no_formats(own):
    plant, controller = (
        ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)(address)
        for address in (logger.logger_3(PLANT, "arm"), logger.logger_3(CONTROLLER, "p" * 500))
    )
    plant(None, 1, b"", b"100 %s of %n")
    controller(None, 1, None, None)
    plant(None, 0, b"", b"fine")
    assert own.lines() == ("arm: 100 %s of %n", "p" * 119) and own.count == 3


@pytest.mark.parametrize("kind", [fmi1CallbackFunctions, fmi2CallbackFunctions])
def test_no_function_that_an_fmu_calls_needs_python(kind):
    made = logger.callbacks(kind)
    # Not of the whole program: in Debian's Python 3.11, free has an address of the program's own there.
    library = ctypes.CDLL(find_library("c"))
    for name, function in (("allocateMemory", library.calloc), ("freeMemory", library.free)):
        address, expected = (ctypes.cast(each, ctypes.c_void_p).value for each in (getattr(made, name), function))
        assert address == expected
    assert ctypes.cast(made.logger, ctypes.c_void_p).value == logger.logger(logger.ANY)


def test_threads_log_at_once(own):
    """Each message that is shown is whole, and they are among the last ones."""
    each, threads = 3000, 4

    def talk(number: int) -> None:
        for i in range(each):
            ANY(None, b"%d" % number, 1, b"", b"message %d " % i + b"%d" % number * 100)

    running = [threading.Thread(target=talk, args=(number,)) for number in range(threads)]
    for thread in running:
        thread.start()
    for thread in running:
        thread.join()
    assert own.count == each * threads
    lines = own.lines()
    assert LINES - threads <= len(lines) <= LINES
    for line in lines:
        number, _, text = line.partition(": message ")
        assert text.split()[1] == number * 100
    assert f"message {each - 1} " in lines[-1]


def test_a_log_takes_no_more_memory_than_it_has(own):
    guarded = ctypes.create_string_buffer(b"\x55" * (SIZE + 64))
    own = Log(memoryview(guarded).cast("B")[:SIZE])
    own.clear()
    log.use(own)
    for i in range(3 * SLOTS):
        say(1, b"%s", b"x" * 5000 + b"%d" % i, instance=b"i" * 500)
    assert guarded.raw[SIZE : SIZE + 64] == b"\x55" * 64
    assert all(line.endswith("x" * 100) and len(line) < MAX_LINE_LENGTH + 200 for line in own.lines())
    assert len(own.lines()) == LINES


@given(
    st.lists(st.tuples(st.integers(0, SIZE - 8), st.binary(min_size=1, max_size=8)), max_size=40),
    st.integers(-(2**63), 2**63 - 1),
    st.integers(-(2**63), 2**63 - 1),
)
def test_whatever_stands_there_is_read(changes, count, kept):
    """The memory is shared with foreign code."""
    memory = bytearray(SIZE)
    for at, data in changes:
        memory[at : at + len(data)] = data
    memory[:16] = count.to_bytes(8, "little", signed=True) + kept.to_bytes(8, "little", signed=True)
    slot = HEAD + (kept - 1) % SLOTS * SLOT  # that of the last message, as if it were whole
    memory[slot : slot + 8] = kept.to_bytes(8, "little", signed=True)
    read = Log(memory)
    assert len(read.lines()) <= LINES and 0 <= read.count <= 2**53
    Log().take(read)


def test_the_last_messages_of_another_log_are_taken():
    one, other = Log(), Log()
    for i in range(50):
        other.keep(b"message %d" % i, b"pid")
    one.keep(b"first", b"plant")
    one.take(other)
    assert one.lines()[-1] == "pid: message 49" and one.count == 51
    one.clear()
    assert (one.lines(), one.count) == ((), 0)
