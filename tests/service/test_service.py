"""The service from without: what it answers, whatever jobs do, and what it keeps."""

import itertools
import json
import re
import sqlite3
import time
from dataclasses import replace

import pytest
from support.tools import require

from orchestrator.service import accounts, database
from orchestrator.service.files import Files
from service.conftest import ALONE, SOME, Asker, fmu

require("starlette", "uvicorn", "httpx2")


def texts(run: dict) -> list[str]:
    return [event["text"] for event in run["history"]]


def under_way(me: Asker, id: str) -> dict:
    """The run when its job has told progress."""
    for _ in range(6000):
        run = me.run(id)
        if run["done"]:
            return run
        time.sleep(0.02)
    raise AssertionError(run)


def folder(me: Asker):
    return me.client.app.state.service.files.root


def test_a_run_is_checked_evaluated_twice_and_finished(me):
    content = fmu(checking={"verdict": "note"}, quick={"cost": 120.25}, evaluating={"cost": 88.125, "holds": False})
    run = me.submit(content, "My%20PID%20%C3%A4.fmu")
    assert run["state"] == "received" and run["name"] == "My PID ä.fmu"
    run = me.until(run["id"])
    assert (run["state"], run["quick_cost"], run["cost"], run["holds"]) == ("finished", 120.25, 88.125, False)
    assert texts(run) == [
        "received",
        "the check has begun",
        "the check has passed",
        "the quick evaluation has begun",
        "the quick evaluation has ended",
        "the evaluation has begun",
        "finished",
    ]
    assert run["command"] == "flexible-manipulator evaluate My_PID.fmu"
    assert (folder(me) / "runs" / run["id"] / "My_PID.fmu").read_bytes() == content


def test_progress_is_told_while_a_stage_lasts(me):
    id = me.submit(fmu(quick={"wait": 3}))["id"]
    me.until(id, "quick", least=3)
    run = under_way(me, id)
    assert (run["done"], run["total"], run["cost_so_far"]) == (3, 24, 101.5)
    assert me.until(id)["state"] == "finished"


def test_a_controller_that_is_refused_is_not_tried_again(me):
    run = me.until(me.submit(fmu(checking={"kind": "refused", "reason": "no q_m", "verdict": "error"}))["id"])
    assert (run["state"], run["reason"]) == ("refused", "no q_m")
    assert (folder(me) / "runs" / run["id"] / "checking.count").read_text() == "1"
    assert me.post(f"/api/runs/{run['id']}/retry").status_code == 409


def test_a_process_that_dies_is_tried_again_visibly_and_a_bounded_number_of_times(me):
    run = me.until(me.submit(fmu(quick={"exit": 9, "times": 2}))["id"])
    assert run["state"] == "finished"
    faults = [text for text in texts(run) if "fault of this machine" in text]
    assert len(faults) == 2 and "exit code 9: cannot go on" in faults[0]
    run = me.until(me.submit(fmu(quick={"exit": 9}), "b.fmu")["id"])
    assert run["state"] == "failed" and "nothing is held against the controller" in run["reason"]
    assert (folder(me) / "runs" / run["id"] / "quick.count").read_text() == "3"
    again = me.post(f"/api/runs/{run['id']}/retry").json()
    assert again["state"] == "received"
    me.until(run["id"], least=again["revision"] + 1)
    assert (folder(me) / "runs" / run["id"] / "quick.count").read_text() == "6"


@pytest.mark.parametrize("line", ["no JSON", '{"done": -1}', '{"cost": 1e999}', "x" * 200_000, "\x00\xff", "[]"])
def test_a_job_that_says_nonsense_changes_nothing(me, line):
    assert me.until(me.submit(fmu(checking={"say": line}))["id"])["state"] == "finished"


def test_cancelled_runs_end_their_process_and_can_begin_again(me):
    id = me.submit(fmu(checking={"wait": 60, "times": 1}))["id"]
    under_way(me, id)
    assert me.post(f"/api/runs/{id}/cancel").json()["state"] == "cancelled"
    assert me.post(f"/api/runs/{id}/cancel").status_code == 409
    service = me.client.app.state.service
    for _ in range(200):
        if not service.runner.live:
            break
        time.sleep(0.05)
    assert not service.runner.live
    assert me.post(f"/api/runs/{id}/retry").status_code == 200
    assert me.until(id, "finished")["reason"] == ""


