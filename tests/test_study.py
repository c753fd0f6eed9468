"""Studies are played without simulating anything: a function answers what they ask for."""

from fractions import Fraction

import pytest
from support.refusals import refusal

from orchestrator import Benchmark, Controller
from orchestrator.asking import answered
from orchestrator.benchmark.metrics import expected, named
from orchestrator.benchmark.results import Judgement, Measurements
from orchestrator.errors import Crash
from orchestrator.execution import store
from orchestrator.execution.job import Done
from orchestrator.loop.trajectory import Status
from orchestrator.pairing.runs import CaseRun
from orchestrator.study import batch
from orchestrator.study.evaluate import evaluate, spread
from orchestrator.study.rehearsal import Rehearsal
from orchestrator.study.requests import (
    Batch,
    Entry,
    Instant,
    Now,
    Record,
    Rehearse,
    Save,
    SeedDone,
    StageDone,
    Tell,
    TrialDone,
)
from orchestrator.study.sweep import sweep
from orchestrator.study.tune import tune
from orchestrator.study.verify import verify
from orchestrator.study.worst_case import worst_case


def run_of(protocol, case, status=Status.DONE, figure=0.0):
    """A run whose criteria all have the value ``figure``, and that ends at rest."""
    names = expected(protocol, case) if status is Status.DONE else ()
    figures = {name: True if name == "settled" else figure if name in protocol.criteria else 0.0 for name in names}
    return CaseRun(case, named(case, Judgement(status=status, time=1.0, measurements=Measurements(**figures))))


class Player:
    """Answers requests with runs whose figures ``figure(entry)`` gives, and keeps the requests."""

    def __init__(self, figure=lambda entry: 0.0, rehearsal=None):
        self.figure, self.rehearsal, self.asked, self.clock = figure, rehearsal or Rehearsal(), [], 0.0

    def __call__(self, request):
        self.asked.append(request)
        match request:
            case Batch(entries):
                return [[run_of(e.protocol, case, figure=self.figure(e)) for case in e.cases] for e in entries]
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
    found = answered(evaluate(quick, Controller()), player)
    assert found.complete and found.cost == 0.0 and len(found.cases) == quick.rules.case_count
    kinds = [type(request) for request in player.asked]
    assert kinds.index(Save) < kinds.index(Record) < len(kinds) - 1 and kinds[-1] is Save
    assert found.results.timing.wall_time == 1.0


def test_a_spread_is_an_evaluation_for_each_seed_in_its_folder(quick):
    player = Player()
    found = answered(spread(quick, Controller(), [3, 5, 3], recordings=False), player)
    assert [score.seed for score in found.seeds] == [3, 5] == [event.seed for event in player.events(SeedDone)]
    assert [save.inside for save in player.of(Save)] == ["seed-3", "", "seed-5", ""]


def test_a_sweep_has_the_values_that_its_figures_depend_on(quick):
    player = Player(lambda entry: entry.pairing.setup.parameters["K_p[1]"])
    found = answered(sweep(quick, Controller(), {"K_p[1]": (30.0, 10.0, 20.0)}), player)
    assert found.best is not None and found.best.values == {"K_p[1]": 10.0}
    assert [event.done for event in player.events(TrialDone)] == [1, 2, 3]
    assert all(entry.patience == 1 for request in player.of(Batch) for entry in request.entries)


@pytest.mark.needs("optuna", "cmaes")
def test_a_tuning_evaluates_its_best_candidate(quick):
    player = Player(lambda entry: abs(entry.pairing.setup.parameters["K_p[1]"] - 50.0))
    study = tune(quick, Controller(), {"K_p[1]": (20.0, 80.0)}, "quick", "quick", 30, 0, "random", 1, None)
    found = answered(study, player)
    assert found.best is not None and abs(found.parameters["K_p[1]"] - 50.0) < 5.0
    saved = {save.inside for save in player.of(Save)}
    assert {"", "strict", "seeds", f"trial-{found.best.trial.number}"} <= saved


def test_a_search_stops_when_its_time_is_over(quick):
    player = Player()
    found, shown = answered(worst_case(quick, Controller(), 2000, minutes=0.01), player)
    assert not found.complete and not found.margins and found.radius is None
    assert found.simulations < 1000 and found.cost == 0.0 and shown
    assert [event.stage for event in player.events(StageDone)][:2] == ["list", "all configurations"]


def test_a_verification_draws_for_the_controller_and_its_references(quick):
    player = Player()
    found = answered(verify(quick, Controller(), "a beacon", 2, False, ("TunedPID",), False), player)
    assert [draw.seed for draw in found.draws] == [draw.seed for draw in found.references["TunedPID"].draws]
    own, reference = player.of(Batch)
    assert own.entries[0].pairing.apart and not reference.entries[0].pairing.apart
    assert (reference.before, reference.total) == (len(own.entries[0].cases), 2 * len(own.entries[0].cases))


def test_a_study_ends_with_a_controller_that_does_not_survive_its_first_sample(quick):
    failure = run_of(quick.rules, quick.cases[0], Status.CRASHED)
    player = Player(rehearsal=Rehearsal(failure=failure))
    assert refusal(answered, sweep(quick, Controller(), {"K_p[1]": (1.0,)}), player, kind=Crash)
    assert not player.of(Batch)


def test_entries_side_by_side_stop_each_for_itself(own):
    """The second of three candidates fails in its first case: its other cases are skipped, those of the others run."""
    protocol = Benchmark("quick").rules
    cases = Benchmark("quick").cases[:3]
    entries = tuple(Entry(protocol, own, cases, patience=1) for _ in range(3))
    jobs = []

    def execute(given):
        jobs.extend(given)
        for index in range(3):
            for number in range(3):
                failed = number == 1
                if failed and index:
                    continue  # a job that gives up
                status = Status.ERROR if failed else Status.DONE
                yield number, Done(index, run_of(protocol, cases[index], status).result, 1.0)

    with store.opened(None) as known:
        runs = batch.run(Batch(entries), execute, known)
    assert [len(job.tasks) for job in jobs] == [3, 3, 3] and all(job.give_up for job in jobs)
    assert all(job.time_limits[0] > float(Fraction(5)) for job in jobs)
    statuses = [[run.result.status for run in each] for each in runs]
    done = [Status.DONE] * 3
    assert statuses == [done, [Status.ERROR, Status.SKIPPED, Status.SKIPPED], done]
