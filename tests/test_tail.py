"""Peaks over threshold: the likelihood, how often its intervals cover a known tail, and what no tail shows."""

import math

import numpy as np
import pytest
from scipy import stats
from test_study import Player, answered, on_target

from orchestrator import Benchmark, Controller
from orchestrator.benchmark.tail import FEWEST, MOST, _likelihood, tail
from orchestrator.documents.reliability import _fits
from orchestrator.loop.trajectory import Status
from orchestrator.study.reliability import ReliabilityStudy
from orchestrator.study.requests import Batch
from orchestrator.views.page import fragment

DRAWS, PROBABILITY = 1000, 0.005
KNOWN = {
    "exponential": stats.expon(scale=12.0),
    "heavy": stats.genpareto(0.25, scale=5.0),
    "Gumbel": stats.gumbel_r(80.0, 5.0),
}


@pytest.mark.parametrize("name", KNOWN)
def test_the_intervals_cover_a_known_tail_as_often_as_they_say(name):
    """A requirement that fails in a draw of 5,000, and the value that one of 200 exceeds, in 200 samples."""
    known, rare = KNOWN[name], PROBABILITY / 25.0
    level, target, covered = known.isf(PROBABILITY), known.isf(rare), [0, 0]
    for seed in range(200):
        found = tail(known.rvs(DRAWS, random_state=seed), target, PROBABILITY, 0.95)
        covered[0] += found.level.low <= level <= found.level.high
        covered[1] += found.exceedance.low <= rare <= found.exceedance.high
    assert all(180 <= count <= 198 for count in covered), covered


@pytest.mark.parametrize("shape", [-0.4, 0.0, 0.3])
def test_the_likelihood_is_scipys_and_the_fit_its_maximum(shape):
    excesses = stats.genpareto(shape, scale=3.0).rvs(400, random_state=1)
    theirs = stats.genpareto.logpdf(excesses, 0.1, scale=4.0).sum()
    assert _likelihood(excesses, np.array(0.1), np.array(4.0)) == pytest.approx(theirs, rel=1e-12)
    found = tail(stats.genpareto(shape, scale=3.0).rvs(4000, random_state=2), 1.0, 0.001, 0.95)
    assert found.peaks == 400 and found.exceedance is None and found.shape == pytest.approx(shape, abs=0.2)
    beyond = stats.genpareto.isf(0.01, found.shape, scale=found.scale) + found.threshold
    assert found.level.estimate == pytest.approx(beyond, rel=1e-9)


def test_more_confidence_gives_wider_intervals_and_other_units_the_same():
    values = KNOWN["Gumbel"].rvs(DRAWS, random_state=3)
    narrow, wide = (tail(values, 105.0, PROBABILITY, confidence) for confidence in (0.8, 0.99))
    for inner, outer in ((narrow.level, wide.level), (narrow.exceedance, wide.exceedance)):
        assert outer.low <= inner.low < inner.estimate < inner.high < outer.high
        assert inner.estimate == pytest.approx(outer.estimate, rel=1e-6)
    small = tail(1e-3 * values, 0.105, PROBABILITY, 0.99)
    assert small.exceedance.high == pytest.approx(wide.exceedance.high, rel=1e-3)
    assert small.level.high == pytest.approx(1e-3 * wide.level.high, rel=1e-3)


def test_there_is_no_tail_of_too_few_draws_or_of_some_without_a_value():
    values = [*KNOWN["exponential"].rvs(10 * FEWEST, random_state=4)]
    assert tail(values, 1.0, 0.01, 0.95).peaks == FEWEST
    assert tail(values[1:], 1.0, 0.01, 0.95) is None
    assert tail([*values, None], 1.0, 0.01, 0.95) is None
    assert tail([0.0] * 1000, 1.0, 0.01, 0.95) is None and tail([], 1.0, 0.01, 0.95) is None
    assert tail(values, 1.0, 0.2, 0.95).level is None
    assert tail(KNOWN["exponential"].rvs(20 * MOST, random_state=4), 1.0, 0.01, 0.95).peaks == MOST


def test_a_second_mode_that_no_draw_has_hit_is_in_no_tail():
    """As RobustLQG's failure of A2: one draw of 2,000 is at 1,000 in place of about 80."""
    draws = KNOWN["Gumbel"].rvs(DRAWS, random_state=5)
    found = tail(draws, 500.0, PROBABILITY, 0.99)
    assert found.exceedance.high < 1.0 / 2000.0


def share(case):
    """Of the targets: exponential, by the mass of the first link, which is uniform."""
    uniform = 0.5 + (dict(case.scenario.parameters)["m[1]"] / 50.0 - 1.0) / 0.2
    return 0.3 - 0.1 * math.log(1.0 - uniform)


class Spread(Player):
    """Loops whose criteria have a known distribution."""

    def __call__(self, request):
        if not isinstance(request, Batch):
            return super().__call__(request)
        return [[on_target(e.protocol, case, Status.DONE, share(case)) for case in e.cases] for e in request.entries]


def test_a_sample_has_the_tails_of_its_values_and_shows_them(tmp_path):
    found = answered(ReliabilityStudy(draws=400).ask(Benchmark("quick"), Controller()), Spread())
    assert found.tails.keys() == {*found.criteria, "V"} and not found._problem()
    assert found.tails["V"] == tail(found.cost.values, 100.0, found.probability, found.confidence)
    interval = found.tails["V"].exceedance
    assert interval.low <= math.exp(-(1.0 - 0.3) / 0.1) <= interval.high < 0.02
    found.save(tmp_path)
    assert type(found).load(tmp_path) == found
    assert "return level" in fragment(found.summary()) and "beyond target" in fragment(found.summary())
    assert not _fits(found.tails["V"], found.criteria["B5"])
    few = answered(ReliabilityStudy(draws=40).ask(Benchmark("quick"), Controller()), Spread())
    assert not few.tails and "return level" not in fragment(few.summary())
