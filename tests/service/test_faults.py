"""What an operator and a machine do to a service: nothing of anybody else's is lost, and no run stops the others."""

import asyncio
import contextlib
import errno
import hashlib
import io
import json
import logging
import os
import shutil
import signal
import sqlite3
import struct
import time
from dataclasses import replace
from pathlib import Path

import pytest
from support.command_lines import call
from support.refusals import refusal
from support.tools import require

from orchestrator.api.benchmark import Benchmark
from orchestrator.benchmark import protocol
from orchestrator.cli import guard
from orchestrator.cli.guard import REMEDIES
from orchestrator.errors import EnvironmentFault, InputError
from orchestrator.execution import store
from orchestrator.service import accounts, job, runner, server, states
from orchestrator.service.borders import Refusal
from orchestrator.service.database import LOCKED, Database
from orchestrator.service.files import FULL, Files
from orchestrator.service.records import Round, Task
from service.conftest import ALONE, SOME, Asker, fmu
from service.test_jobs import ONE_POSE
from service.test_rounds import RUN, Course, handed_in, verified
from service.test_service import under_way

require("starlette", "uvicorn", "httpx2")


def everything_below(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", ["thesis.tex", "runs/thesis/results.json", "fmus/controller.fmu"])
def test_a_folder_of_somebody_else_stays_as_it_is(name, tmp_path):
    """Whatever no row named was removed, such as the user's own folder ``runs``."""
    file = tmp_path / "mine" / name
    file.parent.mkdir(parents=True)
    file.write_text("my own")
    for words in (("--port", "0"), ("--invite", "Ada")):
        refused = call("serve", "--data", "mine", *words, folder=tmp_path)
        assert refused.code == 2 and "Choose an empty folder" in refused.err
    assert everything_below(tmp_path / "mine") == {name}


@pytest.mark.parametrize("loss", ["missing", "empty"])
def test_a_service_without_its_database_does_not_start_and_removes_nothing(loss, serve, tmp_path):
    client = serve()
    me = Asker(client)
    me.until(me.submit()["id"])
    client.__exit__(None, None, None)
    file = tmp_path / "data" / "service.sqlite"
    file.unlink() if loss == "missing" else file.write_bytes(b"")
    before = everything_below(tmp_path / "data")
    refused = call("serve", "--data", "data", "--port", "0", folder=tmp_path)
    assert refused.code == 2 and "no service.sqlite" in refused.err
    assert everything_below(tmp_path / "data") == before


def without_tables(file: Path, *, header: bool) -> None:
    """An empty database, or one that was emptied by a tool of SQLite, which leaves a page."""
    file.unlink()
    with contextlib.closing(sqlite3.connect(file)) as connection:
        if header:
            connection.executescript("CREATE TABLE x (a); DROP TABLE x")
    file.touch()


@pytest.mark.parametrize("header", [False, True], ids=["empty", "no tables"])
@pytest.mark.parametrize(
    "words", [("--port", "0"), ("--backup", "copy"), ("--people",), ("--remove", "Ada"), ("--organizer", "Ada")]
)
def test_tables_are_made_in_no_folder_with_runs(words, header, serve, tmp_path):
    """A copy of an empty database made its tables, and the next start removed all runs and FMUs."""
    client = serve()
    Asker(client).until(Asker(client).submit()["id"])
    ended(client)
    file = tmp_path / "data" / "service.sqlite"
    without_tables(file, header=header)
    content, before = file.read_bytes(), everything_below(tmp_path / "data")
    assert any(name.startswith("fmus/") for name in before) and any(name.startswith("runs/") for name in before)
    refused = call("serve", "--data", "data", *words, folder=tmp_path)
    assert refused.code == 2 and "whole copy of the service there" in refused.err
    assert (file.read_bytes(), everything_below(tmp_path / "data")) == (content, before)


@pytest.mark.parametrize("words", [("--backup", "copy"), ("--people",), ("--remove", "Ada"), ("--organizer", "Ada")])
def test_commands_for_people_and_copies_need_tables(words, tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "service.sqlite").touch()
    refused = call("serve", "--data", "data", *words, folder=tmp_path)
    assert refused.code == 2 and "no tables of a service" in refused.err
    assert (tmp_path / "data" / "service.sqlite").stat().st_size == 0
    assert call("serve", "--data", "data", "--invite", "Ada", folder=tmp_path).code == 0


@pytest.mark.parametrize("words", [("--port", "0"), ("--backup", "copy")])
@pytest.mark.parametrize(
    "damaged", [b"finished", b"CREATE TABLE runs", struct.pack(">d", 99.5)], ids=["a state", "the schema", "V"]
)
def test_one_bit_of_the_database_that_is_another_is_told(damaged, words, serve, tmp_path):
    """Pages answered 500 with a state that does not exist, with another hash the start removed an FMU, and another V
    stood in the table."""
    client = serve()
    Asker(client).until(Asker(client).submit()["id"])
    ended(client)
    file = tmp_path / "data" / "service.sqlite"
    content = bytearray(file.read_bytes())
    # Of the row, not of the text of the schema and of the history.
    place = content.find(damaged, 8 * 4096 if damaged == b"finished" else 0)
    assert place > 0
    content[place + 3] ^= 0x80 if damaged.startswith(b"CREATE") else 1
    file.write_bytes(content)
    refused = call("serve", "--data", "data", *words, folder=tmp_path)
    assert refused.code == 1 and "service's database" in refused.err and "Traceback" not in refused.err
    assert not (tmp_path / "copy" / "service.sqlite").exists()


def test_a_damaged_database_is_told_in_a_sentence(serve, tmp_path):
    client = serve()
    Asker(client).submit()
    client.__exit__(None, None, None)
    file = tmp_path / "data" / "service.sqlite"
    content = bytearray(file.read_bytes())
    content[4096 : 4096 * 3] = bytes(4096 * 2)
    file.write_bytes(content)
    refused = call("serve", "--data", "data", "--port", "0", folder=tmp_path)
    assert refused.code == 1 and "service's database" in refused.err and "Traceback" not in refused.err


def test_a_run_whose_fmu_is_gone_stops_nobody(me):
    service = me.client.app.state.service
    first = me.submit(fmu(checking={"wait": 1.0}), "a.fmu")
    gone = me.submit(fmu(x=1), "gone.fmu")
    service.files.fmu(service.database.run(gone["id"]).sha256).unlink()
    later = me.submit(fmu(x=2), "later.fmu")
    assert me.until(later["id"])["state"] == me.until(first["id"])["state"] == "finished"
    told = me.until(gone["id"])
    assert told["state"] == "failed" and "upload it again" in told["reason"] and "nothing is held" in told["reason"]


def test_a_run_that_has_no_room_on_the_disk_stops_nobody(me, monkeypatch):
    begin = Files.begin

    def refused(files, id, sha256, file_name, binding):
        if file_name == "bad.fmu" and not mended:
            raise EnvironmentFault("The run's folder cannot be written.", FULL)
        return begin(files, id, sha256, file_name, binding)

    mended: list[bool] = []
    monkeypatch.setattr(Files, "begin", refused)
    monkeypatch.setattr("orchestrator.service.runner.HOLD_TIME", 1.5)
    bad = me.submit(fmu(), "bad.fmu")["id"]
    assert me.until(me.submit(fmu(x=1), "good.fmu")["id"])["state"] == "finished"
    assert me.run(bad)["state"] == "received"
    mended.append(True)
    assert me.until(bad)["state"] == "finished"


def test_many_runs_without_room_on_the_disk_stop_nobody(me, monkeypatch):
    """Each of a dozen was waited for by all others, until the first of them was tried again."""
    begin = Files.begin

    def refused(files, id, sha256, file_name, binding):
        if file_name.startswith("bad"):
            raise EnvironmentFault("The run's folder cannot be written.", FULL)
        return begin(files, id, sha256, file_name, binding)

    monkeypatch.setattr(Files, "begin", refused)
    bad = [me.submit(fmu(x=number), f"bad{number}.fmu")["id"] for number in range(12)]
    assert me.until(me.submit(fmu(x="good"), "good.fmu")["id"])["state"] == "finished"
    assert {me.run(id)["state"] for id in bad} == {"received"}


def test_an_outcome_that_cannot_be_removed_keeps_no_place(me, monkeypatch):
    """It was tried without end, and the place of an evaluation was its own meanwhile."""
    forget, mended = Files.forget_outcome, list[bool]()

    def refused(files, id, name):
        if id in bad and not mended:
            raise EnvironmentFault("The run's folder cannot be written.", FULL)
        forget(files, id, name)

    bad = [me.submit(fmu(checking={"wait": 0.5, "exit": 3, "times": 1}, x=number))["id"] for number in range(2)]
    monkeypatch.setattr(Files, "forget_outcome", refused)
    monkeypatch.setattr("orchestrator.service.runner.HOLD_TIME", 1.0)
    assert me.until(me.submit(fmu(x="good"), "good.fmu")["id"])["state"] == "finished"
    mended.append(True)
    assert [me.until(id)["state"] for id in bad] == ["finished"] * 2


def test_a_mistake_in_storing_an_outcome_keeps_no_place(me, monkeypatch):
    ended, failed = states.ended, []

    def broken(*given):
        if len(failed) < 3:
            failed.append(given)
            raise KeyError("a mistake")
        return ended(*given)

    monkeypatch.setattr(states, "ended", broken)
    runs = [me.submit(fmu(checking={"exit": 3, "times": 1}, x=number), f"{number}.fmu")["id"] for number in range(2)]
    runs.append(me.submit(fmu(x=9), "good.fmu")["id"])
    assert [me.until(id)["state"] for id in runs] == 3 * ["finished"]


def test_a_binding_is_not_decided_by_the_former_outcome(me):
    """Nor is it when the power goes as it is bound."""
    id = me.submit(fmu(checking={"kind": "refused", "reason": "no q_m", "times": 1}))["id"]
    me.until(id, "refused")
    assert (me.client.app.state.service.files.run(id) / "checking.json").exists()
    me.put(f"/api/runs/{id}/binding", {"map": {"q_m[1]": "x"}})
    assert me.until(id, least=4)["state"] == "finished"


def test_a_binding_that_comes_too_late_takes_no_results_away(me):
    """A form that is sent slowly may be whole when the run has been bound, and has finished."""
    stages = {"checking": {"kind": "refused", "times": 1}, "evaluating": {"files": {"evaluation/results.json": "{}"}}}
    id = me.submit(fmu(**stages))["id"]
    me.until(id, "refused")
    service = me.client.app.state.service
    late = service.database.run(id)
    me.put(f"/api/runs/{id}/binding", {"map": {"q_m[1]": "x"}})
    me.until(id, "finished")
    assert refusal(lambda: service.bind(late, "[map]\n"), kind=Refusal).status == 409
    assert me.get(f"/api/runs/{id}/files/evaluation/results.json").status_code == 200


def test_a_binding_of_a_refused_run_is_in_the_quota_of_the_queue(serve, limited):
    me = Asker(serve(limited(queue=1)))
    id = me.submit(fmu(checking={"kind": "refused", "reason": "no q_m"}))["id"]
    me.until(id, "refused")
    me.submit(fmu(checking={"wait": 60}), "waits.fmu")
    assert me.put(f"/api/runs/{id}/binding", {"map": {"q_m[1]": "x"}}).status_code == 429


def test_so_many_forms_at_a_time_and_small_ones_where_little_is_asked(me):
    """Hundreds of bindings of 8 MB at a time would fill the memory of the service."""
    service = me.client.app.state.service
    for path in ("/api/comparisons", "/comparisons", "/api/rounds"):
        assert me.post(path, b"x" * 100_000).status_code == 413, path
    id = me.until(me.submit()["id"])["id"]
    assert me.put(f"/api/runs/{id}/binding", {"map": {"q_m": "x" * 60_000}}).status_code == 200
    service.forms[accounts.LOCAL.id] = service.settings.limits.forms
    assert me.put(f"/api/runs/{id}/binding", {"map": {"q_m": "x"}}).status_code == 429
    assert me.post("/comparisons").status_code == 429


def test_somebody_who_is_removed_during_an_upload_leaves_nothing(serve, monkeypatch):
    client = serve(SOME)
    service = client.app.state.service
    ada = Asker(client, accounts.invited(service.database, "Ada"))
    add = Database.add_run

    def late(database, run, *texts):
        database.remove_person(run.owner)
        add(database, run, *texts)

    monkeypatch.setattr(Database, "add_run", late)
    answer = ada.post("/api/runs?name=a.fmu", fmu())
    assert answer.status_code == 401 and "removed" in answer.json()["error"]
    assert list((service.files.root / "fmus").iterdir()) == []


def test_a_clock_that_is_set_back_changes_neither_what_counts_nor_whose_turn_it_is(serve, monkeypatch):
    true, ahead = time.time, [3600.0]
    monkeypatch.setattr(time, "time", lambda: true() + ahead[0])
    course = Course(serve(SOME))
    ada, ben = course.person("Ada"), course.person("Ben")
    round = course.open(days=30)
    handed_in(ada, fmu(verifying=verified(90.0), x=1), "first.fmu")
    ahead[0] = 0.0
    handed_in(ada, fmu(verifying=verified(95.0), x=2), "second.fmu")
    handed_in(ben, fmu(verifying=verified(99.0), x=3), "ben.fmu")
    served = course.people.served()
    assert served[id_of(course, "Ben")] > served[id_of(course, "Ada")]
    course.close(round)
    view = course.until(round)
    assert [(row["name"], row["place"]) for row in view["entries"]].count(("second.fmu", 1)) == 1
    assert {row["name"] for row in view["entries"]} == {"second.fmu", "ben.fmu"}


def test_a_round_begins_after_all_that_was_handed_in_before_it(serve, monkeypatch):
    true, ahead = time.time, [3600.0]
    monkeypatch.setattr(time, "time", lambda: true() + ahead[0])
    course = Course(serve(SOME))
    ada, ben = course.person("Ada"), course.person("Ben")
    handed_in(ada, fmu(), "early.fmu")
    ahead[0] = 0.0
    round = course.open(days=30)
    handed_in(ben, fmu(x=1), "ben.fmu")
    assert [row["name"] for row in course.until(round, "open")["entries"]] == ["ben.fmu"]


def test_a_run_counts_in_one_round(tmp_path):
    database = Database(tmp_path / "x.sqlite")
    database.add_person(accounts.LOCAL, "", 0.0)
    for number, round in enumerate(("", "d" * 24)):
        run = replace(RUN, id=f"{number:024}", owner=accounts.LOCAL.id, created=15.0, round=round)
        database.add_run(run, "received")
    handed = database.handed_in(Round("c" * 24, "x", 10.0, 20.0), accounts.LOCAL.id)
    assert [run.round for run in handed] == [""]


def test_an_outcome_that_lies_there_before_its_stage_decides_nothing(serve):
    course = Course(serve(SOME))
    ada = course.person("Ada")
    round = course.open()
    id = handed_in(ada, fmu(verifying=verified(95.0)))
    forged = course.client.app.state.service.files.run(id) / "verifying.json"
    forged.write_text('{"stage": "verifying", "kind": "done", "cost": 1.0, "holds": true}')
    course.close(round)
    assert [row["drawn_cost"] for row in course.until(round)["entries"]] == [95.0]


def evaluated(me: Asker, id: str) -> None:
    """Wait until a run is being evaluated, by a process."""
    me.until(id, "evaluating")
    live = me.client.app.state.service.runner.live
    for _ in range(400):
        if id in live and live[id].progress.done:
            return
        time.sleep(0.02)
    raise AssertionError("it is not evaluated")


def ended(client) -> None:
    """End a service, so that another one may have its folder."""
    client.__exit__(None, None, None)
    client.__exit__ = lambda *_: None


def test_a_table_is_of_one_protocol(serve, tmp_path):
    file = tmp_path / "mine.toml"

    def written(pose: int, description: str) -> None:
        text = ONE_POSE.format("mine").replace("poses = [0]", f"poses = [{pose}]").replace("points = 1", "points = 2")
        file.write_text(f'description = "{description}"\n{text}', encoding="utf-8")

    written(0, "")
    mine = replace(ALONE, conduct=replace(ALONE.conduct, protocol=str(file)))
    client = serve(mine)
    me = Asker(client)
    id = me.until(me.submit()["id"])["id"]
    ended(client)
    assert "finished runs by the protocol mine. paper is" in str(refusal(serve))
    command = call("serve", "--data", "data", "--protocol", "quick", "--trust", "--port", "0", folder=tmp_path)
    assert command.code == 2 and "results by both. Go on with that one (--protocol" in command.err
    written(1, "")
    assert refusal(lambda: serve(mine)).what == "other-protocol"
    written(0, "Other words change no result.")
    client = serve(mine)
    assert Asker(client).delete(f"/api/runs/{id}").status_code == 204
    ended(client)
    serve()


def test_a_round_is_verified_by_one_protocol(serve):
    course = Course(serve(SOME))
    ada, round = course.person("Ada"), course.open()
    id = handed_in(ada, fmu(verifying={"wait": 60, "times": 1}))
    course.close(round)
    under_way(ada, id)
    ended(course.client)
    other = replace(SOME, conduct=replace(SOME.conduct, drawn_protocol="quick"))
    refused = refusal(lambda: serve(other))
    assert "a round that is not verified to its end" in str(refused) and "verified again" in REMEDIES[refused.what]
    again = Course(serve(SOME))
    again.until(round)
    ended(again.client)
    serve(other)


def id_of(course: Course, name: str) -> str:
    return next(person.id for person in course.people.people() if person.name == name)


def test_what_goes_while_it_is_measured_ends_no_job(tmp_path, monkeypatch):
    """As the folder of a compiler does, at another run of the same FMU: the outcome was lost by that."""
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "file").touch()

    def taken(path: Path) -> int:
        for other in set(tmp_path.iterdir()) - {path.parent} if path.name == "file" else ():
            shutil.rmtree(other)
        return 1

    monkeypatch.setattr(job, "_taken", taken)
    assert job._size(tmp_path) == 3


