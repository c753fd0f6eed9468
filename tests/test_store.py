"""The store: what is committed survives, and what is found belongs to exactly what was asked for."""

from __future__ import annotations

import json
import random
import shutil
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest
from hostile.runs import PROTOCOL
from hypothesis import given, settings
from hypothesis import strategies as st

from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.metrics import CaseResult, Measurement
from orchestrator.commands import nominal_parameters
from orchestrator.cosim.archive import Archive, open_archive
from orchestrator.cosim.controller import Setup
from orchestrator.cosim.trajectory import Status
from orchestrator.errors import BenchmarkError, InputError
from orchestrator.execution import store
from orchestrator.execution.evaluation import Bench
from orchestrator.execution.job import Limits


@pytest.fixture(scope="module")
def own(plant_file, pid_file) -> Bench:
    """The plant and the default controller."""
    return Bench(open_archive(plant_file), open_archive(pid_file))


@pytest.fixture(scope="module")
def cases(own):
    """All cases of the quick protocol."""
    return protocols.cases(PROTOCOL, nominal_parameters(own.plant, {}), 0)


@pytest.fixture
def opened(tmp_path):
    """An open, empty store."""
    with store.opened(tmp_path) as results:
        yield results


# ---- Keys ----


def with_bytes(archive: Archive) -> Archive:
    """Another FMU of the same name."""
    return replace(archive, sha256="0" * 64)


CHANGES = {
    "controller": lambda bench: replace(bench, controller=with_bytes(bench.controller)),
    "plant": lambda bench: replace(bench, plant=with_bytes(bench.plant)),
    "parameter": lambda bench: replace(bench, setup=Setup({"K_p[1]": 46.0})),
    "other parameter": lambda bench: replace(bench, setup=Setup({"K_p[1]": 46.000000000000007})),
    "mapping": lambda bench: replace(bench, setup=Setup(mapping={"q_m[1]": "In1"})),
}


@pytest.mark.parametrize("change", CHANGES)
def test_whatever_the_result_depends_on_changes_the_key(change, own, cases):
    before, after = store.keys(PROTOCOL, cases, own), store.keys(PROTOCOL, cases, CHANGES[change](own))
    assert not set(before.values()) & set(after.values())


@pytest.mark.parametrize("library", ["numpy", "numba", "fmpy"])
def test_another_version_of_a_library_changes_the_key(library, own, cases, monkeypatch):
    before, installed = store.keys(PROTOCOL, cases, own), store.metadata.version
    monkeypatch.setattr(store.metadata, "version", lambda name: "0.0" if name == library else installed(name))
    store._code.cache_clear()
    after = store.keys(PROTOCOL, cases, own)
    store._code.cache_clear()
    assert not set(before.values()) & set(after.values())


def test_keys_of_all_cases_differ(own, cases):
    keys = store.keys(PROTOCOL, cases, own)
    assert len(set(keys.values())) == len(cases)


@pytest.mark.parametrize("what", ["seed", "sample time", "plant parameter", "duration"])
def test_another_scenario_has_another_key(what, own, cases):
    nominal = nominal_parameters(own.plant, {})
    others = {
        "seed": lambda: protocols.cases(PROTOCOL, nominal, 1),
        "sample time": lambda: protocols.cases(PROTOCOL, nominal, 0, Fraction(1, 2000)),
        "plant parameter": lambda: protocols.cases(PROTOCOL, {**nominal, "k_high[2]": 0.5e6}, 0),
        "duration": lambda: [replace(c, scenario=replace(c.scenario, duration=c.scenario.duration + 1)) for c in cases],
    }[what]()
    before, after = store.keys(PROTOCOL, cases, own), store.keys(PROTOCOL, others, own)
    changed = [b != a for b, a in zip(before.values(), after.values(), strict=True)]
    # A stability test draws no disturbance, but its noise has a seed as well.
    assert all(changed)


@pytest.mark.parametrize("section", ["benchmark", "settling", "stability"])
def test_another_judgement_has_another_key(section, own, cases):
    raw = json.loads(json.dumps(dict(PROTOCOL.raw), default=str))
    changed = replace(PROTOCOL, raw=raw)
    if section == "benchmark":
        changed = replace(PROTOCOL, benchmark="FlexibleManipulator-v2")
    elif section == "settling":
        raw["settling"]["error"] = 0.2e-3
    else:
        raw["stability"]["limit_cycle"] = 20e-6
    before, after = store.keys(PROTOCOL, cases, own), store.keys(changed, cases, own)
    assert not set(before.values()) & set(after.values())


