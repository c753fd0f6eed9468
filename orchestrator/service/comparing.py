"""The ordinary comparison of finished runs, in a process of its own: reading results takes memory that stays."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import sys
from asyncio.subprocess import DEVNULL, PIPE
from collections.abc import Sequence
from pathlib import Path

from ..documents.compare_page import FILE
from ..documents.comparison import grouped
from ..documents.evaluation import Evaluation
from ..documents.files import prepare_folder
from ..text import printable
from .borders import Refusal
from .files import Files, is_file
from .runner import environment

logger = logging.getLogger(__name__)

TIME = 120.0
"""Seconds that a comparison may take."""


async def compared(files: Files, id: str, folders: Sequence[Path]) -> None:
    """Write the page that compares the evaluations in ``folders``; raises :class:`Refusal` if that fails."""
    place = files.comparison(id)
    if is_file(place / FILE):
        return
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", __name__, str(place), *map(str, folders)),
        stdin=DEVNULL,
        stdout=DEVNULL,
        stderr=PIPE,
        env=environment(files, sandbox=True),
    )
    try:
        _, said = await asyncio.wait_for(process.communicate(), TIME)
    except asyncio.TimeoutError:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        raise Refusal(503, "The comparison took too long.") from None
    if not is_file(place / FILE):
        logger.error("A comparison has failed: %s", printable(said[-2000:]))
        raise Refusal(500, "These runs could not be compared: the results of one are damaged. Begin again with it.")


def main(place: Path, folders: Sequence[Path]) -> None:
    """Write the page into the folder ``place``."""
    prepare_folder(place)
    grouped([(Evaluation.load(folder), folder) for folder in folders]).report(place / FILE)


if __name__ == "__main__":
    main(Path(sys.argv[1]), [Path(word) for word in sys.argv[2:]])
