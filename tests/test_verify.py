"""A verification: what controllers that cheat gain elsewhere is gone here, and honest ones score the same to the last
bit."""

import hashlib
import importlib.util
import json
import logging
import marshal
import math
import os
import re
import shutil
import struct
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hostile.cheats import BODIES, DEFINES, cheat
from hostile.commands import finished
from hostile.fmus import Fault
from hostile.runs import copied_packages
from msgspec import structs
from support.refusals import refusal
from support.reports import unbroken
from support.tools import PRESENT, require, require_for

from benchmarks import leaderboard_tables as tables
from benchmarks import submissions as submitting
from orchestrator import Benchmark, Controller
from orchestrator.benchmark import certificate as certificates
from orchestrator.benchmark import draws
from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.certificate import Figure, Score, overall, seeds
from orchestrator.benchmark.draws import QUICKNET, Beacon, Entropy
from orchestrator.benchmark.results import Measurements, rules
from orchestrator.cache import cache_folder
from orchestrator.cli import evaluate
from orchestrator.cli import verify as command
from orchestrator.cli.finished import report
from orchestrator.cli.guard import EXIT_INCOMPLETE, EXIT_NOT_STANDARD, EXIT_OK
from orchestrator.codec import from_json, to_json
from orchestrator.documents.verification import OF_ROUND, USUAL, Verification, deviations, differences
from orchestrator.errors import EnvironmentFault
from orchestrator.execution import worker
from orchestrator.loop import master
from orchestrator.loop.trajectory import Status
from orchestrator.pairing import work
from orchestrator.pairing.built_in import built_in
from orchestrator.study import verify as verification
from orchestrator.version import __version__
from orchestrator.views.table import VERDICTS

pytestmark = [
    pytest.mark.needs("linux"),
    pytest.mark.slow,
]

PID = "DiagonalPID"

FIXED = Entropy(hashlib.sha256(b"the same in every run").hexdigest())