def test_deleted_means_deleted(me):
    first, second = me.submit(fmu(x=1), "a.fmu"), me.submit(fmu(x=1), "b.fmu")
    me.until(first["id"]), me.until(second["id"])
    files = Files(folder(me))
    assert first["sha256"] == second["sha256"] and files.fmu(first["sha256"]).exists()
    extracted = files.cache / "fmus" / first["sha256"]
    extracted.mkdir(parents=True)
    assert me.delete(f"/api/runs/{first['id']}").status_code == 204
    assert me.get(f"/api/runs/{first['id']}").status_code == 404
    assert files.fmu(second["sha256"]).exists() and not files.run(first["id"]).exists()
    assert me.delete(f"/api/runs/{second['id']}").status_code == 204
    assert not files.fmu(second["sha256"]).exists() and not extracted.exists()
    assert [path for path in files.root.rglob("*") if path.suffix == ".fmu"] == []
    database = sqlite3.connect(files.database)
    assert database.execute("SELECT (SELECT COUNT(*) FROM runs) + (SELECT COUNT(*) FROM history)").fetchone() == (0,)


def test_a_run_that_is_deleted_while_it_runs_leaves_nothing(me):
    run = me.submit(fmu(checking={"wait": 60}))
    me.until(run["id"], "checking")
    assert me.delete(f"/api/runs/{run['id']}").status_code == 204
    service = me.client.app.state.service
    for _ in range(200):
        if not service.runner.live:
            break
        time.sleep(0.05)
    time.sleep(0.2)
    assert not service.files.run(run["id"]).exists() and not service.files.fmu(run["sha256"]).exists()


def test_what_was_running_is_queued_again_after_the_end_of_the_service(serve, tmp_path):
    me = Asker(serve())
    id = me.submit(fmu(quick={"wait": 60, "times": 1}))["id"]
    me.until(id, "quick", least=3)
    under_way(me, id)
    me.client.__exit__(None, None, None)
    me.client.__exit__ = lambda *_: None
    again = Asker(serve())
    run = again.until(id)
    assert run["state"] == "finished" and "queued again after an end of the service" in texts(run)


def test_an_outcome_that_nobody_heard_of_is_taken_and_the_stage_not_done_again(serve, tmp_path):
    me = Asker(serve())
    id = me.submit(fmu(quick={"cost": 77.0}))["id"]
    me.until(id)
    service = me.client.app.state.service
    me.client.__exit__(None, None, None)
    me.client.__exit__ = lambda *_: None
    database = sqlite3.connect(service.files.database)  # as it was before the end of the quick evaluation was stored
    database.execute("UPDATE runs SET state = 'quick', running = 1, quick_cost = NULL, cost = NULL")
    database.commit()
    database.close()
    again = Asker(serve())
    assert again.until(id, "finished")["quick_cost"] == 77.0
    assert (service.files.run(id) / "quick.count").read_text() == "1"


def test_one_folder_is_for_one_service(serve, tmp_path):
    from orchestrator import InputError

    serve()
    with pytest.raises(InputError, match="Another service works"):
        serve()


def test_uploads_are_bounded_and_what_is_no_fmu_is_refused(serve, limited):
    me = Asker(serve(limited(upload=1000)))
    for content, status, word in [
        (b"PK" + bytes(999), 413, "larger"),
        (b"", 400, "no FMU"),
        (b"MZ" + bytes(10), 400, "no FMU"),
    ]:
        answer = me.client.post("/api/runs?name=a.fmu", content=content)
        assert answer.status_code == status and word in answer.json()["error"]
    pieces = (b"PK" + bytes(300) for _ in range(5))  # of no stated length
    assert me.client.post("/api/runs", content=pieces).status_code == 413
    assert me.client.post("/api/runs", content=b"PK", headers={"content-length": "-3"}).status_code in (400, 413)
    root = me.client.app.state.service.files.root
    assert list((root / "incoming").iterdir()) == list((root / "fmus").iterdir()) == []
    assert me.get("/api/runs").json() == []


def test_so_many_uploads_at_a_time(serve, limited):
    me = Asker(serve(limited(uploads=1)))
    service = me.client.app.state.service
    with service.uploading(accounts.LOCAL):
        assert me.post("/api/runs?name=a.fmu", fmu()).status_code == 429
    assert me.post("/api/runs?name=a.fmu", fmu()).status_code == 201


