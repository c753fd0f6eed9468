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

from ..codec import to_json
from ..errors import BenchmarkError, InputError
from . import accounts, api, live, pages
from .api import Problem
from .borders import HEADERS, POLICY, Borders, Refusal, closing
from .database import Database
from .files import Files
from .records import Settings
from .runner import JOB, Runner
from .service import Service

logger = logging.getLogger(__name__)


def application(folder: Path, settings: Settings, job: tuple[str, ...] = JOB) -> Starlette:
    """The service with all its state in ``folder``, as an ASGI application.

    Its start raises :class:`InputError` if another service has the folder, or it cannot be used.
    """

    @contextlib.asynccontextmanager
    async def life(app: Starlette) -> AsyncIterator[None]:
        files = Files(folder.absolute())
        files.check_own()
        files.prepare()
        with files.taken():
            database = Database(files.database)
            try:
                runner = Runner(database, files, settings.conduct, job)
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

    return Starlette(
        routes=[*api.routes(), *live.routes(), *pages.routes()],
        middleware=[Middleware(Borders, local=not settings.accounts)],
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


def check_folder(folder: Path) -> None:
    """Raise what the start of a service in ``folder`` would, before there is a server to say it."""
    files = Files(folder.absolute())
    files.check_own()
    files.prepare()
    with files.taken():
        database = Database(files.database)
        try:
            database.check()
        finally:
            database.close()


async def _refused(request: Request, problem: Exception) -> Response:
    """Say in a sentence why something was not done: to a program as JSON, to a person as a page."""
    if isinstance(problem, Refusal):
        status, sentence = problem.status, str(problem)
    elif isinstance(problem, HTTPException):
        status, sentence = problem.status_code, "There is no such page."
    else:
        # What the machine cannot do now, it may do later.
        status, sentence = (400 if isinstance(problem, InputError) else 503), str(problem)
    return _answer(request, status, sentence)


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