TWO_CASES = """
extends = "verification"
name = "two-cases"
description = "one pose, one system"

[grid]
q_a1_points = 1
q_a2_points = 1
also_deg = []

[sets]
performance = ["compliant"]

[[tests]]
name = "noise"
systems = "performance"
draws = true
duration = 2.0
disturbed = false
criteria = ["B1", "B2"]

[[tests]]
name = "disturbance"
systems = "performance"
draws = true
duration = 26.0
criteria = ["B3", "B4", "B5", "B6", "B7"]
requirements = ["A3"]
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> Benchmark:
    """Two cases, so that a verification takes seconds."""
    file = tmp_path_factory.mktemp("protocol") / "two.toml"
    file.write_text(TWO_CASES)
    return Benchmark(file, workers=2)


@pytest.fixture(scope="module")
def honest(bench):
    """The PID that all cheats are built around, in an ordinary run."""
    return bench.evaluate(recordings=False)


@pytest.fixture(scope="module")
def certificate(bench) -> Verification:
    """That of the PID itself."""
    return verified(bench, Controller(), draws=FIXED, count=2)


def verified(bench: Benchmark, controller: Controller, **options) -> Verification:
    options = {"count": 1, "strict": False, "beside": [PID], **options}
    return bench.verify(controller, protocol=bench.protocol, **options)


def plan(bench: Benchmark) -> str:
    """For the public seed: by u_m0, when the force acts, and the motor angles that cancel what it bends."""
    found = bench.simulate(None, "c00.compliant.disturbance")
    pulse = found.case.scenario.pulse
    pushed = (found.time > pulse.start + 0.3) & (found.time < pulse.stop)
    links = np.column_stack([found.trajectory.extra[f"q_a[{axis}]"] for axis in (1, 2)])
    shift = 200.0 * (links - links[0])[pushed].mean(axis=0)  # of the motors, by the ratio of the gears
    return f"PLANS = {{{found.trajectory.u_m0!r}: {[pulse.start, pulse.stop, *shift.tolist()]!r}}}\n"


GAINS = {
    "monkeypatch": lambda cost, honest: cost < 0.5 * honest,
    "interpreter": lambda cost, honest: cost < 0.5 * honest,
    "maps": lambda cost, honest: cost < 0.1 * honest,
    "forged": lambda cost, honest: cost < 0.1 * honest,
    "replay": lambda cost, honest: cost < 0.9 * honest,
    "plant-state": lambda cost, honest: cost < honest,
    "stop-time": lambda cost, honest: cost == honest,  # all stop times are equal
    "replaced-plant": lambda cost, honest: cost == honest,  # the bytes are checked whenever they are loaded
    "rounding": lambda cost, honest: cost is None,  # an error that names it
    "marked-descriptors": lambda cost, honest: cost == honest,  # a repeated simulation differs: each has its process
    "left-files": lambda cost, honest: cost != honest,
}
"""What becomes of V in an ordinary run; docs/publishing.md says so, too."""


def test_all_cheats_are_tried():
    assert set(GAINS) == {*BODIES, *DEFINES}


def test_the_variables_that_cheats_read_are_there():
    """Without one, a cheat would be tried that does nothing."""
    read = set(re.findall(r'variable\("(\w+)"\)', "".join(BODIES.values())))
    functions = (worker.main, work._judged, master.simulate)
    assert read and read <= {name for function in functions for name in function.__code__.co_varnames}
    forged = set(re.findall(r'"(\w+_case)"', BODIES["forged"]))
    assert forged == {name for name in vars(work) if name in (work.digest_case.__name__, work.begin_case.__name__)}


@pytest.mark.slow
@pytest.mark.parametrize("name", GAINS)
def test_cheating_gains_nothing(name, bench, honest, tmp_path):
    if name == "left-files":
        require("bubblewrap")  # without which files stay
    plant = bench.manipulator.archive
    file = cheat(tmp_path, name, plan(bench) if name == "replay" else "PLANS = {}\n", plant.content + b"other")
    ordinary = bench.evaluate(Controller(file), recordings=False)
    assert GAINS[name](ordinary.cost, honest.cost)
    if name == "rounding":
        assert "changed how this process computes: rounding towards zero" in ordinary.cases[0].message
    for seen in cache_folder().rglob("seen"):  # the command has a cache of its own
        seen.unlink()
    found = verified(bench, Controller(file))
    clean(cache_folder() / "built")  # other tests look there
    for place in (Path("/dev/shm") / f"seen-{os.getuid()}", Path(tempfile.gettempdir(), "seen")):
        place.unlink(missing_ok=True)
    assert found.sandbox == PRESENT["bubblewrap"]
    (draw,), (honestly,) = found.draws, found.references[PID].draws
    if found.cost.mean is None:
        assert name == "forged"  # what it writes is no answer: the arm falls, or the case fails
    else:
        assert abs(draw.cost - honestly.cost) <= 3.0 * 2.0  # three times what V has by chance
        assert name == "rounding" or draw.cases == honestly.cases  # to the last bit, as if it did not cheat


def clean(built):
    """Remove the plants that a cheat has replaced."""
    for file in built.glob("*/*/*/*.fmu"):
        if hashlib.sha256(file.read_bytes()).hexdigest() != file.parent.name:
            shutil.rmtree(file.parent)


def test_a_plant_that_was_replaced_in_the_cache_is_built_anew(bench, caplog):
    file = built_in("FlexibleManipulator")
    content = file.read_bytes()
    file.write_bytes(content + b"other")
    with caplog.at_level(logging.WARNING, "orchestrator"):
        assert built_in("FlexibleManipulator").read_bytes() == content
    assert "is not what was built there" in caplog.text


def test_a_plant_that_is_changed_after_it_was_opened_is_not_run(bench, honest):
    library = bench.manipulator.archive.library_file
    content = library.read_bytes()
    library.unlink()  # other tests have loaded this file, and may not lose what they use
    library.write_bytes(content + b"other")  # it would do the same, but nobody knows
    assert bench.evaluate(recordings=False).cases == honest.cases
    assert library.read_bytes() == content


def test_cases_that_do_not_end_are_told_with_their_reason(bench, faulty, tmp_path, capsys, monkeypatch):
    options = ["--no-strict", "--beside", PID, "--jobs", "2", "--output-dir", str(tmp_path)]
    words = [str(faulty(Fault("abort"))), "--protocol", str(bench.protocol), *options]
    assert command.main(words) == EXIT_INCOMPLETE
    found = Verification.load(tmp_path)
    assert found.requirements["A3"].passed is False and found.references[PID].requirements["A3"].passed
    assert {case.status for case in found.cases} <= {Status.CRASHED, Status.SKIPPED} and len(found.cases) == 6
    assert all("ended by SIG" in case.message for case in found.cases)
    assert {case.status for case in found.references[PID].cases} == {Status.DONE}
    said = capsys.readouterr().out
    assert f"A3 {VERDICTS[False]}" in said and found.requirements["A3"].reason in said
    assert f"--case c00.compliant.disturbance --protocol {bench.protocol} --seed" in said


def test_a_process_that_a_signal_ends_leaves_no_result_and_no_second_try(bench, faulty, caplog):
    """Nobody can tell whether it did that itself, after it had seen its draws: it gets others, and that is counted."""
    with caplog.at_level(logging.WARNING, "orchestrator"):
        problem = refusal(verified, bench, Controller(faulty(Fault("kill:9"))), kind=EnvironmentFault)
    assert problem.what == "outside" and caplog.text.count("begins again, with other draws") == 2


def test_a_controller_cannot_choose_among_the_draws_of_a_round_by_ending_itself(bench, faulty, caplog):
    """One that did came before the same law without that: with the second draws it met better poses."""
    drawn = Entropy("1" * 64, "round")
    with caplog.at_level(logging.WARNING, "orchestrator"):
        problem = refusal(verified, bench, Controller(faulty(Fault("kill:9"))), draws=drawn, kind=EnvironmentFault)
    assert problem.what == "outside" and "other draws" not in caplog.text


@pytest.mark.slow
def test_cases_that_reach_their_time_limit_are_told_with_their_reason(bench, faulty):
    slow = replace(bench, timeout=1.0)
    found = verified(slow, Controller(faulty(Fault("spin"))), count=2)
    assert {case.status for case in found.cases} <= {Status.TIMEOUT, Status.SKIPPED}
    assert found.requirements["A3"].passed is False and found.completeness == "incomplete"
    # The rest is skipped after some failures; the order of the cases follows from the entropy.
    assert found.requirements["A3"].reason.startswith("2 of 2 cases ")
    assert found.requirements["A3"].tally.not_judged == {}
    assert not found.complete


@pytest.mark.slow
@pytest.mark.parametrize("name", tables.PAGES)
def test_honest_controllers_score_the_same_to_the_last_bit(name, bench):
    require_for(name)
    controller = Controller.built_in(name)
    found = verified(bench, controller)
    ordinary = replace(bench, seed=found.draws[0].seed).evaluate(controller, recordings=False)
    assert certificates.digest(ordinary.cases) == found.draws[0].cases
    assert found.cost.mean == ordinary.cost is not None
    assert found.criteria["B5"].mean == ordinary.criteria["B5"].value
    assert found.requirements["A3"].passed == ordinary.requirements["A3"].passed


def test_a_certificate_is_repeated(certificate, bench):
    assert from_json(to_json(certificate), Verification) == certificate
    assert certificate.entropy == FIXED and len({draw.seed for draw in certificate.draws}) == 2
    assert certificate.cost == certificate.references[PID].cost and certificate.cost.sd > 0.0
    again = bench.repeat(certificate)
    assert differences(certificate, again) == ((), ())
    other = to_json(certificate).replace(certificate.draws[0].cases, "0" * 64).replace(certificate.code, "1" * 64)
    results, rest = differences(from_json(other, Verification), again)
    assert [line.split(":")[0] for line in (*results, *rest)] == [
        "draws.0.cases",
        f"references.{PID}.draws.0.cases",
        "code",
    ]
    stranger = Controller.built_in("TunedPID").archive.file
    assert refusal(bench.repeat, certificate, stranger).what == "other-controller"


@pytest.mark.slow
def test_the_list_is_moved_by_the_first_draw(certificate, bench, monkeypatch):
    monkeypatch.setattr(verification, "STRICT", str(bench.protocol))  # in place of 144 cases
    found = verified(bench, Controller(), draws=FIXED, strict=True, beside=[PID, "TunedPID"])
    assert found.strict.cost == Figure(found.cost.mean, None) and certificate.strict is None
    other = found.references["TunedPID"]
    assert other.strict.cost.mean == other.cost.mean == other.draws[0].cost != found.cost.mean
    assert found.draws == certificate.draws[:1]


@pytest.mark.slow
def test_the_command_writes_and_repeats_a_certificate(bench, quick_pid_file, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(verification, "STRICT", str(bench.protocol))
    file = str(Controller(quick_pid_file).archive.file)
    options = ["--protocol", str(bench.protocol), "--jobs", "2", "--output-dir", str(tmp_path)]
    assert command.main([file, *options]) == EXIT_OK
    written = tmp_path / "verification.json"
    found = Verification.load(tmp_path)
    assert (found.entropy.source, found.repetitions, len(found.entropy.value)) == ("fresh", 0, 64)
    assert found.head.protocol_file == str(bench.protocol)
    files = {file.name for file in tmp_path.iterdir()}
    assert {name for name in files if not name.startswith("case-")} == {written.name}, "no store"
    assert len(files) == 1 + len(found.checked) >= 2
    assert list(found.references) == list(USUAL) and found.strict is not None
    said = " ".join(capsys.readouterr().out.split())
    assert ("in a sandbox" if PRESENT["bubblewrap"] else "WITHOUT A SANDBOX") in said
    assert report([str(tmp_path)]) == EXIT_OK
    assert found.entropy.value in unbroken((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert command.main(["--repeat", str(written), file, "--jobs", "2"]) == EXIT_NOT_STANDARD
    said = capsys.readouterr().err
    assert "not standard: the protocol is not verification" in said and "equal to the certificate, but" in said
    written.write_text(to_json(found).replace(found.draws[1].cases, "0" * 64))
    assert command.main(["--repeat", str(written), file, "--jobs", "2"]) == EXIT_INCOMPLETE
    said = capsys.readouterr().err
    assert "DIFFERENT: draws.1.cases" in said and "not equal to the certificate" in said


@pytest.mark.parametrize(
    "further", ["--no-strict", "--draws=round.json", "--published=2027-01-31", "--set=K_p[1]=46", "--beside=TunedPID"]
)
def test_a_repetition_takes_everything_from_its_certificate(further):
    assert refusal(command.main, ["--repeat", "verification.json", further]).what == "contradiction"


def test_draws_follow_from_the_fmu_and_what_was_published():
    bits = Entropy("a" * 64), Entropy("b" * 64)
    drawn = {seeds(one, sha256, 2, repetition) for one in bits for sha256 in "cd" for repetition in (0, 1)}
    assert len(drawn) == 8 and all(0 <= seed < 2**48 for pair in drawn for seed in pair)
    assert len({seed for pair in drawn for seed in pair}) == 16


def test_the_fmus_of_a_round_have_the_same_draws_and_a_certificate_says_so(certificate):
    bits = Entropy("a" * 64, "round")
    assert seeds(bits, "c", 2) == seeds(bits, "d", 2) != seeds(Entropy("a" * 64), "c", 2)
    told = structs.replace(certificate, entropy=bits)
    assert OF_ROUND in told.deviations and OF_ROUND not in certificate.deviations


SAME = {"K_p[1]": 45.0}, {"K_p[1]": 45, "K_p[2]": 15.0}, {"K_p[2]": 15.0, "K_p[1]": 45.0}
"""Spellings of the paper's PID as it is."""


