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
from support.reports import CONTROLLER, PLANT, results_of, scaled, searched, stored
from support.results import RULES, TABLE_2, everything, result
from support.snapshots import snapshot

from orchestrator.benchmark.certificate import Draw, Reference, Score, identity, overall, seeds
from orchestrator.benchmark.results import Measurements
from orchestrator.benchmark.scorecard import score
from orchestrator.benchmark.tally import UNJUDGED, Failure, Outcome, merged, reason, tally
from orchestrator.cli import compare, report
from orchestrator.cli import verify as verify_command
from orchestrator.cli.guard import EXIT_INCOMPLETE, EXIT_NOT_JUDGED, EXIT_OK, guarded
from orchestrator.cli.judged import results_code, shown_code, verification_code
from orchestrator.cli.tables import show_results
from orchestrator.codec import from_json, to_json
from orchestrator.documents.certificates import Verification, differences
from orchestrator.documents.fragments import results_fragment
from orchestrator.documents.reasons import Reason, reasons, spread_reasons, verification_reasons
from orchestrator.documents.report_page import report_html
from orchestrator.documents.run import Run, load_run
from orchestrator.documents.spread import spread_of
from orchestrator.errors import Crash
from orchestrator.loop.trajectory import Status
from orchestrator.search.findings import RequirementFound

