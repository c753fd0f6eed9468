"""Requests that would cost everybody much, and what people see after an ordinary slip."""

import asyncio
import json
import re
import threading
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from urllib.parse import urlencode

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from starlette.requests import Request
from support.command_lines import call
from support.tools import require

from orchestrator.errors import EnvironmentFault, InputError
from orchestrator.service import accounts, binding, borders, database, interface, live, shown, states, wire
from orchestrator.service.borders import Refusal
from orchestrator.service.client import Client
from orchestrator.service.records import Conduct, Outcome, Person, State, Submission
from orchestrator.service.turns import MAX_WAITING, PRESENCE, Presence, Turns, network
from service.conftest import ALONE, SOME, Asker, fmu
from service.test_service import INTERFACE, under_way

require("starlette", "uvicorn", "httpx2")

FORM = {"content-type": "application/x-www-form-urlencoded"}
UPLOAD = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.fmu"\r\n\r\nPK\r\n--x--\r\n'


PLAIN = {"content-type": "multipart/form-data; boundary=x"}


@pytest.mark.parametrize("charset", ["punycode", "utf-8", '"UTF-7"'])
def test_an_upload_is_in_utf_8_whatever_charset_it_names(me, charset):
    """Punycode is quadratic: a name of 1 MB kept everybody waiting for two minutes."""
    kind = f"multipart/form-data; boundary=x; Charset={charset}"
    assert me.post("/runs", UPLOAD.replace(b"a.fmu", "\xe4.fmu".encode()), **{"content-type": kind}).status_code == 303
    assert me.get("/api/runs").json()[0]["name"] == "\xe4.fmu"


DISPOSITION = b'Content-Disposition: form-data; name="file"; filename="a.fmu"'
SPELLED = {
    "as .NET does": (M := "multipart/form-data; boundary=x", b"name=file; filename=a.fmu; filename*=utf-8''a.fmu"),
    "the other way round": (M, b'filename="a.fmu"; name="file"'),
    "with blanks": (M, b'name = "file" ; filename = "a.fmu"'),
    "in capitals": (M, b'NAME="file"; FILENAME="a.fmu"'),
    "behind another line": (M, b'name="file"; filename="a.fmu"\r\nContent-Type: a/b'),
    "a boundary in quotation marks": ('multipart/form-data; boundary="x"', b'name="file"; filename="a.fmu"'),
    "a semicolon behind": ("Multipart/Form-Data;boundary=x;", b'name="file"; filename="a.fmu"'),
}


@pytest.mark.parametrize("kind, field", SPELLED.values(), ids=SPELLED)
@pytest.mark.parametrize("before", [b"", b"\r\n", b"before\r\n\r\n"])
def test_an_upload_is_spelled_in_many_ways(me, kind, field, before):
    form = before + UPLOAD.replace(DISPOSITION, b"Content-Disposition: form-data; " + field)
    assert me.post("/runs", form, **{"content-type": kind}).status_code == 303
    assert me.get("/api/runs").json()[0]["name"] == "a.fmu"


FIELD = b'--x\r\nContent-Disposition: form-data; name="more"\r\n\r\n1\r\n'
NOT_UPLOADS = {
    "nothing": b"",
    "another field before": FIELD + UPLOAD,
    "another field behind": UPLOAD.replace(b"--x--\r\n", FIELD + b"--x--\r\n"),
    "two files": UPLOAD.replace(b"--x--\r\n", UPLOAD),
    "another name": UPLOAD.replace(b'name="file"', b'name="files"'),
    "no name of a file": UPLOAD.replace(b'; filename="a.fmu"', b""),
    "no file chosen": UPLOAD.replace(b"a.fmu", b""),
    "another boundary": UPLOAD.replace(b"--x", b"--y"),
    "no end": UPLOAD.replace(b"--x--", b""),
    "half an end": UPLOAD.replace(b"--x--\r\n", b"--x"),
    "a long head": UPLOAD.replace(b"\r\n\r\n", b"\r\na: " + b"b" * 5000 + b"\r\n\r\n", 1),
    "no end of the head": b"--x\r\n" + b"a" * 100_000,
}


def test_a_body_that_never_pauses_has_an_end():
    """What was there already had no limit in time."""

    async def receive():
        return {"type": "http.request", "body": b"x", "more_body": True}

    async def read() -> None:
        request = Request({"type": "http", "method": "POST", "headers": []}, receive)
        with pytest.raises(Refusal, match="too long"):
            async for _ in borders.body(request, 20_000, 5.0, 0.05):
                pass

    asyncio.run(read())


