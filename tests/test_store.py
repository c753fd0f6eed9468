"""The store: what is committed survives, and what is found belongs to exactly what was asked for."""

import math
import re
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace as with_fields
from support.closed_loops import case
from support.results import trajectory

from orchestrator import cache
from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.cases import cases as cases_of
from orchestrator.benchmark.metrics import case_result, continuation_if_in_doubt, expected, judge, measure
from orchestrator.benchmark.protocol import JudgingTables
from orchestrator.benchmark.results import Judgement, Measurements
from orchestrator.codec import Struct
from orchestrator.errors import EnvironmentFault, InputError
from orchestrator.execution import store
from orchestrator.execution.job import Limits
from orchestrator.fmi.archive import open_archive
from orchestrator.loop.setup import Setup
from orchestrator.loop.trajectory import Status
from orchestrator.pairing.runs import CaseRun
from orchestrator.study import stored as stored_runs
from plant_fmu.flexible_manipulator.parameters import NOMINAL

QUICK, PAPER = protocols.load("quick"), protocols.load("paper")
CASES = cases_of(QUICK, NOMINAL, 0)
FAILURES = [Status.TIMEOUT, Status.CRASHED, Status.ERROR]


@pytest.fixture
def opened(tmp_path):
    """An open, empty store."""
    with store.opened(tmp_path) as results:
        yield results


def keys(bench, protocol=QUICK, cases=CASES) -> set[str]:
    """The keys of ``cases``, all different."""
    found = stored_runs.keys(protocol, cases, bench)
    assert len(set(found)) == len(cases)
    return set(found)


BENCHES = {
    "controller": lambda bench: replace(bench, controller=replace(bench.controller, sha256="0" * 64)),
    "plant": lambda bench: replace(bench, plant=replace(bench.plant, sha256="0" * 64)),
    "parameter": lambda bench: replace(bench, setup=Setup({"K_p[1]": 46.0})),
    "last bit": lambda bench: replace(bench, setup=Setup({"K_p[1]": 46.000000000000007})),
    "mapping": lambda bench: replace(bench, setup=Setup(mapping={"q_m[1]": "In1"})),
    "sandbox": lambda bench: replace(bench, sandbox=True),  # outside of it, an FMU can read any file
}
PROTOCOLS = {
    "benchmark": with_fields(QUICK, benchmark="FlexibleManipulator-v0"),
    "settling": with_fields(QUICK, settling=with_fields(QUICK.settling, error=0.2e-3)),
    "stability": with_fields(QUICK, stability=with_fields(QUICK.stability, limit_cycle=20e-6)),
}
SCENARIOS = {
    "seed": cases_of(QUICK, NOMINAL, 1),
    "sample time": cases_of(QUICK, NOMINAL, 0, Fraction(1, 2000)),
    "plant parameter": cases_of(QUICK, {**NOMINAL, "k_high[2]": 0.5e6}, 0),
    "duration": [replace(c, scenario=replace(c.scenario, duration=c.scenario.duration + 1)) for c in CASES],
}


@pytest.mark.parametrize("change", [*BENCHES, *PROTOCOLS, *SCENARIOS])
def test_whatever_the_result_depends_on_changes_the_key(change, own):
    bench = BENCHES.get(change, lambda bench: bench)(own)
    others = keys(bench, PROTOCOLS.get(change, QUICK), SCENARIOS.get(change, CASES))
    assert not keys(own) & others
    assert others == keys(
        replace(bench, timeout=1.0, limits=Limits(memory=1)),
        PROTOCOLS.get(change, QUICK),
        SCENARIOS.get(change, CASES),
    ), "limits do not count"


@pytest.mark.needs("compiler")
def test_binary_and_sources_of_one_file_have_keys_of_their_own(own, pid_c_file):
    """With ``library``, results of the binary were taken for those of the sources."""
    native, source = (replace(own, controller=open_archive(pid_c_file, library)) for library in ("native", "source"))
    assert not keys(native) & keys(source)
    before, library = keys(source), source.controller.library_file
    content = library.read_bytes()
    try:
        library.write_bytes(content + b"\0")  # as of another compiler
        assert not before & keys(source)
    finally:
        library.write_bytes(content)


