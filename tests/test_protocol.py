"""The protocol files: which cases there are, and that they are the same for everybody."""

import math
import re
import zlib
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from importlib import resources

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.manipulators import HALF_WIDTHS
from support.refusals import refusal

from orchestrator.benchmark import cases, protocol
from orchestrator.loop.scenario import Chirp, Pulse
from plant_fmu.flexible_manipulator.parameters import NOMINAL

PAPER = protocol.load("paper")
GRID = cases.grid(PAPER)
CASES = cases.cases(PAPER, NOMINAL, 0)


def by_id(found):
    return {case.id: case for case in found}


def test_the_papers_protocol_has_324_cases_of_7128_seconds():
    assert len(CASES) == len(by_id(CASES)) == 324
    assert sum(case.scenario.duration for case in CASES) == 7128
    assert sum(case.scenario.samples for case in CASES) == 28_512_000
    assert Counter(case.test.name for case in CASES) == {
        "noise": 54, "disturbance": 54, "gain_1": 54, "gain_2": 54, "delay_1": 54, "delay_2": 54,
    }  # fmt: skip


def test_quick_is_a_small_part_of_it():
    quick = cases.cases(protocol.load("quick"), NOMINAL, 0)
    assert len(quick) == 24
    assert {case.test for case in quick} == set(PAPER.tests), "of every kind"
    assert protocol.load("quick").criteria == PAPER.criteria


def test_configurations_fill_the_workspace():
    angles = {(round(math.degrees(q.q_a1), 9), round(math.degrees(q.q_a2), 9)) for q in GRID}
    assert angles == {(-90 + 33.75 * k, q_a2) for k in range(9) for q_a2 in (-180, 80)}
    assert [q.index for q in GRID] == list(range(18))
    assert cases.configuration(PAPER, math.radians(-22.5), math.radians(80)) == GRID[5]
    assert cases.configuration(PAPER, 0.1, 0.2).index == -1


def test_weights_and_targets_are_those_of_section_6():
    assert list(PAPER.criteria) == [f"B{i}" for i in range(1, 8)]
    assert [criterion.weight for criterion in PAPER.criteria.values()] == [3, 3, 2, 2, 25, 40, 25]
    assert [criterion.target for criterion in PAPER.criteria.values()] == [0.7, 0.4, 35, 20, 7e-3, 3, 0.5e-3]


def test_imperfections_are_those_of_table_1():
    for case in CASES:
        loop = case.scenario
        assert loop.sample_time == Fraction("0.25e-3")
        # Band-limited white noise of power 3e-12: variance times sample time.
        assert loop.sensor.noise.sigma**2 * 0.25e-3 == pytest.approx(3e-12, rel=1e-12)
        assert loop.sensor.delay == (0, 0)
        assert loop.sensor.quantum * 65536 == pytest.approx(2 * math.pi, rel=1e-15)
        assert loop.drive.limit == (35.0, 20.0)
        assert [quantum * 4096 for quantum in loop.drive.quantum] == [70.0, 40.0]


def test_stability_tests_add_what_they_are_named_for():
    T_d, late = Fraction("0.25e-3"), Fraction("1.75e-3")
    gains = {"gain_1": (2.5, 1.0), "gain_2": (1.0, 2.5)}
    delays = {"delay_1": (late, T_d), "delay_2": (T_d, late)}
    for case in CASES:
        drive, name = case.scenario.drive, case.test.name
        assert (drive.gain, drive.delay) == (gains.get(name, (1.0, 1.0)), delays.get(name, (T_d, T_d)))


def test_noise_alone_has_no_disturbance_and_all_others_have_both():
    for case in CASES:
        if case.test.name == "noise":
            assert case.scenario.chirp == Chirp() and case.scenario.pulse == Pulse()
            continue
        chirp, pulse = case.scenario.chirp, case.scenario.pulse
        assert chirp.amplitude == (1.0, -1.0)
        assert 0.0 <= chirp.start <= 1.0 and chirp.stop == 8.0
        assert {chirp.f_start, chirp.f_stop} == {0.0, 15.0}
        assert math.hypot(*pulse.force) == pytest.approx(500.0, rel=1e-15)
        assert (pulse.start, pulse.stop) == (10.0, 10.5)


def test_stability_systems_draw_nothing():
    disturbances = {
        (case.system.disturbance, case.scenario.chirp, case.scenario.pulse) for case in CASES if case.test.axis
    }
    ((fixed, _, pulse),) = disturbances
    assert (fixed.t_3, fixed.f_start, fixed.f_stop) == (0.5, 15.0, 0.0)
    assert pulse.force == pytest.approx((500 * math.cos(0.7), 500 * math.sin(0.7)))


