"""A program that submits an FMU to a service, and follows it: nothing but Python's own library."""

from __future__ import annotations

import http.client
import json
import re
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

from ..errors import EnvironmentFault, InputError

TIMEOUT = 60.0
"""Seconds that an answer may take."""

PATIENCE = 120.0
"""Seconds that the service may be away, as while it is started again."""

KEY = re.compile(r"[!-~]*")
"""What a key, or a whole invitation, can be: what an HTTP header takes."""

Answer = Mapping[str, Any]


class Client:
    """The service at ``url``, with one's ``key`` if it has accounts. Raises :class:`InputError` for no such address or
    key."""

    def __init__(self, url: str, key: str = "") -> None:
        try:
            parts = urlsplit(url if "://" in url else f"http://{url}")
            host, port = parts.hostname, parts.port
            (host or "").encode("idna")
        except ValueError:  # half a bracket, a port that is none, a name that no host has
            host = None
        if not host or " " in host or parts.scheme not in ("http", "https"):
            raise InputError(f"{url} is not the address of a service, such as http://127.0.0.1:8080.", "bad-url", url)
        key = key.strip()  # of a file, its last line has an end
        if not KEY.fullmatch(key):  # it is not repeated: it is a secret
            raise InputError("The key is none: it has characters that no key has.", "no-key")
        self._secure, self._host, self._port = parts.scheme == "https", host, port
        # A whole invitation is an address, too.
        self._base, self._key = quote(parts.path.rstrip("/").removesuffix("/join"), safe="/%"), key
        # Not as it was given: an invitation has the key, and what is printed of it may be in a log that others read.
        self.url = f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{self._base}"

    def submit(self, file: Path) -> Answer:
        """Submit an FMU; returns its run. Raises as :meth:`ask`."""
        if not file.is_file():
            raise InputError(f"There is no file {file}. Give the path of an FMU (a .fmu file).", "no-file", file)
        query = urlencode({"name": file.name}, quote_via=quote)
        with file.open("rb") as stream:
            return self.ask("POST", f"/api/runs?{query}", stream, {"content-length": str(file.stat().st_size)})

    def bind(self, id: str, binding: Mapping[str, Any]) -> Answer:
        """Bind a run with ``map`` and ``parameters``. Raises as :meth:`ask`."""
        return self.ask("PUT", f"/api/runs/{id}/binding", json.dumps(binding).encode())

    def follow(self, id: str, on_news: Callable[[Answer], None]) -> Answer:
        """Wait for the end of a run; ``on_news(run)`` is called whenever something may have happened.

        The service may be away for a while, as when it is started again. Raises as :meth:`ask`.
        """
        revision, last = -1, time.monotonic()
        while True:
            try:
                run = self.ask("GET", f"/api/runs/{id}?since={revision}" if revision >= 0 else f"/api/runs/{id}")
            except EnvironmentFault:
                if time.monotonic() - last > PATIENCE:
                    raise
                time.sleep(1.0)
                continue
            last = time.monotonic()
            on_news(run)
            if run["is_final"]:
                return run
            if run["revision"] == revision:
                time.sleep(0.2)  # news come with every case
            revision = run["revision"]

    def ask(self, method: str, path: str, body: Any = None, headers: Mapping[str, str] | None = None) -> Answer:
        """The answer to a request.

        Raises :class:`InputError` if the service refuses it, :class:`EnvironmentFault` if it is not there, or can not
        do it now.
        """
        kind = http.client.HTTPSConnection if self._secure else http.client.HTTPConnection
        connection = kind(self._host, self._port, timeout=TIMEOUT)
        sent = {"authorization": f"Bearer {self._key}"} if self._key else {}
        try:
            # Refused before it was all sent: the answer says why.
            with suppress(BrokenPipeError, ConnectionResetError):
                connection.request(method, self._base + path, body, {**sent, **(headers or {})})
            response = connection.getresponse()
            text, status = response.read(), response.status
        except (OSError, http.client.HTTPException) as problem:
            message = f"The service {self.url} does not answer: {problem or type(problem).__name__}."
            raise EnvironmentFault(message, "no-answer") from problem
        finally:
            connection.close()
        answer = _decoded(text)
        if status < 300:
            return answer
        message = answer.get("error") or f"{self.url} answers {status} to {method} {path}."
        if status >= 500:
            raise EnvironmentFault(message, "not-now")
        raise InputError(message, "no-key" if status == 401 else "refused", self.url)


def _decoded(text: bytes) -> dict[str, Any]:
    try:
        answer = json.loads(text) if text else {}
    except ValueError:
        return {}
    return answer if isinstance(answer, dict) else {"answer": answer}
