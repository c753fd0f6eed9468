"""Bounds from independent draws: the statistics, the draws, and the study that puts them together."""

import math
import shlex
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, kstest
from support.closed_loops import PAPER
from support.command_lines import call
from support.refusals import refusal
from test_study import Player, answered, on_target

from orchestrator import Benchmark, Controller, Reliability
from orchestrator.benchmark.reliability import draws_needed, probability_bound, quantile, rank_from_top
from orchestrator.errors import InputError
from orchestrator.loop.trajectory import Status
from orchestrator.search.draws import members
from orchestrator.search.member import names
from orchestrator.study.reliability import ReliabilityStudy
from orchestrator.study.requests import Batch
from orchestrator.views.page import fragment
from orchestrator.views.plot import Plot
from orchestrator.views.table import Facts

CONFIDENCE = 0.99


# The statistics


@pytest.mark.parametrize(
    ("probability", "failures", "draws"),
    [(0.01, 0, 459), (0.001, 0, 4603), (0.001, 1, 6636), (0.001, 2, 8403), (0.001, 3, 10042)],
)
def test_the_number_of_draws_is_that_of_the_tables(probability, failures, draws):
    assert draws_needed(probability, CONFIDENCE, failures) == draws
    assert probability_bound(failures, draws, CONFIDENCE) <= probability < probability_bound(failures, draws - 1, 0.99)


@given(p=st.floats(0.001, 0.999), draws=st.integers(1, 300))
def test_the_bound_covers_the_truth_as_often_as_it_says(p, draws):
    """Summed over all numbers of failures, exactly."""
    counts = np.arange(draws + 1)
    bounds = np.array([probability_bound(int(count), draws, CONFIDENCE) for count in counts])
    assert binom.pmf(counts[bounds >= p], draws, p).sum() >= CONFIDENCE - 1e-12
    assert np.all(np.diff(bounds) >= 0.0) and bounds[-1] == 1.0


@given(draws=st.integers(1, 2000), probability=st.floats(0.005, 0.3))
def test_the_bound_of_a_quantile_is_an_order_statistic(draws, probability):
    """The value at that place is beyond the quantile unless fewer draws than that are, which is unlikely enough."""
    place = rank_from_top(draws, probability, CONFIDENCE)
    assert not place or binom.cdf(place - 1, draws, probability) <= 1.0 - CONFIDENCE
    assert binom.cdf(place, draws, probability) > 1.0 - CONFIDENCE


def test_the_largest_of_459_draws_bounds_the_highest_hundredth():
    assert (rank_from_top(458, 0.01, CONFIDENCE), rank_from_top(459, 0.01, CONFIDENCE)) == (0, 1)
    values = [float(value) for value in range(459)]
    found = quantile(values, 0.01, CONFIDENCE)
    assert (found.median, found.largest, found.bound) == (229.0, 458.0, 458.0)
    assert quantile([*values[:-1], None], 0.01, CONFIDENCE).bound is None, "what has no value is worse than all others"
    assert quantile([*values, *values, None], 0.01, CONFIDENCE).bound == 458.0


# The draws


@pytest.mark.parametrize("distribution", ["box", "corners"])
def test_a_draw_depends_on_seed_and_number_alone(distribution):
    drawn = [members(PAPER, distribution, 0, number) for number in range(200)]
    assert drawn[7] == members(PAPER, distribution, 0, 7) != members(PAPER, distribution, 1, 7)
    assert [member.test for member in drawn[0]] == [test.name for test in PAPER.tests]
    first = [draw[-1] for draw in drawn]
    assert len({member.seed for member in first}) == 200
    assert all(len({(m.q_a, m.deviations, m.seed) for m in draw}) == 1 for draw in drawn), "one arm in one pose"
    values = np.array([[value for _, value in member.deviations] for member in first])
    assert values.shape == (200, len(names(PAPER)))
    if distribution == "corners":
        assert set(np.unique(values)) == {-1.0, 1.0}
    else:
        assert kstest(values.ravel(), "uniform", (-1.0, 2.0)).pvalue > 1e-3
    for place, (low, high) in enumerate((PAPER.workspace.q_a1_deg, PAPER.workspace.q_a2_deg)):
        assert kstest([member.q_a[place] for member in first], "uniform", (low, high - low)).pvalue > 1e-3
    assert kstest([member.phi_F for member in first], "uniform", (0.0, 2.0 * math.pi)).pvalue > 1e-3
    assert kstest([member.t_3 for member in first], "uniform", (0.0, 1.0)).pvalue > 1e-3, "Table 1: 0.5 s +- 0.5 s"
    assert {member.t_3 for draw in drawn for member in draw if member.test == "noise"} == {None}
    assert abs(Counter(member.sweep for member in first)[PAPER.disturbance.chirp_frequencies] - 100) < 40
    assert np.abs(np.corrcoef(values.T) - np.eye(values.shape[1])).max() < 0.35