def test_what_is_installed_belongs_to_a_controller_in_python(own, pid_file, tmp_path, monkeypatch):
    """One that solved an equation with SciPy got the cases of the SciPy before."""
    in_python = replace(own, controller=open_archive(pid_file))
    before, of_none = keys(in_python), stored_runs.keys(PAPER, JUDGED, ANY)
    (tmp_path / "scipy-0.0.1.dist-info").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    forget()
    try:
        assert not before & keys(in_python)
        assert stored_runs.keys(PAPER, JUDGED, ANY) == of_none
    finally:
        monkeypatch.undo()
        forget()


@pytest.fixture
def edited(monkeypatch, tmp_path):
    """A copy of the project's sources, which the keys are made of."""
    ignored = shutil.ignore_patterns("__pycache__", "*.fmu")
    for name in cache.PACKAGES[:-1]:
        shutil.copytree(cache.ROOT / name, tmp_path / name, ignore=ignored)
    shutil.copy(cache.ROOT / "build_fmus.py", tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(cache, "OWN", tuple(tmp_path / path.relative_to(cache.ROOT) for path in cache.OWN))
        patch.setattr(cache, "ROOT", tmp_path)
        patch.setattr(cache, "PACKAGE", tmp_path / "orchestrator")
        forget()
        yield tmp_path
    forget()


def forget():
    """What is remembered of sources, which do not change while a program runs."""
    for function in (cache.computing_code, cache.installed, cache.code_hash, cache._file_of, cache._imports):
        function.cache_clear()


@pytest.mark.parametrize("library", cache.LIBRARIES)
def test_another_library_has_another_key(library, own, monkeypatch):
    before, installed = keys(own), cache.metadata.version
    monkeypatch.setattr(cache.metadata, "version", lambda name: "0" if name == library else installed(name))
    forget()
    try:
        assert not before & keys(own)
    finally:
        forget()


@pytest.mark.parametrize(
    "file",
    [
        "plant_fmu/flexible_manipulator/formulas.py",  # of which the loop's noise is made
        "orchestrator/codec.py",
        "orchestrator/exact_time.py",
        "controller_fmu/pid_c/modelDescription.xml",  # has the gains of a reference
        "orchestrator/execution/controller_host.py",  # the three are named in command lines
        "orchestrator/execution/fork_server.py",
        "orchestrator/execution/sandboxed.py",
        "orchestrator/execution/worker.py",  # restores the rounding mode between two cases
        "orchestrator/fmi/host/host.c",
        "orchestrator/fmi/slaves/numba_pid.py",  # is loaded by its name
        "orchestrator/loop/closed_loop.py",
    ],
)
def test_a_changed_source_has_another_key_and_another_certificate(file, own, edited):
    before, certificate = keys(own), cache.code_hash()
    changed = edited / file
    changed.write_bytes(changed.read_bytes() + b"\n")
    forget()
    assert not before & keys(own)
    assert cache.code_hash() != certificate


def test_one_byte_of_any_source_changes_what_is_named_by_it(edited):
    for modules in (cache.COMPILED, cache.COMPUTING, cache.CERTIFYING):
        sources = cache.closure(*modules)
        before = cache.source_hash(sources)
        for file in sources:
            content = file.read_bytes()
            file.write_bytes(content + b"\n")
            assert cache.source_hash(sources) != before, file
            file.write_bytes(content)
        assert cache.source_hash(sources) == before


def test_what_is_not_computed_with_keeps_the_key(own, edited):
    before = keys(own)
    for file in ("orchestrator/cli/evaluate.py", "orchestrator/views/export.py", "orchestrator/version.py"):
        (edited / file).open("a").write("\n")
    forget()
    assert keys(own) == before


def test_protocols_share_the_cases_that_are_equal(own):
    """A case of "paper" is not run again because "quick" has it, too."""
    quick, paper = (
        dict(zip(stored_runs.keys(of, cases, own), cases, strict=True))
        for of, cases in ((QUICK, CASES), (PAPER, cases_of(PAPER, NOMINAL, 0)))
    )
    shared = quick.keys() & paper.keys()
    assert len(shared) >= 6
    for key in shared:
        one, other = quick[key], paper[key]
        assert (one.scenario, one.test.criteria) == (other.scenario, other.test.criteria)


def motion(t):
    """One that dies away too slowly to leave no doubt, after a jump at the force."""
    swing = 12e-6 * np.exp(-t / 60.0) * np.sin(2 * math.pi * 5.0 * t)
    return swing + np.where((t > 10.0) & (t < 12.0), 2e-4 * (12.0 - t), 0.0)


JUDGED = case(3, "slippery", "gain_1"), case(3, "compliant", "disturbance"), case(3, "compliant", "noise")
SHOWN = trajectory(error_x=motion, error_z=lambda t: 0.5 * motion(t), torque=(lambda t: 1e3 * motion(t), 0.1))


def changed(of, path: tuple[str, ...], by: float):
    """A struct with another value at ``path``: numbers ``by`` times as large, one word less, the other truth."""
    name, *inner = path
    value = getattr(of, name)
    if inner:
        return with_fields(of, **{name: changed(value, tuple(inner), by)})
    match value:
        case bool():
            value = not value
        case int() | float() | Fraction():
            value = type(value)(value * Fraction(by))
        case tuple() | str():
            value = value[1:]
        case dict():
            value = dict([*value.items()][1:])
    return with_fields(of, **{name: value})


def paths(of) -> list[tuple[str, ...]]:
    """Where a struct has values, those of the structs in it included."""
    found = []
    for field in type(of).__struct_fields__:
        value = getattr(of, field)
        found += [(field, *path) for path in paths(value)] if isinstance(value, Struct) else [(field,)]
    return found


def judgements(protocol, cases) -> list:
    """All that is made of one simulation of each case, except its names."""
    measures = [measure(protocol, case, SHOWN) for case in cases]
    return [
        (judge(protocol, case, SHOWN, measured), continuation_if_in_doubt(protocol, case, measured))
        for case, measured in zip(cases, measures, strict=True)
    ]


ANY = SimpleNamespace(
    plant=SimpleNamespace(sha256="0"),
    controller=SimpleNamespace(sha256="1", library="native", is_python=False),
    setup=Setup(),
    sandbox=False,
    separate=False,
)
"""What the keys have of a pairing."""


def assert_key_follows(protocol, cases):
    """Whatever changes what is made of a case changes its key."""
    before, after = stored_runs.keys(PAPER, JUDGED, ANY), stored_runs.keys(protocol, cases, ANY)
    for old, new, one, other in zip(before, after, judgements(PAPER, JUDGED), judgements(protocol, cases), strict=True):
        assert one == other or old != new
    return before != after


factors = st.sampled_from([0.25, 0.5, 0.9, 1.1, 2.0, 4.0])


@given(st.sampled_from(paths(PAPER)), factors)
def test_no_number_of_the_protocol_changes_a_judgement_behind_the_key(path, by):
    changes = assert_key_follows(changed(PAPER, path, by), JUDGED)
    assert changes or path[0] not in ("settling", "stability", "benchmark") or changed(PAPER, path, by) == PAPER


@given(st.sampled_from(paths(JUDGED[0].test)), factors)
def test_nothing_of_a_test_changes_a_judgement_behind_the_key(path, by):
    assert_key_follows(PAPER, [replace(one, test=changed(one.test, path, by)) for one in JUDGED])


def test_a_test_that_was_cut_is_not_continued_and_has_another_key():
    """Its scenario may be that of a shorter test, which is."""
    longer = replace(JUDGED[0], test=with_fields(JUDGED[0].test, duration=JUDGED[0].test.duration + 1))
    (_, further), (_, none) = judgements(PAPER, [JUDGED[0], longer])
    assert further is not None and none is None
    assert len(keys(ANY, PAPER, [JUDGED[0], longer])) == 2


def test_what_judges_sees_no_more_of_a_protocol_than_the_key_has():
    names = ("settling", "stability")
    seen = SimpleNamespace(**dict(zip(names, stored_runs._seen(PAPER, JudgingTables), strict=True)))
    assert judgements(seen, JUDGED) == judgements(PAPER, JUDGED)


positive = st.floats(0.0, 1e300)


def run_of(case, status=Status.DONE, figure=0.1, **changes) -> CaseRun:
    """A run of ``case`` that came to ``status``."""
    figures = {name: name == "settled" or figure for name in expected(QUICK, case)} if status is Status.DONE else {}
    fields = {"time": 2.0, "message": "", "warnings": 0, **changes}
    return CaseRun(
        case, case_result(case, Judgement(status=status, measurements=Measurements(**figures), **fields)), 1.25
    )


def load(opened, bench, failures=True) -> list[CaseRun]:
    """What is stored of the cases."""
    return list(stored_runs.load(opened, stored_runs.keys(QUICK, CASES, bench), QUICK, CASES, bench, failures).values())


def key_of(bench) -> dict[str, str]:
    """The keys by the names of the cases."""
    return dict(zip((case.id for case in CASES), stored_runs.keys(QUICK, CASES, bench), strict=True))


def put(opened, bench, *runs) -> None:
    """Store runs."""
    names = key_of(bench)
    for run in runs:
        stored_runs.keep(opened, names[run.case.id], run, bench)


@settings(max_examples=50)
@given(
    case=st.sampled_from(CASES),
    status=st.sampled_from([Status.DONE, *FAILURES]),
    figure=positive,
    time=st.floats(0.0, 2.0),
    message=st.text(),
    warnings=st.integers(0, 2**40),
)
def test_a_run_comes_back_to_the_last_bit(own, case, status, figure, time, message, warnings):
    run = run_of(case, status, figure, time=time, message=message, warnings=warnings)
    with store.opened(None) as results:
        put(results, own, run)
        assert load(results, own) == [run]


def test_a_second_record_takes_the_first_ones_place_and_what_is_not_final_is_not_kept(opened, own):
    put(opened, own, *map(run_of, CASES[:2]), run_of(CASES[0], warnings=3))
    put(opened, own, run_of(CASES[2], Status.LOST), run_of(CASES[3], Status.SKIPPED))
    assert load(opened, own) == [run_of(CASES[0], warnings=3), run_of(CASES[1])]
    opened.forget([key_of(own)[CASES[0].id]])
    assert load(opened, own) == [run_of(CASES[1])]


@pytest.mark.parametrize("status", FAILURES)
def test_a_failure_counts_under_the_conditions_it_happened_in(status, opened, own):
    """A case that took too long for a time limit is not done with for a longer one."""
    runs = [run_of(CASES[0], status), run_of(CASES[1], Status.UNSTABLE)]
    put(opened, own, *runs)
    assert load(opened, own) == runs
    others = (replace(own, timeout=100.0), replace(own, limits=Limits(memory=1)))
    for found in (*(load(opened, other) for other in others), load(opened, own, failures=False)):
        assert found == runs[1:]
    assert load(opened, replace(own, sandbox=True)) == []


def test_records_that_make_no_sense_are_none(opened, own, tmp_path):
    put(opened, own, run_of(CASES[0]))
    put(opened, own, replace(run_of(CASES[1]), result=case_result(CASES[1], Judgement(status=Status.DONE, time=2.0))))
    put(opened, own, run_of(CASES[2], time=1e6))  # its case cannot have it, nor that without a figure
    names = list(key_of(own).values())[3:]
    for record in (b"", b"{}", b"[1]", b"null", b"\xff", b'{"judgement": {"status": "fine"}}'):
        opened.put(names.pop(), "", record)
    with closing(sqlite3.connect(tmp_path / store.FILE)) as other, other:
        other.executemany("INSERT INTO records VALUES (?, '', ?)", zip(names, ("text", 1, b"", b"123"), strict=False))
    assert load(opened, own) == [run_of(CASES[0])]


def test_a_record_with_one_bit_that_is_another_is_none(opened, tmp_path):
    """B3 of 1.6 in the place of 5.6 gave another V, without a word."""
    record = b'{"judgement": {"measurements": {"B3": 5.6}}}'
    opened.put("key", "", record)
    opened.put("other", "", record)
    (stored,) = opened._connection.execute("SELECT record FROM records WHERE key = 'key'").fetchone()
    for bit in range(8 * len(stored)):
        flipped = (int.from_bytes(stored, "big") ^ 1 << bit).to_bytes(len(stored), "big")
        opened._connection.execute("UPDATE records SET record = ? WHERE key = 'key'", (flipped,))
        assert opened.get(["key"]) == {}, bit
    opened._connection.execute("UPDATE records SET key = 'othes' WHERE key = 'other'")
    # As an earlier version has stored it: simulated again.
    opened._connection.execute("UPDATE records SET record = ? WHERE key = 'key'", (record,))
    assert opened.get(["key", "other", "othes"]) == {}
    opened.put("key", "", record)
    assert opened.get(["key"]) == {"key": record}


def test_a_folder_is_for_one_evaluation_at_a_time(tmp_path):
    script = WRITER.replace("100000", "1")
    with store.opened(tmp_path):
        with pytest.raises(InputError) as told, store.opened(tmp_path):
            pass
        assert told.value.what == "folder-in-use"
        other = subprocess.run([sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True)
        assert "InputError" in other.stderr
    with store.opened(tmp_path):
        pass


@pytest.mark.parametrize("contents", [b"no database, but long enough to be one" * 100, b"SQLite format 3\0junk"])
def test_a_damaged_file_is_an_environment_fault(contents, tmp_path):
    (tmp_path / store.FILE).write_bytes(contents)
    with pytest.raises(EnvironmentFault) as told, store.opened(tmp_path) as results:
        results.get(["key"])
    assert told.value.what == store.DAMAGED


def test_a_full_disk_keeps_what_is_committed(tmp_path):
    with store.opened(tmp_path) as results:
        results.put("one", "", b"1")
        results._connection.execute("PRAGMA max_page_count = 8")
        with pytest.raises(EnvironmentFault):
            results.put("two", "", b"x" * 100_000)
    with store.opened(tmp_path) as results:
        assert results.get(["one", "two"]) == {"one": b"1"}


WRITER = """
import sys
from pathlib import Path
from orchestrator.execution import store
with store.opened(Path(sys.argv[1])) as results:
    for number in range(100000):
        results.put(f"key {number}", "", b"x")
        print(number, flush=True)
"""


def test_what_was_reported_as_stored_survives_kill_9(tmp_path):
    with subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True) as writer:
        for _ in range(100):
            writer.stdout.readline()
        writer.kill()
        rest = writer.stdout.read().splitlines(keepends=True)
    last = max((int(line) for line in rest if line[-1] == "\n"), default=99)
    with store.opened(Path(tmp_path)) as results:
        names = [f"key {number}" for number in range(last + 1)]
        assert results.get(names).keys() == set(names)
        asked = ("integrity_check", "synchronous", "journal_mode")
        found = [results._connection.execute(f"PRAGMA {name}").fetchone()[0] for name in asked]
        assert found == ["ok", 2, "wal"], "every row is committed to the disk"


def test_every_process_of_a_name_is_among_the_sources():
    """The closure follows import statements; a command line is none."""
    launched = (cache.PACKAGE / "execution" / "launch.py").read_text()
    assert {f"orchestrator.execution.{name}" for name in re.findall(r'boot\("(\w+)"', launched)} == {*cache.STARTED}
