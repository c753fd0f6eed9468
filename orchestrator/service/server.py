"""The HTTP server: uvicorn, set up for a service of this kind."""

from __future__ import annotations

import asyncio
import os
import re
import socket
from types import FrameType
from typing import Any

import h11
import uvicorn
from starlette.applications import Starlette
from uvicorn.protocols.http.h11_impl import H11Protocol

from .service import Service
from .turns import PRESENCE, Presence

GRACE = 3
"""Seconds that requests under way have to end, once the service is to end."""

MAX_CONNECTIONS = 400
"""Connections at a time, each of which may have a file open: twice as many are below the 1024 open files that a process
usually has. Who comes when there are more is told to come again."""

MAX_HEAD = 16 * 1024
"""Longest head of a request [bytes]."""

FEW = {b"\n": 100, b",": 500, b";": 500}
"""What a head has so many of at the most. It is read by Python for each of them, before any turn: 30 clients with
16,000 lines in 64 kB each, which uvicorn takes, had others wait for 11 s, and those of 16 kB for 4 s; 380 connections
with 16,000 commas for 1.5 s. Browsers send some twenty lines, and 180 cookies at the most."""

MAX_ADDRESS = 4096
"""Longest address that is asked for [bytes], read in the same way at each ``%``. A file's name in it has 2,300, if all
of its 255 letters are Chinese."""

END_OF_HEAD = re.compile(rb"\n\r?\n")

IN_NO_HEAD = (b"\0", b"\v", b"\f", b"\r")
"""Bytes that h11 takes in no line of a head. Before one of them it goes back byte by byte, over blanks in quadratic
time: 16 kB of blanks kept everybody waiting for 1.5 s, and 16 kB of letters on each of 380 connections for as long."""

HEAD_TIME = 20.0
"""Seconds after which a connection without a request is closed."""

STALLED = 3
"""Looks at which a client has taken nothing of what waits for it, after which it is gone."""

SPARE = 50
"""Connections beyond these, which are told that there are too many. Further ones are closed at once: 1,100 idle ones
took all files that the process may open, and the jobs of people could not be started."""


class Parser(h11.Connection):
    """What a client sends, with a head of few lines, and a body whose length its head tells.

    Of a body in chunks each byte may be one, and each chunk is an event that everybody waits for: 20 clients had others
    wait for a minute. Browsers and programs that send a file tell its length, and so does a server in front that reads
    bodies before it sends them.
    """

    refusal = 400, "This is no HTTP request."
    """Status and sentence for what cannot be parsed."""

    _seen = 0
    """Bytes of a head that were looked at: it may come in one packet for each."""

    is_head = False
    """Whether the request is a HEAD, whose answer has no body."""

    def next_event(self) -> Any:
        """As that of h11; raises :class:`h11.RemoteProtocolError` for such a head or body, too."""
        if self.their_state is h11.IDLE:
            received, _ = self.trailing_data
            end = END_OF_HEAD.search(received, max(self._seen - len("\n\r"), 0))
            size = end.start() if end else len(received)
            # Of a whole head alone, which is read: for each packet of one byte they were counted in 16 kB anew.
            if size > MAX_HEAD or end and any(received.count(sign, 0, size) > most for sign, most in FEW.items()):
                self._refuse(431, "The head of this request is too long.")
            # A carriage return ends a line if a line feed follows, which may not be here yet.
            lines = received[max(self._seen - 1, 0) : size].removesuffix(b"\r").replace(b"\r\n", b"\n")
            if any(byte in lines for byte in IN_NO_HEAD):
                self._refuse(400, "The head of this request has bytes that are in none.")
            self._seen = 0 if end else size
        event = super().next_event()
        if isinstance(event, h11.Request):
            self.is_head = event.method == b"HEAD"
            if len(event.target) > MAX_ADDRESS:
                self._refuse(414, "The address of this request is too long.")
            if any(name == b"transfer-encoding" for name, _ in event.headers):
                self._refuse(411, "Tell the length of the body, and send no chunks.")
        return event

    def _refuse(self, status: int, sentence: str) -> None:
        self.refusal = status, sentence
        raise h11.RemoteProtocolError(sentence)


