"""The HTTP server: uvicorn, set up for a service of this kind."""

from __future__ import annotations

import asyncio
import socket

import uvicorn
from starlette.applications import Starlette
from uvicorn.protocols.http.h11_impl import H11Protocol

from .service import Service

GRACE = 3
"""Seconds that requests under way have to end, once the service is to end."""

MAX_CONNECTIONS = 500
"""Connections at a time, of 1024 open files that a process usually has; who comes when there are more is told to come
again."""


HEAD_TIME = 20.0
"""Seconds after which a connection without a request is closed."""

SPARE = 50
"""Connections beyond these, which are told that there are too many. Further ones are closed at once: 1,100 idle ones
took all files that the process may open, and the jobs of people could not be started."""


class Connection(H11Protocol):
    """A connection that may not stay open for nothing: uvicorn waits for the head of a request for ever."""

    _timer: asyncio.TimerHandle | None = None
    _last: object = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take it, unless there are too many."""
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS + SPARE:
            transport.abort()
        else:
            self._timer = self.loop.call_later(HEAD_TIME, self._look)

    def connection_lost(self, exc: Exception | None) -> None:
        """It has ended."""
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(exc)

    def _look(self) -> None:
        """Close it if there was no request since the last look, and none is under way."""
        if self.cycle is self._last and (self.cycle is None or self.cycle.response_complete):
            self.transport.close()
            return
        self._last = self.cycle
        self._timer = self.loop.call_later(HEAD_TIME, self._look)


class Server(uvicorn.Server):
    """Serves ``app`` until it is told to end, by a signal or by ``should_exit``."""

    def __init__(self, app: Starlette) -> None:
        config = uvicorn.Config(
            app,
            http=Connection,
            log_level="warning",
            # Which pages people look at is nobody's business.
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=GRACE,
            limit_concurrency=MAX_CONNECTIONS,
        )
        super().__init__(config)
        self._app = app

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End: live pages first, which would follow for as long as the service lasts."""
        service = getattr(self._app.state, "service", None)
        if isinstance(service, Service):
            service.closing = True
            service.runner.wake()
        await super().shutdown(sockets)
