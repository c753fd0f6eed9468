"""Rounds: what counts in them, their draws, and the final table, with jobs that compute nothing and with real ones."""

import csv
import io
import json
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import zipfile
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.command_lines import call
from support.tools import require

from orchestrator.service import accounts, rounds
from orchestrator.service.database import Database
from orchestrator.service.files import Files
from orchestrator.service.records import HandIn, Person, Round, State, Submission
from service.conftest import SOME, Asker, fmu
from service.test_jobs import ONE_POSE
from service.unusual import BINDING, unusual

require("starlette", "uvicorn", "httpx2")

RUN = Submission("a" * 24, "ada", "my.fmu", "my.fmu", "0" * 64, 100, 1.0, State.FINISHED, cost=90.0)
CERTIFICATE = {"verification/verification.json": "{}"}


def later(**time: float) -> str:
    return (datetime.now(timezone.utc) + timedelta(**time)).isoformat()


def verified(cost: float, holds: bool = True, **fields) -> dict:
    return {"cost": cost, "holds": holds, "files": CERTIFICATE, **fields}


class Course:
    """A service with an organizer, and people who hand in."""

    def __init__(self, client) -> None:
        self.client, self.people = client, client.app.state.service.database
        self.teacher = self.person("Teacher")
        accounts.made_organizer(self.people, "Teacher")

    def person(self, name: str) -> Asker:
        return Asker(self.client, accounts.invited(self.people, name))

    def open(self, **until: float) -> str:
        answer = self.client.post(
            "/api/rounds",
            json={"name": "Spring", "closes": later(**(until or {"days": 7}))},
            headers=self.teacher.headers,
        )
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    def close(self, round: str) -> dict:
        answer = self.teacher.post(f"/api/rounds/{round}/close")
        assert answer.status_code == 200, answer.text
        return answer.json()

    def until(self, round: str, phase: str = "final") -> dict:
        for _ in range(600):
            view = self.teacher.get(f"/api/rounds/{round}").json()
            if view["phase"] == phase:
                return view
            time.sleep(0.05)
        raise AssertionError(view)


@pytest.fixture
def course(serve) -> Course:
    return Course(serve(SOME))


def handed_in(person: Asker, content: bytes, name: str = "my.fmu") -> str:
    return person.until(person.submit(content, name)["id"], "finished")["id"]


def names(view: dict) -> list[tuple]:
    return [(row["place"], row["person"], row["name"], row["state"]) for row in view["entries"]]


def test_the_latest_finished_run_counts_unless_another_one_is_chosen():
    first, second = RUN, replace(RUN, id="b" * 24, created=2.0)
    bens = replace(RUN, id="c" * 24, owner="ben", created=1.5)
    runs = [first, bens, second]
    assert rounds.counted([], runs) == {"ada": second, "ben": bens}
    assert rounds.counted([HandIn("ada", first.id)], runs) == {"ada": first, "ben": bens}
    for gone_or_anothers in ("d" * 24, bens.id):
        assert rounds.counted([HandIn("ada", gone_or_anothers)], runs)["ada"] is second


def test_places_are_by_requirements_then_by_the_mean_of_v_and_equal_ones_share_one():
    told = [("a", 90.0, True, ""), ("b", 80.0, False, ""), ("c", 90.0, True, ""), ("d", 95.0, True, "")]
    told += [("e", 70.0, None, ""), ("f", 1.0, True, "incomplete"), ("g", None, None, "not verified: it hangs")]
    runs = [replace(RUN, id=id, drawn_cost=V, drawn_holds=holds, drawn_remark=why) for id, V, holds, why in told]
    assert rounds.places(runs) == {"a": 1, "c": 1, "d": 3, "e": 4, "b": 5}


