"""Names that a library shares with this process: read from files of any contents."""

import re
import struct
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.fmi.symbols import HEAD, shadowed

pytestmark = pytest.mark.needs("linux")


@pytest.fixture(scope="module")
def library() -> bytes:
    """A library that defines what this process has: its mathematical one."""
    maps = Path("/proc/self/maps").read_text(encoding="utf-8")
    return Path(re.findall(r"(/\S+/lib(?:m|c)\.so\S*)$", maps, re.MULTILINE)[0]).read_bytes()


def test_names_that_this_process_has(library, tmp_path):
    file = tmp_path / "library.so"
    file.write_bytes(library)
    assert len(shadowed(file)) > 100
    file.write_bytes(b"no library")
    assert not shadowed(file)


@given(st.binary(max_size=200), st.lists(st.tuples(st.integers(0, 0x40), st.integers(0, 255)), max_size=8))
def test_damage_is_no_error(tmp_path_factory, library, rest, changes):
    file = tmp_path_factory.getbasetemp() / "damaged.so"
    head = bytearray(library[:64])
    for place, byte in changes:
        head[min(place, 63)] = byte
    for content in (HEAD + rest, bytes(head) + library[64:4096] + rest, bytes(head) + library[64:]):
        file.write_bytes(content)
        assert isinstance(shadowed(file), list)


def elf(names: int, text: bytes) -> bytes:
    """A library with a number of symbols, whose names begin one byte after the other in ``text``."""
    table, symbols = 64, 64 + 2 * 64
    texts = symbols + 24 * names
    head = bytearray(HEAD.ljust(64, b"\0"))
    struct.pack_into("<Q", head, 0x28, table)
    struct.pack_into("<HH", head, 0x3A, 64, 2)
    sections = struct.pack("<IIQQQQIIQQ", 0, 11, 0, 0, symbols, 24 * names, 1, 0, 0, 24)
    sections += struct.pack("<IIQQQQIIQQ", 0, 3, 0, 0, texts, len(text), 0, 0, 0, 0)
    return bytes(head) + sections + b"".join(struct.pack("<IBBHQQ", i, 0x12, 0, 1, 1, 1) for i in range(names)) + text


def test_names_without_an_end_take_no_memory(tmp_path):
    """70 symbols over one text of 60 MB took 4.2 GB of the process that checks the FMU."""
    file = tmp_path / "library.so"
    file.write_bytes(elf(1, b"malloc\0"))
    assert shadowed(file) == ["malloc"]
    for text in (bytes(8 << 20).replace(b"\0", b"a") + b"\0", b"a" * 4000 + b"\0"):
        file.write_bytes(elf(2000, text))
        tracemalloc.start()
        try:
            assert not shadowed(file)
            assert tracemalloc.get_traced_memory()[1] < 1 << 20
        finally:
            tracemalloc.stop()
