"""The closed list of reasons for which a test may be skipped."""

import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from support.tools import PRESENT, TOOLS

TESTS = Path(__file__).parent

SUITE = """
import pytest
from support import tools

MISSING = tools.Tool("needs a tool that nobody has", lambda: False)
tools.TOOLS, tools.PRESENT = {"anvil": MISSING, "pytest": MISSING}, {"anvil": False, "pytest": True}
tools.REASONS = frozenset({MISSING.reason})

@pytest.mark.needs("pytest")
def test_that_runs():
    pass

@pytest.mark.needs("pytest", "anvil")
def test_that_is_marked():
    raise AssertionError

@pytest.fixture
def shaped():
    tools.require("anvil")

def test_whose_fixture_needs_it(shaped):
    raise AssertionError
"""

OTHERS = {
    "by_hand": "def test_it():\n    pytest.skip('no time')\n",
    "by_mark": "@pytest.mark.skip(reason='no time')\ndef test_it(): pass\n",
    "by_condition": "@pytest.mark.skipif(True, reason='no time')\ndef test_it(): pass\n",
    "in_a_fixture": "@pytest.fixture\ndef late(): pytest.skip('no time')\ndef test_it(late): pass\n",
    "as_an_expected_failure": "@pytest.mark.xfail\ndef test_it(): assert False\n",
    "for_a_tool_that_is_there": "def test_it():\n    pytest.skip('needs Python')\n",
    "by_a_missing_module": "pytest.importorskip('no_such_module')\ndef test_it(): pass\n",
    "as_a_module": "pytest.skip('no time', allow_module_level=True)\n",
}


def outcome(folder: Path, files: Mapping[str, str], *options: str) -> tuple[int, dict[str, int], str]:
    """Exit code, counts by outcome, and output of a session of pytest with these test files."""
    for name, text in files.items():
        (folder / f"test_{name}.py").write_text(text)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-rs", "-p", "support.tools", "-p", "no:cacheprovider", *options],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": f"{TESTS}{os.pathsep}{TESTS.parent}", "PYTEST_ADDOPTS": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    counts = {word.rstrip("s"): int(n) for n, word in re.findall(r"(\d+) (\w+)", done.stdout.splitlines()[-1])}
    return done.returncode, counts, done.stdout


ALONE_AND_ON_WORKERS = pytest.mark.parametrize("options", [(), ("-n", "2")], ids=["alone", "on-workers"])


@ALONE_AND_ON_WORKERS
def test_a_test_is_skipped_for_a_tool_that_is_missing(options, tmp_path):
    code, counts, output = outcome(tmp_path, {"suite": SUITE}, *options)
    assert (code, counts.get("passed"), counts.get("skipped"), counts.get("failed")) == (0, 1, 2, None), output
    assert "needs a tool that nobody has" in output


@ALONE_AND_ON_WORKERS
def test_any_other_reason_is_a_failure(options, tmp_path):
    files = {name: f"import pytest\n{text}" for name, text in OTHERS.items()}
    code, counts, output = outcome(tmp_path, files, "--continue-on-collection-errors", *options)
    assert code == 1 and "skipped" not in counts and "xfailed" not in counts, output
    assert counts["failed"] + counts["error"] == len(OTHERS) and "passed" not in counts, output
    assert output.count("skipped for a reason that tests/support/tools.py does not list") == len(OTHERS)


def test_every_tool_has_a_reason_of_its_own_and_an_answer():
    assert len({tool.reason for tool in TOOLS.values()}) == len(TOOLS) == len(PRESENT)
    assert all(tool.reason.startswith("needs ") for tool in TOOLS.values())


@pytest.mark.needs("linux")
def test_the_bare_path_hides_every_program():
    """Those that are there, that is: a machine that has a compiler and bubblewrap shows that it is not empty."""
    code = "from support.tools import PRESENT; print(*(name for name in PRESENT if PRESENT[name]))"
    environment = {**os.environ, "PYTHONPATH": f"{TESTS}{os.pathsep}{TESTS.parent}"}
    words = [TESTS.parent / ".ci" / "bare-path", sys.executable, "-c", code]
    found = subprocess.run(words, env=environment, capture_output=True, text=True, check=True).stdout.split()
    programs = {"sanitizers", "bubblewrap", "wine", "chromium", "openssl", "readelf", "gcc", "clang", "latex"}
    programs |= {"g++", "musl-gcc", "qemu-aarch64", "mingw"}
    assert programs.isdisjoint(found) and ("compiler" in found) == PRESENT["ziglang"]
    assert {name for name in PRESENT if PRESENT[name]} - programs - {"compiler"} <= set(found)


def test_no_test_is_skipped_another_way():
    ways = re.compile(r"importorskip|mark\.skip|pytest\.skip|SkipTest|mark\.xfail|pytest\.xfail")
    found = [file for file in TESTS.rglob("*.py") if ways.search(file.read_text(encoding="utf-8"))]
    assert {file.name for file in found} == {"tools.py", "test_tools.py"}