@pytest.mark.parametrize("form", NOT_UPLOADS.values(), ids=NOT_UPLOADS)
def test_a_form_that_is_no_upload_leaves_nothing(me, tmp_path, form):
    refused = me.post("/runs", form, **PLAIN)
    assert refused.status_code == 400 and len(refused.text) < 10_000
    assert me.get("/api/runs").json() == []
    assert not [file for place in ("incoming", "fmus") for file in (tmp_path / "data" / place).iterdir()]


@pytest.mark.parametrize(
    "kind", ["", "multipart/form-data", "text/plain; boundary=x", f"multipart/form-data; boundary={'x' * 71}"]
)
def test_an_upload_says_that_it_is_one(me, kind):
    assert "This is no upload" in me.post("/runs", UPLOAD, **{"content-type": kind}).text


@given(
    boundary=st.text("-aZ0'()+_,./:?= ", min_size=1, max_size=70),
    before=st.binary(max_size=300),
    cuts=st.lists(st.integers(0, 900), max_size=8),
    data=st.data(),
)
def test_an_upload_is_what_was_in_the_form(boundary, before, cuts, data):
    """However it comes in pieces, and though it holds parts of its boundary."""
    part = data.draw(st.sampled_from([f"\r\n--{boundary}"[: n or None] for n in range(len(boundary) + 4)]))
    content = before + part.encode() * 3 + b"-" + before
    assume(f"\r\n--{boundary}".encode() not in content)
    head = (
        f'--{boundary}\r\nContent-Disposition: form-data; name="file"; filename="ä%22.fmu"\r\nContent-Type: a/b\r\n\r\n'
    )
    form = head.encode() + content + f"\r\n--{boundary}--\r\n".encode()

    async def pieces():
        at = 0
        for end in [*sorted(cuts), len(form)]:
            yield form[at:end]
            at = max(at, end)

    async def read():
        name, file = await wire.uploaded_file(f'multipart/form-data; boundary="{boundary}"', pieces())
        return name, b"".join([piece async for piece in file])

    assert asyncio.run(read()) == ('ä".fmu', content)


def test_lists_are_read_without_bindings(me):
    """200 runs with bindings of 0.5 MB took seconds, at each news, for each page that was open."""
    run = me.until(me.submit()["id"])
    text = "b" * 5000
    second = me.put(f"/api/runs/{run['id']}/binding", {"map": {"q_m": text}}).json()
    read = []
    me.client.app.state.service.database._connection.set_trace_callback(read.append)
    listed = me.get("/api/runs").json()
    me.client.app.state.service.database._connection.set_trace_callback(None)
    assert [each["id"] for each in listed] == [second["id"], run["id"]]
    assert read and not any("bindings" in statement for statement in read)
    assert text in me.run(second["id"])["binding"] and text in me.get(f"/runs/{second['id']}/binding.toml").text
    assert me.run(run["id"])["binding"] == ""


def test_a_form_is_small(me):
    """One person's forms of 1.5 MB stood in one line before those of all others, who waited for 109 s."""
    run = me.until(me.submit(fmu(checking={"kind": "refused", "reason": "none"}))["id"])
    for path in (f"/runs/{run['id']}/binding", "/comparisons", "/rounds"):
        refused = me.post(path, b"map:q_m=" + b"%41" * 22_000, **FORM)
        assert refused.status_code == 413 and "66 kB" in refused.text and refused.headers["connection"] == "close"
    assert "66 kB" in me.put(f"/api/runs/{run['id']}/binding", {"map": {"q_m": "b" * 70_000}}).text
    assert "268 MB" in me.post("/api/runs?name=a.fmu", b"", **{"content-length": "400000000"}).text


def test_the_largest_form_of_a_page_is_taken(me):
    """Names fill what a page may have, and each variable is given a value."""
    names = [f"controller.cascade[{n}].{'gain' * 12}"[:60] for n in range(interface.MOST)]
    like = INTERFACE["variables"][-1]
    variables = [{**like, "name": name} for name in names]
    assert sum(map(len, names)) > 0.95 * interface.MOST_TEXT
    files = {"interface.json": json.dumps({**INTERFACE, "variables": [*INTERFACE["variables"], *variables]})}
    run = me.until(me.submit(fmu(checking={"kind": "refused", "reason": "none", "files": files}))["id"])
    form = urlencode({f"set:{name}": "-1.2345678901e-05" for name in names}).encode()
    bound = me.post(f"/runs/{run['id']}/binding", form, **FORM)
    assert bound.status_code == 303 and 40_000 < len(form) < borders.MAX_FORM
    assert names[-1] in me.get(f"{bound.headers['location']}/binding.toml").text


