"""The README's leaderboard and the controllers' pages say what the figures say that were measured."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import pytest
from support.pid_fmus import built
from support.tools import require_for

import build_fmus
from benchmarks import leaderboard
from benchmarks import leaderboard_tables as tables
from benchmarks.claims import Claim, best_known, known, name_of
from benchmarks.submissions import LEGEND
from orchestrator.fmi.archive import read_description

KEPT = json.loads(leaderboard.FIGURES.read_text(encoding="utf-8"))
KNOWN = {name_of(figures): figures["robustness"] for figures in best_known(KEPT)}
ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    *sorted(ROOT.glob("docs/*.md")),
    *(ROOT / page / "README.md" for page in tables.PAGES.values()),
]

CLAIM = re.compile(
    r"\bno (known )?failures?\b|\bno system that breaks\b|without a known failure"
    r"|\bV found( of `\w+`)?( was| is| of)* \W*\d",
    re.I,
)
"""What a search did not find, or the V that it found."""

TRIED = re.compile(r"\bbudget\b|whole cases|\d simulations", re.I)
BY_OTHERS = re.compile(r"\battack|\bothers\b|\bindependent (genetic )?search|somebody", re.I)
"""What docs/rules.md asks for beside a claim, with the largest V that anybody has found."""


def test_all_tables_show_the_figures_that_are_kept():
    for file, text in tables.pages(KEPT).items():
        assert file.read_text(encoding="utf-8") == text, f"python benchmarks/leaderboard.py --table mends {file}"


def tables_of(text):
    """The tables of a page in Markdown, each as its head and its rows, lists of cells."""
    for block in re.findall(r"(?:^\|.*\n)+", text, re.M):
        head, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines())
        yield head, rows


def sayings_of(text):
    """The paragraphs and list items of a page, without tables and commands."""
    prose = re.sub(r"^```[\s\S]*?^```$|^(\||    |#).*$", "", text, flags=re.M)
    return re.split(r"\n\s*\n|\n(?=- )", prose)


def unsupported(text, subject=""):
    """The claims of a page about the project's controllers without what the rules ask for; ``subject`` is the one that
    is meant where none is named."""
    found = []
    for head, rows in tables_of(text):
        titles = " ".join(head)
        for row in rows:
            named = [name for name in KNOWN if name in row[0]]
            if not named or not (CLAIM.search(" ".join(row)) or "V found" in titles):
                continue
            largest = f"{KNOWN[named[0]]['cost']:.1f}" in " ".join(row)
            full = len(row) == len(head) and all(row)
            if not (largest and full and TRIED.search(titles) and BY_OTHERS.search(titles) and "V found" in titles):
                found.append(" | ".join(row))
    for saying in sayings_of(text):
        named = [name for name in KNOWN if name in saying] or [subject] * bool(subject)
        if named and CLAIM.search(saying):
            largest = all(f"{KNOWN[name]['cost']:.1f}" in saying for name in named)
            if not (largest and TRIED.search(saying) and BY_OTHERS.search(saying)):
                found.append(saying)
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_no_search_has_found_is_stated_with_what_was_tried(page):
    """docs/rules.md, "What is published of a search": budget, attacks by others, and the largest value of all."""
    subjects = {ROOT / place / "README.md": name for name, place in tables.PAGES.items()}
    subjects[ROOT / "docs" / "study.md"] = "RobustLQG"
    assert unsupported(page.read_text(encoding="utf-8"), subjects.get(page, "")) == []


@pytest.mark.parametrize(
    "claim",
    [
        "For `TunedPID` no failure is known.\n",
        "V found of `RobustLQG` is 99.2, with a budget of 30,000 and an attack by others.\n",
        "- `RobustLinearLQG`, without a known failure\n- others: 191.2, budget of 9,000\n",
        "| controller | V found |\n|---|---|\n| TunedPID | 214.4 |\n",
        "| controller | A1 | budget | attacks |\n|---|---|---|---|\n| TunedPID | no failure found | 9 | 0 |\n",
        "| controller | V found | budget | attacks |\n|---|---|---|---|\n| TunedPID | 214.4 | | 0 |\n",
        "| controller | V found | budget | attacks |\n|---|---|---|---|\n| RobustLQG | 99.2 | 30,000 | 2 |\n",
    ],
)
def test_a_claim_alone_is_noticed(claim):
    assert unsupported(claim)


def test_attacks_by_others_are_counted_once_each_whatever_they_found():
    own = KEPT[0]
    about = {"controller": name_of(own), "cases": "", "figure": "V", "date": ""}
    by = ("this project, from that arm", "somebody", "somebody", "somebody else")
    found = known(own, [Claim(**about, by=each, value=1.0) for each in by])["robustness"]
    assert found["attacks"] == 2 and found["cost"] == own["robustness"]["cost"]


def test_its_controllers_are_built_and_have_a_page():
    assert set(tables.PAGES) <= set(build_fmus.NAMES)
    assert {name_of(figures) for figures in KEPT} == set(tables.PAGES)


@pytest.mark.parametrize("name", tables.PAGES)
def test_each_row_links_its_page_its_animation_and_its_commands(name):
    rows = [line for line in tables.leaderboard(best_known(KEPT)).splitlines() if line.startswith(f"| [{name}]")]
    links = [tables.BOARD.parent / link.split("#")[0] for link in re.findall(r"\]\(([^)]*)\)", "".join(rows))]
    assert len(rows) == 2 and len(links) == 4 and all(link.is_file() for link in links)
    assert tables.animation(name) in links and tables.animation(name).stat().st_size < 2e5


def test_a_leaderboard_can_be_read():
    """At most eight columns each, the rest folded away, and a verdict is a mark behind the name of its requirement."""
    first, folded = tables.leaderboard(best_known(KEPT)).split("<details>")
    board = {row[0].split("]")[0][1:]: row for head, rows in tables_of(first) for row in rows if len(head) <= 8}
    assert board.keys() == KNOWN.keys() and board["RobustLQG"][3:6] == [
        "A1 ✓, A2 ✓, A3 ✓",
        "A1 ✓, A2 ✓, A3 ✓",
        "A1 ✓, A2 ✗, A3 ✗",
    ]
    ((head, rows),) = tables_of(folded)
    assert len(head) <= 8 and len(rows) == len(KNOWN)
    for page in (tables.BOARD, *(ROOT / place / "README.md" for place in tables.PAGES.values())):
        assert LEGEND in page.read_text(encoding="utf-8"), "what the marks mean"


@pytest.mark.parametrize("figures", KEPT, ids=name_of)
def test_the_figures_were_measured_with_the_fmus_there_are(figures, plant_file, fmu_folder):
    """The GUID is a hash of an FMU's contents, sources in the place of binaries."""
    name = name_of(figures)
    require_for(name)
    description = read_description(built(name, fmu_folder))
    assert description.guid == figures["guid"], "run benchmarks/leaderboard.py"
    assert hashlib.sha256(plant_file.read_bytes()).hexdigest() == figures["plant"], "run benchmarks/leaderboard.py"


