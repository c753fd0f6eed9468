"""The search for the worst case: it finds what was hidden, repeats itself, and its commands repeat what it found."""

import math
import shlex
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace as changed
from support.refusals import refusal

from orchestrator import Benchmark, Controller, Robustness
from orchestrator.benchmark.cases import cases as cases_of
from orchestrator.benchmark.metrics import case_result, expected
from orchestrator.benchmark.protocol import load
from orchestrator.benchmark.results import Judgement, Measurements, rules
from orchestrator.cli import simulate
from orchestrator.cli.finished import report
from orchestrator.cli.simulate import variation
from orchestrator.codec import to_json
from orchestrator.documents import recording
from orchestrator.errors import InputError
from orchestrator.loop.random_streams import stable_stream
from orchestrator.loop.trajectory import Status
from orchestrator.search import answers, arms, moves
from orchestrator.search.answers import costs, effects, requirements
from orchestrator.search.by_pose import ELITE, Elites, Peak
from orchestrator.search.descent import Levels, descend, race
from orchestrator.search.history import Ask, History, side_by_side
from orchestrator.search.hunt import Hunt
from orchestrator.search.margins import lowered, margins
from orchestrator.search.member import (
    Member,
    case_of,
    changes,
    cost,
    loose,
    names,
    of_case,
    parameters,
    possible,
    spelled,
)
from orchestrator.search.radius import radius
from orchestrator.search.short import short
from orchestrator.search.stages import search
from orchestrator.search.target import NICHES, Target, fails, niches, scores_of, suspect, targets
from orchestrator.study.requests import answered
from plant_fmu.flexible_manipulator.coefficients import arm as links_of
from plant_fmu.flexible_manipulator.elementary import sin_cos
from plant_fmu.flexible_manipulator.kinematics import tool_torque
from plant_fmu.flexible_manipulator.parameters import NOMINAL

STRICT = load("strict")
B6, B7, GAIN, DELAY = (
    next(target for target in targets(STRICT) if target.name == name) for name in ("B6", "B7", "gain_2", "delay_2")
)
LIST = cases_of(STRICT, NOMINAL, 0)
CORNER = {name: -1.0 if place % 3 else 1.0 for place, name in enumerate(names(STRICT))}
POSES = tuple(dict.fromkeys(of_case(case).q_a for case in LIST))


def run(asking, of, told=lambda *known: True):
    """The result of a part of a search: the figures of all simulations are 0 but those that ``of(member)`` gives, and
    ``told(stage, spent)`` says whether to go on."""

    def result(member):
        case = case_of(member, STRICT, NOMINAL)
        figures = {name: True if name == "settled" else 0.0 for name in expected(STRICT, case)} | of(member)
        return case_result(case, Judgement(status=Status.DONE, time=26.0, measurements=Measurements(**figures)))

    def answer(request):
        if isinstance(request, Ask):
            return [result(member) for member in request.members]
        return told(request.stage, request.spent)

    return answered(asking, answer)


def matches(member):
    return sum(value == CORNER[name] for name, value in member.deviations)


def hidden(member, step=0.4):
    """B6 grows by ``step`` [s] with every sign that is that of the corner."""
    return {"B6": step * matches(member)} if STRICT.test(member.test).criteria else {}


# The search


def hunt_of(budget, listed=True, only=None, restarts=1, known=False):
    """A search from the list of ``strict``, or from the nominal system; and from the arms ``known``."""
    members = [of_case(case) for case in LIST] if listed else []
    chosen = only or targets(STRICT)
    return Hunt(History(STRICT), rules(STRICT), members, POSES, chosen, lambda member: "", budget, restarts, known)


def test_a_hidden_corner_is_found_at_every_pose_from_the_nominal_system():
    hunt = hunt_of(2000, listed=False, only=[B6])
    run(search(hunt, 0), lambda member: hidden(member, 0.1))
    largest = {}
    for value, member in hunt.history.severities(B6):
        largest[member.q_a] = max(largest.get(member.q_a, 0.0), value)
    assert {q_a: largest[q_a] for q_a in POSES} == dict.fromkeys(POSES, 0.1 * len(CORNER))
    assert hunt.history.spent <= 2000


def test_what_is_found_between_the_configurations_is_tried_at_them():
    """At a configuration nothing leads to the worst ends of a dozen parameters."""
    corner = dict(tuple(CORNER.items())[:12])

    def of(member):
        right = sum(value == corner.get(name) for name, value in member.deviations)
        return {"B7": 1e-4 * right if member.q_a not in POSES or right == len(corner) else 0.0}

    hunt = hunt_of(4000, only=[B7])
    run(search(hunt, 0), lambda member: of(member) if STRICT.test(member.test).criteria else {})
    found = {member.q_a for value, member in hunt.history.severities(B7) if value == 1e-4 * len(corner)}
    assert found >= set(POSES)


def test_the_force_is_nothing_to_a_simulation_that_ends_before_it():
    hunt = hunt_of(1500, only=[B7])
    run(search(hunt, 0), lambda member: {"B7": 1e-4 * matches(member)} if member.short else {})
    tried = [member for member in hunt.history.result_of if member.short]
    assert len({replace(member, phi_F=None) for member in tried}) == len(tried)


