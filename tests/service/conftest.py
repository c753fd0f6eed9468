"""A service in this process, with jobs that compute nothing, and somebody who asks it."""

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.tools import require

from orchestrator.service.records import Allowance, Conduct, Settings

FAKE = (str(Path(__file__).with_name("fake_job.py")),)
ALONE = Settings(conduct=Conduct(processes=1, sandbox=False))
SOME = replace(ALONE, accounts=True)
HOST = "http://127.0.0.1:8080"


def fmu(**stages: Any) -> bytes:
    """An FMU that tells the job what to do."""
    return b"PK" + json.dumps(stages).encode()


class Asker:
    """Somebody who asks a service, with a browser or a program."""

    def __init__(self, client: Any, key: str = "") -> None:
        self.client, self.headers = client, {"authorization": f"Bearer {key}"} if key else {}

    def submit(self, content: bytes = b"", name: str = "my.fmu") -> dict[str, Any]:
        answer = self.post(f"/api/runs?name={name}", content or fmu())
        assert answer.status_code == 201, answer.text
        return answer.json()

    def post(self, path: str, content: bytes = b"", **headers: str) -> Any:
        return self.client.post(path, content=content, headers={**self.headers, **headers}, follow_redirects=False)

    def get(self, path: str, **headers: str) -> Any:
        return self.client.get(path, headers={**self.headers, **headers}, follow_redirects=False)

    def put(self, path: str, value: Any) -> Any:
        return self.client.put(path, json=value, headers=self.headers)

    def delete(self, path: str) -> Any:
        return self.client.delete(path, headers=self.headers)

    def run(self, id: str) -> dict[str, Any]:
        return self.get(f"/api/runs/{id}").json()

    def until(self, id: str, *states: str, least: int = 0) -> dict[str, Any]:
        """The run when it is in one of these states, by default at its end."""
        for _ in range(6000):  # five minutes, on a machine that computes other things, too
            run = self.run(id)
            if run["revision"] >= least and (run["state"] in states if states else run["is_final"]):
                return run
            time.sleep(0.05)
        raise AssertionError(f"the run stays {run['state']}: {run}")


Serve = Callable[..., Any]


@pytest.fixture
def serve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Serve]:
    """A function that starts a service in a folder and gives a client, whose ``app.state`` has the service."""
    require("starlette", "uvicorn", "httpx2")
    from starlette.testclient import TestClient

    from orchestrator.service import states
    from orchestrator.service.app import application

    monkeypatch.setattr(states, "DELAYS", (0.0, 0.0))
    opened: list[Any] = []

    def begin(settings: Settings = ALONE, folder: Path | None = None, job: tuple[str, ...] = FAKE) -> Any:
        app = application(folder or tmp_path / "data", settings, job)
        client = TestClient(app, base_url=HOST, raise_server_exceptions=False)
        client.__enter__()
        opened.append(client)
        return client

    yield begin
    for client in opened:
        client.__exit__(None, None, None)


@pytest.fixture
def me(serve: Serve) -> Asker:
    """The one person of a service without accounts."""
    return Asker(serve())


@pytest.fixture
def limited() -> Callable[..., Settings]:
    """Settings with other limits."""
    return lambda accounts=False, **limits: replace(ALONE, accounts=accounts, limits=Allowance(**limits))