def test_what_a_draw_had_before_t_3_was_drawn_is_as_it_was():
    """The figures of earlier samples stay those of the same arms."""
    (*_, member) = members(PAPER, "corners", 3, 5)
    assert member.q_a == (97.98751610790424, -102.26728323371643)
    assert (member.phi_F, member.sweep, member.seed) == (0.7976208157319903, (15.0, 0.0), 1866543147)


# The study


def heavy(case):
    """Whether the first link is among the heaviest tenth: a failure of known probability."""
    return dict(case.scenario.parameters)["m[1]"] > 50.0 * (1.0 + 0.1 * 0.8)


class Sampled(Player):
    """Loops that leave the workspace where the first link is heavy."""

    def __call__(self, request):
        if not isinstance(request, Batch):
            return super().__call__(request)
        self.asked.append(request)
        ends = {True: Status.UNSTABLE, False: Status.DONE}
        return [[on_target(e.protocol, case, ends[heavy(case)], 1.0) for case in e.cases] for e in request.entries]


def test_the_bound_covers_a_known_probability_of_failure():
    """In 99 of 100 samples at least, up to chance: an exact binomial test."""
    bench, covered = Benchmark("quick"), 0
    for seed in range(100):
        study = ReliabilityStudy(0.2, CONFIDENCE, draws=30).ask(replace(bench, seed=seed), Controller())
        found = answered(study, Sampled())
        assert {entry.judged for entry in found.requirements.values()} == {30}
        covered += found.requirements["A1"].bound >= 0.1
    assert binom.cdf(covered, 100, CONFIDENCE) > 1e-3


def test_failures_quantiles_and_progress():
    player = Sampled()
    found = answered(ReliabilityStudy(0.05, CONFIDENCE, draws=100).ask(Benchmark("quick"), Controller()), player)
    failed = {failure.draw for failure in found.requirements["A1"].failures}
    known = {n for n in range(100) if dict(members(PAPER, "box", 0, n)[0].deviations)["m[1]"] > 0.8}
    assert failed == known and 0 < len(failed) < 30
    assert found.requirements["A1"].estimate == len(failed) / 100
    assert found.cost.judged == 100 and len(found.cost.values) == 100 - len(failed)
    assert found.cost.bound is None and found.cost.largest is None and found.cost.median == pytest.approx(100.0)
    assert [(batch.before, batch.total) for batch in player.of(Batch)] == [(0, 600), (384, 600)]
    assert found.completeness == "complete" and not found.rank.holds
    lost = answered(
        ReliabilityStudy(0.5, 0.5, draws=2).ask(Benchmark("quick"), Controller()), Player(status=Status.LOST)
    )
    assert lost.completeness == "not judged" and lost.requirements["A3"].bound == 1.0


