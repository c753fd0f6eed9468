"""Why requirements are not met or not judged: laws of the verdict, and the lines as a user reads them.

After a change of words, look at the difference that ``REFRESH=1 python -m pytest tests/test_reasons.py`` makes to
``snapshots/reasons.txt``.
"""

import io
import json
from collections import Counter
from itertools import groupby
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from markupsafe import escape
from msgspec.structs import replace
from rich.console import Console
from support.reports import head_of, results_of, scaled, searched, stored, unbroken, verified
from support.results import RULES, TABLE_2, everything, result
from support.snapshots import snapshot

from orchestrator.benchmark.results import Measurements
from orchestrator.benchmark.scorecard import score
from orchestrator.benchmark.tally import UNJUDGED, Failure, Outcome, merged, reason, tally
from orchestrator.cli.finished import compare, report
from orchestrator.cli.guard import EXIT_INCOMPLETE, EXIT_NOT_JUDGED, EXIT_OK, guarded
from orchestrator.codec import from_json, to_json
from orchestrator.documents.document import Displayable
from orchestrator.documents.evaluation import Evaluation
from orchestrator.documents.scorecard import reasons
from orchestrator.documents.spread import spread_of, spread_reasons
from orchestrator.documents.verification import Verification, differences, verification_reasons
from orchestrator.documents.wording import Reason
from orchestrator.errors import Crash
from orchestrator.loop.trajectory import Status
from orchestrator.search.findings import RequirementSearched
from orchestrator.views.page import page_html
from orchestrator.views.terminal import show

