"""The JSON face under ``/api``, and its description, which is made of the same list of endpoints."""

from __future__ import annotations

import functools
import json
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from ..codec import Malformed, convert, to_json
from ..version import __version__
from . import binding
from .borders import Refusal, body
from .files import SHOWN
from .people import asking, sent
from .records import Interface
from .shown import RoundView, RowView, RunView, round_csv, round_view, run_view, table
from .wire import file_answer

T = TypeVar("T")

CSV, ZIP = "text/csv; charset=utf-8", "application/zip"

Answer = Callable[[Request], Awaitable[Response]]


class Problem(msgspec.Struct):
    """Why a request was not done, in a sentence."""

    error: str


class Bind(msgspec.Struct, forbid_unknown_fields=True):
    """A binding: variables by connector (``{"q_m[1]": "In1", "q_m[2]": "In2"}``), and values by variable."""

    map: dict[str, str] = {}
    parameters: dict[str, bool | int | float | str | list[bool | int | float | str]] = {}


class Opening(msgspec.Struct, forbid_unknown_fields=True):
    """A round that is to be opened: its name, and when it closes (ISO 8601, UTC if it names no zone)."""

    name: str
    closes: str


class ChosenRun(msgspec.Struct, forbid_unknown_fields=True):
    """The id of the run that is to count for you."""

    run: str


class Created(msgspec.Struct):
    """The id of what was made."""

    id: str


@dataclass(frozen=True)
class Endpoint:
    """A path with a method, what it does, and the types of what goes in and comes out; ``media`` are those of bytes."""

    method: str
    path: str
    summary: str
    answer: Answer
    gives: Any = None
    takes: Any = None
    status: int = 200
    query: dict[str, str] = field(default_factory=dict)
    media: tuple[str, ...] = ("application/octet-stream",)


def _json(value: Any, status: int = 200) -> Response:
    return Response(to_json(value) + "\n", status, media_type="application/json")


async def _runs(request: Request) -> Response:
    service, person = asking(request)
    return _json([run_view(service, run, whole=False) for run in service.database.runs_of(person.id)])


async def _submit(request: Request) -> Response:
    service, person = asking(request)
    limits = service.settings.limits
    pieces = body(request, limits.upload, limits.patience, limits.upload_time)
    with service.uploading(person):
        run = await service.accept(person, request.query_params.get("name", "controller.fmu"), pieces)
    return _json(run_view(service, run), 201)


async def _run(request: Request) -> Response:
    service, person = asking(request)
    run = service.own(person, request.path_params["id"])
    since = request.query_params.get("since", "")
    told = since.isdecimal() and int(since[:15]) == run.revision
    if told and not run.state.is_final and service.may_follow(person.id):
        with service.following(person.id):
            await service.runner.news(LOOK_TIME)
        run = service.own(person, run.id)
    return _json(run_view(service, run))


LOOK_TIME = 10.0
"""Seconds that a request waits for news of a run."""


async def _remove(request: Request) -> Response:
    service, person = asking(request)
    service.remove(service.own(person, request.path_params["id"]))
    return Response(status_code=204)


async def _cancel(request: Request) -> Response:
    service, person = asking(request)
    return _json(run_view(service, service.cancel(service.own(person, request.path_params["id"]))))


async def _retry(request: Request) -> Response:
    service, person = asking(request)
    return _json(run_view(service, service.retry(service.own(person, request.path_params["id"]))))


async def _interface(request: Request) -> Response:
    service, person = asking(request)
    found = service.interface(service.own(person, request.path_params["id"]))
    if found is None:
        raise Refusal(409, "The FMU has not been looked at yet, or cannot be opened.")
    return _json(found)


async def _asked(request: Request, kind: type[T], what: str) -> T:
    """What the body of a request says; ``what`` it has to be."""
    text = await sent(request)
    try:
        # By Python's parser: msgspec takes 25 us for a number such as 9e307, and everybody waits.
        return convert(json.loads(text), kind)
    except (Malformed, ValueError, RecursionError) as problem:
        raise Refusal(400, f"This is no {what}: {problem}.") from None