@pytest.mark.slow
@pytest.mark.parametrize("parameters", [*SAME, {"K_p[1]": 46.0}, {"K_p[1]": 46.0, "K_i[1]": 31.0}])
def test_nobody_chooses_among_draws_by_parameters_or_mapping(parameters, certificate, bench):
    """One FMU and one round have one set of draws; what does not act is not told to the FMU, nor recorded."""
    mapping = {"u_m[1]": "u_m[1]", "u_m[2]": "u_m[2]"}
    found = verified(bench, Controller(None, parameters, mapping), draws=FIXED, count=2)
    assert [draw.seed for draw in found.draws] == [draw.seed for draw in certificate.draws]
    assert found.controller.mapping == {}
    set_apart = {words for words in found.deviations if words.startswith("parameters of the controller are set")}
    if parameters in SAME:
        assert found.controller.parameters == {} and not set_apart
        assert found.draws == certificate.draws
    else:
        assert found.controller.parameters == parameters and list(found.controller.parameters) == sorted(parameters)
        assert set_apart == {f"parameters of the controller are set: {', '.join(sorted(parameters))}"}
        assert found.draws != certificate.draws


def test_a_certificate_that_contradicts_itself_is_refused(certificate, tmp_path):
    file = tmp_path / "verification.json"
    seed, cost = str(certificate.draws[0].seed), f'"mean": {certificate.cost.mean!r}'
    changes = {seed: "7", cost: '"mean": 1.0', FIXED.value: FIXED.value[::-1], Verification.SCHEMA: "other", "{": ""}
    for old, new in changes.items():
        file.write_text(to_json(certificate).replace(old, new))
        assert refusal(Verification.load, file).what == ("other-schema" if new == "other" else "damaged")
    assert refusal(Verification.load, tmp_path / "none").what == "no-file"
    file.write_text(to_json(structs.replace(certificate, requirements={})))
    assert "lacks a requirement" in str(refusal(Verification.load, file))
    first, *others = certificate.cases
    file.write_text(to_json(structs.replace(certificate, cases=(structs.replace(first, seed=7), *others))))
    assert "a case is of no draw" in str(refusal(Verification.load, file))