def test_quotas_of_the_queue_and_of_the_disk(serve, limited):
    me = Asker(serve(limited(queue=2, disk=2 * database.LEAST + 5000)))
    for name in ("a.fmu", "b.fmu"):
        me.submit(fmu(checking={"wait": 60}, x=name), name)
    answer = me.post("/api/runs?name=c.fmu", fmu())
    assert answer.status_code == 429 and "Cancel one" in answer.json()["error"]
    for run in me.get("/api/runs").json():
        me.post(f"/api/runs/{run['id']}/cancel")
    answer = me.post("/api/runs?name=c.fmu", b"PK" + bytes(5000))
    assert answer.status_code == 507 and "Delete some" in answer.json()["error"]


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "..", "", "a/b\\c.fmu", "x" * 500, "\x1b[2J\u202e.fmu", "<b>.FMU"]
)
def test_names_lead_nowhere(me, name):
    from urllib.parse import quote

    run = me.submit(name=quote(name, safe=""))
    files = Files(folder(me))
    assert set(re.sub(r"[A-Za-z0-9._-]", "", run["command"].split(" ")[2])) == set()
    assert "\x1b" not in run["name"] and "\u202e" not in run["name"] and len(run["name"]) <= 120
    me.until(run["id"])
    inside = [path for path in files.run(run["id"]).iterdir() if path.suffix == ".fmu"]
    assert len(inside) == 1 and re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]*\.fmu", inside[0].name)
    page = me.get(f"/runs/{run['id']}").text
    assert "<b>.FMU" not in page and me.get("/").status_code == 200


@pytest.mark.parametrize("id", ["%2e%2e%2fx", "..%2f..%2fx", "0" * 24, "A" * 24, "a" * 23, "a'--", "a%00"])
def test_an_id_that_is_none_is_not_there(me, id):
    for path in (f"/api/runs/{id}", f"/runs/{id}", f"/comparisons/{id}", f"/runs/{id}/evaluation/results.json"):
        assert me.get(path).status_code in (303, 404), path


def test_only_listed_files_are_given_out_and_reports_live_in_a_world_of_their_own(me):
    files = {"evaluation/report.html": "<script>alert(1)</script>", "evaluation/results.json": "{}", "secret": "x"}
    id = me.submit(fmu(evaluating={"files": files}))["id"]
    me.until(id)
    report = me.get(f"/runs/{id}/evaluation/report.html")
    assert report.status_code == 200 and "sandbox allow-scripts;" in report.headers["content-security-policy"]
    assert "allow-same-origin" not in report.headers["content-security-policy"]
    assert 'sandbox="allow-scripts"' in me.get(f"/runs/{id}").text
    data = me.get(f"/runs/{id}/evaluation/results.json")
    assert data.text == "{}" and data.headers["content-disposition"].startswith("attachment")
    for path in (
        "secret",
        "evaluation/secret",
        "evaluation/..%2fsecret",
        "x/report.html",
        "../x",
        "evaluation/log.txt",
    ):
        assert me.get(f"/runs/{id}/{path}").status_code == 404, path


def test_pages_escape_what_comes_from_fmus(me):
    evil = "<img src=x onerror=alert(1)>"
    content = fmu(checking={"kind": "refused", "reason": evil, "verdict": "error"})
    id = me.submit(content, "%3Cscript%3Ealert(2)%3C%2Fscript%3E.fmu")["id"]
    me.until(id)
    for path in ("/", f"/runs/{id}"):
        page = me.get(path).text
        assert evil not in page and "<script>alert" not in page
        assert "script-src 'self'" in me.get(path).headers["content-security-policy"]


def test_every_answer_has_the_headers_that_protect_it(me):
    for path in ("/", "/api/runs", "/nowhere", "/static/service.js", "/api/nowhere"):
        headers = me.get(path).headers
        assert headers["x-content-type-options"] == "nosniff" and headers["referrer-policy"] == "same-origin"
        assert "frame-ancestors" in headers["content-security-policy"]
    assert me.get("/api/nowhere").json() == {"error": "There is no such page."}


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:8081"},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
        {"host": "evil.example:8080"},
        {"host": "127.0.0.1.evil.example"},
        {"cookie": "session=x"},
    ],
)
def test_other_sites_change_nothing(me, headers):
    answer = me.post("/api/runs?name=a.fmu", fmu(), **headers)
    assert answer.status_code == 403 and me.get("/api/runs").json() == []