def test_half_a_copy_of_an_fmu_is_not_taken_for_the_whole(tmp_path, monkeypatch):
    """Where there are no hard links, and the power goes."""

    def half(source, target):
        target.write(source.read(3))
        raise KeyboardInterrupt

    def none(*_):
        raise OSError

    files, sha256, id = Files(tmp_path), "0" * 64, "a" * 24
    files.prepare()
    files.fmu(sha256).write_bytes(fmu())
    monkeypatch.setattr("os.link", none)
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("shutil.copyfileobj", half)
        files.begin(id, sha256, "my.fmu", "")
    assert (files.begin(id, sha256, "my.fmu", "") / "my.fmu").read_bytes() == fmu()


def test_half_an_upload_leaves_a_full_disk(tmp_path):
    files = Files(tmp_path)
    files.prepare()
    incoming = files.incoming()
    incoming.add(bytes(100_000))
    stream = incoming._stream

    class Full:
        def close(self):
            stream.close()
            raise OSError(28, "No space left on device")

    incoming._stream = Full()
    incoming.close()
    assert list((tmp_path / "incoming").iterdir()) == []


def test_what_is_deleted_on_a_full_disk_makes_the_room_for_that(me, monkeypatch):
    files, remove = me.client.app.state.service.files, Database.remove_run

    def full(database, id):
        if files.run(id).exists():
            raise EnvironmentFault("The service's database cannot be written: database or disk is full.", FULL)
        remove(database, id)

    id = me.until(me.submit()["id"])["id"]
    monkeypatch.setattr(Database, "remove_run", full)
    assert me.delete(f"/api/runs/{id}").status_code == 204 and me.get("/api/runs").json() == []