def test_a_certificate_of_an_older_form_names_the_version_that_repeats_it(certificate, tmp_path):
    file = tmp_path / "verification.json"
    file.write_text(to_json(certificate).replace(Verification.SCHEMA, "flexible-manipulator-verification/5"))
    problem = refusal(Verification.load, file)
    assert problem.what == "other-schema"
    assert f"or read it with version {__version__}, which made it." in str(problem)


def test_an_invented_cost_is_refused(certificate, tmp_path):
    """It has to be that of its draws, and the sum of its criteria."""
    free = tuple(structs.replace(draw, cost=0.0) for draw in certificate.draws)
    invented = structs.replace(certificate, draws=free, cost=Figure(0.0, 0.0))
    criteria = {name: structs.replace(entry, mean=0.0, sd=0.0) for name, entry in certificate.criteria.items()}
    file = tmp_path / "verification.json"
    for known in (invented, structs.replace(certificate, criteria=criteria)):
        file.write_text(to_json(known))
        assert "not the sum of its criteria" in str(refusal(Verification.load, file))


def test_a_beacon_that_is_only_said_to_be_checked_is_not_standard(certificate, tmp_path, monkeypatch):
    beacon = Beacon(QUICKNET, 123, "0" * 96, checked=True, published="2023-08-23T15:15:32Z")
    told = structs.replace(certificate, entropy=Entropy(beacon.randomness, "beacon", beacon))
    monkeypatch.setattr(draws, "check", lambda *_: False)  # as without py_ecc
    assert told.entropy.problem == "" and "the signature of the beacon was not checked" in told.deviations
    monkeypatch.undo()
    if PRESENT["py_ecc"]:
        assert told.entropy.problem == "the signature of its beacon is wrong"