def test_pages_of_the_service_itself_may_change_something(me):
    origin = {"origin": "http://127.0.0.1:8080", "sec-fetch-site": "same-origin"}
    assert me.post("/api/runs?name=a.fmu", fmu(), **origin).status_code == 201


def test_nothing_changes_by_get(me):
    id = me.submit(fmu(checking={"wait": 60}))["id"]
    for path in (f"/runs/{id}/cancel", f"/runs/{id}/delete", f"/api/runs/{id}/cancel", f"/runs/{id}/binding", "/leave"):
        assert me.get(path).status_code in (404, 405), path
    assert me.until(id, "checking")


INTERFACE = {
    "connectors": [
        {"name": "q_m", "unit": "rad", "meaning": "angles", "required": False, "causalities": ["input"]},
        {"name": "u_m", "unit": "N.m", "meaning": "torques", "required": True, "causalities": ["output"]},
    ],
    "variables": [
        {"name": name, "causality": causality, "type": "Real", "unit": "rad", "size": 1, "start": "1.0"}
        for name, causality in [
            ("In<1>", "input"),
            ("In2", "input"),
            ("O1", "output"),
            ("O2", "output"),
            ("K", "parameter"),
        ]
    ],
}
UNBOUND = {
    "kind": "refused",
    "reason": "no q_m",
    "verdict": "error",
    "times": 1,
    "files": {"interface.json": json.dumps(INTERFACE), "findings.html": "<p>a finding</p>"},
}


def form(**fields: str) -> bytes:
    from urllib.parse import urlencode

    names = {"q1": "map:q_m[1]", "q2": "map:q_m[2]", "u1": "map:u_m[1]", "u2": "map:u_m[2]", "K": "set:K"}
    return urlencode({names[name]: value for name, value in fields.items()}).encode()


def test_a_refused_run_is_bound_in_the_form_and_goes_on(me):
    id = me.submit(fmu(checking=UNBOUND))["id"]
    me.until(id, "refused")
    page = me.get(f"/runs/{id}").text
    assert (
        "a finding" in page and "In&lt;1&gt;" in page and "In<1>" not in page and '<details class="card" open>' in page
    )
    answer = me.post(f"/runs/{id}/binding", form(q1="In<1>", q2="In<1>"))
    assert answer.status_code == 400 and "chosen twice" in answer.text and "selected>In&lt;1&gt;" in answer.text
    answer = me.post(f"/runs/{id}/binding", form(q1="In<1>", q2="In2", u1="O1", u2="O2", K="2.5"))
    assert answer.status_code == 303 and answer.headers["location"] == f"/runs/{id}"
    run = me.until(id, "finished")
    assert run["binding"].splitlines() == [
        *("[map]", '"q_m[1]" = "In<1>"', '"q_m[2]" = "In2"', '"u_m[1]" = "O1"', '"u_m[2]" = "O2"'),
        *("", "[parameters]", '"K" = 2.5'),
    ]
    assert (Files(folder(me)).run(id) / "binding.toml").read_text() == run["binding"]
    assert run["command"].endswith("my.fmu --mapping binding.toml")
    assert me.get(f"/runs/{id}/binding.toml").text == run["binding"]


def test_while_a_run_is_checked_the_findings_of_an_earlier_check_are_not_shown(me):
    """They said "choose its variables in the form below" of a run whose variables had just been chosen."""
    id = me.submit(fmu(checking={"files": UNBOUND["files"], "wait": 3}))["id"]
    under_way(me, id)
    assert "a finding" not in me.get(f"/runs/{id}").text
    me.until(id, "finished")
    assert "a finding" in me.get(f"/runs/{id}").text


def test_the_form_says_that_one_of_two_connectors_is_needed(me):
    id = me.submit(fmu(checking=UNBOUND))["id"]
    me.until(id, "refused")
    page = me.get(f"/runs/{id}").text
    assert "angles [rad], or e<" in page and "torques [N.m]<" in page


def test_another_binding_of_a_finished_run_is_another_run(me):
    id = me.submit(fmu(checking={"files": UNBOUND["files"]}))["id"]
    me.until(id)
    answer = me.put(f"/api/runs/{id}/binding", {"map": {"q_m[1]": "In<1>", "q_m[2]": "In2"}, "parameters": {"K": 3}})
    other = answer.json()
    assert answer.status_code == 200 and other["id"] != id and other["sha256"] == me.run(id)["sha256"]
    assert me.until(other["id"])["state"] == "finished" and me.run(id)["binding"] == ""
    for nonsense in ([], {"map": 3}, {"map": {"a": 1}}, {"nothing": {}}):
        assert me.put(f"/api/runs/{id}/binding", nonsense).status_code == 400
    assert len(me.get(f"/api/runs/{id}/binding").json()["variables"]) == 5