def test_a_full_disk_is_told_from_other_faults(tmp_path, monkeypatch):
    """Where its file could not be written (chattr +i), a run was not deleted, and its results were. A quota is told as
    that."""
    database = Database(tmp_path / "x.sqlite")

    def code(words: str, error: int = 0) -> str:
        def synced(descriptor):
            if error:
                raise OSError(error, os.strerror(error))

        monkeypatch.setattr("orchestrator.service.database.os.fsync", synced)
        with pytest.raises(EnvironmentFault) as told, database._transaction():
            raise sqlite3.OperationalError(words)
        return told.value.what

    assert code("database or disk is full") == FULL
    assert code("disk I/O error", errno.ENOSPC) == code("disk I/O error", errno.EDQUOT) == FULL
    assert code("disk I/O error") == code("disk I/O error", errno.EIO) == "no-database"
    assert code("attempt to write a readonly database") == "no-database"
    database.close()


def test_half_an_outcome_ends_no_later_attempt(serve):
    """As a power cut leaves it: the next attempt was taken for one that has an outcome and does not end."""
    client = serve()
    me = Asker(client)
    id = me.submit(fmu(checking={"wait": 3, "times": 2}))["id"]
    under_way(me, id)
    torn = client.app.state.service.files.run(id) / "checking.json"
    ended(client)
    torn.touch()
    os.utime(torn, (0.0, 0.0))
    me = Asker(serve())
    run = me.until(id)
    assert run["state"] == "finished" and "signal" not in json.dumps(run["history"])


