"""Arms that are simulated side by side come to what each comes to alone, to the last bit."""

from fractions import Fraction

import pytest

from benchmarks import lanes
from orchestrator import Benchmark, Controller, Variation
from orchestrator.execution import pool
from orchestrator.pairing.pairing import beginning_job, digest_job

pytestmark = [pytest.mark.needs("g++", "gcc", "x86_64-linux"), pytest.mark.slow]

BENCH = Benchmark("strict", workers=2)
T_S = BENCH.rules.sample_time

VARIATIONS = (
    Variation(),
    Variation(delay=(5 * T_S + T_S / 3, T_S)),  # arrives within a sample
    Variation(delay=(2 * T_S, T_S * Fraction(7, 4)), gain=(1.0, 1.7), duration=Fraction(12)),
    Variation(sensor_delay=(T_S / 2, T_S), dropout=0.02),
    Variation(jitter=T_S / 4, duration=Fraction(11)),
    Variation(gain=(2.4, 1.0), chirp_amplitude=(0.0, 0.0), t_1=0.5, t_2=0.7, duration=Fraction(9)),
    Variation(torque_bits=0, angle_bits=0, noise_power=0.0, t_3=0.3),
    Variation(torque_limit=(20.0, 9.0), phi_F=2.0),
    Variation(force=1e6),  # leaves the workspace
)
"""More than eight, of several lengths and numbers of steps in a sample."""


@pytest.fixture
def executor():
    yield lanes.executor(2)
    lanes.end()


@pytest.mark.parametrize("name", ["SteadyLQG", "RobustLQG", "RobustLinearLQG", "DitheredLQG_C"])
def test_each_arm_comes_to_what_it_comes_to_alone(name, executor):
    pairing = BENCH.pairing(Controller.built_in(name))
    listed = [case for case in BENCH.cases if case.test.name == "disturbance_45"][::9]
    cases = [BENCH.varied(case, variation) for case, variation in zip(listed, VARIATIONS, strict=False)]
    assert len(cases) == len(VARIATIONS)
    jobs = [digest_job(BENCH.rules, cases, pairing), beginning_job(BENCH.rules, cases[:2], pairing)]
    alone, side_by_side = (
        sorted((number, outcome.index, outcome.value) for number, outcome in run)
        for run in (pool.run(jobs, 2), executor(jobs))
    )
    assert side_by_side == alone


def test_what_is_not_whole_is_left_to_everybodys_processes(executor, monkeypatch):
    left = []

    def counted(jobs, workers):
        left.extend(jobs)
        yield from pool.run(jobs, workers)

    pairing = BENCH.pairing(Controller.built_in("RobustLinearLQG"))
    steady = next(case for case in BENCH.cases if case.test.name == "disturbance_0")
    wild = BENCH.varied(steady, Variation(force=1e6))
    monkeypatch.setattr(lanes, "everybody", counted)
    found = executor([digest_job(BENCH.rules, [steady, wild], pairing)])
    values = {outcome.index: outcome.value.judgement.status.value for _, outcome in found}
    assert [len(job.tasks) for job in left] == [1]
    assert values == {0: "done", 1: "unstable"}
