"""What the standard finds wrong with a description: FMPy's validation, summed up.

FMPy parses names of the structured convention with a grammar, which takes milliseconds for each. A regular expression
of the same language takes microseconds; it is used instead.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import fmpy
from fmpy.model_description import ModelDescription, ValidationError

from ..fmi.description import uncollected

FIRST, KINDS, LONGEST = 3, 10, 500
"""Problems of one kind that are named, kinds that are, and characters of a problem."""

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
_QUOTED = r"""'(?:[A-Za-z0-9_!#$%&()*+,./:;<=>?@\[\]^{}|~ -]|\\['"?\\abfnrtv])+'"""
_INDICES = r"(?:\[[0-9]+(?:,[0-9]+)*\])?"
_PART = rf"(?:{_NAME}|{_QUOTED}){_INDICES}"
_IDENTIFIER = rf"{_PART}(?:\.{_PART})*"
STRUCTURED = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(?:,[0-9]+)?\)")
"""Names of the structured convention, FMI 2.0.4, section 2.2.9, and FMI 3.0, section 2.4.7.5.1."""

_OWN_WORDS = re.compile(r"\"[^\"]*\"|'[^']*'|[0-9]+")
"""What differs between problems of one kind."""


def validation_problems(file: Path, description: ModelDescription) -> list[str]:
    """What is wrong with the FMU ``file``, which has this ``description``; empty if nothing is."""
    return [*_backslashes(file), *_illegal_names(description), *_invalid(file)]


def summed_up(problems: Sequence[str]) -> Iterator[str]:
    """One text for the problems of each kind: the first few, and how many more there are."""
    kinds: dict[str, list[str]] = {}
    for problem in problems:
        kinds.setdefault(_OWN_WORDS.sub("", problem), []).append(problem)
    for alike in list(kinds.values())[:KINDS]:
        more = [f"and {len(alike) - FIRST} more of this kind"] if len(alike) > FIRST else []
        yield "\n".join((*(problem[:LONGEST] for problem in alike[:FIRST]), *more))
    if len(kinds) > KINDS:
        left = sum(map(len, list(kinds.values())[KINDS:]))
        yield f"{left} more problems of {len(kinds) - KINDS} more kinds"


def _backslashes(file: Path) -> list[str]:
    with zipfile.ZipFile(file) as archive:
        names = [member.orig_filename for member in archive.infolist()]
    return [f'The file path "{name}" contains a backslash.' for name in names if "\\" in name]


def _illegal_names(description: ModelDescription) -> list[str]:
    names = [variable.name for variable in description.modelVariables]
    if description.variableNamingConvention == "structured":
        illegal = (name for name in names if not STRUCTURED.fullmatch(name))
        return [f'"{name}" is not a legal variable name for the naming convention "structured".' for name in illegal]
    illegal = (name for name in names if re.search(r"[\r\n\t]", name))
    return [f'The variable name "{" ".join(name.split())}" has a tab or a line end.' for name in illegal]


def _invalid(file: Path) -> list[str]:
    try:
        with uncollected():  # as for read_description
            fmpy.read_model_description(str(file), validate=True, validate_model_structure=True)
    except ValidationError as invalid:
        problems = invalid.problems
    except Exception as failure:  # FMPy's validation itself trips over some descriptions
        problems = [str(failure) or type(failure).__name__]
    else:
        return []
    lines = [line for problem in problems for line in problem.splitlines() if not line.endswith(":")]
    return [" ".join(line.split()) for line in lines if line.strip()]
