"""State in static memory: every score is that of the same law with its state in the instance, or is called random."""

import logging
from contextlib import suppress

import pytest
from exporters.description_edits import edited
from support.python_controllers import python_controller
from support.refusals import refusal
from support.static_states import static_state_fmu

from orchestrator import Benchmark, Controller
from orchestrator.benchmark.results import Judgement
from orchestrator.benchmark.variation import Variation
from orchestrator.cli.guard import remedy
from orchestrator.codec import unpack
from orchestrator.execution import store
from orchestrator.execution.job import Done
from orchestrator.execution.supervision import run_isolated
from orchestrator.loop.behaviour import CarryOver, carry_over
from orchestrator.loop.trajectory import Status
from orchestrator.pairing.pairing import beginning_job
from orchestrator.pairing.work import BEGINNING, CaseTask, Digested, ScenarioTask, TimingRecord
from orchestrator.study import batch, stored
from orchestrator.study.engine import REPEAT_EVERY, Processes
from orchestrator.study.requests import Batch, BatchEntry

pytestmark = pytest.mark.needs("linux", "compiler")

ONLY = ("c0[01].compliant.*", "c00.slippery.gain_1")
DECLARED = {"canBeInstantiatedOnlyOncePerProcess": "true"}


def declare_once(root):
    for interface in root.iterfind("CoSimulation"):
        interface.attrib.update(DECLARED)