@pytest.mark.parametrize("known", [True, False])
def test_the_worst_arms_of_other_controllers_are_tried_and_confirmed(known):
    """Each of a list is bad for this controller, too, and nothing leads there."""
    planted = {arms.member(arm, B6.test, STRICT): arm["value"] for arm in arms.lists()["lasting"]["B6"]}
    hunt = hunt_of(4000, only=[B6], known=known)
    run(search(hunt, 0), lambda member: {"B6": planted.get(replace(member, short=None), 0.0)})
    found = {member.q_a: value for value, member in hunt.history.severities(B6) if value}
    assert found == ({member.q_a: value for member, value in planted.items()} if known else {})


def test_arms_of_other_controllers_take_a_tenth_of_a_start_at_the_most():
    hunt = hunt_of(1800, only=[B6], known=True)
    tried = []
    run(search(hunt, 0), lambda member: tried.append(member) or {})
    others = set(arms.known(B6, STRICT))
    spent = sum(cost(member, STRICT) for member in tried if member.short and replace(member, short=None) in others)
    whole = 0.4 * (1800 - sum(cost(of_case(case), STRICT) for case in LIST))
    assert 0.0 < spent <= 0.1 * whole


@pytest.mark.parametrize("known", [True, False])
def test_margins_begin_with_arms_that_fail_other_controllers(known):
    """One of them fails from 0.5 ms on, and nothing leads there."""
    planted = next(iter(arms.known(DELAY, STRICT)))

    def of(member):
        same = replace(member, short=None, gain=None, delay=None) == planted
        late = changes(member, STRICT)[1].delay >= Fraction(5, 10000)
        return {"limit_cycle": 1e-4, "limit_cycle_ratio": 1.0} if same and late else {}

    hunt = hunt_of(1500, only=[DELAY], known=known)

    def asked():
        yield from hunt.history.results(hunt.listed)
        return (yield from margins(hunt, 0))

    assert run(asked(), of)["delay_2"].value == (0.5e-3 if known else None)


@pytest.mark.parametrize("known", [True, False])
def test_an_arm_known_is_tried_with_the_change_it_failed_with(known):
    """Its cycle ends again at a larger gain: a search for the margin from above passes it."""
    planted, value = next(iter(arms.known(GAIN, STRICT).items()))

    def of(member):
        same = replace(member, short=None, gain=None, delay=None) == planted
        fails = value <= changes(member, STRICT)[1].gain < 1.2 * value
        return {"limit_cycle": 1e-4, "limit_cycle_ratio": 1.0} if same and fails else {}

    hunt = hunt_of(1500, only=[GAIN], known=known)

    def asked():
        yield from hunt.history.results(hunt.listed)
        return (yield from margins(hunt, 0))

    assert run(asked(), of)["gain_2"].value == (value if known else None)


def test_arms_that_a_protocol_cannot_have_are_left_out():
    """A search of a protocol with an early end of the chirp ended with an error."""
    early = changed(STRICT, disturbance=changed(STRICT.disturbance, t_4=0.5))
    some = arms.known(B6, early)
    assert 0 < len(some) < len(arms.known(B6, STRICT))
    assert all(case_of(arm, early, NOMINAL).scenario.chirp.start <= 0.5 for arm in some)
    slower = changed(STRICT, disturbance=changed(STRICT.disturbance, chirp_frequencies=(0.0, 10.0)))
    assert not arms.known(B6, slower)


def test_each_pose_has_a_worst_member_of_its_own():
    """At half of the poses the opposite corner is the worst: what is good at one is not at the next."""

    def of(member):
        if not STRICT.test(member.test).criteria or member.q_a not in POSES:
            return {}
        return {"B6": 0.4 * (matches(member) if POSES.index(member.q_a) % 2 else len(CORNER) - matches(member))}

    hunt = hunt_of(4000, only=[B6])
    run(search(hunt, 0), of)
    found, listed = costs(hunt)
    largest = 16.0 / 3.0 * len(CORNER)
    assert found > 0.9 * largest > listed


@pytest.mark.parametrize(
    "planted",
    [
        lambda member: all(dict(member.deviations)[name] * CORNER[name] > 0.8 for name in list(CORNER)[:5]),
        lambda member: math.dist(member.q_a, (60.0, 20.0)) < 15.0,
        lambda member: abs(dict(member.deviations)["f_c[1]"] - 0.3) < 0.2,
    ],
    ids=["one combination", "one pose", "inside a range"],
)
def test_a_controller_that_fails_only_there_is_found(planted):
    """From a system that is nowhere near, with nothing but a small motion to follow."""

    def of(member):
        near = (
            matches(member) - math.dist(member.q_a, (60.0, 20.0)) / 20.0 - abs(dict(member.deviations)["f_c[1]"] - 0.3)
        )
        small = 1e-6 * max(0.2, 1.0 + 0.1 * near)
        return {"limit_cycle": 1e-4 if planted(member) else small, "limit_cycle_ratio": 1.0}

    hunt = hunt_of(500, listed=False)
    begin = spelled(Member((0.0, -90.0), DELAY.test, system="slippery"), STRICT, DELAY.test)
    as_it_is = Levels("delay_2", DELAY, (None,), lambda member, _: member)
    found = run(descend(hunt, as_it_is, [begin], 0, hunt.share(1.0)), of)
    assert found is not None and planted(found[1]) and found[1].short is None
    assert fails(hunt.history.result_of[found[1]], STRICT.stability) and hunt.history.spent <= 500