def test_a_round_from_its_opening_to_the_final_table(course):
    ada, ben = course.person("Ada"), course.person("Ben")
    early = handed_in(ada, fmu(evaluating={"cost": 1.0}), "early.fmu")
    round = course.open()
    good = handed_in(ada, fmu(evaluating={"cost": 90.0}, verifying=verified(95.5)), "good.fmu")
    handed_in(ada, fmu(evaluating={"cost": 80.0}, verifying=verified(300.0)), "other.fmu")
    handed_in(ben, fmu(evaluating={"cost": 70.0}, verifying=verified(99.25, False, deviations="odd")), "=ben.fmu")
    waiting = ben.submit(fmu(evaluating={"wait": 60}), "late.fmu")["id"]
    ben.until(waiting, "evaluating")
    view = course.until(round, "open")
    assert names(view) == [(None, "Ben", "=ben.fmu", "provisional"), (None, "Ada", "other.fmu", "provisional")]
    assert [row["cost"] for row in view["entries"]] == [70.0, 80.0] and view["bits"] == ""
    assert ada.put(f"/api/rounds/{round}/choice", {"run": early}).status_code == 409
    assert ben.put(f"/api/rounds/{round}/choice", {"run": good}).status_code == 404
    assert ben.put(f"/api/rounds/{round}/choice", {"run": waiting}).status_code == 409
    assert ada.put(f"/api/rounds/{round}/choice", {"run": good}).json()["chosen"] == good
    assert ada.get(f"/api/rounds/{round}/certificates.zip").status_code == 409
    assert "Provisional table" in ada.get(f"/rounds/{round}").text
    course.close(round)
    assert ben.post(f"/api/runs/{waiting}/cancel").status_code == 200
    view = course.until(round)
    assert names(view) == [(1, "Ada", "good.fmu", "verified"), (2, "Ben", "=ben.fmu", "verified")]
    assert [(row["drawn_cost"], row["drawn_holds"], row["deviations"]) for row in view["entries"]] == [
        *((95.5, True, ""), (99.25, False, "odd"))
    ]
    assert len(view["bits"]) == 64
    assert "Final table" in ada.get(f"/rounds/{round}").text and "Close the round" not in ada.get("/").text
    rows = list(csv.DictReader(io.StringIO(ada.get(f"/api/rounds/{round}/table.csv").text)))
    assert [(row["place"], row["name"], row["drawn_cost"]) for row in rows] == [
        *(("1", "good.fmu", "95.5"), ("2", "'=ben.fmu", "99.25"))
    ]
    archive = zipfile.ZipFile(io.BytesIO(ada.get(f"/api/rounds/{round}/certificates.zip").content))
    assert sorted(archive.namelist()) == sorted(row["certificate"] for row in view["entries"])
    assert ada.run(good)["steps"][-1] == {"stage": "verifying", "state": "done"}
    assert "good.fmu" in [row["name"] for row in ada.get("/api/table").json()], "the list of all stays as it was"


def test_after_the_close_nothing_is_handed_in_chosen_or_cancelled_and_the_draws_stay(course):
    ada = course.person("Ada")
    round = course.open()
    first = handed_in(ada, fmu(x=1), "first.fmu")
    second = handed_in(ada, fmu(verifying={"wait": 60}), "second.fmu")
    view = course.close(round)
    assert names(view) == [(None, "Ada", "second.fmu", "verifying")] and view["bits"] == ""
    service = course.client.app.state.service
    bits = service.database.round(round).bits
    assert len(bits) == 64
    assert ada.put(f"/api/rounds/{round}/choice", {"run": first}).status_code == 409
    assert course.teacher.post(f"/api/rounds/{round}/close").status_code == 409
    assert ada.post(f"/api/runs/{second}/cancel").status_code == 409
    ada.until(ada.submit(fmu(x=2), "third.fmu")["id"], "evaluating")  # behind the verification
    assert names(course.until(round, "verifying")) == [(None, "Ada", "second.fmu", "verifying")]
    with pytest.raises(sqlite3.IntegrityError, match="drawn already"):
        sqlite3.connect(service.files.database).execute("UPDATE rounds SET bits = ?", ("0" * 64,))
    assert service.database.round(round).bits == bits


def test_only_an_organizer_opens_and_closes_and_one_round_at_a_time(course):
    ada, stranger = course.person("Ada"), Asker(course.client, "0" * 24 + ".x")
    wish = json.dumps({"name": "Mine", "closes": later(days=1)}).encode()
    assert ada.post("/api/rounds", wish).status_code == 403 and stranger.post("/api/rounds", wish).status_code == 401
    round = course.open()
    for path in (f"/api/rounds/{round}/close", f"/rounds/{round}/close", f"/api/rounds/{round}/verify"):
        assert ada.post(path).status_code == 403 and stranger.post(path).status_code == 401, path
        assert ada.get(path).status_code in (404, 405), "nothing changes by GET"
    assert "Close the round now" not in ada.get(f"/rounds/{round}").text
    assert "Close the round now" in course.teacher.get(f"/rounds/{round}").text
    assert "Open a round" not in ada.get("/rounds").text
    assert "Open a round" in course.teacher.get("/rounds").text and "Spring" in ada.get("/rounds").text
    assert course.teacher.post("/api/rounds", wish).status_code == 409
    for path in ("", "/table.csv", "/certificates.zip"):
        assert stranger.get(f"/api/rounds/{round}{path}").status_code == 401, path
    assert course.until(round, "open")["closed"] == ""


