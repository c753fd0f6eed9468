"""What a command prints (a summary, JSON, or tables for a paper), and its exit code."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..codec import to_json
from ..documents.document import Completeness, Displayable
from ..text import printable
from ..views.export import FORMS
from ..views.table import Summary
from ..views.terminal import show, terminal
from .guard import EXIT_INCOMPLETE, EXIT_NOT_JUDGED, EXIT_OK
from .values import Parser

EXITS: dict[Completeness, int] = {"complete": EXIT_OK, "incomplete": EXIT_INCOMPLETE, "not judged": EXIT_NOT_JUDGED}


def add_options(parser: Parser, json: str, forms: bool = True) -> argparse._MutuallyExclusiveGroup:
    """Options for what is printed; they exclude each other.

    ``json`` describes the document that ``--json`` prints; ``forms`` are the forms of tables for a paper.
    """
    parser.set_defaults(form=None)
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument("--json", action="store_true", help=f"print {json} instead of tables")
    for form, (words, _) in FORMS.items() if forms else ():
        shown.add_argument(f"--{form}", action="store_const", const=form, dest="form", help=f"print tables in {words}")
    return shown


def add_dry_run(options: argparse._ActionsContainer, what: str) -> None:
    """Add the option ``--dry-run`` to ``options``."""
    options.add_argument("--dry-run", action="store_true", help=f"print {what}, and do nothing")


def put(shown: Displayable | Summary, given: argparse.Namespace, document: Any = None) -> None:
    """Print ``shown`` in the form that was asked for; as JSON, print ``document`` instead if there is one."""
    if given.json:
        print(to_json(shown if document is None else document))
        return
    summary = shown if isinstance(shown, Summary) else shown.summary()
    if given.form:
        print(FORMS[given.form][1](summary.tables))
    else:
        show(summary, terminal())


def add_files(parser: Parser) -> None:
    """Options of a command whose result is the files that it writes."""
    add_dry_run(add_options(parser, "the files written", forms=False), "which files would be written")


def put_files(files: Iterable[Path], given: argparse.Namespace) -> int:
    """Print the files that were written, or would be; returns the exit code."""
    listed = [str(file) for file in files]
    print(to_json({"written": listed}) if given.json else printable("\n".join(listed)))
    return EXIT_OK


def tell_written(folder: Path, names: Iterable[str]) -> None:
    """Name on standard error the files that were written."""
    # Names of files may hold control characters, by which a stranger's archive could rewrite the terminal.
    print(printable(f"written to {folder}: {', '.join(names) or 'nothing'}"), file=sys.stderr)


def shown_code(completeness: Completeness) -> int:
    """The exit code of a command that shows finished results: whether a requirement is not judged."""
    return EXIT_NOT_JUDGED if completeness == "not judged" else EXIT_OK


def free(folder: Path) -> Path:
    """``folder``, or the first of ``folder-2``, ``folder-3``, ... that does not exist: nothing is overwritten."""
    number = 2
    candidate = folder
    while candidate.exists():
        candidate, number = folder.with_name(f"{folder.name}-{number}"), number + 1
    return candidate
