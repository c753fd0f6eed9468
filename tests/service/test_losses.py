"""What an operator's attack showed to be lost: work that was done, a person's place, and everybody's time."""

import asyncio
import io
import json
import os
import shutil
import signal
import sqlite3
import tempfile
import threading
import time
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path

import pytest
from support.command_lines import call
from support.refusals import refusal
from support.tools import require

from orchestrator.api.benchmark import Benchmark
from orchestrator.cache import VARIABLE, incomplete
from orchestrator.conformance.finding import Finding, Severity
from orchestrator.errors import EnvironmentFault, InputError
from orchestrator.service import accounts, job, runner, states
from orchestrator.service.database import Database, _seal
from orchestrator.service.files import LEFT_OUT, Files, new_id, packed
from orchestrator.service.records import HandIn, Round, State, Task
from orchestrator.service.runner import Runner
from service.conftest import SOME, Asker, fmu
from service.test_rounds import RUN, Course, handed_in, verified
from service.test_service import under_way

require("starlette", "uvicorn", "httpx2")

DONE = {"stage": "evaluating", "kind": "done", "cost": 88.5, "holds": True, "disk": 1000}


def test_what_ended_before_the_end_of_a_service_is_stored_at_the_start(serve, tmp_path):
    """A round whose date had passed meanwhile was closed without it, and its bits were drawn."""
    client = serve()
    me = Asker(client)
    id = me.submit(fmu(evaluating={"wait": 300}))["id"]
    me.until(id, "evaluating")
    while not client.app.state.service.database.run(id).running:
        time.sleep(0.05)
    folder = client.app.state.service.files.run(id)
    client.__exit__(None, None, None)
    (folder / "evaluating.json").write_text(json.dumps(DONE))
    again = Asker(serve())
    run = again.run(id)
    assert run["state"] == "finished" and run["cost"] == 88.5 and "queued again" not in json.dumps(run["history"])


@pytest.mark.parametrize("by", ["hand", "date"])
def test_a_round_waits_for_an_outcome_that_is_being_stored(serve, monkeypatch, by):
    """While another process had locked the database over the date, a run that had finished did not count."""
    course, stored, waits = Course(serve(SOME)), threading.Event(), threading.Event()
    ada, keep = course.person("Ada"), Runner._stored

    async def late(runner, live, outcome):
        if outcome.stage == "evaluating":
            waits.set()
            while not stored.is_set():
                await asyncio.sleep(0.01)
        await keep(runner, live, outcome)

    monkeypatch.setattr(Runner, "_stored", late)
    round = course.open() if by == "hand" else course.open(seconds=6)
    id = ada.submit(fmu(verifying=verified(90.0)))["id"]
    assert waits.wait(60)
    if by == "hand":
        assert course.teacher.post(f"/api/rounds/{round}/close").status_code == 503
    else:
        time.sleep(8)
        assert course.teacher.get(f"/api/rounds/{round}").json()["phase"] == "open"
    stored.set()
    ada.until(id, "finished", "verifying")
    if by == "hand":
        course.close(round)
    assert [entry["person"] for entry in course.until(round)["entries"]] == ["Ada"]


def test_what_is_on_the_disk_at_the_close_of_a_round_counts(serve, monkeypatch):
    """A service that was stopped over the date had not heard of the end of the job; after a kill -9, it counted."""
    course, done = Course(serve(SOME)), {"evaluating.json": json.dumps(DONE)}
    ada, service = course.person("Ada"), course.client.app.state.service
    round = course.open()
    id = ada.submit(fmu(evaluating={"files": done, "wait": 300}, verifying=verified(90.0)))["id"]
    while not (file := service.files.run(id) / "evaluating.json").exists():
        time.sleep(0.05)
    written = file.stat().st_mtime
    assert service.runner.is_storing(written) and not service.runner.is_storing(written - 1.0)
    assert course.teacher.post(f"/api/rounds/{round}/close").status_code == 503
    monkeypatch.setattr(runner, "END_TIME", 0.0)  # a job that does not end after its outcome keeps no round open
    assert ada.until(id)["cost"] == 88.5
    course.close(round)
    assert [entry["person"] for entry in course.until(round)["entries"]] == ["Ada"]