@pytest.mark.parametrize("text", [b"run=" + b"%" * 60_000, b"run=%4", b"run=%E4\xe4", b"run=%zz"])
def test_what_no_browser_spells_is_no_form(me, text):
    """Python's parser takes seven times as long for it, and everybody waits."""
    refused = me.post("/comparisons", text, **FORM)
    assert refused.status_code == 400 and "This is no form" in refused.text


def turns_of(me, start):
    """The numbers of the turns of the service's loop in which the requests of ``start(application)`` began to be
    answered, and that of the turn in which the last one had ended."""
    answered, turn = [], 0

    async def count() -> None:
        nonlocal turn
        while True:
            turn += 1
            await asyncio.sleep(0)

    async def send(message):
        if message["type"] == "http.response.start":
            answered.append((turn, message["status"]))

    async def run() -> int:
        counting = asyncio.create_task(count())
        await asyncio.gather(*start(me.client.app, send))
        counting.cancel()
        return turn

    return answered, me.client.portal.call(run)


def scope_of(method: str, path: str, **headers: str):
    head = {"host": "127.0.0.1", **headers}
    return {
        "type": "http",
        "method": method,
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "headers": [(name.replace("_", "-").encode(), value.encode()) for name, value in head.items()],
        "client": ("127.0.0.1", 1),
        "root_path": "",
        "scheme": "http",
        "http_version": "1.1",
    }


def test_what_comes_from_elsewhere_takes_turns_as_well(me):
    """The borders stood before the turns: requests that they refuse had others wait for a second."""
    elsewhere = scope_of("GET", "/nothing", sec_fetch_site="cross-site")
    answered, _ = turns_of(me, lambda app, send: [app(dict(elsewhere), None, send) for _ in range(15)])
    assert {status for _, status in answered} == {403} and len({turn for turn, _ in answered}) == 15


def test_a_verification_may_take_as_much_longer_as_it_has_more_cases():
    conduct = Conduct()
    assert conduct.time("verifying") >= 11 * conduct.time("evaluating") > conduct.time("checking")


def test_a_folder_with_other_letters_is_refused_at_the_start(tmp_path):
    """Without a cache below it, no certificate of a round were standard, which shows after its close."""
    # An address that is none ends a service that would start.
    words = ("--trust", "--accounts", "--host", "203.0.113.1")
    refused = call("serve", "--data", "dä ta", *words, folder=tmp_path)
    assert (
        refused.code == 2 and "ASCII" in refused.err and "--data" in refused.err and not (tmp_path / "dä ta").exists()
    )


def test_a_slip_in_the_folder_makes_no_service(tmp_path):
    assert call("serve", "--data", "here", "--invite", "Ada", folder=tmp_path).code == 0
    for words in (("--people",), ("--remove", "Ada"), ("--organizer", "Ada")):
        refused = call("serve", "--data", "there", *words, folder=tmp_path)
        assert refused.code == 2 and "not the folder of a service" in refused.err
    assert not (tmp_path / "there").exists()


@pytest.mark.parametrize("name", ["Me", "ME", "\u3164", "A\u3164", "\u115f"])
def test_names_that_nobody_can_tell_apart_are_none(name, tmp_path):
    assert call("serve", "--invite", name, folder=tmp_path).code == 2


def test_blanks_make_no_other_name(tmp_path):
    for name in ("Ada Lovelace", " Ada   Lovelace "):
        assert call("serve", "--invite", name, folder=tmp_path).code == 0
    assert call("serve", "--people", folder=tmp_path).out == "Ada Lovelace\n"


@pytest.mark.parametrize(
    "url",
    [
        *("http://127.0.0.1:99999", "http://[::1", "http://127.0.0.1:a", "ftp://x", "http://", "http://a..b:9"),
        *(f"http://{'a' * 70}:9", "http://exa mple:9", "http://\u3002:9"),
    ],
)
def test_an_address_that_is_none_is_told(url):
    with pytest.raises(InputError, match="not the address"):
        Client(url)