def test_a_run_that_can_never_be_deleted_keeps_its_results(me, monkeypatch):
    files, id = me.client.app.state.service.files, me.until(me.submit()["id"])["id"]

    def refused(*_):
        raise EnvironmentFault("The service's database cannot be written: a readonly database.", "no-database")

    monkeypatch.setattr(Database, "remove_run", refused)
    assert me.delete(f"/api/runs/{id}").status_code == 503 and files.run(id).is_dir()


def test_a_run_that_cannot_be_deleted_now_keeps_its_results(me, monkeypatch, tmp_path):
    files = me.client.app.state.service.files
    id = me.until(me.submit()["id"])["id"]
    other = sqlite3.connect(files.database, isolation_level=None)
    me.client.app.state.service.database._connection.execute("PRAGMA busy_timeout = 100")
    other.execute("BEGIN IMMEDIATE")
    assert me.delete(f"/api/runs/{id}").status_code == 503 and files.run(id).is_dir()
    other.execute("ROLLBACK")
    assert me.delete(f"/api/runs/{id}").status_code == 204 and not files.run(id).exists()


def test_results_go_after_their_row(me, monkeypatch):
    """A power cut between the two leaves a folder that nothing names, which the next start removes."""
    files, id = me.client.app.state.service.files, me.until(me.submit()["id"])["id"]

    def cut(files, id):
        raise KeyboardInterrupt

    monkeypatch.setattr(Files, "remove_run", cut)
    with pytest.raises(KeyboardInterrupt):
        me.client.app.state.service.remove(me.client.app.state.service.database.run(id))
    assert me.get("/api/runs").json() == [] and files.run(id).is_dir()