def test_nobody_waits_for_a_removal(me, monkeypatch):
    """That of an FMU with 15,000 folders took 31 s."""
    files, removed, remove = me.client.app.state.service.files, threading.Event(), shutil.rmtree
    run = me.until(me.submit()["id"])
    (files.cache / "fmus" / run["sha256"] / "resources").mkdir(parents=True)

    def slow(*given, **named):
        removed.wait(60)
        remove(*given, **named)

    monkeypatch.setattr("orchestrator.service.files.shutil.rmtree", slow)
    assert me.delete(f"/api/runs/{run['id']}").status_code == 204
    assert not files.run(run["id"]).exists() and not (files.cache / "fmus" / run["sha256"]).exists()
    assert list((files.root / "incoming").iterdir()) and list((files.cache / "removed").iterdir())
    removed.set()
    for _ in range(200):
        if not [*(files.root / "incoming").iterdir(), *(files.cache / "removed").iterdir()]:
            return
        time.sleep(0.05)
    raise AssertionError("what was deleted is on the disk")


def test_a_start_removes_what_an_end_left_of_a_removal(serve, tmp_path):
    client = serve()
    files = client.app.state.service.files
    client.__exit__(None, None, None)
    for bin in (files.root / "incoming", files.cache / "removed"):
        (bin / "left" / "a").mkdir(parents=True)
    serve()
    for _ in range(200):
        if not [*(files.root / "incoming").iterdir(), *(files.cache / "removed").iterdir()]:
            return
        time.sleep(0.05)
    raise AssertionError("what was deleted is on the disk")


def test_a_copy_has_the_runs_whose_fmu_is_gone(serve, tmp_path):
    """One of a final round was dropped in silence, and its person's place with it."""
    client = serve()
    me = Asker(client)
    kept = me.until(me.submit()["id"])
    client.app.state.service.files.fmu(kept["sha256"]).unlink()
    assert call("serve", "--data", "data", "--backup", "copy", folder=tmp_path).code == 0
    assert [run["id"] for run in Asker(serve(folder=tmp_path / "copy")).get("/api/runs").json()] == [kept["id"]]


def test_another_upload_mends_a_damaged_fmu(tmp_path):
    """A message asked for it, and each attempt began with the damaged file."""
    files = Files(tmp_path / "data")
    files.prepare()
    id, sha256 = "a" * 24, "b" * 64
    files.fmu(sha256).write_bytes(b"PK damaged")
    file = files.begin(id, sha256, "my.fmu", "") / "my.fmu"
    assert file.read_bytes() == b"PK damaged" and files.fmu(sha256).samefile(file)
    whole = tmp_path / "whole"
    whole.write_bytes(b"PK whole")
    whole.replace(files.fmu(sha256))
    files.begin(id, sha256, "my.fmu", "")
    assert file.read_bytes() == b"PK whole" and sorted(entry.name for entry in file.parent.iterdir()) == ["my.fmu"]


