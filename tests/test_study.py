"""Studies are played without simulating anything: a function answers what they ask for."""

import logging
import math
import random
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.refusals import refusal
from test_search import TINY
from test_tuning import FEW

from orchestrator import Benchmark, Controller
from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.cases import seed_of
from orchestrator.benchmark.draws import Entropy
from orchestrator.benchmark.metrics import case_result, expected
from orchestrator.benchmark.results import Judgement, Measurements
from orchestrator.codec import unpack
from orchestrator.documents.verification import STRICT
from orchestrator.errors import Crash, EnvironmentFault
from orchestrator.execution import store
from orchestrator.execution.job import Done
from orchestrator.execution.supervision import NOT_BY_CONTROLLER
from orchestrator.loop.trajectory import Status
from orchestrator.pairing.runs import CaseRun
from orchestrator.pairing.work import CaseTask
from orchestrator.study import batch
from orchestrator.study.dry_run import on_target
from orchestrator.study.engine import Engine, Processes
from orchestrator.study.evaluate import EvaluationStudy, SpreadStudy
from orchestrator.study.rehearsal import Rehearsal
from orchestrator.study.reliability import ReliabilityStudy
from orchestrator.study.requests import (
    Batch,
    BatchEntry,
    Instant,
    Now,
    Record,
    Rehearse,
    Save,
    SeedDone,
    StageDone,
    Tell,
    TimeSteps,
    TrialDone,
    answered,
)
from orchestrator.study.sweep import SweepStudy
from orchestrator.study.tune import TuningStudy
from orchestrator.study.verify import Listed, VerificationStudy
from orchestrator.study.worst_case import RobustnessStudy, worst_case
from plant_fmu.flexible_manipulator.parameters import NOMINAL


class Player:
    """Answers requests with runs whose criteria are ``share(entry)`` of their targets, and keeps the requests."""

    def __init__(self, share=lambda entry: 0.0, rehearsal=None, status=Status.DONE):
        self.share, self.status = share, status
        self.rehearsal, self.asked, self.clock = rehearsal or Rehearsal(), [], 0.0

    def __call__(self, request):
        self.asked.append(request)
        match request:
            case Batch(entries):
                return [[on_target(e.protocol, case, self.status, self.share(e)) for case in e.cases] for e in entries]
            case Rehearse():
                return self.rehearsal
            case Record():
                return ()
            case Now():
                self.clock += 1.0
                return Instant("2026-01-01", self.clock, 2)
        return None

    def of(self, kind):
        """The requests of one kind."""
        return [request for request in self.asked if isinstance(request, kind)]

    def events(self, kind):
        """The events of one kind that were told."""
        return [request.event for request in self.of(Tell) if isinstance(request.event, kind)]


@pytest.fixture
def quick():
    return Benchmark("quick")


def test_an_evaluation_saves_its_results_before_it_records(quick):
    player = Player()
    found = answered(EvaluationStudy().ask(quick, Controller()), player)
    assert found.complete and found.cost == 0.0 and len(found.cases) == quick.rules.case_count
    kinds = [type(request) for request in player.asked]
    assert kinds.index(Save) < kinds.index(Record) < len(kinds) - 1 and kinds[-1] is Save
    assert found.results.timing.wall_time == 1.0


def test_a_spread_is_an_evaluation_for_each_seed_in_its_folder(quick):
    player = Player()
    found = answered(SpreadStudy([3, 5, 3], EvaluationStudy(recordings=False)).ask(quick, Controller()), player)
    assert [score.seed for score in found.seeds] == [3, 5] == [event.seed for event in player.events(SeedDone)]
    assert [save.inside for save in player.of(Save)] == ["seed-3", "", "seed-5", ""]


@pytest.mark.parametrize(
    ("status", "completeness"),
    [(Status.DONE, "complete"), (Status.CRASHED, "incomplete"), (Status.LOST, "not judged")],
)
def test_a_spread_says_how_its_cases_ended(quick, status, completeness):
    """Also where no requirement counts them; what was not asked for is no failure."""
    study = SpreadStudy([3, 5], EvaluationStudy("c00.compliant.noise", recordings=False)).ask(quick, Controller())
    assert answered(study, Player(status=status)).completeness == completeness


def test_a_sweep_has_the_values_that_its_figures_depend_on(quick):
    player = Player(lambda entry: entry.pairing.setup.parameters["K_p[1]"])
    found = answered(SweepStudy({"K_p[1]": (30.0, 10.0, 20.0)}, "quick").ask(quick, Controller()), player)
    assert found.best is not None and found.best.values == {"K_p[1]": 10.0}
    assert [event.done for event in player.events(TrialDone)] == [1, 2, 3]
    assert all(entry.patience == 1 for request in player.of(Batch) for entry in request.entries)