def test_a_margin_is_searched_for_at_the_level_that_fails():
    """What fails at a small change is far from what fails at a large one."""

    def of(member):
        if member.gain is None:
            return {}
        threshold = 6.0 - 3.5 * matches(member) / len(CORNER) if member.gain[0] < 5.5 else 5.5
        return {"limit_cycle": 1e-5 * min(member.gain[0] / threshold, 2.0) ** 4, "limit_cycle_ratio": 1.0}

    gain = next(target for target in targets(STRICT) if target.name == "gain_1")
    scale = [round(0.1 * step, 1) for step in range(11, 100)]
    levels = Levels("gain_1", gain, scale, lambda member, value: replace(member, gain=(value, 1.0)))
    hunt = hunt_of(600, listed=False)
    begin = Member((0.0, -90.0), gain.test, system="slippery")
    step, member = run(descend(hunt, levels, [begin], 0, hunt.share(1.0)), of)
    assert scale[step] < 4.0 and member.gain == (scale[step], 1.0) and matches(member) > 12


def test_a_requirement_fails_where_a_margin_is_smaller_than_what_it_asks_for():
    """A2 asks for all delays up to 1.5 ms: what fails at 1.2 ms and holds at 1.5 ms breaks it."""

    def of(member):
        late = (member.delay or (STRICT.loop.delay, STRICT.loop.delay + Fraction(15, 10000)))[1] - STRICT.loop.delay
        fails = Fraction(12, 10000) <= late < Fraction(14, 10000) or late > Fraction(18, 10000)
        return {"limit_cycle": 1e-4, "limit_cycle_ratio": 1.0} if member.test == DELAY.test and fails else {}

    hunt = hunt_of(3000)

    def asked():
        yield from hunt.history.results(hunt.listed)
        return (yield from margins(hunt, 0)), (yield from requirements(hunt))

    found, verdicts = run(asked(), of)
    assert found["delay_2"].value == 1.2e-3 and {name: entry.passed for name, entry in verdicts.items()} == {
        "A1": True, "A2": False, "A3": False,
    }  # fmt: skip


def failing_beyond(gain, delay):
    """A controller that fails with more gain or delay on axis 2, at the tests' own changes too."""

    def of(member):
        value, late = changes(member, STRICT)[1]
        return {"limit_cycle": 1e-4, "limit_cycle_ratio": 1.0} if value >= gain or late >= delay else {}

    return of


def test_a_margin_that_the_budget_did_not_last_for_is_at_most_what_any_stage_has_met():
    """The list fails A2 at 1.5 ms: no margin is larger, however few steps were tried; the gain fails at 20 or less."""
    hunt = hunt_of(1020)

    def asked():
        yield from hunt.history.results(hunt.listed)
        return (yield from margins(hunt, 0)), (yield from requirements(hunt))

    found, verdicts = run(asked(), failing_beyond(3.0, Fraction(1, 1000)))
    assert verdicts["A2"].passed is False
    assert found["delay_2"].value <= 1.5e-3 and not found["delay_2"].refined
    assert found["gain_2"].value > 3.0 and not found["gain_2"].refined


def test_what_parts_ask_for_side_by_side_is_asked_for_together_and_paid_for_once():
    known, arms, asked = History(STRICT), [Member(q_a, DELAY.test) for q_a in POSES[:4]], []

    def part(*rounds):
        seen = []
        for members in rounds:
            seen += [result.configuration.index for result in (yield from known.results(members))]
        return seen

    def watched(member):
        asked.append(member)
        return {}

    short, none, long = part(arms[:2]), part(), part(arms[1:3], arms[:1], arms[3:])
    assert run(side_by_side([short, none, long]), watched) == [[0, 1], [], [1, 2, 0, 3]]
    assert asked == arms and known.spent == pytest.approx(sum(cost(member, STRICT) for member in arms))


def test_a_margin_that_the_budget_lasts_for_is_refined():
    hunt = hunt_of(4000)

    def asked():
        yield from hunt.history.results(hunt.listed)
        return (yield from margins(hunt, 0))

    found = run(asked(), failing_beyond(3.0, Fraction(1, 1000)))
    assert (found["gain_2"].value, found["delay_2"].value) == (3.0, 1e-3)
    assert found["gain_2"].refined and found["delay_2"].refined


