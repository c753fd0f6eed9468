"""A copy that is made while a service works is a whole service."""

from support.command_lines import call

from orchestrator.service.files import KINDS
from service.conftest import Asker, fmu


def test_a_copy_has_the_same_table_and_goes_on_with_what_had_not_ended(serve, tmp_path):
    me, copy = Asker(serve()), tmp_path / "copy"
    done = me.until(me.submit(fmu(), "done.fmu")["id"])
    waits = me.submit(fmu(checking={"wait": 600.0}), "waits.fmu")["id"]
    made = call("serve", "--data", "data", "--backup", copy, folder=tmp_path)
    assert (made.code, made.err) == (0, "")
    assert copy.stat().st_mode & 0o077 == 0
    for kind in KINDS[:2]:
        assert {file.relative_to(copy) for file in (copy / kind).rglob("*.fmu")}, kind
    assert me.delete(f"/api/runs/{waits}").status_code < 300  # in the copy it is still there
    me.submit(fmu(), "later.fmu")
    other = Asker(serve(folder=copy))
    assert other.run(done["id"]) == me.run(done["id"])
    assert not other.run(waits)["is_final"]
    assert {run["name"] for run in other.get("/api/runs").json()} == {"done.fmu", "waits.fmu"}


def test_a_copy_overwrites_nothing_and_is_of_a_service(serve, tmp_path):
    serve()
    for _ in range(2):
        again = call("serve", "--data", "data", "--backup", "copy", folder=tmp_path)
    assert again.code == 2 and "is not empty" in again.err
    nothing = call("serve", "--data", "elsewhere", "--backup", "other", folder=tmp_path)
    assert nothing.code == 2 and "not the folder of a service" in nothing.err
    assert not (tmp_path / "elsewhere").exists()