def test_a_protocol_that_changes_while_the_service_runs_is_no_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.fmu").write_bytes(fmu())
    file = tmp_path / "mine.toml"
    file.write_text(ONE_POSE.format("mine"), encoding="utf-8")
    now = protocol.contents(str(file))
    for changed in (ONE_POSE.format("mine").replace("poses = [0]", "poses = [1]").replace("= 1", "= 2"), "no protocol"):
        file.write_text(changed, encoding="utf-8")
        task = Task("evaluating", "my.fmu", "", str(file), 1, False, contents=now)
        outcome = job.done(task, tmp_path, lambda *_: None)
        assert outcome.kind == "fault" and "mine has changed" in outcome.reason


def test_a_log_that_nobody_reads_stops_nothing(monkeypatch):
    """The queue stood still for good after a warning into a pipe whose reader had ended."""

    class Broken(io.StringIO):
        def write(self, text):
            raise BrokenPipeError

    def warned(arguments):
        logging.getLogger("orchestrator").warning("The database is locked.")
        return 0

    monkeypatch.setattr("sys.stderr", Broken())
    assert guard.guarded(warned, []) == 0


def test_a_job_that_is_ended_with_its_service_is_no_fault(serve, monkeypatch):
    """systemd sends a signal to both."""
    client = serve()
    me = Asker(client)
    id = me.submit(fmu(checking={"wait": 60}))["id"]
    under_way(me, id)
    runner = client.app.state.service.runner
    server.Server(client.app).handle_exit(signal.SIGTERM, None)
    os.killpg(runner.live[id].process.pid, signal.SIGTERM)
    ended(client)
    again = Asker(serve())
    told = [event["text"] for event in again.run(id)["history"]]
    assert not any("signal" in text for text in told) and any("queued again" in text for text in told)
    assert again.client.app.state.service.database.run(id).attempts <= 1


