"""How values are put into words and units, the paper's: in the terminal, in pages and in figures alike."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SHOWN = {"m": (1e3, "mm"), "N.m": (1.0, "Nm"), "s": (1.0, "s")}
"""Factor and name of the unit that a value is shown in."""

REQUIREMENTS = {
    "A1": "loop gain × {gain:g}, axis {axis}",
    "A2": "delay + {delay:g} ms, axis {axis}",
    "A3": "limit cycle, all tests",
}
"""What a requirement asks for."""


def number(value: float | None) -> str:
    """Three figures, four from 100 on; a dash where there is no value."""
    return "-" if value is None else f"{value:.3g}" if abs(value) < 100 else f"{value:.1f}"


def verdict(passed: bool | None) -> str:
    """The verdict on a requirement as a word."""
    return "not tested" if passed is None else "holds" if passed else "fails"


def amplitude(row: Mapping[str, Any]) -> str:
    """What the worst case of a requirement did: its limit cycle, or why there is none to speak of."""
    if row["worst_case"] is None:
        return "-"
    if row["limit_cycle"] is None:
        return "no value"
    if row["rest_error"] is not None:
        return f"no rest: {number(row['rest_error'] * 1e3)} mm"
    return f"{number(row['limit_cycle'] * 1e6)} µm"


def loop_delay(delay: Mapping[str, Any]) -> str:
    """The loop delay of ``results.json`` as a sentence."""
    if delay["seconds"] is None:
        return f"loop delay not measured: the controller {delay['convention'] or 'could not be probed'}"
    text = f"loop delay {delay['seconds'] * 1e3:.3f} ms = {delay['samples']:g} sample{'s' * (delay['samples'] != 1)}"
    within = f" ({delay['controller_samples']} of them in the controller)" if delay["controller_samples"] else ""
    return f"{text}{within}; the controller {delay['convention']}"


def connectors(document: Mapping[str, Any]) -> str:
    """What of the controller is connected, and which of the optional connectors it does not have."""
    entries = document["controller"]["connectors"]
    absent = [name for name, entry in entries.items() if entry is None and name != "e"]
    text = ", ".join(name for name, entry in entries.items() if entry is not None)
    return text + (f" (without {', '.join(absent)})" if absent else "")


def requirement_rows(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The requirements, A1 and A2 per axis, with a title, the verdict, the largest limit cycle [m] and its case."""
    rows = []
    for name, entry in document["stability"].items():
        tests = {str(test["axis"]): test for test in document["rules"]["tests"] if name in test["requirements"]}
        per_axis = "{axis}" in REQUIREMENTS[name]
        for axis, judged in entry["axes"].items() if per_axis else [("", entry)]:
            test = tests.get(axis, {"gain": 1.0, "delay": 0.0})
            title = REQUIREMENTS[name].format(axis=axis, gain=test["gain"], delay=test["delay"] * 1e3)
            rows.append({"name": name, "axis": axis, "title": title, **judged, "verdict": verdict(judged["passed"])})
    return rows


def without_cost(document: Mapping[str, Any]) -> str:
    """Why a complete run has no cost; empty where it has one."""
    if document["cost"] is not None or not document["complete"]:
        return ""
    criteria = {test["name"] for test in document["rules"]["tests"] if test["criteria"]}
    lost = [case for case in document["cases"] if case["test"] in criteria and case["status"] != "done"]
    return f"{len(lost)} of the cases that B1 to B7 are measured in are unstable"


def remarks(document: Mapping[str, Any]) -> list[str]:
    """What a reader must know before comparing the figures with others."""
    found = []
    unsettled = sum(case["measurements"].get("settled") is False for case in document["cases"])
    if unsettled:
        found.append(
            f"In {unsettled} case{'s' * (unsettled != 1)} B6 is the time to the end of the simulation: "
            "the TCP did not settle."
        )
    if not document["complete"]:
        found.append("Incomplete: not every case of the protocol has a verdict.")
    if reason := without_cost(document):
        found.append(f"No cost V: {reason}.")
    if not document["sample_time"]["as_in_benchmark"]:
        milliseconds = document["sample_time"]["seconds"] * 1e3
        found.append(f"Sample time {milliseconds:g} ms, not the benchmark's: not comparable.")
    if document["protocol"] != "paper":
        found.append(f"Protocol {document['protocol']}: not comparable to the paper nor to other protocols.")
    for entry in document["controller"]["connectors"].values():
        found += [f"{note}." for note in (entry or {}).get("notes", ())]
    if document["plant"]["parameters"]:
        changes = ", ".join(f"{name} = {value:g}" for name, value in document["plant"]["parameters"].items())
        found.append(f"The plant's nominal parameters were changed ({changes}): not comparable.")
    return found
