"""Who asks: the session of a browser, the key of a program, or the one person of a service without accounts."""

from __future__ import annotations

import re

from starlette.requests import Request

from . import accounts
from .borders import MAX_FORM, Refusal, whole_body
from .records import Person
from .service import Service

COOKIE = "session"
HOSTS_COOKIE = f"__Host-{COOKIE}"
"""The same over https, where no other host of the domain can set it."""

SESSION = re.compile(rf"(?:^|; ?)(__Host-)?{COOKIE}=([A-Za-z0-9_-]{{1,100}})(?=;|$)")


def service_of(request: Request) -> Service:
    """The service that is asked."""
    found = request.app.state.service
    assert isinstance(found, Service)
    return found


def person_asking(request: Request) -> Person | None:
    """Who asks; None if that is nobody known."""
    service = service_of(request)
    if not service.settings.accounts:
        return accounts.LOCAL
    scheme, _, key = request.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        return accounts.known(service.database, key)
    token = session_of(request)
    return accounts.in_session(service.database, token) if token else None


def session_of(request: Request) -> str:
    """What the browser keeps of its session; empty if there is none, or more than one. Python's parser of cookies is
    quadratic in backslashes: one head of a stranger kept everybody waiting for 24 s."""
    found = SESSION.findall(request.headers.get("cookie", ""))
    # A page of another host of the domain may set a cookie for one path here: what was uploaded went to somebody else.
    tokens = {token for of_host, token in found if of_host} or {token for _, token in found}
    return tokens.pop() if len(tokens) == 1 else ""


def asking(request: Request) -> tuple[Service, Person]:
    """The service and who asks; raises :class:`.Refusal` for a stranger."""
    person = person_asking(request)
    if person is None:
        raise Refusal(401, "Come in by your invitation first.")
    return service_of(request), person


async def sent(request: Request) -> bytes:
    """What somebody has sent that is no upload; raises as :func:`.body`, and :func:`asking`."""
    service, person = asking(request)
    patience = service.settings.limits.patience
    with service.sending(person):
        return await whole_body(request, MAX_FORM, patience, 4 * patience)
