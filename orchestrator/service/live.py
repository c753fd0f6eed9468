"""Live progress: server-sent events that end with the run, the page or the service."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from zlib import crc32

from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from ..codec import Struct, to_json
from .borders import Refusal
from .people import asking, person_asking
from .records import State
from .service import Service
from .shown import shown_cost

ALIVE = 15.0
"""Seconds after which a stream without news says that it is alive, so that nothing on the way closes it."""

CALM = 0.3
"""Seconds between two messages of a stream."""


class News(Struct):
    """A message of a stream: where a run is, for the page that shows it."""

    revision: int
    final: bool
    done: int = 0
    total: int = 0
    cost: str = ""
    text: str = ""


async def events(request: Request) -> Response:
    """The live progress of a run."""
    service, person = asking(request)
    run = service.own(person, request.path_params["id"])
    return _stream(request, lambda: _news(service, run.id))


async def all_events(request: Request) -> Response:
    """That something has changed among one's runs."""
    service, person = asking(request)

    def news() -> News:
        # Runs that are deleted count as well, and those of others change the table.
        ended = service.database.count(State.FINISHED) + service.database.count(State.FAILED)
        # A round that opens or closes, and each verification that ends, change its page.
        told = [(round.id, round.closed) for round in service.database.rounds()]
        changed = crc32(repr((ended, service.database.count(State.VERIFYING), told)).encode())
        return News((service.database.revisions(person.id) << 32) + changed, False)

    return _stream(request, news)


def _news(service: Service, id: str) -> News:
    run = service.database.run(id)
    if run is None:
        return News(-1, True)
    live = service.runner.live.get(id)
    if live is None:
        return News(run.revision, run.state.is_final)
    last = live.findings[-1] if live.findings and run.state is State.CHECKING else None
    text = f"{last[1]}: {last[2]}" if last else ""
    progress = live.progress
    cost = "" if progress.cost is None else shown_cost(progress.cost)
    return News(run.revision, run.state.is_final, progress.done, progress.total, cost, text)


def _stream(request: Request, news: Callable[[], News]) -> Response:
    """Server-sent events: a message whenever ``news()`` gives another one, as long as who asks may come in."""
    service, person = asking(request)
    if not service.may_follow(person.id):
        raise Refusal(429, "So many live pages are open that this one does not follow. Close some, and load it again.")

    async def messages() -> AsyncIterator[str]:
        # Once more: a hundred that are asked for at once have all passed above.
        if not service.may_follow(person.id):
            return
        with service.following(person.id):
            last, said = None, time.monotonic()
            while not service.closing and person_asking(request) == person:
                told = news()
                silent = time.monotonic() - said
                if told != last or silent >= ALIVE:
                    yield f"data: {to_json(told, indent=None)}\n\n" if told != last else ": alive\n\n"
                    last, said = told, time.monotonic()
                    if told.final:
                        return
                    await asyncio.sleep(CALM)
                else:  # others' news, too, wake it
                    await service.runner.news(ALIVE - silent)

    return StreamingResponse(messages(), media_type="text/event-stream")


def routes() -> list[Route]:
    """The routes of all streams."""
    return [Route("/events", all_events, methods=["GET"]), Route("/runs/{id}/events", events, methods=["GET"])]