GOOD = everything(TABLE_2, range(4))
OF_FOUR = replace(
    RULES, cases=len(GOOD), tests=tuple(replace(test, cases=4 * test.cases // 18) for test in RULES.tests)
)
"""The rules of a protocol with the first four configurations."""

FAILURES = tuple(name for name in get_args(Failure) if name != "given up")  # which follows from others
OUTCOMES = ("holds", *FAILURES, *UNJUDGED)
outcomes = st.lists(st.sampled_from(OUTCOMES), max_size=12)


def ended(case, how: str):
    """``case``, ended so."""
    if how == "holds":
        return case
    if how in ("limit cycle", "no rest"):
        status = Status.DONE if how == "limit cycle" else Status.UNSTABLE
        return result(case.configuration.index, case.system, case.test, {}, 3e-5, status)
    status = Status.UNSTABLE if how == "left the workspace" else Status(how)
    return replace(case, status=status, message=f"it {how}", measurements=Measurements())


def with_ends(ends: dict[str, str], cases=GOOD):
    """``cases``, those named ``ended`` as it says; those ``not run`` are left out."""
    kept = [case for case in cases if ends.get(case.id) != "not run"]
    return [ended(case, ends.get(case.id, "holds")) for case in kept]


ends = st.dictionaries(st.sampled_from([case.id for case in GOOD]), st.sampled_from(OUTCOMES), max_size=8)


@given(found=outcomes, more=st.integers(0, 5))
def test_counts_add_up_and_give_the_verdict(found: list[Outcome], more):
    one = tally(found, len(found) + more)
    counts = Counter({"not run": more})
    counts.update(found)
    assert one.cases == len(found) + more == counts.total()
    assert {**one.failed, **one.not_judged} == {name: n for name, n in counts.items() if n and name != "holds"}
    assert one.failed.keys() <= {*FAILURES} and one.not_judged.keys() <= {*UNJUDGED}
    if set(found) & {*FAILURES}:
        assert one.passed is False
    else:
        assert one.passed is (None if more or not found or set(found) & {*UNJUDGED} else True)
    words = reason(one)
    assert (words == "") is (one.passed is True)
    if one.failed:
        assert words.startswith(f"{sum(one.failed.values())} of {one.cases} cases ")


@given(found=outcomes, lost=st.sampled_from(UNJUDGED))
def test_a_case_that_is_not_judged_never_helps(found, lost):
    before, after = tally(found, len(found)), tally([*found, lost], len(found) + 1)
    assert after.passed is (False if before.passed is False else None)
    assert before.failed == after.failed


@given(draws=st.lists(outcomes, max_size=4))
def test_a_tally_over_draws_is_that_of_all_their_cases(draws):
    together = [outcome for draw in draws for outcome in draw]
    assert merged(tally(draw, len(draw)) for draw in draws) == tally(together, len(together))


@settings(max_examples=60)
@given(ends=ends, chance=st.randoms())
def test_a_scorecard_counts_its_cases_in_any_order(ends, chance):
    cases = with_ends(ends)
    card = score(OF_FOUR, cases)
    assert score(OF_FOUR, chance.sample(cases, len(cases))).stability == card.stability
    for name, entry in card.stability.items():
        tests = {test.name for test in OF_FOUR.tests if name in test.requirements}
        asked = [case for case in GOOD if case.test in tests]
        counts = Counter(ends.get(case.id, "holds") for case in asked)
        assert entry.tally.cases == len(asked)
        assert {**entry.tally.failed, **entry.tally.not_judged} == {k: n for k, n in counts.items() if k != "holds"}
        assert entry.passed is entry.tally.passed
        parts = [verdict for _, verdict in entry.by_role(name)]
        assert (entry.passed is False) is any(verdict.passed is False for verdict in parts)
        assert (entry.passed is True) is all(verdict.passed is True for verdict in parts)
        if entry.passed is False:
            assert entry.tally.first == entry.worst_case and ends[entry.worst_case] in FAILURES
        elif entry.tally.first:
            assert ends[entry.tally.first] in ("skipped", "lost")


@settings(max_examples=40)
@given(ends=ends, victim=st.sampled_from(GOOD), how=st.sampled_from(UNJUDGED))
def test_losing_a_case_makes_nothing_met(ends, victim, how):
    """A verdict "not met" stays unless its only failure is lost; nothing becomes "met"."""
    before, after = (score(OF_FOUR, with_ends(each)).stability for each in (ends, {**ends, victim.id: how}))
    for name in before:
        assert after[name].passed is before[name].passed or after[name].passed is None
    if ends.get(victim.id, "holds") not in FAILURES:
        assert all(after[name].passed is False for name in before if before[name].passed is False)


def test_results_that_do_not_say_how_many_cases_a_test_has_are_judged_if_they_are_whole():
    unknown = replace(OF_FOUR, tests=tuple(replace(test, cases=None) for test in OF_FOUR.tests))
    assert score(unknown, GOOD).stability == score(OF_FOUR, GOOD).stability
    part = score(unknown, GOOD[:-1]).stability
    assert {entry.passed for entry in part.values()} == {None} and part["A1"].tally.not_judged == {"not run": 1}


# The lines.


def results_with(ends: dict[str, str], **changes):
    return results_of(with_ends(ends), rules=OF_FOUR, **changes)


def gains(how: str, count: int) -> dict[str, str]:
    """So many cases of A1 ended so."""
    return dict.fromkeys([case.id for case in GOOD if case.test == "gain_1"][-count:], how)


DELAYED = "c02.sticky.delay_2"
RUNS = {
    "met": {},
    "timeouts": gains("timeout", 3),
    "several kinds": gains("crashed", 1) | {"c01.sticky.gain_1": "left the workspace", DELAYED: "limit cycle"},
    "limit cycles": gains("limit cycle", 2) | {DELAYED: "no rest"},
    "lost": gains("lost", 1),
    "skipped and lost": gains("skipped", 4) | {DELAYED: "lost"},
    "failed and skipped": {DELAYED: "error"} | gains("skipped", 5),
    "a part of the cases": {case.id: "not run" for case in GOOD if case.configuration.index or case.test == "gain_2"},
}
COMPLETENESS = dict.fromkeys(("timeouts", "several kinds"), "incomplete") | dict.fromkeys(
    ("lost", "skipped and lost", "failed and skipped"), "not judged"
)


def printed(document: Displayable) -> str:
    console = Console(file=io.StringIO(), emoji=False, width=100)
    show(document.summary(), console)
    return console.file.getvalue()


def test_lines_are_those_of_the_snapshot():
    told = {name: [*reasons(results_with(ends))] for name, ends in RUNS.items()}
    told["seeds"] = [*spread_reasons(SPREAD)]
    told["verification"] = [*verification_reasons(verification(*DRAWS))]
    text = "".join("\n    ".join([name, *map(str, lines)]) + "\n\n" for name, lines in told.items())
    assert text == snapshot("reasons.txt", text)


@pytest.mark.parametrize("name", RUNS)
def test_every_output_has_the_line(name, tmp_path):
    results = results_with(RUNS[name])
    lines = [*reasons(results)]
    failing = {name for name, entry in results.stability.items() if not entry.passed}
    assert [line.text[:2] for line in lines] == sorted(failing)
    run = Evaluation(results)
    text, fragment = printed(run), run._repr_html_()
    page = unbroken(page_html(run.page()))
    for line in map(str, lines):
        assert line in text.splitlines()
    for line in lines:
        assert str(escape(line)) in page and str(escape(line)) in fragment
    for entry in results.stability.values():
        assert entry.reason in text
    assert stored(tmp_path, results, ()).results == results
    assert results.completeness == COMPLETENESS.get(name, "complete")
    expected = EXIT_NOT_JUDGED if results.completeness == "not judged" else EXIT_OK
    (tmp_path / "other").mkdir()
    stored(tmp_path / "other", scaled(1.0), ())
    assert compare([str(tmp_path), str(tmp_path / "other"), "--output-dir", str(tmp_path / "out")]) == expected
    assert report([str(tmp_path), "--no-report"]) == expected


def test_every_case_that_is_not_done_stands_in_the_report_with_status_and_message():
    results = results_with(gains("skipped", 3) | RUNS["several kinds"] | {"c00.compliant.noise": "lost"})
    page = page_html(Evaluation(results).page())
    table = page[page.index('id="failures"') :]
    rows = table[table.index("<tbody>") : table.index("</tbody>")].split("<tr>")[1:]
    left = [case for case in results.cases if case.status is not Status.DONE]
    assert len(rows) == len(left) == 5
    for row, case in zip(rows, left, strict=True):
        assert case.id in row and case.message in row
        assert f"{'✗' if case.judged else '–'} {case.status.value}<" in row


# Several seeds.

HEAD = head_of(seed=None, rules=OF_FOUR)
SEEDS = [results_with(RUNS[name], seed=seed) for seed, name in ((1, "met"), (2, "timeouts"), (3, "lost"))]
SPREAD = spread_of([1, 2, 3], SEEDS, HEAD)


def test_over_seeds_a_failure_counts_and_a_lost_case_leaves_no_verdict():
    assert (SPREAD.unfinished, [score.seed for score in SPREAD.incomplete]) == ((2, 3), [2, 3])
    assert {name: SPREAD.passed(name) for name in SPREAD.requirements} == {"A1": False, "A2": True, "A3": False}
    assert (SPREAD.requirements["A1"].seeds, SPREAD.requirements["A1"].of) == (1, 2)
    assert from_json(to_json(SPREAD), type(SPREAD)) == SPREAD and not SPREAD._problem()
    lost = spread_of([1, 3], SEEDS[::2], HEAD)
    assert lost.passed("A1") is None and lost.passed("A2") is True and lost.completeness == "not judged"
    assert spread_of([1], SEEDS[:1], HEAD).completeness == "complete" and "judged" in printed(lost)
    assert "A1 not judged with 1 of 2 seeds (seed 3)" in lost._repr_html_()


# Verifications.

DRAWS = (RUNS["timeouts"], RUNS["met"], RUNS["lost"] | {DELAYED: "lost"})


def verification(*draws: dict[str, str], reference: dict[str, str] | None = None) -> Verification:
    """A certificate of draws whose cases ended so."""
    cases = [with_ends(own) for own in draws]
    return verified(cases, with_ends(RUNS["limit cycles"]), with_ends(reference or {}), OF_FOUR)


def test_a_verification_says_how_each_case_ended(tmp_path):
    found = verification(*DRAWS)
    assert Verification.load(found.save(tmp_path)) == found
    ended = {(case.id, case.seed): (case.status, case.message) for case in found.cases}
    assert len(ended) == len(found.cases) == 3 * len(GOOD)
    for draw, own in zip(found.draws, DRAWS, strict=True):
        for id, how in own.items():
            assert ended[id, draw.seed] == (Status(how), f"it {how}")
    assert {len([*group]) for _, group in groupby(found.cases, key=lambda case: case.seed)} == {len(GOOD)}
    assert len(found.strict.cases) == len(GOOD) and len(found.references["PID"].cases) == 3 * len(GOOD)
    written = json.loads((tmp_path / "verification.json").read_text())
    assert {frozenset(case) for case in written["cases"] if case["status"] == "done"} == {
        frozenset(("id", "seed", "status", "time"))
    }
    words = replace(found, cases=tuple(replace(case, message=case.message and "other words") for case in found.cases))
    assert differences(found, words) == ((), ())
    other = replace(found, cases=(replace(found.cases[0], status=Status.LOST), *found.cases[1:]))
    assert [line.split(":")[0] for line in differences(found, other)[0]] == ["cases.0.status"]


def test_over_draws_a_failure_counts_and_a_lost_case_leaves_no_verdict(capsys):
    found = verification(*DRAWS).requirements
    assert {name: entry.passed for name, entry in found.items()} == {"A1": False, "A2": None, "A3": False}
    assert found["A1"].failed_draws == 1 and found["A1"].tally.failed == {"timeout": 3}
    assert found["A1"].tally.not_judged == {"lost": 1} and found["A1"].tally.cases == 3 * 24
    assert found["A2"].worst_case.id == DELAYED == found["A2"].tally.first and found["A2"].worst_case.value is None
    assert found["A2"].worst_case.seed == verification(*DRAWS).draws[2].seed


SKIPPED = dict.fromkeys([case.id for case in GOOD if case.test == "delay_2"], "skipped")
"""All cases of A2, as after failures in others."""


def test_in_a_verification_what_was_skipped_after_failures_has_failed_everywhere():
    """Which cases fail and which are skipped follows from their order; the verdict and its words do not."""
    found = verification(RUNS["timeouts"] | SKIPPED)
    assert {name: entry.passed for name, entry in found.requirements.items()} == {"A1": False, "A2": False, "A3": False}
    assert found.requirements["A1"].reason.startswith("3 of 24 cases ended with `timeout`, first")
    assert "cases ended with `skipped` after other failures, first" in found.requirements["A2"].reason
    assert found.requirements["A2"].failed_draws == 1 and not found.rank.holds and not found._problem()
    text = printed(found)
    assert "not judged" not in text and "verify again" not in text and text.count("A2 not met in 1 of 1 draws") == 1


@pytest.mark.parametrize(
    ("draws", "reference", "completeness"),
    [
        ([RUNS["met"]], None, "complete"),
        ([RUNS["limit cycles"]], None, "complete"),
        ([RUNS["timeouts"], {}], None, "incomplete"),
        ([RUNS["timeouts"] | SKIPPED, {}], None, "incomplete"),
        ([SKIPPED], None, "incomplete"),
        ([RUNS["lost"], {}], None, "not judged"),
        ([{"c00.compliant.noise": "lost"}], None, "not judged"),
        ([{}], RUNS["lost"], "not judged"),
        ([{}], RUNS["timeouts"], "complete"),
    ],
)
def test_how_far_a_verification_is_judged(draws, reference, completeness):
    found = verification(*draws, reference=reference)
    assert found.completeness == completeness
    text = printed(found)
    for line in verification_reasons(found):
        assert str(line) in text.splitlines()
    assert ("PID: A1 not judged" in text) is (reference is RUNS["lost"])


def test_a_certificate_whose_cases_contradict_it_is_refused():
    found = verification(*DRAWS)
    assert not found._problem()
    assert "complete" in replace(found, complete=True)._problem()
    met = {name: replace(entry, passed=True) for name, entry in found.requirements.items()}
    assert "verdict" in replace(found, requirements=met)._problem()


# Others.


def test_a_search_of_which_simulations_were_lost_is_not_judged():
    lost = RequirementSearched(None, "quiet", 1e-6, 1.0, 3.0, 0, 0, "")
    found = replace(searched(), requirements={"A1": lost})
    assert (found.completeness, searched().completeness) == ("not judged", "complete")
    assert found.broken == () and "A1 not judged" in repr(found) and "not judged" in found._repr_html_()
    crashed = replace(lost, passed=False, kind="no verdict", status=Status.CRASHED)
    assert "a simulation ended with crashed" in replace(found, requirements={"A1": crashed})._repr_html_()


@pytest.mark.parametrize(("what", "code"), [("killed", EXIT_NOT_JUDGED), ("", EXIT_INCOMPLETE)])
def test_a_single_simulation_that_somebody_else_ended_is_not_judged(what, code, capsys):
    def command(_):
        raise Crash("it ended", what)

    assert guarded(command, []) == code


def test_a_line_is_whole_or_in_its_parts():
    assert str(Reason("A1 not met: why", "command")) == "A1 not met: why; repeat with command"
    assert str(Reason("A1 not judged: why", advice="do it again")) == "A1 not judged: why; do it again"