@pytest.mark.needs("optuna", "cmaes")
def test_a_tuning_evaluates_its_best_candidate(quick):
    player = Player(lambda entry: abs(entry.pairing.setup.parameters["K_p[1]"] - 50.0))
    study = TuningStudy({"K_p[1]": (20.0, 80.0)}, 30, "quick", "quick", sampler="random").ask(quick, Controller())
    found = answered(study, player)
    assert found.best is not None and abs(found.parameters["K_p[1]"] - 50.0) < 5.0
    saved = {save.inside for save in player.of(Save)}
    assert {"", "strict", "seeds", f"trial-{found.best.trial.number}"} <= saved


def test_a_search_stops_when_its_time_is_over(quick):
    player = Player()
    found, shown = answered(worst_case(quick, Controller(), RobustnessStudy(2000, minutes=0.01)), player)
    assert not found.complete and not found.margins and found.radius is None
    assert found.simulations < 1200 and found.cost == 0.0 and shown
    assert [event.stage for event in player.events(StageDone)] == ["list", "effects", "other noise"]


def verification(bench, beside, draws=None):
    """The requests of a verification with two draws, in the protocol of ``bench``."""
    return VerificationStudy(draws, 2, strict=False, beside=beside, protocol=bench.protocol).ask(bench, Controller())


def test_a_verification_draws_for_the_controller_and_its_references(quick):
    player = Player()
    found = answered(verification(quick, ("TunedPID",)), player)
    assert [draw.seed for draw in found.draws] == [draw.seed for draw in found.references["TunedPID"].draws]
    own, reference = player.of(Batch)
    assert own.entries[0].pairing.isolated and not reference.entries[0].pairing.isolated
    assert (reference.before, reference.total) == (len(own.entries[0].cases), 2 * len(own.entries[0].cases))


@given(st.text("0123456789abcdef", min_size=64, max_size=64), st.sets(st.integers(0, 2**53), min_size=1, max_size=3))
def test_the_results_of_a_verification_come_back_to_their_draws(entropy, seeds):
    listed = Listed.of(Benchmark("quick").rules, NOMINAL, [*seeds], None, entropy)
    entry = listed.entry(None)
    found = listed.by_draw([on_target(entry.protocol, case, share=seed_of(case)) for case in entry.cases])
    assert [seed for seed, _ in found] == [*seeds]
    for (seed, results), (_, drawn) in zip(found, listed.draws, strict=True):
        assert [result.id for result in results] == [case.id for case in drawn]
        target = entry.protocol.criteria["B5"].target
        assert {result.measurements.B5 for result in results} <= {None, seed * target}


def test_a_verification_tries_the_worst_poses_in_the_same_batch(quick):
    player = Player()
    study = VerificationStudy(None, 2, strict=True, beside=("TunedPID",), protocol="quick")
    found = answered(study.ask(quick, Controller()), player)
    own, reference = player.of(Batch)
    sizes = [len(entry.cases) for entry in own.entries]
    assert sizes == [2 * quick.rules.case_count, protocols.load(STRICT).case_count]
    assert sizes == [len(entry.cases) for entry in reference.entries]
    assert [entry.witness is not None for entry in (*own.entries, *reference.entries)] == [True, False, False, False]
    assert (own.before, own.total, reference.before, reference.total) == (0, 2 * sum(sizes), sum(sizes), 2 * sum(sizes))
    assert found.strict.complete and found.references["TunedPID"].strict.complete


def test_a_verification_that_is_disturbed_begins_again_with_other_draws(quick, caplog):
    player, disturbed = Player(), []

    def answer(request):
        if isinstance(request, Batch) and len(disturbed) < 2:
            disturbed.append(request)
            raise EnvironmentFault("killed", NOT_BY_CONTROLLER)
        return player(request)

    with caplog.at_level(logging.WARNING, "orchestrator"):
        found = answered(verification(quick, ()), answer)
    tried = [each.entries[0].cases for each in (*disturbed, *player.of(Batch))]
    assert found.repetitions == 2 and len({cases[0].scenario.sensor.noise.seed for cases in tried}) == 3
    assert caplog.text.count("begins again") == 2
    other = EnvironmentFault("no disk")
    for problem in (other, EnvironmentFault("killed", NOT_BY_CONTROLLER)):
        with pytest.raises(EnvironmentFault):
            answered(verification(quick, ()), raising(problem, Player()))


def raising(problem, player):
    def answer(request):
        if isinstance(request, Batch):
            raise problem
        return player(request)

    return answer