@pytest.mark.parametrize(
    ("only", "tests", "judged", "criteria"),
    [
        (("A2",), {"delay_1", "delay_2"}, ["A2"], []),
        (("delay_1",), {"delay_1"}, ["delay_1"], []),
        (("B1", "A1"), {"noise", "gain_1", "gain_2"}, ["A1"], ["B1", "B2"]),
        (("A3",), {"disturbance", "gain_1", "gain_2", "delay_1", "delay_2"}, ["A1", "A2", "A3"], ["B3", "B7"]),
        (("A3", "B1"), {test.name for test in PAPER.tests}, ["A1", "A2", "A3"], ["B1", "B7", "V"]),
    ],
)
def test_only_what_is_asked_for_is_simulated_and_judged(only, tests, judged, criteria):
    """Its figures are those of a whole sample."""
    player = Sampled()
    whole = answered(ReliabilityStudy(0.5, draws=40).ask(Benchmark("quick"), Controller()), Sampled())
    found = answered(ReliabilityStudy(0.5, draws=40, only=only).ask(Benchmark("quick"), Controller()), player)
    assert {case.test.name for batch in player.of(Batch) for entry in batch.entries for case in entry.cases} == tests
    assert list(found.requirements) == judged and found.completeness == "complete" and not found._problem()
    assert set(criteria) <= {*found.criteria, *(["V"] if found.cost.judged else [])}
    assert found.criteria.items() <= whole.criteria.items() and found.only == only
    assert found.cost in (whole.cost, quantile([], 0.5, CONFIDENCE))
    for name in set(judged) & set(whole.requirements):
        assert found.requirements[name] == whole.requirements[name]
    if "delay_1" in judged:
        assert {failure.test for failure in found.requirements["delay_1"].failures} == {"delay_1"}
        assert found.requirements["delay_1"].bound == whole.requirements["A2"].bound
    text = fragment(found.summary())
    assert f"only {', '.join(only)}" in text and ("target" in text) == bool(found.criteria)
    assert found.row(None, ())
    parts = found.summary().parts
    assert isinstance(parts[-1], Facts) and not any(isinstance(part, Facts) for part in parts[:-1])
    for plot in parts:
        assert not isinstance(plot, Plot) or plot.text.startswith("Share of the draws") and len(plot.words) < 400


def test_what_is_unknown_is_refused():
    error = refusal(answered, ReliabilityStudy(only=("delay_3",)).ask(Benchmark("quick"), Controller()), Sampled())
    assert error.what == "no-target" and "delay_1" in error.nearest


def test_draws_are_added_to_a_sample_of_the_same_kind_alone(tmp_path):
    answered(ReliabilityStudy(draws=2).ask(Benchmark("quick"), Controller()), Sampled()).save(tmp_path)
    for other in ({"distribution": "corners"}, {"only": ("A2",)}):
        asked = ReliabilityStudy(more=1, **other).ask(Benchmark("quick"), Controller(), tmp_path)
        assert refusal(answered, asked, Sampled()).what == "no-sample"
    grown = answered(ReliabilityStudy(more=1).ask(Benchmark("quick"), Controller(), tmp_path), Sampled())
    assert grown.draws == 3


def test_numbers_that_are_none_are_refused():
    for name, wrong in (("draws", 0), ("probability", 1.0), ("confidence", 0.0), ("more", 0), ("distribution", "ball")):
        error = refusal(ReliabilityStudy, **{name: wrong}, kind=InputError)
        assert error.what == ("bad-option" if name == "distribution" else "bad-number") and error.where == name


def test_options_that_exclude_each_other_do_so_for_every_caller():
    """The command refused them; from Python, the larger sample was made without a word."""
    error = refusal(ReliabilityStudy, draws=5, more=2)
    assert error.what == "contradiction" and "draws and more" in str(error)


@pytest.mark.slow
def test_a_sample_grows_and_each_failure_has_a_command_that_repeats_it(quick_pid_file, tmp_path):
    """The PID with so large a gain that it fails."""
    words = ("reliability", quick_pid_file, "--set", "K_p[1]=2000", "--output-dir", "own", "--no-report")
    first = call(*words, "--draws", "2", "--jobs", "1", folder=tmp_path)
    more = call(*words, "--more", "2", "--jobs", "2", folder=tmp_path)
    assert (first.code, more.code) == (0, 0)
    grown = Reliability.load(tmp_path / "own")
    at_once = call(*words[:-3], "--output-dir", "other", "--no-report", "--draws", "4", folder=tmp_path)
    same = Reliability.load(tmp_path / "other")
    assert at_once.code == 0 and (grown.requirements, grown.criteria, grown.cost) == (
        *(same.requirements, same.criteria, same.cost),
    )
    failures = grown.requirements["A1"].failures
    assert grown.draws == 4 and failures and grown.requirements["A1"].bound > 0.5
    _, command, *rest = shlex.split(failures[0].command)
    repeated = call(command, *rest, folder=tmp_path)
    assert failures[0].outcome.split()[0] in repeated.out
