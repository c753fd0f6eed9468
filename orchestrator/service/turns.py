"""Turns: everybody's requests are answered by one thread, and nobody has more than one at a time of its turns."""

from __future__ import annotations

import asyncio
from weakref import WeakValueDictionary

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from ..errors import BenchmarkError
from .people import person_asking


class Turns:
    """Middleware around the application: in each turn of the loop one request of each person begins, and one of all
    strangers together.

    Else all that are there begin in the same turn, and another person's, which takes some turns, waits for each of
    them: 100 connections of one stranger, with a page of 6 ms, had others wait for 14 s, and for 0.1 s by this.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._gates: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request begin when it is its turn."""
        if scope["type"] == "http":
            try:
                person = person_asking(Request(scope))
            except BenchmarkError:  # of the database, which the answer tells
                person = None
            # It lives as long as somebody waits at it.
            gate = self._gates.setdefault("" if person is None else person.id, asyncio.Lock())
            async with gate:
                await asyncio.sleep(0)
        await self._app(scope, receive, send)