def test_a_loop_that_fails_as_it_is_has_no_margin_beyond():
    hunt = hunt_of(3000)

    def of(member):
        fails = STRICT.test(member.test).criteria and member.system == "slippery"
        return {"limit_cycle": 1e-4, "limit_cycle_ratio": 1.0} if fails and "limit_cycle" in expected_of(member) else {}

    def asked():
        yield from hunt.history.results(hunt.listed)
        return (yield from margins(hunt, 0)), (yield from radius(hunt))

    found, reach = run(asked(), of)
    assert {name: margin.value for name, margin in found.items()} == {
        "gain_1": 1.0, "gain_1_down": 1.0, "delay_1": 0.0, "gain_2": 1.0, "gain_2_down": 1.0, "delay_2": 0.0,
    }  # fmt: skip
    assert reach.stability == 1.0 and not reach.stability_refined


def expected_of(member):
    """The figures that a member's case has."""
    return expected(STRICT, case_of(member, STRICT, NOMINAL))


def test_a_failure_that_the_radius_meets_counts_for_margin_and_requirement():
    """The noise that members of all factors share lets the loop fail at what A2 asks for, where the list holds."""

    def of(member):
        fails = member.test == DELAY.test and member.delay is None and member.deviations
        return {"limit_cycle": 1e-4, "limit_cycle_ratio": 1.0} if fails else {}

    hunt = hunt_of(4000)

    def asked():
        yield from hunt.history.results(hunt.listed)
        before = yield from margins(hunt, 0)
        judged = yield from requirements(hunt)
        yield from radius(hunt)
        return judged, before, (yield from lowered(hunt, before)), (yield from answers.broken_since(hunt, judged))

    judged, before, found, verdicts = run(asked(), of)
    assert before["delay_2"].value is None and found["delay_2"].value == 1.5e-3
    assert judged["A2"].passed and verdicts["A2"].passed is False and verdicts["A1"].passed


def test_a_long_settling_beyond_a_cliff_is_found_by_what_rings_below_the_limit():
    """The controller notices nothing of the arms that settle late: B6 itself says nothing of them from afar."""

    def of(member):
        if not STRICT.test(member.test).criteria:
            return {}
        near = matches(member) / len(CORNER)
        return {"B5": 1e-2, "recovery": 4.0 * near, "B6": 3.0 if near > 0.8 else 1.0 - 0.5 * near}

    hunt = hunt_of(5000, only=[B6])
    run(search(hunt, 0), of)
    assert answers.criteria(hunt)["B6"].value > 2.5


def test_a_search_that_may_not_leave_its_list_finds_nothing_new():
    def of(member):
        return {"B6": len(member.system)} if STRICT.test(member.test).criteria else {}

    hunt = hunt_of(840)
    run(search(hunt, 0), of)
    found, listed = costs(hunt)
    assert found == listed > 0.0 and {member for member in hunt.history.result_of if not member.short} == set(
        hunt.listed
    )


@pytest.mark.parametrize("budget", [939, 1000, 1300, 2000, 6000])
def test_a_budget_is_not_exceeded_and_what_it_cut_short_is_told(budget):
    """With a controller that fails everything beyond some gain and delay, and V above its target near the end."""

    def of(member):
        size = max((abs(value) for _, value in member.deviations), default=1.0)
        late = member.delay is not None and max(member.delay) > Fraction(2, 1000)
        up = member.gain is not None and max(member.gain) > 3.0
        return hidden(member) | ({"limit_cycle": 1e-3, "limit_cycle_ratio": 1.0} if late or up or size > 1.1 else {})

    stages = []
    hunt = hunt_of(budget)

    def whole():
        yield from search(hunt, 0)
        yield from answers.disturbed(hunt, 0)
        yield from effects(hunt)
        known = yield from margins(hunt, 0)
        yield from requirements(hunt)
        return known, (yield from radius(hunt))

    found, reach = run(whole(), of, lambda stage, spent: stages.append((stage, spent)) or True)
    assert hunt.history.spent <= budget and [spent for _, spent in stages] == sorted(spent for _, spent in stages)
    assert hunt.history.spent == pytest.approx(sum(cost(member, STRICT) for member in hunt.history.result_of))
    assert set(hunt.cut_short) <= {stage for stage, _ in stages}
    assert [step.cost for step in hunt.path] == sorted(step.cost for step in hunt.path)
    if budget == 842:
        assert hunt.cut_short and not found and reach is None
    if budget == 6000:
        assert hunt.cut_short == []
        assert {name: margin.value for name, margin in found.items()} == {
            "gain_1": 3.05, "gain_1_down": None, "delay_1": 1.775e-3,
            "gain_2": 3.05, "gain_2_down": None, "delay_2": 1.775e-3,
        }  # fmt: skip
        assert reach.stability == 1.15 and reach.cost is not None


def test_the_worst_member_of_each_criterion_at_each_configuration_is_told():
    hunt = hunt_of(2000)
    run(search(hunt, 0), hidden)
    found = answers.peaks(hunt)
    assert [(peak.configuration, peak.criterion) for peak in found] == [
        (place, name) for place in range(len(POSES)) for name in ("B6", "B5", "B7")
    ]
    for peak in found:
        assert peak.deviations.keys() == CORNER.keys() and max(map(abs, peak.deviations.values())) <= 1.0
    settling = [peak for peak in found if peak.criterion == "B6"]
    assert all(
        peak.value == sum(peak.deviations[name] == CORNER[name] for name in CORNER)
        for peak in settling
        if peak.value > 8.0
    )
    assert sum(peak.value for peak in settling) / len(settling) == pytest.approx(answers.criteria(hunt)["B6"].value)