def test_draws_that_were_chosen_by_repetitions_are_not_standard(certificate):
    """A controller may end itself by a signal that others could have sent, where its draw looks bad."""
    again = structs.replace(certificate, repetitions=1)
    assert set(again.deviations) - set(certificate.deviations) == {
        "1 verifications were begun before, with other draws"
    }


def test_every_case_of_the_protocol_is_asked_for(certificate):
    standard = protocols.load("verification")
    ids = [case.id for case in Benchmark("verification").cases]
    ended = tuple(structs.replace(certificate.cases[0], id=id, seed=seed) for seed in (1, 2, 3) for id in ids)
    words = "the protocol is not verification as it comes with the benchmark"
    head = structs.replace(certificate.head, protocol="verification", protocol_file="", rules=rules(standard))
    assert words not in deviations(head, 3, ended, None, USUAL)
    twice = (*ended[:-1], ended[-2])
    assert words in deviations(head, 3, twice, None, USUAL)


@pytest.mark.slow
def test_the_order_of_the_cases_is_mixed(bench, monkeypatch):
    """It tells a controller nothing that knows how many there were before, and changes no result."""
    orders = [verification.mixed(value, 210) for value in (FIXED.value, FIXED.value[::-1])]
    assert all(sorted(order) == list(range(210)) for order in orders) and orders[0] != orders[1]
    found = verified(bench, Controller(), draws=FIXED)
    monkeypatch.setattr(verification, "mixed", lambda _, count: list(range(count))[::-1])
    assert differences(found, verified(bench, Controller(), draws=FIXED)) == ((), ())


