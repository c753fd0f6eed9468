"""For `.ci/run`: what passed in one run is kept, and left out in a second one where more tools are installed.

What passed had all tools that it names. Tests that need any compiler have passed with that of the package ``ziglang``,
and are not run again with gcc: where the compiler matters, tests name it (``needs("gcc")``) and compare the bits.
"""

from pathlib import Path

import pytest


def add_options(parser: pytest.Parser) -> None:
    """The options, which ``conftest.py`` declares."""
    parser.addoption("--passed-into", type=Path, help="a file that is written: the names of the tests that passed")
    parser.addoption("--but-passed", type=Path, help="such a file: these are left out")


class Passed:
    """Keeps the tests that passed, and had no error before or after, in a file."""

    def __init__(self, file: Path) -> None:
        self.file, self.passed, self.other = file, set[str](), set[str]()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Take what a part of a test came to."""
        if not report.passed:
            self.other.add(report.nodeid)
        elif report.when == "call":
            self.passed.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        """Write the file."""
        self.file.write_text("\n".join(sorted(self.passed - self.other)), encoding="utf-8")


def pytest_configure(config: pytest.Config) -> None:
    """With pytest-xdist, the processes that run tests report to the one that writes."""
    file = config.getoption("--passed-into")
    if file and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Passed(file))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what has passed."""
    file = config.getoption("--but-passed")
    passed = set(file.read_text(encoding="utf-8").split("\n")) if file else set()
    left_out = [item for item in items if item.nodeid in passed]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in set(left_out)]