def test_the_worst_arms_for_b6_are_tried_with_other_noise():
    """Their values are told, and the largest one counts; a small budget tries each pose with a seed before the next."""

    def of(member):
        figures = hidden(member)
        return (
            {**figures, "B6": figures["B6"] * (1.0 + 0.1 * (member.seed if member.seed < 4 else 0))}
            if "B6" in figures
            else figures
        )

    hunt = hunt_of(2500, only=[B6])
    run(search(hunt, 0), of)
    before = {peak.configuration: peak.value for peak in answers.peaks(hunt)}
    run(answers.heard(hunt), of)
    for peak in answers.peaks(hunt):
        assert peak.value >= before[peak.configuration] and len(peak.other_noise) >= 2
        assert list(peak.other_noise) == sorted(peak.other_noise) and peak.other_noise[-1] <= peak.value
    poor = hunt_of(2500, only=[B6])
    run(search(poor, 0), of)
    poor.budget = poor.history.spent + len(POSES) / answers.HEARD
    run(answers.heard(poor), of)
    assert [(peak.seed, peak.other_noise) for peak in answers.peaks(poor)] == [(1, ())] * len(POSES)
    assert poor.cut_short[-1] == "V with other noise"


def test_the_largest_value_may_be_at_a_pose_that_is_no_configuration():
    def of(member):
        return {"B6": 10.0 - math.dist(member.q_a, (-20.0, -70.0)) / 30.0} if STRICT.test(member.test).criteria else {}

    hunt = hunt_of(1500, listed=False, only=[B6])
    run(search(hunt, 0), of)
    worst = hunt.history.worst(B6)
    assert worst is not None and worst.q_a not in POSES and math.dist(worst.q_a, (-20.0, -70.0)) < 10.0


def test_each_start_is_a_search_of_its_own():
    hunt = hunt_of(3000, only=[B6], restarts=3)
    run(search(hunt, 0), hidden)
    assert len(hunt.starts) == 3 and max(hunt.starts) <= costs(hunt)[0]
    stages = [step.stage for step in hunt.path]
    assert stages[0] == "list" and sum(stage.startswith("V by pose, start 2") for stage in stages) == 3


# Short simulations


@pytest.mark.parametrize(
    ("name", "duration", "force"), [("B5", 1.4, 0.5), ("B6", 14.5, None), ("B7", 10.01, None), ("delay_2", 9.0, 0.5)]
)
def test_a_short_simulation_shows_what_it_is_for(name, duration, force):
    target = next(target for target in targets(STRICT) if target.name == name)
    view = short(STRICT, target, 4.0)
    assert (float(view.duration), view.t_1) == (duration, force)
    member = replace(spelled(Member((0.0, -90.0), target.test, system="sticky"), STRICT, target.test), short=view)
    case = case_of(member, STRICT, NOMINAL)
    assert {target.criterion or "limit_cycle"} <= expected(STRICT, case)
    assert cost(member, STRICT) == pytest.approx(duration / 26.0) and not possible(member, STRICT)
    assert case.scenario.pulse.force == case_of(replace(member, short=None), STRICT, NOMINAL).scenario.pulse.force


def test_what_is_not_shorter_is_no_short_simulation():
    assert short(STRICT, B6, 100.0) is None and short(STRICT, Target("B3", B6.test, "B3"), 4.0) is None


@pytest.mark.parametrize(
    ("amplitude", "ratio", "near"),
    [(12e-6, 1.0, True), (56e-3, 0.67, True), (12e-6, 0.4, False), (6e-6, 1.0, False), (200e-6, 0.3, False)],
)
def test_a_small_motion_that_lasts_is_nearer_to_a_failure_than_a_large_one_that_dies(amplitude, ratio, near):
    def ended(amplitude, ratio):
        figures = Measurements(limit_cycle=amplitude, limit_cycle_ratio=ratio, residual_vibration=amplitude)
        return Judgement(status=Status.DONE, time=11.0, measurements=figures)

    assert suspect(ended(amplitude, ratio), STRICT.stability) is near
    lasting, dying = (scores_of(ended(*motion), STRICT.stability) for motion in ((3e-6, 1.0), (300e-6, 0.4)))
    assert lasting.unrest > dying.unrest and lasting.vibration < dying.vibration
    unstable = Judgement(status=Status.UNSTABLE, time=2.0)
    worst, next_to_it = (scores_of(judgement, STRICT.stability) for judgement in (unstable, ended(1e-2, 1.1)))
    assert suspect(unstable, STRICT.stability)
    assert worst.unrest > next_to_it.unrest and worst.vibration > next_to_it.vibration


