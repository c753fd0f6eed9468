"""The commands in the code of the documentation's pages, and what they are when they are pasted into a shell."""

import re
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

PAGES = sorted(
    str(page.relative_to(ROOT))
    for folder in ("docs", "examples", "controller_fmu", "plant_fmu", ".")
    for page in (ROOT.glob("*.md") if folder == "." else (ROOT / folder).rglob("*.md"))
    if page.name != "CHANGELOG.md"
)

PROGRAMS = (
    *("flexible-manipulator", "python", "python3", ".venv/bin/python", ".venv/bin/pip", "pip", "pre-commit"),
    *("sphinx-build", "git", "cp", "sudo", "apt-get", ".", "eval", "curl", "dask", "OMSimulator"),
)
"""What a line for a shell begins with. It stands in a block of the language ``sh``, ``bash`` or ``console``, or in one
without a language that begins with such a line."""


def text(name: str) -> str:
    """A file of the repository."""
    return (ROOT / name).read_text(encoding="utf-8")


def command_lines(page: str, languages: Sequence[str] = ("sh", "bash", "console", "")) -> list[str]:
    """All lines of the blocks for a shell in the text of a page, each with those that it goes on in; no comments."""
    return [line for block in _blocks(page, languages) for line in _joined(block)]


def simple_commands(line: str) -> list[list[str]]:
    """The words of each command of a line, which ``&&``, ``|`` or ``;`` divides; its comment is left out."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars="&|;")
    lexer.whitespace_split, lexer.commenters = True, "#"
    found: list[list[str]] = [[]]
    for word in lexer:
        if word and set(word) <= set("&|;"):
            found.append([])
        else:
            found[-1].append(word)
    return [words for words in found if words]


def _blocks(page: str, languages: Sequence[str]) -> Iterator[list[str]]:
    """The lines of each block for a shell in one of the ``languages``; "" is a block without one."""
    language: str | None = None
    lines: list[str] = []
    for line in [*page.splitlines(), ""]:
        fence = re.match(r"\s*```(\w*)", line)
        if fence or (language is None and not line.startswith("    ")):
            if (language or "") in languages and (language or (lines and _is_command(lines[0]))):
                yield lines
            language, lines = fence[1] if fence and language is None else None, []
        else:
            lines.append(line.strip())


def _is_command(line: str) -> bool:
    return line.partition(" ")[0] in PROGRAMS or re.match(r"[A-Z_]+=", line) is not None


def _joined(lines: list[str]) -> Iterator[str]:
    whole = ""
    for line in lines:
        whole = f"{whole} {line}".strip()
        if whole.endswith("\\"):
            whole = whole[:-1].rstrip()
        elif not _unfinished(whole):
            if whole and not whole.startswith("#"):
                yield whole
            whole = ""
    assert not whole, f"a quote is left open: {whole}"


def _unfinished(line: str) -> bool:
    """Whether a command goes on in the next line, as one with an open quote does."""
    try:
        shlex.split(line, comments=True)
    except ValueError:
        return True
    return False