def test_a_sandbox_that_is_gone_is_no_fault_of_the_fmu(tmp_path, monkeypatch):
    """While bubblewrap was upgraded, each check refused its controller for good."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.fmu").write_bytes(b"PK")
    found = Finding(Severity.ERROR, "import", "The sandbox does not work on this machine.", what="no-sandbox")
    monkeypatch.setattr(Benchmark, "iter_check", lambda *_, **__: iter([found]))
    task = Task("checking", "my.fmu", "", "quick", 1, True)
    outcome = job.done(task, tmp_path, lambda *_: None)
    assert outcome.kind == "fault" and "sandbox" in outcome.reason
    monkeypatch.setattr(Benchmark, "iter_check", lambda *_, **__: iter([replace(found, what="no-connector")]))
    assert job.done(task, tmp_path, lambda *_: None).kind == "refused"


def test_an_upload_that_cannot_be_stored_leaves_nothing(me, monkeypatch):
    files = me.client.app.state.service.files

    def locked(*_):
        raise EnvironmentFault("The service's database is locked.", "locked-database")

    monkeypatch.setattr(Database, "add_run", locked)
    assert me.post("/api/runs?name=a.fmu", fmu()).status_code == 503
    assert list((files.root / "fmus").iterdir()) == [] and list((files.root / "incoming").iterdir()) == []


def test_no_failure_of_a_start_leaves_a_round_without_an_end(serve, monkeypatch):
    """A thread that could not be started left the stage under way for ever, and the round in verification."""
    monkeypatch.setattr(states, "DELAYS", (0.0, 0.0))
    course, keep, failed = Course(serve(SOME)), Runner._done, []
    ada = course.person("Ada")
    round = course.open()
    ada.until(ada.submit(fmu(verifying=verified(90.0)))["id"])

    async def once(runner, live, folder, stage):
        if stage == "verifying" and not failed:
            failed.append(stage)
            raise RuntimeError("can't start new thread")
        return await keep(runner, live, folder, stage)

    monkeypatch.setattr(Runner, "_done", once)
    course.close(round)
    assert [entry["person"] for entry in course.until(round)["entries"]] == ["Ada"] and failed


def test_a_folder_that_cannot_be_used_ends_its_stage(serve, monkeypatch):
    """It was tried without end, and its round was never final."""
    monkeypatch.setattr(states, "DELAYS", (0.0, 0.0))
    course = Course(serve(SOME))
    ada, files = course.person("Ada"), course.client.app.state.service.files
    round = course.open()
    id = ada.submit(fmu(verifying=verified(90.0)))["id"]
    ada.until(id)
    files.run(id).rename(files.run(id).with_suffix(".aside"))
    files.run(id).write_text("in its place")
    course.close(round)
    assert "cannot be written" in ada.until(id, "failed")["reason"]
    files.run(id).unlink()
    files.run(id).with_suffix(".aside").rename(files.run(id))
    assert course.teacher.post(f"/api/rounds/{round}/verify").status_code == 200
    assert [entry["person"] for entry in course.until(round)["entries"]] == ["Ada"]


def test_a_lock_that_cannot_be_taken_is_told(tmp_path):
    (tmp_path / "data" / ".lock").mkdir(parents=True)
    refused = call("serve", "--data", "data", "--trust", "--port", "0", folder=tmp_path)
    assert refused.code == 2 and ".lock cannot be written" in refused.err


def test_a_database_that_cannot_be_read_is_told(serve, monkeypatch):
    client = serve(SOME)
    me = Asker(client, accounts.invited(client.app.state.service.database, "Ada"))

    def damaged(*_):
        raise EnvironmentFault("The service's database cannot be read.", "no-database")

    monkeypatch.setattr(Database, "person", damaged)
    answer = me.get("/api/runs")
    assert answer.status_code == 503 and "cannot be read" in answer.json()["error"]


def gone(path) -> bool:
    """Whether a path is no more, within some seconds."""
    for _ in range(200):
        if not path.exists():
            return True
        time.sleep(0.05)
    return False


def test_what_a_cancelled_run_has_extracted_goes_though_its_job_had_an_outcome(me):
    """Between the outcome and the end of the job, it stayed, in nobody's quota."""
    service, done = me.client.app.state.service, {**DONE, "stage": "checking"}
    id = me.submit(fmu(checking={"files": {"checking.json": json.dumps(done)}, "wait": 300}))["id"]
    under_way(me, id)
    extracted = service.files.cache / "fmus" / service.database.run(id).sha256
    extracted.mkdir(parents=True)
    while not (service.files.run(id) / "checking.json").exists():
        time.sleep(0.05)
    me.post(f"/api/runs/{id}/cancel")
    assert gone(extracted)


def test_what_was_extracted_goes_with_the_last_run_that_counts_it(me):
    """A second run with the same FMU, cancelled before its check, kept it and counted nothing."""
    service = me.client.app.state.service
    run = service.database.run(me.until(me.submit()["id"])["id"])
    service.database.add_run(replace(run, id=new_id(), state=State.CANCELLED, disk=0), "received")
    extracted = service.files.cache / "fmus" / run.sha256
    extracted.mkdir(parents=True)
    assert me.delete(f"/api/runs/{run.id}").status_code == 204
    assert not extracted.exists() and service.files.fmu(run.sha256).exists()


def test_half_of_what_a_killed_job_extracted_is_removed(me):
    """It outlived the run and the service."""
    service = me.client.app.state.service
    id = me.submit(fmu(checking={"wait": 300, "times": 1}))["id"]
    under_way(me, id)
    folder = service.files.cache / "fmus"
    folder.mkdir(parents=True, exist_ok=True)
    half = Path(tempfile.mkdtemp(prefix=incomplete(service.database.run(id).sha256), dir=folder))
    os.killpg(service.runner.live[id].process.pid, signal.SIGKILL)
    assert me.until(id)["state"] == "finished" and gone(half)


