"""The JSON face under ``/api``, and its description, which is made of the same list of endpoints."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Route

from ..codec import Malformed, from_json, to_json
from ..version import __version__
from . import binding
from .borders import Refusal, body, whole_body
from .files import SHOWN
from .people import asking
from .records import Interface
from .shown import RowView, RunView, run_view, table

Answer = Callable[[Request], Awaitable[Response]]


class Problem(msgspec.Struct):
    """Why a request was not done, in a sentence."""

    error: str


class Bind(msgspec.Struct, forbid_unknown_fields=True):
    """A binding: variables by connector (``{"q_m[1]": "In1", "q_m[2]": "In2"}``), and values by variable."""

    map: dict[str, str] = {}
    parameters: dict[str, bool | int | float | str | list[bool | int | float | str]] = {}


class Created(msgspec.Struct):
    """The id of what was made."""

    id: str


@dataclass(frozen=True)
class Endpoint:
    """A path with a method, what it does, and the types of what goes in and comes out."""

    method: str
    path: str
    summary: str
    answer: Answer
    gives: Any = None
    takes: Any = None
    status: int = 200
    query: dict[str, str] = field(default_factory=dict)


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
    if since.isdecimal() and int(since[:15]) == run.revision and not run.state.is_final:
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


async def _bind(request: Request) -> Response:
    service, person = asking(request)
    run = service.own(person, request.path_params["id"])
    try:
        asked = from_json(await whole_body(request, service.settings.limits.patience), Bind)
    except Malformed as problem:
        raise Refusal(400, f"This is no binding: {problem}.") from None
    return _json(run_view(service, service.bind(run, binding.written(asked.map, asked.parameters))))


async def _file(request: Request) -> Response:
    service, person = asking(request)
    names = request.path_params
    file = service.file(service.own(person, names["id"]), names["place"], names["file"])
    return FileResponse(file, media_type=SHOWN[file.name], filename=file.name)


async def _table(request: Request) -> Response:
    service, person = asking(request)
    return _json(table(service, person.id))


async def _compare(request: Request) -> Response:
    service, person = asking(request)
    try:
        ids = from_json(await whole_body(request, service.settings.limits.patience), list[str])
    except Malformed as problem:
        raise Refusal(400, f"This is no list of runs: {problem}.") from None
    return _json(Created(await service.compare(person, ids)), 201)


async def _description(request: Request) -> Response:
    return _json(description())


RUN = "/api/runs/{id}"

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
        "GET", f"{RUN}/files/{{place}}/{{file}}", f"A file of quick or evaluation: {', '.join(SHOWN)}", _file, bytes
    ),
    Endpoint("GET", "/api/table", "Finished runs of everybody, best first", _table, list[RowView]),
    Endpoint("POST", "/api/comparisons", "Compare finished runs by their ids", _compare, Created, list[str], 201),
    Endpoint("GET", "/api/openapi.json", "This description", _description, dict[str, Any]),
)


def routes() -> list[Route]:
    """The routes of all endpoints."""
    return [Route(each.path, each.answer, methods=[each.method]) for each in ENDPOINTS]


def description() -> dict[str, Any]:
    """The description of all endpoints in OpenAPI 3.1."""
    types = [kind for each in ENDPOINTS for kind in (each.gives, each.takes) if kind not in (None, bytes)]
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
                str(each.status): {"description": "done", **_content(each.gives, by_type)},
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


def _content(kind: Any, schemas: dict[str, Any]) -> dict[str, Any]:
    if kind is None:
        return {}
    if kind is bytes:
        return {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}
    return {"content": {"application/json": {"schema": schemas[str(kind)]}}}