def test_a_weak_force_has_a_niche_of_its_own():
    figures = Measurements(B5=4e-3, B6=0.4, recovery=2.0)
    weak, other = (
        niches(B6, Judgement(status=Status.DONE, time=16.0, measurements=figures), way) for way in (True, False)
    )
    assert len(weak) == NICHES["B6"] and weak[:-1] == other[:-1] == (2.0, 100.0)
    assert weak[-1] == 2.4 and other[-1] == -math.inf


def test_a_member_has_its_own_begin_of_the_chirp():
    member = replace(Member((0.0, -90.0), B6.test), t_3=0.25)
    assert case_of(member, STRICT, NOMINAL).scenario.chirp.start == member.variation.t_3 == 0.25


# Moves


@given(st.integers(0, 1000))
def test_moves_stay_within_the_uncertainty_and_the_workspace(seed):
    stream = stable_stream((seed,))
    own = spelled(Member((170.0, 75.0), DELAY.test, system="sticky"), STRICT, DELAY.test)
    other = spelled(Member((0.0, -90.0), DELAY.test, system="slippery"), STRICT, DELAY.test)
    for _ in range(5):
        found = [
            moves.turned(own, stream),
            moves.inside(own, stream),
            moves.crossed(own, other, stream),
            moves.moved(own, STRICT, stream),
            moves.with_other_force_direction(own, stream),
            moves.with_weak_force(own, stream),
            moves.with_finely_turned_force(own, stream),
            moves.at_pose(own, (-36.0, 20.0), stream),
            moves.with_other_sweep(own, STRICT),
            moves.with_other_noise(own, stream),
            moves.with_other_chirp_start(own, STRICT, stream),
        ]
        for each in found:
            assert possible(each, STRICT) and dict(each.deviations).keys() == dict(own.deviations).keys()
            case_of(each, STRICT, NOMINAL)  # refuses what lies outside of the workspace
        assert moves.is_weak(found[5]) and 0.0 <= found[-1].t_3 <= 1.0
        before = dict(own.deviations)
        assert all(value in (before[name], -1.0, 1.0) for name, value in found[0].deviations)
        assert moves.with_other_sweep(found[8], STRICT) == own
        own = found[int(stream.randint(len(found)))]


@given(st.integers(0, 1000), st.floats(0.0, 2.0 * math.pi))
def test_a_force_is_as_far_from_the_weakest_direction_at_another_pose(seed, phi_F):
    own = replace(spelled(Member((0.0, -90.0), DELAY.test, system="sticky"), STRICT, DELAY.test), phi_F=phi_F)
    there = moves.at_pose(own, (90.0, 80.0), stable_stream((seed,)))
    assert there.q_a == (90.0, 80.0)
    before, after = (math.cos(2.0 * (each.phi_F - moves.weakest(each.q_a))) for each in (own, there))
    assert after == pytest.approx(before, abs=1e-3)


def test_a_chirp_that_ends_early_begins_before_that():
    own = spelled(Member((0.0, -90.0), B6.test, system="sticky"), STRICT, B6.test)
    early = msgspec.structs.replace(STRICT, disturbance=msgspec.structs.replace(STRICT.disturbance, t_4=0.3))
    stream = stable_stream((1,))
    starts = [moves.with_other_chirp_start(own, early, stream).t_3 for _ in range(50)]
    assert max(starts) <= 0.3 and min(starts) < 0.1


def test_the_weakest_direction_turns_with_the_first_axis():
    turned = [moves.weakest((angle, 80.0)) + math.radians(angle) for angle in (-90.0, 0.0, 33.0, 180.0)]
    assert np.ptp(np.tan(turned)) < 1e-9


@pytest.mark.parametrize("q_a", POSES)
def test_no_force_loads_the_joints_less_than_one_in_the_weakest_direction(q_a):
    arm = links_of(NOMINAL)
    s_1, c_1 = sin_cos(math.radians(q_a[0]))
    s_12, c_12 = sin_cos(math.radians(q_a[0] + q_a[1]))

    def load(angle):
        return math.hypot(*tool_torque(arm, s_1, c_1, s_12, c_12, math.cos(angle), math.sin(angle)))

    assert load(moves.weakest(q_a)) <= min(map(load, np.linspace(0.0, math.pi, 361))) + 1e-9


def test_weak_forces_reach_from_one_side_of_the_weakest_direction_to_the_other():
    own = spelled(Member((18.0, 80.0), B6.test, system="sticky"), STRICT, B6.test)
    pushed = moves.weak_forces(own)
    aside = [math.degrees(each.phi_F - moves.weakest(own.q_a)) for each in pushed]
    assert aside == pytest.approx([-12.0, -6.0, 0.0, 6.0, 12.0], abs=0.5)
    assert all(map(moves.is_weak, pushed)) and not moves.is_weak(replace(own, phi_F=pushed[0].phi_F - 0.02))


@given(st.lists(st.floats(0.0, 10.0), max_size=20))
def test_elites_are_the_best_in_order(values):
    elites, peak = Elites(), Peak(B6, (0.0, 0.0))
    for place, value in enumerate(values):
        elites.take(peak, value, Member((float(place), 0.0), B6.test))
    kept = sorted(values, reverse=True)[:ELITE]
    assert [value for value, _ in elites.by_peak.get(peak, [])] == kept
    assert elites.largest(peak) == (kept[0] if kept else 0.0)