def relative(case):
    """Deviation of each uncertain parameter in half-widths of its uncertainty."""
    given = dict(case.system.parameters)
    return {
        f"{symbol}[{axis}]": (given[f"{symbol}[{axis}]"] / NOMINAL[f"{symbol}[{axis}]"] - 1.0) / half_width
        for symbol, half_width in HALF_WIDTHS.items()
        for axis in (1, 2)
    }


SYMBOLS = ("m", "k_low", "k_high", "psi", "d", "f_d", "f_c", "mu_k", "beta", "alpha", "gamma")
SIGNS = {"compliant": "+--+----+--", "slippery": "-++-----+-+", "sticky": "+--+-+++-+-"}


@pytest.mark.parametrize("name", SIGNS)
def test_named_systems_are_corners_of_the_uncertainty(name):
    signs = {symbol: float(f"{sign}1") for symbol, sign in zip(SYMBOLS, SIGNS[name], strict=True)}
    systems = [relative(case) for case in CASES if case.system.name == name]
    for deviations in systems:
        assert deviations == pytest.approx({of: signs[of.partition("[")[0]] for of in deviations}, rel=1e-12)
    assert systems


def test_random_systems_fill_the_uncertainty_and_nothing_else():
    drawn = [case for case in CASES if case.system.name.startswith("random") and case.test.name == "noise"]
    deviations = np.array([list(relative(case).values()) for case in drawn])
    assert deviations.shape == (36, 22)
    assert np.abs(deviations).max() <= 1.0
    assert len(np.unique(deviations)) == deviations.size, "every parameter and axis on its own"
    # 792 uniform numbers: mean 0 and variance 1/3, within four standard deviations of their estimates.
    assert abs(deviations.mean()) < 4 * math.sqrt(1 / 3 / deviations.size)
    assert abs(deviations.var() - 1 / 3) < 4 * math.sqrt((1 / 5 - 1 / 9) / deviations.size)
    for case in drawn:
        certain = {name: value for name, value in case.system.parameters if name.partition("[")[0] not in HALF_WIDTHS}
        assert certain == {name: NOMINAL[name] for name in certain}
    disturbances = [case.system.disturbance for case in drawn]
    assert {int(disturbance.phi_F // (math.pi / 2)) for disturbance in disturbances} == {0, 1, 2, 3}
    assert len({disturbance.t_3 for disturbance in disturbances}) == 36
    assert {(of.f_start, of.f_stop) for of in disturbances} == {(0.0, 15.0), (15.0, 0.0)}, "sweeps go both ways"


def test_cases_are_determined_by_the_seed():
    assert cases.cases(PAPER, NOMINAL, 0) == CASES
    other = by_id(cases.cases(PAPER, NOMINAL, 1))
    for case in CASES:
        assert case.scenario.sensor.noise.seed != other[case.id].scenario.sensor.noise.seed
        if case.system.name.startswith("random"):
            assert case.system.parameters != other[case.id].system.parameters


def test_every_configuration_and_system_has_noise_of_its_own_and_all_its_tests_the_same():
    seeds = {}
    for case in CASES:
        seeds.setdefault((case.configuration.index, case.system.name), set()).add(case.scenario.sensor.noise.seed)
    assert all(len(own) == 1 for own in seeds.values())
    assert len(set().union(*seeds.values())) == len(seeds) == 18 * 5


@settings(max_examples=10)
@given(order=st.permutations(["compliant", "random_1", "random_2"]), tests=st.permutations(PAPER.tests))
def test_the_order_of_systems_and_tests_changes_no_case(order, tests):
    sets = {**PAPER.sets, "performance": tuple(order)}
    shuffled = msgspec.structs.replace(PAPER, sets=sets, tests=tuple(tests))
    known = by_id(CASES)
    assert all(case == known[case.id] for case in cases.cases(shuffled, NOMINAL, 0))


def test_another_sample_time_leaves_sensor_and_systems_alone():
    slower = cases.cases(PAPER, NOMINAL, 0, Fraction(1, 1000))
    for case, other in zip(CASES, slower, strict=True):
        assert other.scenario == replace(case.scenario, sample_time=Fraction(1, 1000))
        assert other.scenario.longest_hold == Fraction(1, 4000)


def test_a_selection_takes_tests_by_name_and_pose(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("extends = 'paper'\n[selection]\ntests = ['noise', 'delay_*']\nposes = [3, 7]\n")
    found = cases.cases(protocol.load(file), NOMINAL, 0)
    wanted = [key for key in by_id(CASES) if re.fullmatch(r"c0[37]\..*\.(noise|delay_[12])", key)]
    assert [case.id for case in found] == wanted and len(found) == protocol.load(file).case_count == 2 * (3 + 3 + 3)
    assert all(case.scenario == by_id(CASES)[case.id].scenario for case in found)


SETS = "[sets]\nperformance = []\n[[tests]]\nname = 'x'\nsystems = 'absent'\nduration = 1"
LOOPS = ("sample_time = 'soon'", "noise_power = nan", "torque_bits = 60", "unknown = 1")
SHORT = "[[tests]]\nname = 'x'\nsystems = 'performance'\nduration = 5\nrequirements = ['A3']"
NAMES = "[[tests]]\nname = 'x'\nsystems = 'performance'\nduration = 26\n"
TOLD = {
    "[loop]\nunknown = 1": ["`unknown`", "Allowed: sample_time, delay, ", "abort_distance."],
    "[grid]\npoints = 1": ["Allowed: q_a1_points, q_a2_points, also_deg."],
    "surname = 'x'": ["Allowed: benchmark, name, description, ", "selection."],
    f"{NAMES}sweep = 'sideways'": ["Allowed: as fixed, down, up."],
    f"{NAMES}size = 1": ["Allowed: name, systems, duration, ", "again."],
    f"{NAMES}criteria = ['B9']": ["the criteria of x: there is no B9, only B1, B2, B3, B4, B5, B6, B7."],
    f"{NAMES}requirements = ['A4']": ["the requirements of x: there is no A4, only A1, A2, A3."],
    "[criteria.B8]\ntarget = 1\nweight = 1\nunit = 'm'\ntitle = 'x'": ["criteria: there is no B8"],
    "[criteria.B3]\ntarget = 1\nweight = 1\nunit = 'rad/s'\ntitle = 'x'": [
        "criteria: the unit of B3 is N.m, not rad/s"
    ],
    "[uncertainty]\nmass = 0.1": ["uncertainty: there is no mass, only j_m, j, m, "],
    "[systems.soft]\nmass = -1": ["the system soft: there is no mass, only m, k_low, "],
    NAMES.replace("'performance'", "'absent'"): ["no set of systems 'absent'. It has: performance, "],
}
"""Wrong files, and what the message says of them."""

SELECTIONS = ("tests = ['nose']", "poses = [18]", "poses = [-1]")


@pytest.mark.parametrize(
    "text",
    [
        "name = 1",
        "not TOML",
        SETS,
        SHORT,
        *(f"[loop]\n{line}" for line in LOOPS),
        *(f"[selection]\n{line}" for line in SELECTIONS),
    ],
)
def test_files_that_do_not_describe_a_protocol_are_refused(text, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('extends = "paper"\n' + text)
    error = refusal(protocol.load, file)
    assert (error.what, error.where) == ("bad-protocol", str(file)) and error.value == (
        "absent" if text == SETS else ""
    )


@pytest.mark.parametrize("text", TOLD)
def test_what_is_wrong_with_a_file_is_told_with_what_is_allowed(text, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('extends = "paper"\n' + text)
    error = refusal(protocol.load, file)
    assert error.what == "bad-protocol" and all(words in str(error) for words in TOLD[text]), str(error)


def test_a_file_of_its_own_needs_the_papers_value_of_each_criterion(tmp_path):
    file = tmp_path / "mine.toml"
    whole = (resources.files("orchestrator.benchmark") / "protocols" / "paper.toml").read_text()
    assert re.search(r"^V = .*$", whole, re.MULTILINE)
    file.write_text(re.sub(r"^V = .*$", "", whole, flags=re.MULTILINE))
    assert "reference has no value of V" in str(refusal(protocol.load, file))


@pytest.mark.parametrize(("q_a1", "q_a2", "name"), [(-91, 0, "q_a1"), (181, 0, "q_a1"), (0, 81, "q_a2")])
def test_poses_outside_the_workspace_are_refused(q_a1, q_a2, name):
    error = refusal(cases.configuration, PAPER, math.radians(q_a1), math.radians(q_a2))
    assert (error.what, error.where) == ("outside-workspace", name)


@pytest.mark.parametrize("name", protocol.names())
@pytest.mark.parametrize("seed", [0, 7, 2**63])
def test_a_case_tells_the_seed_that_it_was_made_with(name, seed):
    """A verification names its draws by it; also where other words follow those that all streams have."""
    assert {cases.seed_of(case) for case in cases.cases(protocol.load(name), NOMINAL, seed)} == {seed}


def test_the_words_of_a_seed_have_an_order_that_stays():
    """Another one would draw other systems and noise."""
    (first, *_) = cases.cases(protocol.load("quick"), NOMINAL, 5)
    words = cases.SeedWords(seed=5, pose=1, system=zlib.crc32(b"compliant"), purpose=cases.NOISE)
    assert first.system.name == "compliant"
    assert first.scenario.sensor.noise.seed == (5, 1, words.system, 1) == tuple(words)