@pytest.mark.parametrize("room", ["COSIM", "BENCHMARK"])
def test_other_code_has_another_key(room, own, cases, monkeypatch, tmp_path):
    before = store.keys(PROTOCOL, cases, own)
    edited = tmp_path / getattr(store, room).name
    shutil.copytree(getattr(store, room), edited)
    with next(iter(sorted(edited.glob("*.py")))).open("a") as module:
        module.write("# edited\n")
    monkeypatch.setattr(store, room, edited)
    store._code.cache_clear()
    after = store.keys(PROTOCOL, cases, own)
    store._code.cache_clear()
    assert not set(before.values()) & set(after.values())


def test_protocols_share_the_cases_that_are_equal(own):
    """A case of the paper's protocol is not run again because "quick" has it, too, nor the other way round."""
    nominal = nominal_parameters(own.plant, {})
    paper = protocols.load("paper")
    of_paper = store.keys(paper, protocols.cases(paper, nominal, 0), own)
    of_quick = store.keys(PROTOCOL, protocols.cases(PROTOCOL, nominal, 0), own)
    shared = set(of_paper.values()) & set(of_quick.values())
    poses = {(case.configuration.q_a1, case.configuration.q_a2, case.system.name, case.test.name): key
             for case, key in of_paper.items()}  # fmt: skip
    for case, key in of_quick.items():
        if key in shared:
            same = (case.configuration.q_a1, case.configuration.q_a2, case.system.name, case.test.name)
            assert poses[same] == key


def test_limits_do_not_change_the_key(own, cases):
    other = replace(own, timeout=1.0, limits=Limits(memory=1), sandbox=True)
    assert store.keys(PROTOCOL, cases, own) == store.keys(PROTOCOL, cases, other)


# ---- Rows ----

numbers = st.floats(allow_nan=False)
measurements = st.builds(
    Measurement,
    criteria=st.dictionaries(st.sampled_from(["B1", "B5", "B6"]), numbers),
    limit_cycle=st.none() | st.tuples(numbers, numbers),
    rest_error=st.none() | numbers,
    settled=st.none() | st.booleans(),
)


@settings(max_examples=50)
@given(
    status=st.sampled_from(list(Status)),
    time=numbers,
    message=st.text(),
    measurement=st.none() | measurements,
    warnings=st.integers(0, 2**40),
    kind=st.text(),
)
def test_a_record_gives_the_result_back_to_the_last_bit(cases, status, time, message, measurement, warnings, kind):
    result = CaseResult(cases[0], status, time, message, measurement, warnings, wall_time=1.25, kind=kind)
    record = json.loads(json.dumps(store.to_record(result)))
    assert store.from_record(cases[0], record) == result


def test_put_load_forget(opened, own, cases):
    keys = store.keys(PROTOCOL, cases, own)
    first, second = (CaseResult(case, Status.DONE, 2.0) for case in cases[:2])
    for result in (first, second, second):
        opened.put(keys[result.case], result)
    assert opened.load(keys) == [first, second]
    opened.put(keys[first.case], replace(first, warnings=3))
    assert opened.load(keys) == [replace(first, warnings=3), second]
    opened.forget([keys[first.case]])
    assert opened.load(keys) == [second]


@pytest.mark.parametrize("status", [Status.TIMEOUT, Status.CRASHED, Status.ERROR])
def test_a_failure_counts_under_the_conditions_it_happened_in(status, opened, own, cases):
    """A case that took too long for --timeout 1 is not done with for --timeout 100."""
    keys = store.keys(PROTOCOL, cases, own)
    opened.put(keys[cases[0]], CaseResult(cases[0], status, 1.0), store.conditions(own))
    opened.put(keys[cases[1]], CaseResult(cases[1], Status.UNSTABLE, 1.0), store.conditions(own))
    assert len(opened.load(keys, store.conditions(own))) == 2
    for other in (replace(own, timeout=100.0), replace(own, limits=Limits(memory=1)), replace(own, sandbox=True)):
        assert [result.case for result in opened.load(keys, store.conditions(other))] == [cases[1]]