@pytest.mark.parametrize("cost", [95.0, 105.0])
def test_v_passes_its_target_within_the_tolerances_just_if_v_found_does(cost):
    """B6 is in proportion to the tolerances, and which force has the largest depends on the pose."""
    places = {q_a: place for place, q_a in enumerate(dict.fromkeys(of_case(case).q_a for case in LIST))}

    def of(member, largest=1.0):
        if not STRICT.test(member.test).criteria:
            return {}
        size = max(abs(value) for _, value in loose(member, STRICT).deviations)
        worst = member.test == ("disturbance_90", "disturbance_135")[places[member.q_a] % 2]
        return {"B6": largest * size * (1.0 if worst else 0.5)}

    unit, _ = costs(searched(of))
    larger = partial(of, largest=cost / unit)
    hunt = searched(larger)
    assert costs(hunt)[0] == pytest.approx(cost)
    assert run(radius(hunt), larger).cost == pytest.approx(math.floor(100.0 / cost * 20.0 + 1.0) / 20.0)


def searched(of):
    hunt = hunt_of(3000)
    run(hunt.history.results(hunt.listed), of)
    return hunt


@pytest.mark.parametrize(
    ("status", "passed"),
    [
        (Status.CRASHED, False),
        (Status.TIMEOUT, False),
        (Status.ERROR, False),
        (Status.LOST, None),
        (Status.SKIPPED, None),
        (Status.DONE, True),
    ],
)
def test_a_simulation_that_crashed_fails_and_one_that_was_lost_is_not_judged(status, passed):
    """One simulation of A2 ends so; it is repeated with no other noise, nor shown."""
    hunt = searched(lambda member: {})
    struck = next(member for member in hunt.listed if member.test == DELAY.test)
    ended = {"status": status} | ({} if status is Status.DONE else {"measurements": Measurements()})
    hunt.history.result_of[struck] = changed(hunt.history.result_of[struck], **ended)
    found = run(requirements(hunt), lambda member: {})
    assert {name: entry.passed for name, entry in found.items()} == {"A1": True, "A2": passed, "A3": passed}
    tried = {member for member in hunt.history.result_of if member.short is None}
    assert tried == set(hunt.listed) and (struck in hunt.shown) <= (status is Status.DONE)
    assert (found["A2"].status is status) is (passed is not None)


def test_the_same_members_are_tried_again_and_others_with_another_seed():
    def tried(seed):
        hunt = hunt_of(400, listed=False, only=[B6])
        run(search(hunt, seed), hidden)
        return list(hunt.history.result_of)

    assert tried(0) == tried(0) != tried(1)


@given(st.lists(st.integers(0, 40), min_size=1, max_size=30), st.integers(1, 40))
def test_a_race_finds_the_smallest_failing_step(thresholds, steps):
    """A member fails from its threshold on; the scale has ``steps`` steps."""
    members = [Member((float(place), 0.0), "gain_1") for place in range(len(thresholds))]
    scale = [float(step) for step in range(steps)]
    tries = []

    def fail(changed):
        tries.extend(changed)
        return [member.gain[0] >= thresholds[int(member.q_a[0])] for member in changed]
        yield

    found = run(race(members, scale, lambda member, step: replace(member, gain=(step, 1.0)), fail), hidden)
    if min(thresholds) >= steps:
        assert found is None and len(tries) == len(members)
    else:
        step, member = found
        assert step == min(thresholds) == thresholds[int(member.q_a[0])] == member.gain[0]


# Members and their commands


@st.composite
def members(draw):
    angles = st.floats(-90.0, 180.0), st.floats(-180.0, 80.0)
    whole = st.sampled_from([(0.0, -90.0), (18.0, -50.0)])
    ends = st.sampled_from([-1.0, 0.0, 0.3, 1.0])
    disturbed = draw(st.booleans())
    return Member(
        q_a=draw(st.one_of(whole, st.tuples(*angles))),
        test=draw(st.sampled_from(["disturbance_0", "disturbance_45"] if disturbed else ["gain_1", "delay_2"])),
        deviations=tuple((name, draw(ends)) for name in names(STRICT)),
        phi_F=draw(st.none() | st.floats(-7.0, 7.0)),
        sweep=draw(st.none() | st.sampled_from([(0.0, 15.0), (15.0, 0.0)])),
        t_3=draw(st.none() | st.floats(0.0, 1.0)),
        gain=draw(st.none() | st.tuples(st.floats(0.1, 20.0), st.just(1.0))),
        delay=draw(
            st.none() | st.tuples(st.just(Fraction(1, 4000)), st.integers(4, 160).map(lambda k: Fraction(k, 16000)))
        ),
        seed=draw(st.integers(0, 8)),
    )


