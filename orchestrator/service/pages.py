"""The pages: HTML of templates, which escape all that they are given."""

from __future__ import annotations

import functools
from importlib import resources
from typing import Any

from markupsafe import Markup
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from ..documents.compare_page import FILE as COMPARISON
from ..errors import InputError
from ..version import __version__
from ..views.page import environment, template_text
from . import accounts, binding
from .borders import REPORT_POLICY, Refusal, body, key_body
from .files import EVALUATION, FINDINGS, QUICK, SCORECARD, SHOWN, is_file
from .people import COOKIE, HOSTS_COOKIE, asking, person_asking, service_of, session_of
from .records import ConnectorRecord, Interface, State, Submission, VariableRecord
from .service import Service
from .shown import moment, round_view, run_view, shown_cost, state_words, table
from .wire import cut, file_answer, form_fields, split, uploaded_file

FILES = resources.files(__package__) / "templates"

FEW = 200
"""Variables that are offered as a list to choose from; of more, a field completes what is typed."""


def page(request: Request, template: str, status: int = 200, **context: Any) -> Response:
    """A page made of a template."""
    service = service_of(request)
    common = {
        "person": person_asking(request) if service.settings.accounts else None,
        "warning": service.settings.warning,
        "version": __version__,
        "here": request.url.path,
    }
    return HTMLResponse(_environment().get_template(template).render({**common, **context}), status)


@functools.cache
def _environment() -> Any:
    made = environment(lambda name: _own(name) or template_text(name))
    made.globals |= {"cost": shown_cost, "state_words": state_words}
    made.filters["moment"] = moment
    return made


def _own(name: str) -> str | None:
    file = FILES / name
    return file.read_text(encoding="utf-8") if file.is_file() else None


async def start(request: Request) -> Response:
    """Where an FMU is dropped, with one's own runs and the table of all."""
    service = service_of(request)
    person = person_asking(request)
    if person is None:
        return RedirectResponse("/join", 303)
    runs = service.database.runs_of(person.id)
    limits = service.settings.limits
    return page(
        *(request, "start.html"),
        runs=runs,
        rows=table(service, person.id),
        rounds=service.database.rounds()[:1],
        organizer=person.organizer,
        accounts=service.settings.accounts,
        most=limits.upload,
        protocol=service.settings.conduct.protocol_name,
    )


async def submit(request: Request) -> Response:
    """Take an FMU from a form; a page with scripts sends it to the JSON face, and shows how far it is."""
    service, person = asking(request)
    limits = service.settings.limits
    pieces = body(request, limits.upload + (1 << 20), limits.patience, limits.upload_time)
    service.check_quota(person)
    with service.uploading(person):
        name, file = await uploaded_file(request.headers.get("content-type", ""), pieces)
        run = await service.accept(person, name, file)
    return RedirectResponse(f"/runs/{run.id}", 303)


async def run_page(request: Request) -> Response:
    """A run: where it is, what was found, its results, and the form for another binding."""
    service, person = asking(request)
    return _run_page(request, service, service.own(person, request.path_params["id"]))


def _run_page(
    request: Request,
    service: Service,
    run: Submission,
    problem: str = "",
    typed: dict[str, str] | None = None,
    status: int = 200,
) -> Response:
    interface = service.interface(run)
    here = EVALUATION if run.is_evaluated else QUICK
    card = service.piece(run, here, SCORECARD)
    return page(
        *(request, "run.html", status),
        run=run,
        view=run_view(service, run),
        findings=Markup(service.piece(run, FINDINGS)),
        scorecard=Markup(card),
        place=here,
        files=[name for name in SHOWN if is_file(service.files.run(run.id) / here / name)],
        fields=[] if interface is None else fields(interface, typed or {}),
        settable=[]
        if interface is None
        else [(v, _given(interface, v, typed or {})) for v in binding.values(interface)],
        left_out=0 if interface is None else interface.left_out,
        problem=problem,
        open=bool(problem) or (run.state is State.REFUSED and interface is not None),
        few=FEW,
        protocol=service.settings.conduct.protocol_name,
    )


Field = tuple[ConnectorRecord, list[tuple[str, str]], list[VariableRecord]]
"""A connector, the names and values of its two fields, and what they offer."""


def fields(interface: Interface, typed: dict[str, str]) -> list[Field]:
    """The fields of the form, as they were ``typed``, else as the connectors are bound."""
    rows: list[Field] = []
    for connector in interface.connectors:
        bound = (*connector.bound, "", "")[:2]
        parts = [
            (part, typed.get(f"map:{part}", now))
            for part, now in zip(binding.components(connector), bound, strict=True)
        ]
        rows.append((connector, parts, binding.candidates(interface, connector)))
    return rows


