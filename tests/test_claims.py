"""Each row of the leaderboard has the worst that is known, whoever found it, and each command gives what it is for."""

import json
import re
import shlex
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import build_fmus
from benchmarks import counterexamples, leaderboard
from benchmarks import leaderboard_tables as tables
from benchmarks.claims import Claim, claims, counting, known, name_of
from orchestrator import Benchmark
from orchestrator.benchmark.results import rules
from orchestrator.benchmark.scorecard import score
from orchestrator.search.arms import lists

FIGURES = {name_of(each): each for each in json.loads(leaderboard.FIGURES.read_text(encoding="utf-8"))}
STRICT = Benchmark("strict").rules
REPEATABLE = {claim.command: claim for claim in claims() if claim.command.startswith(counterexamples.COMMAND)}
REQUIREMENTS, WORST, MARGINS = ("A1", "A2", "A3"), ("B5", "B6", "B7"), ("gain_1", "gain_2", "delay_1", "delay_2")


def row(page: Path, name: str) -> dict[str, str]:
    """The cells of a controller's rows in the tables of a page, by the head of their column."""
    cells: dict[str, str] = {}
    for table in re.findall(r"(?:^\|.*\n)+", page.read_text(encoding="utf-8"), re.M):
        head, *lines = ([cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines())
        for line in lines:
            if line[0].startswith(f"[{name}]"):
                cells |= dict(zip(head, line, strict=True))
    return cells


@pytest.mark.parametrize("claim", claims(), ids=lambda claim: f"{claim.controller}-{claim.figure}-{claim.value}")
def test_a_claim_is_about_a_controller_as_it_is(claim):
    """If its cases are others now, repeat the command of the claim, and keep it with the new hash or remove it."""
    assert claim.cases == FIGURES[claim.controller]["cases"]
    assert claim.figure in ("V", *REQUIREMENTS, *WORST, *MARGINS)
    assert (claim.value is None) == (claim.figure in REQUIREMENTS)


@pytest.mark.parametrize("claim", claims(), ids=lambda claim: f"{claim.controller}-{claim.figure}-{claim.value}")
def test_the_tables_show_nothing_better_than_a_claim(claim):
    short, whole = row(tables.README, claim.controller), row(tables.BOARD, claim.controller)
    if claim.figure == "V":
        for cell in (short["V found (at least)"], whole["V found (at least)"]):
            assert float(re.findall("[0-9.]+", cell)[0]) >= claim.value
    elif claim.figure in REQUIREMENTS:
        assert claim.figure in short["requirements"] and "fail" in short["requirements"]
        assert f"{claim.figure} ✗" in whole["found"]
        assert float(re.findall("[0-9.]+", whole["radius"])[1]) <= 1.0
    elif claim.figure in WORST[:2]:
        head, factor = {"B5": ("B5 mm", 1e3), "B6": ("B6 s", 1.0)}[claim.figure]
        assert float(whole[head]) >= float(f"{factor * claim.value:.3g}")  # as tables show it
    elif claim.figure in MARGINS:
        factor = 1e3 if claim.figure.startswith("delay") else 1.0
        shown = whole["delay ms" if factor > 1.0 else "gain"].split(" and ")[int(claim.figure[-1]) - 1]
        assert float(shown) <= claim.value * factor * (1.0 + 1e-12)


def test_where_others_found_more_the_own_search_is_shown_too():
    own = FIGURES["RobustLQG"]["robustness"]["cost"]
    assert f"(own search: {own:.1f})" in row(tables.README, "RobustLQG")["V found (at least)"]
    assert "own search" not in row(tables.README, "TunedPID")["V found (at least)"]


claimed = st.one_of(
    st.builds(dict, figure=st.just("V"), value=st.floats(1.0, 400.0)),
    st.builds(dict, figure=st.sampled_from(WORST), value=st.floats(1e-4, 0.1)),
    st.builds(dict, figure=st.sampled_from(MARGINS), value=st.floats(1e-3, 10.0)),
    st.builds(dict, figure=st.sampled_from(REQUIREMENTS)),
)


@given(st.sampled_from(list(FIGURES)), st.lists(claimed, max_size=6))
def test_what_is_known_is_the_worst_of_the_own_search_and_all_claims(name, made):
    figures = FIGURES[name]
    others = [Claim(controller=name, cases="", by="somebody", date="", **each) for each in made]
    foreign = Claim(controller="another", cases="", figure="V", by="somebody", date="", value=1e3)
    own, worst = figures["robustness"], known(figures, [*others, foreign])["robustness"]
    values = {key: [each["value"] for each in made if each["figure"] == key] for key in ("V", *WORST, *MARGINS)}
    assert worst["own_cost"] == own["cost"] and worst["cost"] == max([own["cost"], *values["V"]])
    for key in WORST:
        assert worst["worst_case"][key]["value"] == max([own["worst_case"][key]["value"], *values[key]])
    for key in MARGINS:
        kept = [] if own["margins"][key]["value"] is None else [own["margins"][key]["value"]]
        assert worst["margins"][key]["value"] == min([*kept, *values[key]], default=None)
    failing = {key for key, entry in own["requirements"].items() if entry["passed"] is False}
    failing |= {each["figure"] for each in made} & set(REQUIREMENTS)
    assert {key for key, entry in worst["requirements"].items() if entry["passed"] is False} == failing
    for part, missed in (("cost", worst["cost"] > 100.0), ("stability", bool(failing))):
        assert not missed or worst["radius"][part] <= 1.0
        assert own["radius"][part] is None or worst["radius"][part] <= own["radius"][part]
    assert counting(figures, [foreign]) == {}


def test_of_equal_claims_that_which_can_be_repeated_counts():
    alike = [Claim(controller="RobustLQG", cases="", figure="gain_1", by="", date="", value=2.0) for _ in range(2)]
    with_command = Claim(**{**{name: getattr(alike[0], name) for name in alike[0].__struct_fields__}, "command": "x"})
    for order in ([with_command, *alike], [*alike, with_command]):
        assert counting(FIGURES["RobustLQG"], order)["gain_1"].command == "x"


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("command", REPEATABLE, ids=lambda command: REPEATABLE[command].figure)
def test_the_command_of_a_claim_gives_what_is_claimed(command, fmu_folder):
    """By the command line itself, with the figures that are kept to the last bit; A3 fails wherever A2 does."""
    named = [claim for claim in claims() if claim.command == command]
    result = counterexamples.repeated(command, counterexamples.named_in(command, fmu_folder))
    verdicts = score(rules(STRICT), [result]).stability
    figures = result.measurements
    for claim in named:
        kept = (claim.limit_cycle, claim.frequency, claim.rest_error)
        assert kept == (figures.limit_cycle, figures.limit_cycle_frequency, figures.rest_error)
        if claim.figure in REQUIREMENTS:
            assert verdicts[claim.figure].passed is False and verdicts[claim.figure].kind == claim.kind
            assert "--delay" not in command and "--gain" not in command, "the loop of the test itself"
        elif claim.figure in WORST:
            assert getattr(figures, claim.figure) == claim.value
        else:
            assert counterexamples.fails(result, STRICT) and result.test == claim.figure
            kind, axis = claim.figure.split("_")
            words = shlex.split(command)
            given_value = float(words[words.index(f"--{kind}") + int(axis)])
            base = float(STRICT.loop.delay) if kind == "delay" else 0.0
            assert given_value == pytest.approx(base + claim.value, rel=1e-12)


@pytest.mark.needs("compiler")
def test_the_arm_of_a_failure_lies_within_the_tolerances_and_fails_with_other_noise(fmu_folder):
    (command,) = {claim.command for claim in claims() if claim.figure == "A2"}
    words = shlex.split(command)
    nominal = Benchmark("strict").nominal
    for entry in words[words.index("--plant-set") + 1].split(","):
        name, value = entry.split("=")
        width = STRICT.uncertainty[name.partition("[")[0]]
        assert abs(float(value) / nominal[name] - 1.0) <= width * (1.0 + 1e-12)
    file = build_fmus.build("RobustLQG", fmu_folder)
    result = counterexamples.repeated(command, file, seed=7)
    assert counterexamples.fails(result, STRICT) and result.measurements.rest_error > 0.2


def test_v_of_the_list_is_that_of_its_claim():
    """V of the values in the list, with B1 to B4 as on ``strict``, which no arm of the list can raise by much."""
    (claim,) = (each for each in claims() if each.command == "python benchmarks/counterexamples.py")
    list_ = lists()["continued"]
    strict = FIGURES[claim.controller]["strict"]["criteria"]
    shares = [strict[key]["share"] for key in ("B1", "B2", "B3", "B4")]
    for key, arms in list_.items():
        target = STRICT.criteria[key]
        shares.append(target.weight * sum(arm["value"] for arm in arms) / len(arms) / target.target)
    assert sum(shares) == pytest.approx(claim.value, abs=0.1)


def test_what_a_former_search_found_beyond_the_present_one_becomes_a_claim(fmu_folder, monkeypatch):
    monkeypatch.setattr(leaderboard, "FMUS", fmu_folder)
    before = FIGURES["RobustLinearLQG"]
    build_fmus.build("RobustLinearLQG", fmu_folder)
    found = before["robustness"]
    further = {**found["margins"]["delay_1"], "value": 0.0025}
    now = {**before, "robustness": {**found, "margins": {**found["margins"], "delay_1": further}}}
    (claim,) = leaderboard.found_before(before, now)
    assert (claim.figure, claim.value, claim.kind) == ("delay_1", found["margins"]["delay_1"]["value"], "unstable")
    assert claim.command == found["margins"]["delay_1"]["command"] and claim.seeds_tried == 8 >= claim.seeds_failed > 0
    assert known(now, [claim])["robustness"]["margins"]["delay_1"]["value"] == claim.value


def test_a_former_search_that_found_nothing_more_makes_no_claim():
    for figures in FIGURES.values():
        assert leaderboard.found_before(figures, figures) == []
        assert leaderboard.found_before(figures, {**figures, "cases": "of another controller"}) == []
