"""The page ``report.html`` of one run: what its static part says. The figures are drawn by the page's scripts."""

from __future__ import annotations

import math
from collections import Counter
from functools import partial
from typing import Any

from ..benchmark.results import Results
from ..loop.trajectory import Status
from . import pages
from .payload import criteria, report_payload
from .reasons import reasons
from .recording import SPREAD
from .repeat import simulate_command
from .run import Run, contradictions
from .wording import assignments, computing_time, connectors, loop_delay, number, remarks, requirement_rows, scale


def report_html(run: Run) -> str:
    """The report as one HTML file."""
    results = run.results
    payload = report_payload(run)

    def amplitude(row: dict[str, Any]) -> float:
        return math.inf if row["limit_cycle"] is None else row["limit_cycle"]  # none at all is the worst

    shown = {entry["id"]: index for index, entry in reversed(list(enumerate(payload["recordings"])))}
    return pages.render(
        "report.html",
        pages.REPORT,
        payload,
        results=results,
        headline=headline(results),
        criteria=criteria(results.criteria),
        requirements=requirement_rows(results),
        limit=results.rules.stability.limit_cycle,
        reasons=list(reasons(results)),
        endings=Counter(case.status.value for case in results.cases if case.status is not Status.DONE),
        facts=facts(results),
        remarks=remarks(results),
        contradictions=contradictions(run),
        shown=shown,
        command=partial(simulate_command, results),
        poses=poses(results),
        stability=sorted(payload["stability"], key=amplitude, reverse=True),
        spread=[entry.about.id for entry in run.recorded(SPREAD)],
        failures=[case for case in results.cases if case.status is not Status.DONE],
        recorded=bool(payload["recordings"]),
    )


def headline(results: Results) -> dict[str, Any]:
    """V beside the paper's PID and the target, and what it comes to."""
    cost, target, paper = results.cost, results.rules.cost.target, results.rules.cost.paper
    sentence = "No cost: a case that counts has no value."
    if cost is not None:
        side, direction = "At or below" if cost <= target else "Above", "less" if cost < paper else "more"
        change = f"{abs(100 * (cost - paper) / paper):.0f} % {direction}"
        sentence = f"{side} the target of {target:g}, {change} than the paper reports for its PID."
    return {
        "cost": number(cost),
        "scale": scale(cost, [("target", target), ("paper's PID", paper)]),
        "sentence": sentence,
    }


def facts(results: Results) -> list[tuple[str, str]]:
    """How the results were obtained, as pairs of a name and a text."""
    controller, plant, timing, sample_time = results.controller, results.plant, results.timing, results.sample_time
    processes = "1 process" if timing.workers == 1 else f"{timing.workers} processes"
    return [
        ("Controller", controller.file),
        ("Parameters set", assignments(controller.parameters) or "none"),
        ("Connectors", connectors(controller)),
        ("FMI version", controller.fmi_version),
        ("Made by", controller.generation_tool or "not stated"),
        ("SHA-256", controller.sha256),
        ("Benchmark", f"{results.benchmark}, protocol {results.protocol}"),
        ("Seed", str(results.seed)),
        ("Sample time", f"{sample_time.seconds * 1e3:g} ms" + ("" if sample_time.as_in_benchmark else " (own)")),
        ("Loop delay", loop_delay(results.loop_delay).removeprefix("loop delay ")),
        ("Computing time", f"{computing_time(results)}, per sample"),
        ("Cases", f"{len(results.cases)}, {timing.simulated_time:.0f} simulated seconds"),
        ("Run", f"{timing.start}, {timing.wall_time:.0f} s on {processes}"),
        ("Plant", f"{plant.file} ({plant.build}), SHA-256 {plant.sha256}"),
        ("Versions", ", ".join(f"{name} {version}" for name, version in results.environment.items())),
    ]


def poses(results: Results) -> dict[int, str]:
    """The configurations' link angles in words."""
    return {
        entry.index: f"{math.degrees(entry.q_a1):.0f}° / {math.degrees(entry.q_a2):.0f}°"
        for entry in results.configurations
    }