@pytest.mark.parametrize("key", ["a\nb", "\u4f60", "a b", "\x7f"])
def test_a_key_that_is_none_is_told_and_not_repeated(key):
    with pytest.raises(InputError) as problem:
        Client("http://127.0.0.1:1", key)
    assert key not in str(problem.value)


def test_an_address_and_a_key_may_be_spelled_as_they_are_found():
    for url in ("http://127.0.0.1:9/ä", "http://127.0.0.1:9/join#1.2", "https://[::1]:9"):
        with pytest.raises(EnvironmentFault, match="does not answer"):
            Client(url, "1.2\n").ask("GET", "/api/runs")


def test_cookies_are_not_read_by_pythons_parser(serve, monkeypatch):
    """It took 24 s for these, and everybody waited."""

    def forbidden(head):
        raise AssertionError("the slow parser")

    client = serve(SOME)
    monkeypatch.setattr("starlette.requests.cookie_parser", forbidden)
    assert Asker(client).get("/", cookie='session="' + 60_000 * "\\" + '"').status_code == 303


def test_a_session_is_found_among_other_cookies(serve):
    client = serve(SOME)
    state = client.app.state.service.database
    token = accounts.begin_session(state, accounts.known(state, accounts.invited(state, "Ada")))
    asker = Asker(client)
    for cookie in (f"session={token}", f"a=b; session={token}", f"session={token}; session2=x; b"):
        assert asker.get("/api/runs", cookie=cookie).status_code == 200
    for cookie in (f"xsession={token}", f"session={token}x", f'session="{token}"', ""):
        assert asker.get("/api/runs", cookie=cookie).status_code == 401


def test_a_session_that_another_host_has_set_is_not_taken_for_ones_own(serve):
    """For one path it came first: what Ada uploaded was Bob's."""
    client = serve(SOME)
    state = client.app.state.service.database
    ada, bob = (
        accounts.begin_session(state, accounts.known(state, accounts.invited(state, name))) for name in ("Ada", "Bob")
    )
    asker = Asker(client)
    for cookie in (f"session={bob}; session={ada}", f"session={ada};session={bob}"):
        assert asker.get("/api/runs", cookie=cookie).status_code == 401
    for cookie in (f"session={bob}; __Host-session={ada}", f"__Host-session={ada}; session={bob}"):
        assert "Ada" in asker.get("/", cookie=cookie).text


def test_over_https_the_session_is_a_cookie_that_no_other_host_sets(serve):
    client = serve(SOME)
    key, own = accounts.invited(client.app.state.service.database, "Ada"), {"origin": "https://127.0.0.1:8080"}
    entered = client.post("/join", data={"key": key}, headers=own, follow_redirects=False)
    assert re.fullmatch(
        "__Host-session=[^;]+; HttpOnly; Max-Age=[0-9]+; Path=/; SameSite=lax; Secure", entered.headers["set-cookie"]
    )
    left = client.post(
        "/leave", headers={**own, "cookie": entered.headers["set-cookie"].partition(";")[0]}, follow_redirects=False
    )
    assert any(
        cookie.startswith('__Host-session=""') and "Secure" in cookie for cookie in left.headers.get_list("set-cookie")
    )


def test_a_binding_that_is_too_large_is_refused_before_it_is_written(monkeypatch):
    monkeypatch.setattr(binding, "_toml", None)
    for parameters in ({"a": [1] * 300_000}, {"a": [""] * 300_000}, {f"{n}": 1 for n in range(60_000)}):
        with pytest.raises(InputError, match="more than"):
            binding.written({}, parameters)


def test_somebody_has_so_many_runs(serve, limited):
    me = Asker(serve(limited(runs=2)))
    for name in ("a.fmu", "b.fmu"):
        me.until(me.submit(name=name)["id"])
    refused = me.post("/api/runs?name=c.fmu", fmu())
    assert refused.status_code == 507 and "Delete some" in refused.json()["error"]


def test_a_whole_invitation_is_a_key(serve, tmp_path):
    client = serve(SOME)
    link = call("serve", "--data", "data", "--invite", "Ada", folder=tmp_path).out.strip()
    assert Asker(client, link).get("/api/runs").status_code == 200
    form = f"key={link.replace('#', '%23')}".encode()
    entered = Asker(client).post("/join", form, **{"content-type": "application/x-www-form-urlencoded"})
    assert entered.status_code == 303