@pytest.mark.parametrize("status", [Status.TIMEOUT, Status.CRASHED, Status.ERROR])
def test_failures_can_be_left_where_they_are(status, opened, own, cases):
    keys = store.keys(PROTOCOL, cases, own)
    for case, how in zip(cases, (Status.DONE, status, Status.UNSTABLE), strict=False):
        opened.put(keys[case], CaseResult(case, how, 1.0))
    assert [result.case for result in opened.load(keys)] == list(cases[:3])
    assert [result.case for result in opened.load(keys, failures=False)] == [cases[0], cases[2]]


def test_a_record_that_makes_no_sense_is_none(opened, own, cases, tmp_path):
    keys = store.keys(PROTOCOL, cases, own)
    opened.put(keys[cases[0]], CaseResult(cases[0], Status.DONE, 2.0))
    with sqlite3.connect(tmp_path / "cases.sqlite") as other:
        for case, record in zip(cases[1:], ("", "{}", "[1]", '{"status": "fine"}', "null"), strict=False):
            other.execute("INSERT INTO results VALUES (?, ?, ?)", (keys[case], case.id, record))
    assert [result.case for result in opened.load(keys)] == [cases[0]]


# ---- Files ----


def test_a_folder_is_for_one_evaluation_at_a_time(tmp_path):
    with store.opened(tmp_path):
        with pytest.raises(InputError, match="Another evaluation is writing"), store.opened(tmp_path):
            pass
        other = f"""
from pathlib import Path
from orchestrator.execution import store
store.opened(Path({str(tmp_path)!r})).__enter__()
"""
        done = subprocess.run([sys.executable, "-c", other], capture_output=True, text=True)
        assert "Another evaluation is writing" in done.stderr
    with store.opened(tmp_path):
        pass


@pytest.mark.parametrize(
    "contents", [b"this is no database, but long enough to be one" * 100, b"SQLite format 3\0junk"]
)
def test_a_damaged_file_is_told(contents, tmp_path):
    (tmp_path / "cases.sqlite").write_bytes(contents)
    with pytest.raises(BenchmarkError, match="cases.sqlite cannot be"), store.opened(tmp_path) as results:
        results.load({})


def test_a_full_disk_is_told_and_keeps_what_is_committed(tmp_path, own, cases):
    keys = store.keys(PROTOCOL, cases, own)
    long = CaseResult(cases[1], Status.ERROR, 2.0, "x" * 100_000)
    with store.opened(tmp_path) as results:
        results.put(keys[cases[0]], CaseResult(cases[0], Status.DONE, 2.0))
        results._connection.execute("PRAGMA max_page_count = 8")
        with pytest.raises(BenchmarkError, match="full.*What is committed is kept"):
            results.put(keys[cases[1]], long)
    with store.opened(tmp_path) as results:
        assert [result.case for result in results.load(keys)] == [cases[0]]


WRITER = """
import sys
from pathlib import Path
from types import SimpleNamespace
from orchestrator.benchmark.metrics import CaseResult
from orchestrator.cosim.trajectory import Status
from orchestrator.execution import store
with store.opened(Path(sys.argv[1])) as results:
    for number in range(100000):
        results.put(f"key {number}", CaseResult(SimpleNamespace(id=str(number)), Status.DONE, float(number)))
        print(number, flush=True)
"""


def test_what_was_reported_as_stored_survives_kill_9(tmp_path):
    for _ in range(3):
        writer = subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
        assert writer.stdout is not None
        last = int(writer.stdout.readline())
        time.sleep(random.uniform(0.0, 0.2))
        writer.kill()
        last = max([last, *(int(line) for line in writer.stdout.read().splitlines(keepends=True) if line[-1] == "\n")])
        writer.wait()
        with store.opened(Path(tmp_path)) as results:
            rows = results._connection.execute("SELECT count(*) FROM results").fetchone()[0]
            assert results._connection.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
        assert rows >= last + 1


def test_every_row_is_committed_with_the_disk_in_mind(opened):
    assert opened._connection.execute("PRAGMA synchronous").fetchone()[0] == 2  # FULL
    assert opened._connection.execute("PRAGMA journal_mode").fetchone()[0] == "wal"
