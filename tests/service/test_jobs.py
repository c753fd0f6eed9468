"""The service with its real jobs: the ordinary check and evaluations, on a protocol of one pose."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from support.command_lines import call
from support.tools import require

from controller_fmu.export.archive import pack, unpack
from service.conftest import ALONE, Asker
from service.unusual import BINDING, NAMES, unusual

require("starlette", "uvicorn", "httpx2")

pytestmark = pytest.mark.slow

ONE_POSE = (
    'extends = "quick"\nname = "{}"\n[grid]\nq_a1_points = 1\nq_a2_points = 1\n'
    '[selection]\nposes = [0]\ntests = ["noise", "disturbance"]\n'
)


@pytest.fixture
def conduct(tmp_path: Path):
    """Protocols of a few cases."""
    for name in ("quick", "paper"):
        (tmp_path / f"{name}.toml").write_text(ONE_POSE.format(name), encoding="utf-8")
    return replace(
        ALONE.conduct, protocol=str(tmp_path / "paper.toml"), quick_protocol=str(tmp_path / "quick.toml"), processes=2
    )


@pytest.fixture
def settings(conduct):
    return replace(ALONE, conduct=conduct)


def cases(file: Path) -> str:
    return json.dumps(json.loads(file.read_text(encoding="utf-8"))["cases"])


def of_command_line(fmu: Path, conduct, folder: Path, *words: str) -> str:
    """The cases that the ordinary command gives."""
    finished = call(
        *("evaluate", fmu, "--protocol", conduct.protocol, "--no-report", "--output-dir", "mine", *words), folder=folder
    )
    assert finished.code == 0, finished.err
    return cases(folder / "mine" / "results.json")


def test_an_fmu_with_unusual_names_is_refused_bound_and_evaluated_to_the_last_bit(
    serve, settings, quick_pid_file, tmp_path
):
    from orchestrator.service.runner import JOB

    fmu = unusual(quick_pid_file, tmp_path / "my.fmu")
    me = Asker(serve(settings, job=JOB))
    id = me.submit(fmu.read_bytes())["id"]
    for _ in range(10):  # a machine that computes other things, too
        run = me.run(id)
        if run["is_final"]:
            break
        run = me.until(id, "refused")
    assert "q_m" in run["reason"] or "u_m" in run["reason"]
    page = me.get(f"/runs/{id}").text
    assert "Gelenk &lt;links&gt; Winkel" in page and "Choose its variables in the form below." in page
    assert me.put(f"/api/runs/{id}/binding", {"map": BINDING, "parameters": {NAMES["K_p[1]"]: 44.0}}).status_code == 200
    run = _ended(me, id)
    assert run["state"] == "finished", run
    service = me.client.app.state.service
    folder = service.files.run(id)
    (tmp_path / "binding.toml").write_text(run["binding"], encoding="utf-8")
    found = cases(folder / "evaluation" / "results.json")
    assert found == of_command_line(fmu, settings.conduct, tmp_path, "--mapping", "binding.toml")
    head = json.loads((folder / "evaluation" / "results.json").read_text(encoding="utf-8"))["head"]
    assert head["controller"]["parameters"] == {NAMES["K_p[1]"]: 44.0}
    assert (folder / "evaluation" / "report.html").stat().st_size > 100_000
    page = me.get(f"/runs/{id}").text
    assert "badge met" in page and "report.html" in page
    again = me.put(f"/api/runs/{id}/binding", {"map": BINDING}).json()["id"]
    assert _ended(me, again)["state"] == "finished"
    compared = me.client.post("/api/comparisons", json=[id, again]).json()["id"]
    assert "sandbox" in me.get(f"/comparisons/{compared}").text
    assert len(me.get(f"/comparisons/{compared}/page").text) > 100_000
    me.delete(f"/api/runs/{id}")
    assert me.get(f"/comparisons/{compared}/page").status_code == 404


def _ended(me: Asker, id: str) -> dict:
    for _ in range(20):
        try:
            return me.until(id)
        except AssertionError as slow:
            last = slow
    raise last


def test_what_is_no_fmu_and_what_is_broken_is_refused_with_findings(serve, settings, quick_pid_file, tmp_path):
    from orchestrator.service.runner import JOB

    me = Asker(serve(settings, job=JOB))
    broken = [b"PK" + bytes(1000), quick_pid_file.read_bytes()[:-2000], b"PK\x05\x06" + bytes(18)]
    ids = [me.submit(content, f"{number}.fmu")["id"] for number, content in enumerate(broken)]
    for id in ids:
        run = _ended(me, id)
        assert run["state"] == "refused" and run["reason"], run
        assert "badge not-met" in me.get(f"/runs/{id}").text


@pytest.mark.needs("posix")
def test_killing_the_service_and_its_jobs_loses_nothing(settings, quick_pid_file, tmp_path):
    """As in benchmarks/service.py, with a few moments in place of many."""
    from orchestrator.service.client import Client

    data = tmp_path / "data"
    words = ["--trust", "--data", str(data), "--port", "0", "--protocol", settings.conduct.protocol, "--jobs", "2"]

    def begin() -> tuple[subprocess.Popen, Client]:
        command = [sys.executable, "-m", "orchestrator.serve", *words]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        return process, Client(process.stdout.readline().split()[0])

    process, client = begin()
    try:
        ids = [client.submit(quick_pid_file)["id"] for _ in range(2)]
        for seconds in (2.0, 4.0):
            time.sleep(seconds)
            process.send_signal(signal.SIGKILL)
            process.wait()
            process, client = begin()
        ends = [client.follow(id, lambda run: None) for id in ids]
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(30)
    assert [run["state"] for run in ends] == ["finished"] * 2, ends
    assert all([event["text"] for event in run["history"]].count("finished") == 1 for run in ends)
    mine = of_command_line(quick_pid_file, settings.conduct, tmp_path)
    assert [cases(data / "runs" / id / "evaluation" / "results.json") for id in ids] == [mine] * 2


def test_what_is_extracted_of_an_fmu_counts(serve, settings, quick_pid_file, tmp_path):
    """Zeros pack a thousand to one: a person's quota would else be of what was uploaded, not of what is taken."""
    from orchestrator.service.runner import JOB

    # Another FMU in it, too; and a small file or a folder takes a block.
    entries = {**unpack(quick_pid_file), "resources/zeros.fmu": bytes(20_000_000)}
    entries |= {f"resources/{number}/a": b"" for number in range(1000)}
    (tmp_path / "large.fmu").write_bytes(pack(entries))
    client = serve(settings, job=JOB)
    me = Asker(client)
    id = me.submit((tmp_path / "large.fmu").read_bytes())["id"]
    _ended(me, id)
    assert client.app.state.service.database.run(id).disk > 28_000_000
