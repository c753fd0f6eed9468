"""Compilers that fail, hang and flood, and what is told of them: for this repository's sources and for a stranger's."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import psutil
import pytest
from bad_fmus import unpack
from hostile.commands import wait_for

import build_fmus
from controller_fmu.export import compiler
from controller_fmu.export.archive import BuildError, pack
from orchestrator.cosim.archive import open_archive
from orchestrator.errors import InputError

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="shell scripts stand for compilers")
REMEDY = "export the FMU with a binary for"


@pytest.fixture
def sources(pid_c_file, tmp_path, monkeypatch):
    """A function that opens the default controller as source code, with a line before its own, in an empty cache."""
    monkeypatch.setenv("FLEXIBLE_MANIPULATOR_CACHE", str(tmp_path / "cache"))
    entries = {name: data for name, data in unpack(pid_c_file).items() if not name.startswith("binaries/")}

    def opened(first: bytes = b""):
        file = tmp_path / "sources.fmu"
        file.write_bytes(pack({**entries, "sources/pid.c": first + b"\n" + entries["sources/pid.c"]}))
        return open_archive(file)

    return opened


@pytest.fixture
def as_compiler(tmp_path, monkeypatch):
    """A function that makes a shell script this machine's compiler."""

    def make(*lines: str) -> None:
        script = tmp_path / "compiler"
        script.write_text("\n".join(("#!/bin/sh", *lines, "")))
        script.chmod(0o755)
        monkeypatch.setenv("CC", str(script))

    return make


def refusal(sources, first: bytes = b"") -> str:
    """What is told of sources that cannot be used; the way out must be a part of it."""
    with pytest.raises(InputError) as told:
        sources(first)
    assert REMEDY in str(told.value)
    return str(told.value)


def test_sources_in_another_encoding(sources):
    assert "sources/pid.c:1" in refusal(sources, '#error "Regler für ö"'.encode("latin-1"))


def test_a_compiler_gets_no_input(sources, as_compiler):
    as_compiler("cat >&2", "exit 1")
    assert "ended with exit code 1 and said nothing" in refusal(sources)


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("false", "'false' ended with exit code 1 and said nothing"),
        ("true", "'true' ended without an error, but wrote nothing: is it a C compiler?"),
        ("sh -c 'kill -9 $$'", "'sh' was ended by signal 9 and said nothing"),
        ('"', "the environment's CC is no command: \" (No closing quotation); set it to a C compiler"),
    ],
)
def test_what_is_no_compiler_is_told_with_a_reason(command, told, sources, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("CC", command)
    assert told in refusal(sources)
    assert build_fmus.main(["DiagonalPID_C", "--output-dir", str(tmp_path)]) == 1
    message = capsys.readouterr().err
    assert message.startswith("error: DiagonalPID_C.fmu: ") and told in message


def test_a_compiler_that_hangs_ends_with_all_its_parts(sources, as_compiler, tmp_path, monkeypatch):
    monkeypatch.setattr(compiler, "TIME_LIMIT", 1.0)
    as_compiler("sleep 1000 &", f"echo $! > {tmp_path}/pid", "wait")
    begin = time.monotonic()
    assert "did not end within 1 s" in refusal(sources)
    assert time.monotonic() - begin < 60
    part = int(Path(tmp_path, "pid").read_text())
    assert wait_for(lambda: not psutil.pid_exists(part) or psutil.Process(part).status() == psutil.STATUS_ZOMBIE, 5.0)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems may lack a limit")
def test_a_compiler_is_limited_where_it_runs(tmp_path):
    """Limits of the system hold for all parts of a compiler, which are asked for theirs here."""
    product = tmp_path / "limits"
    compiler.run_compiler(["sh", "-c", f"sh -c 'ulimit -v; ulimit -f' > {product}"], product)
    memory, file = (int(line) for line in product.read_text().split())
    assert (memory, file) == (compiler.MEMORY // 1024, compiler.FILE // 512)


def test_what_a_compiler_says_is_read_in_part(tmp_path, monkeypatch):
    monkeypatch.setattr(compiler, "MOST_TOLD", 10)
    with pytest.raises(BuildError, match="^y\ny\ny\ny\ny$"):
        compiler.run_compiler(["sh", "-c", "yes | head -c 100000 >&2; exit 1"], tmp_path / "nothing")


def test_the_command_that_cannot_be_run_is_told(tmp_path, monkeypatch):
    script = tmp_path / "of-another-machine"
    script.write_bytes(b"\x7fELF")
    script.chmod(0o755)
    assert os.access(script, os.X_OK)
    with pytest.raises(BuildError, match="of-another-machine cannot be run: Exec format error"):
        compiler.run_compiler([str(script)], tmp_path / "nothing")