def test_somebody_has_so_many_sessions(serve, tmp_path, monkeypatch):
    monkeypatch.setattr(database, "MAX_SESSIONS", 3)
    state = serve(SOME).app.state.service.database
    key = accounts.invited(state, "Ada")
    ada = accounts.known(state, key)
    tokens = [accounts.begin_session(state, ada) for _ in range(5)]
    assert [accounts.in_session(state, token) is not None for token in tokens] == [False, False, True, True, True]


def test_a_stream_ends_with_the_key_it_was_opened_by(serve, monkeypatch):
    monkeypatch.setattr(live, "ALIVE", 0.2)
    client = serve(SOME)
    state = client.app.state.service.database
    key = accounts.invited(state, "Ada")
    told, end = [], threading.Timer(300, setattr, (client.app.state.service, "closing", True))
    end.start()
    with client.stream("GET", "/events", headers={"authorization": f"Bearer {key}"}) as stream:
        for line in stream.iter_lines():
            told += [line]
            if len(told) == 1:
                accounts.invited(state, "Ada")
    end.cancel()
    assert told[0].startswith("data: ") and not client.app.state.service.closing


def test_a_stream_says_that_it_is_alive_while_others_have_news(me, monkeypatch):
    monkeypatch.setattr(live, "ALIVE", 0.3)
    me.until(me.submit()["id"])
    service = me.client.app.state.service

    async def often(seconds):
        await asyncio.sleep(0.01)
        return True

    monkeypatch.setattr(service.runner, "news", often)
    end = threading.Timer(300, setattr, (service, "closing", True))
    end.start()
    told = []
    with me.client.stream("GET", "/events") as stream:
        for line in stream.iter_lines():
            told += [line]
            if line == ": alive":
                service.closing = True  # ends the stream
    end.cancel()
    assert ": alive" in told


def test_a_form_that_was_refused_stays_and_is_followed_by_the_runs_own_page(me):
    """Its address takes no GET: the page left it, with all that was typed."""
    id = me.submit(fmu(checking={"wait": 30, "files": {"interface.json": json.dumps(INTERFACE)}}))["id"]
    under_way(me, id)
    form = {"content-type": "application/x-www-form-urlencoded"}
    page = me.post(f"/runs/{id}/binding", b"map:q_m%5B1%5D=nothing", **form)
    assert page.status_code == 400 and 'role="alert"' in page.text
    assert '<div id="binding">' in page.text and f'data-page="/runs/{id}"' in page.text
    assert '<div id="binding" data-live>' in me.get(f"/runs/{id}").text


def test_the_command_repeats_what_is_shown(me):
    run = me.submit(fmu(evaluating={"wait": 30}))
    me.until(run["id"], "evaluating")
    assert me.run(run["id"])["command"] == "flexible-manipulator evaluate my.fmu --protocol quick"
    ended = replace(Submission("1" * 24, "me", "a", "a.fmu", "0" * 64, 1, 0.0), round="x", state=State.VERIFYING)
    assert ended.is_evaluated and not replace(ended, round="").is_evaluated


def test_the_table_tells_when_an_evaluation_has_ended():
    run = Submission("1" * 24, "me", "a", "a.fmu", "0" * 64, 1, 0.0, state=State.EVALUATING, running=True, started=5.0)
    finished, _ = states.ended(run, Outcome("evaluating", "done", cost=100.0, holds=True), 9.0)
    again, _ = states.started(replace(finished, state=State.VERIFYING), 20.0)
    assert (finished.finished, again.finished, again.started) == (9.0, 9.0, 20.0)


def test_the_evaluation_is_shown_while_a_run_is_verified(me):
    """In the table, too, with the time of its end."""
    files = {"evaluation/report.html": "<p>", "evaluation/scorecard.html": "<p>the scorecard of the evaluation</p>"}
    run = me.until(me.submit(fmu(evaluating={"cost": 88.125, "files": files}))["id"])
    service = me.client.app.state.service
    before = service.database.run(run["id"])
    (row,) = me.get("/api/table").json()
    assert row["finished"] == shown.moment(before.finished) and before.finished > before.started > 0.0
    service.database.change(before, replace(before, state=State.FAILED, round="1" * 24, started=2e9), "x", 1.0)
    page = me.get(f"/runs/{run['id']}").text
    assert "88.1" in page and "the scorecard of the evaluation" in page and "evaluation/report.html" in page
    assert me.get("/api/table").json() == [row]