class Connection(H11Protocol):
    """A connection that may not stay open for nothing: uvicorn waits for the head of a request for ever."""

    _timer: asyncio.TimerHandle | None = None
    _last: object = None
    _unread = 0
    _stalled = 0

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.conn = Parser(h11.SERVER)
        self._presence = Presence()
        self.app_state = {**self.app_state, PRESENCE: self._presence}

    def send_400_response(self, msg: str) -> None:
        """Say why this is no request, unless another answer has begun."""
        if self.cycle is not None and not self.cycle.response_complete:
            # That of uvicorn writes in any case, and lets the request under way go on to write as well: one packet of a
            # stranger made 4 kB of tracebacks in the log.
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            assert isinstance(self.conn, Parser)
            status, sentence = self.conn.refusal
            text = b"" if self.conn.is_head else sentence.encode() + b"\n"
            headers = [("content-type", "text/plain; charset=utf-8"), ("connection", "close")]
            said = (h11.Response(status_code=status, headers=headers), h11.Data(data=text), h11.EndOfMessage())
            self.transport.write(b"".join(self.conn.send(event) or b"" for event in said))
        self.transport.close()

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
        self._presence.end()

    def on_response_complete(self) -> None:
        """Read no further, if the client goes on with a body that nobody reads: it takes no turns, and has no end."""
        # Looked at before the next request is: who had the last byte of a file at once sent an upload behind it, and
        # the connection was closed in nine of ten times.
        goes_on = self.conn.their_state is h11.SEND_BODY
        super().on_response_complete()
        if goes_on:
            self.transport.close()

    def _look(self) -> None:
        """Close it if there was no request since the last look, and none is under way; or if its client takes nothing
        of the answer: 490 of those held a file each, and the jobs of others could not be started."""
        unread = self.transport.get_write_buffer_size()
        self._stalled = self._stalled + 1 if unread and unread == self._unread else 0
        self._unread = unread
        if self._stalled == STALLED:
            self.transport.abort()
            return
        if self.cycle is self._last and (self.cycle is None or self.cycle.response_complete):
            self.transport.close()  # which waits until what was said is taken: it is looked at until it has ended
        self._last = self.cycle
        self._timer = self.loop.call_later(HEAD_TIME, self._look)


class Server(uvicorn.Server):
    """Serves ``app`` until it is told to end, by a signal or by ``should_exit``."""

    def __init__(self, app: Starlette) -> None:
        config = uvicorn.Config(
            app,
            http=Connection,
            ws="none",
            # Not "warning": strangers could fill the disk with lines about requests that are none.
            log_level="error",
            # Which pages people look at is nobody's business.
            access_log=False,
            server_header=False,
            # A server in front on this machine tells the client's address; uvicorn believes that of 127.0.0.1 alone.
            forwarded_allow_ips=os.environ.get("FORWARDED_ALLOW_IPS", "127.0.0.1,::1"),
            use_colors=False,  # else it asks standard output whether it is a terminal, which may be closed
            timeout_graceful_shutdown=GRACE,
            limit_concurrency=MAX_CONNECTIONS,
        )
        super().__init__(config)
        self._app = app

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Take note of a signal at once: systemd and a terminal may send it to the jobs, too, whose end is no fault of
        this machine then. Requests under way have some seconds before :meth:`shutdown`."""
        if (service := self._service) is not None:
            service.runner.stop()
        super().handle_exit(sig, frame)

    @property
    def _service(self) -> Service | None:
        service = getattr(self._app.state, "service", None)
        return service if isinstance(service, Service) else None

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End: live pages first, which would follow for as long as the service lasts."""
        if (service := self._service) is not None:
            service.closing = True
            service.runner.wake()
        await super().shutdown(sockets)