@pytest.mark.parametrize("name", ["ManipulatorLQG", "DitheredLQG", "RobustLQG"])
def test_the_model_based_controllers_meet_the_papers_target_in_its_sample(name):
    (figures,) = (figures for figures in KEPT if name_of(figures) == name)
    assert figures["cost"] < 100.0
    assert all(requirement["passed"] for requirement in figures["stability"].values())


def test_what_meets_the_target_was_searched_with_the_largest_budget():
    """Else what the own search says of all systems would rest on the shorter of the searches."""
    found = {name_of(each): each["robustness"] for each in KEPT}
    meeting = {name for name, each in found.items() if leaderboard.meets(each)}
    largest = max(each["budget"] for each in found.values())
    assert meeting == {"SteadyLQG"} <= {name for name, each in found.items() if each["budget"] == largest}
    own = found["SteadyLQG"]
    assert not leaderboard.meets({**own, "radius": {**own["radius"], "cost": 0.0}})
    assert not leaderboard.meets({**own, "requirements": {"A1": {"passed": False}}})
    assert leaderboard.meets({**own, "radius": {**own["radius"], "cost": None}})


@pytest.mark.parametrize("figures", KEPT, ids=name_of)
def test_three_starts_of_the_search_agree(figures):
    starts = figures["robustness"]["starts"]
    assert len(starts) == leaderboard.STARTS and max(starts) <= figures["robustness"]["cost"]
    assert leaderboard.agree(starts)


@pytest.mark.parametrize("figures", KEPT, ids=name_of)
def test_what_fails_within_the_tolerances_has_a_radius_of_at_most_one(figures):
    found = figures["robustness"]
    if not all(entry["passed"] for entry in found["requirements"].values()):
        assert found["radius"]["stability"] <= 1.0


def test_those_that_were_found_to_fail_come_last():
    (tuned,) = (figures for figures in KEPT if name_of(figures) == "TunedPID")

    def figures(name, cost, passed=True):
        found = {**tuned["robustness"], "cost": cost, "requirements": {"A1": {"passed": passed}}}
        return known({**tuned, "controller": {"file": f"{name}.fmu"}, "robustness": found}, ())

    kept = [figures("TunedPID", 110.0), figures("DiagonalPID", 50.0, False), figures("ManipulatorLQG", 90.0)]
    lines = tables.leaderboard(kept).split("<details>")[0].splitlines()[2:-1]
    assert [line.split("]")[0][3:] for line in lines] == ["ManipulatorLQG", "TunedPID", "DiagonalPID"]
