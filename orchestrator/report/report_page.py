"""The page ``report.html`` of one run: what its static part says. The figures are made by the page's scripts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from . import pages
from .payload import criteria, report_payload
from .run import Run
from .tables import Document
from .wording import connectors, loop_delay, number, remarks, requirement_rows

SCALE_END = 1.15
"""End of the cost's scale, relative to the largest value on it."""


def report_html(run: Run) -> str:
    """The report as one HTML file."""
    document = run.document
    payload = report_payload(run)
    shown = {entry["id"]: index for index, entry in reversed(list(enumerate(payload["recordings"])))}
    return pages.render(
        "report.html",
        pages.REPORT,
        payload,
        run=document,
        headline=headline(document),
        criteria=criteria(run),
        requirements=requirement_rows(document),
        limit=document["rules"]["stability"]["limit_cycle"],
        facts=facts(document),
        remarks=remarks(document),
        shown=shown,
        poses=poses(document),
        stability=sorted(payload["stability"], key=_amplitude, reverse=True),
        failures=[case for case in document["cases"] if case["status"] != "done"],
        recorded=bool(payload["recordings"]),
    )


def headline(document: Document) -> dict[str, Any]:
    """V beside the paper's PID and the target: values, and places in percent on a common scale."""
    cost, rules = document["cost"], document["rules"]["cost"]
    marks = [("target", rules["target"]), ("paper's PID", rules["paper"])]
    end = SCALE_END * max(value for value in (cost, rules["target"], rules["paper"]) if value is not None)
    return {
        "cost": number(cost),
        "place": None if cost is None else 100 * cost / end,
        "marks": [{"name": name, "value": f"{value:g}", "place": 100 * value / end} for name, value in marks],
        "sentence": _sentence(cost, rules["target"], rules["paper"]),
    }


def _sentence(cost: float | None, target: float, paper: float) -> str:
    if cost is None:
        return "No cost: a case that counts has no value."
    side = "At or below" if cost <= target else "Above"
    change = 100 * (cost - paper) / paper
    direction = "less" if change < 0 else "more"
    return f"{side} the target of {target:g}, {abs(change):.0f} % {direction} than the paper reports for its PID."


def facts(document: Document) -> list[tuple[str, str]]:
    """What the run was, as pairs of a name and a text."""
    controller, plant, timing = document["controller"], document["plant"], document["timing"]
    sample_time = document["sample_time"]
    return [
        ("Controller", controller["file"]),
        ("Parameters set", _assignments(controller["parameters"]) or "none"),
        ("Connectors", connectors(document)),
        ("FMI version", str(controller["fmi_version"])),
        ("Made by", controller["generation_tool"] or "not stated"),
        ("SHA-256", controller["sha256"]),
        ("Benchmark", f"{document['benchmark']}, protocol {document['protocol']}"),
        ("Seed", str(document["seed"])),
        ("Sample time", f"{sample_time['seconds'] * 1e3:g} ms" + ("" if sample_time["as_in_benchmark"] else " (own)")),
        ("Loop delay", loop_delay(document["loop_delay"]).removeprefix("loop delay ")),
        ("Cases", f"{len(document['cases'])}, {timing['simulated_time']:.0f} simulated seconds"),
        ("Run", f"{timing['start']}, {timing['wall_time']:.0f} s on {_processes(timing['workers'])}"),
        ("Plant", f"{plant['file']}, SHA-256 {plant['sha256']}"),
        ("Versions", ", ".join(f"{name} {version}" for name, version in document["environment"].items())),
    ]


def poses(document: Document) -> dict[int, str]:
    """The configurations' link angles in words."""
    return {
        entry["index"]: f"{math.degrees(entry['q_a1']):.0f}° / {math.degrees(entry['q_a2']):.0f}°"
        for entry in document["configurations"]
    }


def _processes(count: int) -> str:
    return "1 process" if count == 1 else f"{count} processes"


def _assignments(parameters: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in parameters.items())


def _amplitude(row: Mapping[str, Any]) -> float:
    """For sorting: no amplitude at all is the worst."""
    return math.inf if row["limit_cycle"] is None else row["limit_cycle"]
