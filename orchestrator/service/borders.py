"""What every request passes: who may ask from where, and which headers every answer has.

A browser sends requests for any page that its user looks at. So nothing changes by GET, and what changes something must
come from a page of this service.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Mapping
from urllib.parse import SplitResult, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .accounts import is_loopback

READING = ("GET", "HEAD", "OPTIONS")

MAX_FORM = 64 * 1024
"""Largest request [bytes] that is no upload: everybody waits while it is read. The form of a binding has 45 kB where it
offers as many variables as it can, with names of 60 letters and values of 17. As JSON, 1.5 MB of numbers took 5 s."""

MAX_KEY_FORM = 4096
"""The same of a stranger [bytes], of whom there may be hundreds: what they send is in memory until it is whole."""

KEY_TIME = 3.0
"""Seconds that a stranger's request may take: as many as there may be connections lock everybody out meanwhile."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "connect-src 'self'; frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
"""Of the service's own pages: no script but the one file. Styles stand in attributes as well, as in reports."""

REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""Of reports: a page of its own, without this service's cookies or address, also if it is opened by itself. Its scripts
are those whose hashes stand in the policy that it has inside."""

HEADERS = {
    "x-content-type-options": "nosniff",
    # Not "no-referrer", with which browsers say of a form's page that its origin is "null".
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class Refusal(Exception):
    """A request that is not done, with the HTTP ``status`` and a sentence."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class Borders:
    """Middleware around the whole application; ``local`` is a service without accounts."""

    def __init__(self, app: ASGIApp, local: bool) -> None:
        self._app, self._local = app, local

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request pass, or say why not."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        problem = refusal(scope["method"], Headers(scope=scope), self._local)

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in {**HEADERS, "content-security-policy": POLICY}.items():
                    headers.setdefault(name, value)
            await send(message)

        if problem:
            await short_answer(scope, 403, problem, closing(scope["method"]))(scope, receive, send)
            return
        await self._app(scope, receive, with_headers)


def short_answer(scope: Scope, status: int, sentence: str, headers: Mapping[str, str]) -> Response:
    """A refusal that needs no page: JSON for a program, and text for a person."""
    told = {**HEADERS, "content-security-policy": POLICY, **headers}
    if scope["path"].startswith("/api/"):
        return JSONResponse({"error": sentence}, status, told)
    return PlainTextResponse(f"{sentence}\n", status, told)


def closing(method: str) -> dict[str, str]:
    """Headers of a refusal: it ends the connection, on which the rest of a body could come for ever."""
    return {} if method in READING else {"connection": "close"}


def refusal(method: str, headers: Headers, local: bool) -> str:
    """Why a request must not pass; empty if it may."""
    host = headers.get("host", "")
    # A name that an attacker has pointed at this machine ("DNS rebinding") would make their page one of this service.
    if local and not is_loopback(_parts(f"//{host}").hostname or ""):
        return "This service has no accounts, and answers on this machine only: open it as http://127.0.0.1."
    origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
    if method in READING:
        # A page elsewhere may link here. What it loads in secret takes places of whoever looks at it, as live pages do.
        if site in ("cross-site", "same-site") and headers.get("sec-fetch-mode") != "navigate":
            return "This request comes from another site's page."
        return ""
    if (origin is not None and _parts(origin).netloc != host) or site not in ("same-origin", "none"):
        return "This request comes from another site's page."
    if origin is None and "cookie" in headers:  # every browser says where a change comes from
        return "This request does not say which page it comes from."
    return ""


def _parts(address: str) -> SplitResult:
    """The parts of an address; those of nothing if it is none, such as one with half a bracket."""
    try:
        return urlsplit(address)
    except ValueError:
        return urlsplit("")


async def body(request: Request, most: int, patience: float, time: float) -> AsyncGenerator[bytes, None]:
    """The pieces of a request's body.

    Raises :class:`Refusal` for more than ``most`` bytes, for a client that is silent for ``patience`` [s], and for a
    body that takes longer than ``time`` [s]: who sends one byte a second would else keep a place for ever.
    """
    stated = request.headers.get("content-length", "0")
    too_large = Refusal(413, f"This is larger than the {spelled_size(most)} that are taken.")
    if not stated.isdecimal() or int(stated[:20]) > most:
        raise too_large
    size, pieces, clock = 0, request.stream(), asyncio.get_running_loop().time
    end = clock() + time
    while True:
        try:
            # From the end on, not even what is there already: who never paused had no end.
            piece = await asyncio.wait_for(anext(pieces), min(patience, end - clock()))
        except StopAsyncIteration:
            return
        except asyncio.TimeoutError:
            raise Refusal(408, "The upload has stopped, or takes too long. Nothing of it is kept.") from None
        size += len(piece)
        if size > most:
            raise too_large
        yield piece


def spelled_size(size: float) -> str:
    """A number of bytes, for a person."""
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"


async def whole_body(request: Request, most: int, patience: float, time: float) -> bytes:
    """A small body at once; raises as :func:`body`."""
    return b"".join([piece async for piece in body(request, most, patience, time)])


async def key_body(request: Request) -> bytes:
    """That of a stranger, who has brought a key or none; raises as :func:`body`."""
    return await whole_body(request, MAX_KEY_FORM, KEY_TIME, KEY_TIME)
