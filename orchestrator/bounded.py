"""Reading files that a user names, or that a stranger has made: no more of them than can be meant.

A device never ends, a pipe may never begin, and TOML of a few kilobytes can take gigabytes: the parser keeps every
beginning of a key of many parts.
"""

from __future__ import annotations

import errno
import os
import re
import stat
import sys
from pathlib import Path
from typing import Any

from .errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MAX_TEXT_BYTES = 4 * 1024**2
"""Largest size [bytes] of a file that a user writes: mappings, parameters, protocols."""

MAX_RESULT_BYTES = 256 * 1024**2
"""Largest size [bytes] of a file of results."""

MAX_DEPTH = 32
"""Most parts of a key in TOML, and most arrays and tables within each other."""

_TOKENS = re.compile(
    r'''"""(?:\\.?|[^\\"]|"(?!""))*(?:"""|\Z)|\'\'\'(?:[^']|'(?!''))*(?:\'\'\'|\Z)'''
    r"""|"(?:\\.?|[^"\\\n])*"?|'[^'\n]*'?|\#[^\n]*|[\w+-]+|[\ \t]+|.""",
    re.DOTALL,
)
"""Texts, comments, words, blanks, and single characters. Each is found without a second try, so in linear time."""


def read(file: Path, most: int = MAX_TEXT_BYTES, what: str = "no-file") -> bytes:
    """The contents of a regular file of at most ``most`` bytes.

    Raises :class:`InputError` with the code ``what`` if it cannot be read, and with the code ``"file-limit"`` if it is
    larger.
    """
    try:
        # Not to block: opening a pipe waits for one who writes.
        opened = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with os.fdopen(opened, "rb") as stream:
            # Of what is open: between a look at the name and the opening, the file could be another.
            mode = os.fstat(opened).st_mode
            if not stat.S_ISREG(mode):
                raise OSError(errno.ENOTSUP, "it is a device, a pipe or a socket")
            # One more than the limit shows that there is more; the size that a file states may be 0, as in /proc.
            content = stream.read(most + 1)
    except OSError as problem:
        raise InputError(f"{file} cannot be read: {problem.strerror}.", what, file) from problem
    if len(content) > most:
        message = f"{file} is larger than the {most} bytes that are read of such a file."
        raise InputError(message, "file-limit", file)
    return content


def read_toml(file: Path, what: str = "bad-file") -> dict[str, Any]:
    """The tables of a TOML file; raises :class:`InputError`, with the code ``what`` if it is none."""
    try:
        text = read(file).decode()
        if _too_deep(text):
            raise ValueError(f"a key has more than {MAX_DEPTH} parts, or more than {MAX_DEPTH} brackets are open")
        return dict(tomllib.loads(text))
    except ValueError as problem:  # TOMLDecodeError, text that is not UTF-8, a number of thousands of digits
        raise InputError(f"{file} is not a TOML file: {problem}.", what, file) from None


def _too_deep(text: str) -> bool:
    """Whether a key of ``text`` has more parts, or arrays and tables are deeper within each other, than MAX_DEPTH."""
    dots = brackets = 0
    for match in _TOKENS.finditer(text):
        token = match.group()
        if token == ".":
            dots += 1
        elif not (token[0] in "\"' \t" or token[0].isalnum() or token[0] in "_+-"):
            dots = 0
            brackets += (token in "[{") - (token in "]}")
        # TOML nested 50,000 deep was a RecursionError; a key of 60,000 dots took 27 s and 8.7 GB.
        if max(dots, brackets) > MAX_DEPTH:
            return True
    return False