def test_the_database_is_whole_without_the_file_beside_it(me, tmp_path):
    id = me.until(me.submit(name="my secret.fmu")["id"])["id"]
    files = me.client.app.state.service.files
    shutil.copy(files.database, tmp_path / "copy.sqlite")
    copy = Database(tmp_path / "copy.sqlite")
    assert copy.run(id).name == "my secret.fmu"
    copy.close()
    me.delete(f"/api/runs/{id}")
    beside = files.database.with_name(f"{files.database.name}-wal")
    assert not any(b"my secret" in file.read_bytes() for file in (files.database, beside))


def test_a_damaged_store_begins_anew(tmp_path, monkeypatch):
    """Who owns a run cannot move a file of the service away."""
    folder, tried = tmp_path / "evaluation", []

    def evaluated(*_, **__):
        tried.append((folder / store.FILE).exists())
        with store.opened(folder):
            raise InputError("as far as that", "no-test")

    folder.mkdir()
    (folder / store.FILE).write_bytes(b"no database, but long enough to be one" * 100)
    (tmp_path / "my.fmu").write_bytes(fmu())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Benchmark, "evaluate", evaluated)
    outcome = job.done(Task("evaluating", "my.fmu", "", "quick", 1, False), tmp_path, lambda *_: None)
    assert tried == [True, False] and outcome.reason == "as far as that"


def test_an_fmu_that_is_damaged_here_is_no_fault_of_its_own(tmp_path, monkeypatch):
    (tmp_path / "my.fmu").write_bytes(fmu()[:-1])
    monkeypatch.chdir(tmp_path)
    task = Task("checking", "my.fmu", "", "quick", 1, False, sha256=hashlib.sha256(fmu()).hexdigest())
    outcome = job.done(task, tmp_path, lambda *_: None)
    assert outcome.kind == "fault" and "upload it again" in outcome.reason


def test_the_latest_run_of_a_name_is_the_one_that_came_last(me, monkeypatch):
    true, ahead = time.time, [86400.0]
    monkeypatch.setattr(time, "time", lambda: true() + ahead[0])
    me.until(me.submit(fmu(evaluating={"cost": 50.0}))["id"])
    ahead[0] = 0.0
    last = me.until(me.submit(fmu(evaluating={"cost": 70.0}))["id"])["id"]
    assert [row["cost"] for row in me.get("/api/table").json()] == [70.0]
    assert me.get("/api/runs").json()[0]["id"] == last


def test_who_is_removed_by_a_command_keeps_no_place(serve):
    client = serve(SOME)
    course = Course(client)
    ada, ben = course.person("Ada"), course.person("Ben")
    evaluated(ada, ada.submit(fmu(evaluating={"wait": 60}))["id"])
    other = Database(client.app.state.service.files.database)
    accounts.removed(other, "Ada")
    other.close()
    assert ben.until(ben.submit(fmu(x=1))["id"])["state"] == "finished"


def test_a_job_that_does_not_end_keeps_no_place(me, monkeypatch):
    monkeypatch.setattr(runner, "END_TIME", 0.5)
    id = me.submit(fmu(evaluating={"wait": 60}))["id"]
    evaluated(me, id)
    os.killpg(me.client.app.state.service.runner.live[id].process.pid, signal.SIGSTOP)
    me.post(f"/api/runs/{id}/cancel")
    assert me.until(me.submit(fmu(x=1))["id"])["state"] == "finished"


