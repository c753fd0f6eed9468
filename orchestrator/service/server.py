"""The HTTP server: uvicorn, set up for a service of this kind."""

from __future__ import annotations

import socket

import uvicorn
from starlette.applications import Starlette

from .service import Service

GRACE = 3
"""Seconds that requests under way have to end, once the service is to end."""

MAX_CONNECTIONS = 500
"""Connections at a time, of 1024 open files that a process usually has; who comes when there are more is told to come
again."""


class Server(uvicorn.Server):
    """Serves ``app`` until it is told to end, by a signal or by ``should_exit``."""

    def __init__(self, app: Starlette) -> None:
        config = uvicorn.Config(
            app,
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