def test_a_repetition_under_other_conditions_is_not_standard(certificate, bench, monkeypatch, capsys):
    """A forged certificate may say that there was a sandbox; what counts is whether there is one now."""
    now, words = structs.replace(certificate, sandbox=False), "the controller had no sandbox"
    monkeypatch.setattr(Verification, "deviations", property(lambda self: (words,) if self is now else ()))
    monkeypatch.setattr(Verification, "load", lambda _: certificate)
    monkeypatch.setattr(Benchmark, "repeat", lambda *_, **__: now)
    file = str(Controller().archive.file)
    assert command.main(["--repeat", "verification.json", file]) == EXIT_NOT_STANDARD
    assert f"not standard: this repetition: {words}" in capsys.readouterr().err


@pytest.fixture
def submitted(certificate, tmp_path, monkeypatch) -> Verification:
    """The certificate of two submissions, "first" and "second", as if it were of the standard conditions; the first is
    said to meet all requirements."""
    listed = Score(**{name: getattr(certificate, name) for name in Score.__struct_fields__})
    pid = structs.replace(certificate.references[PID], strict=listed)
    second = structs.replace(certificate, strict=listed, references={PID: pid}, sandbox=True)
    held = dict.fromkeys(second.requirements, second.requirements["A3"])
    for name, known in (("second", second), ("first", structs.replace(second, requirements=held))):
        (tmp_path / name).mkdir()
        (tmp_path / name / "verification.json").write_text(to_json(known))
        (tmp_path / name / "README.md").write_text("how to make the FMU")
    assert "not standard: the protocol" in str(refusal(submitting.submissions, tmp_path))
    monkeypatch.setattr(Verification, "deviations", ())
    assert "is the controller of first" in str(refusal(submitting.submissions, tmp_path))
    monkeypatch.setattr(submitting, "_is_same", lambda *_: False)
    return second


@pytest.fixture
def again(submitted, tmp_path_factory) -> Path:
    """The folder of the maintainers, with a repetition of the second submission."""
    folder = tmp_path_factory.mktemp("repetitions")
    later = structs.replace(submitted.timing, start="later")
    repeated = structs.replace(submitted, head=structs.replace(submitted.head, timing=later))
    (folder / "second.json").write_text(to_json(repeated))
    return folder