def test_a_binding_of_a_run_that_was_deleted_makes_none(me):
    service, id = me.client.app.state.service, me.until(me.submit()["id"])["id"]
    run = service.database.run(id)
    me.delete(f"/api/runs/{id}")
    assert refusal(lambda: service.bind(run, "[map]\n"), kind=Refusal).status == 404
    assert me.get("/api/runs").json() == []


@pytest.mark.parametrize("content", [b"\xff\xfe", b"<p>" * 1_000_000], ids=["no text", "too long"])
def test_a_piece_of_a_page_that_cannot_be_shown_costs_no_page(content, me):
    id = me.until(me.submit()["id"])["id"]
    (me.client.app.state.service.files.run(id) / "findings.html").write_bytes(content)
    answer = me.get(f"/runs/{id}", accept="text/html")
    assert answer.status_code == 200 and len(answer.content) < 100_000


def test_what_was_extracted_of_a_cancelled_run_is_removed(me):
    """It was in nobody's quota."""
    service = me.client.app.state.service
    id = me.submit(fmu(evaluating={"wait": 60}))["id"]
    evaluated(me, id)
    extracted = service.files.cache / "fmus" / service.database.run(id).sha256
    extracted.mkdir(parents=True)
    me.post(f"/api/runs/{id}/cancel")
    for _ in range(200):
        if not extracted.exists():
            return
        time.sleep(0.05)
    raise AssertionError("it is still there")


