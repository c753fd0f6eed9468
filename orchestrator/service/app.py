"""The whole service: its routes within its borders, its life, and how errors are answered."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator
from pathlib import Path

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from ..benchmark import protocol
from ..codec import Malformed, from_json, to_json
from ..errors import BenchmarkError, InputError
from . import accounts, api, live, pages
from .api import Problem
from .borders import HEADERS, POLICY, Borders, Refusal, closing
from .database import Database
from .files import Files
from .records import Conduct, Settings, Stage
from .runner import JOB, Runner, protocol_of
from .service import Service
from .turns import Turns
from .wire import cut

PATIENCE = 0.5
"""Seconds that the service waits for another process that has locked the database: everybody else waits as well."""

logger = logging.getLogger(__name__)


def application(folder: Path, settings: Settings, job: tuple[str, ...] = JOB) -> Starlette:
    """The service with all its state in ``folder``, as an ASGI application.

    Its start raises :class:`InputError` if another service has the folder, it cannot be used, or has results by
    another protocol.
    """

    @contextlib.asynccontextmanager
    async def life(app: Starlette) -> AsyncIterator[None]:
        files = Files(folder.absolute())
        files.check_own()
        files.prepare()
        with files.taken():
            database = Database(files.database, PATIENCE)
            try:
                database.give_back()
                held = hold_protocols(database, settings.conduct)
                runner = Runner(database, files, settings.conduct, held, job)
                runner.recover()
                if not settings.accounts:
                    accounts.local_person(database)
                app.state.service = service = Service(settings, database, files, runner)
                work, dates = asyncio.create_task(runner.work()), asyncio.create_task(service.keep_dates())
                try:
                    yield
                finally:
                    service.closing = True
                    dates.cancel()
                    await runner.close()
                    await work
            finally:
                database.close()

    app = Starlette(
        routes=[*api.routes(), *live.routes(), *pages.routes()],
        # Turns first: what the borders refuse takes turns as well.
        middleware=[Middleware(Turns), Middleware(Borders, local=not settings.accounts)],
        exception_handlers={
            Refusal: _refused,
            InputError: _refused,
            BenchmarkError: _refused,
            HTTPException: _refused,
            ClientDisconnect: _gone,
            Exception: _broken,
        },
        lifespan=life,
    )
    # It redirects to whatever the Host header says.
    app.router.redirect_slashes = False
    return app


PROTOCOLS: dict[Stage, tuple[str, str]] = {
    "evaluating": ("finished runs", "other-protocol"),
    "verifying": ("a round that is not verified to its end", "other-draws-protocol"),
}
"""Stages with a protocol that an operator chooses, what the folder has when it must stay, and the code of the error."""


def hold_protocols(database: Database, conduct: Conduct) -> dict[Stage, str]:
    """Go on by the protocols of ``conduct``, and return their contents; raises :class:`InputError` if one table would
    have results by two."""
    held_by: dict[Stage, str] = {}
    for stage, (held, code) in PROTOCOLS.items():
        name = protocol_of(conduct, stage)
        now, former = protocol.contents(name), database.held_protocol(stage)
        if former is not None and not _equal(former[1], now):
            message = f"The service's folder has {held} by the protocol {former[0]}. {Path(name).stem} is another one, "
            message += "or has changed since: one table would have results by both."
            raise InputError(message, code, name)
        database.use_protocol(stage, Path(name).stem, now)
        held_by[stage] = now
    return held_by


def _equal(former: str, now: str) -> bool:
    """Whether two contents are of equal protocols. An earlier version wrote those that it knew: what has come since is
    as nothing was there."""
    try:
        return from_json(former, protocol.Protocol) == from_json(now, protocol.Protocol)
    except Malformed:
        return False


def check_folder(folder: Path, conduct: Conduct) -> None:
    """Raise what the start of a service in ``folder`` would, before there is a server to say it."""
    files = Files(folder.absolute())
    files.check_own()
    files.prepare()
    with files.taken():
        database = Database(files.database)
        try:
            database.check()
            hold_protocols(database, conduct)
        finally:
            database.close()


async def _refused(request: Request, problem: Exception) -> Response:
    """Say in a sentence why something was not done: to a program as JSON, to a person as a page."""
    if isinstance(problem, Refusal):
        status, sentence = problem.status, str(problem)
    elif isinstance(problem, HTTPException):
        status = problem.status_code
        sentence = f"This address takes no {request.method}." if status == 405 else "There is no such page."
    else:
        # What the machine cannot do now, it may do later.
        status, sentence = (400 if isinstance(problem, InputError) else 503), str(problem)
    return _answer(request, status, cut(sentence))


async def _gone(request: Request, problem: Exception) -> Response:
    return Response(status_code=400)


async def _broken(request: Request, problem: Exception) -> Response:
    logger.error("%s %s", request.method, request.url.path, exc_info=problem)
    answer = _answer(request, 500, "The service has failed in answering this. Its log says more.")
    answer.headers.update({**HEADERS, "content-security-policy": POLICY})  # it does not pass the borders
    return answer


def _answer(request: Request, status: int, sentence: str) -> Response:
    if request.url.path.startswith("/api/"):
        text = to_json(Problem(sentence)) + "\n"
        return Response(text, status, closing(request.method), media_type="application/json")
    answer = pages.page(request, "problem.html", status, sentence=sentence, is_stranger=status == 401)
    answer.headers.update(closing(request.method))
    return answer
