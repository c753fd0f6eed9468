"""Compilers that fail, hang and flood, and what the error says of them."""

import shlex
import sys
from pathlib import Path

import psutil
import pytest
from hostile.commands import wait_for
from support.refusals import refusal

from controller_fmu.errors import CompilerError, NoCompilerError
from controller_fmu.export import compiler, find_compiler, run_compiler


def refused(*command: str) -> str:
    """What the error of a command says that does not compile; it names the command."""
    error = refusal(run_compiler, command, Path("nothing"), kind=CompilerError)
    assert error.value == command[0]
    return error.what


REASONS = {
    "false": "exit code 1",
    "true": "wrote nothing",
    "sh -c 'kill -9 $$'": "signal 9",
    "sh -c \"printf 'f\\374r' >&2; exit 1\"": "f\N{REPLACEMENT CHARACTER}r",
    "sh -c 'cat >&2; exit 3'": "exit code 3",
    "./compiler-of-another-machine": "Exec format error",
}


@pytest.mark.parametrize("command", REASONS)
def test_what_does_not_compile_is_refused_with_a_reason(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("compiler-of-another-machine").write_bytes(b"\x7fELF")
    Path("compiler-of-another-machine").chmod(0o755)
    assert REASONS[command] in refused(*shlex.split(command))


def test_the_environment_chooses_the_compiler(monkeypatch):
    monkeypatch.setenv("CC", f"'{sys.executable}' -m cc")
    assert find_compiler() == [sys.executable, "-m", "cc"]
    monkeypatch.setenv("CC", "no-such-compiler -m64")
    assert find_compiler() is None
    assert refusal(compiler.require_compiler, kind=NoCompilerError).value == "no-such-compiler -m64"
    monkeypatch.setenv("CC", '"')
    assert refusal(find_compiler, kind=CompilerError).value == '"'


def test_a_compiler_that_hangs_ends_with_all_its_parts_and_one_that_floods_is_cut(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(compiler, "TIME_LIMIT", 1.0)
        assert "1 s of processor time" in refused("sh", "-c", "while :; do :; done")
        patch.setattr(compiler, "HANG_LIMIT", 1.0)
        assert "within 1 s" in refused("sh", "-c", f"sleep 1000 & echo $! > {tmp_path}/pid; wait")
    part = int(Path(tmp_path, "pid").read_text())
    assert wait_for(lambda: not psutil.pid_exists(part) or psutil.Process(part).status() == psutil.STATUS_ZOMBIE)
    monkeypatch.setattr(compiler, "MESSAGE_SIZE", 10)
    assert refused("sh", "-c", "yes | head -c 100000 >&2; exit 1") == "y\ny\ny\ny\ny"


def test_a_compiler_is_limited_where_it_runs(tmp_path):
    """Limits of the system hold for all parts of a compiler, which are asked for theirs here."""
    product = tmp_path / "limits"
    run_compiler(["sh", "-c", f"sh -c 'ulimit -v; ulimit -f' > {product}"], product)
    memory, file = (int(line) for line in product.read_text().split())
    assert (memory, file) == (compiler.MEMORY // 1024, compiler.FILE // 512)