async def _bind(request: Request) -> Response:
    service, person = asking(request)
    run = service.own(person, request.path_params["id"])
    asked = await _asked(request, Bind, "binding")
    return _json(run_view(service, service.bind(run, binding.written(asked.map, asked.parameters))))


async def _file(request: Request) -> Response:
    service, person = asking(request)
    names = request.path_params
    file = service.file(service.own(person, names["id"]), names["place"], names["file"])
    return file_answer(file, SHOWN[file.name], file.name)


async def _table(request: Request) -> Response:
    service, person = asking(request)
    return _json(table(service, person.id))


async def _compare(request: Request) -> Response:
    service, person = asking(request)
    ids = await _asked(request, list[str], "list of runs")
    return _json(Created(await service.compare(person, ids)), 201)


async def _rounds(request: Request) -> Response:
    service, person = asking(request)
    return _json([round_view(service, round, person.id) for round in service.database.rounds()])


async def _open(request: Request) -> Response:
    service, person = asking(request)
    asked = await _asked(request, Opening, "round")
    return _json(round_view(service, service.open_round(person, asked.name, asked.closes), person.id), 201)


async def _round(request: Request) -> Response:
    service, person = asking(request)
    return _json(round_view(service, service.round(request.path_params["id"]), person.id))


async def _choose(request: Request) -> Response:
    service, person = asking(request)
    round = service.round(request.path_params["id"])
    asked = await _asked(request, ChosenRun, "choice")
    service.choose(person, round, service.own(person, asked.run))
    return _json(round_view(service, round, person.id))


async def _close(request: Request) -> Response:
    service, person = asking(request)
    closed = service.close_round(person, service.round(request.path_params["id"]))
    return _json(round_view(service, closed, person.id))


async def _verify_again(request: Request) -> Response:
    service, person = asking(request)
    round = service.round(request.path_params["id"])
    service.verify_again(person, round)
    return _json(round_view(service, round, person.id))


async def _round_csv(request: Request) -> Response:
    service, person = asking(request)
    view = round_view(service, service.round(request.path_params["id"]), person.id)
    return _attachment(round_csv(view).encode(), CSV, "round.csv")


async def _certificates(request: Request) -> Response:
    service, person = asking(request)
    archive = await service.certificates(person, service.round(request.path_params["id"]))
    return _attachment(archive, ZIP, "certificates.zip")


def _attachment(content: bytes, kind: str, name: str) -> Response:
    return Response(content, media_type=kind, headers={"content-disposition": f"attachment; filename={name}"})


async def _description(request: Request) -> Response:
    return Response(_described(), media_type="application/json")


@functools.cache
def _described() -> str:
    return to_json(description()) + "\n"  # once: it takes 6 ms, and strangers may ask for it


RUN, ROUND = "/api/runs/{id}", "/api/rounds/{id}"

