"""The commands of the tutorials run as they stand there, with protocols of one pose and smaller searches."""

import glob
import re
from pathlib import Path

import pytest
from support.command_lines import called
from support.pages import command_lines, simple_commands, text

from orchestrator.cli.main import main

SMALLER = {
    "evaluate": ("--protocol", "paper.toml"),
    "robustness": (
        *("--no-list", "--only", "B5", "--budget", "40"),
        *("--output-dir", "runs/DiagonalPID-strict-robustness"),
    ),
    "sweep": ("--protocol", "tuning.toml"),
    "tune": ("--protocol", "paper.toml", "--objective", "tuning.toml", "--trials", "2"),
}
"""Options that a command gets besides those of the page, which they override."""

ONE_POSE = "[grid]\nq_a1_points = 1\nq_a2_points = 1\nalso_deg = []\n"
NO_STABILITY = '[selection]\nposes = [0]\ntests = ["noise", "disturbance"]\n'
PROTOCOLS = {
    "quick": f'extends = "quick"\nname = "quick"\n{ONE_POSE}',
    "paper": f'extends = "quick"\nname = "paper"\n{ONE_POSE}{NO_STABILITY}',
    "tuning": f'extends = "tuning"\nname = "tuning"\n{ONE_POSE}{NO_STABILITY}',
}

PAGES = [
    "tutorial-evaluate.md",
    "tutorial-compare.md",
    "tutorial-worst-case.md",
    "teaching.md",
    pytest.param("tutorial-tune.md", marks=pytest.mark.needs("optuna", "cmaes")),
]


def smaller(words: list[str], folder: Path) -> list[str]:
    """A command with a smaller protocol or search, and its patterns of files replaced by what they stand for."""
    found = [
        name
        for word in words
        for name in (sorted(glob.glob(word, root_dir=folder)) if "*" in word and "[" not in word else [word])
    ]
    if "--quick" in found:
        return [word for word in found if word != "--quick"] + ["--protocol", "quick.toml"]
    return found + list(SMALLER.get(found[0], ()))


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_the_commands_of_a_tutorial_run_and_write_what_it_says(name: str, tmp_path: Path) -> None:
    for protocol, contents in PROTOCOLS.items():
        (tmp_path / f"{protocol}.toml").write_text(contents)
    page = text(f"docs/{name}")
    for program, *words in (words for line in command_lines(page, ["sh"]) for words in simple_commands(line)):
        assert program == "flexible-manipulator"
        finished = called(main, *smaller(words, tmp_path), folder=tmp_path)
        assert finished.code == 0, (words, finished.out, finished.err)
    for path in re.findall(r"`((?:runs|my_controller)/[^`*]+)`", page):
        assert (tmp_path / path).exists(), path