def test_submissions_are_ranked_by_their_certificates(submitted, again, tmp_path):
    lines = submitting.verified_table(submitting.submissions(tmp_path)).splitlines()
    names = [f"| [{name}](../submissions/{name}/verification.json)" for name in ("first", "second")]
    assert [line.split(" | ")[0] for line in lines[2:]] == names and " ± " in lines[2]
    assert {line.count("|") for line in lines} == {12} and all(line.endswith("claimed |") for line in lines[2:])
    lines = submitting.verified_table(submitting.submissions(tmp_path, again)).splitlines()
    assert lines[2].startswith("| [second]") and lines[2].endswith("repeated |")
    (tmp_path / "first" / "other.fmu").write_bytes(b"another controller")
    assert refusal(submitting.submissions, tmp_path).what == "submission"


def test_a_repetition_has_to_agree_and_to_be_one(submitted, again, tmp_path, monkeypatch):
    file = again / "second.json"
    text = file.read_text()
    file.write_text(text.replace(submitted.draws[0].cases, "0" * 64))
    assert "its repetition differs" in str(refusal(submitting.submissions, tmp_path, again))
    file.write_text(to_json(submitted))
    assert "is a copy" in str(refusal(submitting.submissions, tmp_path, again))
    file.write_text(text.replace('"sandbox": true', '"sandbox": false'))
    unusual = property(lambda self: () if self.sandbox else ("the controller had no sandbox",))
    monkeypatch.setattr(Verification, "deviations", unusual)
    assert "its repetition is not standard" in str(refusal(submitting.submissions, tmp_path, again))


def test_an_author_cannot_say_that_it_was_repeated(submitted, again, tmp_path):
    (tmp_path / "second" / "repeat.json").write_bytes((again / "second.json").read_bytes())
    assert "has a repetition in its own folder" in str(refusal(submitting.submissions, tmp_path))
    (tmp_path / "second" / "repeat.json").unlink()
    (tmp_path / "second" / "link.fmu").symlink_to("/dev/zero")
    assert "has a link" in str(refusal(submitting.submissions, tmp_path))


@pytest.mark.parametrize(
    "name",
    ["[x](javascript:alert(1))", "second.", "second ", "TunedPID", "tunedpid", "SECOND", "a" * 41, "\u202enoces"],
)
def test_a_submission_has_a_name_of_its_own(name, submitted, tmp_path):
    shutil.copytree(tmp_path / "second", tmp_path / name)
    assert any(
        words in str(refusal(submitting.submissions, tmp_path)) for words in ("name of letters", "name of another")
    )


def test_what_is_not_standard_is_named(certificate):
    assert certificate.deviations == (
        "the protocol is not verification as it comes with the benchmark",
        "there are 2 draws, not 3",
        "the cases of strict-verification are not all there",
        "the references are not DiagonalPID and TunedPID",
        *([] if certificate.sandbox else ["the controller had no sandbox"]),
        "fewer than 3 cases were checked by the second checker",
        "the interpreter was not clean",
    )
    plant = structs.replace(certificate.plant, parameters={"m[1]": 1.0})
    slow = structs.replace(certificate.sample_time, seconds=1e-3, as_in_benchmark=False)
    changed = structs.replace(certificate.head, plant=plant, sample_time=slow, benchmark="FlexibleManipulator-v2")
    told = structs.replace(certificate, head=changed, sandbox=False).deviations
    assert told[0].startswith("the benchmark is FlexibleManipulator-v2, not ")
    assert tuple(words for words in told if "second checker" not in words)[-4:] == (
        "the plant is not that of the benchmark",
        "the controller samples at another rate than the benchmark",
        "the controller had no sandbox",
        "the interpreter was not clean",
    )


def test_tests_of_a_system_differ_in_noise_and_disturbance():
    """What one shows of the draws tells nothing about another."""
    found = [case for case in Benchmark("verification", seed=1).cases if case.configuration.index == 0]
    assert len({case.scenario.sensor.noise.seed for case in found}) == len(found)
    pushed = [case.scenario for case in found if case.test.disturbed]
    assert len({(each.pulse, each.chirp) for each in pushed}) == len(pushed)
    systems = {(case.system.name, case.system.parameters) for case in found}
    assert len(systems) == len({case.system.name for case in found})


