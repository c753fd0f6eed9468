"""Names that a library shares with this process: read from files of any contents."""

import re
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