GOOD = everything(TABLE_2, range(4))
OF_FOUR = replace(
    RULES, cases=len(GOOD), tests=tuple(replace(test, cases=4 * test.cases // 18) for test in RULES.tests)
)
"""The rules of a protocol with the first four configurations."""

FAILURES, OUTCOMES = get_args(Failure), ("holds", *get_args(Failure), *UNJUDGED)
outcomes = st.lists(st.sampled_from(OUTCOMES), max_size=12)


def ended(case, how: str):
    """``case``, ended so."""
    if how == "holds":
        return case
    if how in ("limit cycle", "no rest"):
        status = Status.DONE if how == "limit cycle" else Status.UNSTABLE
        return result(case.configuration.index, case.system, case.test, {}, (3e-5, 0.0), status)
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
        assert (entry.passed is False) is any(axis.passed is False for axis in entry.axes.values())
        assert (entry.passed is True) is all(axis.passed is True for axis in entry.axes.values())
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
CODES = {"timeouts": 1, "several kinds": 1, "lost": 3, "skipped and lost": 3, "failed and skipped": 3}


def printed(results) -> str:
    console = Console(file=io.StringIO(), emoji=False, width=100)
    show_results(results, console)
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
    text, page, fragment = printed(results), report_html(Run(results)), results_fragment(results)
    for line in map(str, lines):
        assert line in text.splitlines()
    for line in lines:
        assert line.text.replace("`", "") in page and line.text in fragment and str(escape(line.command)) in page
    for entry in results.stability.values():
        assert entry.reason in text
    assert stored(tmp_path, results, ()).results == results
    assert results_code(results) == CODES.get(name, EXIT_OK)
    expected = EXIT_NOT_JUDGED if CODES.get(name) == EXIT_NOT_JUDGED else EXIT_OK
    assert shown_code(results) == expected
    (tmp_path / "other").mkdir()
    stored(tmp_path / "other", scaled(1.0), ())
    assert compare.main([str(tmp_path), str(tmp_path / "other"), "--output-dir", str(tmp_path / "out")]) == expected
    assert report.main([str(tmp_path), "--no-report"]) == expected


def test_every_case_that_is_not_done_stands_in_the_report_with_status_and_message():
    results = results_with(gains("skipped", 3) | RUNS["several kinds"] | {"c00.compliant.noise": "lost"})
    page = report_html(Run(results))
    table = page[page.index('id="failures"') :]
    rows = [row for row in table.split("<tr>") if 'class="message"' in row]
    left = [case for case in results.cases if case.status is not Status.DONE]
    assert len(rows) == len(left) == 5
    for row, case in zip(rows, left, strict=True):
        assert case.id in row and case.message in row
        assert f"{'✗' if case.judged else '–'} {case.status.value}<" in row


def test_results_of_the_older_form_are_read_with_the_verdicts_of_this_one(tmp_path):
    run = stored(tmp_path, results_with(RUNS["timeouts"]), ())
    old = json.loads(to_json(run.results))
    old["schema"] = "flexible-manipulator-results/2"
    for test in old["rules"]["tests"]:
        del test["cases"]
    for entry in old["stability"].values():
        for verdict in (entry, *entry["axes"].values()):
            del verdict["tally"]
    (tmp_path / "results.json").write_text(json.dumps(old))
    found = load_run(tmp_path).results
    assert found.schema == run.results.schema and found.stability == run.results.stability


# Several seeds.

SPREAD = spread_of(
    [1, 2, 3], [results_with(RUNS[name], seed=seed) for seed, name in ((1, "met"), (2, "timeouts"), (3, "lost"))]
)


def test_over_seeds_a_failure_counts_and_a_lost_case_leaves_no_verdict():
    assert (SPREAD.unfinished, [score.seed for score in SPREAD.incomplete]) == ((2, 3), [2, 3])
    assert {name: SPREAD.passed(name) for name in SPREAD.requirements} == {"A1": False, "A2": True, "A3": False}
    assert (SPREAD.requirements["A1"].seeds, SPREAD.requirements["A1"].of) == (1, 2)
    assert from_json(to_json(SPREAD), type(SPREAD)) == SPREAD and not SPREAD._problem()
    lost = spread_of([1, 3], [results_with(RUNS[name], seed=seed) for seed, name in ((1, "met"), (3, "lost"))])
    assert lost.passed("A1") is None and lost.passed("A2") is True and shown_code(lost) == EXIT_NOT_JUDGED
    assert "A1 not judged with 1 of 2 seeds (seed 3)" in lost._repr_html_()
    older = replace(SPREAD, seeds=tuple(replace(each, tallies={}) for each in SPREAD.seeds), incomplete=())
    assert older.passed("A1") is False and [*spread_reasons(older)] == []


# Verifications.

DRAWS = (RUNS["timeouts"], RUNS["met"], RUNS["lost"] | {DELAYED: "lost"})


def verification(*draws: dict[str, str], reference: dict[str, str] | None = None) -> Verification:
    """A certificate of draws whose cases ended so."""
    drawn = seeds("entropy", identity(CONTROLLER.sha256, {}, {}, 0.25e-3), len(draws))

    def scored(ends) -> dict:
        found = overall(OF_FOUR, [(seed, with_ends(own)) for seed, own in zip(drawn, ends, strict=True)])
        costs = [score(OF_FOUR, with_ends(own)).cost for own in ends]
        made = tuple(Draw(seed, cost, "0" * 64) for seed, cost in zip(drawn, costs, strict=True))
        return {**{name: getattr(found, name) for name in Score.__struct_fields__}, "draws": made}

    return Verification(
        **scored(draws),
        strict=overall(OF_FOUR, [(drawn[0], with_ends(RUNS["limit cycles"]))]),
        references={"PID": Reference(**scored([reference or {}] * len(draws)), strict=None, file="PID.fmu")},
        schema=Verification.SCHEMA,
        benchmark="FlexibleManipulator-v2",
        protocol="verification",
        source="published",
        entropy="entropy",
        controller=CONTROLLER,
        sample_time=0.25e-3,
        plant=PLANT,
        code="0" * 64,
        sandbox=True,
        environment={},
        start="",
        wall_time=1.0,
    )


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


@pytest.mark.parametrize(
    ("draws", "reference", "code"),
    [
        ([RUNS["met"]], None, EXIT_OK),
        ([RUNS["limit cycles"]], None, EXIT_OK),
        ([RUNS["timeouts"], {}], None, EXIT_INCOMPLETE),
        ([RUNS["lost"], {}], None, EXIT_NOT_JUDGED),
        ([{"c00.compliant.noise": "lost"}], None, EXIT_NOT_JUDGED),
        ([{}], RUNS["lost"], EXIT_NOT_JUDGED),
        ([{}], RUNS["timeouts"], EXIT_OK),
    ],
)
def test_the_exit_code_of_a_verification(draws, reference, code):
    found = verification(*draws, reference=reference)
    assert verification_code(found) == code
    console = Console(file=io.StringIO(), emoji=False, width=100)
    verify_command.show(found, console)
    text = console.file.getvalue()
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
    lost = RequirementFound(None, "quiet", 1e-6, 1.0, 3.0, 0, 0, "")
    found = replace(searched(), requirements={"A1": lost})
    assert shown_code(found) == EXIT_NOT_JUDGED and shown_code(searched()) == EXIT_OK
    assert found.broken == () and "A1 not judged" in repr(found) and "not judged" in found._repr_html_()
    crashed = replace(lost, passed=False, kind="no verdict", status=Status.CRASHED)
    assert "fails: a simulation ended with crashed" in replace(found, requirements={"A1": crashed})._repr_html_()


@pytest.mark.parametrize(("what", "code"), [("killed", EXIT_NOT_JUDGED), ("", EXIT_INCOMPLETE)])
def test_a_single_simulation_that_somebody_else_ended_is_not_judged(what, code, capsys):
    def command(_):
        raise Crash("it ended", what)

    assert guarded(command, []) == code


def test_a_line_is_whole_or_in_its_parts():
    assert str(Reason("A1 not met: why", "command")) == "A1 not met: why; repeat with command"
    assert str(Reason("A1 not judged: why", advice="do it again")) == "A1 not judged: why; do it again"