def test_an_address_with_a_slash_leads_nowhere_else(me):
    answer = me.get("/rounds/")
    assert answer.status_code == 404 and "location" not in answer.headers
    answer = me.get("/runs/x/binding")
    assert answer.status_code == 405 and "takes no GET" in answer.text


def test_what_is_deleted_is_given_back_to_the_disk(me):
    file = me.client.app.state.service.files.database
    run = me.until(me.submit()["id"])
    made = [me.put(f"/api/runs/{run['id']}/binding", {"map": {"q_m": "b" * 60_000}}).json()["id"] for _ in range(15)]
    for id in made:
        me.until(id)
    before = file.stat().st_size
    for id in made:
        assert me.delete(f"/api/runs/{id}").status_code == 204
    assert file.stat().st_size < before - 500_000


def test_folders_that_seem_empty_may_be_removed(serve):
    me = Asker(serve(ALONE))
    root = me.client.app.state.service.files.root
    for name in ("incoming", "fmus", "runs"):
        (root / name).rmdir()
    assert me.until(me.submit()["id"])["state"] == "finished"


def test_a_file_whose_run_is_deleted_is_no_fault(me):
    """It was looked for, and opened after the answer had begun: 4 tracebacks in 80 tries."""
    run = me.until(me.submit(fmu(evaluating={"files": {"evaluation/results.json": "{}"}}))["id"])
    file = me.client.app.state.service.files.run(run["id"]) / "evaluation" / "results.json"
    assert me.get(f"/api/runs/{run['id']}/files/evaluation/results.json").content == file.read_bytes()
    file.unlink()
    file.mkdir()  # what is there when it is looked for, and cannot be opened
    with pytest.raises(Refusal, match="cannot be read"):
        wire.file_answer(file, "application/json")
    file.rmdir()
    with pytest.raises(Refusal, match="no such file"):
        wire.file_answer(file, "application/json")


def test_a_client_that_leaves_leaves_no_file_open(tmp_path):
    """300 of them left 300 files open, and jobs need some to begin."""
    file, opened = tmp_path / "report.html", []
    file.write_bytes(bytes(3_000_000))

    async def gone(message):
        raise OSError

    async def ask() -> None:
        answer = wire.file_answer(file, "text/html")
        opened.append(answer._stream)
        with suppress(Exception):
            await answer({"type": "http", "asgi": {"spec_version": "2.4"}, "method": "GET"}, None, gone)

    asyncio.run(ask())
    assert opened[0].closed


def test_what_was_sent_is_not_sent_back_at_length(me):
    """260 answers of 8 MB that nobody read took 1.7 GB of memory."""
    files = {"interface.json": json.dumps(INTERFACE)}
    run = me.until(me.submit(fmu(checking={"kind": "refused", "reason": "none", "files": files}))["id"])
    refused = me.post(f"/runs/{run['id']}/binding", b"map:q_m[1]=" + b"'" * 60_000, **FORM)
    assert refused.status_code == 400 and "no variable" in refused.text and len(refused.content) < 200_000
    assert len(me.put(f"/api/runs/{run['id']}/binding", "x" * 1_000_000).content) < 5_000


def test_the_description_tells_the_types_of_files(me):
    paths = me.get("/api/openapi.json").json()["paths"]
    files = {"evaluation/results.json": "{}", "evaluation/report.html": "<p>"}
    run = me.until(me.submit(fmu(evaluating={"files": files}))["id"])
    told = paths["/api/runs/{id}/files/{place}/{file}"]["get"]["responses"]["200"]["content"]
    for name in ("results.json", "report.html"):
        assert me.get(f"/api/runs/{run['id']}/files/evaluation/{name}").headers["content-type"] in told
    assert list(paths["/api/rounds/{id}/table.csv"]["get"]["responses"]["200"]["content"]) == [
        "text/csv; charset=utf-8"
    ]
    elsewhere = me.get("/api/runs", host="evil.test")
    assert elsewhere.status_code == 403 and "127.0.0.1" in elsewhere.json()["error"]


def test_nobody_has_two_requests_in_one_turn_of_the_loop(me):
    """100 connections of a stranger had others wait for 14 s."""
    begun: list[str] = []

    async def answer(scope, receive, send):
        begun.append(scope["who"])

    async def ask() -> None:
        turns = Turns(answer)
        await asyncio.gather(*(turns({"type": "http", "who": who}, None, None) for who in ["many"] * 20 + ["other"]))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("orchestrator.service.turns.person_asking", lambda request: Person(request.scope["who"], ""))
        asyncio.run(ask())
    assert sorted(begun) == ["many"] * 20 + ["other"] and begun.index("other") <= 1