def test_a_study_ends_with_a_controller_that_does_not_survive_its_first_sample(quick):
    failure = on_target(quick.rules, quick.cases[0], Status.CRASHED)
    player = Player(rehearsal=Rehearsal(failure=failure))
    assert refusal(answered, SweepStudy({"K_p[1]": (1.0,)}, "quick").ask(quick, Controller()), player, kind=Crash)
    assert not player.of(Batch)


def test_entries_side_by_side_stop_each_for_itself(own):
    """The second of three candidates fails in its first case: its other cases are skipped, those of the others run."""
    protocol = Benchmark("quick").rules
    cases = Benchmark("quick").cases[:3]
    entries = tuple(BatchEntry(protocol, own, cases, patience=1) for _ in range(3))
    jobs = []

    def execute(given):
        jobs.extend(given)
        for index in range(3):
            for number in range(3):
                failed = number == 1
                if failed and index:
                    continue  # a job that gives up
                status = Status.ERROR if failed else Status.DONE
                yield number, Done(index, on_target(protocol, cases[index], status).result, 1.0)

    with store.opened(None) as known:
        runs = batch.run(Batch(entries), execute, known)
    assert [len(job.tasks) for job in jobs] == [3, 3, 3] and all(job.give_up for job in jobs)
    assert all(job.time_limits[0] > float(Fraction(5)) for job in jobs)
    statuses = [[run.result.status for run in each] for each in runs]
    done = [Status.DONE] * 3
    assert statuses == [done, [Status.ERROR, Status.SKIPPED, Status.SKIPPED], done]


@pytest.mark.parametrize(("time", "asked"), [(0.3, False), (0.5, True)])
def test_a_controller_that_hangs_early_is_not_timed(time, asked):
    """The timed steps would hang as well, and cost another time limit."""

    class Hanging(Player):
        def __call__(self, request):
            answer, hung = super().__call__(request), Judgement(status=Status.TIMEOUT, time=time)
            if not isinstance(request, Batch):
                return answer
            return [[CaseRun(case, case_result(case, hung)) for case in entry.cases] for entry in request.entries]

    player = Hanging()
    answered(EvaluationStudy(recordings=False).ask(Benchmark("quick"), Controller()), player)
    assert bool(player.of(TimeSteps)) is asked


# Interrupted, and started again


class Once(Processes):
    """Nothing is repeated."""

    def is_due(self, batch):
        return False


class Rehearsed(Engine):
    """The engine with its store and its files, but without a first sample, repetitions and recordings, and with a clock
    that stands still: what is left of the time is that of the cases, which is stored with them."""

    def _answer(self, request, known, spent, processes):
        match request:
            case Rehearse():
                return Rehearsal()
            case TimeSteps():
                return None
            case Record():
                return ()
            case Now():
                return Instant("2026-01-01", 0.0, self.processes, **vars(spent))
        return super()._answer(request, known, spent, Once())


def simulated(task):
    """A judgement that follows from the scenario and the parameters of a task, and from nothing else.

    A controller whose first parameter is above 60 is refused by its FMU; one with at most 50 holds A1 to A3; others
    hold them by chance.
    """
    wanted = unpack(task, CaseTask)
    parameters, protocol = sorted(wanted.setup.parameters.items()), wanted.protocol
    first = parameters[0][1] if parameters else 55.0
    if first > 60.0:
        return Judgement(status=Status.ERROR, time=0.0, message="it is refused")
    chance = random.Random(repr((wanted.case.scenario, parameters)))
    if first > 50.0 and not wanted.case.test.criteria and chance.random() < 0.05:
        return Judgement(status=Status.UNSTABLE, time=0.1)
    limits, largest = protocol.stability, 0.9 if first <= 50.0 else 1.1
    scale = {name: entry.target for name, entry in protocol.criteria.items()}
    scale |= {"limit_cycle": largest * limits.limit_cycle, "rest_error": limits.rest_error}
    names = sorted(expected(protocol, wanted.case))
    figures = {name: True if name == "settled" else chance.random() * scale.get(name, 1.0) for name in names}
    return Judgement(status=Status.DONE, time=0.1, measurements=Measurements(**figures))


def on_its_target(task):
    """A judgement that holds all that is asked for."""
    wanted = unpack(task, CaseTask)
    found = on_target(wanted.protocol, wanted.case).result
    return Judgement(status=found.status, time=found.time, measurements=found.measurements)


