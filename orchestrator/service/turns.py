"""Turns: everybody's requests are answered by one thread, and nobody has more than one at a time of its turns."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from ipaddress import IPv6Address, ip_address
from typing import Any
from weakref import WeakValueDictionary

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from ..errors import BenchmarkError
from .borders import short_answer
from .people import person_asking

MAX_WAITING = 100
"""Requests of one person, or of strangers from one address, that wait for their turn: a quarter of the connections.
Those of a client that has left wait no longer, unless it sent more than is read before the turn."""

BUSY = "Too many requests of yours are waiting. Come again in a second."

PRESENCE = "presence"
"""Under which name the state of a request has the :class:`Presence` of its client."""


@dataclass
class Presence:
    """Whether the client of a connection is there, and the task of its request while that waits for its turn.

    A client that leaves ends no request of itself: one person, with one connection at a time, had so many wait that
    everybody else was told that the service is not available.
    """

    waiting: asyncio.Task[Any] | None = None
    has_left: bool = False

    def end(self) -> None:
        """Take note that the client has left."""
        self.has_left = True
        if self.waiting is not None:
            self.waiting.cancel()


@dataclass(eq=False)
class Line:
    """Who waits for the same turns: the first has the gate, and ``waiting`` are there with it."""

    waiting: int = 0
    gate: asyncio.Lock = field(default_factory=asyncio.Lock)


class Turns:
    """Middleware around the application: in each turn of the loop one request of each person begins, and one of all
    strangers together, whose addresses take turns. Who has too many requests waiting is told to come again.

    Else all that are there begin in the same turn, and another person's, which takes some turns, waits for each of
    them: 100 connections of one stranger, with a page of 6 ms, had others wait for 14 s, and for 0.1 s by this.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._strangers = Line()
        # A line lives as long as somebody stands in it.
        self._by_name: WeakValueDictionary[str, Line] = WeakValueDictionary()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request begin when it is its turn."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        lines = self._lines(scope)
        if lines[0].waiting >= MAX_WAITING:
            answer = short_answer(scope, 429, BUSY, {"retry-after": "1", "connection": "close"})
            await answer(scope, receive, send)
        elif await _had_turn(lines, scope.get("state", {}).get(PRESENCE) or Presence()):
            await self._app(scope, receive, send)

    def _lines(self, scope: Scope) -> list[Line]:
        """In which lines a request stands, one after the other."""
        try:
            person = person_asking(Request(scope))
        except BenchmarkError:  # of the database, which the answer tells
            person = None
        if person is not None:
            return [self._line(f"person {person.id}")]
        host, _ = scope.get("client") or ("", 0)
        return [self._line(f"network {network(host)}"), self._strangers]

    def _line(self, name: str) -> Line:
        return self._by_name.setdefault(name, Line())


async def _had_turn(lines: list[Line], presence: Presence) -> bool:
    """Wait for one's turn in all ``lines``; false if the client has left meanwhile."""
    if presence.has_left:
        return False
    presence.waiting = asyncio.current_task()
    lines[0].waiting += 1
    try:
        async with AsyncExitStack() as stack:
            for line in lines:
                await stack.enter_async_context(line.gate)
            await asyncio.sleep(0)
    except asyncio.CancelledError:
        if presence.has_left:
            return False
        raise
    finally:
        lines[0].waiting -= 1
        presence.waiting = None
    return not presence.has_left


def network(host: str) -> str:
    """What one client has of addresses: one of IPv4, and half a one of IPv6, of whose other half it may have all."""
    try:
        address = ip_address(host.partition("%")[0])
    except ValueError:  # of a socket that has none
        return host
    if not isinstance(address, IPv6Address):
        return str(address)
    return str(address.ipv4_mapped or address.packed[:8].hex())