def invited(client, name: str) -> Asker:
    return Asker(client, accounts.invited(client.app.state.service.database, name))


def test_nobody_reaches_what_is_anothers(serve):
    client = serve(SOME)
    ada, ben, stranger = invited(client, "Ada"), invited(client, "Ben"), Asker(client, "0" * 24 + ".x")
    files = {"evaluation/report.html": "r", **UNBOUND["files"]}
    run = ada.submit(fmu(evaluating={"files": files}))
    id = ada.until(run["id"])["id"]
    reading = [
        *(f"/api/runs/{id}", f"/api/runs/{id}/binding", f"/api/runs/{id}/files/evaluation/report.html", f"/runs/{id}"),
        *(f"/runs/{id}/events", f"/runs/{id}/evaluation/report.html", f"/runs/{id}/binding.toml"),
    ]
    changing = [f"/api/runs/{id}/cancel", f"/api/runs/{id}/retry", f"/runs/{id}/delete", f"/runs/{id}/binding"]
    for path in reading:
        assert ada.get(path).status_code == 200 and ben.get(path).status_code == 404, path
        assert stranger.get(path).status_code == 401 and Asker(client).get(path).status_code == 401, path
    for path in changing:
        assert ben.post(path).status_code == 404 and stranger.post(path).status_code == 401, path
    assert ben.delete(f"/api/runs/{id}").status_code == 404 and ben.get("/api/runs").json() == []
    assert [(row["name"], row["person"], row["own"]) for row in ben.get("/api/table").json()] == [("my.fmu", "Ada", "")]
    assert stranger.get("/api/table").status_code == 401 and stranger.post("/api/runs", fmu()).status_code == 401


def test_somebody_comes_in_by_an_invitation_and_leaves(serve):
    client = serve(SOME)
    key = accounts.invited(client.app.state.service.database, "Ada")
    own = {"origin": "http://127.0.0.1:8080"}
    assert client.get("/", follow_redirects=False).headers["location"] == "/join"
    assert client.post("/join", data={"key": key + "x"}, headers=own).status_code == 403
    entered = client.post("/join", data={"key": key}, headers=own, follow_redirects=False)
    cookie = entered.headers["set-cookie"]
    assert entered.status_code == 303 and "HttpOnly" in cookie and "SameSite=lax" in cookie
    assert "Ada" in client.get("/").text
    assert client.post("/leave").status_code == 403, "no page of the service has asked for it"
    assert client.post("/leave", headers=own, follow_redirects=False).status_code == 303
    token = re.search("session=([^;]+)", cookie)[1]
    assert client.get("/", headers={"cookie": f"session={token}"}, follow_redirects=False).status_code == 303
    text = "".join(sqlite3.connect(client.app.state.service.files.database).iterdump())
    assert key.partition(".")[2] not in text and token not in text, "only hashes are stored"


def test_a_new_invitation_ends_the_old_one_and_who_is_removed_is_out(serve):
    client = serve(SOME)
    database = client.app.state.service.database
    old = invited(client, "Ada")
    run = old.submit()
    new = invited(client, "Ada")
    assert old.get("/api/runs").status_code == 401 and len(new.get("/api/runs").json()) == 1
    accounts.removed(database, "Ada")
    assert new.get("/api/runs").status_code == 401 and database.run(run["id"]) is None


@pytest.mark.parametrize("name", ["", " ", "a" * 61, "<b>", "a\nb", "/etc"])
def test_names_of_people_are_names(name, tmp_path):
    from orchestrator import InputError
    from orchestrator.service.database import Database

    with pytest.raises(InputError, match="cannot be a name"):
        accounts.invited(Database(tmp_path / "x.sqlite"), name)


def test_people_take_turns_in_the_service(serve):
    client = serve(replace(SOME, conduct=replace(ALONE.conduct, evaluations=1)))
    ada, ben = invited(client, "Ada"), invited(client, "Ben")
    runs = [ada.submit(fmu(checking={"wait": 0.3}, x=number), f"{number}.fmu")["id"] for number in range(8)]
    (last,) = [ben.submit(fmu(), "b.fmu")["id"]]
    ben.until(last, "evaluating", "finished")
    still = [ada.run(id)["state"] for id in runs]
    assert still.count("received") >= 3, still