PASSING = ("SINCE_LOADING", "SINCE_INSTANTIATION")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Evaluations by where the state is kept, each made once; with what was logged."""
    folder, known = tmp_path_factory.mktemp("static"), {}

    def evaluate(kept, **abilities):
        key = kept, *abilities
        if key not in known:
            file = static_state_fmu(folder, kept, **abilities)
            known[key] = file, Benchmark("quick", workers=2).evaluate(Controller(file), only=ONLY, recordings=False)
        return known[key]

    return evaluate


def figures(evaluation):
    return [(case.id, case.status, case.measurements) for case in evaluation.results.cases]


@pytest.mark.parametrize(
    ("kept", "abilities", "found"),
    [
        *((kept, {}, CarryOver.FOUND) for kept in (*PASSING, "AFTER_A_FORCE", "BY_POSE", "COUNTED")),
        *((kept, DECLARED, CarryOver.DECLARED) for kept in PASSING),
        *((kept, {}, CarryOver.NONE) for kept in ("IN_THE_INSTANCE", "UNTIL_TERMINATION", "FOR_ALL_INSTANCES")),
    ],
)
def test_the_score_is_that_of_the_law(kept, abilities, found, made):
    _, reference = made("IN_THE_INSTANCE")
    _, evaluation = made(kept, **abilities)
    assert figures(evaluation) == figures(reference)
    assert evaluation.results.loop_delay == reference.results.loop_delay
    assert evaluation.results.timing.computing_time is not None
    assert evaluation.head.carry_over is found
    said = [note for note in evaluation.summary().parts if "process" in getattr(note, "text", "")]
    assert bool(said) == found.separates or found is CarryOver.DECLARED


def test_state_that_only_a_later_group_of_cases_sets_is_found(tmp_path):
    """Only the first group of nine repeated a case: a flag that is set at a pose of the second passed unseen."""
    found, law = (
        Benchmark("quick", workers=2).evaluate(Controller(static_state_fmu(tmp_path, kept)), recordings=False)
        for kept in ("AT_ANOTHER_POSE", "IN_THE_INSTANCE")
    )
    assert (found.head.carry_over, law.head.carry_over) == (CarryOver.FOUND, CarryOver.NONE)
    assert figures(found) == figures(law)


def test_each_process_repeats_its_first_case_or_the_beginning_of_it(quick_pid_file):
    bench, shown = Benchmark("quick"), []
    pairing = bench.pairing(Controller(quick_pid_file))
    entry = BatchEntry(bench.rules, pairing, tuple(bench.cases))

    def execute(jobs):
        shown.extend(jobs)
        yield from ()

    with store.opened(None) as known:
        batch.run(Batch((entry,)), execute, known, repeat=True)
    run_at_all = []
    for number, job in enumerate(shown):
        *tasks, repeated = job.tasks if len(job.tasks) > 1 else (*job.tasks, None)  # a case alone follows no other
        run_at_all += [unpack(task, CaseTask).case.id for task in tasks]
        if number == 0:
            assert unpack(repeated, CaseTask) == unpack(tasks[0], CaseTask)
        elif repeated is not None:
            first, again = unpack(tasks[0], CaseTask).case.scenario, unpack(repeated, ScenarioTask).scenario
            assert again.duration == min(BEGINNING, first.duration) and again.announced == first.announced
            assert again.sensor == first.sensor and again.parameters == first.parameters
    assert sorted(run_at_all) == sorted(case.id for case in bench.cases)


def test_no_run_is_stored_before_its_process_has_repeated_a_case(quick_pid_file):
    """Three cases had other figures, and nobody was told, after an interruption between the last case of a group and
    the repetition: the next run found eight of them in the store, and had one left, which follows no other."""
    bench = Benchmark("quick")
    pairing = bench.pairing(Controller(quick_pid_file))
    entry = BatchEntry(bench.rules, pairing, tuple(bench.cases))
    alike = Digested(Judgement(status=Status.UNSTABLE, time=1.0), bytes(32))

    def execute(jobs, whole):
        """All jobs side by side: the cases of all, and then what each repeats, of the first ``whole`` jobs."""
        for number, job in enumerate(jobs):
            repeats = len(job.tasks) > 1
            yield from ((number, Done(index, alike, 1.0)) for index in range(len(job.tasks) - repeats))
        for number, job in enumerate(jobs[:whole]):
            if len(job.tasks) > 1:
                value = alike if number == 0 else alike.digest
                yield number, Done(len(job.tasks) - 1, value, 1.0)
        if whole < len(jobs):
            raise KeyboardInterrupt

    def there(whole):
        """The cases of an interrupted run that a later one finds, and those of the jobs that had repeated a case."""
        with store.opened(None) as known:
            jobs = []
            with suppress(KeyboardInterrupt):
                batch.run(
                    Batch((entry,)), lambda asked: execute(jobs.extend(asked) or asked, whole), known, repeat=True
                )
            keys = stored.keys(bench.rules, entry.cases, pairing)
            found = stored.load(known, keys, bench.rules, entry.cases, pairing, True)
        over = [job for number, job in enumerate(jobs) if number < whole or len(job.tasks) == 1]
        return len(found), sum(len(job.tasks) - (len(job.tasks) > 1) for job in over), len(jobs)

    *_, jobs = there(0)
    for whole in range(jobs + 1):
        found, expected, _ = there(whole)
        assert found == expected
    assert found == len(entry.cases)


def test_the_beginning_of_a_case_is_that_of_the_whole_one(plant_file, pid_c_file):
    """To the bit, also with jitter and dropout, whose random numbers must not depend on the duration."""
    bench = Benchmark("quick", plant=plant_file)
    pairing = bench.pairing(Controller(pid_c_file))
    varied = bench.varied(bench.case("c00.compliant.disturbance"), Variation(jitter="1e-4", dropout=0.2, duration=3))
    group = [varied, bench.cases[0]]
    *_, again = outcomes = [outcome.value for outcome in run_isolated(beginning_job(bench.rules, group, pairing))]
    assert outcomes[0].digest == again != outcomes[1].digest


def test_a_controller_that_is_random_is_not_taken_for_one_that_remembers(made):
    _, evaluation = made("NOWHERE")
    assert evaluation.head.carry_over is CarryOver.RANDOM


@pytest.mark.parametrize("kept", ["SINCE_LOADING", "AFTER_A_FORCE"])
def test_a_single_simulation_repeats_the_case(kept, made):
    file, evaluation = made(kept)
    for case in evaluation.results.cases[1:3]:
        assert Benchmark("quick").simulate(Controller(file), case.id).result.measurements == case.measurements


@pytest.mark.parametrize(
    ("kept", "abilities", "subject", "severity", "words"),
    [
        ("SINCE_LOADING", {}, "determinism", "warning", "passes from one simulation to the next"),
        ("SINCE_INSTANTIATION", {}, "determinism", "warning", "passes from one simulation to the next"),
        ("COUNTED", {}, "determinism", "warning", "passes from one simulation to the next"),
        ("BY_POSE", {}, "determinism", "warning", "passes from one simulation to the next"),
        ("AT_ANOTHER_POSE", {}, "determinism", "warning", "passes from one simulation to the next"),
        ("AFTER_A_FORCE", {}, "determinism", "warning", "passes from one simulation to the next"),
        ("SINCE_LOADING", DECLARED, "instances", "note", "only one per process, as declared"),
        ("UNTIL_TERMINATION", {}, "determinism", "ok", ""),
        ("FOR_ALL_INSTANCES", {}, "instances", "note", "two at once disturb each other"),
        ("NOWHERE", {}, "determinism", "warning", "other numbers each time"),
        ("IN_THE_INSTANCE", {}, "instances", "ok", ""),
    ],
)
def test_a_check_says_the_same(kept, abilities, subject, severity, words, tmp_path):
    file = static_state_fmu(tmp_path, kept, **abilities)
    found = {finding.subject: finding for finding in Benchmark("quick").check(Controller(file))}
    assert (found[subject].severity.value, words in found[subject].text) == (severity, True), found[subject]
    late = "cannot be measured" if kept == "NOWHERE" else "0 samples from a measurement to the torque"
    assert late in found["latency"].text and "cost" in found
    assert not [each for each in found.values() if each.severity.value == "error"]


@pytest.mark.parametrize(("kept", "equal"), [("IN_THE_INSTANCE", True), ("SINCE_LOADING", False)])
def test_a_reset_that_leaves_static_memory_is_seen(kept, equal, tmp_path):
    found = {each.subject: each for each in Benchmark("quick").check(Controller(static_state_fmu(tmp_path, kept)))}
    assert (found["reset"].severity.value == "ok") == equal


@pytest.mark.slow
def test_a_sample_has_a_process_for_each_simulation(tmp_path):
    file = static_state_fmu(tmp_path, "SINCE_LOADING")
    own, law = Controller(file), Controller(static_state_fmu(tmp_path, "IN_THE_INSTANCE"))
    bench = Benchmark("tuning", workers=2)
    found, reference = (bench.reliability(each, draws=1) for each in (own, law))
    assert (found.head.carry_over, reference.head.carry_over) == (CarryOver.FOUND, CarryOver.NONE)
    assert (found.criteria, found.requirements) == (reference.criteria, reference.requirements)


def test_what_was_found_is_known_to_a_run_that_continues(tmp_path, caplog):
    """The results of the first run lie in its folder beside those of processes that had run others."""
    own, bench = Controller(static_state_fmu(tmp_path, "AFTER_A_FORCE")), Benchmark("quick", workers=2)
    options = {"only": ONLY, "recordings": False, "folder": tmp_path / "run"}
    with caplog.at_level(logging.WARNING, "orchestrator"):
        first = bench.evaluate(own, **options)
        told = caplog.text
        again = bench.evaluate(own, **options)
    assert "passes from one simulation to the next" in told
    assert (figures(again), again.head.carry_over) == (figures(first), CarryOver.FOUND)


@pytest.mark.parametrize(
    ("after", "again", "found"),
    [
        (b"1", b"3", CarryOver.NONE),
        (b"2", b"1", CarryOver.FOUND),
        (b"2", b"3", CarryOver.RANDOM),
    ],
)
def test_what_passes_is_told_from_what_is_random(after, again, found):
    assert carry_over(after, b"1", lambda: again) is found


def test_what_is_found_after_results_have_been_used_is_an_error_and_stays_known(quick_pid_file):
    bench = Benchmark("quick")
    pairing = bench.pairing(Controller(quick_pid_file))
    wanted, processes = Batch((BatchEntry(bench.rules, pairing, tuple(bench.cases)),)), Processes()
    with store.opened(None) as known:
        due = []
        while sum(due) < 2:
            due.append(processes.is_due(wanted))
            processes.count(wanted, due[-1])
        assert due[0] and (len(due) - 1) * len(bench.cases) >= REPEAT_EVERY > (len(due) - 2) * len(bench.cases)
        problem = refusal(processes.take, pairing, CarryOver.FOUND, known)
        assert problem.what == "state-passes" and "again" in remedy(problem)
        assert Processes().of(pairing, known).is_separate and not processes.of(pairing, known).isolated


@pytest.mark.needs("gymnasium")
def test_an_environment_has_no_plant_of_one_instance(native_plant_file, tmp_path):
    import gymnasium

    import orchestrator.gym

    file = edited(native_plant_file, tmp_path / "Once.fmu", declare_once)
    env = gymnasium.make(orchestrator.gym.ID, plant=str(file), duration=0.01, disable_env_checker=True)
    assert refusal(env.reset, seed=0).what == "once-per-process"


def test_a_plant_of_one_instance_has_a_process_for_each_case(native_plant_file, pid_c_file, tmp_path):
    file = edited(native_plant_file, tmp_path / "Once.fmu", declare_once)
    pairing = Benchmark("quick", plant=file).pairing(Controller(pid_c_file))
    job = pairing.raw_job("module:name", [TimingRecord()] * 3, (1.0,) * 3, lambda _, value: value)
    assert pairing.is_separate and [len(job.rest(first).tasks) for first in range(3)] == [1, 1, 1]


def test_a_file_that_a_controller_leaves_in_its_own_folder_is_told_and_removed(tmp_path, caplog):
    """Later cases find it, and an evaluation after this one would."""
    body = "open(os.path.join(os.path.dirname(__file__), 'seen'), 'w').close(); self.law(); return True"
    own, bench = (
        Controller(python_controller(tmp_path, "Leaving", 45.0, 0.25e-3, "import os", step_body=body)),
        Benchmark("quick"),
    )
    for told in ("has left resources/seen in its own folder", "had left resources/seen in its own folder: removed"):
        caplog.clear()
        with caplog.at_level(logging.WARNING, "orchestrator"):
            bench.evaluate(Controller(own.file), only="c00.compliant.noise", recordings=False)
        assert told in caplog.text