def answers_to(asking: list[tuple[str, str]]) -> list[tuple[str, int]]:
    """Who is answered by what, if all of these pairs of a person (a stranger: none) and an address ask at once."""
    told: list[tuple[str, int]] = []

    async def answer(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def ask() -> None:
        turns = Turns(answer)

        async def one(who: str, address: str) -> None:
            async def send(message):
                if message["type"] == "http.response.start":
                    told.append((who or address, message["status"]))
                    if message["status"] == 429:
                        head = dict(message["headers"])
                        assert head[b"retry-after"] == b"1" and head[b"connection"] == b"close"
                        assert head[b"cache-control"] == b"no-store"

            scope = {"type": "http", "who": who, "client": (address, 1), "path": "/", "method": "GET"}
            await turns(scope, None, send)

        await asyncio.gather(*(one(*each) for each in asking))

    def person(request):
        return Person(request.scope["who"], "") if request.scope["who"] else None

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("orchestrator.service.turns.person_asking", person)
        asyncio.run(ask())
    return told


def test_many_requests_of_somebody_do_not_wait():
    told = Counter(answers_to([("many", "a")] * 500 + [("other", "a")]))
    assert told == {("many", 200): MAX_WAITING, ("many", 429): 500 - MAX_WAITING, ("other", 200): 1}


def test_strangers_of_other_addresses_are_served_in_turn():
    """Three addresses had all other strangers refused (429), and those who have come in wait for none of them."""
    many = [("", f"10.0.0.{n}") for n in range(5) for _ in range(500)]
    told = answers_to([*many, ("", "10.0.1.1"), ("", "2001:db8::1"), ("other", "10.0.0.1")])
    assert Counter(told)["10.0.0.3", 200] == MAX_WAITING
    served = [who for who, status in told if status == 200]
    assert served.index("other") <= 1 and served.index("10.0.1.1") <= 8 and served.index("2001:db8::1") <= 8


def test_an_address_of_ipv6_is_one_of_many_that_somebody_has():
    assert network("2001:db8::1") == network("2001:db8::ffff:2") != network("2001:db8:0:1::1")
    assert network("::ffff:10.0.0.1") == network("10.0.0.1") != network("10.0.0.2")
    assert network("fe80::1%eth0") == network("fe80::2") and network("testclient") == "testclient"


def test_who_has_left_waits_no_longer():
    """One connection at a time had everybody else told that the service is not available (503)."""
    begun: list[int] = []

    async def answer(scope, receive, send):
        begun.append(scope["number"])

    async def ask() -> None:
        turns, clients = Turns(answer), [Presence() for _ in range(MAX_WAITING)]
        clients[7].end()  # before its request is looked at

        def asked(number: int, client: Presence):
            scope = {"type": "http", "number": number, "client": ("10.0.0.1", 1), "state": {PRESENCE: client}}
            return asyncio.create_task(turns(scope, None, None))

        asking = [asked(number, client) for number, client in enumerate(clients)]
        await asyncio.sleep(0)
        for client in clients[10:]:
            client.end()
        await asyncio.sleep(0)
        asking.append(asked(1000, Presence()))  # there is a place again
        await asyncio.gather(*asking)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("orchestrator.service.turns.person_asking", lambda request: None)
        asyncio.run(ask())
    assert begun == [0, 1, 2, 3, 4, 5, 6, 8, 9, 1000]


def test_a_browser_keeps_its_session_for_encrypted_pages_alone(serve):
    client = serve(SOME)
    for origin, secure in (("https://127.0.0.1:8080", True), ("http://127.0.0.1:8080", False)):
        key = accounts.invited(client.app.state.service.database, "Ada")
        came = client.post("/join", data={"key": key}, headers={"origin": origin}, follow_redirects=False)
        assert came.status_code == 303 and ("secure" in came.headers["set-cookie"].lower()) is secure


@pytest.mark.parametrize("given", ["{}/join#abc.secret", "http://me:secret@{}/", "{}"])
def test_a_program_tells_no_key(given):
    assert Client(given.format("bench.example.org:8080")).url == "http://bench.example.org:8080"