class Workers:
    """Runs jobs side by side in an order that ``seed`` tells, the cases of each in theirs, until ``stop`` are done in
    all; ``judged`` gives the judgement of a task, ``done`` counts."""

    def __init__(self, seed, stop=math.inf, judged=simulated):
        self.chance, self.stop, self.judged, self.done = random.Random(seed), stop, judged, 0

    def __call__(self, jobs):
        waiting = {number: list(enumerate(job.tasks)) for number, job in enumerate(jobs)}
        while waiting:
            number = self.chance.choice(sorted(waiting))
            if self.done == self.stop:
                raise KeyboardInterrupt
            (index, task), *rest = waiting.pop(number)
            self.done += 1
            found = self.judged(task)
            if rest and not (jobs[number].give_up and found.status is Status.ERROR):
                waiting[number] = rest
            yield number, Done(index, found, float(len(task)))


def studies(folder):
    """Studies, each as a function that begins it in a folder, or for a plan in None."""
    files = {"tiny": TINY, "whole": FEW.format(name="whole", system="nominal")}
    files["short"] = FEW.format(name="short", system="compliant")
    tiny, whole, short = (folder / f"{name}.toml" for name in files)
    for file, text in zip((tiny, whole, short), files.values(), strict=True):
        file.write_text(text, encoding="utf-8")
    bench, pid = Benchmark(whole, workers=2), Controller()
    vary, values = {"K_p[1]": (20.0, 80.0), "z_p[2]": (0.6, 0.99)}, {"K_p[1]": (30.0, 60.0, 90.0), "z_p[2]": (0.8, 0.9)}
    short_bench = Benchmark(short, workers=2)
    return {
        "evaluation": lambda own: EvaluationStudy().ask(bench, pid, own),
        "spread": lambda own: SpreadStudy((3, 5, 8), EvaluationStudy(keep_going=True)).ask(bench, pid, own),
        "search": lambda own: RobustnessStudy(150, protocol=tiny).ask(bench, pid, own),
        "sweep": lambda own: SweepStudy(values, short).ask(bench, pid, own),
        "sample": lambda own: ReliabilityStudy(draws=70).ask(short_bench, pid, own),
        "tuning": lambda own: TuningStudy(vary, 30, short, short, robust=60).ask(bench, pid, own),
        "verification": lambda own: verification(bench, ("TunedPID",), Entropy("0" * 64)),
    }


@pytest.mark.parametrize(
    ("name", "document"),
    [
        ("evaluation", "results.json"),
        ("spread", "spread.json"),
        ("search", "robustness.json"),
        ("sweep", "sweep.json"),
        ("sample", "reliability.json"),
        pytest.param("tuning", "tuning.json", marks=pytest.mark.needs("optuna", "cmaes")),
    ],
)
def test_a_study_that_was_interrupted_writes_the_bytes_of_one_that_was_not(name, document, tmp_path):
    """All its files, those of the evaluations that are part of it as well; and no simulation is run twice."""
    begin = studies(tmp_path)[name]

    def played(workers, folder):
        Rehearsed(workers, 2, folder).run(begin(folder))

    def files(folder):
        texts = (file for file in folder.rglob("*") if file.suffix in (".json", ".csv", ".toml"))
        return {str(file.relative_to(folder)): file.read_bytes() for file in texts}

    whole, resumed = tmp_path / "whole", tmp_path / "resumed"
    undisturbed, last = Workers(0), Workers(9)
    played(undisturbed, whole)
    stops = [1, undisturbed.done // 3, undisturbed.done // 4]
    for seed, stop in enumerate(stops, start=1):
        with pytest.raises(KeyboardInterrupt):
            played(Workers(seed, stop), resumed)
    played(last, resumed)
    assert document in files(whole) and files(resumed) == files(whole)
    assert last.done == undisturbed.done - sum(stops)


# Planned


@pytest.mark.parametrize(
    "name",
    [
        *("evaluation", "spread", "search", "sweep", "sample", "verification"),
        pytest.param("tuning", marks=pytest.mark.needs("optuna", "cmaes")),
    ],
)
def test_a_plan_counts_what_the_study_asks_for_and_what_is_stored(name, tmp_path):
    """One case is simulated to measure the time, and nothing is written."""
    begin, folder = studies(tmp_path)[name], tmp_path / "own"

    def contents():
        return {str(file.relative_to(tmp_path)): file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}

    def planned():
        workers, before = Workers(0, judged=on_its_target), contents()
        found = Rehearsed(workers, 2, folder).plan(begin(None))
        assert contents() == before and found.seconds == found.seconds_per_case * (found.cases - found.stored) / 2
        return found.cases, found.stored, workers.done

    cases, *rest = planned()
    assert rest == [0, 1] and not folder.exists()
    with pytest.raises(KeyboardInterrupt):
        Rehearsed(Workers(1, 2, on_its_target), 2, folder).run(begin(folder))
    assert planned() == (cases, 2, 0)
    workers = Workers(2, judged=on_its_target)
    Rehearsed(workers, 2, folder).run(begin(folder))
    assert workers.done + 2 == cases and planned() == (cases, cases, 0)