def test_a_start_removes_what_was_extracted_and_is_in_no_row(tmp_path, monkeypatch):
    """The jobs of a service that is killed are killed as well, or end by themselves."""
    monkeypatch.delenv(VARIABLE)
    files, (counted, uncounted, strange) = Files(tmp_path / "data"), ("a" * 64, "b" * 64, "c" * 64)
    files.prepare()
    folder = files.cache / "fmus"
    for name in (counted, uncounted, strange, f"{incomplete(counted)}x", f"{incomplete('d' * 64)}x"):
        (folder / name).mkdir(parents=True)
    files.sweep(set(), {counted, uncounted}, {counted})
    # One that no run has may be the plant's.
    assert {entry.name for entry in folder.iterdir()} == {counted, strange}
    # Another cache may be somebody else's as well, who is at work there.
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    other = tmp_path / "cache" / "fmus" / f"{incomplete('d' * 64)}x"
    other.mkdir(parents=True)
    files.sweep(set(), {counted, uncounted}, {counted})
    assert other.exists()


def test_who_deletes_what_has_finished_has_no_other_turn(me):
    """Who did so at once was served before all others: the time of the last start went with the run."""
    database = me.client.app.state.service.database
    id = me.until(me.submit()["id"])["id"]
    before = database.served()
    assert me.delete(f"/api/runs/{id}").status_code == 204
    assert before[accounts.LOCAL.id] > 0.0 and database.served() == before


def test_a_database_of_the_former_form_is_taken_over(tmp_path):
    """With whose turn it is, and the checksums of its runs and rounds."""
    file = tmp_path / "x.sqlite"
    database = Database(file)
    for person in (accounts.LOCAL, replace(accounts.LOCAL, id="new", name="new")):
        database.add_person(person, "", 0.0)
    run = replace(RUN, owner=accounts.LOCAL.id, started=5.0)
    database.add_run(run, "received")
    round, entry = Round("b" * 24, "Spring", 1.0, 9.0), HandIn(accounts.LOCAL.id, run.id, "me", "my.fmu")
    database.add_round(round)
    round = replace(round, closed=8.0, bits="0" * 64)
    database.close_round(round, [entry], [])
    database.close()
    of_5 = """
        ALTER TABLE rounds DROP COLUMN seal; ALTER TABLE entries DROP COLUMN seal; DROP TRIGGER bits_stay;
        CREATE TRIGGER bits_stay BEFORE UPDATE ON rounds WHEN OLD.bits <> ''
        BEGIN SELECT RAISE(ABORT, 'drawn already'); END; UPDATE form SET number = 5;
    """
    of_4 = f"{of_5} ALTER TABLE people DROP COLUMN served; ALTER TABLE runs DROP COLUMN seal;"
    for former in (f"{of_4} UPDATE form SET number = 4", of_5):
        sqlite3.connect(file).executescript(former)
        database = Database(file)
        database.check()
        assert (database.served(), database.run(run.id)) == ({accounts.LOCAL.id: 5.0, "new": 0.0}, run)
        assert (database.rounds(), database.entries(round.id)) == ([round], [entry])
        with pytest.raises(sqlite3.IntegrityError, match="drawn already"):
            database._connection.execute("UPDATE rounds SET bits = ?", ("1" * 64,))
        database.close()
    for form in (3, 7):
        sqlite3.connect(file).executescript(f"UPDATE form SET number = {form}")
        assert refusal(Database, file, kind=InputError).what == "other-database"


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [("runs", "cost", 91.0), ("rounds", "bits", "1" + "0" * 63), ("rounds", "closes", 8.5)]
    + [("entries", column, "x") for column in ("owner", "run", "person", "name")],
)
def test_what_a_place_follows_from_has_a_checksum(tmp_path, table, column, value):
    """One bit of a round's bits that was another gave other draws in silence."""
    database = Database(tmp_path / "x.sqlite")
    database.add_person(accounts.LOCAL, "", 0.0)
    database.add_run(replace(RUN, owner=accounts.LOCAL.id), "received")
    round = Round("b" * 24, "Spring", 1.0, 9.0)
    database.add_round(round)
    database.choose(round.id, HandIn("other", "c" * 24))
    database.choose(round.id, HandIn(accounts.LOCAL.id, RUN.id))
    database.check()
    entries = [HandIn(owner, RUN.id, "me", "my.fmu") for owner in (accounts.LOCAL.id, "other")]
    database.close_round(replace(round, closed=8.0, bits="0" * 64), entries, [])
    database.check()
    database._connection.execute("DROP TRIGGER bits_stay")
    database._connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = 1", (value,))
    assert f"is damaged: what it has in {table}" in str(refusal(database.check, kind=EnvironmentFault))
    database.close()