@pytest.mark.parametrize("headers", [{"origin": "http://evil.example"}, {"sec-fetch-site": "cross-site"}])
def test_pages_of_other_sites_close_nothing(me, headers):
    round = me.client.post("/api/rounds", json={"name": "Mine", "closes": later(days=1)}).json()["id"]
    for path in (f"/api/rounds/{round}/close", f"/rounds/{round}/close", "/rounds"):
        assert me.post(path, b"name=x&closes=2100-01-01T00:00", **headers).status_code == 403
    assert me.get(f"/api/rounds/{round}").json()["phase"] == "open" and len(me.get("/api/rounds").json()) == 1


@pytest.mark.parametrize(
    ("name", "closes", "what"),
    [
        ("", "2100-01-01T00:00", "needs a name"),
        ("x", "", "is no time"),
        ("x", "tomorrow", "is no time"),
        ("x", "2001-01-01T00:00", "in the future"),
        ("x", "9999-12-31T23:59-14:00", "within ten years"),
    ],
)
def test_a_round_that_cannot_be_is_refused_in_a_sentence_and_nothing_typed_is_lost(me, name, closes, what):
    from urllib.parse import urlencode

    answer = me.client.post("/api/rounds", json={"name": name, "closes": closes})
    assert answer.status_code == 400 and what in answer.json()["error"]
    own = {"origin": "http://127.0.0.1:8080"}
    page = me.post("/rounds", urlencode({"name": name, "closes": closes}).encode(), **own)
    assert page.status_code == 400 and what in page.text and f'value="{closes}"' in page.text


def test_the_form_of_the_organizer_opens_a_round_that_closes_at_its_date(me):
    """The one person of a service without accounts is its organizer."""
    from urllib.parse import urlencode

    own = {"origin": "http://127.0.0.1:8080"}
    end = (datetime.now(timezone.utc) + timedelta(seconds=2)).strftime("%Y-%m-%dT%H:%M:%S")  # as a browser sends it
    answer = me.post("/rounds", urlencode({"name": "<b>Mine</b>", "closes": end}).encode(), **own)
    place = answer.headers["location"]
    assert answer.status_code == 303 and "&lt;b&gt;Mine" in me.get(place).text and "<b>Mine" not in me.get("/").text
    handed_in(me, fmu(verifying=verified(90.0)))
    for _ in range(200):
        view = me.get(f"/api{place}").json()
        if view["phase"] == "final":
            break
        time.sleep(0.05)
    assert view["entries"][0]["drawn_cost"] == 90.0 and view["closed"] >= view["closes"]


def test_a_hostile_controller_costs_only_its_own_place(course):
    ada, ben, cid = course.person("Ada"), course.person("Ben"), course.person("Cid")
    round = course.open()
    handed_in(ada, fmu(verifying={"kind": "failed", "reason": "<i>it hangs"}), "ada.fmu")
    broken = handed_in(ben, fmu(verifying={"exit": 9, "times": 3, **verified(97.0)}), "ben.fmu")
    handed_in(cid, fmu(verifying=verified(99.0)), "cid.fmu")
    course.close(round)
    view = course.until(round)
    assert [row[:2] for row in names(view)] == [(1, "Cid"), (None, "Ada"), (None, "Ben")]
    assert view["entries"][1]["remark"] == "not verified: <i>it hangs"
    assert "nothing is held against the controller" in view["entries"][2]["remark"] and view["failed"] == 1
    page = course.teacher.get(f"/rounds/{round}").text
    assert "Verify again" in page and "<i>it" not in page
    bits = view["bits"]
    assert ben.post(f"/api/runs/{broken}/retry").status_code == 409, "an organizer decides"
    assert course.teacher.post(f"/api/rounds/{round}/verify").json()["phase"] == "verifying"
    assert ben.until(broken, "finished")
    view = course.until(round)
    assert view["entries"][0]["person"] in ("Ben", "Cid") and view["failed"] == 0 and view["bits"] == bits
    assert course.teacher.post(f"/api/rounds/{round}/verify").status_code == 409


