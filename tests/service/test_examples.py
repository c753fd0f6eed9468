"""The commands and examples of the documentation, against a service with jobs that compute nothing."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from browser.test_service_in_browser import served
from support.command_lines import call, called
from support.tools import require

from orchestrator.cli.main import main
from orchestrator.service import accounts
from orchestrator.service.database import Database
from orchestrator.service.files import Files
from service.conftest import ALONE, FAKE, SOME, fmu

require("starlette", "uvicorn", "httpx2")

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "tutorial-service.md").read_text(encoding="utf-8")
ADDRESS = "http://127.0.0.1:8080"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


@pytest.fixture
def address(tmp_path: Path):
    (tmp_path / "my_controller.fmu").write_bytes(fmu(evaluating={"cost": 88.125}))
    with served(tmp_path / "data", ALONE, FAKE) as url:
        yield url


def test_the_command_of_the_tutorial_submits_and_follows(address, tmp_path):
    (block,) = blocks("sh")
    program, *words = shlex.split(block.replace("\\\n", " ").replace(ADDRESS, address))
    finished = called(main, *words, folder=tmp_path)
    assert program == "flexible-manipulator" and finished.code == 0, finished.err
    assert finished.out.startswith("V = 88.1, A1 to A3 are met\n" + address) and "received: " in finished.err


@pytest.mark.needs("bash", "curl")
def test_the_lines_for_curl_run(address, tmp_path):
    (block,) = blocks("bash")
    run = subprocess.run(
        ["bash", "-ec", block.replace(ADDRESS, address)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0 and '"name": "my_controller.fmu"' in run.stdout, run


def test_the_lines_of_python_run(address, tmp_path, monkeypatch, capsys):
    (block,) = blocks("python")
    monkeypatch.chdir(tmp_path)
    exec(compile(block.replace(ADDRESS, address), "tutorial", "exec"), {})
    assert capsys.readouterr().out == "finished 88.125\n"


@pytest.mark.needs("octave", "curl")
def test_the_lines_of_octave_run(address, tmp_path):
    (block,) = blocks("octave")
    program = ["octave-cli", "--no-init-file", "--eval", block.replace(ADDRESS, address)]
    run = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.stdout == "88.125\n", run


def test_submit_tells_what_was_refused(address, tmp_path):
    (tmp_path / "b.fmu").write_bytes(fmu(checking={"kind": "refused", "reason": "no q_m\x1b[2J", "verdict": "error"}))
    finished = call("submit", "b.fmu", "--to", address, folder=tmp_path)
    assert finished.code == 2 and "refused: no q_m" in finished.out and "\x1b" not in finished.out + finished.err
    finished = call("submit", "b.fmu", "--to", address, "--no-wait", "--json", folder=tmp_path)
    assert finished.code == 0 and json.loads(finished.out)["state"] == "received"


@pytest.mark.parametrize(
    ("words", "code", "what"),
    [
        (("no.fmu", "--to", "{}"), 2, "There is no file no.fmu"),
        (("my_controller.fmu", "--to", "{}", "--set", "a=1", "--set", "a=2"), 2, "--set gives a more than once"),
        (("my_controller.fmu", "--to", "ftp://x"), 2, "is not the address of a service"),
        (("my_controller.fmu", "--to", "http://127.0.0.1:9"), 1, "does not answer"),
    ],
)
def test_submit_says_in_a_sentence_what_is_wrong(address, words, code, what, tmp_path):
    finished = call("submit", *(word.format(address) for word in words), folder=tmp_path)
    assert finished.code == code and what in finished.err and "Traceback" not in finished.err


def test_submit_with_a_key(tmp_path, monkeypatch):
    (tmp_path / "a.fmu").write_bytes(fmu())
    with served(tmp_path / "data", SOME, FAKE) as url:
        finished = call("submit", "a.fmu", "--to", url, folder=tmp_path)
        assert finished.code == 2 and "BENCHMARK_KEY" in finished.err
        database = Database(Files(tmp_path / "data").database)
        monkeypatch.setenv("BENCHMARK_KEY", accounts.invited(database, "Ada"))
        database.close()
        assert call("submit", "a.fmu", "--to", url, folder=tmp_path).code == 0


def test_people_are_invited_listed_and_removed_on_the_command_line(tmp_path):
    place = ("--data", "data")
    link = call("serve", *place, "--invite", "Ada", "--url", "https://bench.example.org/", folder=tmp_path)
    assert re.fullmatch(r"https://bench\.example\.org/join#[0-9a-f]{24}\.[\w-]{43}\n", link.out), link
    assert call("serve", *place, "--people", folder=tmp_path).out == "Ada\n"
    wrongs = ("bench", "bench.example.org:8080", "https://", "ftp://bench", "https://bench.example.org/path")
    for wrong in (*wrongs, "https://bench example.org", "https://bench:99999", "https://[::1"):
        refused = call("serve", *place, "--invite", "Ben", "--url", wrong, folder=tmp_path)
        assert refused.code == 2 and "no address such as" in refused.err, wrong
    slip = call("serve", *place, "--organizer", "ada", folder=tmp_path)
    assert slip.code == 2 and "nobody called ada" in slip.err and "--people" in slip.err
    assert call("serve", *place, "--remove", "Ada", folder=tmp_path).code == 0
    assert call("serve", *place, "--remove", "Ada", folder=tmp_path).code == 2
    assert call("serve", *place, "--people", folder=tmp_path).out == "nobody was invited\n"
    assert os.stat(tmp_path / "data").st_mode & 0o077 == 0


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("--host", "0.0.0.0"), "Give --accounts"),
        (("--host", "::"), "Give --accounts"),
        (("--host", "ä..x", "--accounts", "--trust"), "cannot be listened on"),
        (("--protocol", "nowhere"), "nowhere"),
        (("--data", "/proc/nowhere"), "cannot be written"),
        (("--invite", "<b>"), "cannot be a name"),
    ],
)
def test_serve_refuses_what_would_be_open_to_all_or_cannot_be(words, what, tmp_path):
    finished = call("serve", "--trust", "--port", "0", *words, folder=tmp_path)
    assert finished.code == 2 and what in finished.err and "Traceback" not in finished.err


def test_the_name_of_the_extra_is_said_where_it_is_missing(tmp_path, monkeypatch):
    from orchestrator.cli import serve

    monkeypatch.setattr(serve, "find_spec", lambda name: None)
    finished = call("serve", folder=tmp_path)
    assert finished.code == 2 and "flexible-manipulator-benchmark[service]" in finished.err


def test_commands_say_so_without_the_packages_of_the_extra(tmp_path):
    """In a process where none of them can be imported."""
    blocked = "import sys; sys.modules.update(dict.fromkeys(('starlette', 'uvicorn')))"
    code = f"{blocked}; from orchestrator.cli.guard import run; sys.exit(run(sys.argv[1], sys.argv[2:]))"

    def run(*words: str) -> subprocess.CompletedProcess:
        return subprocess.run([sys.executable, "-c", code, *words], cwd=tmp_path, capture_output=True, text=True)

    assert run("serve").returncode == 2 and "[service]" in run("serve").stderr
    assert run("serve", "--help").returncode == 0 and run("serve", "--invite", "Ada").returncode == 0
    assert "does not answer" in run("submit", __file__, "--to", "http://127.0.0.1:9").stderr


def test_several_people_need_a_sandbox(monkeypatch):
    from orchestrator import InputError
    from orchestrator.cli.serve import fenced
    from orchestrator.execution import sandbox_probe

    def none():
        raise InputError("There is no bubblewrap.", "no-sandbox")

    monkeypatch.setattr(sandbox_probe, "leaks", none)
    with pytest.raises(InputError) as refused:
        fenced(trust=False, several=True)
    assert refused.value.what == "no-fence"
    assert fenced(trust=False, several=False)[0] is False and fenced(trust=True, several=True)[1]
    monkeypatch.setattr(sandbox_probe, "leaks", lambda: ())
    assert fenced(trust=False, several=True) == (True, "")