ENDPOINTS = (
    Endpoint("GET", "/api/runs", "Your runs, the newest first", _runs, list[RunView]),
    Endpoint(
        *("POST", "/api/runs", "Submit an FMU: its bytes are the body", _submit, RunView, bytes, 201),
        {"name": "what the FMU is called, such as my.fmu"},
    ),
    Endpoint(
        *("GET", RUN, "A run: its state, progress, findings and results", _run, RunView, None, 200),
        {"since": "a revision: the answer waits up to ten seconds for news after it"},
    ),
    Endpoint("DELETE", RUN, "Delete a run with its FMU and results", _remove, status=204),
    Endpoint("POST", f"{RUN}/cancel", "Cancel a run", _cancel, RunView),
    Endpoint("POST", f"{RUN}/retry", "Begin again with a run that failed or was cancelled", _retry, RunView),
    Endpoint("GET", f"{RUN}/binding", "The connectors and the variables of an FMU", _interface, Interface),
    Endpoint(
        *(
            "PUT",
            f"{RUN}/binding",
            "Bind a refused run anew; of another run, a second one is made",
            _bind,
            RunView,
            Bind,
        )
    ),
    Endpoint(
        *("GET", f"{RUN}/files/{{place}}/{{file}}", f"A file of quick or evaluation: {', '.join(SHOWN)}", _file, bytes),
        media=tuple(SHOWN.values()),
    ),
    Endpoint("GET", "/api/table", "Finished runs of everybody, best first", _table, list[RowView]),
    Endpoint("POST", "/api/comparisons", "Compare finished runs by their ids", _compare, Created, list[str], 201),
    Endpoint("GET", "/api/rounds", "All rounds, the newest first", _rounds, list[RoundView]),
    Endpoint("POST", "/api/rounds", "Open a round, as an organizer", _open, RoundView, Opening, 201),
    Endpoint("GET", ROUND, "A round: its phase, and its table", _round, RoundView),
    Endpoint("PUT", f"{ROUND}/choice", "Choose the run that counts for you", _choose, RoundView, ChosenRun),
    Endpoint("POST", f"{ROUND}/close", "Close a round before its date, as an organizer", _close, RoundView),
    Endpoint(
        *("POST", f"{ROUND}/verify", "Verify again what failed by faults of the machine, as an organizer"),
        *(_verify_again, RoundView),
    ),
    Endpoint("GET", f"{ROUND}/table.csv", "The table of a round as CSV", _round_csv, bytes, media=(CSV,)),
    Endpoint(
        *("GET", f"{ROUND}/certificates.zip", "All certificates of a round that is final", _certificates, bytes),
        media=(ZIP,),
    ),
    Endpoint("GET", "/api/openapi.json", "This description", _description, dict[str, Any]),
)


def routes() -> list[Route]:
    """The routes of all endpoints."""
    return [Route(endpoint.path, endpoint.answer, methods=[endpoint.method]) for endpoint in ENDPOINTS]


def description() -> dict[str, Any]:
    """The description of all endpoints in OpenAPI 3.1."""
    types = [kind for endpoint in ENDPOINTS for kind in (endpoint.gives, endpoint.takes) if kind not in (None, bytes)]
    schemas, components = msgspec.json.schema_components([*types, Problem], ref_template="#/components/schemas/{name}")
    by_type = dict(zip(map(str, types), schemas, strict=False))
    paths: dict[str, dict[str, Any]] = {}
    for each in ENDPOINTS:
        names = [part[1:-1] for part in each.path.split("/") if part.startswith("{")]
        told: dict[str, Any] = {
            "summary": each.summary,
            "parameters": [
                *({"name": name, "in": "path", "required": True, "schema": {"type": "string"}} for name in names),
                *(
                    {"name": name, "in": "query", "description": text, "schema": {"type": "string"}}
                    for name, text in each.query.items()
                ),
            ],
            "responses": {
                str(each.status): {"description": "done", **_content(each.gives, by_type, each.media)},
                "default": {"description": "not done", **_content(Problem, {str(Problem): schemas[-1]})},
            },
        }
        if each.takes is not None:
            told["requestBody"] = {"required": True, **_content(each.takes, by_type)}
        paths.setdefault(each.path, {})[each.method.lower()] = told
    return {
        "openapi": "3.1.0",
        "info": {"title": "Flexible-manipulator benchmark: the service", "version": __version__},
        "components": {
            "schemas": components,
            "securitySchemes": {"key": {"type": "http", "scheme": "bearer", "description": "your key"}},
        },
        "security": [{"key": []}, {}],
        "paths": paths,
    }


def _content(
    kind: Any, schemas: dict[str, Any], media: tuple[str, ...] = ("application/octet-stream",)
) -> dict[str, Any]:
    if kind is None:
        return {}
    if kind is bytes:
        return {"content": {each: {"schema": {"type": "string", "format": "binary"}} for each in media}}
    return {"content": {"application/json": {"schema": schemas[str(kind)]}}}