def test_what_is_deleted_leaves_the_table_with_a_mark_and_who_is_removed_without_a_name(course):
    ada, ben, cid = course.person("Ada"), course.person("Ben"), course.person("Cid")
    round = course.open()
    runs = {
        name: handed_in(person, fmu(verifying=verified(90.0 + len(name)), x=name), name)
        for person, name in ((ada, "a.fmu"), (ben, "bb.fmu"), (cid, "ccc.fmu"))
    }
    course.close(round)
    course.until(round)
    assert ada.delete(f"/api/runs/{runs['a.fmu']}").status_code == 204
    accounts.removed(course.people, "Cid")
    view = course.until(round)
    assert names(view)[0] == (1, "Ben", "bb.fmu", "verified")
    assert sorted(names(view)[1:], key=str) == [(None, "", "", "deleted"), (None, "Ada", "a.fmu", "deleted")]
    archive = zipfile.ZipFile(io.BytesIO(ben.get(f"/api/rounds/{round}/certificates.zip").content))
    assert archive.namelist() == [f"{runs['bb.fmu']}.json"]


def test_a_round_that_is_being_verified_goes_on_after_the_end_of_the_service(serve):
    course = Course(serve(SOME))
    ada = course.person("Ada")
    round = course.open()
    run = handed_in(ada, fmu(verifying={"wait": 60, "times": 1}))
    course.close(round)
    for _ in range(600):
        if ada.run(run)["done"]:
            break
        time.sleep(0.02)
    bits = course.people.round(round).bits
    course.client.__exit__(None, None, None)
    course.client.__exit__ = lambda *_: None
    again = Course(serve(SOME))
    view = again.until(round)
    assert view["bits"] == bits and names(view) == [(1, "Ada", "my.fmu", "verified")]


def test_a_close_that_cannot_be_stored_has_drawn_nothing(course, monkeypatch):
    """All of it or nothing: a round without draws whose runs wait for them would wait for ever."""
    from orchestrator.service import database

    ada = course.person("Ada")
    round = course.open()
    run = handed_in(ada, fmu(verifying=verified(90.0)))

    def full(*_):
        raise sqlite3.OperationalError("database or disk is full")

    with monkeypatch.context() as patched:
        patched.setattr(database, "_change", full)
        answer = course.teacher.post(f"/api/rounds/{round}/close")
        assert answer.status_code == 503 and "disk is full" in answer.json()["error"]
        assert course.people.round(round).bits == "" and course.until(round, "open")["closed"] == ""
        assert ada.run(run)["state"] == "finished"
    course.close(round)
    assert course.until(round)["entries"][0]["place"] == 1


def test_a_round_that_lasts_until_a_date_takes_nothing_from_behind_it(tmp_path):
    """A service that is started after the date closes the round late."""
    database = Database(tmp_path / "x.sqlite")
    database.add_person(accounts.LOCAL, "", 0.0)
    round = Round("c" * 24, "x", 10.0, 20.0)
    database.add_round(round)
    for number, created in enumerate((9.0, 10.0, 19.9, 20.0)):
        database.add_run(replace(RUN, id=f"{number:024}", owner=accounts.LOCAL.id, created=created), "received")
    handed = database.handed_in(round, accounts.LOCAL.id)
    assert [run.created for run in handed] == [19.9, 10.0]
    assert [run.created for run in database.may_count(round)] == [19.9]
    database.choose(round.id, HandIn(accounts.LOCAL.id, handed[1].id))
    assert [run.created for run in database.handed_in(round, accounts.LOCAL.id, 1)] == [10.0]
    assert [run.created for run in database.may_count(round)] == [10.0, 19.9]
    assert [database.is_handed_in(round, f"{number:024}") for number in range(5)] == [False, True, True, False, False]


@given(
    runs=st.lists(st.tuples(st.integers(0, 3), st.floats(0, 30), st.booleans()), max_size=12),
    chosen=st.lists(st.tuples(st.integers(0, 3), st.integers(0, 11)), max_size=5),
)
def test_what_counts_follows_from_what_may_count(runs, chosen):
    """As from all that was handed in, of which there may be thousands."""
    round = Round("c" * 24, "x", 10.0, 20.0)
    with tempfile.TemporaryDirectory() as folder:
        database = Database(Path(folder, "x.sqlite"))
        for owner in range(4):
            database.add_person(Person(str(owner), str(owner)), str(owner), 0.0)
        database.add_round(round)
        made = [
            replace(RUN, id=f"{n:024}", owner=str(owner), created=created, cost=1.0 if done else None)
            for n, (owner, created, done) in enumerate(runs)
        ]
        for run in made:
            database.add_run(run, "received")
        for owner, number in chosen:
            database.choose(round.id, HandIn(str(owner), f"{number:024}"))
        entries = database.entries(round.id)
        all_of_them = [run for run in made if run.cost is not None and 10.0 <= run.created < 20.0]
        assert rounds.counted(entries, database.may_count(round)) == rounds.counted(entries, all_of_them)
        database.close()


