"""Forms that come in, and files and sentences that go out."""

from __future__ import annotations

import asyncio
import os
import re
import time
from collections.abc import AsyncGenerator, Mapping
from pathlib import Path
from typing import IO
from urllib.parse import parse_qsl

from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from .borders import Refusal
from .people import sent

MAX_FIELDS = 2000
"""Fields of a form: two for each connector, and one for each variable that is given a value."""

MAX_SENTENCE = 1000
"""Longest sentence that says why something was not done. It may repeat what was sent: 260 answers of 8 MB that nobody
read took 1.7 GB."""

PIECE_BYTES = 1 << 18

SLICE_BYTES, SLICE_TIME = 1 << 13, 0.005

NO_FORM = re.compile(rb"[^\x00-\x7f]|%(?![0-9A-Fa-f]{2})")
"""What is in no form. Of both, 64 kB took Python's parser 0.13 s, and of all else 0.02 s at the most."""


async def form_fields(request: Request) -> list[tuple[str, str]]:
    """The fields of a form in their order; raises :class:`.Refusal` for one that is too large, or none."""
    # Here, and not in a thread. There forms of 1.5 MB stood in one line: others waited for 109 s behind one person's.
    return split(await sent(request))


def split(text: bytes) -> list[tuple[str, str]]:
    """The fields that a form spells; raises :class:`.Refusal` for too many, and for what is no form."""
    if NO_FORM.search(text):
        raise Refusal(400, "This is no form: other signs than those of ASCII are spelled by % and two digits.")
    try:
        return parse_qsl(text.decode("ascii"), max_num_fields=MAX_FIELDS, keep_blank_values=True)
    except ValueError:
        raise Refusal(400, "This form has too many fields.") from None


async def sliced(pieces: AsyncGenerator[bytes, None], gate: asyncio.Lock) -> AsyncGenerator[bytes, None]:
    """The same bytes in slices, with a pause for everybody else after SLICE_TIME of work with them; of all uploads, one
    passes the ``gate`` in a turn of the loop.

    The parser of uploads takes blanks behind a boundary, and much else, byte by byte, while everybody waits: 8 kB take
    4 ms. In pieces as they come, which have up to 300 kB, four uploads had each page wait for a second. A pause after
    each slice had an upload of 20 MB, which takes a second, last for 65 s beside somebody who asked for many pages; it
    is 38 s now, since the parser waits for a thread with each slice that it stores.
    """
    worked = 0.0
    async for piece in pieces:
        for first in range(0, len(piece), SLICE_BYTES):
            if worked >= SLICE_TIME:
                async with gate:
                    await asyncio.sleep(0)
                worked = 0.0
            begin = time.monotonic()
            yield piece[first : first + SLICE_BYTES]
            worked += time.monotonic() - begin


def file_answer(file: Path, kind: str, name: str = "", headers: Mapping[str, str] | None = None) -> Response:
    """A file of the type ``kind``, to be saved as ``name`` if there is one; raises :class:`.Refusal` if it is gone."""
    try:
        # Opened before the answer begins, which Starlette's own does not: its run may be deleted in between.
        stream = file.open("rb")
    except FileNotFoundError:
        raise Refusal(404, "There is no such file any more.") from None
    except OSError as problem:
        raise Refusal(503, f"This file cannot be read on the service's machine: {problem.strerror}.") from None
    told = {"content-length": str(os.fstat(stream.fileno()).st_size), **(headers or {})}
    if name:
        told["content-disposition"] = f'attachment; filename="{name}"'
    return _FileAnswer(stream, told, kind)


class _FileAnswer(StreamingResponse):
    """What an open file holds. It is closed by the answer, since a client that leaves ends no iterator: 300 of them
    left 300 files open."""

    def __init__(self, stream: IO[bytes], headers: Mapping[str, str], kind: str) -> None:
        super().__init__(iter(lambda: stream.read(PIECE_BYTES), b""), headers=headers, media_type=kind)
        self._stream = stream

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        with self._stream:
            await super().__call__(scope, receive, send)


def cut(sentence: str) -> str:
    """A sentence of bounded length."""
    return sentence if len(sentence) <= MAX_SENTENCE else f"{sentence[:MAX_SENTENCE]} ..."