def test_who_is_removed_leaves_a_closed_round_whole(tmp_path):
    database = Database(tmp_path / "x.sqlite")
    database.add_person(accounts.LOCAL, "", 0.0)
    round = Round("b" * 24, "Spring", 1.0, 9.0)
    database.add_round(round)
    entry = HandIn(accounts.LOCAL.id, RUN.id, "me", "my.fmu")
    database.close_round(replace(round, closed=8.0, bits="0" * 64), [entry], [])
    database.remove_person(accounts.LOCAL.id)
    database.check()
    assert database.entries(round.id) == [replace(entry, person="", name="")]
    database.close()


def test_a_folder_that_cannot_be_read_costs_no_page(me, monkeypatch):
    """As after a restore by another user; the page of its run answered 500."""
    id, keep = me.until(me.submit()["id"])["id"], os.stat
    folder = str(me.client.app.state.service.files.run(id))

    def refused(path, *given, **named):
        if str(path).startswith(folder):
            raise PermissionError(13, "Permission denied")
        return keep(path, *given, **named)

    monkeypatch.setattr(os, "stat", refused)
    answer = me.get(f"/runs/{id}")
    assert answer.status_code == 200 and "cannot be read on the service" in answer.text
    assert me.get(f"/runs/{id}/evaluation/report.html").status_code == 404


def test_a_certificate_that_cannot_be_read_keeps_the_others_from_nobody(serve):
    course = Course(serve(SOME))
    ada, ben = course.person("Ada"), course.person("Ben")
    round = course.open()
    first, second = (handed_in(person, fmu(verifying=verified(90.0))) for person in (ada, ben))
    course.close(round)
    course.until(round)
    file = course.client.app.state.service.files.run(first) / "verification" / "verification.json"
    file.unlink()
    file.mkdir()
    answer = ada.get(f"/api/rounds/{round}/certificates.zip")
    assert answer.status_code == 200
    with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
        assert set(archive.namelist()) == {f"{second}.json", LEFT_OUT}
        assert f"{first}.json cannot be read" in archive.read(LEFT_OUT).decode()


def test_what_belongs_to_another_user_is_to_be_given_back(tmp_path, monkeypatch):
    """After a command as root, the service said "Choose another folder"."""
    files, user, access, nobody = Files(tmp_path / "data"), os.geteuid(), os.access, 54321
    files.prepare()
    Database(files.database).close()
    monkeypatch.setattr(os, "geteuid", lambda: nobody)
    monkeypatch.setattr(os, "access", lambda path, mode: path != files.database and access(path, mode))
    told = refusal(files.prepare, kind=InputError)
    assert told.what == "foreign-folder" and f"chown -R {nobody} {files.root}" in str(told)
    monkeypatch.setattr(os, "access", access)
    (files.root / "runs").rmdir()
    (files.root / "runs").touch()  # it cannot be written to
    told = refusal(files.prepare, kind=InputError)
    assert told.what == "foreign-folder" and f"{files.root / 'runs'} cannot be written to" in str(told)
    monkeypatch.setattr(os, "geteuid", lambda: user)
    assert refusal(files.prepare, kind=InputError).what == "folder-not-writable"


def test_a_list_of_people_makes_no_folder(tmp_path):
    """As root, it made some in which the service could not write."""
    assert call("serve", "--data", "data", "--invite", "Ada", folder=tmp_path).code == 0
    for name in ("cache", "incoming", "runs"):
        shutil.rmtree(tmp_path / "data" / name, ignore_errors=True)
    before = {entry.name for entry in (tmp_path / "data").iterdir()}
    for words in (["--people"], ["--organizer", "Ada"], ["--remove", "Ada"]):
        assert call("serve", "--data", "data", *words, folder=tmp_path).code == 0
    assert {entry.name for entry in (tmp_path / "data").iterdir()} == before


def test_there_are_certificates_where_the_clock_has_no_battery(tmp_path, monkeypatch):
    monkeypatch.setattr("orchestrator.service.files.time.localtime", lambda: time.gmtime(5.0))
    (tmp_path / "a.json").write_text("{}" * 1000)
    with zipfile.ZipFile(io.BytesIO(packed({"a.json": tmp_path / "a.json", LEFT_OUT: tmp_path}))) as archive:
        assert [entry.date_time[0] for entry in archive.infolist()] == [1980, 1980]
        assert archive.read("a.json") == b"{}" * 1000 and archive.getinfo("a.json").compress_size < 1000


def test_a_checksum_is_the_same_with_every_version_of_python():
    """``repr`` spells letters of a newer Unicode by their numbers in an older Python, as they are in a newer one."""
    letter = "\U0001fae8"  # of Unicode 15, which Python 3.11 does not know
    assert _seal(letter, 1.5, None) == zlib.crc32(b"('\\U0001fae8', 1.5, None)")