def test_an_organizer_is_named_on_the_command_line(tmp_path):
    assert call("serve", "--organizer", "Ada", folder=tmp_path).code == 2
    call("serve", "--invite", "Ada", folder=tmp_path)
    assert call("serve", "--organizer", "Ada", folder=tmp_path).code == 0
    call("serve", "--invite", "Ada", folder=tmp_path)
    assert call("serve", "--people", folder=tmp_path).out == "Ada (organizer)\n"
    refused = call("serve", "--draws-protocol", "nowhere", "--trust", "--port", "0", folder=tmp_path)
    assert refused.code == 2 and "nowhere" in refused.err


@pytest.mark.slow
@pytest.mark.needs("posix")
def test_a_killed_service_verifies_a_round_whose_certificates_repeat_to_the_last_bit(quick_pid_file, tmp_path):
    from orchestrator.service.client import Client

    for name, base in (("short", "quick"), ("drawn", "verification")):
        text = ONE_POSE.format(name).replace('"quick"', f'"{base}"')
        (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
    data = tmp_path / "data"
    files = Files(data)
    files.prepare()
    database = Database(files.database)
    keys = {name: accounts.invited(database, name) for name in ("Ada", "Ben")}
    accounts.made_organizer(database, "Ada")
    short, drawn = str(tmp_path / "short.toml"), str(tmp_path / "drawn.toml")
    words = ["--accounts", "--trust", "--data", str(data), "--port", "0", "--evaluations", "2"]
    words += ["--jobs", "1", "--protocol", short, "--draws-protocol", drawn]

    def begin() -> tuple[subprocess.Popen, Client, Client]:
        command = [sys.executable, "-m", "orchestrator.serve", *words]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        url = process.stdout.readline().split()[0]
        return process, Client(url, keys["Ada"]), Client(url, keys["Ben"])

    def until(condition) -> dict:
        for _ in range(2400):  # a clean interpreter compiles everything, on a machine that computes other things, too
            view = ada.ask("GET", f"/api/rounds/{round}")
            if condition(view):
                return view
            time.sleep(0.5)
        raise AssertionError(view)

    bens = unusual(quick_pid_file, tmp_path / "bens.fmu")
    process, ada, ben = begin()
    try:
        wish = json.dumps({"name": "Spring", "closes": later(days=1)}).encode()
        round = ada.ask("POST", "/api/rounds", wish)["id"]
        adas = ada.follow(ada.submit(quick_pid_file)["id"], lambda run: None)
        refused = ben.follow(ben.submit(bens)["id"], lambda run: None)
        ben.bind(refused["id"], {"map": BINDING})
        bound = ben.follow(refused["id"], lambda run: None)
        assert adas["state"] == bound["state"] == "finished", (adas, bound)
        ada.ask("POST", f"/api/rounds/{round}/close")
        client = {adas["id"]: ada, bound["id"]: ben}
        until(lambda _: all(not client[id].ask("GET", f"/api/runs/{id}")["waiting"] for id in client))
        time.sleep(5.0)
        process.send_signal(signal.SIGKILL)
        process.wait()
        bits = database.round(round).bits
        process, ada, ben = begin()
        view = until(lambda view: view["phase"] == "final")
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(30)
        database.close()
    # The two are one law, and met the same draws.
    assert [(row["place"], row["state"]) for row in view["entries"]] == [(1, "verified"), (1, "verified")]
    assert view["bits"] == bits
    for run in (adas, bound):
        told = json.loads((files.run(run["id"]) / "verification" / "verification.json").read_text(encoding="utf-8"))
        assert told["entropy"]["value"] == bits and told["repetitions"] == 0 and told["clean"]
        assert told["entropy"]["source"] == "round"
    certificate = files.run(bound["id"]) / "verification" / "verification.json"
    command = [sys.executable, "-m", "orchestrator.verify", "--repeat", certificate, bens]
    repeated = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)  # it starts a clean interpreter
    assert repeated.returncode == 4 and "equal to the certificate, but not" in repeated.stderr, repeated