@given(members())
def test_the_command_of_a_member_makes_its_very_case(member):
    from support.reports import CONTROLLER, PLANT

    from orchestrator.documents.commands import Setting, member_command

    setting = Setting(CONTROLLER, PLANT, "strict", 0, None)
    words = shlex.split(member_command(setting, member, parameters(member, STRICT, NOMINAL)))
    assert words.count("--plant-set") == 1
    given_options = simulate._parser().parse_args(words[2:])
    bench = simulate.options.benchmark(given_options)
    case = bench.varied(simulate._case(bench, given_options), variation(given_options))
    assert case.scenario == case_of(member, STRICT, NOMINAL).scenario


def test_members_of_the_list_are_its_very_cases():
    bench = Benchmark("strict")
    assert all(case_of(of_case(case), STRICT, bench.nominal) == case for case in bench.cases)
    assert len(bench.cases) == STRICT.case_count == 1028


# The whole


TINY = """
extends = "strict"
name = "tiny"
grid = { q_a1_points = 1, q_a2_points = 1, also_deg = [[0.0, -90.0]] }
sets = { all = ["compliant", "sticky"] }
[disturbance]
t_1 = 1.0
t_2 = 1.1
t_4 = 0.9
[stability]
limit_cycle_window = 0.4
rest_window = 0.2
rest_error = 1.0
[[tests]]
name = "disturbance"
systems = "all"
duration = 2.0
criteria = ["B3", "B4", "B5", "B6", "B7"]
requirements = ["A3"]
[[tests]]
name = "noise"
systems = "all"
duration = 0.2
disturbed = false
criteria = ["B1", "B2"]
[[tests]]
name = "delay_2"
systems = "all"
duration = 2.0
axis = 2
delay = "1.5e-3"
requirements = ["A2", "A3"]
"""


@pytest.fixture
def tiny(tmp_path) -> Path:
    file = tmp_path / "tiny.toml"
    file.write_text(TINY, encoding="utf-8")
    return file


@pytest.mark.slow
def test_the_answer_is_the_same_for_any_number_of_processes_and_from_the_store(tiny, quick_pid_file, tmp_path):
    def found(workers, folder):
        stages = []
        answer = Benchmark(workers=workers).robustness(
            Controller(quick_pid_file),
            budget=60,
            protocol=tiny,
            folder=folder,
            on_progress=lambda stage, simulations, *known: stages.append((stage, simulations)),
        )
        still = changed(answer.timing, start="", wall_time=0.0, workers=0, simulation_time=0.0)
        return to_json(changed(answer, head=changed(answer.head, timing=still))), stages, answer

    first, stages, answer = found(2, tmp_path / "a")
    assert (first, stages) == found(1, None)[:2] == found(2, tmp_path / "a")[:2]
    assert stages[0] == ("list", 12) and answer.complete and answer.failures == 0
    assert answer.cost is not None and answer.protocol_cost is not None and answer.cost >= answer.protocol_cost
    assert Robustness.load(tmp_path / "a").cost == answer.cost
    assert all(entry.worst_case.value >= entry.value >= entry.protocol for entry in answer.criteria.values())
    assert {effect.parameter for effect in answer.effects} < set(names(STRICT)), (
        "one by one, as far as the budget lasts"
    )

    recorded = {role: entry for entry in recording.load(tmp_path / "a") for role in entry.about.roles}
    assert {"B5", "B6", "B7", "A2 2", "beside B5", "beside A2 2"} <= set(recorded)
    worst, nominal = recorded["B5"], recorded["beside B5"]
    forced = worst.error[worst.motion[:, 0] >= worst.about.window[0]]
    assert forced.max() == pytest.approx(answer.criteria["B5"].worst_case.value, rel=1e-5) and nominal.error.max() > 0
    same = ("q_a", "test", "force", "chirp")
    assert [getattr(worst.about, name) for name in same] == [getattr(nominal.about, name) for name in same]
    assert report([str(tmp_path / "a")]) == 0
    assert f"Worst case of {quick_pid_file.name}" in (tmp_path / "a" / "report.html").read_text(encoding="utf-8")
    with pytest.raises(InputError, match="holds no evaluation"):
        report([str(tmp_path / "a"), "--mat"])


def test_what_cannot_be_searched_is_refused(quick_pid_file, tmp_path):
    controller = Controller(quick_pid_file)
    assert refusal(Benchmark().robustness, controller, protocol="paper").what == "draws"
    folder = tmp_path / "none"
    assert refusal(Benchmark().robustness, controller, only=["B9"], folder=folder).what == "no-target"
    assert refusal(Benchmark().robustness, controller, budget=838, folder=folder).what == "small-budget"
    few = {"only": ["B6"], "from_list": False, "folder": folder}
    assert refusal(Benchmark().robustness, controller, budget=23, **few).what == "small-budget"
    assert not folder.exists()


def test_when_time_runs_out_what_is_there_is_told_without_margins(tiny, quick_pid_file):
    answer = Benchmark().robustness(Controller(quick_pid_file), budget=60, protocol=tiny, minutes=1e-6)
    assert not answer.complete and not answer.margins and answer.radius is None
    assert answer.criteria["B6"].worst_case.command and answer.requirements["A2"].command