def _given(interface: Interface, variable: VariableRecord, typed: dict[str, str]) -> str:
    if (text := typed.get(f"set:{variable.name}")) is not None:
        return text
    values = [interface.given.get(name) for name in (variable.name, *_elements(variable))]
    return ", ".join(_spelled(value) for value in values if value is not None)


def _elements(variable: VariableRecord) -> list[str]:
    return [f"{variable.name}[{number}]" for number in range(1, variable.size + 1)] if 1 < variable.size <= 100 else []


def _spelled(value: bool | int | float | str) -> str:
    return ("true" if value else "false") if isinstance(value, bool) else str(value)


async def bind(request: Request) -> Response:
    """Bind by the form."""
    service, person = asking(request)
    run = service.own(person, request.path_params["id"])
    # One longer than a value may be is refused, and each is shown again.
    longest = binding.MAX_VALUE + 1
    typed = {name: value[:longest] for name, value in await form_fields(request)}
    chosen, given = (
        {name.removeprefix(kind): value for name, value in typed.items() if name.startswith(kind)}
        for kind in ("map:", "set:")
    )
    try:
        bound = service.bind_by_form(run, chosen, given)
    except InputError as problem:  # what was typed is not lost
        return _run_page(request, service, run, cut(str(problem)), typed, 400)
    return RedirectResponse(f"/runs/{bound.id}", 303)


async def cancel(request: Request) -> Response:
    """End a run."""
    service, person = asking(request)
    run = service.cancel(service.own(person, request.path_params["id"]))
    return RedirectResponse(f"/runs/{run.id}", 303)


async def retry(request: Request) -> Response:
    """Begin again with a run."""
    service, person = asking(request)
    run = service.retry(service.own(person, request.path_params["id"]))
    return RedirectResponse(f"/runs/{run.id}", 303)


async def remove(request: Request) -> Response:
    """Delete a run."""
    service, person = asking(request)
    service.remove(service.own(person, request.path_params["id"]))
    return RedirectResponse("/", 303)


async def file(request: Request) -> Response:
    """A file of an evaluation; a report in a world of its own."""
    service, person = asking(request)
    names = request.path_params
    found = service.file(service.own(person, names["id"]), names["place"], names["file"])
    if found.suffix == ".html":
        return file_answer(found, SHOWN[found.name], headers={"content-security-policy": REPORT_POLICY})
    return file_answer(found, SHOWN[found.name], found.name)


async def mapping(request: Request) -> Response:
    """The mapping file that was used, for one's own machine."""
    service, person = asking(request)
    run = service.own(person, request.path_params["id"])
    headers = {"content-disposition": "attachment; filename=binding.toml"}
    text = service.database.binding(run.id)
    return Response(text, media_type="application/toml", headers=headers)


async def compare(request: Request) -> Response:
    """Compare the runs that were ticked."""
    service, person = asking(request)
    ids = [value for name, value in await form_fields(request) if name == "run"]
    return RedirectResponse(f"/comparisons/{await service.compare(person, ids)}", 303)


async def comparison(request: Request) -> Response:
    """A comparison."""
    service, person = asking(request)
    id = request.path_params["id"]
    return page(request, "comparison.html", id=id, runs=service.comparison(person, id))


async def comparison_page(request: Request) -> Response:
    """The ordinary page of a comparison, in a world of its own."""
    service, person = asking(request)
    id = request.path_params["id"]
    service.comparison(person, id)
    place = service.files.comparison(id) / COMPARISON
    return file_answer(place, "text/html; charset=utf-8", headers={"content-security-policy": REPORT_POLICY})


async def rounds(request: Request) -> Response:
    """All rounds; for an organizer, with the form that opens one."""
    return _rounds_page(request)


def _rounds_page(
    request: Request, problem: str = "", typed: dict[str, str] | None = None, status: int = 200
) -> Response:
    service, person = asking(request)
    return page(
        *(request, "rounds.html", status),
        rounds=service.database.rounds(),
        organizer=person.organizer,
        problem=problem,
        typed=typed or {},
    )


async def open_round(request: Request) -> Response:
    """Open a round by the form."""
    service, person = asking(request)
    typed = dict(await form_fields(request))
    try:
        round = service.open_round(person, typed.get("name", ""), typed.get("closes", ""))
    except (InputError, Refusal) as problem:  # what was typed is not lost
        return _rounds_page(request, str(problem), typed, getattr(problem, "status", 400))
    return RedirectResponse(f"/rounds/{round.id}", 303)