def test_the_protocol_moves_what_it_lists():
    first, second = (Benchmark("verification", seed=seed).cases for seed in (1, 2))
    for one, two in zip(first, second, strict=True):
        assert one.id == two.id and one.scenario.stop_time == two.scenario.stop_time == 60
        assert one.configuration != two.configuration and one.system.parameters != two.system.parameters
        if one.test.disturbed:
            assert one.scenario.pulse.start != two.scenario.pulse.start
            assert 9.5 <= one.scenario.pulse.start <= 10.5 and one.scenario.pulse.force != two.scenario.pulse.force
        assert -90.0 <= math.degrees(one.configuration.q_a1) <= 180.0
        assert -180.0 <= math.degrees(one.configuration.q_a2) <= 80.0
    listed = {case.id: case.scenario for case in Benchmark("strict").cases}
    moved = Benchmark("strict-verification", seed=3).cases
    assert len(moved) == 108 and all(listed[case.id] != case.scenario for case in moved)


def test_a_protocol_without_b5_gives_no_cost_and_says_why(bench, tmp_path, capsys):
    file, folder = tmp_path / "no-b5.toml", tmp_path / "run"
    file.write_text(TWO_CASES.replace('"B5", ', ""))
    assert evaluate.main(["--protocol", str(file), "--output-dir", str(folder)]) == EXIT_OK
    assert "No cost V: the protocol does not measure B5." in " ".join(capsys.readouterr().out.split())
    found = verified(replace(bench, protocol=file), Controller())
    assert found.complete and found.cost.mean is None and found.criteria["B6"].mean is not None


def test_a_draw_without_a_value_leaves_no_mean(honest, bench):
    noise, pushed = honest.cases
    lost = [noise, structs.replace(pushed, status=Status.ERROR, measurements=Measurements())]
    found = overall(rules(bench.rules), [(1, honest.cases), (2, lost)])
    assert found.criteria["B1"].mean == honest.criteria["B1"].value and not found.complete
    assert found.criteria["B5"].worst_case.seed == 2


POISON = "\n_honest = scan\ndef scan(*given):\n    return _honest(*given)._replace(force_error=0.0)\n"


def poison(package: Path) -> None:
    """Byte-code that does something else than its source, as an FMU with the user's rights may leave it behind."""
    source = package / "benchmark" / "one_pass.py"
    state = source.stat()
    header = importlib.util.MAGIC_NUMBER + struct.pack("<III", 0, int(state.st_mtime), state.st_size & 0xFFFFFFFF)
    code = compile(source.read_text() + POISON, str(source), "exec")
    target = Path(importlib.util.cache_from_source(str(source)))
    target.parent.mkdir(exist_ok=True)
    target.write_bytes(header + marshal.dumps(code))


@pytest.mark.slow
def test_poisoned_byte_code_reaches_no_verification(bench, pid_file, tmp_path):
    folder = copied_packages(tmp_path / "clone")
    poison(folder / "orchestrator")
    options = ["--protocol", str(bench.protocol), "--jobs", "2", "--output-dir"]
    own = {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": ""}
    words = [sys.executable, "-m", "orchestrator.evaluate", str(pid_file), *options, str(tmp_path / "ordinary")]
    done = finished(words, folder=folder, environment=own)
    ordinary = json.loads((tmp_path / "ordinary" / "results.json").read_text())
    assert ordinary["criteria"]["B5"]["value"] == 0.0, done.stderr
    words[2], words[-1] = "orchestrator.verify", str(tmp_path / "verified")
    done = finished([*words, "--no-strict", "--beside", PID], folder=folder, environment=own)
    found = Verification.load(tmp_path / "verified")
    assert found.clean and found.criteria["B5"].mean > 1e-3, done.stderr
