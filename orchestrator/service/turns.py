"""Turns: everybody's requests are answered by one thread, and nobody has more than one at a time of its turns."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from weakref import WeakValueDictionary

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from ..errors import BenchmarkError
from .borders import short_answer
from .people import person_asking

MAX_WAITING = 20
"""Requests of one person that wait for their turn. Those of clients that left wait, too, and the server counts them:
one person, with one connection at a time, had everybody else told that the service is not available."""

MAX_FROM_ADDRESS, MAX_STRANGERS = 40, 100
"""The same of strangers from one address, where a whole class may sit, and of all strangers together."""

BUSY = "Too many requests of yours are waiting. Come again in a second."


@dataclass(eq=False)
class Line:
    """Who waits for the same turns: ``waiting`` requests, and ``most`` at a time."""

    most: int
    waiting: int = 0
    gate: asyncio.Lock = field(default_factory=asyncio.Lock)


class Turns:
    """Middleware around the application: in each turn of the loop one request of each person begins, and one of all
    strangers together. What waits is bounded: who has too many requests waiting is told to come again.

    Else all that are there begin in the same turn, and another person's, which takes some turns, waits for each of
    them: 100 connections of one stranger, with a page of 6 ms, had others wait for 14 s, and for 0.1 s by this.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        # A line lives as long as somebody stands in it.
        self._by_name: WeakValueDictionary[str, Line] = WeakValueDictionary()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request begin when it is its turn."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        lines = self._lines(scope)
        if any(line.waiting >= line.most for line in lines):
            answer = short_answer(scope, 429, BUSY, {"retry-after": "1", "connection": "close"})
            await answer(scope, receive, send)
            return
        for line in lines:
            line.waiting += 1
        try:
            async with lines[0].gate:
                await asyncio.sleep(0)
        finally:
            for line in lines:
                line.waiting -= 1
        await self._app(scope, receive, send)

    def _lines(self, scope: Scope) -> list[Line]:
        """In which lines a request stands. The first one has the gate."""
        try:
            person = person_asking(Request(scope))
        except BenchmarkError:  # of the database, which the answer tells
            person = None
        if person is not None:
            return [self._line(f"person {person.id}", MAX_WAITING)]
        address, _ = scope.get("client") or ("", 0)
        return [self._line("strangers", MAX_STRANGERS), self._line(f"address {address}", MAX_FROM_ADDRESS)]

    def _line(self, name: str, most: int) -> Line:
        return self._by_name.setdefault(name, Line(most))