async def round_page(request: Request) -> Response:
    """A round: its table, what counts for who asks, and the organizer's buttons."""
    service, person = asking(request)
    round = service.round(request.path_params["id"])
    view = round_view(service, round, person.id)
    return page(
        *(request, "round.html"),
        view=view,
        own=service.database.handed_in(round, person.id) if view.own else [],
        organizer=person.organizer,
        accounts=service.settings.accounts,
        protocol=service.settings.conduct.protocol_name,
    )


async def choose(request: Request) -> Response:
    """Choose what counts."""
    service, person = asking(request)
    round = service.round(request.path_params["id"])
    service.choose(person, round, service.own(person, dict(await form_fields(request)).get("run", "")))
    return RedirectResponse(f"/rounds/{round.id}", 303)


async def close_round(request: Request) -> Response:
    """Close a round."""
    service, person = asking(request)
    round = service.close_round(person, service.round(request.path_params["id"]))
    return RedirectResponse(f"/rounds/{round.id}", 303)


async def verify_again(request: Request) -> Response:
    """Verify again what failed by faults of the machine."""
    service, person = asking(request)
    round = service.round(request.path_params["id"])
    service.verify_again(person, round)
    return RedirectResponse(f"/rounds/{round.id}", 303)


async def join(request: Request) -> Response:
    """Where an invitation leads."""
    return page(request, "join.html", problem="")


async def come_in(request: Request) -> Response:
    """Come in by a key."""
    service = service_of(request)
    key = dict(split(await key_body(request))).get("key", "")
    person = accounts.known(service.database, key[:500])
    if person is None:
        return page(
            request, "join.html", 403, problem="This invitation is not known here, or a newer one has replaced it."
        )
    answer = RedirectResponse("/", 303)
    # "lax": a link in a course's pages or in a mail finds whoever is in. Nothing changes by GET, and what changes
    # something must come from a page of this service.
    # A server in front may tell the scheme, and a browser does.
    secure = "https" in (request.url.scheme, request.headers.get("origin", "").partition(":")[0])
    token = accounts.begin_session(service.database, person)
    age = int(accounts.SESSION_TIME)
    name = HOSTS_COOKIE if secure else COOKIE
    answer.set_cookie(name, token, max_age=age, httponly=True, samesite="lax", secure=secure)
    return answer


async def leave(request: Request) -> Response:
    """End the session."""
    service, _ = asking(request)
    service.database.end_session(accounts.hashed(session_of(request)))
    answer = RedirectResponse("/join", 303)
    answer.delete_cookie(COOKIE)
    answer.delete_cookie(HOSTS_COOKIE, secure=True)
    return answer


async def static(request: Request) -> Response:
    """The style and the script of all pages."""
    name = request.path_params["name"]
    if name == "style.css":
        return Response(template_text("style.css") + (_own("service.css") or ""), media_type="text/css")
    if name == "service.js":
        return Response(_own("service.js") or "", media_type="text/javascript")
    raise Refusal(404, "There is no such page.")


def routes() -> list[Route]:
    """The routes of all pages."""
    get, post = ["GET"], ["POST"]
    return [
        Route("/", start, methods=get),
        Route("/join", join, methods=get),
        Route("/join", come_in, methods=post),
        Route("/leave", leave, methods=post),
        Route("/runs", submit, methods=post),
        Route("/runs/{id}", run_page, methods=get),
        Route("/runs/{id}/binding", bind, methods=post),
        Route("/runs/{id}/binding.toml", mapping, methods=get),
        Route("/runs/{id}/cancel", cancel, methods=post),
        Route("/runs/{id}/retry", retry, methods=post),
        Route("/runs/{id}/delete", remove, methods=post),
        Route("/runs/{id}/{place}/{file}", file, methods=get),
        Route("/comparisons", compare, methods=post),
        Route("/comparisons/{id}", comparison, methods=get),
        Route("/comparisons/{id}/page", comparison_page, methods=get),
        Route("/rounds", rounds, methods=get),
        Route("/rounds", open_round, methods=post),
        Route("/rounds/{id}", round_page, methods=get),
        Route("/rounds/{id}/choice", choose, methods=post),
        Route("/rounds/{id}/close", close_round, methods=post),
        Route("/rounds/{id}/verify", verify_again, methods=post),
        Route("/static/{name}", static, methods=get),
    ]