def test_commands_that_cannot_print_end_with_a_sentence(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    call("serve", "--invite", "Ada", folder=tmp_path)
    with Path("/dev/full").open("w") as full:
        monkeypatch.setattr("sys.stdout", full)
        assert guard.run("serve", ["--people"]) == 1
    assert "No space left" in capsys.readouterr().err
    monkeypatch.setattr("sys.stdout", None)
    assert guard.run("serve", ["--people"]) == 0


@pytest.mark.parametrize("words", [("--remove", "Ada"), ("--people",), ("--invite", "Ada")])
def test_a_copy_is_a_command_of_its_own(words, tmp_path):
    assert call("serve", "--backup", "copy", *words, folder=tmp_path).code == 2


def test_a_copy_leaves_out_what_vanishes_while_it_is_made(tmp_path, monkeypatch):
    files, copied = Files(tmp_path / "data"), []
    files.prepare()
    for number in range(5):
        (files.root / "runs" / str(number)).mkdir()
        (files.root / "runs" / str(number) / "results.json").write_text("{}")

    def first(file, target):
        copied.append(file)
        for other in (files.root / "runs").iterdir():
            if other != file.parent:
                shutil.rmtree(other)

    monkeypatch.setattr("shutil.copy2", first)
    files.copy(tmp_path / "copy")
    assert len(copied) == 1


@pytest.mark.parametrize("data", ["data", "."])
def test_a_copy_stands_apart(data, serve, tmp_path):
    serve(folder=tmp_path / data)
    made = call("serve", "--data", data, "--backup", tmp_path / "data" / "copy", folder=tmp_path)
    assert made.code == 2 and "is within" in made.err and not (tmp_path / "data" / "copy").exists()


def test_remedies_are_options_of_the_service(serve, tmp_path):
    serve()
    (tmp_path / "file").touch()
    for data in ("data", "file"):
        refused = call("serve", "--data", data, "--trust", "--port", "0", folder=tmp_path)
        assert refused.code == 2 and "--data" in refused.err, refused.err


def test_people_are_listed_on_a_terminal_of_ascii(tmp_path, monkeypatch):
    call("serve", "--invite", " Zoë Ångström ", folder=tmp_path)
    call("serve", "--invite", "Zoë Ångström", folder=tmp_path)
    terminal = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdout", terminal)
    assert guard.run("serve", ["--people"]) == 0
    assert terminal.buffer.getvalue() == b"Zo\\xeb \\xc5ngstr\\xf6m\n"


def test_a_copy_that_failed_is_no_service(serve, tmp_path, monkeypatch):
    me = Asker(serve())
    me.until(me.submit()["id"])

    def full(files, folder):
        raise EnvironmentFault("The copy cannot be written: No space left on device.", "not-written")

    monkeypatch.setattr(Files, "copy", full)
    made = call("serve", "--data", "data", "--backup", "copy", folder=tmp_path)
    assert made.code == 1 and not (tmp_path / "copy" / "service.sqlite").exists()


def test_a_copy_has_no_run_without_its_fmu(serve, tmp_path, monkeypatch):
    me = Asker(serve())
    kept, deleted = (me.until(me.submit(fmu(x=name), f"{name}.fmu")["id"])["id"] for name in "ab")
    copy = Files.copy

    def late(files, folder):
        assert me.delete(f"/api/runs/{deleted}").status_code == 204
        copy(files, folder)

    monkeypatch.setattr(Files, "copy", late)
    assert call("serve", "--data", "data", "--backup", "copy", folder=tmp_path).code == 0
    other = Asker(serve(folder=tmp_path / "copy"))
    assert [run["id"] for run in other.get("/api/runs").json()] == [kept]


def test_what_the_service_may_not_read_is_no_fault_of_the_fmu(tmp_path):
    from orchestrator.service.job import done

    task = Task("checking", "gone.fmu", "", "quick", 1, False, sha256="0" * 64)
    here = os.getcwd()
    os.chdir(tmp_path)
    try:
        assert done(task, tmp_path, lambda *_: None).kind == "fault"
    finally:
        os.chdir(here)


def test_a_folder_that_cannot_be_written_is_no_fault_of_the_fmu(tmp_path, monkeypatch):
    def refused(*_):
        raise InputError("The folder quick cannot be written to: No space left on device.", "folder-not-writable")

    (tmp_path / "my.fmu").write_bytes(fmu())
    monkeypatch.setattr(job, "_evaluated", refused)
    monkeypatch.chdir(tmp_path)
    assert job.done(Task("quick", "my.fmu", "", "quick", 1, False), tmp_path, lambda *_: None).kind == "fault"


def test_a_page_elsewhere_loads_nothing_in_secret(me):
    for site in ("cross-site", "same-site"):
        for mode in ("no-cors", "cors"):
            assert me.get("/events", **{"sec-fetch-site": site, "sec-fetch-mode": mode}).status_code == 403
        assert me.get("/", **{"sec-fetch-site": site, "sec-fetch-mode": "navigate"}).status_code == 200


def test_a_refusal_ends_the_connection_of_a_body(serve, me):
    stranger = Asker(serve(SOME, me.client.app.state.service.files.root.parent / "other"))
    assert stranger.post("/api/runs?name=a.fmu", fmu()).headers["connection"] == "close"
    assert me.post("/api/runs?name=a.fmu", fmu(), origin="http://evil.example").headers["connection"] == "close"
    assert "connection" not in me.get("/api/runs/x").headers


def test_a_failure_has_the_headers_of_all_answers(me, monkeypatch):
    def broken(owner, most=200):
        raise KeyError("a mistake")

    monkeypatch.setattr(me.client.app.state.service.database, "runs_of", broken)
    answer = me.get("/api/runs")
    assert answer.status_code == 500 and answer.headers["x-content-type-options"] == "nosniff"
    assert "content-security-policy" in answer.headers and answer.headers["cache-control"] == "no-store"


def test_the_database_refuses_what_it_cannot_write(tmp_path):
    database = Database(tmp_path / "x.sqlite")
    database.check()
    other = sqlite3.connect(tmp_path / "x.sqlite", isolation_level=None)
    database._connection.execute("PRAGMA busy_timeout = 100")
    other.execute("BEGIN IMMEDIATE")
    assert refusal(database.check, kind=EnvironmentFault).what == LOCKED
    other.close()
    database.close()


def test_a_thread_that_cannot_be_started_keeps_no_place(me, monkeypatch):
    """Python starts one for each process: what it raises is no OSError, and the stage was under way for ever."""
    start, failed = asyncio.create_subprocess_exec, []

    async def without_thread(*words, **options):
        if len(failed) < 2:
            failed.append(words)
            raise RuntimeError("can't start new thread")
        return await start(*words, **options)

    monkeypatch.setattr(asyncio, "create_subprocess_exec", without_thread)
    runs = [me.submit(fmu(x=number))["id"] for number in range(3)]
    assert [me.until(id)["state"] for id in runs] == ["finished"] * 3 and len(failed) == 2
    told = [event["text"] for id in runs for event in me.run(id)["history"]]
    assert sum("fault of this machine" in text and "new thread" in text for text in told) == 2


def test_what_was_done_when_the_time_is_over_counts(serve):
    """A service that is stopped, and goes on, finds that the time of a stage is over, and its outcome on the disk."""
    me = Asker(serve(replace(ALONE, conduct=replace(ALONE.conduct, short_time=2.0))))
    done = {"checking.json": '{"stage": "checking", "kind": "done", "verdict": "ok"}'}
    assert me.until(me.submit(fmu(checking={"files": done, "wait": 60.0}))["id"])["state"] == "finished"
    late = me.until(me.submit(fmu(checking={"wait": 60.0}))["id"])
    assert late["state"] == "failed" and "took longer than 2 s" in late["reason"]
