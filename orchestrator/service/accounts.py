"""Who somebody is: keys of invitations, sessions of browsers, and the one person of a service without accounts.

A key is an id and a secret. Only hashes of secrets are stored, and they are compared in constant time. They are random,
so that a fast hash is enough: there is nothing to guess from.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import re
import secrets
import time
import unicodedata

from ..errors import InputError
from .database import Database
from .files import ID, new_id
from .records import Person

LOCAL = Person("0" * 24, "me", organizer=True)
"""Who uses a service without accounts."""

NAME = re.compile(r"\w[\w .'-]{0,59}")
"""What somebody may be called, but for letters that nobody sees, which Unicode has for Korean."""

SESSION_TIME = 30 * 86400.0
"""Seconds after which a browser has to come in again."""


def invited(database: Database, name: str) -> str:
    """The key of a new person called ``name``; of one who is there already, a new key in the place of the old.

    Raises :class:`InputError` for a name that cannot be.
    """
    name = _spelled(name)  # "Ada " would be somebody else than "Ada", and nobody would see it
    if not NAME.fullmatch(name) or any("FILLER" in unicodedata.name(letter, "") for letter in name):
        message = f"{name!r} cannot be a name: up to 60 letters, digits, blanks, dots, dashes and apostrophes."
        raise InputError(message, "bad-name", "", name)
    if name.casefold() == LOCAL.name:  # the key would be that of whoever used the service without accounts
        raise InputError(
            f"{name!r} is who uses the service without accounts. Choose another name.", "bad-name", "", name
        )
    secret = secrets.token_urlsafe(32)
    for person in database.people():
        if person.name == name:
            database.change_key(person.id, hashed(secret))
            return f"{person.id}.{secret}"
    person = Person(new_id(), name)
    database.add_person(person, hashed(secret), time.time())
    return f"{person.id}.{secret}"


def removed(database: Database, name: str) -> None:
    """Remove somebody with all that is theirs; raises :class:`InputError` if there is nobody called ``name``."""
    database.remove_person(_called(database, name).id)


def made_organizer(database: Database, name: str) -> None:
    """Let somebody open and close rounds; raises :class:`InputError` if there is nobody called ``name``."""
    database.make_organizer(_called(database, name).id)


def _spelled(name: str) -> str:
    return re.sub(" +", " ", name.strip())


def _called(database: Database, name: str) -> Person:
    for person in database.people():
        if person.name == _spelled(name):
            return person
    raise InputError(f"There is nobody called {name}.", "no-person", "", name)


def known(database: Database, key: str) -> Person | None:
    """Whose ``key`` it is, which may be a whole invitation; None if it is nobody's."""
    id, _, secret = key.strip().rpartition("#")[2].partition(".")
    found = database.person(id) if ID.fullmatch(id) else None
    # Compared in any case, so that the time does not tell whether there is such an id.
    right = hmac.compare_digest(found[1] if found else hashed(""), hashed(secret))
    return found[0] if found and right else None


def begin_session(database: Database, person: Person) -> str:
    """A new session; returns what the browser keeps."""
    token, now = secrets.token_urlsafe(32), time.time()
    database.add_session(hashed(token), person.id, now + SESSION_TIME, now)
    return token


def in_session(database: Database, token: str) -> Person | None:
    """Who has this session."""
    return database.session(hashed(token), time.time())


def local_person(database: Database) -> Person:
    """The one person of a service without accounts, added if it is missing."""
    if database.person(LOCAL.id) is None:
        database.add_person(LOCAL, "", time.time())
    return LOCAL


def hashed(secret: str) -> str:
    """The hash that is stored of a secret."""
    return hashlib.sha256(secret.encode()).hexdigest()


def is_loopback(host: str) -> bool:
    """Whether a name or an address is this machine's own, which nobody else reaches."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"