def test_the_stream_of_a_run_ends_with_it(me):
    id = me.submit(fmu(quick={"wait": 0.5}))["id"]
    with me.client.stream("GET", f"/runs/{id}/events") as stream:
        news = [json.loads(line.removeprefix("data: ")) for line in stream.iter_lines() if line.startswith("data: ")]
    assert news[-1]["final"] and any(each["total"] == 24 and each["cost"] == "101.5" for each in news)
    assert not me.client.app.state.service.streams[accounts.LOCAL.id]


def test_the_description_names_every_endpoint_and_its_types(me):
    told = me.get("/api/openapi.json").json()
    assert told["openapi"].startswith("3.1") and {"/api/runs", "/api/runs/{id}", "/api/table"} <= set(told["paths"])
    references = set(re.findall(r'"#/components/schemas/(\w+)"', json.dumps(told)))
    assert references and references <= set(told["components"]["schemas"])
    for path, methods in told["paths"].items():
        for method in methods:
            answer = me.client.request(
                method, path.replace("{id}", "a" * 24).replace("{place}", "x").replace("{file}", "y")
            )
            assert answer.status_code not in (405, 500), (method, path)


@pytest.mark.needs("jsonschema")
def test_answers_are_as_they_are_described(me):
    import jsonschema

    told = me.get("/api/openapi.json").json()
    me.until(me.submit()["id"])
    for path in ("/api/runs", "/api/table"):
        content = told["paths"][path]["get"]["responses"]["200"]["content"]["application/json"]["schema"]
        jsonschema.validate(me.get(path).json(), {**content, "components": told["components"]})


def test_the_table_has_the_best_first_and_of_one_name_the_latest(me):
    for number, (name, cost, holds) in enumerate(
        [("a.fmu", 90.0, True), ("b.fmu", 80.0, False), ("c.fmu", 95.0, True), ("a.fmu", 91.0, True)]
    ):
        me.until(me.submit(fmu(evaluating={"cost": cost, "holds": holds}, x=number), name)["id"])
    assert [(row["name"], row["cost"]) for row in me.get("/api/table").json()] == [
        *(("a.fmu", 91.0), ("c.fmu", 95.0), ("b.fmu", 80.0))
    ]


def test_a_form_without_scripts_uploads_as_well(me):
    own = {"origin": "http://127.0.0.1:8080"}
    answer = me.client.post("/runs", files={"file": ("f.fmu", fmu())}, headers=own, follow_redirects=False)
    assert answer.status_code == 303
    assert me.until(answer.headers["location"].rpartition("/")[2])["name"] == "f.fmu"
    for bad in ({"files": {"other": ("f.fmu", fmu())}}, {"content": b"x"}, {"data": {"file": "x"}}):
        assert me.client.post("/runs", headers=own, **bad).status_code == 400


def test_only_finished_runs_of_ones_own_are_compared(me):
    one = me.submit()["id"]
    me.until(one)
    other = me.submit(fmu(checking={"wait": 60}), "b.fmu")["id"]
    assert me.client.post("/api/comparisons", json=[one]).status_code == 400
    assert me.client.post("/api/comparisons", json=[one, other]).status_code == 409
    assert me.client.post("/api/comparisons", json=[one, "b" * 24]).status_code == 404
    assert me.client.post("/api/comparisons", json={"a": 1}).status_code == 400


def test_a_full_disk_refuses_an_upload_in_a_sentence_and_loses_nothing(me, monkeypatch):
    from orchestrator.errors import EnvironmentFault
    from orchestrator.service.files import Incoming

    def full(*_):
        raise EnvironmentFault("An upload cannot be stored: No space left on device.", "not-written")

    with monkeypatch.context() as patched:
        patched.setattr(Incoming, "settle", full)
        answer = me.post("/api/runs?name=a.fmu", fmu())
    assert answer.status_code == 503 and "No space left" in answer.json()["error"]
    assert me.until(me.submit()["id"])["state"] == "finished"


