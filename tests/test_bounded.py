"""Files that a user names are read to a bound: no device, no size and no nesting takes this process with it."""

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.refusals import refusal

from orchestrator import Benchmark, Controller, Simulation
from orchestrator.benchmark import protocol
from orchestrator.bounded import MAX_DEPTH, MAX_TEXT_BYTES, read, read_toml, tomllib
from orchestrator.documents import recording
from orchestrator.documents.results import Results
from orchestrator.fmi.controller_files import read_mapping, read_parameters

TOO_DEEP = {
    "a key of many parts": "a" + ".a" * 60_000 + " = 1\n",
    "a key of many quoted parts": '"a"' + " . 'a'" * 60_000 + " = 1\n",
    "a table of many parts": "[a" + ".a" * 60_000 + "]\n",
    "a key inside a value": "a = {b" + ".b" * 60_000 + " = 1}\n",
    "nested arrays": "a = " + "[" * 50_000 + "]" * 50_000 + "\n",
    "nested tables": "a = " + "{b = " * 50_000 + "1" + "}" * 50_000 + "\n",
}

READERS = {
    "mapping": (read_mapping, ".toml"),
    "mapping of SSP": (read_mapping, ".ssm"),
    "parameters": (lambda file: read_parameters(file, None), ".toml"),
    "parameters of SSP": (lambda file: read_parameters(file, None), ".ssv"),
    "protocol": (protocol.load, ".toml"),
    "results": (Results.load, ".json"),
    "recording": (lambda file: recording.load(file.parent), "trajectories.npz"),
    "simulation": (Simulation.load, ".simulation"),
}


@pytest.mark.parametrize("name", TOO_DEEP)
@pytest.mark.parametrize("reader", [read_mapping, protocol.load])
def test_toml_that_would_take_the_memory_is_refused(reader, name, tmp_path):
    file = tmp_path / "deep.toml"
    file.write_text(TOO_DEEP[name])
    error = refusal(reader, file)
    assert f"more than {MAX_DEPTH} parts" in str(error) and "\n" not in str(error)


@pytest.mark.needs("linux")
@pytest.mark.parametrize("kind", ["device", "pipe"])
@pytest.mark.parametrize("name", READERS)
def test_what_never_ends_or_begins_is_not_read(name, kind, tmp_path):
    reader, ending = READERS[name]
    file = tmp_path / (ending if "." in ending[1:] else f"file{ending}")
    if kind == "device":
        file.symlink_to("/dev/zero")
    else:
        os.mkfifo(file)
    assert "it is a device, a pipe or a socket" in str(refusal(reader, file))


def test_a_file_is_read_up_to_its_bound(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(b"x" * 100)
    assert read(file, 100) == b"x" * 100
    assert refusal(read, file, 99).what == "file-limit"
    assert refusal(read, tmp_path / "absent", 1, "bad-protocol").what == "bad-protocol"
    assert refusal(read, tmp_path).what == "no-file"


def test_a_mapping_of_any_size_is_refused(tmp_path, quick_pid_file):
    file = tmp_path / "large.toml"
    with file.open("wb") as stream:
        stream.truncate(1 << 40)
    assert Benchmark("quick").check(Controller(quick_pid_file, mapping=file)).found[-1].what == "file-limit"


def test_protocols_that_extend_each_other_are_refused(tmp_path):
    one, other = tmp_path / "one.toml", tmp_path / "other.toml"
    one.write_text(f'extends = "{other}"\n')
    other.write_text(f'extends = "{one}"\n')
    assert "extends" in str(refusal(protocol.load, one))


WORDS = st.text(
    st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")) | st.sampled_from("[]{}.#'\"\\\n"), max_size=80
)
VALUES = st.recursive(
    st.integers(-(2**60), 2**60) | st.floats(allow_nan=False, allow_infinity=False) | st.booleans() | WORDS,
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=20,
)


def _toml(value: object) -> str:
    if isinstance(value, str):
        plain = all(c.isprintable() and c not in '"\\' for c in value)
        return f'"{value}"' if plain else '"' + "".join(f"\\U{ord(c):08x}" for c in value) + '"'
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return str(value).lower()


@settings(max_examples=40)
@given(st.dictionaries(st.from_regex(r"[A-Za-z0-9_-]{1,9}(\.[a-z]{1,3})?", fullmatch=True), VALUES, max_size=6))
def test_ordinary_toml_is_read_as_by_the_parser(tmp_path_factory, table):
    text = "# [[[ a.b.c\n" + "".join(f"{_toml(name)} = {_toml(value)}\n" for name, value in table.items())
    file = tmp_path_factory.getbasetemp() / "ordinary.toml"
    file.write_bytes(text.encode())
    assert read_toml(file) == tomllib.loads(text)


@pytest.mark.parametrize("text", ['"""', "'''", '"', "'", '"""\\', '\\"""'], ids=repr)
def test_texts_without_an_end_are_looked_through_once(text, tmp_path):
    """A search for the end of each would take hours."""
    file: Path = tmp_path / "open.toml"
    file.write_text(f"a = {text}" + '"""\\"""x' * (MAX_TEXT_BYTES // 80))
    assert refusal(read_toml, file).what == "bad-file"
