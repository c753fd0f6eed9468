"""Forms that come in, and files and sentences that go out."""

from __future__ import annotations

import os
import re
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

PARAMETER = re.compile(r';[ \t]*([a-z]+)[ \t]*=[ \t]*(?:"([^"]*)"|([^\s;"]*))', re.IGNORECASE)
DISPOSITION = re.compile(r"\r\nContent-Disposition:[ \t]*form-data[ \t]*(;[^\r\n]*)", re.IGNORECASE)
MAX_BOUNDARY = 70
"""Longest boundary of a form (RFC 2046)."""

MAX_PART_HEAD = 4096
NO_UPLOAD = "This is no upload: a form has one field, a file."

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


async def uploaded_file(kind: str, pieces: AsyncGenerator[bytes, None]) -> tuple[str, AsyncGenerator[bytes, None]]:
    """The name and the pieces of the file in a form that has this one field (RFC 7578), of the content type ``kind``.

    Both raise :class:`.Refusal` for what is no such form. The parser that comes with Starlette takes much of a form
    byte by byte while everybody waits (four uploads had each page wait for a second), and a charset that takes minutes;
    with its pauses, and a copy of the file for each upload, 20 MB took 38 s beside somebody who asks for many pages.
    """
    boundary = _parameters(kind).get("boundary", "")
    if not kind.lower().startswith("multipart/form-data") or not 0 < len(boundary) <= MAX_BOUNDARY:
        raise Refusal(400, NO_UPLOAD)
    line = b"\r\n--" + boundary.encode("latin-1", "replace")
    received, begin, end = b"\r\n", -1, -1  # before the first boundary there may be no line
    async for piece in pieces:
        received += piece
        begin = received.find(line + b"\r\n")
        end = received.find(b"\r\n\r\n", begin + len(line)) if begin >= 0 else -1
        if end >= 0 or len(received) > MAX_PART_HEAD:
            break
    head = received[begin : end + 2] if 0 <= end <= MAX_PART_HEAD else b""
    field = DISPOSITION.search(head.decode("utf-8", "replace"))
    named = _parameters(field[1]) if field else {}
    if named.get("name") != "file" or "filename" not in named:
        raise Refusal(400, NO_UPLOAD)
    if not named["filename"]:
        raise Refusal(400, "Choose an FMU first.")
    return named["filename"].replace("%22", '"'), _until(line, received[end + 4 :], pieces)


def _parameters(text: str) -> dict[str, str]:
    """What stands behind a header's value, such as ``; boundary=x``, with or without quotation marks."""
    return {match[1].lower(): match[2] or match[3] or "" for match in PARAMETER.finditer(text)}


async def _until(line: bytes, received: bytes, pieces: AsyncGenerator[bytes, None]) -> AsyncGenerator[bytes, None]:
    """What comes before the boundary ``line``, which has to be the last one."""
    while (end := received.find(line)) < 0 or len(received) < end + len(line) + 2:
        sure = len(received) - len(line) - 2 if end < 0 else end
        if sure > 0:
            yield received[:sure]
            received = received[sure:]
        try:
            received += await anext(pieces)
        except StopAsyncIteration:
            raise Refusal(400, "The upload ends before its last boundary. Nothing of it is kept.") from None
    if received[end + len(line) :][:2] != b"--":
        raise Refusal(400, NO_UPLOAD)
    yield received[:end]
    async for _ in pieces:  # else a client that still sends loses the answer
        pass


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