def test_a_folder_that_cannot_be_written_is_told_and_loses_nothing(me):
    runs, aside = (me.client.app.state.service.files.root / name for name in ("runs", "aside"))
    runs.rename(aside)
    runs.write_text("no folder")
    id = me.submit()["id"]
    failed = me.until(id)
    assert failed["state"] == "failed" and "cannot be written" in failed["reason"]
    runs.unlink()
    aside.rename(runs)
    assert me.post(f"/api/runs/{id}/retry").status_code == 200
    assert me.until(id, "finished")["cost"] == 99.5


def test_a_clock_that_jumps_by_days_loses_nothing(me, monkeypatch):
    true, jumps = time.time, itertools.cycle((0.0, 86400.0, -2.6e6, 3600.0, -86400.0))
    monkeypatch.setattr(time, "time", lambda: true() + next(jumps))
    ids = [me.submit(fmu(), f"{number}.fmu")["id"] for number in range(4)]
    assert [me.until(id)["state"] for id in ids] == 4 * ["finished"]


def test_a_locked_database_loses_no_outcome(me, monkeypatch):
    monkeypatch.setattr(database, "BUSY", 0.1)
    service = me.client.app.state.service
    service.database._connection.execute("PRAGMA busy_timeout = 100")
    id = me.submit(fmu(checking={"wait": 0.3}))["id"]
    me.until(id, "checking")
    other = sqlite3.connect(service.files.database, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    time.sleep(1.0)
    assert me.run(id)["state"] == "checking", "the outcome waits"
    assert me.post("/api/runs?name=b.fmu", fmu()).status_code == 503
    other.execute("ROLLBACK")
    assert me.until(id)["state"] == "finished"


def test_a_job_shows_its_sandbox_nothing_of_the_services_folder_and_imports_nothing_from_a_runs(me):
    """An FMU that reads another's could tell it in its messages."""
    from orchestrator.cache import PRIVATE
    from orchestrator.service.runner import environment

    files = me.client.app.state.service.files
    variables = environment(files, sandbox=True)
    assert variables[PRIVATE] == str(files.root) and variables["PYTHONSAFEPATH"]
    assert PRIVATE not in environment(files, sandbox=False), "with --trust, sources are compiled without a sandbox"


def test_cancelling_and_beginning_again_gets_round_no_quota(serve, limited):
    """What ends at once takes no time in the queue, and an FMU of some bytes none of the disk."""
    me = Asker(serve(limited(disk=3 * database.LEAST)))
    for number in range(3):
        run = me.submit(fmu(checking={"wait": 60}), f"{number}.fmu")
        assert me.post(f"/api/runs/{run['id']}/cancel").status_code == 200
    assert me.post("/api/runs?name=c.fmu", fmu()).status_code == 507
    assert me.delete(f"/api/runs/{run['id']}").status_code == 204
    assert me.post("/api/runs?name=c.fmu", fmu()).status_code == 201


def test_a_long_binding_counts_in_the_quota(serve, limited, monkeypatch):
    monkeypatch.setattr(database, "LEAST", 10_000)
    me = Asker(serve(limited(disk=5 * database.LEAST)))
    id = me.until(me.submit()["id"])["id"]
    long = {"map": {"a": "x" * 5 * database.LEAST}}
    assert me.put(f"/api/runs/{id}/binding", long).status_code == 200
    assert me.put(f"/api/runs/{id}/binding", long).status_code == 507


def test_the_history_of_a_run_has_an_end(me, monkeypatch):
    monkeypatch.setattr(database, "MAX_HISTORY", 4)
    id = me.submit(fmu(checking={"wait": 60}))["id"]
    for _ in range(4):
        me.post(f"/api/runs/{id}/cancel")
        me.post(f"/api/runs/{id}/retry")
    rows = me.client.app.state.service.database.history(id)
    assert len(rows) == 4 and "begun again" in [text for _, text in rows]


def test_comparisons_are_kept_in_a_number_and_made_a_few_at_a_time(me, monkeypatch):
    """There are millions of them of a dozen runs, and their pages are in no quota of the disk."""
    service = me.client.app.state.service

    async def compared(files, id, folders):
        files.comparison(id).mkdir()

    monkeypatch.setattr("orchestrator.service.service.compared", compared)
    monkeypatch.setattr(database, "MAX_COMPARISONS", 2)
    a, b, c = (me.until(me.submit(name=f"{name}.fmu")["id"])["id"] for name in "abc")
    made = [me.client.post("/api/comparisons", json=ids).json()["id"] for ids in ([a, b], [b, c], [a, c])]
    assert {folder.name for folder in (service.files.root / "comparisons").iterdir()} == set(made[1:])
    assert [me.get(f"/comparisons/{id}").status_code for id in made] == [404, 200, 200]
    service.comparisons[accounts.LOCAL.id] = 2
    assert me.client.post("/api/comparisons", json=[c, a]).status_code == 429


def test_a_run_that_is_deleted_while_it_is_compared_leaves_no_comparison(me, monkeypatch):
    service = me.client.app.state.service
    one, other = (me.until(me.submit(name=f"{name}.fmu")["id"])["id"] for name in "ab")

    async def compared(files, id, folders):
        files.comparison(id).mkdir()
        service.remove(service.own(accounts.LOCAL, one))

    monkeypatch.setattr("orchestrator.service.service.compared", compared)
    assert me.client.post("/api/comparisons", json=[one, other]).status_code == 404
    assert not list((service.files.root / "comparisons").iterdir())


def test_a_stranger_sends_no_more_than_a_key(serve):
    """Hundreds at a time would else fill the memory with forms."""
    client = Asker(serve(SOME))
    assert client.post("/join", b"key=" + b"x" * 5000).status_code == 413
    assert client.post("/join", b"&" * 3000 + b"key=x").status_code == 400


@pytest.mark.parametrize("headers", [{"host": "[bad"}, {"origin": "http://[bad"}])
def test_what_is_no_address_is_none_of_this_service(me, headers):
    assert me.post("/api/runs?name=a.fmu", fmu(), **headers).status_code == 403


def test_whoever_waits_for_news_more_often_than_allowed_is_answered_at_once(serve, limited, monkeypatch):
    """Each of them takes a connection, of which the service has 500 for everybody."""
    me = Asker(serve(limited(streams=0)))
    run = me.submit(fmu(checking={"wait": 60}))
    run = me.until(run["id"], "checking")
    monkeypatch.setattr(me.client.app.state.service.runner, "news", lambda _: pytest.fail("it waits"))
    assert me.get(f"/api/runs/{run['id']}?since={run['revision']}").json() == run


def test_a_run_that_goes_as_its_stage_begins_stops_nothing(me, monkeypatch):
    """``serve --remove`` is another process: the queue ended in silence."""
    begin, gone = Files.begin, []

    def removed(files, id, *rest):
        folder = begin(files, id, *rest)
        if not gone:
            gone.append(id)
            me.client.app.state.service.database.remove_run(id)
        return folder

    monkeypatch.setattr(Files, "begin", removed)
    me.submit(name="a.fmu")
    assert me.until(me.submit(name="b.fmu")["id"])["state"] == "finished" and gone


def test_a_mistake_in_the_queue_is_logged_and_the_queue_goes_on(me, monkeypatch, caplog):
    runner = me.client.app.state.service.runner
    begin, failed = runner._start, []

    def broken(run):
        if not failed:
            failed.append(run)
            raise KeyError("a mistake")
        begin(run)

    monkeypatch.setattr(runner, "_start", broken)
    assert me.until(me.submit()["id"])["state"] == "finished" and "goes on" in caplog.text


def test_many_names_push_nobody_out_of_the_table(serve, monkeypatch):
    monkeypatch.setattr(database, "MAX_ROWS", 2)
    client = serve(SOME)
    ada, ben = invited(client, "Ada"), invited(client, "Ben")
    for number in range(3):
        ada.until(ada.submit(fmu(evaluating={"cost": 50.0 + number}), f"{number}.fmu")["id"])
    ben.until(ben.submit(fmu(evaluating={"cost": 200.0}), "b.fmu")["id"])
    assert [(row["name"], row["cost"]) for row in ben.get("/api/table").json()] == [("0.fmu", 50.0), ("b.fmu", 200.0)]


def test_one_controller_evaluated_many_times_pushes_nobody_out_of_the_table(me, monkeypatch):
    monkeypatch.setattr(database, "MAX_ROWS", 2)
    other = me.submit(fmu(evaluating={"cost": 200.0}), "other.fmu")["id"]
    me.until(other)
    for cost in (50.0, 60.0, 70.0):
        me.until(me.submit(fmu(evaluating={"cost": cost}), "mine.fmu")["id"])
    rows = me.get("/api/table").json()
    assert [(row["name"], row["cost"]) for row in rows] == [("mine.fmu", 70.0), ("other.fmu", 200.0)]
