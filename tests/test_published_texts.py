"""What others show of the project: the package page and the citation."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

import orchestrator

ROOT = Path(__file__).resolve().parents[1]


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_package_page_has_no_link_or_picture_that_leads_nowhere_on_an_index():
    (page,) = re.findall(r'^readme = "(.+?)"', text("pyproject.toml"), re.MULTILINE)
    links = re.findall(r"\]\(([^)]*)\)", text(page))
    assert links and [link for link in links if not link.startswith("https://")] == []


def test_the_citation_has_this_version_and_the_paper_as_on_its_page():
    citation = yaml.safe_load(text("CITATION.cff"))
    assert citation["version"] == orchestrator.__version__
    paper = citation["preferred-citation"]
    *others, last = [f"{each['given-names'][0]}. {each['family-names']}" for each in paper["authors"]]
    where = f"{paper['conference']['name']} {paper['year']}, {paper['conference']['city']}"
    assert f'{", ".join(others)} and {last}, "{paper["title"]}", {where}' in " ".join(text("docs/paper.md").split())
